//! Shading of the visible cells of a round: gradients around them, and light along the rays ([`super::shade`]). If only
//! the light is uncertain, it is computed at more positions ([`super::turning`]).
//!
//! If most lanes of a round are visible, its cells are shaded in place ([`ShadeRound`]). Otherwise the visible ones are
//! packed densely first ([`ShadeCells`]). A cell's colour depends on its own numbers alone in both cases.

use super::fetch::Rows;
use super::integrate::Part;
use super::packet::{Lanes, Stages, queued};
use super::pending::{RefineQueue, RoundParts};
use super::queue::Queue;
use super::shade::{PacketLighting, Shaded, transform};
use super::simd::{LANES_LIMIT, Simd, Task, TaskOf, exp_minus, for_three};
use super::turning::{SettleLight, TurningCells};
use super::walk::{CellStep, PacketBrick, ROUND, Walker, places_along};
use crate::engines::rules::REST_SHARE;

/// A gradient in world space at the beginning, the middle and the end of a part.
pub type Gradients<S> = [[<S as Simd>::F; 3]; 3];

/// The gradient along the rays through some cells.
#[derive(Clone, Copy)]
pub struct AlongRay<S: Simd> {
    pub gradients: Gradients<S>,
    /// Cubic coefficients.
    pub cubics: [S::F; 3],
    /// Lanes beside a hole, which have no gradient.
    is_unknown: S::M,
}

impl<S: Simd> AlongRay<S> {
    /// No gradient.
    #[inline(always)]
    pub fn nothing() -> Self {
        let zero = S::splat(0.0);
        Self { gradients: [[zero; 3]; 3], cubics: [zero; 3], is_unknown: S::lt(zero, zero) }
    }

    /// Numbers that refinement needs.
    #[inline(always)]
    pub fn numbers(&self) -> [S::F; 12] {
        let [[a, b, c], [d, e, f], [g, h, i]] = self.gradients;
        let [j, k, l] = self.cubics;
        [a, b, c, d, e, f, g, h, i, j, k, l]
    }
}

/// Crossings of rays with cells.
#[derive(Clone, Copy)]
pub struct Crossing<S: Simd> {
    /// Voxel offsets of the cells' first corners; in every lane of a cell of the core.
    pub base: S::I,
    /// Entry position in the cell.
    pub fraction: [S::F; 3],
    /// Vector from there to the exit, in cells.
    pub travelled: [S::F; 3],
    /// The cell's four rows, from one voxel before, if they have been gathered.
    pub rows: Option<Rows<S>>,
}

/// Shades cells of a brick.
#[derive(Clone, Copy)]
pub struct CellShader<'a> {
    /// The brick with the voxels.
    pub brick: &'a PacketBrick<'a>,
    /// The brick's lighting.
    pub lighting: &'a PacketLighting<'a>,
}

