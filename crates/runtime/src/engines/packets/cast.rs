//! Tiles of rays through the bricks of a view: the packet caster's pass.
//!
//! ```text
//! tile of 16 x 16 rays -> bricks, front to back -> packets of those that meet the brick -> cells -> pixels
//! ```
//!
//! Protocol as in [`super`]: a tile keeps the gathered state of its rays only while some of them wait.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use supervol_format::brick::APRON;
use supervol_format::{BrickKey, Lod};
use supervol_scene::camera::{PixelRays, Projection};
use supervol_scene::clip::{IndexRay, Segment, ToIndex};
use supervol_scene::scene::Mode;
use supervol_scene::transfer_function::TransferFunction;
use supervol_scene::transfer_function::pieces::{CHANNELS, Column, TransferPieces};

use super::begin::MakeRays;
use super::fetch::Stored;
use super::leap::{Ahead, ProximityCloud};
use super::levels::{LevelErrors, TileErrors, errors_of};
use super::lookup::{FewPieces, Lookup, ManyPieces};
use super::order::{View, push_children, region_of, ways_through};
use super::packet::{Classifier, ClassifyTask, Host, Precision, Queues, cast};
use super::parts::{PartsAhead, begin_next_part, has_ended, is_in_picture, part_of_ray, rays_in_picture};
use super::per_brick::{PerBrick, bytes_kept};
use super::pixels::{FinishedTile, Tile, pixels_of_tile};
use super::plans::{BrickPlan, BrickPlans};
use super::shade::PacketLighting;
use super::silhouette::{MakeSilhouette, MeetSilhouette, Projector, Silhouette};
use super::simd::{InstructionSet, Simd, Task, dispatch};
use super::span::ChooseSpan;
use super::tile::{BrickGrid, Gathered, IndexBox, TILE_RAYS, TILE_SIDE, TileRays, place_of};
use super::value_tiles::{BrickSummaries, BrickSummary};
use super::walk::{Packet, PacketBrick};
use super::work::{NO_WORK, TileWork};
use super::{BlockFeedback, CpuFrame, MAX_ERROR_LIMITS, Made, PacketRule, RayCounters, Skipping};
use crate::engines::blocks::BLOCK;
use crate::engines::cells::walk::AxisRay;
use crate::engines::cells::{CastRay, LevelVisit, exact_cell};
use crate::lod::deviation::Deviation;
use crate::stream::budget::{Bands, CasterBytes};
use crate::stream::residency::{BrickView, DecodedBrick, Resident, Voxels};

/// Most tiles per task. Tiles differ much in cost, and idle threads take over tasks.
const TASK_TILES: usize = 8;

/// Peak factor of data derived from a brick, times its bytes: the data, its source, and dropped data that a thread
/// still uses.
const MAKING: u64 = 4;

/// Look-up tables of packets, shared by all rays of a frame.
#[derive(Debug)]
pub struct PacketTables {
    pieces: TransferPieces,
    /// The render value that packets and their pieces subtract.
    pub(super) origin: f32,
    table: Table,
    pub(super) set: InstructionSet,
    precision: Precision,
    /// Requested error of a pixel, 1 is white.
    max_error: f64,
    view: View,
    pub(super) pixel_rays: PixelRays,
    pub(super) to_index: ToIndex,
    /// Plans of bricks, in mode `dvr`.
    pub(super) plans: Arc<BrickPlans>,
    projector: Projector,
    /// Silhouettes of bricks, in mode `dvr`, where they pay.
    silhouettes: PerBrick<Option<Silhouette>>,
    /// Summaries of bricks, in all modes but `dvr`.
    pub(super) summaries: BrickSummaries,
    /// Deviations of bricks of coarser levels, if errors are summed up.
    pub(super) of_levels: PerBrick<Deviation>,
    /// Whether the work of each ray is counted.
    counts_work: bool,
}

