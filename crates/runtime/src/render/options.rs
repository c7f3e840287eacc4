//! How pictures are made: by whom, from which level, within how much memory and time, how exactly.

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
    /// Bytes that the frame may hold on a graphics device; `None`: what [`GpuDevice::default_memory`] says of it,
    /// or half of that, and so on, where it has no room for so much.
    ///
    /// [`GpuDevice::default_memory`]: crate::engines::gpu::device::GpuDevice::default_memory
    pub gpu_memory_bytes: Option<u64>,
    /// Threads that cast and decode; `None`: one per processor.
    pub threads: Option<usize>,
    /// Whether what cannot be seen is left out; the picture is the same.
    pub skipping: Skipping,
    /// Who casts rays on the CPU; anything but the default is for that backend only.
    pub caster: Caster,
    /// Milliseconds after which the picture is completed from what is there; `None`: it converges.
    pub time_budget_ms: Option<u64>,
    /// Error of the picture that is aimed for, a share of full scale: steers packets of rays, within
    /// [`MAX_ERROR_LIMITS`](crate::engines::rules::MAX_ERROR_LIMITS), and chooses levels where they are chosen automatically.
    /// From 1 on any picture will do, and voxels are as large as a pixel.
    pub max_error: f64,
    /// Whether it is said how far the picture may be off: of each pixel (`error_stated`), and in mode `dvr` term by term (`error_predicted`). 1 to
    /// 2 % of the time on the CPU, 3 to 6 % on graphics devices.
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
            gpu_memory_bytes: None,
            threads: None,
            skipping: Skipping::On,
            caster: Caster::DEFAULT,
            time_budget_ms: None,
            max_error: DEFAULT_ERROR,
            predict_error: false,
            count_work: false,
            progress: None,
            rays_finished: None,
        }
    }
}

impl RenderOptions {
    /// The same options, with a host budget that covers the whole process as it is now: program, stacks and all.
    #[must_use]
    pub fn for_whole_process(self) -> Self {
        Self { process_bytes: bytes_beside_pictures(self.threads), ..self }
    }

    /// Refuses numbers that mean nothing.
    ///
    /// # Errors
    /// [`RenderError::Option`], if the requested error is not a positive number, or there are to be no threads.
    pub fn validate(&self) -> Result<(), RenderError> {
        let wrong = |option, expected, found: f64| Err(RenderError::Option { option, expected, found });
        if self.max_error.is_nan() || self.max_error <= 0.0 {
            return wrong("max_error", "a positive share of full scale, for example 0.5 / 255", self.max_error);
        }
        if self.threads == Some(0) {
            return wrong("threads", "at least 1", 0.0);
        }
        Ok(())
    }

    /// Level of detail as the ray casters and the streamer take it.
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
