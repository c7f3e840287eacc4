//! Cells that wait for refinement, over several rounds, and the light that their rays gather in between.
//!
//! ```text
//! ray:  settled cells | cell that waits | settled cells | cell that waits | settled cells
//!       light 0         part 0            light 1         part 1            what the ray gathers now
//! ```
//!
//! A ray walks on while its cells wait. It weights its light by the known transmittance: that of its settled cells, and
//! an upper bound for the waiting ones. When enough cells wait to fill all lanes several times, they are refined
//! together. The light behind them is then dimmed by their remaining absorption ([`Light::settle`]). A ray's result
//! does not depend on when that happens: cells are added in the ray's own order, light by light and part by part.

use supervol_format::cast::narrow;

use super::queue::Queue;
use super::simd::{LANES_LIMIT, Simd, exp_minus, for_three, lanes};
use super::walk::{PerLane, ROUND};

/// Most waiting cells of one ray.
pub const PENDING_LIMIT: usize = 3 * ROUND;
/// Number of waiting cells at which they are refined.
const ENOUGH: usize = 8 * LANES_LIMIT;
/// Capacity for waiting cells, plus whole lanes after the last.
const CAPACITY: usize = (PENDING_LIMIT + 1) * LANES_LIMIT;

/// Numbers of a part: red, green, blue, error of these and of opacity, optical depth.
pub const PART_NUMBERS: usize = 5;
/// Index of the error; used only if errors are summed up.
pub const ERROR: usize = 3;
/// Index of the optical depth.
pub const DEPTH: usize = 4;
/// Numbers of the light in front of a cell: red, green, blue, their error, optical depth.
const LIGHT_NUMBERS: usize = 5;
/// Numbers of a part that are light: its colour, and its error if errors are summed up.
const CHANNELS: usize = ERROR + 1;
/// Parts of cells: the numbers of each lane, cell after cell.
pub type Parts<const CELLS: usize> = [[PerLane; PART_NUMBERS]; CELLS];

/// The parts of a round.
#[derive(Debug, Clone)]
pub struct RoundParts {
    /// Results of the rule that integrates every cell.
    pub numbers: Parts<ROUND>,
    /// Lower bounds on their optical depths.
    pub least_depths: [PerLane; ROUND],
    /// Cells, or the first cells of spans, that contribute: the numbers of all others are not read.
    pub shows: [bool; ROUND],
}

impl RoundParts {
    /// Nothing in any cell.
    #[inline(always)]
    #[must_use]
    pub fn new() -> Self {
        let nothing = [0.0; LANES_LIMIT];
        let numbers = [[nothing; PART_NUMBERS]; ROUND];
        Self { numbers, least_depths: [nothing; ROUND], shows: [false; ROUND] }
    }

    /// Writes colour and error of the visible parts of a step.
    #[inline(always)]
    pub fn write_shaded<S: Simd>(&mut self, step: usize, shows: S::M, color: [S::F; 3], error: S::F) {
        let [r, g, b] = color;
        for (into, value) in self.numbers[step].iter_mut().zip([r, g, b, error]) {
            S::store(S::select(shows, value, S::load(into)), into);
        }
    }

    /// Writes all numbers but the depth of the parts of `count` cells.
    #[inline(always)]
    pub fn write_colors<S: Simd>(&mut self, slot: S::I, count: usize, numbers: [S::F; DEPTH]) {
        let mut slots = [0; LANES_LIMIT];
        S::store_int(slot, &mut slots);
        for (number, values) in numbers.into_iter().enumerate() {
            let mut lanes = [0.0; LANES_LIMIT];
            S::store(values, &mut lanes);
            for (&slot, value) in slots.iter().zip(lanes).take(count) {
                self.numbers[narrow::<usize>(slot) / LANES_LIMIT % ROUND][number]
                    [narrow::<usize>(slot) % LANES_LIMIT] = value;
            }
        }
    }
}

/// The parts of waiting cells.
pub type PendingParts = Parts<PENDING_LIMIT>;

/// Additional numbers of a shaded unsettled cell: the gradient at its beginning, middle and end, and the gradient's
/// cubic coefficients.
pub type RefineQueue = Queue<CAPACITY, 12>;

