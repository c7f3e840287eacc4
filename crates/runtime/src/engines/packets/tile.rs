//! A tile of rays: 16 x 16 neighbouring pixels, cast brick by brick.
//!
//! Rays of a tile pass the bricks together, front to back, so that a brick's voxels stay in the processor's cache. In
//! each brick, packets are packed again from the rays that meet it. Entry and exit of a ray are computed in `f64` by
//! `(plane - origin) * inverse`: the same expression on both sides of a face and for every brick size. So the parts of
//! a ray tile it without gaps.
//!
//! Spaces: rays run in the index space of level 0; t is a world length.

use supervol_format::BrickKey;
use supervol_format::cast::{narrow, single};
use supervol_format::space::HALF_VOXEL;
use supervol_scene::clip::faces::CutFace;
use supervol_scene::clip::{IndexRay, Segment};

use super::noted::{LevelErrors, TileWork};
use super::parts_ahead::PartsAhead;
use super::places::TILE_RAYS;
use super::walk::Packet;
use crate::engines::cells::walk::PARALLEL;
use crate::engines::ray::{IsoSides, RayState, SurfaceCrossing};

/// One number for each ray of a tile.
pub(super) type PerRay = [f64; TILE_RAYS];

/// The nearest `f32`, except that only an integer becomes an integer. So a ray beside a plane of voxels stays on its
/// side of it, which decides whether holes next to the plane count.
fn beside_planes(position: f64) -> f32 {
    let nearest = single(position);
    let is_moved_onto_plane = nearest.fract() == 0.0 && f64::from(nearest) != position;
    match (is_moved_onto_plane, f64::from(nearest) < position) {
        (false, _) => nearest,
        (true, true) => nearest.next_up(),
        (true, false) => nearest.next_down(),
    }
}

/// Gathered values of a tile's rays, and the bricks they wait for.
#[derive(Debug, Clone)]
pub struct Gathered {
    /// World length at which each ray continues.
    pub t: PerRay,
    /// Premultiplied colour.
    pub color: [PerRay; 3],
    /// Share of light from behind that still passes.
    pub transmittance: PerRay,
    /// `dvr`: sum of the errors of cells, each times the transmittance in front of it.
    pub error: PerRay,
    /// `dvr`: what the ray's cells may still spend of its error budget.
    pub left: PerRay,
    /// `mip`, `minip`: the extreme so far; `mean`: the integral so far; NaN before the first present value.
    pub value: PerRay,
    /// `mean`: present world length so far.
    pub length: PerRay,
    /// `iso`: sides and hits.
    pub iso: [IsoSides; TILE_RAYS],
    /// The brick that the ray waits for.
    pub waiting: [Option<BrickKey>; TILE_RAYS],
    /// Deviations of the rays by coarser levels, if errors are summed up.
    pub levels: Option<Box<LevelErrors>>,
    /// Work of the rays, if it is counted.
    pub work: Option<Box<TileWork>>,
    /// Current part of the rays: solids may cut rays into several.
    pub part: usize,
}

impl Gathered {
    /// Gathered values of a ray in the scalar caster's form; without its position.
    #[must_use]
    pub fn state(&self, ray: usize) -> RayState {
        RayState {
            color: [0, 1, 2].map(|c| self.color[c][ray]),
            transmittance: self.transmittance[ray],
            value: self.value[ray],
            length: self.length[ray],
            iso: self.iso[ray],
            ..RayState::new(None)
        }
    }

    /// Takes over the gathered values of a ray.
    pub fn set_state(&mut self, ray: usize, state: &RayState) {
        for c in 0..3 {
            self.color[c][ray] = state.color[c];
        }
        self.transmittance[ray] = state.transmittance;
        self.value[ray] = state.value;
        self.length[ray] = state.length;
        self.iso[ray] = state.iso;
    }
}

