//! A tile of rays through the bricks of a view, front to back; mode `dvr` in each brick.

use glam::Vec3;
use supervol_format::cast::single;
use supervol_format::{BrickIndex, BrickKey, Lod};
use supervol_scene::clip::Segment;
use supervol_scene::scene::Mode;
use supervol_scene::transfer_function::pieces::{CHANNELS, Column};

use super::frame::PacketFrame;
use super::leap::ProximityCloud;
use super::lookup::PieceLookup;
use super::order::{push_children, region_of};
use super::packet::{ClassifyTask, Host, PacketTransfer, Queues, cast};
use super::places::place_of;
use super::shade::PacketLighting;
use super::silhouette::{MakeSilhouette, MeetSilhouette, Silhouette};
use super::simd::{Simd, Task, dispatch};
use super::tables::PacketTables;
use super::tile::{BrickGrid, IndexBox, TileRays};
use super::walk::{Packet, PacketBrick};
use crate::engines::blocks::BLOCK;
use crate::engines::cells::bounded::{Seen, bounded_cell};
use crate::engines::cells::walk::AxisRay;
use crate::engines::cells::{CastRay, LevelVisit};
use crate::engines::feedback::BlockFeedback;
use crate::stream::classify::Skipping;
use crate::stream::counters::RayCounters;
use crate::stream::residency::{BrickView, DecodedBrick, Resident};

/// A tile through all bricks.
pub(super) struct CastTile<'a> {
    pub(super) view: &'a dyn BrickView,
    pub(super) frame: &'a PacketFrame,
    pub(super) tables: &'a PacketTables,
    /// First pixel of the tile, counted in the frame's rows.
    pub(super) corner: [u32; 2],
    pub(super) rays: &'a mut TileRays,
    pub(super) queues: &'a mut Queues,
    pub(super) feedback: &'a mut BlockFeedback,
}

impl CastTile<'_> {
    /// Casts the rays as far as resident bricks allow. At a stop, each ray waits for its next brick and keeps its
    /// result. At least one brick is visited before.
    pub(super) fn run(mut self) {
        self.find_faces();
        let mut has_come_some_way = false;
        let pyramid = &self.frame.scene.pyramid;
        let mut stack = vec![BrickKey::new(pyramid.coarsest(), BrickIndex([0; 3]))];
        while let Some(key) = stack.pop() {
            if self.rays.going() == 0 {
                break;
            }
            let region = region_of(pyramid, key);
            if !self.rays.may_meet(&region) {
                continue;
            }
            let is_wanted =
                key.lod() <= self.frame.scene.first_lod && self.frame.scene.lod.is_fine_enough(pyramid, key);
            if !is_wanted {
                push_children(pyramid, key, self.tables.view, &mut stack);
                continue;
            }
            if dispatch(self.tables.set, Enter { rays: self.rays, region: &region }) == 0 {
                continue;
            }
            if has_come_some_way && (self.feedback.is_stopped || self.frame.is_due()) {
                self.feedback.is_stopped = true;
                self.rays.wait(key);
                continue;
            }
            match self.visit(key) {
                Visit::Done => has_come_some_way = true,
                Visit::GoesOnBeneath => push_children(pyramid, key, self.tables.view, &mut stack),
            }
        }
    }
}

/// Continuation of the rays after a brick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Visit {
    Done,
    GoesOnBeneath,
}

