//! Samples of a box in rows along x, with repeated samples on both sides of each row, and halving of an axis.
//!
//! A row holds [`MARGIN`] copies of its first sample, its samples, and copies of its last sample: at least [`MARGIN`], and
//! enough to fill groups of [`LANES`]. Loops over rows therefore need no case for their ends. Rows beyond the box are those
//! at its end.

use crate::codec::sample::Sample;

/// Samples that are computed together.
pub const LANES: usize = 16;
/// Copies on each side of a row: the farthest neighbour that a prediction uses.
pub const MARGIN: usize = 2;

/// A box of samples.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid<S> {
    samples: Vec<S>,
    extent: [usize; 3],
    stride: usize,
}

impl<S: Sample> Grid<S> {
    /// A box of zeros.
    pub fn zeros(extent: [usize; 3]) -> Self {
        let stride = extent[0].next_multiple_of(LANES) + 2 * MARGIN;
        Self { samples: vec![S::default(); stride * extent[1] * extent[2]], extent, stride }
    }

    pub fn extent(&self) -> [usize; 3] {
        self.extent
    }

    /// Length of a row in whole groups of lanes.
    pub fn width(&self) -> usize {
        self.stride - 2 * MARGIN
    }

    #[inline(always)]
    fn start(&self, y: usize, z: usize) -> usize {
        (z * self.extent[1] + y) * self.stride
    }

    /// Samples of a row.
    #[inline(always)]
    pub fn row(&self, y: usize, z: usize) -> &[S] {
        &self.samples[self.start(y, z) + MARGIN..][..self.extent[0]]
    }

    /// Samples of a row, to be changed; [`Self::repeat_ends`] must follow.
    #[inline(always)]
    pub fn row_mut(&mut self, y: usize, z: usize) -> &mut [S] {
        let start = self.start(y, z) + MARGIN;
        &mut self.samples[start..start + self.extent[0]]
    }

    /// Repeats the first and the last sample of a row on both sides.
    #[inline(always)]
    pub fn repeat_ends(&mut self, y: usize, z: usize) {
        let (start, n) = (self.start(y, z), self.extent[0]);
        let row = &mut self.samples[start..start + self.stride];
        let [first, last] = [row[MARGIN], row[MARGIN + n - 1]];
        row[..MARGIN].fill(first);
        row[MARGIN + n..].fill(last);
    }

    /// Rows near the row (y, z).
    #[inline(always)]
    pub fn near(&self, [y, z]: [usize; 2]) -> Near<'_, S> {
        let starts = |i: usize, n: usize, stride: usize| {
            let last = n - 1;
            let [before, behind] = [i.saturating_sub(1), (i + 1).min(last)];
            [i.saturating_sub(2), before, i, behind, (i + 2).min(last)].map(|i| i * stride)
        };
        let [_, rows, slices] = self.extent;
        Near {
            samples: &self.samples,
            width: self.width(),
            rows: starts(y, rows, self.stride),
            slices: starts(z, slices, self.stride * rows),
        }
    }
}

/// Rows near a row, in whole groups of lanes. Positions beyond the box are those at its end.
pub struct Near<'a, S> {
    samples: &'a [S],
    width: usize,
    /// First sample of the rows at distances -2 to 2 along y, in the slice.
    rows: [usize; 2 * MARGIN + 1],
    /// The same along z.
    slices: [usize; 2 * MARGIN + 1],
}

impl<'a, S: Sample> Near<'a, S> {
    /// Row at these distances along x, y and z: at most [`MARGIN`].
    #[inline(always)]
    pub fn row(&self, [dx, dy, dz]: [isize; 3]) -> &'a [S] {
        let at = |by: isize| MARGIN.wrapping_add_signed(by);
        &self.samples[self.rows[at(dy)] + self.slices[at(dz)] + at(dx)..][..self.width]
    }
}

/// Halving of one axis of a box: each pair of samples becomes one. A single last sample forms a pair with itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Halving {
    pub axis: usize,
    /// Extent before.
    pub whole: [usize; 3],
    /// Extent after.
    pub half: [usize; 3],
}

impl Halving {
    /// All halvings of a box: x before y before z, where the factor of the axis is 2.
    pub fn all(extent: [usize; 3], factors: [u32; 3]) -> Vec<Self> {
        let mut whole = extent;
        let halve = |axis: usize| {
            let mut half = whole;
            half[axis] = half[axis].div_ceil(2);
            let halving = Self { axis, whole, half };
            whole = half;
            halving
        };
        (0..3).filter(|&axis| factors[axis] == 2).map(halve).collect()
    }

