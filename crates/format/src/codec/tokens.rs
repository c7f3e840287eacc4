//! Coefficients as tokens of one byte, for Zstandard's Huffman coder, and extra bits, which are stored uncompressed.
//!
//! A token stands for a run of zeros, or for one non-zero coefficient, whose sign is its lowest bit (zigzag). Both
//! encode a number u: the length of the run minus one, or the zigzag number minus one. Small numbers have a token of
//! their own. For a greater number the token holds the position of the highest bit and the next `M` bits. The remaining
//! bits go to the stream of extra bits, lowest bit first. Runs compensate the minimum of one bit per symbol of a
//! Huffman code. The token table does not grow with the range of the values.
//!
//! | token | stands for | M |
//! |---|---|---|
//! | 0 to 3 | run of 1 to 4 zeros | |
//! | 4 to 63 | a longer run | 1 |
//! | 64 to 127 | zigzag numbers 1 to 64 | |
//! | 128 to 231 | greater zigzag numbers | 2 |
//! | 232 to 255 | invalid, refused | |

use super::sample::Sample;
use crate::vectors::Vectorized;

/// Tokens of one kind of number: runs or values.
#[derive(Clone, Copy)]
struct Numbers {
    first: u8,
    /// Numbers below `2^direct_bits` have a token of their own.
    direct_bits: u32,
    /// M: bits below the highest one that the token holds.
    kept_bits: u32,
}

const RUNS: Numbers = Numbers { first: 0, direct_bits: 2, kept_bits: 1 };
const VALUES: Numbers = Numbers { first: 64, direct_bits: 6, kept_bits: 2 };
/// One past the last valid token.
const END: u8 = VALUES.token_of(u32::MAX).0 + 1;

impl Numbers {
    /// The token of a number, the number of extra bits, and the extra bits.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "every place is at most 255, see the table of tokens")]
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

    /// The least number of the token at this place behind the first one, and the number of extra bits.
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

/// Meaning of a token, in one word, so that the decoder needs a single table look-up.
#[derive(Clone, Copy)]
#[repr(C, align(8))]
struct Meaning {
    /// Number of extra bits.
    bits: u8,
    /// Whether the token is a run.
    is_run: bool,
    /// Least u, plus one.
    least: u32,
}

/// Meanings by token. Invalid tokens are runs longer than any brick, so the decoder refuses them.
#[expect(clippy::cast_possible_truncation, reason = "a token has at most 31 extra bits")]
const MEANINGS: [Meaning; 256] = {
    let mut all = [Meaning { bits: 0, is_run: true, least: u32::MAX >> 1 }; 256];
    let mut token = 0;
    while token < END {
        let is_run = token < VALUES.first;
        let numbers = if is_run { RUNS } else { VALUES };
        let (least, bits) = numbers.least_of((token - numbers.first) as u32);
        all[token as usize] = Meaning { bits: bits as u8, is_run, least: least.wrapping_add(1) };
        token += 1;
    }
    all
};

/// Number of tokens that are examined together. If each stands for one coefficient without extra bits, they are decoded
/// together.
const GROUP: usize = 16;
/// Number of tokens that are decoded together in the general case.
const HALF: usize = GROUP / 2;
/// Longest run of a token without extra bits.
const LONGEST_DIRECT_RUN: usize = 1 << RUNS.direct_bits;

/// Tokens and extra bits of some coefficients.
#[derive(Debug, PartialEq)]
pub struct Tokens {
    pub tokens: Vec<u8>,
    pub bits: Vec<u8>,
}

/// Largest number of groups that are encoded one by one before the fast path is tried again.
const MOST_PASSED_OVER: u32 = 31;
/// The same for decoding.
const MOST_PASSED_OVER_DECODING: u32 = 7;

/// Task that makes [`Tokens`] from coefficients.
pub struct Encoding<'a, S> {
    pub coefficients: &'a [S],
}

impl<S: Sample> Vectorized for Encoding<'_, S> {
    type Output = Tokens;

    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "a group has 16 coefficients")]
    fn run(self) -> Tokens {
        let mut writer =
            Writer { tokens: vec![0; self.coefficients.len()], end: 0, zeros: 0, bits: BitWriter::default() };
        let (groups, rest) = self.coefficients.as_chunks::<GROUP>();
        // Groups for which the fast path is not tried: twice as many after each failure.
        let (mut passed_over, mut left) = (0, 0);
        for group in groups {
            if *group == [S::default(); GROUP] {
                writer.zeros += GROUP as u32;
            } else if left > 0 {
                left -= 1;
                writer.push_each(group);
            } else if writer.push_direct(group) {
                passed_over = 0;
            } else {
                passed_over = (2 * passed_over + 1).min(MOST_PASSED_OVER);
                left = passed_over;
                writer.push_each(group);
            }
        }
        writer.push_each(rest);
        writer.push_zeros();
        writer.tokens.truncate(writer.end);
        Tokens { tokens: writer.tokens, bits: writer.bits.finish() }
    }
}

