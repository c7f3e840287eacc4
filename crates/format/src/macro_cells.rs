//! Value ranges of macro cells: the values that interpolation can reach inside each cell of 8^3 voxels of a brick.
//!
//! Macro cell m on an axis covers the core voxels 8m to 8m+7 and draws the region `[8m - 1/2, 8m + 7 1/2]` around them.
//! Trilinear interpolation there reaches voxels 8m-1 to 8m+8, so the cell's range is the range of 10^3 voxels. The last
//! cell of an axis may be cut off by the end of the core and has fewer.
//!
//! In a container a cell is two bytes, `low` and `high`. They stand for the range `[lo + low*w/255, lo + high*w/255]`,
//! rounded outward, where `[lo, lo+w]` is the brick's range. `low > high` means that no voxel reached by the cell is
//! present.

use std::marker::PhantomData;

use crate::brick::{APRON, MACRO_CELL};
use crate::codec::BrickShape;
use crate::vectors::{Vectorized, vectorized};
use crate::voxel_type::{Absence, Voxel};
use crate::{ValueRange, with_voxel};

/// Bytes per macro cell in a container.
pub const MACRO_CELL_BYTES: usize = 2;

/// Summary of a brick's voxels, used to skip and draw the brick.
#[derive(Debug, Clone, PartialEq)]
pub struct BrickRanges {
    /// Range of the values that interpolation reaches: the core and one voxel around it. Empty if the core is absent.
    pub range: ValueRange,
    /// Range of each macro cell, x fastest.
    pub cells: Vec<ValueRange>,
    /// Whether an absent voxel is among those that interpolation reaches.
    pub has_holes: bool,
    /// Whether no voxel of the core is present.
    pub absent: bool,
    /// Bits of every stored voxel, in the low bytes, if all voxels are the same; else `None`.
    pub fill: Option<u64>,
}

/// Macro cells along each axis of a brick with this stored extent.
#[must_use]
pub fn cells_along(stored_extent: [usize; 3]) -> [usize; 3] {
    stored_extent.map(|n| (n - 2 * APRON).div_ceil(MACRO_CELL))
}

/// Measures the ranges of a brick's stored voxels.
///
/// # Panics
/// If the length of `voxels` is not that of `shape`, or the shape has no core.
#[must_use]
pub fn measure(shape: BrickShape, voxels: &[u8], absence: Absence) -> BrickRanges {
    assert_eq!(voxels.len(), shape.bytes(), "a brick of {:?} {} has other bytes", shape.extent, shape.voxel_type);
    assert!(shape.extent.iter().all(|&n| n > 2 * APRON), "stored extent {:?} has no core", shape.extent);
    with_voxel!(shape.voxel_type, V => vectorized(Measuring { extent: shape.extent, voxels, absence, typed: PhantomData::<V> }))
}

/// Least and greatest present voxel of each column of a bundle of rows, and whether a voxel of the column is absent.
///
/// A column without a present voxel has `min > max`. Columns are independent, so the compiler keeps many in a register.
struct Columns<V> {
    min: Vec<V>,
    max: Vec<V>,
    holes: Vec<bool>,
}

impl<V: Voxel> Columns<V> {
    fn new(n: usize) -> Self {
        let mut columns = Self { min: vec![V::zeroed(); n], max: vec![V::zeroed(); n], holes: vec![false; n] };
        columns.clear();
        columns
    }

    fn clear(&mut self) {
        let (least, greatest) = V::TYPE.limits();
        self.min.fill(V::from_f64(greatest));
        self.max.fill(V::from_f64(least));
        self.holes.fill(false);
    }

    #[inline(always)]
    fn add(&mut self, row: &[V], absence: Absence, holes_possible: bool) {
        let extremes = self.min.iter_mut().zip(&mut self.max);
        if !holes_possible {
            for ((min, max), &v) in extremes.zip(row) {
                *min = if v < *min { v } else { *min };
                *max = if v > *max { v } else { *max };
            }
            return;
        }
        for (((min, max), holes), &v) in extremes.zip(&mut self.holes).zip(row) {
            let absent = absence.is_absent(v.to_f64());
            *holes |= absent;
            *min = if !absent && v < *min { v } else { *min };
            *max = if !absent && v > *max { v } else { *max };
        }
    }

