//! Long work that somebody stops from another thread.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Stops work from another thread. Clones stop the same work; once cancelled it stays so, unless its owner takes that back.
#[derive(Debug, Clone, Default)]
pub struct Canceller(Arc<AtomicBool>);

impl Canceller {
    /// The work in progress stops soon; where there is none, the next one does at once.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether somebody wants the work to stop.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// The work has stopped: whether somebody wanted that. The next one goes on.
    pub fn take(&self) -> bool {
        self.0.swap(false, Ordering::Relaxed)
    }
}

/// Options that differ only in who may cancel them say the same.
impl PartialEq for Canceller {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Eq for Canceller {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clones_stop_the_same_work_until_its_owner_takes_it_back() {
        let owner = Canceller::default();
        let other = owner.clone();
        assert!(!owner.is_cancelled());
        other.cancel();
        assert!(owner.is_cancelled() && other.is_cancelled());
        assert!(owner.take() && !other.is_cancelled() && !owner.take());
        assert!(!Canceller::default().is_cancelled());
    }
}
