//! The thread that opens volumes and draws pictures, so that the window never waits.
//!
//! ```text
//! window --requests (the newest of each kind)--> worker --messages (the newest of each kind)--> window
//! ```
//!
//! Names in this module:
//!
//! - `Requests`: pending requests of the window.
//! - `Messages`: pending messages of the worker.
//! - `Shared`: state shared by window and worker, which holds both.
//! - `WorkerState`: the worker's own state.
//! - `DrawingState`: drawing state of one open volume.
//!
//! 1. The window writes a request to the shared state. It replaces an older request of its kind that has not begun.
//! 2. The worker takes requests in a fixed order. First: quit, open a volume, result of a build (builds have a thread
//!    of their own), settings. Then: export, animation, view, sections of panels, probe of a pixel. Without requests it
//!    continues the begun sections, then the begun picture, until they have converged. Then it looks ahead: it reads
//!    bricks for the next picture, assuming that the camera motion continues.
//! 3. A new view gets a picture within the time for interaction ([`Settings::interaction_ms`]). Only work after that
//!    time is interrupted by the next request. Otherwise a continuously changing view would never be shown.
//! 4. A message replaces an older one of its kind; the window is woken for each.
//!
//! Both directions hold at most one item of each kind: no queue can grow.

mod animate;
mod drawing;
mod export;
mod marks;
mod open;
mod sections;
mod state;
mod written;

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use eframe::egui::ColorImage;
use serde::{Deserialize, Serialize};
use supervol_format::Container;
use supervol_format::coordinates::Coordinates;
use supervol_preprocess::kept::Reading;
use supervol_preprocess::preview::Preview;
use supervol_preprocess::report::Progress as BuildProgress;
use supervol_runtime::render::error::RenderError;
use supervol_runtime::render::options::Backend;
use supervol_runtime::render::renderer::Picked;
use supervol_runtime::render::stats::FrameStats;
use supervol_runtime::stop::Canceller;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::image::Image;
use supervol_scene::preset::overview::Overview;
use supervol_scene::scene::Scene;
use supervol_sources::{Part, Survey};

pub use self::animate::{Animation, Motion};
pub use self::export::Export;
pub use self::marks::{MARK_LIMIT, Mark};
pub(crate) use self::state::preview_refusal;
use crate::folders::Folders;

/// Number of panels with a section each, beside the picture.
pub const PANELS: usize = 3;

/// Render settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Memory budget in bytes for bricks, rays and pictures, without the window's own memory.
    pub host_memory_bytes: u64,
    /// Error to aim for, as a fraction of full scale.
    pub max_error: f64,
    /// Time in milliseconds after which a changed view shows a picture.
    pub interaction_ms: u64,
    /// Device that casts the rays of pictures. Sections are always drawn by the CPU.
    pub backend: Backend,
    /// Threads for casting and decoding; `None`: one per processor. Applied when a volume is opened.
    pub threads: Option<usize>,
    /// Whether box, orientation, scale and colour bar are drawn around the volume.
    pub decorations: Decorations,
    /// Whether panels beside the picture get a part of the memory.
    pub side_panels: SidePanels,
    /// Diagnostic display.
    pub inspect: Inspect,
}

/// Diagnostic display of how a picture was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Inspect {
    /// Only failed bricks.
    #[default]
    Nothing,
    /// Outlines of bricks in memory, coloured by level.
    Bricks,
    /// Replaces the converged picture by the error map, as `render --error-map` writes it.
    Errors,
    /// Replaces the converged picture by the work map, as `render --work-map` writes it. Pictures then take several
    /// times as long.
    Work,
}

/// Presence of panels beside the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SidePanels {
    /// Only the picture.
    #[default]
    Hidden,
    /// Panels with sections.
    Shown,
}

/// Presence of decorations around the volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Decorations {
    /// No decorations.
    #[default]
    Off,
    /// Decorations as `render --decorate` draws them.
    On,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            host_memory_bytes: 512 << 20,
            max_error: 0.5 / 255.0,
            interaction_ms: 33,
            // Only the CPU reports the error of each pixel.
            backend: Backend::Cpu,
            threads: None,
            decorations: Decorations::Off,
            side_panels: SidePanels::Hidden,
            inspect: Inspect::Nothing,
        }
    }
}

/// A request to open a volume.
#[derive(Debug, Clone)]
pub struct Open {
    /// Path of a container, or of a source file, for which a container is built in the cache folder.
    pub path: PathBuf,
    /// Options for a source file that does not describe itself.
    pub reading: Reading,
    /// Vertical exaggeration: factor of heights or depths.
    pub exaggeration: f64,
    /// Scene; missing keys get defaults that suit the data.
    pub scene: Scene,
}

