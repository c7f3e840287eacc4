//! Slices: planes inside the picture, opaque or semi-transparent, at their exact depth
//! (docs/decisions/019-slices-cut-rays.md).
//!
//! A ray is cut at its crossing with a slice. Compositing order: the part before the slice, the slice, the part behind
//! it. A slice shows the volume's value on the plane: `nearest`, `linear` (as in the model) or `cubic` (Catmull and Rom
//! 1974, along each axis). Optionally an image filter is applied to the values on the plane ([`filter`]). Slices have
//! colours of their own. A slice has no pixel where the value is absent or clipped. Mode `slice` draws only slices.
//! Modes `mip`, `minip` and `mean` have no depth and draw none.

pub mod filter;
mod texels;

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use supervol_format::cast::{narrow, single, whole};

use crate::camera::Ray;
use crate::clip::Segment;
use crate::preset::colormap;
use crate::transfer_function::TransferFunction;
use filter::FilterSpec;

/// Most slices of one scene; each cuts every ray of a picture.
pub const SLICE_LIMIT: usize = 8;
/// A slice within this share of a segment's end lies on the end. A box that is cut exactly at a slice then shows the
/// slice.
const END_SHARE: f64 = 1e-9;

/// Slice: a plane that shows the values on it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SliceSpec {
    /// World direction: the slice is all points p with normal . p = offset.
    pub normal: [f64; 3],
    /// World length times the normal's length.
    pub offset: f64,
    /// Opacity, in [0, 1].
    #[serde(default = "opaque")]
    pub opacity: f64,
    /// Interpolation between voxels.
    #[serde(default)]
    pub interpolation: Interpolation,
    /// Image filter of the values on the plane; if missing, none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub filter: Option<FilterSpec>,
    /// Colours in ascending order of value, linear between; if empty, chosen for the kind of data or the filter.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub colors: Vec<ColorSpec>,
    /// Whether values are numbers of labels: each whole number has a colour of its own, and 0 is clear. Then `colors` has
    /// no effect.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub labels: bool,
}

fn opaque() -> f64 {
    1.0
}

/// Colour of a value on a slice.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ColorSpec {
    /// Data value, or result of the filter.
    pub value: f64,
    /// Colour, each channel in [0, 1].
    pub color: [f64; 3],
}

/// Interpolation between voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Interpolation {
    /// Value of the nearest voxel.
    Nearest,
    /// Linear along each axis, as in volumes.
    #[default]
    Linear,
    /// Cubic along each axis, through the values of the voxels.
    Cubic,
}

/// The label that single precision may have rounded to `value`: the nearest known one.
fn exact_label(value: f64, known: &[f64]) -> f64 {
    let after = known.partition_point(|label| *label < value);
    let nearest = known[after.saturating_sub(1).min(known.len())..].iter().take(2);
    let nearest = nearest.min_by(|a, b| (**a - value).abs().total_cmp(&(**b - value).abs()));
    nearest.copied().unwrap_or_else(|| f64::from(single(value)))
}

/// A slice in the units of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct SlicePlane {
    /// World direction; not zero, any length.
    pub normal: DVec3,
    /// The slice is the set of points p with `normal . p = offset`.
    pub offset: f64,
    /// Opacity in [0, 1].
    pub opacity: f64,
    /// Interpolation between voxels.
    pub interpolation: Interpolation,
    /// Image filter that is applied to the values on the plane.
    pub filter: Option<FilterSpec>,
    /// Colours; `None`: default colours of the filter.
    pub colors: Option<SliceColors>,
}

/// Colours of a slice.
#[derive(Debug, Clone, PartialEq)]
pub enum SliceColors {
    /// Colours over values in units, opaque.
    Values(TransferFunction),
    /// Each label has a colour of its own.
    Labels {
        /// Data value of one unit.
        unit: f64,
        /// The labels that occur, ascending; empty if they are not known.
        known: Vec<f64>,
    },
}

impl SliceColors {
    /// The colour of a value in units; `None` where the slice is clear.
    #[must_use]
    pub fn color(&self, value: f64) -> Option<[f64; 3]> {
        match self {
            Self::Values(colors) => Some(colors.classify(value).0),
            Self::Labels { unit, known } => {
                let number = whole::<i64>(exact_label(value * unit, known).round()).unsigned_abs();
                (number != 0).then(|| colormap::of_label(number))
            }
        }
    }
}

impl SlicePlane {
    /// The ray parameter t of the crossing; `None` if the ray is parallel to the slice.
    #[must_use]
    pub fn crossing(&self, ray: &Ray) -> Option<f64> {
        let rate = self.normal.dot(ray.direction);
        let t = (self.offset - self.normal.dot(ray.origin)) / rate;
        (rate != 0.0 && t.is_finite()).then_some(t)
    }

    /// Whether a point lies on the side that the normal points to.
    #[must_use]
    pub fn is_before(&self, p: DVec3) -> bool {
        self.normal.dot(p) > self.offset
    }
}

/// Crossings of a ray's segment with slices: t and index of the slice, front to back.
#[must_use]
pub fn crossings(slices: &[SlicePlane], ray: &Ray, segment: Segment) -> Vec<(f64, usize)> {
    let room = END_SHARE * segment.t0.abs().max(segment.t1.abs());
    let within = |t: &f64| (segment.t0 - room..=segment.t1 + room).contains(t);
    let at = |(number, slice): (usize, &SlicePlane)| {
        let t = slice.crossing(ray).filter(within)?;
        Some((t.clamp(segment.t0, segment.t1), number))
    };
    let mut found: Vec<(f64, usize)> = slices.iter().enumerate().filter_map(at).collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found
}

