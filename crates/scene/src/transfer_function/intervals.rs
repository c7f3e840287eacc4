//! Extremes and means of a transfer function over intervals of values: exact, `f64`, data values.
//!
//! The level-of-detail rules query them once per brick, not per sample. A table holds extremes over runs of 1, 2, 4,
//! ... control points. A query takes two binary searches and two look-ups, and misses no step or spike, however narrow.

use super::{ControlPoint, TransferFunction};

/// Least and greatest red, green, blue and alpha over an interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// Least of each channel.
    pub low: [f64; 4],
    /// Greatest of each channel.
    pub high: [f64; 4],
}

impl Extent {
    fn of(channels: [f64; 4]) -> Self {
        Self { low: channels, high: channels }
    }

    fn union(self, other: Self) -> Self {
        Self {
            low: std::array::from_fn(|c| self.low[c].min(other.low[c])),
            high: std::array::from_fn(|c| self.high[c].max(other.high[c])),
        }
    }

    /// Greatest change of a colour channel over the interval.
    #[must_use]
    pub fn color_change(&self) -> f64 {
        (0..3).map(|c| self.high[c] - self.low[c]).fold(0.0, f64::max)
    }
}

/// Tables for queries of intervals; see the module.
#[derive(Debug, Clone)]
pub struct Intervals {
    function: TransferFunction,
    /// `runs[k][i]`: extremes of the `2^k` points that begin at point i.
    runs: Vec<Vec<Extent>>,
    /// Integral from the first point to each point of alpha times red, green and blue, and of alpha.
    gathered: Vec<[f64; 4]>,
}

impl Intervals {
    /// The tables of a transfer function.
    #[must_use]
    pub fn new(function: &TransferFunction) -> Self {
        let points = function.points();
        let mut runs = vec![points.iter().map(|p| Extent::of(channels(p.color, p.alpha))).collect::<Vec<_>>()];
        while let Some(last) = runs.last().filter(|last| last.len() > 1) {
            let half = 1 << (runs.len() - 1);
            let joined =
                (0..last.len().saturating_sub(half)).map(|i| last[i].union(last[i + half])).collect::<Vec<_>>();
            if joined.is_empty() {
                break;
            }
            runs.push(joined);
        }
        let mut gathered = vec![[0.0; 4]];
        for pair in points.windows(2) {
            let before = gathered[gathered.len() - 1];
            let piece = integral(&pair[0], &pair[1]);
            gathered.push(std::array::from_fn(|c| before[c] + piece[c]));
        }
        Self { function: function.clone(), runs, gathered }
    }

    /// The transfer function.
    #[must_use]
    pub fn function(&self) -> &TransferFunction {
        &self.function
    }

    /// Extremes over the closed interval. Both sides of every step count, also of steps at the ends.
    #[must_use]
    pub fn extent(&self, low: f64, high: f64) -> Extent {
        let points = self.function.points();
        let at = |value: f64| {
            let (color, alpha) = self.function.classify(value);
            Extent::of(channels(color, alpha))
        };
        let ends = at(low).union(at(high));
        let (start, end) = (points.partition_point(|p| p.value < low), points.partition_point(|p| p.value <= high));
        if start >= end {
            return ends;
        }
        let k = (end - start).ilog2() as usize;
        ends.union(self.runs[k][start]).union(self.runs[k][end - (1 << k)])
    }

    /// Whether every channel is linear over the closed interval.
    #[must_use]
    pub fn is_linear(&self, low: f64, high: f64) -> bool {
        let points = self.function.points();
        points.partition_point(|p| p.value < low) == points.partition_point(|p| p.value <= high)
    }

    /// Means over the interval of alpha times red, green and blue, and of alpha; the values themselves for an interval
    /// of zero width.
    #[must_use]
    pub fn mean(&self, low: f64, high: f64) -> [f64; 4] {
        let width = high - low;
        if !(width > 0.0 && width.is_finite()) {
            let (color, alpha) = self.function.classify(low);
            return weighted(channels(color, alpha));
        }
        let (to_low, to_high) = (self.antiderivative(low), self.antiderivative(high));
        std::array::from_fn(|c| (to_high[c] - to_low[c]) / width)
    }

