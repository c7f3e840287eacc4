//! The trait that every reader implements.

use supervol_format::VoxelBox;

use crate::error::SourceError;
use crate::info::SourceInfo;

/// A volume that can be read box by box.
pub trait VolumeSource: Send + Sync {
    /// Description of the volume; constant.
    fn info(&self) -> &SourceInfo;

    /// Fills `out` with the voxels of `voxels`, little endian, packed, x fastest.
    ///
    /// # Errors
    /// If the file cannot be read, or its content contradicts its header.
    ///
    /// # Panics
    /// If the box is not inside the grid, or `out` does not have exactly the bytes of the box.
    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError>;
}
