//! Run lengths instead of decoded voxels, for bricks of labels, masks and sparse volumes. The bench measures their
//! memory as runs along x, and the cost of looking up the eight voxels of a cell. `cargo bench -p supervol-benches
//! --bench runs -- A.svol B.svol ...` prints a table.
//!
//! A row stores the beginning (one byte) and the value of each run, and the index of its first run (four bytes). A
//! voxel is found by bisection of its row's runs; its neighbour along x is in the same run or the next one. Rays cross
//! bricks in sixteen directions, with one cell per voxel; both representations look up the same eight voxels. One
//! thread, without ray casting and classification.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "it measures small numbers"
)]
#![allow(missing_docs, clippy::print_stdout, reason = "a bench has no callers, and prints what it found")]

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use supervol_format::random::Random;
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{Container, Lod};

/// Most bricks of level 0 that are measured, evenly spread over the volume.
const BRICKS_LIMIT: usize = 200;
/// Rays through each brick.
const RAYS: usize = 1024;
/// Number of different directions of the rays.
const DIRECTIONS: usize = 16;

/// The voxels of a brick, x fastest.
struct Plain {
    extent: [usize; 3],
    values: Vec<u16>,
}

/// The same voxels as runs along x.
struct Runs {
    extent: [usize; 3],
    /// Index of the first run of each row, and of the end of the last row.
    rows: Vec<u32>,
    starts: Vec<u8>,
    values: Vec<u16>,
}

impl Plain {
    #[inline]
    fn cell(&self, [x, y, z]: [usize; 3]) -> u32 {
        let [nx, ny, _] = self.extent;
        let row = |dy: usize, dz: usize| {
            let at = ((z + dz) * ny + y + dy) * nx + x;
            u32::from(self.values[at]) + u32::from(self.values[at + 1])
        };
        row(0, 0) + row(1, 0) + row(0, 1) + row(1, 1)
    }
}

impl Runs {
    fn of(plain: &Plain) -> Self {
        let extent = plain.extent;
        let mut runs = Self { extent, rows: vec![0], starts: Vec::new(), values: Vec::new() };
        for row in plain.values.chunks_exact(extent[0]) {
            for (x, &value) in row.iter().enumerate() {
                if x == 0 || row[x - 1] != value {
                    runs.starts.push(u8::try_from(x).expect("bricks are narrower than 256 voxels"));
                    runs.values.push(value);
                }
            }
            runs.rows.push(runs.starts.len() as u32);
        }
        runs
    }

    /// Memory in bytes; values take `voxel_bytes` bytes each.
    fn bytes(&self, voxel_bytes: usize) -> usize {
        4 * self.rows.len() + (1 + voxel_bytes) * self.starts.len()
    }

    #[inline]
    fn cell(&self, [x, y, z]: [usize; 3]) -> u32 {
        let row = |dy: usize, dz: usize| {
            let row = (z + dz) * self.extent[1] + y + dy;
            let (first, end) = (self.rows[row] as usize, self.rows[row + 1] as usize);
            let run = first + self.starts[first..end].partition_point(|&start| usize::from(start) <= x) - 1;
            let next = run + 1;
            let is_next = next < end && usize::from(self.starts[next]) == x + 1;
            u32::from(self.values[run]) + u32::from(self.values[if is_next { next } else { run }])
        };
        row(0, 0) + row(1, 0) + row(0, 1) + row(1, 1)
    }
}

/// Cells that the rays cross.
fn cells_of(extent: [usize; 3], random: &mut Random) -> Vec<[usize; 3]> {
    let mut cells = Vec::new();
    let directions: Vec<[f64; 3]> = (0..DIRECTIONS).map(|_| random.direction()).collect();
    for ray in 0..RAYS {
        let direction = directions[ray % DIRECTIONS];
        let middle: [f64; 3] = std::array::from_fn(|a| (extent[a] - 1) as f64 * random.unit());
        let reach = extent.iter().max().copied().unwrap_or(0) as i64;
        for step in -reach..reach {
            let place: [f64; 3] = std::array::from_fn(|a| middle[a] + direction[a] * step as f64);
            if (0..3).all(|a| place[a] >= 0.0 && place[a] < (extent[a] - 1) as f64) {
                cells.push(place.map(|p| p as usize));
            }
        }
    }
    cells
}

