//! A packet of rays through one brick, in the modes that gather values: greatest, least, mean.
//!
//! Space, crossings and rounds are those of [`super::packet`]. Numbers are stored numbers minus the brick's centre, so
//! that they are exact at voxels. Each cell is first tested for an effect:
//! - `mip`, `minip`: only a cell with a corner that exceeds the ray's extreme has one; macro cells without are leapt
//!   over. The extreme of the cubic lies at an end of the chord or at a critical point. For the least value all numbers
//!   change sign;
//! - `mean`: two values at Gauss's points, which give the integral of a cubic exactly.
//!
//! The same cells change a ray whether it leaps or walks: no bit depends on skipping. Cells with holes change nothing.
//! A [`ValueHost`] settles in `f64` what `f32` cannot decide: holes beside a ray that runs exactly in a plane of voxels.

use supervol_format::brick::MACRO_CELL;

use super::fetch::{Corners, LaneCell};
use super::leap::{MacroRanges, ProximityCloud};
use super::simd::{LANES_LIMIT, Simd, lanes};
use super::summaries::Numbers;
use super::walk::{CellStep, Packet, PacketBrick, PerLane, ROUND, Walker};
use crate::engines::rules::POSITION_ERROR;
use crate::stream::counters::RayCounters;

/// Numbers that a ray carries through a brick.
const NUMBERS: usize = 3;
/// Gauss's two points on [0, 1]: 1/2 - 1/sqrt(12), and 1 minus that.
const GAUSS_POINTS: [f32; 2] = [0.211_324_87, 0.788_675_1];

/// Rays at their entry into a brick, and their gathered numbers.
#[derive(Debug, Clone)]
pub struct ValuePacket {
    /// Their path; colours and transmittances are not used.
    pub way: Packet,
    /// Their numbers: see [`Extreme`], [`Mean`] and [`super::surfaces::Surfaces`].
    pub numbers: [PerLane; NUMBERS],
}

impl Default for ValuePacket {
    fn default() -> Self {
        Self { way: Packet::default(), numbers: [[0.0; LANES_LIMIT]; NUMBERS] }
    }
}

/// Host: source and destination of rays, with access to them in `f64`.
pub trait ValueHost {
    /// Writes the next ray into a lane; false if there are no more.
    fn lend(&mut self, lane: usize, packet: &mut ValuePacket) -> bool;

    /// Takes a ray back with its gathered numbers.
    fn take_back(&mut self, lane: usize, packet: &ValuePacket);

    /// Gathers in `f64` over the cell whose first corner lies at `base`, and stores the result in the ray.
    fn settle(&mut self, ray: u16, base: i32);

    /// Mode `iso`: notes that a ray passes values of this range, or none if it is empty. Returns false, and notes
    /// nothing, if the range holds a surface that has not been met yet.
    fn pass(&mut self, ray: u16, range: [f32; 2]) -> bool;

    /// Mode `iso`: the numbers between which a ray meets no surface: from the first, up to but not including the
    /// second. The first is greater if the side is unknown; both are infinite if nothing is left to meet.
    fn bounds(&self, ray: u16) -> [f32; 2];
}

/// Rays in a brick, with their host.
pub struct ValueRays<'a, S: Simd> {
    /// The brick.
    pub brick: &'a PacketBrick<'a>,
    /// Their positions.
    pub walker: Walker<'a, S>,
    /// Their numbers in the tile.
    pub numbers: [u16; LANES_LIMIT],
    /// Their host.
    pub host: &'a mut dyn ValueHost,
    /// Counters.
    pub work: RayCounters,
}

impl<S: Simd> ValueRays<'_, S> {
    /// Settles a cell in `f64` for the rays of the mask.
    #[inline(always)]
    pub fn settle(&mut self, mask: u32, base: S::I) {
        let mut bases = [0; LANES_LIMIT];
        S::store_int(base, &mut bases);
        self.work.cells_exact += u64::from(mask.count_ones());
        for lane in lanes(mask) {
            self.host.settle(self.numbers[lane], bases[lane]);
        }
    }

    /// Rays that run in a plane of voxels, with a hole in the cell, which may have no weight for them.
    #[inline(always)]
    pub fn beside_holes(&self, corners: &Corners<S>) -> S::M {
        if S::bits(self.walker.in_plane) == 0 {
            self.walker.in_plane
        } else {
            holes::<S>(corners) & self.walker.in_plane
        }
    }
}

/// Cells with a hole at a corner.
#[inline(always)]
pub fn holes<S: Simd>([first, second]: &Corners<S>) -> S::M {
    // Finite numbers may add up to infinity, never to NaN.
    let row = |r: usize| S::is_nan(first[r] + second[r]);
    (row(0) | row(1)) | (row(2) | row(3))
}

