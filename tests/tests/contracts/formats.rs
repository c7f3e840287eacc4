//! Table of formats: every real file is built and read back bit for bit, or refused with a reason, exactly as in
//! `docs/formats.md`.

use std::path::Path;

use supervol_tests::formats::{document, files, outcome};

#[test]
fn the_table_of_formats_is_true() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let data = root.join("../shared/data");
    if !data.is_dir() {
        supervol_tests::skipped("the data folder is not there: no real files to build");
        return;
    }
    let work = tempfile::tempdir().expect("a temporary folder");
    let files = files(&data).expect("the data folder can be listed");
    assert!(files.len() >= 70, "only {} files found in {}", files.len(), data.display());
    let outcomes: Vec<_> = files.iter().map(|f| outcome(&data, f, work.path())).collect();
    let expected = std::fs::read_to_string(root.join("docs/formats.md")).expect("docs/formats.md is there");
    let found = document(&outcomes);
    for (expected, found) in expected.lines().zip(found.lines()) {
        assert_eq!(
            expected, found,
            "docs/formats.md is out of date; CONTRIBUTING.md says how to make it (Generated files)"
        );
    }
    assert_eq!(expected.lines().count(), found.lines().count());
}
