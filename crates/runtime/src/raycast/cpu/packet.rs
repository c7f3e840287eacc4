//! A packet of rays through one brick: walk, fetch, classify, composite.
//!
//! Coordinates are the brick's own: voxel (0, 0, 0) is the first of its core, cell i lies between voxels i and i + 1, from
//! -1 to the last core voxel. t is a world length from the ray's entry into the brick, so that `f32` resolves it: the
//! position of a crossing is right to a few 1e-6 of a cell, wherever the brick is.
//!
//! A crossing is `plane * inverse + offset` for the plane's whole number: it does not depend on how the ray came there, so
//! that leaping changes nothing. Rays are taken in *rounds* of [`ROUND`] cells, in four stages over all lanes:
//! 1. leap: rays before macro cells that show nothing go to the face of the proximity cloud's cube;
//! 2. walk: base and fractions of the next cells;
//! 3. fetch and classify: the corners of cell i + 1 are gathered while cell i is integrated;
//! 4. refine the parts whose error is too large ([`super::refine`]); composite.

use supervol_format::brick::{APRON, MACRO_CELL};

use super::fetch::{Cell, Stored};
use super::integrate::{Chord, integrate};
use super::leap::ProximityCloud;
use super::lookup::Lookup;
use super::refine::{Queue, refine};
use super::simd::{LANES_LIMIT, Simd, exp_minus};

/// Cells that are walked before anything is composited.
pub const ROUND: usize = 6;

/// Distance, in cells, that stands for beyond everything.
const FAR: f32 = 1e30;

/// Bound on the rounding of a position, in cells: `f32` over the 132 voxels of the largest brick.
const POSITION_ERROR: f32 = 2e-5;
/// Bound on the rounding of an interpolated value, in parts of it.
const VALUE_ERROR: f32 = 5e-7;

/// Numbers of one packet, lane by lane.
pub type PerLane = [f32; LANES_LIMIT];

/// Rays as they enter a brick, and what they gather in it.
#[derive(Debug, Clone)]
pub struct Packet {
    /// Position at entry, in cells.
    pub origin: [PerLane; 3],
    /// Cells per world length; 0 where parallel.
    pub direction: [PerLane; 3],
    /// World length in the brick; 0 for unused lanes.
    pub length: PerLane,
    /// Transmittance in front of the brick.
    pub front: PerLane,
    /// Premultiplied colour gathered in the brick, over transmittance 1.
    pub color: [PerLane; 3],
    /// Transmittance of the brick.
    pub transmittance: PerLane,
    /// Which ray each lane is, for those who lent it.
    pub rays: [u16; LANES_LIMIT],
}

impl Default for Packet {
    fn default() -> Self {
        let zero = [0.0; LANES_LIMIT];
        Self {
            origin: [zero; 3],
            direction: [zero; 3],
            length: zero,
            front: zero,
            color: [zero; 3],
            transmittance: [1.0; LANES_LIMIT],
            rays: [0; LANES_LIMIT],
        }
    }
}

/// One brick, as packets read it.
#[derive(Clone, Copy)]
pub struct PacketBrick<'a> {
    /// Voxels, apron included, x fastest.
    pub voxels: *const u8,
    /// What they are.
    pub stored: Stored,
    /// Voxels between neighbours along y and z.
    pub strides: [i32; 2],
    /// Voxels of the core along each axis.
    pub core: [i32; 3],
    /// What is taken off stored numbers; whole where they are.
    pub centre: f32,
    /// Value, as the pieces count it, = (stored number - `centre`) * `scale` + `offset`.
    pub scale: f32,
    /// See `scale`.
    pub offset: f32,
    /// Stored number of holes.
    pub absent: Option<u16>,
    /// What to leap over.
    pub cloud: Option<&'a ProximityCloud>,
}

/// What integration may cost and miss.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Precision {
    /// Error of one cell, of colour or opacity times the transmittance in front, from which it is refined.
    pub cell_error: f32,
    /// Transmittance at which a ray ends.
    pub last_transmittance: f32,
    /// Whether the transfer function has steps: there rounding can be seen.
    pub has_steps: bool,
}

