//! NRRD: stored files, written files of every type, encoding and data-file form, geometry, and refusals.

use std::io::Write;
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;
use supervol_format::space::WorldSpace;
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{Geometry, VoxelBox, VoxelType};
use supervol_sources::formats::nrrd::NrrdSource;
use supervol_sources::input::spool::SpoolFolder;
use supervol_sources::{Endian, SourceError, VolumeSource};

use crate::grid_support;
use grid_support::{
    BOTH_ORDERS, assert_refused, check_boxes, data_file, in_order, random_voxels, read_all, summary, value_at,
};

fn open(path: &Path) -> Result<NrrdSource, SourceError> {
    NrrdSource::open(path, &SpoolFolder::system())
}

fn stored(name: &str) -> Option<NrrdSource> {
    Some(open(&data_file(name)?).unwrap_or_else(|e| panic!("{e}")))
}

fn has_note(source: &NrrdSource, words: &str) -> bool {
    source.info().notes.iter().any(|n| n.to_string().contains(words))
}

#[test]
fn ball_in_all_its_forms() {
    let mut balls = Vec::new();
    for form in [".nrrd", ".nhdr", "_gz.nrrd", "_byteskip_minus_one.nhdr"] {
        let Some(source) = stored(&format!("nrrd/odd/BallBinary30x30x30{form}")) else { return };
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([30; 3], VoxelType::I16));
        assert_eq!(source.info().geometry, Geometry::IDENTITY);
        assert_eq!(summary(&source, [15; 3]), (0.0, 257.0, 3_682_296.0, 257.0), "{form}");
        assert!(has_note(&source, "left-posterior-superior"));
        balls.push(read_all(&source).unwrap());
    }
    assert!(balls.windows(2).all(|pair| pair[0] == pair[1]));
    let Some(path) = data_file("nrrd/odd/BallBinary30x30x30_bz2.nrrd") else { return };
    assert_refused(open(&path), &["bzip2", "raw or gzip", "unu save"]);
}

#[test]
fn fiji_stack() {
    let Some(source) = stored("nrrd/odd/fiji-stack-microns-16bit.nrrd") else { return };
    assert_eq!((source.info().dims.0, source.info().voxel_type), ([50, 40, 30], VoxelType::U16));
    assert_eq!(source.info().geometry.spacing, [0.4, 0.4, 2.0]);
    assert!(source.info().axes.iter().all(|axis| axis.unit == "microns"));
    assert_eq!(summary(&source, [25, 20, 15]), (0.0, 64225.0, 1_926_758_400.0, 32768.0));
}

#[test]
fn real_volumes() {
    if let Some(source) = stored("nrrd/prostate_phantom_u16.nrrd") {
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([82, 67, 13], VoxelType::U16));
        let geometry = source.info().geometry;
        assert_eq!(geometry.spacing, [0.5, 0.5, 3.0]);
        assert_eq!(geometry.direction, [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0]);
        assert_eq!(geometry.origin, [15.683382511138916, 76.5357608795166, -52.77613067626954]);
        assert_eq!(summary(&source, [41, 33, 6]), (0.0, 2017.0, 27_811_967.0, 1751.0));
    }
    if let Some(source) = stored("nrrd/avf_f32.nrrd") {
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([74, 93, 20], VoxelType::F32));
        assert_eq!(source.info().geometry.spacing, [0.7226560115814209, 0.7226560115814209, 1.0]);
        let (_, greatest, _, at) = summary(&source, [37, 46, 10]);
        assert_eq!((greatest as f32, at as f32), (2509.887, 364.3384));
    }
    if let Some(source) = stored("nrrd/lung1_label_512.nrrd") {
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([512, 512, 48], VoxelType::I16));
        assert_eq!(source.info().geometry.spacing, [0.5703125, 0.5703125, 5.0]);
        assert_eq!(summary(&source, [256, 256, 24]), (0.0, 1.0, 837.0, 0.0));
    }
}

