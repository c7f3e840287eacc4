//! Methods of comparison: integration methods of other ray casters, never used by default.
//!
//! They plug into the renderer's scalar caster (`supervol_runtime::engines::cells`) by [`Sampling::caster`].
//!
//! A [`Sampling`] cuts each ray at equal distances and integrates each interval by one rule. All other parts (bricks,
//! streaming, skipping, camera, clipping, scene) are those of the default. Only the method changes picture or time.
//!
//! Interval j of a ray covers `[(j - 1 + offset) h, (j + offset) h]` from the ray's entry into the clipped volume; h is
//! the step. It is cut to the ray's segment. Jittered rays begin with a whole interval and sample each interval at a
//! random position. Every position then has its right weight.

pub mod gradient;
pub mod preintegration;
mod probe;
pub mod reconstruction;
mod sampled;

use std::sync::Arc;

use supervol_runtime::engines::cpu::Caster;
use supervol_runtime::engines::rules::TERMINATION_OPACITY;

/// Sampling at equal distances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampling {
    /// Length of an interval, in smallest voxel spacings of level 0.
    pub step_voxels: f64,
    /// Offset of the first interval, or jitter.
    pub offset: Offset,
    /// Rule of integration of an interval.
    pub rule: Rule,
    /// Order of classification and interpolation.
    pub classification: Classification,
    /// Reconstruction of values between voxels.
    pub reconstruction: Reconstruction,
    /// Gradient operator for shading.
    pub gradient: GradientOperator,
    /// Number format of the sums along a ray.
    pub accumulation: Accumulation,
    /// Opacity at which a ray ends; above 1: never.
    pub termination_opacity: f64,
}

impl Default for Sampling {
    /// Classic ray caster: one midpoint sample per voxel of the trilinear field, sums in `f64`.
    fn default() -> Self {
        Self {
            step_voxels: 1.0,
            offset: Offset::Fixed(1.0),
            rule: Rule::Midpoint,
            classification: Classification::Post,
            reconstruction: Reconstruction::Trilinear,
            gradient: GradientOperator::Central,
            accumulation: Accumulation::Double,
            termination_opacity: TERMINATION_OPACITY,
        }
    }
}

impl Sampling {
    /// A caster that samples in this way.
    #[must_use]
    pub fn caster(self) -> Caster {
        Caster::Custom(Arc::new(self))
    }
}

/// Offset of the first interval, or jitter inside the intervals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Offset {
    /// Length of the first interval of every ray, as a fraction of the step, in (0, 1].
    Fixed(f64),
    /// Whole intervals, each sampled at the same fraction of its length, for every rule. The fraction differs from
    /// pixel to pixel (interleaved gradient noise, Jimenez 2014) and from frame to frame (multiples of the golden
    /// ratio). The error becomes noise without a pattern; its mean over frames goes to zero.
    Jittered {
        /// Number of the frame.
        frame: u32,
    },
}

/// Contribution of an interval of length h.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Colour and extinction at the start of the interval are used for all of it: first order.
    LeftRiemann,
    /// Colour and extinction at the midpoint are used: second order for smooth fields.
    Midpoint,
    /// Like midpoint, but with opacity `alpha * h / unit_distance` (Levoy 1988) instead of
    /// `1 - (1 - alpha)^(h / unit_distance)`. Wrong for any h except the unit distance.
    LinearOpacity,
    /// The value is linear between the interval's ends. The transfer function is integrated exactly over it (Engel,
    /// Kraus, Ertl 2001), by prefix sums: average colour times `1 - exp(-tau)`.
    PreIntegrated,
    /// Like `PreIntegrated`, but without attenuation inside the interval: the colour is `int c kappa`.
    PreIntegratedNeglecting,
}

/// Order of classification and interpolation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Classification {
    /// After interpolation, as the rendering model requires.
    Post,
    /// Before interpolation: premultiplied colours and opacities of voxels are interpolated. Only trilinear.
    Pre,
}

/// Reconstruction of values between voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reconstruction {
    /// The nearest voxel.
    Nearest,
    /// Trilinear, as the rendering model requires.
    Trilinear,
    /// Trilinear with fractions rounded to 1/256, as in texture units.
    TrilinearByteFractions,
    /// Catmull-Rom spline over 4^3 voxels. It may overshoot, so skipping must be off.
    CatmullRom,
    /// Cubic B-spline over 4^3 voxels. Skipping must be off. Without B-spline coefficients as voxels
    /// ([`reconstruction::bspline_coefficients`]) it blurs.
    CubicBSpline,
}

/// Gradient operator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GradientOperator {
    /// Central differences at the voxels, interpolated, as the rendering model requires.
    Central,
    /// Differences of the interpolated field, half a voxel to either side.
    Intermediate,
    /// Sobel's operator at the voxels (differences smoothed across by 1 2 1), interpolated.
    Sobel,
}

/// Number format of a ray's colour and opacity sums, rounded after each interval.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Accumulation {
    /// 64-bit floating point: the default.
    Double,
    /// 32-bit floating point.
    Single,
    /// 16-bit floating point.
    Half,
    /// 8-bit fixed point.
    Byte,
}
