//! A packet of rays through one brick in mode `dvr`: walk, fetch, classify, shade, composite.
//!
//! Rays are cast in *rounds* of [`ROUND`] cells, stage by stage over all lanes.
//! 1. leap: rays in front of invisible blocks go to the face of the proximity cloud's cube ([`super::walk`]);
//! 2. walk: base and fractions of the next cells;
//! 3. fetch: the field along each cell; locate it in the transfer function's table; integrate it
//!    ([`super::integrate`]);
//! 4. shade visible cells ([`super::shade`]); composite. Cells whose error is too large wait ([`super::pending`]) until
//!    there are enough to be refined together ([`super::refine`]).
//!
//! The cells of a round pass each stage together: stages are short, so that the processor overlaps several cells.

use std::marker::PhantomData;

use supervol_format::cast::narrow;
use supervol_scene::transfer_function::pieces::Limits;

use super::blocks::OVERSHOOT;
use super::budget::{Allowed, Budget};
use super::chord::{Chord, Line};
use super::fetch::{LaneCell, Raw, Rows};
use super::integrate::{Part, Passed, Wanted, integrate_at};
use super::lookup::PieceLookup;
use super::pending::{DEPTH, ERROR, Light, Pending, RoundParts};
use super::queue::QueuedCell;
use super::refine::Refine;
use super::shade::PacketLighting;
use super::shaded_cells::{AlongRay, CellShader, SHADE_NUMBERS, ShadeCells, ShadeQueue, ShadeRound};
use super::simd::{LANES_LIMIT, Places, Simd, for_three};
use super::uneven::{Located, locate};
use super::walk::{CellStep, Packet, PacketBrick, PerLane, ROUND, Walker, places_along};
use crate::engines::cells::bounded::Seen;
use crate::engines::rules::{ORDER_SHARE, POSITION_ERROR, RESERVE_SHARE, VALUE_ERROR};
use crate::stream::counters::RayCounters;

/// Least share of visible lanes, in parts of [`DENSE_OF`], to shade a round's cells in place: packing has a cost, too.
const DENSE: usize = 5;
/// The denominator of [`DENSE`].
const DENSE_OF: usize = 8;

/// The number of each lane.
const LANE_NUMBERS: [i32; LANES_LIMIT] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// The transfer function in the form for packets.
#[derive(Debug, Clone, Copy)]
pub struct PacketTransfer<'a, L> {
    /// Its pieces.
    pub table: &'a L,
    /// See [`TransferPieces::limits`](supervol_scene::transfer_function::pieces::TransferPieces::limits).
    pub limits: Limits,
    /// See [`TransferPieces::clear`](supervol_scene::transfer_function::pieces::TransferPieces::clear).
    pub clear: [f32; 2],
}

/// A task for any number of lanes, and any table of the transfer function's pieces.
pub trait ClassifyTask {
    /// Its result.
    type Output;
    /// See [`Task::run`](super::simd::Task::run).
    fn run<S: Simd, L: PieceLookup>(self, classifier: &PacketTransfer<'_, L>) -> Self::Output;
}

/// Cost and accuracy of integration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Precision {
    /// Error that cells may have per opacity, and reserve of a ray: see [`super::budget`].
    pub by_opacity: f32,
    pub reserve: f32,
    /// Opacity of a cell, times the transmittance in front; cells below it are not shaded if the budget allows it.
    pub least_shaded: f32,
    /// Transmittance at which a ray ends.
    pub last_transmittance: f32,
    /// Whether the errors of cells are summed up along rays: 1 to 2 % of the time.
    pub sums_errors: bool,
}

/// Host: source and destination of rays, with access to them in `f64`.
pub trait Host {
    /// Writes the next ray into a lane; false if there are no more.
    fn lend(&mut self, lane: usize, packet: &mut Packet) -> bool;

    /// Takes a ray back with its gathered light.
    fn take_back(&mut self, lane: usize, packet: &Packet);

    /// Light of a ray in the cell whose first corner lies at `base`, off by no more than `tolerance` if rounding allows that. For
    /// cells that `f32` and a bounded number of refinements do not settle. Counts parts.
    fn integrate_in_f64(&mut self, ray: u16, base: i32, tolerance: f32, parts: &mut u64) -> Seen;
}

