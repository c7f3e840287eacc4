//! Proximity cloud of a brick: distance of each cube of cells from the nearest one that may be visible.
//!
//! The distance is Chebyshev's, in cubes (Cohen, Sheffer 1994; Deakin, Knackstedt 2019). Only cubes ahead count: if all
//! rays through the brick ascend along an axis, cubes behind cannot be met. At distance k, all cubes less than k ahead
//! are invisible, and a ray may leap to the far face of the last of them. The cloud ends at the brick's faces: the next
//! brick has its own, and invisible bricks are never entered.
//!
//! Cubes are macro cells, or in mode `dvr` [blocks](crate::engines::blocks::BLOCK) of half the edge
//! ([`super::blocks`]).

use supervol_format::brick::MACRO_CELL;
use supervol_format::cast::narrow;

use super::simd::{Simd, hidden_in_memory};
use crate::stream::residency::DecodedBrick;

/// Bytes after the last distance.
const PADDING: usize = 3;
/// Distances that the processor handles at once.
const VECTOR: usize = 16;
/// Distance to no cube.
const FAR: u8 = u8::MAX;

/// Directions that rays may have along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxisDirection {
    /// Ascending, or parallel to the face.
    Up,
    /// Descending, or parallel to the face.
    Down,
    /// Both.
    Both,
}

impl AxisDirection {
    /// Steps to neighbours that may lie ahead.
    fn steps(self) -> std::ops::RangeInclusive<isize> {
        match self {
            Self::Up => 0..=1,
            Self::Down => -1..=0,
            Self::Both => -1..=1,
        }
    }
}

/// Distances of a brick's cubes of `SIDE` cells, x fastest. 0: the cube may be visible.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProximityCloud<const SIDE: usize> {
    /// Cubes along each axis.
    pub cells: [usize; 3],
    /// One per cube, plus `PADDING`, so that whole words can be read.
    pub distances: Vec<u8>,
    /// Number of distances that are not 0.
    pub hidden: usize,
}

impl ProximityCloud<MACRO_CELL> {
    /// The cloud of a brick's macro cells; `shows`: whether a range of render values is visible.
    #[must_use]
    pub fn new(
        brick: &DecodedBrick,
        apron: usize,
        ahead: [AxisDirection; 3],
        shows: impl Fn([f32; 2]) -> bool,
    ) -> Self {
        let cells = macro_cells_of(brick, apron);
        Self::of_shown(cells, ahead, brick.macro_ranges.iter().map(|&range| shows(range)))
    }

    /// The cloud of visible cubes, and of cubes that have a neighbour on another side: a cube beyond has one side
    /// everywhere.
    #[must_use]
    pub fn of_sides<T: PartialEq>(cells: [usize; 3], sides: &[T], shows: impl Fn(usize) -> bool) -> Self {
        let [nx, ny, nz] = cells;
        let around = |at: usize, n: usize| at.saturating_sub(1)..(at + 2).min(n);
        let differs = |i: usize| {
            let (x, y, z) = (i % nx, i / nx % ny, i / (nx * ny));
            let row = |y: usize, z: usize| around(x, nx).any(|x| sides[x + nx * (y + ny * z)] != sides[i]);
            around(z, nz).any(|z| around(y, ny).any(|y| row(y, z)))
        };
        Self::of_shown(cells, [AxisDirection::Both; 3], (0..sides.len()).map(|i| shows(i) || differs(i)))
    }
}

impl<const SIDE: usize> ProximityCloud<SIDE> {
    /// The cloud of visible cubes: one flag per cube, x fastest; `cells` along each axis.
    #[must_use]
    pub fn of_shown(cells: [usize; 3], ahead: [AxisDirection; 3], shown: impl Iterator<Item = bool>) -> Self {
        let most = narrow::<u8>(cells.iter().copied().max().unwrap_or(1).min(usize::from(FAR)));
        let mut distances = Vec::with_capacity(cells.iter().product::<usize>() + PADDING);
        // A product, because visibility alternates too often for a branch.
        distances.extend(shown.map(|shows| most * u8::from(!shows)));
        let hidden = distances.iter().filter(|&&distance| distance > 0).count();
        if 0 < hidden && hidden < distances.len() {
            spread(&mut distances, cells, ahead);
        }
        distances.extend([0; PADDING]);
        Self { cells, distances, hidden }
    }

    /// Whether it is the cloud of a brick with `core` voxels along each axis.
    #[must_use]
    pub fn covers(&self, core: [usize; 3]) -> bool {
        self.cells == core.map(|n| n.div_ceil(SIDE)) && self.distances.len() >= self.cubes() + PADDING
    }