/// Divisor of the memory for data derived from bricks: the share of deviations.
const LEVELS_SHARE: u64 = 8;
/// Divisor of the same memory: the share of silhouettes.
const SILHOUETTES_SHARE: u64 = 4;
/// Roundings of colour and of optical depth in a cell.
const ROUNDINGS: f64 = 4.0;
/// Half the distance of 1 from the next `f32`.
const HALF_EPSILON: f64 = 0.5 * f32::EPSILON as f64;

/// Most lanes for which look-ups in registers are not compiled: plain arrays have none.
const FEW_LANES: usize = 4;

/// The pieces in the smallest table that holds them.
#[derive(Debug)]
enum Table {
    UpTo16(Box<FewPieces<16>>),
    UpTo32(Box<FewPieces<32>>),
    Many,
}

impl Table {
    fn new(pieces: &TransferPieces) -> Self {
        let up_to_16 = FewPieces::new(pieces).map(|few| Self::UpTo16(Box::new(few)));
        let up_to_32 = || FewPieces::new(pieces).map(|few| Self::UpTo32(Box::new(few)));
        up_to_16.or_else(up_to_32).unwrap_or(Self::Many)
    }
}

/// Runs a task with the transfer-function table of a frame.
struct WithTable<'a, T> {
    tables: &'a PacketTables,
    task: T,
}

impl<T: ClassifyTask> Task for WithTable<'_, T> {
    type Output = T::Output;

    #[inline(always)]
    fn run<S: Simd>(self) -> T::Output {
        let Self { tables: PacketTables { pieces, table, .. }, task } = self;
        let TransferPieces { narrow, clear, .. } = *pieces;
        if S::LANES <= FEW_LANES {
            return task.run::<S, _>(&Classifier { table: &ManyPieces::new(pieces), narrow, clear });
        }
        match table {
            Table::UpTo16(few) => task.run::<S, _>(&Classifier { table: &**few, narrow, clear }),
            Table::UpTo32(few) => task.run::<S, _>(&Classifier { table: &**few, narrow, clear }),
            Table::Many => task.run::<S, _>(&Classifier { table: &ManyPieces::new(pieces), narrow, clear }),
        }
    }
}

impl PacketTables {
    /// The tables of a frame.
    pub fn new(frame: &CpuFrame, source: &TransferFunction, rule: PacketRule, (made_bytes, plans): Made) -> Self {
        let max_error = rule.max_error.clamp(MAX_ERROR_LIMITS[0], MAX_ERROR_LIMITS[1]);
        let origin = origin_of(source, frame.map.shift);
        let pieces = TransferPieces::new(source, frame.map.shift + f64::from(origin), FIT_SHARE * max_error);
        let precision = precision_of(max_error, pieces.has_steps(), rule.sums_errors);
        let for_levels = if rule.sums_errors { made_bytes / LEVELS_SHARE } else { 0 };
        let for_silhouettes = if frame.mode == Mode::Dvr { made_bytes / SILHOUETTES_SHARE } else { 0 };
        let for_bricks = made_bytes - for_levels - for_silhouettes;
        let set = rule.instructions.unwrap_or_else(InstructionSet::best);
        let ray = frame.camera.ray(0, 0);
        let index_ray = IndexRay::new(&ray, &frame.geometry);
        let view = match frame.camera.projection {
            Projection::Perspective { .. } => View::Eye(DVec3::from_array(index_ray.origin)),
            Projection::Orthographic { .. } => View::Direction(DVec3::from_array(index_ray.direction)),
        };
        Self {
            table: Table::new(&pieces),
            pieces,
            origin,
            set,
            precision,
            max_error,
            view,
            pixel_rays: frame.camera.rays(),
            to_index: ToIndex::new(&frame.geometry),
            // A frame has one mode, so only one of the two is filled.
            plans: BrickPlans::new(plans, frame, (source, rule), for_bricks),
            projector: Projector::new(&frame.camera, &frame.geometry),
            silhouettes: PerBrick::new(for_silhouettes),
            summaries: BrickSummaries::new(for_bricks),
            of_levels: PerBrick::new(for_levels),
            counts_work: rule.counts_work,
        }
    }

    /// The instruction set of the packets.
    pub fn instructions(&self) -> InstructionSet {
        self.set
    }