/// The rays of a tile during a pass.
#[derive(Debug, Clone)]
pub struct TileRays {
    pub(super) origin: [PerRay; 3],
    pub(super) direction: [PerRay; 3],
    pub(super) inverse: [PerRay; 3],
    /// End of each ray; before every entry for rays that are done in this pass.
    pub(super) stop: PerRay,
    /// Gathered values of the rays.
    pub gathered: Gathered,
    /// Surfaces that rays meet in the current brick, in order along each ray; in frames that list them.
    pub crossings: Vec<(u16, SurfaceCrossing)>,
    /// Entry into and exit from the current brick.
    entry: PerRay,
    exit: PerRay,
    /// Distance behind its entry at which a ray begins, if `has_starts`.
    pub(super) start: [f32; TILE_RAYS],
    has_starts: bool,
    /// Parts of the rays that solids leave.
    pub(super) ahead: PartsAhead,
    /// The cut face in front of each ray's part; empty if none lights anything.
    faces: Vec<Option<CutFace>>,
    /// Rays that meet the current brick.
    hits: [u16; TILE_RAYS],
    hit_count: usize,
    /// Rays that continue in this pass.
    going: usize,
    has_parallel: bool,
    /// Least and greatest origin and inverse direction of all rays, for culling of bricks.
    bounds: Bounds,
}

/// Bounds over the rays of a tile.
#[derive(Debug, Clone, Copy, Default)]
struct Bounds {
    origin: [[f64; 2]; 3],
    inverse: [[f64; 2]; 3],
    t: [f64; 2],
}

/// A box in index space, half-open; infinite at the volume's ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IndexBox {
    /// Least corner.
    pub low: [f64; 3],
    /// Greatest corner.
    pub high: [f64; 3],
}

/// The grid of a brick's voxels for packets: level voxel = (index + 1/2) / scale - 1/2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrickGrid {
    /// Voxels per level-0 voxel: exact, a power of two.
    pub inverse_scale: [f64; 3],
    /// First core voxel.
    pub start: [f64; 3],
}

/// Least and greatest number of the rays that are active.
#[inline(always)]
fn extremes(numbers: &PerRay, stop: &PerRay) -> [f64; 2] {
    // As many lanes as the widest registers hold.
    const SIDE: usize = 8;
    let (mut low, mut high) = ([f64::INFINITY; SIDE], [f64::NEG_INFINITY; SIDE]);
    for (numbers, stop) in numbers.chunks_exact(SIDE).zip(stop.chunks_exact(SIDE)) {
        for i in 0..SIDE {
            let is_going = stop[i] > f64::NEG_INFINITY;
            low[i] = if is_going & (numbers[i] < low[i]) { numbers[i] } else { low[i] };
            high[i] = if is_going & (numbers[i] > high[i]) { numbers[i] } else { high[i] };
        }
    }
    [low.into_iter().fold(f64::INFINITY, f64::min), high.into_iter().fold(f64::NEG_INFINITY, f64::max)]
}

impl TileRays {
    /// Most bytes of cut faces, which it holds beside itself.
    pub(super) const MOST_BYTES_OF_FACES: usize = TILE_RAYS * size_of::<Option<CutFace>>();

    /// A tile without rays.
    #[must_use]
    pub fn new() -> Self {
        let zero = [0.0; TILE_RAYS];
        Self {
            origin: [zero; 3],
            direction: [zero; 3],
            inverse: [zero; 3],
            stop: [f64::NEG_INFINITY; TILE_RAYS],
            gathered: Gathered {
                t: zero,
                color: [zero; 3],
                transmittance: [1.0; TILE_RAYS],
                error: zero,
                left: zero,
                value: [f64::NAN; TILE_RAYS],
                length: zero,
                iso: [IsoSides::default(); TILE_RAYS],
                waiting: [None; TILE_RAYS],
                levels: None,
                work: None,
                part: 0,
            },
            crossings: Vec::new(),
            entry: zero,
            exit: zero,
            start: [0.0; TILE_RAYS],
            has_starts: false,
            ahead: PartsAhead::default(),
            faces: Vec::new(),
            hits: [0; TILE_RAYS],
            hit_count: 0,
            going: 0,
            has_parallel: false,
            bounds: Bounds::default(),
        }
    }

    /// Removes all rays; those that follow have this error budget.
    pub fn clear(&mut self, budget: f32) {
        self.faces.clear();
        self.gathered.left.fill(f64::from(budget));
        self.stop.fill(f64::NEG_INFINITY);
        self.ahead.clear();
        self.gathered.color = [[0.0; TILE_RAYS]; 3];
        self.gathered.transmittance.fill(1.0);
        self.gathered.error.fill(0.0);
        self.gathered.value.fill(f64::NAN);
        self.gathered.length.fill(0.0);
        self.gathered.iso.fill(IsoSides::default());
        self.gathered.waiting.fill(None);
        self.gathered.levels = None;
        self.gathered.work = None;
        self.gathered.part = 0;
        (self.going, self.hit_count, self.has_parallel) = (0, 0, false);
    }