/// The value at an index point; NaN if a voxel with a non-zero weight is absent. `voxel` gives the value at a voxel
/// index. It must clamp indices, which may lie up to two voxels outside the grid.
#[must_use]
pub fn interpolate(p: [f64; 3], how: Interpolation, voxel: impl Fn([i64; 3]) -> f64) -> f64 {
    match how {
        Interpolation::Nearest => voxel(p.map(|x| whole::<i64>((x + 0.5).floor()))),
        Interpolation::Linear => weighted::<2>(p, 0, |x| [1.0 - x, x], &voxel),
        Interpolation::Cubic => {
            let cubic = weighted::<4>(p, -1, catmull_rom, &voxel);
            // Beside an absent voxel there is no cubic interpolation, but there may be a linear one.
            if cubic.is_nan() { interpolate(p, Interpolation::Linear, voxel) } else { cubic }
        }
    }
}

/// Weighted sum over `N` voxels along each axis; the first lies `first` voxels after the cell's corner.
fn weighted<const N: usize>(
    p: [f64; 3],
    first: i64,
    weights: impl Fn(f64) -> [f64; N],
    voxel: &impl Fn([i64; 3]) -> f64,
) -> f64 {
    let cell = p.map(f64::floor);
    let along: [[f64; N]; 3] = std::array::from_fn(|a| weights(p[a] - cell[a]));
    let [x, y, z] = cell.map(|c| whole::<i64>(c) + first);
    let mut sum = 0.0;
    for k in 0..N {
        for j in 0..N {
            let across = along[1][j] * along[2][k];
            for (i, weight) in along[0].iter().enumerate() {
                let weight = weight * across;
                if weight != 0.0 {
                    sum += weight * voxel([x + narrow::<i64>(i), y + narrow::<i64>(j), z + narrow::<i64>(k)]);
                }
            }
        }
    }
    sum
}

/// Weights of four consecutive points for a position at `x` in [0, 1] between the second and the third: Catmull and Rom
/// 1974. Tangents are half the difference of the neighbours.
fn catmull_rom(x: f64) -> [f64; 4] {
    let [x2, x3] = [x * x, x * x * x];
    [0.5 * (-x3 + 2.0 * x2 - x), 0.5 * (3.0 * x3 - 5.0 * x2 + 2.0), 0.5 * (-3.0 * x3 + 4.0 * x2 + x), 0.5 * (x3 - x2)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_between_voxels_are_those_of_the_field() {
        let field = |[x, y, z]: [f64; 3]| 2.0 * x - 3.0 * y + 0.5 * z * z + x * y;
        let voxel = |index: [i64; 3]| field(index.map(|i| i as f64));
        let p = [3.25, 4.5, 2.75];
        assert_eq!(interpolate(p, Interpolation::Nearest, voxel), field([3.0, 5.0, 3.0]));
        // Linear along z only between voxels, exact along x and y; cubic is exact for squares.
        let on_planes = [3.25, 4.5, 3.0];
        assert!((interpolate(on_planes, Interpolation::Linear, voxel) - field(on_planes)).abs() < 1e-12);
        assert!((interpolate(p, Interpolation::Linear, voxel) - field(p)).abs() > 0.01);
        assert!((interpolate(p, Interpolation::Cubic, voxel) - field(p)).abs() < 1e-12);
        // Beside an absent voxel there is no cubic interpolation, but a linear one.
        let holed = |index: [i64; 3]| if index[0] >= 5 { f64::NAN } else { voxel(index) };
        assert_eq!(interpolate(p, Interpolation::Cubic, holed), interpolate(p, Interpolation::Linear, voxel));
        let beside = [4.25, 4.5, 2.75];
        assert!(interpolate(beside, Interpolation::Cubic, holed).is_nan());
    }

    #[test]
    fn labels_that_single_precision_rounds_keep_their_colours() {
        let known = [0.0, 5.0, 17.0, 30.0, 1_163_580_131.0, 2_143_948_897.0];
        let colors = SliceColors::Labels { unit: 2.0, known: known.to_vec() };
        for label in known {
            let rounded = f64::from(single(label / 2.0));
            let expected = (label != 0.0).then(|| colormap::of_label(whole::<u64>(label)));
            assert_eq!(colors.color(rounded), expected, "{label}");
        }
        let unknown = SliceColors::Labels { unit: 1.0, known: Vec::new() };
        assert_eq!(unknown.color(f64::from(single(1_163_580_131.0))), unknown.color(1_163_580_131.0));
        assert_eq!(unknown.color(0.0), None);
    }

    #[test]
    fn a_ray_is_cut_front_to_back_and_at_the_ends_too() {
        let plane = |normal: [f64; 3], offset: f64| SlicePlane {
            normal: normal.into(),
            offset,
            opacity: 1.0,
            interpolation: Interpolation::Linear,
            filter: None,
            colors: None,
        };
        let slices = [
            plane([2.0, 0.0, 0.0], 12.0),
            plane([0.0, 1.0, 0.0], 3.0),
            plane([-1.0, 0.0, 0.0], -4.0),
            plane([1.0, 0.0, 0.0], 9.0),
        ];
        let ray = Ray { origin: DVec3::ZERO, direction: DVec3::X, t_min: 0.0 };
        let cut = |t0, t1| crossings(&slices, &ray, Segment { t0, t1 });
        assert_eq!(cut(1.0, 9.0), [(4.0, 2), (6.0, 0), (9.0, 3)]);
        assert_eq!(cut(4.0 + 1e-10, 5.0), [(4.0 + 1e-10, 2)]);
        assert_eq!(cut(4.1, 5.0), []);
    }
}
