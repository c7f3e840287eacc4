//! Coefficients as tokens of one byte, which Zstandard's Huffman coder is good at, and bits beside them, which nothing is.
//!
//! A token stands for a run of zeros, or for one coefficient other than zero, whose sign is its lowest bit (zigzag). Both
//! begin a number u: the run's length less one; the zigzag number less one. Small numbers are tokens of their own; of a
//! greater one the token holds the position of the highest bit and the next `M` bits, and the rest follows, lowest bit
//! first, in the stream of bits. So runs make up for a Huffman code's least cost of one bit a symbol, and no token's table
//! grows with the range of the values.
//!
//! | token | stands for | M |
//! |---|---|---|
//! | 0 to 3 | 1 to 4 zeros | |
//! | 4 to 63 | a longer run | 1 |
//! | 64 to 127 | zigzag numbers 1 to 64 | |
//! | 128 to 231 | greater ones | 2 |
//! | 232 to 255 | nothing: refused | |

/// Tokens of one kind of number.
#[derive(Clone, Copy)]
struct Numbers {
    first: u8,
    /// Numbers below `2^direct_bits` are tokens of their own.
    direct_bits: u32,
    /// M.
    kept_bits: u32,
}

const RUNS: Numbers = Numbers { first: 0, direct_bits: 2, kept_bits: 1 };
const VALUES: Numbers = Numbers { first: 64, direct_bits: 6, kept_bits: 2 };
/// One past the last token.
const END: u8 = VALUES.token_of(u32::MAX).0 + 1;

impl Numbers {
    /// The token of a number, how many bits follow, and those.
    const fn token_of(self, u: u32) -> (u8, u32, u32) {
        if u < 1 << self.direct_bits {
            return (self.first + u as u8, 0, 0);
        }
        let exponent = 31 - u.leading_zeros();
        let rest = exponent - self.kept_bits;
        let kept = (u >> rest) & ((1 << self.kept_bits) - 1);
        let place = (1 << self.direct_bits) + ((exponent - self.direct_bits) << self.kept_bits) + kept;
        (self.first + place as u8, rest, u & ((1 << rest) - 1))
    }

    /// The least number of the token at a place behind the first one, and how many bits follow.
    const fn least_of(self, place: u32) -> (u32, u32) {
        let beyond = place.wrapping_sub(1 << self.direct_bits);
        if place < 1 << self.direct_bits {
            return (place, 0);
        }
        let exponent = self.direct_bits + (beyond >> self.kept_bits);
        let rest = exponent - self.kept_bits;
        (((1 << self.kept_bits) | (beyond & ((1 << self.kept_bits) - 1))) << rest, rest)
    }
}

/// What a token means.
#[derive(Clone, Copy)]
struct Meaning {
    /// Least u.
    least: u32,
    /// Bits that follow.
    bits: u8,
    /// All ones for a coefficient, 0 for a run.
    is_value: u32,
}

/// Meanings by token; those that mean nothing are runs longer than any brick.
const MEANINGS: [Meaning; 256] = {
    let mut all = [Meaning { least: u32::MAX >> 1, bits: 0, is_value: 0 }; 256];
    let mut token = 0;
    while token < END as usize {
        let is_value = token >= VALUES.first as usize;
        let numbers = if is_value { VALUES } else { RUNS };
        let (least, bits) = numbers.least_of(token as u32 - numbers.first as u32);
        all[token] = Meaning { least, bits: bits as u8, is_value: if is_value { u32::MAX } else { 0 } };
        token += 1;
    }
    all
};

/// What a token without bits does: the coefficient it writes, and how many it moves on.
#[derive(Clone, Copy)]
struct Direct {
    coefficient: i32,
    /// 1 to [`LONGEST_DIRECT_RUN`]; more in tokens that have bits.
    count: u32,
}

const LONGEST_DIRECT_RUN: usize = 1 << RUNS.direct_bits;
/// What stands in the table for tokens that have bits, or mean nothing.
const NOT_DIRECT: Direct = Direct { coefficient: 0, count: 1 << 8 };

