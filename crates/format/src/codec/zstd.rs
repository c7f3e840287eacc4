//! Predicted differences in byte planes, compressed by Zstandard.
//!
//! Payload: one byte for the predictor, then one Zstandard frame whose content has exactly the brick's size. The
//! content is made in three lossless steps; decoding reverses them:
//!
//! 1. *Predict.* Voxels are taken as unsigned integers of their size (floats by their bits). Each is replaced by its
//!    difference, modulo 2^bits, from the prediction. `Predictor::None` predicts 0. `Predictor::Left` predicts the
//!    voxel at x-1 (at x = 0: the voxel at y-1, there z-1, there 0).
//! 2. *Zigzag* (predicted voxels only): the difference d, taken as signed, becomes `2d` or `-2d-1`. Small differences
//!    of either sign then have zero high bytes.
//! 3. *Byte planes*: all lowest bytes, then all second bytes, and so on; one-byte voxels have a single plane.

use std::borrow::Cow;

use super::compressor::{Frames, append_frame, read_frame};
use super::payload::{BrickShape, CodecError};
use crate::vectors::{Vectorized, vectorized};

/// Prediction of a voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
enum Predictor {
    /// No prediction: for labels and palettes, whose differences have no meaning.
    None = 0,
    /// The previous voxel of the row.
    Left = 1,
}

/// Unsigned integer of a voxel's size.
trait Word: bytemuck::Pod + Into<u64> {
    fn sub(self, other: Self) -> Self;
    fn add(self, other: Self) -> Self;
    fn zigzag(self) -> Self;
    fn unzigzag(self) -> Self;
    /// Number of significant bits: an estimate of the storage cost.
    fn cost(self) -> u32;
}

macro_rules! word {
    ($t:ty, $signed:ty) => {
        impl Word for $t {
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                self.wrapping_sub(other)
            }
            #[inline]
            fn add(self, other: Self) -> Self {
                self.wrapping_add(other)
            }
            #[inline(always)]
            fn zigzag(self) -> Self {
                (self << 1) ^ ((self as $signed) >> (<$t>::BITS - 1)) as $t
            }
            #[inline]
            fn unzigzag(self) -> Self {
                (self >> 1) ^ (0 as $t).wrapping_sub(self & 1)
            }
            #[inline]
            fn cost(self) -> u32 {
                <$t>::BITS - self.leading_zeros()
            }
        }
    };
}
word!(u8, i8);
word!(u16, i16);
word!(u32, i32);
word!(u64, i64);

/// Evaluates an expression with the integer type of a voxel's size.
macro_rules! with_word {
    ($bytes:expr, $w:ident => $body:expr) => {
        match $bytes {
            1 => {
                type $w = u8;
                $body
            }
            2 => {
                type $w = u16;
                $body
            }
            4 => {
                type $w = u32;
                $body
            }
            _ => {
                type $w = u64;
                $body
            }
        }
    };
}

/// Encodes the voxels of a brick.
///
/// # Errors
/// If Zstandard cannot get memory.
pub fn encode(shape: BrickShape, voxels: &[u8]) -> Result<Vec<u8>, CodecError> {
    with_word!(shape.voxel_type.bytes(), W => {
        let words = to_words::<W>(voxels);
        match choose_predictor(&words, shape.extent[0]) {
            Predictor::None => compress(Predictor::None, &words),
            Predictor::Left => compress(Predictor::Left, &differences(&words, shape.extent)),
        }
    })
}

/// Payload of words after prediction.
fn compress<W: Word>(predictor: Predictor, words: &[W]) -> Result<Vec<u8>, CodecError> {
    // One-byte words are one plane already.
    let planes = if size_of::<W>() == 1 { Cow::Borrowed(bytemuck::cast_slice(words)) } else { to_planes(words).into() };
    let mut payload = vec![predictor as u8];
    append_frame(Frames::Matches, &planes, &mut payload).map_err(|e| CodecError::Zstd { reason: e.to_string() })?;
    Ok(payload)
}

/// Decodes into a buffer of exactly the brick's size.
///
/// # Errors
/// If the predictor is unknown, the frame is damaged, or its content has not exactly the brick's size.
pub fn decode_into(shape: BrickShape, payload: &[u8], out: &mut [u8]) -> Result<(), CodecError> {
    let fail = |reason: String| CodecError::Zstd { reason };
    let (&tag, frame) = payload.split_first().ok_or_else(|| fail("empty; expected a predictor byte".into()))?;
    let predictor = [Predictor::None, Predictor::Left]
        .into_iter()
        .find(|p| *p as u8 == tag)
        .ok_or_else(|| fail(format!("predictor {tag}; expected 0 or 1")))?;
    let mut planes = vec![0; out.len()];
    let length = read_frame(frame, &mut planes).map_err(|e| fail(e.to_string()))?;
    if length != out.len() {
        return Err(fail(format!("frame holds {length} bytes; expected {}", out.len())));
    }
    with_word!(shape.voxel_type.bytes(), W => {
        let mut words = from_planes::<W>(&planes);
        if predictor == Predictor::Left {
            undo_differences(&mut words, shape.extent);
        }
        out.copy_from_slice(bytemuck::cast_slice(&words));
        if cfg!(target_endian = "big") {
            out.chunks_exact_mut(size_of::<W>()).for_each(<[u8]>::reverse);
        }
    });
    Ok(())
}

