//! The passes of one frame: streamer and engine alternate.

use std::ops::Range;
use std::time::{Duration, Instant};

use supervol_format::Lod;
use supervol_scene::image::Image;

use crate::engines::engine::{Advance, Engine, InSteps};
use crate::engines::maps::Maps;
use crate::render::accuracy::check;
use crate::render::accuracy::predict::{self, CastFacts};
use crate::render::error::RenderError;
use crate::render::options::{LevelChoice, Progress, RenderOptions};
use crate::render::stats::FrameStats;
use crate::stop::{LEAST_STEP, Stop};
use crate::stream::budget::{BrickBytes, HostPlan};
use crate::stream::counters::milliseconds;
use crate::stream::field::{Field, FieldBrick};
use crate::stream::streamer::{OnMissing, Room, Streamer};

/// Most passes of one band. Each pass but the last answers at least one brick that a ray waits for.
pub const PASS_LIMIT: u64 = 10_000_000;
/// Divisor of the host cache: the share of coarse levels kept for a deadline.
const KEPT_SHARE: u64 = 8;
/// Divisor of the time budget: the share of fetching coarse levels for a deadline.
const KEPT_TIME_SHARE: u32 = 4;

/// Least time that a pass waits for bricks, once it could begin.
const LEAST_PATIENCE: Duration = Duration::from_millis(10);

/// Runs one engine through the passes of one frame.
///
/// The streamer outlives the walk: its bricks serve the next frame.
#[derive(Debug)]
pub struct FrameWalk<'a> {
    streamer: &'a mut Streamer,
    plan: HostPlan,
    options: &'a RenderOptions,
    start: Instant,
    stop: Stop,
    stats: FrameStats,
    /// Time spent fetching bricks.
    fetching: Duration,
    rows: u32,
    rows_finished: u32,
    /// Whether it goes on with a frame of the streamer that another engine has begun.
    goes_on: bool,
}

/// Progress through the bands of a picture that is cast with interruptions.
#[derive(Debug, Clone, Default)]
pub struct BandProgress {
    /// Pixel rows of the band in progress; empty between two bands.
    rows: Range<u32>,
    /// Pixels of the bands before it.
    written_before: u64,
}

/// The bands of a picture that were finished before its walk was cancelled.
#[derive(Debug, Default)]
pub struct FinishedBands {
    /// Pixels of the picture, from the first band on.
    pixels: Vec<[f32; 4]>,
    /// Further maps requested of these pixels.
    maps: Maps,
    rows: u32,
    count: u64,
    /// Bricks that the rays of the band in progress wait for.
    wanted: Vec<FieldBrick>,
}

impl FinishedBands {
    /// No finished bands, with the memory of an older picture: new memory would cost as much time as a picture on fast
    /// devices.
    #[must_use]
    pub fn over(pixels: Vec<[f32; 4]>) -> Self {
        Self { pixels, ..Self::default() }
    }

    /// The maps of the picture's pixels; unknown in bands that are not finished.
    #[must_use]
    pub fn into_maps(self) -> Maps {
        self.maps
    }
}

impl<'a> FrameWalk<'a> {
    /// A walk whose time budget began at `start`.
    #[must_use]
    pub fn new(streamer: &'a mut Streamer, plan: HostPlan, options: &'a RenderOptions, start: Instant) -> Self {
        let deadline = options.time_budget_ms.map(|ms| start + Duration::from_millis(ms));
        let stats = FrameStats { converged: true, ..FrameStats::default() };
        Self {
            streamer,
            plan,
            options,
            start,
            stop: Stop::at(deadline),
            stats,
            fetching: Duration::ZERO,
            rows: 0,
            rows_finished: 0,
            goes_on: false,
        }
    }

    /// The same walk, in a frame that another engine has begun: what the streamer knows of drawn bricks stays.
    #[must_use]
    pub fn going_on(self) -> Self {
        Self { goes_on: true, ..self }
    }

