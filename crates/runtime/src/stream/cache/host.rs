//! Host cache: decoded bricks, kept by field and brick within a number of bytes. The limit covers all fields together.
//!
//! Eviction is least recently used by *pass*: all bricks that one pass used are equally recent. The caller says which
//! bricks may leave ([`Victims`]); the cache chooses their order. The budget is never exceeded: room is made before
//! anything is read for it.
//!
//! Protocol of one pass:
//! 1. [`HostCache::begin_pass`]; rays look up bricks with [`HostCache::get`].
//! 2. [`HostCache::note_uses`] with the bricks they used.
//! 3. [`HostCache::victims`], [`HostCache::make_room`], [`HostCache::reserve`] for bricks to be read.
//! 4. For each brick that arrives: [`HostCache::take_spares`] for its memory, [`HostCache::release`],
//!    [`HostCache::insert`].

use super::KeyMap;
use crate::stream::counters::StreamCounters;
use crate::stream::field::FieldBrick;

/// Bytes of a brick besides its voxels and ranges: table entry and allocations.
pub const BRICK_OVERHEAD_BYTES: u64 = 256;

/// Bricks within a budget of bytes.
#[derive(Debug)]
pub struct HostCache<T> {
    bricks: KeyMap<Held<T>>,
    budget_bytes: u64,
    bytes: u64,
    /// Bytes kept free for bricks being loaded.
    reserved: u64,
    /// Evicted bricks whose memory is kept for bricks being loaded; never more bytes than are reserved. Freeing it and
    /// allocating it again on the next decoding thread would fragment memory.
    spares: Vec<Held<T>>,
    pass: u64,
    counters: StreamCounters,
    peak_bytes: u64,
}

#[derive(Debug)]
struct Held<T> {
    brick: T,
    bytes: u64,
    /// Pass in which a ray last used it, or in which it came.
    last_used: u64,
}

/// Eviction priority of a brick.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Standing {
    /// No ray of this frame will want it: leaves first, the least recently used first.
    Free,
    /// Rays of this frame may want it again; lesser numbers are wanted sooner. It leaves only for bricks that rays wait
    /// for now, the greatest number first.
    Live(i64),
    /// It stays.
    Kept,
}

/// Bricks that may leave, in their order of eviction.
#[derive(Debug, Default)]
pub struct Victims {
    /// The last element leaves next.
    free: Vec<(FieldBrick, u64)>,
    /// The last element leaves next.
    live: Vec<(FieldBrick, u64)>,
    free_bytes: u64,
    live_bytes: u64,
}

impl Victims {
    /// Bytes that no ray of this frame will want.
    #[must_use]
    pub fn free_bytes(&self) -> u64 {
        self.free_bytes
    }

    /// Bytes that rays of this frame may want again.
    #[must_use]
    pub fn live_bytes(&self) -> u64 {
        self.live_bytes
    }
}

impl<T> HostCache<T> {
    /// An empty cache of this many bytes.
    #[must_use]
    pub fn new(budget_bytes: u64) -> Self {
        Self {
            bricks: KeyMap::default(),
            budget_bytes,
            bytes: 0,
            reserved: 0,
            spares: Vec::new(),
            pass: 0,
            counters: StreamCounters::default(),
            peak_bytes: 0,
        }
    }

    /// Begins a pass: bricks used from now on are more recent than all others.
    pub fn begin_pass(&mut self) {
        self.pass += 1;
    }

    /// Number of the current pass.
    #[must_use]
    pub fn pass(&self) -> u64 {
        self.pass
    }

    /// The brick, if it is in the cache.
    #[inline]
    #[must_use]
    pub fn get(&self, key: FieldBrick) -> Option<&T> {
        self.bricks.get(&key).map(|held| &held.brick)
    }

    /// Records the bricks that the current pass used, and the number of its misses.
    pub fn note_uses(&mut self, used: &[FieldBrick], missed: u64) {
        for key in used {
            if let Some(held) = self.bricks.get_mut(key) {
                held.last_used = self.pass;
                self.counters.uses += 1;
            }
        }
        self.counters.misses += missed;
    }

