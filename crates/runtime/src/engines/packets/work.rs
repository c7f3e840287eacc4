//! Work of each ray: cells crossed and leaps, for maps of the cost.
//!
//! Packets count for all of their rays together. If work is counted ([`super::PacketRule::counts_work`]), each ray
//! crosses each brick as a packet of its own. The picture is the same, since lanes are independent, but takes several
//! times as long. Otherwise the cost is one test for each brick of a tile, and no kernel is concerned. The number of
//! cells of a ray may differ slightly from that in a shared packet. There, a ray learns of its end when waiting cells
//! are refined, and neighbours decide that too.

use supervol_format::BrickKey;

use super::visit::CastTile;
use crate::stream::counters::RayCounters;
use crate::stream::residency::Resident;

impl CastTile<'_> {
    /// Casts the rays that meet a brick through it one by one, and counts the work of each.
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

/// The counters that make up a ray's work.
fn counted(counters: &RayCounters) -> [u64; 2] {
    [counters.cells, counters.macro_cells_skipped]
}
