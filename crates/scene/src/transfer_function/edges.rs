//! Edges of visibility: the values at which a transfer function becomes visible or invisible. Visibility of value
//! ranges is queried millions of times.
//!
//! Over `f32`, visibility is a step function of the value, and so is the number of visible points up to a value.
//! Between two control points opacity is computed by monotone operations, rounding included. It therefore changes
//! between zero and positive at most once, at a number that bisection finds. So a few edges reproduce the function's
//! own answers bit for bit. A spike whose points fall on one `f32` value becomes two edges at that value.

use std::cmp::Ordering;

use super::render::RenderTransferFunction;

/// Sorted edges of visibility; see the module.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Edges {
    /// Ascending. Values are visible after an odd number of edges, each value from the edge itself on.
    at: Vec<f32>,
}

impl Edges {
    /// The edges of a transfer function.
    #[must_use]
    pub fn new(function: &RenderTransferFunction) -> Self {
        let mut edges = Self { at: Vec::new() };
        let mut visible_points = 0;
        let mut look_at = |value: f32| {
            let (was_visible, is_visible) = (edges.at.len() % 2 == 1, function.is_visible_at(value));
            let points = function.visible_points_up_to(value);
            let is_unseen_spike = !was_visible && !is_visible && points > visible_points;
            let count = if is_unseen_spike { 2 } else { usize::from(was_visible != is_visible) };
            edges.at.extend(std::iter::repeat_n(value, count));
            visible_points = points;
        };
        let values: Vec<f32> = function.points.iter().map(|p| p.value).collect();
        look_at(f32::NEG_INFINITY);
        for pair in values.windows(2).filter(|pair| pair[0] < pair[1]) {
            look_at(pair[0]);
            look_at(first_unlike(pair[0], pair[1].next_down(), |value| function.is_visible_at(value)));
        }
        look_at(values[values.len() - 1]);
        edges
    }

    /// Number of edges that a value has passed; NaN has passed all.
    #[inline]
    fn up_to(&self, value: f32) -> usize {
        self.at.partition_point(|edge| value.partial_cmp(edge) != Some(Ordering::Less))
    }

    /// See [`RenderTransferFunction::is_visible`].
    #[inline]
    #[must_use]
    pub fn is_visible(&self, low: f32, high: f32) -> bool {
        let ([first, last], is_empty) = ([self.up_to(low), self.up_to(high)], low > high);
        // No branches: visibility of successive ranges changes too often for branch prediction.
        !is_empty & (((first | last) % 2 == 1) | (first < last))
    }
}

/// The least number of the closed interval at which `holds` differs from its answer at `low`; `low` if there is none.
/// The answer must change at most once.
fn first_unlike(low: f32, high: f32, holds: impl Fn(f32) -> bool) -> f32 {
    let at_begin = holds(low);
    if holds(high) == at_begin {
        return low;
    }
    let (mut like, mut unlike) = (rank(low), rank(high));
    while like + 1 < unlike {
        let middle = like.midpoint(unlike);
        if holds(of_rank(middle)) == at_begin { like = middle } else { unlike = middle }
    }
    of_rank(unlike)
}

/// Rank of a number among all `f32` values in ascending order.
fn rank(value: f32) -> i64 {
    let bits = i64::from(value.to_bits() & 0x7fff_ffff);
    if value.is_sign_negative() { -1 - bits } else { bits }
}

/// The number of a rank.
fn of_rank(rank: i64) -> f32 {
    let magnitude = if rank < 0 { -1 - rank } else { rank };
    let value = f32::from_bits(u32::try_from(magnitude).expect("ranks of numbers have 31 bits"));
    if rank < 0 { -value } else { value }
}

#[cfg(test)]
mod tests {
    use supervol_format::random::Random;

    use super::*;
    use crate::transfer_function::{ControlPoint, TransferFunction};

    const FUNCTIONS: usize = 4000;

