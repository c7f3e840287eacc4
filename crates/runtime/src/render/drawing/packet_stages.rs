//! Stages by ray packets on the CPU. Tiles of a stage overwrite the picture before it as they are finished.

use std::time::Instant;

use supervol_scene::image::Image;
use supervol_scene::scene::{Mode, ResolvedScene};

use super::means::Tools;
use super::stage::{Begun, Canvas, Cast, StageCaster, options_for, sketch_pixel, with_pixels};
use crate::engines::maps::AskedMaps;
use crate::render::enlarge::Enlarge;
use crate::render::error::RenderError;
use crate::render::frame::cpu::CpuCaster;
use crate::render::frame::cpu_frame_of;
use crate::render::frame::walk::{BandProgress, FrameWalk};
use crate::render::options::{Refining, RenderOptions};
use crate::stop::Stop;

/// Casts stages by ray packets.
#[derive(Default)]
pub(super) struct PacketStages {
    /// The stage in progress.
    stage: Option<Stage>,
}

/// A picture of one pixel size, as far as its rays have come.
struct Stage {
    pixel: u32,
    scene: ResolvedScene,
    options: RenderOptions,
    caster: CpuCaster,
    bands: BandProgress,
    /// Page-ins for the picture before the stage began.
    page_ins_before: u64,
}

impl StageCaster for PacketStages {
    fn backend(&self) -> &'static str {
        "cpu"
    }

    fn maps(&self, options: &RenderOptions) -> AskedMaps {
        options.asked_maps()
    }

    fn keeps_rays_over_sketch(&self) -> bool {
        true
    }

    fn first(&self, scene: &ResolvedScene, _tools: &mut Tools<'_>, _deadline: Instant) -> (u32, Instant) {
        (sketch_pixel(scene), Instant::now())
    }

    fn sketch(
        &mut self,
        canvas: &mut Canvas,
        pixel: u32,
        tools: &mut Tools<'_>,
        stop: &Stop,
    ) -> Result<Cast, RenderError> {
        let began = Instant::now();
        if pixel > 1 && canvas.scene.mode == Mode::Dvr {
            tools.resident.look_at_coarsest_level(&canvas.scene, tools.options, stop)?;
        }
        let mut stage = Stage::new(&canvas.scene, pixel, tools);
        tools.resident.aim(&stage.scene, &stage.options);
        let plan = tools.resident.plan();
        let mut walk = FrameWalk::new(tools.resident.streamer(), plan, &stage.options, began)
            .until(stop.clone())
            .after(std::mem::take(&mut canvas.stats));
        let sketch = walk.run(&mut stage.caster, stage.scene.image_size)?;
        canvas.stats = walk.into_stats();
        match &mut canvas.picture {
            // The requested picture was begun without a deadline: its finished pixels stay.
            Some(finest) => finest.fill_unknown(&sketch, pixel),
            None => (canvas.picture, canvas.pixel) = (Some(sketch), pixel),
        }
        Ok(Cast { is_finished: true, took: began.elapsed(), is_typical: canvas.stats.fallbacks == 0 })
    }

    fn cast(
        &mut self,
        canvas: &mut Canvas,
        Begun { pixel, spent }: Begun,
        tools: &mut Tools<'_>,
        stop: &Stop,
    ) -> Result<Cast, RenderError> {
        let mut stage = match self.stage.take() {
            Some(stage) if stage.pixel == pixel => stage,
            _ => Stage::over(canvas, pixel, tools),
        };
        // A sketch may have been drawn in between.
        tools.resident.aim(&stage.scene, &stage.options);
        let (began, plan) = (Instant::now(), tools.resident.plan());
        let picture = canvas.picture.as_mut().expect("a stage has a picture");
        let mut walk = FrameWalk::new(tools.resident.streamer(), plan, &stage.options, began)
            .until(stop.clone())
            .after(std::mem::take(&mut canvas.stats));
        let maps = (pixel == 1).then_some(&mut canvas.maps);
        let written = walk.run_over(&mut stage.caster, (picture, maps), &mut stage.bands)?;
        canvas.stats = walk.into_stats();
        let is_finished = written == picture.pixels.len() as u64;
        if pixel == 1 {
            canvas.finished = written;
            canvas.by_reason = stage.caster.errors_by_reason();
        }
        let is_typical = canvas.stats.streaming.page_ins == stage.page_ins_before;
        if is_finished {
            canvas.whole = None;
        } else {
            self.stage = Some(stage);
        }
        Ok(Cast { is_finished, took: spent + began.elapsed(), is_typical })
    }
}

impl Stage {
    /// A stage of a scene with this pixel size; no ray is cast yet.
    fn new(scene: &ResolvedScene, pixel: u32, tools: &mut Tools<'_>) -> Self {
        let Tools { resident, options, .. } = tools;
        let mut scene = with_pixels(scene, pixel);
        let options = options_for(resident.container(), options, pixel);
        if pixel > 1
            && let Some(coarse) = resident.coarse_transfer_function(&scene, &options)
        {
            scene.transfer_function = coarse;
        }
        let frame = cpu_frame_of(resident.container(), &scene, &options, options.lod(), resident.made_for(pixel));
        if pixel == 1 {
            resident.keep_plans(&frame);
        }
        let caster = CpuCaster::new(frame);
        Self { pixel, scene, options, caster, bands: BandProgress::default(), page_ins_before: 0 }
    }

    /// A stage that begins over the picture so far, enlarged.
    fn over(canvas: &mut Canvas, pixel: u32, tools: &mut Tools<'_>) -> Self {
        let page_ins_before = canvas.stats.streaming.page_ins;
        let stage = Self { page_ins_before, ..Self::new(&canvas.scene, pixel, tools) };
        let shows_whole = tools.options.refining == Refining::WholeStages;
        canvas.whole = canvas.picture.clone().filter(|_| shows_whole).map(|picture| (picture, canvas.pixel));
        let picture = match canvas.picture.take() {
            Some(picture) => picture.enlarged(canvas.pixel / pixel, stage.scene.image_size),
            None => Image::unknown(stage.scene.image_size),
        };
        (canvas.picture, canvas.pixel) = (Some(picture), pixel);
        stage
    }
}
