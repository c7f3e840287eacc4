//! A box of voxels in memory.

use supervol_format::VoxelBox;

/// Values of a box of one level, x contiguous, then y, then z.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    voxels: VoxelBox,
    shape: [usize; 3],
    values: Vec<f64>,
}

impl Array {
    pub(crate) fn new(voxels: VoxelBox, values: Vec<f64>) -> Self {
        Self { voxels, shape: voxels.extent(), values }
    }

    /// The box of the level that the array holds; ends are not included.
    #[must_use]
    pub fn voxels(&self) -> VoxelBox {
        self.voxels
    }

    /// Voxels along x, y and z.
    #[must_use]
    pub fn shape(&self) -> [usize; 3] {
        self.shape
    }

    /// All values in data units, x contiguous; NaN where a voxel is absent.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// All values, without a copy.
    #[must_use]
    pub fn into_values(self) -> Vec<f64> {
        self.values
    }

    /// The value at `[x, y, z]`, counted from the first voxel of the box; `None` outside of it.
    #[must_use]
    pub fn get(&self, place: [usize; 3]) -> Option<f64> {
        let is_inside = (0..3).all(|axis| place[axis] < self.shape[axis]);
        is_inside.then(|| self.values[place[0] + self.shape[0] * (place[1] + self.shape[1] * place[2])])
    }
}
