//! Stages by a device. A stage replaces the picture before it once all its rays are finished. The first picture waits for
//! bricks until it must begin ([`Device::pace`]). In the requested picture, rays that may be off by more than requested are then cast
//! again by the CPU ([`Recast`]).

use std::time::{Duration, Instant};

use supervol_scene::scene::ResolvedScene;

use super::device::{Device, LEAST_SURE_SHARE};
use super::means::Tools;
use super::recast::Recast;
use super::stage::{Begun, Canvas, Cast, StageCaster, options_for, sketch_pixel, with_pixels};
use crate::engines::gpu::device::GpuDevice;
use crate::engines::maps::AskedMaps;
use crate::render::error::RenderError;
use crate::render::frame::on_device::{GpuDrawn, GpuPicture};
use crate::render::options::RenderOptions;
use crate::stop::{Stop, WhenDue};

/// Casts stages on the device of the [`Tools`]. The device itself keeps the rays of a paused stage.
pub(super) struct DeviceStages {
    /// Whether pictures of large pixels are enlarged between steps.
    enlarges: bool,
    /// Rays of the requested picture that are cast again.
    recast: Option<Recast>,
}

impl DeviceStages {
    /// Nothing is cast yet. `enlarges`: whether pictures of large pixels are enlarged between steps.
    pub(super) fn new(enlarges: bool) -> Self {
        Self { enlarges, recast: None }
    }
}

impl StageCaster for DeviceStages {
    fn backend(&self) -> &'static str {
        "gpu"
    }

    fn maps(&self, options: &RenderOptions) -> AskedMaps {
        AskedMaps { work: false, ..options.asked_maps() }
    }

    /// The sketch takes the place of the paused picture on the device.
    fn keeps_rays_over_sketch(&self) -> bool {
        false
    }

    fn first(&self, scene: &ResolvedScene, tools: &mut Tools<'_>, deadline: Instant) -> (u32, Instant) {
        let (Device { backend, pace }, now) = (tools.device(), Instant::now());
        // Times of software adapters vary too much, and a picture that must be completed cannot be stopped.
        let known = pace
            .fitting(scene.image_size, deadline.saturating_duration_since(now))
            .filter(|_| !backend.device().deals_as_software());
        match known {
            Some((pixel, took)) => (pixel, deadline.checked_sub(took.div_f64(LEAST_SURE_SHARE)).unwrap_or(now)),
            None => (sketch_pixel(scene), now),
        }
    }

    fn sketch(
        &mut self,
        canvas: &mut Canvas,
        pixel: u32,
        tools: &mut Tools<'_>,
        stop: &Stop,
    ) -> Result<Cast, RenderError> {
        self.draw(canvas, Begun { pixel, spent: Duration::ZERO }, WhenDue::Complete, tools, stop)
    }

    fn cast(
        &mut self,
        canvas: &mut Canvas,
        stage: Begun,
        tools: &mut Tools<'_>,
        stop: &Stop,
    ) -> Result<Cast, RenderError> {
        if let Some(recast) = &mut self.recast {
            return recast.advance(canvas, stage, tools, stop);
        }
        let began = Instant::now();
        match self.draw(canvas, stage, WhenDue::Pause, tools, stop) {
            Err(RenderError::Cancelled) => {
                Ok(Cast { is_finished: false, took: stage.spent + began.elapsed(), is_typical: false })
            }
            cast => cast,
        }
    }

    /// Enlarges the picture, in memory of an older one: new memory would take as long as a picture.
    fn show(&mut self, canvas: &mut Canvas, tools: &mut Tools<'_>) {
        if self.enlarges
            && canvas.pixel > 1
            && let Some(picture) = canvas.picture.take()
        {
            let large = tools.device().backend.enlarged(picture, canvas.pixel, canvas.scene.image_size);
            (canvas.picture, canvas.pixel) = (Some(large), 1);
        }
    }
}

impl DeviceStages {
    /// Draws the picture of one pixel size. If the canvas shows a full-size picture already, its memory is reused later.
    fn draw(
        &mut self,
        canvas: &mut Canvas,
        Begun { pixel, spent }: Begun,
        when_due: WhenDue,
        tools: &mut Tools<'_>,
        stop: &Stop,
    ) -> Result<Cast, RenderError> {
        let began = Instant::now();
        let (scene, options) = (&canvas.scene, tools.options);
        let room = ([scene.camera.width, scene.camera.height], true);
        // The errors of rays decide which are cast again, and all stages use the same shaders.
        let options = RenderOptions { predict_error: true, ..options_for(tools.resident.container(), options, pixel) };
        let seen = with_pixels(scene, pixel);
        tools.resident.aim(&seen, &options);
        let (plan, before) = (tools.resident.plan(), canvas.stats.clone());
        let picture = GpuPicture { scene: &seen, options: &options, plan, stop, when_due, before, room };
        let (Device { backend, pace }, resident) = tools.device_and_volume();
        let GpuDrawn { image, mut stats, maps, errors, above, fetching } =
            backend.draw(resident.streamer(), &picture, &GpuDevice::open)?;
        let took = began.elapsed();
        pace.note(scene.image_size, pixel, took.saturating_sub(fetching));
        let full_size = scene.pixels();
        if let Some(before) = canvas.picture.replace(image)
            && before.pixels.len() as u64 == full_size
        {
            backend.take_back(before);
        }
        let is_stated = tools.options.predict_error;
        stats.error_predicted = stats.error_predicted.filter(|_| is_stated);
        (canvas.pixel, canvas.stats) = (pixel, stats);
        if pixel == 1 {
            canvas.finished = full_size;
            canvas.maps.errors = maps.errors.filter(|_| is_stated);
            canvas.by_reason = errors;
            // A picture with stand-ins is drawn once more.
            self.recast = above.filter(|_| canvas.stats.converged).map(|above| Recast::new(canvas, above, tools));
            canvas.above = self.recast.as_ref().map_or(0, Recast::count);
        }
        Ok(Cast { is_finished: true, took: spent + took, is_typical: true })
    }
}
