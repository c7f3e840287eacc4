//! Data kept in memory from picture to picture: decoded bricks, and the states of all others.

use std::sync::Arc;

use supervol_format::{BrickIndex, BrickKey, Container, Lod};
use supervol_scene::scene::{Mode, ResolvedScene};
use supervol_scene::transfer_function::TransferFunction;
use supervol_scene::units::{InUnits, edges};
use supervol_scene::value_map::value_map;

use super::spread::{Spread, values_of};
use crate::engines::cpu::CpuFrame;
use crate::engines::packets::{BrickPlans, Made};
use crate::render::error::RenderError;
use crate::render::frame::{classifier_for, plan_host_for, streamer_for};
use crate::render::options::{LevelChoice, RenderOptions};
use crate::stop::Stop;
use crate::stream::budget::{DeadlineReserve, EngineBytes, HostPlan};
use crate::stream::field::Field;
use crate::stream::priority::BrickOrder;
use crate::stream::residency::{BrickView, Resident as Brick};
use crate::stream::streamer::{OnMissing, Room, Streamer};

/// Divisor of the memory for data derived from bricks: the share of pictures of large pixels, which show few bricks.
const SKETCHES_SHARE: u64 = 8;

/// A streamer that outlives its pictures.
#[derive(Debug)]
pub struct LoadedVolume {
    streamer: Streamer,
    plan: HostPlan,
    aimed: Aim,
    /// Spread of values within coarse voxels; `None` if nothing is lost, or before it was computed.
    spread: Option<Spread>,
    /// Whether the coarsest level was read for it.
    is_spread_read: bool,
    /// Plans of packets through bricks, from the last full-resolution picture.
    plans: Option<Arc<BrickPlans>>,
}

/// The streamer's last aim.
#[derive(Debug, Clone, PartialEq)]
struct Aim {
    scene: ResolvedScene,
    level: LevelChoice,
    max_error: f64,
}

impl Aim {
    fn new(scene: &ResolvedScene, options: &RenderOptions) -> Self {
        Self { scene: scene.clone(), level: options.level, max_error: options.max_error }
    }

    /// Whether bricks are classified equally for both. For a fixed level nothing depends on the camera.
    fn classifies_as(&self, other: &Self) -> bool {
        let is_fixed = |aim: &Self| matches!(aim.level, LevelChoice::Fixed(_));
        self == other || (is_fixed(self) && is_fixed(other) && self.scene.has_look_of(&other.scene))
    }
}

impl LoadedVolume {
    /// An empty store.
    fn new(
        container: &Arc<Container>,
        scene: &ResolvedScene,
        options: &RenderOptions,
        engine: EngineBytes,
        reserve: DeadlineReserve,
    ) -> Result<Self, RenderError> {
        let plan = plan_host_for(engine, container, scene, options, reserve)?;
        let streamer = streamer_for(container, scene, options, plan);
        Ok(Self { streamer, plan, aimed: Aim::new(scene, options), spread: None, is_spread_read: false, plans: None })
    }

