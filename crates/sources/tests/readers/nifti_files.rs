//! NIfTI: stored files compared with independently computed values, and files written in every type and byte order.

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;
use supervol_format::space::WorldSpace;
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{Geometry, VoxelType};
use supervol_sources::formats::nifti::NiftiSource;
use supervol_sources::input::selection::Selection;
use supervol_sources::input::spool::SpoolFolder;
use supervol_sources::{Endian, VolumeSource};

use crate::grid_support;
use grid_support::{
    BOTH_ORDERS, assert_refused, check_boxes, data_file, in_order, random_voxels, read_all, summary, value_at,
};

fn open(path: &Path) -> Result<NiftiSource, supervol_sources::SourceError> {
    NiftiSource::open(path, &SpoolFolder::system())
}

fn stored(name: &str) -> Option<NiftiSource> {
    Some(open(&data_file(&format!("nifti/{name}"))?).unwrap_or_else(|e| panic!("{e}")))
}

fn has_note(source: &NiftiSource, words: &str) -> bool {
    source.info().notes.iter().any(|n| n.to_string().contains(words))
}

/// Compares the affine from index to world, row by row.
fn assert_affine(source: &NiftiSource, rows: [[f64; 4]; 3]) {
    let affine = source.info().geometry.world_from_index();
    for (row, expected) in rows.into_iter().enumerate() {
        for (column, expected) in expected.into_iter().enumerate() {
            let found = if column < 3 { affine.matrix3.col(column)[row] } else { affine.translation[row] };
            assert!(
                (found - expected).abs() <= 1e-12 * (1.0 + expected.abs()),
                "[{row}, {column}]: {found}, {expected}"
            );
        }
    }
}

#[test]
fn ramp_in_six_types() {
    for voxel_type in [
        (VoxelType::U8, "uint8"),
        (VoxelType::I16, "int16"),
        (VoxelType::U16, "uint16"),
        (VoxelType::I32, "int32"),
        (VoxelType::F32, "float32"),
        (VoxelType::F64, "float64"),
    ] {
        let Some(source) = stored(&format!("odd/types27/{}.nii", voxel_type.1)) else { return };
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([3; 3], voxel_type.0));
        assert_eq!(source.info().geometry, Geometry::IDENTITY);
        let values = voxels_as_f64(voxel_type.0, &read_all(&source).unwrap());
        // The last index is the fastest of the ramp.
        let index = |i: usize| (i % 3, i / 3 % 3, i / 9);
        let expected: Vec<f64> = (0..27).map(index).map(|(x, y, z)| (9 * x + 3 * y + z) as f64).collect();
        assert_eq!(values, expected);
    }
}

#[test]
fn both_byte_orders() {
    let (Some(big), Some(little)) = (stored("odd/big.nii.gz"), stored("odd/little.nii.gz")) else { return };
    assert_eq!(read_all(&big).unwrap(), read_all(&little).unwrap());
    assert_eq!(big.info().geometry, little.info().geometry);
    let (least, greatest, _, at) = summary(&big, [21, 32, 10]);
    assert_eq!((least as f32, greatest as f32, at as f32), (-8.710_751, 18.582_53, -2.506_132_6));
    assert_affine(&big, [[-4.0, 0.0, 0.0, 0.0], [0.0, 4.0, 0.0, 0.0], [0.0, 0.0, 6.0, 0.0]]);
    assert_eq!(big.info().axes[0].unit, "mm");
}

#[test]
fn brains() {
    if let Some(source) = stored("odd/avg152T1_LR_nifti.nii.gz") {
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([91, 109, 91], VoxelType::U8));
        assert_eq!(summary(&source, [30, 54, 45]), (0.0, 255.0, 74_825_382.0, 255.0));
        assert_affine(&source, [[-2.0, 0.0, 0.0, 90.0], [0.0, 2.0, 0.0, -126.0], [0.0, 0.0, 2.0, -72.0]]);
        assert!(has_note(&source, "MNI 152"));
    }
    if let Some(source) = stored("mni152_t1_1mm.nii.gz") {
        assert_eq!(source.info().dims.0, [197, 233, 189]);
        assert_eq!(summary(&source, [65, 116, 94]), (0.0, 255.0, 333_468_829.0, 218.0));
        assert_affine(&source, [[1.0, 0.0, 0.0, -98.0], [0.0, 1.0, 0.0, -134.0], [0.0, 0.0, 1.0, -72.0]]);
    }
}