/// What was done, over all lanes.
#[derive(Debug, Clone, Copy, Default)]
pub struct Work {
    /// Cells crossed.
    pub cells: u64,
    /// Values classified.
    pub samples: u64,
    /// Leaps.
    pub leaps: u64,
    /// Cells that one rule did not settle.
    pub refined: u64,
    /// Cells that were left to roots in `f64`.
    pub exact: u64,
}

impl Work {
    /// Adds another packet's.
    pub fn add(&mut self, other: &Self) {
        self.cells += other.cells;
        self.samples += other.samples;
        self.leaps += other.leaps;
        self.refined += other.refined;
        self.exact += other.exact;
    }
}

/// Rays on their way through a brick.
struct Walker<S: Simd> {
    origin: [S::F; 3],
    direction: [S::F; 3],
    inverse: [S::F; 3],
    /// t of plane 0.
    offset: [S::F; 3],
    /// 1 where the ray ascends: the plane ahead is that much further than the cell.
    ahead: [S::F; 3],
    /// Plane ahead on each axis.
    plane: [S::F; 3],
    plane_step: [S::F; 3],
    /// Voxel offset of the cell's first corner.
    base: S::I,
    base_step: [S::I; 3],
    t: S::F,
    end: S::F,
    /// Rays that run exactly in a plane of voxels: holes beside the plane have no weight for them.
    in_plane: S::M,
}

/// A cell on the way.
#[derive(Clone, Copy)]
pub struct Step<S: Simd> {
    /// Voxel offset of its first corner.
    pub base: S::I,
    /// Position in it where the ray comes in.
    pub fraction: [S::F; 3],
    /// World length in it.
    pub length: S::F,
}

impl<S: Simd> Walker<S> {
    #[inline(always)]
    fn new(packet: &Packet, brick: &PacketBrick<'_>) -> Self {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let zero_int = S::splat_int(0);
        let mut walker = Self {
            origin: [zero; 3],
            direction: [zero; 3],
            inverse: [zero; 3],
            offset: [zero; 3],
            ahead: [zero; 3],
            plane: [zero; 3],
            plane_step: [zero; 3],
            base: zero_int,
            base_step: [zero_int; 3],
            t: zero,
            end: S::load(&packet.length),
            in_plane: S::lt(one, zero),
        };
        let strides = [1, brick.strides[0], brick.strides[1]];
        let mut cell = [zero; 3];
        for a in 0..3 {
            let (o, d) = (S::load(&packet.origin[a]), S::load(&packet.direction[a]));
            let (ascends, descends) = (S::lt(zero, d), S::lt(d, zero));
            let moves = ascends | descends;
            let inverse = S::select(moves, one / S::select(moves, d, one), zero);
            walker.origin[a] = o;
            walker.direction[a] = d;
            walker.inverse[a] = inverse;
            walker.offset[a] = S::select(moves, zero - o * inverse, S::splat(FAR));
            walker.ahead[a] = S::select(ascends, one, zero);
            walker.plane_step[a] = S::select(ascends, one, zero - one);
            walker.in_plane = walker.in_plane | (!moves & S::le(o, S::floor(o)));
            let stride = S::splat_int(strides[a]);
            walker.base_step[a] = S::select_int(ascends, stride, stride * S::splat_int(-1));
            cell[a] = walker.cell_of(a, o, S::splat(-1.0), S::splat(brick.core[a] as f32 - 1.0));
        }
        walker.go_to(cell, brick.strides, S::mask_from_bits(u32::MAX));
        walker
    }

    /// The cell of a position on an axis, inside two bounds; a position on a face lies in the cell that the ray enters.
    #[inline(always)]
    fn cell_of(&self, axis: usize, position: S::F, low: S::F, high: S::F) -> S::F {
        let below = S::floor(position);
        let is_face = S::le(position, below) & S::lt(self.plane_step[axis], S::splat(0.0));
        let cell = S::select(is_face, below - S::splat(1.0), below);
        S::min(S::max(cell, low), high)
    }

    /// Places rays of the mask into cells.
    #[inline(always)]
    fn go_to(&mut self, cell: [S::F; 3], strides: [i32; 2], mask: S::M) {
        let apron = S::splat(APRON as f32);
        let mut base = S::to_int(cell[0] + apron);
        for a in 1..3 {
            base = base + S::to_int(cell[a] + apron) * S::splat_int(strides[a - 1]);
        }
        self.base = S::select_int(mask, base, self.base);
        for a in 0..3 {
            self.plane[a] = S::select(mask, cell[a] + self.ahead[a], self.plane[a]);
        }
    }

