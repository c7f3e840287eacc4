//! npy: stored files, every type, byte order and memory order, and refused headers.

use std::path::{Path, PathBuf};

use supervol_format::VoxelType;
use supervol_sources::formats::npy::NpySource;
use supervol_sources::{AccessOrder, Endian, VolumeSource};

use crate::grid_support;
use grid_support::{
    BOTH_ORDERS, assert_refused, check_boxes, data_file, in_order, random_voxels, read_all, summary, value_at,
};

fn type_string(voxel_type: VoxelType, endian: Endian) -> String {
    let order = match (voxel_type.bytes(), endian) {
        (1, _) => '|',
        (_, Endian::Little) => '<',
        (_, Endian::Big) => '>',
    };
    let letter = if voxel_type.is_float() { "f" } else { &voxel_type.name()[..1] };
    format!("{order}{letter}{}", voxel_type.bytes())
}

fn npy(version: u8, dict: &str, data: &[u8]) -> Vec<u8> {
    let mut file = b"\x93NUMPY".to_vec();
    file.extend([version, 0]);
    match version {
        1 => file.extend((dict.len() as u16).to_le_bytes()),
        _ => file.extend((dict.len() as u32).to_le_bytes()),
    }
    file.extend(dict.as_bytes());
    file.extend(data);
    file
}

#[test]
fn stored_files() {
    for (name, voxel_type, summed) in [
        ("npy_test.uint8.npy", VoxelType::U8, (4.0, 248.0, 7668.0, 95.0)),
        ("npy_test.uint16-le.npy", VoxelType::U16, (179.0, 62960.0, 1_909_240.0, 18783.0)),
        ("npy_test.uint16-be.npy", VoxelType::U16, (179.0, 62960.0, 1_909_240.0, 18783.0)),
        (
            "npy_test.uint32-be.npy",
            VoxelType::U32,
            (208_505_583.0, 4_282_984_061.0, 142_718_989_314.0, 2_880_309_929.0),
        ),
    ] {
        let Some(path) = data_file(&format!("npy/{name}")) else { return };
        let source = NpySource::open(&path).unwrap();
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([5, 4, 3], voxel_type), "{name}");
        assert_eq!(summary(&source, [0; 3]), summed, "{name}");
    }
    let floats = ["le", "be"].map(|order| data_file(&format!("npy/npy_test.float32-{order}.npy")));
    let [Some(little), Some(big)] = floats else { return };
    let [little, big] = [little, big].map(|path| NpySource::open(&path).unwrap());
    assert_eq!(read_all(&little).unwrap(), read_all(&big).unwrap());
    assert_eq!(value_at(&big, [1, 0, 0]), f64::from(-0.075_701_53_f32));
    assert_eq!(value_at(&big, [0, 0, 2]), f64::from(0.083_475_36_f32));
}

#[test]
fn stored_fortran_file() {
    let Some(path) = data_file("npy/fortran_2d_f64_lung2_gldm.npy") else { return };
    let source = NpySource::open(&path).unwrap();
    assert_eq!((source.info().dims.0, source.info().voxel_type), ([27, 39, 1], VoxelType::F64));
    assert_eq!(source.info().access_order, AccessOrder([0, 1, 2]));
    assert_eq!(summary(&source, [0; 3]), (0.0, 864.0, 24644.0, 1.0));
    // The stored order is one column of 39 after the other.
    let file = std::fs::read(&path).unwrap();
    let data = &file[file.len() - 27 * 39 * 8..];
    for (x, y) in [(0, 0), (1, 0), (0, 1), (26, 38), (13, 7)] {
        let at = (x * 39 + y) * 8;
        let expected = f64::from_le_bytes(data[at..at + 8].try_into().unwrap());
        assert_eq!(value_at(&source, [x as u64, y as u64, 0]), expected, "{x}, {y}");
    }
}

/// Voxels in Fortran order of the indices [z, y, x]: z fastest.
fn z_fastest(voxels: &[u8], dims: [u64; 3], bytes: usize) -> Vec<u8> {
    let mut out = Vec::new();
    for x in 0..dims[0] {
        for y in 0..dims[1] {
            for z in 0..dims[2] {
                let at = (x + dims[0] * (y + dims[1] * z)) as usize * bytes;
                out.extend_from_slice(&voxels[at..at + bytes]);
            }
        }
    }
    out
}

#[test]
fn round_trips() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("volume.npy");
    for dims in [[7, 5, 3], [1, 1, 1], [130, 70, 9], [3, 2, 300], [1, 40, 1]] {
        for voxel_type in VoxelType::ALL {
            for (version, endian) in [1, 2, 3].into_iter().zip(BOTH_ORDERS.into_iter().cycle()) {
                for (fortran, word) in [(false, "False"), (true, "True")] {
                    let bytes = voxel_type.bytes();
                    let voxels = random_voxels(dims, voxel_type, 23);
                    let stored = if fortran { z_fastest(&voxels, dims, bytes) } else { voxels.clone() };
                    let [nx, ny, nz] = dims;
                    let descr = type_string(voxel_type, endian);
                    let dict =
                        format!("{{'descr': '{descr}', 'fortran_order': {word}, 'shape': ({nz}, {ny}, {nx})}}\n");
                    std::fs::write(&path, npy(version, &dict, &in_order(&stored, bytes, endian))).unwrap();
                    let source = NpySource::open(&path).unwrap();
                    assert_eq!((source.info().dims.0, source.info().voxel_type), (dims, voxel_type));
                    check_boxes(&source, &voxels, 29);
                }
            }
        }
    }
}

