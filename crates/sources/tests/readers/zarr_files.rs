//! Zarr, OME-Zarr and N5: one volume in every variant of zarr-python, numcodecs and tensorstore (see
//! `tests/data/README.md`), real files, and damaged files.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use supervol_format::random::Random;
use supervol_format::voxel_type::Voxel;
use supervol_format::{Dims, VoxelType, with_voxel};
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{SourceError, VolumeSource};

use crate::grid_support;
use grid_support::*;

const DIMS: [u64; 3] = [24, 20, 18];

/// The files of the archive, unpacked once.
static FILES: LazyLock<tempfile::TempDir> = LazyLock::new(unpacked);

fn unpacked() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let archive = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/zarr.zip");
    let file = std::fs::File::open(archive).unwrap();
    zip::ZipArchive::new(file).unwrap().extract(folder.path()).unwrap();
    folder
}

fn opened(path: &Path) -> Result<Box<dyn VolumeSource>, SourceError> {
    open(path, &OpenOptions::default())
}

fn named(path: &Path, array: &str) -> PathBuf {
    let mut path = path.as_os_str().to_owned();
    path.push(":/");
    path.push(array);
    path.into()
}

fn value([x, y, z]: [u64; 3]) -> f64 {
    (3 * x + 5 * y + 7 * z + x * y * z % 11) as f64
}

/// Voxels of this type, computed from their positions.
fn voxels(voxel_type: VoxelType, dims: [u64; 3], value: impl Fn([u64; 3]) -> f64) -> Vec<u8> {
    let mut out = Vec::new();
    let mut voxel = [0; 8];
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                with_voxel!(voxel_type, V => V::from_f64(value([x, y, z])).write_le(&mut voxel[..size_of::<V>()]));
                out.extend_from_slice(&voxel[..voxel_type.bytes()]);
            }
        }
    }
    out
}

#[test]
fn every_way_in_which_libraries_write() {
    use VoxelType::{F32, F64, I16, I32, U8, U16, U32};
    let blosc =
        ["blosclz", "lz4", "lz4hc", "zlib", "zstd"].iter().flat_map(|c| [0, 1, 2].map(|s| format!("v2/{c}-{s}")));
    let others = [
        ("v2/blosc-blocks", F32),
        ("v2/blosc-f8", F64),
        ("v2/blosc-i8", U16),
        ("v2/blosc-odd", I32),
        ("v2/gzip", U16),
        ("v2/zlib", F32),
        ("v2/zstd", I16),
        ("v2/lz4", I32),
        ("v2/raw", U32),
        ("v2/shuffle-zlib", U16),
        ("v3/zstd", U16),
        ("v3/gzip", F32),
        ("v3/blosc", I32),
        ("v3/checksum", I16),
        ("v3/transpose", F64),
        ("v3/sharded", U16),
        ("v3/start", U16),
        ("v3/keys", U16),
        ("n5/gzip", U16),
        ("n5/raw", F32),
        ("n5/zstd", I16),
        ("n5/blosc", I32),
    ];
    let all = blosc.map(|name| (name, U16)).chain(others.map(|(name, voxel_type)| (name.to_string(), voxel_type)));
    for (seed, (name, voxel_type)) in all.enumerate() {
        let source = opened(&FILES.path().join(&name)).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((source.info().dims, source.info().voxel_type), (Dims(DIMS), voxel_type), "{name}");
        check_boxes(source.as_ref(), &voxels(voxel_type, DIMS, value), seed as u64);
    }
    let bits = opened(&FILES.path().join("v2/bool")).unwrap();
    check_boxes(bits.as_ref(), &voxels(U8, DIMS, |at| value(at) % 2.0), 1);
    let holes = opened(&FILES.path().join("v2/holes")).unwrap();
    let is_hole = |[x, _, z]: [u64; 3]| z >= 9 && x >= 16;
    check_boxes(holes.as_ref(), &voxels(I16, DIMS, |at| if is_hole(at) { -7.0 } else { value(at) }), 1);
}

