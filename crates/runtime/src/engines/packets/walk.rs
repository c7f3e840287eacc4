//! Rays through a brick: from cell to cell, and leaps over invisible parts.
//!
//! Coordinates are the brick's own: voxel (0, 0, 0) is the first of its core. Cell i lies between voxels i and i + 1,
//! from -1 to the last core voxel. The parameter t is a world length from the ray's entry into the brick, so that `f32`
//! resolves it. Positions of crossings are right to a few 1e-6 of a cell, wherever the brick is.
//!
//! A crossing is `plane * inverse + offset` for the plane's integer number. It does not depend on the ray's earlier
//! path, so leaping changes nothing.

use supervol_format::brick::{APRON, MACRO_CELL};
use supervol_format::cast::narrow;

use super::fetch::{BrickVoxels, strides_of};
use super::leap::ProximityCloud;
use super::shade::PacketLighting;
use super::simd::{LANES_LIMIT, Places, Simd, hidden_in_memory};
use crate::engines::blocks::BLOCK;
use crate::engines::rules::POSITION_ERROR;

/// Cells walked before anything is composited.
pub const ROUND: usize = 6;

/// Pixels along each side of a block of consecutive rays: the content of one packet, as long as all rays run.
pub const BLOCK_SIDE: u32 = 4;

/// Distance, in cells, beyond everything.
const FAR: f32 = 1e30;

/// Numbers of one packet, lane by lane.
pub type PerLane = [f32; LANES_LIMIT];

/// Rays at their entry into a brick, and the light they gather in it.
#[derive(Debug, Clone)]
pub struct Packet {
    /// Position at entry, in cells.
    pub origin: [PerLane; 3],
    /// Cells per world length; 0 where parallel.
    pub direction: [PerLane; 3],
    /// World length behind the entry at which the ray begins: nothing is visible before.
    pub start: PerLane,
    /// World length behind the entry at which it ends; 0 for unused lanes.
    pub length: PerLane,
    /// Transmittance in front of the brick.
    pub front: PerLane,
    /// Error that the ray's cells may still have together ([`super::budget`]).
    pub left: PerLane,
    /// Premultiplied colour gathered in the brick, over transmittance 1.
    pub color: [PerLane; 3],
    /// Transmittance of the brick.
    pub transmittance: PerLane,
    /// Error of colour and opacity, for transmittance 1 in front.
    pub error: PerLane,
    /// Ray number of each lane, for the host.
    pub rays: [u16; LANES_LIMIT],
}

impl Default for Packet {
    fn default() -> Self {
        let zero = [0.0; LANES_LIMIT];
        Self {
            origin: [zero; 3],
            direction: [zero; 3],
            start: zero,
            length: zero,
            front: zero,
            left: zero,
            color: [zero; 3],
            transmittance: [1.0; LANES_LIMIT],
            error: zero,
            rays: [0; LANES_LIMIT],
        }
    }
}

/// The part of a brick that walking needs: its size, and the cloud for leaping.
#[derive(Clone, Copy)]
pub struct WalkedBrick<'a> {
    /// Voxels of the core along each axis.
    core: [i32; 3],
    /// Voxels between neighbours along y and z.
    strides: [i32; 2],
    /// Cloud for leaping; it covers the core.
    cloud: Option<&'a ProximityCloud<BLOCK>>,
}

impl<'a> WalkedBrick<'a> {
    /// A brick whose core has `core` voxels along each axis, without a cloud.
    #[must_use]
    pub fn new(core: [usize; 3]) -> Self {
        Self { core: core.map(narrow::<i32>), strides: strides_of(core), cloud: None }
    }

    /// The same brick with a cloud for leaping.
    ///
    /// # Panics
    /// If the cloud belongs to a brick of another size.
    #[must_use]
    pub fn with_cloud(self, cloud: Option<&'a ProximityCloud<BLOCK>>) -> Self {
        let core = self.core.map(narrow::<usize>);
        assert!(cloud.is_none_or(|cloud| cloud.covers(core)), "the cloud does not cover a brick of {core:?} voxels");
        Self { cloud, ..self }
    }

    /// Voxels of the core along each axis.
    #[must_use]
    pub fn core(&self) -> [i32; 3] {
        self.core
    }
}

