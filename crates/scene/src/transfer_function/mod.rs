//! Transfer functions: maps from data values to colour and opacity (RENDERING-MODEL, section 3).
//!
//! [`TransferFunction`] is the definition, in `f64` and data units. [`RenderTransferFunction`] is the same function in
//! `f32` and render values, with tables for the frequent queries of ray casters. Colours are display-referred, channels
//! in [0, 1]. `alpha` is the opacity over the unit distance.

pub mod edges;
mod fit;
pub mod intervals;
pub mod pieces;
pub mod render;

use crate::units::Units;
pub use intervals::Intervals;
pub use render::RenderTransferFunction;

/// Greatest effective opacity: an alpha of 1 would need an infinite extinction.
pub const ALPHA_LIMIT: f64 = 0.9999;
/// Most control points of one transfer function.
pub const POINT_LIMIT: usize = 4096;

/// A coarse level loses visible detail if its mean extinction is below this share of that of the finest level.
const LOST_SHARE: f64 = 0.25;

/// One control point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControlPoint {
    /// Data value.
    pub value: f64,
    /// Colour, each channel in [0, 1].
    pub color: [f64; 3],
    /// Opacity over the unit distance, in [0, 1].
    pub alpha: f64,
}

/// Piecewise linear function of the value; constant outside its points.
///
/// Two points at one value make a step: the later one holds at that value.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferFunction {
    points: Vec<ControlPoint>,
    unit_distance: f64,
    /// Values of iso surfaces inside the volume; they are visible whatever their opacity.
    surfaces: Vec<f64>,
}

/// Reason why points define no transfer function.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum TransferFunctionError {
    #[error("{found} points; expected 1 to {POINT_LIMIT}")]
    PointCount { found: usize },
    #[error("points[{index}].value is {found}; expected a finite number, not less than the point before")]
    Order { index: usize, found: f64 },
    #[error("points[{index}].color is {found:?}; expected three numbers between 0 and 1")]
    Color { index: usize, found: [f64; 3] },
    #[error("points[{index}].alpha is {found}; expected a number between 0 and 1")]
    Alpha { index: usize, found: f64 },
    #[error("unit_distance is {found}; expected a positive finite world length")]
    UnitDistance { found: f64 },
}

impl TransferFunction {
    /// A transfer function of control points sorted by value; `unit_distance` is a world length.
    ///
    /// # Errors
    /// If there are no points or too many, they are not sorted, or a number is out of range.
    pub fn new(points: Vec<ControlPoint>, unit_distance: f64) -> Result<Self, TransferFunctionError> {
        if points.is_empty() || points.len() > POINT_LIMIT {
            return Err(TransferFunctionError::PointCount { found: points.len() });
        }
        let mut previous = f64::NEG_INFINITY;
        for (index, point) in points.iter().enumerate() {
            if !point.value.is_finite() || point.value < previous {
                return Err(TransferFunctionError::Order { index, found: point.value });
            }
            if point.color.iter().any(|c| !(0.0..=1.0).contains(c)) {
                return Err(TransferFunctionError::Color { index, found: point.color });
            }
            if !(0.0..=1.0).contains(&point.alpha) {
                return Err(TransferFunctionError::Alpha { index, found: point.alpha });
            }
            previous = point.value;
        }
        if !(unit_distance.is_finite() && unit_distance > 0.0) {
            return Err(TransferFunctionError::UnitDistance { found: unit_distance });
        }
        Ok(Self { points, unit_distance, surfaces: Vec::new() })
    }

    /// The same function in units of a volume. The unit distance must not overflow there.
    #[must_use]
    pub fn in_units(&self, units: &Units) -> Self {
        let points = self.points.iter().map(|&point| ControlPoint { value: units.value(point.value), ..point });
        let surfaces = self.surfaces.iter().map(|&value| units.value(value)).collect();
        Self { points: points.collect(), unit_distance: self.unit_distance / units.length, surfaces }
    }

    /// The same function for a volume with iso surfaces at these values. A region that holds one of them is never
    /// skipped as invisible.
    #[must_use]
    pub fn with_surfaces(self, surfaces: Vec<f64>) -> Self {
        Self { surfaces, ..self }
    }

    /// The same function without iso surfaces.
    #[must_use]
    pub fn without_surfaces(&self) -> Self {
        self.clone().with_surfaces(Vec::new())
    }

    /// Values of iso surfaces, which are visible whatever their opacity.
    #[must_use]
    pub fn surfaces(&self) -> &[f64] {
        &self.surfaces
    }

    /// The control points, sorted by value.
    #[must_use]
    pub fn points(&self) -> &[ControlPoint] {
        &self.points
    }

    /// World length over which `alpha` is the opacity.
    #[must_use]
    pub fn unit_distance(&self) -> f64 {
        self.unit_distance
    }