/// Waiting cells of a packet. See the module.
#[derive(Debug, Clone)]
pub struct Pending {
    /// The cells. The slot of a cell of the current round is its step times [`LANES_LIMIT`] plus the lane. In earlier
    /// rounds it has the cell's number on the ray instead of the step.
    pub cells: RefineQueue,
    /// Contributions of the cells, once they are known.
    pub parts: PendingParts,
    /// Light in front of each: premultiplied colour and error since the previous one, and the known optical depth;
    /// infinite behind the end of the ray.
    light: [[PerLane; LIGHT_NUMBERS]; PENDING_LIMIT],
    /// Lower bounds on their optical depths.
    least_depths: [PerLane; PENDING_LIMIT],
    /// Waiting cells of each ray.
    counts: [u8; LANES_LIMIT],
    /// Number of them whose light is known.
    lit: [u8; LANES_LIMIT],
}

impl Pending {
    /// Nothing waits.
    #[must_use]
    pub fn new() -> Self {
        let parts = [[[0.0; LANES_LIMIT]; PART_NUMBERS]; PENDING_LIMIT];
        let light = [[[0.0; LANES_LIMIT]; LIGHT_NUMBERS]; PENDING_LIMIT];
        let least_depths = [[0.0; LANES_LIMIT]; PENDING_LIMIT];
        let counts = [0; LANES_LIMIT];
        Self { cells: RefineQueue::new(), parts, light, least_depths, counts, lit: counts }
    }

    /// Whether cells are to be refined before the next round: there are many, or a ray has no room for more.
    #[inline(always)]
    pub fn is_enough(&self) -> bool {
        let most = self.counts.iter().copied().fold(0, u8::max);
        self.cells.len() >= ENOUGH || usize::from(most) + ROUND > PENDING_LIMIT
    }

    /// Takes the waiting cells of a round, from number `first` on, out of its parts; only their least depth stays.
    /// Returns their lanes, step by step.
    #[inline(always)]
    pub fn take_over(&mut self, first: usize, parts: &mut RoundParts) -> [u32; ROUND] {
        let mut left = [0; ROUND];
        for slot in self.cells.slots_from(first) {
            let (step, lane) = (slot.to_bits() as usize / LANES_LIMIT % ROUND, slot.to_bits() as usize % LANES_LIMIT);
            left[step] |= 1 << lane;
            let number = usize::from(self.counts[lane]) % PENDING_LIMIT;
            let least_depth = parts.least_depths[step][lane];
            for (numbers, value) in parts.numbers[step].iter_mut().zip([0.0, 0.0, 0.0, 0.0, least_depth]) {
                numbers[lane] = value;
            }
            self.least_depths[number][lane] = least_depth;
            *slot = f32::from_bits(narrow::<u32>(number * LANES_LIMIT + lane));
            self.counts[lane] += 1;
        }
        left
    }

    /// Records the light in front of the next waiting cell of each lane of a mask.
    #[inline(always)]
    fn note_light<S: Simd>(&mut self, mask: u32, [r, g, b, error]: [S::F; CHANNELS], depth: S::F) {
        let mut numbers = [[0.0; LANES_LIMIT]; LIGHT_NUMBERS];
        for (into, values) in numbers.iter_mut().zip([r, g, b, error, depth]) {
            S::store(values, into);
        }
        for lane in lanes(mask) {
            let light = &mut self.light[usize::from(self.lit[lane]) % PENDING_LIMIT];
            for (into, values) in light.iter_mut().zip(&numbers) {
                into[lane] = values[lane];
            }
            self.lit[lane] += 1;
        }
    }
}

/// Light that rays have gathered in a brick.
#[derive(Clone, Copy)]
pub struct Light<S: Simd> {
    /// Transmittance in front of the brick.
    front: S::F,
    /// Premultiplied colour and error behind the last cell that waits or waited, weighted by the known transmittance.
    color: [S::F; CHANNELS],
    /// Known transmittance and optical depth.
    transmittance: S::F,
    depth: S::F,
    /// The same up to the last cell that waited.
    behind: [S::F; CHANNELS],
    /// Optical depth of the cells that waited, minus its lower bounds.
    hidden: S::F,
    /// Rays that have ended in a cell that waited.
    ended: S::M,
    /// Whether errors are summed.
    pub(super) sums_errors: bool,
}

