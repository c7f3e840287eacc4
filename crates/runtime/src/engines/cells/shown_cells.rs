//! Cells of a brick that may show something, with opacity by the gradient.
//!
//! The gradient in a cell interpolates central differences at its corners, and the length of a vector is convex: so it is nowhere
//! longer than at one of the corners. A cell shows nothing if its gradient is nowhere longer than the beginning of the ramp, or if
//! its values are invisible. That is exact, so that cells are left out whether others are skipped or not.

use glam::{DMat3, DVec3};
use supervol_format::brick::{APRON, MACRO_CELL};
use supervol_scene::value_map::ValueMap;

use super::bounded::Modulation;
use super::visit::StoredVoxel;
use crate::stream::residency::{DecodedBrick, Voxels};

/// Voxels of the core's cells beyond the core, on each side.
const BEYOND: usize = 1;
/// Bits of a word.
const WORD: usize = u64::BITS as usize;

/// One bit for each cell and each macro cell of a brick.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ShownCells {
    cells: Bits,
    macro_cells: Bits,
}

/// Bits of a box, x fastest.
#[derive(Debug, Clone, PartialEq)]
struct Bits {
    counts: [usize; 3],
    words: Vec<u64>,
}

impl Bits {
    fn none(counts: [usize; 3]) -> Self {
        Self { counts, words: vec![0; counts.iter().product::<usize>().div_ceil(WORD)] }
    }

    fn place(&self, [x, y, z]: [usize; 3]) -> usize {
        x + self.counts[0] * (y + self.counts[1] * z)
    }

    fn set(&mut self, at: [usize; 3]) {
        let place = self.place(at);
        self.words[place / WORD] |= 1 << (place % WORD);
    }

    fn has(&self, at: [usize; 3]) -> bool {
        let place = self.place(at);
        self.words[place / WORD] >> (place % WORD) & 1 == 1
    }
}

impl ShownCells {
    /// The cells of a brick, with the matrix from central differences at its level to gradients in the world.
    pub(crate) fn new(modulation: &Modulation, world_from_level: &DMat3, map: &ValueMap, brick: &DecodedBrick) -> Self {
        match &brick.voxels {
            Voxels::U8(voxels) => Self::of_voxels(modulation, world_from_level, map, (brick, voxels)),
            Voxels::U16(voxels) => Self::of_voxels(modulation, world_from_level, map, (brick, voxels)),
            Voxels::F32(voxels) => Self::of_voxels(modulation, world_from_level, map, (brick, voxels)),
        }
    }

    fn of_voxels<T: StoredVoxel>(
        modulation: &Modulation,
        world_from_level: &DMat3,
        map: &ValueMap,
        (brick, voxels): (&DecodedBrick, &[T]),
    ) -> Self {
        let core = brick.extent.map(|n| n as usize - 2 * APRON);
        let mut shown = Self {
            cells: Bits::none(core.map(|n| n + BEYOND)),
            macro_cells: Bits::none(core.map(|n| n.div_ceil(MACRO_CELL))),
        };
        let planes = Planes { voxels, brick, map, world_from_level };
        let mut near = planes.plane(0);
        for z in 0..core[2] + BEYOND {
            let far = planes.plane(z + 1);
            for y in 0..core[1] + BEYOND {
                for x in 0..core[0] + BEYOND {
                    let first = x + planes.row() * y;
                    let corners = [first, first + 1, first + planes.row(), first + planes.row() + 1];
                    let cell = corners.iter().fold(Corner::NOTHING, |cell, &at| cell.with(&near[at]).with(&far[at]));
                    if cell.low <= cell.high && modulation.shows([cell.low, cell.high], cell.square) {
                        shown.add([x, y, z]);
                    }
                }
            }
            near = far;
        }
        shown
    }

