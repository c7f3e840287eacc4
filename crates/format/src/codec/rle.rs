//! Runs of equal voxels.
//!
//! The payload is a list of tokens. A token begins with a number t of variable length: 7 bits per byte, low bits first,
//! at most 5 bytes. The top bit is set on all bytes but the last. Its meaning:
//!
//! | t | followed by | meaning |
//! |---|---|---|
//! | even | one voxel | that voxel `t/2 + 1` times |
//! | odd | `(t+1)/2` voxels | those voxels, once each |
//!
//! Runs cross rows. Voxels are compared by their bits, so that -0.0 and the payloads of NaNs survive. Voxels without
//! any run cost one token of at most 5 bytes: an expansion below 1 % for bricks of any useful size.

use super::payload::{BrickShape, CodecError};

/// Shortest run that is coded as one: it must save more than the two tokens that it may add around it.
fn shortest_run(voxel_bytes: usize) -> usize {
    if voxel_bytes == 1 { 8 } else { 4 }
}

/// Encodes the voxels of a brick.
#[must_use]
pub fn encode(shape: BrickShape, voxels: &[u8]) -> Vec<u8> {
    encode_if_smaller(shape, voxels, usize::MAX).expect("no payload is longer than usize::MAX")
}

/// As [`encode`], but returns `None` as soon as the payload is not smaller than `limit` bytes.
#[must_use]
pub fn encode_if_smaller(shape: BrickShape, voxels: &[u8], limit: usize) -> Option<Vec<u8>> {
    // Voxels are compared as arrays, so that the compiler uses single machine words.
    match shape.voxel_type.bytes() {
        1 => encode_voxels(voxels.as_chunks::<1>().0, limit),
        2 => encode_voxels(voxels.as_chunks::<2>().0, limit),
        4 => encode_voxels(voxels.as_chunks::<4>().0, limit),
        _ => encode_voxels(voxels.as_chunks::<8>().0, limit),
    }
}

/// Lower bound of the payload's bytes. Voxels outside runs are copied to the payload. The bound on those inside counts
/// windows of w equal voxels. A run of r voxels holds r + 1 - w of them, and r is at least [`shortest_run`].
fn least_bytes<const SIZE: usize>(voxels: &[[u8; SIZE]]) -> usize {
    const WINDOW: usize = 3;
    // A u8 holds the count of so many windows, and a vector register most u8 lanes.
    const AT_ONCE: usize = 128;
    let from = |place: usize| voxels.get(place..).unwrap_or_default().chunks(AT_ONCE);
    let windows = from(0).zip(from(1)).zip(from(2)).map(|((a, b), c)| {
        let equal = a.iter().zip(b).zip(c).map(|((a, b), c)| u8::from((a == b) & (b == c)));
        usize::from(equal.sum::<u8>())
    });
    let shortest = shortest_run(SIZE);
    let in_runs = windows.sum::<usize>() * shortest / (shortest + 1 - WINDOW);
    voxels.len().saturating_sub(in_runs) * SIZE
}

fn encode_voxels<const SIZE: usize>(voxels: &[[u8; SIZE]], limit: usize) -> Option<Vec<u8>> {
    if least_bytes(voxels) >= limit {
        return None;
    }
    let mut out = Vec::new();
    let mut literal_start = 0;
    let mut i = 0;
    while i < voxels.len() {
        let run = voxels[i..].iter().take_while(|v| **v == voxels[i]).count();
        if run >= shortest_run(SIZE) {
            push_literals(&mut out, voxels[literal_start..i].as_flattened(), SIZE);
            push_number(&mut out, (run - 1) << 1);
            out.extend_from_slice(&voxels[i]);
            literal_start = i + run;
        }
        i += run;
        if out.len() + (i - literal_start) * SIZE >= limit {
            return None;
        }
    }
    push_literals(&mut out, voxels[literal_start..].as_flattened(), SIZE);
    (out.len() < limit).then_some(out)
}

fn push_literals(out: &mut Vec<u8>, literals: &[u8], size: usize) {
    if !literals.is_empty() {
        push_number(out, ((literals.len() / size - 1) << 1) | 1);
        out.extend_from_slice(literals);
    }
}

#[expect(clippy::cast_possible_truncation, reason = "the low 7 bits are wanted; the top bit is set or is zero")]
fn push_number(out: &mut Vec<u8>, mut t: usize) {
    while t >= 0x80 {
        out.push(t as u8 | 0x80);
        t >>= 7;
    }
    out.push(t as u8);
}

/// Reads a number of at most 5 bytes from the payload and advances it.
#[inline(always)]
fn take_number(payload: &mut &[u8]) -> Option<usize> {
    let mut t = 0u64;
    for shift in (0..35).step_by(7) {
        let (&byte, rest) = payload.split_first()?;
        *payload = rest;
        t |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return usize::try_from(t).ok();
        }
    }
    None
}

