//! State that the window and the worker share: pending requests and messages.

use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use supervol::Canceller;
use supervol_preprocess::preview::Preview;

use super::messages::{Animation, Busy, Export, Message, Messages, Open, PANELS, Probe, Settings, View};
use crate::folders::Folders;

/// Pending requests of the window that have not begun.
#[derive(Default)]
pub(super) struct Requests {
    pub(super) quit: bool,
    pub(super) open: Option<Open>,
    pub(super) settings: Option<Settings>,
    pub(super) export: Option<Export>,
    pub(super) animation: Option<Animation>,
    pub(super) view: Option<View>,
    pub(super) sections: [Option<View>; PANELS],
    pub(super) probe: Option<Probe>,
    /// Canceller of the worker's current work, while it may be interrupted.
    pub(super) interrupt: Option<Canceller>,
    /// Canceller of an export.
    pub(super) export_canceller: Option<Canceller>,
    /// Canceller of a build.
    pub(super) build_canceller: Option<Canceller>,
    /// Preview and result of a build, each with the number of the build's request.
    pub(super) preview: Option<(u64, Box<Preview>)>,
    pub(super) built: Option<(u64, Result<PathBuf, Message>)>,
}

impl Requests {
    /// Takes the request to open a volume, and installs a canceller for its build.
    pub(super) fn opening(&mut self) -> Option<Work> {
        let open = self.open.take()?;
        let canceller = Canceller::default();
        self.build_canceller = Some(canceller.clone());
        Some(Work::Open(Box::new(open), canceller))
    }

    /// Takes the first requested section.
    pub(super) fn section(&mut self) -> Option<(usize, View)> {
        self.sections.iter_mut().enumerate().find_map(|(panel, view)| Some((panel, view.take()?)))
    }
}

/// State shared by the window and the worker.
pub(super) struct Shared {
    pub(super) requests: Mutex<Requests>,
    pub(super) request_added: Condvar,
    pub(super) messages: Mutex<Messages>,
    pub(super) wake: Box<dyn Fn() + Send + Sync>,
    pub(super) folders: Folders,
    /// Number of the build that is still wanted; 0: none. Changed only while the messages are locked.
    pub(super) building: AtomicU64,
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// Adds a request and interrupts work that may be interrupted.
    pub(super) fn request(&self, put: impl FnOnce(&mut Requests)) {
        let mut requests = lock(&self.requests);
        put(&mut requests);
        if let Some(canceller) = requests.interrupt.take() {
            canceller.cancel();
        }
        self.request_added.notify_one();
    }

    pub(super) fn send(&self, put: impl FnOnce(&mut Messages)) {
        put(&mut lock(&self.messages));
        (self.wake)();
    }

    /// Reports the progress of a build, if it is still wanted.
    pub(super) fn report_build(&self, number: u64, busy: Busy) {
        self.send(|messages| {
            if self.building.load(Ordering::Relaxed) == number {
                messages.busy = Some(busy);
            }
        });
    }

    pub(super) fn report_failure(&self, message: impl std::fmt::Display) {
        self.send(|messages| messages.message = Some(Message::Failure(message.to_string())));
    }
}

/// The next piece of work.
pub(super) enum Work {
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
    pub(super) fn next(&self, interruptible: Option<Canceller>) -> Work {
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
