//! The walk of one frame, from an open container to an image. Only this module knows streamer, cache and ray casters.
//!
//! ```text
//! plan the host budget --> for each band of rows: cast --> misses --> fetch --> cast ... until no ray waits --> image
//! ```
//!
//! Without a time budget the picture always converges: it depends neither on the budgets, nor on the number of threads,
//! nor on the order in which bricks arrive. With one, the coarsest level is fetched first and kept. On the CPU pictures of
//! ever smaller pixels follow (`deadline`), which stop where they are when the time is up. Other casters' rays that wait
//! then go on through coarser bricks: time is looked at between passes and between batches of reads, and a frame ends at most
//! one of these late. Either way the picture is complete, and the statistics say that it has not converged.

pub mod caster;
pub mod check;
mod deadline;
mod gpu;
pub mod predict;
pub mod reference;

use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::container::ContainerError;
use supervol_format::container::manifest::Source;
use supervol_format::container::toc;
use supervol_format::{BrickKey, Container, Lod, ValueRange};

use crate::image::Image;
use crate::lod::by_error::{DataScale, LevelsByError};
use crate::lod::{LodChoice, LodRule};
use crate::process;
use crate::raycast::cpu::{Caster, CpuFrame, CpuQuality, Skipping};
use crate::raycast::gpu::{GpuDevice, GpuError, may_have_hardware};
use crate::raycast::reference::render_reference_counted;
use crate::raycast::volume::ValueMap;
use crate::scene::{DataKind, Mode, ResolvedScene, VolumeFacts};
use crate::stats::{FrameStats, mode_name};
use crate::streamer::budget::{BrickBytes, BudgetError, CasterBytes, Demand, HostPlan};
use crate::streamer::classify::Classifier;
use crate::streamer::priority::FrontToBack;
use crate::streamer::{OnMissing, Room, StreamError, Streamer};
use caster::{CpuCaster, PassReport, RayCaster};
pub use gpu::render_gpu_surviving;

/// Most passes of one band. Each pass but the last answers at least one brick that a ray waits for.
pub const PASS_LIMIT: u64 = 10_000_000;
/// Part of the host cache, as a divisor, that coarse levels kept for a deadline may fill.
const KEPT_SHARE: u64 = 8;
/// Part of the time budget, as a divisor, that fetching coarse levels for a deadline may take.
const KEPT_TIME_SHARE: u32 = 4;

/// Who casts the rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Backend {
    /// A hardware GPU if there is one that can draw this, else the CPU.
    #[default]
    Auto,
    /// The ray caster in Rust.
    Cpu,
    /// The ray caster in WGSL.
    Gpu,
    /// The brute-force integrator, for small volumes.
    Reference,
}

/// Which level bricks are taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LevelChoice {
    /// The coarsest level that keeps the picture within the error asked for, and whose voxels are not larger than a pixel,
    /// brick by brick ([`crate::lod::by_error`]).
    #[default]
    Auto,
    /// This level everywhere; the coarsest where there is no such level.
    Fixed(Lod),
}

/// How far a frame has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Passes cast.
    pub passes: u64,
    /// Pixel rows of bands that are finished.
    pub rows_finished: u32,
    /// Pixel rows of the picture.
    pub rows: u32,
    /// Rays of the band that wait.
    pub rays_waiting: u64,
    /// Bytes read.
    pub bytes_read: u64,
}

/// How a frame is made.
#[derive(Clone)]
pub struct RenderOptions<'a> {
    /// Who casts the rays.
    pub backend: Backend,
    /// Which level bricks are taken from.
    pub level: LevelChoice,
    /// Bytes that the frame may hold in host memory.
    pub host_memory_bytes: u64,
    /// Bytes that the frame may hold on a graphics device.
    pub gpu_memory_bytes: u64,
    /// Threads that cast and decode; `None`: one per processor.
    pub threads: Option<usize>,
    /// Whether what cannot be seen is left out; the picture is the same.
    pub skipping: Skipping,
    /// Who casts rays on the CPU; anything but the default is for that backend only.
    pub caster: Caster,
    /// Milliseconds after which the picture is completed from what is there; `None`: it converges.
    pub time_budget_ms: Option<u64>,
    /// Error of the picture that is aimed for, a share of full scale: steers packets of rays, within
    /// [`MAX_ERROR_LIMITS`](crate::raycast::cpu::MAX_ERROR_LIMITS), and chooses levels where they are chosen automatically.
    /// From 1 on any picture will do, and voxels are as large as a pixel.
    pub max_error: f64,
    /// Whether the statistics say how far the picture may be off (`error_predicted`): 1 to 2 % of the time, on the CPU in
    /// mode `dvr`.
    pub predict_error: bool,
    /// Called after each pass.
    pub progress: Option<&'a (dyn Fn(Progress) + Sync)>,
}

