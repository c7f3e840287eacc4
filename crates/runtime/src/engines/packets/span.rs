//! How many cells of a brick are integrated together.
//!
//! Where the field is smooth and the transfer function even, one line stands for several cells as well as for one
//! ([`super::integrate::Line::over`]), and classifying costs as much less. What it misses is bounded in the same way, and a
//! span that it does not settle is taken apart again, which costs more than cells of their own would have: so spans are
//! tried on a sample of a brick's cells first, along the way that rays take through it.
//!
//! The choice depends on the brick, the transfer function, the error asked for and the view, not on what is cast when.

use super::integrate::{Chord, Line, integrate_at, locate};
use super::lookup::Lookup;
use super::packet::{Classifier, ClassifyTask, Precision, Round};
use super::simd::{LANES_LIMIT, Simd};
use super::walk::{Packet, PacketBrick, ROUND, Walker};

/// Numbers of cells that are tried, the greatest first: divisors of a round's. One is what is left.
pub const SPANS: [usize; 2] = [6, 3];
/// Rounds of cells that are tried, in a brick that is large enough.
const SAMPLES: usize = 96;
/// Share of spans that one line has to settle: a cell that waits costs as much as ten that do not.
const LEAST_SETTLED: f64 = 0.97;
/// Spans that have to show something, for the share to say anything.
const LEAST_TRIED: u32 = 16;

/// Finds how many cells of a brick to integrate together.
pub struct ChooseSpan<'a> {
    /// The brick.
    pub brick: &'a PacketBrick<'a>,
    /// What is asked for.
    pub precision: Precision,
    /// Of rays through the brick's middle, in cells per world length.
    pub direction: [f32; 3],
}

/// Spans that show something, and those of them that one line settles.
#[derive(Clone, Copy, Default)]
struct Tried {
    shown: u32,
    settled: u32,
}

impl ClassifyTask for ChooseSpan<'_> {
    type Output = usize;

    #[inline(always)]
    fn run<S: Simd, L: Lookup>(self, classifier: &Classifier<'_, L>) -> usize {
        let mut tried = [Tried::default(); SPANS.len()];
        for first in (0..SAMPLES).step_by(S::LANES) {
            self.try_spans::<S, L>(classifier, first, &mut tried);
        }
        let is_settled = |tried: &Tried| {
            tried.shown >= LEAST_TRIED && f64::from(tried.settled) >= LEAST_SETTLED * f64::from(tried.shown)
        };
        tried.iter().position(is_settled).map_or(1, |i| SPANS[i])
    }
}

impl ChooseSpan<'_> {
    /// Tries all spans on the rounds of cells from sample `first` on, one in each lane.
    #[inline(always)]
    fn try_spans<S: Simd, L: Lookup>(
        &self,
        classifier: &Classifier<'_, L>,
        first: usize,
        tried: &mut [Tried; SPANS.len()],
    ) {
        let mut packet = Packet::default();
        for lane in 0..S::LANES {
            self.place(first + lane, lane, &mut packet);
        }
        // SAFETY: `place` begins and ends its rays between the first and the last voxel of the core.
        let mut walker = unsafe { Walker::<S>::new(&packet, &self.brick.walked) };
        let steps = walker.round();
        let round = Round { brick: self.brick, classifier, precision: self.precision, front: S::splat(1.0) };
        let mut chords = [Chord::nothing(); ROUND];
        let mut rows = [None; ROUND];
        // SAFETY: the walk stays in cells of the core.
        unsafe { round.fetch(&steps, &walker.direction, &mut chords, &mut rows) };
        for (span, tried) in SPANS.iter().zip(tried) {
            for cells in chords.chunks_exact(*span) {
                let line = Line::over(cells);
                let shows = round.shows(line.range(), line.crosses());
                let part = integrate_at::<S, L>(
                    classifier.table,
                    S::splat(classifier.narrow),
                    &locate(classifier.table, &line),
                );
                let is_settled = S::le(part.error, S::splat(self.precision.cell_error));
                // Holes say nothing of the field around them.
                let shows = shows & !S::is_nan(part.error);
                tried.shown += S::bits(shows).count_ones();
                tried.settled += S::bits(shows & is_settled).count_ones();
            }
        }
    }

    /// Places sample `number` into a lane: evenly over the brick (Roberts 2018, the additive sequence of three dimensions).
    #[inline(always)]
    fn place(&self, number: usize, lane: usize, packet: &mut Packet) {
        /// Powers of 1 / 1.2207..., the positive root of x^4 = x + 1.
        const STEPS: [f64; 3] = [0.819_172_513_396_164_5, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3];
        let mut length = f32::INFINITY;
        for (a, step) in STEPS.into_iter().enumerate() {
            let last = (self.brick.walked.core()[a] - 1) as f32;
            let origin = last * (number as f64 * step).fract() as f32;
            let direction = self.direction[a];
            let ahead = if direction > 0.0 { last - origin } else { origin };
            // None leaves the brick.
            length = length.min(ahead / direction.abs());
            packet.origin[a][lane] = origin;
            packet.direction[a][lane] = direction;
        }
        packet.length[lane] = if length.is_finite() { length } else { 0.0 };
    }
}

const _: () = assert!(LANES_LIMIT <= SAMPLES && SAMPLES.is_multiple_of(LANES_LIMIT));