    /// Integral from the first point to `value`.
    fn antiderivative(&self, value: f64) -> [f64; 4] {
        let points = self.function.points();
        let next = points.partition_point(|p| p.value <= value);
        let (color, alpha) = self.function.classify(value);
        let here = ControlPoint { value, color, alpha };
        let (from, sum) = match next.checked_sub(1) {
            None => (ControlPoint { value: points[0].value, ..here }, [0.0; 4]),
            Some(i) => (points[i], self.gathered[i]),
        };
        let piece = integral(&from, &here);
        std::array::from_fn(|c| sum[c] + piece[c])
    }
}

fn channels([r, g, b]: [f64; 3], alpha: f64) -> [f64; 4] {
    [r, g, b, alpha]
}

fn weighted([r, g, b, alpha]: [f64; 4]) -> [f64; 4] {
    [r * alpha, g * alpha, b * alpha, alpha]
}

/// Integral of alpha times colour, and of alpha, between two points of one segment. All channels are linear there, so
/// their products are quadratic and Simpson's rule is exact.
fn integral(from: &ControlPoint, to: &ControlPoint) -> [f64; 4] {
    let width = to.value - from.value;
    if width == 0.0 {
        return [0.0; 4];
    }
    let (a, b) = (channels(from.color, from.alpha), channels(to.color, to.alpha));
    let middle = std::array::from_fn(|c| 0.5 * (a[c] + b[c]));
    let [a, m, b] = [a, middle, b].map(weighted);
    std::array::from_fn(|c| width / 6.0 * (a[c] + 4.0 * m[c] + b[c]))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn extremes_and_means_are_those_of_dense_sampling(
            mut points in prop::collection::vec((0u8..24, 0.0f64..1.0, prop::sample::select(vec![0.0, 0.1, 1.0])), 1..40),
            a in -4.0f64..28.0, b in -4.0f64..28.0,
        ) {
            points.sort_by_key(|p| p.0);
            let points = points.iter().map(|&(value, red, alpha)| {
                ControlPoint { value: f64::from(value), color: [red, 1.0 - red, 0.5], alpha }
            });
            let function = TransferFunction::new(points.collect(), 1.0).unwrap();
            let table = Intervals::new(&function);
            let (low, high) = (a.min(b), a.max(b));
            let extent = table.extent(low, high);
            prop_assert_eq!(table.is_linear(low, high), !function.points().iter().any(|p| low <= p.value && p.value <= high));
            let parts = 20_000;
            let mut sum = [0.0; 4];
            let mut seen: Option<Extent> = None;
            for i in 0..parts {
                let value = low + (high - low) * (f64::from(i) + 0.5) / f64::from(parts);
                let (color, alpha) = function.classify(value);
                let here = channels(color, alpha);
                for c in 0..4 {
                    prop_assert!(extent.low[c] <= here[c] && here[c] <= extent.high[c]);
                    sum[c] += weighted(here)[c] / f64::from(parts);
                }
                seen = Some(seen.map_or(Extent::of(here), |s| s.union(Extent::of(here))));
            }
            let mean = table.mean(low, high);
            for c in 0..4 {
                prop_assert!((mean[c] - sum[c]).abs() < 2e-3, "channel {c}: {} and {}", mean[c], sum[c]);
            }
            // The extremes are also tight if no step lies in the interval, because a linear function changes little
            // between samples.
            let steps = function.points().windows(2).any(|p| p[0].value == p[1].value && low <= p[0].value && p[0].value <= high);
            if let (false, Some(seen)) = (steps, seen) {
                for c in 0..4 {
                    prop_assert!(extent.high[c] - seen.high[c] < 2e-3 && seen.low[c] - extent.low[c] < 2e-3);
                }
            }
        }
    }

    #[test]
    fn steps_and_spikes_at_the_ends_count() {
        let point = |value, alpha| ControlPoint { value, color: [1.0, 0.5, 0.0], alpha };
        let points = vec![point(0.0, 0.0), point(5.0, 0.0), point(5.0, 0.9), point(5.0, 0.0), point(9.0, 0.0)];
        let table = Intervals::new(&TransferFunction::new(points, 1.0).unwrap());
        for (low, high, alpha) in [(5.0, 5.0, 0.9), (4.0, 5.0, 0.9), (5.0, 6.0, 0.9), (5.1, 8.0, 0.0), (0.0, 4.9, 0.0)]
        {
            assert_eq!(table.extent(low, high).high[3], alpha, "[{low}, {high}]");
            assert_eq!(table.extent(low, high).color_change(), 0.0);
        }
        assert_eq!(table.mean(0.0, 9.0), [0.0; 4], "a spike without width has no mean");
    }
}
