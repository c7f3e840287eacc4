//! Cells that need more than the others of their round: packed densely, so that no lane runs for nothing.

use super::integrate::Chord;
use super::simd::{LANES_LIMIT, Simd, for_three};
use super::walk::ROUND;

/// Cells that one round can leave, and room for whole lanes after the last.
const CAPACITY: usize = (ROUND + 1) * LANES_LIMIT;
/// Numbers of a [`QueuedCell`].
const CELL_NUMBERS: usize = 9;

/// Cells of one round, with `MORE` numbers each beside those of all.
#[derive(Debug, Clone)]
pub struct Queue<const MORE: usize> {
    cells: [[f32; CAPACITY]; CELL_NUMBERS],
    more: [[f32; CAPACITY]; MORE],
    length: usize,
}

/// What is kept of every cell.
#[derive(Clone, Copy)]
pub struct QueuedCell<S: Simd> {
    /// Number of the cell in its round times [`LANES_LIMIT`], plus the lane of its ray.
    pub slot: S::I,
    /// Voxel offset of its first corner.
    pub base: S::I,
    /// The field in it.
    pub chord: Chord<S>,
    /// Error of its colour and opacity so far.
    pub error: S::F,
}

impl<const MORE: usize> Queue<MORE> {
    /// An empty queue.
    #[must_use]
    pub fn new() -> Self {
        Self { cells: [[0.0; CAPACITY]; CELL_NUMBERS], more: [[0.0; CAPACITY]; MORE], length: 0 }
    }

    /// Cells that wait.
    #[inline(always)]
    #[must_use]
    pub fn len(&self) -> usize {
        self.length
    }

    /// Takes all cells off.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.length = 0;
    }

    /// Adds the lanes of a mask; the numbers of `more` are the first of `MORE`.
    #[inline(always)]
    pub fn push<S: Simd, const K: usize>(&mut self, lanes: S::M, cell: &QueuedCell<S>, more: [S::F; K]) {
        let QueuedCell { slot, base, chord, error } = *cell;
        let [first, middle, last] = chord.values;
        let (slot, base) = (S::float_from_bits(slot), S::float_from_bits(base));
        let numbers = [slot, base, first, middle, last, chord.cubic, chord.length, chord.noise, error];
        for (into, number) in self.cells.iter_mut().zip(numbers).chain(self.more.iter_mut().zip(more)) {
            let room = into[self.length..].first_chunk_mut().expect("a round leaves no more cells than it has");
            S::compress(number, lanes, room);
        }
        self.length += S::bits(lanes).count_ones() as usize;
    }

    /// Lanes that hold cells, from number `first` on.
    #[inline(always)]
    #[must_use]
    pub fn used<S: Simd>(&self, first: usize) -> S::M {
        let count = (self.length - first).min(S::LANES);
        S::mask_from_bits(((1u64 << count) - 1) as u32)
    }

    /// The cells from number `first` on, lane by lane; anything in lanes behind the last.
    #[inline(always)]
    #[must_use]
    pub fn cells<S: Simd>(&self, first: usize) -> QueuedCell<S> {
        let mut n = [S::splat(0.0); CELL_NUMBERS];
        for (into, numbers) in n.iter_mut().zip(&self.cells) {
            *into = load::<S>(numbers, first);
        }
        QueuedCell {
            slot: S::bits_from_float(n[0]),
            base: S::bits_from_float(n[1]),
            chord: Chord { values: [n[2], n[3], n[4]], cubic: n[5], length: n[6], noise: n[7] },
            error: n[8],
        }
    }

    /// Three of the other numbers of the cells from number `first` on, in a row from `number`.
    #[inline(always)]
    #[must_use]
    pub fn three<S: Simd>(&self, number: usize, first: usize) -> [S::F; 3] {
        for_three!(i => load::<S>(&self.more[number + i], first))
    }

    /// See [`Queue::three`].
    #[inline(always)]
    #[must_use]
    pub fn one<S: Simd>(&self, number: usize, first: usize) -> S::F {
        load::<S>(&self.more[number], first)
    }
}

#[inline(always)]
fn load<S: Simd>(numbers: &[f32; CAPACITY], first: usize) -> S::F {
    S::load(numbers[first..].first_chunk().expect("the queue ends with room for all lanes"))
}
