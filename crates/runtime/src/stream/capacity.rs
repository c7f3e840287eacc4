//! Capacity: how many of the wanted bricks are fetched in one tick, and which bricks they may evict.
//!
//! The *frontier* is the least rank that any ray waits for (see [`super::priority`]). Ranks below it are passed: no ray
//! of this frame returns to them. Wanted bricks at the frontier are fetched *now*, whatever they evict.
//!
//! Wanted bricks behind the frontier are fetched *ahead*: rays wait there already, and a pass is saved. They take only
//! memory that no ray of this frame will want, while bricks at or behind the frontier fill at most `AHEAD_SHARE` of the
//! cache. So the frontier always finds room that is not live, and no brick is fetched twice.

use supervol_format::cast::index;

use super::priority::Rank;
use crate::stream::field::FieldBrick;

/// Part of the cache, as a divisor, that bricks at or behind the frontier may fill: one half.
const AHEAD_SHARE: u64 = 2;

/// A wanted brick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Candidate {
    /// The brick.
    pub key: FieldBrick,
    /// Position in the front-to-back order.
    pub rank: Rank,
    /// Bytes it will take in the host cache; 0 if it is there already.
    pub bytes: u64,
}

/// Room for bricks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Supply {
    /// Bytes of the host cache that hold nothing.
    pub unused_bytes: u64,
    /// Bytes of bricks that no ray of this frame will want.
    pub free_bytes: u64,
    /// Bytes of bricks that rays of this frame may want again.
    pub live_bytes: u64,
    /// Bytes reserved for bricks being loaded.
    pub reserved_bytes: u64,
    /// Bytes of the whole cache.
    pub budget_bytes: u64,
    /// Bricks that the ray caster can take in one tick; at least 1.
    pub bricks: usize,
}

/// Whether [`admit`] needs to know which bricks may leave the cache. It does not while all bricks held, being loaded
/// and wanted fit into the share for bricks fetched ahead.
#[must_use]
pub fn needs_victims(candidates: &[Candidate], unused_bytes: u64, budget_bytes: u64) -> bool {
    let wanted: u64 = candidates.iter().map(|candidate| candidate.bytes).sum();
    budget_bytes - unused_bytes + wanted > budget_bytes / AHEAD_SHARE
}

/// Number of candidates, from the front of the list, to fetch in this tick. Candidates are in order of rank.
#[must_use]
pub fn admit(candidates: &[Candidate], frontier: Rank, supply: Supply) -> usize {
    let mut bytes = 0;
    for (i, candidate) in candidates.iter().enumerate() {
        bytes += candidate.bytes;
        let now = candidate.rank <= frontier;
        let fits = if now {
            bytes <= supply.unused_bytes + supply.free_bytes + supply.live_bytes && i < supply.bricks
        } else {
            bytes <= supply.unused_bytes + supply.free_bytes
                && supply.live_bytes + supply.reserved_bytes + bytes <= supply.budget_bytes / AHEAD_SHARE
                && i < supply.bricks.div_ceil(index(AHEAD_SHARE))
        };
        if !fits {
            return i;
        }
    }
    candidates.len()
}

#[cfg(test)]
mod tests {
    use supervol_format::{BrickIndex, BrickKey, Lod};

    use super::*;
    use crate::stream::field::Field;

    fn candidates(ranks: &[Rank]) -> Vec<Candidate> {
        let key = Field::FIRST.brick(BrickKey::new(Lod(0), BrickIndex([0; 3])));
        ranks.iter().map(|&rank| Candidate { key, rank, bytes: 10 }).collect()
    }

    const SUPPLY: Supply = Supply {
        unused_bytes: 20,
        free_bytes: 20,
        live_bytes: 60,
        reserved_bytes: 0,
        budget_bytes: 100,
        bricks: usize::MAX,
    };

    #[test]
    fn the_frontier_may_push_out_live_bricks_and_what_lies_behind_may_not() {
        assert_eq!(admit(&candidates(&[5; 12]), 5, SUPPLY), 10);
        assert_eq!(admit(&candidates(&[5, 6, 7]), 5, SUPPLY), 1, "more than half of the cache is live");
        let calm = Supply { live_bytes: 20, ..SUPPLY };
        assert_eq!(admit(&candidates(&[5, 6, 7, 8, 9]), 5, calm), 3, "up to one half live");
        let empty = Supply { live_bytes: 0, free_bytes: 0, unused_bytes: 100, ..SUPPLY };
        assert_eq!(admit(&candidates(&[5, 6, 7, 8, 9, 9, 9]), 5, empty), 5);
        let loading = Supply { unused_bytes: 70, reserved_bytes: 30, ..empty };
        assert_eq!(admit(&candidates(&[5, 6, 7, 8, 9, 9, 9]), 5, loading), 2, "bricks on their way are in the half");
        assert_eq!(admit(&candidates(&[5; 9]), 5, loading), 7);
    }

    #[test]
    fn who_may_leave_is_asked_only_where_it_matters() {
        let cases = (0..=100).step_by(10).flat_map(|filled| (0..=filled).step_by(10).map(move |live| (filled, live)));
        let mut asked = 0;
        for ((filled, live_bytes), count) in cases.flat_map(|case| (1..12).map(move |count| (case, count))) {
            let wanted = candidates(&[5, 5, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14][..count]);
            let supply = Supply { unused_bytes: 100 - filled, free_bytes: filled - live_bytes, live_bytes, ..SUPPLY };
            let unknown = Supply { free_bytes: 0, live_bytes: 0, ..supply };
            if needs_victims(&wanted, supply.unused_bytes, supply.budget_bytes) {
                asked += 1;
                continue;
            }
            assert_eq!([admit(&wanted, 5, supply), admit(&wanted, 5, unknown)], [count; 2], "{supply:?}");
        }
        assert!(asked > 0);
    }

    #[test]
    fn the_ray_caster_s_places_are_a_limit_too() {
        let supply = Supply { live_bytes: 0, unused_bytes: 100, free_bytes: 0, bricks: 4, ..SUPPLY };
        assert_eq!(admit(&candidates(&[5; 9]), 5, supply), 4);
        assert_eq!(admit(&candidates(&[5, 6, 7, 8]), 5, supply), 2);
        assert_eq!(admit(&candidates(&[5, 6]), 5, Supply { bricks: 1, ..supply }), 1);
        assert_eq!(admit(&candidates(&[6]), 5, Supply { bricks: 1, ..supply }), 1);
    }
}
