//! JPEG and zstd TIFFs: files by other programs (see `tests/data/tiff` for their contents), and damaged files.

use std::path::{Path, PathBuf};

use supervol_format::{Dims, VoxelType};
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{SourceError, VolumeSource};

use crate::grid_support;
use grid_support::*;

const SIZE: [u64; 3] = [40, 36, 3];

fn stored(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/tiff").join(name)
}

fn chosen(path: &Path, channel: Option<u64>) -> Result<Box<dyn VolumeSource>, SourceError> {
    let mut options = OpenOptions::default();
    options.selection.channel = channel;
    open(path, &options)
}

fn opened(name: &str, channel: Option<u64>) -> Box<dyn VolumeSource> {
    chosen(&stored(name), channel).unwrap_or_else(|e| panic!("{name}: {e}"))
}

fn places(slices: u64) -> impl Iterator<Item = [u64; 3]> {
    (0..slices).flat_map(|z| (0..SIZE[1]).flat_map(move |y| (0..SIZE[0]).map(move |x| [x, y, z])))
}

/// Voxels of the zstd files, before scaling.
fn exact([x, y, z]: [u64; 3]) -> u64 {
    (3 * x + 5 * y + 7 * z + x * y * z) % 251
}

fn colour([x, y, _]: [u64; 3], channel: u64) -> u64 {
    [40 + 2 * x, 50 + 3 * y, 200 - x - y][channel as usize]
}

#[test]
fn grey_by_jpeg() {
    for name in ["jpeg-grey-strips.tif", "jpeg-grey-tiles.tif", "jpeg-tables-grey.tif"] {
        let source = opened(name, None);
        assert_eq!((source.info().dims, source.info().voxel_type), (Dims(SIZE), VoxelType::U8), "{name}");
        for place @ [x, y, z] in places(3) {
            let expected = (2 * x + 3 * y + 10 * z) as f64;
            let found = value_at(source.as_ref(), place);
            assert!((found - expected).abs() <= 4.0, "{name} at {place:?}: {found} is not {expected}");
        }
    }
}

#[test]
fn colours_by_jpeg_are_red_green_and_blue() {
    for name in ["jpeg-ycbcr-tiles.tif", "jpeg-ycbcr-strips.tif", "jpeg-tables-rgb.tif"] {
        for channel in 0..3 {
            let source = opened(name, Some(channel));
            // Padding beside the page in the last chunks affects the pixels near it.
            for place in places(1).filter(|place| place[0] < 32 && place[1] < 32) {
                let (found, expected) = (value_at(source.as_ref(), place), colour(place, channel) as f64);
                assert!((found - expected).abs() <= 6.0, "{name}, {channel} at {place:?}: {found} is not {expected}");
            }
        }
        let source = opened(name, None);
        assert!(source.info().notes.iter().any(|note| note.to_string().contains("luminance")), "{name}");
    }
}

#[test]
fn numbers_by_zstd_are_what_they_were() {
    let bytes = |number: &dyn Fn(u64) -> Vec<u8>| places(3).flat_map(|place| number(exact(place))).collect::<Vec<u8>>();
    let whole = bytes(&|v| (199 * v as u16).to_le_bytes().to_vec());
    let cases = [
        ("zstd-u8-strips.tif", VoxelType::U8, bytes(&|v| vec![v as u8])),
        ("zstd-white-is-zero.tif", VoxelType::U8, bytes(&|v| vec![!(v as u8)])),
        ("zstd-u16-tiles-predictor.tif", VoxelType::U16, whole.clone()),
        ("zstd-u16-big-endian.tif", VoxelType::U16, whole.clone()),
        ("zstd-u16-big-endian-predictor.tif", VoxelType::U16, whole),
        ("zstd-f32-tiles-predictor.tif", VoxelType::F32, bytes(&|v| (v as f32 / 7.0).to_le_bytes().to_vec())),
    ];
    for (name, voxel_type, voxels) in cases {
        let source = opened(name, None);
        assert_eq!((source.info().dims, source.info().voxel_type), (Dims(SIZE), voxel_type), "{name}");
        check_boxes(source.as_ref(), &voxels, 3);
    }
    for name in ["zstd-rgb-predictor.tif", "zstd-planes.tif"] {
        for channel in 0..3 {
            let voxels: Vec<u8> = places(1).map(|place| colour(place, channel) as u8).collect();
            check_boxes(opened(name, Some(channel)).as_ref(), &voxels, 3);
        }
    }
}

