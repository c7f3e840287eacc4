//! Downsampling: voxels of a coarser level from those of the next finer level.
//!
//! Coarse voxel c of a halved axis covers the fine voxels 2c and 2c+1, or 2c alone at the end of the grid. Absent
//! voxels are ignored; if all are absent, the coarse voxel is absent, too. [`Reduce`] selects how up to eight voxels
//! become one. Means are rounded to the voxel type, ties to even. They are computed in doubles; those of integers of at
//! most 16 bits in integers, with equal results.

use std::marker::PhantomData;

use supervol_format::cast::index;
use supervol_format::vectors::{Vectorized, vectorized};
use supervol_format::voxel_type::{Absence, Voxel};
use supervol_format::{Dims, VoxelBox, VoxelType, with_voxel};

pub use crate::pipeline::options::Reduce;

impl Reduce {
    /// Result for these values; the absence marker if none of them is present.
    fn of(self, values: [f64; 8], absence: Absence) -> f64 {
        let present = || values.iter().copied().filter(|&v| !absence.is_absent(v));
        match self {
            Self::Mean => mean_of_present(values, absence),
            Self::Max => present().reduce(f64::max).unwrap_or(absence.marker()),
            Self::Majority => {
                let votes = |v: f64| present().filter(|&other| other == v).count();
                let more = |a: f64, b: f64| if (votes(b), -b) > (votes(a), -a) { b } else { a };
                present().reduce(more).unwrap_or(absence.marker())
            }
        }
    }
}

/// Box of the finer voxels that the voxels of a coarse box are made of.
#[must_use]
pub fn finer_box(coarse: VoxelBox, factors: [u32; 3], finer_dims: Dims) -> VoxelBox {
    let scaled = |v: [u64; 3]| std::array::from_fn(|a| v[a] * u64::from(factors[a]));
    VoxelBox { start: scaled(coarse.start), end: scaled(coarse.end) }.intersect(finer_dims.full_box())
}

/// A box of voxels in memory: little endian, packed, x fastest.
#[derive(Debug, Clone, Copy)]
pub struct VoxelBlock<'a> {
    /// Position of the box in its level, in voxels.
    pub voxels: VoxelBox,
    /// Bytes of the voxels.
    pub bytes: &'a [u8],
}

impl<'a> VoxelBlock<'a> {
    /// Bytes of the voxels of a part, row by row.
    ///
    /// # Panics
    /// If the part leaves the block.
    pub fn rows(self, part: VoxelBox, voxel_bytes: usize) -> impl Iterator<Item = &'a [u8]> {
        let first = std::array::from_fn(|a| index(part.start[a] - self.voxels.start[a]));
        rows_of(self.bytes, self.voxels.extent(), (first, part.extent()), voxel_bytes)
    }
}

/// Rows of a part of packed voxels with this extent. The part is given by its first voxel and its extent.
///
/// # Panics
/// If the part leaves the voxels.
pub fn rows_of(
    bytes: &[u8],
    [nx, ny, _]: [usize; 3],
    ([x, y, z], [columns, rows, slices]): ([usize; 3], [usize; 3]),
    voxel_bytes: usize,
) -> impl Iterator<Item = &[u8]> {
    let starts = (0..slices).flat_map(move |k| (0..rows).map(move |j| ((z + k) * ny + y + j) * nx + x));
    starts.map(move |start| &bytes[start * voxel_bytes..(start + columns) * voxel_bytes])
}

/// Reduces `fine` to the coarse voxels of `coarse` and writes them to `out`, one z-slice per task.
///
/// # Panics
/// If `fine` lacks a voxel of [`finer_box`], or a buffer has another length than its box.
pub fn downsample(
    reduce: Reduce,
    voxel_type: VoxelType,
    absence: Absence,
    factors: [u32; 3],
    fine: VoxelBlock<'_>,
    coarse: VoxelBox,
    out: &mut [u8],
) {
    with_voxel!(voxel_type, V => downsample_typed::<V>(reduce, absence, factors, fine, coarse, out));
}

