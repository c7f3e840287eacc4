//! Description of a headerless file by the user.

use supervol_format::{Dims, Geometry, VoxelType};

use crate::Endian;

/// Properties that a raw file does not state itself.
#[derive(Debug, Clone, PartialEq)]
pub struct RawOptions {
    /// Number of voxels along x, y, z.
    pub dims: Dims,
    /// Type of the voxels.
    pub voxel_type: VoxelType,
    /// Byte order of the voxels.
    pub endian: Endian,
    /// Bytes before the first voxel.
    pub header_bytes: u64,
    /// Placement of the grid in the world.
    pub geometry: Geometry,
    /// Stored value that means "no data".
    pub nodata: Option<f64>,
}

impl RawOptions {
    /// Options that determine the voxel values. Containers store the geometry anyway.
    pub(super) fn describe(&self) -> Vec<(&'static str, String)> {
        let [nx, ny, nz] = self.dims.0;
        let said = [
            ("dims", format!("{nx},{ny},{nz}")),
            ("dtype", self.voxel_type.to_string()),
            ("endian", self.endian.name().into()),
            ("offset", self.header_bytes.to_string()),
        ];
        said.into_iter().chain(self.nodata.map(|value| ("nodata", value.to_string()))).collect()
    }
}