    /// Whether the errors of cells are summed up.
    pub fn sums_errors(&self) -> bool {
        self.precision.sums_errors
    }

    /// Whether the work of each ray is counted.
    pub fn counts_work(&self) -> bool {
        self.counts_work
    }

    /// Bound on the light left out behind the end of a ray that ends early, 1 is white.
    pub fn end_error(&self) -> f64 {
        f64::from(self.precision.last_transmittance)
    }

    /// See [`fit_error`].
    pub fn fit_error(&self) -> f64 {
        fit_error(self.max_error)
    }

    /// See [`rounding_error`].
    pub fn rounding_error(&self, frame: &CpuFrame) -> f64 {
        rounding_error(frame.pyramid.layout().core())
    }

    /// See [`own_error`].
    pub fn own_error(&self, frame: &CpuFrame, opacity: f64) -> f64 {
        // For surfaces, as in mode `iso`, it is only known that they aim at the requested error.
        own_error(frame.mode, opacity, (self.max_error, frame.inner.is_some()), frame.pyramid.layout().core())
    }

    /// Number of cells of a brick to integrate together, for rays along this direction.
    pub(super) fn choose_span(
        &self,
        frame: &CpuFrame,
        (key, brick): (BrickKey, &DecodedBrick),
        direction: [f32; 3],
    ) -> usize {
        let (brick, _) = self.packet_brick(frame, key, brick);
        self.dispatch(ChooseSpan { brick: &brick, precision: self.precision, direction })
    }

    /// A brick with values relative to the pieces' origin: see [`packet_brick`].
    fn packet_brick<'a>(
        &self,
        frame: &CpuFrame,
        key: BrickKey,
        brick: &'a DecodedBrick,
    ) -> (PacketBrick<'a>, BrickGrid) {
        let (packet_brick, grid) = packet_brick(frame, key, brick);
        let [centre, scale, offset] = packet_brick.stored.to_values_from(self.origin, &frame.map);
        (PacketBrick { centre, scale, offset, ..packet_brick }, grid)
    }

    /// Direction of rays through a brick's middle, in cells per world length.
    pub(super) fn direction_through(&self, frame: &CpuFrame, key: BrickKey) -> [f32; 3] {
        let scale = frame.pyramid.level_at(key.lod()).scale.map(|s| s as f64);
        let core = frame.pyramid.core_box(key);
        let middle = DVec3::from_array(std::array::from_fn(|a| scale[a] * 0.5 * (core.start[a] + core.end[a]) as f64));
        let direction = match self.view {
            View::Direction(direction) => direction,
            View::Eye(eye) => middle - eye,
        };
        let world: DVec3 = frame.geometry.linear() * direction;
        let per_world = 1.0 / world.length();
        std::array::from_fn(|a| (direction[a] * per_world / scale[a]) as f32)
    }

    /// Runs a task with the frame's instructions and its table.
    fn dispatch<T: ClassifyTask>(&self, task: T) -> T::Output {
        dispatch(self.set, WithTable { tables: self, task })
    }

    /// Directions that rays may have in a brick, along each axis.
    pub(super) fn ahead(&self, frame: &CpuFrame, key: BrickKey) -> [Ahead; 3] {
        ways_through(&frame.pyramid, key, self.view)
    }
}

/// Share of the requested error for one cell: errors have both signs, and few cells of a ray are near it.
const CELL_SHARE: f64 = 0.28;
/// Greatest error for which the share holds. For greater errors, fewer cells are cut into parts far below the limit,
/// and more cells of a ray are near it.
const FULL_SHARE_UP_TO: f64 = 0.5 / 255.0;
/// Power of the error with which the share falls above that.
const FALL_OF_SHARE: f64 = 1.0 / 6.0;
/// Share of the requested error for the fit of extinction, relative to the extinction.
pub(crate) const FIT_SHARE: f64 = 0.25;
/// Share of the requested error for light left out behind the end of a ray.
pub(crate) const END_SHARE: f64 = 0.15;