fn downsample_typed<V: Voxel>(
    reduce: Reduce,
    absence: Absence,
    factors: [u32; 3],
    fine: VoxelBlock<'_>,
    coarse: VoxelBox,
    out: &mut [u8],
) {
    use rayon::prelude::*;
    let [nx, ny, nz] = coarse.extent();
    let [fine_nx, fine_ny, fine_nz] = fine.voxels.extent();
    assert_eq!(fine.bytes.len(), fine_nx * fine_ny * fine_nz * size_of::<V>(), "fine box {:?}", fine.voxels);
    assert_eq!(out.len(), nx * ny * nz * size_of::<V>(), "coarse box {coarse:?}");
    // First fine voxel of a coarse one, and the number of its fine voxels, on one axis of the fine box.
    let pair = |axis: usize, c: usize, n: usize| -> (usize, usize) {
        let first = (coarse.start[axis] + c as u64) * u64::from(factors[axis]);
        let first = usize::try_from(first - fine.voxels.start[axis]).expect("an offset inside a box fits");
        (first, if factors[axis] == 2 && first + 1 < n { 2 } else { 1 })
    };
    let holes_possible = absence.possible(V::TYPE);
    out.par_chunks_exact_mut(nx * ny * size_of::<V>()).enumerate().for_each(|(z, slice)| {
        let (z0, z_count) = pair(2, z, fine_nz);
        for (y, row) in slice.chunks_exact_mut(nx * size_of::<V>()).enumerate() {
            let (y0, y_count) = pair(1, y, fine_ny);
            let rows: [&[u8]; 4] = std::array::from_fn(|i| {
                let (dy, dz) = ((i & 1).min(y_count - 1), (i >> 1).min(z_count - 1));
                let start = ((z0 + dz) * fine_ny + y0 + dy) * fine_nx * size_of::<V>();
                &fine.bytes[start..start + fine_nx * size_of::<V>()]
            });
            let (x0, _) = pair(0, 0, fine_nx);
            if holes_possible || reduce != Reduce::Mean {
                reduce_row::<V>(reduce, absence, factors[0] as usize, x0, rows, row);
            } else if V::TYPE.bytes() <= 2 {
                vectorized(Averaging {
                    factor: factors[0],
                    rows: rows.map(|row| &row[x0 * size_of::<V>()..]),
                    out: row,
                    typed: PhantomData::<V>,
                });
            } else {
                average_row::<V>(factors[0] as usize, x0, rows, row);
            }
        }
    });
}

/// Task: means of eight integers of at most 16 bits each. On an axis that is not halved, or at its end, a voxel counts
/// twice.
struct Averaging<'a, V> {
    factor: u32,
    /// The four rows, starting at the first voxel of the first mean.
    rows: [&'a [u8]; 4],
    out: &'a mut [u8],
    typed: PhantomData<V>,
}

impl<V: Voxel> Vectorized for Averaging<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { factor, rows, out, .. } = self;
        if factor == 1 {
            return average_each::<V, 1>(rows, out);
        }
        let whole = (rows[0].len() / (2 * size_of::<V>())).min(out.len() / size_of::<V>()) * size_of::<V>();
        let (pairs, last) = out.split_at_mut(whole);
        average_each::<V, 2>(rows, pairs);
        if !last.is_empty() {
            average_each::<V, 1>(rows.map(|row| &row[2 * whole..]), last);
        }
    }
}

/// Mean of `COUNT` voxels of each row; a single voxel counts twice. Written for vectors.
#[inline(always)]
fn average_each<V: Voxel, const COUNT: usize>(rows: [&[u8]; 4], out: &mut [u8]) {
    let size = size_of::<V>();
    let rows = rows.map(|row| &row[..COUNT * out.len()]);
    let word = |row: &[u8], i: usize| V::read_le(&row[i * size..(i + 1) * size]).to_word();
    for i in 0..out.len() / size {
        let of_row = |row| word(row, COUNT * i) + word(row, COUNT * i + COUNT - 1);
        let sum = of_row(rows[0]) + of_row(rows[1]) + of_row(rows[2]) + of_row(rows[3]);
        V::from_word(eighth(sum)).write_le(&mut out[i * size..(i + 1) * size]);
    }
}

