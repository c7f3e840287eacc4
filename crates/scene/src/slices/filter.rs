//! Image filters on slices, computed on a grid of texels in the plane that is as fine as the voxels.
//!
//! The grid's axes follow the volume's axes in or nearest to the plane. On a plane across an axis of the volume, the
//! texels are the voxels. For filtering, absent texels count as the mean of the present ones; in the result they stay
//! absent.

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use supervol_format::cast::{narrow, single, whole};
use supervol_format::{Dims, Geometry};

use super::texels::{Kernel, Texels};
use super::{Interpolation, SlicePlane, interpolate};
use crate::clip::Clip;
use crate::transfer_function::{ControlPoint, TransferFunction};
use crate::units::edges;

/// Most texels of a filtered slice; larger slices get larger texels.
pub const TEXEL_LIMIT: usize = 1 << 24;
/// Greatest size of a filter, in texels.
pub const SIZE_LIMIT: f64 = 64.0;
/// Greatest radius of the median's window, in texels: the window of each texel is sorted.
const MEDIAN_LIMIT: f64 = 8.0;
/// A zero crossing of the Laplacian is an edge if the change exceeds this factor times the mean magnitude.
const EDGE_SHARE: f32 = 0.75;
/// Share of the texels that the colours of a filter leave out at the ends of the value range.
const CLIPPED: f64 = 0.01;

/// Image filter of a slice.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FilterSpec {
    /// Name of the filter.
    pub kind: FilterKind,
    /// Size in texels: standard deviation of `gaussian` and `marr-hildreth`, radius of the window of `median`; others
    /// have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<f64>,
}

/// Name of an image filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FilterKind {
    /// Gaussian blur.
    Gaussian,
    /// Median of a square window: removes single bright and dark voxels.
    Median,
    /// Magnitude of the gradient.
    Sobel,
    /// Laplacian: sum of the second derivatives.
    Laplacian,
    /// Edges: 1 at zeros of the Laplacian of the Gaussian blur (Marr and Hildreth 1980), 0 elsewhere.
    MarrHildreth,
}

impl FilterKind {
    /// All filters with their names.
    pub const NAMES: [(&str, Self); 5] = [
        ("gaussian", Self::Gaussian),
        ("median", Self::Median),
        ("sobel", Self::Sobel),
        ("laplacian", Self::Laplacian),
        ("marr-hildreth", Self::MarrHildreth),
    ];

    /// Whether the filtered values are in the volume's units.
    #[must_use]
    pub fn keeps_values(self) -> bool {
        matches!(self, Self::Gaussian | Self::Median)
    }

    /// Least and greatest size in texels; `None` for a filter without a size.
    #[must_use]
    pub fn sizes(self) -> Option<[f64; 2]> {
        match self {
            Self::Gaussian | Self::MarrHildreth => Some([0.1, SIZE_LIMIT]),
            Self::Median => Some([1.0, MEDIAN_LIMIT]),
            Self::Sobel | Self::Laplacian => None,
        }
    }
}

/// First derivatives per texel (Sobel and Feldman 1968), and the sum of the second derivatives: 3 x 3 kernels, row by
/// row.
const ACROSS: [f32; 9] = [-0.125, 0.0, 0.125, -0.25, 0.0, 0.25, -0.125, 0.0, 0.125];
const DOWN: [f32; 9] = [-0.125, -0.25, -0.125, 0.0, 0.0, 0.0, 0.125, 0.25, 0.125];
const CURVATURE: [f32; 9] = [0.0, 1.0, 0.0, 1.0, -4.0, 1.0, 0.0, 1.0, 0.0];

/// The grid of texels on a slice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TexelGrid {
    /// Position of the first texel, in units.
    origin: DVec3,
    /// Vectors from one texel to the next along each axis, in units.
    steps: [DVec3; 2],
    /// Number of texels along each axis.
    pub size: [usize; 2],
}

