//! Division of a build's memory. All memory that grows with the volume, the bricks or the threads is counted here.
//!
//! | part | bytes |
//! |---|---|
//! | program | 48 MiB (`PROGRAM_BYTES`), but at most two thirds of the memory beyond the least possible |
//! | tables | 80 per brick until the container is finished, and the source's own memory |
//! | workspaces | a quarter of the rest: `WORKSPACE_COPIES` stored bricks per thread, or the wavelet encoder's need |
//! | statistics | one histogram per thread and one more, of 64 Ki counters (512 Ki for doubles) |
//! | brick cache | a sixteenth of the memory after the program: decoded finer bricks, or part of `next_level` |
//! | tiles | the rest: voxels read for a tile and bricks made of it ([`tile_bytes`]) |
//!
//! The tiles' share depends on the budget and the volume alone, never on the number of threads. Tiles determine the
//! order in which bricks are written. If the workspaces do not suffice for all threads, fewer are started.

use std::sync::{Mutex, PoisonError};

use supervol_format::brick::APRON;
use supervol_format::cast::whole;
use supervol_format::codec::wavelet::ENCODING_BYTES_PER_VOXEL;
use supervol_format::container::toc::ENTRY_BYTES;
use supervol_format::{Level, Pyramid, VoxelType};

use crate::error::{BuildError, MemoryPurpose};
use crate::statistics::Statistics;

/// Memory of the process besides the planned one: the program itself, stacks, progress, and memory held by the
/// allocator (measured: 24 to 36 MiB for small plans).
const PROGRAM_BYTES: u64 = 48 << 20;
/// Scratch memory of a thread, in stored bricks: cut, predicted, byte planes, encoded, ...
const WORKSPACE_COPIES: u64 = 6;
/// The same for the wavelet encoder: cut, as voxels, and two payloads.
const WAVELET_COPIES: u64 = 4;
/// Copies of a tile's voxels in memory: while the tile is read, while the previous one is encoded, and the coarser
/// voxels made of it.
const TILES_IN_FLIGHT: f64 = 2.6;
/// Bricks per thread that are begun before the first of them is written.
pub(crate) const AHEAD_PER_THREAD: usize = 4;
/// Memory of an encoded brick besides its record, in bytes.
const ENCODED_BRICK_BYTES: u64 = 256;

/// Part of a memory limit that is left for data, in bytes. The data need at least `needed` bytes.
///
/// # Errors
/// If they do not fit; the message names a sufficient number.
pub fn left_for_data(memory_bytes: u64, needed: u64, purpose: MemoryPurpose) -> Result<u64, BuildError> {
    match memory_bytes.checked_sub(needed) {
        Some(spare) => Ok(memory_bytes - PROGRAM_BYTES.min(spare / 3 * 2)),
        None => Err(BuildError::memory(needed, memory_bytes, purpose)),
    }
}

/// Division of one build's memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryPlan {
    /// The user's limit in bytes.
    pub budget_bytes: u64,
    /// Threads that have workspaces, at most those requested.
    pub threads: usize,
    /// Bytes of tables, workspaces and statistics.
    pub fixed_bytes: u64,
    /// Bytes for decoded bricks of the finer level.
    pub cache_bytes: u64,
    /// Largest size of a tile in bytes, as counted by [`tile_bytes`].
    pub tile_bytes: u64,
}

impl MemoryPlan {
    /// Divides `budget_bytes` for at most `threads` threads, besides a source that takes `source_bytes` while it is
    /// open.
    ///
    /// # Errors
    /// If not even one thread and the smallest tile fit; the message names a sufficient number.
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
        let smallest_tiles = smallest.fold(0, u64::max);
        let needed = (smallest_tiles + per_thread + table + histogram) * 16 / 15 + 16;
        let purpose = MemoryPurpose::Build {
            table_bytes: table,
            bricks: pyramid.brick_count(),
            thread_bytes: per_thread + histogram,
        };
        let left = left_for_data(budget_bytes, needed, purpose)?;
        let cache_bytes = left / 16;
        let rest = left - (table + histogram + cache_bytes);
        // The tiles' share must not depend on the threads: tiles determine the order in which bricks are written.
        let tiles = smallest_tiles.max((rest / 4 * 3).min(rest - per_thread));
        let affordable = usize::try_from((rest - tiles) / per_thread).unwrap_or(usize::MAX);
        let threads = threads.clamp(1, affordable);
        let fixed_bytes = table + histogram + threads as u64 * per_thread;
        Ok(Self { budget_bytes, threads, fixed_bytes, cache_bytes, tile_bytes: tiles })
    }

    /// Memory in bytes for `next_level` while a level is written in tiles of `size` bricks. It is the brick cache,
    /// which is unused then, plus the unused part of the tile's share. Only a few encoded bricks of such a tile exist
    /// at once.
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

    /// Sum of the parts in bytes.
    #[must_use]
    pub fn planned_bytes(&self) -> u64 {
        self.fixed_bytes + self.cache_bytes + self.tile_bytes
    }
}

/// Bytes in memory at once for a tile of `size` bricks of a level: the voxels read, twice; their averages; and the
/// encoded bricks. In lines and planes the encoded bricks are many times the voxels read, because each stores its
/// apron.
#[must_use]
pub fn tile_bytes(pyramid: &Pyramid, level: &Level, factors: [u32; 3], size: [u32; 3], voxel_type: VoxelType) -> u64 {
    let read = read_bytes(pyramid, level, factors, size, voxel_type) as f64 * TILES_IN_FLIGHT;
    whole::<u64>(read.ceil()).saturating_add(records_bytes(pyramid, level, size, voxel_type))
}

/// Largest size in bytes of the encoded bricks of a tile of `size` bricks.
fn records_bytes(pyramid: &Pyramid, level: &Level, size: [u32; 3], voxel_type: VoxelType) -> u64 {
    let bricks: u64 = (0..3).map(|a| u64::from(size[a].min(level.bricks[a]))).product();
    // A payload is at most 1/64 longer than the raw voxels; a macro cell takes 2 bytes per 512 voxels.
    let core = pyramid.layout().core() as u64;
    let extent = level.dims.0.map(|n| n.min(core) + 2 * APRON as u64);
    let record = extent.iter().product::<u64>() * voxel_type.bytes() as u64 * 65 / 64;
    bricks.saturating_mul(record + ENCODED_BRICK_BYTES)
}

/// Bytes to read for a tile of `size` bricks of a level: its voxels with apron, times the factors to the finer level.
/// At level 0, which is read from the source, all factors are 1.
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

/// Buffers of encoded tiles, reused for the next tiles. In the allocator they would be fragmented by the bricks'
/// records, and half as much memory again would be needed. There are never more buffers than were in use at once.
#[derive(Default)]
pub(crate) struct Spares(Mutex<Vec<Vec<u8>>>);

impl Spares {
    /// A buffer of `bytes` bytes with unspecified contents.
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
        // Fresh zero pages from the system cost nothing until they are written.
        let Some(mut buffer) = spare else { return vec![0; bytes] };
        buffer.resize(bytes, 0);
        buffer
    }

    /// Returns a buffer for reuse.
    pub(crate) fn give_back(&self, buffer: Vec<u8>) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(buffer);
    }
}
