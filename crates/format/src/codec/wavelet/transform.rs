//! Invertible transforms of a box of integers, in place, in 32 bits that wrap around: exact for all integers.
//!
//! *Differences* along x, then y, then z: the Lorenzo predictor (Ibarria et al. 2003), best where the field is smooth on the
//! scale of a voxel or made of few values. *Lifting*: the reversible 5/3 wavelet (Le Gall and Tabatabai 1988; lifting:
//! Calderbank, Daubechies, Sweldens, Yeo 1998) on every axis, again and again on the half with the averages; best where
//! there is noise, which differences along three axes make eight times as strong. Of n samples x along a line
//!
//! ```text
//! d_i = x_{2i+1} - floor((x_{2i} + x_{2i+2} + 1) / 2)        i = 0 .. floor(n/2)
//! s_i = x_{2i}   + floor((d_{i-1} + d_i + 2) / 4)            i = 0 .. ceil(n/2)
//! ```
//!
//! where what lies beyond the end is taken from the end. All s stand before all d afterwards, so that a box is cut into up
//! to eight *bands*. An axis is halved as long as it has [`SHORTEST`] samples.

/// A line of fewer samples is not halved any more.
const SHORTEST: usize = 5;

/// Part of a box: first and one past the last sample on each axis.
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

/// The extents that are halved, finest first; all that is left is the extent behind the last.
fn halvings(extent: [usize; 3]) -> Vec<[usize; 3]> {
    let halves = |&e: &[usize; 3]| Some(half(e)).filter(|h| *h != e);
    let mut all: Vec<_> = std::iter::successors(Some(extent), halves).collect();
    all.pop();
    all
}

fn half(extent: [usize; 3]) -> [usize; 3] {
    extent.map(|n| if n < SHORTEST { n } else { n.div_ceil(2) })
}

/// The bands of a lifted box, coarsest first; together they are the box.
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

/// Rows of a box that lie one behind the other along an axis: `count` of `length` samples, `stride` apart.
#[derive(Clone, Copy)]
struct Rows {
    first: usize,
    stride: usize,
    count: usize,
    length: usize,
}

impl Rows {
    /// All such rows of the part `[0, part)` of a box, along y (1) or z (2).
    fn along(axis: usize, extent: [usize; 3], part: [usize; 3]) -> impl Iterator<Item = Self> {
        let strides = [1, extent[0], extent[0] * extent[1]];
        let across = 3 - axis;
        let rows =
            move |i| Self { first: i * strides[across], stride: strides[axis], count: part[axis], length: part[0] };
        (0..part[across]).map(rows)
    }

    fn row(self, i: usize) -> std::ops::Range<usize> {
        let start = self.first + i * self.stride;
        start..start + self.length
    }
}

/// d of two neighbours.
#[inline]
fn predicted(before: i32, after: i32) -> i32 {
    before.wrapping_add(after).wrapping_add(1) >> 1
}

/// What s has more than x.
#[inline]
fn updated(before: i32, after: i32) -> i32 {
    before.wrapping_add(after).wrapping_add(2) >> 2
}

/// Lifts a box of this extent.
pub fn lift(samples: &mut [i32], extent: [usize; 3]) {
    let mut scratch = Vec::new();
    for part in halvings(extent) {
        // Slice by slice along x and y, while the slice is in the processor's nearest cache.
        for (z, rows) in Rows::along(1, extent, part).enumerate() {
            if part[0] >= SHORTEST {
                for_rows_of_x(samples, extent, part, z, |row| lift_row(row, &mut scratch));
            }
            if part[1] >= SHORTEST {
                lift_rows(samples, rows, &mut scratch);
            }
        }
        if part[2] >= SHORTEST {
            Rows::along(2, extent, part).for_each(|rows| lift_rows(samples, rows, &mut scratch));
        }
    }
}

