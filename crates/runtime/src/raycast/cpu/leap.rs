//! Proximity clouds of a brick: how far each of its cubes of cells is from the nearest one that may show something.
//!
//! The distance is Chebyshev's, in cubes (Cohen, Sheffer 1994; Deakin, Knackstedt 2019). Only what lies ahead counts: along
//! an axis on which all rays through the brick ascend, nothing behind can be met. At distance k, all cubes less than k ahead
//! show nothing, and a ray may leap to the far face of the last of them. Bricks end the cloud: what lies beyond is
//! another brick's, and whole bricks without anything to show are never entered.
//!
//! Cubes are macro cells, or in mode `dvr` [`BLOCK`]s, half as wide: see [`super::blocks`].

use super::simd::Simd;
use crate::raycast::volume::DecodedBrick;
use supervol_format::brick::MACRO_CELL;

/// Edge of a block, in cells.
pub const BLOCK: usize = MACRO_CELL / 2;

/// Bytes after the last distance.
const PADDING: usize = 3;
/// A distance that stands for none.
const FAR: u8 = u8::MAX;

/// Which way rays may go along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ahead {
    /// Up, or not at all.
    Up,
    /// Down, or not at all.
    Down,
    /// Some this way, some that.
    Both,
}

impl Ahead {
    /// Steps to neighbours that may lie ahead.
    fn steps(self) -> std::ops::RangeInclusive<isize> {
        match self {
            Self::Up => 0..=1,
            Self::Down => -1..=0,
            Self::Both => -1..=1,
        }
    }
}

/// Distances of a brick's cubes of `SIDE` cells, x fastest: 0 may show something.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProximityCloud<const SIDE: usize> {
    /// Cubes along each axis.
    pub cells: [usize; 3],
    /// One per cube, and `PADDING` more, so that words can be read.
    pub distances: Vec<u8>,
    /// Whether all are 0: nothing to leap over.
    pub is_dense: bool,
    /// Whether none is 0: nothing to see.
    pub is_empty: bool,
}

impl ProximityCloud<MACRO_CELL> {
    /// The cloud of a brick's macro cells; `shows` is asked for each range of render values.
    #[must_use]
    pub fn new(brick: &DecodedBrick, apron: usize, ahead: [Ahead; 3], shows: impl Fn([f32; 2]) -> bool) -> Self {
        let cells = macro_cells_of(brick, apron);
        Self::of_shown(cells, ahead, brick.macro_ranges.iter().map(|&range| shows(range)))
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
        Self::of_shown(cells, [Ahead::Both; 3], (0..sides.len()).map(|i| shows(i) || differs(i)))
    }
}

impl<const SIDE: usize> ProximityCloud<SIDE> {
    /// The cloud of what shows: one truth per cube, x fastest; `cells` along each axis.
    #[must_use]
    pub fn of_shown(cells: [usize; 3], ahead: [Ahead; 3], shown: impl Iterator<Item = bool>) -> Self {
        let most = cells.iter().copied().max().unwrap_or(1).min(usize::from(FAR)) as u8;
        let mut distances: Vec<u8> = shown.map(|shows| if shows { 0 } else { most }).collect();
        let is_dense = distances.iter().all(|&d| d == 0);
        let is_empty = distances.iter().all(|&d| d > 0);
        if !is_dense && !is_empty {
            spread(&mut distances, cells, ahead);
        }
        distances.extend([0; PADDING]);
        Self { cells, distances, is_dense, is_empty }
    }

    /// Whether it is the cloud of a brick with so many core voxels along each axis.
    #[must_use]
    pub fn covers(&self, core: [usize; 3]) -> bool {
        self.cells == core.map(|n| n.div_ceil(SIDE))
    }

    /// Distances of cubes; 0 outside the mask.
    ///
    /// # Safety
    /// In every lane of the mask, the cube is one of the cloud's.
    #[inline(always)]
    pub(super) unsafe fn gather<S: Simd>(&self, cube: [S::I; 3], mask: S::M) -> S::I {
        // SAFETY: the caller's promise; the padding lets words be read.
        let words = unsafe { S::gather(self.distances.as_ptr(), place_in::<S>(self.cells, cube), mask) };
        S::and_int(words, S::splat_int(255))
    }

    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        (size_of::<Self>() + size_of_val(&self.distances[..])) as u64
    }

    /// Bytes held by the cloud of a brick with so many core voxels along each axis.
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

