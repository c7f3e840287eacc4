//! Shifts of groups of voxels: from voxels whose S transform ends in the coarser voxels, to the true ones.
//!
//! The S transform of a group of 2, 4 or 8 voxels leaves an average, rounded down on each axis, and differences. If all
//! voxels of a group are shifted by a number, the average is shifted by it, and the differences stay. So the differences of
//! the true voxels, around the coarser voxel m in place of their average, give voxels that are all shifted by one number.
//! If m is the mean of the group, rounded to the nearest, that number follows from the sum S of the n shifted voxels:
//!
//! ```text
//! shift = m - floor((S + n/2 - 1) / n)
//! ```
//!
//! At a *tie*, S = n/2 modulo n, a mean may have been rounded up or down: then the shift may be one less. The payload holds
//! a correction of each shift. Corrections are zero except at ties, unless m is no mean.

use super::grid::{Grid, Halving, rows_of, sum};
use crate::codec::sample::Sample;
use crate::vectors::Vectorized;

/// Shifts of all groups, x fastest, if their coarser voxels are means.
#[derive(Debug, PartialEq)]
pub struct Shifts<S> {
    pub shifts: Vec<S>,
    pub are_ties: Vec<bool>,
}

/// Task that computes [`Shifts`] from the shifted voxels.
pub struct Shifting<'a, S> {
    pub means: &'a Grid<S>,
    pub shifted: &'a Grid<S>,
    pub halvings: &'a [Halving],
}

impl<S: Sample> Vectorized for Shifting<'_, S> {
    type Output = Shifts<S>;

    #[inline(always)]
    fn run(self) -> Shifts<S> {
        let Self { means, shifted, halvings } = self;
        let mut sums = None;
        for halving in halvings {
            sums = Some(halving.fold(sums.as_ref().unwrap_or(shifted), sum));
        }
        let sums = sums.as_ref().unwrap_or(shifted);
        let halved = halvings.len();
        let tie = (1 << halved) >> 1;
        let count = means.extent().iter().product();
        let (mut shifts, mut are_ties) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for [y, z] in rows_of(means.extent()) {
            for (&mean, &sum) in means.row(y, z).iter().zip(sums.row(y, z)) {
                let rounded = S::wrap(sum.number().wrapping_add(tie - 1) >> halved);
                shifts.push(mean.minus(rounded));
                are_ties.push(sum.number() & ((1 << halved) - 1) == tie);
            }
        }
        Shifts { shifts, are_ties }
    }
}

impl<S: Sample> Shifts<S> {
    /// Corrections in their order in the payload: at ties, then elsewhere.
    pub fn parts(&self, corrections: &[S]) -> [Vec<S>; 2] {
        [true, false].map(|part| {
            let of_part = corrections.iter().zip(&self.are_ties).filter(|(_, is_tie)| **is_tie == part);
            of_part.map(|(correction, _)| *correction).collect()
        })
    }

    /// Numbers of corrections at ties and elsewhere.
    pub fn counts(&self) -> [usize; 2] {
        let ties = self.are_ties.iter().filter(|is_tie| **is_tie).count();
        [ties, self.are_ties.len() - ties]
    }

    /// Adds corrections.
    pub fn correct(&mut self, parts: &[Vec<S>; 2]) {
        let [mut ties, mut others] = parts.each_ref().map(|part| part.iter());
        for (shift, is_tie) in self.shifts.iter_mut().zip(&self.are_ties) {
            let next = if *is_tie { ties.next() } else { others.next() };
            *shift = shift.plus(*next.expect("each part has its number of corrections"));
        }
    }
}

/// Adds to each voxel of a row of a box the shift of its group. `factor` is the factor of x.
#[inline(always)]
pub fn shift_row<S: Sample>(row: &[S], shifts: &[S], factor: u32, out: &mut [S]) {
    if factor == 1 {
        for ((out, &voxel), &shift) in out.iter_mut().zip(row).zip(shifts) {
            *out = voxel.plus(shift);
        }
        return;
    }
    let (pairs, single) = row.as_chunks::<2>();
    for ((out, pair), &shift) in out.as_chunks_mut::<2>().0.iter_mut().zip(pairs).zip(shifts) {
        *out = [pair[0].plus(shift), pair[1].plus(shift)];
    }
    if let &[single] = single {
        out[row.len() - 1] = single.plus(shifts[shifts.len() - 1]);
    }
}
