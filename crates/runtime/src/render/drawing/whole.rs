//! Pictures that are drawn in one step: by the reference integrator, by rays cast cell by cell, and by engines from
//! outside. At the deadline they are completed from coarser bricks.

use std::borrow::Cow;
use std::time::Instant;

use supervol_format::Container;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use super::Drawing;
use super::means::{Means, Tools};
use crate::engines::engine::Engine;
use crate::engines::maps::Maps;
use crate::engines::reference::render_reference_counted;
use crate::render::accuracy::check::level_to_check;
use crate::render::accuracy::reference::{load_level, scene_of_level};
use crate::render::accuracy::stated::{ErrorStated, complete};
use crate::render::error::RenderError;
use crate::render::frame::render_cpu;
use crate::render::frame::walk::{FinishedBands, FrameWalk};
use crate::render::options::RenderOptions;
use crate::render::stats::{FrameStats, OUTSIDE_ENGINE};
use crate::stop::Stop;
use crate::stream::counters::{RayCounters, StreamCounters, milliseconds};

/// The engine of a whole picture.
pub(crate) enum WholeBy {
    /// The reference integrator, from one level in memory.
    Reference,
    /// The CPU engine that the options choose.
    Cpu,
    /// An engine from outside.
    Engine(Box<dyn Engine + Send>),
}

/// A picture drawn in one step.
pub(crate) struct WholeDrawing {
    scene: ResolvedScene,
    by: WholeBy,
    drawn: Option<(Image, Maps, FrameStats)>,
}

impl WholeDrawing {
    /// A picture that is not begun.
    #[must_use]
    pub(crate) fn new(scene: ResolvedScene, by: WholeBy) -> Self {
        Self { scene, by, drawn: None }
    }
}

impl Drawing for WholeDrawing {
    fn advance(&mut self, means: Means<'_>, stop: &Stop) -> Result<(), RenderError> {
        let scene = &self.scene;
        let engine = match &mut self.by {
            WholeBy::Reference => {
                let (image, stats) = by_reference(means.container, scene, means.options)?;
                self.drawn = Some((image, Maps::default(), stats));
                return Ok(());
            }
            WholeBy::Cpu => None,
            WholeBy::Engine(engine) => Some(engine),
        };
        let bytes = means.engine_bytes();
        let Tools { options, resident, .. } = means.for_picture(scene, bytes)?;
        resident.aim(scene, options);
        let plan = resident.plan();
        self.drawn = Some(match engine {
            Some(engine) => {
                let mut walk = FrameWalk::new(resident.streamer(), plan, options, Instant::now()).until(stop.clone());
                let mut bands = FinishedBands::default();
                let image = walk.run_on(engine.as_mut(), scene.image_size, &mut bands)?;
                (image, bands.into_maps(), FrameStats { backend: OUTSIDE_ENGINE, ..walk.into_stats() })
            }
            None => {
                let (image, stats) = render_cpu(scene, options, resident.streamer(), plan, stop)?;
                (image, Maps::default(), stats)
            }
        });
        Ok(())
    }

    fn is_finished(&self) -> bool {
        self.drawn.as_ref().is_some_and(|(_, _, stats)| stats.converged)
    }

    fn picture(&self) -> Option<Cow<'_, Image>> {
        self.drawn.as_ref().map(|(image, _, _)| Cow::Borrowed(image))
    }

    fn into_pictures(self: Box<Self>) -> Option<(Image, Maps)> {
        let errors = self.error_map();
        self.drawn.map(|(image, maps, _)| (image, Maps { errors, ..maps }))
    }

    fn error_map(&self) -> Option<Image> {
        let (image, maps, _) = self.drawn.as_ref()?;
        Some(complete(maps.errors.clone()?, image))
    }

    fn work_map(&self) -> Option<Image> {
        self.drawn.as_ref()?.1.work.clone()
    }

    /// Errors of an engine from outside have no reasons.
    fn error_stated(&self) -> Option<ErrorStated> {
        None
    }

    fn stats(&self) -> FrameStats {
        match &self.drawn {
            Some((_, _, stats)) => stats.clone(),
            None => FrameStats { pixels_unfinished: self.scene.pixels(), ..FrameStats::default() },
        }
    }
}

/// Draws the picture with the reference integrator in `f64`.
fn by_reference(
    container: &Container,
    scene: &ResolvedScene,
    options: &RenderOptions,
) -> Result<(Image, FrameStats), RenderError> {
    let lod = level_to_check(container, options.level);
    let volume = load_level(container, lod, scene, options.host_memory_bytes)?;
    let start = Instant::now();
    let picture = render_reference_counted(&volume, &scene_of_level(container, lod, scene));
    let level = container.pyramid().level_at(lod);
    let stats = FrameStats {
        backend: "reference",
        converged: true,
        passes: 1,
        bands: 1,
        bricks_total: container.pyramid().brick_count(),
        streaming: StreamCounters { page_ins: level.brick_count(), ..StreamCounters::default() },
        render_ms: milliseconds(start.elapsed()),
        casting: RayCounters { rays: scene.rays(), ..RayCounters::default() },
        reference_capped_pieces: picture.capped_pieces,
        error_bound: container.manifest().level_errors.get(lod.0 as usize).copied().unwrap_or(0.0),
        ..FrameStats::default()
    };
    Ok((picture.image, stats))
}