    /// Rays that have not left the brick.
    #[inline(always)]
    fn active(&self) -> S::M {
        S::lt(self.t, self.end)
    }

    /// Ends rays.
    #[inline(always)]
    fn finish(&mut self, mask: S::M) {
        self.end = S::select(mask, self.t, self.end);
    }

    /// One cell on; lanes that have left the brick stay where they are, with length 0.
    #[inline(always)]
    fn step(&mut self) -> Step<S> {
        let mut exits = [self.end; 3];
        for a in 0..3 {
            exits[a] = S::mul_add(self.plane[a], self.inverse[a], self.offset[a]);
        }
        let leave = S::min(S::min(exits[0], exits[1]), S::min(exits[2], self.end));
        let leave = S::max(leave, self.t);
        let mut step = Step { base: self.base, fraction: exits, length: leave - self.t };
        let goes_on = S::lt(leave, self.end);
        for a in 0..3 {
            let position = S::mul_add(self.t, self.direction[a], self.origin[a]);
            step.fraction[a] = position - (self.plane[a] - self.ahead[a]);
            let crosses = S::le(exits[a], leave) & goes_on;
            self.plane[a] = S::select(crosses, self.plane[a] + self.plane_step[a], self.plane[a]);
            self.base = S::select_int(crosses, self.base + self.base_step[a], self.base);
        }
        self.t = leave;
        step
    }

    /// Takes rays out of macro cells that show nothing, to the face of the cube around that shows nothing either; returns
    /// the number of leaps.
    #[inline(always)]
    fn leap(&mut self, cloud: &ProximityCloud, brick: &PacketBrick<'_>) -> u32 {
        let side = S::splat(MACRO_CELL as f32);
        let mut leaps = 0;
        loop {
            let active = self.active();
            let mut macro_cell = [S::splat_int(0); 3];
            for a in 0..3 {
                // Cell -1 belongs to the first macro cell.
                let cell = S::max(self.plane[a] - self.ahead[a], S::splat(0.0));
                macro_cell[a] = S::shift_right::<{ MACRO_CELL.ilog2() }>(S::to_int(cell));
            }
            let [nx, ny, _] = cloud.cells.map(|n| S::splat_int(n as i32));
            let place = macro_cell[0] + nx * (macro_cell[1] + ny * macro_cell[2]);
            // SAFETY: cells of active rays lie in the core, whose macro cells the cloud covers.
            let bytes = unsafe { S::gather(cloud.distances.as_ptr(), place, active) };
            let distance = S::and_int(bytes, S::splat_int(255));
            let leaping = S::lt_int(S::splat_int(0), distance) & active;
            if S::bits(leaping) == 0 {
                return leaps;
            }
            leaps += S::bits(leaping).count_ones();
            let reach = S::to_float(distance);
            let mut faces = [[reach; 2]; 3];
            let mut exits = [self.end; 3];
            for a in 0..3 {
                let m = S::to_float(macro_cell[a]);
                let low = (m - reach + S::splat(1.0)) * side;
                // What lies before the first macro cell lies outside the brick.
                let low = S::select(S::le(low, S::splat(0.0)), S::splat(-2.0 * MACRO_CELL as f32), low);
                faces[a] = [low, (m + reach) * side];
                let ascends = S::lt(S::splat(0.0), self.plane_step[a]);
                let face = S::select(ascends, faces[a][1], low);
                exits[a] = S::mul_add(face, self.inverse[a], self.offset[a]);
            }
            let leave = S::max(S::min(S::min(exits[0], exits[1]), S::min(exits[2], self.end)), self.t);
            let mut cell = [leave; 3];
            for a in 0..3 {
                let position = S::mul_add(leave, self.direction[a], self.origin[a]);
                let [low, high] = faces[a];
                let inside = self.cell_of(a, position, low, high - S::splat(1.0));
                let ascends = S::lt(S::splat(0.0), self.plane_step[a]);
                let beyond = S::select(ascends, high, low - S::splat(1.0));
                let next = S::select(S::le(exits[a], leave), beyond, inside);
                cell[a] = S::min(S::max(next, S::splat(-1.0)), S::splat(brick.core[a] as f32 - 1.0));
            }
            self.t = S::select(leaping, leave, self.t);
            self.go_to(cell, brick.strides, leaping);
        }
    }
}