    /// Bricks that may leave. `standing` receives the key and the pass in which the brick was last used.
    pub fn victims(&self, standing: impl Fn(FieldBrick, u64) -> Standing) -> Victims {
        let mut free = Vec::new();
        let mut live = Vec::new();
        for (&key, held) in &self.bricks {
            match standing(key, held.last_used) {
                Standing::Free => free.push((held.last_used, key, held.bytes)),
                Standing::Live(rank) => live.push((rank, key, held.bytes)),
                Standing::Kept => {}
            }
        }
        // The key breaks ties, so that the order does not depend on the hash table.
        free.sort_unstable_by(|a, b| b.cmp(a));
        live.sort_unstable();
        let strip =
            |v: Vec<(_, FieldBrick, u64)>| v.into_iter().map(|(_, key, bytes)| (key, bytes)).collect::<Vec<_>>();
        let free = free.into_iter().map(|(_, key, bytes)| (key, bytes)).collect::<Vec<_>>();
        let live: Vec<(FieldBrick, u64)> = strip(live);
        let sum = |v: &[(FieldBrick, u64)]| v.iter().map(|(_, bytes)| bytes).sum();
        Victims { free_bytes: sum(&free), live_bytes: sum(&live), free, live }
    }

    /// Drops bricks until `bytes` more fit; live ones only when no free ones are left. Returns the dropped bricks.
    /// Their memory is kept for the next reservation.
    ///
    /// # Errors
    /// The number of missing bytes if all victims together do not make enough room; then nothing was dropped.
    pub fn make_room(&mut self, bytes: u64, victims: &mut Victims) -> Result<Vec<FieldBrick>, u64> {
        let available = self.free_bytes() + victims.free_bytes + victims.live_bytes;
        if bytes > available {
            return Err(bytes - available);
        }
        let mut dropped = Vec::new();
        while self.free_bytes() < bytes {
            let (key, victim_bytes) = match victims.free.pop() {
                Some(victim) => {
                    victims.free_bytes -= victim.1;
                    victim
                }
                None => {
                    let victim = victims.live.pop().expect("the victims' bytes were counted above");
                    victims.live_bytes -= victim.1;
                    victim
                }
            };
            let held = self.bricks.remove(&key);
            self.spares.push(held.unwrap_or_else(|| panic!("{key} was to leave the cache but is not in it")));
            self.bytes -= victim_bytes;
            self.counters.evictions += 1;
            dropped.push(key);
        }
        Ok(dropped)
    }

    /// Changes the budget. Returns the dropped bricks. The least recently used leave first, those that `stays` selects
    /// last.
    pub fn set_budget(&mut self, budget_bytes: u64, stays: impl Fn(FieldBrick) -> bool) -> Vec<FieldBrick> {
        let rank = |key| if stays(key) { Standing::Live(0) } else { Standing::Free };
        let mut victims = self.victims(|key, _| rank(key));
        let less = self.budget_bytes.saturating_sub(budget_bytes);
        let dropped = self.make_room(less, &mut victims).expect("every brick may leave");
        self.budget_bytes = budget_bytes;
        self.drop_spares(self.reserved);
        dropped
    }

    /// Keeps bytes free for bricks being loaded.
    ///
    /// # Panics
    /// If no room was made for them.
    pub fn reserve(&mut self, bytes: u64) {
        assert!(
            bytes <= self.free_bytes(),
            "{bytes} bytes are to be reserved, but only {} are free",
            self.free_bytes()
        );
        self.reserved += bytes;
        self.peak_bytes = self.peak_bytes.max(self.bytes + self.reserved);
        self.drop_spares(self.reserved);
    }

    /// Takes one spare brick of equal size for each size, `None` if there is none.
    ///
    /// # Panics
    /// If less is reserved than the sizes' sum.
    pub fn take_spares(&mut self, sizes: &[u64]) -> Vec<Option<T>> {
        let spares = sizes.iter().map(|&bytes| self.take_spare(bytes)).collect();
        // The arriving bricks are in memory beside the remaining spares.
        self.drop_spares(self.reserved - sizes.iter().sum::<u64>());
        spares
    }

    fn take_spare(&mut self, bytes: u64) -> Option<T> {
        let at = self.spares.iter().rposition(|spare| spare.bytes == bytes)?;
        Some(self.spares.swap_remove(at).brick)
    }

    /// Drops spares until they hold at most `most_bytes`.
    fn drop_spares(&mut self, most_bytes: u64) {
        let mut bytes = self.spare_bytes();
        while bytes > most_bytes {
            bytes -= self.spares.pop().expect("they have these bytes").bytes;
        }
    }

