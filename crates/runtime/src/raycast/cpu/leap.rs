//! Proximity clouds of a brick: how far each macro cell is from the nearest one that may show something.
//!
//! The distance is Chebyshev's, in macro cells (Cohen, Sheffer 1994; Deakin, Knackstedt 2019): at distance k, the cube of
//! `2k - 1` macro cells around shows nothing, and a ray may leap to its face. Bricks end the cloud: what lies beyond is
//! another brick's, and whole bricks without anything to show are never entered.

use super::simd::Simd;
use crate::raycast::volume::DecodedBrick;
use supervol_format::brick::MACRO_CELL;

/// Bytes after the last distance.
const PADDING: usize = 3;

/// Distances of a brick's macro cells, x fastest: 0 may show something.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProximityCloud {
    /// Macro cells along each axis.
    pub cells: [usize; 3],
    /// One per macro cell, and [`PADDING`] more, so that words can be read.
    pub distances: Vec<u8>,
    /// Whether all are 0: nothing to leap over.
    pub is_dense: bool,
    /// Whether none is 0: nothing to see.
    pub is_empty: bool,
}

impl ProximityCloud {
    /// The cloud of a brick; `shows` is asked for each range of render values.
    #[must_use]
    pub fn new(brick: &DecodedBrick, apron: usize, shows: impl Fn([f32; 2]) -> bool) -> Self {
        let cells = macro_cells_of(brick, apron);
        Self::of_shown(cells, brick.macro_ranges.iter().map(|&range| shows(range)))
    }

    /// The cloud of what shows, and of what has another side than a neighbour: a cube around is of one side all over.
    #[must_use]
    pub fn of_sides<T: PartialEq>(cells: [usize; 3], sides: &[T], shows: impl Fn(usize) -> bool) -> Self {
        let [nx, ny, nz] = cells;
        let around = |at: usize, n: usize| at.saturating_sub(1)..(at + 2).min(n);
        let differs = |i: usize| {
            let (x, y, z) = (i % nx, i / nx % ny, i / (nx * ny));
            let row = |y: usize, z: usize| around(x, nx).any(|x| sides[x + nx * (y + ny * z)] != sides[i]);
            around(z, nz).any(|z| around(y, ny).any(|y| row(y, z)))
        };
        Self::of_shown(cells, (0..sides.len()).map(|i| shows(i) || differs(i)))
    }

    /// The cloud of what shows: one truth per macro cell, x fastest.
    #[must_use]
    pub fn of_shown(cells: [usize; 3], shown: impl Iterator<Item = bool>) -> Self {
        let most = cells.iter().copied().max().unwrap_or(1).min(255) as u8;
        let mut distances: Vec<u8> = shown.map(|shows| if shows { 0 } else { most }).collect();
        let is_dense = distances.iter().all(|&d| d == 0);
        let is_empty = distances.iter().all(|&d| d > 0);
        if !is_dense && !is_empty {
            spread(&mut distances, cells);
        }
        distances.extend([0; PADDING]);
        Self { cells, distances, is_dense, is_empty }
    }

    /// Whether it is the cloud of a brick with so many core voxels along each axis.
    #[must_use]
    pub fn covers(&self, core: [usize; 3]) -> bool {
        self.cells == core.map(|n| n.div_ceil(MACRO_CELL))
    }

    /// Distances of macro cells; 0 outside the mask.
    ///
    /// # Safety
    /// In every lane of the mask, the macro cell is one of the cloud's.
    #[inline(always)]
    pub(super) unsafe fn gather<S: Simd>(&self, macro_cell: [S::I; 3], mask: S::M) -> S::I {
        // SAFETY: the caller's promise; the padding lets words be read.
        let words = unsafe { S::gather(self.distances.as_ptr(), place_in::<S>(self.cells, macro_cell), mask) };
        S::and_int(words, S::splat_int(255))
    }

    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        (size_of::<Self>() + size_of_val(&self.distances[..])) as u64
    }
}

/// Macro cells of a brick along each axis.
#[must_use]
pub fn macro_cells_of(brick: &DecodedBrick, apron: usize) -> [usize; 3] {
    brick.extent.map(|n| (n as usize - 2 * apron).div_ceil(MACRO_CELL))
}

/// Place of a macro cell among so many along each axis, x fastest.
#[inline(always)]
fn place_in<S: Simd>(cells: [usize; 3], macro_cell: [S::I; 3]) -> S::I {
    let (nx, ny) = (S::splat_int(cells[0] as i32), S::splat_int(cells[1] as i32));
    macro_cell[0] + nx * (macro_cell[1] + ny * macro_cell[2])
}

