//! Zstandard's compressor, its output, and its decompressor, kept by each thread from one call to the next: to prepare them takes longer
//! than a small payload, and given back to the system their memory comes anew, page by page.

use std::cell::RefCell;
use std::io;

use zstd::bulk::{Compressor, Decompressor};
use zstd::zstd_safe::compress_bound;

/// Level of compression: 1 compresses at some 400 MB/s per core; 3 saves 2 to 4 % more at half the speed. The tokens of wavelets are left
/// to Zstandard's Huffman coder, where higher levels find little more.
const LEVEL: i32 = 1;

#[derive(Default)]
struct Kept {
    compressor: Option<Compressor<'static>>,
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
pub(super) fn append_frame(bytes: &[u8], out: &mut Vec<u8>) -> io::Result<usize> {
    KEPT.with_borrow_mut(|Kept { compressor, frame, .. }| {
        let compressor = match compressor {
            Some(compressor) => compressor,
            None => compressor.insert(Compressor::new(LEVEL)?),
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
