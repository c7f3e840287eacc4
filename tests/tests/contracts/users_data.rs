//! A source file that changes while it is read: the build reports it and leaves no file.

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use supervol_format::{Dims, Geometry, VoxelBox, VoxelType};
use supervol_preprocess::{BuildError, build, identify};
use supervol_sources::formats::raw::{RawOptions, RawSource};
use supervol_sources::{Endian, SourceError, SourceInfo, VolumeSource};
use supervol_tests::fields::options;

const DIMS: Dims = Dims([40, 40, 40]);

/// A change to a file.
type Change = dyn Fn(&Path) + Sync;

/// A source that changes its file at the first read of voxels.
struct Disturbed<'a> {
    source: RawSource,
    disturb: &'a (dyn Fn() + Sync),
    is_done: AtomicBool,
}

impl VolumeSource for Disturbed<'_> {
    fn info(&self) -> &SourceInfo {
        self.source.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        if !self.is_done.swap(true, Ordering::Relaxed) {
            (self.disturb)();
        }
        self.source.read_box(voxels, out)
    }
}

fn open(file: &Path) -> RawSource {
    let raw = RawOptions {
        dims: DIMS,
        voxel_type: VoxelType::U8,
        endian: Endian::Little,
        header_bytes: 0,
        geometry: Geometry::IDENTITY,
        nodata: None,
    };
    RawSource::open(file, &raw).expect("a raw file")
}

fn build_while(file: &Path, disturb: &(dyn Fn() + Sync)) -> Result<(), BuildError> {
    let source = open(file);
    let origin = identify(file, "raw").expect("a raw file");
    let disturbed = Disturbed { source, disturb, is_done: AtomicBool::new(false) };
    build(&disturbed, origin, &file.with_extension("svol"), &options(16), &|_| ()).map(drop)
}

fn volume(folder: &Path) -> PathBuf {
    let file = folder.join("v.raw");
    std::fs::write(&file, vec![7; 40 * 40 * 40]).expect("a temporary folder has room");
    file
}

fn overwrite(file: &Path, at: u64, bytes: &[u8]) {
    let mut out = File::options().write(true).open(file).expect("the file is there");
    out.seek(SeekFrom::Start(at)).expect("a file can be sought in");
    out.write_all(bytes).expect("a temporary folder has room");
}

#[test]
fn a_source_that_changes_while_it_is_read_is_refused() {
    let cases: [(&str, &Change); 5] = [
        ("written to", &|file| overwrite(file, 100, &[8])),
        // The modification time can be set back.
        ("written to", &|file| {
            let modified = file.metadata().and_then(|m| m.modified()).expect("a time");
            overwrite(file, 100, &[8]);
            File::options().write(true).open(file).and_then(|f| f.set_modified(modified)).expect("a file of ours");
        }),
        ("64000 bytes, now it has 64001", &|file| overwrite(file, 64000, &[8])),
        ("another file", &|file| {
            std::fs::write(file.with_extension("new"), vec![8; 40 * 40 * 40]).expect("room");
            std::fs::rename(file.with_extension("new"), file).expect("one folder");
        }),
        ("v.raw", &|file| std::fs::remove_file(file).expect("a file of ours")),
    ];
    for (said, change) in cases {
        let folder = tempfile::tempdir().expect("a folder");
        let file = volume(folder.path());
        let error = build_while(&file, &|| change(&file)).err().unwrap_or_else(|| panic!("{said}: built"));
        let message = error.to_string();
        assert!(message.contains(said) && message.contains("v.raw"), "{said}: {message}");
        let left = std::fs::read_dir(folder.path()).expect("a folder").map(|e| e.expect("an entry").path());
        assert!(left.filter(|path| *path != file).count() == 0, "{said}: something is left");
    }
}

#[test]
fn a_checksum_of_another_version_is_found_out() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = volume(folder.path());
    let mut origin = identify(&file, "raw").expect("a raw file");
    origin.xxh3_64 = "0123456789abcdef".into();
    let source = open(&file);
    let error = build(&source, origin, &file.with_extension("svol"), &options(16), &|_| ()).expect_err("it is another");
    assert!(error.to_string().contains("checksum was 0123456789abcdef"), "{error}");
}

#[test]
fn a_source_that_is_left_alone_builds() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = volume(folder.path());
    // Reading is not a change.
    build_while(&file, &|| drop(std::fs::read(&file))).expect("nothing happened to it");
}