impl Default for RenderOptions<'_> {
    fn default() -> Self {
        Self {
            backend: Backend::Auto,
            level: LevelChoice::Auto,
            host_memory_bytes: 512 << 20,
            gpu_memory_bytes: 256 << 20,
            threads: None,
            skipping: Skipping::On,
            caster: Caster::DEFAULT,
            time_budget_ms: None,
            max_error: 0.5 / 255.0,
            predict_error: false,
            progress: None,
        }
    }
}

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum RenderError {
    #[error(transparent)]
    Budget(#[from] BudgetError),
    #[error(transparent)]
    Stream(#[from] StreamError),
    #[error(transparent)]
    Container(#[from] ContainerError),
    #[error(
        "level {level} needs {needed_bytes} bytes for the reference integrator, but the host budget is {budget_bytes}; \
         give more memory or choose a coarser level"
    )]
    ReferenceTooLarge { level: u8, needed_bytes: u64, budget_bytes: u64 },
    #[error(
        "the check of level {level} needs {needed_bytes} bytes for the reference integrator, but the host budget is \
         {budget_bytes}; give more memory, or draw and check a coarser level (finest that fits: {finest_that_fits:?})"
    )]
    CheckTooLarge { level: u8, needed_bytes: u64, budget_bytes: u64, finest_that_fits: Option<u8> },
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error("methods of comparison are for the cpu backend and mode dvr; found backend {backend:?} and mode {mode}")]
    Method { backend: Backend, mode: &'static str },
    #[error("{threads} threads cannot be started: {message}")]
    Threads { threads: usize, message: String },
    #[error(
        "a mistake of supervol: after pass {pass}, {unfinished_rays} rays wait for {misses} bricks, the first of which is \
         {first}, but nothing could be done for them"
    )]
    NoProgress { pass: u64, unfinished_rays: u64, misses: usize, first: String },
    #[error("a mistake of supervol: {unfinished_rays} rays are still unfinished after {PASS_LIMIT} passes")]
    TooManyPasses { unfinished_rays: u64 },
}

/// Makes the picture of a scene from a container, within the given memory.
///
/// # Errors
/// If a budget is too small, threads cannot be started, or (reference backend only) a brick cannot be read: in all other
/// backends bricks that cannot be read are drawn from their parents and counted.
pub fn render(
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions<'_>,
) -> Result<(Image, FrameStats), RenderError> {
    if !options.caster.is_default() && (options.backend != Backend::Cpu || scene.mode != Mode::Dvr) {
        return Err(RenderError::Method { backend: options.backend, mode: mode_name(scene.mode) });
    }
    let (threads, pool) = thread_pool(options.threads)?;
    let (start, cpu_start) = (Instant::now(), process::cpu_time());
    let (image, mut stats) = pool.install(|| match options.backend {
        Backend::Auto => render_auto(container, scene, options, start),
        Backend::Cpu => render_cpu(container, scene, options, start),
        Backend::Gpu => render_gpu_surviving(&GpuDevice::open()?, &GpuDevice::open, container, scene, options, start),
        Backend::Reference => render_from_reference(container, scene, options),
    })?;
    [stats.image_width, stats.image_height] = scene.image_size;
    stats.threads = threads;
    stats.mode = mode_name(scene.mode);
    stats.level = match options.level {
        LevelChoice::Auto => None,
        LevelChoice::Fixed(lod) => Some(lod.min(container.pyramid().coarsest()).0),
    };
    stats.host_budget_bytes = options.host_memory_bytes;
    stats.gpu_budget_bytes = options.gpu_memory_bytes;
    stats.max_error_requested = options.max_error;
    stats.total_ms = milliseconds(start.elapsed());
    stats.cpu_ms = milliseconds(process::cpu_time().saturating_sub(cpu_start));
    stats.peak_rss_bytes = process::peak_resident_bytes();
    Ok((image, stats))
}