/// Undoes [`lift`].
pub fn unlift(samples: &mut [i32], extent: [usize; 3]) {
    let mut scratch = Vec::new();
    for part in halvings(extent).into_iter().rev() {
        if part[2] >= SHORTEST {
            Rows::along(2, extent, part).for_each(|rows| unlift_rows(samples, rows, &mut scratch));
        }
        for (z, rows) in Rows::along(1, extent, part).enumerate() {
            if part[1] >= SHORTEST {
                unlift_rows(samples, rows, &mut scratch);
            }
            if part[0] >= SHORTEST {
                for_rows_of_x(samples, extent, part, z, |row| unlift_row(row, &mut scratch));
            }
        }
    }
}

/// The rows along x of one slice of the part `[0, part)` of a box.
fn for_rows_of_x(
    samples: &mut [i32],
    extent: [usize; 3],
    part: [usize; 3],
    z: usize,
    mut what: impl FnMut(&mut [i32]),
) {
    for y in 0..part[1] {
        let start = (z * extent[1] + y) * extent[0];
        what(&mut samples[start..start + part[0]]);
    }
}

fn lift_row(row: &mut [i32], scratch: &mut Vec<i32>) {
    let halves = row.len().div_ceil(2);
    scratch.clear();
    scratch.extend(row.iter().step_by(2));
    scratch.extend(row.iter().skip(1).step_by(2));
    let (even, odd) = scratch.split_at_mut(halves);
    for (i, d) in odd.iter_mut().enumerate() {
        *d = d.wrapping_sub(predicted(even[i], even[(i + 1).min(halves - 1)]));
    }
    let last = odd.len() - 1;
    for (i, s) in even.iter_mut().enumerate() {
        *s = s.wrapping_add(updated(odd[i.saturating_sub(1)], odd[i.min(last)]));
    }
    row.copy_from_slice(scratch);
}

fn unlift_row(row: &mut [i32], scratch: &mut Vec<i32>) {
    scratch.clear();
    scratch.extend_from_slice(row);
    let (even, odd) = scratch.split_at_mut(row.len().div_ceil(2));
    let (first, last) = (0, odd.len() - 1);
    even[first] = even[first].wrapping_sub(updated(odd[first], odd[first]));
    for (s, d) in even[1..].iter_mut().zip(odd.windows(2)) {
        *s = s.wrapping_sub(updated(d[0], d[1]));
    }
    // With as many s as d, the windows end before the last s; with one s more, that has only the last d beside it.
    if even.len() > odd.len() {
        even[last + 1] = even[last + 1].wrapping_sub(updated(odd[last], odd[last]));
    }
    for (d, s) in odd.iter_mut().zip(even.windows(2)) {
        *d = d.wrapping_add(predicted(s[0], s[1]));
    }
    if even.len() == odd.len() {
        odd[last] = odd[last].wrapping_add(predicted(even[last], even[last]));
    }
    for (pair, (s, d)) in row.chunks_exact_mut(2).zip(even.iter().zip(odd.iter())) {
        pair[0] = *s;
        pair[1] = *d;
    }
    if even.len() > odd.len() {
        row[2 * last + 2] = even[last + 1];
    }
}

/// Appends a row, changed by what two others say.
fn push_row(out: &mut Vec<i32>, row: &[i32], before: &[i32], after: &[i32], by: impl Fn(i32, i32, i32) -> i32) {
    out.extend(row.iter().zip(before).zip(after).map(|((&x, &b), &a)| by(x, b, a)));
}

/// Writes a row, changed by what two others say, to the place of another one, which does not lie behind it.
fn move_row(
    samples: &mut [i32],
    from: std::ops::Range<usize>,
    to: std::ops::Range<usize>,
    before: &[i32],
    after: &[i32],
    by: impl Fn(i32, i32, i32) -> i32,
) {
    let changes = before.iter().zip(after);
    if from == to {
        samples[to].iter_mut().zip(changes).for_each(|(x, (&b, &a))| *x = by(*x, b, a));
    } else {
        let (head, tail) = samples.split_at_mut(from.start);
        let moved = head[to].iter_mut().zip(&*tail);
        moved.zip(changes).for_each(|((target, &x), (&b, &a))| *target = by(x, b, a));
    }
}

