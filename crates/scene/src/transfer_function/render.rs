//! The transfer function in the form of ray casters: `f32`, render values, answers in constant time.
//!
//! A *render value* is a data value minus a constant shift, so that `f32` resolves the data's range. A table of bins
//! over `[first point, last point]` locates points. A bin names the last point of an earlier bin; a short scan from
//! there finds the exact segment. So evaluation is exact for any number of bins; only its cost depends on it. Queries
//! of intervals use running sums over the points:
//! - [`RenderTransferFunction::is_visible`]: exact up to rounding, never falsely "no";
//! - [`RenderTransferFunction::variation`]: total change of opacity and colour over an interval;
//! - [`RenderTransferFunction::knots_in`]: the values at which the function bends or steps.

use supervol_format::cast::{narrow, single, whole};

use super::edges::Edges;
use super::{ALPHA_LIMIT, ControlPoint, TransferFunction};

/// Bins per control point; with 4, most bins hold at most one point.
const BINS_PER_POINT: usize = 4;
/// Least number of bins.
const MIN_BINS: usize = 64;
/// Change of opacity or colour, caused by a change of slope, below which a point is no knot.
const KNOT_TOLERANCE: f64 = 1e-6;

/// One control point and the segment to its right.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct RenderPoint {
    /// Red, green, blue, alpha at the point.
    pub rgba: [f32; 4],
    /// Change of each channel up to the next point; 0 for the last.
    pub delta: [f32; 4],
    /// Render value.
    pub value: f32,
    /// 1 / width of the segment; 0 for the last and for steps.
    pub inverse_width: f32,
    /// Sum of the variation of all segments before this point.
    pub variation_before: f32,
    /// Variation of the segment.
    pub variation: f32,
    /// Number of points before this one with positive alpha.
    pub visible_before: u32,
    /// Number of knots with a value not greater than this point's.
    pub knots_up_to: u32,
}

/// Transfer function with look-up tables; see the module.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderTransferFunction {
    /// Control points by value, with an additional point wherever alpha passes [`ALPHA_LIMIT`], where extinction bends.
    pub points: Vec<RenderPoint>,
    /// Distinct values at which opacity, colour, or their slopes change; ascending.
    pub knots: Vec<f32>,
    /// For each bin: the last point in an earlier bin, or 0.
    pub bins: Vec<u32>,
    /// Bins per unit of render value.
    pub bins_per_value: f32,
    /// 1 / unit distance; the unit distance is a world length.
    pub inverse_unit_distance: f32,
    /// Number of points with positive alpha.
    visible_points: u32,
    /// Render values of iso surfaces inside the volume, which are visible whatever their opacity.
    surfaces: Vec<f32>,
    /// Values at which the function becomes visible or invisible.
    pub(super) edges: Edges,
}

impl RenderTransferFunction {
    /// The render form of a transfer function. `shift` is subtracted from every data value.
    #[must_use]
    pub fn new(source: &TransferFunction, shift: f64) -> Self {
        let source_points = with_limit_points(source.points());
        let values: Vec<f32> = source_points.iter().map(|p| single(p.value - shift)).collect();
        let knots = knot_values(&source_points, &values);
        let points = render_points(&source_points, &values, &knots);
        let width = values[values.len() - 1] - values[0];
        let bin_count = (BINS_PER_POINT * points.len()).next_power_of_two().max(MIN_BINS);
        let bins_per_value = if width > 0.0 { (bin_count as f32 / width).min(f32::MAX) } else { 0.0 };
        let visible_points = narrow::<u32>(source_points.iter().filter(|p| p.alpha > 0.0).count());
        let inverse_unit_distance = single(1.0 / source.unit_distance());
        let bins = vec![0; bin_count];
        let edges = Edges::default();
        // Rounded like the values of the surfaces themselves.
        let surfaces = source.surfaces().iter().map(|value| single(value - shift)).collect();
        let mut table =
            Self { points, knots, bins, bins_per_value, inverse_unit_distance, visible_points, surfaces, edges };
        // The bin of a value is a monotone expression, so every point in an earlier bin is less than the value.
        let bins_of_points: Vec<usize> = values.iter().map(|&v| table.bin(v)).collect();
        let mut last = 0;
        for bin in 0..bin_count {
            while last + 1 < bins_of_points.len() && bins_of_points[last + 1] < bin {
                last += 1;
            }
            table.bins[bin] = narrow::<u32>(last);
        }
        table.edges = Edges::new(&table);
        table
    }

