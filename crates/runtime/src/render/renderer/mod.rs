//! Renderer of successive pictures: loaded data serves the next picture, whatever changes.
//!
//! ```text
//! set_scene --> advance --> picture, stats --> advance --> better ones --> ... --> converged
//!          (look or view changes: set_scene again; bricks and what is known of them stay)
//! ```
//!
//! With a deadline, [`Renderer::advance`] always leaves a whole picture. Every further call improves it, until it
//! equals the picture that a new renderer draws without a deadline. The picture in progress is a
//! `Drawing` (`render::drawing`); `backend` decides which.
//!
//! [`Renderer::look_ahead`] reads for the next picture in idle time (`ahead`). [`render`] does all of this for one
//! picture.

mod ahead;
mod backend;
mod pick;

use std::borrow::Cow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::Container;
use supervol_scene::camera::Camera;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;
use supervol_scene::units::Units;

pub use self::ahead::Ahead;
use self::backend::Chosen;
pub use self::backend::{MakeEngine, NO_DEVICE};
pub use self::pick::{Picked, PickedOn};
use crate::engines::engine::Engine;
use crate::engines::gpu::device::GpuDevice;
use crate::engines::gpu::limits::SHARED_MEMORY;
use crate::engines::maps::Maps;
use crate::render::drawing::Drawing;
use crate::render::drawing::loaded::LoadedVolume;
use crate::render::drawing::means::Means;
use crate::render::error::RenderError;
use crate::render::frame::walk::FinishedBands;
use crate::render::frame::{FrameWalk, plan_host, streamer_for};
use crate::render::options::{Backend, LevelChoice, RenderOptions};
use crate::render::process;
use crate::render::stats::{FrameStats, OUTSIDE_ENGINE, mode_name};
use crate::render::volume::PlacedVolume;
use crate::stop::{Canceller, Stop};
use crate::stream::budget::DeadlineReserve;
use crate::stream::counters::milliseconds;
use crate::stream::streamer::Streamer;

/// Draws successive pictures of one volume.
pub struct Renderer {
    volume: PlacedVolume,
    options: RenderOptions,
    pool: rayon::ThreadPool,
    canceller: Canceller,
    /// `None` until a picture is drawn.
    backend: Option<Chosen>,
    /// Memory for deadlines; kept from the first deadline on.
    reserve: DeadlineReserve,
    resident: Option<LoadedVolume>,
    scene: Option<ResolvedScene>,
    /// The previous camera, if only the camera has changed.
    came_from: Option<Camera>,
    /// The picture in progress; `None` before it is begun.
    drawing: Option<Box<dyn Drawing>>,
    /// Cost of streaming before this picture.
    before: FrameStats,
    spent: Duration,
    cpu: Duration,
}

/// Result of one step of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Step {
    /// Nothing is left to do: every pixel is finished, from its wanted bricks or, if these failed, from coarser ones.
    pub is_finished: bool,
    /// The step was cancelled.
    pub is_cancelled: bool,
    /// Pixels that are taken from a coarser picture.
    pub pixels_unfinished: u64,
    /// Edge of a pixel of that coarser picture, in pixels; 0 if all pixels are finished.
    pub coarsest_pixel: u32,
    /// Missing bricks at the deadline, replaced by their coarser parents.
    pub bricks_missing: u64,
    /// Bricks that could not be read or decoded, replaced by their coarser parents. The picture then differs from the
    /// data there, even if converged.
    pub bricks_failed: u64,
}

impl Step {
    /// Whether the picture is finished and no brick failed.
    #[must_use]
    pub fn is_converged(&self) -> bool {
        self.is_finished && self.bricks_failed == 0
    }
}

impl std::fmt::Debug for Renderer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Renderer").field("options", &self.options).field("scene", &self.scene).finish_non_exhaustive()
    }
}

