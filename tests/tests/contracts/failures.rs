//! Failures of the machine and wrong commands: the message names the problem, the place and the remedy, and no file is
//! left.

use std::path::Path;
use std::process::Command;

use supervol_format::VoxelType;
use supervol_preprocess::{BuildError, BuildOptions, Existing, build};
use supervol_sources::VolumeSource;
use supervol_tests::faults::FailingVolume;
use supervol_tests::fields::{Content, Field, options, origin, try_build};
use supervol_tests::skipped;

fn field() -> Field {
    Field::of(Content::Noise, [70, 40, 50], VoxelType::U16)
}

fn build_at(source: &dyn VolumeSource, output: &Path, options: &BuildOptions) -> Result<(), BuildError> {
    build(source, origin(), output, options, &|_| ()).map(|_| ())
}

fn files_in(folder: &Path) -> Vec<std::ffi::OsString> {
    std::fs::read_dir(folder).expect("the folder is there").map(|e| e.expect("an entry").file_name()).collect()
}

#[test]
fn an_existing_output_is_kept_unless_told_otherwise() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("out.svol");
    std::fs::write(&output, b"precious").expect("a small file");
    let error = build_at(&field(), &output, &options(16)).expect_err("the output exists");
    assert!(error.to_string().contains("`existing`"), "{error}");
    assert!(error.is_wrong_command());
    assert_eq!(std::fs::read(&output).expect("still there"), b"precious");
    // A build that fails half way keeps the old file, even if it may replace it.
    let replace = BuildOptions { existing: Existing::Replace, ..options(16) };
    let failing = FailingVolume::new(field(), 1);
    build_at(&failing, &output, &replace).expect_err("the source fails");
    assert_eq!(std::fs::read(&output).expect("still there"), b"precious");
    build_at(&field(), &output, &replace).expect("replacing is allowed");
    supervol_format::Container::open(&output).expect("a container took its place");
    assert_eq!(files_in(folder.path()), ["out.svol"]);
}

#[test]
fn a_source_that_fails_at_any_read_leaves_nothing_behind() {
    // Little memory, so that the source is read in many boxes.
    let options = BuildOptions { memory_bytes: 2 << 20, ..options(16) };
    let long = || Field::of(Content::Noise, [70, 40, 150], VoxelType::U16);
    let never = FailingVolume::new(long(), u64::MAX);
    try_build(&never, &options).expect("a source that does not fail builds");
    assert!(never.boxes() > 4, "{} boxes are too few to tell", never.boxes());
    for fail_at in 0..never.boxes() {
        let folder = tempfile::tempdir().expect("a folder");
        let failing = FailingVolume::new(long(), fail_at);
        let error = build_at(&failing, &folder.path().join("out.svol"), &options)
            .err()
            .unwrap_or_else(|| panic!("box {fail_at} failed and the build did not"));
        let message = error.to_string();
        assert!(message.contains("injected.raw") && message.contains("injected read failure"), "{message}");
        assert!(error.is_machine_failure(), "{message}");
        assert!(files_in(folder.path()).is_empty(), "box {fail_at}: {:?} are left", files_in(folder.path()));
    }
}

#[test]
fn outputs_that_cannot_be_written_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let nowhere = folder.path().join("missing").join("out.svol");
    let error = build_at(&field(), &nowhere, &options(16)).expect_err("the folder does not exist");
    assert!(error.to_string().contains("missing") && error.to_string().contains("does not exist"), "{error}");
    assert!(error.is_machine_failure());
}

#[test]
fn too_little_memory_is_refused_with_what_would_do() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("out.svol");
    let little = BuildOptions { memory_bytes: 100_000, ..options(64) };
    let error = build_at(&field(), &output, &little).expect_err("100 kB are too little");
    let message = error.to_string();
    assert!(["memory", "`memory_bytes`", "`layout`", "MiB"].iter().all(|w| message.contains(w)), "{message}");
    assert!(error.is_wrong_command());
    assert!(files_in(folder.path()).is_empty());
    // The memory that the message asks for must suffice.
    let needed: u64 = message.split(' ').next().and_then(|n| n.parse().ok()).expect("the message begins with a number");
    let enough = BuildOptions { memory_bytes: needed << 20, ..options(64) };
    build_at(&field(), &output, &enough).unwrap_or_else(|e| panic!("{needed} MiB: {e}"));
}

/// A file system of limited size, unmounted when it is dropped.
struct SmallDisk(tempfile::TempDir);

impl SmallDisk {
    fn mount(bytes: u64) -> Option<Self> {
        let folder = tempfile::tempdir().ok()?;
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &format!("size={bytes}"), "tmpfs"])
            .arg(folder.path())
            .output()
            .is_ok_and(|o| o.status.success());
        mounted.then_some(Self(folder))
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.0.path()).status();
    }
}

#[test]
fn a_full_disk_is_named_and_nothing_is_left() {
    // Sizes from nothing to almost enough: the disk fills at the header, at bricks, at the TOC.
    let whole = try_build(&field(), &options(16)).expect("the field builds").report.container_bytes;
    for bytes in [4096, whole / 4, whole / 2, whole * 3 / 4, whole - 8192] {
        let Some(disk) = SmallDisk::mount(bytes) else {
            skipped("the full-disk test needs the right to mount a tmpfs (run as root)");
            return;
        };
        let output = disk.0.path().join("out.svol");
        let error = build_at(&field(), &output, &options(16)).expect_err("the disk is too small");
        let message = error.to_string();
        assert!(message.contains("The disk is full") && message.contains("out.svol"), "{bytes} bytes: {message}");
        assert!(error.is_machine_failure());
        assert!(files_in(disk.0.path()).is_empty(), "{bytes} bytes: {:?} are left", files_in(disk.0.path()));
    }
}

/// A u8 number as text takes two bytes, decoded one byte. The disk is too small for the decoded voxels.
#[test]
fn a_disk_that_fills_while_voxels_are_decoded_is_named() {
    use supervol_sources::formats::nrrd::NrrdSource;
    use supervol_sources::input::spool::SpoolFolder;
    let Some(disk) = SmallDisk::mount(64 << 10) else {
        skipped("the full-disk test needs the right to mount a tmpfs (run as root)");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("v.nrrd");
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 128 128 64\nencoding: text\n\n";
    std::fs::write(&path, header.to_owned() + &"7 ".repeat(128 * 128 * 64)).expect("room");
    let error = NrrdSource::open(&path, &SpoolFolder::at(disk.0.path())).expect_err("the disk is too small");
    let error = BuildError::from(error);
    let message = error.to_string();
    assert!(
        message.contains("The disk is full") && message.contains(&disk.0.path().display().to_string()),
        "{message}"
    );
    assert!(error.is_machine_failure());
}
