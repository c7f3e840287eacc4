//! What one brick stores: its core, and an apron so that interpolation and gradients never leave it.
//!
//! A brick owns the voxels of its core and draws the region `[-1/2, core-1/2]` around them (brick-local index space:
//! the core's first voxel is 0). Trilinear interpolation there reaches voxels -1 to core; central differences, whose
//! taps lie one voxel away, reach -2 to core+1. So the apron is 2 voxels on every side. Outside the grid the apron
//! repeats the nearest voxel, which is the model's clamping of indices.

use crate::BrickKey;

/// Voxels of apron on every side of a brick.
pub const APRON: usize = 2;

/// Edge of a macro cell in voxels: the cell in which visibility is decided.
pub const MACRO_CELL: usize = 8;

/// The brick sizes a container may have: core voxels along each axis.
pub const CORE_SIZES: [u32; 4] = [16, 32, 64, 128];

/// Size of the bricks of one container.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BrickLayout {
    core: u32,
}

impl BrickLayout {
    /// The default: 64 voxels, 20 % apron.
    pub const DEFAULT: Self = Self { core: 64 };
    /// The last of [`CORE_SIZES`].
    pub const LARGEST: Self = Self { core: CORE_SIZES[CORE_SIZES.len() - 1] };

    /// A layout with this core edge, if it is one of [`CORE_SIZES`].
    #[must_use]
    pub fn new(core: u32) -> Option<Self> {
        CORE_SIZES.contains(&core).then_some(Self { core })
    }

    /// Core voxels along each axis of a full brick.
    #[must_use]
    pub fn core(self) -> usize {
        self.core as usize
    }

    /// Voxels along each axis of a full brick with its apron.
    #[must_use]
    pub fn stored(self) -> usize {
        self.core() + 2 * APRON
    }

    /// Most voxels along an axis that brick keys can name: 2^23 with a core of 16, 2^26 with one of 128.
    #[must_use]
    pub const fn voxels_limit(self) -> u64 {
        BrickKey::AXIS_LIMIT as u64 * self.core as u64
    }

    /// Bricks needed for this many voxels along an axis.
    #[must_use]
    pub fn bricks_along(self, voxels: u64) -> u64 {
        voxels.div_ceil(u64::from(self.core))
    }
}
