//! Slots of the cache: the brick of which field is in which slot, and the order of eviction.
//!
//! Eviction is least recently used first; "used" means that a ray sampled the slot in a pass. A brick inserted since
//! the last pass is never evicted: some ray waits for it and has not seen it yet. All fields share the slots.

use std::collections::{BTreeSet, HashMap};

use crate::stream::field::FieldBrick;

/// Number of a slot: below the capacity of the cache textures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SlotIndex(pub u32);

/// Assignment of bricks to slots.
#[derive(Debug)]
pub struct Slots {
    /// Key of each slot; `None` if it is free.
    keys: Vec<Option<FieldBrick>>,
    /// Pass in which each slot was last used or filled.
    stamps: Vec<u64>,
    /// Slot of each resident brick.
    places: HashMap<FieldBrick, SlotIndex>,
    /// Occupied slots by age: the first is evicted first.
    by_age: BTreeSet<(u64, SlotIndex)>,
    /// Free slots; the last one is taken next.
    free: Vec<SlotIndex>,
    /// Number of the coming pass; bricks inserted now carry it and stay.
    pass: u64,
}

impl Slots {
    /// `capacity` free slots.
    ///
    /// # Panics
    /// If there are more slots than 32 bits count.
    #[must_use]
    pub fn new(capacity: usize) -> Self {
        let count = u32::try_from(capacity).expect("the memory plan keeps slots below 2^32");
        Self {
            keys: vec![None; capacity],
            stamps: vec![0; capacity],
            places: HashMap::with_capacity(capacity),
            by_age: BTreeSet::new(),
            free: (0..count).rev().map(SlotIndex).collect(),
            pass: 1,
        }
    }

    /// Slots in all.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.keys.len()
    }

    /// Slots that hold a brick.
    #[must_use]
    pub fn occupied(&self) -> usize {
        self.places.len()
    }

    /// Number of the coming pass.
    #[must_use]
    pub fn coming_pass(&self) -> u64 {
        self.pass
    }

    /// Slots whose bricks were used or inserted since a pass.
    #[must_use]
    pub fn used_since(&self, pass: u64) -> usize {
        self.by_age.range((pass, SlotIndex(0))..).count()
    }

    /// Slot of a brick, if it is resident.
    #[must_use]
    pub fn place(&self, key: FieldBrick) -> Option<SlotIndex> {
        self.places.get(&key).copied()
    }

    /// The brick in a slot.
    #[must_use]
    pub fn key(&self, slot: SlotIndex) -> Option<FieldBrick> {
        self.keys[slot.0 as usize]
    }

    /// All bricks and their slots.
    pub fn iter(&self) -> impl Iterator<Item = (FieldBrick, SlotIndex)> + '_ {
        (0u32..).zip(&self.keys).filter_map(|(slot, key)| Some(((*key)?, SlotIndex(slot))))
    }

    /// Gives the brick a slot and returns the brick that was evicted for it. `None` if every slot holds a brick
    /// inserted since the last pass. A brick that is already resident keeps its slot.
    pub fn insert(&mut self, key: FieldBrick) -> Option<(SlotIndex, Option<FieldBrick>)> {
        if let Some(slot) = self.place(key) {
            self.touch(slot, self.pass);
            return Some((slot, None));
        }
        let (slot, evicted) = match self.free.pop() {
            Some(slot) => (slot, None),
            None => {
                let &(stamp, slot) = self.by_age.first()?;
                if stamp >= self.pass {
                    return None;
                }
                let old = self.keys[slot.0 as usize].expect("a slot that is not free holds a brick");
                self.remove(old);
                self.free.pop();
                (slot, Some(old))
            }
        };
        self.keys[slot.0 as usize] = Some(key);
        self.stamps[slot.0 as usize] = self.pass;
        self.places.insert(key, slot);
        self.by_age.insert((self.pass, slot));
        Some((slot, evicted))
    }

    /// Frees the brick's slot, if it has one.
    pub fn remove(&mut self, key: FieldBrick) -> Option<SlotIndex> {
        let slot = self.places.remove(&key)?;
        let i = slot.0 as usize;
        self.by_age.remove(&(self.stamps[i], slot));
        self.keys[i] = None;
        self.free.push(slot);
        Some(slot)
    }

    /// Closes a pass that sampled these slots: they become the youngest, and all of them may be evicted from now on.
    pub fn end_pass(&mut self, used: impl IntoIterator<Item = SlotIndex>) {
        let pass = self.pass;
        for slot in used {
            if self.keys[slot.0 as usize].is_some() {
                self.touch(slot, pass);
            }
        }
        self.pass += 1;
    }

    fn touch(&mut self, slot: SlotIndex, pass: u64) {
        let stamp = &mut self.stamps[slot.0 as usize];
        self.by_age.remove(&(*stamp, slot));
        *stamp = pass;
        self.by_age.insert((pass, slot));
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

    #[test]
    fn the_least_recently_used_brick_leaves_first() {
        let mut slots = Slots::new(2);
        let (a, _) = slots.insert(key(0)).unwrap();
        slots.insert(key(1)).unwrap();
        slots.end_pass([]);
        slots.end_pass([a]);
        assert_eq!(slots.insert(key(2)).unwrap().1, Some(key(1)));
        assert_eq!(slots.place(key(0)), Some(a));
        assert_eq!(slots.place(key(1)), None);
        assert_eq!(slots.occupied(), 2);
        assert_eq!([1, 2, 3, 4].map(|pass| slots.used_since(pass)), [2, 2, 1, 0], "{}", slots.coming_pass());
    }

    #[test]
    fn bricks_of_two_fields_at_one_place_take_two_slots_and_leave_one_by_one() {
        let mut slots = Slots::new(2);
        let [a, b, c] = [0, 1, 2].map(|field| key_of(Field(field), 3));
        let (slot_a, _) = slots.insert(a).unwrap();
        let (slot_b, _) = slots.insert(b).unwrap();
        assert!(slot_a != slot_b);
        assert_eq!((slots.place(a), slots.place(b), slots.occupied()), (Some(slot_a), Some(slot_b), 2));
        assert_eq!((slots.key(slot_a), slots.key(slot_b)), (Some(a), Some(b)));
        assert_eq!(slots.insert(c), None, "both slots are taken");
        slots.end_pass([]);
        slots.end_pass([slot_a]);
        assert_eq!(slots.insert(c), Some((slot_b, Some(b))), "the one that was not used leaves");
        assert_eq!([a, b, c].map(|key| slots.place(key)), [Some(slot_a), None, Some(slot_b)]);
        assert_eq!((slots.remove(b), slots.remove(c), slots.occupied()), (None, Some(slot_b), 1));
        assert_eq!(slots.iter().collect::<Vec<_>>(), [(a, slot_a)]);
    }

    #[test]
    fn bricks_inserted_since_the_last_pass_stay() {
        let mut slots = Slots::new(2);
        slots.insert(key(0)).unwrap();
        slots.insert(key(1)).unwrap();
        assert_eq!(slots.insert(key(2)), None);
        slots.end_pass([]);
        assert!(slots.insert(key(2)).unwrap().1.is_some());
    }

    #[test]
    fn a_removed_brick_frees_its_slot() {
        let mut slots = Slots::new(1);
        let (slot, _) = slots.insert(key(0)).unwrap();
        assert_eq!(slots.remove(key(0)), Some(slot));
        assert_eq!(slots.insert(key(1)), Some((slot, None)));
        assert_eq!(slots.key(slot), Some(key(1)));
    }
}