const DIRECT: [Direct; 256] = {
    let mut all = [NOT_DIRECT; 256];
    let mut token = 0;
    while token < END as usize {
        let Meaning { least, bits, is_value } = MEANINGS[token];
        if bits == 0 {
            let coefficient = if is_value == 0 { 0 } else { unzigzag(least + 1) };
            all[token] = Direct { coefficient, count: if is_value == 0 { least + 1 } else { 1 } };
        }
        token += 1;
    }
    all
};

/// Tokens that are looked at together: where none of them has bits, they are decoded without looking for any.
const GROUP: usize = 8;

/// Tokens and bits of some coefficients.
#[derive(Debug, Default)]
pub struct Tokens {
    pub tokens: Vec<u8>,
    pub bits: Vec<u8>,
}

impl Tokens {
    pub fn of(coefficients: &[i32]) -> Self {
        let mut out = Self { tokens: Vec::with_capacity(coefficients.len()), bits: Vec::new() };
        let mut writer = BitWriter::default();
        let mut zeros = 0u32;
        for &coefficient in coefficients {
            if coefficient == 0 {
                zeros += 1;
                continue;
            }
            if zeros > 0 {
                out.push(RUNS, zeros - 1, &mut writer);
                zeros = 0;
            }
            out.push(VALUES, zigzag(coefficient) - 1, &mut writer);
        }
        if zeros > 0 {
            out.push(RUNS, zeros - 1, &mut writer);
        }
        writer.finish(&mut out.bits);
        out
    }

    #[inline]
    fn push(&mut self, numbers: Numbers, u: u32, writer: &mut BitWriter) {
        let (token, count, bits) = numbers.token_of(u);
        self.tokens.push(token);
        writer.push(bits, count, &mut self.bits);
    }
}

fn zigzag(v: i32) -> u32 {
    ((v << 1) ^ (v >> 31)) as u32
}

const fn unzigzag(z: u32) -> i32 {
    (z >> 1) as i32 ^ -((z & 1) as i32)
}

/// Bits on their way to bytes, lowest first.
#[derive(Default)]
struct BitWriter {
    word: u64,
    filled: u32,
}

impl BitWriter {
    #[inline]
    fn push(&mut self, bits: u32, count: u32, out: &mut Vec<u8>) {
        self.word |= u64::from(bits) << self.filled;
        self.filled += count;
        if self.filled >= 32 {
            out.extend_from_slice(&(self.word as u32).to_le_bytes());
            self.word >>= 32;
            self.filled -= 32;
        }
    }

    fn finish(self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.word.to_le_bytes()[..self.filled.div_ceil(8) as usize]);
    }
}

/// Bytes that a reader of bits may look at beyond the last bit.
pub const BITS_PADDING: usize = 8;

/// Undoes [`Tokens::of`]. `bits` is followed by [`BITS_PADDING`] more bytes. Coefficients that no token names are left as
/// they are: `out` must hold zeros. False where tokens and bits are not those of exactly so many coefficients.
#[must_use]
pub fn decode(tokens: &[u8], bits: &[u8], out: &mut [i32]) -> bool {
    let Some(bits_bytes) = bits.len().checked_sub(BITS_PADDING) else { return false };
    let (mut place, mut bit) = (0usize, 0usize);
    let (groups, rest) = tokens.as_chunks::<GROUP>();
    for group in groups {
        match out.get_mut(place..place + GROUP * LONGEST_DIRECT_RUN).and_then(|room| decode_direct(group, room)) {
            Some(count) => place += count,
            None if decode_each(group, bits, &mut bit, out, &mut place) => {}
            None => return false,
        }
    }
    // A run beyond the end is noticed here; less than a byte of padding may be left of the bits.
    decode_each(rest, bits, &mut bit, out, &mut place) && place == out.len() && bit.div_ceil(8) == bits_bytes
}

/// Decodes tokens if none of them has bits: the number of coefficients.
#[inline]
fn decode_direct(group: &[u8; GROUP], room: &mut [i32]) -> Option<usize> {
    let direct = group.map(|token| DIRECT[usize::from(token)]);
    if direct.iter().any(|d| d.count == NOT_DIRECT.count) {
        return None;
    }
    let mut place = 0;
    for Direct { coefficient, count } in direct {
        // Below the room's length, since no token moves on by more than the longest direct run.
        *room.get_mut(place)? = coefficient;
        place += count as usize;
    }
    Some(place)
}