/// One eighth, ties to even.
#[inline(always)]
fn eighth(sum: i32) -> i32 {
    (sum + 3 + (sum >> 3 & 1)) >> 3
}

/// Means of eight voxels each, as [`Averaging`], for all types.
fn average_row<V: Voxel>(factor: usize, x0: usize, rows: [&[u8]; 4], out: &mut [u8]) {
    let size = size_of::<V>();
    let n = rows[0].len() / size;
    let at = |row: &[u8], i: usize| V::read_le(&row[i * size..(i + 1) * size]).to_f64();
    for (c, target) in out.chunks_exact_mut(size).enumerate() {
        let first = x0 + c * factor;
        let second = (first + factor - 1).min(n - 1);
        let sum: f64 = rows.iter().map(|row| at(row, first) + at(row, second)).sum();
        V::from_f64(sum * 0.125).write_le(target);
    }
}

fn reduce_row<V: Voxel>(reduce: Reduce, absence: Absence, factor: usize, x0: usize, rows: [&[u8]; 4], out: &mut [u8]) {
    let size = size_of::<V>();
    let n = rows[0].len() / size;
    for (c, target) in out.chunks_exact_mut(size).enumerate() {
        let first = x0 + c * factor;
        let second = (first + factor - 1).min(n - 1);
        let values: [f64; 8] = std::array::from_fn(|i| {
            let x = if i & 1 == 0 { first } else { second };
            V::read_le(&rows[i >> 1][x * size..(x + 1) * size]).to_f64()
        });
        V::from_f64(reduce.of(values, absence)).write_le(target);
    }
}

