//! Renderer of successive pictures: loaded data serves the next picture, whatever changes.
//!
//! ```text
//! set_scene --> advance --> picture, stats --> advance --> better ones --> ... --> converged
//!          (look or view changes: set_scene again; bricks and what is known of them stay)
//! ```
//!
//! With a deadline, [`Renderer::advance`] always leaves a whole picture. Every further call improves it, until it
//! equals the picture that a new renderer draws without a deadline (`drawing`; with slices `layers`; on a GPU
//! `stages`). All other casters draw a picture in one go, and complete it from coarser bricks at the deadline.
//!
//! [`Renderer::look_ahead`] reads for the next picture in idle time (`ahead`). [`render`] does all of this for one
//! picture.

mod ahead;
mod drawing;
mod layers;
mod pick;
mod region;
mod resident;
mod sampling;
mod sheet;
mod spread;
mod stages;

use std::borrow::Cow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::Container;
use supervol_scene::camera::Camera;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::image::Image;
use supervol_scene::scene::{Mode, ResolvedScene};
use supervol_scene::units::Units;

use crate::engines::engine::Engine;
use crate::engines::gpu::device::GpuDevice;
use crate::engines::gpu::hardware::may_have_hardware;
use crate::engines::gpu::limits::SHARED_MEMORY;
use crate::engines::maps::Maps;
use crate::render::error::RenderError;
use crate::render::frame::walk::FinishedBands;
use crate::render::frame::{FrameWalk, plan_host, render_cpu, render_from_reference, streamer_for};
use crate::render::options::{Backend, LevelChoice, RenderOptions};
use crate::render::process;
use crate::render::stats::{FrameStats, mode_name};
use crate::render::volume::PlacedVolume;
use crate::stop::{Canceller, Stop};
use crate::stream::budget::CasterBytes;
use crate::stream::counters::milliseconds;
use crate::stream::streamer::Streamer;
pub use ahead::Ahead;
use drawing::Drawing;
use layers::Layers;
pub use pick::{Picked, PickedOn};
use resident::Resident;
use stages::{Best, Device};

/// Message for the usual case that no GPU is present ([`FrameStats::no_gpu_because`]); printed only on request.
pub const NO_DEVICE: &str = "no graphics device is there";

/// Draws successive pictures of one volume.
pub struct Renderer {
    volume: PlacedVolume,
    options: RenderOptions,
    pool: rayon::ThreadPool,
    canceller: Canceller,
    drawer: Drawer,
    /// Whether a deadline was ever set: from then on memory for deadlines is reserved.
    has_deadline: bool,
    resident: Option<Resident>,
    scene: Option<ResolvedScene>,
    /// The previous camera, if only the camera has changed.
    came_from: Option<Camera>,
    work: Work,
    /// Cost of streaming before this picture.
    before: FrameStats,
    spent: Duration,
    cpu: Duration,
}

/// The device or processor that casts the rays, once decided.
enum Drawer {
    Undecided,
    Cpu { no_gpu_because: Option<String> },
    Gpu { device: Box<Device>, or_cpu: bool },
    Reference,
}

/// The picture in progress.
enum Work {
    Nothing,
    InSteps(Box<Drawing>),
    AtOnce(Image, Box<FrameStats>),
    InStages(Box<Best>),
    InLayers(Box<Layers>),
}

