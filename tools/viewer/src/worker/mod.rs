//! The thread that opens volumes and draws pictures, so that the window never waits.
//!
//! ```text
//! window --wishes (the newest of each kind)--> worker --news (the newest of each kind)--> window
//! ```
//!
//! 1. Whoever wishes something puts it on the desk; what was wished before and not begun is forgotten.
//! 2. The worker takes, in this order: an end, a volume to open, what has come of a build (which has a thread of its own), settings,
//!    a picture to export, an animation, a view, the sections of panels, a pixel to look under. With nothing to take it goes on
//!    with the sections and then with the picture that it has begun, until these have converged, and then brings into memory what
//!    the next picture will want if the camera goes on as it came.
//! 3. A new view gets a picture within the time for interaction ([`Settings::interaction_ms`]). Only what comes after that is cut
//!    short by the next wish: otherwise a view that changes all the time would never be seen.
//! 4. News replace older news of their kind; the window is woken for each.
//!
//! Both directions hold at most one of each kind: nothing queues.

mod animate;
mod easel;
mod export;
mod marks;
mod open;
mod sections;
mod studio;

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Instant;

use eframe::egui::ColorImage;
use serde::{Deserialize, Serialize};
use supervol_format::Container;
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
use supervol_sources::Survey;

pub use self::animate::{Animation, Motion};
pub use self::export::Export;
pub use self::marks::{MARK_LIMIT, Mark};
pub(crate) use self::studio::refused_of_preview;
use crate::folders::Folders;

/// Panels with a section each, beside the picture.
pub const PANELS: usize = 3;

/// With what pictures are made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Bytes for bricks, rays and pictures; the window's own memory is not among them.
    pub host_memory_bytes: u64,
    /// Error that is aimed for, a share of full scale.
    pub max_error: f64,
    /// Milliseconds after which a view that has changed shows a picture.
    pub interaction_ms: u64,
    /// Who casts the rays of pictures. Sections are the processor's.
    pub backend: Backend,
    /// Threads that cast and decode; `None`: one per processor. Read when a volume is opened.
    pub threads: Option<usize>,
    /// Whether box, orientation, scale and colours are drawn beside the volume.
    pub decorations: Decorations,
    /// Whether a part of the memory is that of panels beside the picture.
    pub beside: Beside,
    /// What is shown of how the picture was made.
    pub inspect: Inspect,
}

/// What is shown of how a picture was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Inspect {
    /// Nothing but bricks that failed.
    #[default]
    Nothing,
    /// Bricks in memory, in the colours of their levels.
    Bricks,
    /// In place of the picture, once it has converged: how far each pixel may be off, as `render --error-map` writes it.
    Errors,
    /// In place of the picture, once it has converged: what the rays of each pixel cost, as `render --work-map` writes it. Pictures take
    /// several times as long meanwhile.
    Work,
}

/// Whether there are panels beside the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Beside {
    /// The picture is alone.
    #[default]
    Nothing,
    /// Panels, with sections.
    Panels,
}

/// Whether something stands beside the volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Decorations {
    /// Nothing.
    #[default]
    Off,
    /// As `render --decorate` draws them.
    On,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            host_memory_bytes: 512 << 20,
            max_error: 0.5 / 255.0,
            interaction_ms: 33,
            // Which alone says how far pixels may be off.
            backend: Backend::Cpu,
            threads: None,
            decorations: Decorations::Off,
            beside: Beside::Nothing,
            inspect: Inspect::Nothing,
        }
    }
}

/// A volume to open.
#[derive(Debug, Clone)]
pub struct Open {
    /// Container, or a source file, which is built into the cache folder first.
    pub path: PathBuf,
    /// What a source file does not say about itself.
    pub reading: Reading,
    /// How many times as large heights or depths are drawn.
    pub exaggeration: f64,
    /// What the scene says; the rest is chosen to suit the data.
    pub scene: Scene,
}