#[test]
fn small_and_odd() {
    let both = (stored("nrrd/odd/small.nrrd"), stored("nrrd/odd/smallgz.nrrd"));
    if let (Some(raw), Some(gzip)) = both {
        assert_eq!((raw.info().dims.0, raw.info().voxel_type), ([10; 3], VoxelType::F32));
        assert_eq!(read_all(&raw).unwrap(), read_all(&gzip).unwrap());
        assert_eq!(value_at(&raw, [5; 3]) as f32, 113.305_466);
    }
    if let Some(source) = stored("nrrd/odd/test1d_ascii.nrrd") {
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([27, 1, 1], VoxelType::U8));
        assert_eq!(read_all(&source).unwrap(), (1..=27).collect::<Vec<u8>>());
        assert_eq!(source.info().geometry.spacing, [1.0458, 1.0, 1.0]);
        assert!(has_note(&source, "1 axis"));
    }
    if let Some(source) = stored("nrrd/odd/test_simple4d_raw.nrrd") {
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([1; 3], VoxelType::F64));
        assert_eq!(source.info().geometry.spacing, [1.5, 1.5, 1.0]);
        assert_eq!(value_at(&source, [0; 3]) as f32, 0.769_034_26);
        assert!(has_note(&source, "axis 3 has one voxel"));
    }
    if let Some(source) = stored("nrrd/odd/eltype_gray_u12.nrrd") {
        assert_eq!((source.info().dims.0, source.info().voxel_type), ([3, 5, 1], VoxelType::U16));
        assert_eq!(summary(&source, [1, 2, 0]), (52.0, 3091.0, 16871.0, 2335.0));
        assert_eq!(source.info().unit, "gray 4095");
    }
}

#[test]
fn head_in_93_slices() {
    let Some(source) = stored("raw/headsq_64x64x93_i16le/quarter.nhdr") else { return };
    assert_eq!((source.info().dims.0, source.info().voxel_type), ([64, 64, 93], VoxelType::I16));
    assert_eq!(source.info().geometry.spacing, [3.2, 3.2, 1.5]);
    // Files are numbered from 1, so slice 40 is quarter.40, at z = 39.
    let slice = |z| {
        let voxels = VoxelBox { start: [0, 0, z], end: [64, 64, z + 1] };
        grid_support::read(&source, voxels).unwrap()
    };
    let values = voxels_as_f64(VoxelType::I16, &slice(39));
    let range = values.iter().fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(*v), high.max(*v)));
    assert_eq!(range, (0.0, 2523.0));
    let mut all = Vec::new();
    for number in 1..=93 {
        let Some(path) = data_file(&format!("raw/headsq_64x64x93_i16le/quarter.{number}")) else { return };
        all.extend(std::fs::read(path).unwrap());
    }
    check_boxes(&source, &all, 47);
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// The first of the format's names for each type, and another one.
fn names(voxel_type: VoxelType) -> [&'static str; 2] {
    match voxel_type {
        VoxelType::U8 => ["uchar", "unsigned char"],
        VoxelType::I8 => ["signed char", "int8"],
        VoxelType::U16 => ["unsigned short int", "uint16_t"],
        VoxelType::I16 => ["short", "signed short"],
        VoxelType::U32 => ["unsigned int", "uint32"],
        VoxelType::I32 => ["int", "signed int"],
        VoxelType::F32 => ["float", "float"],
        VoxelType::F64 => ["double", "double"],
    }
}

