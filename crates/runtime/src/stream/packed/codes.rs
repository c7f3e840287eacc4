//! Codes of equal width, eight at a time: eight codes of `bits` bits take `bits` bytes, so that every group begins with a
//! byte.
//!
//! Codes stand one behind the other, the first in the lowest bits (little endian). Codes of 8 and 16 bits are spread and
//! gathered within a 64-bit word: fields are halved into two halves of the word, then into quarters, then into eighths.

use supervol_format::cast::narrow;

/// Codes packed together.
pub(super) const GROUP: usize = 8;
/// Bytes that must follow the last code: a group is read as whole words.
pub(super) const PADDING: usize = 16;
/// Bytes of a 64-bit word.
const WORD: usize = size_of::<u64>();
/// Most bytes of a group, and of what is written behind it.
const GROUP_ROOM: usize = GROUP * size_of::<u32>() + PADDING;

/// An unsigned integer that is packed to fewer bits.
pub(super) trait Code: Copy + Default + Ord {
    /// Packs a group. `to` has [`GROUP_ROOM`] bytes; the first `bits` are the result.
    fn pack_group(codes: &[Self; GROUP], bits: u32, to: &mut [u8; GROUP_ROOM]);

    /// Unpacks groups that begin `bits` bytes apart. `bytes` reach [`PADDING`] bytes further.
    ///
    /// # Panics
    /// If there are too few bytes.
    fn unpack(bytes: &[u8], bits: u32, to: &mut [[Self; GROUP]]);
}

/// Packs codes, whole groups of them, behind `to`.
pub(super) fn pack<C: Code>(codes: &[[C; GROUP]], bits: u32, to: &mut Vec<u8>) {
    let mut room = [0; GROUP_ROOM];
    for group in codes {
        C::pack_group(group, bits, &mut room);
        to.extend_from_slice(&room[..bits as usize]);
    }
}

/// The word that begins with this byte.
#[inline(always)]
fn word_at(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + WORD].try_into().expect("a slice of a word's length"))
}

/// The lowest `bits` bits; at most 64.
#[inline(always)]
fn low_bits(bits: u32) -> u64 {
    u64::MAX.checked_shr(u64::BITS - bits).unwrap_or(0)
}

/// One step of spreading: in each of `2^level` parts of a word, the upper half of the fields moves to the upper half of
/// the part.
#[derive(Clone, Copy)]
struct Halving {
    low: u64,
    high: u64,
    shift: u32,
}

impl Halving {
    /// The step in parts of `part` bits that hold `fields` bits.
    fn new(part: u32, fields: u32) -> Self {
        let parts = (0..u64::BITS / part).fold(0, |parts, i| parts | 1 << (i * part));
        let half = low_bits(fields / 2);
        let low = half * parts;
        Self { low, high: low << (fields / 2), shift: (part - fields) / 2 }
    }

    #[inline(always)]
    fn spread(self, word: u64) -> u64 {
        (word & self.low) | (word & self.high) << self.shift
    }

    #[inline(always)]
    fn gather(self, word: u64) -> u64 {
        (word & self.low) | (word >> self.shift & self.high)
    }
}

/// Steps from a word of packed fields to lanes of 8 bits.
fn to_bytes(bits: u32) -> [Halving; 3] {
    [Halving::new(64, 8 * bits), Halving::new(32, 4 * bits), Halving::new(16, 2 * bits)]
}

/// Steps from a word of packed fields to lanes of 16 bits.
fn to_halves(bits: u32) -> [Halving; 2] {
    [Halving::new(64, 4 * bits), Halving::new(32, 2 * bits)]
}

impl Code for u8 {
    #[inline]
    fn pack_group(codes: &[Self; GROUP], bits: u32, to: &mut [u8; GROUP_ROOM]) {
        let [first, second, third] = to_bytes(bits);
        let word = first.gather(second.gather(third.gather(u64::from_le_bytes(*codes))));
        to[..WORD].copy_from_slice(&word.to_le_bytes());
    }

    #[inline]
    fn unpack(bytes: &[u8], bits: u32, to: &mut [[Self; GROUP]]) {
        let [first, second, third] = to_bytes(bits);
        for (number, group) in to.iter_mut().enumerate() {
            let word = word_at(bytes, number * bits as usize);
            *group = third.spread(second.spread(first.spread(word))).to_le_bytes();
        }
    }
}