/// One brick in the form that packets read.
#[derive(Clone, Copy)]
pub struct PacketBrick<'a> {
    /// Size and cloud, for walking.
    pub walked: WalkedBrick<'a>,
    /// Voxels, for gathering.
    pub voxels: BrickVoxels<'a>,
    /// Subtracted from stored numbers; an integer if they are.
    pub centre: f32,
    /// Value, relative to the pieces' origin, = (stored number - `centre`) * `scale` + `offset`.
    pub scale: f32,
    /// See `scale`.
    pub offset: f32,
    /// Bound on what values are off by the data.
    pub rounding: f32,
    /// Cells integrated together, if one rule settles them: 1 or one of [`SPANS`](super::span::SPANS).
    pub span: usize,
    /// Stored number of holes.
    pub absent: Option<u16>,
    /// `None`: unshaded.
    pub lighting: Option<PacketLighting<'a>>,
}

impl PacketBrick<'_> {
    /// Voxel offset of the first corner of cell (-1, -1, -1).
    #[must_use]
    pub fn first_base(&self) -> i32 {
        let [dy, dz] = self.voxels.strides();
        (narrow::<i32>(APRON) - 1) * (1 + dy + dz)
    }

    /// Offsets of the cells of a round; prefetches the cells of the next round.
    #[inline(always)]
    pub fn places_of<S: Simd>(&self, steps: &[CellStep<S>; ROUND]) -> [Places; ROUND] {
        let mut bases = [steps[0].base; ROUND];
        for (base, step) in bases.iter_mut().zip(steps) {
            *base = step.base;
        }
        let places = hidden_in_memory::<S, ROUND>(bases);
        self.prefetch_behind::<S>(&places);
        places
    }

    /// Prefetches rows of cells at one round's distance ahead, for the packet's outermost rays: those in between share
    /// their cache lines.
    #[inline(always)]
    fn prefetch_behind<S: Simd>(&self, places: &[Places; ROUND]) {
        let ([dy, dz], row_of_rays) = (self.voxels.strides(), BLOCK_SIDE as usize);
        for lane in [0, row_of_rays - 1, S::LANES - row_of_rays, S::LANES - 1] {
            let behind = 2 * places[ROUND - 1][lane] - places[0][lane];
            for row in [0, dy, dz, dy + dz] {
                self.voxels.prefetch::<S>(behind + row);
            }
        }
    }
}

/// Beginning, middle and end of chords in cells, which begin at `fraction` and are `travelled` cells long.
#[inline(always)]
pub fn places_along<S: Simd>(fraction: &[S::F; 3], travelled: &[S::F; 3]) -> [[S::F; 3]; 3] {
    let mut places = [*fraction; 3];
    for (place, share) in places[1..].iter_mut().zip([0.5, 1.0]) {
        for a in 0..3 {
            place[a] = S::mul_add(travelled[a], S::splat(share), fraction[a]);
        }
    }
    places
}

/// Rays walking through a brick. The cells of unfinished rays are the brick's: from -1 to the last core voxel along each axis.
pub struct Walker<'a, S: Simd> {
    brick: WalkedBrick<'a>,
    origin: [S::F; 3],
    pub direction: [S::F; 3],
    inverse: [S::F; 3],
    /// t of plane 0.
    offset: [S::F; 3],
    /// 1 if the ray ascends: the plane ahead is that much further than the cell.
    ahead: [S::F; 3],
    /// `origin + ahead`: minus the plane ahead, it is the position at entry from the corner of the cell.
    origin_and_ahead: [S::F; 3],
    /// Plane ahead on each axis.
    plane: [S::F; 3],
    plane_step: [S::F; 3],
    /// Voxel offset of the cell's first corner.
    base: S::I,
    base_step: [S::I; 3],
    pub t: S::F,
    end: S::F,
    /// Rays that run exactly in a plane of voxels: holes beside the plane have no weight for them.
    pub in_plane: S::M,
}

/// A cell on the path.
#[derive(Clone, Copy)]
pub struct CellStep<S: Simd> {
    /// Voxel offset of its first corner.
    pub base: S::I,
    /// Entry position in it.
    pub fraction: [S::F; 3],
    /// World length in it.
    pub length: S::F,
}

impl<S: Simd> CellStep<S> {
    /// Rays that cross the cell at all.
    #[inline(always)]
    pub fn crosses(&self) -> S::M {
        S::lt(S::splat(0.0), self.length)
    }

    /// Rays that cross it further than the rounding of positions. The rest of a cell beside a clip plane or a brick's
    /// face may be rounding alone. Modes in which a value counts for any length must check such cells in `f64`.
    #[inline(always)]
    pub fn crosses_surely(&self, direction: &[S::F; 3]) -> S::M {
        let way = |a: usize| S::abs(self.length * direction[a]);
        S::lt(S::splat(POSITION_ERROR), S::max(way(0), S::max(way(1), way(2))))
    }
}

