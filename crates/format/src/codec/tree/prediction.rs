//! Prediction of details from averages around them and from details of earlier rows.
//!
//! A detail is predicted as a weighted sum of [`TERMS`] numbers. Let D_k(p) be the average k places before p on the halved
//! axis, less the average k places behind p. Let d(j, k) be the detail j rows before in y and k slices before in z. The terms
//! are D_1 and D_2 of the detail's own place; D_1 of the four places beside it on the other two axes; and d(1, 0), d(0, 1),
//! d(1, 1), d(2, 0) and d(0, 2). A prediction from D_1 alone with weight 1/4 is that of S+P (Said, Pearlman 1996, "An image
//! multiresolution representation for lossless and lossy compression", predictor A).
//!
//! No term lies on the detail's own row among the details: all details of a row are predicted at once. Weights are those
//! that would have predicted the details of the encoder's brick best ([`Fit`]), in units of 1/256. Sums are computed in
//! 32 bits with wrapping arithmetic, the same in encoder and decoder.

use super::grid::{Grid, Halving, LANES, MARGIN, lanes_of};
use crate::codec::sample::Sample;

/// Differences of averages in a prediction.
const DIFFERENCES: usize = 6;
/// Earlier details in a prediction.
const EARLIER: usize = 5;
/// Terms of a prediction.
pub const TERMS: usize = DIFFERENCES + EARLIER;
/// Bits of a weight behind the binary point.
const WEIGHT_BITS: u32 = 8;
/// Greatest weight of the encoder, in units of 2^-8.
const GREATEST_WEIGHT: f64 = 2048.0;

/// Weights of the terms, in units of 2^-8.
pub type Weights = [i16; TERMS];

/// Slices of details that predictions look back to, this one included, and rows in front of each slice.
const BACK: usize = 3;

/// Details of the last rows: three slices, with zeros in front of the first row and slice.
struct Earlier<S> {
    slices: [Vec<S>; BACK],
    width: usize,
}

impl<S: Sample> Earlier<S> {
    fn new(width: usize, rows: usize) -> Self {
        Self { slices: std::array::from_fn(|_| vec![S::default(); (rows + BACK - 1) * width]), width }
    }

    /// Row `j` rows and `k` slices before the row (y, z).
    #[inline(always)]
    fn row(&self, [y, z]: [usize; 2], j: usize, k: usize) -> &[S] {
        &self.slices[(z + BACK - k) % BACK][(y + BACK - 1 - j) * self.width..][..self.width]
    }

    #[inline(always)]
    fn put(&mut self, [y, z]: [usize; 2], details: &[S]) {
        self.slices[z % BACK][(y + BACK - 1) * self.width..][..self.width].copy_from_slice(details);
    }
}

