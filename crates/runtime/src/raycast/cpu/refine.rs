//! Cells that one rule does not settle: packed densely, cut into as many parts as their error asks for.
//!
//! The rule's error falls with the square of the number of parts, but where a ray grazes a step: there the whole length of
//! a part may lie on either side, and what is still too uncertain after [`PARTS_LIMIT`] parts goes to roots in `f64`
//! ([`Host::integrate_exactly`]). A lane's parts depend on its own error alone, so that pictures do not depend on how lanes are packed.

use super::integrate::{Chord, integrate};
use super::lookup::Lookup;
use super::packet::{Host, PART_NUMBERS, Parts, ROUND, Work};
use super::simd::{LANES_LIMIT, Simd};

/// Most parts that a cell is cut into.
pub const PARTS_LIMIT: f32 = 64.0;

/// Numbers kept of a cell.
const NUMBERS: usize = 8;
/// Parts per square root of the error: what is left is then well below the tolerance.
const PARTS_PER_ROOT: f32 = 1.4;
/// Error left after refinement, in tolerances, from which a cell is integrated exactly.
const EXACT_FROM: f32 = 1.0;
/// Cells that one round can leave, and room for whole lanes after the last.
const CAPACITY: usize = (ROUND + 1) * LANES_LIMIT;

/// Unsettled cells of one round.
pub struct Queue {
    /// s(0), s(1/2), s(1), coefficient of u^3, length, error in tolerances, tolerances per error.
    numbers: [[f32; CAPACITY]; NUMBERS],
    /// Cell of the round times [`LANES_LIMIT`] plus lane.
    slots: [u16; CAPACITY],
    bases: [i32; CAPACITY],
    length: usize,
}

impl Queue {
    /// An empty queue.
    #[inline(always)]
    pub fn new() -> Self {
        Self { numbers: [[0.0; CAPACITY]; NUMBERS], slots: [0; CAPACITY], bases: [0; CAPACITY], length: 0 }
    }

    /// Whether nothing waits.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Adds the lanes of `bits` in cell number `cell` of the round.
    #[inline(always)]
    pub fn push<S: Simd>(
        &mut self,
        bits: u32,
        chord: &Chord<S>,
        [error, per_error]: [S::F; 2],
        cell: usize,
        base: S::I,
    ) {
        let mut lanes = [[0.0; LANES_LIMIT]; NUMBERS];
        let numbers = [
            chord.values[0],
            chord.values[1],
            chord.values[2],
            chord.cubic,
            chord.length,
            error,
            per_error,
            chord.noise,
        ];
        for (lanes, number) in lanes.iter_mut().zip(numbers) {
            S::store(number, lanes);
        }
        let mut bases = [0; LANES_LIMIT];
        S::store_int(base, &mut bases);
        let mut rest = bits;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            for (into, from) in self.numbers.iter_mut().zip(&lanes) {
                into[self.length] = from[lane];
            }
            self.slots[self.length] = (cell * LANES_LIMIT + lane) as u16;
            self.bases[self.length] = bases[lane];
            self.length += 1;
        }
    }

    #[inline(always)]
    fn load<S: Simd>(&self, number: usize, first: usize) -> S::F {
        let mut lanes = [0.0; LANES_LIMIT];
        lanes.copy_from_slice(&self.numbers[number][first..first + LANES_LIMIT]);
        S::load(&lanes)
    }
}

/// Settles everything in the queue: writes the parts and empties it. Returns what that took.
#[inline(always)]
pub fn refine<S: Simd, L: Lookup>(
    table: &L,
    narrow: f32,
    rays: &[u16; LANES_LIMIT],
    queue: &mut Queue,
    parts: &mut Parts,
    host: &mut dyn Host,
) -> Work {
    let mut work = Work { refined: queue.length as u64, ..Work::default() };
    for first in (0..queue.length).step_by(S::LANES) {
        let count = (queue.length - first).min(S::LANES);
        let (mut out, mut errors) = ([[0.0; LANES_LIMIT]; PART_NUMBERS], [0.0; LANES_LIMIT]);
        work.samples += refine_lanes::<S, L>(table, narrow, queue, first, count, &mut out, &mut errors);
        for lane in 0..count {
            let slot = usize::from(queue.slots[first + lane]);
            let (cell, ray) = (slot / LANES_LIMIT, slot % LANES_LIMIT);
            // Also NaN: a cell beside a hole.
            let is_settled = errors[lane] <= EXACT_FROM;
            if !is_settled {
                work.exact += 1;
                let [r, g, b, transmittance] = host.integrate_exactly(rays[ray], queue.bases[first + lane]);
                let tau = -transmittance.max(f32::MIN_POSITIVE).ln();
                for (number, value) in [r, g, b, tau].into_iter().enumerate() {
                    parts[cell][number][ray] = value;
                }
            } else {
                for (number, lanes) in out.iter().enumerate() {
                    parts[cell][number][ray] = lanes[lane];
                }
            }
        }
    }
    queue.length = 0;
    work
}

/// Cuts `count` cells from `first` on into parts and integrates those.
#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "inlined into its one caller: the arguments are its variables")]
fn refine_lanes<S: Simd, L: Lookup>(
    table: &L,
    narrow: f32,
    queue: &Queue,
    first: usize,
    count: usize,
    out: &mut [[f32; LANES_LIMIT]; PART_NUMBERS],
    errors: &mut [f32; LANES_LIMIT],
) -> u64 {
    let (zero, one) = (S::splat(0.0), S::splat(1.0));
    let number = |n: usize| queue.load::<S>(n, first);
    let whole =
        Chord::<S> { values: [number(0), number(1), number(2)], cubic: number(3), length: number(4), noise: number(7) };
    let ratio = number(5);
    let used = S::mask_from_bits(((1u64 << count) - 1) as u32);
    let wanted = S::floor(S::splat(PARTS_PER_ROOT) * S::sqrt(S::min(ratio, S::splat(PARTS_LIMIT * PARTS_LIMIT)))) + one;
    let wanted = S::select(used, S::min(S::max(wanted, S::splat(2.0)), S::splat(PARTS_LIMIT)), zero);
    let share = one / S::max(wanted, one);
    let [k0, k1, k2, k3] = whole.coefficients();
    let at = |u: S::F| S::mul_add(u, S::mul_add(u, S::mul_add(u, k3, k2), k1), k0);
    let (cubic, length) = (k3 * share * share * share, whole.length * share);
    let mut color = [zero; 3];
    let mut transmittance = one;
    let (mut tau, mut error) = (zero, zero);
    let mut begin = k0;
    let mut done = zero;
    let mut samples = 0;
    loop {
        let going = S::lt(done, wanted);
        let lanes = S::bits(going).count_ones();
        if lanes == 0 {
            break;
        }
        samples += u64::from(2 * lanes);
        let middle = at((done + S::splat(0.5)) * share);
        let end = at((done + one) * share);
        let part = integrate::<S, L>(
            table,
            S::splat(narrow),
            &Chord::<S> { values: [begin, middle, end], cubic, length, noise: whole.noise },
        );
        for c in 0..3 {
            color[c] = S::select(going, S::mul_add(transmittance, part.color[c], color[c]), color[c]);
        }
        error = S::select(going, S::mul_add(transmittance, part.error, error), error);
        tau = S::select(going, tau + part.tau, tau);
        transmittance = S::select(going, transmittance * part.transmittance, transmittance);
        begin = end;
        done = done + one;
    }
    for c in 0..3 {
        S::store(color[c], &mut out[c]);
    }
    S::store(tau, &mut out[3]);
    S::store(error * number(6), errors);
    samples
}