    /// Range of a part of the columns, and whether it has holes.
    fn over(&self, part: std::ops::Range<usize>) -> (ValueRange, bool) {
        let (mut min, mut max) = (self.min[part.start], self.max[part.start]);
        for i in part.clone() {
            min = if self.min[i] < min { self.min[i] } else { min };
            max = if self.max[i] > max { self.max[i] } else { max };
        }
        let range = if min <= max { ValueRange { min: min.to_f64(), max: max.to_f64() } } else { ValueRange::EMPTY };
        (range, self.holes[part].contains(&true))
    }
}

/// Task of [`measure`].
struct Measuring<'a, V> {
    extent: [usize; 3],
    voxels: &'a [u8],
    absence: Absence,
    typed: PhantomData<V>,
}

impl<V: Voxel> Vectorized for Measuring<'_, V> {
    type Output = BrickRanges;

    #[inline(always)]
    fn run(self) -> BrickRanges {
        measure_typed::<V>(self.extent, self.voxels, self.absence)
    }
}

#[inline(always)]
fn measure_typed<V: Voxel>(extent: [usize; 3], voxels: &[u8], absence: Absence) -> BrickRanges {
    let [nx, ny, nz] = extent;
    let cells = cells_along(extent);
    let holes_possible = absence.possible(V::TYPE);
    let mut row = vec![V::zeroed(); nx];
    let mut columns = Columns::<V>::new(nx);
    let mut cell_ranges = Vec::with_capacity(cells.iter().product());
    let mut has_holes = false;
    for cz in 0..cells[2] {
        for cy in 0..cells[1] {
            columns.clear();
            for z in reach(cz, nz) {
                for y in reach(cy, ny) {
                    read_row(&mut row, voxels, (z * ny + y) * nx);
                    columns.add(&row, absence, holes_possible);
                }
            }
            for cx in 0..cells[0] {
                let (range, holes) = columns.over(reach(cx, nx));
                cell_ranges.push(range);
                has_holes |= holes;
            }
        }
    }
    // Every sample inside the brick uses at least one core voxel. If no core voxel is present, no sample is.
    let absent = holes_possible && !core_is_present::<V>(extent, voxels, absence);
    if absent {
        cell_ranges.fill(ValueRange::EMPTY);
    }
    BrickRanges {
        range: cell_ranges.iter().fold(ValueRange::EMPTY, |a, &b| a.union(b)),
        cells: cell_ranges,
        has_holes,
        absent,
        fill: fill_of(voxels, size_of::<V>()),
    }
}

/// Reads the row that begins at voxel `start`.
#[inline(always)]
fn read_row<V: Voxel>(row: &mut [V], voxels: &[u8], start: usize) {
    for (v, b) in row.iter_mut().zip(voxels[start * size_of::<V>()..].chunks_exact(size_of::<V>())) {
        *v = V::read_le(b);
    }
}

fn core_is_present<V: Voxel>(extent: [usize; 3], voxels: &[u8], absence: Absence) -> bool {
    let [nx, ny, nz] = extent;
    let mut row = vec![V::zeroed(); nx];
    (APRON..nz - APRON).any(|z| {
        (APRON..ny - APRON).any(|y| {
            read_row(&mut row, voxels, (z * ny + y) * nx);
            row[APRON..nx - APRON].iter().any(|v| !absence.is_absent(v.to_f64()))
        })
    })
}

/// Bits of the voxels, if all are the same.
fn fill_of(voxels: &[u8], voxel_bytes: usize) -> Option<u64> {
    // A slice that equals itself shifted by one voxel repeats its first voxel. This comparison runs at memory speed.
    let all_equal = voxels[voxel_bytes..] == voxels[..voxels.len() - voxel_bytes];
    all_equal.then(|| {
        let mut bits = [0; 8];
        bits[..voxel_bytes].copy_from_slice(&voxels[..voxel_bytes]);
        u64::from_le_bytes(bits)
    })
}

/// Stored voxels that interpolation reaches in macro cell `cell` of an axis with `stored` voxels.
fn reach(cell: usize, stored: usize) -> std::ops::Range<usize> {
    let first = cell * MACRO_CELL + APRON - 1;
    first..(first + MACRO_CELL + 2).min(stored - APRON + 1)
}