/// Share of the requested error: cells with less light are not shaded.
pub(crate) const LEAST_SHADED_SHARE: f64 = 5e-4;

/// The middle of the transfer function's window, if it lies far from zero compared with its width: `f32` then resolves
/// it.
fn origin_of(source: &TransferFunction, shift: f64) -> f32 {
    let points = source.points();
    let (first, last) = (points[0].value - shift, points[points.len() - 1].value - shift);
    let middle = 0.5 * first + 0.5 * last;
    let is_far = middle.is_finite() && middle.abs() > last - first;
    if is_far { middle as f32 } else { 0.0 }
}

/// Error from `f32` of a ray that has gathered light, 1 is white: sums over the cells of a brick with `core` voxels
/// along an edge.
pub(crate) fn rounding_error(core: usize) -> f64 {
    // A ray leaves a cell through a plane of voxels.
    let cells_per_brick = 3 * core + 1;
    ROUNDINGS * cells_per_brick as f64 * HALF_EPSILON
}

/// Error of a ray from the fit of the transfer function's pieces, for this requested error. Extinction and emission are
/// each off by at most [`FIT_SHARE`] of it, relative to the extinction, and a ray gathers at most one whole.
pub(crate) fn fit_error(max_error: f64) -> f64 {
    2.0 * FIT_SHARE * max_error
}

/// Error not caused by single cells: that of a ray of this opacity in mode `dvr`, and the requested error in mode
/// `iso`. With `only_aims`, other parts of the picture also only aim at the requested error. `core`: see
/// [`rounding_error`].
pub(crate) fn own_error(mode: Mode, opacity: f64, (max_error, only_aims): (f64, bool), core: usize) -> f64 {
    let aimed_at = if only_aims || mode == Mode::Iso { max_error } else { 0.0 };
    match mode {
        Mode::Dvr if opacity > 0.0 => fit_error(max_error) * opacity + rounding_error(core) + aimed_at,
        Mode::Iso if opacity > 0.0 => aimed_at,
        _ => 0.0,
    }
}

/// Largest error of one cell, for this requested error of a pixel.
pub(crate) fn cell_error(max_error: f64) -> f64 {
    CELL_SHARE * max_error * (FULL_SHARE_UP_TO / max_error).min(1.0).powf(FALL_OF_SHARE)
}

fn precision_of(max_error: f64, has_steps: bool, sums_errors: bool) -> Precision {
    Precision {
        cell_error: cell_error(max_error) as f32,
        last_transmittance: (END_SHARE * max_error) as f32,
        least_shaded: (LEAST_SHADED_SHARE * max_error) as f32,
        has_steps,
        sums_errors,
    }
}

/// Host memory of packets beside their tables; `core`: voxels along an edge of a full brick's core.
#[must_use]
pub fn bytes_held(core: usize, rule: PacketRule) -> CasterBytes {
    let made = (BrickPlan::most_bytes(core) + Silhouette::most_bytes(core)).max(BrickSummary::most_bytes(core));
    let made_of_brick = bytes_kept(made);
    let gathered = size_of::<Gathered>()
        + if rule.sums_errors { size_of::<LevelErrors>() } else { 0 }
        + if rule.counts_work { size_of::<TileWork>() } else { 0 };
    const { assert!(FinishedTile::BYTES <= size_of::<Gathered>()) };
    const { assert!(size_of::<TileErrors>() <= size_of::<LevelErrors>()) };
    CasterBytes {
        bands: Bands::Allowed,
        tile_side: TILE_SIDE,
        tile: (size_of::<Tile>() + gathered + size_of::<BlockFeedback>()) as u64,
        // A waiting tile that continues exists twice for a moment.
        thread: (size_of::<TileRays>() + PartsAhead::MOST_BYTES + size_of::<Queues>() + gathered) as u64
            + MAKING * made_of_brick,
        made_of_brick,
        // Each map, and a copy for the caller.
        of_pixel: (u64::from(rule.sums_errors) + u64::from(rule.counts_work)) * 2 * size_of::<[f32; 4]>() as u64,
    }
}