#[test]
fn round_trips() {
    let folder = tempfile::tempdir().unwrap();
    let spool = SpoolFolder::at(folder.path());
    let path = folder.path().join("volume.nrrd");
    for dims in [[11, 7, 5], [1, 1, 1], [40, 3, 17]] {
        for voxel_type in VoxelType::ALL {
            for endian in BOTH_ORDERS {
                for (encoding, name) in ["raw", "gzip"].into_iter().zip(names(voxel_type)) {
                    let voxels = random_voxels(dims, voxel_type, 53);
                    let stored = in_order(&voxels, voxel_type.bytes(), endian);
                    let order = if endian == Endian::Big { "big" } else { "little" };
                    let [nx, ny, nz] = dims;
                    let mut file = format!(
                        "NRRD0005\n# a comment: with a colon\ntype: {name}\nDimension: 3\nsizes: {nx} {ny} {nz}\n\
                         endian: {order}\nencoding: {encoding}\nkey:=value: with a colon\n\n"
                    )
                    .into_bytes();
                    file.extend(if encoding == "raw" { stored } else { gzip(&stored) });
                    std::fs::write(&path, file).unwrap();
                    let source = NrrdSource::open(&path, &spool).unwrap_or_else(|e| panic!("{e}"));
                    assert_eq!((source.info().dims.0, source.info().voxel_type), (dims, voxel_type));
                    assert!(source.info().notes.is_empty(), "{:?}", source.info().notes);
                    check_boxes(&source, &voxels, 59);
                }
            }
        }
    }
}

/// A header and the files beside it, in a temporary folder.
struct Files(tempfile::TempDir);

