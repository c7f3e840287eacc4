//! TIFF: real files compared with other programs' numbers, stacks in ImageJ's form, damaged files.

use std::path::Path;

use supervol_format::{Dims, VoxelType};
use supervol_sources::formats::tiff::TiffSource;
use supervol_sources::input::selection::Selection;
use supervol_sources::input::spool::SpoolFolder;
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{SourceError, VolumeSource};

use crate::grid_support;
use grid_support::*;

/// Number of voxels along x, y, z, type, and least, greatest and sum of the voxels, by tifffile.
const REAL_FILES: [(&str, [u64; 3], VoxelType, [f64; 3]); 12] = [
    // Colours: the luminance of tifffile's colours.
    ("tiff/odd/BigTIFF.tif", [64, 64, 1], VoxelType::U8, [0.0, 255.0, 241_583.0]),
    ("tiff/odd/BigTIFFMotorola.tif", [64, 64, 1], VoxelType::U8, [0.0, 255.0, 241_583.0]),
    ("tiff/beads_imagej_41x150x150_u8.tif", [150, 150, 41], VoxelType::U8, [1.0, 156.0, 1_443_760.0]),
    (
        "tiff/odd/gradient-1c-64b-float.tiff",
        [256, 1, 1],
        VoxelType::F64,
        [0.0008935276418924332, 0.9982651472091675, 128.0319210877642],
    ),
    ("tiff/odd/int16.tif", [64, 64, 1], VoxelType::I16, [-5000.0, 4998.0, 354_396.0]),
    ("tiff/odd/issue_69_lzw.tiff", [45, 45, 1], VoxelType::U16, [430.0, 598.0, 1_015_486.0]),
    ("tiff/odd/minisblack-1c-16b.tiff", [157, 151, 1], VoxelType::U16, [0.0, 58_955.0, 733_126_239.0]),
    // Single bits with white as zero: inverted.
    ("tiff/odd/miniswhite-1c-1b.tiff", [157, 151, 1], VoxelType::U8, [0.0, 1.0, 11_853.0]),
    ("tiff/odd/multi-channel.ome.tif", [439, 167, 1], VoxelType::I8, [-1.0, 96.0, 3_481_959.0]),
    ("tiff/odd/multipage_2x15x10.tif", [10, 15, 2], VoxelType::U8, [0.0, 255.0, 38_144.0]),
    ("tiff/odd/predictor-3-gray-f32.tif", [200, 200, 1], VoxelType::F32, [0.0, 0.9992643594741821, 20008.279317855835]),
    ("tiff/odd/seq-1c-16b-tiled-68f373a0.tiff", [16, 16, 1], VoxelType::U16, [0.0, 255.0, 32_640.0]),
];

fn source(path: &Path) -> Result<TiffSource, SourceError> {
    let folder = std::env::temp_dir();
    TiffSource::open(path, &SpoolFolder::at(folder), &Selection::default())
}

/// A classic little-endian TIFF with pages of u16 voxels, uncompressed, in strips of `rows` rows. Pages beyond
/// `directories` have no directory.
fn tiff(size: [u32; 2], pages: &[Vec<u8>], directories: usize, rows: u32, description: &str) -> Vec<u8> {
    tiff_with(size, pages, directories, (rows, 0), description, 1)
}