/// Tiles along both sides of the rows of a frame.
#[must_use]
pub fn tiles_of(frame: &CpuFrame) -> [u32; 2] {
    [frame.camera.width.div_ceil(TILE_SIDE), (frame.rows.len() as u32).div_ceil(TILE_SIDE)]
}

/// Casts every unfinished ray as far as resident bricks allow. The first tile makes progress even after the deadline:
/// otherwise late passes would neither cast a ray nor ask for a brick.
pub(super) fn cast_tiles(
    view: &dyn BrickView,
    frame: &CpuFrame,
    tables: &PacketTables,
    tiles: &mut [Tile],
) -> Vec<BlockFeedback> {
    let columns = tiles_of(frame)[0] as usize;
    let has_begun = AtomicBool::new(false);
    let pass = tiles.par_iter_mut().enumerate().with_max_len(TASK_TILES).map_init(
        || (Box::new(TileRays::new()), Box::new(Queues::new())),
        |(rays, queues), (index, tile)| {
            let mut feedback = BlockFeedback::default();
            if matches!(tile, Tile::Finished(_)) {
                return feedback;
            }
            if has_begun.swap(true, Ordering::Relaxed) && frame.is_due() {
                feedback.is_stopped = true;
                return feedback;
            }
            let corner = [index % columns, index / columns].map(|i| i as u32 * TILE_SIDE);
            begin_tile((frame, tables), corner, tile, rays, &mut feedback);
            let begun = rays.going();
            if begun > 0 {
                dispatch(tables.set, BoundRays(rays));
                CastTile { view, frame, tables, corner, rays, queues, feedback: &mut feedback }.run();
            }
            while frame.cuts_rays() && begin_next_part((frame, tables), corner, rays) {
                dispatch(tables.set, BoundRays(rays));
                CastTile { view, frame, tables, corner, rays, queues, feedback: &mut feedback }.run();
            }
            *tile = end_tile((frame, tables), rays);
            feedback.counters.rays_waiting += tile.waiting();
            feedback.counters.rays_finished += match (frame.cuts_rays(), &*tile) {
                (false, tile) => begun as u64 - tile.waiting(),
                (true, Tile::Finished(_)) => rays_in_picture(frame, corner),
                (true, Tile::Fresh | Tile::Waiting(_)) => 0,
            };
            frame.count_finished(feedback.counters.rays_finished);
            feedback
        },
    );
    pass.collect()
}

/// Creates the rays of a tile; rays that miss the volume count as finished.
fn begin_tile(
    (frame, tables): (&CpuFrame, &PacketTables),
    corner: [u32; 2],
    tile: &Tile,
    rays: &mut TileRays,
    feedback: &mut BlockFeedback,
) {
    rays.clear();
    let waiting = match tile {
        Tile::Waiting(gathered) => Some(gathered),
        _ => None,
    };
    if let Some(gathered) = waiting {
        rays.gathered = (**gathered).clone();
        rays.gathered.waiting = [None; TILE_RAYS];
    }
    if frame.deviations.is_some() && rays.gathered.levels.is_none() {
        rays.gathered.levels = Some(Box::new(LevelErrors::NONE));
    }
    if tables.counts_work && rays.gathered.work.is_none() {
        rays.gathered.work = Some(Box::new(NO_WORK));
    }
    let is_asked = |ray: usize| {
        is_in_picture(frame, corner, ray) && waiting.is_none_or(|gathered| gathered.waiting[ray].is_some())
    };
    if frame.cuts_rays() {
        for ray in (0..TILE_RAYS).filter(|&ray| is_asked(ray)) {
            if let Some((index_ray, segment)) = part_of_ray((frame, tables), corner, rays, ray) {
                let t0 = waiting.map_or(segment.t0, |gathered| gathered.t[ray]);
                rays.set(ray, &index_ray, Segment { t0, ..segment });
            }
        }
        return;
    }
    let PacketTables { pixel_rays, to_index, set, .. } = tables;
    let corner = [corner[0], frame.rows.start + corner[1]];
    let dims = frame.pyramid.level_at(Lod::FINEST).dims;
    dispatch(*set, MakeRays { pixel_rays, to_index, clip: &frame.clip, dims, corner, rays });
    if let Some(gathered) = waiting {
        rays.gathered.t = gathered.t;
    }
    feedback.counters.rays_finished += rays.keep(is_asked);
}

