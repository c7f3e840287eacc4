//! What stays in memory from picture to picture: decoded bricks, and what is known of all others.

use std::sync::Arc;

use supervol_format::Container;

use crate::frame::{LevelChoice, RenderError, RenderOptions, classifier_for, plan_host_for, streamer_for};
use crate::scene::ResolvedScene;
use crate::streamer::Streamer;
use crate::streamer::budget::{CasterBytes, HostPlan};
use crate::streamer::priority::FrontToBack;
use crate::units::InUnits;

/// A streamer that outlives its pictures.
#[derive(Debug)]
pub struct Resident {
    streamer: Streamer,
    plan: HostPlan,
    aimed: Aim,
}

/// What the streamer was told last.
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

    /// Whether the table of contents decides the same for both. Where the level is asked for, nothing depends on the camera.
    fn classifies_as(&self, other: &Self) -> bool {
        let is_fixed = |aim: &Self| matches!(aim.level, LevelChoice::Fixed(_));
        self == other || (is_fixed(self) && is_fixed(other) && self.scene.has_look_of(&other.scene))
    }
}

impl Resident {
    /// Nothing yet.
    ///
    /// # Errors
    /// If the host budget is too small for pictures of this size.
    pub fn new(
        container: &Arc<Container>,
        scene: &ResolvedScene,
        options: &RenderOptions,
        caster: CasterBytes,
        has_deadline: bool,
    ) -> Result<Self, RenderError> {
        let plan = plan_host_for(caster, container, scene, options, has_deadline)?;
        let streamer = streamer_for(container, scene, options, plan);
        Ok(Self { streamer, plan, aimed: Aim::new(scene, options) })
    }

    /// Divides the memory anew, for a picture of another size, by another caster, or with a deadline.
    ///
    /// # Errors
    /// If the host budget is too small.
    pub fn fit(
        &mut self,
        scene: &ResolvedScene,
        options: &RenderOptions,
        caster: CasterBytes,
        has_deadline: bool,
    ) -> Result<(), RenderError> {
        let plan = plan_host_for(caster, self.streamer.container(), scene, options, has_deadline)?;
        if plan != self.plan {
            self.streamer.set_plan(plan);
            self.plan = plan;
        }
        Ok(())
    }

    /// From now on bricks are fetched for this scene.
    pub fn aim(&mut self, scene: &ResolvedScene, options: &RenderOptions) {
        let geometry = InUnits::of(self.streamer.container()).geometry;
        self.streamer.set_order(FrontToBack::new(&scene.camera, &geometry));
        let aim = Aim::new(scene, options);
        if !self.aimed.classifies_as(&aim) {
            self.streamer.set_classifier(classifier_for(self.streamer.container(), scene, options));
        }
        self.aimed = aim;
    }

    /// How the memory is divided.
    #[must_use]
    pub fn plan(&self) -> HostPlan {
        self.plan
    }

    /// The streamer.
    pub fn streamer(&mut self) -> &mut Streamer {
        &mut self.streamer
    }

    /// The streamer, to look at.
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