/// A request to draw a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Number of the request, ascending.
    pub number: u64,
    /// Number of the volume: [`OpenVolume::number`].
    pub volume: u64,
    /// Scene, with the size of the picture.
    pub scene: Scene,
}

/// An open volume. Its content is shared by reference counts.
#[derive(Debug)]
pub struct OpenVolume {
    /// Number of the volume, ascending.
    pub number: u64,
    /// Path of the opened file.
    pub source: PathBuf,
    /// Options with which a source file was read.
    pub reading: Reading,
    /// Path of the container: the opened file, or a file in the cache folder. Empty for a preview.
    pub path: PathBuf,
    /// Only for a preview, which is shown while the container is built: distance of its voxels along each axis, in
    /// voxels of the volume.
    pub preview_of: Option<[u64; 3]>,
    /// The container, with the geometry that is drawn.
    pub container: Arc<Container>,
    /// Facts of the container.
    pub facts: VolumeFacts,
    /// Line numbers and times or depths of a survey.
    pub survey: Option<Survey>,
    /// Coordinates of the volume's places.
    pub coordinates: Coordinates,
    /// Overview from a coarse level, if one is small enough.
    pub overview: Option<Overview>,
    /// Vertical exaggeration: factor of heights or depths.
    pub exaggeration: f64,
    /// The scene of the request with all defaults filled in.
    pub scene: Scene,
    /// Whether the request contained a camera.
    pub has_requested_camera: bool,
}

/// A drawn picture.
#[derive(Debug)]
pub struct Frame {
    /// Number of the volume.
    pub volume: u64,
    /// Number of the request.
    pub number: u64,
    /// 8-bit RGB, background added.
    pub image: Arc<ColorImage>,
    /// Statistics of the picture.
    pub stats: FrameStats,
    /// Whether the picture is final.
    pub is_converged: bool,
    /// Wall time of drawing it so far, in milliseconds.
    pub spent_ms: f64,
    /// Bricks to outline in it.
    pub marks: Vec<Mark>,
}

/// A request for the value under a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Probe {
    /// Number of the request, ascending.
    pub number: u64,
    /// Number of the volume.
    pub volume: u64,
    /// Panel; `None`: the picture.
    pub panel: Option<usize>,
    /// Number of the request of the picture that has the pixel. Other pictures give no answer.
    pub picture: u64,
    /// Pixel (x, y), from the upper left.
    pub pixel: [u32; 2],
}

/// The answer to a [`Probe`]: a point, nothing, or an error.
#[derive(Debug, Clone, PartialEq)]
pub struct ProbeAnswer {
    /// The request.
    pub probe: Probe,
    /// The point under the pixel, `None` if there is nothing, or the error.
    pub found: Result<Option<Picked>, String>,
}

/// Bricks that were read for the next picture after the present one had converged.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LookedAhead {
    /// Number of the request of the present picture.
    pub number: u64,
    /// Number of bricks read.
    pub page_ins: u64,
    /// Whether all predicted bricks are in memory.
    pub is_complete: bool,
}

/// A long-running task and its progress.
#[derive(Debug, Clone, PartialEq)]
pub enum Busy {
    /// Opening a file.
    Opening(PathBuf),
    /// Building a container from a file.
    Building(PathBuf, BuildProgress),
    /// Reading a mesh file that the scene refers to.
    Reading(PathBuf),
    /// Exporting a picture: finished rows and all rows.
    Exporting(PathBuf, [u32; 2]),
    /// Writing an animation to a folder: finished pictures and all pictures.
    Animating(PathBuf, [usize; 2]),
}

/// A failure or a success to report to the user.
#[derive(Debug, Clone, PartialEq)]
pub enum Message {
    /// A failure, in words, with advice.
    Failure(String),
    /// A success, in words.
    Done(String),
}

/// A file that cannot be read without options.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refused {
    /// Path of the file.
    pub source: PathBuf,
    /// Reason, in words.
    pub why: String,
    /// Volumes of the file, if it holds several.
    pub choices: Vec<Part>,
}

/// Pending messages of the worker. [`Worker::messages`] takes them all and leaves only `busy`.
#[derive(Debug, Default)]
pub struct Messages {
    /// A volume has been opened.
    pub opened: Option<Arc<OpenVolume>>,
    /// A picture has been drawn.
    pub frame: Option<Frame>,
    /// Pictures of the panels.
    pub sections: [Option<Frame>; PANELS],
    /// Answer to the last probe.
    pub probed: Option<ProbeAnswer>,
    /// Bricks read for the next picture.
    pub ahead: Option<LookedAhead>,
    /// The running task.
    pub busy: Option<Busy>,
    /// A success or a failure.
    pub message: Option<Message>,
    /// A file that needs options.
    pub refused: Option<Box<Refused>>,
}

