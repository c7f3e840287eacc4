//! MetaImage: every type, byte order, encoding and way to name data files; geometry; refusals; real files.

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use supervol_format::{Dims, VoxelType};
use supervol_sources::formats::metaimage::{MetaImageSource, Outside};
use supervol_sources::input::spool::SpoolFolder;
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{Endian, SourceError, VolumeSource};

use crate::grid_support;
use grid_support::*;

const NEGHIP: [f64; 3] = [0.0, 255.0, 4824177.0];
const HYDROGEN: [f64; 3] = [0.0, 250.0, 5990975.0];
const FUEL: [f64; 3] = [0.0, 255.0, 509815.0];
const HEAD: [f64; 3] = [0.0, 255.0, 3058332.0];
const BRAIN: [f64; 3] = [1.0, 249.0, 4861905.0];

const DIMS: [u64; 3] = [7, 5, 4];

const TYPES: [(&str, VoxelType); 10] = [
    ("MET_UCHAR", VoxelType::U8),
    ("MET_CHAR", VoxelType::I8),
    ("MET_USHORT", VoxelType::U16),
    ("MET_SHORT", VoxelType::I16),
    ("MET_UINT", VoxelType::U32),
    ("MET_ULONG", VoxelType::U32),
    ("MET_INT", VoxelType::I32),
    ("MET_LONG", VoxelType::I32),
    ("MET_FLOAT", VoxelType::F32),
    ("MET_DOUBLE", VoxelType::F64),
];

fn header(element: &str, more: &str, data: &str) -> Vec<u8> {
    format!(
        "ObjectType = Image\nNDims = 3\nDimSize = 7 5 4\nElementSpacing = 0.5 2 1.25\nOffset = -3 4e1 0.5\n{more}\
         ElementType = {element}\nElementDataFile = {data}\n"
    )
    .into_bytes()
}

fn source(path: &Path) -> Result<MetaImageSource, SourceError> {
    MetaImageSource::open(path, &SpoolFolder::at(path.parent().unwrap()), Outside::Refused)
}

fn written(folder: &Path, name: &str, parts: &[&[u8]]) -> std::path::PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, parts.concat()).unwrap();
    path
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn every_type_order_and_encoding() {
    let folder = tempfile::tempdir().unwrap();
    for (name, voxel_type) in TYPES {
        let voxels = random_voxels(DIMS, voxel_type, 3);
        for order in BOTH_ORDERS {
            let is_big = if order == Endian::Big { "True" } else { "False" };
            let order_line = format!("BinaryDataByteOrderMSB = {is_big}\n");
            let in_file = in_order(&voxels, voxel_type.bytes(), order);
            let path = written(folder.path(), "v.mha", &[&header(name, &order_line, "LOCAL"), &in_file]);
            check_boxes(&source(&path).unwrap(), &voxels, 1);
            let compressed = format!("CompressedData = True\n{order_line}");
            let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
            gzip.write_all(&in_file).unwrap();
            for stream in [zlib(&in_file), gzip.finish().unwrap()] {
                let path = written(folder.path(), "c.mha", &[&header(name, &compressed, "LOCAL"), &stream]);
                check_boxes(&source(&path).unwrap(), &voxels, 2);
            }
        }
    }
    let numbers: Vec<String> = (0..140).map(|i| (i * 3 - 70).to_string()).collect();
    let text = header("MET_SHORT", "BinaryData = False\n", "LOCAL");
    let path = written(folder.path(), "t.mha", &[&text, numbers.join(" ").as_bytes()]);
    let expected: Vec<u8> = (0..140i16).flat_map(|i| (i * 3 - 70).to_le_bytes()).collect();
    check_boxes(&source(&path).unwrap(), &expected, 3);
}

#[test]
fn data_files_are_found_and_stay_below_the_header() {
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("in");
    std::fs::create_dir(&inside).unwrap();
    let voxels = random_voxels(DIMS, VoxelType::U16, 5);
    for (i, slice) in voxels.chunks(70).enumerate() {
        std::fs::write(inside.join(format!("s{:02}.raw", i + 1)), slice).unwrap();
        std::fs::write(inside.join(format!("z{}.zraw", i + 1)), zlib(slice)).unwrap();
    }
    std::fs::write(inside.join("all.raw"), [&[9; 11], &voxels[..]].concat()).unwrap();
    let list = "LIST 2\ns01.raw\ns02.raw\n\ns03.raw\ns04.raw";
    let compressed = "CompressedData = True\n";
    for (more, data) in [
        ("", list),
        ("", "s%02d.raw 1 4 1"),
        ("", "s%02d.raw 1 4"),
        (compressed, "z%d.zraw 1 4 1"),
        ("HeaderSize = 11\n", "all.raw"),
        ("HeaderSize = -1\n", "all.raw"),
    ] {
        let path = written(&inside, "v.mhd", &[&header("MET_USHORT", more, data)]);
        check_boxes(&source(&path).unwrap(), &voxels, 6);
    }
    std::fs::write(folder.path().join("secret"), [7; 280]).unwrap();
    let path = written(&inside, "v.mhd", &[&header("MET_USHORT", "", "../secret")]);
    assert_refused(source(&path), &["outside", "`outside`"]);
    assert!(MetaImageSource::open(&path, &SpoolFolder::at(&inside), Outside::Allowed).is_ok());
    for (data, words) in [
        ("missing.raw", &["data file", "no such file"][..]),
        ("s01.raw", &["length of the file"]),
        ("s%02d.raw 1 3 1", &["divides"]),
        ("LIST", &["at least one file name"]),
    ] {
        assert_refused(source(&written(&inside, "v.mhd", &[&header("MET_USHORT", "", data)])), words);
    }
}

