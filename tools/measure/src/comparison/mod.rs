//! Methods of comparison: what most ray casters do instead, never what users get.
//!
//! They plug into the renderer's scalar caster (`supervol_runtime::engines::cells`), by [`Sampling::caster`].
//!
//! A [`Sampling`] cuts each ray at equal distances and treats every interval by one rule. Everything around it (bricks,
//! streaming, skipping, camera, clipping, scene) is the pipeline that users get, so that a difference in the picture or in
//! the time is the method's own. Interval j of a ray covers `[(j - 1 + offset) h, (j + offset) h]` from the ray's entry into
//! the clipped volume, cut to the ray's segment; h is the step. Jittered rays begin with a whole interval, and each of their
//! intervals is sampled at a place that is random: so every place is sampled with the weight that it has.

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
    /// Length of an interval, in smallest spacings of level 0.
    pub step_voxels: f64,
    /// Where intervals begin.
    pub offset: Offset,
    /// What an interval contributes.
    pub rule: Rule,
    /// When values become colours.
    pub classification: Classification,
    /// How values between voxels are made.
    pub reconstruction: Reconstruction,
    /// How gradients are made, for shading.
    pub gradient: GradientOperator,
    /// The numbers that a ray gathers in.
    pub accumulation: Accumulation,
    /// A ray ends when its opacity reaches this; above 1, never.
    pub termination_opacity: f64,
}

impl Default for Sampling {
    /// One midpoint sample per voxel of the trilinear field, gathered in doubles: the textbook's ray caster.
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
    /// The caster of a frame that is sampled this way.
    #[must_use]
    pub fn caster(self) -> Caster {
        Caster::Custom(Arc::new(self))
    }
}

/// Where intervals begin, or where in them samples lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Offset {
    /// Length of every ray's first interval, as a share of the step, in (0, 1].
    Fixed(f64),
    /// Whole intervals, each sampled at the same share of its length, whatever the rule. The share differs from pixel to
    /// pixel (interleaved gradient noise, Jimenez 2014) and from frame to frame (multiples of the golden ratio): the error
    /// becomes noise without a pattern, and its mean over frames goes to zero.
    Jittered {
        /// Number of the frame.
        frame: u32,
    },
}

/// What an interval of length h contributes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// Colour and extinction at the interval's beginning hold all along it: first order.
    LeftRiemann,
    /// Those of its middle do: second order where everything is smooth.
    Midpoint,
    /// As midpoint, but opacity is `alpha * h / unit_distance` (Levoy 1988) instead of `1 - (1 - alpha)^(h / unit_distance)`:
    /// wrong for any h but the unit distance.
    LinearOpacity,
    /// The value is linear between the interval's ends, and the transfer function is integrated exactly in between
    /// (Engel, Kraus, Ertl 2001), by prefix sums (average colour times `1 - exp(-tau)`).
    PreIntegrated,
    /// The same without attenuation inside the interval: colour `int c kappa` instead of its attenuated share.
    PreIntegratedNeglecting,
}

/// When values become colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Classification {
    /// After interpolation: what the model says.
    Post,
    /// Before it: premultiplied colours and opacities of the voxels are interpolated (only with trilinear reconstruction).
    Pre,
}

/// How values between voxels are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reconstruction {
    /// The nearest voxel.
    Nearest,
    /// Trilinear: what the model says.
    Trilinear,
    /// Trilinear with the fractions rounded to 1/256, as texture units do.
    TrilinearByteFractions,
    /// Catmull-Rom spline over 4^3 voxels; may overshoot, so that skipping must be off.
    CatmullRom,
    /// Cubic B-spline over 4^3 voxels, which must be B-spline coefficients ([`reconstruction::bspline_coefficients`]),
    /// or it blurs; skipping must be off.
    CubicBSpline,
}

/// How gradients are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GradientOperator {
    /// Central differences at the voxels, interpolated: what the model says.
    Central,
    /// Differences of the interpolated field half a voxel to both sides.
    Intermediate,
    /// Sobel's operator at the voxels (differences smoothed across by 1 2 1), interpolated.
    Sobel,
}

/// The numbers that a ray gathers colour and opacity in; rounded after every interval.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Accumulation {
    /// 64-bit floating point: what users get.
    Double,
    /// 32-bit floating point.
    Single,
    /// 16-bit floating point.
    Half,
    /// 8-bit fixed point.
    Byte,
}
