//! Reversible transforms of a box of integers, in place, with wrapping arithmetic: exact for all 32-bit samples.
//!
//! *Differences* along x, then y, then z: the Lorenzo predictor (Ibarria et al. 2003). It wins where the field is
//! smooth on the scale of a voxel, or has few values. *Lifting*: the reversible 5/3 wavelet (Le Gall and Tabatabai
//! 1988; lifting: Calderbank, Daubechies, Sweldens, Yeo 1998) on every axis, repeated on the half with the averages. It
//! wins on noisy fields: differences along three axes amplify noise eightfold. For n samples x along a line
//!
//! ```text
//! d_i = x_{2i+1} - floor((x_{2i} + x_{2i+2} + 1) / 2)        i = 0 .. floor(n/2)
//! s_i = x_{2i}   + floor((d_{i-1} + d_i + 2) / 4)            i = 0 .. ceil(n/2)
//! ```
//!
//! where positions beyond the end are clamped to the end. Afterwards all s precede all d, so that a box consists of up
//! to eight *bands*. An axis is halved while it has at least [`SHORTEST`] samples.
//!
//! Samples of one-byte voxels are transformed in 16 bits, which halves the memory traffic. Over all halvings of one
//! axis, s and d are at most 1.72 and 2.86 times as large as x. Along three axes that is less than 24 times.

use std::ops::Range;

use super::super::sample::Sample;

/// A line of fewer samples is not halved further.
const SHORTEST: usize = 5;

/// Part of a box: the first sample on each axis, and one past the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Band {
    pub start: [usize; 3],
    pub end: [usize; 3],
}

impl Band {
    pub fn extent(self) -> [usize; 3] {
        std::array::from_fn(|a| self.end[a] - self.start[a])
    }

    pub fn samples(self) -> usize {
        self.extent().iter().product()
    }
}

/// Extents that are halved, finest first. Halving the last one gives the rest, which is not halved.
fn halvings(extent: [usize; 3]) -> Vec<[usize; 3]> {
    let halves = |&e: &[usize; 3]| Some(half(e)).filter(|h| *h != e);
    let mut all: Vec<_> = std::iter::successors(Some(extent), halves).collect();
    all.pop();
    all
}

fn half(extent: [usize; 3]) -> [usize; 3] {
    extent.map(|n| if n < SHORTEST { n } else { n.div_ceil(2) })
}

/// Bands of a lifted box, coarsest first; together they are the box.
pub fn bands(extent: [usize; 3]) -> Vec<Band> {
    let halvings = halvings(extent);
    let rest = halvings.last().map_or(extent, |&e| half(e));
    let mut bands = vec![Band { start: [0; 3], end: rest }];
    for &whole in halvings.iter().rev() {
        let half = half(whole);
        let details = (1..8).map(|corner| {
            let is_detail = |a: usize| corner >> a & 1 == 1;
            Band {
                start: std::array::from_fn(|a| if is_detail(a) { half[a] } else { 0 }),
                end: std::array::from_fn(|a| if is_detail(a) { whole[a] } else { half[a] }),
            }
        });
        bands.extend(details.filter(|band| band.samples() > 0));
    }
    bands
}

/// Rows of a box that follow one another along an axis: `count` rows of `length` samples, `stride` samples apart.
#[derive(Clone, Copy)]
struct Rows {
    first: usize,
    stride: usize,
    count: usize,
    length: usize,
}

impl Rows {
    /// All such groups of rows of the part `[0, part)` of a box, along y (1) or z (2).
    fn along(axis: usize, extent: [usize; 3], part: [usize; 3]) -> impl Iterator<Item = Self> {
        let strides = [1, extent[0], extent[0] * extent[1]];
        let across = 3 - axis;
        let rows =
            move |i| Self { first: i * strides[across], stride: strides[axis], count: part[axis], length: part[0] };
        (0..part[across]).map(rows)
    }

    fn row(self, i: usize) -> Range<usize> {
        let start = self.first + i * self.stride;
        start..start + self.length
    }
}

/// Prediction of the sample between two neighbours: d is the sample minus this.
#[inline(always)]
fn predicted<S: Sample>(before: S, after: S) -> S {
    before.plus(after).plus(S::wrap(1)).shifted::<1>()
}

/// Update: s is x plus this, computed from the two neighbouring d.
#[inline(always)]
fn updated<S: Sample>(before: S, after: S) -> S {
    before.plus(after).plus(S::wrap(2)).shifted::<2>()
}

