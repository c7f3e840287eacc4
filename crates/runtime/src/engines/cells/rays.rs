//! Rays of a picture, one by one, row by row from the top.

use rayon::prelude::*;
use supervol_scene::camera::Ray;
use supervol_scene::clip::IndexRay;
use supervol_scene::image::Image;

use super::frame::CellFrame;
use super::march::cast_ray;
use crate::engines::feedback::{BlockFeedback, PassFeedback};
use crate::engines::ray::RayState;
use crate::stream::residency::BrickView;

/// Rays that one task casts; neighbours, so that they visit the same bricks.
const BLOCK_RAYS: usize = 256;

/// The rays of a picture, and the picture that they are cast for.
#[derive(Debug, Clone)]
pub struct CellRays {
    frame: CellFrame,
    states: Vec<RayState>,
}

impl CellRays {
    /// All rays before the first pass.
    #[must_use]
    pub fn new(frame: CellFrame) -> Self {
        let scene = &frame.scene;
        let width = scene.camera.width;
        let rays =
            scene.rows.clone().into_par_iter().flat_map_iter(|y| (0..width).map(move |x| scene.camera.ray(x, y)));
        let parts_of = |ray: Ray| scene.parts_of(&ray, &IndexRay::new(&ray, &scene.geometry));
        let states = rays.map(|ray| RayState::new(parts_of(ray).first().copied())).collect();
        Self { frame, states }
    }

    /// The rays, row by row from the top.
    #[must_use]
    pub fn states(&self) -> &[RayState] {
        &self.states
    }

    /// See [`Self::states`].
    pub fn states_mut(&mut self) -> &mut [RayState] {
        &mut self.states
    }

    /// Casts every unfinished ray as far as resident bricks allow.
    ///
    /// # Panics
    /// If a brick's size is not what the pyramid says.
    pub fn cast_pass<V: BrickView + ?Sized>(&mut self, view: &V) -> PassFeedback {
        let Self { frame, states } = self;
        let blocks = states.par_chunks_mut(BLOCK_RAYS).enumerate();
        PassFeedback::merged(
            blocks.map(|(block, states)| cast_block(view, frame, block * BLOCK_RAYS, states)).collect(),
        )
    }

    /// The picture of what the rays have gathered, sub-grid averaged.
    #[must_use]
    pub fn image(&self) -> Image {
        let scene = &self.frame.scene;
        scene.image_of(self.states.iter().map(|state| scene.pixel(state)).collect())
    }

    /// The picture of finished rays, sub-grid averaged: NaN elsewhere.
    #[must_use]
    pub fn finished_pixels(&self) -> Image {
        let scene = &self.frame.scene;
        let pixel = |state: &RayState| if state.finished { scene.pixel(state) } else { [f32::NAN; 4] };
        scene.image_of(self.states.iter().map(pixel).collect())
    }

    /// Rays that wait for a brick.
    #[must_use]
    pub fn waiting(&self) -> u64 {
        self.states.iter().filter(|s| s.waiting.is_some()).count() as u64
    }

    /// Whether every ray is finished.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.states.iter().all(|s| s.finished)
    }

    /// Rays that ended before they left the volume.
    #[must_use]
    pub fn terminated_early(&self) -> u64 {
        self.states.iter().filter(|s| s.finished && s.t < s.t_end).count() as u64
    }

    /// Rays of the picture.
    #[must_use]
    pub fn ray_count(&self) -> u64 {
        self.frame.scene.ray_count()
    }
}

/// Casts the unfinished ones of a block of rays, of which the first is the picture's `first`th.
fn cast_block<V: BrickView + ?Sized>(
    view: &V,
    frame: &CellFrame,
    first: usize,
    states: &mut [RayState],
) -> BlockFeedback {
    let mut feedback = BlockFeedback::default();
    for (i, state) in states.iter_mut().enumerate().filter(|(_, state)| !state.finished) {
        cast_ray(view, frame, frame.scene.pixel_of(first + i), state, &mut feedback);
    }
    feedback
}
