//! Cache of decoded bricks in [`host`] memory; a graphics device copies from there. Packed ones are read through a store of
//! [`unpacked`] ones.
//!
//! A cache holds the data it is given, within a number of bytes, and reports what it dropped. It reads no file, ranks
//! nothing and knows no brick state: the streamer does.

pub mod host;
pub mod unpacked;

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use crate::stream::field::FieldBrick;

/// Map keyed by bricks of fields. Rays look bricks up millions of times per frame. Keys come from our own arithmetic
/// and need no protection against chosen collisions, so one multiplication replaces the standard hash.
pub type KeyMap<T> = HashMap<FieldBrick, T, BuildHasherDefault<KeyHasher>>;

/// Hash of the one word that identifies a brick of a field: the two halves of a product with an odd constant, folded.
#[derive(Debug, Default, Clone, Copy)]
pub struct KeyHasher(u64);

/// 2^64 divided by the golden ratio, made odd: spreads neighbouring keys evenly (Knuth 1973, section 6.4).
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

impl Hasher for KeyHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        for chunk in bytes.chunks(8) {
            let mut word = [0; 8];
            word[..chunk.len()].copy_from_slice(chunk);
            self.write_u64(u64::from_le_bytes(word));
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "the product is cut into halves")]
    fn write_u64(&mut self, bits: u64) {
        let product = u128::from(self.0 ^ bits ^ GOLDEN.rotate_left(32)) * u128::from(GOLDEN);
        self.0 = (product >> 64) as u64 ^ product as u64;
    }
}

#[cfg(test)]
mod tests {
    use std::hash::BuildHasher;

    use supervol_format::{BrickIndex, BrickKey, Lod};

    use super::*;
    use crate::stream::field::Field;

    fn hash_of(key: FieldBrick) -> u64 {
        BuildHasherDefault::<KeyHasher>::default().hash_one(key)
    }

    /// Whether 4096 hashes fall evenly into 128 bins by their lowest bits, and by their highest.
    fn are_spread(hashes: impl Iterator<Item = u64>) -> bool {
        let mut bins = [[0u32; 128]; 2];
        for hash in hashes {
            bins[0][(hash & 127) as usize] += 1;
            bins[1][(hash >> 57) as usize] += 1;
        }
        assert_eq!(bins.map(|counts| counts.iter().sum::<u32>()), [4096; 2]);
        // 32 keys per bin on average; a Poisson count above 80 has a chance below 1e-11.
        bins.iter().flatten().all(|&n| n < 80)
    }

    #[test]
    fn neighbouring_keys_spread_over_low_and_high_bits() {
        let place = |i: u32| BrickIndex([i & 7, i >> 3 & 7, i >> 6 & 7]);
        let keys = (0..4096u32).map(|i| BrickKey::new(Lod((i >> 9) as u8), place(i)));
        assert!(are_spread(keys.map(|key| hash_of(Field::FIRST.brick(key)))));
    }

    #[test]
    fn bricks_of_many_fields_at_few_places_spread_as_well() {
        let key = |i: u32| BrickKey::new(Lod(0), BrickIndex([i & 3, i >> 2 & 3, i >> 4 & 3]));
        assert!(are_spread((0..4096u32).map(|i| hash_of(Field((i >> 6) as u16).brick(key(i))))));
        assert!(are_spread((0..4096).map(|field| hash_of(Field(field).brick(key(0))))));
    }
}
