//! The CPU ray caster as an engine: reads bricks directly from the host cache.

use std::ops::Range;
use std::time::Instant;

use supervol_format::Container;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;
use supervol_scene::units::InUnits;
use supervol_scene::value_map::value_map;

use super::FrameWalk;
use super::setting::with_data_scale;
use crate::engines::cpu::{CpuFrame, CpuQuality, CpuRays};
use crate::engines::engine::{Advance, Engine, InSteps};
use crate::engines::error::EngineError;
use crate::engines::maps::Maps;
use crate::engines::packets::Made;
use crate::engines::packets::simd::InstructionSet;
use crate::engines::ray_scene::DrawnVolume;
use crate::engines::totals::{EngineTotals, ErrorsByReason};
use crate::lod::LodChoice;
use crate::lod::deviation::Deviations;
use crate::render::error::RenderError;
use crate::render::options::RenderOptions;
use crate::render::stats::FrameStats;
use crate::stop::Stop;
use crate::stream::budget::HostPlan;
use crate::stream::counters::RayCounters;
use crate::stream::streamer::{HostView, Streamer};

/// Data that all rays of the CPU ray caster share in a frame.
#[must_use]
pub fn cpu_frame(container: &Container, scene: &ResolvedScene, options: &RenderOptions, plan: &HostPlan) -> CpuFrame {
    cpu_frame_of(container, scene, options, options.lod(), (plan.made_bytes, None))
}

/// The same with its own level choice, and with plans from another picture's frame.
pub(crate) fn cpu_frame_of(
    container: &Container,
    scene: &ResolvedScene,
    options: &RenderOptions,
    lod: LodChoice,
    (made_bytes, plans): Made,
) -> CpuFrame {
    let InUnits { geometry, value_range, .. } = InUnits::of(container);
    let quality = CpuQuality { lod, skipping: options.skipping, caster: options.ray_caster(), made_bytes, plans };
    let (pyramid, map) = (container.pyramid(), value_map(container));
    let volume = DrawnVolume { pyramid, geometry: &geometry, map, value_range };
    let frame = CpuFrame::new(scene, &volume, quality);
    let frame = frame.counting(options.rays_finished.clone());
    if !options.predict_error {
        return frame;
    }
    let value_error = frame.value_error(value_range);
    frame.with_deviations(with_data_scale(container, |data| Deviations::new(scene, data, value_error)))
}

/// Draws the picture on the CPU in one go, on the calling thread's pool, with bricks that the streamer has or fetches.
/// The statistics lack the fields that a [`Renderer`](crate::render::renderer::Renderer) adds.
///
/// # Errors
/// As [`crate::render::renderer::render`].
pub fn render_cpu(
    scene: &ResolvedScene,
    options: &RenderOptions,
    streamer: &mut Streamer,
    plan: HostPlan,
    stop: &Stop,
) -> Result<(Image, FrameStats), RenderError> {
    let mut caster = CpuCaster::new(cpu_frame(streamer.container(), scene, options, &plan));
    let mut walk = FrameWalk::new(streamer, plan, options, Instant::now()).until(stop.clone());
    let image = walk.run(&mut caster, scene.image_size)?;
    Ok((image, FrameStats { backend: "cpu", ..walk.into_stats() }))
}

/// The CPU ray caster: reads bricks directly from the host cache.
#[derive(Debug)]
pub struct CpuCaster {
    frame: CpuFrame,
    /// The rays of the present band; `None` before the first one.
    rays: Option<CpuRays>,
    counters: RayCounters,
    /// Share of the current band in `counters.rays_terminated_early`: it is counted at every interruption.
    terminated_in_band: u64,
    errors: ErrorsByReason,
    /// Totals of the device that has begun the picture, if one has.
    before: Option<EngineTotals>,
}

impl CpuCaster {
    /// A caster for this frame.
    #[must_use]
    pub fn new(frame: CpuFrame) -> Self {
        Self {
            frame,
            rays: None,
            counters: RayCounters::default(),
            terminated_in_band: 0,
            errors: ErrorsByReason::default(),
            before: None,
        }
    }

    /// The same caster, in a picture that a device with these totals has begun.
    #[must_use]
    pub(crate) fn after(self, before: EngineTotals) -> Self {
        Self { before: Some(before), ..self }
    }

    /// Largest errors of rays, by reason.
    #[must_use]
    pub fn errors_by_reason(&self) -> ErrorsByReason {
        self.errors
    }

    fn band(&self) -> &CpuRays {
        self.rays.as_ref().expect("a frame begins its bands before it casts them")
    }

    fn band_mut(&mut self) -> &mut CpuRays {
        self.rays.as_mut().expect("a frame begins its bands before it casts them")
    }

    /// Sums up what the rays of a band say so far.
    fn note_band(&mut self) {
        let Some(rays) = &self.rays else { return };
        let terminated = rays.terminated_early();
        self.counters.rays_terminated_early += terminated - self.terminated_in_band;
        self.terminated_in_band = terminated;
        self.errors = self.errors.or(rays.errors());
    }
}

impl Engine for CpuCaster {
    fn begin(&mut self, pixel_rows: Range<u32>) -> Result<(), EngineError> {
        // Two bands' rays never exist at once: the budget has room for one.
        self.rays = None;
        let rays = self.frame.band(pixel_rows).into_rays();
        self.terminated_in_band = 0;
        self.counters.rays += rays.ray_count();
        self.rays = Some(rays);
        Ok(())
    }

    fn advance(&mut self, view: &HostView<'_>) -> Result<Advance, EngineError> {
        let feedback = self.band_mut().cast_pass(view);
        self.counters.add(&feedback.counters);
        Ok(Advance {
            remaining: feedback.misses.iter().map(|miss| miss.rays).sum(),
            wanted: view.field().bricks(feedback.misses.into_iter().map(|miss| miss.key)),
            used: view.field().bricks(feedback.uses),
            stood_in: feedback.counters.parent_bricks,
            is_stopped: feedback.is_stopped,
        })
    }

    fn write_image(&mut self, to: &mut [[f32; 4]]) -> Result<(), EngineError> {
        self.note_band();
        to.copy_from_slice(&self.band().image().pixels);
        Ok(())
    }

    fn pixel_maps(&mut self) -> Maps {
        let rays = self.band();
        Maps { errors: rays.error_pixels(), work: rays.work_pixels() }
    }

    fn totals(&self) -> EngineTotals {
        let own = EngineTotals {
            rays: self.counters,
            instructions: self.frame.instructions().map(InstructionSet::name),
            errors: self.frame.errors(self.errors),
            device: None,
        };
        match &self.before {
            Some(before) => own.after(before),
            None => own,
        }
    }
}

impl InSteps for CpuCaster {
    fn stop_at(&mut self, stop: &Stop) {
        self.frame.set_stop(stop.clone());
        if let Some(rays) = &mut self.rays {
            rays.set_stop(stop.clone());
        }
    }

    fn finished_pixels(&mut self) -> Image {
        self.note_band();
        self.band().finished_pixels()
    }
}