/// Decodes tokens one by one; false where they do not fit.
#[inline]
fn decode_each(tokens: &[u8], bits: &[u8], bit: &mut usize, out: &mut [i32], place: &mut usize) -> bool {
    for &token in tokens {
        let Meaning { least, bits: count, is_value } = MEANINGS[usize::from(token)];
        let Some(word) = bits.get(*bit / 8..).and_then(<[u8]>::first_chunk::<8>) else { return false };
        let rest = (u64::from_le_bytes(*word) >> (*bit % 8)) as u32 & ((1 << count) - 1);
        *bit += usize::from(count);
        let u = least + rest;
        let Some(target) = out.get_mut(*place) else { return false };
        // Zero for a run, which begins with one.
        *target = unzigzag(u.wrapping_add(1) & is_value);
        *place += 1 + (u & !is_value) as usize;
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn round_trip(coefficients: &[i32]) -> Tokens {
        let mut coded = Tokens::of(coefficients);
        coded.bits.extend([0; BITS_PADDING]);
        let mut out = vec![0; coefficients.len()];
        assert!(decode(&coded.tokens, &coded.bits, &mut out), "{} coefficients", coefficients.len());
        assert!(out == coefficients);
        coded
    }

    #[test]
    fn every_number_s_token_holds_it() {
        for numbers in [RUNS, VALUES] {
            for u in (0..5000).chain((12..32).flat_map(|e| [(1 << e) - 1, 1 << e, (1 << e) + 1])).chain([u32::MAX]) {
                let (token, count, bits) = numbers.token_of(u);
                let (least, counted) = numbers.least_of(u32::from(token - numbers.first));
                assert_eq!((least + bits, counted), (u, count), "{u}");
            }
        }
        assert_eq!((RUNS.token_of(u32::MAX).0, VALUES.token_of(63).0, VALUES.token_of(64).0, END), (63, 127, 128, 232));
    }

    #[test]
    fn runs_and_extremes_survive() {
        round_trip(&[]);
        round_trip(&[i32::MIN, i32::MAX, 0, -1, 1, 0, 0, 0, 0, 0, 7]);
        let coded = round_trip(&vec![0; 132 * 132 * 132]);
        assert_eq!(coded.tokens.len(), 1);
        for run in (0..20).flat_map(|e| [(1 << e) - 1, 1 << e, (1 << e) + 1]) {
            let mut coefficients = vec![0; run];
            coefficients.push(-5);
            round_trip(&coefficients);
        }
    }

    #[test]
    fn what_is_too_long_or_too_short_is_refused() {
        let mut coded = round_trip(&[1, 0, 0, 0, 0, 0, 0, 900, -3]);
        let decodes = |tokens: &[u8], bits: &[u8], n: usize| decode(tokens, bits, &mut vec![0; n]);
        for n in [0, 1, 8, 10, 1000] {
            assert!(!decodes(&coded.tokens, &coded.bits, n), "{n} coefficients");
        }
        assert!(!decodes(&coded.tokens[1..], &coded.bits, 9) && !decodes(&coded.tokens, &coded.bits[1..], 9));
        assert!(!decodes(&coded.tokens, &[], 9) && !decodes(&[END], &[0; 8], 1 << 20));
        coded.bits.push(0);
        assert!(!decodes(&coded.tokens, &coded.bits, 9), "a byte of bits is left over");
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn any_coefficients_survive(values in proptest::collection::vec((any::<i32>(), 0u32..32, 0usize..40), 0..200)) {
            let coefficients: Vec<i32> = values
                .into_iter()
                .flat_map(|(value, shift, zeros)| std::iter::repeat_n(0, zeros).chain([value >> shift]))
                .collect();
            round_trip(&coefficients);
        }

        #[test]
        fn any_tokens_are_answered(tokens in proptest::collection::vec(any::<u8>(), 0..300), bits in proptest::collection::vec(any::<u8>(), 0..300), n in 0usize..500) {
            let _ = decode(&tokens, &bits, &mut vec![0; n]);
        }
    }
}