    /// Definition of visibility: the ends of the range, and all points between them in the order of the points.
    fn by_points(function: &RenderTransferFunction, low: f32, high: f32) -> bool {
        if low > high {
            return false;
        }
        let alpha_at = |value: f32| match function.segment(value) {
            None => function.points[0].rgba[3],
            Some(i) => {
                let p = &function.points[i];
                p.rgba[3] + ((value - p.value) * p.inverse_width).min(1.0) * p.delta[3]
            }
        };
        alpha_at(low) > 0.0
            || alpha_at(high) > 0.0
            || function.visible_points_up_to(high) > function.visible_points_up_to(low)
    }

    /// Functions with steps, spikes of zero width and of one ulp, points that `f32` merges, and opacities that `f32`
    /// rounds to 0.
    fn function(random: &mut Random) -> RenderTransferFunction {
        let start = random.of(&[0.0, -0.0, -3.0, 1e9, -2e38, 1e-40, -1e300]);
        let scale = random.of(&[1.0, 1.0, 1e-9, 1e-44, 3e37, 1e299]);
        let mut value: f64 = start;
        let points = (0..=random.index(12)).map(|_| {
            value = match random.index(6) {
                0 | 1 => value,
                2 => value.next_up(),
                3 => f64::from((value as f32).next_up()).max(value),
                _ => value + scale * (random.index(8) as f64),
            };
            let alpha = random.of(&[0.0, 0.0, 0.0, 1e-60, 1e-45, 1e-9, 0.3, 0.3 + 1e-12, 0.99995, 1.0]);
            ControlPoint { value: value.clamp(f64::MIN, f64::MAX), color: [0.5; 3], alpha }
        });
        let source = TransferFunction::new(points.collect(), 1.0).unwrap();
        RenderTransferFunction::new(&source, random.of(&[0.0, 0.0, start, 0.25]))
    }

    /// Values of points, their neighbours, values in between, and values that are not numbers.
    fn values(function: &RenderTransferFunction, random: &mut Random) -> Vec<f32> {
        let mut values = vec![f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, 0.0, -0.0];
        for (i, p) in function.points.iter().enumerate() {
            let next = function.points.get(i + 1).map_or(p.value + 1.0, |next| next.value);
            let inside = p.value.midpoint(next);
            let third = p.value + (next - p.value) * (random.index(1000) as f32 / 1000.0);
            values.extend([
                p.value,
                p.value.next_up(),
                p.value.next_down(),
                p.value.next_up().next_up(),
                inside,
                third,
            ]);
        }
        values.extend(function.edges.at.iter().flat_map(|edge| [*edge, edge.next_up(), edge.next_down()]));
        values
    }

    #[test]
    fn answers_are_those_of_the_points_bit_for_bit() {
        let mut random = Random::new(7);
        let (mut asked, mut visible, mut spikes) = (0u64, 0u64, 0u64);
        for _ in 0..FUNCTIONS {
            let function = function(&mut random);
            spikes += u64::from(function.edges.at.windows(2).any(|pair| pair[0] == pair[1]));
            let values = values(&function, &mut random);
            for &low in &values {
                for &high in &values {
                    let expected = by_points(&function, low, high);
                    let found = function.is_visible(low, high);
                    let points: Vec<_> = function.points.iter().map(|p| (p.value, p.rgba[3], p.delta[3])).collect();
                    assert_eq!(
                        found, expected,
                        "[{low:e}, {high:e}], edges {:?}, points {points:?}",
                        function.edges.at
                    );
                    (asked, visible) = (asked + 1, visible + u64::from(found));
                }
            }
        }
        // The random cases cover visible and invisible ranges about equally.
        assert!(asked > 3_000_000 && visible > asked / 8 && visible < asked - asked / 8, "{visible} of {asked}");
        assert!(spikes > 100, "{spikes} spikes that no value sees");
    }
}
