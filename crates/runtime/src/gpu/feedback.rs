//! What the rays of a pass say: bricks they wait for, bricks they used, and what it cost.
//!
//! Layout of the buffer, in words: [`GpuCounters`]; the number of misses; three zeros; [`MISS_LIMIT`] pairs (entry, waiting
//! rays); one bit for each slot; for each entry of the page table the rays that wait for it. All but the last is read back
//! after every pass, so that it is bounded: at most [`MISS_LIMIT`] misses are listed, the rest is counted and asked for again
//! in the next pass.

use supervol_format::BrickKey;

use super::layout::GpuCounters;
use super::slots::SlotIndex;
use crate::counters::{DeviceCounters, RayCounters};
use crate::raycast::cpu::Miss;

/// Most misses listed in one pass.
pub const MISS_LIMIT: u32 = 1 << 16;

/// Words before the miss list.
pub const HEADER_WORDS: usize = size_of::<GpuCounters>() / 4 + 4;

/// Place of the number of misses, words.
pub const MISS_COUNT_WORD: usize = size_of::<GpuCounters>() / 4;

/// What one pass has to say.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PassFeedback {
    /// Bricks that rays wait for, each once, nearest first.
    pub misses: Vec<Miss>,
    /// Resident bricks that rays sampled, each once, in the order of their slots.
    pub uses: Vec<BrickKey>,
    /// Rays that are not finished: all of them wait for one of the misses.
    pub unfinished_rays: u64,
    /// Whether it was time to stop before all rays were finished or waited.
    pub is_stopped: bool,
    /// What the rays did.
    pub counters: RayCounters,
    /// What only this backend counts.
    pub device: DeviceCounters,
}

impl PassFeedback {
    /// Whether every ray is finished.
    #[must_use]
    pub fn is_converged(&self) -> bool {
        self.unfinished_rays == 0
    }

    /// Adds what one dispatch counted.
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

/// Where the bits of the slots begin, words after the header.
#[must_use]
pub const fn use_words() -> u32 {
    2 * MISS_LIMIT
}

/// Where the counts of waiting rays begin, words after the header.
#[must_use]
pub const fn wait_words(slots: u64) -> u64 {
    use_words() as u64 + slots.div_ceil(32)
}

/// Words that are read back after a pass.
#[must_use]
pub const fn read_words(slots: u64) -> u64 {
    HEADER_WORDS as u64 + wait_words(slots)
}

/// Words of the whole buffer.
#[must_use]
pub const fn buffer_words(slots: u64, entries: u64) -> u64 {
    read_words(slots) + entries
}

/// The listed misses (entry, rays), by entry, and how many found no place.
#[must_use]
pub fn read_misses(words: &[u32]) -> (Vec<(u32, u32)>, u64) {
    let found = words[MISS_COUNT_WORD];
    let listed = found.min(MISS_LIMIT) as usize;
    let list = &words[HEADER_WORDS..HEADER_WORDS + 2 * listed];
    let mut misses: Vec<(u32, u32)> = list.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect();
    misses.sort_unstable();
    (misses, u64::from(found) - listed as u64)
}

/// The slots whose bit is set.
pub fn read_uses(words: &[u32]) -> impl Iterator<Item = SlotIndex> + '_ {
    let bits = &words[HEADER_WORDS + use_words() as usize..];
    (0u32..).zip(bits).flat_map(|(word, &bits)| {
        (0..32).filter(move |bit| bits >> bit & 1 != 0).map(move |bit| SlotIndex(word * 32 + bit))
    })
}