/// Computes the bounds of a tile's rays.
struct BoundRays<'a>(&'a mut TileRays);

impl Task for BoundRays<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        self.0.bound();
    }
}

fn end_tile((frame, tables): (&CpuFrame, &PacketTables), rays: &TileRays) -> Tile {
    let gathered = &rays.gathered;
    if gathered.waiting.iter().any(Option::is_some) {
        return Tile::Waiting(Box::new(gathered.clone()));
    }
    let terminated_early = (0..TILE_RAYS).filter(|&ray| has_ended((frame, tables), gathered, ray)).count() as u64;
    let pixels = pixels_of_tile(frame, gathered);
    let errors = errors_of(frame, tables, gathered, &pixels);
    let work = gathered.work.clone();
    Tile::Finished(Box::new(FinishedTile { pixels, terminated_early, errors, work }))
}

/// Casts a tile through all bricks.
pub(super) struct CastTile<'a> {
    pub(super) view: &'a dyn BrickView,
    pub(super) frame: &'a CpuFrame,
    pub(super) tables: &'a PacketTables,
    /// First pixel of the tile, counted in the frame's rows.
    pub(super) corner: [u32; 2],
    pub(super) rays: &'a mut TileRays,
    pub(super) queues: &'a mut Queues,
    pub(super) feedback: &'a mut BlockFeedback,
}