impl<'a, S: Simd> Walker<'a, S> {
    /// Rays at their entry into a brick.
    ///
    /// # Safety
    /// Between `start` and `length`, every ray of the packet lies in the brick's core. Along each axis the core reaches
    /// from half a voxel before its first voxel to half a voxel behind its last, with at most a tenth of a cell of
    /// rounding.
    #[inline(always)]
    pub unsafe fn new(packet: &Packet, brick: &WalkedBrick<'a>) -> Self {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let zero_int = S::splat_int(0);
        let mut walker = Self {
            brick: *brick,
            origin: [zero; 3],
            direction: [zero; 3],
            inverse: [zero; 3],
            offset: [zero; 3],
            ahead: [zero; 3],
            origin_and_ahead: [zero; 3],
            plane: [zero; 3],
            plane_step: [zero; 3],
            base: zero_int,
            base_step: [zero_int; 3],
            t: S::load(&packet.start),
            end: S::load(&packet.length),
            in_plane: S::lt(one, zero),
        };
        let strides = [1, brick.strides[0], brick.strides[1]];
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
            walker.origin_and_ahead[a] = o + walker.ahead[a];
            walker.plane_step[a] = S::select(ascends, one, zero - one);
            walker.in_plane = walker.in_plane | (!moves & S::le(o, S::floor(o)));
            let stride = S::splat_int(strides[a]);
            walker.base_step[a] = S::select_int(ascends, stride, stride * S::splat_int(-1));
            let position = S::mul_add(walker.t, d, o);
            let cell = walker.cell_of(a, position, S::splat(-1.0), S::splat(brick.core[a] as f32 - 1.0));
            walker.plane[a] = cell + walker.ahead[a];
        }
        walker.find_base();
        walker
    }

    /// The cell of a position on an axis, clamped to two bounds; a position on a face lies in the cell that the ray
    /// enters.
    #[inline(always)]
    fn cell_of(&self, axis: usize, position: S::F, low: S::F, high: S::F) -> S::F {
        let below = S::floor(position);
        let is_face = S::le(position, below) & S::lt(self.plane_step[axis], S::splat(0.0));
        let cell = S::select(is_face, below - S::splat(1.0), below);
        S::min(S::max(cell, low), high)
    }

    /// Rays that have not left the brick.
    #[inline(always)]
    pub fn active(&self) -> S::M {
        S::lt(self.t, self.end)
    }

    /// Ends rays.
    #[inline(always)]
    pub fn finish(&mut self, mask: S::M) {
        self.end = S::select(mask, self.t, self.end);
    }

    /// The next cells of a round.
    #[inline(always)]
    pub fn round(&mut self) -> [CellStep<S>; ROUND] {
        let zero = S::splat(0.0);
        let mut steps = [CellStep { base: self.base, fraction: [zero; 3], length: zero }; ROUND];
        for step in &mut steps {
            *step = self.step();
        }
        steps
    }

    /// Advances by one cell; lanes that have left the brick stay, with length 0.
    #[inline(always)]
    fn step(&mut self) -> CellStep<S> {
        let mut exits = [self.end; 3];
        for a in 0..3 {
            exits[a] = S::mul_add(self.plane[a], self.inverse[a], self.offset[a]);
        }
        let leave = S::min(S::min(exits[0], exits[1]), S::min(exits[2], self.end));
        let leave = S::max(leave, self.t);
        let mut step = CellStep { base: self.base, fraction: exits, length: leave - self.t };
        let goes_on = S::lt(leave, self.end);
        for a in 0..3 {
            step.fraction[a] = S::mul_add(self.t, self.direction[a], self.origin_and_ahead[a] - self.plane[a]);
            let crosses = S::le(exits[a], leave) & goes_on;
            self.plane[a] = S::select(crosses, self.plane[a] + self.plane_step[a], self.plane[a]);
            self.base = S::select_int(crosses, self.base + self.base_step[a], self.base);
        }
        self.t = leave;
        step
    }

    /// Leaps rays over invisible blocks, to the face of the last invisible one ahead; returns the number of leaps.
    #[inline(always)]
    pub fn leap(&mut self) -> u32 {
        match self.brick.cloud {
            // SAFETY: the brick's cloud covers its core.
            Some(cloud) => unsafe { self.leap_by(cloud) },
            None => 0,
        }
    }

    /// One leap of every ray that can; returns these as one bit per lane. Does not update the memory offsets of their
    /// cells.
    #[inline(always)]
    pub fn leap_once(&mut self) -> u32 {
        match self.brick.cloud {
            // SAFETY: the brick's cloud covers its core.
            Some(cloud) => unsafe { self.leap_once_by(cloud) },
            None => 0,
        }
    }

    /// Like [`Self::leap`], with a cloud of cubes of another size.
    ///
    /// # Safety
    /// The cloud covers the core of the walker's brick.
    #[inline(always)]
    pub unsafe fn leap_by<const SIDE: usize>(&mut self, cloud: &ProximityCloud<SIDE>) -> u32 {
        let mut leaps = 0;
        loop {
            // SAFETY: the caller's promise.
            let leaping = unsafe { self.leap_once_by(cloud) };
            if leaping == 0 {
                break;
            }
            leaps += leaping.count_ones();
        }
        if leaps > 0 {
            self.find_base();
        }
        leaps
    }

    /// Like [`Self::leap_once`], with a cloud of cubes of another size.
    ///
    /// # Safety
    /// The same as for [`Self::leap_by`].
    #[inline(always)]
    unsafe fn leap_once_by<const SIDE: usize>(&mut self, cloud: &ProximityCloud<SIDE>) -> u32 {
        let active = self.active();
        let cube = self.cube::<SIDE>();
        // SAFETY: cells of active rays lie in the core, whose cubes the cloud covers.
        let distance = unsafe { cloud.gather::<S>(cube, active) };
        let leaping = S::lt_int(S::splat_int(0), distance) & active;
        let bits = S::bits(leaping);
        if bits != 0 {
            self.go_out_of::<SIDE>(cube, S::to_float(distance), leaping);
        }
        bits
    }

    /// Cubes of `SIDE` cells that hold the rays, indices in the brick; those of rays that have left it may lie outside.
    #[inline(always)]
    pub fn cube<const SIDE: usize>(&self) -> [S::I; 3] {
        let mut cube = [S::splat_int(0); 3];
        for a in 0..3 {
            // Cell -1 belongs to the first cube.
            let cell = S::max(self.plane[a] - self.ahead[a], S::splat(0.0));
            cube[a] = match SIDE {
                BLOCK => S::shift_right::<{ BLOCK.ilog2() }>(S::to_int(cell)),
                _ => S::shift_right::<{ MACRO_CELL.ilog2() }>(S::to_int(cell)),
            };
        }
        cube
    }

    /// Moves rays of the mask to the far face of the cubes less than `reach` ahead of their own.
    #[inline(always)]
    pub fn leave<const SIDE: usize>(&mut self, cube: [S::I; 3], reach: S::F, leaping: S::M) {
        self.go_out_of::<SIDE>(cube, reach, leaping);
        self.find_base();
    }

    /// Like [`Walker::leave`], without updating the memory offsets of the cells.
    #[inline(always)]
    fn go_out_of<const SIDE: usize>(&mut self, cube: [S::I; 3], reach: S::F, leaping: S::M) {
        let (zero, one, side) = (S::splat(0.0), S::splat(1.0), S::splat(SIDE as f32));
        let mut faces = [reach; 3];
        let mut exits = [self.end; 3];
        for a in 0..3 {
            let ascends = S::lt(zero, self.plane_step[a]);
            let face = (S::to_float(cube[a]) + S::select(ascends, reach, one - reach)) * side;
            // A position before the first cube lies outside the brick.
            faces[a] = S::select(S::le(face, zero), S::splat(-2.0 * SIDE as f32), face);
            exits[a] = S::mul_add(faces[a], self.inverse[a], self.offset[a]);
        }
        let leave = S::max(S::min(S::min(exits[0], exits[1]), S::min(exits[2], self.end)), self.t);
        for a in 0..3 {
            let position = S::mul_add(leave, self.direction[a], self.origin[a]);
            let ascends = S::lt(zero, self.plane_step[a]);
            // The last cell before the face, and the first behind it.
            let before = S::select(ascends, faces[a] - one, faces[a]);
            let behind = before + self.plane_step[a];
            let here = self.plane[a] - self.ahead[a];
            let inside = self.cell_of(a, position, S::min(here, before), S::max(here, before));
            let next = S::select(S::le(exits[a], leave), behind, inside);
            let cell = S::min(S::max(next, S::splat(-1.0)), S::splat(self.brick.core[a] as f32 - 1.0));
            self.plane[a] = S::select(leaping, cell + self.ahead[a], self.plane[a]);
        }
        self.t = S::select(leaping, leave, self.t);
    }

    /// Updates the memory offsets of the cells.
    #[inline(always)]
    fn find_base(&mut self) {
        let strides = self.brick.strides;
        let apron = S::splat(APRON as f32);
        let place = |a: usize| S::to_int(self.plane[a] - self.ahead[a] + apron);
        self.base = place(0) + place(1) * S::splat_int(strides[0]) + place(2) * S::splat_int(strides[1]);
    }
}
