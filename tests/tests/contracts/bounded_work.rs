//! Bounded work: small inputs cause little work and memory. Quadratic or unbounded code would show at these sizes.

use std::path::PathBuf;

use supervol_format::container::ContainerError;
use supervol_format::container::manifest::{BYTES_LIMIT, Manifest};
use supervol_format::{Container, Dims, VoxelType};
use supervol_preprocess::verify::verify;
use supervol_preprocess::{BuildOptions, build};
use supervol_sources::VolumeSource;
use supervol_sources::formats::nrrd::NrrdSource;
use supervol_sources::input::spool::SpoolFolder;
use supervol_sources::synthetic::Synthetic;
use supervol_tests::fields::{options, origin, try_build};

/// A file of 64 voxels with these lines in its NRRD header.
fn nrrd(lines: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("v.nrrd");
    let header = format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n{lines}\n");
    std::fs::write(&file, [header.as_bytes(), &[7; 64]].concat()).expect("room");
    (folder, file)
}

fn manifest_of(file: &std::path::Path) -> Manifest {
    let source = NrrdSource::open(file, &SpoolFolder::system()).unwrap_or_else(|e| panic!("{e}"));
    let built = try_build(&source, &options(16)).unwrap_or_else(|e| panic!("{e}"));
    built.container.manifest().clone()
}

#[test]
fn unknown_fields_are_counted_not_listed() {
    let lines: String = (0..300_000).map(|i| format!("f{i}: 1\n")).collect();
    let (_folder, file) = nrrd(&lines);
    let notes = manifest_of(&file).notes;
    assert!(notes.len() < 20 && notes.iter().any(|note| note.contains("299992 more fields")), "{notes:?}");
}

#[test]
fn lists_of_files_have_a_limit() {
    let (_folder, file) = nrrd(&format!("data file: LIST\n{}", "a\n".repeat(2_000_000)));
    let error = NrrdSource::open(&file, &SpoolFolder::system()).expect_err("too many files").to_string();
    assert!(error.contains("at most 65536 files"), "{error}");
}

/// Every text from a source file that is written can be read again.
#[test]
fn labels_and_units_of_any_length_make_a_container_that_opens() {
    let long = "\u{1}".repeat(3_400_000);
    let (_folder, file) = nrrd(&format!("labels: \"{long}\" \"b\" \"c\"\n"));
    let manifest = manifest_of(&file);
    assert!(manifest.axes[0].name.starts_with('\u{1}') && manifest.axes[0].name.len() < 300);
}

#[test]
fn no_manifest_is_longer_than_readers_take() {
    let built =
        try_build(&Synthetic::new("sphere", Dims([8; 3]), None, 1).expect("a name"), &options(16)).expect("it builds");
    let mut manifest = built.container.manifest().clone();
    assert_eq!(Manifest::from_json(&manifest.to_json().expect("a manifest")).as_ref(), Ok(&manifest));
    manifest.notes = vec!["x".repeat(BYTES_LIMIT as usize)];
    assert!(manifest.to_json().is_err_and(|e| e.contains("at most")));
    // The same for a source.
    let mut noisy = Noisy(Synthetic::new("sphere", Dims([8; 3]), None, 1).expect("a name"), None);
    let mut info = noisy.0.info().clone();
    info.notes = vec!["x".repeat(1000).into(); 10_000];
    info.unit = "y".repeat(1 << 20);
    noisy.1 = Some(info);
    let built = try_build(&noisy, &options(16)).expect("it builds");
    assert!(built.container.manifest().notes.len() < 100);
}

/// A volume with far too many notes.
struct Noisy(Synthetic, Option<supervol_sources::SourceInfo>);

impl VolumeSource for Noisy {
    fn info(&self) -> &supervol_sources::SourceInfo {
        self.1.as_ref().unwrap_or_else(|| self.0.info())
    }

    fn read_box(&self, voxels: supervol_format::VoxelBox, out: &mut [u8]) -> Result<(), supervol_sources::SourceError> {
        self.0.read_box(voxels, out)
    }
}

/// A line of many small bricks: eviction from a full cache must not examine all of them.
#[test]
fn long_thin_volumes_build_and_verify() -> Result<(), ContainerError> {
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("line.svol");
    let source = Synthetic::new("ramp", Dims([4_000_000, 1, 1]), Some(VoxelType::U8), 1).expect("a name");
    let options = BuildOptions { memory_bytes: 256 << 20, ..options(16) };
    build(&source, origin(), &output, &options, &|_| ()).unwrap_or_else(|e| panic!("{e}"));
    verify(&output, 64 << 20, &|_, _| ()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(Container::open(&output)?.pyramid().levels()[0].bricks, [250_000, 1, 1]);
    Ok(())
}
