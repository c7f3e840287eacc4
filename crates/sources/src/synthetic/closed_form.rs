//! Fields given by a formula: Marschner-Lobb, sphere, ramp, constant. Computed in doubles, row by row.
//!
//! Each field is the sum of a part that depends on (x, y), computed once per column, and a part that depends on z.

use std::f64::consts::{FRAC_PI_2, TAU};

use supervol_format::{Dims, VoxelType};

use super::target::{CHUNK_VOXELS, Scale, Target};

/// Frequency of the ripples of the Marschner-Lobb signal, f_M.
const MARSCHNER_LOBB_FREQUENCY: f64 = 6.0;

/// Weight of the ripples, alpha.
const MARSCHNER_LOBB_ALPHA: f64 = 0.25;

/// Value of the constant field, in stored units of every type.
const CONSTANT: f64 = 100.0;

#[derive(Debug, Clone, PartialEq)]
pub(super) enum ClosedForm {
    /// Index points map to [-1, 1]: `a = index * scale - 1`.
    MarschnerLobb { scale: [f64; 3] },
    /// Centre and radius in voxels.
    Sphere { centre: [f64; 3], radius: f64 },
    /// Stored value per voxel along x.
    Ramp { slope: f64 },
    /// The same value everywhere.
    Constant,
}

impl ClosedForm {
    /// The first and last voxel of each axis map to -1 and 1; an axis of one voxel maps to 0.
    pub(super) fn marschner_lobb(dims: Dims) -> Self {
        Self::MarschnerLobb { scale: dims.0.map(|n| if n > 1 { 2.0 / (n - 1) as f64 } else { f64::INFINITY }) }
    }

    /// A centred sphere; its radius is a quarter of the shortest axis with more than one voxel.
    pub(super) fn sphere(dims: Dims) -> Self {
        let shortest = dims.0.into_iter().filter(|n| *n > 1).min().unwrap_or(1);
        Self::Sphere { centre: dims.0.map(|n| (n - 1) as f64 / 2.0), radius: shortest as f64 / 4.0 }
    }

    pub(super) fn ramp(dims: Dims, voxel_type: VoxelType) -> Self {
        let (last, greatest) = ((dims.0[0] - 1) as f64, voxel_type.limits().1);
        Self::Ramp { slope: if last > greatest { greatest / last } else { 1.0 } }
    }

    pub(super) fn fill(&self, target: &mut Target<'_>) {
        let scale = match self {
            Self::MarschnerLobb { .. } | Self::Sphere { .. } => Scale::unit(target.voxel_type),
            Self::Ramp { .. } | Self::Constant => Scale { gain: 1.0, bias: 0.0 },
        };
        let (voxels, voxel_type) = (target.voxels, target.voxel_type);
        let (mut columns, mut values) = ([0.0; CHUNK_VOXELS], [0.0; CHUNK_VOXELS]);
        for (x, length) in target.chunks() {
            let (columns, values) = (&mut columns[..length], &mut values[..length]);
            for y in voxels.start[1]..voxels.end[1] {
                for (column, x) in columns.iter_mut().zip(x..) {
                    *column = self.column(x as f64, y as f64);
                }
                for z in voxels.start[2]..voxels.end[2] {
                    self.add_z(z as f64, columns, values);
                    scale.write(values, voxel_type, target.row([x, y, z], length));
                }
            }
        }
    }

    /// The part of the field that depends on (x, y).
    fn column(&self, x: f64, y: f64) -> f64 {
        match self {
            // alpha (1 + rho_r(sqrt(x^2 + y^2))) / (2 (1 + alpha)), rho_r(r) = cos(2 pi f_M cos(pi r / 2))
            // (Marschner, Lobb 1994, "An Evaluation of Reconstruction Filters for Volume Rendering", eq. 3 and 4).
            Self::MarschnerLobb { scale } => {
                let (x, y) = (on_unit_cube(x, scale[0]), on_unit_cube(y, scale[1]));
                let ripple = (TAU * MARSCHNER_LOBB_FREQUENCY * (FRAC_PI_2 * (x * x + y * y).sqrt()).cos()).cos();
                MARSCHNER_LOBB_ALPHA * (1.0 + ripple) / (2.0 * (1.0 + MARSCHNER_LOBB_ALPHA))
            }
            Self::Sphere { centre, .. } => (x - centre[0]).powi(2) + (y - centre[1]).powi(2),
            Self::Ramp { slope } => x * slope,
            Self::Constant => CONSTANT,
        }
    }

    /// Computes the values of a row from the parts of its columns.
    fn add_z(&self, z: f64, columns: &[f64], values: &mut [f64]) {
        match self {
            // (1 - sin(pi z / 2)) / (2 (1 + alpha)) plus the column's part.
            Self::MarschnerLobb { scale } => {
                let z = on_unit_cube(z, scale[2]);
                let along_z = (1.0 - (FRAC_PI_2 * z).sin()) / (2.0 * (1.0 + MARSCHNER_LOBB_ALPHA));
                values.iter_mut().zip(columns).for_each(|(value, column)| *value = along_z + column);
            }
            Self::Sphere { centre, radius } => {
                let z_squared = (z - centre[2]).powi(2);
                for (value, column) in values.iter_mut().zip(columns) {
                    *value = (1.0 - (column + z_squared).sqrt() / (2.0 * radius)).max(0.0);
                }
            }
            Self::Ramp { .. } | Self::Constant => values.copy_from_slice(columns),
        }
    }
}

/// Maps an index to [-1, 1]. An infinite scale marks an axis of one voxel, which maps to 0.
fn on_unit_cube(index: f64, scale: f64) -> f64 {
    if scale.is_finite() { index * scale - 1.0 } else { 0.0 }
}