/// Where rays come from and go to, and who knows them better than `f32`.
pub trait Host {
    /// Writes the next ray into a lane; false where there are no more.
    fn lend(&mut self, lane: usize, packet: &mut Packet) -> bool;

    /// Takes a ray back with what it has gathered.
    fn take_back(&mut self, lane: usize, packet: &Packet);

    /// Colour and transmittance of a ray in the cell whose first corner lies at `base`: where `f32` and a bounded number of
    /// refinements do not settle them.
    fn integrate_exactly(&mut self, ray: u16, base: i32) -> [f32; 4];
}

/// Numbers of a part: red, green, blue, optical depth.
pub const PART_NUMBERS: usize = 4;
/// The parts of one round: the numbers of each lane in each cell.
pub type Parts = [[PerLane; PART_NUMBERS]; ROUND];

/// What rays have gathered in a brick.
struct Light<S: Simd> {
    /// Transmittance in front of the brick.
    front: S::F,
    /// Premultiplied colour, over transmittance 1.
    color: [S::F; 3],
    transmittance: S::F,
    /// Optical depth.
    depth: S::F,
}

impl<S: Simd> Light<S> {
    /// Adds the parts of a round; rays through which no more than `last` gets end there.
    #[inline(always)]
    fn composite(&mut self, parts: &Parts, last: S::F) {
        for part in parts {
            // A ray ends in the cell that makes it end, not with the round: rounds begin elsewhere where rays leap.
            let goes_on = S::lt(last, self.transmittance * self.front);
            let in_front = S::select(goes_on, self.transmittance, S::splat(0.0));
            for c in 0..3 {
                self.color[c] = S::mul_add(in_front, S::load(&part[c]), self.color[c]);
            }
            // From the sum, not as a product: thousands of numbers near 1 round to one side where the field is even.
            self.depth = S::select(goes_on, self.depth + S::load(&part[3]), self.depth);
            self.transmittance = exp_minus::<S>(self.depth);
        }
    }
}

/// Casts the host's rays through a brick, packet by packet.
///
/// # Safety
/// The voxels, strides and core of `brick` are those of one array with an apron of [`APRON`] voxels around.
#[inline(always)]
pub unsafe fn cast<S: Simd, L: Lookup>(
    brick: &PacketBrick<'_>,
    table: &L,
    narrow: f32,
    precision: Precision,
    host: &mut dyn Host,
) -> Work {
    let mut packet = Packet::default();
    let mut work = Work::default();
    loop {
        let lent = (0..S::LANES).take_while(|&lane| host.lend(lane, &mut packet)).count();
        if lent == 0 {
            return work;
        }
        packet.length[lent..].fill(0.0);
        // SAFETY: the caller's promise.
        unsafe { cast_packet::<S, L>(brick, table, narrow, precision, &mut packet, host, &mut work) };
        (0..lent).for_each(|lane| host.take_back(lane, &packet));
    }
}

/// Casts one packet.
///
/// # Safety
/// As for [`cast`].
#[inline(always)]
unsafe fn cast_packet<S: Simd, L: Lookup>(
    brick: &PacketBrick<'_>,
    table: &L,
    narrow: f32,
    precision: Precision,
    packet: &mut Packet,
    host: &mut dyn Host,
    work: &mut Work,
) {
    let (zero, one) = (S::splat(0.0), S::splat(1.0));
    let last = S::splat(precision.last_transmittance);
    let front = S::load(&packet.front);
    let mut walker = Walker::<S>::new(packet, brick);
    let mut light = Light::<S> { front, color: [zero; 3], transmittance: one, depth: zero };
    let round = Round { brick, table, narrow, precision, weight: front };
    let mut parts: Parts = [[[0.0; LANES_LIMIT]; PART_NUMBERS]; ROUND];
    let mut queue = Queue::new();
    loop {
        walker.finish(S::le(light.transmittance * front, last));
        if let Some(cloud) = brick.cloud {
            work.leaps += u64::from(walker.leap(cloud, brick));
        }
        if S::bits(walker.active()) == 0 {
            break;
        }
        // SAFETY: the caller's promise.
        unsafe { round.classify(&mut walker, &mut parts, &mut queue, work) };
        if !queue.is_empty() {
            work.add(&refine::<S, L>(table, narrow, &packet.rays, &mut queue, &mut parts, host));
        }
        light.composite(&parts, last);
    }
    for c in 0..3 {
        S::store(light.color[c], &mut packet.color[c]);
    }
    S::store(light.transmittance, &mut packet.transmittance);
}

