//! Tables of a picture for all its packets, and kept data derived from bricks.

use std::sync::Arc;

use glam::DVec3;
use supervol_format::BrickKey;
use supervol_format::brick::APRON;
use supervol_format::cast::single;
use supervol_scene::camera::{PixelRays, Projection};
use supervol_scene::clip::{IndexRay, ToIndex};
use supervol_scene::scene::Mode;
use supervol_scene::transfer_function::TransferFunction;
use supervol_scene::transfer_function::pieces::TransferPieces;

use super::blocks::cloud_of_blocks;
use super::fetch::BrickVoxels;
use super::leap::{AxisDirection, ProximityCloud};
use super::levels::BrickDeviation;
use super::lookup::{FewPieces, ManyPieces};
use super::order::{RayOrigin, ways_through};
use super::packet::{ClassifyTask, PacketTransfer, Precision};
use super::per_brick::PerBrick;
use super::plans::{BrickPlan, BrickPlans, LEAST_LEAPT, Made};
use super::rule::PacketRule;
use super::silhouette::{Projector, Silhouette};
use super::simd::{InstructionSet, Simd, Task, dispatch};
use super::span::ChooseSpan;
use super::summaries::BrickSummaries;
use super::tile::BrickGrid;
use super::walk::{PacketBrick, WalkedBrick};
use crate::engines::blocks::BLOCK;
use crate::engines::cells::shown_cells::ShownCells;
use crate::engines::ray_scene::RayScene;
use crate::engines::rules::{
    BY_OPACITY, END_SHARE, FIT_SHARE, LEAST_SHADED_SHARE, MAX_ERROR_LIMITS, fit_error, reserve, rounding_error,
};
use crate::engines::value_error::tolerated;
use crate::stream::classify::Skipping;
use crate::stream::residency::DecodedBrick;

/// Tables for packets, the same for all rays of a frame.
#[derive(Debug)]
pub struct PacketTables {
    pub(super) pieces: TransferPieces,
    /// The render value from which packets and their pieces count.
    pub(super) origin: f32,
    table: PieceTable,
    pub(super) set: InstructionSet,
    pub(super) precision: Precision,
    /// Requested error of a pixel.
    pub(super) max_error: f64,
    /// Modes that gather values: error of a value that the picture allows, data units.
    pub(super) tolerated: f64,
    pub(super) view: RayOrigin,
    pub(super) pixel_rays: PixelRays,
    pub(super) to_index: ToIndex,
    /// Plans of bricks, in mode `dvr`.
    pub(super) plans: Arc<BrickPlans>,
    pub(super) projector: Projector,
    /// Silhouettes of bricks, in mode `dvr`; `None` if a silhouette costs more than it saves.
    pub(super) silhouettes: PerBrick<Option<Silhouette>>,
    /// Summaries of bricks, in all modes but `dvr`.
    pub(super) summaries: BrickSummaries,
    /// Errors of bricks of coarser levels, if errors are summed up.
    pub(super) of_levels: PerBrick<BrickDeviation>,
    /// Whether it is noted what each ray costs.
    pub(super) counts_work: bool,
}

/// Part of the memory for kept data that errors of coarser levels get, as a divisor.
const LEVELS_SHARE: u64 = 8;
/// The same for silhouettes.
const SILHOUETTES_SHARE: u64 = 4;

/// Lanes up to which look-ups in registers are not compiled: arrays have none.
const FEW_LANES: usize = 4;

/// The pieces in the smallest table that holds them.
#[derive(Debug)]
enum PieceTable {
    Few(Box<FewPieces>),
    Many,
}

impl PieceTable {
    fn new(pieces: &TransferPieces) -> Self {
        FewPieces::new(pieces).map_or(Self::Many, |few| Self::Few(Box::new(few)))
    }
}

/// A task that looks up the transfer function of a frame.
struct WithTable<'a, T> {
    tables: &'a PacketTables,
    task: T,
}

impl<T: ClassifyTask> Task for WithTable<'_, T> {
    type Output = T::Output;

    #[inline(always)]
    fn run<S: Simd>(self) -> T::Output {
        let Self { tables: PacketTables { pieces, table, .. }, task } = self;
        let TransferPieces { limits, clear, .. } = *pieces;
        if S::LANES <= FEW_LANES {
            return task.run::<S, _>(&PacketTransfer { table: &ManyPieces::new(pieces), limits, clear });
        }
        match table {
            PieceTable::Few(few) => task.run::<S, _>(&PacketTransfer { table: &**few, limits, clear }),
            PieceTable::Many => task.run::<S, _>(&PacketTransfer { table: &ManyPieces::new(pieces), limits, clear }),
        }
    }
}

