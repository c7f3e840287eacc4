//! Sessions: several frames by one renderer, as in a viewer.
//!
//! The default backend is the CPU ray caster.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use supervol_format::{Container, Lod};
use supervol_runtime::lod::by_error::ANY_ERROR;
use supervol_runtime::render::options::{Backend, LevelChoice, Progress, RenderOptions};
use supervol_runtime::render::renderer::{Ahead, Renderer};
use supervol_runtime::render::stats::FrameStats;
use supervol_runtime::stream::streamer::Streamer;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use crate::context::ChartError;
use crate::measure::Spread;
use crate::volume::{HOST_MEMORY_BYTES, Point, Volume, transfer_function};

/// Settings shared by all frames of a session.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// Threads for casting and decoding.
    pub threads: usize,
    /// Level of detail of the bricks.
    pub level: LevelChoice,
    /// Memory limit of the host, bytes.
    pub host_memory_bytes: u64,
    /// Capacity of the host cache, bytes; `None`: all host memory that is left.
    pub cache_bytes: Option<u64>,
    /// Backend that casts the rays.
    pub backend: Backend,
    /// Requested error, fraction of full scale. The default is `ANY_ERROR`, so that levels depend only on the size of
    /// voxels. BRICKID states its whole value range as the error of every brick, which would select too fine levels.
    pub max_error: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            threads: 2,
            level: LevelChoice::Auto,
            host_memory_bytes: HOST_MEMORY_BYTES,
            cache_bytes: None,
            backend: Backend::Cpu,
            max_error: ANY_ERROR,
        }
    }
}

impl Settings {
    /// The same settings with level 0 everywhere.
    pub fn finest(self) -> Self {
        Self { level: LevelChoice::Fixed(Lod::FINEST), ..self }
    }

    fn options(&self) -> RenderOptions {
        RenderOptions {
            backend: self.backend,
            level: self.level,
            host_memory_bytes: self.host_memory_bytes,
            cache_bytes: self.cache_bytes,
            threads: Some(self.threads),
            max_error: self.max_error,
            ..RenderOptions::default()
        }
    }
}

/// A renderer that is kept between frames and observed.
pub struct Session {
    renderer: Renderer,
    passes: Arc<Mutex<Vec<Progress>>>,
    /// Number of passes after which a frame is cancelled.
    cancel_after: Arc<AtomicU64>,
}

/// One frame of a session.
pub struct Frame {
    /// The picture.
    pub image: Image,
    /// Statistics of the frame.
    pub stats: FrameStats,
    /// Passes whose rays had to wait although nothing had been read for the rays that waited before.
    pub idle_passes: u64,
    /// Wall time, milliseconds.
    pub ms: f64,
}

impl Session {
    /// A session with an empty cache.
    ///
    /// If threads cannot be started.
    /// If threads cannot be started.
    pub fn new(container: &Arc<Container>, settings: Settings) -> Result<Self, ChartError> {
        let passes: Arc<Mutex<Vec<Progress>>> = Arc::default();
        let cancel_after = Arc::new(AtomicU64::new(u64::MAX));
        let canceller = Arc::new(Mutex::new(None));
        let (seen, most, stops) = (passes.clone(), cancel_after.clone(), canceller.clone());
        let progress = move |progress: Progress| {
            let mut seen = locked(&seen);
            seen.push(progress);
            if seen.len() as u64 >= most.load(Ordering::Relaxed) {
                locked(&stops).as_ref().map(supervol_runtime::stop::Canceller::cancel);
            }
        };
        let options = RenderOptions { progress: Some(Arc::new(progress)), ..settings.options() };
        let renderer = Renderer::new(supervol_runtime::render::volume::PlacedVolume::of(container.clone()), options)?;
        *locked(&canceller) = Some(renderer.canceller());
        Ok(Self { renderer, passes, cancel_after })
    }