impl Files {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn put(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    fn open(&self, header: &str) -> Result<NrrdSource, SourceError> {
        open(&self.put("header.nhdr", header))
    }
}

const SMALL: &str = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 3 2\n";

fn small_voxels() -> Vec<u8> {
    (10..34).collect()
}

#[test]
fn segmentations_are_labels() {
    let files = Files::new();
    let with = |pairs: &str| {
        files.put("small.raw", small_voxels());
        files.open(&format!("{SMALL}encoding: raw\ndata file: small.raw\n{pairs}")).unwrap().info().labels
    };
    assert_eq!(with("Segmenter:=somebody\n"), None);
    assert!(with("Segment0_ID:=bone\nSegment0_LabelValue:=1\n").is_some());
    assert!(with("Segmentation_MasterRepresentation:=Binary labelmap\n").is_some());
}

#[test]
fn text_encoding() {
    let files = Files::new();
    let with = |numbers: &str| files.open(&format!("{SMALL}encoding: text\n\n{numbers}"));
    let numbers: Vec<String> = small_voxels().iter().map(u8::to_string).collect();
    check_boxes(&with(&numbers.join(" ")).unwrap(), &small_voxels(), 61);
    check_boxes(&with(&numbers.join(",\r\n  ")).unwrap(), &small_voxels(), 61);
    assert_refused(with(&numbers[1..].join(" ")), &["24 numbers", "found 23 numbers"]);
    assert_refused(with(&format!("{} 7", numbers.join(" "))), &["24 numbers", "at least 25"]);
    assert_refused(with(&format!("256 {}", numbers[1..].join(" "))), &["number 0", "u8", "`256`"]);
    assert_refused(with(&format!("{} x", numbers[1..].join(" "))), &["number 23", "`x`"]);
    assert_refused(with("1 2 3"), &["24 numbers", "5 bytes of text"]);
    assert_refused(with(&"9".repeat(999)), &["characters"]);
    let floats = "NRRD0001\ntype: float\ndimension: 1\nsizes: 4\nencoding: txt\n\n1.5 -2e3 nan inf";
    let values = voxels_as_f64(VoxelType::F32, &read_all(&files.open(floats).unwrap()).unwrap());
    assert_eq!((values[0], values[1], values[3]), (1.5, -2000.0, f64::INFINITY));
    assert!(values[2].is_nan());
}

#[test]
fn detached_forms() {
    let files = Files::new();
    let voxels = small_voxels();
    let open = |fields: &str| files.open(&format!("{SMALL}encoding: raw\n{fields}"));
    files.put("all.raw", &voxels);
    files.put("skipped.raw", [b"two\nlines\nand four", &voxels[..]].concat());
    files.put("my data.raw", &voxels);
    for (number, slice) in voxels.chunks(12).enumerate() {
        files.put(&format!("slice{:03}.raw", 5 + 2 * number), slice);
        files.put(&format!("down{}.raw", 9 - number), slice);
    }
    for fields in [
        "data file: all.raw\n",
        "datafile: ./all.raw\n",
        "data file: my data.raw\n",
        "line skip: 2\nbyte skip: 8\ndata file: skipped.raw\n",
        "byte skip: -1\ndata file: skipped.raw\n",
        "data file: slice%03d.raw 5 7 2\n",
        "data file: slice%03d.raw 5 7 2 2\n",
        "data file: down%d.raw 9 8 -1\n",
        "data file: LIST\nslice005.raw\nslice007.raw\n",
        "data file: LIST 2\r\ndown9.raw\r\ndown8.raw\r\n\r\n",
    ] {
        check_boxes(&open(fields).unwrap_or_else(|e| panic!("{fields}: {e}")), &voxels, 67);
    }
    // Compressed parts are decoded one after the other, each with its own skips.
    files.put("a.gz", [b"line\n", &gzip(&[&[0, 0], &voxels[..12]].concat())[..]].concat());
    files.put("b.gz", [b"line\n", &gzip(&[&[0, 0], &voxels[12..]].concat())[..]].concat());
    let parts = "encoding: gz\nline skip: 1\nbyte skip: 2\ndata file: LIST\na.gz\nb.gz\n";
    check_boxes(&files.open(&format!("{SMALL}{parts}")).unwrap(), &voxels, 71);

    assert_refused(open("data file: slice%03d.raw 5 5 1\n"), &["slice005.raw", "24 bytes", "12 bytes"]);
    assert_refused(open("data file: LIST\n"), &["at least one file name"]);
    assert_refused(open("data file: slice%s.raw 5 7 2\n"), &["%d", "slice%s.raw"]);
    assert_refused(open("data file: slice%03d.raw 5 7 0\n"), &["min, max and step"]);
    assert_refused(open("data file: slice%99999d.raw 5 7 1\n"), &["%d"]);
    assert_refused(open("data file: slice%03d.raw 5 9223372036854775807 1\n"), &["min, max and step"]);
    assert_refused(open("data file: slice%03d.raw 5 7 2 9\n"), &["dimension of 1 to 3"]);
    assert_refused(open("byte skip: 30\ndata file: all.raw\n"), &["byte skip", "24 bytes"]);
    assert_refused(open("byte skip: -2\ndata file: all.raw\n"), &["byte skip", "-2"]);
    assert_refused(open("line skip: 9\ndata file: skipped.raw\n"), &["9 lines", "lines"]);
    assert_refused(open(""), &["data file", "end of the file"]);
    assert_refused(open("data file: missing.raw\n"), &["data file", "missing.raw", "no such file"]);
}

#[test]
fn windows_line_ends_and_excess() {
    let files = Files::new();
    let header = format!("{SMALL}encoding: raw\nsome: thing\n\n").replace('\n', "\r\n");
    let path = files.put("windows.nrrd", [header.as_bytes(), &small_voxels(), b"extra"].concat());
    let source = open(&path).unwrap();
    check_boxes(&source, &small_voxels(), 73);
    assert!(has_note(&source, "windows.nrrd goes on after the voxels; bytes not read: 5"));
    assert!(has_note(&source, "`some` is unknown"));
    let path = files.put("excess.nrrd", [format!("{SMALL}encoding: gzip\n\n").as_bytes(), &gzip(&[1; 25])].concat());
    assert_refused(open(&path), &["24 bytes", "at least 25"]);
    let path = files.put("short.nrrd", [format!("{SMALL}encoding: gzip\n\n").as_bytes(), &gzip(&[1; 23])].concat());
    assert_refused(open(&path), &["24 bytes", "found 23"]);
}

#[test]
fn headers_that_are_refused() {
    let files = Files::new();
    let path = |header: &str| files.put("h.nrrd", [header.as_bytes(), &[1; 4096]].concat());
    let open = |header: &str| open(&path(header));
    let fields = |kind: &str, dims: &str, more: &str| {
        let dimension = dims.split(' ').count();
        format!(
            "NRRD0004\ntype: {kind}\ndimension: {dimension}\nsizes: {dims}\nencoding: raw\nendian: little\n{more}\n"
        )
    };
    assert!(open(&fields("uint8", "4 3 2", "")).is_ok());
    assert_refused(open("NRRD0006\n\n"), &["NRRD0001 to NRRD0005", "NRRD0006"]);
    assert_refused(open(&fields("int64", "4 3 2", "")), &["64-bit integers of", "fit no voxel type"]);
    assert_refused(open(&fields("block", "4 3 2", "")), &["block"]);
    assert_refused(open(&fields("half", "4 3 2", "")), &["type", "half"]);
    assert_refused(open(&fields("uint8", "3 4 3 2 2", "")), &["axis 3 of 2 values", "unu slice -a 3"]);
    let vector = fields("uint8", "3 4 3 2", "space dimension: 3\nspace directions: none (1,0,0) (0,1,0) (0,0,1)\n");
    assert_refused(open(&vector), &["3 numbers per voxel", "`channel` 0 to 2"]);
    assert_refused(open(&fields("uint8", "4 -3 2", "")), &["sizes", "4 -3 2"]);
    assert_refused(open(&fields("uint8", "4 0 2", "")), &["sizes"]);
    assert_refused(open(&fields("uint8", "4 3 2", "").replace("dimension: 3", "dimension: 2")), &["2 positive"]);
    assert_refused(open(&fields("uint8", "4 3 99999999", "")), &["dims"]);
    assert_refused(open(&fields("uint8", "400 300 200", "")), &["length of the file", "24000"]);
    assert_refused(open(&fields("uint16", "4 3 2", "").replace("endian: little\n", "")), &["endian"]);
    assert_refused(open(&fields("uint8", "4 3 2", "").replace("raw", "hex")), &["hex", "unu save"]);
    assert_refused(open(&fields("uint8", "4 3 2", "").replace("raw", "zip")), &["encoding", "zip"]);
    assert_refused(open(&fields("uint8", "4 3 2", "type: float\n")), &["each field once"]);
    assert_refused(
        open(&fields("uint8", "4 3 2", "space directions: (1,0,0) (0,1) (0,0,1)\nspace: RAS\n")),
        &["3 numbers"],
    );
    assert_refused(open(&fields("uint8", "4 3 2", "spacings: 1 2\n")), &["spacings", "3 numbers"]);
    assert_refused(open(&fields("uint8", "4 3 2", "this is no field\n")), &["this is no field"]);
}

#[test]
fn geometry() {
    let files = Files::new();
    let open = |fields: &str| {
        let header = format!("{SMALL}encoding: raw\n{fields}\n");
        open(&files.put("g.nrrd", [header.as_bytes(), &[1; 24]].concat())).unwrap_or_else(|e| panic!("{fields}: {e}"))
    };
    let geometry = |fields: &str| open(fields).info().geometry;
    // Axes rotated and sheared; the columns are the directions of the axes.
    let turned = geometry("space: RAS\nspace directions: (0,2,0) (-3,0,0) (0,0.6,0.8)\nspace origin: (1,2,3)\n");
    assert_eq!((turned.spacing, turned.origin), ([2.0, 3.0, 1.0], [1.0, 2.0, 3.0]));
    assert_eq!(turned.direction, [0.0, -1.0, 0.0, 1.0, 0.0, 0.6, 0.0, 0.0, 0.8]);
    // An axis without a vector is perpendicular to the others and has the per-axis spacing.
    let none = open(
        "space dimension: 3\nspace directions: (0,2,0) (0,0,3) none\n\
         spacings: nan nan 7\nkinds: domain domain domain\n",
    );
    assert_eq!(none.info().geometry.spacing, [2.0, 3.0, 7.0]);
    assert_eq!(none.info().geometry.direction, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
    // Linearly dependent vectors are replaced, with a note.
    let flat = open("space: LPS\nspace directions: (2,0,0) (4,0,0) (0,0,1)\n");
    assert_eq!(flat.info().geometry, Geometry { spacing: [2.0, 4.0, 1.0], ..Geometry::IDENTITY });
    assert!(has_note(&flat, "span no volume"));
    let zero = open("space: LPS\nspace directions: (0,0,0) (0,4,0) (0,0,1)\nspace origin: (nan,nan,nan)\n");
    assert_eq!(zero.info().geometry, Geometry { spacing: [1.0, 4.0, 1.0], ..Geometry::IDENTITY });
    // Only spacings: a negative one reverses its axis, an impossible one becomes 1.
    let spacings = open("spacings: -2 0 0.5\nunits: \"mm\" \"\" \"um\"\nlabels: \"left\" \"\" \"up\"\n");
    assert_eq!(spacings.info().geometry.spacing, [2.0, 1.0, 0.5]);
    assert_eq!(spacings.info().geometry.direction, [-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let axes = spacings.info().axes.clone().map(|a| (a.name, a.unit));
    assert_eq!(axes.each_ref().map(|a| (&*a.0, &*a.1)), [("left", "mm"), ("y", ""), ("up", "um")]);
    // Axis limits are positions of cells or nodes.
    let limits = geometry("axis mins: 0 10 0\naxis maxs: 8 16 1\ncenterings: cell node node\n");
    assert_eq!((limits.spacing, limits.origin), ([2.0, 3.0, 1.0], [1.0, 10.0, 0.0]));
    // An axis gets the unit of the closest world axis.
    let units = open("space: RAS\nspace directions: (0,2,0) (1,0,0) (0,0,1)\nspace units: \"a\" \"b\" \"c\"\n");
    assert_eq!(units.info().axes.clone().map(|a| a.unit), ["b", "a", "c"]);
    // Two axes in a plane.
    let header = "NRRD0004\ntype: uint8\ndimension: 2\nsizes: 4 3\nspace dimension: 2\nspace directions: (2,0) (0,5)\n";
    let plane = Files::new().open(&format!("{header}space origin: (1,2)\nencoding: raw\n\n123456789012")).unwrap();
    assert_eq!((plane.info().geometry.spacing, plane.info().geometry.origin), ([2.0, 5.0, 1.0], [1.0, 2.0, 0.0]));
}

#[test]
fn patients_frames_are_known_and_left_handed_spaces_turned_round() {
    let files = Files::new();
    let open = |space: &str| {
        let header = format!(
            "{SMALL}encoding: raw\nspace: {space}\nspace directions: (2,0,0) (0,3,0) (0,0,4)\nspace origin: (1,2,3)\n\n"
        );
        open(&files.put("s.nrrd", [header.as_bytes(), &[1; 24]].concat())).unwrap_or_else(|e| panic!("{space}: {e}"))
    };
    let place = |space: &str| {
        let source = open(space);
        let Geometry { origin, direction: d, .. } = source.info().geometry;
        (source.info().space, origin, [d[0], d[4], d[8]])
    };
    let (ras, lps) = (WorldSpace::RightAnteriorSuperior, WorldSpace::LeftPosteriorSuperior);
    assert_eq!(place("RAS"), (ras, [1.0, 2.0, 3.0], [1.0; 3]));
    assert_eq!(place("left-posterior-superior"), (lps, [1.0, 2.0, 3.0], [1.0; 3]));
    assert_eq!(place("left-anterior-superior"), (ras, [-1.0, 2.0, 3.0], [-1.0, 1.0, 1.0]));
    assert_eq!(place("3D-left-handed"), (WorldSpace::Unknown, [1.0, 2.0, -3.0], [1.0, 1.0, -1.0]));
    assert_eq!(place("scanner-xyz"), (WorldSpace::Unknown, [1.0, 2.0, 3.0], [1.0; 3]));
    assert!(has_note(&open("LAS"), "x turned round") && !has_note(&open("LPS"), "turned round"));
}
