//! Cache of the most recently used TOC pages.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::recent::Recent;

/// Largest number of cached TOC pages: 1024 pages take 64 MiB and hold the entries of 837,632 bricks.
pub const CACHED_TOC_PAGES: usize = 1024;

/// Pages by number, shared by all threads.
#[derive(Default)]
pub(super) struct TocPages(Mutex<Recent<u64, Arc<Vec<u8>>>>);

impl TocPages {
    /// The page, if it is cached; counts as a use.
    pub(super) fn get(&self, number: u64) -> Option<Arc<Vec<u8>>> {
        self.lock().get(&number).cloned()
    }

    /// Whether the page is cached.
    pub(super) fn contains(&self, number: u64) -> bool {
        self.lock().contains(&number)
    }

    /// Caches a page; if there are too many, the least recently used one is dropped.
    pub(super) fn insert(&self, number: u64, page: Arc<Vec<u8>>) {
        self.lock().insert_within(CACHED_TOC_PAGES, number, page);
    }

    fn lock(&self) -> MutexGuard<'_, Recent<u64, Arc<Vec<u8>>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