impl<S: Simd> Light<S> {
    /// No light, behind this transmittance; errors are not summed.
    #[inline(always)]
    pub fn new(front: S::F) -> Self {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let (color, behind) = ([zero; CHANNELS], [zero; CHANNELS]);
        let ended = S::lt(one, zero);
        Self { front, color, transmittance: one, depth: zero, behind, hidden: zero, ended, sums_errors: false }
    }

    /// Rays whose known transmittance is at most `last`.
    #[inline(always)]
    pub fn ended(&self, last: S::F) -> S::M {
        S::le(self.transmittance * self.front, last) | self.ended
    }

    /// Colour and transmittance, when nothing waits.
    #[inline(always)]
    pub fn sum(&self) -> ([S::F; 3], S::F) {
        let dimmed = exp_minus::<S>(self.hidden);
        let color = for_three!(c => S::mul_add(dimmed, self.color[c], self.behind[c]));
        (color, exp_minus::<S>(self.depth + self.hidden))
    }

    /// Error of colour and opacity, when nothing waits: those of the cells, each times the transmittance in front of it.
    #[inline(always)]
    pub fn error(&self) -> S::F {
        S::mul_add(exp_minus::<S>(self.hidden), self.color[ERROR], self.behind[ERROR])
    }

    /// Adds the parts of a round, without the lanes `left` at each step. Rays whose transmittance falls to `last` end
    /// there.
    ///
    /// A ray ends in the cell that makes it end, not with the round: rounds begin elsewhere if rays leap.
    #[inline(always)]
    pub fn composite(&mut self, parts: &RoundParts, left: &[u32; ROUND], pending: &mut Pending, last: S::F) {
        let (zero, sums_errors) = (S::splat(0.0), self.sums_errors);
        if !parts.shows.contains(&true) {
            return;
        }
        // Depth and transmittance in front of each cell, and behind the last: no exponential waits for another.
        let mut depths = [self.depth; ROUND + 1];
        let mut transmittances = [self.transmittance; ROUND + 1];
        for i in 0..ROUND {
            if !parts.shows[i] {
                (depths[i + 1], transmittances[i + 1]) = (depths[i], transmittances[i]);
                continue;
            }
            depths[i + 1] = depths[i] + S::load(&parts.numbers[i][DEPTH]);
            // Computed from the sum, not as a product: products of thousands of numbers near 1 round to one side in an
            // even field.
            transmittances[i + 1] = exp_minus::<S>(depths[i + 1]);
        }
        (self.depth, self.transmittance) = (depths[ROUND], transmittances[ROUND]);
        // If nothing is added, nothing changes from one cell to the next.
        for i in (0..ROUND).rev().filter(|&i| parts.shows[i] | (left[i] != 0)) {
            let goes_on = S::lt(last, transmittances[i] * self.front);
            self.depth = S::select(goes_on, self.depth, depths[i]);
            self.transmittance = S::select(goes_on, self.transmittance, transmittances[i]);
            transmittances[i] = S::select(goes_on, transmittances[i], zero);
        }
        for i in 0..ROUND {
            if left[i] != 0 {
                let goes_on = S::lt(zero, transmittances[i]);
                let depth = S::select(goes_on, depths[i], S::splat(f32::INFINITY));
                pending.note_light::<S>(left[i], self.color, depth);
                let is_noted = S::mask_from_bits(left[i]) & goes_on;
                for c in (0..CHANNELS).filter(|&c| sums_errors || c < ERROR) {
                    self.color[c] = S::select(is_noted, zero, self.color[c]);
                }
            }
            if !parts.shows[i] {
                continue;
            }
            for c in (0..CHANNELS).filter(|&c| sums_errors || c < ERROR) {
                self.color[c] = S::mul_add(transmittances[i], S::load(&parts.numbers[i][c]), self.color[c]);
            }
        }
    }

