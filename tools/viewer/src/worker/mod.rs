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
mod messages;
mod open;
mod sections;
mod shared;
mod state;
mod written;

use std::sync::atomic::AtomicU64;
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;

pub use self::marks::MARK_LIMIT;
pub use self::messages::{
    Animation, Busy, Decorations, Export, Frame, Inspect, LookedAhead, Mark, Message, Messages, Motion, Open,
    OpenVolume, PANELS, Probe, ProbeAnswer, Refused, Settings, SidePanels, View,
};
use self::shared::{Shared, lock};
pub(crate) use self::state::preview_refusal;
use crate::folders::Folders;

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
