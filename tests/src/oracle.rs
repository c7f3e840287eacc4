//! Slow implementations of the definitions: level grids, interpolation, ranges. They share no code with the tested
//! crates except the decoding of single bricks.

use supervol_format::voxel_type::{Absence, voxels_as_f64};
use supervol_format::{BrickKey, Container, Lod};

/// All voxels of one level as `f64`.
#[derive(Debug, Clone)]
pub struct Grid {
    /// Voxels along x, y, z.
    pub dims: [usize; 3],
    /// Values, x fastest.
    pub values: Vec<f64>,
    /// Rule for absent values.
    pub absence: Absence,
}

impl Grid {
    /// Reads a level from the cores of its bricks.
    ///
    /// # Panics
    /// If a brick cannot be read.
    #[must_use]
    pub fn of_level(container: &Container, lod: Lod) -> Self {
        let pyramid = container.pyramid();
        let dims = pyramid.level_at(lod).dims.0.map(|n| n as usize);
        let mut values = vec![f64::NAN; dims.iter().product()];
        for key in pyramid.keys_of(lod) {
            let brick = brick_values(container, key);
            let core = pyramid.core_box(key);
            let [sx, sy, _] = pyramid.stored_extent(key);
            let [nx, ny, nz] = core.extent();
            let start = core.start.map(|v| v as usize);
            for (z, y, x) in (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| (z, y, x)))) {
                let at = start[0] + x + dims[0] * (start[1] + y + dims[1] * (start[2] + z));
                values[at] = brick[x + 2 + sx * (y + 2 + sy * (z + 2))];
            }
        }
        Self { dims, values, absence: container.descriptor().absence }
    }

    /// The voxel at clamped indices; `None` if it is absent.
    #[must_use]
    pub fn at(&self, voxel: [i64; 3]) -> Option<f64> {
        let [x, y, z]: [usize; 3] = std::array::from_fn(|a| voxel[a].clamp(0, self.dims[a] as i64 - 1) as usize);
        let value = self.values[x + self.dims[0] * (y + self.dims[1] * z)];
        (!self.absence.is_absent(value)).then_some(value)
    }

    /// Trilinear interpolation at an index point of this level; `None` if a voxel with non-zero weight is absent.
    #[must_use]
    pub fn sample(&self, p: [f64; 3]) -> Option<f64> {
        let mut sum = 0.0;
        for corner in 0..8u8 {
            let mut weight = 1.0;
            let mut voxel = [0i64; 3];
            for a in 0..3 {
                let q = p[a].clamp(0.0, (self.dims[a] - 1) as f64);
                let share = q - q.floor();
                let upper = corner >> a & 1 == 1;
                weight *= if upper { share } else { 1.0 - share };
                voxel[a] = q.floor() as i64 + i64::from(upper);
            }
            if weight > 0.0 {
                sum += weight * self.at(voxel)?;
            }
        }
        Some(sum)
    }

    /// Least and greatest present voxel of a box (both corners included, indices clamped), and whether a voxel in it is
    /// absent.
    #[must_use]
    pub fn range(&self, first: [i64; 3], last: [i64; 3]) -> (Option<(f64, f64)>, bool) {
        let (mut range, mut holes) = (None::<(f64, f64)>, false);
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                for x in first[0]..=last[0] {
                    match self.at([x, y, z]) {
                        None => holes = true,
                        Some(v) => range = Some(range.map_or((v, v), |(low, high)| (low.min(v), high.max(v)))),
                    }
                }
            }
        }
        (range, holes)
    }

    /// Greatest magnitude of a present value.
    #[must_use]
    pub fn magnitude(&self) -> f64 {
        self.values.iter().filter(|v| !self.absence.is_absent(**v)).fold(0.0, |m, v| m.max(v.abs()))
    }
}

/// The stored voxels of a brick as `f64`.
///
/// # Panics
/// If the brick cannot be read.
#[must_use]
pub fn brick_values(container: &Container, key: BrickKey) -> Vec<f64> {
    let entry = container.entry(key).unwrap_or_else(|e| panic!("{key}: {e}"));
    let bytes = container.read_brick(key, &entry).unwrap_or_else(|e| panic!("{key}: {e}"));
    voxels_as_f64(container.descriptor().voxel_type, &bytes)
}
