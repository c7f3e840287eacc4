//! The fit of quadratic pieces to a transfer function, with a bound at every value.
//!
//! The bound is proved in docs/bounds.md, section 8: deviations are known at nine values of a segment; what they do between
//! these follows from the third derivative.

use supervol_format::cast::single;

use super::pieces::{CHANNELS, Piece};
use super::{ALPHA_LIMIT, ControlPoint, TransferFunction};

/// The shortest piece is the segment between two control points divided by this. It fits any function between two points to
/// 1e-5 of the extinction.
const LEAST_PARTS: f64 = 65536.0;
/// Bisection steps for the end of a piece.
const BISECTIONS: usize = 12;
/// Panels of a segment: at the ends and in the middle of each, deviations are computed.
const PANELS: usize = 4;
/// Rounding of a deviation, of the greatest extinction.
const ROUNDING: f64 = 1e-14;

/// The part of the function between two control points of different values.
#[derive(Debug, Clone, Copy)]
pub(super) struct Segment {
    pub(super) ends: [ControlPoint; 2],
    /// Render values of the ends as rounded to `f32`, in which samples are compared with knots.
    pub(super) values: [f64; 2],
}

impl Segment {
    /// Extinction and emission at a value.
    fn at(&self, source: &TransferFunction, value: f64) -> [f64; CHANNELS] {
        let x = (value - self.values[0]) / (self.values[1] - self.values[0]);
        channels_between(source, &self.ends, x)
    }

    fn is_visible(&self) -> bool {
        self.ends.iter().any(|end| end.alpha > 0.0)
    }

    /// Greatest change of a colour channel per unit of value.
    fn color_slope(&self) -> f64 {
        let change = |c: usize| (self.ends[1].color[c] - self.ends[0].color[c]).abs();
        (0..3).map(change).fold(0.0, f64::max) / (self.values[1] - self.values[0])
    }

    /// Opacities of the ends, up to their limit. No segment has its ends on both sides of it.
    fn alphas(&self) -> [f64; 2] {
        self.ends.map(|end| end.alpha.min(ALPHA_LIMIT))
    }

    /// Bounds of the third derivatives of the channels between two shares x of the way. With `u = 1 - alpha`, which is linear,
    /// and `d = -u'`, extinction has the derivatives `d/u`, `d^2/u^2` and `2 d^3/u^3`, over the unit distance. Emission has
    /// `d^2/u^2 (2 d c/u + 3 c')`: `c/u` is monotone.
    fn third_derivatives(&self, source: &TransferFunction, shares: [f64; 2]) -> [f64; CHANNELS] {
        let [a, b] = self.alphas();
        let slope = b - a;
        let clear = shares.map(|x| 1.0 - (a + x * slope));
        let square = (slope / clear[0].min(clear[1])).powi(2) / source.unit_distance();
        let of_emission = |c: usize| {
            let change = self.ends[1].color[c] - self.ends[0].color[c];
            let at = |i: usize| {
                let color = self.ends[0].color[c] + shares[i] * change;
                (2.0 * slope * color / clear[i] + 3.0 * change).abs()
            };
            square * at(0).max(at(1))
        };
        let of_extinction = square * 2.0 * slope.abs() / clear[0].min(clear[1]);
        [of_extinction, of_emission(0), of_emission(1), of_emission(2)]
    }

    /// A line below the extinction: its values at two shares. Extinction is convex in the share, so that it lies above its
    /// tangent at the end with the smaller opacity.
    fn line_below(&self, source: &TransferFunction, shares: [f64; 2]) -> [f64; 2] {
        let [a, b] = self.alphas();
        let alphas = shares.map(|x| a + x * (b - a));
        let least = alphas[0].min(alphas[1]);
        let (kappa, slope) = (source.kappa(least), 1.0 / ((1.0 - least) * source.unit_distance()));
        alphas.map(|alpha| kappa + slope * (alpha - least))
    }
}

/// Channels at the share `x` of the way between two control points.
pub(super) fn channels_between(source: &TransferFunction, [a, b]: &[ControlPoint; 2], x: f64) -> [f64; CHANNELS] {
    let kappa = source.kappa(a.alpha + x * (b.alpha - a.alpha));
    let color = |c: usize| a.color[c] + x * (b.color[c] - a.color[c]);
    [kappa, kappa * color(0), kappa * color(1), kappa * color(2)]
}

