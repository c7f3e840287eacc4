//! Shape, type and order of the voxels of a grid in a file.

use supervol_format::{Dims, VoxelType};

use crate::{AccessOrder, Endian};

/// Largest memory of a read in bytes, besides the caller's buffer.
pub const SCRATCH_BYTES: usize = 1 << 20;

/// Arrangement of the voxels in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GridLayout {
    /// Number of voxels along x, y, z.
    pub dims: Dims,
    /// Type of the voxels.
    pub voxel_type: VoxelType,
    /// Byte order of the voxels.
    pub endian: Endian,
    /// Order of the axes in the file, fastest first: `[0, 1, 2]` is x fastest, `[2, 1, 0]` z fastest.
    pub fastest_first: [usize; 3],
}

impl GridLayout {
    /// x fastest, then y, then z.
    pub const X_FASTEST: [usize; 3] = [0, 1, 2];

    /// The order of the axes for [`SourceInfo::access_order`](crate::SourceInfo::access_order), slowest first.
    #[must_use]
    pub fn access_order(&self) -> AccessOrder {
        let [fast, middle, slow] = self.fastest_first;
        AccessOrder([slow, middle, fast])
    }
}