impl CastTile<'_> {
    /// The rays that meet a brick go through it, or wait for it.
    fn visit(&mut self, wanted: BrickKey) -> Visit {
        let counters = &mut self.feedback.counters;
        let hits = self.rays.hits().len() as u64;
        let mut key = wanted;
        let mut resident = self.view.lookup(key);
        while let (Resident::UseParent, Some(parent)) = (resident, self.frame.scene.pyramid.parent(key)) {
            counters.parent_bricks += hits;
            key = parent;
            resident = self.view.stand_in(key);
        }
        if matches!(resident, Resident::TooCoarse) && key == wanted && wanted.lod() > Lod::FINEST {
            return Visit::GoesOnBeneath;
        }
        counters.bricks += hits;
        if let Resident::Missing = resident {
            let entry = self.feedback.misses.entry(key).or_insert((0, f64::INFINITY));
            for &ray in self.rays.hits() {
                *entry = (entry.0 + 1, entry.1.min(self.rays.interval(ray)[0]));
            }
            self.rays.wait(key);
            return Visit::Done;
        }
        self.feedback.uses.insert(key);
        let crossing = self.crossing(key, resident);
        match self.tables.counts_work {
            true => self.go_through_one_by_one(key, resident),
            false => self.go_through(key, resident),
        }
        if let Some(crossing) = crossing {
            self.note_levels(&crossing);
        }
        Visit::Done
    }

    /// The rays that meet a brick gather what there is of it.
    pub(super) fn go_through(&mut self, key: BrickKey, resident: Resident<'_>) {
        let is_dvr = self.frame.scene.mode == Mode::Dvr;
        match &self.frame.inner {
            Some(surfaces) => self.cast_around_surfaces(key, resident, surfaces),
            None if is_dvr => self.cast_resident(key, resident),
            None => self.gather_resident(key, resident),
        }
    }

    /// Rays gather light in what there is of a brick.
    pub(super) fn cast_resident(&mut self, key: BrickKey, resident: Resident<'_>) {
        match resident {
            Resident::Brick(brick) => self.cast_brick(key, &brick.read()),
            Resident::Uniform(value) => self.cast_uniform(key, value),
            Resident::Nothing | Resident::TooCoarse | Resident::UseParent | Resident::Missing => {}
        }
    }

    /// Rays gather values, or meet surfaces, in what there is of a brick.
    pub(super) fn gather_resident(&mut self, key: BrickKey, resident: Resident<'_>) {
        match resident {
            Resident::Brick(brick) => self.gather_brick(key, &brick.read()),
            Resident::Uniform(value) => self.gather_uniform(key, value),
            Resident::Nothing | Resident::TooCoarse | Resident::UseParent => self.gather_nothing(),
            Resident::Missing => {}
        }
    }

    /// Extinction and emission of a value.
    fn channels_at(&self, value: f32) -> [f32; CHANNELS] {
        let pieces = &self.tables.pieces;
        let value = value - self.tables.origin;
        let piece = pieces.column(Column::Knot, 0)[..pieces.count()].iter().rposition(|&k| k <= value).unwrap_or(0);
        let y = value - pieces.column(Column::Anchor, 0)[piece];
        std::array::from_fn(|c| {
            let of = |column| pieces.column(column, c)[piece];
            of(Column::Value) + y * (2.0 * of(Column::HalfSlope) + y * 3.0 * of(Column::ThirdBend))
        })
    }

    /// The container's own value of a brick that has one render value, which is rounded.
    fn unrounded_of_uniform(&self, key: BrickKey) -> Option<f64> {
        let map = &self.frame.scene.map;
        let known = if map.is_rounded { self.view.entry(key) } else { None };
        known.map(|known| map.data_of_container(known.entry.range.min))
    }

    /// Data value of a brick that has one render value.
    fn data_value_of_uniform(&self, key: BrickKey, value: f32) -> f64 {
        self.unrounded_of_uniform(key).unwrap_or_else(|| self.frame.scene.map.to_data(value))
    }

    /// Extinction and emission of a brick that has one render value. If that is rounded, the container's own value decides on which side
    /// of a step it lies.
    fn channels_of_uniform(&self, key: BrickKey, value: f32) -> [f32; CHANNELS] {
        match self.unrounded_of_uniform(key) {
            Some(value) => {
                let transfer_function = &self.frame.scene.data_transfer_function;
                let (color, alpha) = transfer_function.classify(value);
                let kappa = transfer_function.kappa(alpha);
                [kappa, kappa * color[0], kappa * color[1], kappa * color[2]].map(single)
            }
            None => self.channels_at(value),
        }
    }

    /// All rays see one value all the way.
    fn cast_uniform(&mut self, key: BrickKey, value: f32) {
        let modulation = &self.frame.scene.modulation;
        if modulation.ramp.is_some() {
            // Even values have no gradient: nothing shows.
            return;
        }
        if let Some(cuts) = &modulation.cuts {
            self.cast_uniform_behind_faces(key, self.data_value_of_uniform(key, value), cuts);
        }
        let [kappa, emission @ ..] = self.channels_of_uniform(key, value);
        if kappa <= 0.0 {
            return;
        }
        let last = f64::from(self.tables.precision.last_transmittance);
        for i in 0..self.rays.hits().len() {
            let ray = self.rays.hits()[i];
            let [entry, exit] = self.rays.interval(ray);
            let transmittance = (-f64::from(kappa) * (exit - entry)).exp();
            let color = emission.map(|e| e / kappa * single(1.0 - transmittance));
            self.rays.add(ray, color, single(transmittance), last);
        }
        self.feedback.counters.cells += self.rays.hits().len() as u64;
    }

    /// Leaves out the rays that miss all that shows of a brick: each has leapt over it.
    fn leave_out_unseen(&mut self, key: BrickKey, cloud: &ProximityCloud<BLOCK>, grid: &BrickGrid) {
        let (frame, tables) = (self.frame, self.tables);
        let projector = &tables.projector;
        let make = || dispatch(tables.set, MakeSilhouette { projector, grid, cloud });
        let bytes = |made: &Option<Silhouette>| made.as_ref().map_or(0, Silhouette::bytes);
        let made = tables.silhouettes.of(frame.scene.field.brick(key), bytes, make);
        let Some(silhouette) = made.as_ref() else { return };
        let corner = [self.corner[0], frame.scene.rows.start + self.corner[1]];
        let before = self.rays.hits().len();
        dispatch(tables.set, MeetSilhouette { silhouette, projector, corner, rays: self.rays });
        self.feedback.counters.macro_cells_skipped += (before - self.rays.hits().len()) as u64;
    }

    fn cast_brick(&mut self, key: BrickKey, brick: &DecodedBrick) {
        let (frame, tables) = (self.frame, self.tables);
        let modulation = &frame.scene.modulation;
        if let Some(cuts) = modulation.cuts.as_ref().filter(|_| modulation.ramp.is_none()) {
            self.cast_behind_faces((key, brick), cuts);
            if self.rays.hits().is_empty() {
                return;
            }
        }
        let plan = tables.plan(&frame.scene, key, brick);
        if plan.cloud.is_empty() && frame.scene.skipping == Skipping::On {
            self.feedback.counters.macro_cells_skipped += self.rays.hits().len() as u64;
            return;
        }
        let (packet_brick, grid) = tables.packet_brick(&frame.scene, key, brick);
        // With opacity by the gradient, cells are integrated in `f64`.
        if let Some(shown) = &plan.shown {
            if plan.leaps && frame.inner.is_none() {
                self.leave_out_unseen(key, &plan.cloud, &grid);
            }
            self.cast_modulated((key, brick), shown);
            return;
        }
        // Between surfaces rays are cast piece by piece: the silhouette would be looked up for each piece.
        if plan.leaps && frame.inner.is_none() {
            self.leave_out_unseen(key, &plan.cloud, &grid);
            if self.rays.hits().is_empty() {
                return;
            }
        }
        let lighting = frame.scene.lighting.as_ref().map(|lighting| {
            let level_scale = frame.scene.pyramid.level_at(key.lod()).scale;
            PacketLighting::new(lighting, &frame.scene.geometry, level_scale, packet_brick.scale)
                .with_rounded_values(packet_brick.rounding)
        });
        let cloud = plan.leaps.then_some(&plan.cloud);
        let walked = packet_brick.walked.with_cloud(cloud);
        let packet_brick = PacketBrick { walked, span: plan.span, lighting, ..packet_brick };
        let host = TileHost { frame, tables, key, brick, grid, corner: self.corner, rays: self.rays, next: 0 };
        let work = tables.dispatch(CastBrick { packet_brick, host, queues: self.queues });
        self.feedback.counters.add(&work);
    }
}

