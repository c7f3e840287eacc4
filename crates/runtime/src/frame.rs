//! One frame, from an open container to an image: what it is made with, and its passes ([`walk`]).
//!
//! ```text
//! plan the host budget --> for each band of rows: cast --> misses --> fetch --> cast ... until no ray waits --> image
//! ```
//!
//! Without a deadline the picture always converges: it depends neither on the budgets, nor on the number of threads, nor on
//! the order in which bricks arrive. With one, rays that wait when the time is up go on through coarser bricks, or stop where
//! they are, as [`crate::renderer`] wants it.

pub mod caster;
pub mod check;
pub(crate) mod gpu;
pub mod maps;
pub mod predict;
pub mod reference;
pub mod stated;
pub mod walk;

use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Instant;

use crate::counters::{RayCounters, StreamCounters, milliseconds};
use crate::facts::value_map;
use supervol_format::container::ContainerError;
use supervol_format::container::toc;
use supervol_format::readable::Mib;
use supervol_format::{Container, Lod};

use crate::image::Image;
use crate::lod::by_error::{DataScale, LevelsByError};
use crate::lod::deviation::Deviations;
use crate::lod::{LodChoice, LodRule};
use crate::raycast::cpu::{Caster, CpuFrame, CpuQuality, Skipping};
use crate::raycast::gpu::GpuError;
use crate::raycast::reference::render_reference_counted;
use crate::scene::ResolvedScene;
use crate::stats::FrameStats;
use crate::stop::Stop;
use crate::streamer::budget::{BrickBytes, BudgetError, CasterBytes, Demand, HostPlan};
use crate::streamer::classify::Classifier;
use crate::streamer::priority::FrontToBack;
use crate::streamer::{StreamError, Streamer};
use crate::units::InUnits;
use caster::CpuCaster;
pub use gpu::render_gpu_surviving;
pub use walk::{FrameWalk, PASS_LIMIT};

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

/// Called with how far a frame has come, from one thread at a time.
pub type OnProgress = Arc<dyn Fn(Progress) + Send + Sync>;

/// How a frame is made.
#[derive(Clone)]
pub struct RenderOptions {
    /// Who casts the rays.
    pub backend: Backend,
    /// Which level bricks are taken from.
    pub level: LevelChoice,
    /// Bytes that the frame may hold in host memory.
    pub host_memory_bytes: u64,
    /// Of these, what the process holds beside the frame: program, stacks, manifest, what the allocator keeps.
    pub process_bytes: u64,
    /// Most bytes of decoded bricks among these; `None`: all that is left of them.
    pub cache_bytes: Option<u64>,
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
    /// Whether it is counted what the rays of each pixel cost, for a map of that: several times the time, on the CPU. Nothing else of the
    /// picture changes.
    pub count_work: bool,
    /// Called after each pass.
    pub progress: Option<OnProgress>,
    /// Counts up while packets finish rays, for who wants to know how far a pass has come.
    pub rays_finished: Option<Arc<AtomicU64>>,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            backend: Backend::Auto,
            level: LevelChoice::Auto,
            host_memory_bytes: 512 << 20,
            process_bytes: 0,
            cache_bytes: None,
            gpu_memory_bytes: 256 << 20,
            threads: None,
            skipping: Skipping::On,
            caster: Caster::DEFAULT,
            time_budget_ms: None,
            max_error: 0.5 / 255.0,
            predict_error: false,
            count_work: false,
            progress: None,
            rays_finished: None,
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
        "level {level} needs {} for the reference integrator, but the host budget is {}; give more memory or choose a \
         coarser level",
        Mib(*needed_bytes), Mib(*budget_bytes)
    )]
    ReferenceTooLarge { level: u8, needed_bytes: u64, budget_bytes: u64 },
    #[error(
        "the check of level {level} needs {} for the reference integrator, but the host budget is {}; give more memory, \
         or draw and check a coarser level (finest that fits: {finest_that_fits:?})",
        Mib(*needed_bytes), Mib(*budget_bytes)
    )]
    CheckTooLarge { level: u8, needed_bytes: u64, budget_bytes: u64, finest_that_fits: Option<u8> },
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error("methods of comparison are for the cpu backend and mode dvr; found backend {backend:?} and mode {mode}")]
    Method { backend: Backend, mode: &'static str },
    #[error(
        "slices within the picture are drawn by the backends cpu and reference (and auto, which takes cpu then); found gpu"
    )]
    SlicesOnGpu,
    #[error(
        "volumes clipped by solids are drawn by the backends cpu and reference (and auto, which takes cpu then); found gpu"
    )]
    SolidsOnGpu,
    #[error("surfaces inside the volume (mode dvr with iso) are drawn by --backend cpu or reference only")]
    SurfacesOnGpu,
    #[error("mode mean shows no place that could be picked: all points of a ray count alike")]
    NoPlace,
    #[error("pixel {},{}: the picture has {} x {} pixels, the first is 0,0", pixel[0], pixel[1], size[0], size[1])]
    NoSuchPixel { pixel: [u32; 2], size: [u32; 2] },
    #[error("{threads} threads cannot be started: {message}")]
    Threads { threads: usize, message: String },
    #[error(
        "a mistake of supervol: after pass {pass}, {unfinished_rays} rays wait for {misses} bricks, the first of which is \
         {first}, but nothing could be done for them"
    )]
    NoProgress { pass: u64, unfinished_rays: u64, misses: usize, first: String },
    #[error("the picture was cancelled before it was whole")]
    Cancelled,
    #[error("a mistake of supervol: {unfinished_rays} rays are still unfinished after {PASS_LIMIT} passes")]
    TooManyPasses { unfinished_rays: u64 },
}

