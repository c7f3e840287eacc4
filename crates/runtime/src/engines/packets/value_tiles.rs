//! Tiles of rays through one brick, in the modes that gather values (`mip`, `minip`, `mean`) and in `iso`.

use supervol_format::BrickKey;
use supervol_scene::clip::IndexRay;
use supervol_scene::scene::Mode;

use super::fetch::Stored;
use super::frame::PacketFrame;
use super::simd::{Simd, Task, dispatch};
use super::summaries::{BrickSummary, Care, Numbers};
use super::surfaces::Surfaces;
use super::tables::packet_brick;
use super::tile::{BrickGrid, TileRays};
use super::values::{Extreme, Mean, ValueHost, ValuePacket, cast};
use super::visit::{CastTile, cast_ray};
use super::walk::PacketBrick;
use crate::engines::cells::{
    CellByCell, CellRule, Integrator, LevelVisit, gather_exact_cell, gather_exact_uniform, gather_exact_value_cell,
    gather_exact_values,
};
use crate::engines::ray::RayState;
use crate::stream::classify::Skipping;
use crate::stream::counters::RayCounters;
use crate::stream::residency::DecodedBrick;

impl CastTile<'_> {
    /// Casts all rays through a brick.
    pub(super) fn gather_brick(&mut self, key: BrickKey, brick: &DecodedBrick) {
        let (frame, tables) = (self.frame, self.tables);
        let (packet_brick, grid) = packet_brick(&frame.scene, key, brick);
        let make = || {
            BrickSummary::new(
                &frame.scene,
                brick,
                packet_brick.voxels.stored(),
                tables.origin,
                tables.ahead(&frame.scene, key),
                tables.tolerated,
            )
        };
        let summary = tables.summaries.of(frame.scene.field.brick(key), BrickSummary::bytes, make);
        if summary.care == Care::Exact {
            for i in 0..self.rays.hits().len() {
                self.gather_exactly(self.rays.hits()[i], key, brick);
            }
            return;
        }
        if frame.scene.mode == Mode::Mean {
            self.gather_short_rays_exactly(key, brick, &grid);
        }
        if frame.scene.skipping == Skipping::On && !self.may_change(&summary) {
            self.feedback.counters.macro_cells_skipped += self.rays.hits().len() as u64;
            return;
        }
        let packet_brick = PacketBrick { centre: summary.numbers.centre, ..packet_brick };
        let corner = self.corner;
        let mut closer = Vec::new();
        let at = (key, brick);
        let host =
            ValueTileHost { frame, at, summary: &summary, grid, corner, rays: self.rays, next: 0, closer: &mut closer };
        let work = dispatch(tables.set, GatherBrick { packet_brick, host });
        self.feedback.counters.add(&work);
        for (ray, at_least) in closer {
            let value = &mut self.rays.gathered.value[usize::from(ray)];
            *value = better(frame.scene.mode, *value, at_least);
            self.gather_exactly(ray, key, brick);
        }
    }

    /// Gathers values along a ray through a brick in `f64`.
    fn gather_exactly(&mut self, ray: u16, key: BrickKey, brick: &DecodedBrick) {
        self.with_state(ray, key, |level, t, state, counters| {
            gather_exact_values(level, (key, brick), t, state, counters);
        });
    }

    /// The same for rays that cross less than a cell: the rounding of their length would show in the mean. They meet the brick no more.
    fn gather_short_rays_exactly(&mut self, key: BrickKey, brick: &DecodedBrick, grid: &BrickGrid) {
        let is_short = |rays: &TileRays, ray: u16| {
            let ([entry, exit], IndexRay { direction, .. }) = (rays.interval(ray), rays.index_ray(ray));
            (0..3).all(|a| (exit - entry) * direction[a].abs() * grid.inverse_scale[a] < 1.0)
        };
        let short: Vec<u16> = self.rays.hits().iter().copied().filter(|&ray| is_short(self.rays, ray)).collect();
        if short.is_empty() {
            return;
        }
        for &ray in &short {
            self.gather_exactly(ray, key, brick);
        }
        self.rays.keep_hits(|ray, _| !short.iter().any(|&short| usize::from(short) == ray));
    }

    /// Does something with the state of a ray that meets the present brick, in the scalar caster's form.
    fn with_state(
        &mut self,
        ray: u16,
        key: BrickKey,
        gather: impl FnOnce(LevelVisit<'_>, [f64; 2], &mut RayState, &mut RayCounters),
    ) {
        let (interval, place) = (self.rays.interval(ray), usize::from(ray));
        let cast_ray = cast_ray(self.frame, self.rays, self.corner, ray);
        let mut state = self.rays.gathered.state(place);
        let level = LevelVisit::new(&self.frame.scene, &cast_ray, key);
        gather(level, interval, &mut state, &mut self.feedback.counters);
        self.rays.gathered.set_state(place, &state);
    }

    /// Whether a brick may change the rays that meet it. Removes rays that it cannot change, and records the sides on
    /// which they come out.
    fn may_change(&mut self, summary: &BrickSummary) -> bool {
        let cloud = summary.cloud.as_ref();
        match self.frame.scene.mode {
            Mode::Mip | Mode::Minip => {
                self.rays.keep_hits(|ray, gathered| summary.best(gathered.value[ray]) < summary.range[1]) > 0
            }
            Mode::Iso if cloud.is_some_and(|cloud| cloud.is_empty()) => {
                let thresholds = || summary.thresholds.iter().copied();
                self.rays.keep_hits(|ray, gathered| !gathered.iso[ray].pass(summary.range, thresholds())) > 0
            }
            _ => cloud.is_none_or(|cloud| !cloud.is_empty()),
        }
    }

    /// Casts all rays through a uniform value.
    pub(super) fn gather_uniform(&mut self, key: BrickKey, value: f32) {
        if self.frame.scene.mode != Mode::Iso {
            let map = &self.frame.scene.map;
            let stored = if map.is_rounded { self.view.entry(key).map(|known| known.entry.range.min) } else { None };
            let value = stored.map_or_else(|| map.to_data(value), |stored| map.data_of_container(stored));
            self.feedback.counters.cells += self.rays.hits().len() as u64;
            for i in 0..self.rays.hits().len() {
                let gather = |level: LevelVisit<'_>, t, state: &mut _, _: &mut _| {
                    gather_exact_uniform(&level, value, t, state);
                };
                self.with_state(self.rays.hits()[i], key, gather);
            }
            return;
        }
        let cells = CellByCell { pairs: CellRule::DEFAULT.pairs };
        let iso = || self.frame.scene.iso.iter().map(|surface| surface.value);
        for i in 0..self.rays.hits().len() {
            let ray = self.rays.hits()[i];
            let [t0, t1] = self.rays.interval(ray);
            let place = usize::from(ray);
            if self.frame.scene.mode == Mode::Iso && self.rays.gathered.iso[place].pass([value; 2], iso()) {
                continue;
            }
            let cast_ray = cast_ray(self.frame, self.rays, self.corner, ray);
            let visit = LevelVisit::new(&self.frame.scene, &cast_ray, key);
            let mut state = RayState { t: t0, ..self.rays.gathered.state(place) };
            let counters = &mut self.feedback.counters;
            cells.gather_uniform(&visit, value, [t0, t1], &mut state, counters);
            self.rays.gathered.set_state(place, &state);
            self.rays.crossings.extend(state.crossings.drain(..).map(|crossing| (ray, crossing)));
            if self.frame.scene.is_done(&state) {
                self.rays.end(place);
            }
        }
    }

    /// Casts all rays through nothing.
    pub(super) fn gather_nothing(&mut self) {
        for i in 0..self.rays.hits().len() {
            let ray = usize::from(self.rays.hits()[i]);
            self.rays.gathered.iso[ray].known = 0;
        }
    }
}