    /// The streamer, for inspection.
    ///
    /// # Panics
    /// Before the first frame.
    pub fn streamer(&self) -> &Streamer {
        self.renderer.streamer().expect("a frame has been drawn")
    }

    /// Begins a frame and cancels it after this many passes.
    ///
    /// # Errors
    /// If there is no progress, or the memory is too small.
    pub fn begin_only(&mut self, scene: &ResolvedScene, passes: u64) -> Result<(), ChartError> {
        self.begin(scene);
        if passes == 0 {
            self.renderer.canceller().cancel();
        }
        self.cancel_after.store(passes, Ordering::Relaxed);
        let step = self.renderer.advance(None);
        self.cancel_after.store(u64::MAX, Ordering::Relaxed);
        step.map_err(ChartError::from).map(|_| ())
    }

    /// Draws the next frame; with a time budget it may end before it converges.
    ///
    /// # Errors
    /// If there is no progress, or the memory is too small.
    pub fn frame(&mut self, scene: &ResolvedScene, time_budget_ms: Option<u64>) -> Result<Frame, ChartError> {
        self.begin(scene);
        let start = Instant::now();
        self.renderer.advance(time_budget_ms.map(|ms| start + Duration::from_millis(ms)))?;
        let ms = start.elapsed().as_secs_f64() * 1e3;
        let image = self.renderer.picture().expect("nobody cancels").into_owned();
        let passes = locked(&self.passes);
        let is_idle =
            |w: &&[Progress]| w[0].rays_waiting > 0 && w[1].rays_waiting > 0 && w[0].bytes_read == w[1].bytes_read;
        let idle_passes = passes.windows(2).filter(is_idle).count() as u64;
        Ok(Frame { image, idle_passes, stats: self.renderer.stats(), ms })
    }

    /// Reads ahead for the next frame, if the camera moves on as before, for at most this many milliseconds.
    ///
    /// # Errors
    /// If threads cannot be started.
    pub fn look_ahead(&mut self, most_ms: u64) -> Result<Ahead, ChartError> {
        Ok(self.renderer.look_ahead(Some(Instant::now() + Duration::from_millis(most_ms)))?)
    }

    /// Every frame is a new one, even for the same scene.
    fn begin(&mut self, scene: &ResolvedScene) {
        locked(&self.passes).clear();
        self.renderer.set_scene(scene.clone());
        self.renderer.begin_anew();
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// One converged frame by a new renderer.
///
/// # Errors
/// As [`Session::frame`].
pub fn fresh(volume: &Volume, scene: &ResolvedScene, settings: Settings) -> Result<Frame, ChartError> {
    Session::new(&volume.container, settings)?.frame(scene, None)
}

/// A transfer function for which everything is visible and rays reach the far side of a volume with this radius.
pub fn translucent(radius: f64) -> String {
    const POINTS: [Point; 3] =
        [(0.0, [0.1, 0.2, 0.9], 0.05), (125.0, [0.9, 0.9, 0.8], 0.15), (249.0, [1.0, 0.5, 0.1], 0.3)];
    transfer_function(0.5 * radius, &POINTS)
}

/// The scene with these members.
///
/// # Errors
/// If the members are not a valid scene.
pub fn scene(volume: &Volume, members: &[String]) -> Result<ResolvedScene, ChartError> {
    volume.scene(&members.iter().map(String::as_str).collect::<Vec<_>>())
}

/// Number of pixels that are not empty in `whole` but empty in `picture`.
pub fn pixels_lost(picture: &Image, whole: &Image) -> usize {
    picture.pixels.iter().zip(&whole.pixels).filter(|(p, w)| w[3] > 0.0 && p[3] <= 0.0).count()
}

/// Greatest difference of any channel.
pub fn linf(a: &Image, b: &Image) -> f64 {
    crate::measure::distance(a, b).linf
}

/// Median of some times, ms.
///
/// # Panics
/// If there are none.
pub fn median(numbers: &[f64]) -> f64 {
    Spread::of(numbers).median_ms
}