impl CastTile<'_> {
    /// Casts as far as resident bricks allow. When the stop condition is due, and at least one brick is done, rays wait
    /// for the next brick they meet. Their gathered light stays.
    fn run(mut self) {
        let mut has_come_some_way = false;
        let pyramid = &self.frame.pyramid;
        let mut stack = vec![BrickKey::new(pyramid.coarsest(), supervol_format::BrickIndex([0; 3]))];
        while let Some(key) = stack.pop() {
            if self.rays.going() == 0 {
                break;
            }
            let region = region_of(pyramid, key);
            if !self.rays.may_meet(&region) {
                continue;
            }
            let is_wanted = key.lod() <= self.frame.first_lod && self.frame.lod.is_fine_enough(pyramid, key);
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

/// The next step of rays after a brick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Visit {
    Done,
    GoesOnBeneath,
}

impl CastTile<'_> {
    /// Casts the rays that meet a brick through it, or lets them wait for it.
    fn visit(&mut self, wanted: BrickKey) -> Visit {
        let counters = &mut self.feedback.counters;
        let hits = self.rays.hits().len() as u64;
        let mut key = wanted;
        let mut resident = self.view.lookup(key);
        while let (Resident::UseParent, Some(parent)) = (resident, self.frame.pyramid.parent(key)) {
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

    /// Casts the rays that meet a brick through its resident data.
    pub(super) fn go_through(&mut self, key: BrickKey, resident: Resident<'_>) {
        let is_dvr = self.frame.mode == Mode::Dvr;
        match &self.frame.inner {
            Some(surfaces) => self.cast_around_surfaces(key, resident, surfaces),
            None if is_dvr => self.cast_resident(key, resident),
            None => self.gather_resident(key, resident),
        }
    }

    /// Gathers light in the resident data of a brick.
    pub(super) fn cast_resident(&mut self, key: BrickKey, resident: Resident<'_>) {
        match resident {
            Resident::Brick(brick) => self.cast_brick(key, brick),
            Resident::Uniform(value) => self.cast_uniform(value),
            Resident::Nothing | Resident::TooCoarse | Resident::UseParent | Resident::Missing => {}
        }
    }

    /// Gathers values, or meets surfaces, in the resident data of a brick.
    pub(super) fn gather_resident(&mut self, key: BrickKey, resident: Resident<'_>) {
        match resident {
            Resident::Brick(brick) => self.gather_brick(key, brick),
            Resident::Uniform(value) => self.gather_uniform(key, value),
            Resident::Nothing | Resident::TooCoarse | Resident::UseParent => self.gather_nothing(),
            Resident::Missing => {}
        }
    }

    /// Casts all rays through a uniform value.
    fn cast_uniform(&mut self, value: f32) {
        let pieces = &self.tables.pieces;
        let value = value - self.tables.origin;
        let piece = pieces.column(Column::Knot, 0)[..pieces.count()].iter().rposition(|&k| k <= value).unwrap_or(0);
        let y = value - pieces.column(Column::Anchor, 0)[piece];
        let [kappa, emission @ ..]: [f32; CHANNELS] = std::array::from_fn(|c| {
            let of = |column| pieces.column(column, c)[piece];
            of(Column::Value) + y * (2.0 * of(Column::HalfSlope) + y * 3.0 * of(Column::ThirdBend))
        });
        if kappa <= 0.0 {
            return;
        }
        let last = f64::from(self.tables.precision.last_transmittance);
        for i in 0..self.rays.hits().len() {
            let ray = self.rays.hits()[i];
            let [entry, exit] = self.rays.interval(ray);
            let transmittance = (-f64::from(kappa) * (exit - entry)).exp();
            let color = emission.map(|e| e / kappa * (1.0 - transmittance) as f32);
            self.rays.add(ray, color, transmittance as f32, last);
        }
        self.feedback.counters.cells += self.rays.hits().len() as u64;
    }

    /// Removes the rays that miss all visible parts of a brick: each has leapt over it.
    fn leave_out_unseen(&mut self, key: BrickKey, cloud: &ProximityCloud<BLOCK>, grid: &BrickGrid) {
        let (frame, tables) = (self.frame, self.tables);
        let projector = &tables.projector;
        let make = || dispatch(tables.set, MakeSilhouette { projector, grid, cloud });
        let bytes = |made: &Option<Silhouette>| made.as_ref().map_or(0, Silhouette::bytes);
        let made = tables.silhouettes.of(frame.field.brick(key), bytes, make);
        let Some(silhouette) = made.as_ref() else { return };
        let corner = [self.corner[0], frame.rows.start + self.corner[1]];
        let before = self.rays.hits().len();
        dispatch(tables.set, MeetSilhouette { silhouette, projector, corner, rays: self.rays });
        self.feedback.counters.macro_cells_skipped += (before - self.rays.hits().len()) as u64;
    }

    fn cast_brick(&mut self, key: BrickKey, brick: &DecodedBrick) {
        let (frame, tables) = (self.frame, self.tables);
        let plan = tables.plans.of(frame, tables, key, brick);
        if plan.cloud.is_empty() && frame.skipping == Skipping::On {
            self.feedback.counters.macro_cells_skipped += self.rays.hits().len() as u64;
            return;
        }
        let (packet_brick, grid) = tables.packet_brick(frame, key, brick);
        // Between surfaces rays advance piece by piece; the look-up would be repeated for each.
        if plan.leaps && frame.inner.is_none() {
            self.leave_out_unseen(key, &plan.cloud, &grid);
            if self.rays.hits().is_empty() {
                return;
            }
        }
        let lighting = frame.lighting.as_ref().map(|lighting| {
            let level_scale = frame.pyramid.level_at(key.lod()).scale;
            PacketLighting::new(lighting, &frame.geometry, level_scale, packet_brick.scale)
        });
        let cloud = plan.leaps.then_some(&plan.cloud);
        let packet_brick = PacketBrick { cloud, span: plan.span, lighting, ..packet_brick };
        let host = TileHost { frame, tables, key, brick, grid, corner: self.corner, rays: self.rays, next: 0 };
        let work = tables.dispatch(CastBrick { packet_brick, host, queues: self.queues });
        self.feedback.counters.add(&work);
    }
}

/// Casts a ray of a tile, whose first pixel is `corner`, through the current brick with the scalar caster.
pub(super) fn cast_ray(
    frame: &CpuFrame,
    tables: &PacketTables,
    rays: &TileRays,
    corner: [u32; 2],
    ray: u16,
) -> CastRay {
    let [t0, t1] = rays.interval(ray);
    let to_eye = if frame.lighting.is_some() {
        let place = place_of(usize::from(ray));
        let [x, y] = [corner[0] + place[0], frame.rows.start + corner[1] + place[1]];
        -tables.pixel_rays.ray(x, y).direction.as_vec3()
    } else {
        Vec3::ZERO
    };
    CastRay { axis_ray: AxisRay::new(&rays.index_ray(ray)), to_eye, segment: Segment { t0, t1 }, pixel: [0; 2] }
}

/// A brick in the form that packets read, with stored numbers, without a cloud and unshaded; and its grid.
///
/// # Panics
/// If the brick's size does not match the pyramid.
pub(super) fn packet_brick<'a>(
    frame: &CpuFrame,
    key: BrickKey,
    brick: &'a DecodedBrick,
) -> (PacketBrick<'a>, BrickGrid) {
    let extent = brick.extent.map(|n| n as usize);
    let core = frame.pyramid.core_box(key);
    assert_eq!(extent, core.extent().map(|n| n + 2 * APRON), "stored extent of {key}");
    let (voxels, stored, count): (*const u8, _, _) = match &brick.voxels {
        Voxels::U8(v) => (v.as_ptr(), Stored::U8, v.len()),
        Voxels::U16(v) => (v.as_ptr().cast(), Stored::U16, v.len()),
        Voxels::F32(v) => (v.as_ptr().cast(), Stored::F32, v.len()),
    };
    assert_eq!(count, extent.iter().product::<usize>(), "voxels of {key}");
    let level = frame.pyramid.level_at(key.lod());
    let grid = BrickGrid { inverse_scale: level.scale.map(|s| 1.0 / s as f64), start: core.start.map(|s| s as f64) };
    let packet_brick = PacketBrick {
        voxels,
        stored,
        strides: [extent[0] as i32, (extent[0] * extent[1]) as i32],
        core: core.extent().map(|n| n as i32),
        centre: 0.0,
        scale: 1.0,
        offset: 0.0,
        span: 1,
        absent: frame.map.absent,
        cloud: None,
        lighting: None,
    };
    (packet_brick, grid)
}

/// Finds the rays of a tile that meet a region.
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

/// Casts the rays of a tile that meet a brick, packet by packet.
struct CastBrick<'a> {
    packet_brick: PacketBrick<'a>,
    host: TileHost<'a>,
    queues: &'a mut Queues,
}