    /// The same walk with this stop condition instead of the options'.
    #[must_use]
    pub fn until(self, stop: Stop) -> Self {
        Self { stop, ..self }
    }

    /// The same walk, continuing from these statistics of earlier walks for the same picture.
    #[must_use]
    pub fn after(self, stats: FrameStats) -> Self {
        Self { stats: FrameStats { converged: true, ..stats }, ..self }
    }

    /// Statistics of the walk. The streamer's counters count since the streamer was made.
    #[must_use]
    pub fn into_stats(self) -> FrameStats {
        self.stats
    }

    /// Time spent fetching bricks, waiting included.
    #[must_use]
    pub fn fetching(&self) -> Duration {
        self.fetching
    }

    /// Casts until the picture is complete. After the deadline, rays that wait take coarser bricks.
    ///
    /// # Errors
    /// If a device fails, memory does not suffice, there is no progress, or the walk is cancelled.
    pub fn run(&mut self, engine: &mut dyn Engine, image_size: [u32; 2]) -> Result<Image, RenderError> {
        let mut bands = FinishedBands::default();
        self.run_on(engine, image_size, &mut bands)
    }

    /// The same, after the bands that an earlier walk has finished. If this walk is cancelled, `bands` holds the bands
    /// finished by then.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn run_on(
        &mut self,
        engine: &mut dyn Engine,
        image_size: [u32; 2],
        bands: &mut FinishedBands,
    ) -> Result<Image, RenderError> {
        let [width, height] = image_size;
        self.rows = height;
        self.stats.bands += bands.count;
        self.begin_frame(engine);
        if self.stop.deadline().is_some() {
            self.keep_coarse_levels(engine)?;
        }
        let count = width as usize * height as usize;
        if bands.pixels.len() != count {
            bands.pixels = vec![[0.0; 4]; count];
        }
        bands.maps.begin(self.options.asked_maps(), image_size);
        let rows = self.plan.band_rows.min(engine.band_rows());
        for first in (bands.rows..height).step_by(rows as usize) {
            self.rows_finished = first;
            self.streamer.begin_band();
            engine.begin(first..first.saturating_add(rows).min(height))?;
            self.complete_band(engine, &mut bands.wanted)?;
            bands.rows = first.saturating_add(rows).min(height);
            let [begin, end] = [first, bands.rows].map(|row| row as usize * width as usize);
            engine.write_image(&mut bands.pixels[begin..end])?;
            bands.maps.write_over(first, engine.pixel_maps());
            bands.count += 1;
            self.stats.bands += 1;
        }
        self.rows_finished = height;
        self.gather_stats(engine);
        Ok(Image { width, height, pixels: std::mem::take(&mut bands.pixels) })
    }

    /// Casts until the picture is finished or the walk must stop. Finished pixels are written into `picture`, their
    /// maps into `maps`; returns their number. `bands` says where an earlier walk with the same engine stopped.
    ///
    /// # Errors
    /// If memory does not suffice, or there is no progress.
    pub fn run_over(
        &mut self,
        engine: &mut dyn InSteps,
        (picture, mut maps): (&mut Image, Option<&mut Maps>),
        bands: &mut BandProgress,
    ) -> Result<u64, RenderError> {
        self.rows = picture.height;
        self.stop = self.stop.not_before(Instant::now() + LEAST_STEP);
        engine.stop_at(&self.stop);
        if bands.rows == (0..0) {
            self.begin_frame(engine);
        }
        let mut written = bands.written_before;
        while bands.rows.start < picture.height {
            self.rows_finished = bands.rows.start;
            if bands.rows.is_empty() {
                let rows = self.plan.band_rows.min(engine.band_rows());
                bands.rows.end = bands.rows.start.saturating_add(rows).min(picture.height);
                self.streamer.begin_band();
                engine.begin(bands.rows.clone())?;
                self.stats.bands += 1;
            }
            let is_finished = self.cast_band(engine)?;
            written = bands.written_before + picture.write_over(bands.rows.start, &engine.finished_pixels());
            if let Some(maps) = &mut maps {
                maps.write_over(bands.rows.start, engine.pixel_maps());
            }
            if !is_finished {
                self.stats.converged = false;
                break;
            }
            *bands = BandProgress { rows: bands.rows.end..bands.rows.end, written_before: written };
        }
        self.gather_stats(engine);
        Ok(written)
    }

    fn begin_frame(&mut self, engine: &dyn Engine) {
        if let Some(order) = engine.order() {
            self.streamer.set_order(order);
        }
        if !self.goes_on {
            self.streamer.begin_frame();
        }
    }

    /// Runs the passes of a band until none of its rays waits. If cancelled, `wanted` holds the bricks that its rays
    /// wait for. They are fetched first when the walk resumes, because a pass may take longer than there is time.
    fn complete_band(&mut self, engine: &mut dyn Engine, wanted: &mut Vec<FieldBrick>) -> Result<(), RenderError> {
        let mut remaining = 0;
        for pass in 1..=PASS_LIMIT {
            if self.stop.is_cancelled() {
                return Err(RenderError::Cancelled);
            }
            let is_going_on = pass > 1 || !wanted.is_empty();
            // After the deadline nothing more is fetched: the next pass does not wait.
            if is_going_on && !self.stop.is_late() {
                self.fetch(pass, (wanted, remaining), engine, None)?;
            }
            let is_late = self.stop.is_late();
            let on_missing = if is_late { OnMissing::UseParent } else { OnMissing::Wait };
            let report = match self.pass(engine, on_missing) {
                Err(RenderError::Cancelled) if !wanted.is_empty() => {
                    // Requested without waiting: the next picture wants most of these bricks, too.
                    self.fetch(pass, (wanted, remaining), engine, None)?;
                    return Err(RenderError::Cancelled);
                }
                report => report?,
            };
            if is_late {
                self.stats.converged &= report.stood_in == 0;
                self.stats.bricks_missing_at_deadline += wanted.len() as u64;
            }
            (*wanted, remaining) = (report.wanted, report.remaining);
            if report.is_stopped {
                // Requested without waiting.
                self.fetch(pass, (wanted, remaining), engine, None)?;
                return Err(RenderError::Cancelled);
            }
            if remaining == 0 {
                wanted.clear();
                return Ok(());
            }
            if is_late {
                return Err(no_progress(pass, wanted, remaining));
            }
        }
        Err(RenderError::TooManyPasses { remaining, limit: PASS_LIMIT })
    }

    /// Runs the passes of a band until it is finished or the walk must stop; returns whether it is finished. Bricks are
    /// read while rays are cast. A pass waits for more bricks as long as the last pass took.
    fn cast_band(&mut self, engine: &mut dyn InSteps) -> Result<bool, RenderError> {
        let mut remaining = 0;
        for pass in 1..=PASS_LIMIT {
            let start = Instant::now();
            let report = self.pass(engine, OnMissing::Wait)?;
            let patience = start.elapsed().max(LEAST_PATIENCE);
            if !report.is_stopped && report.remaining == 0 {
                return Ok(true);
            }
            remaining = report.remaining;
            // Fetches also after the deadline, without waiting, so that the bricks are there in the next step, however
            // short steps are.
            self.fetch(pass, (&report.wanted, remaining), engine, Some(patience))?;
            if self.stop.is_due() {
                return Ok(false);
            }
        }
        Err(RenderError::TooManyPasses { remaining, limit: PASS_LIMIT })
    }

    fn pass(&mut self, engine: &mut dyn Engine, on_missing: OnMissing) -> Result<Advance, RenderError> {
        self.streamer.begin_pass();
        let start = Instant::now();
        let report = engine.advance(&self.streamer.view(on_missing))?;
        self.stats.render_ms += milliseconds(start.elapsed());
        self.stats.passes += 1;
        self.stats.fallbacks += report.stood_in;
        self.streamer.note_uses(&report.used, report.wanted.len() as u64);
        if let Some(progress) = &self.options.progress {
            progress(Progress {
                passes: self.stats.passes,
                rows_finished: self.rows_finished,
                rows: self.rows,
                rays_waiting: report.remaining,
                bytes_read: self.streamer.counters().bytes_read,
            });
        }
        Ok(report)
    }

    /// Fetches the bricks that `remaining` rays wait for, and gives them to the caster; see [`Room::patience`].
    fn fetch(
        &mut self,
        pass: u64,
        (wanted, remaining): (&[FieldBrick], u64),
        engine: &mut dyn Engine,
        patience: Option<Duration>,
    ) -> Result<(), RenderError> {
        let room = Room { bricks: engine.room(), stop: self.stop.clone(), patience };
        let start = Instant::now();
        let fetched = self.streamer.fetch(wanted, room)?;
        self.fetching += start.elapsed();
        if !fetched.is_progress() && !self.stop.is_due() {
            return Err(no_progress(pass, wanted, remaining));
        }
        Ok(engine.update(&self.streamer.view(OnMissing::Wait), &fetched)?)
    }

    /// Fetches the coarsest level in any case, and finer ones while they are small and the time allows. Rays fall back
    /// to them after the deadline.
    fn keep_coarse_levels(&mut self, engine: &mut dyn Engine) -> Result<(), RenderError> {
        let container = self.streamer.container().clone();
        let pyramid = container.pyramid();
        let brick_bytes = BrickBytes::of(&container).decoded;
        let most = (self.plan.cache_bytes / KEPT_SHARE / brick_bytes).min(engine.room() as u64 / KEPT_SHARE);
        let time = self.stop.deadline().map_or(Duration::ZERO, |d| d.saturating_duration_since(self.start));
        let time = time / KEPT_TIME_SHARE;
        let finest = match self.options.level {
            LevelChoice::Auto => Lod::FINEST,
            LevelChoice::Fixed(lod) => lod,
        };
        let mut kept = 0;
        for level in (0..=pyramid.coarsest().0).rev() {
            let lod = Lod(level);
            kept += pyramid.level_at(lod).brick_count();
            let is_optional = lod != pyramid.coarsest();
            if is_optional && (lod < finest || kept > most || self.start.elapsed() >= time) {
                break;
            }
            let keys = Field::FIRST.bricks(pyramid.keys_of(lod));
            // A level that takes too long is kept as far as it was read.
            let stop = self.stop.instead_at(is_optional.then(|| self.start + time));
            let room = Room { bricks: engine.room(), stop, patience: None };
            let fetched = self.streamer.fetch_to_keep(&keys, room)?;
            engine.update(&self.streamer.view(OnMissing::Wait), &fetched)?;
        }
        Ok(())
    }

    fn gather_stats(&mut self, engine: &dyn Engine) {
        self.stats.gather_streamer(self.streamer);
        let totals = engine.totals();
        let errors = totals.errors;
        self.stats.gather_engine(totals);
        let level = check::level_to_check(self.streamer.container(), self.options.level);
        let cast = CastFacts {
            rays_terminated_early: self.stats.casting.rays_terminated_early,
            fallbacks: self.stats.fallbacks,
            is_converged: self.stats.converged,
        };
        let predict = |errors| predict::predict(&errors, &cast, self.options, level);
        self.stats.error_predicted = errors.map(predict);
    }
}

/// A bug: the engine waits, and no brick could be answered for it.
fn no_progress(pass: u64, wanted: &[FieldBrick], remaining: u64) -> RenderError {
    let first = wanted.first().map_or("none".into(), ToString::to_string);
    RenderError::NoProgress { pass, remaining, wanted: wanted.len(), first }
}