/// The more extreme of two values; the other one if one is NaN.
fn better(mode: Mode, a: f64, b: f64) -> f64 {
    if mode == Mode::Mip { a.max(b) } else { a.min(b) }
}

/// A value that is less extreme by `off`.
pub(super) fn worse(mode: Mode, value: f64, off: f64) -> f64 {
    if mode == Mode::Mip { value - off } else { value + off }
}

/// Casts the rays of a tile that meet a brick, packet by packet.
struct GatherBrick<'a> {
    packet_brick: PacketBrick<'a>,
    host: ValueTileHost<'a>,
}

impl Task for GatherBrick<'_> {
    type Output = RayCounters;

    #[inline(always)]
    fn run<S: Simd>(mut self) -> RayCounters {
        let (brick, summary) = (&self.packet_brick, self.host.summary);
        let leaps = self.host.frame.scene.skipping == Skipping::On;
        let cloud = summary.cloud.as_ref();
        match self.host.frame.scene.mode {
            Mode::Mip | Mode::Minip => {
                let mut extreme = Extreme::<S>::new(&summary.numbers, leaps.then_some(&summary.ranges));
                // SAFETY: as in `visit`; the summary is the brick's.
                unsafe { cast::<S, _>(brick, &mut extreme, &mut self.host) }
            }
            Mode::Mean => {
                let mut mean = Mean::<S>::new(summary.mean_scale(), cloud.filter(|cloud| !cloud.is_dense()));
                // SAFETY: as in `visit`; the summary is the brick's.
                unsafe { cast::<S, _>(brick, &mut mean, &mut self.host) }
            }
            Mode::Iso => {
                let quiet = cloud.map(|cloud| (cloud, &summary.ranges));
                let mut surfaces = Surfaces::<S>::new(&summary.numbers, quiet);
                // SAFETY: as in `visit`; the summary is the brick's.
                unsafe { cast::<S, _>(brick, &mut surfaces, &mut self.host) }
            }
            Mode::Dvr | Mode::Slice => RayCounters::default(),
        }
    }
}

