//! The pages of the table of contents that were used last.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::recent::Recent;

/// Most TOC pages kept in memory: 1024 pages are 64 MiB and name 837,632 bricks.
pub const CACHED_TOC_PAGES: usize = 1024;

/// Pages by number; shared by all threads.
#[derive(Default)]
pub(super) struct TocPages(Mutex<Recent<u64, Arc<Vec<u8>>>>);

impl TocPages {
    /// A page, which counts as used now.
    pub(super) fn get(&self, number: u64) -> Option<Arc<Vec<u8>>> {
        self.lock().get(&number).cloned()
    }

    /// Whether a page is there.
    pub(super) fn contains(&self, number: u64) -> bool {
        self.lock().contains(&number)
    }

    /// Keeps a page; the one that was used longest ago leaves where there are too many.
    pub(super) fn insert(&self, number: u64, page: Arc<Vec<u8>>) {
        self.lock().insert_within(CACHED_TOC_PAGES, number, page);
    }

    fn lock(&self) -> MutexGuard<'_, Recent<u64, Arc<Vec<u8>>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