/// Mean of the present values among eight; the absence marker if there is none.
fn mean_of_present(values: [f64; 8], absence: Absence) -> f64 {
    let present = || values.iter().copied().filter(|&v| !absence.is_absent(v));
    let count = present().count();
    if count == 0 {
        return absence.marker();
    }
    let sum: f64 = present().sum();
    // The sum of doubles near their limit overflows; the sum of their shares of the mean does not.
    let mean = if sum.is_finite() { sum / count as f64 } else { present().map(|v| v / count as f64).sum() };
    // A mean equal to the nodata value would turn present data into a hole; the first present voxel replaces it.
    if absence.is_absent(mean) { present().next().unwrap_or(mean) } else { mean }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn average_u8(dims: [u64; 3], factors: [u32; 3], values: &[u8], nodata: Option<f64>) -> Vec<u8> {
        reduce_u8(Reduce::Mean, dims, factors, values, nodata)
    }

    fn reduce_u8(reduce: Reduce, dims: [u64; 3], factors: [u32; 3], values: &[u8], nodata: Option<f64>) -> Vec<u8> {
        let fine_dims = Dims(dims);
        let coarse = Dims(std::array::from_fn(|a| dims[a].div_ceil(u64::from(factors[a]))));
        let block = VoxelBlock { voxels: finer_box(coarse.full_box(), factors, fine_dims), bytes: values };
        let mut out = vec![0; coarse.full_box().voxels()];
        downsample(reduce, VoxelType::U8, Absence { nodata }, factors, block, coarse.full_box(), &mut out);
        out
    }

    #[test]
    fn means_round_to_even_and_end_with_single_voxels() {
        assert_eq!(average_u8([5, 1, 1], [2, 1, 1], &[1, 2, 3, 4, 9], None), [2, 4, 9]);
        assert_eq!(average_u8([2, 2, 2], [2, 2, 2], &[0, 1, 2, 3, 4, 5, 6, 8], None), [4]);
        assert_eq!(average_u8([2, 2, 1], [1, 2, 1], &[10, 20, 30, 50], None), [20, 35]);
    }

    #[test]
    fn eighths_of_whole_numbers_are_those_of_doubles() {
        for sum in -8 * 32768..=8 * 65535 {
            assert_eq!(f64::from(eighth(sum)), (f64::from(sum) * 0.125).round_ties_even(), "{sum}");
        }
    }

    #[test]
    fn rows_of_small_integers_are_averaged_as_all_others_are() {
        let mut random = supervol_format::random::Random::new(5);
        let rows: [Vec<u8>; 4] = std::array::from_fn(|_| (0..2 * 41).map(|_| random.next_u64() as u8).collect());
        fn compare<V: Voxel>(rows: &[Vec<u8>; 4]) {
            let size = size_of::<V>();
            for n in [1, 2, 3, 38, 41] {
                let rows = rows.each_ref().map(|row| &row[..n * size]);
                for (factor, x0) in [(1, 0), (1, n / 2), (2, 0), (2, n / 2)] {
                    let mut out = [(); 2].map(|()| vec![0xa5; (n - x0).div_ceil(factor as usize) * size]);
                    let [whole, double] = &mut out;
                    let from = rows.map(|row| &row[x0 * size..]);
                    vectorized(Averaging { factor, rows: from, out: whole, typed: PhantomData::<V> });
                    average_row::<V>(factor as usize, x0, rows, double);
                    assert_eq!(whole, double, "{} times {n} from {x0} by {factor}", V::TYPE);
                }
            }
        }
        compare::<u8>(&rows);
        compare::<i8>(&rows);
        compare::<u16>(&rows);
        compare::<i16>(&rows);
    }

    #[test]
    fn absent_voxels_take_no_part() {
        assert_eq!(average_u8([4, 1, 1], [2, 1, 1], &[255, 8, 255, 255], Some(255.0)), [8, 255]);
        // The mean of 0 and 2 is 1, but 1 means "no data": the result must stay present.
        assert_eq!(average_u8([2, 1, 1], [2, 1, 1], &[0, 2], Some(1.0)), [0]);
    }

    #[test]
    fn labels_are_chosen_and_never_made() {
        let of = |values: &[u8]| reduce_u8(Reduce::Majority, [2, 2, 2], [2, 2, 2], values, Some(255.0));
        assert_eq!(of(&[7, 7, 7, 3, 3, 9, 9, 1]), [7]);
        assert_eq!(of(&[9, 9, 9, 3, 3, 3, 1, 1]), [3], "of equally frequent ones the least");
        assert_eq!(of(&[255, 255, 255, 255, 255, 255, 255, 4]), [4], "absent voxels have no vote");
        assert_eq!(of(&[255; 8]), [255]);
        // At the end of the grid, and on an axis that is not halved, every voxel has the same number of votes.
        let ends = reduce_u8(Reduce::Majority, [3, 2, 1], [2, 2, 1], &[5, 5, 8, 6, 5, 2], None);
        assert_eq!(ends, [5, 2]);
        for name in Reduce::ALL.map(Reduce::name) {
            assert!(["mean", "max", "majority"].contains(&name));
        }
    }

    #[test]
    fn the_greatest_is_kept() {
        let of = |values: &[u8]| reduce_u8(Reduce::Max, [4, 1, 1], [2, 1, 1], values, Some(255.0));
        assert_eq!([of(&[3, 9, 255, 4]), of(&[255, 255, 0, 0])], [[9, 4], [255, 0]]);
    }

    #[test]
    fn doubles_near_their_limit_do_not_overflow() {
        assert_eq!(mean_of_present([f64::MAX; 8], Absence::NON_FINITE_ONLY), f64::MAX);
        assert!(mean_of_present([f64::NAN; 8], Absence::NON_FINITE_ONLY).is_nan());
    }
}