impl ClassifyTask for CastBrick<'_> {
    type Output = RayCounters;

    #[inline(always)]
    fn run<S: Simd, L: Lookup>(mut self, classifier: &Classifier<'_, L>) -> RayCounters {
        let precision = self.host.tables.precision;
        // SAFETY: `packet_brick` compared strides, core and length of the voxels.
        unsafe { cast::<S, L>(&self.packet_brick, classifier, precision, self.queues, &mut self.host) }
    }
}

/// Host of the rays of a tile that meet a brick.
struct TileHost<'a> {
    frame: &'a CpuFrame,
    tables: &'a PacketTables,
    key: BrickKey,
    brick: &'a DecodedBrick,
    grid: BrickGrid,
    /// First pixel of the tile, in the frame's rows.
    corner: [u32; 2],
    rays: &'a mut TileRays,
    /// The next hit to lend.
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
        self.rays.add(packet.rays[lane], color, packet.transmittance[lane], last);
    }

    /// By roots in `f64`.
    #[cold]
    fn integrate_exactly(&mut self, ray: u16, base: i32) -> [f32; 4] {
        let t = self.rays.interval(ray);
        let ray = cast_ray(self.frame, self.tables, self.rays, self.corner, ray);
        let base = usize::try_from(base).expect("cells of a brick lie behind its first voxel");
        exact_cell(LevelVisit::new(self.frame, &ray, self.key), self.brick, self.key, base, t)
    }
}