/// Data about the rays of a packet for the later stages.
#[derive(Debug, Clone)]
pub struct Lanes {
    /// See [`Packet::rays`].
    pub rays: [u16; LANES_LIMIT],
    /// See [`Packet::direction`].
    pub direction: [PerLane; 3],
    /// 1 if the ray runs exactly in a plane of voxels, else 0.
    pub in_plane: PerLane,
}

impl Lanes {
    /// Directions of the rays of slots.
    #[inline(always)]
    pub fn direction<S: Simd>(&self, slot: S::I) -> [S::F; 3] {
        for_three!(a => S::lookup16(&self.direction[a], slot))
    }

    /// Unit vectors in the world from the rays of slots toward the eye.
    #[inline(always)]
    pub fn toward_eye<S: Simd>(&self, lighting: &PacketLighting<'_>, slot: S::I) -> [S::F; 3] {
        lighting.toward_eye::<S>(self.direction::<S>(slot))
    }
}

/// Queues of cells that wait for the later stages of their round.
#[derive(Debug, Clone)]
pub struct Queues {
    to_shade: ShadeQueue,
    pending: Pending,
}

impl Queues {
    /// Empty queues.
    #[must_use]
    pub fn new() -> Self {
        Self { to_shade: ShadeQueue::new(), pending: Pending::new() }
    }
}

/// Casts the host's rays through a brick, packet by packet.
///
/// # Safety
/// Rays that the host lends keep to the promise of [`Walker::new`]; `brick` walks through the brick whose voxels it holds.
#[inline(always)]
pub unsafe fn cast<S: Simd, L: PieceLookup>(
    brick: &PacketBrick<'_>,
    classifier: &PacketTransfer<'_, L>,
    precision: Precision,
    queues: &mut Queues,
    host: &mut dyn Host,
) -> RayCounters {
    let mut packet = Packet::default();
    let mut work = RayCounters::default();
    let mut stages = Stages::<S>::new();
    loop {
        let lent = (0..S::LANES).take_while(|&lane| host.lend(lane, &mut packet)).count();
        if lent == 0 {
            return work;
        }
        packet.length[lent..].fill(0.0);
        // SAFETY: the caller's promise.
        let done =
            unsafe { cast_packet::<S, L>(brick, classifier, precision, (&mut packet, &mut stages, queues), host) };
        work.add(&done);
        (0..lent).for_each(|lane| host.take_back(lane, &packet));
    }
}

/// Casts one packet.
///
/// # Safety
/// As for [`cast`].
#[inline(always)]
unsafe fn cast_packet<S: Simd, L: PieceLookup>(
    brick: &PacketBrick<'_>,
    classifier: &PacketTransfer<'_, L>,
    precision: Precision,
    (packet, stages, queues): (&mut Packet, &mut Stages<S>, &mut Queues),
    host: &mut dyn Host,
) -> RayCounters {
    let last = S::splat(precision.last_transmittance);
    let front = S::load(&packet.front);
    // SAFETY: the caller's promise.
    let mut walker = unsafe { Walker::<S>::new(packet, &brick.walked) };
    let mut light = Light::<S>::new(front);
    light.sums_errors = precision.sums_errors;
    let round = Round { brick, classifier, precision, lanes: PhantomData };
    let mut budget =
        Budget::<S>::new(S::load(&packet.left), front, [precision.by_opacity, precision.last_transmittance]);
    let lanes = round.lanes(packet, &walker);
    let mut parts = RoundParts::new();
    let mut work = RayCounters::default();
    loop {
        walker.finish(light.ended(last));
        work.macro_cells_skipped += u64::from(walker.leap());
        let is_done = S::bits(walker.active()) == 0;
        if queues.pending.cells.len() > 0 && (is_done || queues.pending.is_enough()) {
            let (lighting, lanes, pending) = (brick.lighting.as_ref(), &lanes, &mut queues.pending);
            work.add(&S::apart(Refine { classifier, lanes, lighting, pending: &mut *pending, host }));
            light.settle(pending, last);
            walker.finish(light.ended(last));
        }
        if S::bits(walker.active()) == 0 {
            break;
        }
        let first = queues.pending.cells.len();
        // SAFETY: the caller's promise.
        unsafe { round.classify(&mut walker, (stages, &mut budget), &mut parts, queues, &mut work) };
        let Queues { to_shade, pending } = queues;
        if let Some(lighting) = &brick.lighting
            && to_shade.len() > 0
        {
            let (cells, unsettled, parts) = (to_shade, &mut pending.cells, &mut parts);
            S::apart(ShadeCells { shader: CellShader { brick, lighting }, lanes: &lanes, cells, unsettled, parts });
        }
        let left = pending.take_over(first, &mut parts);
        if brick.lighting.is_some() {
            stages.refund(&parts, &left, &mut budget);
        }
        light.composite(&parts, &left, pending, last);
    }
    let (color, transmittance) = light.sum();
    for c in 0..3 {
        S::store(color[c], &mut packet.color[c]);
    }
    S::store(transmittance, &mut packet.transmittance);
    S::store(light.error(), &mut packet.error);
    S::store(budget.left + budget.late.sum(), &mut packet.left);
    work
}

