//! Names of containers, derived from their inputs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use supervol_sources::open::split_array;
use xxhash_rust::xxh3::xxh3_64;

use crate::batch::results::Record;

/// Compression endings, which follow another ending.
const COMPRESSIONS: [&str; 1] = ["gz"];

/// Default path of an input's container: in the input's folder.
#[must_use]
pub fn container_beside(input: &Path) -> PathBuf {
    let (file, _) = split_array(input);
    let whole = std::fs::canonicalize(&file).unwrap_or_else(|_| file.clone());
    let name = format!("{}.svol", stem_of(input));
    // The path as given, unless it has no name of its own, such as `.` or `..`.
    match (file.file_name(), whole.parent()) {
        (None, Some(folder)) => folder.join(name),
        _ => file.with_file_name(name),
    }
}

/// Names of containers for inputs, in order. Inputs in `known` keep their names; all others get new ones. If two would
/// have the same name, a number computed from their paths is added. Names that differ only in case count as the same.
#[must_use]
pub fn container_names(inputs: &[PathBuf], known: &BTreeMap<String, Record>) -> Vec<String> {
    let of_input = |input: &PathBuf| known.get(&*input.to_string_lossy()).map(|record| record.container.clone());
    let mut taken: BTreeSet<String> = known.values().map(|record| record.container.to_lowercase()).collect();
    let mut wanted: BTreeMap<String, usize> = BTreeMap::new();
    for input in inputs.iter().filter(|input| of_input(input).is_none()) {
        *wanted.entry(stem_of(input).to_lowercase()).or_default() += 1;
    }
    let mut name = |input: &PathBuf| {
        let stem = stem_of(input);
        let plain = format!("{stem}.svol");
        if wanted[&stem.to_lowercase()] == 1 && taken.insert(plain.to_lowercase()) {
            return plain;
        }
        let path = input.to_string_lossy();
        let numbered = |n: u64| format!("{stem}-{:016x}.svol", xxh3_64(format!("{n}{path}").as_bytes()));
        let mut n = 0;
        loop {
            let name = numbered(n);
            if taken.insert(name.to_lowercase()) {
                return name;
            }
            n += 1;
        }
    };
    inputs.iter().map(|input| of_input(input).unwrap_or_else(|| name(input))).collect()
}

/// Name of an input without its ending.
fn stem_of(input: &Path) -> String {
    let (file, array) = split_array(input);
    let whole = std::fs::canonicalize(&file).unwrap_or(file);
    let mut stem = whole.clone();
    if !whole.is_dir() {
        if whole.extension().is_some_and(|ending| COMPRESSIONS.iter().any(|c| ending.eq_ignore_ascii_case(c))) {
            stem.set_extension("");
        }
        stem.set_extension("");
    }
    let stem = stem.file_name().map_or_else(|| "volume".into(), |name| name.to_string_lossy().into_owned());
    let array = array.map(|array| array.replace(['/', '\\'], "-")).filter(|array| !array.is_empty());
    array.map_or(stem.clone(), |array| format!("{stem}-{array}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn containers_have_names_of_their_own() {
        let inputs = ["a/x.sgy", "b/x.sgy", "b/X.nii.gz", "c/y.nii.gz", "d/z.h5:/g/t", "e/new.raw"].map(PathBuf::from);
        let known = BTreeMap::from([("q".to_owned(), Record { container: "New.svol".into(), ..Record::default() })]);
        let names = container_names(&inputs, &known);
        assert_eq!(names[3..5], ["y.svol", "z-g-t.svol"]);
        for (name, stem) in names.iter().zip(["x-", "x-", "X-"]).chain([(&names[5], "new-")]) {
            assert!(name.starts_with(stem) && name.len() == stem.len() + 16 + 5, "{name}");
        }
        let lower: BTreeSet<String> = names.iter().map(|name| name.to_lowercase()).collect();
        assert_eq!(lower.len(), inputs.len(), "{names:?}");
        // An input keeps its name when other inputs are added.
        let first = Record { container: "x.svol".into(), ..Record::default() };
        let known = BTreeMap::from([("a/x.sgy".to_owned(), first)]);
        let again = container_names(&inputs[..2], &known);
        assert!(again[0] == "x.svol" && again[1].starts_with("x-"), "{again:?}");
    }

    #[test]
    fn a_container_lies_beside_its_input() {
        let folder = tempfile::tempdir().unwrap();
        let series = folder.path().join("series.v2");
        std::fs::create_dir(&series).unwrap();
        for (input, container) in [("a/x.sgy", "a/x.svol"), ("y.nii.gz", "y.svol"), ("d/z.h5:/g/t", "d/z-g-t.svol")] {
            assert_eq!(container_beside(Path::new(input)), Path::new(container));
        }
        for input in [series.clone(), series.join(""), series.join(".")] {
            let container = container_beside(&input);
            assert_eq!(container, folder.path().join("series.v2.svol"), "{input:?}");
        }
    }
}