impl TexelGrid {
    /// The grid of a slice. Along each axis of the volume, texels are as large as `scale` voxels of level 0.
    #[must_use]
    pub fn new(slice: &SlicePlane, geometry: &Geometry, dims: Dims, clip: &Clip, scale: [u64; 3]) -> Self {
        let normal = slice.normal.normalize();
        let linear = geometry.linear();
        let along = |axis: usize| linear.col(axis).normalize_or_zero();
        let flat = |v: DVec3| v - v.dot(normal) * normal;
        // The volume's axis that lies most nearly in the plane, and the axis that runs most nearly along the plane's
        // other direction.
        let first =
            (0..3).min_by(|&a, &b| along(a).dot(normal).abs().total_cmp(&along(b).dot(normal).abs())).unwrap_or(0);
        let u = flat(along(first)).normalize();
        let v = normal.cross(u);
        let second = (0..3).max_by(|&a, &b| along(a).dot(v).abs().total_cmp(&along(b).dot(v).abs())).unwrap_or(1);
        let v = v * along(second).dot(v).signum();
        let edges = edges(geometry);
        let mut steps = [u * edges[first] * scale[first] as f64, v * edges[second] * scale[second] as f64];
        let foot = |p: DVec3| p + normal * (slice.offset / slice.normal.length() - normal.dot(p));
        let world = geometry.world_from_index();
        let voxel = foot(world.transform_point3(DVec3::from_array(scale.map(|s| 0.5 * (s as f64 - 1.0)))));
        let [low, high] = clip.index_box.unwrap_or([[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]]);
        let corners: [DVec3; 8] = std::array::from_fn(|corner| {
            let side = |a: usize| match corner >> a & 1 {
                0 => low[a].max(-0.5),
                _ => high[a].min(dims.0[a] as f64 - 0.5),
            };
            foot(world.transform_point3(DVec3::new(side(0), side(1), side(2))))
        });
        loop {
            let places = steps.map(|step| {
                let at = corners.map(|corner| (corner - voxel).dot(step) / step.length_squared());
                let [low, high] =
                    [at.into_iter().fold(f64::INFINITY, f64::min), at.into_iter().fold(f64::NEG_INFINITY, f64::max)];
                [low.floor(), (high - low.floor()).ceil() + 1.0]
            });
            if places[0][1] * places[1][1] <= TEXEL_LIMIT as f64 {
                let origin = voxel + steps[0] * places[0][0] + steps[1] * places[1][0];
                return Self { origin, steps, size: places.map(|[_, count]| whole::<usize>(count)) };
            }
            steps = steps.map(|step| 2.0 * step);
        }
    }

    /// Positions of a range of texels, in units; texels are numbered row by row.
    pub fn points(&self, texels: std::ops::Range<usize>) -> impl Iterator<Item = DVec3> + '_ {
        texels.map(|i| {
            let [x, y] = [i % self.size[0], i / self.size[0]];
            self.origin + self.steps[0] * x as f64 + self.steps[1] * y as f64
        })
    }

    /// Number of texels.
    #[must_use]
    pub fn texels(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// Texel coordinates of a position on the slice.
    fn place(&self, p: DVec3) -> [f64; 2] {
        self.steps.map(|step| (p - self.origin).dot(step) / step.length_squared())
    }
}

/// A slice with a filter applied.
#[derive(Debug, Clone)]
pub struct FilteredSlice {
    grid: TexelGrid,
    texels: Texels,
    /// Constant that was subtracted from the values, so that `f32` resolves them.
    shift: f64,
}

impl FilteredSlice {
    /// Filters the values of a slice. `values` are row by row, NaN where absent, and have `shift` subtracted.
    ///
    /// # Panics
    /// If the number of values is not the number of texels.
    #[must_use]
    pub fn new(grid: TexelGrid, values: Vec<f32>, filter: FilterSpec, shift: f64) -> Self {
        assert_eq!(values.len(), grid.texels(), "values of texels");
        let is_absent: Vec<bool> = values.iter().map(|v| v.is_nan()).collect();
        let present = || values.iter().filter(|v| !v.is_nan()).map(|&v| f64::from(v));
        let mean = single(present().sum::<f64>() / present().count().max(1) as f64);
        let filled: Vec<f32> = values.iter().map(|&v| if v.is_nan() { mean } else { v }).collect();
        let mut texels = filtered(&Texels::new(grid.size, filled), filter);
        for (texel, _) in texels.values_mut().iter_mut().zip(&is_absent).filter(|(_, absent)| **absent) {
            *texel = f32::NAN;
        }
        let shift = if filter.kind.keeps_values() { shift } else { 0.0 };
        Self { grid, texels, shift }
    }