    fn spare_bytes(&self) -> u64 {
        self.spares.iter().map(|spare| spare.bytes).sum()
    }

    /// Reserved bytes.
    #[must_use]
    pub fn reserved_bytes(&self) -> u64 {
        self.reserved
    }

    /// Frees reserved bytes: their brick is about to be inserted, or will not come.
    pub fn release(&mut self, bytes: u64) {
        self.reserved -= bytes;
        self.drop_spares(self.reserved);
    }

    /// Inserts a brick; `bytes` includes [`BRICK_OVERHEAD_BYTES`].
    ///
    /// # Panics
    /// If it is already in the cache, or no room was made for it.
    pub fn insert(&mut self, key: FieldBrick, brick: T, bytes: u64) {
        assert!(bytes <= self.free_bytes(), "{key} has {bytes} bytes, but only {} are free", self.free_bytes());
        let before = self.bricks.insert(key, Held { brick, bytes, last_used: self.pass });
        assert!(before.is_none(), "{key} is in the cache already");
        self.bytes += bytes;
        self.counters.page_ins += 1;
        self.peak_bytes = self.peak_bytes.max(self.bytes);
    }

    /// Replaces a brick by another form of it.
    ///
    /// # Panics
    /// If it is not in the cache, or no room was made for what it takes more.
    pub fn replace(&mut self, key: FieldBrick, brick: T, bytes: u64) {
        let free = self.free_bytes();
        let held =
            self.bricks.get_mut(&key).unwrap_or_else(|| panic!("{key} is to be replaced but is not in the cache"));
        assert!(bytes <= held.bytes + free, "{key} is to have {bytes} bytes, but only {free} more are free");
        self.bytes = self.bytes - held.bytes + bytes;
        (held.brick, held.bytes) = (brick, bytes);
        self.peak_bytes = self.peak_bytes.max(self.bytes + self.reserved);
    }

    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Most bytes that may be held.
    #[must_use]
    pub fn budget_bytes(&self) -> u64 {
        self.budget_bytes
    }

    /// Bytes that are free, and not reserved.
    #[must_use]
    pub fn free_bytes(&self) -> u64 {
        self.budget_bytes - self.bytes - self.reserved
    }