/// The greatest corner; arbitrary if one is a hole.
#[inline(always)]
pub fn greatest<S: Simd>([first, second]: &Corners<S>) -> S::F {
    let row = |r: usize| S::max(first[r], second[r]);
    S::max(S::max(row(0), row(1)), S::max(row(2), row(3)))
}

/// The least corner; arbitrary if one is a hole.
#[inline(always)]
pub fn least<S: Simd>([first, second]: &Corners<S>) -> S::F {
    let row = |r: usize| S::min(first[r], second[r]);
    S::min(S::min(row(0), row(1)), S::min(row(2), row(3)))
}

/// Operation of packets on cells, one after the other along each ray.
pub trait Gather<S: Simd> {
    /// Takes over the numbers of a packet's rays.
    fn begin(&mut self, packet: &ValuePacket);

    /// Leaps rays over cells that change nothing, and ends finished rays.
    fn leap(&mut self, rays: &mut ValueRays<'_, S>);

    /// Gathers over the next cell of each ray; rays not in `crosses` have none.
    fn gather(&mut self, rays: &mut ValueRays<'_, S>, corners: &Corners<S>, step: &CellStep<S>, crosses: S::M);

    /// Stores the numbers of the rays in the packet.
    fn end(&self, packet: &mut ValuePacket);
}

/// Casts the host's rays through a brick, packet by packet.
///
/// # Safety
/// As for [`super::packet::cast`]; macro ranges and clouds that `gather` leaps by are the brick's.
#[inline(always)]
pub unsafe fn cast<S: Simd, G: Gather<S>>(
    brick: &PacketBrick<'_>,
    gather: &mut G,
    host: &mut dyn ValueHost,
) -> RayCounters {
    let mut packet = ValuePacket::default();
    let mut work = RayCounters::default();
    loop {
        let lent = (0..S::LANES).take_while(|&lane| host.lend(lane, &mut packet)).count();
        if lent == 0 {
            return work;
        }
        packet.way.length[lent..].fill(0.0);
        gather.begin(&packet);
        // SAFETY: the caller's promise.
        let walker = unsafe { Walker::<S>::new(&packet.way, &brick.walked) };
        let mut rays = ValueRays { brick, walker, numbers: packet.way.rays, host: &mut *host, work };
        // SAFETY: the caller's promise.
        unsafe { cast_packet::<S, G>(&mut rays, gather) };
        work = rays.work;
        gather.end(&mut packet);
        (0..lent).for_each(|lane| host.take_back(lane, &packet));
    }
}

/// Casts one packet.
///
/// # Safety
/// As for [`cast`].
#[inline(always)]
unsafe fn cast_packet<S: Simd, G: Gather<S>>(rays: &mut ValueRays<'_, S>, gather: &mut G) {
    let (brick, zero) = (rays.brick, S::splat(0.0));
    loop {
        gather.leap(rays);
        if S::bits(rays.walker.active()) == 0 {
            return;
        }
        let steps = rays.walker.round();
        let places = brick.places_of(&steps);
        // SAFETY: the walk stays in cells of the core, whose corners the apron holds.
        let mut raw = unsafe { brick.voxels.gather::<S>(&places[0]) };
        for i in 0..ROUND {
            let corners = brick.voxels.stored().corners::<S>(&raw, brick.absent, brick.centre);
            if i + 1 < ROUND {
                // SAFETY: as above.
                raw = unsafe { brick.voxels.gather::<S>(&places[i + 1]) };
            }
            let crosses = S::lt(zero, steps[i].length);
            rays.work.cells += u64::from(S::bits(crosses).count_ones());
            gather.gather(rays, &corners, &steps[i], crosses);
        }
    }
}

/// The field along rays' chords in a cell.
pub struct ValueChord<S: Simd> {
    cell: LaneCell<S>,
    /// Entry position.
    entry: [S::F; 3],
    /// Vector from there to the exit, in cells.
    travelled: [S::F; 3],
    ends: [S::F; 2],
}

impl<S: Simd> ValueChord<S> {
    /// The chords of a step.
    #[inline(always)]
    pub fn new(corners: &Corners<S>, step: &CellStep<S>, direction: &[S::F; 3]) -> Self {
        let (mut entry, mut exit, mut travelled) = (step.fraction, step.fraction, step.fraction);
        for a in 0..3 {
            travelled[a] = step.length * direction[a];
            exit[a] = snapped::<S>(entry[a] + travelled[a]);
            entry[a] = snapped::<S>(entry[a]);
        }
        let ends = [at_exactly::<S>(corners, entry), at_exactly::<S>(corners, exit)];
        Self { cell: LaneCell::new(corners), entry: step.fraction, travelled, ends }
    }

    /// The value at u in [0, 1].
    #[inline(always)]
    fn at(&self, u: S::F) -> S::F {
        let mut position = self.entry;
        for a in 0..3 {
            position[a] = S::mul_add(self.travelled[a], u, position[a]);
        }
        self.cell.at(position)
    }

    /// Least and greatest value on the chord; NaN if a corner is a hole.
    ///
    /// The cubic c0 + c1 u + c2 u^2 + c3 u^3 is known from its values at 0, 1/2 and 1 and from c3. Its critical points
    /// are the roots of its derivative. The values there are interpolated from the corners: rounding of the
    /// coefficients then only moves the position, where the field is flat.
    #[inline(always)]
    pub fn range(&self) -> [S::F; 2] {
        let (zero, one, half) = (S::splat(0.0), S::splat(1.0), S::splat(0.5));
        let [begin, end] = self.ends;
        let [x, y, z] = self.travelled;
        let c3 = self.cell.twist() * (x * y * z);
        let whole = end - begin - c3;
        let part = S::mul_add(c3, S::splat(-0.125), self.at(half) - begin);
        let c1 = S::mul_add(part, S::splat(4.0), zero - whole);
        let c2 = whole - c1;
        let a = c3 * S::splat(3.0);
        let discriminant = S::mul_add(c2, c2, zero - a * c1);
        // This form of the two roots never subtracts equal numbers. No root gives NaN, which lies in no interval.
        let root = S::sqrt(discriminant);
        let q = zero - S::select(S::lt(c2, zero), c2 - root, c2 + root);
        let mut range = [S::min(begin, end), S::max(begin, end)];
        for u in [q / a, c1 / q] {
            let inside = S::lt(zero, u) & S::lt(u, one);
            if S::bits(inside) != 0 {
                let value = self.at(S::select(inside, u, zero));
                range[0] = S::select(inside, S::min(value, range[0]), range[0]);
                range[1] = S::select(inside, S::max(value, range[1]), range[1]);
            }
        }
        range
    }

    /// Bound on the change of the value per cell.
    #[inline(always)]
    pub fn steepness(&self) -> S::F {
        self.cell.steepness()
    }
}

/// A position in a cell, snapped onto a face within rounding: rounding must not move rays off voxels, where a transfer
/// function may step.
#[inline(always)]
fn snapped<S: Simd>(position: S::F) -> S::F {
    let low = S::select(S::lt(position, S::splat(POSITION_ERROR)), S::splat(0.0), position);
    S::select(S::lt(S::splat(1.0 - POSITION_ERROR), low), S::splat(1.0), low)
}

/// The value at fractions of a cell, exact at its corners.
#[inline(always)]
fn at_exactly<S: Simd>([first, second]: &Corners<S>, position: [S::F; 3]) -> S::F {
    let mix = |axis: usize, from: S::F, to: S::F| {
        let is_near = S::lt(position[axis], S::splat(0.5));
        let way = S::select(is_near, position[axis], position[axis] - S::splat(1.0));
        S::mul_add(way, to - from, S::select(is_near, from, to))
    };
    let row = |r: usize| mix(0, first[r], second[r]);
    mix(2, mix(1, row(0), row(1)), mix(1, row(2), row(3)))
}

/// The greatest value, or the least one, for which all numbers change sign.
///
/// Number 0 of a ray is the greatest so far; minus infinity at first.
pub struct Extreme<'a, S: Simd> {
    best: S::F,
    /// Whether numbers change sign.
    is_turned: bool,
    /// Ranges for leaping, in numbers with changed sign; `None`: every cell is walked.
    ranges: Option<&'a MacroRanges>,
}

impl<'a, S: Simd> Extreme<'a, S> {
    /// See the fields.
    #[inline(always)]
    pub(super) fn new(numbers: &Numbers, ranges: Option<&'a MacroRanges>) -> Self {
        Self { best: S::splat(f32::NEG_INFINITY), is_turned: numbers.is_turned, ranges }
    }
}

impl<S: Simd> Gather<S> for Extreme<'_, S> {
    #[inline(always)]
    fn begin(&mut self, packet: &ValuePacket) {
        self.best = S::load(&packet.numbers[0]);
    }

