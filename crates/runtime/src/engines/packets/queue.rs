//! Queue of cells that need more work than the others of their round: packed densely, so that no lane is wasted.

use supervol_format::cast::narrow;

use super::chord::Chord;
use super::simd::{Simd, for_three, load_from};

/// Numbers of a [`QueuedCell`]: slot and base as bits.
pub const CELL_NUMBERS: usize = 10;

/// Up to `CAPACITY` cells minus whole lanes, with `MORE` additional numbers each.
#[derive(Debug, Clone)]
pub struct Queue<const CAPACITY: usize, const MORE: usize> {
    cells: [[f32; CAPACITY]; CELL_NUMBERS],
    more: [[f32; CAPACITY]; MORE],
    length: usize,
}

/// Numbers kept of every cell.
#[derive(Clone, Copy)]
pub struct QueuedCell<S: Simd> {
    /// Number of the cell on its ray times [`LANES_LIMIT`], plus the lane of the ray.
    pub slot: S::I,
    /// Voxel offset of its first corner.
    pub base: S::I,
    /// The field in it.
    pub chord: Chord<S>,
    /// Error of its colour and opacity so far.
    pub error: S::F,
    /// Error in tolerances, per error.
    pub per_error: S::F,
}

impl<S: Simd> QueuedCell<S> {
    /// A cell from its numbers.
    #[inline(always)]
    #[must_use]
    pub fn from_numbers(n: [S::F; CELL_NUMBERS]) -> Self {
        Self {
            slot: S::bits_from_float(n[0]),
            base: S::bits_from_float(n[1]),
            chord: Chord {
                values: [n[2], n[3], n[4]],
                cubic: n[5],
                length: n[6],
                noise: n[7],
                bounds: Chord::<S>::UNBOUNDED.map(S::splat),
            },
            error: n[8],
            per_error: n[9],
        }
    }
}

impl<const CAPACITY: usize, const MORE: usize> Queue<CAPACITY, MORE> {
    /// An empty queue.
    #[must_use]
    pub fn new() -> Self {
        Self { cells: [[0.0; CAPACITY]; CELL_NUMBERS], more: [[0.0; CAPACITY]; MORE], length: 0 }
    }

    /// Waiting cells.
    #[inline(always)]
    #[must_use]
    pub fn len(&self) -> usize {
        self.length
    }

    /// Removes all cells.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.length = 0;
    }

    /// Adds the lanes of a mask; `more` are the first of the `MORE` additional numbers.
    #[inline(always)]
    pub fn push<S: Simd, const K: usize>(&mut self, lanes: S::M, cell: &QueuedCell<S>, more: [S::F; K]) {
        let QueuedCell { slot, base, chord, error, per_error } = *cell;
        let [first, middle, last] = chord.values;
        let (slot, base) = (S::float_from_bits(slot), S::float_from_bits(base));
        let numbers = [slot, base, first, middle, last, chord.cubic, chord.length, chord.noise, error, per_error];
        for (into, number) in self.cells.iter_mut().zip(numbers).chain(self.more.iter_mut().zip(more)) {
            let room = into[self.length..].first_chunk_mut().expect("there is room for whole lanes");
            S::compress(number, lanes, room);
        }
        self.length += S::bits(lanes).count_ones() as usize;
    }

    /// Lanes that hold cells, from number `first` on.
    #[inline(always)]
    #[must_use]
    pub fn used<S: Simd>(&self, first: usize) -> S::M {
        let count = (self.length - first).min(S::LANES);
        S::mask_from_bits(narrow::<u32>((1u64 << count) - 1))
    }

    /// The cells from number `first` on, lane by lane; anything in lanes behind the last.
    #[inline(always)]
    #[must_use]
    pub fn cells<S: Simd>(&self, first: usize) -> QueuedCell<S> {
        let mut n = [S::splat(0.0); CELL_NUMBERS];
        for (into, numbers) in n.iter_mut().zip(&self.cells) {
            *into = load_from::<S>(numbers, first);
        }
        QueuedCell::from_numbers(n)
    }

    /// Slots of the cells from number `first` on, as bits.
    #[inline(always)]
    pub fn slots_from(&mut self, first: usize) -> &mut [f32] {
        &mut self.cells[0][first..self.length]
    }

    /// Moves cells from number `first` on into the lanes of a mask, in their order, with their additional numbers.
    #[inline(always)]
    pub fn refill<S: Simd>(&self, first: usize, mask: S::M, cells: &mut [S::F; CELL_NUMBERS], more: &mut [S::F; MORE]) {
        for (into, numbers) in cells.iter_mut().zip(&self.cells).chain(more.iter_mut().zip(&self.more)) {
            *into = S::expand(load_from::<S>(numbers, first), mask, *into);
        }
    }

    /// Three consecutive additional numbers, from number `number` on, of the cells from `first` on.
    #[inline(always)]
    #[must_use]
    pub fn three<S: Simd>(&self, number: usize, first: usize) -> [S::F; 3] {
        for_three!(i => load_from::<S>(&self.more[number + i], first))
    }

    /// See [`Queue::three`].
    #[inline(always)]
    #[must_use]
    pub fn one<S: Simd>(&self, number: usize, first: usize) -> S::F {
        load_from::<S>(&self.more[number], first)
    }
}
