//! Refinement of unsettled cells: one per lane, cut into as many parts as its error requires. A lane whose cell is done
//! takes the next.
//!
//! The length of the first part follows from the square root of the error: in a smooth cell, the rule's error falls
//! with the square of the number of parts. Parts that are still too inaccurate are halved. They lengthen again behind
//! the difficult place, such as a step of the transfer function or a turn of the normal. If no part of [`LEAST_PART`]
//! suffices, for example where a ray grazes a step, or what rounding makes is too much, the cell is integrated in `f64`
//! ([`Host::integrate_in_f64`]). A lane's parts depend on its own error alone, so pictures do not depend on the
//! packing of lanes.

use supervol_format::cast::{narrow, single};

use super::chord::{Chord, cubic_at, cubic_through};
use super::integrate::{Part, Wanted, integrate};
use super::lookup::PieceLookup;
use super::packet::{Host, Lanes, PacketTransfer};
use super::pending::{PART_NUMBERS, PENDING_LIMIT, Pending};
use super::queue::{CELL_NUMBERS, QueuedCell};
use super::shade::{LightAt, PacketLighting, Shaded};
use super::simd::{LANES_LIMIT, Simd, Task, for_three, lanes};
use crate::engines::rules::{
    EASY, EXACT_FROM, HARD, LEAST_PART, LEAST_SHARE, PARTS_LIMIT, PARTS_PER_ROOT, PARTS_SHARE, ROUNDED_BELOW, SHORTEST,
    TRIES_LIMITS,
};
use crate::stream::counters::RayCounters;

/// Share of the lanes, as its inverse, that must be without work before they get new cells: that costs a quarter of a part.
const REFILL_SHARE: u32 = 5;

/// Refines all waiting cells and writes their parts.
pub struct Refine<'a, L> {
    /// The transfer function.
    pub classifier: &'a PacketTransfer<'a, L>,
    /// Rays of the packet.
    pub lanes: &'a Lanes,
    /// The brick's lighting, if it is shaded.
    pub lighting: Option<&'a PacketLighting<'a>>,
    /// The cells.
    pub pending: &'a mut Pending,
    /// Integrates the cells that are not settled here.
    pub host: &'a mut dyn Host,
}

/// Cells being cut, one per lane.
struct Cuts<S: Simd> {
    /// Numbers of the cells, and their additional numbers.
    numbers: [S::F; CELL_NUMBERS],
    more: [S::F; 12],
    /// Lanes that hold a cell.
    used: S::M,
    cell: QueuedCell<S>,
    /// The field and the gradient along the cell: coefficients.
    field: [S::F; 4],
    gradients: [[S::F; 4]; 3],
    to_eye: [S::F; 3],
    /// Beginning of the next part, and its length, in cells.
    at: S::F,
    next: S::F,
    /// Field and light there.
    begin: S::F,
    light: LightAt<S>,
    /// Parts that may still be tried.
    tries: S::F,
    /// The parts so far.
    sum: Part<S>,
}

/// The part of a cell that is tried.
struct Trial<S: Simd> {
    /// Its length and its end, in cells.
    size: S::F,
    end: S::F,
    chord: Chord<S>,
}

impl<S: Simd> Cuts<S> {
    /// No cells.
    #[inline(always)]
    fn new() -> Self {
        let zero = S::splat(0.0);
        let numbers = [zero; CELL_NUMBERS];
        Self {
            numbers,
            more: [zero; 12],
            used: S::lt(zero, zero),
            cell: QueuedCell::from_numbers(numbers),
            field: [zero; 4],
            gradients: [[zero; 4]; 3],
            to_eye: [zero; 3],
            at: zero,
            next: zero,
            begin: zero,
            light: LightAt::nothing(),
            tries: zero,
            sum: Part::nothing(),
        }
    }

    /// The next part.
    #[inline(always)]
    fn next_part(&self) -> Trial<S> {
        let (one, half) = (S::splat(1.0), S::splat(0.5));
        // The remainder must not be shorter than the shortest part.
        let rest = one - self.at;
        let size = S::select(S::lt(self.next + S::splat(LEAST_PART), rest), self.next, rest);
        let end = S::select(S::le(rest, size), one, self.at + size);
        let middle = S::mul_add(half, size, self.at);
        let whole = &self.cell.chord;
        let chord = Chord {
            values: [self.begin, cubic_at::<S>(self.field, middle), cubic_at::<S>(self.field, end)],
            cubic: whole.cubic * size * size * size,
            length: whole.length * size,
            noise: whole.noise,
            bounds: whole.bounds,
        };
        Trial { size, end, chord }
    }