/// Threads for a frame: `None` is one per processor.
fn thread_pool(threads: Option<usize>) -> Result<(usize, rayon::ThreadPool), RenderError> {
    let threads = threads.unwrap_or_else(rayon::current_num_threads).max(1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    Ok((threads, pool.map_err(|e| RenderError::Threads { threads, message: e.to_string() })?))
}

/// What a scene must know of a container to be resolved.
#[must_use]
pub fn volume_facts(container: &Container) -> VolumeFacts {
    let (descriptor, manifest) = (container.descriptor(), container.manifest());
    let value_range = manifest.value_range.unwrap_or(ValueRange { min: 0.0, max: 1.0 });
    VolumeFacts {
        dims: descriptor.dims(),
        geometry: descriptor.geometry,
        value_range,
        percentiles: manifest.percentiles.iter().map(|&[percent, value]| (percent, value)).collect(),
        kind: data_kind(&manifest.source, value_range),
        has_zero_centre: value_range.min < 0.0 && value_range.max > 0.0,
    }
}

/// What the data are, by where they came from and how far their values reach: Hounsfield units go from air, near
/// -1000, to bone, above 400.
fn data_kind(source: &Source, value_range: ValueRange) -> DataKind {
    let seismic = source.format == "segy" || (source.format == "synth" && source.name.starts_with("seismic"));
    if seismic {
        DataKind::Seismic
    } else if value_range.min < -500.0 && value_range.max > 400.0 {
        DataKind::Ct
    } else {
        DataKind::Generic
    }
}

/// Render values of a container: see [`ValueMap`].
#[must_use]
pub fn value_map(container: &Container) -> ValueMap {
    let d = container.descriptor();
    let range = container.manifest().value_range.unwrap_or(ValueRange::EMPTY);
    ValueMap::for_container(d.voxel_type, d.scale, d.offset, d.absence.nodata, range)
}

/// Divides the host budget for a frame that the CPU makes.
///
/// # Errors
/// If it is too small.
pub fn plan_host(
    container: &Container,
    scene: &ResolvedScene,
    options: &RenderOptions<'_>,
) -> Result<HostPlan, BudgetError> {
    plan_host_for(options.caster.bytes(container.pyramid().layout().core()), container, scene, options)
}

/// Divides the host budget for a frame that a ray caster makes who holds so much.
fn plan_host_for(
    caster: CasterBytes,
    container: &Container,
    scene: &ResolvedScene,
    options: &RenderOptions<'_>,
) -> Result<HostPlan, BudgetError> {
    let demand = Demand {
        image_size: scene.image_size,
        subgrid: scene.subgrid,
        caster,
        brick: BrickBytes::of(container),
        has_deadline: options.time_budget_ms.is_some(),
        threads: rayon::current_num_threads() as u64,
        toc_pages: toc::pages_for(container.pyramid().brick_count()),
    };
    HostPlan::new(options.host_memory_bytes, &demand)
}

/// Level of detail as the ray casters and the streamer take it.
#[must_use]
pub fn lod_choice(options: &RenderOptions<'_>) -> LodChoice {
    match options.level {
        LevelChoice::Auto => CpuQuality::default().lod,
        LevelChoice::Fixed(lod) => LodChoice::Fixed(lod),
    }
}

/// What all rays of the CPU ray caster share in a frame.
#[must_use]
pub fn cpu_frame(
    container: &Container,
    scene: &ResolvedScene,
    options: &RenderOptions<'_>,
    plan: &HostPlan,
) -> CpuFrame {
    let descriptor = container.descriptor();
    let value_range = volume_facts(container).value_range;
    let caster = options.caster.clone().with_max_error(options.max_error);
    let caster = if options.predict_error { caster.summing_errors() } else { caster };
    let quality =
        CpuQuality { lod: lod_choice(options), skipping: options.skipping, caster, made_bytes: plan.made_bytes };
    CpuFrame::new(scene, &descriptor.pyramid, &descriptor.geometry, value_map(container), value_range, quality)
}

/// A streamer with an empty cache for frames of this scene.
#[must_use]
pub fn streamer_for(
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions<'_>,
    plan: HostPlan,
) -> Streamer {
    let order = FrontToBack::new(&scene.camera, &container.descriptor().geometry);
    let classifier = classifier_for(container, scene, options);
    Streamer::new(container.clone(), value_map(container), classifier, order, plan)
}

/// What the table of contents decides about bricks, for frames of this scene.
#[must_use]
pub fn classifier_for(container: &Container, scene: &ResolvedScene, options: &RenderOptions<'_>) -> Classifier {
    let descriptor = container.descriptor();
    let classifier = Classifier::new(scene, descriptor.voxel_type, value_map(container), options.skipping);
    // Who asks for a level gets it.
    if let LevelChoice::Fixed(_) = options.level {
        return classifier;
    }
    let data = DataScale {
        pyramid: &descriptor.pyramid,
        geometry: &descriptor.geometry,
        scale: descriptor.scale,
        offset: descriptor.offset,
        value_range: volume_facts(container).value_range,
    };
    let lod = LodRule::new(lod_choice(options), &scene.camera, &descriptor.geometry);
    classifier.with_levels(LevelsByError::new(scene, &data, lod, options.max_error))
}

/// A hardware GPU, or the CPU and the reason why not the GPU. Errors that both share are errors.
fn render_auto(
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions<'_>,
    start: Instant,
) -> Result<(Image, FrameStats), RenderError> {
    let device = if may_have_hardware() { Some(GpuDevice::open()) } else { None };
    let why = match device {
        None => "no graphics device is there".to_string(),
        Some(Ok(device)) if device.is_software() => format!("{} is a processor", device.name()),
        Some(Ok(device)) => match render_gpu_surviving(&device, &GpuDevice::open, container, scene, options, start) {
            Err(error @ (RenderError::Gpu(_) | RenderError::Budget(_))) => error.to_string(),
            other => return other,
        },
        Some(Err(error)) => error.to_string(),
    };
    let (image, stats) = render_cpu(container, scene, options, start)?;
    Ok((image, FrameStats { no_gpu_because: Some(why), ..stats }))
}

fn render_cpu(
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions<'_>,
    start: Instant,
) -> Result<(Image, FrameStats), RenderError> {
    let plan = plan_host(container, scene, options)?;
    match options.time_budget_ms {
        Some(ms) if options.caster.is_default() => {
            deadline::render_until(container, scene, options, plan, start, Duration::from_millis(ms))
        }
        _ => render_cpu_with(container, scene, options, plan, start),
    }
}

/// [`render`] on the CPU, on the calling thread's pool, with the host budget already divided. The time budget began at
/// `start`; what [`render`] adds to the statistics is missing.
///
/// # Errors
/// As [`render`].
pub fn render_cpu_with(
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions<'_>,
    plan: HostPlan,
    start: Instant,
) -> Result<(Image, FrameStats), RenderError> {
    let frame = cpu_frame(container, scene, options, &plan);
    let mut streamer = streamer_for(container, scene, options, plan);
    let mut walk = FrameWalk::new(&mut streamer, plan, options, start);
    let image = walk.run(&mut CpuCaster::new(frame), scene.image_size)?;
    Ok((image, FrameStats { backend: "cpu", ..walk.into_stats() }))
}

fn render_from_reference(
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions<'_>,
) -> Result<(Image, FrameStats), RenderError> {
    let lod = check::level_to_check(container, options.level);
    let volume = reference::load_level(container, lod, scene, options.host_memory_bytes)?;
    let start = Instant::now();
    let picture = render_reference_counted(&volume, &reference::scene_of_level(container, lod, scene));
    let level = container.pyramid().level_at(lod);
    let page_ins = level.brick_count();
    let stats = FrameStats {
        backend: "reference",
        converged: true,
        passes: 1,
        bands: 1,
        bricks_total: container.pyramid().brick_count(),
        page_ins,
        render_ms: milliseconds(start.elapsed()),
        rays: u64::from(scene.camera.width) * u64::from(scene.camera.height),
        reference_capped_pieces: picture.capped_pieces,
        error_bound: container.manifest().level_errors.get(lod.0 as usize).copied().unwrap_or(0.0),
        ..FrameStats::default()
    };
    Ok((picture.image, stats))
}

/// The passes of one frame: streamer and ray caster in turn.
///
/// The streamer outlives the walk: what it holds serves the next frame.
pub struct FrameWalk<'a> {
    streamer: &'a mut Streamer,
    plan: HostPlan,
    options: &'a RenderOptions<'a>,
    start: Instant,
    deadline: Option<Instant>,
    stats: FrameStats,
    rows: u32,
    rows_finished: u32,
}