    /// Adds all waiting cells, each behind its light.
    #[inline(always)]
    pub fn settle(&mut self, pending: &mut Pending, last: S::F) {
        let (zero, sums_errors) = (S::splat(0.0), self.sums_errors);
        let mut counts = [0; LANES_LIMIT];
        for (into, count) in counts.iter_mut().zip(&pending.counts) {
            *into = i32::from(*count);
        }
        let most = pending.counts.iter().copied().fold(0, u8::max);
        let counts = S::load_int(&counts);
        for number in 0..usize::from(most).min(PENDING_LIMIT) {
            let (light, part) = (&pending.light[number], &pending.parts[number]);
            let depth = S::load(&light[CHANNELS]);
            let is_there = S::lt_int(S::splat_int(narrow::<i32>(number)), counts) & !self.ended;
            let is_there = is_there & S::lt(depth, S::splat(f32::INFINITY));
            let dimmed = S::select(is_there, exp_minus::<S>(self.hidden), zero);
            let transmittance = S::select(is_there, exp_minus::<S>(depth + self.hidden), zero);
            for c in (0..CHANNELS).filter(|&c| sums_errors || c < ERROR) {
                let in_front = S::mul_add(dimmed, S::load(&light[c]), self.behind[c]);
                self.behind[c] = S::mul_add(transmittance, S::load(&part[c]), in_front);
            }
            let known = S::load(&pending.least_depths[number]);
            self.hidden = S::select(is_there, self.hidden + (S::load(&part[DEPTH]) - known), self.hidden);
            let depth = depth + known;
            let ends = is_there & S::le(exp_minus::<S>(depth + self.hidden) * self.front, last);
            // Light that the ray gathered behind its end is dropped.
            self.depth = S::select(ends, depth, self.depth);
            for c in (0..CHANNELS).filter(|&c| sums_errors || c < ERROR) {
                self.color[c] = S::select(ends, zero, self.color[c]);
            }
            self.ended = self.ended | ends;
        }
        pending.counts = [0; LANES_LIMIT];
        pending.lit = [0; LANES_LIMIT];
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::random::Random;

    use super::super::chord::Chord;
    use super::super::queue::QueuedCell;
    use super::super::simd::{Portable, Task};
    use super::*;

    /// Rays of random parts, one for `SPAN` cells, or one for each cell that waits; largest difference of colour and
    /// transmittance from the plain sum.
    struct Rays<const SPAN: usize> {
        seed: u64,
        /// Share of cells that wait.
        waiting: f64,
        /// Greatest optical depth of a cell.
        depth: f64,
        last: f32,
    }

    impl<const SPAN: usize> Task for Rays<SPAN> {
        type Output = f64;

        #[inline(always)]
        fn run<S: Simd>(self) -> f64 {
            let mut numbers = Random::new(self.seed);
            let mut random = || numbers.unit();
            let zero = S::splat(0.0);
            let chord = Chord::nothing();
            let mut pending = Pending::new();
            let mut light = Light::<S>::new(S::splat(1.0));
            light.sums_errors = true;
            let mut exact = [[0.0f64, 0.0, 1.0]; LANES_LIMIT];
            for _ in 0..20 {
                let mut parts = RoundParts::new();
                let mut truth = [[[0.0f32; 3]; LANES_LIMIT]; ROUND];
                // Ended rays do not walk on.
                let ended = S::bits(light.ended(S::splat(self.last)));
                let mut settled = [false; LANES_LIMIT];
                for (step, truth) in truth.iter_mut().enumerate() {
                    let mut waits = 0;
                    for lane in 0..S::LANES {
                        let has_ended = ended >> lane & 1 == 1;
                        let is_first = step.is_multiple_of(SPAN);
                        parts.shows[step] = is_first;
                        if is_first {
                            // The unknown part of waiting cells has no influence.
                            settled[lane] = has_ended || random() >= self.waiting;
                        }
                        let is_settled = settled[lane];
                        let tau = if is_settled && !is_first { 0.0 } else { self.depth * random() };
                        let color = random() * (1.0 - (-tau).exp());
                        let error = random() * (1.0 - (-tau).exp());
                        truth[lane] = [color as f32, error as f32, tau as f32];
                        let [sum, errors, through] = &mut exact[lane];
                        *sum += *through * color;
                        *errors += *through * error;
                        *through *= (-tau).exp();
                        waits |= u32::from(!is_settled) << lane;
                        let [color, error, tau] = match (has_ended, is_settled) {
                            (true, _) => [0.0; 3],
                            (false, true) => [color, error, tau],
                            (false, false) => [random(), random(), random()],
                        };
                        // The contribution of a span is stored in its first cell; the numbers of the others are not
                        // read.
                        let [color, error, tau] =
                            if is_first { [color as f32, error as f32, tau as f32] } else { [f32::NAN; 3] };
                        let numbers = &mut parts.numbers[step];
                        (numbers[0][lane], numbers[ERROR][lane], numbers[DEPTH][lane]) = (color, error, tau);
                        // No lower bound is known of a waiting span.
                        let known = if SPAN == 1 { random() as f32 } else { 0.0 };
                        parts.least_depths[step][lane] = truth[lane][2] * known;
                    }
                    let slots = std::array::from_fn(|lane| (step * LANES_LIMIT + lane) as i32);
                    let cell = QueuedCell {
                        slot: S::load_int(&slots),
                        base: S::splat_int(0),
                        chord,
                        error: zero,
                        per_error: zero,
                    };
                    pending.cells.push::<S, 0>(S::mask_from_bits(waits), &cell, []);
                }
                let steps: Vec<_> = pending.cells.slots_from(0).iter().map(|slot| slot.to_bits() as usize).collect();
                let left = pending.take_over(0, &mut parts);
                light.composite(&parts, &left, &mut pending, S::splat(self.last));
                let slots: Vec<_> = pending.cells.slots_from(0).iter().map(|slot| slot.to_bits() as usize).collect();
                for (from, to) in steps.into_iter().zip(slots) {
                    let [color, error, tau] = truth[from / LANES_LIMIT][from % LANES_LIMIT];
                    let (part, lane) = (&mut pending.parts[to / LANES_LIMIT], to % LANES_LIMIT);
                    (part[0][lane], part[ERROR][lane], part[DEPTH][lane]) = (color, error, tau);
                }
                pending.cells.clear();
                if pending.is_enough() || random() < 0.3 {
                    light.settle(&mut pending, S::splat(self.last));
                }
            }
            light.settle(&mut pending, S::splat(self.last));
            let (color, transmittance) = light.sum();
            let mut found = [[0.0; LANES_LIMIT]; 3];
            for (into, values) in found.iter_mut().zip([color[0], light.error(), transmittance]) {
                S::store(values, into);
            }
            let differences = (0..S::LANES).flat_map(|lane| {
                exact[lane].into_iter().zip(found).map(move |(exact, found)| (f64::from(found[lane]) - exact).abs())
            });
            differences.fold(0.0, f64::max)
        }
    }

    #[test]
    fn cells_that_wait_are_added_in_their_places() {
        for seed in 0..200 {
            let [waiting, depth] = [[0.0, 0.1], [0.1, 0.05], [0.5, 0.3], [1.0, 0.02]][seed as usize % 4];
            let last = 0.0;
            let differences = [
                Rays::<1> { seed, waiting, depth, last }.run::<Portable>(),
                Rays::<3> { seed, waiting, depth, last }.run::<Portable>(),
                Rays::<6> { seed, waiting, depth, last }.run::<Portable>(),
            ];
            assert!(differences.iter().all(|&d| d < 3e-6), "seed {seed}: {differences:?}");
        }
    }

    #[test]
    fn rays_that_end_miss_no_more_than_what_gets_through() {
        for seed in 0..200 {
            let [waiting, depth] = [[0.0, 2.0], [0.1, 1.0], [0.5, 0.3], [1.0, 5.0]][seed as usize % 4];
            let difference = Rays::<3> { seed, waiting, depth, last: 0.01 }.run::<Portable>();
            assert!(difference < 0.01 + 3e-6, "seed {seed}: {difference}");
        }
    }
}
