//! LZF, which h5py compresses by where it is told `compression="lzf"`: runs of bytes as they are, and copies of what came before.
//!
//! Format: Marc Lehmann, `LibLZF`. Undone to a stated length and no further; 30 lines, for which no crate is kept.

/// Greatest first byte of a run of bytes as they are, which is one longer than this byte.
const LITERAL_LIMIT: u8 = 31;
/// Bits of the first byte of a copy that belong to its distance; above them lies its length.
const DISTANCE_BITS: u8 = 5;
/// Length of a copy from which on a byte more of it follows.
const LONG: usize = 7;
/// What is never written of a copy's length.
const LENGTH_BASE: usize = 2;

/// Bytes behind `stream`, which must be `length`; `None` where it is no such stream.
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
        // What is copied may reach into what it makes.
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

    /// By hand: four bytes as they are, then 3 + 2 of them again, then a long copy that overlaps itself.
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