/// Least and greatest number of each macro cell of a brick, x fastest; the first is greater where nothing is present.
#[derive(Debug, Clone, PartialEq)]
pub struct MacroRanges {
    /// Macro cells along each axis.
    pub cells: [usize; 3],
    /// Least numbers.
    pub low: Vec<f32>,
    /// Greatest numbers.
    pub high: Vec<f32>,
}

impl MacroRanges {
    /// Ranges of macro cells.
    ///
    /// # Safety
    /// In every lane of the mask, the macro cell is one of these.
    #[inline(always)]
    pub unsafe fn gather<S: Simd>(&self, macro_cell: [S::I; 3], mask: S::M) -> [S::F; 2] {
        let place = place_in::<S>(self.cells, macro_cell) * S::splat_int(size_of::<f32>() as i32);
        // SAFETY: the caller's promise; there is one number of either kind for each macro cell.
        let (low, high) = unsafe {
            (S::gather(self.low.as_ptr().cast(), place, mask), S::gather(self.high.as_ptr().cast(), place, mask))
        };
        [S::float_from_bits(low), S::float_from_bits(high)]
    }
}

/// Lowers every distance to the nearest zero's plus the way to it: two sweeps over the 13 neighbours before and after,
/// exact for Chebyshev's distance (Borgefors 1986).
fn spread(distances: &mut [u8], [nx, ny, nz]: [usize; 3]) {
    let sweep = |distances: &mut [u8], x: usize, y: usize, z: usize, sign: isize| {
        let mut least = distances[x + nx * (y + ny * z)];
        for dz in -1..=0isize {
            for dy in -1..=1isize {
                for dx in -1..=1isize {
                    let before = dz < 0 || (dz == 0 && (dy < 0 || (dy == 0 && dx < 0)));
                    let [px, py, pz] = [(x, dx), (y, dy), (z, dz)].map(|(at, d)| at.wrapping_add_signed(sign * d));
                    if before && px < nx && py < ny && pz < nz {
                        least = least.min(distances[px + nx * (py + ny * pz)] + 1);
                    }
                }
            }
        }
        distances[x + nx * (y + ny * z)] = least;
    };
    let places = |i: usize| (i % nx, i / nx % ny, i / (nx * ny));
    for i in 0..distances.len() {
        let (x, y, z) = places(i);
        sweep(distances, x, y, z, 1);
    }
    for i in (0..distances.len()).rev() {
        let (x, y, z) = places(i);
        sweep(distances, x, y, z, -1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubes_that_are_leapt_over_have_one_side() {
        let cells = [6, 5, 7];
        // Three sides along x, and one macro cell that shows something.
        let sides: Vec<usize> = (0..210).map(|i| i % 6 / 2).collect();
        let cloud = ProximityCloud::of_sides(cells, &sides, |i| i == 5 + 6 * (2 + 5 * 3));
        assert!(!cloud.is_dense && !cloud.is_empty);
        let place = |i: usize| [i % 6, i / 6 % 5, i / 30];
        for (i, &distance) in cloud.distances[..210].iter().enumerate() {
            let x = i % 6;
            assert!(distance <= 1 && (distance == 0 || x == 0 || x == 5), "beside another side: {:?}", place(i));
            let near_shown = (0..3).all(|a| place(i)[a].abs_diff([5, 2, 3][a]) == 0);
            assert!(distance == u8::from((x == 0 || x == 5) && !near_shown), "{:?}", place(i));
        }
        let one = ProximityCloud::of_sides(cells, &[7; 210], |_| false);
        assert!(one.is_empty && one.distances[..210].iter().all(|&d| d == 7));
    }

    #[test]
    fn distances_are_those_of_brute_force() {
        let cells = [5, 3, 4];
        let mut seed = 3u32;
        for _ in 0..200 {
            let mut random = || {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                seed >> 24
            };
            let shown: Vec<bool> = (0..60).map(|_| random() < 12).collect();
            if !shown.contains(&true) {
                continue;
            }
            let mut distances: Vec<u8> = shown.iter().map(|&s| if s { 0 } else { 5 }).collect();
            spread(&mut distances, cells);
            let place = |i: usize| [i % 5, i / 5 % 3, i / 15];
            for (i, &found) in distances.iter().enumerate() {
                let far = |j: usize| (0..3).map(|a| place(i)[a].abs_diff(place(j)[a])).max().unwrap();
                let expected = (0..60).filter(|&j| shown[j]).map(far).min().unwrap();
                assert_eq!(found, expected as u8);
            }
        }
    }
}