    /// Light in the middle and at the end of a part.
    #[inline(always)]
    fn light_behind(&self, trial: &Trial<S>, lighting: &PacketLighting<'_>) -> [LightAt<S>; 2] {
        let middle = S::mul_add(S::splat(0.5), trial.size, self.at);
        let at_middle = for_three!(a => cubic_at::<S>(self.gradients[a], middle));
        let at_end = for_three!(a => cubic_at::<S>(self.gradients[a], trial.end));
        lighting.at::<S, 2>(&[at_middle, at_end], &self.to_eye)
    }

    /// Takes a part or halves it; `at_end` is the light at its end.
    #[inline(always)]
    fn end_part(&mut self, trial: &Trial<S>, part: &Part<S>, at_end: &LightAt<S>) {
        let going = self.going();
        let (size, sum) = (trial.size, &mut self.sum);
        let sum_in_front = sum.transmittance;
        let error = sum_in_front * part.error;
        // A part of what is left of the cell's tolerance.
        let unused = S::max(S::splat(PARTS_SHARE) - sum.error * self.cell.per_error, S::splat(0.0));
        let share = size / S::max(S::splat(1.0) - self.at, S::splat(LEAST_PART));
        let allowed = unused * S::max(share, S::splat(LEAST_SHARE));
        let (ratio, is_shortest) = (error * self.cell.per_error, S::le(size, S::splat(SHORTEST)));
        // NaN is taken, and found in the sum.
        let is_taken = (!S::lt(allowed, ratio) | is_shortest) & going;
        for c in 0..3 {
            let color = S::mul_add(sum_in_front, part.color[c], sum.color[c]);
            sum.color[c] = S::select(is_taken, color, sum.color[c]);
        }
        sum.error = S::select(is_taken, sum.error + error, sum.error);
        sum.tau = S::select(is_taken, sum.tau + part.tau, sum.tau);
        sum.transmittance = S::select(is_taken, sum_in_front * part.transmittance, sum_in_front);
        self.begin = S::select(is_taken, trial.chord.values[2], self.begin);
        self.at = S::select(is_taken, trial.end, self.at);
        self.light.replace(is_taken, at_end);
        let longer = S::select(S::lt(ratio, allowed * S::splat(EASY)), S::splat(2.0), S::splat(1.0));
        let shorter = S::select(S::lt(allowed * S::splat(HARD), ratio), S::splat(0.25), S::splat(0.5));
        self.next = S::max(size * S::select(is_taken, longer, shorter), S::splat(LEAST_PART));
        // Shorter parts around a step are rounded as much.
        let is_rounded = S::lt(unused, sum_in_front * part.rounding * self.cell.per_error);
        let is_hopeless = is_rounded & S::le(size, S::splat(ROUNDED_BELOW)) & !is_taken;
        self.tries = S::select(is_hopeless, S::splat(0.0), self.tries - S::splat(1.0));
    }

    /// Lanes whose cells are not at their end.
    #[inline(always)]
    fn going(&self) -> S::M {
        S::lt(self.at, S::splat(1.0)) & S::lt(S::splat(0.0), self.tries) & self.used
    }
}

impl<L: PieceLookup> Task for Refine<'_, L> {
    type Output = RayCounters;

    #[inline(always)]
    fn run<S: Simd>(mut self) -> RayCounters {
        let count = self.pending.cells.len();
        let mut work = RayCounters { cells_refined: count as u64, ..RayCounters::default() };
        let mut cuts = Cuts::<S>::new();
        let mut taken = 0;
        loop {
            let mut going = S::bits(cuts.going()).count_ones();
            let idle = narrow::<u32>(S::LANES) - going;
            if going == 0 || (taken < count && idle * REFILL_SHARE >= narrow::<u32>(S::LANES)) {
                self.hand_over(&cuts, &mut work);
                taken += self.refill(&mut cuts, taken);
                going = S::bits(cuts.going()).count_ones();
            }
            if going == 0 {
                break;
            }
            work.samples += u64::from(2 * going);
            self.cut(&mut cuts);
        }
        self.pending.cells.clear();
        work
    }
}

