//! Frames by one streamer, one after the other: what a viewer does, and a headless run does not.
//!
//! The CPU ray caster throughout. What a frame cost is counted from its own beginning, although the streamer counts from
//! its own.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use supervol_format::{Container, Lod};
use supervol_runtime::frame::RenderError;
use supervol_runtime::frame::caster::{CpuCaster, PassReport, RayCaster};
use supervol_runtime::frame::{
    Backend, FrameWalk, LevelChoice, Progress, RenderOptions, classifier_for, cpu_frame, plan_host, streamer_for,
};
use supervol_runtime::image::Image;
use supervol_runtime::lod::by_error::ANY_ERROR;
use supervol_runtime::scene::ResolvedScene;
use supervol_runtime::stats::FrameStats;
use supervol_runtime::streamer::budget::HostPlan;
use supervol_runtime::streamer::priority::FrontToBack;
use supervol_runtime::streamer::{Fetched, OnMissing, StreamError, Streamer};

use crate::context::ChartError;
use crate::measure::Spread;
use crate::volume::{HOST_MEMORY_BYTES, Point, Volume, transfer_function};

/// What the frames of a session have in common.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Threads that cast and decode.
    pub threads: usize,
    /// Which level bricks are taken from.
    pub level: LevelChoice,
    /// Bytes of host memory.
    pub host_memory_bytes: u64,
    /// Bytes of the host cache, where it is not to have all that is left of the host memory.
    pub cache_bytes: Option<u64>,
}

impl Default for Settings {
    fn default() -> Self {
        Self { threads: 2, level: LevelChoice::Auto, host_memory_bytes: HOST_MEMORY_BYTES, cache_bytes: None }
    }
}

impl Settings {
    /// The same with level 0 everywhere.
    pub fn finest(self) -> Self {
        Self { level: LevelChoice::Fixed(Lod::FINEST), ..self }
    }

    fn options(&self) -> RenderOptions<'static> {
        RenderOptions {
            backend: Backend::Cpu,
            level: self.level,
            host_memory_bytes: self.host_memory_bytes,
            // Levels go by the size of voxels alone: BRICKID states the width of all values as the error of every brick,
            // and the number of bricks is to follow the picture.
            max_error: ANY_ERROR,
            ..RenderOptions::default()
        }
    }
}

/// A streamer that outlives its frames.
pub struct Session {
    container: Arc<Container>,
    settings: Settings,
    plan: HostPlan,
    pool: rayon::ThreadPool,
    /// The streamer, for whoever wants to look.
    pub streamer: Streamer,
}

/// One frame of a session.
pub struct Frame {
    /// The picture.
    pub image: Image,
    /// As the streamer counts them: since it was made.
    pub stats: FrameStats,
    /// Bricks that came into the cache in this frame.
    pub page_ins: u64,
    /// Queued bricks that were dropped in this frame.
    pub cancelled: u64,
    /// Passes after which rays waited although nothing had been read for those that waited before.
    pub idle_passes: u64,
    /// Wall time.
    pub ms: f64,
}

