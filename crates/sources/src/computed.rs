//! A volume computed voxel by voxel from a function of its coordinates, for fixtures, demonstrations and experiments.
//!
//! [`super::synthetic`] holds the named, fast volumes of the command line; this module serves everything else. The
//! function returns stored values, which are rounded to the voxel type.

use supervol_format::voxel_type::Voxel;
use supervol_format::{Dims, VoxelBox, VoxelType, with_voxel};

use super::{SourceError, SourceInfo, VolumeSource};

type Value = Box<dyn Fn([u64; 3]) -> f64 + Send + Sync>;

/// Volume computed from a function, see the module head.
pub struct Computed {
    info: SourceInfo,
    value: Value,
}

impl std::fmt::Debug for Computed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Computed").field("info", &self.info).finish_non_exhaustive()
    }
}

impl Computed {
    /// Volume whose voxel `[i, j, k]` has the stored value `value([i, j, k])`.
    #[must_use]
    pub fn new(dims: [u64; 3], voxel_type: VoxelType, value: impl Fn([u64; 3]) -> f64 + Send + Sync + 'static) -> Self {
        Self { info: SourceInfo::plain("synth", Dims(dims), voxel_type), value: Box::new(value) }
    }

    /// The same volume with another description: spacing, scale, nodata, ... `change` must not change the dims or the
    /// voxel type.
    #[must_use]
    pub fn with_info(mut self, change: impl FnOnce(&mut SourceInfo)) -> Self {
        change(&mut self.info);
        self
    }
}

impl VolumeSource for Computed {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let [nx, ny, _] = voxels.extent();
        with_voxel!(self.info.voxel_type, V => {
            for (i, target) in out.chunks_exact_mut(size_of::<V>()).enumerate() {
                let local = [i % nx, i / nx % ny, i / nx / ny];
                let value = (self.value)(std::array::from_fn(|a| voxels.start[a] + local[a] as u64));
                V::from_f64(value).write_le(target);
            }
        });
        Ok(())
    }
}