/// The file that every clone of the repository has.
#[test]
fn the_carp_of_the_repository() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/carp_ct.nii.gz");
    let source = open(&path).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(source.info().dims.0, [256, 512, 256]);
    assert_eq!(summary(&source, [85, 256, 128]), (0.0, 254.0, 423_854_130.0, 77.0));
}

#[test]
fn gzipped_pair_by_either_name() {
    for name in ["odd/air.hdr.gz", "odd/air.img.gz"] {
        let Some(source) = stored(name) else { return };
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([79, 67, 64], VoxelType::F32));
        let (least, greatest, sum, at) = summary(&source, [26, 33, 32]);
        assert_eq!((least, greatest as f32, at as f32), (0.0, 92.553_89, 26.495_817));
        assert!((sum - 11_398_461.247).abs() < 0.01, "{sum}");
        assert_affine(
            &source,
            [
                [0.0, 0.0, f64::from(2.385_232_2_f32), f64::from(-75.762_535_f32)],
                [f64::from(2.389_753_8_f32), 0.0, 0.0, f64::from(-110.762_535_f32)],
                [0.0, f64::from(-2.366_486_3_f32), 0.0, f64::from(84.425_56_f32)],
            ],
        );
    }
}

#[test]
fn series_give_their_first_volume() {
    if let Some(source) = stored("odd/functional_4d_slope.nii") {
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([17, 21, 3], VoxelType::I16));
        assert!(has_note(&source, "20 time points; the first is used"));
        assert_eq!(source.info().scale as f32, 0.075_406_97);
        assert_eq!(source.info().offset, 3100.76171875);
        assert_eq!(summary(&source, [5, 10, 1]), (-31008.0, 32322.0, 7_463_909.0, 10214.0));
        assert_affine(&source, [[-4.0, 0.0, 0.0, 32.0], [0.0, 4.0, 0.0, -40.0], [0.0, 0.0, 8.0, 0.0]]);
    }
    if let Some(source) = stored("odd/5D_small.nii") {
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([1, 2, 3], VoxelType::U8));
        assert!(has_note(&source, "3 values along axis 5; the first is used"));
        assert_eq!(summary(&source, [0, 1, 1]), (11.0, 249.0, 794.0, 229.0));
        assert_eq!(source.info().scale as f32, 0.002_758_141);
    }
    if let Some(source) = stored("odd/example_nifti2.nii.gz") {
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([32, 20, 12], VoxelType::I16));
        assert_eq!(summary(&source, [10, 10, 6]), (49.0, 742.0, 3_461_748.0, 432.0));
        assert_affine(
            &source,
            [
                [-2.0, 6.714_715_653_593_746e-19, 9.081_024_511_081_715e-18, 117.855_102_539_062_5],
                [-6.714_715_653_593_746e-19, 1.973_711_490_631_103_5, -0.355_528_235_435_485_4, -35.722_942_352_294_92],
                [8.255_480_888_960_93e-18, 0.323_207_616_806_030_3, 2.171_081_781_387_329, -7.248_798_370_361_328],
            ],
        );
    }
}

#[test]
fn stored_refusals() {
    for (name, words) in
        [("not-nifti.nii", ["header size", "348 or 540"]), ("fuzz_crash-1.nii", ["fuzz_crash-1.nii", "expected"])]
    {
        let Some(path) = data_file(&format!("nifti/odd/{name}")) else { return };
        assert_refused(open(&path), &words);
    }
}

/// Small header writer: fields by offset, in either byte order.
struct Writer {
    bytes: Vec<u8>,
    endian: Endian,
    version: u8,
}

