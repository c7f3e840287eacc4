//! What is made once for each brick of a frame, and kept while it fits.

use std::collections::HashMap;
use std::sync::{Arc, RwLock};

use supervol_format::BrickKey;

/// Most bytes that are kept; all is dropped where more would be needed.
const BYTES_LIMIT: u64 = 32 << 20;

/// Things made of bricks, each at least once.
#[derive(Debug)]
pub struct PerBrick<T> {
    kept: RwLock<Kept<T>>,
}

#[derive(Debug)]
struct Kept<T> {
    of_bricks: HashMap<BrickKey, Arc<T>>,
    bytes: u64,
}

impl<T> Default for Kept<T> {
    fn default() -> Self {
        Self { of_bricks: HashMap::new(), bytes: 0 }
    }
}

impl<T> Default for PerBrick<T> {
    fn default() -> Self {
        Self { kept: RwLock::default() }
    }
}

impl<T> PerBrick<T> {
    /// What was made of a brick, or is made now; `bytes` says how much it holds.
    pub fn of(&self, key: BrickKey, bytes: impl Fn(&T) -> u64, make: impl FnOnce() -> T) -> Arc<T> {
        let known = self.kept.read().expect("no thread panics with the lock").of_bricks.get(&key).cloned();
        known.unwrap_or_else(|| {
            let made = Arc::new(make());
            let held = bytes(&made);
            let mut kept = self.kept.write().expect("no thread panics with the lock");
            if kept.bytes + held > BYTES_LIMIT {
                *kept = Kept::default();
            }
            if kept.of_bricks.insert(key, made.clone()).is_none() {
                kept.bytes += held;
            }
            made
        })
    }
}