/// Lifts a box of this extent.
#[inline(always)]
pub fn lift<S: Sample>(samples: &mut [S], extent: [usize; 3]) {
    let mut scratch = Vec::new();
    for part in halvings(extent) {
        // Slice by slice along x and y, while the slice is in the first-level cache.
        for (z, rows) in Rows::along(1, extent, part).enumerate() {
            if part[0] >= SHORTEST {
                lift_along_x(samples, rows_of_x(extent, part, z), &mut scratch);
            }
            if part[1] >= SHORTEST {
                lift_rows(samples, rows, &mut scratch);
            }
        }
        if part[2] >= SHORTEST {
            for rows in Rows::along(2, extent, part) {
                lift_rows(samples, rows, &mut scratch);
            }
        }
    }
}

/// Reverses [`lift`].
#[inline(always)]
pub fn unlift<S: Sample>(samples: &mut [S], extent: [usize; 3]) {
    let mut scratch = Vec::new();
    for part in halvings(extent).into_iter().rev() {
        if part[2] >= SHORTEST {
            for rows in Rows::along(2, extent, part) {
                unlift_rows(samples, rows, &mut scratch);
            }
        }
        for (z, rows) in Rows::along(1, extent, part).enumerate() {
            if part[1] >= SHORTEST {
                unlift_rows(samples, rows, &mut scratch);
            }
            if part[0] >= SHORTEST {
                unlift_along_x(samples, rows_of_x(extent, part, z), &mut scratch);
            }
        }
    }
}

/// The rows along x of one slice of the part `[0, part)` of a box.
#[inline(always)]
fn rows_of_x(extent: [usize; 3], part: [usize; 3], z: usize) -> Rows {
    Rows { first: z * extent[1] * extent[0], stride: extent[0], count: part[1], length: part[0] }
}

/// Lifts each of some rows. Each step runs over all rows before the next step begins: a shifted load of a value that
/// was just stored would stall.
#[inline(always)]
fn lift_along_x<S: Sample>(samples: &mut [S], rows: Rows, scratch: &mut Vec<S>) {
    let (evens, odds) = (rows.length.div_ceil(2), rows.length / 2);
    scratch.resize(rows.count * rows.length, S::default());
    let (even, odd) = scratch.split_at_mut(rows.count * evens);
    for (i, (even, odd)) in even.chunks_exact_mut(evens).zip(odd.chunks_exact_mut(odds)).enumerate() {
        let row = &samples[rows.row(i)];
        for ((even, odd), pair) in even.iter_mut().zip(odd.iter_mut()).zip(row.chunks_exact(2)) {
            (*even, *odd) = (pair[0], pair[1]);
        }
        if evens > odds {
            even[odds] = row[2 * odds];
        }
    }
    for (even, odd) in even.chunks_exact(evens).zip(odd.chunks_exact_mut(odds)) {
        for (d, s) in odd.iter_mut().zip(even.windows(2)) {
            *d = d.minus(predicted(s[0], s[1]));
        }
        if evens == odds {
            odd[odds - 1] = odd[odds - 1].minus(predicted(even[evens - 1], even[evens - 1]));
        }
    }
    for (i, (even, odd)) in even.chunks_exact(evens).zip(odd.chunks_exact(odds)).enumerate() {
        let (s, d) = samples[rows.row(i)].split_at_mut(evens);
        d.copy_from_slice(odd);
        update(s, even, odd, |x, by| x.plus(by));
    }
}

/// Reverses [`lift_along_x`].
#[inline(always)]
fn unlift_along_x<S: Sample>(samples: &mut [S], rows: Rows, scratch: &mut Vec<S>) {
    let (evens, odds) = (rows.length.div_ceil(2), rows.length / 2);
    scratch.resize(rows.count * rows.length, S::default());
    let (even, odd) = scratch.split_at_mut(rows.count * evens);
    for (i, even) in even.chunks_exact_mut(evens).enumerate() {
        let (s, d) = samples[rows.row(i)].split_at(evens);
        update(even, s, d, |x, by| x.minus(by));
    }
    for (i, (even, odd)) in even.chunks_exact(evens).zip(odd.chunks_exact_mut(odds)).enumerate() {
        let d = &samples[rows.row(i)][evens..];
        for ((x, &d), s) in odd.iter_mut().zip(d).zip(even.windows(2)) {
            *x = d.plus(predicted(s[0], s[1]));
        }
        if evens == odds {
            odd[odds - 1] = d[odds - 1].plus(predicted(even[evens - 1], even[evens - 1]));
        }
    }
    for (i, (even, odd)) in even.chunks_exact(evens).zip(odd.chunks_exact(odds)).enumerate() {
        let row = &mut samples[rows.row(i)];
        for ((even, odd), pair) in even.iter().zip(odd).zip(row.chunks_exact_mut(2)) {
            (pair[0], pair[1]) = (*even, *odd);
        }
        if evens > odds {
            row[2 * odds] = even[odds];
        }
    }
}