impl PacketTables {
    /// The tables of a frame.
    pub fn new(scene: &RayScene, source: &TransferFunction, rule: PacketRule, (made_bytes, plans): Made) -> Self {
        let max_error = rule.max_error.clamp(MAX_ERROR_LIMITS[0], MAX_ERROR_LIMITS[1]);
        let (origin, pieces) = pieces_of(source, scene.map.shift, max_error);
        let precision = precision_of(max_error, scene.pyramid.layout().core(), rule.sums_errors);
        let for_levels = if rule.sums_errors { made_bytes / LEVELS_SHARE } else { 0 };
        let for_silhouettes = if scene.mode == Mode::Dvr { made_bytes / SILHOUETTES_SHARE } else { 0 };
        let for_bricks = made_bytes - for_levels - for_silhouettes;
        let set = rule.instructions.unwrap_or_else(InstructionSet::best);
        let ray = scene.camera.ray(0, 0);
        let index_ray = IndexRay::new(&ray, &scene.geometry);
        let view = match scene.camera.projection {
            Projection::Perspective { .. } => RayOrigin::Eye(DVec3::from_array(index_ray.origin)),
            Projection::Orthographic { .. } => RayOrigin::Direction(DVec3::from_array(index_ray.direction)),
        };
        Self {
            table: PieceTable::new(&pieces),
            pieces,
            origin,
            set,
            precision,
            max_error,
            tolerated: tolerated(source, max_error),
            view,
            pixel_rays: scene.camera.rays(),
            to_index: ToIndex::new(&scene.geometry),
            // A frame has one mode: only one of the two is filled.
            plans: BrickPlans::new(plans, scene, (source, rule), for_bricks),
            projector: Projector::new(&scene.camera, &scene.geometry),
            silhouettes: PerBrick::new(for_silhouettes),
            summaries: BrickSummaries::new(for_bricks),
            of_levels: PerBrick::new(for_levels),
            counts_work: rule.counts_work,
        }
    }

    /// The instructions that packets are cast with.
    pub fn instructions(&self) -> InstructionSet {
        self.set
    }

    /// Whether the errors of cells are summed up.
    pub fn sums_errors(&self) -> bool {
        self.precision.sums_errors
    }

    /// Whether it is noted what each ray costs.
    pub fn counts_work(&self) -> bool {
        self.counts_work
    }

    /// Largest light that is left out behind the end of a ray; 1 is white.
    pub fn end_error(&self) -> f64 {
        f64::from(self.precision.last_transmittance)
    }

    /// See [`fit_error`].
    pub fn fit_error(&self) -> f64 {
        fit_error(self.max_error)
    }

    /// See [`rounding_error`].
    pub fn rounding_error(&self, scene: &RayScene) -> f64 {
        rounding_error(scene.pyramid.layout().core())
    }

    /// How many cells of a brick to integrate together, where rays go along this direction.
    pub(super) fn choose_span(
        &self,
        scene: &RayScene,
        (key, brick): (BrickKey, &DecodedBrick),
        direction: [f32; 3],
    ) -> usize {
        let (brick, _) = self.packet_brick(scene, key, brick);
        self.dispatch(ChooseSpan { brick: &brick, precision: self.precision, direction })
    }

