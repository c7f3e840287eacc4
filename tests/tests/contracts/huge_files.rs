//! Offsets beyond 4 GiB, in a sparse file that takes no room on disk.

use std::io::{Seek, SeekFrom, Write};

use supervol_format::random::Random;
use supervol_format::{Dims, Geometry, VoxelBox, VoxelType};
use supervol_sources::formats::raw::{RawOptions, RawSource};
use supervol_sources::{Endian, VolumeSource};

/// 2000 x 1500 x 1000 voxels of u16 are 6 GB.
const DIMS: [u64; 3] = [2000, 1500, 1000];
const HEADER_BYTES: u64 = 512;

#[test]
fn voxels_beyond_4_gib_are_read_where_they_are() {
    let mut file = tempfile::NamedTempFile::new().expect("a temporary file");
    let bytes = DIMS.iter().product::<u64>() * 2;
    assert!(bytes > 5 << 30);
    file.as_file().set_len(HEADER_BYTES + bytes).expect("a sparse file of 6 GB");

    // Single voxels, including the last one and those around the offset of 2^32 bytes.
    let mut random = Random::new(4);
    let mut numbers: Vec<u64> = (0..200).map(|_| random.below(bytes / 2)).collect();
    numbers.extend([bytes / 2 - 1, 0, (1 << 31) - 257, (1 << 31) - 256, (1 << 31) - 255, 1 << 31]);
    let value = |number: u64| (number % 65_521) as u16 + 1;
    for &number in &numbers {
        file.seek(SeekFrom::Start(HEADER_BYTES + 2 * number)).expect("a sparse file can be sought in");
        file.write_all(&value(number).to_be_bytes()).expect("room for one page");
    }

    let options = RawOptions {
        dims: Dims(DIMS),
        voxel_type: VoxelType::U16,
        endian: Endian::Big,
        header_bytes: HEADER_BYTES,
        geometry: Geometry::IDENTITY,
        nodata: None,
    };
    let source = RawSource::open(file.path(), &options).expect("the length is right");
    for &number in &numbers {
        let voxel = [number % DIMS[0], number / DIMS[0] % DIMS[1], number / DIMS[0] / DIMS[1]];
        let voxels = VoxelBox { start: voxel, end: voxel.map(|v| v + 1) }.grown(2, Dims(DIMS));
        let mut out = vec![0; voxels.voxels() * 2];
        source.read_box(voxels, &mut out).unwrap_or_else(|e| panic!("{e}"));
        let [nx, ny, _] = voxels.extent();
        for (i, found) in out.as_chunks::<2>().0.iter().enumerate() {
            let at = [i % nx, i / nx % ny, i / nx / ny];
            let [x, y, z]: [u64; 3] = std::array::from_fn(|a| voxels.start[a] + at[a] as u64);
            let here = x + DIMS[0] * (y + DIMS[1] * z);
            let expected = if numbers.contains(&here) { value(here) } else { 0 };
            assert_eq!(u16::from_le_bytes(*found), expected, "voxel {here}");
        }
    }
}
