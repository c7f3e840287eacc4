//! Values that lie far from all others: single outliers, and numbers that stand for "no value" such as 1e30.
//!
//! The *central* intervals are found from the inside outwards. They begin as all intervals without 0.1 % of the voxels
//! at either end, and without the first and the last interval if this is not zero (a null may fill much of a volume).
//! Voxels of a background value do not count, if this has half of all voxels. Then the central intervals take in their
//! neighbours until the gap to the next one is [`GAP`] times as wide as they are. The rest is far.

use std::ops::Range;

use super::sketch::Interval;

/// Gap in front of far values, in widths of the central ones.
const GAP: f64 = 8.0;
/// One in so many voxels may be an outlier at either end.
const ONE_IN: u64 = 1000;
/// Fewest central intervals. Fewer are labels or a mask, of which none is far.
const LEAST: usize = 16;

/// Places of the central intervals among all, which ascend. `None` if no value is far.
pub fn central(intervals: &[Interval]) -> Option<Range<usize>> {
    let core = core(intervals)?;
    let Range { mut start, mut end } = core;
    // Scaled, because the range of doubles may be wider than the greatest double.
    let width = |low: f64, high: f64| high / 64.0 - low / 64.0;
    loop {
        let reach = GAP * width(intervals[start].low, intervals[end - 1].high);
        if start > 0 && width(intervals[start - 1].high, intervals[start].low) <= reach {
            start -= 1;
        } else if end < intervals.len() && width(intervals[end - 1].high, intervals[end].low) <= reach {
            end += 1;
        } else {
            break;
        }
    }
    (start > 0 || end < intervals.len()).then_some(start..end)
}

/// Intervals from which the search begins; `None` if there are too few.
fn core(intervals: &[Interval]) -> Option<Range<usize>> {
    let total: u64 = intervals.iter().map(|interval| interval.count).sum();
    let fullest = (0..intervals.len()).max_by_key(|&i| intervals[i].count)?;
    let background = Some(fullest).filter(|&i| intervals[i].count > total / 2);
    let count = |i: usize| if background == Some(i) { 0 } else { intervals[i].count };
    let may_be_null = |i: usize| intervals[i].low != 0.0;
    let (mut start, mut end) =
        (usize::from(may_be_null(0)), intervals.len() - usize::from(may_be_null(intervals.len() - 1)));
    if start >= end {
        return None;
    }
    let inside = start..end;
    let most = (inside.clone().map(count).sum::<u64>() / ONE_IN).max(1);
    let mut left = most;
    while start + 1 < end && count(start) <= left {
        left -= count(start);
        start += 1;
    }
    left = most;
    while start + 1 < end && count(end - 1) <= left {
        left -= count(end - 1);
        end -= 1;
    }
    if let Some(background) = background.filter(|i| inside.contains(i)) {
        (start, end) = (start.min(background), end.max(background + 1));
    }
    (end - start >= LEAST).then_some(start..end)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Range of the central values of these values with their counts.
    fn of(mut values: Vec<(f64, u64)>) -> Option<[f64; 2]> {
        values.sort_by(|a, b| a.0.total_cmp(&b.0));
        let intervals: Vec<Interval> =
            values.into_iter().map(|(value, count)| Interval { low: value, high: value, count }).collect();
        central(&intervals).map(|range| [intervals[range.start].low, intervals[range.end - 1].high])
    }

    fn with(far: &[(f64, u64)]) -> Vec<(f64, u64)> {
        let near = (-100..=100).map(|i: i32| (f64::from(i), u64::from(150 - i.unsigned_abs())));
        near.chain(far.iter().copied()).collect()
    }

    #[test]
    fn outliers_and_nulls_of_any_size_are_far() {
        assert_eq!(of(with(&[])), None);
        for far in [1e4, 1e6, -1e8, 1e30, -f64::MAX, f64::MAX] {
            assert_eq!(of(with(&[(far, 1)])), Some([-100.0, 100.0]), "{far}");
            // A null may fill most of the volume.
            assert_eq!(of(with(&[(far, 200_000)])), Some([-100.0, 100.0]), "{far}");
        }
        let both = with(&[(-1e30, 4000), (1e30, 500), (1e6, 2), (-1e9, 1)]);
        assert_eq!(of(both), Some([-100.0, 100.0]));
    }

    #[test]
    fn what_belongs_to_the_rest_is_not_far() {
        // Near ones, a second class of many values, a background of zeros.
        assert_eq!(of(with(&[(900.0, 1), (1500.0, 1)])), None);
        let bright = (0..40).map(|i| (5000.0 + f64::from(i), 30));
        assert_eq!(of(with(&bright.collect::<Vec<_>>())), None);
        let hot: Vec<_> = (0..100).map(|i| (293.0 + f64::from(i) / 100.0, 10)).chain([(0.0, 5000)]).collect();
        assert_eq!(of(hot), None);
    }

    #[test]
    fn the_few_voxels_in_an_empty_volume_are_central() {
        let sparse = |far: f64| (1..=50).map(|i| (f64::from(i), 2)).chain([(0.0, 1_000_000), (far, 1)]).collect();
        assert_eq!(of(sparse(60.0)), None);
        assert_eq!(of(sparse(1e6)), Some([0.0, 50.0]));
    }

    #[test]
    fn a_mask_and_labels_have_no_far_values() {
        assert_eq!(of(vec![(0.0, 900), (255.0, 100)]), None);
        assert_eq!(of(vec![(0.0, 900), (1.0, 50), (2.0, 40), (65_535.0, 5)]), None);
        assert_eq!(of(Vec::new()), None);
        assert_eq!(of(vec![(7.0, 3)]), None);
    }
}
