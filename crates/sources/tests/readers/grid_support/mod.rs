//! Shared parts of the reader tests: paths of real files, seeded numbers, and a naive copy for comparing boxes.

#![allow(dead_code, reason = "each test binary uses a part")]
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "these are tests: they fail loudly and skip loudly")]

pub mod largest_allocation;

use std::io::Write;
use std::path::{Path, PathBuf};

use supervol_format::random::Random;
use supervol_format::voxel_type::{Voxel, voxels_as_f64};
use supervol_format::{VoxelBox, VoxelType, with_voxel};
use supervol_sources::{Endian, SourceError, VolumeSource};

/// A file of the developers' data folder: `$SUPERVOL_DATA`, or `shared/data` beside the workspace. Prints a line if it
/// is missing.
pub fn data_file(name: &str) -> Option<PathBuf> {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    let beside = ["../../../shared/data", "../../../../shared/data"].map(|p| manifest.join(p));
    let folders = std::env::var_os("SUPERVOL_DATA").map(PathBuf::from).into_iter().chain(beside);
    let found = folders.map(|folder| folder.join(name)).find(|path| path.exists());
    if found.is_none() {
        eprintln!("SKIPPED: {name} is not in the data folder (set SUPERVOL_DATA)");
    }
    found
}

pub fn sub_box(random: &mut Random, dims: [u64; 3]) -> VoxelBox {
    let mut sides = dims.map(|n| {
        let (a, b) = (random.below(n), random.below(n));
        (a.min(b), a.max(b) + 1)
    });
    // Every other box has whole rows, a special case of the readers.
    if random.below(2) == 0 {
        sides[0] = (0, dims[0]);
        if random.below(2) == 0 {
            sides[1] = (0, dims[1]);
        }
    }
    VoxelBox { start: sides.map(|s| s.0), end: sides.map(|s| s.1) }
}

/// All voxels, little endian.
pub fn read_all(source: &dyn VolumeSource) -> Result<Vec<u8>, SourceError> {
    read(source, source.info().dims.full_box())
}

pub fn read(source: &dyn VolumeSource, voxels: VoxelBox) -> Result<Vec<u8>, SourceError> {
    let mut out = vec![0xa5; voxels.voxels() * source.info().voxel_type.bytes()];
    source.read_box(voxels, &mut out)?;
    Ok(out)
}

/// The voxels of a box, copied one by one from a whole little-endian volume.
pub fn naive_box(all: &[u8], dims: [u64; 3], voxel_bytes: usize, voxels: VoxelBox) -> Vec<u8> {
    let mut out = Vec::new();
    for z in voxels.start[2]..voxels.end[2] {
        for y in voxels.start[1]..voxels.end[1] {
            for x in voxels.start[0]..voxels.end[0] {
                let at = (x + dims[0] * (y + dims[1] * z)) as usize * voxel_bytes;
                out.extend_from_slice(&all[at..at + voxel_bytes]);
            }
        }
    }
    out
}

/// Compares the full read and many boxes with the expected voxels (little endian, x fastest).
pub fn check_boxes(source: &dyn VolumeSource, expected: &[u8], seed: u64) {
    let dims = source.info().dims.0;
    let bytes = source.info().voxel_type.bytes();
    assert!(read_all(source).unwrap() == expected, "full read, {:?}", source.info());
    let mut random = Random::new(seed);
    for _ in 0..40 {
        let voxels = sub_box(&mut random, dims);
        assert!(read(source, voxels).unwrap() == naive_box(expected, dims, bytes, voxels), "{voxels:?}, seed {seed}");
    }
}

/// Little-endian voxels in the given byte order.
pub fn in_order(little: &[u8], voxel_bytes: usize, endian: Endian) -> Vec<u8> {
    match endian {
        Endian::Little => little.to_vec(),
        Endian::Big => little.chunks_exact(voxel_bytes).flat_map(|v| v.iter().rev().copied()).collect(),
    }
}

/// Least, greatest and sum of all voxels, and the voxel at `at`.
pub fn summary(source: &dyn VolumeSource, at: [u64; 3]) -> (f64, f64, f64, f64) {
    let info = source.info();
    let values = voxels_as_f64(info.voxel_type, &read_all(source).unwrap());
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let greatest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (least, greatest, values.iter().sum(), value_at(source, at))
}