impl Session {
    /// A session whose budget is divided for frames like this one.
    ///
    /// # Errors
    /// If the budget is too small, or threads cannot be started.
    pub fn new(container: &Arc<Container>, scene: &ResolvedScene, settings: Settings) -> Result<Self, ChartError> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(settings.threads).build();
        let pool = pool.map_err(|e| ChartError::Command(format!("{} threads: {e}", settings.threads)))?;
        // With a deadline one brick more must fit: frames of a session may have one.
        let options = RenderOptions { time_budget_ms: Some(0), ..settings.options() };
        let mut plan = pool.install(|| plan_host(container, scene, &options)).map_err(RenderError::from)?;
        plan.cache_bytes = settings.cache_bytes.unwrap_or(plan.cache_bytes);
        let streamer = streamer_for(container, scene, &options, plan);
        Ok(Self { container: container.clone(), settings, plan, pool, streamer })
    }

    /// The ray caster of a scene.
    pub fn caster(&self, scene: &ResolvedScene) -> CpuCaster {
        CpuCaster::new(cpu_frame(&self.container, scene, &self.settings.options(), &self.plan))
    }

    /// The session's camera and transfer function become those of a scene.
    pub fn look(&mut self, scene: &ResolvedScene) {
        let descriptor = self.container.descriptor();
        self.streamer.set_order(FrontToBack::new(&scene.camera, &descriptor.geometry));
    }

    /// The transfer function, mode or iso values changed.
    pub fn edit(&mut self, scene: &ResolvedScene) {
        let options = self.settings.options();
        self.streamer.set_classifier(classifier_for(&self.container, scene, &options));
    }

    /// Runs something on the session's threads.
    pub fn run<T: Send>(&mut self, work: impl FnOnce(&mut Streamer) -> T + Send) -> T {
        let (pool, streamer) = (&self.pool, &mut self.streamer);
        pool.install(|| work(streamer))
    }

    /// Passes of a frame that nobody finishes: at most `most`. `tick` is handed what each pass reported and does the
    /// streamer's part. Returns the number of passes.
    ///
    /// # Errors
    /// If there is no progress, or memory does not suffice.
    pub fn passes(
        &mut self,
        scene: &ResolvedScene,
        most: usize,
        mut tick: impl FnMut(&mut Streamer, &PassReport) -> Result<Fetched, StreamError> + Send,
    ) -> Result<usize, ChartError> {
        self.look(scene);
        let mut caster = self.caster(scene);
        self.run(|streamer| {
            streamer.begin_frame();
            caster.begin(0..scene.image_size[1])?;
            for pass in 1..=most {
                streamer.begin_pass();
                let report = caster.cast_pass(&streamer.view(OnMissing::Wait))?;
                let fetched = tick(streamer, &report)?;
                if report.unfinished_rays == 0 {
                    return Ok(pass);
                }
                caster.update(&streamer.view(OnMissing::Wait), &fetched)?;
            }
            Ok::<_, RenderError>(most)
        })
        .map_err(ChartError::from)
    }

    /// The next frame; with a time budget it may end before it has converged.
    ///
    /// # Errors
    /// If there is no progress, or memory does not suffice.
    pub fn frame(&mut self, scene: &ResolvedScene, time_budget_ms: Option<u64>) -> Result<Frame, ChartError> {
        self.look(scene);
        let passes: Mutex<Vec<Progress>> = Mutex::default();
        let note = |progress: Progress| passes.lock().unwrap_or_else(PoisonError::into_inner).push(progress);
        let options = RenderOptions { time_budget_ms, progress: Some(&note), ..self.settings.options() };
        let before = (page_ins(&self.streamer), self.streamer.counters().cancelled);
        let mut caster = self.caster(scene);
        let (plan, start) = (self.plan, Instant::now());
        let (image, stats) = self.run(|streamer| {
            let mut walk = FrameWalk::new(streamer, plan, &options, start);
            let image = walk.run(&mut caster, scene.image_size);
            image.map(|image| (image, walk.into_stats()))
        })?;
        let ms = start.elapsed().as_secs_f64() * 1e3;
        let passes = passes.into_inner().unwrap_or_else(PoisonError::into_inner);
        let is_idle =
            |w: &&[Progress]| w[0].rays_waiting > 0 && w[1].rays_waiting > 0 && w[0].bytes_read == w[1].bytes_read;
        Ok(Frame {
            image,
            page_ins: page_ins(&self.streamer) - before.0,
            cancelled: stats.cancelled - before.1,
            idle_passes: passes.windows(2).filter(is_idle).count() as u64,
            stats,
            ms,
        })
    }
}

fn page_ins(streamer: &Streamer) -> u64 {
    let levels = streamer.container().pyramid().levels().len();
    (0..levels).map(|lod| streamer.states().page_ins(Lod(lod as u8))).sum()
}

/// One frame by a streamer of its own, converged.
///
/// # Errors
/// As [`Session::frame`].
pub fn fresh(volume: &Volume, scene: &ResolvedScene, settings: Settings) -> Result<Frame, ChartError> {
    Session::new(&volume.container, scene, settings)?.frame(scene, None)
}

/// Everything shows, and rays get through to the far side of a volume with this radius.
pub fn translucent(radius: f64) -> String {
    const POINTS: [Point; 3] =
        [(0.0, [0.1, 0.2, 0.9], 0.05), (125.0, [0.9, 0.9, 0.8], 0.15), (249.0, [1.0, 0.5, 0.1], 0.3)];
    transfer_function(0.5 * radius, &POINTS)
}

/// The scene of these members.
///
/// # Errors
/// If they make none.
pub fn scene(volume: &Volume, members: &[String]) -> Result<ResolvedScene, ChartError> {
    volume.scene(&members.iter().map(String::as_str).collect::<Vec<_>>())
}

/// Pixels that `whole` shows something in and `picture` does not.
pub fn pixels_lost(picture: &Image, whole: &Image) -> usize {
    picture.pixels.iter().zip(&whole.pixels).filter(|(p, w)| w[3] > 0.0 && p[3] <= 0.0).count()
}

/// Greatest difference of any channel.
pub fn linf(a: &Image, b: &Image) -> f64 {
    crate::measure::distance(a, b).linf
}

/// The middle of some times.
///
/// # Panics
/// If there are none.
pub fn median(numbers: &[f64]) -> f64 {
    Spread::of(numbers).median_ms
}
