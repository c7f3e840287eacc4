//! Chunks of coefficients in a payload: tokens in a Zstandard frame, and extra bits behind it.
//!
//! | size | meaning |
//! |---|---|
//! | 4 | u32: number of tokens ([`super::tokens`]) |
//! | 4 | u32: length of the Zstandard frame of the tokens in bytes |
//! | 4 | u32: length of the extra bits in bytes |
//! | | frame, extra bits |

use super::compressor::{Frames, append_frame, read_frame};
use super::payload::CodecError;
use super::sample::Sample;
use super::tokens::{BITS_PADDING, Decoding, Encoding, Tokens};
use crate::vectors::vectorized;

const HEAD_BYTES: usize = 12;
/// Number of tokens that are compressed twice to find out whether matches help.
const TRIED: usize = 8192;
/// Matches must save at least one part in this many; a smaller gain may be chance.
const LEAST_SAVED: usize = 16;

/// Payload to which chunks are appended.
pub(super) struct Chunks {
    pub payload: Vec<u8>,
    /// Kind of frame, once there have been enough tokens to choose it.
    chosen: Option<Frames>,
}

impl Chunks {
    /// Chunks behind the beginning of a payload.
    pub fn after(payload: Vec<u8>) -> Self {
        Self { payload, chosen: None }
    }

    /// Forgets the kind of frame, because coefficients of another kind follow.
    pub fn choose_anew(&mut self) {
        self.chosen = None;
    }

    /// Appends a chunk.
    ///
    /// # Errors
    /// If Zstandard cannot get memory.
    pub fn push<S: Sample>(&mut self, coefficients: &[S]) -> Result<(), CodecError> {
        let Tokens { tokens, bits } = vectorized(Encoding { coefficients });
        let head = self.payload.len();
        self.payload.extend([0; HEAD_BYTES]);
        if self.chosen.is_none() {
            self.chosen = frames_of(&tokens)?;
        }
        let frames = self.chosen.unwrap_or(Frames::Codes);
        let frame = append_frame(frames, &tokens, &mut self.payload).map_err(zstd_failed)?;
        let lengths = [tokens.len(), frame, bits.len()];
        for (target, length) in self.payload[head..].as_chunks_mut::<4>().0.iter_mut().zip(lengths) {
            *target = u32::try_from(length).expect("a brick has fewer than 2^32 voxels").to_le_bytes();
        }
        self.payload.extend(bits);
        Ok(())
    }
}

/// Kind of frame for tokens like these, or `None` if there are too few to tell. Noise is coded best by Huffman codes
/// alone; periodic data also by matches.
fn frames_of(tokens: &[u8]) -> Result<Option<Frames>, CodecError> {
    let Some(tried) = tokens.get(..TRIED) else { return Ok(None) };
    let length = |frames| append_frame(frames, tried, &mut Vec::new()).map_err(zstd_failed);
    let codes = length(Frames::Codes)?;
    let repeat = length(Frames::Matches)? < codes - codes / LEAST_SAVED;
    Ok(Some(if repeat { Frames::Matches } else { Frames::Codes }))
}

fn zstd_failed(e: std::io::Error) -> CodecError {
    CodecError::Zstd { reason: e.to_string() }
}

/// Reader of chunks. Its buffers are reused for all of them.
#[derive(Default)]
pub(super) struct ChunkReader {
    tokens: Vec<u8>,
    bits: Vec<u8>,
}

impl ChunkReader {
    /// Reads a chunk of `out.len()` coefficients and advances `payload`. `out` must hold zeros.
    ///
    /// # Errors
    /// A sentence, if the payload does not begin with such a chunk.
    pub fn take<S: Sample>(&mut self, payload: &mut &[u8], out: &mut [S]) -> Result<(), String> {
        let coefficients = out.len();
        let cut_short = || "a chunk is cut short".to_owned();
        let (head, rest) = payload.split_first_chunk::<HEAD_BYTES>().ok_or_else(cut_short)?;
        let length = |i: usize| u32::from_le_bytes([0, 1, 2, 3].map(|b| head[4 * i + b])) as usize;
        let [tokens, frame_bytes, bits_bytes] = [0, 1, 2].map(length);
        // Each token stands for at least one coefficient, so the buffer never exceeds the brick's size.
        if tokens > coefficients {
            return Err(format!("{tokens} tokens for {coefficients} coefficients"));
        }
        let (frame, rest) = rest.split_at_checked(frame_bytes).ok_or_else(cut_short)?;
        let (bits, rest) = rest.split_at_checked(bits_bytes).ok_or_else(cut_short)?;
        *payload = rest;
        self.tokens.resize(tokens, 0);
        let found = read_frame(frame, &mut self.tokens).map_err(|e| e.to_string())?;
        self.bits.clear();
        self.bits.extend_from_slice(bits);
        self.bits.extend([0; BITS_PADDING]);
        if found == tokens && vectorized(Decoding { tokens: &self.tokens, bits: &self.bits, out }) {
            Ok(())
        } else {
            Err(format!("{found} tokens and {bits_bytes} bytes of bits that are not {coefficients} coefficients"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn tokens_that_repeat_have_matches_and_noise_has_none() {
        let mut random = Random::new(5);
        let noise: Vec<u8> = (0..2 * TRIED).map(|_| 64 + random.below(8) as u8).collect();
        let periodic: Vec<u8> = noise[..500].iter().copied().cycle().take(2 * TRIED).collect();
        let coded = |frames, tokens: &[u8]| append_frame(frames, tokens, &mut Vec::new()).expect("there is memory");
        for (tokens, expected, other) in
            [(&noise, Frames::Codes, Frames::Matches), (&periodic, Frames::Matches, Frames::Codes)]
        {
            let frames_of = |tokens: &[u8]| frames_of(tokens).expect("there is memory");
            assert_eq!(frames_of(&tokens[..TRIED - 1]), None, "too few to tell");
            assert_eq!([frames_of(tokens), frames_of(&tokens[..TRIED])], [Some(expected); 2]);
            assert!(coded(expected, tokens) < coded(other, tokens));
            // Huffman codes alone take three bits per token.
            assert!(coded(Frames::Codes, tokens) < tokens.len() * 4 / 8);
        }
    }
}