    /// Starts a ray at `segment.t0`, or at the position where it waited.
    pub fn set(&mut self, ray: usize, index_ray: &IndexRay, segment: Segment) {
        for a in 0..3 {
            let direction = if index_ray.direction[a].abs() < PARALLEL { 0.0 } else { index_ray.direction[a] };
            self.origin[a][ray] = index_ray.origin[a];
            self.direction[a][ray] = direction;
            self.inverse[a][ray] = direction.recip();
            self.has_parallel |= direction == 0.0;
        }
        self.gathered.t[ray] = segment.t0;
        self.stop[ray] = segment.t1;
        self.going += 1;
    }

    /// Keeps the active rays that `is_asked` selects; returns the number of inactive ones.
    pub fn keep(&mut self, is_asked: impl Fn(usize) -> bool) -> u64 {
        let mut without_way = 0;
        for ray in 0..TILE_RAYS {
            if !is_asked(ray) {
                self.stop[ray] = f64::NEG_INFINITY;
            } else if self.stop[ray] > f64::NEG_INFINITY {
                self.going += 1;
                self.has_parallel |= (0..3).any(|a| self.direction[a][ray] == 0.0);
            } else {
                without_way += 1;
            }
        }
        without_way
    }

    /// Number of rays that continue in this pass.
    #[must_use]
    pub fn going(&self) -> usize {
        self.going
    }

    /// Stops all rays; their gathered values stay.
    pub fn take_off(&mut self) {
        self.stop.fill(f64::NEG_INFINITY);
        self.going = 0;
    }

    /// Computes the bounds, once all rays are set.
    #[inline(always)]
    pub fn bound(&mut self) {
        let of = |numbers: &PerRay| extremes(numbers, &self.stop);
        let [begins, ends] = [of(&self.gathered.t), of(&self.stop)];
        self.bounds = Bounds {
            origin: [0, 1, 2].map(|a| of(&self.origin[a])),
            inverse: [0, 1, 2].map(|a| of(&self.inverse[a])),
            t: [begins[0].min(ends[0]), begins[1].max(ends[1])],
        };
    }

    /// Whether some ray may meet the box; never wrongly false.
    #[must_use]
    pub fn may_meet(&self, cube: &IndexBox) -> bool {
        let [mut near, mut far] = self.bounds.t;
        for a in 0..3 {
            let (origin, inverse) = (self.bounds.origin[a], self.bounds.inverse[a]);
            if inverse[0] == f64::INFINITY {
                // All rays are perpendicular to this axis.
                if origin[1] < cube.low[a] || cube.high[a] <= origin[0] {
                    return false;
                }
                continue;
            }
            // Usable only if finite and of one sign.
            if inverse[0] * inverse[1] > 0.0 && inverse.iter().all(|v| v.is_finite()) {
                let crossing = |plane: f64| {
                    let ways = [0, 1, 2, 3].map(|i| (plane - origin[i & 1]) * inverse[i >> 1]);
                    ways.into_iter().fold([f64::INFINITY, f64::NEG_INFINITY], |r, t| [r[0].min(t), r[1].max(t)])
                };
                let (low, high) = (crossing(cube.low[a]), crossing(cube.high[a]));
                near = near.max(low[0].min(high[0]));
                far = far.min(low[1].max(high[1]));
            }
        }
        near <= far
    }

    /// Finds the rays that meet the box, with entry and exit; returns their number.
    #[inline(always)]
    pub fn enter(&mut self, cube: &IndexBox) -> usize {
        for ray in 0..TILE_RAYS {
            let (mut near, mut far) = (self.gathered.t[ray], self.stop[ray]);
            for a in 0..3 {
                let low = (cube.low[a] - self.origin[a][ray]) * self.inverse[a][ray];
                let high = (cube.high[a] - self.origin[a][ray]) * self.inverse[a][ray];
                // This form ignores NaN, which comes from a parallel ray in a face's plane.
                let (first, last) = if low < high { (low, high) } else { (high, low) };
                near = if first > near { first } else { near };
                far = if last < far { last } else { far };
            }
            self.entry[ray] = near;
            self.exit[ray] = far;
        }
        if self.has_parallel {
            self.leave_out_parallel(cube);
        }
        let mut count = 0;
        for ray in 0..TILE_RAYS {
            self.hits[count] = narrow::<u16>(ray);
            count += usize::from(self.entry[ray] < self.exit[ray]);
            // The last write may lie at the end; it is never read.
            if count == TILE_RAYS {
                break;
            }
        }
        (self.hit_count, self.has_starts) = (count, false);
        count
    }

