//! Map that can drop the least recently used value first.
//!
//! The owner limits the number or the bytes of the values. The streamer's brick cache does not use this map. All its
//! bricks of one pass are equally recent, and priorities matter more than the time of use.

use std::borrow::Borrow;
use std::collections::{BTreeMap, HashMap};
use std::hash::Hash;

/// Values by key, and keys by the time of their last use. Finding the oldest takes logarithmic time.
#[derive(Debug)]
pub struct Recent<K, V> {
    kept: HashMap<K, (u64, V)>,
    by_use: BTreeMap<u64, K>,
    clock: u64,
}

impl<K, V> Default for Recent<K, V> {
    fn default() -> Self {
        Self { kept: HashMap::new(), by_use: BTreeMap::new(), clock: 0 }
    }
}

impl<K: Clone + Eq + Hash, V> Recent<K, V> {
    /// The value of this key; counts as a use.
    pub fn get<Q: Eq + Hash + ?Sized>(&mut self, key: &Q) -> Option<&V>
    where
        K: Borrow<Q>,
    {
        let (used, value) = self.kept.get_mut(key)?;
        // A value that is asked for repeatedly, such as a TOC page, keeps its time.
        if *used != self.clock {
            let key = self.by_use.remove(used)?;
            self.clock += 1;
            self.by_use.insert(self.clock, key);
            *used = self.clock;
        }
        Some(value)
    }

    /// Whether a value has this key; does not count as a use.
    pub fn contains<Q: Eq + Hash + ?Sized>(&self, key: &Q) -> bool
    where
        K: Borrow<Q>,
    {
        self.kept.contains_key(key)
    }

    /// Inserts a value, used now. Returns the old value of the key.
    pub fn insert(&mut self, key: K, value: V) -> Option<V> {
        self.clock += 1;
        self.by_use.insert(self.clock, key.clone());
        let (used, before) = self.kept.insert(key, (self.clock, value))?;
        self.by_use.remove(&used);
        Some(before)
    }

    /// Inserts a value, then drops the oldest ones until at most `most` (at least one) are left.
    pub fn insert_within(&mut self, most: usize, key: K, value: V) {
        self.insert(key, value);
        while self.len() > most.max(1) {
            self.remove_oldest();
        }
    }

    /// Removes and returns the least recently used value.
    pub fn remove_oldest(&mut self) -> Option<(K, V)> {
        let (_, key) = self.by_use.pop_first()?;
        let (_, value) = self.kept.remove(&key)?;
        Some((key, value))
    }

    /// Number of values.
    #[must_use]
    pub fn len(&self) -> usize {
        self.kept.len()
    }

    /// Whether the map is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn what_was_used_longest_ago_leaves_first() {
        let mut recent = Recent::default();
        for number in 0..3 {
            recent.insert_within(3, number, number * 10);
        }
        assert_eq!(recent.get(&0), Some(&0));
        recent.insert_within(3, 3, 30);
        assert_eq!((recent.contains(&0), recent.contains(&1), recent.len()), (true, false, 3));
        assert_eq!(recent.insert(2, 21), Some(20));
        let order: Vec<_> = std::iter::from_fn(|| recent.remove_oldest()).collect();
        assert_eq!(order, [(0, 0), (3, 30), (2, 21)]);
        assert!(recent.is_empty() && recent.get(&0).is_none());
    }

    /// Compares the map with a list that is searched linearly.
    #[test]
    fn it_does_what_a_plain_list_does() {
        let mut random = Random::new(5);
        let (mut recent, mut list) = (Recent::default(), Vec::new());
        for value in 0..2_000u64 {
            let key = random.below(12);
            let place = list.iter().position(|&(k, _)| k == key);
            if random.below(2) == 0 {
                assert_eq!(recent.get(&key).copied(), place.map(|at| list[at].1));
                list.extend(place.map(|at| list[at]));
            } else {
                recent.insert_within(7, key, value);
                list.push((key, value));
            }
            if let Some(at) = place {
                list.remove(at);
            }
            list.drain(..list.len().saturating_sub(7));
            assert_eq!(recent.len(), list.len());
        }
        assert_eq!(std::iter::from_fn(|| recent.remove_oldest()).collect::<Vec<_>>(), list);
    }
}
