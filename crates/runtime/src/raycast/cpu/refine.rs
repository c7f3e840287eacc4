//! Cells that one rule does not settle: packed densely, cut into as many parts as their error asks for.
//!
//! The first part is as long as the square root of the error says: where nothing happens in particular, the rule's error
//! falls with the square of the number of parts. Parts that are still too uncertain are halved, and lengthen again behind
//! what made them so: a step that is crossed, a normal that turns over. What no part of [`LEAST_PART`] settles, where a ray
//! grazes a step for example, goes to roots in `f64` ([`Host::integrate_exactly`]). A lane's parts depend on its own error
//! alone, so that pictures do not depend on how lanes are packed.

use super::integrate::{Chord, Part, cubic_at, cubic_through, integrate};
use super::lookup::Lookup;
use super::packet::{Classifier, Host, Lanes, PART_NUMBERS, Parts, Work, write_parts};
use super::queue::{Queue, QueuedCell};
use super::shade::PacketLighting;
use super::simd::{LANES_LIMIT, Simd, Task, for_three, lanes};

/// Most parts that a cell is cut into at once.
const PARTS_LIMIT: f32 = 64.0;
/// Most parts that are tried for one cell.
const TRIES_LIMIT: u32 = 128;
/// Shortest part, in cells.
const LEAST_PART: f32 = 1.0 / 4096.0;
/// Parts per square root of the error: what is left is then well below the tolerance.
const PARTS_PER_ROOT: f32 = 1.4;
/// Least share of a cell's tolerance that a part may use up, however short it is.
const LEAST_SHARE: f32 = 1.0 / 8.0;
/// Share of what is allowed, below which the next part is twice as long.
const EASY: f32 = 1.0 / 8.0;
/// Multiple of what is allowed, from which the next part is a quarter as long, not half.
const HARD: f32 = 16.0;
/// Error left after refinement, in tolerances, from which a cell is integrated exactly.
const EXACT_FROM: f32 = 2.5;

/// Numbers of an unsettled cell beside those of all, where it is shaded: the gradient at its beginning, its middle and its
/// end, and the coefficients of its third power.
pub type RefineQueue = Queue<12>;

/// Settles everything in a queue: writes the parts and empties it.
pub struct Refine<'a, L> {
    /// The transfer function.
    pub classifier: &'a Classifier<'a, L>,
    /// Rays of the packet.
    pub lanes: &'a Lanes,
    /// The brick's, where it is shaded.
    pub lighting: Option<&'a PacketLighting<'a>>,
    /// The cells; none are left.
    pub cells: &'a mut RefineQueue,
    /// Where colours and optical depths go.
    pub parts: &'a mut Parts,
    /// Who settles what is not settled here.
    pub host: &'a mut dyn Host,
}

impl<L: Lookup> Task for Refine<'_, L> {
    type Output = Work;

    #[inline(always)]
    fn run<S: Simd>(self) -> Work {
        let mut work = Work { refined: self.cells.len() as u64, ..Work::default() };
        for first in (0..self.cells.len()).step_by(S::LANES) {
            let count = (self.cells.len() - first).min(S::LANES);
            let cell = self.cells.cells::<S>(first);
            let (part, samples) = self.cut::<S>(&cell, first);
            work.samples += samples;
            let [r, g, b] = part.color;
            write_parts::<S, PART_NUMBERS>(self.parts, cell.slot, count, [r, g, b, part.tau]);
            let per_error = S::lookup16(&self.lanes.per_error, cell.slot);
            // Also NaN: a cell beside a hole.
            let is_unsettled = !S::le(part.error * per_error, S::splat(EXACT_FROM));
            let exact = S::bits(is_unsettled & self.cells.used::<S>(first));
            if exact != 0 {
                work.exact += u64::from(exact.count_ones());
                let (mut slots, mut bases) = ([0; LANES_LIMIT], [0; LANES_LIMIT]);
                S::store_int(cell.slot, &mut slots);
                S::store_int(cell.base, &mut bases);
                for lane in lanes(exact) {
                    let (step, ray) = (slots[lane] as usize / LANES_LIMIT, slots[lane] as usize % LANES_LIMIT);
                    let [r, g, b, transmittance] = self.host.integrate_exactly(self.lanes.rays[ray], bases[lane]);
                    let tau = -transmittance.max(f32::MIN_POSITIVE).ln();
                    for (number, value) in [r, g, b, tau].into_iter().enumerate() {
                        self.parts[step][number][ray] = value;
                    }
                }
            }
        }
        self.cells.clear();
        work
    }
}

