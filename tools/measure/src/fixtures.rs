//! Fixtures of the stability suite: volumes with a known right answer.
//!
//! Index space: voxel (i, j, k) is a sample at (i, j, k). All fixtures are f32 unless the caller asks for another type.
//! Values are data values. `BRICKID` is in [`crate::virtual_volume`].

use std::f64::consts::{FRAC_PI_2, TAU};

use glam::DVec3;
use supervol_format::VoxelType;
use supervol_sources::computed::Computed;

/// The Marschner-Lobb signal (Marschner and Lobb 1994), f_M = 6, alpha = 0.25, at a point of [-1, 1]^3. Range 0 to 1.
#[must_use]
pub fn marschner_lobb_at(p: DVec3) -> f64 {
    const FREQUENCY: f64 = 6.0;
    const ALPHA: f64 = 0.25;
    let radius = p.x.hypot(p.y);
    let ripples = (TAU * FREQUENCY * (FRAC_PI_2 * radius).cos()).cos();
    (1.0 - (FRAC_PI_2 * p.z).sin() + ALPHA * (1.0 + ripples)) / (2.0 * (1.0 + ALPHA))
}

/// ML: the Marschner-Lobb signal on `edge`^3 voxels; the first voxel is at -1, the last at 1.
#[must_use]
pub fn marschner_lobb(edge: u64) -> Computed {
    let scale = 2.0 / (edge - 1) as f64;
    Computed::new([edge; 3], VoxelType::F32, move |v| marschner_lobb_at(point(v) * scale - DVec3::ONE))
}

/// CONST: one value everywhere.
#[must_use]
pub fn constant(dims: [u64; 3], value: f64) -> Computed {
    Computed::new(dims, VoxelType::F32, move |_| value)
}

/// RAMP: the voxel index x.
#[must_use]
pub fn ramp(dims: [u64; 3]) -> Computed {
    Computed::new(dims, VoxelType::F32, |[x, _, _]| x as f64)
}

/// SPHERE: the distance from the centre of the grid, in voxels.
#[must_use]
pub fn sphere(edge: u64) -> Computed {
    let middle = DVec3::splat((edge - 1) as f64 / 2.0);
    Computed::new([edge; 3], VoxelType::F32, move |v| (point(v) - middle).length())
}

/// Index coordinates of a voxel.
#[must_use]
pub fn point(voxel: [u64; 3]) -> DVec3 {
    DVec3::from_array(voxel.map(|v| v as f64))
}

/// STEP: 0 in the lower half along x, 1 in the upper.
#[must_use]
pub fn step(edge: u64) -> Computed {
    Computed::new([edge; 3], VoxelType::F32, move |[x, _, _]| if x < edge / 2 { 0.0 } else { 1.0 })
}

/// Features that are one voxel wide: SHEET, LINE, POINT.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Thin {
    /// One voxel wide along x.
    Sheet,
    /// One voxel wide along x and y.
    Line,
    /// A single voxel.
    Point,
}

impl Thin {
    /// All three features.
    pub const ALL: [Self; 3] = [Self::Sheet, Self::Line, Self::Point];

    /// Name, for tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sheet => "sheet",
            Self::Line => "line",
            Self::Point => "point",
        }
    }

    /// Number of axes along which the feature is one voxel wide.
    #[must_use]
    pub fn thin_axes(self) -> usize {
        match self {
            Self::Sheet => 1,
            Self::Line => 2,
            Self::Point => 3,
        }
    }
}

/// SHEET, LINE, POINT: 1 at index `edge / 2 + 1` of the thin axes, 0 elsewhere.
#[must_use]
pub fn thin(edge: u64, thin: Thin) -> Computed {
    let (axes, at) = (thin.thin_axes(), edge / 2 + 1);
    Computed::new([edge; 3], VoxelType::F32, move |v| if v[..axes].iter().all(|&i| i == at) { 1.0 } else { 0.0 })
}

/// CHECK: alternating +1 and -1 along every axis.
#[must_use]
pub fn check(edge: u64) -> Computed {
    Computed::new([edge; 3], VoxelType::F32, |[x, y, z]| if (x + y + z).is_multiple_of(2) { 1.0 } else { -1.0 })
}

/// Smooth waves about ten voxels long, different on all three axes; range 0 to 1. A field without symmetry.
#[must_use]
pub fn waves_at(p: DVec3) -> f64 {
    let wave = (p.x * 0.61).sin() + (p.y * 0.47 + 1.0).sin() + (p.z * 0.71 + p.x * 0.2).cos();
    0.5 + wave / 6.0
}