/// Results of the stages of a round; kept from packet to packet, since clearing them takes as long as a stage.
pub struct Stages<S: Simd> {
    /// The field in each cell.
    pub chords: [Chord<S>; ROUND],
    located: [Located<S>; ROUND],
    /// Only for shaded cells of byte voxels.
    pub rows: [Option<Rows<S>>; ROUND],
    /// Only for shaded cells: their contribution without light.
    pub parts: [Part<S>; ROUND],
    /// Only for shaded cells: the gradient in them.
    pub along: [AlongRay<S>; ROUND],
    /// Only for shaded cells: error in tolerances per error.
    pub per_error: [S::F; ROUND],
    /// Only for shaded cells: their charges.
    charged: [Charged<S>; ROUND],
}

/// Charge of visible cells, before their light is known.
#[derive(Clone, Copy)]
struct Charged<S: Simd> {
    /// Lanes whose cells count.
    spends: S::M,
    /// Weight of their errors.
    weight: S::F,
    /// Part of the reserve that was taken away.
    charge: S::F,
    allowed: Allowed<S>,
}

impl<S: Simd> Stages<S> {
    #[inline(always)]
    fn new() -> Self {
        Self {
            chords: [Chord::nothing(); ROUND],
            located: [Located::nothing(); ROUND],
            rows: [None; ROUND],
            parts: [Part::nothing(); ROUND],
            along: [AlongRay::nothing(); ROUND],
            per_error: [S::splat(0.0); ROUND],
            charged: [Charged::nothing(); ROUND],
        }
    }

    /// Notes what the settled cells of a shaded round did not need: it is given back some cells later.
    #[inline(always)]
    fn refund(&self, parts: &RoundParts, left: &[u32; ROUND], budget: &mut Budget<S>) {
        let zero = S::splat(0.0);
        for i in 0..ROUND {
            if parts.shows[i] {
                let Charged { spends, weight, charge, allowed } = &self.charged[i];
                // NaN: a hole spends nothing.
                let spent = allowed.of_reserve(S::max(S::load(&parts.numbers[i][ERROR]) * *weight, zero));
                // Refined cells spend all of it.
                let rest = S::select(S::mask_from_bits(left[i]), zero, S::max(*charge - spent, zero));
                budget.late.add(*spends, rest);
            }
        }
    }
}

impl<S: Simd> Charged<S> {
    /// No cells.
    #[inline(always)]
    fn nothing() -> Self {
        let zero = S::splat(0.0);
        Self { spends: S::lt(zero, zero), weight: zero, charge: zero, allowed: Allowed::nothing() }
    }
}

/// Output of the stages after fetching.
struct LaterStages<'a, S: Simd> {
    stages: &'a mut Stages<S>,
    /// Budget of the rays in front of the current cell.
    budget: &'a mut Budget<S>,
    parts: &'a mut RoundParts,
    queues: &'a mut Queues,
    work: &'a mut RayCounters,
}

/// Data that is the same for all cells of a round.
pub struct Round<'a, S: Simd, L: PieceLookup> {
    /// The brick of the cells.
    pub brick: &'a PacketBrick<'a>,
    /// The transfer function.
    pub classifier: &'a PacketTransfer<'a, L>,
    /// The required accuracy.
    pub precision: Precision,
    /// The lanes of its packets.
    pub lanes: PhantomData<S>,
}