impl Writer {
    fn new(version: u8, endian: Endian, magic: &[u8], dims: [u64; 3], code: i16, bits: i16) -> Self {
        let mut writer = Self { bytes: vec![0; if version == 1 { 352 } else { 544 }], endian, version };
        let size: i32 = if version == 1 { 348 } else { 540 };
        writer.put(0, size.to_le_bytes());
        let magic_at = if version == 1 { 344 } else { 4 };
        writer.bytes[magic_at..magic_at + magic.len()].copy_from_slice(magic);
        writer.i16(if version == 1 { 70 } else { 12 }, code);
        writer.i16(if version == 1 { 72 } else { 14 }, bits);
        writer.dim(0, 3);
        (0..3).for_each(|axis| writer.dim(axis + 1, dims[axis] as i64));
        (1..4).for_each(|axis| writer.pixdim(axis, 1.0));
        writer
    }

    fn put<const N: usize>(&mut self, at: usize, mut little: [u8; N]) {
        if self.endian == Endian::Big {
            little.reverse();
        }
        self.bytes[at..at + N].copy_from_slice(&little);
    }

    fn i16(&mut self, at: usize, value: i16) {
        self.put(at, value.to_le_bytes());
    }

    fn dim(&mut self, axis: usize, n: i64) {
        match self.version {
            1 => self.put(40 + 2 * axis, (n as i16).to_le_bytes()),
            _ => self.put(16 + 8 * axis, n.to_le_bytes()),
        }
    }

    fn pixdim(&mut self, axis: usize, spacing: f64) {
        match self.version {
            1 => self.put(76 + 4 * axis, (spacing as f32).to_le_bytes()),
            _ => self.put(104 + 8 * axis, spacing.to_le_bytes()),
        }
    }
}

const TYPES: [(VoxelType, i16); 8] = [
    (VoxelType::U8, 2),
    (VoxelType::I16, 4),
    (VoxelType::I32, 8),
    (VoxelType::F32, 16),
    (VoxelType::F64, 64),
    (VoxelType::I8, 256),
    (VoxelType::U16, 512),
    (VoxelType::U32, 768),
];

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn round_trips() {
    let folder = tempfile::tempdir().unwrap();
    let spool = SpoolFolder::at(folder.path());
    let dims = [13, 7, 5];
    for (voxel_type, code) in TYPES {
        for endian in BOTH_ORDERS {
            for version in [1, 2] {
                let voxels = random_voxels(dims, voxel_type, 41);
                let data = in_order(&voxels, voxel_type.bytes(), endian);
                let bits = 8 * voxel_type.bytes() as i16;
                let magic: [&[u8]; 2] =
                    if version == 1 { [b"n+1\0", b"ni1\0"] } else { [b"n+2\0\r\n\x1a\n", b"ni2\0\r\n\x1a\n"] };
                let single = [Writer::new(version, endian, magic[0], dims, code, bits).bytes, data.clone()].concat();
                let pair_header = Writer::new(version, endian, magic[1], dims, code, bits).bytes;
                let at = |name: &str| folder.path().join(name);
                std::fs::write(at("a.nii"), &single).unwrap();
                std::fs::write(at("b.nii.gz"), gzip(&single)).unwrap();
                std::fs::write(at("c.hdr"), &pair_header).unwrap();
                std::fs::write(at("c.img"), &data).unwrap();
                std::fs::write(at("d.hdr.gz"), gzip(&pair_header)).unwrap();
                std::fs::write(at("d.img.gz"), gzip(&data)).unwrap();
                for name in ["a.nii", "b.nii.gz", "c.hdr", "c.img", "d.hdr.gz", "d.img.gz"] {
                    let source = NiftiSource::open(&at(name), &spool).unwrap_or_else(|e| panic!("{e}"));
                    assert_eq!((source.info().dims.0, source.info().voxel_type), (dims, voxel_type));
                    check_boxes(&source, &voxels, 43);
                }
            }
        }
    }
}

fn written(path: &Path, writer: &Writer, data_bytes: usize) -> Result<NiftiSource, supervol_sources::SourceError> {
    let file = [writer.bytes.clone(), vec![1; data_bytes]].concat();
    std::fs::write(path, file).unwrap();
    open(path)
}

