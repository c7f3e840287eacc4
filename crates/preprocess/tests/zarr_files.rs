//! Zarr, OME-Zarr and N5: one volume in every way in which zarr-python, numcodecs and tensorstore write it
//! (`tests/data/README.md` says how), real files, and damaged ones.

#![allow(clippy::unwrap_used, reason = "tests fail loudly")]

mod grid_support;

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use grid_support::*;
use supervol_format::random::Random;
use supervol_format::voxel_type::Voxel;
use supervol_format::{Dims, VoxelType, with_voxel};
use supervol_preprocess::source::open::{OpenOptions, open};
use supervol_preprocess::source::{SourceError, VolumeSource};

#[global_allocator]
static RECORDING: largest_allocation::Recording = largest_allocation::Recording;

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

/// The voxels of a volume of this type, by their places.
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
        assert!(info.notes.iter().any(|n| n.contains("2 channels")), "{:?}", info.notes);
        assert!(info.notes.iter().any(|n| n.contains("2 levels")), "{:?}", info.notes);
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
        assert_refused(open(&path, &options).map(|_| ()), &["--source-level 2", "the last is number 1"]);
        // An array of the image, by its name.
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
    assert_refused(open(&path, &options).map(|_| ()), &["--frame 2", "the last is number 1"]);
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
    assert_refused(opened(&named(&inside, "../out")).map(|_| ()), &["outside the folder", "--allow-outside"]);
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
    options.outside = supervol_preprocess::source::nrrd::Outside::Allowed;
    let allowed = open(&inside, &options).unwrap();
    check_boxes(allowed.as_ref(), &voxels(VoxelType::U16, DIMS, value), 1);
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

/// Metadata of an array of 8 x 8 x 8 bytes in one chunk, and what stands in it instead.
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
        ("chunks", serde_json::json!([1024, 1024, 4096]), &["--memory", "65536 MiB"]),
        ("shape", serde_json::json!([1u64 << 62, 1u64 << 62, 1u64 << 62]), &["dims"]),
        ("dtype", serde_json::json!("<f2"), &["<f2"]),
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
        selection: supervol_preprocess::source::selection::Selection { series: Some("1".into()), ..Default::default() },
        ..OpenOptions::default()
    };
    assert_refused(open(array_with(|_| ()).path(), &series).map(|_| ()), &["only DICOM has series"]);
    assert!(largest_allocation::largest_bytes() < 64 << 20);
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
        // What is more than 65536 bytes longer than the voxels is not even read.
        std::fs::write(folder.path().join("0.0.0"), &bomb).unwrap();
        let source = opened(folder.path()).unwrap();
        let mut out = vec![0; 512];
        let error = source.read_box(source.info().dims.full_box(), &mut out);
        assert_refused(error, &["0.0.0", "chunk"]);
    }
}

/// Every cut and many flipped bits of every file of an array: an error or voxels, never a panic, and little memory.
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

/// Name, dims, type, least, greatest and sum by zarr-python (by hand where it refuses the array).
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
