//! Options of a picture: backend, level, memory, time and accuracy.

use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use supervol_format::Lod;

use crate::engines::cpu::{Caster, CpuQuality};
use crate::engines::maps::AskedMaps;
use crate::engines::rules::DEFAULT_ERROR;
use crate::lod::LodChoice;
use crate::render::error::RenderError;
use crate::render::process::bytes_beside_pictures;
use crate::stream::classify::Skipping;
use crate::stream::held::BrickForm;

/// Choice of the device or integrator that draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Backend {
    /// A hardware GPU if one can draw this picture, else the CPU.
    #[default]
    Auto,
    /// The ray caster in Rust.
    Cpu,
    /// The ray caster in WGSL.
    Gpu,
    /// The brute-force integrator, for small volumes.
    Reference,
}

/// Choice of the level of bricks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LevelChoice {
    /// Brick by brick, the coarsest level that keeps the picture within the requested error and whose voxels are not
    /// larger than a pixel ([`crate::lod::by_error`]).
    #[default]
    Auto,
    /// This level everywhere; the coarsest if there is no such level.
    Fixed(Lod),
}

/// Picture that is shown while a finer one is cast in steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Refining {
    /// Finished tiles of the finer picture over the coarser one: as much as is known.
    #[default]
    Tiles,
    /// The coarser picture until the finer one is finished: evenly sharp, as windows need it.
    WholeStages,
}

/// Progress of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Passes cast.
    pub passes: u64,
    /// Pixel rows of finished bands.
    pub rows_finished: u32,
    /// Pixel rows of the picture.
    pub rows: u32,
    /// Waiting rays of the current band.
    pub rays_waiting: u64,
    /// Bytes read.
    pub bytes_read: u64,
}

/// Callback with the progress of a frame; called from one thread at a time.
pub type OnProgress = Arc<dyn Fn(Progress) + Send + Sync>;

/// Options of a frame.
#[derive(Clone)]
pub struct RenderOptions {
    /// The engine that casts the rays.
    pub backend: Backend,
    /// Choice of the level of bricks.
    pub level: LevelChoice,
    /// Bytes that the frame may hold in host memory.
    pub host_memory_bytes: u64,
    /// Part of these that the process holds beside the frame: program, stacks, manifest, memory kept by the allocator.
    pub process_bytes: u64,
    /// Part of these for decoded bricks, at most; `None`: all that is left.
    pub cache_bytes: Option<u64>,
    /// Form of bricks in the host cache; the picture is the same. Any but the default is for tests and measurements.
    pub brick_form: BrickForm,
    /// Bytes that the frame may hold on a graphics device. `None`: [`GpuDevice::default_memory`]; if the device has no
    /// room for that, half of it, and so on.
    ///
    /// [`GpuDevice::default_memory`]: crate::engines::gpu::device::GpuDevice::default_memory
    pub gpu_memory_bytes: Option<u64>,
    /// Threads that cast and decode; `None`: one per processor.
    pub threads: Option<usize>,
    /// Whether invisible parts are skipped; the picture is the same.
    pub skipping: Skipping,
    /// The CPU ray caster; any other than the default requires the CPU backend.
    pub caster: Caster,
    /// Milliseconds after which the picture is completed from resident bricks; `None`: it converges.
    pub time_budget_ms: Option<u64>,
    /// Largest allowed error of a pixel channel, as a fraction of full scale. It steers packets of rays, within
    /// [`MAX_ERROR_LIMITS`](crate::engines::rules::MAX_ERROR_LIMITS), and automatic levels. From 1 on, every picture
    /// suffices, and voxels are as large as a pixel.
    pub max_error: f64,
    /// Whether errors are stated: of each pixel (`error_stated`), and in mode `dvr` term by term (`error_predicted`).
    /// Costs 1 to 2 % of the time on the CPU. Graphics devices sum errors up in any case.
    pub predict_error: bool,
    /// Whether the work of each pixel's rays is counted, for a map: several times the time, on the CPU. The picture is
    /// the same.
    pub count_work: bool,
    /// Picture that is shown while a finer one is cast in steps on the CPU.
    pub refining: Refining,
    /// Called after each pass.
    pub progress: Option<OnProgress>,
    /// Counter of rays that packets finish: shows the progress within a pass.
    pub rays_finished: Option<Arc<AtomicU64>>,
}