#[test]
fn the_intent_code_says_labels() {
    let folder = tempfile::tempdir().unwrap();
    for (version, at) in [(1, 68), (2, 504)] {
        let magic: &[u8] = if version == 1 { b"n+1\0" } else { b"n+2\0\r\n\x1a\n" };
        for endian in BOTH_ORDERS {
            let says = |code: i32| {
                let mut writer = Writer::new(version, endian, magic, [4, 3, 2], 4, 16);
                if version == 1 {
                    writer.put(at, (code as i16).to_le_bytes())
                } else {
                    writer.put(at, code.to_le_bytes())
                }
                written(&folder.path().join("a.nii"), &writer, 48).unwrap().info().labels
            };
            assert!(says(1002).is_some_and(|because| because.contains("intent code")));
            assert_eq!((says(0), says(1001)), (None, None));
        }
    }
}

#[test]
fn headers_that_are_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("volume.nii");
    let new = || Writer::new(1, Endian::Little, b"n+1\0", [4, 3, 2], 2, 8);
    assert!(written(&path, &new(), 24).is_ok());
    assert_refused(written(&path, &new(), 23), &["length of the file", "376 bytes", "375 bytes"]);
    for (code, word) in [(1024, "64-bit integers of"), (32, "complex"), (1, "single bits"), (3, "datatype")] {
        let mut writer = new();
        writer.i16(70, code);
        assert_refused(written(&path, &writer, 999), &[word]);
    }
    let mut writer = new();
    writer.dim(2, -3);
    assert_refused(written(&path, &writer, 24), &["dim[2]", "-3"]);
    let mut writer = new();
    writer.dim(0, 9);
    assert_refused(written(&path, &writer, 24), &["dim[0]", "9"]);
    let mut writer = new();
    writer.put(108, 12.5_f32.to_le_bytes());
    assert_refused(written(&path, &writer, 24), &["vox_offset", "12.5"]);
    let mut writer = new();
    writer.bytes[344..348].fill(0);
    assert_refused(written(&path, &writer, 24), &[".img", "none"]);
    let mut writer = new();
    writer.bytes[344..348].copy_from_slice(b"ni1\0");
    std::fs::write(folder.path().join("lonely.hdr"), &writer.bytes).unwrap();
    assert_refused(open(&folder.path().join("lonely.hdr")), &[".img", "none"]);
    // Gzip streams that are longer or shorter than announced, damaged, or have an absurd length.
    let whole = [new().bytes, vec![1; 24]].concat();
    for (bytes, word) in [
        (gzip(&[&whole[..], &[1]].concat()), "at least 377 bytes"),
        (gzip(&whole[..375]), "375 bytes"),
        (gzip(&whole)[..40].to_vec(), "gzip"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        assert_refused(open(&path), &[word]);
    }
    let mut writer = new();
    (1..4).for_each(|axis| writer.dim(axis, 32767));
    std::fs::write(&path, gzip(&writer.bytes)).unwrap();
    assert_refused(open(&path), &["gzip data", "hold at most"]);
}

#[test]
fn orientations() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("volume.nii");
    let new = || {
        let mut writer = Writer::new(1, Endian::Little, b"n+1\0", [4, 3, 2], 2, 8);
        [2.0, 3.0, 4.0].into_iter().enumerate().for_each(|(i, s)| writer.pixdim(i + 1, s));
        writer
    };
    let affine = |writer: &mut Writer, rows: [[f32; 4]; 3]| {
        writer.i16(254, 1);
        for (i, value) in rows.iter().flatten().enumerate() {
            writer.put(280 + 4 * i, value.to_le_bytes());
        }
    };
    // Without forms only the spacings count; an impossible one becomes 1.
    let mut writer = new();
    writer.pixdim(2, 0.0);
    writer.bytes[123] = 3;
    let source = written(&path, &writer, 24).unwrap();
    assert_eq!(source.info().geometry, Geometry { spacing: [2.0, 1.0, 4.0], ..Geometry::IDENTITY });
    assert!(has_note(&source, "impossible") && has_note(&source, "no orientation"));
    assert_eq!(source.info().axes[2].unit, "um");
    // A sheared sform is kept exactly.
    let mut writer = new();
    let sheared = [[2.0, 0.5, 0.0, 10.0], [0.0, 3.0, 0.25, 20.0], [0.0, 0.0, -4.0, 30.0]];
    affine(&mut writer, sheared);
    assert_affine(&written(&path, &writer, 24).unwrap(), sheared.map(|row| row.map(f64::from)));
    // A singular sform is replaced by the qform: a half turn about z, with the third axis reversed.
    let mut writer = new();
    affine(&mut writer, [[2.0, 2.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 4.0, 0.0]]);
    writer.i16(252, 1);
    writer.pixdim(0, -1.0);
    writer.put(264, 1.0_f32.to_le_bytes());
    writer.put(268, 7.0_f32.to_le_bytes());
    let source = written(&path, &writer, 24).unwrap();
    assert_affine(&source, [[-2.0, 0.0, 0.0, 7.0], [0.0, -3.0, 0.0, 0.0], [0.0, 0.0, -4.0, 0.0]]);
    assert!(has_note(&source, "sform is not used"));
    assert_eq!(value_at(&source, [0, 0, 0]), 1.0);
}

