//! A packet of rays through one brick, in mode `iso`: finds the cells that may hold a crossing.
//!
//! A ray between surfaces keeps two numbers: the greatest iso value that is not above it, and the least that is. While
//! all corners of its cells lie in between, there is no crossing, whatever the number of surfaces. Other cells are
//! examined by the range of the cubic along the chord, widened by the error of `f32`. The remaining cells are settled
//! by the scalar caster in `f64`, in order along the ray: crossings, side, light. So no picture depends on `f32`.
//!
//! The side of a ray is carried from cell to cell (see `cells::modes::gather_iso`), and is unknown behind holes. A
//! cube that is leapt over lies between the same two iso values everywhere, or is empty everywhere (see
//! [`super::leap::ProximityCloud::of_sides`]). So the macro cell at the start of a leap gives the side on which the ray
//! comes out. Rays that are on another side, after a jump between levels, do not leap but walk and settle.

use supervol_format::brick::MACRO_CELL;

use super::fetch::{Corners, Stored};
use super::leap::{MacroRanges, ProximityCloud};
use super::simd::{LANES_LIMIT, Simd, lanes};
use super::summaries::Numbers;
use super::values::{Gather, ValueChord, ValuePacket, ValueRays, greatest, holes, least};
use super::walk::CellStep;
use crate::engines::rules::{POSITION_ERROR, VALUE_ERROR};

/// The numbers between which each ray meets no surface: numbers 0 and 1 of a ray, see [`super::values::ValueHost::bounds`].
pub struct Surfaces<'a, S: Simd> {
    low: S::F,
    high: S::F,
    /// Whether the sign of numbers is changed, so that greater numbers are greater values.
    is_turned: bool,
    /// Whether corners may be holes.
    may_have_holes: bool,
    /// Added to the size of numbers to account for rounding in the scalar caster.
    offset_size: f32,
    /// Data for leaping; `None`: every cell is walked.
    quiet: Option<(&'a ProximityCloud<MACRO_CELL>, &'a MacroRanges)>,
}

impl<'a, S: Simd> Surfaces<'a, S> {
    /// See the fields.
    #[inline(always)]
    pub(super) fn new(numbers: &Numbers, quiet: Option<(&'a ProximityCloud<MACRO_CELL>, &'a MacroRanges)>) -> Self {
        let &Numbers { stored, map, centre, is_turned } = numbers;
        let zero = S::splat(0.0);
        let may_have_holes = stored == Stored::F32 || map.absent.is_some();
        let offset_size = if stored == Stored::F32 { 0.0 } else { centre.abs() + (map.offset / map.scale).abs() };
        Self { low: zero, high: zero, is_turned, may_have_holes, offset_size, quiet }
    }

    /// Rays that can meet no more surfaces.
    #[inline(always)]
    fn done(&self) -> S::M {
        S::le(self.low, S::splat(f32::NEG_INFINITY)) & S::le(S::splat(f32::INFINITY), self.high)
    }

    /// Rays whose side is unknown.
    #[inline(always)]
    fn unknown(&self) -> S::M {
        S::lt(self.high, self.low)
    }

    /// Whether values of a range meet no surface.
    #[inline(always)]
    fn is_quiet(&self, low: S::F, high: S::F) -> S::M {
        S::le(self.low, low) & S::lt(high, self.high)
    }

    /// Handles cells in which some rays meet a surface or learn their side. Rays of `passes` pass a range if they can.
    #[inline(always)]
    fn meet(&mut self, rays: &mut ValueRays<'_, S>, asks: S::M, passes: S::M, [low, high]: [S::F; 2], base: S::I) {
        let mut range = [[0.0; LANES_LIMIT]; 2];
        S::store(low, &mut range[0]);
        S::store(high, &mut range[1]);
        let mut settles = S::bits(asks & !passes);
        for lane in lanes(S::bits(asks & passes)) {
            let has_passed = rays.host.pass(rays.numbers[lane], [range[0][lane], range[1][lane]]);
            settles |= u32::from(!has_passed) << lane;
        }
        rays.settle(settles, base);
        let mut bounds = [[0.0; LANES_LIMIT]; 2];
        S::store(self.low, &mut bounds[0]);
        S::store(self.high, &mut bounds[1]);
        for lane in lanes(S::bits(asks)) {
            [bounds[0][lane], bounds[1][lane]] = rays.host.bounds(rays.numbers[lane]);
        }
        [self.low, self.high] = [S::load(&bounds[0]), S::load(&bounds[1])];
    }
}