/// A picture to draw.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Counts wishes.
    pub number: u64,
    /// Of which volume: [`Opened::number`].
    pub volume: u64,
    /// What is wanted, with the size of the picture.
    pub scene: Scene,
}

/// A volume that is open. Clones of what it holds are shared.
#[derive(Debug)]
pub struct Opened {
    /// Counts volumes.
    pub number: u64,
    /// The file that was asked for.
    pub source: PathBuf,
    /// What it does not say about itself.
    pub reading: Reading,
    /// Its container: the same, or one in the cache folder; empty of a preview.
    pub path: PathBuf,
    /// Of a preview, which is shown while the container is built: how far apart its voxels are on each axis, in voxels of the volume.
    pub preview_of: Option<[u64; 3]>,
    /// The container, placed as it is drawn.
    pub container: Arc<Container>,
    /// What its header says.
    pub facts: VolumeFacts,
    /// Line numbers and times or depths, of a survey.
    pub survey: Option<Survey>,
    /// What a coarse level tells, where one is small enough.
    pub overview: Option<Overview>,
    /// How many times as large heights or depths are drawn.
    pub exaggeration: f64,
    /// The scene that was asked for, with everything written out.
    pub scene: Scene,
    /// Whether its camera was asked for, too.
    pub is_camera_asked: bool,
}

/// A picture that was drawn.
pub struct Frame {
    /// Of which volume.
    pub volume: u64,
    /// Of which wish.
    pub number: u64,
    /// 8 bits, background added.
    pub image: Arc<ColorImage>,
    /// What it cost, and how far it has come.
    pub stats: FrameStats,
    /// Nothing is left to do.
    pub is_converged: bool,
    /// Wall time of drawing it so far, milliseconds.
    pub spent_ms: f64,
    /// Bricks to mark in it: those that failed, and others where somebody wants to see them.
    pub marks: Vec<Mark>,
}

/// A question: what is under a pixel?
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Probe {
    /// Counts questions.
    pub number: u64,
    /// Of which volume.
    pub volume: u64,
    /// The panel; `None`: of the picture.
    pub panel: Option<usize>,
    /// Pixel (x, y), from the top left.
    pub pixel: [u32; 2],
}

/// The answer: a point, nothing, or why nobody knows.
#[derive(Debug, Clone, PartialEq)]
pub struct Probed {
    /// To what.
    pub probe: Probe,
    /// What is there.
    pub found: Result<Option<Picked>, String>,
}

/// What was brought into memory for the next picture, since the present one has converged.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LookedAhead {
    /// The wish that the present picture answers.
    pub number: u64,
    /// Bricks that came.
    pub page_ins: u64,
    /// Whether all that was looked for is there.
    pub is_complete: bool,
}

/// What takes long, and how far it is.
#[derive(Debug, Clone, PartialEq)]
pub enum Busy {
    /// A file is opened.
    Opening(PathBuf),
    /// A container is built from it.
    Building(PathBuf, BuildProgress),
    /// A file is read that the scene names: a mesh.
    Reading(PathBuf),
    /// A picture is exported: rows that are finished, and all.
    Exporting(PathBuf, [u32; 2]),
    /// Pictures of an animation go to a folder: those that are there, and all.
    Animating(PathBuf, [usize; 2]),
}

/// Something went wrong, or well.
#[derive(Debug, Clone, PartialEq)]
pub enum Message {
    /// In words for people, with what to do.
    Failure(String),
    /// What was done.
    Done(String),
}

/// All that the worker has to tell; reading takes it away, but for `busy`.
#[derive(Default)]
pub struct News {
    /// A volume has been opened.
    pub opened: Option<Arc<Opened>>,
    /// A picture has been drawn.
    pub frame: Option<Frame>,
    /// Pictures of the panels.
    pub sections: [Option<Frame>; PANELS],
    /// What is under the pixel that was asked for last.
    pub probed: Option<Probed>,
    /// What is there for the next picture.
    pub ahead: Option<LookedAhead>,
    /// What is going on.
    pub busy: Option<Busy>,
    /// What was done or went wrong.
    pub message: Option<Message>,
}