impl<S: Simd, L: PieceLookup> Round<'_, S, L> {
    /// Data about the packet's rays for the later stages.
    #[inline(always)]
    fn lanes(&self, packet: &Packet, walker: &Walker<'_, S>) -> Lanes {
        let zero = [0.0; LANES_LIMIT];
        let mut lanes = Lanes { rays: packet.rays, direction: packet.direction, in_plane: zero };
        S::store(S::select(walker.in_plane, S::splat(1.0), S::splat(0.0)), &mut lanes.in_plane);
        lanes
    }

    /// Walks a round, and integrates each cell once; unsettled cells go into the queue.
    ///
    /// # Safety
    /// As for [`cast`].
    #[inline(always)]
    unsafe fn classify(
        &self,
        walker: &mut Walker<'_, S>,
        (stages, budget): (&mut Stages<S>, &mut Budget<S>),
        parts: &mut RoundParts,
        queues: &mut Queues,
        work: &mut RayCounters,
    ) {
        let steps = walker.round();
        parts.shows = [false; ROUND];
        // One stage after the other for all cells: each is short, so that the processor overlaps several cells.
        // SAFETY: the walk stays in cells of the core, whose corners the apron holds.
        unsafe { self.fetch(&steps, &walker.direction, &mut stages.chords, &mut stages.rows) };
        for step in &steps {
            work.cells += u64::from(S::bits(step.crosses()).count_ones());
        }
        let later = LaterStages { stages, budget, parts, queues, work };
        match self.brick.span {
            6 => self.integrate_spans::<6>(&steps, walker.in_plane, later),
            3 => self.integrate_spans::<3>(&steps, walker.in_plane, later),
            _ => match &self.brick.lighting {
                Some(lighting) => self.integrate_lit_cells(lighting, &steps, walker, later),
                None => self.integrate_cells(&steps, walker.in_plane, later),
            },
        }
    }

    /// Integrates each cell once.
    #[inline(always)]
    fn integrate_cells(&self, steps: &[CellStep<S>; ROUND], in_plane: S::M, later: LaterStages<'_, S>) {
        let LaterStages { stages: Stages { chords, located, .. }, budget, parts, queues, work } = later;
        let seen = self.locate_cells(steps, chords, located);
        let mut found = [Passed { transmittance: S::splat(1.0), error: S::splat(0.0) }; ROUND];
        // Apart from what depends on the cells in front, so that the processor overlaps several cells.
        for i in 0..ROUND {
            if S::bits(seen[i]) != 0 {
                let wanted = Wanted { lanes: seen[i], order: self.order(1), lit: false };
                let part = self.integrate_cell(&steps[i], (&chords[i], &located[i]), &wanted, work);
                self.write(i, &chords[i], &part, parts);
                found[i] = part.passed();
            }
        }
        for i in 0..ROUND {
            if S::bits(seen[i]) != 0 {
                let part = found[i];
                let allowed = budget.allowed(part, 1);
                let (spent, most) = (part.error * budget.weight, allowed.sum());
                let is_unsettled = is_unsettled(&steps[i], (&chords[i], in_plane), (spent, most));
                if S::bits(is_unsettled) != 0 {
                    let cell = queued(i, &steps[i], &chords[i], part.error, budget.weight / most);
                    queues.pending.cells.push::<S, 0>(is_unsettled, &cell, []);
                }
                let spent = S::select(S::le(spent, most), spent, S::select(is_unsettled, most, S::splat(0.0)));
                budget.spend(spent, &allowed);
                budget.pass(part);
            }
        }
    }

    /// Error of order of some cells together that is not worth a closer look.
    #[inline(always)]
    fn order(&self, cells: usize) -> S::F {
        S::splat(self.precision.reserve * RESERVE_SHARE * ORDER_SHARE * cells as f32)
    }

    /// Looks up the visible cells of a round in the table; returns their lanes.
    #[inline(always)]
    fn locate_cells(
        &self,
        steps: &[CellStep<S>; ROUND],
        chords: &[Chord<S>; ROUND],
        located: &mut [Located<S>; ROUND],
    ) -> [S::M; ROUND] {
        let mut seen = [S::lt(S::splat(0.0), S::splat(0.0)); ROUND];
        for i in 0..ROUND {
            seen[i] = self.shows(chords[i].range(), steps[i].crosses());
            if S::bits(seen[i]) != 0 {
                located[i] = locate::<S, L>(self.classifier.table, &chords[i].line(), seen[i]);
            }
        }
        seen
    }

    /// Integrates a cell once. Only what is wanted has an error: leaps leave some of the rest out.
    #[inline(always)]
    fn integrate_cell(
        &self,
        step: &CellStep<S>,
        (chord, located): (&Chord<S>, &Located<S>),
        wanted: &Wanted<S>,
        work: &mut RayCounters,
    ) -> Part<S> {
        work.samples += u64::from(2 * S::bits(step.crosses()).count_ones());
        let &PacketTransfer { table, limits, .. } = self.classifier;
        let part = integrate_at::<S, L>(table, limits, (&chord.line(), located), wanted);
        Part { error: S::select(wanted.lanes, part.error, S::splat(0.0)), ..part }
    }

    /// Integrates each cell once, and shades visible cells: in place if most lanes of the round are visible, else
    /// packed densely.
    #[inline(always)]
    fn integrate_lit_cells(
        &self,
        lighting: &PacketLighting<'_>,
        steps: &[CellStep<S>; ROUND],
        walker: &Walker<'_, S>,
        later: LaterStages<'_, S>,
    ) {
        let LaterStages { stages, budget, parts, queues, work } = later;
        let seen = self.locate_cells(steps, &stages.chords, &mut stages.located);
        let mut late = budget.late;
        let mut shows = [S::lt(S::splat(0.0), S::splat(0.0)); ROUND];
        let (mut packets, mut cells) = (0, 0);
        for i in 0..ROUND {
            if S::bits(seen[i]) != 0 {
                let wanted = Wanted { lanes: seen[i], order: self.order(1), lit: true };
                let located = (&stages.chords[i], &stages.located[i]);
                let part = self.integrate_cell(&steps[i], located, &wanted, work);
                self.write(i, &stages.chords[i], &part, parts);
                let opacity = S::splat(1.0) - part.transmittance;
                // Also holes. Cells without any effect do not count: leaps leave some of them out.
                let spends = !S::le(opacity + part.error, S::splat(0.0)) & seen[i];
                budget.left = budget.left + late.take(spends);
                let (weight, allowed) = (budget.weight, budget.allowed(part.passed(), 1));
                let chord = (&stages.chords[i], walker.in_plane);
                let most = allowed.sum();
                let is_unsettled = is_unsettled(&steps[i], chord, (part.error * weight, most));
                // The light of a cell that is not shaded may be anything.
                let unseen = S::min(S::splat(self.precision.least_shaded), most);
                shows[i] = S::lt(unseen, (opacity + part.error) * weight) | is_unsettled;
                // All of it, until the light is known.
                let charge = S::select(spends, allowed.of_reserve(most), S::splat(0.0));
                budget.left = budget.left - charge;
                budget.pass(part.passed());
                stages.charged[i] = Charged { spends, weight, charge, allowed };
                (stages.parts[i], stages.per_error[i]) = (part, weight / most);
                let count = S::bits(shows[i]).count_ones() as usize;
                packets += usize::from(count > 0);
                cells += count;
            }
        }
        if cells * DENSE_OF >= packets * S::LANES * DENSE {
            S::apart(ShadeRound {
                shader: CellShader { brick: self.brick, lighting },
                steps,
                walker,
                shows: &shows,
                stages,
                unsettled: &mut queues.pending.cells,
                parts,
            });
            return;
        }
        for i in 0..ROUND {
            let part = &stages.parts[i];
            if S::bits(shows[i]) != 0 {
                let ([x, y, z], [r, g, b]) = (steps[i].fraction, part.color);
                let [of_opacity, red, green, blue] = part.moments;
                let more = [x, y, z, r, g, b, of_opacity, red, green, blue, part.tau, part.misplaced, part.colors];
                let cell = queued(i, &steps[i], &stages.chords[i], part.error, stages.per_error[i]);
                queues.to_shade.push::<S, SHADE_NUMBERS>(shows[i], &cell, more);
            }
        }
    }

    /// Integrates each `SPAN` cells once; the cells of unsettled spans wait, one by one.
    #[inline(always)]
    fn integrate_spans<const SPAN: usize>(
        &self,
        steps: &[CellStep<S>; ROUND],
        in_plane: S::M,
        later: LaterStages<'_, S>,
    ) {
        let LaterStages { stages: Stages { chords, located, .. }, budget, parts, queues, work } = later;
        let &PacketTransfer { table, limits, .. } = self.classifier;
        let mut shows = [false; ROUND];
        for first in (0..ROUND).step_by(SPAN) {
            let line = Line::over(&chords[first..first + SPAN]);
            let seen = self.shows(line.range(), line.crosses());
            shows[first] = S::bits(seen) != 0;
            if shows[first] {
                located[first] = locate::<S, L>(table, &line, seen);
            }
        }
        for first in (0..ROUND).step_by(SPAN) {
            if shows[first] {
                let line = Line::over(&chords[first..first + SPAN]);
                let crosses = line.crosses();
                work.samples += u64::from(2 * S::bits(crosses).count_ones());
                let wanted = Wanted { lanes: crosses, order: self.order(SPAN), lit: false };
                let part = integrate_at::<S, L>(table, limits, (&line, &located[first]), &wanted);
                let allowed = budget.allowed(part.passed(), SPAN);
                let most = allowed.sum();
                let place = (first, budget.weight / most);
                let settled =
                    self.hand_on_span::<SPAN>(place, (steps, chords), &part, (crosses, in_plane), parts, queues);
                let zero = S::splat(0.0);
                let spent = S::select(settled, part.error * budget.weight, S::select(crosses, most, zero));
                budget.spend(spent, &allowed);
                budget.pass(part.passed());
            }
        }
    }

    /// Rays for which values of this range may be visible. Holes are not clear: values beside them may be visible.
    #[inline(always)]
    pub fn shows(&self, [low, high]: [S::F; 2], crosses: S::M) -> S::M {
        let clear = self.classifier.clear;
        let is_clear = S::lt(S::splat(clear[0]), low) & S::lt(high, S::splat(clear[1]));
        !is_clear & crosses
    }

    /// Fetches the field in each cell of a round.
    ///
    /// # Safety
    /// In every lane, the steps are a walker's through this brick.
    #[inline(always)]
    pub unsafe fn fetch(
        &self,
        steps: &[CellStep<S>; ROUND],
        direction: &[S::F; 3],
        chords: &mut [Chord<S>; ROUND],
        rows: &mut [Option<Rows<S>>; ROUND],
    ) {
        let brick = self.brick;
        let places = brick.places_of(steps);
        // SAFETY: the caller's promise.
        let mut raw = unsafe { self.gather(&places[0], &mut rows[0]) };
        for i in 0..ROUND {
            let cell = brick.voxels.stored().cell::<S>(&raw, brick.absent, brick.centre);
            if i + 1 < ROUND {
                // SAFETY: as above.
                raw = unsafe { self.gather(&places[i + 1], &mut rows[i + 1]) };
            }
            chords[i] = self.chord(&cell, &steps[i], direction);
        }
    }

    /// Gathers the corners of cells, and keeps their rows if shading needs them.
    ///
    /// # Safety
    /// As for [`Round::fetch`].
    #[inline(always)]
    unsafe fn gather(&self, places: &Places, rows: &mut Option<Rows<S>>) -> Raw<S> {
        let voxels = &self.brick.voxels;
        // SAFETY: the caller's promise; the apron is wider than a voxel.
        unsafe {
            match self.brick.lighting {
                Some(_) => voxels.gather_rows::<S>(places, rows),
                None => voxels.gather::<S>(places),
            }
        }
    }

    /// Writes the contribution of a cell.
    #[inline(always)]
    fn write(&self, number: usize, chord: &Chord<S>, part: &Part<S>, parts: &mut RoundParts) {
        let zero = S::splat(0.0);
        let is_hole = S::is_nan(chord.values[1]);
        parts.shows[number] = true;
        for c in 0..3 {
            S::store(S::select(is_hole, zero, part.color[c]), &mut parts.numbers[number][c]);
        }
        S::store(S::select(is_hole, zero, part.tau), &mut parts.numbers[number][DEPTH]);
        S::store(part.least_depth(), &mut parts.least_depths[number]);
        // Nearly invisible cells are not shaded, whatever the light. For all others shading writes the error.
        let unshaded = if self.brick.lighting.is_some() { S::splat(1.0) - part.transmittance } else { zero };
        S::store(S::select(is_hole, zero, part.error + unshaded), &mut parts.numbers[number][ERROR]);
    }

    /// Writes the contribution of a span of cells where one rule settles it; elsewhere queues each of its cells.
    /// Returns the settled lanes.
    #[inline(always)]
    #[allow(clippy::too_many_arguments, reason = "inlined into its one caller: the arguments are its variables")]
    fn hand_on_span<const SPAN: usize>(
        &self,
        (first, per_error): (usize, S::F),
        (steps, chords): (&[CellStep<S>; ROUND], &[Chord<S>; ROUND]),
        part: &Part<S>,
        (crosses, in_plane): (S::M, S::M),
        parts: &mut RoundParts,
        queues: &mut Queues,
    ) -> S::M {
        let zero = S::splat(0.0);
        // False also if the error is NaN: beside a hole.
        let is_settled = S::le(part.error * per_error, S::splat(1.0)) & crosses;
        parts.shows[first] = true;
        for c in 0..3 {
            S::store(S::select(is_settled, part.color[c], zero), &mut parts.numbers[first][c]);
        }
        S::store(S::select(is_settled, part.tau, zero), &mut parts.numbers[first][DEPTH]);
        if self.precision.sums_errors {
            S::store(S::select(is_settled, part.error, zero), &mut parts.numbers[first][ERROR]);
        }
        let is_left = crosses & !is_settled;
        if S::bits(is_left) == 0 {
            return is_settled;
        }
        for number in first..first + SPAN {
            let chord = &chords[number];
            let is_hole = S::is_nan(chord.values[1]) & !in_plane;
            let waits = is_left & steps[number].crosses() & !is_hole;
            parts.least_depths[number] = [0.0; LANES_LIMIT];
            let slot = S::load_int(&LANE_NUMBERS) + S::splat_int(narrow::<i32>(number * LANES_LIMIT));
            // One by one, each cell may be settled by one rule.
            let error = S::select(S::is_nan(chord.values[1]), chord.values[1], S::splat(0.0));
            let per_error = per_error * S::splat(SPAN as f32);
            let cell = QueuedCell { slot, base: steps[number].base, chord: *chord, error, per_error };
            queues.pending.cells.push::<S, 0>(waits, &cell, []);
        }
        is_settled
    }

    /// The field along a ray's chord in a cell.
    #[inline(always)]
    fn chord(&self, cell: &LaneCell<S>, step: &CellStep<S>, direction: &[S::F; 3]) -> Chord<S> {
        let (brick, h) = (self.brick, step.length);
        let (scale, offset) = (S::splat(brick.scale), S::splat(brick.offset));
        let travelled = [h * direction[0], h * direction[1], h * direction[2]];
        let places = places_along::<S>(&step.fraction, &travelled);
        let values = for_three!(i => S::mul_add(cell.at(places[i]), scale, offset));
        let cubic = cell.twist() * scale * (travelled[0] * travelled[1] * travelled[2]);
        let size = S::max(S::abs(values[0]), S::abs(values[2]));
        let of_place = cell.steepness() * S::splat(brick.scale.abs() * POSITION_ERROR);
        let noise = S::mul_add(size, S::splat(VALUE_ERROR), of_place + S::splat(brick.rounding));
        let corners = cell.range().map(|corner| S::mul_add(corner, scale, offset));
        let (low, high) = (S::min(corners[0], corners[1]), S::max(corners[0], corners[1]));
        let margin = S::mul_add(high - low, S::splat(OVERSHOOT), noise);
        Chord { values, cubic, length: h, noise, bounds: [low - margin, high + margin] }
    }
}

/// Lanes whose cell is not settled by one rule: it would spend more than is allowed, or a ray runs in a plane beside a hole.
#[inline(always)]
fn is_unsettled<S: Simd>(
    step: &CellStep<S>,
    (chord, in_plane): (&Chord<S>, S::M),
    (spent, allowed): (S::F, S::F),
) -> S::M {
    S::lt(allowed, spent) | (S::is_nan(chord.values[1]) & in_plane & step.crosses())
}

/// A cell of a round in the form for queues.
#[inline(always)]
pub fn queued<S: Simd>(
    number: usize,
    step: &CellStep<S>,
    chord: &Chord<S>,
    error: S::F,
    per_error: S::F,
) -> QueuedCell<S> {
    let slot = S::load_int(&LANE_NUMBERS) + S::splat_int(narrow::<i32>(number * LANES_LIMIT));
    QueuedCell { slot, base: step.base, chord: *chord, error, per_error }
}
