//! The GPU ray caster as an engine: it copies bricks from the host cache to its slots.
//!
//! Its page table holds the state of bricks on the device. A brick that left the host cache may still be resident
//! there; a brick in the host cache may have to be copied again.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Arc;

use supervol_format::BrickKey;
use supervol_scene::image::Image;

use super::caster::{GpuRenderer, PageEntry};
use crate::engines::engine::{Advance, Engine};
use crate::engines::error::EngineError;
use crate::engines::maps::Maps;
use crate::engines::totals::{EngineErrors, EngineTotals, ErrorsByReason, GpuStats, PixelsAbove};
use crate::lod::deviation::Deviations;
use crate::stop::{Stop, WhenDue};
use crate::stream::counters::{DeviceCounters, RayCounters};
use crate::stream::field::FieldBrick;
use crate::stream::residency::{BrickView, Resident};
use crate::stream::streamer::{Fetched, HostView, OnMissing};

/// Stop condition of the engine, and the handling of its rays then.
#[derive(Debug, Clone)]
pub(crate) struct WhenToStop {
    pub(crate) stop: Stop,
    pub(crate) when_due: WhenDue,
}

/// The ray caster in WGSL.
pub(crate) struct GpuEngine {
    renderer: GpuRenderer,
    counters: RayCounters,
    stops: WhenToStop,
    /// Rows with rays in progress; kept when a picture is continued.
    rows: Range<u32>,
    /// Counters of the device before this picture.
    before: DeviceCounters,
    /// Errors of coarser levels, if they are summed up.
    deviations: Option<Arc<Deviations>>,
    /// Errors of the picture so far.
    errors: ErrorsByReason,
    /// The same of its rays that keep to the requested error.
    errors_within: ErrorsByReason,
    /// Whether a pixel of the bands so far may be off by more.
    is_above: Vec<bool>,
    /// Errors of the pixels of the last band.
    error_pixels: Option<Image>,
    /// Bricks without voxels to draw, of this picture and earlier ones. The next camera requests most of them again.
    answered: BTreeSet<FieldBrick>,
}

/// Most remembered bricks without voxels to draw, with some 40 bytes each.
const ANSWERED_LIMIT: usize = 1 << 15;

impl GpuEngine {
    /// An engine of so many rays; `before`: counters of its device before this picture.
    pub(crate) fn new(
        renderer: GpuRenderer,
        rays: u64,
        stops: WhenToStop,
        deviations: Option<Arc<Deviations>>,
        before: DeviceCounters,
    ) -> Self {
        Self {
            renderer,
            counters: RayCounters { rays, ..RayCounters::default() },
            stops,
            rows: 0..0,
            before,
            deviations,
            errors: ErrorsByReason::default(),
            errors_within: ErrorsByReason::default(),
            is_above: Vec::new(),
            error_pixels: None,
            answered: BTreeSet::new(),
        }
    }

    /// Continues the same picture, with another stop condition.
    pub(crate) fn resumed(self, stops: WhenToStop) -> Self {
        Self { stops, ..self }
    }

    /// The renderer, and the bricks without voxels to draw.
    pub(crate) fn into_parts(self) -> (GpuRenderer, BTreeSet<FieldBrick>) {
        (self.renderer, self.answered)
    }

    /// Takes over the bricks without voxels to draw.
    pub(crate) fn set_answered(&mut self, answered: BTreeSet<FieldBrick>) {
        self.answered = answered;
    }

    /// Largest errors of its rays so far; zero unless they are summed up.
    pub(crate) fn errors(&self) -> ErrorsByReason {
        self.errors
    }

    /// The pixels of the finished picture that may be off by more than requested; `None` if there are none, or none is known.
    pub(crate) fn take_pixels_above(&mut self) -> Option<PixelsAbove> {
        let is_above = std::mem::take(&mut self.is_above);
        let within = self.errors_within;
        is_above.contains(&true).then(|| PixelsAbove { is_above, within, totals_within: self.totals_of(within) })
    }

    /// The totals, if these are the errors.
    fn totals_of(&self, ErrorsByReason { cells, levels, .. }: ErrorsByReason) -> EngineTotals {
        let stats = self.renderer.stats();
        let counters = stats.counters.since(&self.before);
        let [ray_ends, transfer_function, rounding] = self.renderer.common_errors();
        let states_errors = self.deviations.is_some() && self.renderer.sums_cells();
        EngineTotals {
            rays: self.counters,
            errors: states_errors.then_some(EngineErrors { cells, levels, ray_ends, transfer_function, rounding }),
            device: Some(GpuStats { counters, ..stats }),
            ..EngineTotals::default()
        }
    }

    /// Copies bricks of the host cache to slots, as far as there are some for them.
    fn insert(&mut self, view: &HostView<'_>, keys: impl IntoIterator<Item = BrickKey>) -> Result<(), EngineError> {
        let mut bricks = Vec::new();
        for key in keys {
            if let (Resident::Brick(brick), false) = (view.stand_in(key), self.renderer.is_resident(key)) {
                if matches!(view.lookup(key), Resident::TooCoarse) {
                    self.renderer.set_state(key, PageEntry::TooCoarse);
                }
                bricks.push(brick);
            }
        }
        Ok(self.renderer.insert_all(&bricks)?)
    }

