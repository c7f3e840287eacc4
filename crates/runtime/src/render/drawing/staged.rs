//! Progressive picture: its pixels become smaller until the requested picture is reached.
//!
//! ```text
//! sketch: large pixels, the coarsest level --> smaller pixels, finer levels --> ... --> the requested picture
//! ```
//!
//! The sketch is always finished. Each later picture (a *stage*) has smaller pixels. Levels follow the pixel size, so
//! halving the pixel size takes about eight times as long. The time of the last stage decides which sizes are skipped.
//! At the deadline, rays pause. With more time they continue. Pixels that are not finished show the stage before
//! ([`FrameStats::pixels_unfinished`]). Without a deadline the requested picture is drawn at once.
//!
//! A [`StageCaster`] casts the rays of a stage: [`PacketStages`] on the CPU, [`DeviceStages`] on a device.

use std::borrow::Cow;
use std::time::{Duration, Instant};

use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use super::Drawing;
use super::device_stages::DeviceStages;
use super::means::{Means, Tools};
use super::packet_stages::PacketStages;
use super::stage::{Begun, Canvas, Cast, StageCaster, next_pixel};
use crate::engines::maps::{Maps, of_work};
use crate::render::accuracy::stated::{ErrorStated, complete};
use crate::render::enlarge::Enlarge;
use crate::render::error::RenderError;
use crate::render::stats::FrameStats;
use crate::stop::{LEAST_STEP, Stop};

/// Progressive picture of one scene.
pub(crate) struct StagedDrawing {
    canvas: Canvas,
    caster: Box<dyn StageCaster>,
    /// The stage in progress.
    begun: Option<Begun>,
    /// The last finished stage.
    last: Cast,
}

impl StagedDrawing {
    /// A picture by ray packets that is not begun.
    #[must_use]
    pub(crate) fn by_packets(scene: ResolvedScene) -> Self {
        Self::new(scene, Box::new(PacketStages::default()))
    }

    /// A picture by a device that is not begun.
    #[must_use]
    pub(crate) fn by_device(scene: ResolvedScene) -> Self {
        Self::new(scene, Box::new(DeviceStages::new(true)))
    }

    /// A part of a picture by a device. It stays small until it is finished, because other parts take memory, too.
    #[must_use]
    pub(crate) fn part_by_device(scene: ResolvedScene) -> Self {
        Self::new(scene, Box::new(DeviceStages::new(false)))
    }

    fn new(scene: ResolvedScene, caster: Box<dyn StageCaster>) -> Self {
        Self { canvas: Canvas::new(scene), caster, begun: None, last: Cast::default() }
    }

    /// Whether each pixel is known at least coarsely.
    #[must_use]
    pub(crate) fn has_picture(&self) -> bool {
        self.canvas.picture.is_some() && self.canvas.behind.is_some()
    }

    /// The picture so far, the edge of its pixels in pixels of the requested picture, and the size of that picture.
    #[must_use]
    pub(crate) fn unenlarged(&self) -> Option<(&Image, u32, [u32; 2])> {
        let (picture, pixel) = self.canvas.shown().filter(|_| self.has_picture())?;
        Some((picture, pixel, self.canvas.scene.image_size))
    }

    /// Errors of the finished pixels; NaN elsewhere.
    #[must_use]
    pub(crate) fn known_errors(&self) -> Option<&Image> {
        self.canvas.maps.errors.as_ref()
    }