/// Results of one volume.
#[derive(Default)]
struct Sums {
    bricks: usize,
    plain_bytes: usize,
    run_bytes: usize,
    cells: usize,
    decoding: Duration,
    plain: Duration,
    runs: Duration,
}

fn measure(path: &Path) {
    let container = Container::open(path).expect("a container");
    let voxel_type = container.descriptor().voxel_type;
    let keys: Vec<_> = container.pyramid().keys_of(Lod(0)).collect();
    let mut random = Random::new(1);
    let mut sums = Sums::default();
    for key in keys.iter().step_by(keys.len().div_ceil(BRICKS_LIMIT)) {
        let entry = container.entry(*key).expect("a whole container");
        let extent = container.shape(*key).extent;
        if entry.uniform || extent.iter().any(|&n| n < 2) {
            continue;
        }
        let start = Instant::now();
        let bytes = container.read_brick(*key, &entry).expect("a whole container");
        sums.decoding += start.elapsed();
        // Values only need to be distinguishable: wide ones are replaced by their rank.
        let numbers = voxels_as_f64(voxel_type, &bytes);
        let mut all: Vec<u64> = numbers.iter().map(|v| v.to_bits()).collect();
        all.sort_unstable();
        all.dedup();
        let rank =
            |v: &f64| all.binary_search(&v.to_bits()).expect("it is among them").min(usize::from(u16::MAX)) as u16;
        let plain = Plain { extent, values: numbers.iter().map(rank).collect() };
        let runs = Runs::of(&plain);
        let cells = cells_of(extent, &mut random);
        let start = Instant::now();
        let by_plain: u64 = cells.iter().map(|&cell| u64::from(black_box(&plain).cell(cell))).sum();
        sums.plain += start.elapsed();
        let start = Instant::now();
        let by_runs: u64 = cells.iter().map(|&cell| u64::from(black_box(&runs).cell(cell))).sum();
        sums.runs += start.elapsed();
        assert_eq!(by_plain, by_runs, "both hold the same voxels");
        sums.bricks += 1;
        sums.plain_bytes += bytes.len();
        sums.run_bytes += runs.bytes(voxel_type.bytes());
        sums.cells += cells.len();
    }
    let mb = |bytes: usize| bytes as f64 / 1e6;
    let per_cell = |time: Duration| time.as_secs_f64() * 1e9 / sums.cells.max(1) as f64;
    println!(
        "| {} | {} | {:.1} | {:.1} | {:.2} | {:.2} | {:.1} | {:.1} | {:.1} |",
        path.file_stem().unwrap_or_default().to_string_lossy(),
        sums.bricks,
        mb(sums.plain_bytes),
        mb(sums.run_bytes),
        sums.run_bytes as f64 / sums.plain_bytes.max(1) as f64,
        sums.decoding.as_secs_f64() * 1e9 / sums.plain_bytes.max(1) as f64,
        per_cell(sums.plain),
        per_cell(sums.runs),
        per_cell(sums.runs) / per_cell(sums.plain)
    );
}

fn main() {
    println!(
        "| data | bricks not of one value | MB decoded | MB as runs | share | reading and decoding, ns a byte | ns a cell: voxels | runs | \
         runs / voxels |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    // Cargo passes an option of its own to benches.
    let containers = std::env::args_os().skip(1).filter(|argument| !argument.to_string_lossy().starts_with("--"));
    containers.map(PathBuf::from).for_each(|path| measure(&path));
}