/// Cuts the function into pieces in ascending order of value, each as long as one quadratic fits.
pub(super) struct Fitter<'a> {
    pub(super) source: &'a TransferFunction,
    /// Segments that are not yet covered by pieces.
    pub(super) segments: &'a [Segment],
    pub(super) tolerance: f64,
}

impl Fitter<'_> {
    /// The next piece, which starts at `begin`; moves `begin` to its end. `None` at the end of the function.
    pub(super) fn next_piece(&mut self, begin: &mut f64) -> Option<Piece> {
        while self.segments.first().is_some_and(|s| s.values[1] <= *begin) {
            self.segments = &self.segments[1..];
        }
        let first = *self.segments.first()?;
        // The piece covers as many whole segments as fit. For most functions that is none, and it covers a part of the
        // first segment.
        let mut end = *begin;
        for (i, segment) in self.segments.iter().enumerate() {
            let is_joined = i == 0 || self.segments[i - 1].ends[1] == segment.ends[0];
            if !is_joined || !self.fits(*begin, segment.values[1]) {
                break;
            }
            end = segment.values[1];
        }
        if end == *begin {
            let (mut low, mut high) = (*begin, first.values[1]);
            for _ in 0..BISECTIONS {
                let middle = 0.5 * (low + high);
                if self.fits(*begin, middle) { low = middle } else { high = middle }
            }
            // A piece of the least length fits, even if the bound is not close enough to say so.
            let least = *begin + (first.values[1] - first.values[0]) / LEAST_PARTS;
            end = rounded_down(low.max(least), *begin).min(first.values[1]);
        }
        let covered = self.segments.iter().take_while(|s| s.values[0] < end);
        let color_slope = covered.filter(|s| s.is_visible()).map(Segment::color_slope).fold(0.0, f64::max);
        let channels = self.fit(*begin, end).map(|[v, s, b]| {
            let width = end - *begin;
            [v, s / width, b / (width * width)]
        });
        let begins_at_point = *begin == first.values[0];
        let piece = Piece { knot: *begin, anchor: *begin, channels, color_slope, begins_at_point };
        *begin = end;
        Some(piece)
    }

    fn at(&self, value: f64) -> [f64; CHANNELS] {
        let i = self.segments.partition_point(|s| s.values[1] < value).min(self.segments.len() - 1);
        self.segments[i].at(self.source, value)
    }

    /// Quadratics through both ends and the middle; coefficients of 1, x and x^2, x from 0 to 1.
    fn fit(&self, begin: f64, end: f64) -> [[f64; 3]; CHANNELS] {
        // At a step, the right side counts.
        let first = self.segments[0].at(self.source, begin);
        let (middle, last) = (self.at(0.5 * (begin + end)), self.at(end));
        std::array::from_fn(|c| {
            let bend = 2.0 * (first[c] - 2.0 * middle[c] + last[c]);
            [first[c], last[c] - first[c] - bend, bend]
        })
    }

    /// Whether the quadratics are certainly within the tolerance, at every value. Bounds: docs/bounds.md, section 8.
    fn fits(&self, begin: f64, end: f64) -> bool {
        let quadratics = self.fit(begin, end);
        let covered = self.segments.iter().take_while(|s| s.values[0] < end);
        covered.into_iter().all(|segment| {
            let ends = [segment.values[0].max(begin), segment.values[1].min(end)];
            let deviations: [Place; 2 * PANELS + 1] = std::array::from_fn(|i| {
                let value = ends[0] + (ends[1] - ends[0]) * i as f64 / (2 * PANELS) as f64;
                let share = (value - segment.values[0]) / (segment.values[1] - segment.values[0]);
                let exact = segment.at(self.source, value);
                let x = (value - begin) / (end - begin);
                let found = quadratics.map(|[v, s, b]| v + x * (s + x * b));
                Place { share, deviations: std::array::from_fn(|c| found[c] - exact[c]) }
            });
            (0..PANELS).all(|panel| self.panel_fits(segment, &deviations[2 * panel..=2 * panel + 2]))
        })
    }

    /// Whether the deviations stay within the tolerance on a panel, if these are the ones at its ends and its middle.
    fn panel_fits(&self, segment: &Segment, places: &[Place]) -> bool {
        let shares = [places[0].share, places[2].share];
        let width = shares[1] - shares[0];
        let below = segment.line_below(self.source, shares);
        let thirds = segment.third_derivatives(self.source, shares);
        let rounding = ROUNDING * (below[0].max(below[1]) + 1.0 / self.source.unit_distance());
        (0..CHANNELS).all(|c| {
            let deviations = [0, 1, 2].map(|i| places[i].deviations[c]);
            let rest = share_of_line(thirds[c] / 6.0, width, below);
            stays_below(deviations, below.map(|line| (self.tolerance - rest) * line + rounding))
        })
    }
}