impl Renderer {
    /// A renderer that has loaded nothing. `options` apply to its pictures, except that `time_budget_ms` applies to
    /// [`render`] only.
    ///
    /// # Errors
    /// If an option is invalid ([`RenderOptions::validate`]), or threads cannot be started.
    pub fn new(volume: PlacedVolume, options: RenderOptions) -> Result<Self, RenderError> {
        options.validate()?;
        let pool = options.thread_pool()?;
        Ok(Self {
            volume,
            options,
            pool,
            canceller: Canceller::default(),
            backend: None,
            reserve: DeadlineReserve::None,
            resident: None,
            scene: None,
            came_from: None,
            drawing: None,
            before: FrameStats::default(),
            spent: Duration::ZERO,
            cpu: Duration::ZERO,
        })
    }

    /// A renderer that draws by engines from outside, with the usual streamer and budgets: `engines` makes one for each
    /// picture. Loaded bricks stay from picture to picture. At a deadline, the picture is completed from coarser bricks.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn by_engines(
        volume: PlacedVolume,
        options: RenderOptions,
        engines: impl MakeEngine + 'static,
    ) -> Result<Self, RenderError> {
        Ok(Self { backend: Some(Chosen::Outside(Box::new(engines))), ..Self::new(volume, options)? })
    }

    /// A renderer that draws on an open device, with backend `gpu` whatever the options say.
    ///
    /// A device compiles pipelines once, which takes a software adapter about a second; renderers on one device share
    /// them. They share its counters of traffic, too: these are true if one renderer draws at a time.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn on_device(volume: PlacedVolume, options: RenderOptions, device: GpuDevice) -> Result<Self, RenderError> {
        let options = RenderOptions { backend: Backend::Gpu, ..options };
        Ok(Self { backend: Some(Chosen::on_device(device)), ..Self::new(volume, options)? })
    }

    /// The volume that it draws.
    #[must_use]
    pub fn volume(&self) -> &PlacedVolume {
        &self.volume
    }

    /// Draws another volume from now on, or the same one placed anew. The scene and all loaded data are dropped.
    pub fn set_volume(&mut self, volume: PlacedVolume) {
        self.begin_anew();
        self.volume = volume;
        (self.resident, self.scene, self.came_from) = (None, None, None);
        self.before = FrameStats::default();
    }

    /// A canceller that stops [`Self::advance`] from another thread.
    #[must_use]
    pub fn canceller(&self) -> Canceller {
        self.canceller.clone()
    }

    /// How pictures are made.
    #[must_use]
    pub fn options(&self) -> &RenderOptions {
        &self.options
    }

    /// Changes the options and restarts the current picture. Loaded data stays, as far as the budgets allow. The number
    /// of threads does not change.
    ///
    /// # Errors
    /// If an option is invalid ([`RenderOptions::validate`]); nothing changes then.
    pub fn set_options(&mut self, options: RenderOptions) -> Result<(), RenderError> {
        options.validate()?;
        let is_chosen_by_options = !matches!(self.backend, Some(Chosen::Outside(_)));
        if is_chosen_by_options && options.backend != self.options.backend {
            self.backend = None;
        }
        self.options = RenderOptions { threads: self.options.threads, ..options };
        self.begin_anew();
        Ok(())
    }

    /// Sets the scene. If it is the current scene, the picture stays.
    pub fn set_scene(&mut self, scene: ResolvedScene) {
        if self.scene.as_ref() != Some(&scene) {
            let is_moved = |before: &&ResolvedScene| before.has_look_of(&scene) && before.camera != scene.camera;
            self.came_from = self.scene.as_ref().filter(is_moved).map(|before| before.camera);
            self.scene = Some(scene);
            self.begin_anew();
        }
    }

    /// Prefetches the bricks of the next picture, assuming that the camera keeps moving as before. Call it when the
    /// picture has converged and the program is idle. It takes spare room only, and stops at the deadline or when
    /// cancelled. It does nothing if the camera has not moved, if the picture has not converged, with slices, or on a
    /// GPU.
    ///
    /// # Errors
    /// If threads cannot be started.
    pub fn look_ahead(&mut self, deadline: Option<Instant>) -> Result<Ahead, RenderError> {
        let Self { options, pool, backend, resident, scene, came_from, drawing, .. } = self;
        let (Some(scene), Some(before), Some(resident)) = (scene, came_from, resident) else {
            return Ok(Ahead::default());
        };
        let is_by_packets =
            backend.as_ref().is_some_and(Chosen::is_cpu) && options.caster.is_default() && scene.slices.is_empty();
        if !is_by_packets || !drawing.as_ref().is_some_and(|drawing| drawing.is_finished()) {
            return Ok(Ahead::default());
        }
        let next = ResolvedScene { camera: scene.camera.moved_on_from(before), ..scene.clone() };
        let stop = Stop::at(deadline).or_by(self.canceller.clone());
        let result = pool.install(|| ahead::look_ahead(resident, &next, options, &stop));
        self.canceller.take();
        result
    }

    /// The first visible point under pixel (x, y) of the picture, (0, 0) being at the top left; `None` if nothing is
    /// visible.
    /// - mode `dvr`: the point at which the ray has gathered half of its opacity;
    /// - `iso`: the first surface; `mip` and `minip`: the extreme; on slices: the plane; `mean` has none.
    ///
    /// It is computed from voxels of the finest level, or of the requested level, whatever has been drawn. Only bricks
    /// on the ray are fetched.
    ///
    /// # Errors
    /// If there is no scene, the picture has no such pixel, the mode has no such point, a budget is too small, or it is
    /// cancelled.
    pub fn pick(&mut self, pixel: [u32; 2]) -> Result<Option<Picked>, RenderError> {
        let Self { volume, options, pool, resident, scene, reserve, .. } = self;
        let scene = scene.as_ref().ok_or(RenderError::NoScene)?;
        if (0..2).any(|a| pixel[a] >= scene.image_size[a]) {
            return Err(RenderError::NoSuchPixel { pixel, size: scene.image_size });
        }
        let container = volume.container();
        let stop = Stop::NEVER.or_by(self.canceller.clone());
        let result = pool.install(|| {
            let caster = options.ray_caster().bytes(container.pyramid().layout().core());
            let resident = match resident {
                Some(resident) => resident,
                None => LoadedVolume::fitting(resident, container, (scene, options), caster, *reserve)?,
            };
            pick::pick(resident, (scene, &Units::of(volume.facts())), options, pixel, &stop)
        });
        self.canceller.take();
        result
    }

    /// Restarts the picture from loaded data; bricks that failed long enough ago are tried again.
    pub fn begin_anew(&mut self) {
        if let (Some(before), Some(backend)) = (self.drawing.take(), &mut self.backend) {
            backend.take_back(before.into_memory());
        }
        self.before = FrameStats::default();
        if let Some(resident) = &self.resident {
            self.before.gather_streamer(resident.as_streamer());
        }
        (self.spent, self.cpu) = (Duration::ZERO, Duration::ZERO);
    }

    /// Improves the picture until it has converged, the deadline passes, or it is cancelled. With a deadline there is
    /// always a whole picture afterwards.
    ///
    /// # Errors
    /// If there is no scene, a budget is too small, or (reference backend only) a brick cannot be read. In all other
    /// backends, unreadable bricks are drawn from their parents and counted. After an error the unfinished picture is
    /// lost.
    pub fn advance(&mut self, deadline: Option<Instant>) -> Result<Step, RenderError> {
        let (start, cpu_start) = (Instant::now(), process::cpu_time());
        let scene = self.scene.clone().ok_or(RenderError::NoScene)?;
        if deadline.is_some() {
            self.reserve = DeadlineReserve::Kept;
        }
        let stop = Stop::at(deadline).or_by(self.canceller.clone());
        let result = self.draw(&scene, &stop);
        let is_cancelled = self.canceller.take();
        self.spent += start.elapsed();
        self.cpu += process::cpu_time().saturating_sub(cpu_start);
        match result {
            Ok(()) | Err(RenderError::Cancelled) => {}
            Err(error) => {
                self.drawing = None;
                return Err(error);
            }
        }
        let stats = self.drawn_stats(&scene);
        Ok(Step {
            is_finished: stats.converged,
            is_cancelled,
            pixels_unfinished: stats.pixels_unfinished,
            coarsest_pixel: stats.coarsest_pixel,
            bricks_missing: stats.bricks_missing_at_deadline,
            bricks_failed: stats.bricks_failed,
        })
    }

    fn draw(&mut self, scene: &ResolvedScene, stop: &Stop) -> Result<(), RenderError> {
        backend::check(scene, &self.options)?;
        if self.backend.is_none() {
            self.backend = Some(Chosen::new(self.options.backend, &self.pool)?);
        }
        match self.draw_by_backend(scene, stop) {
            Err(error @ (RenderError::Engine(_) | RenderError::Budget(_)))
                if self.backend.as_ref().is_some_and(Chosen::is_replaceable) =>
            {
                self.backend = Some(Chosen::Cpu { no_gpu_because: Some(error.to_string()) });
                self.drawing = None;
                self.draw_by_backend(scene, stop)
            }
            other => other,
        }
    }

    fn draw_by_backend(&mut self, scene: &ResolvedScene, stop: &Stop) -> Result<(), RenderError> {
        let Self { volume, options, pool, backend, reserve, resident, drawing, .. } = self;
        let (container, backend) = (volume.container(), backend.as_mut().expect("a backend is chosen before"));
        pool.install(|| {
            let drawing = match drawing {
                Some(drawing) => drawing,
                None => drawing.insert(backend.begin(container, scene, options)?),
            };
            if drawing.is_finished() {
                return Ok(());
            }
            let device = backend.device().filter(|_| backend::suits_device(scene));
            let means = Means { container, options, device, resident, reserve: *reserve };
            drawing.advance(means, stop)
        })
    }

    /// Statistics of the drawing so far, including unfinished parts of the scene.
    fn drawn_stats(&self, scene: &ResolvedScene) -> FrameStats {
        match &self.drawing {
            Some(drawing) => drawing.stats(),
            None => FrameStats { pixels_unfinished: scene.pixels(), ..FrameStats::default() },
        }
    }

    /// The picture so far; `None` until each pixel is known at least coarsely.
    #[must_use]
    pub fn picture(&self) -> Option<Cow<'_, Image>> {
        self.drawing.as_ref()?.picture()
    }

    /// Consumes the renderer and returns the picture so far.
    #[must_use]
    pub fn into_picture(self) -> Option<Image> {
        self.into_pictures().map(|(picture, _)| picture)
    }

    /// Consumes the renderer: the picture so far, with [`Self::error_map`] and [`Self::work_map`].
    #[must_use]
    pub fn into_pictures(self) -> Option<(Image, Maps)> {
        self.drawing?.into_pictures()
    }

    /// Error map: how far each pixel may be from the exact picture of the finest level; grey, 1 is white, opaque.
    /// `None` before there is a picture, if errors were not requested ([`RenderOptions::predict_error`]), and for
    /// backends without errors.
    #[must_use]
    pub fn error_map(&self) -> Option<Image> {
        self.drawing.as_ref()?.error_map()
    }

    /// Work map: cost of the rays of each pixel. Red is the mean number of cells crossed, green that of leaps. `None`
    /// before there is a picture, if it was not requested ([`RenderOptions::count_work`]), and for backends without
    /// these counts.
    #[must_use]
    pub fn work_map(&self) -> Option<Image> {
        self.drawing.as_ref()?.work_map()
    }

    /// [`Self::error_map`] and [`Self::work_map`].
    #[must_use]
    pub fn maps(&self) -> Maps {
        Maps { errors: self.error_map(), work: self.work_map() }
    }

    /// Statistics of the picture since it was begun.
    #[must_use]
    pub fn stats(&self) -> FrameStats {
        let error_stated = self.drawing.as_ref().and_then(|drawing| drawing.error_stated());
        FrameStats { error_stated, ..self.counts() }
    }

    /// The same without the stated error, which needs a pass over all pixels.
    #[must_use]
    pub fn counts(&self) -> FrameStats {
        let stats = self.scene.as_ref().map_or_else(FrameStats::default, |scene| self.drawn_stats(scene));
        let mut stats = stats.since(&self.before).with_failures(self.volume.facts().value_range);
        if let Some(scene) = &self.scene {
            [stats.image_width, stats.image_height] = scene.image_size;
            stats.mode = mode_name(scene.mode);
        }
        let mut default_memory = SHARED_MEMORY;
        if let Some(backend) = &self.backend {
            backend.describe(&mut stats);
            default_memory = backend.default_memory();
        }
        stats.threads = self.pool.current_num_threads();
        stats.level = match self.options.level {
            LevelChoice::Auto => None,
            LevelChoice::Fixed(lod) => Some(lod.min(self.volume.container().pyramid().coarsest()).0),
        };
        stats.host_budget_bytes = self.options.host_memory_bytes;
        stats.gpu_budget_bytes = self.options.gpu_memory_bytes.unwrap_or(default_memory);
        stats.max_error_requested = self.options.max_error;
        stats.total_ms = milliseconds(self.spent);
        stats.cpu_ms = milliseconds(self.cpu);
        stats.peak_rss_bytes = process::peak_resident_bytes();
        stats
    }

    /// The streamer, read-only; `None` before the first picture.
    #[must_use]
    pub fn streamer(&self) -> Option<&Streamer> {
        self.resident.as_ref().map(LoadedVolume::as_streamer)
    }
}