/// Threads for a frame: `None` is one per processor.
pub(crate) fn thread_pool(threads: Option<usize>) -> Result<rayon::ThreadPool, RenderError> {
    let threads = threads.unwrap_or_else(rayon::current_num_threads).max(1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|e| RenderError::Threads { threads, message: e.to_string() })
}

/// Divides the host budget for a frame that the CPU makes.
///
/// # Errors
/// If it is too small.
pub fn plan_host(
    container: &Container,
    scene: &ResolvedScene,
    options: &RenderOptions,
) -> Result<HostPlan, BudgetError> {
    let caster = caster_of(options).bytes(container.pyramid().layout().core());
    plan_host_for(caster, container, scene, options, options.time_budget_ms.is_some())
}

/// Divides the host budget for a frame that a ray caster makes who holds so much, with or without a deadline.
pub(crate) fn plan_host_for(
    caster: CasterBytes,
    container: &Container,
    scene: &ResolvedScene,
    options: &RenderOptions,
    has_deadline: bool,
) -> Result<HostPlan, BudgetError> {
    let demand = Demand {
        image_size: scene.image_size,
        subgrid: scene.subgrid,
        caster,
        brick: BrickBytes::of(container),
        has_deadline,
        threads: rayon::current_num_threads() as u64,
        toc_pages: toc::pages_for(container.pyramid().brick_count()),
        // Meshes stay in memory as long as the scene does.
        process_bytes: options.process_bytes.saturating_add(scene.clip.bytes()),
    };
    let plan = HostPlan::new(options.host_memory_bytes, &demand)?;
    Ok(HostPlan {
        cache_bytes: options.cache_bytes.map_or(plan.cache_bytes, |most| plan.cache_bytes.min(most)),
        ..plan
    })
}

/// Level of detail as the ray casters and the streamer take it.
#[must_use]
pub fn lod_choice(options: &RenderOptions) -> LodChoice {
    match options.level {
        LevelChoice::Auto => CpuQuality::default().lod,
        LevelChoice::Fixed(lod) => LodChoice::Fixed(lod),
    }
}

/// What all rays of the CPU ray caster share in a frame.
#[must_use]
pub fn cpu_frame(container: &Container, scene: &ResolvedScene, options: &RenderOptions, plan: &HostPlan) -> CpuFrame {
    cpu_frame_of(container, scene, options, (lod_choice(options), plan))
}

/// The same with levels of its own.
pub(crate) fn cpu_frame_of(
    container: &Container,
    scene: &ResolvedScene,
    options: &RenderOptions,
    (lod, plan): (LodChoice, &HostPlan),
) -> CpuFrame {
    let InUnits { geometry, value_range, .. } = InUnits::of(container);
    let quality =
        CpuQuality { lod, skipping: options.skipping, caster: caster_of(options), made_bytes: plan.made_bytes };
    let frame = CpuFrame::new(scene, container.pyramid(), &geometry, value_map(container), value_range, quality);
    let frame = frame.counting(options.rays_finished.clone());
    if !options.predict_error {
        return frame;
    }
    frame.with_deviations(with_data_scale(container, |data| Deviations::new(scene, data)))
}

/// The ray caster that the options mean.
pub(crate) fn caster_of(options: &RenderOptions) -> Caster {
    let caster = options.caster.clone().with_max_error(options.max_error);
    let caster = if options.count_work { caster.counting_work() } else { caster };
    if options.predict_error { caster.summing_errors() } else { caster }
}

/// What comes of what the rules of levels must know of a container.
fn with_data_scale<T>(container: &Container, make: impl FnOnce(&DataScale<'_>) -> T) -> T {
    let InUnits { geometry, scale, offset, value_range } = InUnits::of(container);
    let voxel_error = container.descriptor().voxel_error() * scale.abs();
    make(&DataScale { pyramid: container.pyramid(), geometry: &geometry, scale, offset, value_range, voxel_error })
}

/// A streamer with an empty cache for frames of this scene.
#[must_use]
pub fn streamer_for(
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions,
    plan: HostPlan,
) -> Streamer {
    let order = FrontToBack::new(&scene.camera, &InUnits::of(container).geometry);
    let classifier = classifier_for(container, scene, options);
    Streamer::new(container.clone(), value_map(container), classifier, order, plan)
}

/// What the table of contents decides about bricks, for frames of this scene.
#[must_use]
pub fn classifier_for(container: &Container, scene: &ResolvedScene, options: &RenderOptions) -> Classifier {
    let descriptor = container.descriptor();
    let classifier = Classifier::new(scene, descriptor.voxel_type, value_map(container), options.skipping);
    // Who asks for a level gets it.
    if let LevelChoice::Fixed(_) = options.level {
        return classifier;
    }
    classifier.with_levels(with_data_scale(container, |data| {
        let lod = LodRule::new(lod_choice(options), &scene.camera, data.geometry);
        LevelsByError::new(scene, data, lod, options.max_error)
    }))
}

/// Makes the picture on the CPU in one go, on the calling thread's pool, from what the streamer has and fetches. What a
/// [`Renderer`](crate::renderer::Renderer) adds to the statistics is missing.
///
/// # Errors
/// As [`crate::renderer::render`].
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

/// The picture by the reference integrator.
///
/// # Errors
/// If the level does not fit the host budget, or a brick cannot be read.
pub(crate) fn render_from_reference(
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions,
) -> Result<(Image, FrameStats), RenderError> {
    let lod = check::level_to_check(container, options.level);
    let volume = reference::load_level(container, lod, scene, options.host_memory_bytes)?;
    let start = Instant::now();
    let picture = render_reference_counted(&volume, &reference::scene_of_level(container, lod, scene));
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
