//! How the bytes of `--memory` are divided. Everything that grows with the volume, the bricks or the threads is here.
//!
//! | part | bytes |
//! |---|---|
//! | program | 48 MiB (`PROGRAM_BYTES`), but no more than two thirds of what is there beyond the least that will do |
//! | tables | 80 per brick, until the container is finished, and what the source needs |
//! | workspaces | a quarter of the rest: per thread `WORKSPACE_COPIES` stored bricks (cut, predicted, byte planes, encoded, ...), or what making wavelets takes if that is more |
//! | statistics | per thread one histogram of 64 Ki counters, 512 Ki for doubles, and one |
//! | brick cache | a sixteenth of what the program leaves: decoded bricks of the finer level, or part of what is kept of the next one (`next_level`) |
//! | tiles | the rest: what is read for a tile and made of it ([`tile_bytes`]) |
//!
//! The tiles' share depends on the budget and the volume alone, never on the number of threads, because tiles decide in
//! which order bricks are written. Where the workspaces do not suffice for all threads, fewer are started.

use std::sync::{Mutex, PoisonError};

use supervol_format::brick::APRON;
use supervol_format::codec::wavelet::ENCODING_BYTES_PER_VOXEL;
use supervol_format::container::toc::ENTRY_BYTES;
use supervol_format::readable::Mib;
use supervol_format::{Level, Pyramid, VoxelType};

use crate::error::BuildError;
use crate::ordered::AHEAD_PER_THREAD;
use crate::statistics::Statistics;

/// What the process has in memory beside what is planned: the program itself, stacks, progress, and what the allocator keeps between
/// pieces (measured: 24 to 36 MiB where little is planned).
const PROGRAM_BYTES: u64 = 48 << 20;
/// What helps where memory does not suffice.
pub const ALLOW_MORE: &str = "Allow more with --memory";
/// Stored bricks of scratch memory that one thread may need at once.
const WORKSPACE_COPIES: u64 = 6;
/// The same while wavelets are made: cut, as voxels, and two payloads.
const WAVELET_COPIES: u64 = 4;
/// What is read for a tile is in memory so many times: while it is read, while the one before is encoded, and the coarser
/// voxels that are made of it.
const TILES_IN_FLIGHT: f64 = 2.6;
/// Bytes that an encoded brick takes beside its record.
const ENCODED_BRICK_BYTES: u64 = 256;

/// What `--memory` leaves for a command's data, which take at least `needed` bytes for `what`.
///
/// # Errors
/// If they do not fit, with what would do.
pub fn left_for_data(
    memory_bytes: u64,
    needed: u64,
    what: impl FnOnce() -> String,
    advice: &str,
) -> Result<u64, BuildError> {
    match memory_bytes.checked_sub(needed) {
        Some(spare) => Ok(memory_bytes - PROGRAM_BYTES.min(spare / 3 * 2)),
        None => Err(BuildError::memory(needed, memory_bytes, what(), advice)),
    }
}

/// The division of one build's memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryPlan {
    /// What the user allowed.
    pub budget_bytes: u64,
    /// Threads that the workspaces suffice for, at most those asked for.
    pub threads: usize,
    /// Tables, workspaces and statistics.
    pub fixed_bytes: u64,
    /// Decoded bricks of the finer level.
    pub cache_bytes: u64,
    /// Most that a tile may take, as [`tile_bytes`] counts.
    pub tile_bytes: u64,
}

impl MemoryPlan {
    /// Divides `budget_bytes` for at most `threads` threads, beside a source that takes `source_bytes` as long as it is open.
    ///
    /// # Errors
    /// If not even one thread and the smallest tile fit, with what would.
    pub fn new(
        budget_bytes: u64,
        threads: usize,
        source_bytes: u64,
        pyramid: &Pyramid,
        voxel_type: VoxelType,
    ) -> Result<Self, BuildError> {
        let brick = pyramid.largest_brick_bytes(voxel_type);
        let histogram = Statistics::bytes(voxel_type);
        let table = pyramid.brick_count() * ENTRY_BYTES as u64 + source_bytes;
        let voxels = brick / voxel_type.bytes() as u64;
        let wavelets = WAVELET_COPIES * brick + ENCODING_BYTES_PER_VOXEL as u64 * voxels;
        let per_thread = wavelets.max(WORKSPACE_COPIES * brick) + histogram;
        let smallest = pyramid.levels().iter().enumerate().map(|(lod, level)| {
            let finer = if lod == 0 { [1; 3] } else { level.factors };
            tile_bytes(pyramid, level, finer, [1; 3], voxel_type)
        });
        let smallest_tiles = smallest.max().expect("a pyramid has levels");
        let needed = (smallest_tiles + per_thread + table + histogram) * 16 / 15 + 16;
        let what = || {
            format!(
                "{} for the tables of the source and of {} bricks, {} for one thread, the rest for tiles of one brick",
                Mib(table),
                pyramid.brick_count(),
                Mib(per_thread + histogram)
            )
        };
        let advice = "Allow more with --memory, or use smaller bricks (--brick)";
        let left = left_for_data(budget_bytes, needed, what, advice)?;
        let cache_bytes = left / 16;
        let rest = left - (table + histogram + cache_bytes);
        // The share of the tiles must not depend on the threads: tiles decide in which order bricks are written.
        let tiles = smallest_tiles.max((rest / 4 * 3).min(rest - per_thread));
        let affordable = usize::try_from((rest - tiles) / per_thread).unwrap_or(usize::MAX);
        let threads = threads.clamp(1, affordable);
        let fixed_bytes = table + histogram + threads as u64 * per_thread;
        Ok(Self { budget_bytes, threads, fixed_bytes, cache_bytes, tile_bytes: tiles })
    }