    #[inline]
    fn bin(&self, value: f32) -> usize {
        // Saturating: a value below the first point has bin 0.
        whole::<usize>((value - self.points[0].value) * self.bins_per_value).min(self.bins.len() - 1)
    }

    /// Index of the last point with a value not greater than `value`; `None` below the first point.
    #[inline]
    #[must_use]
    pub fn segment(&self, value: f32) -> Option<usize> {
        if value < self.points[0].value {
            return None;
        }
        let mut i = self.bins[self.bin(value)] as usize;
        while let Some(next) = self.points.get(i + 1) {
            if value < next.value {
                break;
            }
            i += 1;
        }
        Some(i)
    }

    /// Red, green, blue and alpha at a render value.
    #[inline]
    #[must_use]
    pub fn classify(&self, value: f32) -> [f32; 4] {
        let Some(i) = self.segment(value) else { return self.points[0].rgba };
        let p = &self.points[i];
        let x = ((value - p.value) * p.inverse_width).min(1.0);
        std::array::from_fn(|c| p.rgba[c] + x * p.delta[c])
    }

    /// Whether a value of the closed interval can have positive opacity or is the value of an iso surface. False for
    /// the empty interval `low > high`. True if one end is visible, or if a visible point lies above the lower end and
    /// not above the upper one. Points decide here, not the rounded values of the segments between them.
    #[inline]
    #[must_use]
    pub fn is_visible(&self, low: f32, high: f32) -> bool {
        self.edges.is_visible(low, high) || self.surfaces.iter().any(|value| (low..=high).contains(value))
    }

    /// Whether a value has positive opacity.
    pub(super) fn is_visible_at(&self, value: f32) -> bool {
        self.classify(value)[3] > 0.0
    }

    /// Number of points with positive alpha among those with values not greater than `value`.
    pub(super) fn visible_points_up_to(&self, value: f32) -> u32 {
        let next = |i: usize| self.points.get(i + 1).map_or(self.visible_points, |p| p.visible_before);
        self.segment(value).map_or(0, next)
    }

    /// Total variation of alpha, and of colour weighted by its visibility, over the closed interval.
    #[inline]
    #[must_use]
    pub fn variation(&self, low: f32, high: f32) -> f32 {
        let gathered = |value: f32| {
            self.segment(value).map_or(0.0, |i| {
                let p = &self.points[i];
                p.variation_before + ((value - p.value) * p.inverse_width).min(1.0) * p.variation
            })
        };
        gathered(high) - gathered(low)
    }

    /// Values strictly between `low` and `high` at which the function bends or steps, ascending.
    #[inline]
    #[must_use]
    pub fn knots_in(&self, low: f32, high: f32) -> &[f32] {
        let up_to = |value: f32| self.segment(value).map_or(0, |i| self.points[i].knots_up_to as usize);
        let (start, mut end) = (up_to(low), up_to(high));
        if end > start && self.knots[end - 1] >= high {
            end -= 1;
        }
        &self.knots[start..end.max(start)]
    }

    /// Extinction per world length of an opacity.
    #[inline]
    #[must_use]
    pub fn extinction(&self, alpha: f32) -> f32 {
        absorbance(alpha.min(single(ALPHA_LIMIT))) * self.inverse_unit_distance
    }
}

/// `-ln(1 - alpha)`, accurate for small alpha, where `1 - alpha` would round the digits away.
#[inline]
#[must_use]
pub fn absorbance(alpha: f32) -> f32 {
    if alpha < 0.0625 {
        // Taylor series; the first omitted term is below 2^-24 of the sum.
        let terms = 1.0 / 2.0 + alpha * (1.0 / 3.0 + alpha * (1.0 / 4.0 + alpha * (1.0 / 5.0 + alpha * (1.0 / 6.0))));
        alpha + alpha * alpha * terms
    } else {
        -(1.0 - alpha).ln()
    }
}