impl CellShader<'_> {
    /// Gathers the gradients around cells.
    ///
    /// # Safety
    /// In every lane, the cell is one of the brick's.
    #[inline(always)]
    pub unsafe fn gradients<S: Simd>(&self, cell: &Crossing<S>, along: &mut AlongRay<S>) {
        let (brick, lighting) = (self.brick, self.lighting);
        let around = brick.voxels.around::<S>(cell.base, brick.absent);
        // SAFETY: the caller's promise.
        let slopes = unsafe { around.slopes(cell.rows.as_ref()) };
        let places = places_along::<S>(&cell.fraction, &cell.travelled);
        for (gradient, at) in along.gradients.iter_mut().zip(places) {
            let differences = for_three!(a => slopes[a].at(at));
            *gradient = transform::<S>(&lighting.world_from_differences, differences);
        }
        let volume = cell.travelled[0] * cell.travelled[1] * cell.travelled[2];
        let twists = for_three!(a => slopes[a].twist() * volume);
        along.cubics = transform::<S>(&lighting.world_from_differences, twists);
        let middle = along.gradients[1];
        along.is_unknown = S::is_nan(middle[0] + middle[1] + middle[2]);
        for gradient in along.gradients.iter_mut().chain([&mut along.cubics]) {
            for component in gradient {
                *component = S::select(along.is_unknown, S::splat(0.0), *component);
            }
        }
    }

    /// Colours of parts after shading, and their errors. The error is NaN beside a hole for rays in a plane of voxels.
    /// There the hole may have no weight, so that a gradient exists after all.
    #[inline(always)]
    pub fn shade<S: Simd>(
        &self,
        part: &Part<S>,
        along: &AlongRay<S>,
        to_eye: &[S::F; 3],
        (shows, in_plane): (S::M, S::M),
        per_error: S::F,
    ) -> ([S::F; 3], S::F) {
        let one = S::splat(1.0);
        let lit = self.lighting.at::<S, 3>(&along.gradients, to_eye);
        let Shaded { mut color, mut error, of_part, .. } = self.lighting.shade::<S>(part, &lit, &along.cubics);
        // If the other errors leave room, only the light is improved.
        let is_unsettled = S::lt(one, error * per_error) & S::lt(of_part * per_error, S::splat(REST_SHARE)) & shows;
        if S::bits(is_unsettled) != 0 {
            let mut cells = TurningCells::new::<S>(part, along, to_eye, of_part);
            S::apart(SettleLight { lighting: self.lighting, cells: &mut cells, lanes: S::bits(is_unsettled) });
            let (lit, settled) = cells.outcome::<S>();
            color = for_three!(c => S::select(is_unsettled, lit[c], color[c]));
            error = S::select(is_unsettled, settled, error);
        }
        (color, S::select(along.is_unknown & in_plane, S::splat(f32::NAN), error))
    }
}

/// Shades the visible cells of a round, each in its lane.
pub struct ShadeRound<'a, S: Simd> {
    /// Shader of the brick's cells.
    pub shader: CellShader<'a>,
    /// The round.
    pub steps: &'a [CellStep<S>; ROUND],
    /// Its rays.
    pub walker: &'a Walker<'a, S>,
    /// Visible lanes, step by step.
    pub shows: &'a [S::M; ROUND],
    /// Results of the earlier stages.
    pub stages: &'a mut Stages<S>,
    /// Cells that one rule does not settle.
    pub unsettled: &'a mut RefineQueue,
    /// Output: colours.
    pub parts: &'a mut RoundParts,
}

impl<S: Simd> TaskOf<S> for ShadeRound<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run_lanes(self) {
        let Self { shader, steps, walker, shows, stages, unsettled, parts } = self;
        let nowhere = S::splat_int(shader.brick.first_base());
        for (i, step) in steps.iter().enumerate() {
            if S::bits(shows[i]) != 0 {
                let base = S::select_int(step.crosses(), step.base, nowhere);
                let travelled = for_three!(a => walker.direction[a] * step.length);
                let cell = Crossing { base, fraction: step.fraction, travelled, rows: stages.rows[i] };
                // SAFETY: steps of a walker lie in its brick; other lanes look at its first cell.
                unsafe { shader.gradients(&cell, &mut stages.along[i]) };
            }
        }
        let to_eye = shader.lighting.toward_eye::<S>(walker.direction);
        for (i, step) in steps.iter().enumerate() {
            if S::bits(shows[i]) == 0 {
                continue;
            }
            let (part, along, per_error) = (&stages.parts[i], &stages.along[i], stages.per_error[i]);
            let (color, error) = shader.shade(part, along, &to_eye, (shows[i], walker.in_plane), per_error);
            parts.write_shaded::<S>(i, shows[i], color, error);
            // Also NaN.
            let is_unsettled = !S::le(error * per_error, S::splat(1.0)) & shows[i];
            if S::bits(is_unsettled) != 0 {
                let cell = queued(i, step, &stages.chords[i], error, per_error);
                unsettled.push::<S, 12>(is_unsettled, &cell, along.numbers());
            }
        }
    }
}

