//! Zstandard's compressors, their output buffer and its decompressor, kept per thread between calls. To prepare them
//! takes longer than a small payload, and returned memory would come back from the system page by page.

use std::cell::RefCell;
use std::io;

use zstd::bulk::{Compressor, Decompressor};
use zstd::zstd_safe::{CParameter, ParamSwitch, compress_bound};

/// Compression level: 1 compresses about 400 MB/s per core; 3 saves 2 to 4 % more bytes at half the speed.
const LEVEL: i32 = 1;

/// Contents of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Frames {
    /// Matches with earlier bytes, and Huffman codes for the rest.
    Matches,
    /// Huffman codes alone, as far as Zstandard can be kept from searching matches. A chance match of five tokens takes
    /// more bytes than their codes, and longer to decode.
    Codes,
}

impl Frames {
    fn compressor(self) -> io::Result<Compressor<'static>> {
        /// Bytes between two positions at which matches are searched: the size of a block.
        const STRIDE: u32 = 128 << 10;
        /// Smallest table of such positions, as a power of two.
        const LEAST_TABLE: u32 = 6;
        let mut compressor = Compressor::new(LEVEL)?;
        if self == Self::Codes {
            compressor.set_parameter(CParameter::TargetLength(STRIDE))?;
            compressor.set_parameter(CParameter::HashLog(LEAST_TABLE))?;
            // With such a target length Zstandard would also leave the literals uncompressed.
            compressor.set_parameter(CParameter::LiteralCompressionMode(ParamSwitch::Enable))?;
        }
        Ok(compressor)
    }
}

#[derive(Default)]
struct Kept {
    /// Indexed by [`Frames`].
    compressors: [Option<Compressor<'static>>; 2],
    frame: Vec<u8>,
    decompressor: Option<Decompressor<'static>>,
}

thread_local! {
    static KEPT: RefCell<Kept> = RefCell::default();
}

/// Compresses `bytes` to a frame and appends it to `out`; returns its length in bytes.
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

/// Decompresses a frame into the beginning of `out`; returns the number of decompressed bytes.
///
/// # Errors
/// If the frame is damaged, or its content is longer than `out`.
pub(super) fn read_frame(frame: &[u8], out: &mut [u8]) -> io::Result<usize> {
    KEPT.with_borrow_mut(|Kept { decompressor, .. }| {
        let decompressor = match decompressor {
            Some(decompressor) => decompressor,
            None => decompressor.insert(Decompressor::new()?),
        };
        decompressor.decompress_to_buffer(frame, out)
    })
}
