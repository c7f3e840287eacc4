//! Store of unpacked bricks, within a number of bytes: the plain form of packed bricks that rays entered last.
//!
//! Casting threads share it. A brick is unpacked once, by the first thread that needs it; others that need it wait for that
//! thread. The least recently used leave first. A brick that is in use when it leaves is freed by its last user, so that
//! one brick a thread may lie beside the store.

use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use super::KeyMap;
use crate::stream::field::FieldBrick;
use crate::stream::held::PackedBrick;
use crate::stream::residency::DecodedBrick;

/// A brick that is unpacked by the first thread that needs it.
pub type Unpacked = OnceLock<DecodedBrick>;

/// Unpacked bricks of all threads.
#[derive(Debug, Default)]
pub struct UnpackedBricks(Mutex<Store>);

#[derive(Debug, Default)]
struct Store {
    bricks: KeyMap<Entry>,
    bytes: u64,
    limit_bytes: u64,
    peak_bytes: u64,
    /// Uses so far: the time of this store.
    uses: u64,
    unpacked: u64,
}

#[derive(Debug)]
struct Entry {
    brick: Arc<Unpacked>,
    bytes: u64,
    last_used: u64,
}

impl UnpackedBricks {
    /// Changes the most bytes to be held; one brick may always be.
    pub fn set_limit(&self, limit_bytes: u64) {
        let mut store = self.store();
        store.limit_bytes = limit_bytes;
        while store.bytes > limit_bytes && store.drop_oldest().is_some() {}
    }

    /// Bytes held at most since the last change to 0.
    #[must_use]
    pub fn peak_bytes(&self) -> u64 {
        self.store().peak_bytes
    }

    /// Bricks unpacked so far.
    #[must_use]
    pub fn unpacked(&self) -> u64 {
        self.store().unpacked
    }

    /// The plain form of a brick.
    pub(crate) fn get(&self, key: FieldBrick, packed: &PackedBrick) -> Arc<Unpacked> {
        let (brick, spare) = self.store().find_or_place(key, packed.plain_bytes());
        brick.get_or_init(|| packed.unpacked(spare));
        brick
    }

    /// A thread that panicked has left the store whole: nothing in here can fail half way.
    fn store(&self) -> MutexGuard<'_, Store> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Store {
    /// The brick, and memory for it if it must be unpacked.
    fn find_or_place(&mut self, key: FieldBrick, bytes: u64) -> (Arc<Unpacked>, Option<DecodedBrick>) {
        self.uses += 1;
        if let Some(entry) = self.bricks.get_mut(&key) {
            entry.last_used = self.uses;
            return (entry.brick.clone(), None);
        }
        let mut spare = None;
        while self.bytes + bytes > self.limit_bytes
            && let Some(dropped) = self.drop_oldest()
        {
            spare = Arc::into_inner(dropped).and_then(OnceLock::into_inner).or(spare);
        }
        let brick = Arc::<Unpacked>::default();
        self.bricks.insert(key, Entry { brick: brick.clone(), bytes, last_used: self.uses });
        self.bytes += bytes;
        self.peak_bytes = self.peak_bytes.max(self.bytes);
        self.unpacked += 1;
        (brick, spare)
    }

    fn drop_oldest(&mut self) -> Option<Arc<Unpacked>> {
        let oldest = self.bricks.iter().min_by_key(|(_, entry)| entry.last_used).map(|(&key, _)| key)?;
        let entry = self.bricks.remove(&oldest)?;
        self.bytes -= entry.bytes;
        Some(entry.brick)
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::{BrickIndex, BrickKey, Lod};

    use super::*;
    use crate::stream::field::Field;
    use crate::stream::residency::Voxels;

    fn packed(x: u32) -> (FieldBrick, PackedBrick) {
        let key = BrickKey::new(Lod(0), BrickIndex([x, 0, 0]));
        let voxels = Voxels::U8(vec![x as u8; 1000]);
        let (macro_ranges, macro_errors) = (Vec::new(), Vec::new());
        let extent = [10; 3];
        let brick = DecodedBrick { key, extent, voxels, macro_ranges, rounding: 0.0, unrounded: None, macro_errors };
        (Field::FIRST.brick(key), PackedBrick::new(&brick).expect("one value takes few bits"))
    }

    #[test]
    fn the_least_recently_used_leaves_and_each_is_unpacked_once_while_it_stays() {
        let (store, bricks) = (UnpackedBricks::default(), [0, 1, 2].map(packed));
        store.set_limit(2000);
        let get = |x: usize| {
            let (key, packed) = &bricks[x];
            store.get(*key, packed).get().unwrap().voxels.clone()
        };
        for x in [0, 1, 0, 1, 0] {
            assert_eq!(get(x), Voxels::U8(vec![x as u8; 1000]));
        }
        assert_eq!((store.unpacked(), store.peak_bytes()), (2, 2000));
        // Brick 1 was used longest ago.
        assert_eq!(get(2), Voxels::U8(vec![2; 1000]));
        assert_eq!((get(0), store.unpacked()), (Voxels::U8(vec![0; 1000]), 3));
        assert_eq!((get(1), store.unpacked(), store.peak_bytes()), (Voxels::U8(vec![1; 1000]), 4, 2000));
        // One brick is held whatever the limit, and one that leaves stays whole for its users.
        store.set_limit(0);
        let (key, brick) = &bricks[0];
        let held = store.get(*key, brick);
        assert_eq!(get(1), Voxels::U8(vec![1; 1000]));
        assert_eq!(held.get().unwrap().voxels, Voxels::U8(vec![0; 1000]));
        assert_eq!(store.store().bytes, 1000);
    }

    #[test]
    fn threads_share_what_one_of_them_unpacks() {
        let (store, bricks) = (UnpackedBricks::default(), [0, 1, 2, 3].map(packed));
        store.set_limit(4000);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for round in 0..200 {
                        let (key, packed) = &bricks[round % 4];
                        let brick = store.get(*key, packed);
                        assert_eq!(brick.get().unwrap().voxels, Voxels::U8(vec![(round % 4) as u8; 1000]));
                    }
                });
            }
        });
        assert_eq!(store.unpacked(), 4);
    }
}
