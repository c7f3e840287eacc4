//! The field along a ray, cell by cell: between two faces of trilinear cells it is a cubic.
//!
//! t is a length in the units of the picture; x runs from 0 to 1 through one piece of a ray.

use supervol_scene::scene::GradientOpacity;
use supervol_scene::transfer_function::TransferFunction;

use crate::engines::cells::cell::cubic_mean;

/// Sampling positions in a piece, in x: all inside, so that no voxel of a neighbouring cell is read. They are Chebyshev
/// nodes, which give the ends with hardly more rounding.
pub const NODES: [f64; 4] =
    [0.038_060_233_744_356_6, 0.308_658_283_817_455, 0.691_341_716_182_545, 0.961_939_766_255_643_4];
/// Halvings after which an interval is empty in `f64`.
const HALVINGS: usize = 60;
/// Gauss's rule of six points: distances from the middle of an interval, in halves of it, and weights.
const GAUSS: [[f64; 2]; 3] = [
    [0.238_619_186_083_196_9, 0.467_913_934_572_691],
    [0.661_209_386_466_264_5, 0.360_761_573_048_138_6],
    [0.932_469_514_203_152, 0.171_324_492_379_170_35],
];

/// A ray in the index space of a level, cut at the faces of its cells.
#[derive(Debug, Clone)]
pub struct Cells {
    origin: [f64; 3],
    direction: [f64; 3],
    t: f64,
    end: f64,
}

impl Cells {
    /// The cells of a part of a ray.
    #[must_use]
    pub fn new(origin: [f64; 3], direction: [f64; 3], [t, end]: [f64; 2]) -> Self {
        Self { origin, direction, t, end }
    }
}

impl Iterator for Cells {
    /// Begin and end, t.
    type Item = [f64; 2];

    fn next(&mut self) -> Option<[f64; 2]> {
        if self.t >= self.end {
            return None;
        }
        let next = (0..3).filter(|&a| self.direction[a] != 0.0).map(|a| {
            let (origin, direction) = (self.origin[a], self.direction[a]);
            let at = origin + self.t * direction;
            let (face, step) = if direction > 0.0 { (at.floor() + 1.0, 1.0) } else { (at.ceil() - 1.0, -1.0) };
            let t = (face - origin) / direction;
            // Rounding may have left the ray on the near side of a face that it has passed.
            if t > self.t { t } else { (face + step - origin) / direction }
        });
        let next = next.fold(self.end, f64::min);
        let piece = [self.t, if next > self.t { next } else { self.end }];
        self.t = piece[1];
        Some(piece)
    }
}

/// Parts of a piece in which the gradient's length is searched for the ends of a ramp.
const SEARCHED: usize = 16;

/// Factor of extinction in a piece of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Factor {
    /// The whole extinction, or none.
    Constant(f64),
    /// That of the gradient with these components in the world.
    Ramp(GradientOpacity, [FieldCubic; 3]),
}

impl Factor {
    /// The factor at x.
    #[must_use]
    pub fn at(&self, x: f64) -> f64 {
        match self {
            Self::Constant(factor) => *factor,
            Self::Ramp(ramp, gradient) => ramp.factor(length(gradient, x)),
        }
    }

    /// Positions at which the gradient's length passes an end of the ramp.
    fn kinks(&self) -> Vec<f64> {
        let Self::Ramp(ramp, gradient) = self else { return Vec::new() };
        let place = |i: usize| i as f64 / SEARCHED as f64;
        let mut found = Vec::new();
        for (level, i) in [ramp.from, ramp.to].into_iter().flat_map(|level| (0..SEARCHED).map(move |i| (level, i))) {
            let is_above = |x: f64| length(gradient, x) >= level;
            let (mut low, mut high) = (place(i), place(i + 1));
            let before = is_above(low);
            if before == is_above(high) {
                continue;
            }
            for _ in 0..HALVINGS {
                let middle = 0.5 * (low + high);
                if is_above(middle) == before { low = middle } else { high = middle }
            }
            found.push(high);
        }
        found
    }
}

fn length(vector: &[FieldCubic; 3], x: f64) -> f64 {
    vector.iter().map(|component| component.at(x).powi(2)).sum::<f64>().sqrt()
}

/// The field in a piece of a ray: `c0 + c1 x + c2 x^2 + c3 x^3`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldCubic([f64; 4]);

impl FieldCubic {
    /// The cubic with these values at [`NODES`].
    #[must_use]
    pub fn through(values: [f64; 4]) -> Self {
        // Newton's divided differences, multiplied out from the last one on.
        let mut differences = values;
        for order in 1..4 {
            for i in (order..4).rev() {
                differences[i] = (differences[i] - differences[i - 1]) / (NODES[i] - NODES[i - order]);
            }
        }
        let mut c = [0.0; 4];
        for i in (0..4).rev() {
            let before = c;
            for (power, coefficient) in c.iter_mut().enumerate() {
                *coefficient = if power > 0 { before[power - 1] } else { 0.0 } - NODES[i] * before[power];
            }
            c[0] += differences[i];
        }
        Self(c)
    }

    /// The value at x.
    #[must_use]
    pub fn at(&self, x: f64) -> f64 {
        let [a, b, c, d] = self.0;
        a + x * (b + x * (c + x * d))
    }

    /// The mean from 0 to 1.
    #[must_use]
    pub fn mean(&self) -> f64 {
        cubic_mean(&self.0)
    }