impl<S: Simd> Gather<S> for Surfaces<'_, S> {
    #[inline(always)]
    fn begin(&mut self, packet: &ValuePacket) {
        [self.low, self.high] = [S::load(&packet.numbers[0]), S::load(&packet.numbers[1])];
    }

    #[inline(always)]
    fn leap(&mut self, rays: &mut ValueRays<'_, S>) {
        rays.walker.finish(self.done());
        let Some((cloud, ranges)) = self.quiet else { return };
        loop {
            let active = rays.walker.active();
            let macro_cell = rays.walker.cube::<MACRO_CELL>();
            // SAFETY: cloud and ranges are the brick's, and active rays lie in its core.
            let (distance, [low, high]) =
                unsafe { (cloud.gather::<S>(macro_cell, active), ranges.gather::<S>(macro_cell, active)) };
            let is_empty = S::lt(high, low);
            let unknown = self.unknown();
            // Surfaces already met keep a macro cell in the cloud, but the ray may leave it.
            let meets_nothing = is_empty | self.is_quiet(low, high) | (unknown & S::lt_int(S::splat_int(0), distance));
            let leaping = active & meets_nothing;
            if S::bits(leaping) == 0 {
                return;
            }
            rays.work.macro_cells_skipped += u64::from(S::bits(leaping).count_ones());
            let reach = S::max(S::to_float(distance), S::splat(1.0));
            rays.walker.leave::<MACRO_CELL>(macro_cell, reach, leaping);
            let changes = leaping & ((unknown & !is_empty) | (is_empty & !unknown));
            if S::bits(changes) != 0 {
                self.meet(rays, changes, changes, [low, high], S::splat_int(0));
            }
        }
    }

    #[inline(always)]
    fn gather(&mut self, rays: &mut ValueRays<'_, S>, corners: &Corners<S>, step: &CellStep<S>, crosses: S::M) {
        let (least, greatest) = (least::<S>(corners), greatest::<S>(corners));
        let zero = S::splat(0.0);
        let [low, high] = if self.is_turned { [zero - greatest, zero - least] } else { [least, greatest] };
        let mut asks = crosses & !self.is_quiet(low, high);
        let none = S::lt(zero, zero);
        let (mut is_hole, mut beside_holes) = (none, none);
        if self.may_have_holes {
            is_hole = holes::<S>(corners);
            beside_holes = is_hole & rays.walker.in_plane;
            asks = crosses & ((asks & !is_hole) | (is_hole & !self.unknown()) | beside_holes);
        }
        if S::bits(asks) == 0 {
            return;
        }
        let chord = ValueChord::<S>::new(corners, step, &rays.walker.direction);
        let [least, greatest] = chord.range();
        let [chord_low, chord_high] = if self.is_turned { [zero - greatest, zero - least] } else { [least, greatest] };
        let size = S::max(S::abs(low), S::abs(high)) + S::splat(self.offset_size);
        // Positions are rounded, and moved onto faces that they may lie on.
        let of_place = chord.steepness() * S::splat(2.0 * POSITION_ERROR);
        let noise = S::mul_add(size, S::splat(VALUE_ERROR), of_place);
        asks = asks & !self.is_quiet(chord_low - noise, chord_high + noise) & !self.done();
        if S::bits(asks) != 0 {
            let passes = (is_hole | self.unknown()) & !beside_holes;
            let infinity = S::splat(f32::INFINITY);
            let range = [S::select(is_hole, infinity, low), S::select(is_hole, zero - infinity, high)];
            self.meet(rays, asks, passes, range, step.base);
        }
    }

    #[inline(always)]
    fn end(&self, _packet: &mut ValuePacket) {}
}