/// Value of byte `code` in a brick of this range.
#[must_use]
pub fn dequantize(code: u8, range: ValueRange) -> f64 {
    match code {
        0 => range.min,
        // Not lo + w: rounding can make that sum smaller than the end of the range.
        255 => range.max,
        _ => {
            let share = f64::from(code) / 255.0;
            // The distance of two doubles may exceed the greatest double.
            let width = range.width();
            if width.is_finite() { range.min + width * share } else { range.min * (1.0 - share) + range.max * share }
        }
    }
}

/// Encodes cell ranges as bytes, rounded outward: `low, high` for each cell, x fastest.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "saturating: codes are clamped to 0 to 255")]
pub fn quantize(cells: &[ValueRange], range: ValueRange) -> Vec<u8> {
    // Halve all values if the width of the range is not a finite double.
    let part = if range.width().is_finite() { 1.0 } else { 0.5 };
    let (start, width) = (range.min * part, range.max * part - range.min * part);
    let scale = if width > 0.0 { 255.0 / width } else { 0.0 };
    let mut bytes = Vec::with_capacity(cells.len() * MACRO_CELL_BYTES);
    for cell in cells {
        if cell.is_empty() {
            bytes.extend([255, 0]);
            continue;
        }
        // Rounding can make the first guess too narrow. These loops move it outward, by at most a step or two.
        let mut low = ((cell.min * part - start) * scale).floor().clamp(0.0, 255.0) as u8;
        while low > 0 && dequantize(low, range) > cell.min {
            low -= 1;
        }
        let mut high = ((cell.max * part - start) * scale).ceil().clamp(0.0, 255.0) as u8;
        while high < 255 && dequantize(high, range) < cell.max {
            high += 1;
        }
        bytes.extend([low, high]);
    }
    bytes
}

/// Decodes the bytes of [`quantize`].
#[must_use]
pub fn dequantize_cells(bytes: &[u8], range: ValueRange) -> Vec<ValueRange> {
    bytes
        .chunks_exact(MACRO_CELL_BYTES)
        .map(|b| {
            if b[0] > b[1] {
                ValueRange::EMPTY
            } else {
                ValueRange { min: dequantize(b[0], range), max: dequantize(b[1], range) }
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::VoxelType;
    use crate::random::Random;
    use proptest::prelude::*;

    /// Brute force over every voxel that each cell reaches.
    fn naive(extent: [usize; 3], values: &[f64], absence: Absence) -> Vec<ValueRange> {
        let cells = cells_along(extent);
        let mut out = Vec::new();
        for cz in 0..cells[2] {
            for cy in 0..cells[1] {
                for cx in 0..cells[0] {
                    let mut range = ValueRange::EMPTY;
                    for z in reach(cz, extent[2]) {
                        for y in reach(cy, extent[1]) {
                            for x in reach(cx, extent[0]) {
                                let v = values[x + extent[0] * (y + extent[1] * z)];
                                if !absence.is_absent(v) {
                                    range.include(v);
                                }
                            }
                        }
                    }
                    out.push(range);
                }
            }
        }
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn ranges_equal_brute_force_and_bytes_hold_them_tightly(
            extent in [5usize..24, 5usize..24, 5usize..24], seed in any::<u64>(), with_holes in any::<bool>(),
        ) {
            let n: usize = extent.iter().product();
            let mut random = Random::new(seed);
            let values: Vec<f32> = (0..n).map(|_| {
                let bits = random.next_u64();
                if with_holes && bits % 16 < 3 { f32::NAN } else { (bits >> 40) as f32 * 1e-3 - 5000.0 }
            }).collect();
            let shape = BrickShape { voxel_type: VoxelType::F32, extent };
            let measured = measure(shape, bytemuck::cast_slice(&values), Absence::NON_FINITE_ONLY);
            let as_f64: Vec<f64> = values.iter().map(|&v| f64::from(v)).collect();
            prop_assume!(!measured.absent);
            let expected = naive(extent, &as_f64, Absence::NON_FINITE_ONLY);
            prop_assert_eq!(&measured.cells, &expected);
            let bytes = quantize(&measured.cells, measured.range);
            let step = measured.range.width() / 255.0;
            for (packed, exact) in dequantize_cells(&bytes, measured.range).iter().zip(&expected) {
                prop_assert!(packed.holds(*exact), "{packed:?} does not hold {exact:?}");
                if !exact.is_empty() {
                    prop_assert!(exact.min - packed.min <= 1.001 * step && packed.max - exact.max <= 1.001 * step);
                }
            }
        }
    }
}