    /// The value at a position on the slice, in units; NaN if it is absent.
    #[must_use]
    pub fn value(&self, p: DVec3, how: Interpolation) -> f64 {
        let [x, y] = self.grid.place(p);
        let texel = |[i, j, _]: [i64; 3]| f64::from(self.texels.at([i, j]));
        interpolate([x, y, 0.0], how, texel) + self.shift
    }

    /// Default colours for the filtered values.
    ///
    /// # Panics
    /// Never: the control points are finite and ascend.
    #[must_use]
    pub fn colors(&self, kind: FilterKind) -> TransferFunction {
        let mut sorted: Vec<f32> = self.texels.values().iter().copied().filter(|v| !v.is_nan()).collect();
        sorted.sort_by(f32::total_cmp);
        let at =
            |share: f64| sorted.get(whole::<usize>(share * (sorted.len() as f64 - 1.0))).map_or(0.0, |&v| f64::from(v));
        let [low, high] = [at(CLIPPED), at(1.0 - CLIPPED)];
        let grey = |low: f64, high: f64| {
            // A slice of one value must be drawable, too.
            let high = if high > low { high } else { low + 1.0 };
            [(low, [0.0; 3]), (high, [1.0; 3])].to_vec()
        };
        let points = match kind {
            FilterKind::Gaussian | FilterKind::Median => grey(low + self.shift, high + self.shift),
            FilterKind::Sobel => grey(0.0, high),
            FilterKind::MarrHildreth => grey(0.0, 1.0),
            FilterKind::Laplacian => {
                let most = low.abs().max(high.abs()).max(f64::MIN_POSITIVE);
                vec![(-most, [0.1, 0.2, 0.7]), (0.0, [1.0; 3]), (most, [0.75, 0.1, 0.1])]
            }
        };
        let points = points.into_iter().map(|(value, color)| ControlPoint { value, color, alpha: 1.0 }).collect();
        TransferFunction::new(points, 1.0).expect("finite and ascending")
    }
}

fn filtered(image: &Texels, filter: FilterSpec) -> Texels {
    let size = filter.size.unwrap_or(1.0);
    match filter.kind {
        FilterKind::Gaussian => image.blurred(single(size)),
        FilterKind::Median => median(image, whole::<i64>(size.round())),
        FilterKind::Sobel => {
            let mut sizes = convolved(image, &ACROSS);
            sizes.values_mut().iter_mut().zip(convolved(image, &DOWN).values()).for_each(|(x, y)| *x = x.hypot(*y));
            sizes
        }
        FilterKind::Laplacian => convolved(image, &CURVATURE),
        FilterKind::MarrHildreth => zeros(&convolved(&image.blurred(single(size)), &CURVATURE)),
    }
}

fn convolved(image: &Texels, rows: &[f32; 9]) -> Texels {
    image.convolved(Kernel { size: [3, 3], weights: rows })
}

/// The median of the window around each texel; positions are clamped at the picture's edges.
fn median(image: &Texels, radius: i64) -> Texels {
    let mut window = Vec::new();
    Texels::from_fn(image.size(), |place| {
        let [x, y] = place.map(narrow::<i64>);
        window.clear();
        window.extend((-radius..=radius).flat_map(|j| (-radius..=radius).map(move |i| image.at([x + i, y + j]))));
        let middle = window.len() / 2;
        let (_, value, _) = window.select_nth_unstable_by(middle, f32::total_cmp);
        *value
    })
}

