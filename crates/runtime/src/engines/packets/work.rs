//! What each ray costs: the cells that it crosses and the leaps that it takes, for who wants to see where the work goes.
//!
//! Packets count for all of their rays together. Where somebody asks ([`super::PacketRule::counts_work`]), each ray goes through each
//! brick as a packet of its own: the picture stays what it is, since no lane influences another, and takes several times as long.
//! Nobody else pays more than one look for each brick of a tile, and no kernel knows of it. Of a ray that shares a packet some cells more or
//! fewer may be crossed: it learns that it has ended when the cells that wait are settled, which neighbours decide, too.

use supervol_format::BrickKey;

use super::visit::CastTile;
use crate::stream::counters::RayCounters;
use crate::stream::residency::Resident;

impl CastTile<'_> {
    /// The rays that meet a brick go through it one by one, and what each costs is noted.
    pub(super) fn go_through_one_by_one(&mut self, key: BrickKey, resident: Resident<'_>) {
        let hits = self.rays.hits().to_vec();
        for &ray in &hits {
            self.rays.set_hits(&[ray]);
            let before = counted(&self.feedback.counters);
            self.go_through(key, resident);
            let after = counted(&self.feedback.counters);
            if let Some(work) = &mut self.rays.gathered.work {
                for (sum, (after, before)) in work[usize::from(ray)].iter_mut().zip(after.into_iter().zip(before)) {
                    *sum = sum.saturating_add(u32::try_from(after - before).unwrap_or(u32::MAX));
                }
            }
        }
    }
}

/// What a ray's work is counted by.
fn counted(counters: &RayCounters) -> [u64; 2] {
    [counters.cells, counters.macro_cells_skipped]
}