    /// Leaps over macro cells that cannot exceed the ray's extreme, one at a time.
    #[inline(always)]
    fn leap(&mut self, rays: &mut ValueRays<'_, S>) {
        let Some(ranges) = self.ranges else { return };
        loop {
            let active = rays.walker.active();
            let macro_cell = rays.walker.cube::<MACRO_CELL>();
            // SAFETY: the ranges are the brick's, and active rays lie in its core.
            let [_, high] = unsafe { ranges.gather::<S>(macro_cell, active) };
            let leaping = S::le(high, self.best) & active;
            if S::bits(leaping) == 0 {
                return;
            }
            rays.work.macro_cells_skipped += u64::from(S::bits(leaping).count_ones());
            rays.walker.leave::<MACRO_CELL>(macro_cell, S::splat(1.0), leaping);
        }
    }

    #[inline(always)]
    fn gather(&mut self, rays: &mut ValueRays<'_, S>, corners: &Corners<S>, step: &CellStep<S>, crosses: S::M) {
        let top = if self.is_turned { S::splat(0.0) - least::<S>(corners) } else { greatest::<S>(corners) };
        let surely = step.crosses_surely(&rays.walker.direction);
        let unsure = S::bits((rays.beside_holes(corners) | (S::lt(self.best, top) & !surely)) & crosses);
        if unsure != 0 {
            rays.settle(unsure, step.base);
        }
        let may_better = S::lt(self.best, top) & surely;
        if S::bits(may_better) == 0 {
            return;
        }
        let [low, high] = ValueChord::<S>::new(corners, step, &rays.walker.direction).range();
        let found = if self.is_turned { S::splat(0.0) - low } else { high };
        // Never beyond the corners: rounding must not leave their range.
        let found = S::min(found, top);
        let is_better = S::lt(self.best, found) & may_better & !S::is_nan(low);
        self.best = S::select(is_better, found, self.best);
    }

