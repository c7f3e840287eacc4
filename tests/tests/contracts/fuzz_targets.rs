//! Lists of fuzz targets: every body of `fuzz_bodies::all` is in each of them, and nothing else is.

use std::collections::BTreeSet;
use std::path::Path;

use supervol_tests::fuzz_bodies;

/// Bodies that only the seeded test runs: the fuzz targets are built without the crates that draw.
const SEEDED_ONLY: [&str; 1] = ["scene_files"];

/// Text of a file, by its path from the root of the repository.
fn text(path: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// Every text between `start` and the next `end`.
fn between(text: &str, start: &str, end: &str) -> BTreeSet<String> {
    text.split(start).skip(1).filter_map(|rest| rest.split_once(end)).map(|(name, _)| name.to_owned()).collect()
}

#[test]
fn every_fuzz_body_is_in_every_list_of_targets() {
    let is_fuzzed = |name: &str| !SEEDED_ONLY.contains(&name);
    let bodies: BTreeSet<String> =
        fuzz_bodies::all().into_iter().filter(|(name, ..)| is_fuzzed(name)).map(|(name, ..)| name.to_owned()).collect();
    let ci = text("tools/ci.sh");
    let (_, targets) = ci.split_once("FUZZ_TARGETS=(").expect("tools/ci.sh lists the targets");
    let (targets, _) = targets.split_once(')').expect("the list ends");
    let manifest = text("fuzz/Cargo.toml");
    let mut seeded = between(&text("tests/tests/drawn/fuzz_seeds.rs"), "run(\"", "\")");
    seeded.retain(|name| is_fuzzed(name));
    let lists = [
        ("FUZZ_TARGETS in tools/ci.sh", targets.split_whitespace().map(str::to_owned).collect()),
        ("names in fuzz/Cargo.toml", between(&manifest, "[[bin]]\nname = \"", "\"")),
        ("paths in fuzz/Cargo.toml", between(&manifest, "path = \"fuzz_targets/", ".rs\"")),
        ("tests in tests/tests/drawn/fuzz_seeds.rs", seeded),
    ];
    for (list, found) in lists {
        let missing: Vec<_> = bodies.difference(&found).collect();
        let unknown: Vec<_> = found.difference(&bodies).collect();
        assert!(missing.is_empty() && unknown.is_empty(), "{list}: missing {missing:?}, without a body {unknown:?}");
    }
    for name in bodies {
        let target = text(&format!("fuzz/fuzz_targets/{name}.rs"));
        assert!(target.contains(&format!("::{name}(")), "fuzz/fuzz_targets/{name}.rs does not call the body {name}");
    }
}