    /// Tells the renderer the state of a brick that has no voxels to copy.
    fn answer(&mut self, view: &HostView<'_>, key: BrickKey) {
        if matches!(view.lookup(key), Resident::TooCoarse) {
            self.renderer.set_state(key, PageEntry::TooCoarse);
        }
        match view.stand_in(key) {
            Resident::Nothing => self.renderer.set_state(key, PageEntry::Nothing),
            Resident::Uniform(value) => self.renderer.set_state(key, PageEntry::Uniform(value)),
            Resident::UseParent => self.renderer.set_state(key, PageEntry::Failed),
            Resident::Brick(_) | Resident::Missing | Resident::TooCoarse => {}
        }
    }

    /// The same, and remembers the brick.
    pub(crate) fn note_answer(&mut self, view: &HostView<'_>, key: FieldBrick) {
        if self.answered.len() >= ANSWERED_LIMIT {
            self.answered.clear();
        }
        self.answered.insert(key);
        self.answer(view, key.brick);
    }

    /// Ends all waiting: missing bricks are drawn from their parents. The coarsest bricks are resident.
    fn stop_waiting(&mut self, view: &HostView<'_>) -> Result<(), EngineError> {
        let coarsest = self.renderer.pyramid.coarsest();
        let keys: Vec<BrickKey> = self.renderer.pyramid.keys_of(coarsest).collect();
        self.insert(view, keys)?;
        for entry in 0..self.renderer.pyramid.brick_count() {
            let key = self.renderer.pyramid.key(entry).expect("entries below the count have keys");
            if self.renderer.is_resident(key) {
                continue;
            }
            self.answer(view, key);
            if matches!(view.stand_in(key), Resident::Brick(_) | Resident::Missing) {
                self.renderer.set_state(key, PageEntry::Failed);
            }
        }
        Ok(())
    }
}

impl Engine for GpuEngine {
    fn room(&self) -> usize {
        // One slot stays free for the coarsest brick, should the time run out.
        self.renderer.slot_capacity().saturating_sub(1).max(1)
    }

    fn band_rows(&self) -> u32 {
        (self.renderer.band_rows() / self.renderer.subgrid()).max(1)
    }

    fn begin(&mut self, pixel_rows: Range<u32>) -> Result<(), EngineError> {
        if self.rows != pixel_rows {
            let subgrid = self.renderer.subgrid();
            self.renderer.begin(pixel_rows.start * subgrid..pixel_rows.end * subgrid);
            self.rows = pixel_rows;
        }
        Ok(())
    }

    fn advance(&mut self, view: &HostView<'_>) -> Result<Advance, EngineError> {
        let is_late = view.on_missing() == OnMissing::UseParent;
        if is_late && self.stops.when_due == WhenDue::Pause {
            return Err(EngineError::Stopped);
        }
        if is_late {
            self.stop_waiting(view)?;
        }
        // A picture that is completed has no deadline: only a cancel request stops it.
        let stop = match self.stops.when_due {
            WhenDue::Pause => self.stops.stop.clone(),
            WhenDue::Complete => self.stops.stop.instead_at(None),
        };
        let feedback = self.renderer.cast_pass_until(&stop)?;
        self.counters.add(&feedback.counters);
        Ok(Advance {
            wanted: view.field().bricks(feedback.misses.into_iter().map(|miss| miss.key)),
            used: view.field().bricks(feedback.uses),
            remaining: feedback.unfinished_rays,
            stood_in: feedback.counters.parent_bricks,
            is_stopped: feedback.is_stopped,
        })
    }

    fn update(&mut self, view: &HostView<'_>, fetched: &Fetched) -> Result<(), EngineError> {
        fetched.answered.iter().chain(&fetched.neighbours).for_each(|key| self.note_answer(view, *key));
        self.insert(view, fetched.bricks.iter().map(|key| key.brick))
    }

    fn write_image(&mut self, to: &mut [[f32; 4]]) -> Result<(), EngineError> {
        let Some(deviations) = &self.deviations else { return Ok(self.renderer.write_image(to)?) };
        if let Some(band) = self.renderer.write_image_with_errors(deviations, to)? {
            self.errors = self.errors.or(band.greatest);
            self.errors_within = self.errors_within.or(band.greatest_within);
            self.is_above.extend(band.is_above);
            self.counters.rays_terminated_early += band.ended_early;
            self.error_pixels = Some(band.pixels);
        }
        Ok(())
    }

    fn pixel_maps(&mut self) -> Maps {
        Maps { errors: self.error_pixels.take(), work: None }
    }

    fn totals(&self) -> EngineTotals {
        self.totals_of(self.errors)
    }
}
