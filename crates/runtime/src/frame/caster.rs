//! What a frame asks of a ray caster, and the CPU ray caster behind it.
//!
//! Protocol, for each band of pixel rows:
//! 1. [`RayCaster::begin`].
//! 2. [`RayCaster::cast_pass`]: every unfinished ray goes as far as the bricks of the view allow.
//! 3. [`RayCaster::update`] with what was fetched for it; again from 2 until no ray is unfinished.
//! 4. [`RayCaster::image`].
//!
//! A caster that reads the host cache directly ignores `update`; one with a memory of its own copies there.

use std::ops::Range;

use supervol_format::BrickKey;

use super::RenderError;
use crate::image::Image;
use crate::raycast::cpu::levels::ErrorsByReason;
use crate::raycast::cpu::simd::InstructionSet;
use crate::raycast::cpu::{CpuFrame, RayCounters, Rays, cast_pass};
use crate::raycast::gpu::GpuStats;
use crate::stop::Stop;
use crate::streamer::{Fetched, HostView};

/// What one pass tells the frame.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PassReport {
    /// Bricks that rays wait for, each once.
    pub misses: Vec<BrickKey>,
    /// Resident bricks that rays used, each once.
    pub uses: Vec<BrickKey>,
    /// Rays that are not finished.
    pub unfinished_rays: u64,
    /// Times a ray took a coarser brick than it wanted.
    pub fallbacks: u64,
    /// Whether it was time to stop before all rays were finished or waited.
    pub is_stopped: bool,
}

/// What a caster has done and knows, over all passes and bands.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CasterTotals {
    /// What its rays did.
    pub rays: RayCounters,
    /// Instructions of packets.
    pub instructions: Option<&'static str>,
    /// What the picture may be off by, where the caster was asked to sum it up and can.
    pub errors: Option<CasterErrors>,
    /// What its graphics device did for this picture, if it has one.
    pub device: Option<GpuStats>,
}

/// What a caster says of its own errors; 1 is white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CasterErrors {
    /// The greatest sum, over all rays, of what cells may be off by.
    pub cells: f64,
    /// Most that coarser levels may do to a ray, against the finest.
    pub levels: f64,
    /// Most that is left out behind the end of a ray that ends early.
    pub ray_ends: f64,
    /// What the fit of the transfer function may do to a ray.
    pub transfer_function: f64,
    /// What sums of `f32` over the cells of a brick may do to a ray.
    pub rounding: f64,
}

/// Casts rays through resident bricks.
pub trait RayCaster {
    /// Bricks that can be handed over between two passes; at least 1.
    fn room(&self) -> usize;

    /// Most rows of pixels that are begun at once.
    fn band_rows(&self) -> u32 {
        u32::MAX
    }

    /// Begins the rays of these rows of pixels, numbered from the top.
    ///
    /// # Errors
    /// If a device fails.
    fn begin(&mut self, pixel_rows: Range<u32>) -> Result<(), RenderError>;

    /// Takes every unfinished ray as far as the bricks allow.
    ///
    /// # Errors
    /// If a device fails.
    fn cast_pass(&mut self, view: &HostView<'_>) -> Result<PassReport, RenderError>;

    /// Takes note of what was fetched; the view holds the bricks and the answers.
    ///
    /// # Errors
    /// If a device fails.
    fn update(&mut self, view: &HostView<'_>, fetched: &Fetched) -> Result<(), RenderError>;

    /// The picture of the band.
    ///
    /// # Errors
    /// If a device fails.
    fn image(&mut self) -> Result<Image, RenderError>;

    /// Sums so far.
    fn totals(&self) -> CasterTotals;
}

/// The ray caster in Rust: reads bricks where the host cache holds them.
pub struct CpuCaster {
    frame: CpuFrame,
    band: CpuFrame,
    states: Rays,
    counters: RayCounters,
    errors: ErrorsByReason,
}

impl CpuCaster {
    /// A caster for this frame.
    #[must_use]
    pub fn new(frame: CpuFrame) -> Self {
        let band = frame.clone();
        Self {
            frame,
            band,
            states: Rays::default(),
            counters: RayCounters::default(),
            errors: ErrorsByReason::default(),
        }
    }

    /// Packets stop where they are when this is due, instead of when they were to stop before.
    pub fn stop_at(&mut self, stop: &Stop) {
        self.frame.set_stop(stop.clone());
        self.band.set_stop(stop.clone());
    }

    /// The pixels of the band that are finished; NaN elsewhere.
    pub fn finished_pixels(&mut self) -> Image {
        self.note_band();
        self.band.finished_pixels(&self.states)
    }

    /// What the pixels of the band may be off by, where they are finished and that is summed up; see
    /// [`CpuFrame::error_pixels`].
    #[must_use]
    pub fn error_pixels(&self) -> Option<Image> {
        self.band.error_pixels(&self.states)
    }

    /// What the rays of the pixels of the band cost, where they are finished and that is counted; see [`CpuFrame::work_pixels`].
    #[must_use]
    pub fn work_pixels(&self) -> Option<Image> {
        self.band.work_pixels(&self.states)
    }

    /// What rays may be off by at most, reason by reason.
    #[must_use]
    pub fn errors_by_reason(&self) -> ErrorsByReason {
        self.errors
    }

    /// Sums up what the rays of a band say at its end.
    fn note_band(&mut self) {
        self.counters.rays_terminated_early += self.states.terminated_early();
        self.errors = self.errors.or(self.states.errors());
    }
}

impl RayCaster for CpuCaster {
    fn room(&self) -> usize {
        usize::MAX
    }

    fn begin(&mut self, pixel_rows: Range<u32>) -> Result<(), RenderError> {
        // Two bands' rays never exist at once: the budget has room for one.
        self.states = Rays::default();
        self.band = self.frame.band(pixel_rows);
        self.states = self.band.begin();
        self.counters.rays += self.band.ray_count();
        Ok(())
    }

    fn cast_pass(&mut self, view: &HostView<'_>) -> Result<PassReport, RenderError> {
        let feedback = cast_pass(view, &self.band, &mut self.states);
        self.counters.add(&feedback.counters);
        Ok(PassReport {
            unfinished_rays: feedback.misses.iter().map(|miss| miss.rays).sum(),
            misses: feedback.misses.into_iter().map(|miss| miss.key).collect(),
            uses: feedback.uses,
            fallbacks: feedback.counters.parent_bricks,
            is_stopped: feedback.is_stopped,
        })
    }

    fn update(&mut self, _view: &HostView<'_>, _fetched: &Fetched) -> Result<(), RenderError> {
        Ok(())
    }

    fn image(&mut self) -> Result<Image, RenderError> {
        self.note_band();
        Ok(self.band.image(&self.states))
    }

    fn totals(&self) -> CasterTotals {
        CasterTotals {
            rays: self.counters,
            instructions: self.frame.instructions().map(InstructionSet::name),
            errors: self.frame.errors(self.errors),
            device: None,
        }
    }
}
