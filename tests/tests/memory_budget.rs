//! Memory budgets: builds, checks and extractions stay within them for every shape of volume. Allocations are counted,
//! so this test is alone in its program.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "tests use small numbers"
)]

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;

use supervol_export::extract::{Extraction, extract};
use supervol_format::random::Random;
use supervol_format::{Lod, VoxelType};
use supervol_preprocess::verify::verify;
use supervol_preprocess::{BuildOptions, Existing};
use supervol_sources::VolumeSource;
use supervol_sources::formats::segy::{SegyOptions, SegySource};
use supervol_sources::synthetic::Synthetic;
use supervol_tests::counting::{Counting, peak_of};
use supervol_tests::fields::{Built, options, try_build};

#[global_allocator]
static COUNTING: Counting = Counting;

/// Memory outside the budget: threads and file buffers.
const SLACK: usize = 2 << 20;

/// A volume with its build options and memory budget.
struct Case {
    dims: [u64; 3],
    voxel_type: VoxelType,
    core: u32,
    mebibytes: u64,
    threads: usize,
}

const fn case(dims: [u64; 3], voxel_type: VoxelType, core: u32, mebibytes: u64, threads: usize) -> Case {
    Case { dims, voxel_type, core, mebibytes, threads }
}

/// Cubes, then lines and planes, whose bricks are mostly apron.
const CASES: [Case; 12] = [
    case([256; 3], VoxelType::U16, 64, 24, 2),
    case([256; 3], VoxelType::U16, 64, 24, 8),
    case([256; 3], VoxelType::U16, 32, 16, 8),
    case([256; 3], VoxelType::U16, 64, 64, 8),
    case([200; 3], VoxelType::U16, 128, 192, 8),
    case([400_000, 1, 1], VoxelType::F32, 64, 12, 2),
    case([1, 400_000, 1], VoxelType::U8, 64, 12, 2),
    case([1, 1, 100_000], VoxelType::F64, 16, 12, 2),
    case([1500, 1500, 1], VoxelType::F32, 64, 12, 2),
    case([1, 1500, 1500], VoxelType::U16, 64, 12, 2),
    case([1500, 1, 1500], VoxelType::U8, 32, 12, 2),
    case([500, 500, 9], VoxelType::F64, 64, 32, 2),
];

// One test, because all allocations of the program are counted.
#[test]
fn builds_extractions_and_sources_stay_within_their_budget() {
    check_scattered_traces();
    // Containers that were read already, by their bytes.
    let mut checked = HashMap::new();
    for case in CASES {
        let Case { dims, voxel_type, core, mebibytes, threads } = case;
        let source = Synthetic::new("seismic", supervol_format::Dims(dims), Some(voxel_type), 1).expect("a known name");
        let options = BuildOptions { memory_bytes: mebibytes << 20, threads, ..options(core) };
        let (peak, built) = peak_of(|| try_build(&source, &options).unwrap_or_else(|e| panic!("{dims:?}: {e}")));
        let planned = built.report.memory_planned_bytes;
        let mebi = |bytes: usize| bytes as f64 / 1048576.0;
        println!(
            "MEASURED: {dims:?} {voxel_type}, bricks of {core}, {threads} threads asked for, {} used: budget {mebibytes} MiB, \
             planned {:.1} MiB, peak {:.1} MiB",
            built.report.threads,
            mebi(planned as usize),
            mebi(peak)
        );
        assert!(planned <= mebibytes << 20, "{dims:?}: the plan exceeds the budget");
        let allowed = (mebibytes << 20) as usize + SLACK;
        assert!(peak <= allowed, "{dims:?}: {peak} bytes at the peak, {allowed} allowed");

        let what = format!("{dims:?} {voxel_type}, bricks of {core}");
        let checksum = checksum(&built.path);
        match checked.insert((what.clone(), mebibytes), checksum) {
            None => check_reading(&built, &what),
            // Bytes that were read before.
            Some(before) => assert_eq!(before, checksum, "{what}: threads of a build change its bytes"),
        }
    }
}

fn checksum(file: &Path) -> u64 {
    let mut hasher = DefaultHasher::new();
    std::fs::read(file).expect("the container was built").hash(&mut hasher);
    hasher.finish()
}