    /// Most that may be kept of next levels (`next_level`) while a level is written in tiles of `size` bricks: what the cache
    /// would take, which nobody needs then, and what such a tile leaves of its share, since only a few of its encoded bricks are there at
    /// once.
    #[must_use]
    pub fn next_level_bytes(
        &self,
        pyramid: &Pyramid,
        level: &Level,
        factors: [u32; 3],
        size: [u32; 3],
        voxel_type: VoxelType,
    ) -> u64 {
        let all = tile_bytes(pyramid, level, factors, size, voxel_type);
        let records = |size| records_bytes(pyramid, level, size, voxel_type);
        let at_once = (AHEAD_PER_THREAD * self.threads) as u64 * records([1; 3]);
        (self.cache_bytes + self.tile_bytes).saturating_sub(all - records(size) + at_once)
    }

    /// What the parts add up to, bytes.
    #[must_use]
    pub fn planned_bytes(&self) -> u64 {
        self.fixed_bytes + self.cache_bytes + self.tile_bytes
    }
}

/// Bytes in memory at once for a tile of `size` bricks of a level: what is read, twice over; what is averaged; and the
/// encoded bricks, which along a line or in a plane are many times what was read, since each stores its apron.
#[must_use]
pub fn tile_bytes(pyramid: &Pyramid, level: &Level, factors: [u32; 3], size: [u32; 3], voxel_type: VoxelType) -> u64 {
    let read = read_bytes(pyramid, level, factors, size, voxel_type) as f64 * TILES_IN_FLIGHT;
    (read.ceil() as u64).saturating_add(records_bytes(pyramid, level, size, voxel_type))
}

/// Most bytes that the encoded bricks of a tile of `size` bricks take.
fn records_bytes(pyramid: &Pyramid, level: &Level, size: [u32; 3], voxel_type: VoxelType) -> u64 {
    let bricks: u64 = (0..3).map(|a| u64::from(size[a].min(level.bricks[a]))).product();
    // No payload is longer than raw voxels by more than 1 in 64; a macro cell takes 2 bytes of 512 voxels.
    let core = pyramid.layout().core() as u64;
    let extent = level.dims.0.map(|n| n.min(core) + 2 * APRON as u64);
    let record = extent.iter().product::<u64>() * voxel_type.bytes() as u64 * 65 / 64;
    bricks.saturating_mul(record + ENCODED_BRICK_BYTES)
}

/// Bytes to read for a tile of `size` bricks of a level: its voxels with apron, times the factors to the finer level
/// that they are averages of (all 1 at level 0, which is read as it is).
#[must_use]
pub fn read_bytes(pyramid: &Pyramid, level: &Level, factors: [u32; 3], size: [u32; 3], voxel_type: VoxelType) -> u64 {
    let core = pyramid.layout().core() as u64;
    let voxels: u64 = (0..3)
        .map(|a| {
            let stored = (u64::from(size[a]) * core + 2 * APRON as u64).min(level.dims.0[a]);
            stored * u64::from(factors[a])
        })
        .product();
    voxels * voxel_type.bytes() as u64
}

/// Memory of tiles that have been encoded, for the next ones: given back to the allocator, it would be torn to pieces by the bricks'
/// records, and half as much again would be needed. There are never more than were in use at once.
#[derive(Default)]
pub(crate) struct Spares(Mutex<Vec<Vec<u8>>>);

impl Spares {
    /// So many bytes, whatever they hold.
    pub(crate) fn take(&self, bytes: usize) -> Vec<u8> {
        let spare = {
            let mut spares = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            spares.sort_by_key(Vec::capacity);
            let found = spares.iter().position(|spare| spare.capacity() >= bytes);
            if found.is_none() {
                spares.pop();
            }
            found.map(|at| spares.remove(at))
        };
        // Zeros that the system gives cost nothing until they are written over.
        let Some(mut buffer) = spare else { return vec![0; bytes] };
        buffer.resize(bytes, 0);
        buffer
    }

    /// Memory that is needed no more.
    pub(crate) fn give_back(&self, buffer: Vec<u8>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(buffer);
    }
}