    /// As [`Drawing::advance`], with memory that is divided already.
    ///
    /// # Errors
    /// As [`Drawing::advance`].
    pub(crate) fn advance_with(&mut self, tools: &mut Tools<'_>, stop: &Stop) -> Result<(), RenderError> {
        let Self { canvas, caster, .. } = self;
        canvas.maps.begin(caster.maps(tools.options), canvas.scene.image_size);
        let mut stop = stop.clone();
        match stop.deadline() {
            Some(deadline) if canvas.behind.is_none() => {
                let (pixel, latest) = caster.first(&canvas.scene, tools, deadline);
                self.last = caster.sketch(canvas, pixel, tools, &stop.instead_at(Some(latest)))?;
                canvas.behind = Some(pixel);
                self.begun = self.begun.filter(|_| caster.keeps_rays_over_sketch());
            }
            // Each step makes progress, however short it is.
            _ => stop = stop.not_before(Instant::now() + LEAST_STEP),
        }
        while !self.is_finished() && !stop.is_due() {
            let stage = self.next_stage(stop.deadline());
            let cast = self.caster.cast(&mut self.canvas, stage, tools, &stop)?;
            if !cast.is_finished {
                self.begun = Some(Begun { spent: cast.took, ..stage });
                break;
            }
            (self.begun, self.last) = (None, cast);
            self.canvas.behind = Some(stage.pixel);
        }
        self.caster.show(&mut self.canvas, tools);
        Ok(())
    }

    /// The stage to cast: the one in progress, or the next one.
    fn next_stage(&self, deadline: Option<Instant>) -> Begun {
        let behind = self.canvas.behind.unwrap_or(self.canvas.pixel);
        let left = deadline.map(|deadline| deadline.saturating_duration_since(Instant::now()));
        let pixel = match (self.begun, left) {
            (Some(stage), Some(_)) => return stage,
            (Some(stage), None) if stage.pixel == 1 => return stage,
            // Without a deadline intermediate pictures are not needed.
            (_, None) => 1,
            (None, Some(left)) if self.last.is_typical => next_pixel(behind, self.last.took, left),
            (None, Some(_)) => (behind / 2).max(1),
        };
        Begun { pixel, spent: Duration::ZERO }
    }
}

impl Drawing for StagedDrawing {
    fn advance(&mut self, means: Means<'_>, stop: &Stop) -> Result<(), RenderError> {
        let bytes = means.engine_bytes();
        self.advance_with(&mut means.for_picture(&self.canvas.scene, bytes)?, stop)
    }

    fn is_finished(&self) -> bool {
        // A sketch of pixels of the requested size may contain coarser bricks.
        let Canvas { scene, finished, above, stats, .. } = &self.canvas;
        *finished == scene.pixels() && *above == 0 && stats.converged
    }

    fn picture(&self) -> Option<Cow<'_, Image>> {
        let (picture, pixel) = self.canvas.shown().filter(|_| self.has_picture())?;
        Some(match pixel {
            1 => Cow::Borrowed(picture),
            pixel => Cow::Owned(picture.clone().enlarged(pixel, self.canvas.scene.image_size)),
        })
    }

    fn into_pictures(self: Box<Self>) -> Option<(Image, Maps)> {
        let Canvas { scene, picture, pixel, behind, maps, .. } = self.canvas;
        let picture = picture.filter(|_| behind.is_some())?.enlarged(pixel, scene.image_size);
        let errors = maps.errors.map(|known| complete(known, &picture));
        Some((picture, Maps { errors, work: maps.work.map(of_work) }))
    }

    fn error_map(&self) -> Option<Image> {
        Some(complete(self.canvas.maps.errors.clone()?, self.picture()?.as_ref()))
    }

    fn work_map(&self) -> Option<Image> {
        self.picture()?;
        self.canvas.maps.work.clone().map(of_work)
    }

    fn error_stated(&self) -> Option<ErrorStated> {
        let Canvas { scene, maps, by_reason, finished, .. } = &self.canvas;
        let unfinished = scene.pixels() - finished;
        Some(ErrorStated::of(maps.errors.as_ref()?, self.picture()?.as_ref(), *by_reason, unfinished))
    }

    fn stats(&self) -> FrameStats {
        let Canvas { scene, behind, finished, above, stats, .. } = &self.canvas;
        let mut stats = FrameStats { backend: self.caster.backend(), ..stats.clone() };
        stats.converged &= *above == 0;
        stats.pixels_unfinished = scene.pixels() - finished;
        if stats.pixels_unfinished > 0 {
            stats.coarsest_pixel = behind.unwrap_or(0);
            stats.converged = false;
            // The error of a coarser picture is not summed up.
            stats.error_predicted = None;
        }
        stats
    }

    fn into_memory(self: Box<Self>) -> Option<Image> {
        self.canvas.picture
    }
}