impl Code for u16 {
    #[inline]
    fn pack_group(codes: &[Self; GROUP], bits: u32, to: &mut [u8; GROUP_ROOM]) {
        let [first, second] = to_halves(bits);
        let (mut word, mut parts) = (0u128, [0u64; 2]);
        for (part, codes) in parts.iter_mut().zip(codes.chunks_exact(GROUP / 2)) {
            *part = codes.iter().rev().fold(0, |word, &code| word << 16 | u64::from(code));
        }
        for part in parts.into_iter().rev() {
            word = word << (4 * bits) | u128::from(first.gather(second.gather(part)));
        }
        to[..2 * WORD].copy_from_slice(&word.to_le_bytes());
    }

    #[inline]
    fn unpack(bytes: &[u8], bits: u32, to: &mut [[Self; GROUP]]) {
        let [first, second] = to_halves(bits);
        // Four codes take half a group: it begins with a byte, or in the middle of one.
        let (half_bytes, half_bits) = (bits as usize / 2, 4 * (bits % 2));
        for (number, group) in to.iter_mut().enumerate() {
            let at = number * bits as usize;
            let words = [word_at(bytes, at), word_at(bytes, at + half_bytes) >> half_bits];
            for (half, word) in words.into_iter().enumerate() {
                let lanes = second.spread(first.spread(word)).to_le_bytes();
                for lane in 0..GROUP / 2 {
                    group[half * (GROUP / 2) + lane] = u16::from_le_bytes([lanes[2 * lane], lanes[2 * lane + 1]]);
                }
            }
        }
    }
}

impl Code for u32 {
    fn pack_group(codes: &[Self; GROUP], bits: u32, to: &mut [u8; GROUP_ROOM]) {
        let (mut waiting, mut count, mut at) = (0u64, 0, 0);
        for &code in codes {
            waiting |= u64::from(code) << count;
            count += bits;
            while count >= u8::BITS {
                to[at] = waiting.to_le_bytes()[0];
                (waiting, count, at) = (waiting >> u8::BITS, count - u8::BITS, at + 1);
            }
        }
    }

    #[inline]
    fn unpack(bytes: &[u8], bits: u32, to: &mut [[Self; GROUP]]) {
        let mask = low_bits(bits);
        let first_bits: [u32; GROUP] = std::array::from_fn(|lane| narrow::<u32>(lane) * bits);
        for (number, group) in to.iter_mut().enumerate() {
            let at = number * bits as usize;
            for (code, first) in group.iter_mut().zip(first_bits) {
                let word = word_at(bytes, at + (first / u8::BITS) as usize) >> (first % u8::BITS);
                *code = narrow::<u32>(word & mask);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::random::Random;

    use super::*;

    /// Codes one bit after the other, as the module's head defines them.
    fn by_bits(codes: &[u64], bits: u32) -> Vec<u8> {
        let mut bytes = vec![0; codes.len() * bits as usize / 8];
        for (i, code) in codes.iter().enumerate() {
            for bit in 0..bits as usize {
                let place = i * bits as usize + bit;
                bytes[place / 8] |= u8::from(code >> bit & 1 == 1) << (place % 8);
            }
        }
        bytes
    }

    fn check<C: Code + TryFrom<u64> + std::fmt::Debug>(most_bits: u32) {
        let mut random = Random::new(u64::from(most_bits));
        for bits in 0..=most_bits {
            for _ in 0..4 {
                let codes: Vec<u64> = (0..5 * GROUP).map(|_| random.next_u64() & low_bits(bits)).collect();
                let narrow = |&code: &u64| C::try_from(code).ok().expect("it has few bits");
                let groups: Vec<[C; GROUP]> =
                    codes.chunks(GROUP).map(|group| std::array::from_fn(|i| narrow(&group[i]))).collect();
                let mut bytes = Vec::new();
                pack(&groups, bits, &mut bytes);
                assert_eq!(bytes, by_bits(&codes, bits), "{bits} bits");
                // The bytes behind are not zero, and must not matter.
                bytes.extend([0xff; PADDING]);
                let mut unpacked = vec![[C::default(); GROUP]; groups.len()];
                C::unpack(&bytes, bits, &mut unpacked);
                assert_eq!(unpacked, groups, "{bits} bits");
            }
        }
    }

    #[test]
    fn codes_of_every_width_are_packed_bit_by_bit_and_come_back() {
        check::<u8>(8);
        check::<u16>(16);
        check::<u32>(32);
    }
}