/// The points, with an additional one wherever a segment passes [`ALPHA_LIMIT`], so that extinction bends only at
/// points.
///
/// # Panics
/// If there are no points.
#[must_use]
pub fn with_limit_points(points: &[ControlPoint]) -> Vec<ControlPoint> {
    let mut out = vec![points[0]];
    for pair in points.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        if (a.alpha - ALPHA_LIMIT) * (b.alpha - ALPHA_LIMIT) < 0.0 && a.value < b.value {
            let x = (ALPHA_LIMIT - a.alpha) / (b.alpha - a.alpha);
            let color = std::array::from_fn(|c| a.color[c] + x * (b.color[c] - a.color[c]));
            out.push(ControlPoint { value: a.value + x * (b.value - a.value), color, alpha: ALPHA_LIMIT });
        }
        out.push(b);
    }
    out
}

fn channels(point: &ControlPoint) -> [f64; 4] {
    let [r, g, b] = point.color;
    [r, g, b, point.alpha]
}

/// Values of the points with a step, or with a relevant change of slope relative to the shorter side.
fn knot_values(points: &[ControlPoint], values: &[f32]) -> Vec<f32> {
    let mut knots = Vec::new();
    let mut first = 0;
    while first < points.len() {
        let last = (first..points.len()).take_while(|&i| values[i] == values[first]).last().unwrap_or(first);
        let step = (first..last).any(|i| channels(&points[i]) != channels(&points[i + 1]));
        let left = first.checked_sub(1).map(|i| (&points[i], &points[first]));
        let right = points.get(last + 1).map(|next| (&points[last], next));
        if step || slope_change(left, right) > KNOT_TOLERANCE {
            knots.push(values[first]);
        }
        first = last + 1;
    }
    knots
}

type SegmentEnds<'a> = Option<(&'a ControlPoint, &'a ControlPoint)>;

/// Greatest change of a channel that a change of slope causes over the narrower of two segments.
fn slope_change(left: SegmentEnds<'_>, right: SegmentEnds<'_>) -> f64 {
    let width = |ends: SegmentEnds<'_>| ends.map_or(f64::INFINITY, |(a, b)| b.value - a.value);
    // The fifth channel is the effective opacity, which stops rising at the limit.
    let channel = |p: &ControlPoint, c: usize| if c < 4 { channels(p)[c] } else { p.alpha.min(ALPHA_LIMIT) };
    let slope = |ends: SegmentEnds<'_>, c: usize| {
        ends.map_or(0.0, |(a, b)| (channel(b, c) - channel(a, c)) / (b.value - a.value).max(f64::MIN_POSITIVE))
    };
    let narrower = width(left).min(width(right));
    if narrower.is_infinite() {
        return 0.0;
    }
    (0..5).map(|c| (slope(right, c) - slope(left, c)).abs() * narrower).fold(0.0, f64::max)
}