/// A place of a segment, and by how much a piece's quadratics are off there.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// Share of the way between the segment's ends.
    share: f64,
    deviations: [f64; CHANNELS],
}

/// Greatest value of `factor |x - a| |x - m| |x - b|` on a panel from a to b of this width, m its middle, in parts of a line
/// with these values at a and b, which are not negative.
fn share_of_line(factor: f64, width: f64, line: [f64; 2]) -> f64 {
    if factor == 0.0 {
        return 0.0;
    }
    // The product is at most w^3 / (12 sqrt 3), and without the factor that vanishes with the line at most w^2 / 2.
    let by_value = width.powi(3) / (12.0 * 3f64.sqrt()) / line[0].min(line[1]);
    let by_slope = width.powi(2) / 2.0 * (width / (line[1] - line[0]).abs());
    factor * by_value.min(by_slope)
}

/// Whether the parabola with these values at a panel's ends and middle stays between a line and its negative.
fn stays_below([first, middle, last]: [f64; 3], [begin, end]: [f64; 2]) -> bool {
    let bend = 2.0 * (first - 2.0 * middle + last);
    let slope = last - first - bend;
    [1.0, -1.0].into_iter().all(|sign| {
        // The greatest value of a parabola on [0, 1] is at an end or at its top.
        let (value, slope, bend) = (sign * first - begin, sign * slope - (end - begin), sign * bend);
        let top = -slope / (2.0 * bend);
        let is_inside = bend < 0.0 && top > 0.0 && top < 1.0;
        value <= 0.0 && value + slope + bend <= 0.0 && !(is_inside && value + 0.5 * slope * top > 0.0)
    })
}

/// The greatest `f32` not above a value, or the one after `begin` if there is none between. No value lies inside such a piece.
fn rounded_down(value: f64, begin: f64) -> f64 {
    let nearest = single(value);
    let below = if f64::from(nearest) > value { nearest.next_down() } else { nearest };
    f64::from(below).max(f64::from(single(begin).next_up()))
}

#[cfg(test)]
mod tests {
    use supervol_format::random::Random;

    use super::super::pieces::pieces_of;
    use super::*;

    /// Places at which each function is compared with its pieces.
    const SEARCHED: u32 = 10_000;

    /// Random control points whose values are exact in `f32`: ramps, steps, spikes, plateaus, full and hardly any opacity. No
    /// alpha exceeds the limit: the point at which it is reached would be rounded.
    fn random_points(random: &mut Random) -> Vec<ControlPoint> {
        let count = 2 + random.below(7);
        let mut value = f64::from(single(1000.0 * (random.unit() - 0.5)));
        let mut points = Vec::new();
        for _ in 0..count {
            let alpha = match random.below(5) {
                0 => 0.0,
                1 => ALPHA_LIMIT,
                2 => 1e-6 * random.unit(),
                _ => random.unit(),
            };
            points.push(ControlPoint { value, color: std::array::from_fn(|_| random.unit()), alpha });
            let width = [0.0, 0.01, 1.0, 100.0][random.below(4) as usize];
            value = f64::from(single(value + width * random.unit()));
        }
        points
    }

    /// Greatest deviation of the pieces from the function, in parts of the extinction; rounding of `f64` left out.
    fn deviation(source: &TransferFunction, tolerance: f64) -> f64 {
        let pieces = pieces_of(source, 0.0, tolerance);
        let (first, last) = (pieces[0].anchor, pieces[pieces.len() - 1].anchor);
        let mut greatest = 0.0f64;
        for i in 0..SEARCHED {
            let value = first + (last - first) * (f64::from(i) + 0.5) / f64::from(SEARCHED);
            let next = pieces.partition_point(|piece| piece.knot <= value);
            let piece = pieces[next - 1];
            let has_no_value_inside = |end: &Piece| single(piece.knot).next_up() == single(end.knot);
            if pieces.get(next).is_some_and(has_no_value_inside) {
                continue;
            }
            let (color, alpha) = source.classify(value);
            let kappa = source.kappa(alpha);
            let exact = [kappa, kappa * color[0], kappa * color[1], kappa * color[2]];
            for (exact, [v, s, b]) in exact.into_iter().zip(piece.channels) {
                let y = value - piece.anchor;
                let off = (v + y * (s + y * b) - exact).abs() - 1e-12 / source.unit_distance();
                greatest = greatest.max(off.max(0.0) / kappa.max(f64::MIN_POSITIVE));
            }
        }
        greatest
    }