    /// Distances of cubes; 0 outside the mask.
    ///
    /// # Safety
    /// In every lane of the mask, the cube is one of the cloud's.
    #[inline(always)]
    pub(super) unsafe fn gather<S: Simd>(&self, cube: [S::I; 3], mask: S::M) -> S::I {
        // Lanes outside the mask read the first cube.
        let place = S::select_int(mask, place_in::<S>(self.cells, cube), S::splat_int(0));
        // SAFETY: the caller's promise; the padding lets words be read.
        let [words] =
            unsafe { S::gather_around(self.distances.as_ptr(), 1, &hidden_in_memory::<S, 1>([place])[0], [0]) };
        S::select_int(mask, S::and_int(words, S::splat_int(255)), S::splat_int(0))
    }

    /// Number of cubes.
    #[must_use]
    pub fn cubes(&self) -> usize {
        self.cells.iter().product()
    }

    /// Whether every cube may be visible: nothing to leap over.
    #[must_use]
    pub fn is_dense(&self) -> bool {
        self.hidden == 0
    }

    /// Whether no cube may be visible.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.hidden == self.cubes()
    }

    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        (size_of::<Self>() + size_of_val(&self.distances[..])) as u64
    }

    /// Most bytes of the cloud of a brick with `core` core voxels along each axis.
    #[must_use]
    pub fn most_bytes(core: usize) -> u64 {
        (size_of::<Self>() + core.div_ceil(SIDE).pow(3) + PADDING) as u64
    }
}

/// Macro cells of a brick along each axis.
#[must_use]
pub fn macro_cells_of(brick: &DecodedBrick, apron: usize) -> [usize; 3] {
    brick.extent.map(|n| (n as usize - 2 * apron).div_ceil(MACRO_CELL))
}

/// Index of a macro cell, x fastest, with `cells` along each axis.
#[inline(always)]
fn place_in<S: Simd>(cells: [usize; 3], macro_cell: [S::I; 3]) -> S::I {
    let (nx, ny) = (S::splat_int(narrow::<i32>(cells[0])), S::splat_int(narrow::<i32>(cells[1])));
    macro_cell[0] + nx * (macro_cell[1] + ny * macro_cell[2])
}

/// Least and greatest number of each macro cell of a brick, x fastest; the first is greater if nothing is present.
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
        let place = place_in::<S>(self.cells, macro_cell) * S::splat_int(narrow::<i32>(size_of::<f32>()));
        // SAFETY: the caller's promise; there is one number of either kind for each macro cell.
        let (low, high) = unsafe {
            (S::gather(self.low.as_ptr().cast(), place, mask), S::gather(self.high.as_ptr().cast(), place, mask))
        };
        [S::float_from_bits(low), S::float_from_bits(high)]
    }
}

/// Lowers every distance to that of the nearest zero ahead, exactly for Chebyshev's distance. First along rows, then in
/// two sweeps over rows, from neighbours in the rows after and before in memory order (after Borgefors 1986).
fn spread(distances: &mut [u8], [nx, ny, nz]: [usize; 3], ahead: [AxisDirection; 3]) {
    for row in distances.chunks_exact_mut(nx) {
        spread_in_row(row, ahead[0]);
    }
    // Rows are whole vectors, with a frame of one cube around, so that neighbours need no bounds checks.
    let row = nx.next_multiple_of(VECTOR) + 2;
    let plane = row * (ny + 2);
    let mut framed = vec![FAR; plane * (nz + 2)];
    let starts = || (0..nz).flat_map(|z| (0..ny).map(move |y| 1 + row * (y + 1) + plane * (z + 1)));
    for (to, from) in starts().zip(distances.chunks_exact(nx)) {
        framed[to..to + nx].copy_from_slice(from);
    }
    let vectors: Vec<usize> = starts().flat_map(|start| (start..start + nx).step_by(VECTOR)).collect();
    let behind = neighbours_in_rows(1, [row, plane], ahead);
    vectors.iter().rev().for_each(|&vector| lower(&mut framed, vector, &behind));
    let before = neighbours_in_rows(-1, [row, plane], ahead);
    vectors.iter().for_each(|&vector| lower(&mut framed, vector, &before));
    for (from, to) in starts().zip(distances.chunks_exact_mut(nx)) {
        to.copy_from_slice(&framed[from..from + nx]);
    }
}

/// Lowers the distances of a row to those from the zeros ahead in it.
fn spread_in_row(row: &mut [u8], ahead: AxisDirection) {
    let mut last = FAR;
    let mut lower = |distance: &mut u8| {
        last = last.saturating_add(1).min(*distance);
        *distance = last;
    };
    if ahead.steps().contains(&-1) {
        row.iter_mut().for_each(&mut lower);
    }
    if ahead.steps().contains(&1) {
        row.iter_mut().rev().for_each(&mut lower);
    }
}

