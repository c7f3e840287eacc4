//! Where decoded bricks are kept: [`host`] memory first; a graphics device copies from there.
//!
//! A cache holds what it is handed, within a number of bytes, and says what it dropped. It reads no file, ranks nothing
//! and knows no state of a brick: the streamer does.

pub mod host;

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

use supervol_format::BrickKey;

/// A map from brick keys. Rays look bricks up millions of times per frame; keys come from our own arithmetic and need no
/// protection against chosen collisions, so one multiplication replaces the standard hash.
pub type KeyMap<T> = HashMap<BrickKey, T, BuildHasherDefault<KeyHasher>>;

/// Hash of the 64 bits of a brick key: the two halves of a product with an odd constant, folded.
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

    fn write_u64(&mut self, bits: u64) {
        let product = u128::from(self.0 ^ bits ^ GOLDEN.rotate_left(32)) * u128::from(GOLDEN);
        self.0 = (product >> 64) as u64 ^ product as u64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use supervol_format::{BrickIndex, Lod};

    #[test]
    fn neighbouring_keys_spread_over_low_and_high_bits() {
        let mut low = [0u32; 128];
        let mut high = [0u32; 128];
        for i in 0..4096u32 {
            let key = BrickKey::new(Lod((i >> 9) as u8), BrickIndex([i & 7, i >> 3 & 7, i >> 6 & 7]));
            let mut hasher = KeyHasher::default();
            hasher.write_u64(key.bits());
            low[(hasher.finish() & 127) as usize] += 1;
            high[(hasher.finish() >> 57) as usize] += 1;
        }
        // 32 keys per bin on average; a Poisson count above 80 has a chance below 1e-11.
        assert!(low.iter().chain(&high).all(|&n| n < 80), "{low:?} {high:?}");
    }
}