    /// Number of pairs of two different samples in the row (y, z) of the half.
    #[inline(always)]
    pub fn pairs(self, [y, z]: [usize; 2]) -> usize {
        let n = self.whole[self.axis];
        let is_pair = match self.axis {
            0 => return n / 2,
            1 => 2 * y + 1 < n,
            _ => 2 * z + 1 < n,
        };
        if is_pair { self.half[0] } else { 0 }
    }

    /// Positions of the two rows that become the row (y, z) of the half, if x is not halved.
    #[inline(always)]
    pub fn rows(self, [y, z]: [usize; 2]) -> [[usize; 2]; 2] {
        let second = |i: usize| (2 * i + 1).min(self.whole[self.axis] - 1);
        if self.axis == 1 { [[2 * y, z], [second(y), z]] } else { [[y, 2 * z], [y, second(z)]] }
    }

    /// Halves a box: `fold` makes one sample of each pair.
    #[inline(always)]
    pub fn fold<S: Sample>(self, grid: &Grid<S>, fold: impl Fn(S, S) -> S) -> Grid<S> {
        let mut half = Grid::zeros(self.half);
        for [y, z] in rows_of(self.half) {
            let out = half.row_mut(y, z);
            if self.axis == 0 {
                let (pairs, single) = grid.row(y, z).as_chunks::<2>();
                for (out, &[a, b]) in out.iter_mut().zip(pairs) {
                    *out = fold(a, b);
                }
                if let &[single] = single {
                    out[pairs.len()] = fold(single, single);
                }
            } else {
                let [first, second] = self.rows([y, z]).map(|[y, z]| grid.row(y, z));
                for ((out, &a), &b) in out.iter_mut().zip(first).zip(second) {
                    *out = fold(a, b);
                }
            }
            half.repeat_ends(y, z);
        }
        half
    }

    /// Details of a row of the half: the differences of pairs. Zero beyond the pairs.
    #[inline(always)]
    pub fn details<S: Sample>(self, grid: &Grid<S>, [y, z]: [usize; 2], out: &mut [S]) {
        let pairs = self.pairs([y, z]);
        if self.axis == 0 {
            for (out, pair) in out.iter_mut().zip(grid.row(y, z).as_chunks::<2>().0) {
                *out = pair[0].minus(pair[1]);
            }
        } else {
            let [first, second] = self.rows([y, z]).map(|[y, z]| grid.row(y, z));
            for ((out, &first), &second) in out[..pairs].iter_mut().zip(first).zip(second) {
                *out = first.minus(second);
            }
        }
        out[pairs..].fill(S::default());
    }

    /// Writes the pairs of a row of the half, from its averages and details.
    #[inline(always)]
    pub fn put<S: Sample>(self, grid: &mut Grid<S>, averages: &Grid<S>, [y, z]: [usize; 2], details: &[S]) {
        let averages = averages.row(y, z);
        let details = &details[..averages.len()];
        if self.axis == 0 {
            let (pairs, single) = grid.row_mut(y, z).as_chunks_mut::<2>();
            for ((pair, &average), &detail) in pairs.iter_mut().zip(averages).zip(details) {
                let second = average.minus(detail.shifted::<1>());
                *pair = [second.plus(detail), second];
            }
            if let [single] = single {
                *single = averages[averages.len() - 1];
            }
            grid.repeat_ends(y, z);
            return;
        }
        // At the end of an odd axis, both rows are the same one, and the details are zero.
        let [first, second] = self.rows([y, z]);
        for ((out, &average), &detail) in grid.row_mut(second[0], second[1]).iter_mut().zip(averages).zip(details) {
            *out = average.minus(detail.shifted::<1>());
        }
        grid.repeat_ends(second[0], second[1]);
        for ((out, &average), &detail) in grid.row_mut(first[0], first[1]).iter_mut().zip(averages).zip(details) {
            *out = average.minus(detail.shifted::<1>()).plus(detail);
        }
        grid.repeat_ends(first[0], first[1]);
    }
}

/// Average of a pair, rounded down: `floor((a + b) / 2)`. It depends on b and the difference alone, so that it shifts with
/// the pair even where numbers wrap.
#[inline(always)]
pub fn average<S: Sample>(a: S, b: S) -> S {
    b.plus(a.minus(b).shifted::<1>())
}

/// Sum of a pair.
#[inline(always)]
pub fn sum<S: Sample>(a: S, b: S) -> S {
    a.plus(b)
}

/// Positions (y, z) of all rows of a box, in order.
pub fn rows_of([_, rows, slices]: [usize; 3]) -> impl Iterator<Item = [usize; 2]> {
    (0..slices).flat_map(move |z| (0..rows).map(move |y| [y, z]))
}

/// A group of lanes of a row.
#[inline(always)]
pub fn lanes_of<S>(row: &[S], group: usize) -> &[S; LANES] {
    row[group * LANES..].first_chunk().expect("rows are whole groups of lanes")
}