/// As [`tiff`], with `gap` bytes behind each strip, and a sample format: 1 for integers, 3 for floats.
fn tiff_with(
    size: [u32; 2],
    pages: &[Vec<u8>],
    directories: usize,
    (rows, gap): (u32, u32),
    description: &str,
    format: u32,
) -> Vec<u8> {
    let [width, height] = size;
    let mut file = b"II*\0\0\0\0\0".to_vec();
    let mut text = description.as_bytes().to_vec();
    text.push(0);
    let text_at = file.len() as u32;
    file.extend(&text);
    file.resize(file.len().next_multiple_of(2), 0);
    let data_at: Vec<u32> = pages
        .iter()
        .map(|page| {
            let at = file.len() as u32;
            for strip in page.chunks((rows * width * 2) as usize) {
                file.extend(strip);
                file.resize(file.len() + gap as usize, 0);
            }
            at
        })
        .collect();
    let strips = height.div_ceil(rows);
    let mut link = 4;
    for (number, &at) in data_at.iter().enumerate().take(directories) {
        let table = file.len() as u32;
        let strip_bytes = |i: u32| (height - i * rows).min(rows) * width * 2;
        (0..strips).for_each(|i| file.extend((at + i * (rows * width * 2 + gap)).to_le_bytes()));
        (0..strips).for_each(|i| file.extend(strip_bytes(i).to_le_bytes()));
        let directory = file.len() as u32;
        file[link..link + 4].copy_from_slice(&directory.to_le_bytes());
        let one = strips == 1;
        let mut fields: Vec<[u32; 4]> = vec![
            [256, 4, 1, width],
            [257, 4, 1, height],
            [258, 3, 1, 16],
            [259, 3, 1, 1],
            [262, 3, 1, 1],
            [273, 4, strips, if one { at } else { table }],
            [277, 3, 1, 1],
            [278, 4, 1, rows],
            [279, 4, strips, if one { strip_bytes(0) } else { table + 4 * strips }],
            [339, 3, 1, format],
        ];
        if number == 0 && !description.is_empty() {
            fields.insert(5, [270, 2, text.len() as u32, text_at]);
        }
        file.extend((fields.len() as u16).to_le_bytes());
        for [tag, kind, count, value] in fields {
            file.extend((tag as u16).to_le_bytes());
            file.extend((kind as u16).to_le_bytes());
            file.extend(count.to_le_bytes());
            file.extend(value.to_le_bytes());
        }
        link = file.len();
        file.extend([0; 4]);
    }
    file
}

fn written(folder: &Path, bytes: &[u8]) -> std::path::PathBuf {
    let path = folder.join("v.tif");
    std::fs::write(&path, bytes).unwrap();
    path
}

fn pages(voxels: &[u8], page_bytes: usize) -> Vec<Vec<u8>> {
    voxels.chunks(page_bytes).map(<[u8]>::to_vec).collect()
}

#[test]
fn pages_are_slices_in_strips_of_any_height() {
    let folder = tempfile::tempdir().unwrap();
    let voxels = random_voxels([9, 7, 5], VoxelType::U16, 3);
    for rows in [1, 2, 3, 7, 9] {
        let path = written(folder.path(), &tiff([9, 7], &pages(&voxels, 126), 5, rows, ""));
        let opened = source(&path).unwrap();
        assert_eq!((opened.info().format, opened.info().dims), ("tiff", Dims([9, 7, 5])));
        check_boxes(&opened, &voxels, 4);
        // With gaps, so that the pages are decoded.
        let path = written(folder.path(), &tiff_with([9, 7], &pages(&voxels, 126), 5, (rows, 2), "", 1));
        check_boxes(&source(&path).unwrap(), &voxels, 4);
    }
}

#[test]
fn stacks_of_image_j_with_one_page_and_with_all() {
    let folder = tempfile::tempdir().unwrap();
    let voxels = random_voxels([9, 7, 6], VoxelType::U16, 5);
    let plain = "ImageJ=1.53t\nimages=6\nslices=6\nunit=micron\nspacing=2.5\n";
    for directories in [1, 6] {
        let path = written(folder.path(), &tiff([9, 7], &pages(&voxels, 126), directories, 7, plain));
        let opened = source(&path).unwrap();
        check_boxes(&opened, &voxels, 6);
        assert_eq!((opened.info().geometry.spacing[2], opened.info().axes[2].unit.as_str()), (2.5, "um"));
    }
    // Three slices of two channels.
    let channels = "ImageJ=1.53t\nimages=6\nchannels=2\nslices=3\nhyperstack=true\n";
    let path = written(folder.path(), &tiff([9, 7], &pages(&voxels, 126), 6, 7, channels));
    let first: Vec<u8> = voxels.chunks(252).flat_map(|pair| &pair[..126]).copied().collect();
    check_boxes(&source(&path).unwrap(), &first, 7);
    let choose = |channel, frame| {
        let mut options = OpenOptions::default();
        (options.selection.channel, options.selection.frame) = (channel, frame);
        open(&path, &options)
    };
    let second: Vec<u8> = voxels.chunks(252).flat_map(|pair| &pair[126..]).copied().collect();
    check_boxes(choose(Some(1), None).unwrap().as_ref(), &second, 7);
    assert_refused(choose(Some(2), None), &["`channel` 2", "has 2"]);
    assert_refused(choose(None, Some(1)), &["`frame` 1", "has one"]);
    // Missing pages.
    let path = written(folder.path(), &tiff([9, 7], &pages(&voxels, 126), 4, 7, plain));
    assert_refused(source(&path), &["page 4", "4 pages"]);
    let path = written(folder.path(), &tiff([9, 7], &pages(&voxels[..252], 126), 1, 7, plain));
    assert_refused(source(&path), &["length of the file"]);
    // Channels behind the only page.
    let path = written(folder.path(), &tiff([9, 7], &pages(&voxels, 126), 1, 7, channels));
    check_boxes(&source(&path).unwrap(), &first, 7);
    let path = written(folder.path(), &tiff([9, 7], &pages(&voxels[..378], 126), 1, 7, channels));
    assert_refused(source(&path), &["5 pages", "one"]);
}

