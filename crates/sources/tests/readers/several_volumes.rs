//! Files with several volumes, several numbers per voxel, or 64-bit integers: selection of one, in every format that
//! has them.

use std::path::{Path, PathBuf};

use supervol_format::{Dims, VoxelType};
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{SourceError, VolumeSource};

use crate::grid_support;
use grid_support::*;

fn choose(path: &Path, frame: Option<u64>, channel: Option<u64>) -> Result<Box<dyn VolumeSource>, SourceError> {
    let mut options = OpenOptions::default();
    (options.selection.frame, options.selection.channel) = (frame, channel);
    open(path, &options)
}

fn npy(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let mut text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}}}").into_bytes();
    text.resize(117, b' ');
    text.push(b'\n');
    [&b"\x93NUMPY\x01\x00"[..], &(text.len() as u16).to_le_bytes(), &text, data].concat()
}

fn nifti(code: i16, dims: [i16; 8], data: &[u8]) -> Vec<u8> {
    let mut file = vec![0; 352];
    let mut put = |at: usize, bytes: &[u8]| file[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    dims.iter().enumerate().for_each(|(i, n)| put(40 + 2 * i, &n.to_le_bytes()));
    put(70, &code.to_le_bytes());
    put(344, b"n+1\0");
    [&file, data].concat()
}

fn nrrd(kind: &str, sizes: &str, more: &str, data: &[u8]) -> Vec<u8> {
    let axes = sizes.split(' ').count();
    let header =
        format!("NRRD0004\ntype: {kind}\ndimension: {axes}\nsizes: {sizes}\nencoding: raw\nendian: little\n{more}\n");
    [header.as_bytes(), data].concat()
}

fn metaimage(kind: &str, sizes: &str, more: &str, data: &[u8]) -> Vec<u8> {
    let axes = sizes.split(' ').count();
    let header = format!(
        "ObjectType = Image\nNDims = {axes}\nDimSize = {sizes}\n{more}ElementType = {kind}\nElementDataFile = LOCAL\n"
    );
    [header.as_bytes(), data].concat()
}

struct Files(tempfile::TempDir);

impl Files {
    fn put(&self, name: &str, bytes: Vec<u8>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }
}

#[test]
fn frames() {
    let files = Files(tempfile::tempdir().unwrap());
    let voxels = random_voxels([5, 4, 9], VoxelType::I16, 4);
    let paths = [
        files.put("a.npy", npy("<i2", "(3, 3, 4, 5)", &voxels)),
        files.put("a.nii", nifti(4, [4, 5, 4, 3, 3, 1, 1, 1], &voxels)),
        files.put("a.nrrd", nrrd("short", "5 4 3 3", "", &voxels)),
        files.put("a.mha", metaimage("MET_SHORT", "5 4 3 3", "", &voxels)),
    ];
    for path in paths {
        for (frame, expected) in voxels.chunks(120).enumerate() {
            let source = choose(&path, Some(frame as u64), None).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(source.info().dims, Dims([5, 4, 3]));
            check_boxes(source.as_ref(), expected, 3);
        }
        assert_refused(choose(&path, Some(3), None), &["`frame` 3", "has 3, of which the last is number 2"]);
        match choose(&path, None, None) {
            Ok(source) => {
                check_boxes(source.as_ref(), &voxels[..120], 3);
                let notes = &source.info().notes;
                assert!(
                    notes.iter().any(|note| note.to_string().contains("`frame` 0 to 2")),
                    "{}: {notes:?}",
                    path.display()
                );
            }
            // An npy array does not tell which axis is time.
            Err(error) => assert!(path.ends_with("a.npy") && error.to_string().contains("`frame`"), "{error}"),
        }
    }
    // Compressed: the bytes before the volume are skipped.
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    std::io::Write::write_all(&mut encoder, &nifti(4, [4, 5, 4, 3, 3, 1, 1, 1], &voxels)).unwrap();
    let path = files.put("b.nii.gz", encoder.finish().unwrap());
    check_boxes(choose(&path, Some(1), None).unwrap().as_ref(), &voxels[120..240], 3);
    check_boxes(choose(&path, Some(2), None).unwrap().as_ref(), &voxels[240..], 3);
}

#[test]
fn channels() {
    let files = Files(tempfile::tempdir().unwrap());
    let colours = random_voxels([15, 4, 6], VoxelType::U8, 4);
    let channel = |c: usize| -> Vec<u8> { colours.chunks(3).map(|colour| colour[c]).collect() };
    let grey: Vec<u8> = colours
        .chunks(3)
        .map(|c| {
            (f64::from(299 * u32::from(c[0]) + 587 * u32::from(c[1]) + 114 * u32::from(c[2])) / 1000.0)
                .round_ties_even() as u8
        })
        .collect();
    let is_colour = [
        files.put("c.nii", nifti(128, [3, 5, 4, 6, 1, 1, 1, 1], &colours)),
        files.put("c.nrrd", nrrd("uchar", "3 5 4 6", "kinds: RGB-color domain domain domain\n", &colours)),
        files.put("c.mha", metaimage("MET_UCHAR", "5 4 6", "ElementNumberOfChannels = 3\n", &colours)),
    ];
    for path in &is_colour {
        let source = choose(path, None, None).unwrap_or_else(|e| panic!("{e}"));
        check_boxes(source.as_ref(), &grey, 5);
        assert!(
            source.info().notes.iter().any(|note| note.to_string().contains("luminance")),
            "{:?}",
            source.info().notes
        );
    }
    let is_vector = [
        files.put("c.npy", npy("|u1", "(6, 4, 5, 3)", &colours)),
        files.put("v.nrrd", nrrd("uchar", "3 5 4 6", "kinds: vector domain domain domain\n", &colours)),
    ];
    for path in &is_vector {
        assert_refused(choose(path, None, None), &["`channel`"]);
    }
    for path in is_colour.iter().chain(&is_vector) {
        for c in 0..3 {
            check_boxes(choose(path, None, Some(c)).unwrap().as_ref(), &channel(c as usize), 5);
        }
        assert_refused(choose(path, None, Some(3)), &["`channel` 3", "last is number 2"]);
    }
}

#[test]
fn integers_of_64_bits_take_the_smallest_type_that_holds_them() {
    let files = Files(tempfile::tempdir().unwrap());
    let cases: [(&[i64], Option<VoxelType>); 7] = [
        (&[0, 1, 29, 255], Some(VoxelType::U8)),
        (&[-1, 1, 29, 127], Some(VoxelType::I8)),
        (&[0, 256, 1, 1], Some(VoxelType::U16)),
        (&[-129, 5, 5, 5], Some(VoxelType::I16)),
        (&[0, 5, 5, 1 << 31], Some(VoxelType::U32)),
        (&[-1, 5, 5, 1 << 53], Some(VoxelType::F64)),
        (&[-1, 5, 5, (1 << 53) + 1], None),
    ];
    for (values, expected) in cases {
        let data: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let big: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
        let paths = [
            files.put("w.npy", npy("<i8", "(1, 2, 2)", &data)),
            files.put("b.npy", npy(">i8", "(1, 2, 2)", &big)),
            files.put("w.nii", nifti(1024, [3, 2, 2, 1, 1, 1, 1, 1], &data)),
            files.put("w.nrrd", nrrd("int64", "2 2 1", "", &data)),
            files.put("w.mha", metaimage("MET_LONG_LONG", "2 2 1", "", &data)),
        ];
        for path in paths {
            let opened = choose(&path, None, None);
            let Some(voxel_type) = expected else {
                assert_refused(opened, &["64-bit integers of", "fit no voxel type"]);
                continue;
            };
            let source = opened.unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(source.info().voxel_type, voxel_type, "{}", path.display());
            for (i, value) in values.iter().enumerate() {
                assert_eq!(value_at(source.as_ref(), [i as u64 % 2, i as u64 / 2, 0]), *value as f64);
            }
            let says = format!("kept as {voxel_type}");
            assert!(
                source.info().notes.iter().any(|note| note.to_string().contains(&says)),
                "{:?}",
                source.info().notes
            );
        }
    }
    let unsigned: Vec<u8> = [u64::MAX, 0, 0, 0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let path = files.put("u.npy", npy("<u8", "(1, 2, 2)", &unsigned));
    assert_refused(choose(&path, None, None), &["18446744073709551615"]);
}

#[test]
fn formats_with_one_volume_say_so() {
    let files = Files(tempfile::tempdir().unwrap());
    let path = files.put("a.npy", npy("|u1", "(2, 2, 2)", &[0; 8]));
    assert!(choose(&path, Some(0), None).is_ok());
    assert_refused(choose(&path, Some(1), None), &["`frame` 1", "has one, which is number 0"]);
    let mut options = OpenOptions::default();
    options.selection.series = Some("3".into());
    assert_refused(open(&path, &options), &["`series`", "no DICOM"]);
    let mut named = path.into_os_string();
    named.push(":/x");
    assert_refused(open(Path::new(&named), &OpenOptions::default()), &["no arrays", ":/x"]);
}

/// Sums by nibabel and SimpleITK.
#[test]
fn real_files() {
    let sum = |name: &str, frame, channel| {
        let path = data_file(name)?;
        Some(summary(choose(&path, frame, channel).unwrap_or_else(|e| panic!("{e}")).as_ref(), [0; 3]).2)
    };
    let cases = [
        ("nifti/odd/rgb_3D.nii", None, None, 111.0),
        ("nifti/odd/rgb_3D.nii", None, Some(1), 110.0),
        ("nifti/odd/functional_4d_slope.nii", Some(7), None, 7_572_019.0),
        ("metaimage/brain_slice_complex_2ch.mha", None, Some(0), 4_860_107.0),
        ("metaimage/brain_slice_complex_2ch.mha", None, Some(1), 2_673_952.0),
    ];
    for (name, frame, channel, expected) in cases {
        let Some(found) = sum(name, frame, channel) else { continue };
        assert!((found - expected).abs() < 1.0, "{name}: {found}");
    }
}