#[test]
fn geometry_and_values() {
    let folder = tempfile::tempdir().unwrap();
    // Rows of the matrix are the directions of the axes.
    let more = "TransformMatrix = 0 1 0 -1 0 0 0 0 1\nDistanceUnits = mm\nElementToIntensityFunctionSlope = 2.5\n\
                ElementToIntensityFunctionOffset = -1000\nAnatomicalOrientation = RAI\n";
    let path = written(folder.path(), "v.mha", &[&header("MET_UCHAR", more, "LOCAL"), &[0; 140]]);
    let opened = source(&path).unwrap();
    let info = opened.info();
    assert_eq!((info.dims, info.scale, info.offset), (Dims(DIMS), 2.5, -1000.0));
    assert_eq!(info.axes[2].unit, "mm");
    let world = info.geometry.world_from_index();
    let at = |x: f64, y: f64, z: f64| world.transform_point3([x, y, z].into()).to_array();
    assert_eq!(at(0.0, 0.0, 0.0), [-3.0, 40.0, 0.5]);
    assert_eq!(at(2.0, 0.0, 0.0), [-3.0, 41.0, 0.5]);
    assert_eq!(at(0.0, 1.0, 0.0), [-5.0, 40.0, 0.5]);
    assert_eq!(at(0.0, 0.0, 2.0), [-3.0, 40.0, 3.0]);
    let singular = "TransformMatrix = 0 1 0 0 1 0 0 0 1\n";
    let path = written(folder.path(), "v.mha", &[&header("MET_UCHAR", singular, "LOCAL"), &[0; 140]]);
    assert!(source(&path).unwrap().info().notes.iter().any(|note| note.to_string().contains("singular")));
    // Bytes behind the voxels are noted.
    let path = written(folder.path(), "v.mha", &[&header("MET_UCHAR", "", "LOCAL"), &[0; 143]]);
    assert!(source(&path).unwrap().info().notes.iter().any(|note| note.to_string().ends_with("not read: 3")));
}

#[test]
fn what_is_no_volume_of_ours_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |from: &str, to: &str, words: &[&str]| {
        let text = String::from_utf8(header("MET_UCHAR", "", "LOCAL")).unwrap();
        assert!(text.contains(from), "{from}");
        let path = written(folder.path(), "v.mha", &[text.replace(from, to).as_bytes(), &[0; 140]]);
        assert_refused(source(&path), words);
    };
    refused("MET_UCHAR", "MET_UCHAR_ARRAY", &["ElementType", "MET_UCHAR_ARRAY"]);
    refused("Offset", "ElementNumberOfChannels = 2\nOffset", &["2 numbers per voxel", "`channel` 0 to 1"]);
    refused("7 5 4", "7 5", &["DimSize"]);
    refused("7 5 4", "7 0 4", &["DimSize"]);
    refused("7 5 4", "7 5 9999999999999", &["dims"]);
    refused("NDims = 3", "NDims = 11", &["NDims"]);
    refused("NDims = 3\nDimSize = 7 5 4", "NDims = 5\nDimSize = 7 5 2 2 2", &["axis 3 of 2 values"]);
    refused("0.5 2 1.25", "0.5 two 1.25", &["ElementSpacing"]);
    refused("ElementDataFile = LOCAL", "Comment = x", &["header", "Key = Value"]);
    refused("NDims = 3", "NDims", &["Key = Value"]);
    refused("NDims = 3", "NDims = 3\nNDims = 3", &["each field once"]);
    refused("Offset", "CompressedData = True\nOffset", &["zlib"]);
    refused("Offset", "HeaderSize = 3\nOffset", &["HeaderSize 3"]);
}

#[test]
fn real_files_are_what_their_makers_say() {
    let options = OpenOptions::default();
    // Number of voxels along x, y, z; least, greatest and sum, counted by a Python script on the decoded bytes.
    let files: [(&str, [u64; 3], [f64; 3]); 5] = [
        ("metaimage/neghip.mha", [70, 70, 70], NEGHIP),
        ("metaimage/hydrogenAtom.mha", [128, 128, 128], HYDROGEN),
        ("metaimage/fuel.mha", [68, 68, 68], FUEL),
        ("metaimage/HeadMRVolume.mhd", [48, 62, 42], HEAD),
        ("metaimage/BrainProtonDensitySliceBorder20DirectionPlus30.mhd", [221, 257, 1], BRAIN),
    ];
    for (name, dims, [least, greatest, sum]) in files {
        let Some(path) = data_file(name) else { continue };
        let source = open(&path, &options).unwrap();
        assert_eq!((source.info().format, source.info().dims), ("metaimage", Dims(dims)), "{name}");
        let found = summary(source.as_ref(), [0; 3]);
        assert_eq!((found.0, found.1, found.2), (least, greatest, sum), "{name}");
        if name.contains("DirectionPlus30") {
            let column = source.info().geometry.world_from_index().transform_vector3([1.0, 0.0, 0.0].into());
            assert!((column.x - 30f64.to_radians().cos()).abs() < 1e-6 && (column.y - 0.5).abs() < 1e-6, "{column}");
        }
    }
    if let Some(path) = data_file("metaimage/brain_slice_complex_2ch.mha") {
        assert_refused(open(&path, &options).map(|_| ()), &["2 numbers per voxel"]);
    }
}