impl<L: Lookup> Refine<'_, L> {
    /// Cuts the cells from number `first` on into parts and integrates those; also the number of samples.
    #[inline(always)]
    fn cut<S: Simd>(&self, cell: &QueuedCell<S>, first: usize) -> (Part<S>, u64) {
        let (zero, one, half) = (S::splat(0.0), S::splat(1.0), S::splat(0.5));
        let whole = cell.chord;
        let per_error = S::lookup16(&self.lanes.per_error, cell.slot);
        let used = self.cells.used::<S>(first);
        let field = cubic_through::<S>(whole.values, whole.cubic);
        #[allow(clippy::manual_map, reason = "nobody promises that a closure is compiled with the set's instructions")]
        let shading = match self.lighting {
            Some(lighting) => {
                Some((lighting, self.gradients::<S>(first), self.lanes.toward_eye::<S>(lighting, cell.slot)))
            }
            None => None,
        };
        let mut sum = Part::<S>::nothing();
        // Unknown from the beginning: beside a hole.
        sum.error = S::select(S::is_nan(cell.error), cell.error, zero);
        let (mut at, mut next) = (zero, first_part::<S>(cell.error * per_error));
        let mut begin = field[0];
        let mut gradient = match &shading {
            Some((_, curves, _)) => for_three!(a => curves[a][0]),
            None => [zero; 3],
        };
        let mut samples = 0;
        for _ in 0..TRIES_LIMIT {
            let going = S::lt(at, one) & used;
            let lanes = S::bits(going).count_ones();
            if lanes == 0 {
                return (sum, samples);
            }
            samples += u64::from(2 * lanes);
            // Nothing shorter than the shortest part is left over.
            let rest = one - at;
            let size = S::select(S::lt(next + S::splat(LEAST_PART), rest), next, rest);
            let is_last = S::le(rest, size);
            let end = S::select(is_last, one, at + size);
            let middle = S::mul_add(half, size, at);
            let values = [begin, cubic_at::<S>(field, middle), cubic_at::<S>(field, end)];
            let (cubic, length) = (whole.cubic * size * size * size, whole.length * size);
            let chord = Chord::<S> { values, cubic, length, noise: whole.noise };
            let mut part = integrate::<S, L>(self.classifier.table, S::splat(self.classifier.narrow), &chord);
            let mut gradient_at_end = gradient;
            if let Some((lighting, curves, to_eye)) = &shading {
                let at_middle = for_three!(a => cubic_at::<S>(curves[a], middle));
                gradient_at_end = for_three!(a => cubic_at::<S>(curves[a], end));
                let gradients = [gradient, at_middle, gradient_at_end];
                (part.color, part.error) = lighting.shade::<S>(&part, &gradients, to_eye);
            }
            let error = sum.transmittance * part.error;
            let allowed = S::max(size, S::splat(LEAST_SHARE));
            let (ratio, is_shortest) = (error * per_error, S::le(size, S::splat(LEAST_PART)));
            // NaN is taken, and found in the sum.
            let is_taken = (!S::lt(allowed, ratio) | is_shortest) & going;
            for c in 0..3 {
                let color = S::mul_add(sum.transmittance, part.color[c], sum.color[c]);
                sum.color[c] = S::select(is_taken, color, sum.color[c]);
                gradient[c] = S::select(is_taken, gradient_at_end[c], gradient[c]);
            }
            sum.error = S::select(is_taken, sum.error + error, sum.error);
            sum.tau = S::select(is_taken, sum.tau + part.tau, sum.tau);
            sum.transmittance = S::select(is_taken, sum.transmittance * part.transmittance, sum.transmittance);
            begin = S::select(is_taken, values[2], begin);
            at = S::select(is_taken, end, at);
            let longer = S::select(S::lt(ratio, allowed * S::splat(EASY)), size + size, size);
            let shorter = size * S::select(S::lt(allowed * S::splat(HARD), ratio), S::splat(0.25), half);
            next = S::select(is_taken, longer, S::max(shorter, S::splat(LEAST_PART)));
        }
        // Never settled: as if nothing were known.
        sum.error = S::select(S::lt(at, one), S::splat(f32::NAN), sum.error);
        (sum, samples)
    }

    /// The gradient along the cells from number `first` on: coefficients for each axis.
    #[inline(always)]
    fn gradients<S: Simd>(&self, first: usize) -> [[S::F; 4]; 3] {
        let cells = &self.cells;
        let (begin, middle) = (cells.three::<S>(0, first), cells.three::<S>(3, first));
        let (end, cubics) = (cells.three::<S>(6, first), cells.three::<S>(9, first));
        for_three!(a => cubic_through::<S>([begin[a], middle[a], end[a]], cubics[a]))
    }
}

/// Length of the first part of cells with these errors, in tolerances.
#[inline(always)]
fn first_part<S: Simd>(ratio: S::F) -> S::F {
    let (one, two, most) = (S::splat(1.0), S::splat(2.0), S::splat(PARTS_LIMIT));
    let root = S::sqrt(S::min(ratio, most * most));
    let parts = S::floor(S::splat(PARTS_PER_ROOT) * root) + one;
    one / S::min(S::max(parts, two), most)
}