/// State of the encoder.
struct Writer {
    /// Tokens; those before `end` are valid.
    tokens: Vec<u8>,
    end: usize,
    /// Zeros that have no token yet.
    zeros: u32,
    bits: BitWriter,
}

impl Writer {
    /// Fast path: encodes coefficients if each of them, and each run of zeros, has a token without extra bits; else
    /// does nothing and returns false.
    #[inline(always)]
    #[expect(
        clippy::cast_possible_truncation,
        reason = "numbers that get a direct token are at most 64, and a mask has 16 bits"
    )]
    fn push_direct<S: Sample>(&mut self, group: &[S; GROUP]) -> bool {
        let numbers = group.map(S::zigzagged);
        let mut others = 0u8;
        for number in numbers {
            others |= u8::from(number > 1 << VALUES.direct_bits);
        }
        // Masks of the zeros, and of zeros that begin a run too long for a token without extra bits.
        let are_zeros = numbers.map(|number| number == 0);
        let zeros = mask_of(are_zeros);
        let long_runs = (1..=LONGEST_DIRECT_RUN).fold(zeros, |runs, step| runs & (zeros >> step));
        if others != 0 || long_runs != 0 {
            return false;
        }
        // Zeros at the beginning continue the previous run, if there is one.
        let before = if self.zeros > 0 { zeros.trailing_ones() } else { 0 };
        self.zeros += before;
        self.push_zeros();
        let values = numbers.map(|number| (VALUES.first - 1).wrapping_add(number as u8));
        if zeros & (zeros >> 1) == 0 && before == 0 {
            self.push_singles(are_zeros, values);
        } else {
            self.push_runs(values, before as u8);
        }
        true
    }

    /// Encodes coefficients without two adjacent zeros, from the tokens of the non-zero ones. Written for vectors.
    #[inline(always)]
    fn push_singles(&mut self, zeros: [bool; GROUP], values: [u8; GROUP]) {
        let tokens = std::array::from_fn(|i| if zeros[i] { RUNS.first } else { values[i] });
        // No token stands for less than one coefficient, so there is room for a token per remaining coefficient.
        *self.room() = tokens;
        self.zeros = u32::from(zeros[GROUP - 1]);
        self.end += GROUP - self.zeros as usize;
    }

    /// Encodes coefficients with short runs of zeros, from the tokens of the non-zero ones. Branches on zeros would be
    /// mispredicted. Each step therefore writes the token of a run and that of a coefficient, and advances only past
    /// those it needs. The first `done` zeros already have a token.
    #[inline(always)]
    fn push_runs(&mut self, values: [u8; GROUP], done: u8) {
        let (mut end, mut zeros) = (0, 0u8.wrapping_sub(done));
        let room = self.room();
        for value in values {
            let is_zero = value == VALUES.first - 1;
            // There are never more tokens than coefficients before this one.
            room[end % GROUP] = RUNS.first.wrapping_add(zeros).wrapping_sub(1);
            end += usize::from(!is_zero & (zeros > 0));
            room[end % GROUP] = value;
            end += usize::from(!is_zero);
            zeros = if is_zero { zeros.wrapping_add(1) } else { 0 };
        }
        self.zeros = u32::from(zeros);
        self.end += end;
    }

    /// Buffer for the next tokens.
    #[inline(always)]
    fn room(&mut self) -> &mut [u8; GROUP] {
        self.tokens[self.end..].first_chunk_mut().expect("no token stands for less than one coefficient")
    }

    /// Encodes coefficients one by one.
    #[inline(always)]
    fn push_each<S: Sample>(&mut self, coefficients: &[S]) {
        for &coefficient in coefficients {
            if coefficient == S::default() {
                self.zeros += 1;
                continue;
            }
            self.push_zeros();
            self.push(VALUES, coefficient.zigzagged() - 1);
        }
    }

    /// Encodes the zeros that have no token yet.
    #[inline(always)]
    fn push_zeros(&mut self) {
        if self.zeros > 0 {
            self.push(RUNS, self.zeros - 1);
            self.zeros = 0;
        }
    }

    #[inline(always)]
    fn push(&mut self, numbers: Numbers, u: u32) {
        let (token, count, bits) = numbers.token_of(u);
        self.tokens[self.end] = token;
        self.end += 1;
        self.bits.push(bits, count);
    }
}