impl<'a> FrameWalk<'a> {
    /// A walk whose time budget began at `start`.
    #[must_use]
    pub fn new(streamer: &'a mut Streamer, plan: HostPlan, options: &'a RenderOptions<'a>, start: Instant) -> Self {
        let deadline = options.time_budget_ms.map(|ms| start + Duration::from_millis(ms));
        let stats = FrameStats { converged: true, ..FrameStats::default() };
        Self { streamer, plan, options, start, deadline, stats, rows: 0, rows_finished: 0 }
    }

    /// The same walk with another deadline, after walks of the same frame that have these statistics.
    #[must_use]
    fn until(self, deadline: Instant, stats: FrameStats) -> Self {
        Self { deadline: Some(deadline), stats: FrameStats { converged: true, ..stats }, ..self }
    }

    /// Statistics of the walk; what the streamer counts, it counts since it was made.
    #[must_use]
    pub fn into_stats(self) -> FrameStats {
        self.stats
    }

    /// Casts until the picture is complete.
    ///
    /// # Errors
    /// If a device fails, memory does not suffice, or there is no progress.
    pub fn run(&mut self, caster: &mut dyn RayCaster, image_size: [u32; 2]) -> Result<Image, RenderError> {
        let [width, height] = image_size;
        self.rows = height;
        self.streamer.begin_frame();
        if self.deadline.is_some() {
            self.keep_coarse_levels(caster)?;
        }
        let mut image = Image { width, height, pixels: Vec::with_capacity(width as usize * height as usize) };
        for first in (0..height).step_by(self.plan.band_rows as usize) {
            self.streamer.begin_band();
            caster.begin(first..(first + self.plan.band_rows).min(height))?;
            self.cast_band(caster)?;
            image.pixels.extend(caster.image()?.pixels);
            self.stats.bands += 1;
            self.rows_finished = (first + self.plan.band_rows).min(height);
        }
        self.gather_stats(caster);
        Ok(image)
    }

