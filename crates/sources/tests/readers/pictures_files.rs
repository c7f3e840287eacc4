//! Folders of pictures: real ones compared with Pillow and tifffile, small ones written by these tests.

use std::path::Path;

use supervol_format::{Dims, VoxelType};
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{SourceError, VolumeSource};

use crate::grid_support;
use grid_support::*;

fn opened(path: &Path) -> Result<Box<dyn VolumeSource>, SourceError> {
    open(path, &OpenOptions::default())
}

fn png(size: [u32; 2], color: png::ColorType, depth: png::BitDepth, bytes: &[u8]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, size[0], size[1]);
    encoder.set_color(color);
    encoder.set_depth(depth);
    if color == png::ColorType::Indexed {
        encoder.set_palette(vec![0; 48]);
    }
    encoder.write_header().unwrap().write_image_data(bytes).unwrap();
    file
}

#[test]
fn real_folders_are_what_pillow_and_tifffile_read() {
    if let Some(path) = data_file("png-slices/fibsem-medulla-250") {
        let source = opened(&path).unwrap();
        assert_eq!((source.info().dims, source.info().voxel_type), (Dims([250; 3]), VoxelType::U8));
        assert_eq!(summary(source.as_ref(), [25, 50, 100]), (27.0, 221.0, 2_061_679_510.0, 118.0));
        assert_eq!(value_at(source.as_ref(), [200, 3, 249]), 183.0);
    }
    if let Some(path) = data_file("tiff/odd/ome-multifile") {
        let source = opened(&path).unwrap();
        assert_eq!(source.info().dims, Dims([18, 24, 5]));
        assert_eq!(summary(source.as_ref(), [0; 3]).2, 314_466.0);
    }
    if let Some(path) = data_file("tiff/odd/multipage_2x15x10.tif") {
        let folder = tempfile::tempdir().unwrap();
        std::fs::copy(path, folder.path().join("a.tif")).unwrap();
        assert_refused(opened(folder.path()), &["a.tif", "2 pages", "give it alone"]);
    }
}

#[test]
fn jpeg_is_what_pillow_reads() {
    let source = opened(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/grey.jpg")).unwrap();
    assert_eq!((source.info().dims, source.info().voxel_type), (Dims([32, 24, 1]), VoxelType::U8));
    let (least, greatest, sum, value) = summary(source.as_ref(), [20, 10, 0]);
    // Decoders may round differently, by one.
    assert!((value - 191.0).abs() <= 1.0 && (sum - 124_755.0).abs() < 200.0, "{value}, {sum}");
    assert_eq!((least, greatest), (0.0, 255.0));
}

#[test]
fn slices_come_in_natural_order() {
    let folder = tempfile::tempdir().unwrap();
    let voxels = random_voxels([9, 7, 12], VoxelType::U16, 6);
    for (i, slice) in voxels.chunks(126).enumerate() {
        let big: Vec<u8> = in_order(slice, 2, supervol_sources::Endian::Big);
        let file = png([9, 7], png::ColorType::Grayscale, png::BitDepth::Sixteen, &big);
        std::fs::write(folder.path().join(format!("slice-{i}.png")), file).unwrap();
    }
    std::fs::write(folder.path().join("Thumbs.db"), "x").unwrap();
    let source = opened(folder.path()).unwrap();
    assert_eq!(source.info().format, "pictures");
    check_boxes(source.as_ref(), &voxels, 8);
    assert!(
        source.info().notes.iter().any(|note| note.to_string().contains("no pictures")),
        "{:?}",
        source.info().notes
    );
    // A picture of another size, and one of another format.
    let odd = folder.path().join("slice-5b.png");
    std::fs::write(&odd, png([7, 9], png::ColorType::Grayscale, png::BitDepth::Sixteen, &voxels[..126])).unwrap();
    assert_refused(opened(folder.path()), &["slice-5b.png", "9 x 7 pixels of 1 u16", "7 x 9"]);
    std::fs::write(&odd, b"\xff\xd8\xff\xe0").unwrap();
    assert_refused(opened(folder.path()), &["one format", "12 PNG and 1 JPEG"]);
}

#[test]
fn palettes_bits_and_colours() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let write = |color, depth, bytes: &[u8]| {
        std::fs::write(&path, png([3, 2], color, depth, bytes)).unwrap();
        read_all(opened(&path).unwrap().as_ref()).unwrap()
    };
    // Rows of three pixels of four bits, and of one bit.
    assert_eq!(write(png::ColorType::Indexed, png::BitDepth::Four, &[0x12, 0x30, 0x45, 0x60]), [1, 2, 3, 4, 5, 6]);
    assert_eq!(write(png::ColorType::Grayscale, png::BitDepth::One, &[0b1010_0000, 0b0110_0000]), [1, 0, 1, 0, 1, 1]);
    let colours: Vec<u8> = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [9, 9, 9], [0, 0, 0], [255, 255, 255]].concat();
    assert_eq!(write(png::ColorType::Rgb, png::BitDepth::Eight, &colours), [76, 150, 29, 9, 0, 255]);
    let mut options = OpenOptions::default();
    options.selection.channel = Some(1);
    assert_eq!(read_all(open(&path, &options).unwrap().as_ref()).unwrap(), [0, 255, 0, 9, 0, 255]);
    options.selection.channel = None;
    options.selection.frame = Some(1);
    assert_refused(open(&path, &options), &["`frame` 1"]);
}