    /// Removes rays parallel to an axis that do not lie between the box's faces, the lower one included.
    #[cold]
    fn leave_out_parallel(&mut self, cube: &IndexBox) {
        for ray in 0..TILE_RAYS {
            if self.stop[ray] == f64::NEG_INFINITY {
                continue;
            }
            let (mut near, mut far) = (self.gathered.t[ray], self.stop[ray]);
            for a in 0..3 {
                let (origin, inverse) = (self.origin[a][ray], self.inverse[a][ray]);
                if self.direction[a][ray] == 0.0 {
                    if !(cube.low[a] <= origin && origin < cube.high[a]) {
                        far = f64::NEG_INFINITY;
                    }
                    continue;
                }
                let crossings = [(cube.low[a] - origin) * inverse, (cube.high[a] - origin) * inverse];
                near = near.max(crossings[0].min(crossings[1]));
                far = far.min(crossings[0].max(crossings[1]));
            }
            self.entry[ray] = near;
            self.exit[ray] = far;
        }
    }

    /// Keeps rays found by [`TileRays::enter`] that have something between two depths, and limits them to that range.
    /// Depths are relative to `depth`, along `forward` from the index space's origin.
    #[inline(always)]
    pub(super) fn keep_between(&mut self, forward: [f64; 3], depth: f64, depths: &[[f32; TILE_RAYS]; 2]) {
        let mut from: PerRay = [0.0; TILE_RAYS];
        for (ray, from) in from.iter_mut().enumerate() {
            let along = |of: &[PerRay; 3]| forward[0] * of[0][ray] + forward[1] * of[1][ray] + forward[2] * of[2][ray];
            let (begin, per_depth) = (along(&self.origin), along(&self.direction).recip());
            let to = |behind: f32| (depth - begin + f64::from(behind)) * per_depth;
            let (near, far) = (to(depths[0][ray]), to(depths[1][ray]));
            *from = if near > self.entry[ray] { near } else { self.entry[ray] };
            self.exit[ray] = if far < self.exit[ray] { far } else { self.exit[ray] };
        }
        for (start, (from, entry)) in self.start.iter_mut().zip(from.iter().zip(&self.entry)) {
            *start = single(from - entry);
        }
        let mut count = 0;
        for i in 0..self.hit_count {
            let ray = self.hits[i];
            self.hits[count] = ray;
            count += usize::from(from[usize::from(ray)] < self.exit[usize::from(ray)]);
        }
        (self.hit_count, self.has_starts) = (count, true);
    }

    /// The rays found by [`TileRays::enter`].
    #[must_use]
    pub fn hits(&self) -> &[u16] {
        &self.hits[..self.hit_count]
    }

    /// Entry and exit of a ray found by [`TileRays::enter`].
    #[must_use]
    pub fn interval(&self, ray: u16) -> [f64; 2] {
        [self.entry[usize::from(ray)], self.exit[usize::from(ray)]]
    }

    /// Sets the cut faces of the rays that go on, by their number and the end of their part.
    pub(super) fn set_faces(&mut self, of_ray: impl Fn(usize, f64) -> Option<CutFace>) {
        self.faces.resize(TILE_RAYS, None);
        for (ray, (face, &stop)) in self.faces.iter_mut().zip(&self.stop).enumerate() {
            *face = if stop > f64::NEG_INFINITY { of_ray(ray, stop) } else { None };
        }
    }

    /// The cut face in front of a ray's part, if it lights something.
    pub(super) fn face(&self, ray: u16) -> Option<CutFace> {
        self.faces.get(usize::from(ray)).copied().flatten()
    }

