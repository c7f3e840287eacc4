//! LZF, the compression of h5py's `compression="lzf"`: literal runs, and copies of earlier bytes.
//!
//! Format: Marc Lehmann, `LibLZF`. The decoder stops at the stated length. It has 30 lines; no maintained crate exists.

/// Greatest first byte of a literal run; the run is one byte longer than this number.
const LITERAL_LIMIT: u8 = 31;
/// Bits of a copy's first byte that belong to its distance; its length is in the higher bits.
const DISTANCE_BITS: u8 = 5;
/// Coded length of a copy from which on another byte of the length follows.
const LONG: usize = 7;
/// Added to the coded length of a copy.
const LENGTH_BASE: usize = 2;

/// Decodes `stream` to exactly `length` bytes; `None` if it is not such a stream.
pub(super) fn decoded(stream: &[u8], length: usize) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(length);
    let mut bytes = stream.iter();
    while let Some(&control) = bytes.next() {
        if control <= LITERAL_LIMIT {
            let (run, rest) = bytes.as_slice().split_at_checked(usize::from(control) + 1)?;
            if out.len() + run.len() > length {
                return None;
            }
            out.extend_from_slice(run);
            bytes = rest.iter();
            continue;
        }
        let mut count = usize::from(control >> DISTANCE_BITS);
        if count == LONG {
            count += usize::from(*bytes.next()?);
        }
        let distance = (usize::from(control & LITERAL_LIMIT) << 8) + usize::from(*bytes.next()?) + 1;
        let from = out.len().checked_sub(distance)?;
        if out.len() + count + LENGTH_BASE > length {
            return None;
        }
        // A copy may overlap its own output.
        for at in from..from + count + LENGTH_BASE {
            out.push(out[at]);
        }
    }
    (out.len() == length).then_some(out)
}

#[cfg(test)]
mod tests {
    use supervol_format::random::Random;

    use super::*;

    /// Made by hand: four literal bytes, then 3 + 2 of them copied, then a long copy that overlaps itself.
    const STREAM: &[u8] = &[3, 1, 2, 3, 4, 0x60, 3, 0xe0, 4, 0];

    #[test]
    fn runs_and_copies() {
        let expected = [&[1, 2, 3, 4, 1, 2, 3, 4, 1][..], &[1; 13]].concat();
        assert_eq!(decoded(STREAM, 22), Some(expected));
        assert_eq!(decoded(STREAM, 21), None, "further than it should");
        assert_eq!(decoded(STREAM, 23), None, "not as far as it should");
        assert_eq!(decoded(&[0x60, 3], 5), None, "a copy from before the beginning");
        for end in 0..STREAM.len() {
            assert_eq!(decoded(&STREAM[..end], 22), None, "cut after {end} bytes");
        }
    }

    #[test]
    fn noise_is_answered() {
        let mut random = Random::new(5);
        for _ in 0..20_000 {
            let stream: Vec<u8> = (0..random.below(40)).map(|_| random.next_u64() as u8).collect();
            assert!(decoded(&stream, 64).is_none_or(|out| out.len() == 64));
        }
    }
}