    /// Adds a cell, and the macro cells that it meets.
    fn add(&mut self, cell: [usize; 3]) {
        self.cells.set(cell);
        let counts = self.macro_cells.counts;
        // Half of the cell lies before its last voxel, half behind its first.
        let range = |a: usize| {
            let [first, last] = [cell[a].saturating_sub(BEYOND), cell[a]].map(|voxel| voxel / MACRO_CELL);
            first..=last.min(counts[a] - 1)
        };
        for z in range(2) {
            for y in range(1) {
                for x in range(0) {
                    self.macro_cells.set([x, y, z]);
                }
            }
        }
    }

    /// Whether a cell may show something; see `BrickVisit::place_of_cell`.
    pub(crate) fn has_cell(&self, cell: [usize; 3]) -> bool {
        self.cells.has(cell)
    }

    /// Whether something in a macro cell may show, by its place in the brick.
    pub(crate) fn has_macro_cell(&self, macro_cell: [usize; 3]) -> bool {
        self.macro_cells.has(macro_cell)
    }

    /// Whether something may show in a block of this edge, by its place in the brick.
    pub(crate) fn has_block(&self, block: [usize; 3], edge: usize) -> bool {
        let counts = self.cells.counts;
        // The cells from the one before the first voxel to that behind the last.
        let range = |a: usize| block[a] * edge..=((block[a] + 1) * edge).min(counts[a] - 1);
        range(2).any(|z| range(1).any(|y| range(0).any(|x| self.cells.has([x, y, z]))))
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> u64 {
        (size_of_val(&self.cells.words[..]) + size_of_val(&self.macro_cells.words[..])) as u64
    }
}

/// Values and gradients at some corners.
#[derive(Debug, Clone, Copy)]
struct Corner {
    low: f64,
    high: f64,
    /// Greatest squared length of the gradient.
    square: f64,
}

impl Corner {
    const NOTHING: Self = Self { low: f64::INFINITY, high: f64::NEG_INFINITY, square: 0.0 };

    fn with(self, other: &Self) -> Self {
        let Self { low, high, square } = *other;
        Self { low: self.low.min(low), high: self.high.max(high), square: self.square.max(square) }
    }
}

/// Planes of a brick's voxels, from one voxel before the core to one behind it.
struct Planes<'a, T> {
    voxels: &'a [T],
    brick: &'a DecodedBrick,
    map: &'a ValueMap,
    world_from_level: &'a DMat3,
}

impl<T: StoredVoxel> Planes<'_, T> {
    /// Corners along x in a plane.
    fn row(&self) -> usize {
        self.brick.extent[0] as usize - 2 * (APRON - BEYOND)
    }

    /// Data value of a voxel; NaN if absent.
    fn value(&self, voxel: usize) -> f64 {
        let value = self.voxels[voxel].data_value(self.map);
        match &self.brick.unrounded {
            Some(unrounded) if !value.is_nan() => unrounded.data_value(voxel, self.map),
            _ => value,
        }
    }

    /// The corners of a plane, x fastest. What is absent takes no part: beside it there is no gradient, unless a ray runs
    /// exactly in a plane of voxels.
    fn plane(&self, z: usize) -> Vec<Corner> {
        let extent = self.brick.extent.map(|n| n as usize);
        let steps = [1, extent[0], extent[0] * extent[1]];
        let before = APRON - BEYOND;
        let corner = |x: usize, y: usize| {
            let voxel = (x + before) + steps[1] * (y + before) + steps[2] * (z + before);
            let value = self.value(voxel);
            if value.is_nan() {
                return Corner::NOTHING;
            }
            let differences = steps.map(|step| 0.5 * (self.value(voxel + step) - self.value(voxel - step)));
            let square = (*self.world_from_level * DVec3::from_array(differences)).length_squared();
            Corner { low: value, high: value, square: if square.is_nan() { 0.0 } else { square } }
        };
        (0..extent[1] - 2 * before)
            .flat_map(|y| (0..extent[0] - 2 * before).map(move |x| (x, y)))
            .map(|(x, y)| corner(x, y))
            .collect()
    }
}