    #[test]
    fn pieces_keep_the_tolerance_at_every_value() {
        let mut random = Random::new(7);
        let mut nearest = 0.0f64;
        for number in 0..300 {
            let points = random_points(&mut random);
            if points[0].value == points[points.len() - 1].value {
                continue;
            }
            let source = TransferFunction::new(points.clone(), 0.5 + random.unit()).unwrap();
            let tolerance = [1e-5, 1e-4, 3e-3][number % 3];
            let found = deviation(&source, tolerance) / tolerance;
            assert!(found <= 1.0, "{found} times the tolerance of {tolerance}: {points:?}");
            nearest = nearest.max(found);
        }
        // The tolerance is used, too.
        assert!(nearest > 0.9, "{nearest}");
    }

    /// Segments of a few hundred values of `f32`.
    #[test]
    fn narrow_segments_far_from_zero_keep_the_tolerance() {
        let point = |value: f64, alpha: f64| ControlPoint { value, color: [1.0, 0.5, alpha], alpha };
        for width in [4.0, 32.0, 1024.0] {
            let points = vec![point(1e6, 0.0), point(1e6 + width, ALPHA_LIMIT)];
            let source = TransferFunction::new(points, 1.0).unwrap();
            let pieces = pieces_of(&source, 0.0, 1e-4);
            // Between two neighbours of `f32`, there is no value.
            for value in (0..).map(|i| 1e6 + f64::from(i) * 0.0625).take_while(|value| *value < 1e6 + width) {
                let piece = pieces[pieces.partition_point(|piece| piece.knot <= value) - 1];
                let [v, s, b] = piece.channels[0];
                let exact = source.kappa(source.classify(value).1);
                let y = value - piece.anchor;
                let off = (v + y * (s + y * b) - exact).abs();
                assert!(off <= 1e-4 * exact + 1e-12, "{value} of {width}: {off}, extinction {exact}");
            }
        }
    }

    #[test]
    fn a_parabola_is_compared_with_a_line_at_its_top() {
        // Values 0, 1, 0 at 0, 1/2, 1; and 0, 3/4, 1, with its top at the end.
        assert!(stays_below([0.0, 1.0, 0.0], [1.0, 1.0]) && !stays_below([0.0, 1.0, 0.0], [0.99, 0.99]));
        assert!(!stays_below([0.0, 1.0, 0.0], [2.0, 0.0]) && stays_below([0.0, -1.0, 0.0], [1.0, 1.0]));
        assert!(stays_below([0.0, 0.75, 1.0], [1.0, 1.0]) && !stays_below([0.0, 0.75, 1.0], [1.0, 0.9]));
        assert!(!stays_below([0.0, -0.75, -1.0], [0.5, 1.0]));
    }

    /// The bound of the third derivative, against differences at random places.
    #[test]
    fn third_derivatives_are_bounded() {
        let mut random = Random::new(11);
        for _ in 0..2000 {
            let mut point = |value: f64| ControlPoint {
                value,
                color: std::array::from_fn(|_| random.unit()),
                alpha: random.unit(),
            };
            let segment = Segment { ends: [point(0.0), point(1.0)], values: [0.0, 1.0] };
            let source = TransferFunction::new(segment.ends.to_vec(), 1.0).unwrap();
            let (x, h) = (0.1 + 0.8 * random.unit(), 1e-2);
            let bounds = segment.third_derivatives(&source, [x - 2.0 * h, x + 2.0 * h]);
            let at = |steps: f64| segment.at(&source, x + steps * h);
            let [a, b, c, d] = [at(-1.5), at(-0.5), at(0.5), at(1.5)];
            for channel in 0..CHANNELS {
                let third = (d[channel] - 3.0 * c[channel] + 3.0 * b[channel] - a[channel]) / h.powi(3);
                // Some of it is rounding: eight values, over h^3.
                assert!(third.abs() <= bounds[channel] + 1e-6, "{third} above {}: {segment:?}", bounds[channel]);
            }
        }
    }
}