/// A ray of a tile whose first pixel is `corner`, on its way through the present brick, as the scalar caster takes it.
pub(super) fn cast_ray(frame: &PacketFrame, rays: &TileRays, corner: [u32; 2], ray: u16) -> CastRay {
    let [t0, t1] = rays.interval(ray);
    let to_eye = if frame.scene.lighting.is_some() {
        let place = place_of(usize::from(ray));
        let [x, y] = [corner[0] + place[0], frame.scene.rows.start + corner[1] + place[1]];
        -frame.tables.pixel_rays.ray(x, y).direction.as_vec3()
    } else {
        Vec3::ZERO
    };
    CastRay { axis_ray: AxisRay::new(&rays.index_ray(ray)), to_eye, segment: Segment { t0, t1 }, pixel: [0; 2] }
}

/// Which rays of a tile meet a region.
struct Enter<'a> {
    rays: &'a mut TileRays,
    region: &'a IndexBox,
}

impl Task for Enter<'_> {
    type Output = usize;

    #[inline(always)]
    fn run<S: Simd>(self) -> usize {
        self.rays.enter(self.region)
    }
}

/// The rays of a tile that meet a brick, packet by packet.
struct CastBrick<'a> {
    packet_brick: PacketBrick<'a>,
    host: TileHost<'a>,
    queues: &'a mut Queues,
}