    /// Casts until the caster's frame stops, and writes the pixels that are finished over those of `picture`; how many.
    ///
    /// # Errors
    /// As [`Self::run`].
    fn run_over(&mut self, caster: &mut CpuCaster, picture: &mut Image) -> Result<u64, RenderError> {
        self.rows = picture.height;
        self.streamer.begin_frame();
        let mut written = 0;
        let mut is_stopped = false;
        for first in (0..picture.height).step_by(self.plan.band_rows as usize) {
            self.streamer.begin_band();
            caster.begin(first..(first + self.plan.band_rows).min(picture.height))?;
            is_stopped = self.cast_band(caster)?;
            written += picture.write_over(first, &caster.finished_pixels());
            self.stats.bands += 1;
            if is_stopped {
                break;
            }
            self.rows_finished = (first + self.plan.band_rows).min(picture.height);
        }
        self.stats.converged &= !is_stopped;
        self.gather_stats(caster);
        Ok(written)
    }

    /// The pass loop of one band. Casters that stop when the time is up say so: then it is true; others complete the band from
    /// what is there.
    fn cast_band(&mut self, caster: &mut dyn RayCaster) -> Result<bool, RenderError> {
        let mut waiting = 0;
        for pass in 1..=PASS_LIMIT {
            let is_late = self.is_late();
            let on_missing = if is_late { OnMissing::UseParent } else { OnMissing::Wait };
            let report = self.cast_pass(caster, on_missing)?;
            if is_late {
                self.stats.converged &= report.fallbacks == 0;
                self.stats.bricks_missing_at_deadline += waiting;
            }
            if report.is_stopped || report.unfinished_rays == 0 {
                return Ok(report.is_stopped);
            }
            waiting = report.misses.len() as u64;
            // When the time is up nothing more is fetched: the next pass waits for nothing.
            if !is_late && self.is_late() {
                continue;
            }
            let room = Room { bricks: caster.room(), deadline: self.deadline };
            let fetched = self.streamer.fetch(&report.misses, room)?;
            if is_late || !fetched.is_progress() {
                let first = report.misses.first().map_or("none".into(), ToString::to_string);
                let (unfinished_rays, misses) = (report.unfinished_rays, report.misses.len());
                return Err(RenderError::NoProgress { pass, unfinished_rays, misses, first });
            }
            caster.update(&self.streamer.view(OnMissing::Wait), &fetched)?;
        }
        Err(RenderError::TooManyPasses { unfinished_rays: waiting })
    }