/// Draws a picture of a scene from a container, within the memory and the time budget of the options.
///
/// # Errors
/// As [`Renderer::advance`].
pub fn render(
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions,
) -> Result<(Image, FrameStats), RenderError> {
    let (picture, _, stats) = render_with_maps(container, scene, options)?;
    Ok((picture, stats))
}

/// The same, with the error of each pixel: [`Renderer::error_map`].
///
/// # Errors
/// As [`Renderer::advance`].
pub fn render_with_errors(
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions,
) -> Result<(Image, Option<Image>, FrameStats), RenderError> {
    let (picture, maps, stats) = render_with_maps(container, scene, options)?;
    Ok((picture, maps.errors, stats))
}

/// The same, with all maps that the options request.
///
/// # Errors
/// As [`Renderer::advance`].
pub fn render_with_maps(
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions,
) -> Result<(Image, Maps, FrameStats), RenderError> {
    let deadline = deadline_of(options);
    finished(Renderer::new(PlacedVolume::of(container.clone()), options.clone())?, scene, deadline)
}

/// The same on an open device: [`Renderer::on_device`].
///
/// # Errors
/// As [`Renderer::advance`].
pub fn render_on_device(
    device: GpuDevice,
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions,
) -> Result<(Image, Maps, FrameStats), RenderError> {
    let deadline = deadline_of(options);
    finished(Renderer::on_device(PlacedVolume::of(container.clone()), options.clone(), device)?, scene, deadline)
}