/// What is wanted and not begun.
#[derive(Default)]
struct Wishes {
    quit: bool,
    open: Option<Open>,
    settings: Option<Settings>,
    export: Option<Export>,
    animation: Option<Animation>,
    view: Option<View>,
    sections: [Option<View>; PANELS],
    probe: Option<Probe>,
    /// Stops what the worker does, while that may be cut short.
    cut: Option<Canceller>,
    /// Stops an export.
    export_canceller: Option<Canceller>,
    /// Stops a build.
    build_canceller: Option<Canceller>,
    /// Of a build: what there is to look at until it has ended, and what has come of it. With the number of its wish.
    preview: Option<(u64, Box<Preview>)>,
    built: Option<(u64, Result<PathBuf, Message>)>,
}

impl Wishes {
    /// The volume that is to be opened, and what stops its build from now on.
    fn opening(&mut self) -> Option<Work> {
        let open = self.open.take()?;
        let canceller = Canceller::default();
        self.build_canceller = Some(canceller.clone());
        Some(Work::Open(Box::new(open), canceller))
    }

    /// The first section that is wanted.
    fn section(&mut self) -> Option<(usize, View)> {
        self.sections.iter_mut().enumerate().find_map(|(panel, view)| Some((panel, view.take()?)))
    }
}

/// What lies between window and worker.
struct Desk {
    wishes: Mutex<Wishes>,
    rung: Condvar,
    news: Mutex<News>,
    wake: Box<dyn Fn() + Send + Sync>,
    folders: Folders,
    /// The build that anybody still waits for; 0: none. Changes while the news are locked.
    building: AtomicU64,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Desk {
    /// Puts a wish down, and cuts short what may be.
    fn wish(&self, put: impl FnOnce(&mut Wishes)) {
        let mut wishes = lock(&self.wishes);
        put(&mut wishes);
        if let Some(canceller) = wishes.cut.take() {
            canceller.cancel();
        }
        self.rung.notify_one();
    }

    fn tell(&self, put: impl FnOnce(&mut News)) {
        put(&mut lock(&self.news));
        (self.wake)();
    }

    /// Tells what a build does, if anybody still waits for it.
    fn tell_of_build(&self, number: u64, busy: Busy) {
        self.tell(|news| {
            if self.building.load(Ordering::Relaxed) == number {
                news.busy = Some(busy);
            }
        });
    }

    fn fail(&self, message: impl std::fmt::Display) {
        self.tell(|news| news.message = Some(Message::Failure(message.to_string())));
    }
}

/// What to do next.
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
    GoOn,
}

