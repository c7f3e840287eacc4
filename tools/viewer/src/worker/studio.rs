//! The worker's thread: executes the requests of the window (`Studio`).
//!
//! Containers are built on a thread of their own, so that drawing continues meanwhile. For a large volume, a preview is
//! drawn until the container is finished:
//!
//! ```text
//! open a source --> build thread: preview (in memory) --> container in the cache folder
//!                                    |                       |
//!                   this thread:  an easel with it  -->  an easel with the volume itself
//! ```
//!
//! An easel is the drawing state of one open volume ([`Easel`]).

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use supervol_preprocess::kept::is_container;
use supervol_preprocess::preview::Preview;
use supervol_runtime::stop::Canceller;

use super::easel::Easel;
use super::{Busy, Desk, Message, Open, Opened, Settings, Work, lock, open};

/// Longest time that a closing window waits for a build, and interval of its checks.
const CLOSING_PATIENCE: Duration = Duration::from_millis(800);
const CLOSING_INTERVAL: Duration = Duration::from_millis(5);

/// State of the worker's thread.
struct Studio {
    desk: Arc<Desk>,
    settings: Settings,
    easel: Option<Easel>,
    /// Number of volumes requested so far, including previews.
    volumes: u64,
    /// The running build: its number and its request.
    building: Option<(u64, Open)>,
    /// Thread of the last build.
    builder: Option<JoinHandle<()>>,
}

/// Main loop of the thread.
pub(super) fn work(desk: &Arc<Desk>, settings: Settings) {
    let mut studio = Studio { desk: desk.clone(), settings, easel: None, volumes: 0, building: None, builder: None };
    loop {
        let going_on = studio.easel.as_ref().and_then(Easel::unfinished);
        let next = desk.next(going_on);
        if let (Some(easel), false) = (&mut studio.easel, matches!(next, Work::GoOn)) {
            easel.forget_cut();
        }
        if matches!(next, Work::Quit) {
            break;
        }
        studio.run(next);
    }
    studio.leave();
}

impl Studio {
    fn run(&mut self, work: Work) {
        match work {
            Work::Quit => return,
            Work::Open(wish, canceller) => return self.open(*wish, canceller),
            Work::Preview(number, preview) => return self.show_preview(number, preview),
            Work::Built(number, built) => return self.end_build(number, built),
            Work::Settings(settings) => self.settings = settings,
            Work::Export(_) | Work::Animation(_) => {
                if let Some(why) = self.refusal() {
                    return self.desk.fail(why);
                }
            }
            _ => {}
        }
        let Self { desk, settings, easel: Some(easel), .. } = self else { return };
        match work {
            Work::Settings(_) => easel.set(desk, settings),
            Work::Export(wish) => {
                let message = easel.export(desk, &wish, settings).unwrap_or_else(Message::Failure);
                end_export(desk, message);
            }
            Work::Animation(wish) => {
                let message = easel.animate(desk, &wish, settings).unwrap_or_else(Message::Failure);
                end_export(desk, message);
            }
            Work::View(view) => easel.begin(desk, view, settings),
            Work::Section(panel, view) => easel.begin_section(desk, panel, view, settings),
            Work::Probe(probe) => easel.probe(desk, probe),
            Work::GoOn => easel.go_on(desk),
            Work::Quit | Work::Open(..) | Work::Preview(..) | Work::Built(..) => {}
        }
    }

    /// Waits for a stopped build for a limited time. Third-party code may not check for cancellation. The end of the
    /// process then stops it, and the finished parts stay as after a kill.
    fn leave(self) {
        let patience = Instant::now() + CLOSING_PATIENCE;
        while self.builder.as_ref().is_some_and(|thread| !thread.is_finished()) && Instant::now() < patience {
            std::thread::sleep(CLOSING_INTERVAL);
        }
    }

    /// Reason why no picture can be written now; `None` if one can.
    fn refusal(&self) -> Option<String> {
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if let Some((_, wish)) = &self.building {
            return Some(format!(
                "the container of {} is still being built: export later, or cancel the build",
                name(&wish.path)
            ));
        }
        let opened = &self.easel.as_ref()?.opened;
        opened.preview_of.map(|strides| refused_of_preview(&opened.source, strides))
    }

    /// Opens a container, or starts to build one.
    fn open(&mut self, wish: Open, canceller: Canceller) {
        self.volumes += 1;
        let number = self.volumes;
        let is_built = !is_container(&wish.path);
        self.desk.tell(|news| {
            self.desk.building.store(if is_built { number } else { 0 }, Ordering::Relaxed);
            news.busy = Some(Busy::Opening(wish.path.clone()));
        });
        if !is_built {
            self.building = None;
            let path = wish.path.clone();
            return self.end_opening(open::open(&path, wish, number));
        }
        self.building = Some((number, wish.clone()));
        match open::begin_build(&self.desk, (wish, number), (&self.settings, canceller), self.builder.take()) {
            Ok(thread) => self.builder = Some(thread),
            Err(error) => self.end_opening(Err(Message::Failure(format!("cannot start a thread: {error}")))),
        }
    }

    /// Shows the preview of a volume whose container is being built.
    fn show_preview(&mut self, build: u64, preview: Box<Preview>) {
        let Some((_, wish)) = self.building.as_ref().filter(|(number, _)| *number == build) else { return };
        self.volumes += 1;
        let opened = open::open_preview(*preview, wish.clone(), self.volumes);
        match opened.and_then(|opened| Easel::new(&self.desk, opened, &self.settings).map_err(Message::Failure)) {
            Ok(easel) => self.easel = Some(easel),
            Err(message) => self.desk.tell(|news| news.message = Some(message)),
        }
    }

    /// Handles the result of a build; ignores it if another file was opened meanwhile.
    fn end_build(&mut self, build: u64, built: Result<PathBuf, Message>) {
        let Some((_, wish)) = self.building.take_if(|(number, _)| *number == build) else { return };
        self.volumes += 1;
        self.end_opening(built.and_then(|path| open::open(&path, wish, self.volumes)));
    }

    /// Shows an opened volume. If opening failed, the present one stays.
    fn end_opening(&mut self, opened: Result<Arc<Opened>, Message>) {
        let easel = opened.and_then(|opened| Easel::new(&self.desk, opened, &self.settings).map_err(Message::Failure));
        let message = match easel {
            Ok(easel) => {
                self.easel = Some(easel);
                None
            }
            Err(message) => Some(message),
        };
        lock(&self.desk.wishes).build_canceller = None;
        self.desk.tell(|news| {
            self.desk.building.store(0, Ordering::Relaxed);
            news.busy = None;
            if message.is_some() {
                news.message = message;
            }
        });
    }
}

/// Message for the refusal to write a picture of a preview, which is not the volume.
pub(crate) fn refused_of_preview(source: &Path, [x, y, z]: [u64; 3]) -> String {
    format!(
        "this picture is a preview (one of {x} x {y} x {z} voxels) and cannot be saved. Wait until the container of {} is built; \
         if the build was stopped, open the file again",
        source.display()
    )
}

fn end_export(desk: &Desk, message: Message) {
    lock(&desk.wishes).export_canceller = None;
    desk.tell(|news| (news.busy, news.message) = (None, Some(message)));
}