impl ClassifyTask for CastBrick<'_> {
    type Output = RayCounters;

    #[inline(always)]
    fn run<S: Simd, L: PieceLookup>(mut self, classifier: &PacketTransfer<'_, L>) -> RayCounters {
        let precision = self.host.tables.precision;
        // SAFETY: the tile lends the parts of its rays between the faces of the brick (`TileRays::enter`), to which voxels and walk belong.
        unsafe { cast::<S, L>(&self.packet_brick, classifier, precision, self.queues, &mut self.host) }
    }
}

/// The rays of a tile that meet a brick.
struct TileHost<'a> {
    frame: &'a PacketFrame,
    tables: &'a PacketTables,
    key: BrickKey,
    brick: &'a DecodedBrick,
    grid: BrickGrid,
    /// First pixel of the tile, counted in the frame's rows.
    corner: [u32; 2],
    rays: &'a mut TileRays,
    /// The next hit that is lent.
    next: usize,
}

impl Host for TileHost<'_> {
    fn lend(&mut self, lane: usize, packet: &mut Packet) -> bool {
        let is_there = self.next < self.rays.hits().len();
        if is_there {
            self.rays.pack(self.next, &self.grid, lane, packet);
            self.next += 1;
        }
        is_there
    }

    fn take_back(&mut self, lane: usize, packet: &Packet) {
        let color = [0, 1, 2].map(|c| packet.color[c][lane]);
        let last = f64::from(self.tables.precision.last_transmittance);
        if self.tables.precision.sums_errors {
            self.rays.add_error(packet.rays[lane], packet.error[lane]);
        }
        self.rays.set_left(packet.rays[lane], packet.left[lane]);
        self.rays.add(packet.rays[lane], color, packet.transmittance[lane], last);
    }

    #[cold]
    fn integrate_in_f64(&mut self, ray: u16, base: i32, tolerance: f32, parts: &mut u64) -> Seen {
        let t = self.rays.interval(ray);
        let ray = cast_ray(self.frame, self.rays, self.corner, ray);
        let base = usize::try_from(base).expect("cells of a brick lie behind its first voxel");
        let level = LevelVisit::new(&self.frame.scene, &ray, self.key);
        bounded_cell(level, (self.key, self.brick), (base, t), f64::from(tolerance), parts)
    }
}