    /// Colour and opacity at a value.
    #[must_use]
    pub fn classify(&self, value: f64) -> ([f64; 3], f64) {
        let next = self.points.partition_point(|p| p.value <= value);
        let Some(before) = next.checked_sub(1).map(|i| self.points[i]) else {
            return (self.points[0].color, self.points[0].alpha);
        };
        let Some(after) = self.points.get(next) else {
            return (before.color, before.alpha);
        };
        let x = (value - before.value) / (after.value - before.value);
        let mix = |a: f64, b: f64| a + x * (b - a);
        (std::array::from_fn(|c| mix(before.color[c], after.color[c])), mix(before.alpha, after.alpha))
    }

    /// Whether the voxels of a coarse level show less than a quarter of the extinction of the fine voxels that they
    /// average. `coarse` holds values; `fine` holds values with their shares.
    #[must_use]
    pub fn loses(&self, coarse: &[f64], fine: impl Iterator<Item = (f64, f64)>) -> bool {
        let kappa = |value: f64| self.kappa(self.classify(value).1);
        let of_fine: f64 = fine.map(|(value, share)| share * kappa(value)).sum();
        let present = || coarse.iter().filter(|value| !value.is_nan());
        let (count, least) = (present().count() as f64, LOST_SHARE * of_fine);
        // Extinction is never negative: once the sum suffices it stays sufficient, usually after a quarter of the
        // voxels.
        let mut of_coarse = 0.0;
        for value in present() {
            of_coarse += kappa(*value);
            if of_coarse / count >= least {
                return false;
            }
        }
        of_coarse / count < least
    }

    /// Extinction per world length of an opacity: `-ln(1 - min(alpha, 0.9999)) / unit_distance`.
    #[must_use]
    pub fn kappa(&self, alpha: f64) -> f64 {
        -(-alpha.min(ALPHA_LIMIT)).ln_1p() / self.unit_distance
    }
}

/// The opacity of an extinction that is multiplied by a positive factor: `1 - (1 - alpha)^factor`. For factors below 1,
/// alpha is limited to [`ALPHA_LIMIT`], as extinctions are: a share of an infinite extinction would be infinite.
#[must_use]
pub fn times_extinction(alpha: f64, factor: f64) -> f64 {
    let alpha = if factor < 1.0 { alpha.min(ALPHA_LIMIT) } else { alpha };
    1.0 - (1.0 - alpha).powf(factor)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(value: f64, alpha: f64) -> ControlPoint {
        ControlPoint { value, color: [alpha, 0.5, 1.0 - alpha], alpha }
    }

    #[test]
    fn averages_lose_what_only_extremes_show() {
        let ends = [point(0.0, 0.5), point(1.0, 0.0), point(9.0, 0.0), point(10.0, 0.5)];
        let function = TransferFunction::new(ends.to_vec(), 1.0).expect("it is valid");
        let fine = [(0.0, 0.5), (10.0, 0.5)];
        assert!(function.loses(&[5.0, f64::NAN, 5.0], fine.into_iter()));
        assert!(!function.loses(&[0.2, 9.8], fine.into_iter()));
        assert!(!function.loses(&[], fine.into_iter()) && !function.loses(&[f64::NAN], fine.into_iter()));
    }

    #[test]
    fn linear_between_points_constant_outside() {
        let tf = TransferFunction::new(vec![point(1.0, 0.2), point(3.0, 0.8)], 1.0).unwrap();
        assert_eq!(tf.classify(-9.0).1, 0.2);
        assert_eq!(tf.classify(9.0).1, 0.8);
        assert!((tf.classify(2.0).1 - 0.5).abs() < 1e-15);
        assert!((tf.classify(1.5).0[2] - 0.65).abs() < 1e-15);
    }

    #[test]
    fn the_right_side_of_a_step_holds_at_its_value() {
        let tf = TransferFunction::new(vec![point(0.0, 0.1), point(1.0, 0.1), point(1.0, 0.9)], 1.0).unwrap();
        assert_eq!(tf.classify(1.0).1, 0.9);
        assert_eq!(tf.classify(1.0 - 1e-12).1, 0.1);
    }

    #[test]
    fn extinction_gives_its_opacity_back_over_the_unit_distance() {
        let tf = TransferFunction::new(vec![point(0.0, 0.1)], 2.5).unwrap();
        for alpha in [1e-9, 1e-4, 0.1, 0.9, 0.9999] {
            let back = -(-tf.kappa(alpha) * 2.5).exp_m1();
            assert!((back / alpha - 1.0).abs() < 1e-12);
        }
        assert_eq!(tf.kappa(1.0), tf.kappa(ALPHA_LIMIT));
    }

    #[test]
    fn opacities_follow_a_multiplied_extinction() {
        let tf = TransferFunction::new(vec![point(0.0, 0.1)], 2.5).unwrap();
        for (alpha, factor) in [(0.3, 0.5), (0.3, 7.0), (1.0, 0.001), (1.0, 0.5), (0.99999, 0.01), (1e-6, 0.1)] {
            let found = tf.kappa(times_extinction(alpha, factor));
            let expected = (factor * tf.kappa(alpha)).min(tf.kappa(1.0));
            assert!((found / expected - 1.0).abs() < 1e-8, "{alpha} times {factor}: {found}, expected {expected}");
        }
        assert_eq!([times_extinction(1.0, 2.0), times_extinction(0.0, 0.5)], [1.0, 0.0]);
    }
}