/// One bit per flag, the first flag lowest.
#[inline(always)]
fn mask_of(are: [bool; GROUP]) -> u16 {
    // Multiplied by this, eight bytes of 0 or 1 leave one bit each in the highest byte, without carries.
    const GATHER: u64 = 0x0102_0408_1020_4080;
    let bytes = are.map(u8::from);
    let bits = |half: &[u8; HALF]| (u64::from_le_bytes(*half).wrapping_mul(GATHER) >> 56) as u16;
    let (halves, _) = bytes.as_chunks::<HALF>();
    bits(&halves[0]) | bits(&halves[1]) << HALF
}

/// Bits that become bytes, lowest first.
#[derive(Default)]
struct BitWriter {
    word: u64,
    filled: u32,
    out: Vec<u8>,
}

impl BitWriter {
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "the low 32 bits are wanted; the others stay in the word")]
    fn push(&mut self, bits: u32, count: u32) {
        self.word |= u64::from(bits) << self.filled;
        self.filled += count;
        if self.filled >= 32 {
            self.out.extend_from_slice(&(self.word as u32).to_le_bytes());
            self.word >>= 32;
            self.filled -= 32;
        }
    }

    fn finish(mut self) -> Vec<u8> {
        self.out.extend_from_slice(&self.word.to_le_bytes()[..self.filled.div_ceil(8) as usize]);
        self.out
    }
}

/// Bytes beyond the last bit that the decoder may read.
pub const BITS_PADDING: usize = 8;
/// Least number of valid bits in a 64-bit word that is read at any bit position.
const BITS_AT_ONCE: u32 = u64::BITS - 7;

/// Task that reverses [`Encoding`]. Returns false if tokens and bits are not those of exactly `out.len()` coefficients.
pub struct Decoding<'a, S> {
    pub tokens: &'a [u8],
    /// Extra bits, followed by [`BITS_PADDING`] more bytes.
    pub bits: &'a [u8],
    /// Zeros before decoding, the coefficients afterwards.
    pub out: &'a mut [S],
}

impl<S: Sample> Vectorized for Decoding<'_, S> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let Self { tokens, bits, out } = self;
        let Some(bits_bytes) = bits.len().checked_sub(BITS_PADDING) else { return false };
        let mut reader = Reader { bits, bit: 0, out, place: 0 };
        let (groups, rest) = tokens.as_chunks::<GROUP>();
        // Groups for which the fast path is not tried: twice as many after each failure.
        let (mut passed_over, mut left) = (0, 0);
        for group in groups {
            if left > 0 {
                left -= 1;
            } else if reader.take_singles(group) || reader.take_direct(group) {
                passed_over = 0;
                continue;
            } else {
                passed_over = (2 * passed_over + 1).min(MOST_PASSED_OVER_DECODING);
                left = passed_over;
            }
            for half in group.as_chunks::<HALF>().0 {
                if !reader.take_half(half) {
                    return false;
                }
            }
        }
        // A run beyond the end is noticed here. Up to 7 bits of padding may be left over.
        let is_whole =
            reader.take_each(rest) && reader.place == reader.out.len() && reader.bit.div_ceil(8) == bits_bytes;
        for number in reader.out {
            *number = number.unzigzagged();
        }
        is_whole
    }
}

/// Whether all tokens satisfy `are`. The loop examines all of them, so that the compiler vectorizes it.
#[inline(always)]
fn are_all<const COUNT: usize>(tokens: &[u8; COUNT], are: impl Fn(u8) -> bool) -> bool {
    let mut others = 0;
    for &token in tokens {
        others |= u8::from(!are(token));
    }
    others == 0
}

/// Total number of extra bits of the tokens.
#[inline(always)]
fn bits_of(meanings: &[Meaning; HALF]) -> u32 {
    let mut count = 0;
    for meaning in meanings {
        count += u32::from(meaning.bits);
    }
    count
}

/// State of the decoder.
struct Reader<'a, S> {
    bits: &'a [u8],
    /// Position of the next extra bit.
    bit: usize,
    out: &'a mut [S],
    /// Position of the next coefficient.
    place: usize,
}