/// Rows that a row of details is predicted from, in whole groups of lanes.
pub struct Around<'a, S> {
    differences: [[&'a [S]; 2]; DIFFERENCES],
    earlier: [&'a [S]; EARLIER],
}

impl<'a, S: Sample> Around<'a, S> {
    #[inline(always)]
    fn new<const AXIS: usize>(averages: &'a Grid<S>, earlier: &'a Earlier<S>, at: [usize; 2]) -> Self {
        let near = averages.near(at);
        let mut differences = [[near.row([0; 3]); 2]; DIFFERENCES];
        let mut place = [0; 3];
        let besides = [(0, 0), (0, 0), (1, -1), (1, 1), (2, -1), (2, 1)];
        for (term, (axis, by)) in besides.into_iter().enumerate() {
            place[(AXIS + axis) % 3] = by;
            let steps = if term == 1 { 2 } else { 1 };
            place[AXIS] = -steps;
            differences[term][0] = near.row(place);
            place[AXIS] = steps;
            differences[term][1] = near.row(place);
            place = [0; 3];
        }
        let row = |j, k| earlier.row(at, j, k);
        let earlier = [row(1, 0), row(0, 1), row(1, 1), row(2, 0), row(0, 2)];
        Self { differences, earlier }
    }

    /// Predicts all details of the row.
    #[inline(always)]
    pub fn predict(&self, weights: &Weights, out: &mut [S]) {
        const HALF: i32 = 1 << (WEIGHT_BITS - 1);
        for (group, out) in out.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
            let mut sum = [HALF; LANES];
            for (term, &weight) in weights.iter().enumerate() {
                let weight = i32::from(weight);
                let numbers = self.term(term, group);
                for lane in 0..LANES {
                    sum[lane] = sum[lane].wrapping_add(numbers[lane].wrapping_mul(weight));
                }
            }
            for lane in 0..LANES {
                out[lane] = S::wrap(sum[lane] >> WEIGHT_BITS);
            }
        }
    }

    /// A term of the details in a group of lanes.
    #[inline(always)]
    fn term(&self, term: usize, group: usize) -> [i32; LANES] {
        let mut numbers = [0; LANES];
        if term < DIFFERENCES {
            let [before, behind] = self.differences[term];
            let (before, behind) = (lanes_of(before, group), lanes_of(behind, group));
            for lane in 0..LANES {
                numbers[lane] = before[lane].minus(behind[lane]).number();
            }
        } else {
            let details = lanes_of(self.earlier[term - DIFFERENCES], group);
            for lane in 0..LANES {
                numbers[lane] = details[lane].number();
            }
        }
        numbers
    }
}

/// Visitor of rows of details. It is a trait, not a closure, so that its method is compiled for the caller's vectors.
pub trait Visitor<S> {
    /// Gets the position of the row and its surroundings, and leaves the details; those beyond the pairs must be zero.
    fn visit(&mut self, at: [usize; 2], around: &Around<'_, S>, details: &mut [S]);
}

/// Visits all rows of details in order.
#[inline(always)]
pub fn for_each_row<S: Sample>(averages: &Grid<S>, halving: Halving, visitor: &mut impl Visitor<S>) {
    match halving.axis {
        0 => visit_rows::<0, S>(averages, halving, visitor),
        1 => visit_rows::<1, S>(averages, halving, visitor),
        _ => visit_rows::<2, S>(averages, halving, visitor),
    }
}

#[inline(always)]
fn visit_rows<const AXIS: usize, S: Sample>(averages: &Grid<S>, halving: Halving, visitor: &mut impl Visitor<S>) {
    let [_, rows, slices] = halving.half;
    let mut earlier = Earlier::new(averages.width(), rows);
    let mut details = vec![S::default(); averages.width()];
    for z in 0..slices {
        for y in 0..rows {
            visitor.visit([y, z], &Around::new::<AXIS>(averages, &earlier, [y, z]), &mut details);
            earlier.put([y, z], &details);
        }
    }
}

/// Rows of which one is looked at when weights are fitted, at least.
const ROWS_PER_SAMPLE: usize = 5;
/// Part of a term's squares that is added to keep weights finite.
const DAMPING: f64 = 1e-6;

/// Least squares of the details' distances from their predictions.
pub struct Fit {
    /// Weights so far; all zero in the first round.
    weights: [f32; TERMS],
    /// Products of terms, and of terms and details.
    products: [[f64; TERMS + 1]; TERMS],
    is_first: bool,
}

impl Fit {
    pub fn new() -> Self {
        Self { weights: [0.0; TERMS], products: [[0.0; TERMS + 1]; TERMS], is_first: true }
    }

    /// Whether a row is looked at.
    pub fn looks_at([y, z]: [usize; 2]) -> bool {
        (y + 2 * z).is_multiple_of(ROWS_PER_SAMPLE)
    }

    /// Adds the first `pairs` details of a row. From the second round on, a detail counts the less the farther it is from
    /// its prediction: this approaches the least sum of distances, and codes grow with distances, not squares.
    #[inline(always)]
    pub fn add<S: Sample>(&mut self, around: &Around<'_, S>, details: &[S], pairs: usize) {
        for group in 0..pairs.div_ceil(LANES) {
            let mut terms = [[0.0; LANES]; TERMS + 1];
            for (term, floats) in terms.iter_mut().enumerate().take(TERMS) {
                *floats = floats_of(around.term(term, group));
            }
            let mut numbers = [0; LANES];
            for (number, detail) in numbers.iter_mut().zip(lanes_of(details, group)) {
                *number = detail.number();
            }
            terms[TERMS] = floats_of(numbers);
            let mut shares = [0.0f32; LANES];
            shares[..LANES.min(pairs - group * LANES)].fill(1.0);
            if !self.is_first {
                let mut rest = terms[TERMS];
                for (numbers, weight) in terms.iter().zip(self.weights) {
                    for lane in 0..LANES {
                        rest[lane] -= weight * numbers[lane];
                    }
                }
                for lane in 0..LANES {
                    shares[lane] /= rest[lane].abs() + 1.0;
                }
            }
            for i in 0..TERMS {
                let mut shared = [0.0; LANES];
                for lane in 0..LANES {
                    shared[lane] = terms[i][lane] * shares[lane];
                }
                for (j, other) in terms.iter().enumerate().skip(i) {
                    let mut product = [0.0; LANES];
                    for lane in 0..LANES {
                        product[lane] = shared[lane] * other[lane];
                    }
                    self.products[i][j] += f64::from(sum_of(product));
                }
            }
        }
    }

    /// Ends a round: computes its weights and begins the next round.
    #[expect(clippy::needless_range_loop, reason = "indices of rows and columns, as in every text on elimination")]
    pub fn solve(&mut self) {
        let mut rows = self.products;
        for i in 0..TERMS {
            for j in 0..i {
                rows[i][j] = rows[j][i];
            }
            rows[i][i] = rows[i][i] * (1.0 + DAMPING) + DAMPING;
        }
        // Gauss's elimination. The matrix is positive definite, so the diagonal holds good pivots.
        for i in 0..TERMS {
            for j in i + 1..TERMS {
                let factor = rows[j][i] / rows[i][i];
                for k in i..=TERMS {
                    rows[j][k] -= factor * rows[i][k];
                }
            }
        }
        let mut weights = [0.0; TERMS];
        for i in (0..TERMS).rev() {
            let known: f64 = (i + 1..TERMS).map(|j| rows[i][j] * weights[j]).sum();
            weights[i] = (rows[i][TERMS] - known) / rows[i][i];
        }
        #[expect(clippy::cast_possible_truncation, reason = "weights need few bits")]
        let single = weights.map(|weight| if weight.is_finite() { weight as f32 } else { 0.0 });
        *self = Self { weights: single, is_first: false, ..Self::new() };
    }

    /// The weights, rounded.
    pub fn weights(&self) -> Weights {
        let unit = f64::from(1 << WEIGHT_BITS);
        #[expect(clippy::cast_possible_truncation, reason = "the limit fits 16 bits")]
        self.weights.map(|weight| (f64::from(weight) * unit).round().clamp(-GREATEST_WEIGHT, GREATEST_WEIGHT) as i16)
    }
}

#[inline(always)]
#[expect(clippy::cast_precision_loss, reason = "weights need few bits")]
fn floats_of(numbers: [i32; LANES]) -> [f32; LANES] {
    let mut floats = [0.0; LANES];
    for (float, number) in floats.iter_mut().zip(numbers) {
        *float = number as f32;
    }
    floats
}

/// Sum of lanes, always in the same order.
#[inline(always)]
fn sum_of(lanes: [f32; LANES]) -> f32 {
    let mut rest = lanes;
    let mut count = LANES / 2;
    while count > 0 {
        for i in 0..count {
            rest[i] += rest[i + count];
        }
        count /= 2;
    }
    rest[0]
}

const _: () = assert!(MARGIN == 2, "the farthest difference reaches two places");