#[test]
fn images_have_levels_axes_and_a_place() {
    for name in ["ome-0.4", "ome-0.5"] {
        let path = FILES.path().join(name);
        let mut options = OpenOptions::default();
        let first = open(&path, &options).unwrap_or_else(|e| panic!("{e}"));
        let info = first.info();
        assert_eq!((info.format, info.dims), ("ome-zarr", Dims(DIMS)), "{name}");
        check_boxes(first.as_ref(), &voxels(VoxelType::U16, DIMS, value), 1);
        let g = info.geometry;
        assert_eq!((g.spacing, g.origin), ([0.25, 0.5, 2.0], [20.0, 10.0, 0.0]), "{name}");
        assert_eq!(
            info.axes.each_ref().map(|axis| (axis.name.as_str(), axis.unit.as_str())),
            [("x", "um"), ("y", "um"), ("z", "um")]
        );
        assert!(info.notes.iter().any(|n| n.to_string().contains("2 channels")), "{:?}", info.notes);
        assert!(info.notes.iter().any(|n| n.to_string().contains("2 levels")), "{:?}", info.notes);
        options.selection.level = Some(1);
        options.selection.channel = Some(1);
        let coarse = open(&path, &options).unwrap_or_else(|e| panic!("{e}"));
        let half = DIMS.map(|n| n / 2);
        check_boxes(coarse.as_ref(), &voxels(VoxelType::U16, half, |at| value(at.map(|n| 2 * n)) + 1000.0), 1);
        assert_eq!(
            (coarse.info().geometry.spacing, coarse.info().geometry.origin),
            ([0.5, 1.0, 4.0], [20.0, 10.0, 1.0])
        );
        options.selection.level = Some(2);
        assert_refused(open(&path, &options).map(|_| ()), &["`level` 2", "the last is number 1"]);
        // An array of the image, by name.
        let array = opened(&named(&path, "1")).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((array.info().dims, array.info().format), (Dims(half), "zarr"));
    }
    let n5 = opened(&FILES.path().join("n5/gzip")).unwrap();
    assert_eq!((n5.info().geometry.spacing, n5.info().axes[2].unit.as_str()), ([0.25, 0.5, 2.0], "um"));
}

#[test]
fn frames_and_channels_of_plain_arrays() {
    let path = FILES.path().join("v3/five");
    let mut options = OpenOptions::default();
    for (frame, channel) in [(0, 0), (1, 2), (0, 1)] {
        (options.selection.frame, options.selection.channel) = (Some(frame), Some(channel));
        let source = open(&path, &options).unwrap_or_else(|e| panic!("{e}"));
        let expected = |at| value(at) % 200.0 + (channel + 10 * frame) as f64;
        check_boxes(source.as_ref(), &voxels(VoxelType::U8, DIMS, expected), frame);
    }
    options.selection.frame = Some(2);
    assert_refused(open(&path, &options).map(|_| ()), &["`frame` 2", "the last is number 1"]);
}