/// Offsets of the neighbours ahead in the rows after a cube's own in memory order (`sign` 1), or before it (-1).
fn neighbours_in_rows(sign: isize, [row, plane]: [usize; 2], ahead: [AxisDirection; 3]) -> Vec<isize> {
    let [xs, ys, zs] = ahead.map(AxisDirection::steps);
    let rows = zs.flat_map(|z| ys.clone().map(move |y| (y, z)));
    let rows = rows.filter(|&(y, z)| z == sign || (z == 0 && y == sign));
    rows.flat_map(|(y, z)| xs.clone().map(move |x| x + y * narrow::<isize>(row) + z * narrow::<isize>(plane))).collect()
}

/// Lowers a vector of distances by those of all neighbours at these offsets.
fn lower(framed: &mut [u8], vector: usize, neighbours: &[isize]) {
    let at =
        |place: usize| -> [u8; VECTOR] { framed[place..place + VECTOR].try_into().expect("a slice of one vector") };
    let mut nearest = [FAR; VECTOR];
    for &neighbour in neighbours {
        let theirs = at(vector.wrapping_add_signed(neighbour));
        nearest = std::array::from_fn(|i| nearest[i].min(theirs[i]));
    }
    let here = at(vector);
    let lowered: [u8; VECTOR] = std::array::from_fn(|i| here[i].min(nearest[i].saturating_add(1)));
    framed[vector..vector + VECTOR].copy_from_slice(&lowered);
}

#[cfg(test)]
mod tests {
    use supervol_format::random::Random;

    use super::*;

    #[test]
    fn cubes_that_are_leapt_over_have_one_side() {
        let cells = [6, 5, 7];
        // Three sides along x, and one visible macro cell.
        let sides: Vec<usize> = (0..210).map(|i| i % 6 / 2).collect();
        let cloud = ProximityCloud::of_sides(cells, &sides, |i| i == 5 + 6 * (2 + 5 * 3));
        assert!(!cloud.is_dense() && !cloud.is_empty());
        let place = |i: usize| [i % 6, i / 6 % 5, i / 30];
        for (i, &distance) in cloud.distances[..210].iter().enumerate() {
            let x = i % 6;
            assert!(distance <= 1 && (distance == 0 || x == 0 || x == 5), "beside another side: {:?}", place(i));
            let near_shown = (0..3).all(|a| place(i)[a].abs_diff([5, 2, 3][a]) == 0);
            assert!(distance == u8::from((x == 0 || x == 5) && !near_shown), "{:?}", place(i));
        }
        let one = ProximityCloud::of_sides(cells, &[7; 210], |_| false);
        assert!(one.is_empty() && one.distances[..210].iter().all(|&d| d == 7));
    }

    #[test]
    fn distances_are_those_of_brute_force() {
        let mut numbers = Random::new(3);
        let mut random = || numbers.below(256);
        let ways = [AxisDirection::Up, AxisDirection::Down, AxisDirection::Both];
        // Rows shorter than a vector, of equal length, and longer.
        for cells in [[5, 3, 4], [16, 2, 3], [17, 3, 2], [33, 1, 3], [1, 7, 1]] {
            for _ in 0..300 {
                let count = cells.iter().product();
                let shown: Vec<bool> = (0..count).map(|_| random() < 12).collect();
                let ahead: [AxisDirection; 3] = std::array::from_fn(|_| ways[random() as usize % 3]);
                let mut distances: Vec<u8> = shown.iter().map(|&s| if s { 0 } else { 40 }).collect();
                spread(&mut distances, cells, ahead);
                let place = |i: usize| [i % cells[0], i / cells[0] % cells[1], i / (cells[0] * cells[1])];
                for (i, &found) in distances.iter().enumerate() {
                    let may_meet = |j: usize| {
                        (0..3).all(|a| match ahead[a] {
                            AxisDirection::Up => place(j)[a] >= place(i)[a],
                            AxisDirection::Down => place(j)[a] <= place(i)[a],
                            AxisDirection::Both => true,
                        })
                    };
                    let far = |j: usize| (0..3).map(|a| place(i)[a].abs_diff(place(j)[a])).max().unwrap();
                    let expected = (0..count).filter(|&j| shown[j] && may_meet(j)).map(far).min().unwrap_or(40);
                    assert_eq!(found, expected as u8, "{:?} of {cells:?} {ahead:?}", place(i));
                }
            }
        }
    }
}