    fn cast_pass(&mut self, caster: &mut dyn RayCaster, on_missing: OnMissing) -> Result<PassReport, RenderError> {
        self.streamer.begin_pass();
        let start = Instant::now();
        let report = caster.cast_pass(&self.streamer.view(on_missing))?;
        self.stats.render_ms += milliseconds(start.elapsed());
        self.stats.passes += 1;
        self.stats.fallbacks += report.fallbacks;
        self.streamer.note_uses(&report.uses, report.misses.len() as u64);
        if let Some(progress) = self.options.progress {
            progress(Progress {
                passes: self.stats.passes,
                rows_finished: self.rows_finished,
                rows: self.rows,
                rays_waiting: report.unfinished_rays,
                bytes_read: self.streamer.counters().io.bytes_read,
            });
        }
        Ok(report)
    }

    fn is_late(&self) -> bool {
        self.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }

    /// Fetches the coarsest level, whatever it takes, and finer ones while they are small and the time allows: what rays
    /// fall back to when the time is up.
    fn keep_coarse_levels(&mut self, caster: &mut dyn RayCaster) -> Result<(), RenderError> {
        let container = self.streamer.container().clone();
        let pyramid = container.pyramid();
        let brick_bytes = BrickBytes::of(&container).decoded;
        let most = (self.plan.cache_bytes / KEPT_SHARE / brick_bytes).min(caster.room() as u64 / KEPT_SHARE);
        let time = self.deadline.map_or(Duration::ZERO, |d| d.saturating_duration_since(self.start)) / KEPT_TIME_SHARE;
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
            let keys: Vec<BrickKey> = pyramid.keys_of(lod).collect();
            // A level that there is no time for is kept as far as it came.
            let deadline = is_optional.then(|| self.start + time);
            let room = Room { bricks: caster.room(), deadline };
            let fetched = self.streamer.fetch_to_keep(&keys, room)?;
            caster.update(&self.streamer.view(OnMissing::Wait), &fetched)?;
        }
        Ok(())
    }

    fn gather_stats(&mut self, caster: &dyn RayCaster) {
        self.stats.gather_streamer(self.streamer);
        let totals = caster.totals();
        self.stats.rays = totals.rays;
        self.stats.rays_terminated_early = totals.rays_terminated_early;
        self.stats.samples = totals.samples;
        self.stats.cells = totals.cells;
        self.stats.cells_refined = totals.cells_refined;
        self.stats.cells_exact = totals.cells_exact;
        self.stats.instructions = totals.instructions;
        self.stats.macro_cells = totals.macro_cells;
        self.stats.macro_cells_skipped = totals.macro_cells_skipped;
        self.stats.gpu_bytes = totals.gpu_bytes;
        self.stats.gpu_page_ins = totals.gpu_page_ins;
        self.stats.gpu_anomalies = totals.gpu_anomalies;
        self.stats.gpu_dispatch_ms_max = totals.gpu_dispatch_ms_max;
        self.stats.adapter = totals.adapter;
        self.stats.upload_ms = milliseconds(totals.upload_time);
        let level = check::level_to_check(self.streamer.container(), self.options.level);
        let predict = |errors| predict::predict(&errors, &self.stats, self.options, level);
        self.stats.error_predicted = totals.errors.map(predict);
    }
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}