    /// 0, the extrema of the field in between, and 1.
    #[must_use]
    pub fn turns(&self) -> Vec<f64> {
        let [_, b, c, d] = self.0;
        let (a2, a1, a0) = (3.0 * d, 2.0 * c, b);
        let root = (a1 * a1 - 4.0 * a2 * a0).sqrt();
        // Avoids cancellation, and handles lines, for which one root is infinite.
        let q = -0.5 * (a1 + root.copysign(a1));
        let mut turns: Vec<f64> = [q / a2, a0 / q].into_iter().filter(|x| *x > 0.0 && *x < 1.0).collect();
        turns.sort_by(f64::total_cmp);
        [vec![0.0], turns, vec![1.0]].concat()
    }

    /// Position at which the field passes a level, between two positions without an extremum in between.
    #[must_use]
    pub fn crossing(&self, [mut low, mut high]: [f64; 2], level: f64) -> f64 {
        let before = self.at(low) >= level;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if (self.at(middle) >= level) == before { low = middle } else { high = middle }
        }
        high
    }

    /// The piece cut at the field's extrema, at control points and at kinks of the factor: extinction is smooth in between.
    #[must_use]
    pub fn smooth_parts(&self, function: &TransferFunction, factor: &Factor) -> Vec<f64> {
        let mut cuts = self.turns();
        cuts.extend(factor.kinks());
        for ends in self.turns().windows(2) {
            let [a, b] = [self.at(ends[0]), self.at(ends[1])];
            let points = function.points();
            let first = points.partition_point(|point| point.value <= a.min(b));
            let last = points.partition_point(|point| point.value < a.max(b));
            for point in points.get(first..last).unwrap_or_default() {
                cuts.push(self.crossing([ends[0], ends[1]], point.value));
            }
        }
        cuts.sort_by(f64::total_cmp);
        cuts
    }

    /// Optical depth between two x in a piece of this length.
    #[must_use]
    pub fn depth(&self, [from, to]: [f64; 2], length: f64, function: &TransferFunction, factor: &Factor) -> f64 {
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        let kappa = |x: f64| factor.at(x) * function.kappa(function.classify(self.at(x)).1);
        let pairs = GAUSS.map(|[place, weight]| weight * (kappa(middle - half * place) + kappa(middle + half * place)));
        half * length * pairs.iter().sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use supervol_scene::transfer_function::ControlPoint;

    use super::*;

    fn cubic(c: [f64; 4]) -> FieldCubic {
        FieldCubic::through(NODES.map(|x| FieldCubic(c).at(x)))
    }

    #[test]
    fn cells_end_at_whole_numbers() {
        let cells = Cells::new([0.25, 5.0, 3.0], [0.5, -1.0, 0.0], [0.0, 3.0]);
        assert_eq!(cells.collect::<Vec<_>>(), [[0.0, 1.0], [1.0, 1.5], [1.5, 2.0], [2.0, 3.0]]);
        let long = Cells::new([1e9 + 0.3, 0.7, 0.1], [1.0, 0.3, -0.2], [0.0, 1000.0]);
        let pieces: Vec<[f64; 2]> = long.collect();
        assert!(pieces.windows(2).all(|w| w[0][1] == w[1][0]) && pieces.iter().all(|p| p[0] < p[1]));
        assert!(pieces.len() < 1600 && pieces.last().unwrap()[1] == 1000.0);
    }

    #[test]
    fn cubics_turn_and_cross_where_they_do() {
        // (x - 0.2) (x - 0.5) (x - 0.9)
        let field = cubic([-0.09, 0.73, -1.6, 1.0]);
        for (found, exact) in field.0.iter().zip([-0.09, 0.73, -1.6, 1.0]) {
            assert!((found - exact).abs() < 1e-13, "{field:?}");
        }
        let turns = field.turns();
        assert_eq!(turns.len(), 4);
        for (ends, root) in turns.windows(2).zip([0.2, 0.5, 0.9]) {
            assert!((field.crossing([ends[0], ends[1]], 0.0) - root).abs() < 1e-12);
        }
        assert_eq!(FieldCubic([3.0, 0.0, 0.0, 0.0]).turns(), [0.0, 1.0]);
        assert_eq!(FieldCubic([0.0, 2.0, 0.0, 0.0]).turns(), [0.0, 1.0]);
        assert_eq!(FieldCubic([0.0, 1.0, -1.0, 0.0]).turns(), [0.0, 0.5, 1.0]);
    }

    #[test]
    fn optical_depth_is_the_integral_of_extinction() {
        let point = |value: f64, alpha: f64| ControlPoint { value, color: [1.0; 3], alpha };
        // Clear below 0.25, half opaque above: a step in the middle of the piece.
        let function = TransferFunction::new(vec![point(0.0, 0.0), point(0.25, 0.0), point(0.25, 0.5)], 2.0).unwrap();
        let field = cubic([0.0, 0.0, 1.0, 0.0]);
        let depth_by = |factor: Factor| -> f64 {
            let parts = field.smooth_parts(&function, &factor);
            parts.windows(2).map(|ends| field.depth([ends[0], ends[1]], 3.0, &function, &factor)).sum()
        };
        let depth = depth_by(Factor::Constant(1.0));
        assert!((depth - 1.5 * 2f64.ln() / 2.0).abs() < 1e-12, "{depth}");
        // A gradient of length x, and a ramp from 0.6 to 0.8: the mean factor from 0.5 to 1 is 0.6.
        let gradient = [cubic([0.0, 0.6, 0.0, 0.0]), cubic([0.0; 4]), cubic([0.0, 0.8, 0.0, 0.0])];
        let depth = depth_by(Factor::Ramp(GradientOpacity { from: 0.6, to: 0.8 }, gradient));
        assert!((depth - 0.6 * 1.5 * 2f64.ln() / 2.0).abs() < 1e-9, "{depth}");
        assert_eq!(depth_by(Factor::Constant(0.0)), 0.0);
    }
}