/// Pending requests of the window that have not begun.
#[derive(Default)]
struct Requests {
    quit: bool,
    open: Option<Open>,
    settings: Option<Settings>,
    export: Option<Export>,
    animation: Option<Animation>,
    view: Option<View>,
    sections: [Option<View>; PANELS],
    probe: Option<Probe>,
    /// Canceller of the worker's current work, while it may be interrupted.
    interrupt: Option<Canceller>,
    /// Canceller of an export.
    export_canceller: Option<Canceller>,
    /// Canceller of a build.
    build_canceller: Option<Canceller>,
    /// Preview and result of a build, each with the number of the build's request.
    preview: Option<(u64, Box<Preview>)>,
    built: Option<(u64, Result<PathBuf, Message>)>,
}

impl Requests {
    /// Takes the request to open a volume, and installs a canceller for its build.
    fn opening(&mut self) -> Option<Work> {
        let open = self.open.take()?;
        let canceller = Canceller::default();
        self.build_canceller = Some(canceller.clone());
        Some(Work::Open(Box::new(open), canceller))
    }

    /// Takes the first requested section.
    fn section(&mut self) -> Option<(usize, View)> {
        self.sections.iter_mut().enumerate().find_map(|(panel, view)| Some((panel, view.take()?)))
    }
}

/// State shared by the window and the worker.
struct Shared {
    requests: Mutex<Requests>,
    request_added: Condvar,
    messages: Mutex<Messages>,
    wake: Box<dyn Fn() + Send + Sync>,
    folders: Folders,
    /// Number of the build that is still wanted; 0: none. Changed only while the messages are locked.
    building: AtomicU64,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// Adds a request and interrupts work that may be interrupted.
    fn request(&self, put: impl FnOnce(&mut Requests)) {
        let mut requests = lock(&self.requests);
        put(&mut requests);
        if let Some(canceller) = requests.interrupt.take() {
            canceller.cancel();
        }
        self.request_added.notify_one();
    }

    fn send(&self, put: impl FnOnce(&mut Messages)) {
        put(&mut lock(&self.messages));
        (self.wake)();
    }

    /// Reports the progress of a build, if it is still wanted.
    fn report_build(&self, number: u64, busy: Busy) {
        self.send(|messages| {
            if self.building.load(Ordering::Relaxed) == number {
                messages.busy = Some(busy);
            }
        });
    }

    fn report_failure(&self, message: impl std::fmt::Display) {
        self.send(|messages| messages.message = Some(Message::Failure(message.to_string())));
    }
}

/// The next piece of work.
enum Work {
    Quit,
    Open(Box<Open>, Canceller),
    Preview(u64, Box<Preview>),
    Built(u64, Result<PathBuf, Message>),
    Settings(Settings),
    Export(Export),
    Animation(Box<Animation>),
    View(View),
    Section(usize, View),
    Probe(Probe),
    Continue,
}

