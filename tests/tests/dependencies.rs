//! Licences, advisories and origins of all packages that the program, its tests and its fuzz targets compile. They are
//! compared with `tools/dependencies.json`, which is maintained by hand. Accepted advisories have a reason and are
//! removed when they are no longer needed. The test needs no network beyond that of a build.

use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// The only accepted origin of packages.
const REGISTRY: &str = "registry+https://github.com/rust-lang/crates.io-index";

struct Package {
    name: String,
    version: String,
    licence: String,
    source: Option<String>,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the tests are a member of the workspace")
}

/// Every package in the lock file of a manifest, ours included.
fn packages(manifest: &str) -> Vec<Package> {
    let arguments = ["metadata", "--locked", "--format-version", "1", "--manifest-path"];
    let output = Command::new(env!("CARGO")).args(arguments).arg(root().join(manifest)).output().expect("cargo starts");
    assert!(output.status.success(), "{manifest}: {}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo writes JSON");
    let text = |value: &Value| value.as_str().map(str::to_owned);
    let packages = metadata["packages"].as_array().expect("a list of packages").iter();
    let package = |p: &Value| Package {
        name: text(&p["name"]).expect("a name"),
        version: text(&p["version"]).expect("a version"),
        licence: text(&p["license"]).unwrap_or_default(),
        source: text(&p["source"]),
    };
    packages.map(package).collect()
}

/// Major, minor and patch number; missing ones are 0. A pre-release counts as its release.
fn version(text: &str) -> [u64; 3] {
    let plain = text.split(['-', '+']).next().unwrap_or_default();
    let mut numbers = plain.split('.').map(|n| n.parse().unwrap_or_else(|e| panic!("version {text}: {e}")));
    std::array::from_fn(|_| numbers.next().unwrap_or(0))
}

/// Whether a version lies in one of the ranges `[first affected, first fixed]`; the second is empty if there is no fix.
fn is_affected(found: &str, ranges: &Value) -> bool {
    let found = version(found);
    ranges.as_array().expect("a list of ranges").iter().any(|range| {
        let end = range[1].as_str().expect("a version or nothing");
        version(range[0].as_str().expect("a version")) <= found && (end.is_empty() || found < version(end))
    })
}

#[test]
fn versions_are_compared_by_their_numbers() {
    let ranges = serde_json::json!([["0.5.12", "0.5.15"], ["2", ""]]);
    for (version, affected) in [
        ("0.5.9", false),
        ("0.5.12", true),
        ("0.5.14+meta", true),
        ("0.5.15", false),
        ("1.99.0", false),
        ("2.0.1", true),
    ] {
        assert_eq!(is_affected(version, &ranges), affected, "{version}");
    }
}

#[test]
fn licences_are_compatible_and_no_advisory_is_overlooked() {
    let text = std::fs::read_to_string(root().join("tools/dependencies.json")).expect("the list is there");
    let list: Value = serde_json::from_str(&text).expect("the list is JSON");
    let licences: BTreeSet<&str> =
        list["licences"].as_array().expect("licences").iter().filter_map(Value::as_str).collect();
    let packages: Vec<Package> = ["Cargo.toml", "fuzz/Cargo.toml"].into_iter().flat_map(packages).collect();
    assert!(packages.len() > 100, "{} packages are not all", packages.len());

    let mut wrong = Vec::new();
    for Package { name, version, licence, source } in &packages {
        if !licences.contains(licence.as_str()) {
            wrong.push(format!("{name} {version}: licence `{licence}` is not in tools/dependencies.json"));
        }
        if source.as_deref().is_some_and(|source| source != REGISTRY) {
            wrong.push(format!("{name} {version}: comes from {source:?}"));
        }
    }
    for advisory in list["advisories"].as_array().expect("advisories") {
        let hit = packages
            .iter()
            .find(|p| advisory["package"] == p.name.as_str() && is_affected(&p.version, &advisory["affected"]));
        match (hit, advisory["accepted"].as_str()) {
            (Some(p), None) => wrong.push(format!("{} {}: {}", p.name, p.version, advisory["id"])),
            (None, Some(_)) => wrong.push(format!("{}: accepted, but nothing is affected any more", advisory["id"])),
            (Some(_), Some(_)) | (None, None) => {}
        }
    }
    wrong.sort();
    wrong.dedup();
    assert!(wrong.is_empty(), "{wrong:#?}");
}
