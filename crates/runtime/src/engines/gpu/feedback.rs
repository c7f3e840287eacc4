//! Feedback of the rays of a pass: missing bricks, used bricks, unfinished tiles, and counters.
//!
//! Layout of the buffer, in words:
//! - [`GpuCounters`]; the number of misses; three zeros;
//! - one bit for each slot;
//! - [`MISS_LIMIT`] pairs (entry, waiting rays);
//! - for each entry of the page table, the number of rays that wait for it;
//! - the tiles of a run.
//!
//! The used part up to the pairs is read back after every pass, and its size is bounded. At most [`MISS_LIMIT`] misses
//! are listed; the rest is counted and requested again in the next pass. Tiles are written before every run, and their
//! unfinished rays are read after it.

use supervol_format::BrickKey;
use supervol_format::cast::index;

use super::layout::GpuCounters;
use super::slots::SlotIndex;
use crate::engines::feedback::Miss;
use crate::stream::counters::{DeviceCounters, RayCounters};

/// Most misses listed in one pass.
pub const MISS_LIMIT: u32 = 1 << 16;

/// Misses that are read back with everything else; further ones are read after them.
pub const FIRST_MISSES: u32 = 1 << 10;

/// Words before the miss list.
pub const HEADER_WORDS: usize = size_of::<GpuCounters>() / 4 + 4;

/// Position of the number of misses, words.
pub const MISS_COUNT_WORD: usize = size_of::<GpuCounters>() / 4;

/// Result of one pass.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DeviceFeedback {
    /// Bricks that rays wait for, each once, nearest first.
    pub misses: Vec<Miss>,
    /// Resident bricks that rays sampled, each once, in the order of their slots.
    pub uses: Vec<BrickKey>,
    /// Rays that are not finished: all of them wait for one of the misses.
    pub unfinished_rays: u64,
    /// Whether it was stopped before all rays were finished or waited.
    pub is_stopped: bool,
    /// Counters of the rays.
    pub counters: RayCounters,
    /// Counters of this backend alone.
    pub device: DeviceCounters,
}

impl DeviceFeedback {
    /// Whether every ray is finished.
    #[must_use]
    pub fn is_converged(&self) -> bool {
        self.unfinished_rays == 0
    }

    /// Adds the counters of one dispatch.
    pub fn add(&mut self, counters: &GpuCounters) {
        let sums = &mut self.counters;
        sums.cells += u64::from(counters.cells);
        sums.samples += u64::from(counters.samples);
        sums.macro_cells += u64::from(counters.macro_cells);
        sums.macro_cells_skipped += u64::from(counters.macro_cells_skipped);
        sums.bricks += u64::from(counters.bricks);
        sums.parent_bricks += u64::from(counters.fallbacks);
        sums.rays_finished += u64::from(counters.finished);
        sums.rays_waiting += u64::from(counters.waiting);
        self.device.bricks_lost += u64::from(counters.lost);
        self.device.anomalies += u64::from(counters.anomalies);
        self.device.interruptions += u64::from(counters.interrupted);
        self.device.dispatches += 1;
    }
}

/// Position of the list of misses, words after the header: behind the bits of the slots.
#[must_use]
pub const fn miss_words(slots: u64) -> u64 {
    slots.div_ceil(32)
}

/// Position of the counts of waiting rays, words after the header.
#[must_use]
pub const fn wait_words(slots: u64) -> u64 {
    miss_words(slots) + 2 * MISS_LIMIT as u64
}

/// Position of the tiles of a run, words after the header.
#[must_use]
pub const fn tile_words(slots: u64, entries: u64) -> u64 {
    wait_words(slots) + entries
}

/// Words of the whole buffer, for runs of `tiles` tiles.
#[must_use]
pub const fn buffer_words(slots: u64, entries: u64, tiles: u64) -> u64 {
    HEADER_WORDS as u64 + tile_words(slots, entries) + tiles
}

/// Words up to the end of `misses` listed misses.
#[must_use]
pub const fn words_with(slots: u64, misses: u32) -> u64 {
    HEADER_WORDS as u64 + miss_words(slots) + 2 * misses as u64
}

/// Listed misses.
#[must_use]
pub fn listed_misses(words: &[u32]) -> u32 {
    words[MISS_COUNT_WORD].min(MISS_LIMIT)
}

/// The listed misses (entry, rays), by entry, and the number of unlisted ones; `words` are those of [`words_with`] all
/// misses.
#[must_use]
pub fn read_misses(words: &[u32], slots: u64) -> (Vec<(u32, u32)>, u64) {
    let listed = listed_misses(words);
    let list = &words[index(words_with(slots, 0))..index(words_with(slots, listed))];
    let mut misses: Vec<(u32, u32)> = list.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect();
    misses.sort_unstable();
    (misses, u64::from(words[MISS_COUNT_WORD] - listed))
}

/// The slots whose bit is set.
pub fn read_uses(words: &[u32], slots: u64) -> impl Iterator<Item = SlotIndex> + '_ {
    let bits = &words[HEADER_WORDS..index(words_with(slots, 0))];
    (0u32..).zip(bits).flat_map(|(word, &bits)| {
        (0..32).filter(move |bit| bits >> bit & 1 != 0).map(move |bit| SlotIndex(word * 32 + bit))
    })
}