#[test]
fn groups_ask_for_a_name() {
    assert_refused(opened(FILES.path().join("v2").as_path()).map(|_| ()), &["neither DICOM, pictures nor SEG-Y"]);
    let group = tempfile::tempdir().unwrap();
    std::fs::write(group.path().join(".zgroup"), r#"{"zarr_format": 2}"#).unwrap();
    assert_refused(opened(group.path()).map(|_| ()), &["group of Zarr", "nothing that is read"]);
    for name in ["a", "b"] {
        copy_folder(&FILES.path().join("v2/zstd-1"), &group.path().join(name));
    }
    assert_refused(opened(group.path()).map(|_| ()), &["a, b", ":/a"]);
    assert!(opened(&named(group.path(), "b")).is_ok());
    assert_refused(opened(&named(group.path(), "c")).map(|_| ()), &["neither `zarr.json`"]);
    std::fs::remove_dir_all(group.path().join("b")).unwrap();
    assert!(opened(group.path()).is_ok(), "the only array of a group");
    std::fs::write(group.path().join(".zattrs"), r#"{"plate": {}}"#).unwrap();
    assert_refused(opened(group.path()).map(|_| ()), &["plate of wells", ":/a"]);
}

#[test]
fn nothing_outside_the_folder_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let inside = folder.path().join("in");
    copy_folder(&FILES.path().join("v2/zstd-1"), &inside);
    copy_folder(&FILES.path().join("v2/zstd-1"), &folder.path().join("out"));
    assert_refused(opened(&named(&inside, "../out")).map(|_| ()), &["outside the folder", "`outside`"]);
    std::fs::write(inside.join(".zattrs"), "{}").unwrap();
    let attributes = r#"{"multiscales": [{"axes": ["z", "y", "x"], "datasets": [{"path": "../out"}]}]}"#;
    let image = folder.path().join("image");
    std::fs::create_dir(&image).unwrap();
    std::fs::write(image.join(".zattrs"), attributes).unwrap();
    assert_refused(opened(&image).map(|_| ()), &["`../out` lies outside"]);
    let mut options = OpenOptions::default();
    #[cfg(unix)]
    {
        let chunk = inside.join("0.0.0");
        std::fs::remove_file(&chunk).unwrap();
        std::os::unix::fs::symlink(folder.path().join("out/0.0.0"), &chunk).unwrap();
        let source = opened(&inside).unwrap();
        assert_refused(read_all(source.as_ref()).map(|_| ()), &["`0.0.0` lies outside"]);
    }
    options.outside = supervol_sources::formats::nrrd::Outside::Allowed;
    let allowed = open(&inside, &options).unwrap();
    check_boxes(allowed.as_ref(), &voxels(VoxelType::U16, DIMS, value), 1);
}

#[test]
fn the_attribute_of_an_image_says_labels() {
    let folder = tempfile::tempdir().unwrap();
    copy_folder(&FILES.path().join("v2/zstd-1"), &folder.path().join("0"));
    let image = r#""multiscales": [{"axes": ["z", "y", "x"], "datasets": [{"path": "0"}]}]"#;
    let labels = |attributes: String| {
        std::fs::write(folder.path().join(".zattrs"), attributes).unwrap();
        opened(folder.path()).unwrap().info().labels
    };
    assert_eq!(labels(format!("{{{image}}}")), None);
    assert!(labels(format!(r#"{{{image}, "image-label": {{"version": "0.4"}}}}"#)).is_some());
    assert!(labels(format!(r#"{{"ome": {{{image}, "image-label": {{}}}}}}"#)).is_some());
}

fn copy_folder(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy_folder(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).unwrap();
        }
    }
}

/// Metadata of an array of 8 x 8 x 8 bytes in one chunk, with changes.
fn array_with(change: impl Fn(&mut serde_json::Value)) -> tempfile::TempDir {
    let mut metadata = serde_json::json!({
        "zarr_format": 2, "shape": [8, 8, 8], "chunks": [8, 8, 8], "dtype": "|u1", "compressor": null, "fill_value": 0, "order": "C",
        "filters": null
    });
    change(&mut metadata);
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(".zarray"), metadata.to_string()).unwrap();
    folder
}

#[test]
fn what_is_wrong_or_not_read_is_said() {
    let cases: [(&str, serde_json::Value, &[&str]); 12] = [
        ("shape", serde_json::json!([8, 8]), &["shape", "a chunk of as many"]),
        ("shape", serde_json::json!([0, 8, 8]), &["at least one element"]),
        ("chunks", serde_json::json!([0, 8, 8]), &["at least one element"]),
        (
            "chunks",
            serde_json::json!([1u64 << 30, 1u64 << 30, 1u64 << 30]),
            &["more than can be addressed", "smaller chunks"],
        ),
        ("chunks", serde_json::json!([1024, 1024, 4096]), &["`memory_bytes`", "65536 MiB"]),
        ("shape", serde_json::json!([1u64 << 62, 1u64 << 62, 1u64 << 62]), &["dims"]),
        ("dtype", serde_json::json!("<c8"), &["<c8"]),
        ("dtype", serde_json::json!([["a", "<u2"]]), &["elements of type"]),
        ("compressor", serde_json::json!({"id": "bz2"}), &["bz2"]),
        ("filters", serde_json::json!([{"id": "delta"}]), &["delta"]),
        ("fill_value", serde_json::json!("many"), &["fill_value"]),
        ("order", serde_json::json!("K"), &["C or F"]),
    ];
    for (key, wrong, words) in cases {
        let folder = array_with(|metadata| metadata[key] = wrong.clone());
        let mut options = OpenOptions::default();
        options.segy.memory_bytes = 256 << 20;
        let found = open(folder.path(), &options).map(|_| ());
        assert!(found.is_err(), "{key} = {wrong}");
        assert_refused(found, words);
    }
    let series = OpenOptions {
        selection: supervol_sources::input::selection::Selection { series: Some("1".into()), ..Default::default() },
        ..OpenOptions::default()
    };
    assert_refused(open(array_with(|_| ()).path(), &series).map(|_| ()), &["only DICOM and OME-TIFF have series"]);
    assert!(largest_allocation::largest_bytes() < 64 << 20);
}

/// Filters that round numbers change nothing when they are read. Attributes by Python may hold words that are no JSON.
#[test]
fn rounding_filters_and_attributes_of_python() {
    for (filter, is_read) in [
        (serde_json::json!({"id": "bitround", "keepbits": 8}), true),
        (serde_json::json!({"id": "quantize", "digits": 2, "dtype": "<f4", "astype": "<f4"}), true),
        (serde_json::json!({"id": "quantize", "digits": 2, "dtype": "<f4", "astype": "<i2"}), false),
    ] {
        let folder = array_with(|metadata| metadata["filters"] = serde_json::json!([filter]));
        assert_eq!(open(folder.path(), &OpenOptions::default()).is_ok(), is_read, "{filter}");
    }
    let folder = array_with(|metadata| metadata["fill_value"] = 7.into());
    let attributes = r#"{"_ARRAY_DIMENSIONS": ["z", "y", "x"], "title": "NaN \" NaN", "missing_value": NaN,
                         "valid_range": [-Infinity, 100], "units": "m"}"#;
    std::fs::write(folder.path().join(".zattrs"), attributes).unwrap();
    let voxels: Vec<u8> = (0..=255).chain(0..=255).collect();
    std::fs::write(folder.path().join("0.0.0"), &voxels).unwrap();
    let source = open(folder.path(), &OpenOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((source.info().nodata, source.info().unit.as_str()), (Some(7.0), "m"));
    // 7 is the fill value, and replaces all that is not valid.
    let expected: Vec<u8> = voxels.iter().map(|voxel| if *voxel > 100 { 7 } else { *voxel }).collect();
    check_boxes(source.as_ref(), &expected, 5);
}

/// MDIO 0 states line numbers and samples at its root, and the traces that there are beside the data.
#[test]
fn a_survey_of_mdio_0() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mdio");
    let write = |name: &str, bytes: &[u8]| {
        let file = path.join(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, bytes).unwrap();
    };
    let array = |shape: &[u64], dtype: &str| {
        serde_json::json!({"zarr_format": 2, "shape": shape, "chunks": shape, "dtype": dtype, "compressor": null, "fill_value": 0,
                           "order": "C", "filters": null})
        .to_string()
    };
    let root = serde_json::json!({"dimension": [{"name": "inline", "coords": [10, 12]}, {"name": "crossline", "coords": [7, 8, 9]},
                                                {"name": "sample", "coords": [100.0, 104.0]}]});
    for group in ["", "data/", "metadata/"] {
        write(&format!("{group}.zgroup"), br#"{"zarr_format": 2}"#);
    }
    write(".zattrs", root.to_string().as_bytes());
    write("data/chunked_012/.zarray", array(&[2, 3, 2], "<f4").as_bytes());
    let samples: Vec<u8> = (0..12u8).flat_map(|n| f32::from(n).to_le_bytes()).collect();
    write("data/chunked_012/0.0.0", &samples);
    write("metadata/live_mask/.zarray", array(&[2, 3], "|b1").as_bytes());
    write("metadata/live_mask/0.0", &[1, 1, 0, 1, 1, 1]);
    for name in [path.clone(), named(&path, "data/chunked_012")] {
        let source = opened(&name).unwrap_or_else(|e| panic!("{e}"));
        let (info, survey) = (source.info(), source.info().survey.as_ref().expect("a survey"));
        assert_eq!((info.dims, survey.missing_traces), (Dims([3, 2, 2]), 1));
        assert_eq!((survey.inline.first, survey.inline.step, survey.crossline.first), (10, 2, 7));
        assert_eq!((survey.first_sample, survey.sample_interval), (100.0, 4.0));
        assert_eq!((value_at(source.as_ref(), [1, 1, 1]), value_at(source.as_ref(), [1, 0, 0])), (9.0, 2.0));
        assert!(value_at(source.as_ref(), [2, 0, 1]).is_nan(), "a trace that is not there");
    }
}

/// A stream that inflates to far more than its chunk is not inflated further.
#[test]
fn chunks_are_inflated_to_their_size_and_no_further() {
    use std::io::Write;
    let zeros = vec![0; 200 << 20];
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gzip.write_all(&zeros).unwrap();
    let bombs = [
        ("gzip", gzip.finish().unwrap()),
        ("zstd", zstd::bulk::compress(&zeros, 1).unwrap()),
        ("lz4", [&(200i32 << 20).to_le_bytes()[..], &[0; 40]].concat()),
        ("blosc", [&[2, 1, 1, 1][..], &(200u32 << 20).to_le_bytes(), &(200u32 << 20).to_le_bytes(), &[0; 40]].concat()),
    ];
    drop(zeros);
    for (codec, bomb) in bombs {
        let folder = array_with(|metadata| metadata["compressor"] = serde_json::json!({"id": codec}));
        // A file more than 65536 bytes longer than the voxels is not even read.
        std::fs::write(folder.path().join("0.0.0"), &bomb).unwrap();
        let source = opened(folder.path()).unwrap();
        let mut out = vec![0; 512];
        let error = source.read_box(source.info().dims.full_box(), &mut out);
        assert_refused(error, &["0.0.0", "chunk"]);
    }
}

/// Every truncation and many flipped bits of every file of an array: an error or voxels, without a panic, in little
/// memory.
#[test]
fn damaged_files_are_errors_or_other_voxels() {
    let work = tempfile::tempdir().unwrap();
    let mut random = Random::new(7);
    for name in [
        "v2/blosclz-1",
        "v2/lz4-2",
        "v2/zlib-0",
        "v3/sharded",
        "v3/start",
        "v2/lz4",
        "n5/gzip/s0",
        "n5/blosc",
        "ome-0.5",
    ] {
        let folder = work.path().join(name.replace('/', "-"));
        copy_folder(&FILES.path().join(name), &folder);
        let mut files = Vec::new();
        list(&folder, &mut files);
        for _ in 0..100 {
            let file = &files[random.below(files.len() as u64) as usize];
            let whole = std::fs::read(file).unwrap();
            let mut damaged = whole.clone();
            if random.below(3) == 0 {
                damaged.truncate(random.below(whole.len() as u64) as usize);
            } else {
                for _ in 0..=random.below(3) {
                    damaged[random.below(whole.len() as u64) as usize] ^= 1 << random.below(8);
                }
            }
            std::fs::write(file, &damaged).unwrap();
            if let Ok(source) = opened(&folder) {
                let dims = source.info().dims.0;
                let end = dims.map(|n| n.min(24));
                let _ = read(source.as_ref(), supervol_format::VoxelBox { start: [0; 3], end });
            }
            std::fs::write(file, &whole).unwrap();
        }
    }
}

fn list(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { list(&path, files) } else { files.push(path) }
    }
}

/// Name, dims, type, least, greatest and sum by zarr-python (by hand if it refuses the array).
type RealFile = (&'static str, [u64; 3], VoxelType, [f64; 3]);
const REAL_FILES: [RealFile; 13] = [
    ("zarr/ome_zarr_0.4", [10, 10, 1], VoxelType::U16, [0.0, 99.0, 4950.0]),
    ("zarr/ome_zarr_0.5", [10, 10, 1], VoxelType::U16, [0.0, 99.0, 4950.0]),
    ("zarr/ome_zarr_0.6_scale.zarr", [186, 226, 27], VoxelType::U8, [0.0, 255.0, 40_784_917.0]),
    ("zarr/v2/1d.contiguous.f4.be", [4, 1, 1], VoxelType::F32, [-1000.5, 1000.5, 0.0]),
    ("zarr/v2/2d.chunked.ragged.i2", [3, 3, 1], VoxelType::I16, [1.0, 9.0, 45.0]),
    ("zarr/v2/3d.chunked.i2", [3, 3, 3], VoxelType::I16, [0.0, 26.0, 351.0]),
    ("zarr/v2/3d.chunked.mixed.i2.C", [3, 3, 3], VoxelType::I16, [0.0, 26.0, 351.0]),
    ("zarr/v2/3d.chunked.mixed.i2.F", [3, 3, 3], VoxelType::I16, [0.0, 26.0, 351.0]),
    ("zarr/v2/3d.contiguous.i2", [3, 3, 3], VoxelType::I16, [0.0, 26.0, 351.0]),
    ("zarr/v3/3d.chunked.compressed.sharded.i2", [4, 4, 4], VoxelType::I16, [0.0, 63.0, 2016.0]),
    ("zarr/v3/3d.chunked.i2", [3, 3, 3], VoxelType::I16, [0.0, 26.0, 351.0]),
    ("zarr/v3/3d.chunked.mixed.i2.F", [3, 3, 3], VoxelType::I16, [0.0, 26.0, 351.0]),
    ("zarr/v3/3d.contiguous.i2", [3, 3, 3], VoxelType::I16, [0.0, 26.0, 351.0]),
];

#[test]
fn real_files_are_what_zarr_python_reads() {
    for (name, dims, voxel_type, [least, greatest, sum]) in REAL_FILES {
        let Some(path) = data_file(name) else { continue };
        let source = opened(&path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((source.info().dims, source.info().voxel_type), (Dims(dims), voxel_type), "{name}");
        let found = summary(source.as_ref(), [0; 3]);
        assert_eq!((found.0, found.1, found.2), (least, greatest, sum), "{name}");
    }
    if let Some(path) = data_file("zarr/v2/3d.chunked.O") {
        assert_refused(opened(&path).map(|_| ()), &["|O"]);
    }
    if let Some(path) = data_file("zarr/ome_zarr_0.6_scale.zarr") {
        assert_eq!(opened(&path).unwrap().info().geometry.spacing, [2.0, 3.0, 4.0]);
    }
}

/// Writes an archive with these entries, all stored or all deflated.
fn write_archive(path: &Path, entries: &[(String, Vec<u8>)], method: zip::CompressionMethod) {
    use std::io::Write as _;
    let mut out = zip::ZipWriter::new(std::fs::File::create(path).unwrap());
    let options = zip::write::SimpleFileOptions::default().compression_method(method);
    for (name, bytes) in entries {
        out.start_file(name.as_str(), options).unwrap();
        out.write_all(bytes).unwrap();
    }
    out.finish().unwrap();
}

/// The files below a folder, named relative to it with a prefix.
fn entries_of(folder: &Path, before: &str) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let name = format!("{before}{}", entry.file_name().to_string_lossy());
        if entry.path().is_dir() {
            found.extend(entries_of(&entry.path(), &format!("{name}/")));
        } else {
            found.push((name, std::fs::read(entry.path()).unwrap()));
        }
    }
    found.sort();
    found
}

/// Every array of the archive reads the same in place and unpacked.
#[test]
fn archives_are_read_as_what_they_hold() {
    let folder = tempfile::tempdir().unwrap();
    let archive = folder.path().join("all.zip");
    write_archive(&archive, &entries_of(FILES.path(), ""), zip::CompressionMethod::Stored);
    let mut count = 0;
    for kind in ["v2", "v3", "n5"] {
        for entry in std::fs::read_dir(FILES.path().join(kind)).unwrap().flatten() {
            let array = format!("{kind}/{}", entry.file_name().to_string_lossy());
            let Ok(unpacked) = opened(&entry.path()) else { continue };
            let zipped = opened(&named(&archive, &array)).unwrap_or_else(|e| panic!("{array}: {e}"));
            let [mut a, mut b] = [zipped.info().clone(), unpacked.info().clone()];
            assert!(a.files.len() == 1 && a.folder.is_none() && b.folder.is_some(), "{array}");
            for info in [&mut a, &mut b] {
                info.files.clear();
                (info.folder, info.memory_bytes) = (None, 0);
            }
            assert_eq!(a, b, "{array}");
            check_boxes(zipped.as_ref(), &read_all(unpacked.as_ref()).unwrap(), 3);
            count += 1;
        }
    }
    assert!(count > 30, "{count} arrays");
    // Without a volume at the top level, the user must give a name.
    assert_refused(opened(&archive).map(|_| ()), &["all.zip", "neither `zarr.json`"]);
}

#[test]
fn archives_hold_a_folder_or_what_lies_in_it_stored_or_deflated() {
    let folder = tempfile::tempdir().unwrap();
    let expected = read_all(opened(&FILES.path().join("v3/sharded")).unwrap().as_ref()).unwrap();
    let plain = read_all(opened(&FILES.path().join("v2/gzip")).unwrap().as_ref()).unwrap();
    for (name, before) in [("a.zarr.zip", ""), ("a.ozx", "a.zarr/")] {
        let path = folder.path().join(name);
        let sharded = entries_of(&FILES.path().join("v3/sharded"), before);
        write_archive(&path, &sharded, zip::CompressionMethod::Stored);
        assert_eq!(read_all(opened(&path).unwrap().as_ref()).unwrap(), expected, "{name}");
        // Libraries do not write this, but people do.
        write_archive(&path, &sharded, zip::CompressionMethod::Deflated);
        assert_eq!(read_all(opened(&path).unwrap().as_ref()).unwrap(), expected, "{name}, deflated shards");
        write_archive(&path, &entries_of(&FILES.path().join("v2/gzip"), before), zip::CompressionMethod::Deflated);
        assert_eq!(read_all(opened(&path).unwrap().as_ref()).unwrap(), plain, "{name}, deflated");
    }
    // Archives with other contents are refused.
    let other = folder.path().join("other.zip");
    write_archive(&other, &[("a.txt".into(), b"a".to_vec())], zip::CompressionMethod::Stored);
    assert_refused(opened(&other).map(|_| ()), &["a ZIP archive", "unzip"]);
}

/// A truncated archive, or one with a wrong byte, is refused, or read with other voxels if there is no checksum. No
/// panic, little memory.
#[test]
fn damaged_archives() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.zarr.zip");
    let sharded = entries_of(&FILES.path().join("v3/sharded"), "");
    let [stored, deflated] = [zip::CompressionMethod::Stored, zip::CompressionMethod::Deflated].map(|method| {
        write_archive(&path, &sharded, method);
        std::fs::read(&path).unwrap()
    });
    let mut random = Random::new(11);
    let mut options = OpenOptions::default();
    options.segy.memory_bytes = 64 << 20;
    let mut refused = 0;
    for round in 0..400 {
        let mut bytes = if round % 4 < 2 { stored.clone() } else { deflated.clone() };
        let at = random.below(bytes.len() as u64) as usize;
        if round % 2 == 0 {
            bytes.truncate(at)
        } else {
            bytes[at] ^= 1 << (round / 2 % 8)
        }
        std::fs::write(&path, &bytes).unwrap();
        refused += usize::from(open(&path, &options).and_then(|source| read_all(source.as_ref()).map(drop)).is_err());
    }
    let largest = largest_allocation::largest_bytes();
    assert!(largest < 64 << 20, "{largest} bytes at once");
    assert!(refused > 200, "{refused} refused");
}

/// Half-precision floats as values, as fill values and as bits.
#[test]
fn half_floats() {
    let folder = tempfile::tempdir().unwrap();
    // 1, 2, 0.5, -65504 (the greatest magnitude), the least positive number, NaN.
    let halves: [u16; 6] = [0x3c00, 0x4000, 0x3800, 0xfbff, 0x0001, 0x7e00];
    let expected = [1.0f32, 2.0, 0.5, -65504.0, 5.960_464_5e-8, f32::NAN];
    for (big, dtype) in [(false, "<f2"), (true, ">f2")] {
        let array = folder.path().join(if big { "big" } else { "little" });
        std::fs::create_dir(&array).unwrap();
        let text = format!(
            r#"{{"zarr_format": 2, "shape": [2, 1, 6], "chunks": [1, 1, 6], "dtype": "{dtype}", "order": "C", "compressor": null,
                "filters": null, "fill_value": 1.5}}"#
        );
        std::fs::write(array.join(".zarray"), text).unwrap();
        let bytes: Vec<u8> = halves.iter().flat_map(|h| if big { h.to_be_bytes() } else { h.to_le_bytes() }).collect();
        std::fs::write(array.join("0.0.0"), bytes).unwrap();
        let source = opened(&array).unwrap();
        assert_eq!((source.info().voxel_type, source.info().dims), (VoxelType::F32, Dims([6, 1, 2])));
        assert!(
            source.info().notes.iter().any(|note| note.to_string().contains("half-precision")),
            "{:?}",
            source.info().notes
        );
        let found = read_all(source.as_ref()).unwrap();
        let found: Vec<f32> = found.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        for (a, b) in found.iter().zip(expected.iter().chain(&[1.5; 6])) {
            assert!(a == b || a.is_nan() && b.is_nan(), "{found:?}");
        }
    }
    let array = folder.path().join("v3");
    std::fs::create_dir(&array).unwrap();
    let text = r#"{"zarr_format": 3, "node_type": "array", "shape": [1, 1, 2], "data_type": "float16",
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [1, 1, 2]}},
        "chunk_key_encoding": {"name": "default"}, "fill_value": "0x3c00",
        "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}]}"#;
    std::fs::write(array.join("zarr.json"), text).unwrap();
    assert_eq!(read_all(opened(&array).unwrap().as_ref()).unwrap(), [1.0f32; 2].map(f32::to_le_bytes).as_flattened());
}