/// Updates the samples at the even positions of a line with the details on both sides.
#[inline(always)]
fn update<S: Sample>(target: &mut [S], even: &[S], details: &[S], by: impl Fn(S, S) -> S) {
    let last = details.len() - 1;
    target[0] = by(even[0], updated(details[0], details[0]));
    for ((target, &x), d) in target[1..].iter_mut().zip(&even[1..]).zip(details.windows(2)) {
        *target = by(x, updated(d[0], d[1]));
    }
    // With as many s as d, the windows end before the last s. With one s more, only the last d lies beside it.
    if even.len() > details.len() {
        target[last + 1] = by(even[last + 1], updated(details[last], details[last]));
    }
}

/// Writes a row, changed by two other rows.
#[inline(always)]
fn change_row<S: Sample>(target: &mut [S], row: &[S], before: &[S], after: &[S], by: impl Fn(S, S, S) -> S) {
    for (((target, &x), &b), &a) in target.iter_mut().zip(row).zip(before).zip(after) {
        *target = by(x, b, a);
    }
}

/// As [`change_row`], but writes to the row `to`, which does not lie behind `from`.
#[inline(always)]
fn move_row<S: Sample>(
    samples: &mut [S],
    [from, to]: [Range<usize>; 2],
    before: &[S],
    after: &[S],
    by: impl Fn(S, S, S) -> S,
) {
    if from == to {
        for ((x, &b), &a) in samples[to].iter_mut().zip(before).zip(after) {
            *x = by(*x, b, a);
        }
    } else {
        let (head, tail) = samples.split_at_mut(from.start);
        change_row(&mut head[to], tail, before, after, by);
    }
}

#[inline(always)]
fn lift_rows<S: Sample>(samples: &mut [S], rows: Rows, scratch: &mut Vec<S>) {
    let (halves, n, last) = (rows.count.div_ceil(2), rows.length, rows.count / 2 - 1);
    scratch.resize((last + 1) * n, S::default());
    for (i, target) in scratch.chunks_exact_mut(n).enumerate() {
        let [own, before, after] = [2 * i + 1, 2 * i, 2 * (i + 1).min(halves - 1)].map(|row| &samples[rows.row(row)]);
        change_row(target, own, before, after, |x, b, a| x.minus(predicted(b, a)));
    }
    for i in 0..halves {
        // Starting with the first row, each overwritten row has already been read.
        let [before, after] = [i.saturating_sub(1), i.min(last)].map(|d| &scratch[d * n..(d + 1) * n]);
        move_row(samples, [2 * i, i].map(|row| rows.row(row)), before, after, |x, b, a| x.plus(updated(b, a)));
    }
    for (i, row) in scratch.chunks_exact(n).enumerate() {
        samples[rows.row(halves + i)].copy_from_slice(row);
    }
}

#[inline(always)]
fn unlift_rows<S: Sample>(samples: &mut [S], rows: Rows, scratch: &mut Vec<S>) {
    let (halves, n, last) = (rows.count.div_ceil(2), rows.length, rows.count / 2 - 1);
    scratch.resize(halves * n, S::default());
    for (i, target) in scratch.chunks_exact_mut(n).enumerate() {
        let [own, before, after] =
            [i, halves + i.saturating_sub(1), halves + i.min(last)].map(|row| &samples[rows.row(row)]);
        change_row(target, own, before, after, |x, b, a| x.minus(updated(b, a)));
    }
    for i in 0..=last {
        // Starting with the first row, as in [`lift_rows`].
        let [before, after] = [i, (i + 1).min(halves - 1)].map(|s| &scratch[s * n..(s + 1) * n]);
        let places = [halves + i, 2 * i + 1].map(|row| rows.row(row));
        move_row(samples, places, before, after, |x, b, a| x.plus(predicted(b, a)));
    }
    for (i, row) in scratch.chunks_exact(n).enumerate() {
        samples[rows.row(2 * i)].copy_from_slice(row);
    }
}