impl Work {
    /// Statistics so far, including unfinished parts of the scene.
    fn stats(&self, scene: &ResolvedScene) -> FrameStats {
        match self {
            Self::Nothing => FrameStats { pixels_unfinished: scene.pixels(), ..FrameStats::default() },
            Self::InSteps(drawing) => drawing.stats(),
            Self::AtOnce(_, stats) => (**stats).clone(),
            Self::InStages(best) => best.stats.clone(),
            Self::InLayers(layers) => layers.stats(),
        }
    }
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
            drawer: Drawer::Undecided,
            has_deadline: false,
            resident: None,
            scene: None,
            came_from: None,
            work: Work::Nothing,
            before: FrameStats::default(),
            spent: Duration::ZERO,
            cpu: Duration::ZERO,
        })
    }

    /// The volume that it draws.
    #[must_use]
    pub fn volume(&self) -> &PlacedVolume {
        &self.volume
    }

    /// A canceller that stops [`Self::advance`] from another thread.
    #[must_use]
    pub fn canceller(&self) -> Canceller {
        self.canceller.clone()
    }

    /// The same renderer, stopped by this canceller instead of its own.
    #[must_use]
    pub fn stopped_by(self, canceller: Canceller) -> Self {
        Self { canceller, ..self }
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
        if options.backend != self.options.backend {
            self.drawer = Drawer::Undecided;
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
        let Self { options, pool, drawer, resident, scene, came_from, work, .. } = self;
        let (Some(scene), Some(before), Some(resident)) = (scene, came_from, resident) else {
            return Ok(Ahead::default());
        };
        let is_possible =
            matches!((drawer, &*work), (Drawer::Cpu { .. }, Work::InSteps(drawing)) if drawing.is_finished());
        if !is_possible {
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
        let Self { volume, options, pool, resident, scene, has_deadline, .. } = self;
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
                None => fitting(resident, container, (scene, options), caster, *has_deadline)?,
            };
            pick::pick(resident, (scene, &Units::of(volume.facts())), options, pixel, &stop)
        });
        self.canceller.take();
        result
    }

    /// Restarts the picture from loaded data; bricks that failed long enough ago are tried again.
    pub fn begin_anew(&mut self) {
        let before = std::mem::replace(&mut self.work, Work::Nothing);
        if let (Work::InStages(best), Drawer::Gpu { device, .. }) = (before, &mut self.drawer) {
            device.backend.take_back(best.image);
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
        self.has_deadline |= deadline.is_some();
        let stop = Stop::at(deadline).or_by(self.canceller.clone());
        let result = self.draw(&scene, &stop);
        let is_cancelled = self.canceller.take();
        self.spent += start.elapsed();
        self.cpu += process::cpu_time().saturating_sub(cpu_start);
        match result {
            Ok(()) | Err(RenderError::Cancelled) => {}
            Err(error) => {
                self.work = Work::Nothing;
                return Err(error);
            }
        }
        let stats = self.work.stats(&scene);
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
        let backend = self.options.backend;
        if !self.options.caster.is_default()
            && (backend != Backend::Cpu || scene.mode != Mode::Dvr || scene.has_inner_surfaces())
        {
            return Err(RenderError::Method { backend, mode: mode_name(scene.mode) });
        }
        if backend == Backend::Gpu && scene.mode == Mode::Slice {
            return Err(RenderError::SlicesOnGpu);
        }
        if matches!(self.drawer, Drawer::Undecided) {
            self.drawer = self.choose_drawer()?;
        }
        let or_cpu = matches!(self.drawer, Drawer::Gpu { or_cpu: true, .. });
        match self.draw_by_drawer(scene, stop) {
            Err(error @ (RenderError::Engine(_) | RenderError::Budget(_))) if or_cpu => {
                self.drawer = Drawer::Cpu { no_gpu_because: Some(error.to_string()) };
                self.work = Work::Nothing;
                self.draw_by_drawer(scene, stop)
            }
            other => other,
        }
    }

    fn draw_by_drawer(&mut self, scene: &ResolvedScene, stop: &Stop) -> Result<(), RenderError> {
        match self.drawer {
            Drawer::Cpu { .. } | Drawer::Gpu { .. } if !scene.slices.is_empty() => self.draw_in_layers(scene, stop),
            _ => self.draw_by_engine(scene, stop),
        }
    }

    /// A hardware GPU if the options allow it; otherwise the CPU, with the reason why not the GPU.
    fn choose_drawer(&self) -> Result<Drawer, RenderError> {
        let no_gpu = |why: String| Drawer::Cpu { no_gpu_because: Some(why) };
        let gpu = |device, or_cpu| Drawer::Gpu { device: Box::new(Device::new(device)), or_cpu };
        Ok(match self.options.backend {
            Backend::Cpu => Drawer::Cpu { no_gpu_because: None },
            Backend::Gpu => gpu(self.pool.install(GpuDevice::open)?, false),
            Backend::Reference => Drawer::Reference,
            Backend::Auto if !may_have_hardware() => no_gpu(NO_DEVICE.into()),
            Backend::Auto => match GpuDevice::open() {
                Ok(device) if device.is_software() => no_gpu(format!("{} is a processor", device.name())),
                Ok(device) => gpu(device, true),
                Err(error) => no_gpu(error.to_string()),
            },
        })
    }

    /// A picture with slices: the volume between them is drawn as usual, their colours on the CPU.
    fn draw_in_layers(&mut self, scene: &ResolvedScene, stop: &Stop) -> Result<(), RenderError> {
        let Self { volume, options, pool, drawer, has_deadline, resident, work, .. } = self;
        if !options.caster.is_default() {
            return Err(RenderError::Method { backend: options.backend, mode: "slices" });
        }
        let container = volume.container();
        let device = match drawer {
            // A sheet of sections shows no volume between them.
            Drawer::Gpu { device, .. } if scene.mode != Mode::Slice => Some(&mut **device),
            _ => None,
        };
        pool.install(|| {
            if !matches!(work, Work::InLayers(_)) {
                *work = Work::InLayers(Box::new(Layers::new(scene, container, device.is_some())));
            }
            let Work::InLayers(layers) = work else { unreachable!("it has just been made so") };
            let caster_bytes = match device {
                Some(_) => CasterBytes::on_device(options.predict_error),
                None => options.ray_caster().bytes(container.pyramid().layout().core()),
            };
            let caster_bytes = layers.bytes(caster_bytes);
            let resident = fitting(resident, container, (&layers.ray_scene(), options), caster_bytes, *has_deadline)?;
            layers.advance(device, resident, options, stop)
        })
    }

    fn draw_by_engine(&mut self, scene: &ResolvedScene, stop: &Stop) -> Result<(), RenderError> {
        let Self { volume, options, pool, drawer, has_deadline, resident, work, .. } = self;
        let container = volume.container();
        let caster_bytes = match drawer {
            Drawer::Gpu { .. } => CasterBytes::on_device(options.predict_error),
            _ => options.ray_caster().bytes(container.pyramid().layout().core()),
        };
        pool.install(|| {
            if let Drawer::Reference = drawer {
                let (image, stats) = render_from_reference(container, scene, options)?;
                *work = Work::AtOnce(image, Box::new(stats));
                return Ok(());
            }
            let resident = fitting(resident, container, (scene, options), caster_bytes, *has_deadline)?;
            if let Drawer::Gpu { device, .. } = drawer {
                let best = match std::mem::replace(work, Work::Nothing) {
                    Work::InStages(best) if best.stats.converged => {
                        *work = Work::InStages(best);
                        return Ok(());
                    }
                    Work::InStages(best) => Some(*best),
                    _ => None,
                };
                *work = Work::InStages(Box::new(stages::draw(device, resident, scene, options, stop, best)?));
                return Ok(());
            }
            if options.caster.is_default() {
                if !matches!(work, Work::InSteps(_)) {
                    *work = Work::InSteps(Box::new(Drawing::new(scene.clone())));
                }
                let Work::InSteps(drawing) = work else { unreachable!("it has just been made so") };
                return drawing.advance(resident, options, stop);
            }
            if matches!(work, Work::AtOnce(_, stats) if stats.converged) {
                return Ok(());
            }
            resident.aim(scene, options);
            let plan = resident.plan();
            let (image, stats) = render_cpu(scene, options, resident.streamer(), plan, stop)?;
            *work = Work::AtOnce(image, Box::new(stats));
            Ok(())
        })
    }

    /// The picture so far; `None` until each pixel is known at least coarsely.
    #[must_use]
    pub fn picture(&self) -> Option<Cow<'_, Image>> {
        match &self.work {
            Work::Nothing => None,
            Work::InSteps(drawing) => drawing.picture(),
            Work::AtOnce(image, _) => Some(Cow::Borrowed(image)),
            Work::InStages(best) => Some(Cow::Borrowed(&best.image)),
            Work::InLayers(layers) => layers.picture().map(Cow::Owned),
        }
    }

    /// Consumes the renderer and returns the picture so far.
    #[must_use]
    pub fn into_picture(self) -> Option<Image> {
        self.into_pictures().map(|(picture, _)| picture)
    }

    /// Consumes the renderer: the picture so far, with [`Self::error_map`] and [`Self::work_map`].
    #[must_use]
    pub fn into_pictures(self) -> Option<(Image, Maps)> {
        match self.work {
            Work::Nothing => None,
            Work::InSteps(drawing) => drawing.into_pictures(),
            Work::AtOnce(image, _) => Some((image, Maps::default())),
            Work::InStages(best) => Some(best.into_pictures()),
            Work::InLayers(layers) => {
                Some((layers.picture()?, Maps { errors: layers.error_map(), work: layers.work_map() }))
            }
        }
    }

    /// Error map: how far each pixel may be from the exact picture of the finest level; grey, 1 is white, opaque.
    /// `None` before there is a picture, if errors were not requested ([`RenderOptions::predict_error`]), and for
    /// backends without errors.
    #[must_use]
    pub fn error_map(&self) -> Option<Image> {
        match &self.work {
            Work::InSteps(drawing) => drawing.error_map(),
            Work::InLayers(layers) => layers.error_map(),
            Work::InStages(best) => best.error_map(),
            Work::Nothing | Work::AtOnce(..) => None,
        }
    }

    /// Work map: cost of the rays of each pixel. Red is the mean number of cells crossed, green that of leaps. `None`
    /// before there is a picture, if it was not requested ([`RenderOptions::count_work`]), and for backends without
    /// these counts.
    #[must_use]
    pub fn work_map(&self) -> Option<Image> {
        match &self.work {
            Work::InSteps(drawing) => drawing.work_map(),
            Work::InLayers(layers) => layers.work_map(),
            Work::Nothing | Work::InStages(_) | Work::AtOnce(..) => None,
        }
    }

    /// [`Self::error_map`] and [`Self::work_map`].
    #[must_use]
    pub fn maps(&self) -> Maps {
        Maps { errors: self.error_map(), work: self.work_map() }
    }

    /// Statistics of the picture since it was begun.
    #[must_use]
    pub fn stats(&self) -> FrameStats {
        let mut stats = self.counts();
        match &self.work {
            Work::InSteps(drawing) => stats.error_stated = drawing.error_stated(),
            Work::InLayers(layers) => stats.error_stated = layers.error_stated(),
            Work::InStages(best) => stats.error_stated = best.error_stated(),
            Work::Nothing | Work::AtOnce(..) => {}
        }
        stats
    }

    /// The same without the stated error, which needs a pass over all pixels.
    #[must_use]
    pub fn counts(&self) -> FrameStats {
        let stats = self.scene.as_ref().map_or_else(FrameStats::default, |scene| self.work.stats(scene));
        let mut stats = stats.since(&self.before).with_failures(self.volume.facts().value_range);
        if let Some(scene) = &self.scene {
            [stats.image_width, stats.image_height] = scene.image_size;
            stats.mode = mode_name(scene.mode);
        }
        if let Drawer::Cpu { no_gpu_because } = &self.drawer {
            stats.no_gpu_because.clone_from(no_gpu_because);
        }
        if let Drawer::Gpu { device, .. } = &self.drawer {
            if stats.backend == "cpu" {
                stats.no_gpu_because = Some("sections (mode slice) are drawn by the processor".to_owned());
            } else {
                stats.adapter_is_software = device.backend.device().is_software();
            }
        }
        stats.threads = self.pool.current_num_threads();
        stats.level = match self.options.level {
            LevelChoice::Auto => None,
            LevelChoice::Fixed(lod) => Some(lod.min(self.volume.container().pyramid().coarsest()).0),
        };
        stats.host_budget_bytes = self.options.host_memory_bytes;
        let default = match &self.drawer {
            Drawer::Gpu { device, .. } => device.backend.default_memory(),
            Drawer::Undecided | Drawer::Cpu { .. } | Drawer::Reference => SHARED_MEMORY,
        };
        stats.gpu_budget_bytes = self.options.gpu_memory_bytes.unwrap_or(default);
        stats.max_error_requested = self.options.max_error;
        stats.total_ms = milliseconds(self.spent);
        stats.cpu_ms = milliseconds(self.cpu);
        stats.peak_rss_bytes = process::peak_resident_bytes();
        stats
    }

    /// The streamer, read-only; `None` before the first picture.
    #[must_use]
    pub fn streamer(&self) -> Option<&Streamer> {
        self.resident.as_ref().map(Resident::as_streamer)
    }
}

/// The resident data, with its memory divided for pictures of this scene.
fn fitting<'a>(
    resident: &'a mut Option<Resident>,
    container: &Arc<Container>,
    (scene, options): (&ResolvedScene, &RenderOptions),
    caster: CasterBytes,
    has_deadline: bool,
) -> Result<&'a mut Resident, RenderError> {
    match resident {
        Some(resident) => {
            resident.fit(scene, options, caster, has_deadline)?;
            Ok(resident)
        }
        None => Ok(resident.insert(Resident::new(container, scene, options, caster, has_deadline)?)),
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
    let deadline = options.time_budget_ms.map(|ms| Instant::now() + Duration::from_millis(ms));
    let mut renderer = Renderer::new(PlacedVolume::of(container.clone()), options.clone())?;
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
        let stats = walk.into_stats().with_failures(VolumeFacts::of(container).value_range);
        Ok((image, bands.into_maps(), stats))
    })
}