impl std::fmt::Debug for RenderOptions {
    /// All options but the two that watch the progress.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RenderOptions")
            .field("backend", &self.backend)
            .field("level", &self.level)
            .field("host_memory_bytes", &self.host_memory_bytes)
            .field("process_bytes", &self.process_bytes)
            .field("cache_bytes", &self.cache_bytes)
            .field("brick_form", &self.brick_form)
            .field("gpu_memory_bytes", &self.gpu_memory_bytes)
            .field("threads", &self.threads)
            .field("skipping", &self.skipping)
            .field("caster", &self.caster)
            .field("time_budget_ms", &self.time_budget_ms)
            .field("max_error", &self.max_error)
            .field("predict_error", &self.predict_error)
            .field("count_work", &self.count_work)
            .field("refining", &self.refining)
            .finish_non_exhaustive()
    }
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            backend: Backend::Auto,
            level: LevelChoice::Auto,
            host_memory_bytes: 512 << 20,
            process_bytes: 0,
            cache_bytes: None,
            brick_form: BrickForm::ByBudget,
            gpu_memory_bytes: None,
            threads: None,
            skipping: Skipping::On,
            caster: Caster::DEFAULT,
            time_budget_ms: None,
            max_error: DEFAULT_ERROR,
            predict_error: false,
            count_work: false,
            refining: Refining::Tiles,
            progress: None,
            rays_finished: None,
        }
    }
}

impl RenderOptions {
    /// The same options with a host budget that covers the whole process as it is now, including program and stacks.
    #[must_use]
    pub fn for_whole_process(self) -> Self {
        Self { process_bytes: bytes_beside_pictures(self.threads), ..self }
    }

    /// Checks that all numbers are valid.
    ///
    /// # Errors
    /// [`RenderError::Option`], if the requested error is negative or no number, or there are to be no threads.
    pub fn validate(&self) -> Result<(), RenderError> {
        let wrong = |option, expected, found: f64| Err(RenderError::Option { option, expected, found });
        if self.max_error.is_nan() || self.max_error < 0.0 {
            return wrong("max_error", "a share of full scale from 0 on, for example 0.5 / 255", self.max_error);
        }
        if self.threads == Some(0) {
            return wrong("threads", "at least 1", 0.0);
        }
        Ok(())
    }

    /// Level choice in the form that ray casters and the streamer take.
    #[must_use]
    pub fn lod(&self) -> LodChoice {
        match self.level {
            LevelChoice::Auto => CpuQuality::default().lod,
            LevelChoice::Fixed(lod) => LodChoice::Fixed(lod),
        }
    }

    /// Maps that are made beside the picture.
    pub(crate) fn asked_maps(&self) -> AskedMaps {
        AskedMaps { errors: self.predict_error, work: self.count_work }
    }

    /// The ray caster that the options mean.
    pub(crate) fn ray_caster(&self) -> Caster {
        let caster = self.caster.clone().with_max_error(self.max_error);
        let caster = if self.count_work { caster.counting_work() } else { caster };
        if self.predict_error { caster.summing_errors() } else { caster }
    }

    /// The threads that cast and decode.
    ///
    /// # Errors
    /// If they cannot be started.
    pub(crate) fn thread_pool(&self) -> Result<rayon::ThreadPool, RenderError> {
        let threads = self.threads.unwrap_or_else(rayon::current_num_threads).max(1);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.map_err(|e| RenderError::Threads { threads, message: e.to_string() })
    }
}
