//! Notes on the rays of a tile beside their results: errors and work.

use super::places::TILE_RAYS;
use crate::engines::totals::ErrorsByReason;
use crate::lod::deviation::RayDeviation;

/// Errors of the rays of a tile from coarser levels.
#[derive(Debug, Clone)]
pub struct LevelErrors {
    pub(super) rays: [RayDeviation; TILE_RAYS],
    /// Whether a voxel may be present in one level and absent in the other.
    pub(super) presence_may_change: bool,
}

/// Errors of the rays of a finished tile; 1 is white.
#[derive(Debug, Clone)]
pub struct TileErrors {
    /// Each ray, for all reasons.
    pub of_rays: [f32; TILE_RAYS],
    /// The greatest of them for each reason.
    pub greatest: ErrorsByReason,
}

impl LevelErrors {
    /// Nothing is off.
    pub const NONE: Self = Self { rays: [RayDeviation::NONE; TILE_RAYS], presence_may_change: false };
}

/// Cells crossed and leaps of each ray of a tile. An invisible brick counts as one leap.
pub type TileWork = [[u32; 2]; TILE_RAYS];

/// The same of no work at all.
pub const NO_WORK: TileWork = [[0; 2]; TILE_RAYS];
