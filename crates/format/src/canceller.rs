//! Cancel flag for long work, set from another thread.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Cancel flag. Clones share one flag. A set flag stays set until its owner calls [`Canceller::take`].
#[derive(Debug, Clone, Default)]
pub struct Canceller(Arc<AtomicBool>);

impl Canceller {
    /// Sets the flag. Work in progress stops soon; if none is in progress, the next work stops at once.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether the flag is set.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Resets the flag and returns whether it was set. Later work is not affected.
    pub fn take(&self) -> bool {
        self.0.swap(false, Ordering::Relaxed)
    }
}

/// All cancellers are equal, so that options compare by their other fields.
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
