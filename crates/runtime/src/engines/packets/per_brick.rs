//! Data derived once from each brick of each field, and kept while it fits.

use std::sync::{Arc, RwLock};

use crate::stream::cache::KeyMap;
use crate::stream::field::FieldBrick;

/// Bytes of an entry beside its own data: its place in the table, and allocations.
const OVERHEAD_BYTES: u64 = 128;

/// Data derived from bricks, each at least once.
#[derive(Debug)]
pub struct PerBrick<T> {
    /// Most bytes kept; if more would be needed, everything is dropped.
    bytes_limit: u64,
    kept: RwLock<Kept<T>>,
}

#[derive(Debug)]
struct Kept<T> {
    /// Entries with their bytes.
    of_bricks: KeyMap<(Arc<T>, u64)>,
    bytes: u64,
}

impl<T> Default for Kept<T> {
    fn default() -> Self {
        Self { of_bricks: KeyMap::default(), bytes: 0 }
    }
}

/// Bytes of keeping an entry of this many bytes.
#[must_use]
pub fn bytes_kept(bytes: u64) -> u64 {
    bytes + OVERHEAD_BYTES
}

impl<T> PerBrick<T> {
    /// An empty store that keeps at most this many bytes.
    #[must_use]
    pub fn new(bytes_limit: u64) -> Self {
        Self { bytes_limit, kept: RwLock::default() }
    }

    /// The entry of a brick, made now if it is missing; `bytes` gives its size.
    pub fn of(&self, key: FieldBrick, bytes: impl Fn(&T) -> u64, make: impl FnOnce() -> T) -> Arc<T> {
        self.of_which(key, |_| true, bytes, make)
    }

    /// The same, made again if `is_true` rejects the old entry.
    pub fn of_which(
        &self,
        key: FieldBrick,
        is_true: impl Fn(&T) -> bool,
        bytes: impl Fn(&T) -> u64,
        make: impl FnOnce() -> T,
    ) -> Arc<T> {
        let known = self.kept.read().expect("no thread panics with the lock").of_bricks.get(&key).cloned();
        known.map(|(made, _)| made).filter(|made| is_true(made)).unwrap_or_else(|| {
            let made = Arc::new(make());
            self.keep(key, bytes_kept(bytes(&made)), made.clone());
            made
        })
    }

    fn keep(&self, key: FieldBrick, bytes: u64, made: Arc<T>) {
        if bytes > self.bytes_limit {
            return;
        }
        let mut kept = self.kept.write().expect("no thread panics with the lock");
        if kept.bytes + bytes > self.bytes_limit {
            *kept = Kept::default();
        }
        // Another thread may have made the same in the meantime, or the old entry is outdated.
        let before = kept.of_bricks.insert(key, (made, bytes));
        kept.bytes = kept.bytes + bytes - before.map_or(0, |(_, bytes)| bytes);
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::{BrickIndex, BrickKey, Lod};

    use super::*;
    use crate::stream::field::Field;

    fn key(x: u32) -> FieldBrick {
        key_of(Field::FIRST, x)
    }

    fn key_of(field: Field, x: u32) -> FieldBrick {
        field.brick(BrickKey::new(Lod::FINEST, BrickIndex([x, 0, 0])))
    }

    /// Asks for ten bricks three times; returns how often an entry was made.
    fn made_of_ten(limit: u64) -> usize {
        let (per_brick, mut made) = (PerBrick::new(limit), 0);
        for x in (0..3).flat_map(|_| 0..10) {
            let make = || {
                made += 1;
                x
            };
            assert_eq!(*per_brick.of(key(x), |_| 1000, make), x);
            let kept = per_brick.kept.read().unwrap();
            assert_eq!(kept.bytes, kept.of_bricks.len() as u64 * bytes_kept(1000));
            assert!(kept.bytes <= limit, "{} of {limit} bytes", kept.bytes);
        }
        made
    }

    /// For example of two time steps, seen the same way.
    #[test]
    fn what_was_made_of_one_field_is_not_taken_for_another_s() {
        let of = |per_brick: &PerBrick<u16>, field| *per_brick.of(key_of(Field(field), 1), |_| 8, || field);
        let per_brick = PerBrick::new(2 * bytes_kept(8));
        assert_eq!([0, 1, 0, 1].map(|field| of(&per_brick, field)), [0, 1, 0, 1]);
        assert_eq!(per_brick.kept.read().unwrap().bytes, 2 * bytes_kept(8));
        let narrow = PerBrick::new(2 * bytes_kept(8) - 1);
        assert_eq!([0, 1].map(|field| of(&narrow, field)), [0, 1]);
        assert_eq!(narrow.kept.read().unwrap().of_bricks.len(), 1, "there is room for one of them");
    }

    #[test]
    fn what_is_not_true_any_more_is_made_anew_and_counted_once() {
        let per_brick = PerBrick::new(10 * bytes_kept(8));
        let of = |wanted: u64| per_brick.of_which(key(1), |&made| made == wanted, |&made| made, || wanted);
        for wanted in [8, 8, 3, 8] {
            assert_eq!(*of(wanted), wanted);
            let kept = per_brick.kept.read().unwrap();
            assert_eq!((kept.of_bricks.len(), kept.bytes), (1, bytes_kept(wanted)));
        }
    }

    #[test]
    fn no_more_is_kept_than_the_limit_allows_and_nothing_is_mistaken() {
        let one = bytes_kept(1000);
        assert_eq!(made_of_ten(10 * one), 10);
        assert_eq!([0, one - 1, one, 9 * one].map(made_of_ten), [30; 4]);
    }
}
