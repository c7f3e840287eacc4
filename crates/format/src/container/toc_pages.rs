//! The pages of the table of contents that were used last.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most TOC pages kept in memory: 1024 pages are 64 MiB and name 837,632 bricks.
pub const CACHED_TOC_PAGES: usize = 1024;

/// Pages by number; shared by all threads.
#[derive(Default)]
pub(super) struct TocPages(Mutex<Recent>);

#[derive(Default)]
struct Recent {
    /// Each with the time of its last use.
    pages: HashMap<u64, (u64, Arc<[u8]>)>,
    clock: u64,
}

impl TocPages {
    /// A page, which counts as used now.
    pub(super) fn get(&self, number: u64) -> Option<Arc<[u8]>> {
        let mut recent = self.lock();
        recent.clock += 1;
        let now = recent.clock;
        let (used, page) = recent.pages.get_mut(&number)?;
        *used = now;
        Some(page.clone())
    }

    /// Whether a page is there.
    pub(super) fn contains(&self, number: u64) -> bool {
        self.lock().pages.contains_key(&number)
    }

    /// Keeps a page; the one that was used longest ago leaves where there are too many.
    pub(super) fn insert(&self, number: u64, page: Arc<[u8]>) {
        let mut recent = self.lock();
        if recent.pages.len() >= CACHED_TOC_PAGES {
            let oldest = recent.pages.iter().min_by_key(|(_, (used, _))| *used).map(|(&n, _)| n);
            oldest.and_then(|n| recent.pages.remove(&n));
        }
        let now = recent.clock;
        recent.pages.insert(number, (now, page));
    }

    fn lock(&self) -> MutexGuard<'_, Recent> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