fn lift_rows(samples: &mut [i32], rows: Rows, scratch: &mut Vec<i32>) {
    let (halves, n, last) = (rows.count.div_ceil(2), rows.length, rows.count / 2 - 1);
    scratch.clear();
    for i in 0..=last {
        let [own, before, after] = [2 * i + 1, 2 * i, 2 * (i + 1).min(halves - 1)].map(|row| &samples[rows.row(row)]);
        push_row(scratch, own, before, after, |x, b, a| x.wrapping_sub(predicted(b, a)));
    }
    for i in 0..halves {
        // From the first row on: what is written over has been taken before.
        let [before, after] = [i.saturating_sub(1), i.min(last)].map(|d| &scratch[d * n..(d + 1) * n]);
        move_row(samples, rows.row(2 * i), rows.row(i), before, after, |x, b, a| x.wrapping_add(updated(b, a)));
    }
    scratch.chunks_exact(n).enumerate().for_each(|(i, row)| samples[rows.row(halves + i)].copy_from_slice(row));
}

fn unlift_rows(samples: &mut [i32], rows: Rows, scratch: &mut Vec<i32>) {
    let (halves, n, last) = (rows.count.div_ceil(2), rows.length, rows.count / 2 - 1);
    scratch.clear();
    for i in 0..halves {
        let [own, before, after] =
            [i, halves + i.saturating_sub(1), halves + i.min(last)].map(|row| &samples[rows.row(row)]);
        push_row(scratch, own, before, after, |x, b, a| x.wrapping_sub(updated(b, a)));
    }
    for i in 0..=last {
        // From the first row on, here, too.
        let [before, after] = [i, (i + 1).min(halves - 1)].map(|s| &scratch[s * n..(s + 1) * n]);
        let (own, target) = (rows.row(halves + i), rows.row(2 * i + 1));
        move_row(samples, own, target, before, after, |x, b, a| x.wrapping_add(predicted(b, a)));
    }
    scratch.chunks_exact(n).enumerate().for_each(|(i, row)| samples[rows.row(2 * i)].copy_from_slice(row));
}

/// Differences along x, y and z.
pub fn difference(samples: &mut [i32], extent: [usize; 3]) {
    for row in samples.chunks_exact_mut(extent[0]) {
        (1..row.len()).rev().for_each(|i| row[i] = row[i].wrapping_sub(row[i - 1]));
    }
    for axis in [1, 2] {
        for rows in Rows::along(axis, extent, extent) {
            for i in (1..rows.count).rev() {
                let (before, own) = samples.split_at_mut(rows.row(i).start);
                let before = &before[rows.row(i - 1)];
                own.iter_mut().zip(before).for_each(|(x, b)| *x = x.wrapping_sub(*b));
            }
        }
    }
}

/// Undoes [`difference`].
pub fn undo_difference(samples: &mut [i32], extent: [usize; 3]) {
    for axis in [2, 1] {
        for rows in Rows::along(axis, extent, extent) {
            for i in 1..rows.count {
                let (before, own) = samples.split_at_mut(rows.row(i).start);
                let before = &before[rows.row(i - 1)];
                own.iter_mut().zip(before).for_each(|(x, b)| *x = x.wrapping_add(*b));
            }
        }
    }
    for row in samples.chunks_exact_mut(extent[0]) {
        let mut sum = 0i32;
        for x in row {
            sum = sum.wrapping_add(*x);
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

    /// The formulas of the module, literally: on one line, with what lies beyond the end taken from the end.
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
                    lift_row(&mut once, &mut Vec::new());
                } else {
                    Rows::along(axis, extent, extent).for_each(|rows| lift_rows(&mut once, rows, &mut Vec::new()));
                }
                assert_eq!(once, expected, "{n} samples along axis {axis}");
            }
        }
    }

    /// A ramp is what both predict: nothing is left of it inside.
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
