//! Bytes that packets hold in host memory.

use super::noted::{LevelErrors, TileErrors, TileWork};
use super::packet::Queues;
use super::parts_ahead::PartsAhead;
use super::per_brick::bytes_kept;
use super::pixels::{FinishedTile, Tile};
use super::places::TILE_SIDE;
use super::plans::BrickPlan;
use super::rule::PacketRule;
use super::silhouette::Silhouette;
use super::summaries::BrickSummary;
use super::tile::{Gathered, TileRays};
use crate::engines::feedback::BlockFeedback;
use crate::stream::budget::{BandMode, EngineBytes};

/// Copies of a brick's derived data in memory at once: the data itself, its input, and data that a thread still uses
/// after it left the cache.
const MAKING: u64 = 4;

/// Bytes of packets in host memory beside their tables; `core`: voxels along an edge of a full brick's core.
#[must_use]
pub fn bytes_held(core: usize, rule: PacketRule) -> EngineBytes {
    let made = (BrickPlan::most_bytes(core) + Silhouette::most_bytes(core)).max(BrickSummary::most_bytes(core));
    let made_of_brick = bytes_kept(made);
    let gathered = size_of::<Gathered>()
        + if rule.sums_errors { size_of::<LevelErrors>() } else { 0 }
        + if rule.counts_work { size_of::<TileWork>() } else { 0 };
    const { assert!(FinishedTile::BYTES <= size_of::<Gathered>()) };
    const { assert!(size_of::<TileErrors>() <= size_of::<LevelErrors>()) };
    EngineBytes {
        bands: BandMode::Allowed,
        group_side: TILE_SIDE,
        group: (size_of::<Tile>() + gathered + size_of::<BlockFeedback>()) as u64,
        // A tile that is about to wait exists twice for a moment.
        thread: (size_of::<TileRays>()
            + TileRays::MOST_BYTES_OF_FACES
            + PartsAhead::MOST_BYTES
            + size_of::<Queues>()
            + gathered) as u64
            + MAKING * made_of_brick,
        made_of_brick,
        of_ray: 0,
        // Each map, and a copy to hand out.
        of_pixel: (u64::from(rule.sums_errors) + u64::from(rule.counts_work)) * 2 * size_of::<[f32; 4]>() as u64,
    }
}
