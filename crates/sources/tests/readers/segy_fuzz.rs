//! Damaged headers: the reader answers any bytes with a volume or a message. It never panics and never needs more
//! memory than the file justifies.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "test helpers fail by panicking, and say what they skip")]

use std::path::{Path, PathBuf};

use supervol_format::random::Random;
use supervol_sources::VolumeSource;
use supervol_sources::formats::segy::{SegyOptions, SegySource};

/// Number of damaged copies of each file.
const ROUNDS: u64 = 2000;

/// Larger files are skipped: each copy is read as a whole.
const MAX_FILE_BYTES: u64 = 20_000;

/// Damaged region in bytes: both file headers and two trace headers.
const HEADER_BYTES: u64 = 3600 + 480;

/// Largest number of voxel bytes per byte of the file: 64 cells per trace, 4 voxel bytes per sample byte.
const MAX_GROWTH: u64 = 64 * 4;

/// Small files of the data folder, in a fixed order.
fn files() -> Vec<PathBuf> {
    let stated = std::env::var_os("SUPERVOL_DATA").map(PathBuf::from);
    let mut candidates =
        stated.into_iter().chain(Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|a| a.join("shared/data")));
    let Some(data) = candidates.find(|c| c.join("segy").is_dir()) else { return Vec::new() };
    let folders = ["real", "odd", "f3-formats"].map(|f| std::fs::read_dir(data.join("segy").join(f)).unwrap());
    let mut files: Vec<PathBuf> = folders.into_iter().flatten().map(|entry| entry.unwrap().path()).collect();
    files.retain(|f| f.metadata().unwrap().len() < MAX_FILE_BYTES);
    files.sort();
    files
}

/// Opens the bytes and reads every voxel; returns whether they were accepted.
fn read_everything(bytes: Vec<u8>, options: &SegyOptions) -> bool {
    let file_bytes = bytes.len() as u64;
    let Ok(source) = SegySource::from_bytes(Box::new(bytes), Path::new("damaged.sgy"), options) else { return false };
    let info = source.info();
    let voxel_bytes = info.dims.bytes(info.voxel_type).expect("an accepted grid has a size");
    assert!(voxel_bytes <= file_bytes * MAX_GROWTH, "{} of {} from {file_bytes} bytes", info.dims, info.voxel_type);
    assert!(info.geometry.defect().is_none(), "{:?}", info.geometry);
    let mut out = vec![0; voxel_bytes as usize];
    // A sample that does not fit its voxel type is refused here, with a message.
    let _ = source.read_box(info.dims.full_box(), &mut out);
    true
}

/// Flips bits, overwrites header words with extremes, or cuts the file.
fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    match random.below(4) {
        0 => bytes.truncate(random.below(bytes.len() as u64 + 1) as usize),
        1 => {
            let at = random.below(HEADER_BYTES.min(bytes.len() as u64)) as usize;
            let extreme = [0x00, 0x7F, 0x80, 0xFF][random.below(4) as usize];
            bytes.iter_mut().skip(at).take(4).for_each(|b| *b = extreme);
        }
        _ => {
            for _ in 0..=random.below(8) {
                // Half of the damage hits the binary header, which matters most.
                let (start, length) = if random.below(2) == 0 { (3200, 400) } else { (0, HEADER_BYTES) };
                let at = (start + random.below(length)) as usize;
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= 1 << random.below(8);
                }
            }
        }
    }
}

#[test]
fn damaged_headers_never_panic() {
    let files = files();
    if files.is_empty() {
        eprintln!("SKIPPED: no folder shared/data with the SEG-Y test files; set SUPERVOL_DATA to name one");
    }
    for (number, file) in files.iter().enumerate() {
        let seed = 0x5E67_0000 + number as u64;
        let mut random = Random::new(seed);
        let original = std::fs::read(file).unwrap();
        let mut accepted = 0;
        for round in 0..ROUNDS {
            let mut bytes = original.clone();
            damage(&mut bytes, &mut random);
            let format = if random.below(4) == 0 { Some(1 + random.below(16) as u16) } else { None };
            let options = SegyOptions { format, ..SegyOptions::default() };
            let outcome = std::panic::catch_unwind(|| read_everything(bytes, &options));
            match outcome {
                Ok(volume) => accepted += u64::from(volume),
                Err(_) => panic!("{} panics in round {round} of seed {seed:#x}, format {format:?}", file.display()),
            }
        }
        eprintln!("{}: {accepted} of {ROUNDS} damaged copies accepted", file.display());
    }
}

#[test]
fn noise_is_refused_without_a_panic() {
    let mut random = Random::new(1);
    for _ in 0..2000 {
        let length = random.below(12_000) as usize;
        let bytes: Vec<u8> = (0..length).map(|_| random.next_u64() as u8).collect();
        read_everything(bytes, &SegyOptions::default());
    }
}
