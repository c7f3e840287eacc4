//! Rays that a device may have wrong by more than requested, cast again by the CPU. A device has `f32` alone; the CPU integrates hard
//! cells in `f64`.

use std::ops::Range;
use std::time::Instant;

use supervol_scene::image::Image;

use super::means::Tools;
use super::stage::{Begun, Canvas, Cast};
use crate::engines::asked::AskedPixels;
use crate::engines::engine::{Advance, Engine, InSteps};
use crate::engines::error::EngineError;
use crate::engines::maps::Maps;
use crate::engines::totals::{EngineTotals, ErrorsByReason, PixelsAbove};
use crate::render::error::RenderError;
use crate::render::frame::cpu::CpuCaster;
use crate::render::frame::cpu_frame_of;
use crate::render::frame::walk::{BandProgress, FrameWalk};
use crate::stop::Stop;
use crate::stream::streamer::HostView;

/// The pixels of a picture by a device that are cast again, as far as they have come.
pub(super) struct Recast {
    caster: OverDevice,
    bands: BandProgress,
    /// Pixels to cast again.
    count: u64,
    /// Largest errors of the rays that stay.
    within: ErrorsByReason,
}

impl Recast {
    /// No ray is cast again yet.
    pub(super) fn new(canvas: &Canvas, above: PixelsAbove, tools: &mut Tools<'_>) -> Self {
        let Tools { resident, options, .. } = tools;
        let PixelsAbove { is_above, within, totals_within } = above;
        let scene = &canvas.scene;
        let asked = AskedPixels::new(is_above, scene.image_size[0], scene.subgrid);
        let count = asked.count();
        let frame = cpu_frame_of(resident.container(), scene, options, options.lod(), resident.made_for(1));
        resident.keep_plans(&frame);
        let caster = OverDevice { caster: CpuCaster::new(frame.only(asked)), device: totals_within };
        Self { caster, bands: BandProgress::default(), count, within }
    }

    /// Pixels to cast again.
    pub(super) fn count(&self) -> u64 {
        self.count
    }

    /// Casts rays again until all are finished or `stop` is due; the pixels overwrite those of the device.
    ///
    /// # Errors
    /// As [`Drawing::advance`](super::Drawing::advance).
    pub(super) fn advance(
        &mut self,
        canvas: &mut Canvas,
        Begun { spent, .. }: Begun,
        tools: &mut Tools<'_>,
        stop: &Stop,
    ) -> Result<Cast, RenderError> {
        let began = Instant::now();
        tools.resident.aim(&canvas.scene, tools.options);
        let plan = tools.resident.plan();
        let picture = canvas.picture.as_mut().expect("rays are cast again over a picture");
        let mut walk = FrameWalk::new(tools.resident.streamer(), plan, tools.options, began)
            .until(stop.clone())
            .going_on()
            .after(std::mem::take(&mut canvas.stats));
        let written = walk.run_over(&mut self.caster, (picture, Some(&mut canvas.maps)), &mut self.bands)?;
        canvas.stats = walk.into_stats();
        canvas.stats.pixels_cast_again = written;
        canvas.above = self.count - written;
        if canvas.above == 0 {
            canvas.by_reason = self.within.or(self.caster.caster.errors_by_reason());
        }
        Ok(Cast { is_finished: canvas.above == 0, took: spent + began.elapsed(), is_typical: false })
    }
}

/// The CPU caster, with the totals of the device before it.
struct OverDevice {
    caster: CpuCaster,
    device: EngineTotals,
}

impl Engine for OverDevice {
    fn begin(&mut self, pixel_rows: Range<u32>) -> Result<(), EngineError> {
        self.caster.begin(pixel_rows)
    }

    fn advance(&mut self, view: &HostView<'_>) -> Result<Advance, EngineError> {
        self.caster.advance(view)
    }

    fn write_image(&mut self, to: &mut [[f32; 4]]) -> Result<(), EngineError> {
        self.caster.write_image(to)
    }

    fn pixel_maps(&mut self) -> Maps {
        self.caster.pixel_maps()
    }

    fn totals(&self) -> EngineTotals {
        let EngineTotals { mut rays, instructions, errors, .. } = self.caster.totals();
        rays.add(&self.device.rays);
        let both = self.device.errors.zip(errors);
        let errors = both.map(|(device, cpu)| device.or(cpu));
        EngineTotals { rays, instructions, errors, device: self.device.device.clone() }
    }
}

impl InSteps for OverDevice {
    fn stop_at(&mut self, stop: &Stop) {
        self.caster.stop_at(stop);
    }

    fn finished_pixels(&mut self) -> Image {
        self.caster.finished_pixels()
    }
}