/// Decodes into a buffer of exactly the brick's size.
///
/// # Errors
/// If a token is truncated, or the tokens hold fewer or more voxels than the brick.
pub fn decode_into(shape: BrickShape, payload: &[u8], out: &mut [u8]) -> Result<(), CodecError> {
    match shape.voxel_type.bytes() {
        1 => decode_voxels(payload, out.as_chunks_mut::<1>().0),
        2 => decode_voxels(payload, out.as_chunks_mut::<2>().0),
        4 => decode_voxels(payload, out.as_chunks_mut::<4>().0),
        _ => decode_voxels(payload, out.as_chunks_mut::<8>().0),
    }
}

/// Voxels that are written for any shorter token, if there is room. The next token overwrites the surplus. A copy of
/// fixed length costs less than one of the token's length.
const AT_ONCE: usize = 16;

fn decode_voxels<const SIZE: usize>(payload: &[u8], out: &mut [[u8; SIZE]]) -> Result<(), CodecError> {
    let voxels_in_all = out.len();
    let (mut rest, mut left) = (payload, out);
    while !rest.is_empty() {
        let at = payload.len() - rest.len();
        let truncated = CodecError::Truncated { codec: "rle", at };
        let Some(t) = take_number(&mut rest) else { return Err(truncated) };
        let (count, is_run) = ((t >> 1) + 1, t & 1 == 0);
        if count > left.len() {
            return Err(CodecError::Overrun { codec: "rle", voxels: voxels_in_all, at });
        }
        let source = rest.as_chunks::<SIZE>().0;
        let taken = if is_run { 1 } else { count };
        if taken > source.len() {
            return Err(truncated);
        }
        let is_short = count <= AT_ONCE;
        match (left.first_chunk_mut::<AT_ONCE>(), source.first_chunk::<AT_ONCE>()) {
            (Some(room), _) if is_short && is_run => *room = [source[0]; AT_ONCE],
            (Some(room), Some(voxels)) if is_short => *room = *voxels,
            _ if is_run => left[..count].fill(source[0]),
            _ => left[..count].copy_from_slice(&source[..count]),
        }
        rest = &rest[taken * SIZE..];
        left = &mut left[count..];
    }
    if left.is_empty() {
        Ok(())
    } else {
        let expected = format!("tokens for {voxels_in_all} voxels, which hold {}", voxels_in_all - left.len());
        Err(CodecError::Length { codec: "rle", expected, found: payload.len() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::VoxelType;
    use crate::random::Random;

    fn shape(voxels: usize) -> BrickShape {
        BrickShape { voxel_type: VoxelType::U16, extent: [voxels, 1, 1] }
    }

    /// Regime S46: runs of 1, 2^k +- 1, all equal, none equal.
    #[test]
    fn run_lengths_around_powers_of_two_are_exact_and_never_expand_much() {
        let mut runs: Vec<usize> =
            (0..16).flat_map(|k| [(1 << k) - 1, 1 << k, (1 << k) + 1]).filter(|n| *n > 0).collect();
        runs.push(1);
        let voxels: Vec<u16> = runs.iter().enumerate().flat_map(|(i, &n)| std::iter::repeat_n(i as u16, n)).collect();
        let bytes: &[u8] = bytemuck::cast_slice(&voxels);
        let payload = encode(shape(voxels.len()), bytes);
        assert!(payload.len() < runs.len() * 6, "{} bytes for {} runs", payload.len(), runs.len());
        let mut out = vec![0; bytes.len()];
        decode_into(shape(voxels.len()), &payload, &mut out).expect("what was encoded decodes");
        assert_eq!(out, bytes);

        let different: Vec<u16> = (0..8000).collect();
        let payload = encode(shape(8000), bytemuck::cast_slice(&different));
        assert!(payload.len() <= 16_000 * 101 / 100, "{} bytes for 16000", payload.len());
    }

    #[test]
    fn stored_bytes_stay_as_they_are() {
        let voxels: [u16; 8] = [5, 5, 5, 5, 5, 1, 2, 3];
        let payload = encode(shape(8), bytemuck::cast_slice(&voxels));
        assert_eq!(payload, [8, 5, 0, 5, 1, 0, 2, 0, 3, 0]);
    }

    #[test]
    fn no_payload_is_shorter_than_the_least() {
        let mut random = Random::new(3);
        let mut tight = 0;
        for case in 0..400 {
            // Runs of few different lengths, some just long enough to be coded.
            let longest = 1 + case % 12;
            let mut voxels: Vec<[u8; 2]> = Vec::new();
            while voxels.len() < 300 {
                let run = vec![[random.below(3) as u8, random.below(2) as u8]; 1 + random.index(longest)];
                voxels.extend(run);
            }
            let bytes: Vec<[u8; 1]> = voxels.iter().map(|v| [v[0]]).collect();
            for (least, payload) in [
                (least_bytes(&voxels), encode_voxels(&voxels, usize::MAX)),
                (least_bytes(&bytes), encode_voxels(&bytes, usize::MAX)),
            ] {
                let payload = payload.expect("no limit").len();
                assert!(least <= payload, "{least} of {payload}, runs of {longest}");
                tight += usize::from(10 * least > 8 * payload);
            }
        }
        assert!(tight > 50, "{tight}");
    }
}
