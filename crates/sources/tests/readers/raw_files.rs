//! Raw files: every type and byte order, boxes compared with a naive copy, and wrong lengths.

use std::path::Path;

use supervol_format::{Dims, Geometry, VoxelType};
use supervol_sources::formats::raw::{RawOptions, RawSource};
use supervol_sources::{Endian, VolumeSource};

use crate::grid_support;
use grid_support::{BOTH_ORDERS, assert_refused, check_boxes, data_file, in_order, random_voxels, summary};

fn options(dims: [u64; 3], voxel_type: VoxelType) -> RawOptions {
    RawOptions {
        dims: Dims(dims),
        voxel_type,
        endian: Endian::Little,
        header_bytes: 0,
        geometry: Geometry::IDENTITY,
        nodata: None,
    }
}

#[test]
fn walnut() {
    let Some(path) = data_file("raw/walnut_128x96x114_u16le.raw") else { return };
    let source = RawSource::open(&path, &options([128, 96, 114], VoxelType::U16)).unwrap();
    assert_eq!(summary(&source, [64, 48, 57]), (0.0, 22526.0, 2_873_024_118.0, 5353.0));
    assert_eq!(grid_support::value_at(&source, [30, 20, 10]), 732.0);
    let wrong = RawSource::open(&path, &options([128, 96, 115], VoxelType::U16));
    assert_refused(wrong, &["2826240 bytes", "2801664 bytes", "`dims` 128,96,114 fits"]);
}

#[test]
fn round_trips() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("volume.raw");
    for dims in [[7, 5, 3], [1, 1, 19], [19, 1, 1], [1, 1, 1], [65, 33, 9], [600, 3, 2]] {
        for voxel_type in VoxelType::ALL {
            for endian in BOTH_ORDERS {
                let voxels = random_voxels(dims, voxel_type, 11);
                let mut file = vec![0xee; 13];
                file.extend(in_order(&voxels, voxel_type.bytes(), endian));
                std::fs::write(&path, file).unwrap();
                let options = RawOptions { endian, header_bytes: 13, nodata: Some(3.0), ..options(dims, voxel_type) };
                let source = RawSource::open(&path, &options).unwrap();
                assert_eq!((source.info().format, source.info().nodata), ("raw", Some(3.0)));
                check_boxes(&source, &voxels, 5);
            }
        }
    }
}

/// Distant rows are read one by one, close rows as one span; both must agree with the naive copy.
#[test]
fn wide_rows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("volume.raw");
    for dims in [[6000, 40, 3], [1500, 1200, 2]] {
        let voxels = random_voxels(dims, VoxelType::I16, 3);
        std::fs::write(&path, in_order(&voxels, 2, Endian::Big)).unwrap();
        let options = RawOptions { endian: Endian::Big, ..options(dims, VoxelType::I16) };
        check_boxes(&RawSource::open(&path, &options).unwrap(), &voxels, 17);
    }
}

#[test]
fn wrong_options() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("volume.raw");
    std::fs::write(&path, vec![0; 1000]).unwrap();
    let open = |options: &RawOptions| RawSource::open(&path, options);
    let ten = options([10, 10, 10], VoxelType::U8);
    assert!(open(&ten).is_ok());
    assert_refused(
        open(&options([10, 10, 10], VoxelType::I16)),
        &["2000 bytes", "1000 bytes", "`voxel_type` u8 or i8 fits"],
    );
    assert_refused(
        open(&options([10, 10, 9], VoxelType::U8)),
        &["900 bytes", "`header_bytes` 100 fits", "`dims` 10,10,10"],
    );
    assert_refused(open(&RawOptions { header_bytes: 1, ..ten.clone() }), &["1001 bytes", "1000 bytes"]);
    assert_refused(open(&RawOptions { header_bytes: u64::MAX, ..ten.clone() }), &["1000 bytes"]);
    assert_refused(open(&options([0, 10, 10], VoxelType::U8)), &["0 x 10 x 10"]);
    assert_refused(open(&options([1 << 23, 1 << 23, 1 << 23], VoxelType::U8)), &["2^64"]);
    let bent = Geometry { spacing: [1.0, 0.0, 1.0], ..Geometry::IDENTITY };
    assert_refused(open(&RawOptions { geometry: bent, ..ten.clone() }), &["spacing"]);
    let error = RawSource::open(Path::new("no/such/file.raw"), &ten).unwrap_err();
    assert!(matches!(error, supervol_sources::SourceError::Io { .. }), "{error}");
}

/// A sparse file beyond 4 GiB: offsets have 64 bits everywhere.
#[cfg(unix)]
#[test]
fn beyond_four_gibibytes() {
    use std::os::unix::fs::FileExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("volume.raw");
    let file = std::fs::File::create(&path).unwrap();
    let dims = [4096, 1024, 1100];
    let bytes: u64 = dims.iter().product();
    file.set_len(bytes).unwrap();
    file.write_all_at(&[77], bytes - 1).unwrap();
    let source = RawSource::open(&path, &options(dims, VoxelType::U8)).unwrap();
    assert_eq!(grid_support::value_at(&source, [4095, 1023, 1099]), 77.0);
}