    #[inline(always)]
    fn end(&self, packet: &mut ValuePacket) {
        S::store(self.best, &mut packet.numbers[0]);
    }
}

/// The integral of the values, and the present length of each ray.
///
/// Numbers of a ray: the integral in this brick, and the world lengths of present and absent parts.
pub struct Mean<'a, S: Simd> {
    integral: S::F,
    present: S::F,
    absent: S::F,
    /// Factor of integrals, so that the largest numbers do not overflow.
    scale: f32,
    /// Cloud of macro cells that hold nothing.
    cloud: Option<&'a ProximityCloud<MACRO_CELL>>,
}

impl<'a, S: Simd> Mean<'a, S> {
    /// See the fields.
    #[inline(always)]
    pub fn new(scale: f32, cloud: Option<&'a ProximityCloud<MACRO_CELL>>) -> Self {
        let zero = S::splat(0.0);
        Self { integral: zero, present: zero, absent: zero, scale, cloud }
    }
}

impl<S: Simd> Gather<S> for Mean<'_, S> {
    #[inline(always)]
    fn begin(&mut self, _packet: &ValuePacket) {
        let zero = S::splat(0.0);
        (self.integral, self.present, self.absent) = (zero, zero, zero);
    }

    #[inline(always)]
    fn leap(&mut self, rays: &mut ValueRays<'_, S>) {
        if let Some(cloud) = self.cloud {
            // SAFETY: the cloud is the brick's.
            let leaps = unsafe { rays.walker.leap_by(cloud) };
            let before = rays.walker.t;
            rays.work.macro_cells_skipped += u64::from(leaps);
            self.absent = self.absent + (rays.walker.t - before);
        }
    }

    #[inline(always)]
    fn gather(&mut self, rays: &mut ValueRays<'_, S>, corners: &Corners<S>, step: &CellStep<S>, crosses: S::M) {
        let zero = S::splat(0.0);
        let surely = step.crosses_surely(&rays.walker.direction);
        let unsure = S::bits((rays.beside_holes(corners) | !surely) & crosses);
        if unsure != 0 {
            rays.settle(unsure, step.base);
        }
        let cell = LaneCell::<S>::new(corners);
        let weight = step.length * S::splat(0.5 * self.scale);
        let (mut integral, mut is_hole) = (self.integral, S::lt(zero, zero));
        for u in GAUSS_POINTS {
            let mut position = step.fraction;
            for a in 0..3 {
                let travelled = step.length * rays.walker.direction[a];
                position[a] = S::mul_add(travelled, S::splat(u), position[a]);
            }
            let value = cell.at(position);
            is_hole = S::is_nan(value);
            integral = S::mul_add(value, weight, integral);
        }
        is_hole = is_hole | !surely;
        self.integral = S::select(is_hole, self.integral, integral);
        self.present = self.present + S::select(is_hole, zero, step.length);
        self.absent = self.absent + S::select(is_hole, step.length, zero);
    }

    #[inline(always)]
    fn end(&self, packet: &mut ValuePacket) {
        for (number, lanes) in [self.integral, self.present, self.absent].into_iter().zip(&mut packet.numbers) {
            S::store(number, lanes);
        }
    }
}
