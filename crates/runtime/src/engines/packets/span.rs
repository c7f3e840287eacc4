//! Choice of the number of cells of a brick that are integrated together.
//!
//! If the field is smooth and the transfer function even, one line replaces several cells without loss
//! ([`super::chord::Line::over`]), and classification is that much cheaper. Its error is bounded in the same way.
//! An unsettled span is split into cells again, which costs more than cells from the start. So spans are first tried on
//! a sample of a brick's cells, along the direction of rays through it.
//!
//! The choice depends on the brick, the transfer function, the requested error and the view. It does not depend on the
//! order of casting.

use std::marker::PhantomData;

use supervol_format::cast::single;

use super::budget::Budget;
use super::chord::{Chord, Line};
use super::integrate::{Wanted, integrate_at};
use super::lookup::PieceLookup;
use super::packet::{ClassifyTask, PacketTransfer, Precision, Round};
use super::simd::{LANES_LIMIT, Simd};
use super::uneven::locate;
use super::walk::{Packet, PacketBrick, ROUND, Walker};

/// Numbers of cells to try, the greatest first: divisors of a round's. If none suits, it is one.
pub const SPANS: [usize; 2] = [6, 3];
/// Rounds of cells to try, in a brick that is large enough.
const SAMPLES: usize = 96;
/// Least share of spans that one line must settle: a cell that waits costs as much as ten that do not.
const LEAST_SETTLED: f64 = 0.97;
/// Least number of visible spans for the share to be meaningful.
const LEAST_TRIED: u32 = 16;

/// Finds the number of cells of a brick to integrate together.
pub struct ChooseSpan<'a> {
    /// The brick.
    pub brick: &'a PacketBrick<'a>,
    /// The required accuracy.
    pub precision: Precision,
    /// Direction of rays through the brick's middle, in cells per world length.
    pub direction: [f32; 3],
}

/// Number of visible spans, and of those that one line settles.
#[derive(Clone, Copy, Default)]
struct Tried {
    shown: u32,
    settled: u32,
}

impl ClassifyTask for ChooseSpan<'_> {
    type Output = usize;

    #[inline(always)]
    fn run<S: Simd, L: PieceLookup>(self, classifier: &PacketTransfer<'_, L>) -> usize {
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
    fn try_spans<S: Simd, L: PieceLookup>(
        &self,
        classifier: &PacketTransfer<'_, L>,
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
        let round = Round { brick: self.brick, classifier, precision: self.precision, lanes: PhantomData };
        let mut chords = [Chord::nothing(); ROUND];
        let mut rows = [None; ROUND];
        // SAFETY: the walk stays in cells of the core.
        unsafe { round.fetch(&steps, &walker.direction, &mut chords, &mut rows) };
        for (span, tried) in SPANS.iter().zip(tried) {
            for cells in chords.chunks_exact(*span) {
                let line = Line::over(cells);
                let shows = round.shows(line.range(), line.crosses());
                let located = locate(classifier.table, &line, shows);
                let wanted = Wanted { lanes: shows, order: S::splat(0.0), lit: false };
                let part = integrate_at::<S, L>(classifier.table, classifier.limits, (&line, &located), &wanted);
                // Typical rays have spent half of their reserve.
                let half = S::splat(0.5 * self.precision.reserve);
                let budget = Budget::<S>::new(half, S::splat(1.0), [self.precision.by_opacity, 0.0]);
                let allowed = budget.allowed(part.passed(), *span).sum();
                let is_settled = S::le(part.error, allowed);
                // Holes say nothing about the field around them.
                let shows = shows & !S::is_nan(part.error);
                tried.shown += S::bits(shows).count_ones();
                tried.settled += S::bits(shows & is_settled).count_ones();
            }
        }
    }

    /// Writes sample `number` into a lane: samples are spread evenly over the brick (Roberts 2018, the additive
    /// sequence of three dimensions).
    #[inline(always)]
    fn place(&self, number: usize, lane: usize, packet: &mut Packet) {
        /// Powers of 1 / 1.2207..., the positive root of x^4 = x + 1.
        const STEPS: [f64; 3] = [0.819_172_513_396_164_5, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3];
        let mut length = f32::INFINITY;
        for (a, step) in STEPS.into_iter().enumerate() {
            let last = (self.brick.walked.core()[a] - 1) as f32;
            let origin = last * single((number as f64 * step).fract());
            let direction = self.direction[a];
            let ahead = if direction > 0.0 { last - origin } else { origin };
            // No sample leaves the brick.
            length = length.min(ahead / direction.abs());
            packet.origin[a][lane] = origin;
            packet.direction[a][lane] = direction;
        }
        packet.length[lane] = if length.is_finite() { length } else { 0.0 };
    }
}

const _: () = assert!(LANES_LIMIT <= SAMPLES && SAMPLES.is_multiple_of(LANES_LIMIT));
