//! Feedback of a pass: bricks that rays wait for, bricks that they read, counts.

use std::collections::{BTreeMap, BTreeSet};

use supervol_format::BrickKey;

use crate::stream::counters::RayCounters;

/// A brick that rays wait for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Miss {
    /// The brick.
    pub key: BrickKey,
    /// Rays that wait for it.
    pub rays: u64,
    /// Least world length from a ray's origin to it.
    pub nearest: f64,
}

/// Result of a pass.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PassFeedback {
    /// Bricks that rays wait for, nearest first.
    pub misses: Vec<Miss>,
    /// Bricks that rays read, in key order.
    pub uses: Vec<BrickKey>,
    /// Sums over the pass.
    pub counters: RayCounters,
    /// Whether the stop condition ended it before every tile was finished or waited.
    pub is_stopped: bool,
}

impl PassFeedback {
    /// Whether every ray is finished.
    #[must_use]
    pub fn is_converged(&self) -> bool {
        self.misses.is_empty() && !self.is_stopped
    }
}

/// Result of a pass for one block of rays.
#[derive(Default)]
pub(crate) struct BlockFeedback {
    pub(crate) misses: BTreeMap<BrickKey, (u64, f64)>,
    pub(crate) uses: BTreeSet<BrickKey>,
    pub(crate) counters: RayCounters,
    pub(crate) is_stopped: bool,
}

impl PassFeedback {
    /// Sums up what blocks of rays report.
    pub(crate) fn merged(blocks: Vec<BlockFeedback>) -> Self {
        let mut misses: BTreeMap<BrickKey, (u64, f64)> = BTreeMap::new();
        let mut uses = BTreeSet::new();
        let mut counters = RayCounters::default();
        let mut is_stopped = false;
        for block in blocks {
            is_stopped |= block.is_stopped;
            for (key, (rays, nearest)) in block.misses {
                let entry = misses.entry(key).or_insert((0, f64::INFINITY));
                *entry = (entry.0 + rays, entry.1.min(nearest));
            }
            uses.extend(block.uses);
            counters.add(&block.counters);
        }
        let mut misses: Vec<Miss> =
            misses.into_iter().map(|(key, (rays, nearest))| Miss { key, rays, nearest }).collect();
        misses.sort_by(|a, b| a.nearest.total_cmp(&b.nearest).then(a.key.cmp(&b.key)));
        Self { misses, uses: uses.into_iter().collect(), counters, is_stopped }
    }
}