impl Shared {
    /// Takes the next piece of work; waits if there is none. `interruptible` cancels work that the next request may
    /// interrupt.
    fn next(&self, interruptible: Option<Canceller>) -> Work {
        let mut requests = lock(&self.requests);
        loop {
            requests.interrupt = None;
            if requests.quit {
                return Work::Quit;
            }
            let work = (requests.opening())
                .or_else(|| requests.preview.take().map(|(number, preview)| Work::Preview(number, preview)))
                .or_else(|| requests.built.take().map(|(number, built)| Work::Built(number, built)))
                .or_else(|| requests.settings.take().map(Work::Settings))
                .or_else(|| requests.export.take().map(Work::Export))
                .or_else(|| requests.animation.take().map(|animation| Work::Animation(Box::new(animation))))
                .or_else(|| requests.view.take().map(Work::View))
                .or_else(|| requests.section().map(|(panel, view)| Work::Section(panel, view)))
                .or_else(|| requests.probe.take().map(Work::Probe));
            if let Some(work) = work {
                return work;
            }
            if interruptible.is_some() {
                requests.interrupt = interruptible;
                return Work::Continue;
            }
            requests = self.request_added.wait(requests).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// The window's handle of the worker. Dropping it ends the thread.
pub struct Worker {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl std::fmt::Debug for Worker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Worker").field("thread", &self.thread).finish_non_exhaustive()
    }
}

impl Worker {
    /// Starts the thread. It calls `wake` after each message.
    ///
    /// # Errors
    /// If the system cannot start a thread.
    pub fn start(
        settings: Settings,
        folders: Folders,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> std::io::Result<Self> {
        let shared = Arc::new(Shared {
            requests: Mutex::default(),
            request_added: Condvar::new(),
            messages: Mutex::default(),
            wake: Box::new(wake),
            folders,
            building: AtomicU64::new(0),
        });
        let of_thread = shared.clone();
        let thread = std::thread::Builder::new()
            .name("supervol-worker".into())
            .spawn(move || state::work(&of_thread, settings))?;
        Ok(Self { shared, thread: Some(thread) })
    }

    /// Opens a volume in place of the open one. Stops a running build.
    pub fn open(&self, open: Open) {
        self.cancel_build();
        self.shared.request(|requests| {
            (requests.open, requests.view, requests.probe) = (Some(open), None, None);
            requests.sections = [const { None }; PANELS];
        });
    }

    /// Draws a picture.
    pub fn view(&self, view: View) {
        self.shared.request(|requests| requests.view = Some(view));
    }

    /// Draws the section of a panel.
    ///
    /// # Panics
    /// If there is no such panel.
    pub fn section(&self, panel: usize, view: View) {
        self.shared.request(|requests| requests.sections[panel] = Some(view));
    }

    /// Determines the value under a pixel.
    pub fn probe(&self, probe: Probe) {
        self.shared.request(|requests| requests.probe = Some(probe));
    }

    /// Changes the render settings.
    pub fn set(&self, settings: Settings) {
        self.shared.request(|requests| requests.settings = Some(settings));
    }

    /// Draws a picture until it has converged, and writes it to a file.
    pub fn export(&self, export: Export) {
        self.shared.request(|requests| requests.export = Some(export));
    }

    /// Draws the pictures of an animation, and writes them to a folder.
    pub fn animate(&self, animation: Animation) {
        self.shared.request(|requests| requests.animation = Some(animation));
    }

    /// Cancels an export or an animation.
    pub fn cancel_export(&self) {
        self.shared.request(|requests| {
            (requests.export, requests.animation) = (None, None);
            if let Some(canceller) = requests.export_canceller.take() {
                canceller.cancel();
            }
        });
    }

    /// Stops the build of a container. Finished parts stay in the cache folder; opening the same file again continues
    /// the build.
    pub fn cancel_build(&self) {
        self.shared.request(|requests| {
            requests.open = None;
            if let Some(canceller) = requests.build_canceller.take() {
                canceller.cancel();
            }
        });
    }

    /// Takes the messages since the last call.
    pub fn messages(&self) -> Messages {
        let mut messages = lock(&self.shared.messages);
        Messages {
            opened: messages.opened.take(),
            frame: messages.frame.take(),
            sections: std::mem::take(&mut messages.sections),
            probed: messages.probed.take(),
            ahead: messages.ahead.take(),
            busy: messages.busy.clone(),
            message: messages.message.take(),
            refused: messages.refused.take(),
        }
    }

    /// Whether the thread has ended unexpectedly, which is a bug.
    pub fn is_dead(&self) -> bool {
        self.thread.as_ref().is_some_and(JoinHandle::is_finished)
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.cancel_export();
        self.cancel_build();
        self.shared.request(|requests| requests.quit = true);
        let Some(thread) = self.thread.take() else { return };
        // A panic message is on standard error already.
        let _ = thread.join();
    }
}

/// A picture for the window, with its background; `began` is the time at which drawing began. A picture with failed
/// bricks may be final without having converged in the sense of the statistics.
fn frame_of(
    view: &View,
    (picture, background): (&Image, [f64; 3]),
    (stats, is_converged): (FrameStats, bool),
    began: Instant,
) -> Frame {
    let size = [picture.width, picture.height].map(|n| n as usize);
    Frame {
        volume: view.volume,
        number: view.number,
        image: Arc::new(ColorImage::from_rgb(size, &picture.to_rgb8(background))),
        stats,
        is_converged,
        marks: Vec::new(),
        spent_ms: began.elapsed().as_secs_f64() * 1e3,
    }
}

/// The answer to a probe; `None` if it was interrupted by another request.
fn picked(found: Result<Option<Picked>, RenderError>) -> Option<Result<Option<Picked>, String>> {
    match found {
        Err(RenderError::Cancelled) => None,
        found => Some(found.map_err(|e| e.to_string())),
    }
}