/// ANALYZE 7.5 pairs written by nibabel with the values x + 10 y + 100 z, opened by either name.
#[test]
fn pairs_of_analyze() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/analyze");
    let ramp: Vec<f64> = (0..120).map(|i| f64::from(i % 6 + 10 * (i / 6 % 5) + 100 * (i / 30))).collect();
    for (name, voxel_type) in [
        ("i16.hdr", VoxelType::I16),
        ("i16.img", VoxelType::I16),
        ("i16-big-endian.hdr", VoxelType::I16),
        ("f32.img", VoxelType::F32),
        ("scaled.hdr", VoxelType::I16),
    ] {
        let source = open(&folder.join(name)).unwrap_or_else(|e| panic!("{e}"));
        let info = source.info();
        assert_eq!((info.dims.0, info.voxel_type), ([6, 5, 4], voxel_type), "{name}");
        assert_eq!(info.geometry, Geometry { spacing: [1.0, 1.5, 2.5], ..Geometry::IDENTITY }, "{name}");
        assert_eq!(
            (info.space, info.scale),
            (WorldSpace::Unknown, if name == "scaled.hdr" { 0.25 } else { 1.0 }),
            "{name}"
        );
        assert!(has_note(&source, "ANALYZE 7.5: which sides of a patient"), "{:?}", info.notes);
        assert_eq!(voxels_as_f64(voxel_type, &read_all(&source).unwrap()), ramp, "{name}");
    }
    let frames = open(&folder.join("u8-two-frames.hdr")).unwrap();
    assert!(has_note(&frames, "2 time points; the first is used"), "{:?}", frames.info().notes);
    let selection = Selection { frame: Some(1), ..Selection::default() };
    let second = NiftiSource::open_with(&folder.join("u8-two-frames.hdr"), &SpoolFolder::system(), &selection).unwrap();
    let expected: Vec<u8> = ramp.iter().map(|v| ((*v as u32 % 256 + 7) % 256) as u8).collect();
    assert_eq!(read_all(&second).unwrap(), expected);
}

#[test]
fn headers_of_analyze_that_are_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let (header, voxels) = (folder.path().join("v.hdr"), folder.path().join("v.img"));
    let stored = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/analyze/i16.hdr");
    let whole = std::fs::read(stored).unwrap();
    std::fs::write(&voxels, [0; 240]).unwrap();
    for (at, value, words) in [
        (70, 128u16, ["colours of ANALYZE", "NIfTI"]),
        (70, 132, ["", ""]),
        (70, 512, ["datatype", "ANALYZE"]),
        (70, 32, ["complex", ""]),
        (42, 7, ["length of the file", "280 bytes"]),
        (42, 0, ["dim[1]", "0"]),
        (46, 5, ["length of the file", "300 bytes"]),
        (110, 0xbf80, ["vox_offset", "-1"]),
    ] {
        let mut damaged = whole.clone();
        damaged[at..at + 2].copy_from_slice(&value.to_le_bytes());
        std::fs::write(&header, damaged).unwrap();
        let opened = open(&header);
        if words[0].is_empty() {
            assert_eq!(opened.unwrap().info().voxel_type, VoxelType::U16);
        } else {
            assert_refused(opened, &words);
        }
    }
}