impl<L: PieceLookup> Refine<'_, L> {
    /// Moves cells from number `first` on into the idle lanes; returns their number.
    #[inline(always)]
    fn refill<S: Simd>(&self, cuts: &mut Cuts<S>, first: usize) -> usize {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let going = cuts.going();
        let mut bits = S::bits(!going);
        while bits.count_ones() as usize > self.pending.cells.len() - first {
            bits &= bits - 1;
        }
        let new = S::mask_from_bits(bits);
        self.pending.cells.refill::<S>(first, new, &mut cuts.numbers, &mut cuts.more);
        cuts.used = going | new;
        cuts.cell = QueuedCell::from_numbers(cuts.numbers);
        let QueuedCell { slot, chord, error, per_error, .. } = &cuts.cell;
        cuts.field = cubic_through::<S>(chord.values, chord.cubic);
        cuts.begin = S::select(new, chord.values[0], cuts.begin);
        if let Some(lighting) = self.lighting {
            let n = &cuts.more;
            cuts.gradients = for_three!(a => cubic_through::<S>([n[a], n[3 + a], n[6 + a]], n[9 + a]));
            cuts.to_eye = self.lanes.toward_eye::<S>(lighting, *slot);
            let [light] = lighting.at::<S, 1>(&[[n[0], n[1], n[2]]], &cuts.to_eye);
            cuts.light.replace(new, &light);
        }
        cuts.at = S::select(new, zero, cuts.at);
        cuts.next = S::select(new, first_part::<S>(*error * *per_error), cuts.next);
        cuts.tries = S::select(new, S::splat(TRIES_LIMITS[usize::from(self.lighting.is_some())]), cuts.tries);
        let sum = &mut cuts.sum;
        for c in 0..3 {
            sum.color[c] = S::select(new, zero, sum.color[c]);
        }
        sum.tau = S::select(new, zero, sum.tau);
        sum.transmittance = S::select(new, one, sum.transmittance);
        // Unknown from the beginning: beside a hole.
        sum.error = S::select(new, S::select(S::is_nan(*error), *error, zero), sum.error);
        bits.count_ones() as usize
    }

    /// Writes the parts of the finished cells.
    #[inline(always)]
    fn hand_over<S: Simd>(&mut self, cuts: &Cuts<S>, work: &mut RayCounters) {
        let done = cuts.used & !cuts.going();
        let sum = &cuts.sum;
        let [r, g, b] = sum.color;
        let mut numbers = [[0.0; LANES_LIMIT]; PART_NUMBERS];
        for (into, values) in numbers.iter_mut().zip([r, g, b, sum.error, sum.tau]) {
            S::store(values, into);
        }
        let (mut slots, mut bases, mut per_error) = ([0; LANES_LIMIT], [0; LANES_LIMIT], [0.0; LANES_LIMIT]);
        S::store(cuts.cell.per_error, &mut per_error);
        S::store_int(cuts.cell.slot, &mut slots);
        S::store_int(cuts.cell.base, &mut bases);
        // Unsettled also if NaN, beside a hole, or if the end was not reached.
        let is_settled = S::le(sum.error * cuts.cell.per_error, S::splat(EXACT_FROM)) & !S::lt(cuts.at, S::splat(1.0));
        let exact = S::bits(!is_settled & done);
        work.cells_exact += u64::from(exact.count_ones());
        for lane in lanes(S::bits(done)) {
            let (number, ray) =
                (narrow::<usize>(slots[lane]) / LANES_LIMIT, narrow::<usize>(slots[lane]) % LANES_LIMIT);
            let mut part = numbers.map(|values| values[lane]);
            if exact >> lane & 1 == 1 {
                let (ray, base, tolerance) = (self.lanes.rays[ray], bases[lane], 1.0 / per_error[lane]);
                let found = self.host.integrate_in_f64(ray, base, tolerance, &mut work.samples);
                let [r, g, b] = found.color.to_array().map(single);
                part = [r, g, b, single(found.error), -single(found.transmittance).max(f32::MIN_POSITIVE).ln()];
            }
            for (into, value) in self.pending.parts[number % PENDING_LIMIT].iter_mut().zip(part) {
                into[ray] = value;
            }
        }
    }

    /// Integrates the next part of each cell, and takes it or halves it.
    #[inline(always)]
    fn cut<S: Simd>(&self, cuts: &mut Cuts<S>) {
        let &PacketTransfer { table, limits, .. } = self.classifier;
        let trial = cuts.next_part();
        let mut along = [cuts.light; 3];
        if let Some(lighting) = self.lighting {
            [along[1], along[2]] = cuts.light_behind(&trial, lighting);
        }
        let wanted = Wanted { lanes: cuts.going(), order: S::splat(0.0), lit: self.lighting.is_some() };
        let mut part = integrate::<S, L>(table, limits, &trial.chord, &wanted);
        if let Some(lighting) = self.lighting {
            let cube = trial.size * trial.size * trial.size;
            let cubic = for_three!(a => cuts.gradients[a][3] * cube);
            let Shaded { color, error, rounding, .. } = lighting.shade::<S>(&part, &along, &cubic);
            (part.color, part.error, part.rounding) = (color, error, part.rounding + rounding);
        }
        cuts.end_part(&trial, &part, &along[2]);
    }
}

/// Length of the first part of cells with these errors, in tolerances: 1 if the whole cell may be settled at once.
#[inline(always)]
fn first_part<S: Simd>(ratio: S::F) -> S::F {
    let (one, two, most) = (S::splat(1.0), S::splat(2.0), S::splat(PARTS_LIMIT));
    let root = S::sqrt(S::min(ratio, most * most));
    let parts = S::floor(S::splat(PARTS_PER_ROOT) * root) + one;
    let least = S::select(S::le(ratio, one), one, two);
    one / S::min(S::max(parts, least), most)
}
