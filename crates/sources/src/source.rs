//! The trait behind which every volume file stands.

use supervol_format::VoxelBox;

use crate::error::SourceError;
use crate::info::SourceInfo;

/// A volume that can be read box by box.
pub trait VolumeSource: Send + Sync {
    /// What the source says about itself; constant.
    fn info(&self) -> &SourceInfo;

    /// Fills `out` with the voxels of `voxels`, little endian, packed, x fastest.
    ///
    /// # Errors
    /// If the file cannot be read, or holds something its header does not allow.
    ///
    /// # Panics
    /// If the box is not inside the grid or `out` has not exactly the box's bytes: both are the caller's mistakes.
    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError>;
}
