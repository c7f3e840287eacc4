//! Archives of NumPy arrays: a real one compared with NumPy, small ones written by these tests, damaged ones.

use std::io::Write;
use std::path::{Path, PathBuf};

use supervol_format::{Dims, VoxelType};
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{SourceError, VolumeSource};
use zip::CompressionMethod;
use zip::write::{SimpleFileOptions, ZipWriter};

use crate::grid_support;
use grid_support::*;

/// Least, greatest and sum of the voxels, and the voxel (32, 64, 128), by NumPy.
const STENT: (f64, f64, f64, f64) = (0.0, 2000.0, 148_470_906.0, 0.0);

fn opened(path: &Path) -> Result<Box<dyn VolumeSource>, SourceError> {
    open(path, &OpenOptions::default())
}

fn named(path: &Path, array: &str) -> PathBuf {
    PathBuf::from(format!("{}:/{array}", path.display()))
}

fn npy(voxels: &[u8]) -> Vec<u8> {
    let mut text = b"{'descr': '<i2', 'fortran_order': False, 'shape': (5, 4, 3)}".to_vec();
    text.resize(117, b' ');
    text.push(b'\n');
    [&b"\x93NUMPY\x01\x00"[..], &(text.len() as u16).to_le_bytes(), &text, voxels].concat()
}

fn npz(arrays: &[(&str, &[u8])], method: CompressionMethod) -> Vec<u8> {
    let mut archive = ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, voxels) in arrays {
        archive.start_file(*name, SimpleFileOptions::default().compression_method(method)).unwrap();
        archive.write_all(&npy(voxels)).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

#[test]
fn a_real_archive_is_what_numpy_reads() {
    let Some(path) = data_file("npz/stent.npz") else { return };
    for path in [path.clone(), named(&path, "arr_0")] {
        let source = opened(&path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((source.info().dims, source.info().voxel_type), (Dims([128, 128, 256]), VoxelType::I16));
        assert_eq!(summary(source.as_ref(), [32, 64, 128]), STENT);
    }
}

#[test]
fn arrays_are_named_where_there_are_several() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let [first, second] = [3, 4].map(|seed| random_voxels([3, 4, 5], VoxelType::I16, seed));
    for method in [CompressionMethod::Stored, CompressionMethod::Deflated] {
        std::fs::write(&path, npz(&[("ct.npy", &first)], method)).unwrap();
        check_boxes(opened(&path).unwrap().as_ref(), &first, 3);
        std::fs::write(&path, npz(&[("ct.npy", &first), ("pet.npy", &second)], method)).unwrap();
        assert_refused(opened(&path), &["2 arrays: ", "ct", "pet", ":/NAME"]);
        check_boxes(opened(&named(&path, "pet")).unwrap().as_ref(), &second, 3);
        check_boxes(opened(&named(&path, "ct.npy")).unwrap().as_ref(), &first, 3);
        assert_refused(opened(&named(&path, "mr")), &["no array `mr`", "pet"]);
    }
    std::fs::write(&path, npz(&[("readme.txt", &first)], CompressionMethod::Stored)).unwrap();
    assert_refused(opened(&path), &["without NumPy arrays"]);
    std::fs::write(&path, "no archive").unwrap();
    assert_refused(opened(&path), &["a whole archive"]);
}

#[test]
fn damaged_archives() {
    let folder = tempfile::tempdir().unwrap();
    let voxels = random_voxels([3, 4, 5], VoxelType::I16, 8);
    for method in [CompressionMethod::Stored, CompressionMethod::Deflated] {
        let file = npz(&[("ct.npy", &voxels)], method);
        fuzz_header(folder.path(), "v.npz", &file, file.len(), 5000, opened);
    }
    let largest = largest_allocation::largest_bytes();
    assert!(largest < 8 << 20, "{largest} bytes at once");
}