    /// Keys of all bricks, in no order.
    pub fn keys(&self) -> impl Iterator<Item = FieldBrick> + '_ {
        self.bricks.keys().copied()
    }

    /// Bricks held.
    #[must_use]
    pub fn len(&self) -> usize {
        self.bricks.len()
    }

    /// Whether nothing is held.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bricks.is_empty()
    }

    /// Most bytes held and reserved at once.
    #[must_use]
    pub fn peak_bytes(&self) -> u64 {
        self.peak_bytes
    }

    /// Counters: uses, misses, page-ins and evictions.
    #[must_use]
    pub fn counters(&self) -> &StreamCounters {
        &self.counters
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
        field.brick(BrickKey::new(Lod(0), BrickIndex([x, 0, 0])))
    }

    fn full() -> HostCache<u32> {
        let mut cache = HostCache::new(40);
        for x in 0..4 {
            cache.begin_pass();
            cache.insert(key(x), x, 10);
        }
        cache
    }

    #[test]
    fn the_least_recently_used_leaves_first() {
        let mut cache = full();
        cache.begin_pass();
        cache.note_uses(&[key(0)], 0);
        let mut victims = cache.victims(|_, _| Standing::Free);
        assert_eq!(cache.make_room(20, &mut victims), Ok(vec![key(1), key(2)]));
        assert_eq!((cache.get(key(0)), cache.get(key(1)), cache.bytes()), (Some(&0), None, 20));
        assert_eq!((cache.counters().evictions, cache.peak_bytes()), (2, 40));
    }

    #[test]
    fn live_bricks_leave_last_and_the_farthest_of_them_first_and_kept_ones_never() {
        let mut cache = full();
        let standing = |k: FieldBrick, _| match k.brick.brick().0[0] {
            0 => Standing::Kept,
            3 => Standing::Free,
            x => Standing::Live(i64::from(x)),
        };
        let mut victims = cache.victims(standing);
        assert_eq!((victims.free_bytes(), victims.live_bytes()), (10, 20));
        assert_eq!(cache.make_room(25, &mut victims), Ok(vec![key(3), key(2), key(1)]));
        assert_eq!(cache.make_room(35, &mut victims), Err(5));
        assert_eq!(cache.len(), 1);
    }

    #[test]
    fn a_smaller_budget_drops_what_is_over() {
        let mut cache = full();
        assert_eq!(cache.set_budget(25, |k| k == key(0)), [key(1), key(2)]);
        assert_eq!((cache.bytes(), cache.budget_bytes(), cache.free_bytes()), (20, 25, 5));
        assert_eq!(cache.set_budget(9, |k| k == key(0)), [key(3), key(0)]);
        assert_eq!(cache.set_budget(90, |_| false), []);
        cache.insert(key(7), 7, 90);
    }

    #[test]
    fn bricks_of_two_fields_at_one_place_are_two_in_the_bytes_and_in_the_order_in_which_they_leave() {
        let [a, b, c] = [0, 1, 2].map(|field| key_of(Field(field), 5));
        let mut cache = HostCache::new(20);
        for (brick, key) in [(1, a), (2, b)] {
            cache.begin_pass();
            cache.insert(key, brick, 10);
        }
        assert_eq!((cache.get(a), cache.get(b), cache.get(c)), (Some(&1), Some(&2), None));
        assert_eq!((cache.len(), cache.bytes(), cache.free_bytes()), (2, 20, 0));
        let mut keys: Vec<FieldBrick> = cache.keys().collect();
        keys.sort_unstable();
        assert_eq!(keys, [a, b]);
        // The older one is used once more: only the other leaves for the third field.
        cache.begin_pass();
        cache.note_uses(&[a, c], 0);
        assert_eq!(cache.counters().uses, 1);
        let mut victims = cache.victims(|_, _| Standing::Free);
        assert_eq!(cache.make_room(10, &mut victims), Ok(vec![b]));
        cache.insert(c, 3, 10);
        assert_eq!((cache.get(a), cache.get(b), cache.get(c)), (Some(&1), None, Some(&3)));
        assert_eq!(cache.set_budget(10, |key| key == a), [c]);
        assert_eq!((cache.get(a), cache.get(c), cache.bytes()), (Some(&1), None, 10));
    }

    #[test]
    fn room_that_is_there_costs_nothing() {
        let mut cache: HostCache<u32> = HostCache::new(10);
        assert_eq!(cache.make_room(10, &mut Victims::default()), Ok(vec![]));
        assert_eq!(cache.make_room(11, &mut Victims::default()), Err(1));
    }

    #[test]
    fn room_is_reserved_for_bricks_on_their_way() {
        let mut cache: HostCache<u32> = HostCache::new(40);
        cache.insert(key(0), 0, 10);
        cache.reserve(25);
        assert_eq!((cache.free_bytes(), cache.bytes(), cache.reserved_bytes()), (5, 10, 25));
        let mut victims = cache.victims(|_, _| Standing::Free);
        assert_eq!(cache.make_room(16, &mut victims), Err(1), "what is reserved cannot leave");
        cache.release(10);
        cache.insert(key(1), 1, 10);
        assert_eq!((cache.free_bytes(), cache.bytes(), cache.peak_bytes()), (5, 20, 35));
    }

    #[test]
    fn the_memory_of_those_that_left_waits_for_those_that_come_and_is_never_more_than_is_reserved() {
        let mut cache = full();
        let mut victims = cache.victims(|_, _| Standing::Free);
        assert_eq!(cache.make_room(25, &mut victims), Ok(vec![key(0), key(1), key(2)]));
        cache.reserve(25);
        assert_eq!(cache.spare_bytes(), 20, "the third would be more than is on its way");
        assert_eq!(cache.take_spares(&[10, 5]), [Some(1), None]);
        assert_eq!(cache.spare_bytes(), 10);
        cache.release(15);
        assert_eq!(cache.take_spares(&[7]), [None], "of another size");
        assert_eq!(cache.spare_bytes(), 0, "what comes and a spare are more than is reserved");
        cache.release(10);
        cache.insert(key(4), 4, 10);
        assert_eq!((cache.bytes(), cache.free_bytes(), cache.spares.len()), (20, 20, 0));
    }

    #[test]
    #[should_panic(expected = "only 0 are free")]
    fn the_budget_is_never_exceeded() {
        full().insert(key(9), 9, 1);
    }
}