/// 1 if the sign changes towards the next texel to the right or below by more than noise, else 0.
fn zeros(curved: &Texels) -> Texels {
    let mean = curved.values().iter().map(|v| f64::from(v.abs())).sum::<f64>() / curved.values().len().max(1) as f64;
    let least = EDGE_SHARE * single(mean);
    Texels::from_fn(curved.size(), |place| {
        let [x, y] = place.map(narrow::<i64>);
        let here = curved.at([x, y]);
        // Beyond the edge the same texel continues: no change there.
        let changes = |there: f32| here * there < 0.0 && (here - there).abs() > least;
        if [[x + 1, y], [x, y + 1]].into_iter().any(|next| changes(curved.at(next))) { 1.0 } else { 0.0 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(size: [usize; 2]) -> TexelGrid {
        TexelGrid { origin: DVec3::ZERO, steps: [DVec3::X, DVec3::Y], size }
    }

    /// A slice of 16 x 12 texels with the values of a function.
    fn made(kind: FilterKind, size: Option<f64>, value: impl Fn(f64, f64) -> f64) -> FilteredSlice {
        let values = (0..16 * 12).map(|i| value(f64::from(i % 16), f64::from(i / 16)) as f32).collect();
        FilteredSlice::new(grid([16, 12]), values, FilterSpec { kind, size }, 0.0)
    }

    #[test]
    fn filters_make_what_their_names_say() {
        let at = |slice: &FilteredSlice, x: f64, y: f64| slice.value(DVec3::new(x, y, 0.0), Interpolation::Linear);
        let ramp = |x: f64, y: f64| 3.0 * x - 4.0 * y;
        assert!((at(&made(FilterKind::Sobel, None, ramp), 6.0, 5.0) - 5.0).abs() < 1e-5);
        assert!(at(&made(FilterKind::Laplacian, None, ramp), 6.0, 5.0).abs() < 1e-4);
        let bowl = |x: f64, y: f64| x * x + 2.0 * y * y;
        assert!((at(&made(FilterKind::Laplacian, None, bowl), 6.0, 5.0) - 6.0).abs() < 1e-4);
        assert!((at(&made(FilterKind::Gaussian, Some(1.5), ramp), 7.5, 5.5) - ramp(7.5, 5.5)).abs() < 1e-3);
        let spike = |x: f64, y: f64| if x == 6.0 && y == 5.0 { 1000.0 } else { 7.0 };
        assert_eq!(at(&made(FilterKind::Median, None, spike), 6.0, 5.0), 7.0);
        let step = |x: f64, _: f64| if x < 8.0 { 0.0 } else { 10.0 };
        let edges = made(FilterKind::MarrHildreth, Some(1.0), step);
        let line: Vec<f64> = (1..15).map(|x| at(&edges, f64::from(x), 5.0)).collect();
        assert_eq!(line.iter().sum::<f64>(), 1.0, "{line:?}");
        assert_eq!(at(&edges, 7.0, 5.0), 1.0);
    }

    #[test]
    fn absent_texels_stay_absent_and_spoil_no_others() {
        let holed = |x: f64, y: f64| if x == 6.0 && y == 5.0 { f64::NAN } else { 7.0 };
        let slice = made(FilterKind::Gaussian, Some(2.0), holed);
        let at = |x: f64| slice.value(DVec3::new(x, 5.0, 0.0), Interpolation::Nearest);
        assert!(at(6.0).is_nan() && (at(5.0) - 7.0).abs() < 1e-5);
    }

    #[test]
    fn texels_of_a_plane_across_an_axis_are_voxels() {
        let geometry = Geometry { spacing: [2.0, 3.0, 5.0], origin: [1.0, 1.0, 1.0], ..Geometry::IDENTITY };
        let slice = SlicePlane {
            normal: DVec3::new(0.0, -2.0, 0.0),
            offset: -2.0 * (1.0 + 3.0 * 4.25),
            opacity: 1.0,
            interpolation: Interpolation::Linear,
            filter: None,
            colors: None,
        };
        let grid = TexelGrid::new(&slice, &geometry, Dims([10, 9, 8]), &Clip::default(), [1; 3]);
        let index = geometry.world_from_index().inverse();
        for p in grid.points(0..grid.texels()) {
            let p = index.transform_point3(p);
            assert!(
                (p.y - 4.25).abs() < 1e-9 && (p.x - p.x.round()).abs() < 1e-9 && (p.z - p.z.round()).abs() < 1e-9,
                "{p}"
            );
        }
        assert!(grid.size.iter().all(|&n| (8..=13).contains(&n)), "{:?}", grid.size);
    }
}
