//! Shape, type and order of the voxels of a grid as they lie in a file.

use supervol_format::{Dims, VoxelType};

use crate::{AccessOrder, Endian};

/// Most bytes a read holds beside the caller's buffer.
pub const SCRATCH_BYTES: usize = 1 << 20;

/// How the voxels lie in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GridLayout {
    /// Voxels along x, y, z.
    pub dims: Dims,
    /// Type of the voxels.
    pub voxel_type: VoxelType,
    /// Their byte order.
    pub endian: Endian,
    /// The axes from the fastest in the file to the slowest: `[0, 1, 2]` is x fastest, `[2, 1, 0]` z fastest.
    pub fastest_first: [usize; 3],
}

impl GridLayout {
    /// x fastest, then y, then z.
    pub const X_FASTEST: [usize; 3] = [0, 1, 2];

    /// The same order as [`SourceInfo::access_order`](crate::SourceInfo::access_order) wants it: slowest first.
    #[must_use]
    pub fn access_order(&self) -> AccessOrder {
        let [fast, middle, slow] = self.fastest_first;
        AccessOrder([slow, middle, fast])
    }
}
