//! The worker's thread: executes the requests of the window (`WorkerState`).
//!
//! Containers are built on a thread of their own, so that drawing continues meanwhile. For a large volume, a preview is
//! drawn until the container is finished:
//!
//! ```text
//! open a source --> build thread: preview (in memory) --> container in the cache folder
//!                                    |                       |
//!              this thread:  a DrawingState of it  -->  a DrawingState of the volume itself
//! ```
//!
//! A [`DrawingState`] belongs to one open volume.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use supervol::Canceller;
use supervol_preprocess::kept::is_container;
use supervol_preprocess::preview::Preview;

use super::drawing::DrawingState;
use super::messages::{Busy, Message, Open, OpenVolume, Settings};
use super::open;
use super::shared::{Shared, Work, lock};

/// Longest time that a closing window waits for a build, and interval of its checks.
const CLOSING_TIMEOUT: Duration = Duration::from_millis(800);
const CLOSING_INTERVAL: Duration = Duration::from_millis(5);

/// State of the worker's thread.
struct WorkerState {
    shared: Arc<Shared>,
    settings: Settings,
    drawing: Option<DrawingState>,
    /// Number of volumes requested so far, including previews.
    volumes: u64,
    /// The running build: its number and its request.
    building: Option<(u64, Open)>,
    /// Thread of the last build.
    builder: Option<JoinHandle<()>>,
}

/// Main loop of the thread.
pub(super) fn work(shared: &Arc<Shared>, settings: Settings) {
    let mut state =
        WorkerState { shared: shared.clone(), settings, drawing: None, volumes: 0, building: None, builder: None };
    loop {
        let interruptible = state.drawing.as_ref().and_then(DrawingState::unfinished);
        let next = shared.next(interruptible);
        if let (Some(drawing), false) = (&mut state.drawing, matches!(next, Work::Continue)) {
            drawing.clear_cancellation();
        }
        if matches!(next, Work::Quit) {
            break;
        }
        state.run(next);
    }
    state.shut_down();
}

impl WorkerState {
    fn run(&mut self, work: Work) {
        match work {
            Work::Quit => return,
            Work::Open(request, canceller) => return self.open(*request, canceller),
            Work::Preview(number, preview) => return self.show_preview(number, preview),
            Work::Built(number, built) => return self.end_build(number, built),
            Work::Settings(settings) => self.settings = settings,
            Work::Export(_) | Work::Animation(_) => {
                if let Some(why) = self.refusal() {
                    return self.shared.report_failure(why);
                }
            }
            _ => {}
        }
        let Self { shared, settings, drawing: Some(drawing), .. } = self else { return };
        match work {
            Work::Settings(_) => drawing.set(shared, settings),
            Work::Export(request) => {
                let message = drawing.export(shared, &request, settings).unwrap_or_else(Message::Failure);
                end_export(shared, message);
            }
            Work::Animation(request) => {
                let message = drawing.animate(shared, &request, settings).unwrap_or_else(Message::Failure);
                end_export(shared, message);
            }
            Work::View(view) => drawing.begin(shared, view, settings),
            Work::Section(panel, view) => drawing.begin_section(shared, panel, view, settings),
            Work::Probe(probe) => drawing.probe(shared, probe),
            Work::Continue => drawing.continue_drawing(shared),
            Work::Quit | Work::Open(..) | Work::Preview(..) | Work::Built(..) => {}
        }
    }

    /// Waits for a stopped build for a limited time. Third-party code may not check for cancellation. The end of the
    /// process then stops it, and the finished parts stay as after a kill.
    fn shut_down(self) {
        let deadline = Instant::now() + CLOSING_TIMEOUT;
        while self.builder.as_ref().is_some_and(|thread| !thread.is_finished()) && Instant::now() < deadline {
            std::thread::sleep(CLOSING_INTERVAL);
        }
    }

    /// Reason why no picture can be written now; `None` if one can.
    fn refusal(&self) -> Option<String> {
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if let Some((_, request)) = &self.building {
            return Some(format!(
                "the container of {} is still being built: export later, or cancel the build",
                name(&request.path)
            ));
        }
        let opened = &self.drawing.as_ref()?.opened;
        opened.preview_of.map(|strides| preview_refusal(&opened.source, strides))
    }

    /// Opens a container, or starts to build one.
    fn open(&mut self, request: Open, canceller: Canceller) {
        self.volumes += 1;
        let number = self.volumes;
        let is_built = !is_container(&request.path);
        self.shared.send(|messages| {
            self.shared.building.store(if is_built { number } else { 0 }, Ordering::Relaxed);
            messages.busy = Some(Busy::Opening(request.path.clone()));
        });
        if !is_built {
            self.building = None;
            let path = request.path.clone();
            return self.end_opening(open::open(&path, request, number));
        }
        self.building = Some((number, request.clone()));
        match open::begin_build(&self.shared, (request, number), (&self.settings, canceller), self.builder.take()) {
            Ok(thread) => self.builder = Some(thread),
            Err(error) => self.end_opening(Err(Message::Failure(format!("cannot start a thread: {error}")))),
        }
    }

    /// Shows the preview of a volume whose container is being built.
    fn show_preview(&mut self, build: u64, preview: Box<Preview>) {
        let Some((_, request)) = self.building.as_ref().filter(|(number, _)| *number == build) else { return };
        self.volumes += 1;
        let opened = open::open_preview(*preview, request.clone(), self.volumes);
        match opened
            .and_then(|opened| DrawingState::new(&self.shared, opened, &self.settings).map_err(Message::Failure))
        {
            Ok(drawing) => self.drawing = Some(drawing),
            Err(message) => self.shared.send(|messages| messages.message = Some(message)),
        }
    }

    /// Handles the result of a build; ignores it if another file was opened meanwhile.
    fn end_build(&mut self, build: u64, built: Result<PathBuf, Message>) {
        let Some((_, request)) = self.building.take_if(|(number, _)| *number == build) else { return };
        self.volumes += 1;
        self.end_opening(built.and_then(|path| open::open(&path, request, self.volumes)));
    }

    /// Shows an opened volume. If opening failed, the present one stays.
    fn end_opening(&mut self, opened: Result<Arc<OpenVolume>, Message>) {
        let drawing =
            opened.and_then(|opened| DrawingState::new(&self.shared, opened, &self.settings).map_err(Message::Failure));
        let message = match drawing {
            Ok(drawing) => {
                self.drawing = Some(drawing);
                None
            }
            Err(message) => Some(message),
        };
        lock(&self.shared.requests).build_canceller = None;
        self.shared.send(|messages| {
            self.shared.building.store(0, Ordering::Relaxed);
            messages.busy = None;
            if message.is_some() {
                messages.message = message;
            }
        });
    }
}

/// Message for the refusal to write a picture of a preview, which is not the volume.
pub(crate) fn preview_refusal(source: &Path, [x, y, z]: [u64; 3]) -> String {
    format!(
        "this picture is a preview (one of {x} x {y} x {z} voxels) and cannot be saved. Wait until the container of {} is built; \
         if the build was stopped, open the file again",
        source.display()
    )
}

fn end_export(shared: &Shared, message: Message) {
    lock(&shared.requests).export_canceller = None;
    shared.send(|messages| (messages.busy, messages.message) = (None, Some(message)));
}