/// What is the same for all cells of a round.
struct Round<'a, S: Simd, L: Lookup> {
    brick: &'a PacketBrick<'a>,
    table: &'a L,
    narrow: f32,
    precision: Precision,
    /// Transmittance in front of the brick: whatever is nearer depends on how rays are cut into rounds.
    weight: S::F,
}

impl<S: Simd, L: Lookup> Round<'_, S, L> {
    /// Walks a round, and integrates each cell once; what is not settled by that goes into the queue.
    ///
    /// # Safety
    /// As for [`cast`].
    #[inline(always)]
    unsafe fn classify(&self, walker: &mut Walker<S>, parts: &mut Parts, queue: &mut Queue, work: &mut Work) {
        let (zero, brick) = (S::splat(0.0), self.brick);
        let nothing = Step { base: walker.base, fraction: [zero; 3], length: zero };
        let mut steps = [nothing; ROUND];
        for step in &mut steps {
            *step = walker.step();
        }
        let tolerance = S::splat(self.precision.cell_error);
        // SAFETY: the walk stays in cells of the core, whose corners the apron holds.
        let mut raw = unsafe { brick.stored.gather::<S>(brick.voxels, steps[0].base, brick.strides) };
        for i in 0..ROUND {
            let step = steps[i];
            let cell = brick.stored.cell::<S>(&raw, brick.absent, brick.centre);
            if i + 1 < ROUND {
                // SAFETY: as above.
                raw = unsafe { brick.stored.gather::<S>(brick.voxels, steps[i + 1].base, brick.strides) };
            }
            let chord = self.chord(&cell, &step, &walker.direction);
            let part = integrate::<S, L>(self.table, S::splat(self.narrow), &chord);
            let is_hole = S::is_nan(chord.values[1]);
            for c in 0..3 {
                S::store(S::select(is_hole, zero, part.color[c]), &mut parts[i][c]);
            }
            S::store(S::select(is_hole, zero, part.tau), &mut parts[i][3]);
            let crosses = S::lt(zero, step.length);
            let is_beside_hole = is_hole & walker.in_plane & crosses;
            let unsettled = S::bits(S::lt(tolerance, part.error * self.weight) | is_beside_hole);
            let crossed = S::bits(crosses).count_ones();
            work.cells += u64::from(crossed);
            work.samples += u64::from(2 * crossed);
            if unsettled != 0 {
                let per_error = self.weight / tolerance;
                queue.push::<S>(unsettled, &chord, [part.error * per_error, per_error], i, step.base);
            }
        }
    }

    /// The field along a ray's way through a cell.
    #[inline(always)]
    fn chord(&self, cell: &Cell<S>, step: &Step<S>, direction: &[S::F; 3]) -> Chord<S> {
        let (brick, h) = (self.brick, step.length);
        let (scale, offset) = (S::splat(brick.scale), S::splat(brick.offset));
        let travelled = [h * direction[0], h * direction[1], h * direction[2]];
        let mut values = [h; 3];
        for (value, share) in values.iter_mut().zip([0.0, 0.5, 1.0]) {
            let mut at = step.fraction;
            for a in 0..3 {
                at[a] = S::mul_add(travelled[a], S::splat(share), at[a]);
            }
            *value = S::mul_add(cell.at(at), scale, offset);
        }
        let cubic = cell.twist() * scale * (travelled[0] * travelled[1] * travelled[2]);
        let mut noise = S::splat(0.0);
        if self.precision.has_steps {
            let size = S::max(S::abs(values[0]), S::abs(values[2]));
            let of_place = cell.steepness() * S::splat(brick.scale.abs() * POSITION_ERROR);
            noise = S::mul_add(size, S::splat(VALUE_ERROR), of_place);
        }
        Chord { values, cubic, length: h, noise }
    }
}