    /// Replaces the rays found by [`TileRays::enter`].
    pub fn set_hits(&mut self, hits: &[u16]) {
        self.hits[..hits.len()].copy_from_slice(hits);
        self.hit_count = hits.len();
    }

    /// Sets the part of the current brick that a ray crosses.
    pub fn set_interval(&mut self, ray: u16, [entry, exit]: [f64; 2]) {
        (self.entry[usize::from(ray)], self.exit[usize::from(ray)]) = (entry, exit);
    }

    /// A ray in index space.
    #[must_use]
    pub fn index_ray(&self, ray: u16) -> IndexRay {
        let ray = usize::from(ray);
        IndexRay {
            origin: std::array::from_fn(|a| self.origin[a][ray]),
            direction: std::array::from_fn(|a| self.direction[a][ray]),
        }
    }

    /// Writes hit number `hit` into a lane of a packet for a brick.
    #[inline(always)]
    pub fn pack(&self, hit: usize, grid: &BrickGrid, lane: usize, packet: &mut Packet) {
        let ray = usize::from(self.hits[hit]);
        let entry = self.entry[ray];
        for a in 0..3 {
            let position = self.origin[a][ray] + entry * self.direction[a][ray];
            let local = (position + HALF_VOXEL) * grid.inverse_scale[a] - HALF_VOXEL - grid.start[a];
            packet.origin[a][lane] = if self.direction[a][ray] == 0.0 { beside_planes(local) } else { single(local) };
            packet.direction[a][lane] = single(self.direction[a][ray] * grid.inverse_scale[a]);
        }
        packet.length[lane] = single(self.exit[ray] - entry);
        packet.start[lane] = if self.has_starts { self.start[ray] } else { 0.0 };
        packet.front[lane] = single(self.gathered.transmittance[ray]);
        packet.left[lane] = single(self.gathered.left[ray]);
        packet.rays[lane] = narrow::<u16>(ray);
    }

    /// Adds a part's contribution to one ray.
    #[inline(always)]
    pub fn add(&mut self, ray: u16, color: [f32; 3], transmittance: f32, last_transmittance: f64) {
        let ray = usize::from(ray);
        let in_front = self.gathered.transmittance[ray];
        for c in 0..3 {
            self.gathered.color[c][ray] += in_front * f64::from(color[c]);
        }
        let behind = in_front * f64::from(transmittance);
        self.gathered.transmittance[ray] = behind;
        if behind <= last_transmittance {
            self.end(ray);
        }
    }

    /// Adds the error of the next part to be added, for transmittance 1 in front.
    #[inline(always)]
    pub fn add_error(&mut self, ray: u16, error: f32) {
        let ray = usize::from(ray);
        self.gathered.error[ray] += self.gathered.transmittance[ray] * f64::from(error);
    }

    /// Rest of a ray's error budget.
    #[inline(always)]
    pub fn set_left(&mut self, ray: u16, left: f32) {
        self.gathered.left[usize::from(ray)] = f64::from(left);
    }

    /// Ends a ray.
    #[inline(always)]
    pub fn end(&mut self, ray: usize) {
        if self.stop[ray] > f64::NEG_INFINITY {
            self.stop[ray] = f64::NEG_INFINITY;
            self.going -= 1;
        }
    }

    /// Whether a ray continues in this pass.
    #[must_use]
    pub fn is_going(&self, ray: usize) -> bool {
        self.stop[ray] > f64::NEG_INFINITY
    }

    /// Removes the rays found by [`TileRays::enter`] that a brick cannot change; returns how many remain.
    pub fn keep_hits(&mut self, mut keeps: impl FnMut(usize, &mut Gathered) -> bool) -> usize {
        let mut count = 0;
        for i in 0..self.hit_count {
            let ray = self.hits[i];
            self.hits[count] = ray;
            count += usize::from(keeps(usize::from(ray), &mut self.gathered));
        }
        self.hit_count = count;
        count
    }

    /// Lets the rays of the current brick wait for it.
    pub fn wait(&mut self, key: BrickKey) {
        for i in 0..self.hit_count {
            let ray = usize::from(self.hits[i]);
            self.gathered.t[ray] = self.entry[ray];
            self.gathered.waiting[ray] = Some(key);
            self.stop[ray] = f64::NEG_INFINITY;
        }
        self.going -= self.hit_count;
    }
}