fn deadline_of(options: &RenderOptions) -> Option<Instant> {
    options.time_budget_ms.map(|ms| Instant::now() + Duration::from_millis(ms))
}

/// One picture of a new renderer.
fn finished(
    mut renderer: Renderer,
    scene: &ResolvedScene,
    deadline: Option<Instant>,
) -> Result<(Image, Maps, FrameStats), RenderError> {
    renderer.set_scene(scene.clone());
    renderer.advance(deadline)?;
    let stats = renderer.stats();
    let pictures = renderer.into_pictures();
    let (picture, maps) = pictures.expect("nobody cancels, and with or without a deadline there is a picture");
    Ok((picture, maps, stats))
}

/// Draws a picture of a scene with an engine from outside, with the usual streamer, budgets and passes. The time budget
/// of the options begins at `start`.
///
/// # Errors
/// If an option is wrong, a budget is too small, threads cannot be started, or the engine fails.
pub fn render_by_engine(
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions,
    engine: &mut (dyn Engine + Send),
    start: Instant,
) -> Result<(Image, Maps, FrameStats), RenderError> {
    options.validate()?;
    options.thread_pool()?.install(|| {
        let plan = plan_host(container, scene, options)?;
        let mut streamer = streamer_for(container, scene, options, plan);
        let mut walk = FrameWalk::new(&mut streamer, plan, options, start);
        let mut bands = FinishedBands::default();
        let image = walk.run_on(engine, scene.image_size, &mut bands)?;
        let stats = FrameStats { backend: OUTSIDE_ENGINE, ..walk.into_stats() };
        Ok((image, bands.into_maps(), stats.with_failures(VolumeFacts::of(container).value_range)))
    })
}