/// Packets of cells that pass a stage together: stages are short, so that the processor overlaps several packets.
const GROUP: usize = ROUND;

/// Additional numbers of a cell: position of its beginning; and of its part the colour, its moments, the optical depth, how far it
/// is misplaced, and how colour varies.
pub type ShadeQueue = Queue<{ (ROUND + 1) * LANES_LIMIT }, SHADE_NUMBERS>;
/// Their number.
pub const SHADE_NUMBERS: usize = 13;

/// Shades the visible cells of a round.
pub struct ShadeCells<'a> {
    /// Shader of the brick's cells.
    pub shader: CellShader<'a>,
    /// Rays of the packet.
    pub lanes: &'a Lanes,
    /// The cells; none are left afterwards.
    pub cells: &'a mut ShadeQueue,
    /// Cells that one rule does not settle.
    pub unsettled: &'a mut RefineQueue,
    /// Output: colours.
    pub parts: &'a mut RoundParts,
}

impl Task for ShadeCells<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self) {
        for group in (0..self.cells.len()).step_by(GROUP * S::LANES) {
            let mut along = [AlongRay::<S>::nothing(); GROUP];
            let end = self.cells.len().min(group + GROUP * S::LANES);
            for (i, first) in (group..end).step_by(S::LANES).enumerate() {
                self.gradients::<S>(first, &mut along[i]);
            }
            for (i, first) in (group..end).step_by(S::LANES).enumerate() {
                self.shade::<S>(first, &along[i]);
            }
        }
        self.cells.clear();
    }
}

impl ShadeCells<'_> {
    /// Gathers the gradients around the cells from number `first` on.
    #[inline(always)]
    fn gradients<S: Simd>(&self, first: usize, along: &mut AlongRay<S>) {
        let cell = self.cells.cells::<S>(first);
        // Lanes behind the last cell may hold an offset of another brick's cell.
        let nowhere = S::splat_int(self.shader.brick.first_base());
        let base = S::select_int(self.cells.used::<S>(first), cell.base, nowhere);
        let direction = self.lanes.direction::<S>(cell.slot);
        let travelled = for_three!(a => direction[a] * cell.chord.length);
        let cell = Crossing { base, fraction: self.cells.three::<S>(0, first), travelled, rows: None };
        // SAFETY: cells are queued from steps through this brick; other lanes look at its first cell.
        unsafe { self.shader.gradients(&cell, along) };
    }

    /// Shades the cells from number `first` on; cells that three positions do not settle are refined.
    #[inline(always)]
    fn shade<S: Simd>(&mut self, first: usize, along: &AlongRay<S>) {
        let mut cell = self.cells.cells::<S>(first);
        let [tau, misplaced, colors] = self.cells.three::<S>(10, first);
        let [red, green, blue] = self.cells.three::<S>(7, first);
        let part = Part {
            color: self.cells.three::<S>(3, first),
            tau,
            transmittance: exp_minus::<S>(tau),
            error: cell.error,
            rounding: S::splat(0.0),
            moments: [self.cells.one::<S>(6, first), red, green, blue],
            misplaced,
            colors,
        };
        let to_eye = self.lanes.toward_eye::<S>(self.shader.lighting, cell.slot);
        let in_plane = S::lt(S::splat(0.0), S::lookup16(&self.lanes.in_plane, cell.slot));
        let per_error = cell.per_error;
        let used = self.cells.used::<S>(first);
        let ([r, g, b], error) = self.shader.shade(&part, along, &to_eye, (used, in_plane), per_error);
        cell.error = error;
        let count = (self.cells.len() - first).min(S::LANES);
        self.parts.write_colors::<S>(cell.slot, count, [r, g, b, cell.error]);
        // Also NaN.
        let is_unsettled = !S::le(cell.error * per_error, S::splat(1.0)) & used;
        if S::bits(is_unsettled) != 0 {
            self.unsettled.push::<S, 12>(is_unsettled, &cell, along.numbers());
        }
    }
}