impl Desk {
    /// The next piece of work; waits where there is none. What goes on may be cut short by the next wish.
    fn next(&self, going_on: Option<Canceller>) -> Work {
        let mut wishes = lock(&self.wishes);
        loop {
            wishes.cut = None;
            if wishes.quit {
                return Work::Quit;
            }
            let work = (wishes.opening())
                .or_else(|| wishes.preview.take().map(|(number, preview)| Work::Preview(number, preview)))
                .or_else(|| wishes.built.take().map(|(number, built)| Work::Built(number, built)))
                .or_else(|| wishes.settings.take().map(Work::Settings))
                .or_else(|| wishes.export.take().map(Work::Export))
                .or_else(|| wishes.animation.take().map(|animation| Work::Animation(Box::new(animation))))
                .or_else(|| wishes.view.take().map(Work::View))
                .or_else(|| wishes.section().map(|(panel, view)| Work::Section(panel, view)))
                .or_else(|| wishes.probe.take().map(Work::Probe));
            if let Some(work) = work {
                return work;
            }
            if going_on.is_some() {
                wishes.cut = going_on;
                return Work::GoOn;
            }
            wishes = self.rung.wait(wishes).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// The window's end of the desk. The thread ends with it.
pub struct Worker {
    desk: Arc<Desk>,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// Starts the thread; `wake` is called from it whenever there are news.
    ///
    /// # Errors
    /// If the system starts no thread.
    pub fn start(
        settings: Settings,
        folders: Folders,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> std::io::Result<Self> {
        let desk = Arc::new(Desk {
            wishes: Mutex::default(),
            rung: Condvar::new(),
            news: Mutex::default(),
            wake: Box::new(wake),
            folders,
            building: AtomicU64::new(0),
        });
        let of_thread = desk.clone();
        let thread = std::thread::Builder::new()
            .name("supervol-worker".into())
            .spawn(move || studio::work(&of_thread, settings))?;
        Ok(Self { desk, thread: Some(thread) })
    }

    /// Opens a volume, instead of the one that is open; a build that is under way is for nobody any more, and stops.
    pub fn open(&self, open: Open) {
        self.cancel_build();
        self.desk.wish(|wishes| {
            (wishes.open, wishes.view, wishes.probe) = (Some(open), None, None);
            wishes.sections = [const { None }; PANELS];
        });
    }

    /// Draws a picture.
    pub fn view(&self, view: View) {
        self.desk.wish(|wishes| wishes.view = Some(view));
    }

    /// Draws the section of a panel.
    ///
    /// # Panics
    /// If there is no such panel.
    pub fn section(&self, panel: usize, view: View) {
        self.desk.wish(|wishes| wishes.sections[panel] = Some(view));
    }

    /// Looks what is under a pixel.
    pub fn probe(&self, probe: Probe) {
        self.desk.wish(|wishes| wishes.probe = Some(probe));
    }

    /// From now on pictures are made like this.
    pub fn set(&self, settings: Settings) {
        self.desk.wish(|wishes| wishes.settings = Some(settings));
    }

    /// Draws a picture until it has converged, and writes it to a file.
    pub fn export(&self, export: Export) {
        self.desk.wish(|wishes| wishes.export = Some(export));
    }

    /// Draws the pictures of an animation, and writes them to a folder.
    pub fn animate(&self, animation: Animation) {
        self.desk.wish(|wishes| wishes.animation = Some(animation));
    }

    /// Gives an export or an animation up.
    pub fn cancel_export(&self) {
        self.desk.wish(|wishes| {
            (wishes.export, wishes.animation) = (None, None);
            if let Some(canceller) = wishes.export_canceller.take() {
                canceller.cancel();
            }
        });
    }

    /// Stops the build of a container. What it has finished stays in the cache folder, and the same file opened again goes on with it.
    pub fn cancel_build(&self) {
        self.desk.wish(|wishes| {
            wishes.open = None;
            if let Some(canceller) = wishes.build_canceller.take() {
                canceller.cancel();
            }
        });
    }

    /// What has happened since this was asked last.
    pub fn news(&self) -> News {
        let mut news = lock(&self.desk.news);
        News {
            opened: news.opened.take(),
            frame: news.frame.take(),
            sections: std::mem::take(&mut news.sections),
            probed: news.probed.take(),
            ahead: news.ahead.take(),
            busy: news.busy.clone(),
            message: news.message.take(),
        }
    }

    /// Whether the thread has ended although nobody asked it to: a mistake of ours.
    pub fn is_dead(&self) -> bool {
        self.thread.as_ref().is_some_and(JoinHandle::is_finished)
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.cancel_export();
        self.cancel_build();
        self.desk.wish(|wishes| wishes.quit = true);
        let Some(thread) = self.thread.take() else { return };
        // What it panicked with is on standard error already.
        let _ = thread.join();
    }
}

/// A picture for the window, with its background, that was begun then. Where bricks failed, it may have come to its end without having
/// converged as statistics mean it.
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

/// What was found, or why not; nothing where somebody wanted something else meanwhile.
fn picked(found: Result<Option<Picked>, RenderError>) -> Option<Result<Option<Picked>, String>> {
    match found {
        Err(RenderError::Cancelled) => None,
        found => Some(found.map_err(|e| e.to_string())),
    }
}
