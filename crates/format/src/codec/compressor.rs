//! Zstandard's compressors, their output, and its decompressor, kept by each thread from one call to the next: to prepare them takes longer
//! than a small payload, and given back to the system their memory comes anew, page by page.

use std::cell::RefCell;
use std::io;

use zstd::bulk::{Compressor, Decompressor};
use zstd::zstd_safe::{CParameter, ParamSwitch, compress_bound};

/// Level of compression: 1 compresses at some 400 MB/s per core; 3 saves 2 to 4 % more at half the speed.
const LEVEL: i32 = 1;

/// What a frame is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Frames {
    /// Matches with what stands before, and Huffman codes of the rest.
    Matches,
    /// Huffman codes alone, as far as Zstandard can be kept from looking. A match of five tokens by chance takes more than their codes, and
    /// longer to decode.
    Codes,
}

impl Frames {
    fn compressor(self) -> io::Result<Compressor<'static>> {
        /// Bytes between two places where a match is looked for: as many as a block has.
        const STRIDE: u32 = 128 << 10;
        /// The smallest table of such places, 2 to the power of it.
        const LEAST_TABLE: u32 = 6;
        let mut compressor = Compressor::new(LEVEL)?;
        if self == Self::Codes {
            compressor.set_parameter(CParameter::TargetLength(STRIDE))?;
            compressor.set_parameter(CParameter::HashLog(LEAST_TABLE))?;
            // Who looks for no matches is taken to be in a hurry, and would get no codes either.
            compressor.set_parameter(CParameter::LiteralCompressionMode(ParamSwitch::Enable))?;
        }
        Ok(compressor)
    }
}

#[derive(Default)]
struct Kept {
    /// By [`Frames`].
    compressors: [Option<Compressor<'static>>; 2],
    frame: Vec<u8>,
    decompressor: Option<Decompressor<'static>>,
}

thread_local! {
    static KEPT: RefCell<Kept> = RefCell::default();
}

/// Appends the frame that holds some bytes; its length.
///
/// # Errors
/// If Zstandard cannot get memory.
pub(super) fn append_frame(frames: Frames, bytes: &[u8], out: &mut Vec<u8>) -> io::Result<usize> {
    KEPT.with_borrow_mut(|Kept { compressors, frame, .. }| {
        let compressor = match &mut compressors[frames as usize] {
            Some(compressor) => compressor,
            none => none.insert(frames.compressor()?),
        };
        frame.clear();
        frame.reserve(compress_bound(bytes.len()));
        let length = compressor.compress_to_buffer(bytes, frame)?;
        out.extend_from_slice(frame);
        Ok(length)
    })
}

/// Fills the beginning of a buffer with what a frame holds; how many bytes that is.
///
/// # Errors
/// If the frame is damaged, or holds more than there is room for.
pub(super) fn read_frame(frame: &[u8], out: &mut [u8]) -> io::Result<usize> {
    KEPT.with_borrow_mut(|Kept { decompressor, .. }| {
        let decompressor = match decompressor {
            Some(decompressor) => decompressor,
            None => decompressor.insert(Decompressor::new()?),
        };
        decompressor.decompress_to_buffer(frame, out)
    })
}