pub fn value_at(source: &dyn VolumeSource, at: [u64; 3]) -> f64 {
    let bytes = read(source, VoxelBox { start: at, end: at.map(|i| i + 1) }).unwrap();
    with_voxel!(source.info().voxel_type, V => V::read_le(&bytes).to_f64())
}

/// Asserts that the error blames the data (not the machine), and that its message contains all the words.
pub fn assert_refused<T>(result: Result<T, SourceError>, words: &[&str]) {
    let error = result.err().expect("must be refused");
    let is_of_data =
        matches!(error, SourceError::Invalid { .. } | SourceError::RawLength { .. } | SourceError::Unsupported { .. });
    assert!(is_of_data || error.is_wrong_option(), "{error}");
    let message = error.to_string();
    for word in words {
        assert!(message.contains(word), "`{word}` is not in: {message}");
    }
}

/// Opens seeded damaged copies of a file. Each must be refused, or be readable to its last voxel, or fail with an
/// error.
///
/// Bit flips, overwritten bytes and truncation damage the first `header_bytes`. `open` gets the damaged file.
pub fn fuzz_header(
    folder: &Path,
    name: &str,
    whole: &[u8],
    header_bytes: usize,
    cases: u64,
    open: impl Fn(&Path) -> Result<Box<dyn VolumeSource>, SourceError>,
) {
    let path = folder.join(name);
    let mut accepted = 0;
    for case in 0..cases {
        let mut random = Random::new(case.wrapping_mul(0x1234_5678_9abc_def1) + 7);
        let mut damaged = whole.to_vec();
        match random.below(8) {
            0 => damaged.truncate(random.below(whole.len() as u64) as usize),
            1 => {
                let at = random.below(header_bytes as u64) as usize;
                damaged.remove(at);
            }
            2 => {
                let digits = b"0123456789()-. \n:9999";
                let at = random.below(header_bytes as u64) as usize;
                damaged[at] = digits[random.below(digits.len() as u64) as usize];
            }
            _ => {
                for _ in 0..=random.below(4) {
                    damaged[random.below(header_bytes as u64) as usize] ^= 1 << random.below(8);
                }
            }
        }
        overwrite(&path, &damaged);
        if let Ok(source) = open(&path) {
            accepted += 1;
            let dims = source.info().dims;
            assert!(dims.is_valid() && source.info().geometry.defect().is_none(), "case {case}: {:?}", source.info());
            // A reader that accepts the file must not announce many more bytes than the file can hold.
            let bytes = dims.bytes(source.info().voxel_type).unwrap();
            assert!(bytes <= 1100 * (whole.len() as u64 + 1), "case {case}: {dims} of a file of {} bytes", whole.len());
            for z in 0..dims.0[2] {
                let [nx, ny, _] = dims.0;
                let _ = read(source.as_ref(), VoxelBox { start: [0, 0, z], end: [nx, ny, z + 1] });
            }
        }
    }
    assert!(accepted > 0, "no damaged copy of {name} was accepted: the damage is too crude to test anything");
    eprintln!("{name}: {accepted} of {cases} damaged copies accepted");
}

/// Overwrites a file without truncating it first, because some file systems then wait for the disk.
fn overwrite(path: &Path, bytes: &[u8]) {
    let mut file = std::fs::OpenOptions::new().write(true).create(true).truncate(false).open(path).unwrap();
    file.write_all(bytes).unwrap();
    file.set_len(bytes.len() as u64).unwrap();
}

pub const BOTH_ORDERS: [Endian; 2] = [Endian::Little, Endian::Big];

/// Random bytes as voxels; they are present for every type, except NaNs of float types.
pub fn random_voxels(dims: [u64; 3], voxel_type: VoxelType, seed: u64) -> Vec<u8> {
    let count = dims.iter().product::<u64>() as usize;
    let mut random = Random::new(seed);
    (0..count * voxel_type.bytes()).map(|_| random.next_u64() as u8).collect()
}