/// Host of the rays of a tile that meet a brick.
struct ValueTileHost<'a> {
    frame: &'a PacketFrame,
    at: (BrickKey, &'a DecodedBrick),
    summary: &'a BrickSummary,
    grid: BrickGrid,
    /// The tile's first pixel.
    corner: [u32; 2],
    rays: &'a mut TileRays,
    /// The next hit to lend.
    next: usize,
    /// Rays that are gathered once more, with a value that their extreme is not within.
    closer: &'a mut Vec<(u16, f64)>,
}

impl ValueTileHost<'_> {
    /// A ray that comes out of the brick with this extreme.
    fn found(&mut self, ray: u16, extreme: f64) {
        let mode = self.frame.scene.mode;
        let value = &mut self.rays.gathered.value[usize::from(ray)];
        match self.summary.care {
            Care::Closer(off) => {
                let at_least = worse(mode, extreme, off);
                // True where the ray has no value yet.
                if better(mode, worse(mode, *value, off), extreme) != worse(mode, *value, off) {
                    self.closer.push((ray, at_least));
                }
            }
            Care::Packets | Care::Exact => *value = better(mode, *value, extreme),
        }
    }

    /// Adds to a ray its part of the mean.
    fn add_integral(&mut self, ray: usize, [integral, present, absent]: [f32; 3], length: f64) {
        if present == 0.0 {
            return;
        }
        let Numbers { stored, map, .. } = self.summary.numbers;
        let length = if absent == 0.0 { length } else { f64::from(present) };
        let scale = if stored == Stored::F32 { 1.0 } else { f64::from(map.scale) };
        let integral = f64::from(integral) * scale / f64::from(self.summary.mean_scale());
        let integral = integral + self.summary.numbers.value(0.0) * length;
        let gathered = &mut self.rays.gathered;
        let before = gathered.value[ray];
        gathered.value[ray] = if before.is_nan() { 0.0 } else { before } + integral;
        gathered.length[ray] += length;
    }
}

impl ValueHost for ValueTileHost<'_> {
    fn lend(&mut self, lane: usize, packet: &mut ValuePacket) -> bool {
        let Some(&ray) = self.rays.hits().get(self.next) else { return false };
        self.rays.pack(self.next, &self.grid, lane, &mut packet.way);
        self.next += 1;
        match self.frame.scene.mode {
            Mode::Mip | Mode::Minip => {
                packet.numbers[0][lane] = self.summary.best(self.rays.gathered.value[usize::from(ray)]);
            }
            Mode::Iso => [packet.numbers[0][lane], packet.numbers[1][lane]] = self.bounds(ray),
            Mode::Mean | Mode::Dvr | Mode::Slice => {}
        }
        true
    }

    fn take_back(&mut self, lane: usize, packet: &ValuePacket) {
        let (ray, number) = (packet.way.rays[lane], packet.numbers[0][lane]);
        match self.frame.scene.mode {
            Mode::Mip | Mode::Minip if number > f32::NEG_INFINITY => {
                self.found(ray, self.summary.numbers.value(number))
            }
            Mode::Mean => {
                let [t0, t1] = self.rays.interval(ray);
                self.add_integral(usize::from(ray), packet.numbers.map(|number| number[lane]), t1 - t0);
            }
            _ => {}
        }
    }

    #[cold]
    fn settle(&mut self, ray: u16, base: i32) {
        let cast_ray = cast_ray(self.frame, self.rays, self.corner, ray);
        let place = usize::from(ray);
        let mut state = self.rays.gathered.state(place);
        let base = usize::try_from(base).expect("cells of a brick lie behind its first voxel");
        let (key, brick) = self.at;
        let level = LevelVisit::new(&self.frame.scene, &cast_ray, key);
        let t = self.rays.interval(ray);
        match self.frame.scene.mode {
            Mode::Iso => gather_exact_cell(level, brick, key, base, t, &mut state),
            _ => gather_exact_value_cell(level, (key, brick), base, t, &mut state),
        }
        self.rays.gathered.set_state(place, &state);
        self.rays.crossings.extend(state.crossings.drain(..).map(|crossing| (ray, crossing)));
        if self.frame.scene.is_done(&state) {
            self.rays.end(place);
        }
    }

    fn pass(&mut self, ray: u16, range: [f32; 2]) -> bool {
        let thresholds = self.summary.thresholds.iter().copied();
        self.rays.gathered.iso[usize::from(ray)].pass(range, thresholds)
    }

    fn bounds(&self, ray: u16) -> [f32; 2] {
        if self.rays.is_going(usize::from(ray)) {
            self.summary.bounds(self.rays.gathered.iso[usize::from(ray)])
        } else {
            [f32::NEG_INFINITY, f32::INFINITY]
        }
    }
}