/// Little-endian bytes as words of this machine; without a copy if the bytes are aligned like words.
fn to_words<W: Word>(bytes: &[u8]) -> Cow<'_, [W]> {
    if cfg!(target_endian = "little")
        && let Ok(words) = bytemuck::try_cast_slice(bytes)
    {
        return Cow::Borrowed(words);
    }
    let mut words = vec![W::zeroed(); bytes.len() / size_of::<W>()];
    let target: &mut [u8] = bytemuck::cast_slice_mut(&mut words);
    target.copy_from_slice(bytes);
    if cfg!(target_endian = "big") {
        target.chunks_exact_mut(size_of::<W>()).for_each(<[u8]>::reverse);
    }
    words.into()
}

/// `Left`, unless the differences of every 16th row take as many bits as the voxels themselves.
fn choose_predictor<W: Word>(words: &[W], row: usize) -> Predictor {
    let (mut plain, mut predicted) = (0u64, 0u64);
    for row in words.chunks_exact(row).step_by(16) {
        plain += row.iter().map(|w| u64::from(w.cost())).sum::<u64>();
        predicted += row.windows(2).map(|w| u64::from(w[1].sub(w[0]).zigzag().cost())).sum::<u64>();
    }
    // Differences of labels are as large as labels; those of measured fields are much smaller.
    if predicted < plain { Predictor::Left } else { Predictor::None }
}

/// Steps 1 and 2: zigzag differences from the previous voxel of the row.
fn differences<W: Word>(words: &[W], extent: [usize; 3]) -> Vec<W> {
    let mut out = vec![W::zeroed(); words.len()];
    vectorized(Differences { words, extent, out: &mut out });
    out
}

/// Task of [`differences`].
struct Differences<'a, W> {
    words: &'a [W],
    extent: [usize; 3],
    out: &'a mut [W],
}

impl<W: Word> Vectorized for Differences<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { words, extent, out } = self;
        let rows = words.chunks_exact(extent[0]).zip(out.chunks_exact_mut(extent[0]));
        for (number, (row, out)) in rows.enumerate() {
            out[0] = row[0].sub(above(words, number * extent[0], extent)).zigzag();
            for ((out, &word), &before) in out[1..].iter_mut().zip(&row[1..]).zip(row) {
                *out = word.sub(before).zigzag();
            }
        }
    }
}

/// Reverses [`differences`] in place.
fn undo_differences<W: Word>(words: &mut [W], extent: [usize; 3]) {
    for start in (0..words.len()).step_by(extent[0]) {
        let mut previous = above(words, start, extent);
        for word in &mut words[start..start + extent[0]] {
            previous = word.unzigzag().add(previous);
            *word = previous;
        }
    }
}

/// Prediction of the first voxel of a row: the first voxel of the row at y-1, else z-1, else 0.
fn above<W: Word>(words: &[W], row_start: usize, extent: [usize; 3]) -> W {
    let y = row_start / extent[0] % extent[1];
    let back = if y > 0 { extent[0] } else { extent[0] * extent[1] };
    row_start.checked_sub(back).map_or(W::zeroed(), |i| words[i])
}

/// Step 3: words to byte planes, lowest byte first.
#[expect(clippy::cast_possible_truncation, reason = "one byte of the word is wanted")]
fn to_planes<W: Word>(words: &[W]) -> Vec<u8> {
    let mut planes = Vec::with_capacity(size_of_val(words));
    for byte in 0..size_of::<W>() {
        planes.extend(words.iter().map(|&w| (w.into() >> (8 * byte)) as u8));
    }
    planes
}

/// Reverses [`to_planes`].
fn from_planes<W: Word>(planes: &[u8]) -> Vec<W> {
    let n = planes.len() / size_of::<W>();
    let mut bytes = vec![W::zeroed(); n];
    for (byte, plane) in planes.chunks_exact(n).enumerate() {
        let position = if cfg!(target_endian = "big") { size_of::<W>() - 1 - byte } else { byte };
        let target: &mut [u8] = bytemuck::cast_slice_mut(&mut bytes);
        for (t, &p) in target[position..].iter_mut().step_by(size_of::<W>()).zip(plane) {
            *t = p;
        }
    }
    bytes
}