/// Extracting and verifying a container stay within their budgets.
#[allow(clippy::print_stdout, reason = "measurements of a test")]
fn check_reading(built: &Built, what: &str) {
    let extraction =
        |memory_bytes: u64| Extraction { lod: Lod(0), voxels: None, existing: Existing::Replace, memory_bytes };
    let output = built.folder.path().join("out.raw");
    let refused = extract(&built.container, &output, &extraction(0)).expect_err("nothing can be done in no memory");
    let refused = refused.to_string();
    // The memory that the message asks for must suffice.
    let needed: u64 = refused.split(' ').next().and_then(|n| n.parse().ok()).expect("it begins with a number");
    let (peak, extracted) = peak_of(|| extract(&built.container, &output, &extraction(needed << 20)));
    extracted.unwrap_or_else(|e| panic!("{what}: {e}"));
    check_verifying(&built.path, what);
    println!("MEASURED: extraction of {what}: budget {needed} MiB, peak {:.1} MiB", peak as f64 / 1048576.0);
    let allowed = (needed << 20) as usize + SLACK;
    assert!(peak <= allowed, "extraction of {what}: {peak} bytes at the peak, {allowed} allowed");
}

/// `verify` stays within its budget on eight threads, from the least sufficient budget upwards.
#[allow(clippy::print_stdout, reason = "measurements of a test")]
fn check_verifying(path: &Path, what: &str) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(8).build().expect("eight threads");
    let run = |memory_bytes: u64| pool.install(|| peak_of(|| verify(path, memory_bytes, &|_, _| ())));
    let refused = run(0).1.expect_err("nothing can be done in no memory").to_string();
    let needed: u64 = refused.split(' ').next().and_then(|n| n.parse().ok()).expect("it begins with a number");
    for mebibytes in [needed, 3 * needed] {
        let (peak, verified) = run(mebibytes << 20);
        verified.unwrap_or_else(|e| panic!("{what}: {e}"));
        println!("MEASURED: check of {what}: budget {mebibytes} MiB, peak {:.1} MiB", peak as f64 / 1048576.0);
        let allowed = (mebibytes << 20) as usize + SLACK;
        assert!(peak <= allowed, "check of {what}: {peak} bytes at the peak, {allowed} allowed");
    }
}

/// A SEG-Y file of `edge` x `edge` traces of one sample each, in random order.
fn scattered_traces(edge: u32) -> Vec<u8> {
    let mut places: Vec<u32> = (0..edge * edge).collect();
    let mut random = Random::new(1);
    for i in (1..places.len()).rev() {
        places.swap(i, random.index(i + 1));
    }
    let mut file = vec![b' '; 3200];
    file[0] = b'C';
    let mut header = [0; 400];
    // Sample interval, number of samples, format (IEEE float), revision, fixed length.
    for (byte, value) in [(3217, 1000u16), (3221, 1), (3225, 5), (3501, 0x100), (3503, 1)] {
        header[byte - 3201..][..2].copy_from_slice(&value.to_be_bytes());
    }
    file.extend(header);
    for place in places {
        let mut trace = [0; 244];
        trace[29] = 1;
        trace[115] = 1;
        trace[188..192].copy_from_slice(&(place / edge + 1).to_be_bytes());
        trace[192..196].copy_from_slice(&(place % edge + 1).to_be_bytes());
        trace[240..].copy_from_slice(&(place as f32).to_be_bytes());
        file.extend(trace);
    }
    file
}

/// The table of traces is counted, too; if it does not fit, the refusal names a sufficient budget.
fn check_scattered_traces() {
    let file = scattered_traces(300);
    let open = |memory_bytes: u64| {
        let options = SegyOptions { memory_bytes, ..SegyOptions::default() };
        SegySource::from_bytes(Box::new(file.clone()), Path::new("scattered.sgy"), &options)
    };
    let refused = open(1 << 20).expect_err("a table of 90,000 traces takes more").to_string();
    let needed: u64 = refused.split(' ').next().and_then(|n| n.parse().ok()).expect("it begins with a number");
    let (peak, source) = peak_of(|| open(needed << 20).unwrap_or_else(|e| panic!("{needed} MiB: {e}")));
    let allowed = (needed << 20) as usize + file.len() + SLACK;
    assert!(peak <= allowed, "scattered traces: {peak} bytes at the peak, {allowed} allowed");
    assert_eq!(source.info().memory_bytes, 4 * 300 * 300);
    let built = try_build(&source, &BuildOptions { memory_bytes: 16 << 20, ..options(64) });
    built.unwrap_or_else(|e| panic!("{e}"));
}