/// Differences along x, y and z.
#[inline(always)]
pub fn difference<S: Sample>(samples: &mut [S], extent: [usize; 3]) {
    for row in samples.chunks_exact_mut(extent[0]) {
        for i in (1..row.len()).rev() {
            row[i] = row[i].minus(row[i - 1]);
        }
    }
    for axis in [1, 2] {
        for rows in Rows::along(axis, extent, extent) {
            for i in (1..rows.count).rev() {
                let (before, own) = samples.split_at_mut(rows.row(i).start);
                let before = &before[rows.row(i - 1)];
                for (x, b) in own.iter_mut().zip(before) {
                    *x = x.minus(*b);
                }
            }
        }
    }
}

/// Reverses [`difference`].
#[inline(always)]
pub fn undo_difference<S: Sample>(samples: &mut [S], extent: [usize; 3]) {
    for axis in [2, 1] {
        for rows in Rows::along(axis, extent, extent) {
            for i in 1..rows.count {
                let (before, own) = samples.split_at_mut(rows.row(i).start);
                let before = &before[rows.row(i - 1)];
                for (x, b) in own.iter_mut().zip(before) {
                    *x = x.plus(*b);
                }
            }
        }
    }
    for row in samples.chunks_exact_mut(extent[0]) {
        let mut sum = S::default();
        for x in row {
            sum = sum.plus(*x);
            *x = sum;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use proptest::prelude::*;

    fn noise(n: usize, spread: u64) -> Vec<i32> {
        let mut random = Random::new(99);
        (0..n).map(|_| random.below(spread) as i32).collect()
    }

    const EXTENTS: [[usize; 3]; 8] =
        [[1, 1, 1], [4, 5, 6], [5, 1, 1], [9, 7, 8], [68, 5, 17], [20, 20, 20], [1, 37, 3], [13, 68, 66]];

    #[test]
    fn both_transforms_are_undone_exactly() {
        for extent in EXTENTS {
            for spread in [2, 1 << 12, 1 << 31] {
                let original = noise(extent.iter().product(), spread);
                for (there, back) in [
                    (lift as fn(&mut [i32], [usize; 3]), unlift as fn(&mut [i32], [usize; 3])),
                    (difference, undo_difference),
                ] {
                    let mut samples = original.clone();
                    there(&mut samples, extent);
                    back(&mut samples, extent);
                    assert!(samples == original, "{extent:?}, spread {spread}");
                }
            }
        }
    }

    #[test]
    fn bands_tile_the_box() {
        for extent in EXTENTS {
            let mut covered = vec![0u8; extent.iter().product()];
            for band in bands(extent) {
                for z in band.start[2]..band.end[2] {
                    for y in band.start[1]..band.end[1] {
                        for x in band.start[0]..band.end[0] {
                            covered[(z * extent[1] + y) * extent[0] + x] += 1;
                        }
                    }
                }
            }
            assert!(covered.iter().all(|&n| n == 1), "{extent:?}");
        }
    }

    /// The formulas of the module head, literally, on one line with clamped positions.
    #[test]
    fn a_line_is_lifted_as_the_formulas_say() {
        for n in [5usize, 6, 9, 12] {
            let x = noise(n, 1000);
            let (evens, odds) = (n.div_ceil(2), n / 2);
            let even = |i: usize| x[2 * i.min(evens - 1)];
            let d: Vec<i32> = (0..odds).map(|i| x[2 * i + 1] - (even(i) + even(i + 1) + 1).div_euclid(2)).collect();
            let detail = |i: isize| d[i.clamp(0, odds as isize - 1) as usize];
            let s = (0..evens).map(|i| even(i) + (detail(i as isize - 1) + detail(i as isize) + 2).div_euclid(4));
            let expected: Vec<i32> = s.chain(d.iter().copied()).collect();
            for axis in 0..3 {
                let mut extent = [1; 3];
                extent[axis] = n;
                let mut once = x.clone();
                if axis == 0 {
                    lift_along_x(&mut once, rows_of_x(extent, extent, 0), &mut Vec::new());
                } else {
                    Rows::along(axis, extent, extent).for_each(|rows| lift_rows(&mut once, rows, &mut Vec::new()));
                }
                assert_eq!(once, expected, "{n} samples along axis {axis}");
            }
        }
    }

    /// Weights of a line's samples in each coefficient, without rounding, from the first halving to the last.
    fn weights(n: usize) -> Vec<Vec<f64>> {
        let sum = |parts: &[(&Vec<f64>, f64)]| -> Vec<f64> {
            (0..n).map(|i| parts.iter().map(|(weights, by)| by * weights[i]).sum()).collect()
        };
        let mut line: Vec<Vec<f64>> = (0..n).map(|i| (0..n).map(|j| f64::from(u8::from(i == j))).collect()).collect();
        let mut all = Vec::new();
        while line.len() >= SHORTEST {
            let (evens, odds) = (line.len().div_ceil(2), line.len() / 2);
            let even = |i: usize| &line[2 * i.min(evens - 1)];
            let d: Vec<_> =
                (0..odds).map(|i| sum(&[(&line[2 * i + 1], 1.0), (even(i), -0.5), (even(i + 1), -0.5)])).collect();
            let detail = |i: usize| &d[i.min(odds - 1)];
            let s: Vec<_> = (0..evens)
                .map(|i| sum(&[(even(i), 1.0), (detail(i.saturating_sub(1)), 0.25), (detail(i), 0.25)]))
                .collect();
            all.extend(d);
            line = s.clone();
            all.extend(s);
        }
        all
    }

    /// The extreme coefficients of bytes along three axes are far from the limits of 16 bits. A volume near these
    /// extremes is lifted in 16 bits as in 32.
    #[test]
    fn bytes_are_lifted_in_16_bits() {
        let gain = |weights: &[f64]| weights.iter().map(|w| w.abs()).sum::<f64>();
        let most = (SHORTEST..=132).flat_map(weights).map(|weights| gain(&weights)).fold(0.0, f64::max);
        assert!((2.8..2.87).contains(&most), "along one axis samples become {most} times as large");
        // Each of 18 halvings rounds twice by less than 1, and the later ones amplify it.
        let rounding = 2.0 * 18.0 * most.powi(3);
        assert!(255.0 * most.powi(3) + rounding < f64::from(i16::MAX) / 4.0, "{most}");

        let line = weights(36);
        let worst = line.iter().max_by(|a, b| gain(a).total_cmp(&gain(b))).expect("there are some");
        let extent = [36, 36, 36];
        let sign = |i: usize| worst[i] < 0.0;
        for flipped in [false, true] {
            let bytes = (0..36 * 36 * 36).map(|i| sign(i % 36) ^ sign(i / 36 % 36) ^ sign(i / 1296) ^ flipped);
            let samples: Vec<i32> = bytes.map(|b| if b { 255 } else { 0 }).collect();
            let mut wide = samples.clone();
            let mut narrow: Vec<i16> = samples.iter().map(|&s| s as i16).collect();
            lift(&mut wide, extent);
            lift(&mut narrow, extent);
            let greatest = wide.iter().map(|c| c.abs()).max().expect("there are some");
            assert!(greatest > 2000, "at most {greatest}: not the worst");
            assert!(narrow.iter().map(|&s| i32::from(s)).eq(wide));
            unlift(&mut narrow, extent);
            assert!(narrow.iter().map(|&s| i32::from(s)).eq(samples));
        }
    }

    /// Both transforms predict a ramp exactly: no details remain inside.
    #[test]
    fn ramps_leave_no_details() {
        let extent = [17, 17, 17];
        let ramp: Vec<i32> = (0..17 * 17 * 17).map(|i| i % 17 * 2 + i / 17 % 17 * 4).collect();
        let mut lifted = ramp.clone();
        lift(&mut lifted, extent);
        let details = lifted.iter().enumerate().filter(|(i, v)| **v != 0 && i % 17 > 8).count();
        assert!(details == 0, "{details} details along x");
        let mut differences = ramp;
        difference(&mut differences, extent);
        assert_eq!(differences.iter().filter(|v| **v != 0).count(), 32);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn any_integers_survive(samples in proptest::collection::vec(any::<i32>(), 6 * 7 * 11)) {
            let extent = [11, 6, 7];
            let mut changed = samples.clone();
            lift(&mut changed, extent);
            unlift(&mut changed, extent);
            prop_assert_eq!(&changed, &samples);
            difference(&mut changed, extent);
            undo_difference(&mut changed, extent);
            prop_assert_eq!(&changed, &samples);
        }
    }
}