#[test]
fn damaged_files() {
    let folder = tempfile::tempdir().unwrap();
    let voxels = random_voxels([6, 4, 3], VoxelType::U16, 8);
    let description = "ImageJ=1.53t\nimages=3\nslices=3\n";
    let open = |path: &Path| -> Result<Box<dyn VolumeSource>, SourceError> { Ok(Box::new(source(path)?)) };
    for (directories, text) in [(3, ""), (3, description), (1, description)] {
        let file = tiff([6, 4], &pages(&voxels, 48), directories, 2, text);
        fuzz_header(folder.path(), "v.tif", &file, file.len(), 4000, open);
        let file = tiff_with([6, 4], &pages(&voxels, 48), directories, (2, 2), text, 1);
        if directories > 1 {
            fuzz_header(folder.path(), "v.tif", &file, file.len(), 4000, open);
        }
    }
    // A chunk may take 256 MiB, if the file says so.
    let largest = largest_allocation::largest_bytes();
    assert!(largest <= 300 << 20, "{largest} bytes at once");
}

#[test]
fn real_files_are_what_their_makers_say() {
    let options = OpenOptions::default();
    for (name, dims, voxel_type, [least, greatest, sum]) in REAL_FILES {
        let Some(path) = data_file(name) else { continue };
        let source = open(&path, &options).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((source.info().dims, source.info().voxel_type), (Dims(dims), voxel_type), "{name}");
        let found = summary(source.as_ref(), [0; 3]);
        assert_eq!((found.0, found.1), (least, greatest), "{name}");
        assert!((found.2 / sum - 1.0).abs() < 1e-12, "{name}: {} is not {sum}", found.2);
    }
    if let Some(path) = data_file("tiff/beads_imagej_41x150x150_u8.tif") {
        let source = open(&path, &options).unwrap();
        let info = source.info();
        assert_eq!((info.geometry.spacing[2], info.axes[0].unit.as_str()), (0.125, "um"));
        assert!((info.geometry.spacing[0] - 1e6 / 44_460_534.0).abs() < 1e-12);
        assert_eq!(value_at(source.as_ref(), [21, 33, 7]), 1.0);
    }
    if let Some(path) = data_file("tiff/odd/BigTIFF.tif") {
        let mut options = OpenOptions::default();
        options.selection.channel = Some(1);
        assert_eq!(summary(open(&path, &options).unwrap().as_ref(), [0; 3]).2, 190_578.0);
    }
    if let Some(path) = data_file("tiff/odd/ome-multifile/multifile-Z1.ome.tiff") {
        assert_refused(open(&path, &options).map(|_| ()), &["several files"]);
    }
}

/// Half-precision floats, read in place and decoded.
#[test]
fn half_floats() {
    let folder = tempfile::tempdir().unwrap();
    let halves: Vec<u16> = (0..48).map(|n| 0x3c00 + 21 * n).collect();
    let value = |bits: u16| (1.0 + f32::from(bits & 1023) / 1024.0) * 2f32.powi(i32::from(bits >> 10) - 15);
    let expected: Vec<u8> = halves.iter().flat_map(|bits| value(*bits).to_le_bytes()).collect();
    let bytes: Vec<u8> = halves.iter().flat_map(|bits| bits.to_le_bytes()).collect();
    for gap in [0, 2] {
        let path = written(folder.path(), &tiff_with([4, 6], &pages(&bytes, 48), 2, (2, gap), "", 3));
        let source = source(&path).unwrap_or_else(|e| panic!("gap {gap}: {e}"));
        assert_eq!((source.info().dims, source.info().voxel_type), (Dims([4, 6, 2]), VoxelType::F32));
        assert!(source.info().notes.iter().any(|note| note.to_string().contains("half-precision")));
        check_boxes(&source, &expected, 3);
    }
}