/// Offset of the value of a field of the first page in a little-endian file.
fn field(file: &[u8], tag: u16) -> usize {
    let word = |at: usize| u32::from_le_bytes(*file[at..].first_chunk().unwrap()) as usize;
    let directory = word(4);
    let count = usize::from(u16::from_le_bytes(*file[directory..].first_chunk().unwrap()));
    let entry = (0..count).map(|i| directory + 2 + 12 * i).find(|at| file[*at..].starts_with(&tag.to_le_bytes()));
    entry.expect("the page has this field") + 8
}

#[test]
fn other_compressions_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.tif");
    let file = std::fs::read(stored("zstd-u8-strips.tif")).unwrap();
    for (code, name) in
        [(6u16, "JPEG of the old style"), (34925, "LZMA"), (50001, "WebP"), (34712, "JPEG 2000"), (4, "fax")]
    {
        let mut file = file.clone();
        let at = field(&file, 259);
        file[at..at + 2].copy_from_slice(&code.to_le_bytes());
        std::fs::write(&path, file).unwrap();
        assert_refused(chosen(&path, None).map(|_| ()), &[name, &code.to_string(), "rewrite it first"]);
    }
}

/// A chunk that would decode to more than its pixels need is refused, without a large allocation.
#[test]
fn chunks_are_decoded_no_further_than_they_should_be() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.tif");
    for (name, tag) in
        [("zstd-u8-strips.tif", 278), ("jpeg-grey-strips.tif", 278), ("zstd-f32-tiles-predictor.tif", 323)]
    {
        let mut file = std::fs::read(stored(name)).unwrap();
        // Strips of fewer rows would be more strips, so the page's height is reduced instead.
        let [rows, height] = [field(&file, tag), field(&file, 257)];
        file[rows] = 8;
        if tag == 278 {
            file[height] = 24;
        }
        std::fs::write(&path, &file).unwrap();
        let message = chosen(&path, None).map(|_| ()).unwrap_err().to_string();
        assert!(tag == 323 || message.contains("compressed chunk 0"), "{name}: {message}");
    }
    // A JPEG image of 65,500 x 65,500 pixels where a page of 40 x 36 is expected.
    let mut file = std::fs::read(stored("jpeg-tables-grey.tif")).unwrap();
    let frame = file.windows(4).position(|bytes| bytes == [0xff, 0xc0, 0, 11]).unwrap();
    file[frame + 5..frame + 9].copy_from_slice(&[255, 220, 255, 220]);
    std::fs::write(&path, &file).unwrap();
    assert_refused(chosen(&path, None).map(|_| ()), &["compressed chunk", "40 x 36", "65500 x 65500"]);
}

#[test]
fn damaged_files() {
    let folder = tempfile::tempdir().unwrap();
    let names = [
        "jpeg-tables-grey.tif",
        "jpeg-ycbcr-tiles.tif",
        "jpeg-ycbcr-strips.tif",
        "zstd-u16-tiles-predictor.tif",
        "zstd-f32-tiles-predictor.tif",
        "zstd-planes.tif",
    ];
    for name in names {
        let file = std::fs::read(stored(name)).unwrap();
        fuzz_header(folder.path(), "v.tif", &file, file.len(), 1500, |path| chosen(path, None));
    }
    // The crate `tiff` allocates for a field what its count says, up to 256 MiB.
    let largest = largest_allocation::largest_bytes();
    assert!(largest <= 256 << 20, "{largest} bytes at once");
}