/// Lowers every distance to that of the nearest zero ahead: two sweeps, over the neighbours behind and before a cube in the
/// order of memory, exact for Chebyshev's distance (Borgefors 1986). A row at a time: what comes from other rows is their
/// elementwise minimum.
fn spread(distances: &mut [u8], [nx, ny, nz]: [usize; 3], ahead: [Ahead; 3]) {
    // With a frame of one cube around, nothing needs to be asked about neighbours.
    let (row, plane) = (nx + 2, (nx + 2) * (ny + 2));
    let mut framed = vec![FAR; plane * (nz + 2)];
    let rows = || (0..nz).flat_map(|z| (0..ny).map(move |y| (1 + row * (y + 1) + plane * (z + 1), nx * (y + ny * z))));
    for (to, from) in rows() {
        framed[to..to + nx].copy_from_slice(&distances[from..from + nx]);
    }
    let mut least = vec![FAR; row];
    let row_starts: Vec<usize> = rows().map(|(framed, _)| framed - 1).collect();
    let goes = |sign: isize| ahead.iter().any(|ahead| ahead.steps().contains(&sign));
    if goes(1) {
        for start in row_starts.iter().rev() {
            sweep(&mut framed, [*start, row, plane], ahead, 1, &mut least);
        }
    }
    if goes(-1) {
        for start in &row_starts {
            sweep(&mut framed, [*start, row, plane], ahead, -1, &mut least);
        }
    }
    for (from, to) in rows() {
        distances[to..to + nx].copy_from_slice(&framed[from..from + nx]);
    }
}

/// One row of a sweep, from those behind it in the order of memory (`sign` 1), or before it (-1).
fn sweep(framed: &mut [u8], [start, row, plane]: [usize; 3], ahead: [Ahead; 3], sign: isize, least: &mut [u8]) {
    least.fill(FAR);
    let mut take = |offset: isize| {
        let from = start.wrapping_add_signed(offset);
        least.iter_mut().zip(&framed[from..from + row]).for_each(|(l, &d)| *l = (*l).min(d));
    };
    if ahead[2].steps().contains(&sign) {
        ahead[1].steps().for_each(|dy| take(sign * plane as isize + dy * row as isize));
    }
    if ahead[1].steps().contains(&sign) {
        take(sign * row as isize);
    }
    let this = &mut framed[start..start + row];
    let (up, down, along) =
        (ahead[0].steps().contains(&1), ahead[0].steps().contains(&-1), ahead[0].steps().contains(&sign));
    let mut last = FAR;
    for i in 1..row - 1 {
        let x = if sign > 0 { row - 1 - i } else { i };
        let mut nearest = least[x];
        if up {
            nearest = nearest.min(least[x + 1]);
        }
        if down {
            nearest = nearest.min(least[x - 1]);
        }
        if along {
            nearest = nearest.min(last);
        }
        last = this[x].min(nearest.saturating_add(1));
        this[x] = last;
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
        let mut random = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            seed >> 24
        };
        let ways = [Ahead::Up, Ahead::Down, Ahead::Both];
        for _ in 0..600 {
            let shown: Vec<bool> = (0..60).map(|_| random() < 12).collect();
            let ahead: [Ahead; 3] = std::array::from_fn(|_| ways[random() as usize % 3]);
            let mut distances: Vec<u8> = shown.iter().map(|&s| if s { 0 } else { 5 }).collect();
            spread(&mut distances, cells, ahead);
            let place = |i: usize| [i % 5, i / 5 % 3, i / 15];
            for (i, &found) in distances.iter().enumerate() {
                let may_meet = |j: usize| {
                    (0..3).all(|a| match ahead[a] {
                        Ahead::Up => place(j)[a] >= place(i)[a],
                        Ahead::Down => place(j)[a] <= place(i)[a],
                        Ahead::Both => true,
                    })
                };
                let far = |j: usize| (0..3).map(|a| place(i)[a].abs_diff(place(j)[a])).max().unwrap();
                let expected = (0..60).filter(|&j| shown[j] && may_meet(j)).map(far).min().unwrap_or(5);
                assert_eq!(found, expected as u8, "{:?} {ahead:?}", place(i));
            }
        }
    }
}