/// A Fortran file larger than the transposing read's scratch buffer.
#[test]
fn large_fortran_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("volume.npy");
    let dims = [210, 90, 170];
    let voxels = random_voxels(dims, VoxelType::U16, 31);
    let dict = "{'descr': '>u2', 'fortran_order': True, 'shape': (170, 90, 210)}";
    std::fs::write(&path, npy(1, dict, &in_order(&z_fastest(&voxels, dims, 2), 2, Endian::Big))).unwrap();
    check_boxes(&NpySource::open(&path).unwrap(), &voxels, 37);
}

fn open_dict(path: &Path, dict: &str, data_bytes: usize) -> Result<NpySource, supervol_sources::SourceError> {
    std::fs::write(path, npy(1, dict, &vec![1; data_bytes])).unwrap();
    NpySource::open(path)
}

#[test]
fn shapes() {
    let folder = tempfile::tempdir().unwrap();
    let path: PathBuf = folder.path().join("volume.npy");
    let open = |shape: &str, bytes| {
        open_dict(&path, &format!("{{'descr': '|u1', 'fortran_order': False, 'shape': {shape}}}"), bytes)
    };
    let dims = |shape: &str, bytes| open(shape, bytes).unwrap().info().dims.0;
    assert_eq!(dims("()", 1), [1, 1, 1]);
    assert_eq!(dims("(6,)", 6), [6, 1, 1]);
    assert_eq!(dims("(2, 3)", 6), [3, 2, 1]);
    assert_eq!(dims("(1, 2, 3, 4)", 24), [4, 3, 2]);
    assert_eq!(dims("(2, 3, 4, 1)", 24), [4, 3, 2]);
    assert_refused(
        open("(5, 2, 3, 4)", 120),
        &["4 axes", "5 along the first with `frame`", "4 along the last with `channel`"],
    );
    assert_refused(open("(2, 0, 4)", 8), &["shape", "axis 1"]);
    assert_refused(open("(2, 3, 5)", 29), &["30 of voxels", "length of the file"]);
    assert_refused(open("(99999999, 3, 5)", 29), &["dims", "67108864"]);
    assert!(open("(2, 3, 4)", 30).unwrap().info().notes[0].to_string().contains("bytes not read: 6"));
}

#[test]
fn refusals() {
    let folder = tempfile::tempdir().unwrap();
    let path: PathBuf = folder.path().join("volume.npy");
    let open =
        |descr: &str| open_dict(&path, &format!("{{'descr': {descr}, 'fortran_order': False, 'shape': (2, 2)}}"), 64);
    assert_refused(open("'<f16'"), &["extended floats", "astype('float64')"]);
    assert_refused(open("'>c8'"), &["complex"]);
    assert_refused(open("[('a', '<f4')]"), &["structure"]);
    assert_refused(open("'|u2'"), &["descr", "|u2"]);
    assert_refused(open("'|O'"), &["descr"]);
    assert!(open("'|b1'").unwrap().info().notes.iter().any(|n| n.to_string().contains("truth values")));
    std::fs::write(&path, b"PK\x03\x04 a zip file").unwrap();
    assert_refused(NpySource::open(&path), &["magic", "NUMPY"]);
    std::fs::write(&path, npy(4, "{}", &[])).unwrap();
    assert_refused(NpySource::open(&path), &["version", "found 4"]);
    std::fs::write(&path, b"\x93NUMPY\x02\0\xff\xff\xff\xff{").unwrap();
    assert_refused(NpySource::open(&path), &["length of the npy header", "4294967295"]);
}

/// Half-precision floats of both byte orders, in both memory orders, keep their values.
#[test]
fn half_floats() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("h.npy");
    let halves: Vec<u16> = (0..24u16).map(|n| 0x3c00 + 37 * n).collect();
    let value = |n: usize| {
        let bits = halves[n];
        2f64.powi(i32::from(bits >> 10) - 15) * (1.0 + f64::from(bits & 1023) / 1024.0)
    };
    for (order, fortran) in [('<', "False"), ('>', "False"), ('<', "True"), ('>', "True")] {
        let bytes: Vec<u8> =
            halves.iter().flat_map(|h| if order == '<' { h.to_le_bytes() } else { h.to_be_bytes() }).collect();
        let dict = format!("{{'descr': '{order}f2', 'fortran_order': {fortran}, 'shape': (2, 3, 4), }}\n");
        std::fs::write(&path, npy(1, &dict, &bytes)).unwrap();
        let source = NpySource::open(&path).unwrap();
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([4, 3, 2], VoxelType::F32));
        for (x, y, z) in [(0, 0, 0), (3, 0, 0), (1, 2, 1), (3, 2, 1)] {
            let n = if fortran == "True" { z + 2 * y + 6 * x } else { x + 4 * y + 12 * z };
            assert_eq!(value_at(&source, [x, y, z]), value(n as usize), "{order} {fortran} {x} {y} {z}");
        }
    }
    std::fs::write(&path, npy(1, "{'descr': '|f2', 'fortran_order': False, 'shape': (1, 1, 1), }\n", &[0; 2])).unwrap();
    assert_refused(NpySource::open(&path).map(|_| ()), &["a byte order"]);
}
