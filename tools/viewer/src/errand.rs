//! Something short that is done in a thread of its own, so that the window does not wait for a disk or a network: a folder is listed,
//! a small file is read or written.

use std::sync::{Arc, Mutex, PoisonError};

use eframe::egui;

/// See the module. One that is dropped goes on, and nobody hears of it.
pub struct Errand<T>(Arc<Mutex<Option<T>>>);

impl<T: Send + 'static> Errand<T> {
    /// Begins; the window is woken when it is done. Where no thread can be started, it is done at once.
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
        if std::thread::Builder::new().name("supervol-errand".into()).spawn(run).is_err()
            && let Some(work) = work.lock().unwrap_or_else(PoisonError::into_inner).take()
        {
            let done = work();
            *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(done);
        }
        Self(place)
    }

    /// What came of it, once.
    pub fn take(&self) -> Option<T> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}