    /// A brick of values as the pieces count them: see [`packet_brick`].
    pub(super) fn packet_brick<'a>(
        &self,
        scene: &RayScene,
        key: BrickKey,
        brick: &'a DecodedBrick,
    ) -> (PacketBrick<'a>, BrickGrid) {
        let (packet_brick, grid) = packet_brick(scene, key, brick);
        let [centre, scale, offset] = packet_brick.voxels.stored().to_values_from(self.origin, &scene.map);
        (PacketBrick { centre, scale, offset, ..packet_brick }, grid)
    }

    /// Direction of rays through a brick's middle, in cells per world length.
    pub(super) fn direction_through(&self, scene: &RayScene, key: BrickKey) -> [f32; 3] {
        let scale = scene.pyramid.level_at(key.lod()).scale.map(|s| s as f64);
        let core = scene.pyramid.core_box(key);
        let middle = DVec3::from_array(std::array::from_fn(|a| scale[a] * 0.5 * (core.start[a] + core.end[a]) as f64));
        let direction = match self.view {
            RayOrigin::Direction(direction) => direction,
            RayOrigin::Eye(eye) => middle - eye,
        };
        let world: DVec3 = scene.geometry.linear() * direction;
        let per_world = 1.0 / world.length();
        std::array::from_fn(|a| single(direction[a] * per_world / scale[a]))
    }

    /// How to go through a brick.
    pub(super) fn plan(&self, scene: &RayScene, key: BrickKey, brick: &DecodedBrick) -> Arc<BrickPlan> {
        let ahead = self.ahead(scene, key);
        let direction = || self.direction_through(scene, key);
        self.plans.of(scene.field.brick(key), (ahead, direction), || self.make_plan(scene, (key, ahead), brick))
    }

    fn make_plan(
        &self,
        scene: &RayScene,
        (key, ahead): (BrickKey, [AxisDirection; 3]),
        brick: &DecodedBrick,
    ) -> BrickPlan {
        if scene.modulation.ramp.is_some() {
            let gradient = scene.world_from_level_gradient(key.lod());
            return self.plan_of(scene, ahead, brick, ShownCells::new(&scene.modulation, &gradient, &scene.map, brick));
        }
        let shows = |[low, high]: [f32; 2]| scene.transfer_function.is_visible(low, high);
        let cloud = cloud_of_blocks(brick, APRON, ahead, &scene.map, shows);
        let leaps = LEAST_LEAPT * cloud.cubes() as f64 <= cloud.hidden as f64;
        let may_span = !leaps && !self.plans.premises.is_lit;
        let span_along = may_span.then(|| self.direction_through(scene, key));
        let span = span_along.map_or(1, |along| self.choose_span(scene, (key, brick), along));
        BrickPlan { cloud, leaps: leaps && scene.skipping == Skipping::On, span, ahead, span_along, shown: None }
    }

    /// The plan of a brick of which these cells may show something.
    fn plan_of(
        &self,
        scene: &RayScene,
        ahead: [AxisDirection; 3],
        brick: &DecodedBrick,
        shown: ShownCells,
    ) -> BrickPlan {
        let blocks = brick.extent.map(|n| (n as usize - 2 * APRON).div_ceil(BLOCK));
        let places = 0..blocks.iter().product::<usize>();
        let block = |i: usize| [i % blocks[0], i / blocks[0] % blocks[1], i / (blocks[0] * blocks[1])];
        let cloud = ProximityCloud::of_shown(blocks, ahead, places.map(|i| shown.has_block(block(i), BLOCK)));
        let leaps = LEAST_LEAPT * cloud.cubes() as f64 <= cloud.hidden as f64 && scene.skipping == Skipping::On;
        BrickPlan { cloud, leaps, span: 1, ahead, span_along: None, shown: Some(shown) }
    }

    /// Runs a task with the frame's instructions and its table.
    pub(super) fn dispatch<T: ClassifyTask>(&self, task: T) -> T::Output {
        dispatch(self.set, WithTable { tables: self, task })
    }

    /// Which way rays may go in a brick.
    pub(super) fn ahead(&self, scene: &RayScene, key: BrickKey) -> [AxisDirection; 3] {
        ways_through(&scene.pyramid, key, self.view)
    }
}

/// The middle of the transfer function's window where that lies far from zero for its width: `f32` then resolves it.
fn origin_of(source: &TransferFunction, shift: f64) -> f32 {
    let points = source.points();
    let (first, last) = (points[0].value - shift, points[points.len() - 1].value - shift);
    let middle = 0.5 * first + 0.5 * last;
    let is_far = middle.is_finite() && middle.abs() > last - first;
    if is_far { single(middle) } else { 0.0 }
}

/// The pieces of a transfer function for pictures of this error, and the render value from which they count; `shift` is subtracted from
/// every data value.
pub(crate) fn pieces_of(source: &TransferFunction, shift: f64, max_error: f64) -> (f32, TransferPieces) {
    let origin = origin_of(source, shift);
    (origin, TransferPieces::new(source, shift + f64::from(origin), FIT_SHARE * max_error))
}

fn precision_of(max_error: f64, core: usize, sums_errors: bool) -> Precision {
    Precision {
        by_opacity: single(BY_OPACITY * max_error),
        reserve: single(reserve(max_error, core)),
        last_transmittance: single(END_SHARE * max_error),
        least_shaded: single(LEAST_SHADED_SHARE * max_error),
        sums_errors,
    }
}

/// A brick as packets read it, stored numbers as they are, without a cloud and unshaded; and its grid.
///
/// # Panics
/// If the brick's size is not what the pyramid says.
pub(super) fn packet_brick<'a>(
    scene: &RayScene,
    key: BrickKey,
    brick: &'a DecodedBrick,
) -> (PacketBrick<'a>, BrickGrid) {
    let core = scene.pyramid.core_box(key);
    let level = scene.pyramid.level_at(key.lod());
    let grid = BrickGrid { inverse_scale: level.scale.map(|s| 1.0 / s as f64), start: core.start.map(|s| s as f64) };
    let packet_brick = PacketBrick {
        walked: WalkedBrick::new(core.extent()),
        voxels: BrickVoxels::new(brick, core.extent()),
        centre: 0.0,
        scale: 1.0,
        offset: 0.0,
        rounding: brick.rounding,
        span: 1,
        absent: scene.map.absent,
        lighting: None,
    };
    (packet_brick, grid)
}