    /// The resident data, with its memory divided for a picture of this scene.
    ///
    /// # Errors
    /// If the host budget is too small.
    pub fn fitting<'a>(
        resident: &'a mut Option<Self>,
        container: &Arc<Container>,
        (scene, options): (&ResolvedScene, &RenderOptions),
        engine: EngineBytes,
        reserve: DeadlineReserve,
    ) -> Result<&'a mut Self, RenderError> {
        match resident {
            Some(resident) => {
                resident.fit(scene, options, engine, reserve)?;
                Ok(resident)
            }
            None => Ok(resident.insert(Self::new(container, scene, options, engine, reserve)?)),
        }
    }

    /// Divides the memory again: for a picture of another size, by another engine, or with a deadline.
    fn fit(
        &mut self,
        scene: &ResolvedScene,
        options: &RenderOptions,
        engine: EngineBytes,
        reserve: DeadlineReserve,
    ) -> Result<(), RenderError> {
        let plan = plan_host_for(engine, self.streamer.container(), scene, options, reserve)?;
        if plan != self.plan {
            self.streamer.set_plan(plan);
            self.plan = plan;
            self.plans = None;
        }
        Ok(())
    }

    /// Aims the streamer: bricks are fetched for this scene from now on.
    pub fn aim(&mut self, scene: &ResolvedScene, options: &RenderOptions) {
        let geometry = InUnits::of(self.streamer.container()).geometry;
        self.streamer.set_order(BrickOrder::front_to_back(&scene.camera, &geometry));
        let aim = Aim::new(scene, options);
        if !self.aimed.classifies_as(&aim) {
            self.streamer.set_classifier(classifier_for(self.streamer.container(), scene, options));
        }
        self.aimed = aim;
    }

    /// Reads the coarsest level, unless it was read before: a sketch needs it first.
    ///
    /// # Errors
    /// If memory does not suffice for it.
    pub fn look_at_coarsest_level(
        &mut self,
        scene: &ResolvedScene,
        options: &RenderOptions,
        stop: &Stop,
    ) -> Result<(), RenderError> {
        if self.is_spread_read {
            return Ok(());
        }
        self.aim(scene, options);
        let container = self.streamer.container().clone();
        let coarsest = BrickKey::new(container.pyramid().coarsest(), BrickIndex([0; 3]));
        self.streamer.begin_frame();
        self.streamer.begin_band();
        self.streamer.fetch_to_keep(
            &[Field::FIRST.brick(coarsest)],
            Room { bricks: usize::MAX, stop: stop.instead_at(None), patience: None },
        )?;
        let map = value_map(&container);
        let coarsest_values = match self.streamer.view(OnMissing::UseParent).stand_in(coarsest) {
            Brick::Brick(brick) => {
                self.is_spread_read = true;
                values_of(&brick.read(), &map)
            }
            // It may become visible under the next transfer function. The ends of its range are values of it.
            _ => container.entry(coarsest).map_or(vec![], |entry| {
                let ends = [entry.range.min, entry.range.max];
                let value = |end| map.to_data(map.from_container(container.descriptor().voxel_type, end));
                if entry.range.is_empty() { vec![] } else { ends.map(value).to_vec() }
            }),
        };
        self.spread = Spread::of(&container, coarsest_values);
        Ok(())
    }

    /// The transfer function for coarse levels: it shows in a picture of large pixels what the scene's shows at full
    /// resolution. `None` if the scene's own will do. `options` are those of the picture.
    #[must_use]
    pub fn coarse_transfer_function(&self, scene: &ResolvedScene, options: &RenderOptions) -> Option<TransferFunction> {
        let spread = self.spread.as_ref().filter(|_| scene.mode == Mode::Dvr)?;
        let container = self.streamer.container();
        let level = match options.level {
            LevelChoice::Fixed(lod) => lod,
            LevelChoice::Auto => {
                let geometry = InUnits::of(container).geometry;
                let middle = container.descriptor().dims().0.map(|n| 0.5 * (n as f64 - 1.0));
                let middle = geometry.world_from_index().transform_point3(middle.into());
                level_within(container, scene.camera.pixel_size_at(middle))
            }
        };
        spread.transfer_function(&scene.transfer_function, level, container.pyramid().coarsest())
    }

    /// Budget and plans of data derived from bricks, for a picture with pixels of edge `pixel`.
    #[must_use]
    pub fn made_for(&self, pixel: u32) -> Made {
        let for_sketches = self.plan.made_bytes / SKETCHES_SHARE;
        match pixel {
            1 => (self.plan.made_bytes - for_sketches, self.plans.clone()),
            _ => (for_sketches, None),
        }
    }

    /// Keeps the plans of a frame for the next one.
    pub fn keep_plans(&mut self, frame: &CpuFrame) {
        self.plans = frame.plans();
    }

    /// The memory plan.
    #[must_use]
    pub fn plan(&self) -> HostPlan {
        self.plan
    }

    /// The streamer.
    pub fn streamer(&mut self) -> &mut Streamer {
        &mut self.streamer
    }

    /// The streamer, read-only.
    #[must_use]
    pub fn as_streamer(&self) -> &Streamer {
        &self.streamer
    }

    /// The container that it streams from.
    #[must_use]
    pub fn container(&self) -> &Arc<Container> {
        self.streamer.container()
    }
}

/// The coarsest level whose voxels are not larger than `length`, in units; the finest if all are larger.
#[must_use]
pub fn level_within(container: &Container, length: f64) -> Lod {
    let edges = edges(&InUnits::of(container).geometry);
    let pyramid = container.pyramid();
    let is_fine = |lod: &Lod| {
        let scale = pyramid.level_at(*lod).scale;
        (0..3).all(|a| scale[a] == 1 || scale[a] as f64 * edges[a] <= length)
    };
    (0..=pyramid.coarsest().0).map(Lod).take_while(is_fine).last().unwrap_or(Lod::FINEST)
}