impl<S: Sample> Reader<'_, S> {
    /// Fast path: decodes tokens if each stands for one coefficient without extra bits; else does nothing and returns
    /// false. Written for vectors of bytes.
    #[inline(always)]
    fn take_singles(&mut self, group: &[u8; GROUP]) -> bool {
        if !are_all(group, |token| (token == RUNS.first) | (token.wrapping_sub(VALUES.first) < 1 << VALUES.direct_bits))
        {
            return false;
        }
        let Some(room) = self.room::<GROUP>() else { return false };
        // A run of one zero becomes the zigzag number 0.
        let numbers = group.map(|token| token.saturating_sub(VALUES.first - 1));
        *room = numbers.map(|number| S::wrap(i32::from(number)));
        self.place += GROUP;
        true
    }

    /// Fast path: decodes tokens if none of them has extra bits; else does nothing and returns false. The position of
    /// each coefficient follows from the lengths of the previous tokens, which are summed independently.
    #[inline(always)]
    fn take_direct(&mut self, group: &[u8; GROUP]) -> bool {
        const MOST: usize = GROUP * LONGEST_DIRECT_RUN;
        if !are_all(group, |token| {
            (token < 1 << RUNS.direct_bits) | (token.wrapping_sub(VALUES.first) < 1 << VALUES.direct_bits)
        }) {
            return false;
        }
        let Some(room) = self.room::<MOST>() else { return false };
        let numbers = group.map(|token| token.saturating_sub(VALUES.first - 1));
        let lengths = group.map(|token| if token < VALUES.first { token + 1 } else { 1 });
        let mut at = 0;
        for (number, length) in numbers.into_iter().zip(lengths) {
            room[at % MOST] = S::wrap(i32::from(number));
            at += usize::from(length);
        }
        self.place += at;
        true
    }

    /// Decodes tokens whose extra bits fit one word, otherwise one by one; false if the coefficients do not fit.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "the low 32 bits are wanted: no token has more extra bits")]
    fn take_half(&mut self, tokens: &[u8; HALF]) -> bool {
        let meanings = tokens.map(|token| MEANINGS[usize::from(token)]);
        let count = bits_of(&meanings);
        if count > BITS_AT_ONCE {
            return self.take_each(tokens);
        }
        let Some(mut word) = self.word() else { return false };
        self.bit += count as usize;
        for meaning in meanings {
            if !self.take(meaning, word as u32) {
                return false;
            }
            word >>= meaning.bits;
        }
        true
    }

    /// Decodes tokens one by one; false if the coefficients do not fit.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "the low 32 bits are wanted: no token has more extra bits")]
    fn take_each(&mut self, tokens: &[u8]) -> bool {
        for &token in tokens {
            let meaning = MEANINGS[usize::from(token)];
            let Some(word) = self.word() else { return false };
            self.bit += usize::from(meaning.bits);
            if !self.take(meaning, word as u32) {
                return false;
            }
        }
        true
    }

    /// Buffer for the next coefficients, or `None` if fewer are left.
    #[inline(always)]
    fn room<const COUNT: usize>(&mut self) -> Option<&mut [S; COUNT]> {
        self.out.get_mut(self.place..)?.first_chunk_mut()
    }

    /// The next extra bits: at least [`BITS_AT_ONCE`], or all that are left.
    #[inline(always)]
    fn word(&self) -> Option<u64> {
        let bytes = self.bits.get(self.bit / 8..).and_then(<[u8]>::first_chunk::<8>)?;
        Some(u64::from_le_bytes(*bytes) >> (self.bit % 8))
    }

    /// Decodes one token, whose extra bits are the lowest of `bits`; false if the coefficients do not fit.
    #[inline(always)]
    fn take(&mut self, Meaning { bits: count, is_run, least }: Meaning, bits: u32) -> bool {
        let number = least.wrapping_add(bits & ((1 << count) - 1));
        let Some(target) = self.out.get_mut(self.place) else { return false };
        *target = S::wrap(if is_run { 0 } else { number as i32 });
        self.place += if is_run { number as usize } else { 1 };
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::vectors::vectorized;
    use proptest::prelude::*;

    /// Decodes with the processor's vector instructions and with the baseline ones, and compares.
    fn decode(tokens: &[u8], bits: &[u8], out: &mut [i32]) -> bool {
        let mut plain = out.to_vec();
        let is_plainly_whole = Decoding { tokens, bits, out: &mut plain }.run();
        let is_whole = vectorized(Decoding { tokens, bits, out });
        assert!(is_whole == is_plainly_whole && *out == plain);
        is_whole
    }

    fn round_trip(coefficients: &[i32]) -> Tokens {
        let mut coded = vectorized(Encoding { coefficients });
        assert_eq!(coded, Encoding { coefficients }.run());
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
    fn short_runs_of_small_numbers_survive_wherever_they_end() {
        let mut random = Random::new(16);
        // `zeros` of eight coefficients are zero; a few have tokens with extra bits.
        for zeros in 0..8 {
            for length in (0..200).chain([1000, 5000]) {
                let coefficients: Vec<i32> = (0..length)
                    .map(|_| match random.below(8) {
                        n if n < zeros => 0,
                        _ if random.below(300) == 0 => 1000,
                        _ => random.below(64) as i32 - 32,
                    })
                    .collect();
                round_trip(&coefficients);
            }
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
