//! Damaged NIfTI headers cause no panic and no large allocation.

use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;
use supervol_sources::formats::nifti::NiftiSource;
use supervol_sources::input::spool::SpoolFolder;

use crate::grid_support;
use grid_support::{fuzz_header, largest_allocation};

/// A 4 x 3 x 2 volume of i16 with an sform.
fn volume() -> Vec<u8> {
    let mut file = vec![0; 352 + 48];
    let mut put = |at: usize, bytes: &[u8]| file[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348_i32.to_le_bytes());
    [3, 4, 3, 2, 1, 1, 1, 1].into_iter().enumerate().for_each(|(i, n): (_, i16)| put(40 + 2 * i, &n.to_le_bytes()));
    put(70, &4_i16.to_le_bytes());
    put(72, &16_i16.to_le_bytes());
    (1..4).for_each(|axis| put(76 + 4 * axis, &2.0_f32.to_le_bytes()));
    put(108, &352.0_f32.to_le_bytes());
    put(252, &[1, 0, 1, 0]);
    (0..3).for_each(|i| put(280 + 20 * i, &2.0_f32.to_le_bytes()));
    put(344, b"n+1\0");
    file
}

#[test]
fn damaged_headers() {
    let folder = tempfile::tempdir().unwrap();
    let spool = SpoolFolder::at(folder.path());
    let open = |path: &std::path::Path| -> Result<Box<dyn supervol_sources::VolumeSource>, _> {
        Ok(Box::new(NiftiSource::open(path, &spool)?))
    };
    let file = volume();
    fuzz_header(folder.path(), "plain.nii", &file, 352, 5000, open);
    // Only the fields that determine sizes, so that most damage hits them.
    let mut compact = file.clone();
    compact[254] = 0;
    fuzz_header(folder.path(), "sizes.nii", &compact, 120, 5000, open);
    let mut encoder = GzEncoder::new(Vec::new(), Compression::none());
    encoder.write_all(&file).unwrap();
    let compressed = encoder.finish().unwrap();
    fuzz_header(folder.path(), "stream.nii.gz", &compressed, compressed.len(), 5000, open);
    // An ANALYZE 7.5 header beside its voxels.
    let mut header = file[..348].to_vec();
    header[108..112].fill(0);
    header[344..].fill(0);
    std::fs::write(folder.path().join("pair.img"), &file[352..]).unwrap();
    fuzz_header(folder.path(), "pair.hdr", &header, 120, 5000, open);
    assert!(largest_allocation::largest_bytes() < 4 << 20, "{} bytes at once", largest_allocation::largest_bytes());
}