/// A `BigDataViewer` data set in N5.
#[test]
fn data_sets_of_big_data_viewer_in_n5() {
    let folder = tempfile::tempdir().unwrap();
    let level = folder.path().join("data.n5/setup0/timepoint0/s0");
    for (name, bytes) in entries_of(&FILES.path().join("n5/gzip"), "") {
        let path = level.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
    std::fs::write(folder.path().join("data.n5/attributes.json"), r#"{"n5": "2.5.1"}"#).unwrap();
    let factors = r#"{"downsamplingFactors": [[2, 2, 1]], "dataType": "uint16"}"#;
    std::fs::write(folder.path().join("data.n5/setup0/attributes.json"), factors).unwrap();
    let xml = folder.path().join("set.xml");
    let text = "<?xml version=\"1.0\"?><SpimData version=\"0.2\"><BasePath type=\"relative\">.</BasePath><SequenceDescription>\
        <ImageLoader format=\"bdv.n5\"><n5 type=\"relative\">data.n5</n5></ImageLoader><ViewSetups><ViewSetup><id>0</id>\
        <voxelSize><unit>mm</unit><size>1 2 3</size></voxelSize></ViewSetup></ViewSetups></SequenceDescription></SpimData>";
    std::fs::write(&xml, text).unwrap();
    let source = opened(&xml).unwrap_or_else(|e| panic!("{e}"));
    let geometry = source.info().geometry;
    assert_eq!((source.info().format, geometry.spacing, geometry.origin), ("bdv", [2.0, 4.0, 3.0], [0.5, 1.0, 0.0]));
    check_boxes(source.as_ref(), &read_all(opened(&level).unwrap().as_ref()).unwrap(), 3);
}
