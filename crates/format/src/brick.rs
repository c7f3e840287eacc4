//! Geometry of one brick: its core, and an apron that keeps interpolation and gradients inside the brick.
//!
//! A brick owns the voxels of its core and draws the region `[-1/2, core-1/2]` around them (brick-local index space:
//! the core's first voxel is 0). Trilinear interpolation there reaches voxels -1 to core. Central differences take
//! samples one voxel further away, so they reach -2 to core+1. The apron is therefore 2 voxels wide on every side.
//! Outside the grid the apron repeats the nearest voxel, as the model clamps indices.

use crate::BrickKey;

/// Width of the apron in voxels, on every side of a brick.
pub const APRON: usize = 2;

/// Edge of a macro cell in voxels. The renderers decide visibility per macro cell.
pub const MACRO_CELL: usize = 8;

/// Allowed brick sizes: core voxels along each axis.
pub const CORE_SIZES: [u32; 4] = [16, 32, 64, 128];

/// Size of the bricks of one container.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BrickLayout {
    core: u32,
}

impl BrickLayout {
    /// The default: a core of 64 voxels. Both aprons together add 4 voxels per axis, about 20 % of the volume.
    pub const DEFAULT: Self = Self { core: 64 };
    /// The largest of [`CORE_SIZES`].
    pub const LARGEST: Self = Self { core: CORE_SIZES[CORE_SIZES.len() - 1] };

    /// Layout with this core edge in voxels; `None` if it is not one of [`CORE_SIZES`].
    #[must_use]
    pub fn new(core: u32) -> Option<Self> {
        CORE_SIZES.contains(&core).then_some(Self { core })
    }

    /// Core voxels along each axis of a full brick.
    #[must_use]
    pub fn core(self) -> usize {
        self.core as usize
    }

    /// Voxels along each axis of a full brick, aprons included.
    #[must_use]
    pub fn stored(self) -> usize {
        self.core() + 2 * APRON
    }

    /// Largest number of voxels along an axis that brick keys can address: 2^23 with a core of 16, 2^26 with a core of
    /// 128.
    #[must_use]
    pub const fn voxels_limit(self) -> u64 {
        BrickKey::AXIS_LIMIT as u64 * self.core as u64
    }

    /// Number of bricks that cover this many voxels along an axis.
    #[must_use]
    pub fn bricks_along(self, voxels: u64) -> u64 {
        voxels.div_ceil(u64::from(self.core))
    }
}
