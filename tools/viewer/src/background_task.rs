//! Background task: a short job on a thread of its own, so that the window does not wait for a disk or a network. Used
//! to list folders and to read or write small files.

use std::sync::{Arc, Mutex, PoisonError};

use eframe::egui;

/// A background task with its result. If it is dropped, the job still runs to its end, and the result is lost.
pub struct BackgroundTask<T>(Arc<Mutex<Option<T>>>);

impl<T: Send + 'static> BackgroundTask<T> {
    /// Starts the job; the window is repainted when it is done. If no thread can be started, the job runs at once.
    pub fn start(ctx: &egui::Context, work: impl FnOnce() -> T + Send + 'static) -> Self {
        let place = Arc::new(Mutex::new(None));
        let work = Arc::new(Mutex::new(Some(work)));
        let (told, waker, own_work) = (place.clone(), ctx.clone(), work.clone());
        let run = move || {
            let taken = own_work.lock().unwrap_or_else(PoisonError::into_inner).take();
            if let Some(work) = taken {
                let done = work();
                *told.lock().unwrap_or_else(PoisonError::into_inner) = Some(done);
                waker.request_repaint();
            }
        };
        if std::thread::Builder::new().name("supervol-task".into()).spawn(run).is_err()
            && let Some(work) = work.lock().unwrap_or_else(PoisonError::into_inner).take()
        {
            let done = work();
            *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(done);
        }
        Self(place)
    }

    /// The result, once; `None` until the job is done.
    pub fn take(&self) -> Option<T> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}
