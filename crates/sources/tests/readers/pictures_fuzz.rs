//! Damaged pictures cause no panic and no large allocation; pictures that exceed the memory limit are refused.

use std::path::Path;

use supervol_format::VoxelType;
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{SourceError, VolumeSource};

use crate::grid_support;
use grid_support::*;

fn opened(path: &Path) -> Result<Box<dyn VolumeSource>, SourceError> {
    open(path, &OpenOptions::default())
}

fn png(size: [u32; 2], bytes: &[u8]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, size[0], size[1]);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.write_header().unwrap().write_image_data(bytes).unwrap();
    file
}

#[test]
fn damaged_files_and_pictures_that_are_too_large() {
    let folder = tempfile::tempdir().unwrap();
    let voxels = random_voxels([9, 7, 1], VoxelType::U8, 6);
    let file = png([9, 7], &voxels);
    fuzz_header(folder.path(), "v.png", &file, file.len(), 3000, opened);
    let jpeg = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/grey.jpg");
    let file = std::fs::read(jpeg).unwrap();
    fuzz_header(folder.path(), "v.jpg", &file, file.len(), 3000, opened);
    let largest = largest_allocation::largest_bytes();
    assert!(largest < 64 << 20, "{largest} bytes at once");
    let mut options = OpenOptions::default();
    options.segy.memory_bytes = 100;
    std::fs::write(folder.path().join("v.png"), png([9, 7], &voxels)).unwrap();
    assert_refused(open(&folder.path().join("v.png"), &options), &["9 x 7", "`memory_bytes` allows 0.001 MiB"]);
}