fn render_points(points: &[ControlPoint], values: &[f32], knots: &[f32]) -> Vec<RenderPoint> {
    let mut variation_before = 0.0;
    let mut visible_before = 0;
    let mut out = Vec::with_capacity(points.len());
    for (i, point) in points.iter().enumerate() {
        let next = points.get(i + 1).unwrap_or(point);
        let (here, there) = (channels(point), channels(next));
        let width = values.get(i + 1).map_or(0.0, |v| v - values[i]);
        let inverse_width = if width > 0.0 && (1.0 / width).is_finite() { 1.0 / width } else { 0.0 };
        let color_change = (0..3).map(|c| (there[c] - here[c]).abs()).fold(0.0, f64::max);
        let variation = (there[3] - here[3]).abs() + color_change * here[3].max(there[3]);
        out.push(RenderPoint {
            rgba: here.map(single),
            delta: std::array::from_fn(|c| single(there[c]) - single(here[c])),
            value: values[i],
            inverse_width,
            variation_before: single(variation_before),
            variation: single(variation),
            visible_before,
            knots_up_to: narrow::<u32>(knots.partition_point(|&k| k <= values[i])),
        });
        variation_before += variation;
        visible_before += u32::from(point.alpha > 0.0);
    }
    out
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn function(points: &[(f64, f64)]) -> TransferFunction {
        let points = points.iter().map(|&(value, alpha)| ControlPoint { value, color: [alpha, 0.5, 0.25], alpha });
        TransferFunction::new(points.collect(), 1.0).unwrap()
    }

    #[test]
    fn knots_are_where_something_changes() {
        let tf = function(&[(0.0, 0.0), (1.0, 0.1), (2.0, 0.2), (3.0, 0.2), (3.0, 0.6), (4.0, 0.6), (5.0, 1.0)]);
        let render = RenderTransferFunction::new(&tf, 0.0);
        // (1, 0.1) lies on a straight line. One knot is the bend of extinction at the alpha limit.
        assert_eq!(render.knots.len(), 6);
        assert_eq!(render.knots_in(0.0, 3.5), &[2.0, 3.0]);
        assert_eq!(render.knots_in(-1.0, 0.5), &[0.0]);
        assert_eq!(render.knots_in(2.0, 3.0), &[] as &[f32]);
        assert_eq!(render.knots_in(3.0, 3.0), &[] as &[f32]);
        assert_eq!(render.knots_in(4.5, 9.0).len(), 2);
        assert_eq!(render.knots_in(7.0, 9.0), &[] as &[f32]);
    }

    #[test]
    fn a_spike_one_code_wide_is_seen() {
        let tf = function(&[(0.0, 0.0), (1000.0, 0.0), (1000.0, 0.9), (1001.0, 0.9), (1001.0, 0.0), (65535.0, 0.0)]);
        let render = RenderTransferFunction::new(&tf, 32768.0);
        let visible = |a: f32, b: f32| render.is_visible(a - 32768.0, b - 32768.0);
        assert!(visible(0.0, 65535.0) && visible(1000.5, 1000.5) && visible(999.0, 1000.0));
        assert!(!visible(0.0, 999.0) && !visible(1001.0, 65535.0) && !visible(5.0, 4.0));
        assert!(render.variation(0.0 - 32768.0, 65535.0 - 32768.0) >= 1.8);
    }

    #[test]
    fn absorbance_is_accurate() {
        for i in 1..10_000 {
            let alpha = i as f32 / 10_001.0;
            let exact = -(-f64::from(alpha)).ln_1p();
            assert!((f64::from(absorbance(alpha)) / exact - 1.0).abs() < 2e-6, "alpha {alpha}");
        }
    }

    proptest! {
        #[test]
        fn agrees_with_the_definition_and_is_conservative(
            mut points in prop::collection::vec((0u8..64, prop::sample::select(vec![0.0, 0.0, 0.25, 0.5, 1.0])), 1..20),
            a in 0.0f32..64.0, b in 0.0f32..64.0, shift in prop::sample::select(vec![0.0, 32.0]),
        ) {
            points.sort_by_key(|p| p.0);
            let points: Vec<(f64, f64)> = points.iter().map(|p| (f64::from(p.0), p.1)).collect();
            let tf = function(&points);
            let render = RenderTransferFunction::new(&tf, shift);
            let (low, high) = (a.min(b), a.max(b));
            let mut visible = false;
            let mut variation = 0.0;
            let mut previous = None;
            for i in 0..=200 {
                let value = low + (high - low) * i as f32 / 200.0;
                let (color, alpha) = tf.classify(f64::from(value));
                let r = value - shift as f32;
                let found = render.classify(r);
                prop_assert!((f64::from(found[3]) - alpha).abs() < 1e-4);
                prop_assert!((f64::from(found[0]) - color[0]).abs() < 1e-4);
                visible |= found[3] > 0.0;
                variation += previous.map_or(0.0, |p: f32| (p - found[3]).abs());
                previous = Some(found[3]);
            }
            let (r_low, r_high) = (low - shift as f32, high - shift as f32);
            prop_assert!(render.is_visible(r_low, r_high) || !visible);
            prop_assert!(render.variation(r_low, r_high) >= variation - 1e-4);
            let knots = render.knots_in(r_low, r_high);
            let expected: Vec<f32> = render.knots.iter().copied().filter(|&k| r_low < k && k < r_high).collect();
            prop_assert_eq!(knots, &expected[..]);
        }
    }
}
