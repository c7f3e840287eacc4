//! Blosc 1: blocks of a chunk, each shuffled and compressed alone. It is the usual compression of Zarr and N5.
//!
//! Layout (c-blosc's `README_CHUNK_FORMAT`): a header of 16 bytes, the offsets of the blocks as u32, and the blocks.
//! The header holds the version, the compressor's version, flags and the bytes per element. Then follow, as u32, the
//! bytes of the chunk, of a block, and of the whole compressed chunk. A block is one stream, or one stream for each
//! byte of the elements; before each stream stands its length as i32.
//! Written by hand: the only Rust crate is young, and the C library allocates what a header claims. The compressors are
//! crates, except BloscLZ. The decoder produces exactly the length that the caller expects and allocates nothing else.

use std::io::Read;

/// Bytes before the offsets of the blocks.
const HEADER_BYTES: usize = 16;
/// Largest element size in bytes that is split into streams, and smallest size of such a stream in bytes.
const SPLITS_LIMIT: usize = 16;
const STREAM_BYTES: usize = 128;

const SHUFFLED: u8 = 1;
const STORED: u8 = 2;
const BIT_SHUFFLED: u8 = 4;
const NOT_SPLIT: u8 = 16;

/// Largest distance of a BloscLZ match that needs no two extra bytes.
const BLOSCLZ_NEAR: usize = 8191;

#[derive(Debug, Clone, Copy)]
enum Compressor {
    BloscLz,
    Lz4,
    Zlib,
    Zstd,
}

struct Header {
    flags: u8,
    element: usize,
    bytes: usize,
    block: usize,
    compressor: Compressor,
}

/// Decodes a chunk to exactly `wanted` bytes.
///
/// # Errors
/// A description of the defect.
pub(super) fn decode(data: &[u8], wanted: usize) -> Result<Vec<u8>, String> {
    let header = Header::of(data)?;
    if header.bytes != wanted {
        return Err(format!("{} bytes, where {wanted} were expected", header.bytes));
    }
    let mut out = vec![0; wanted];
    if header.flags & STORED != 0 {
        let stored = data.get(HEADER_BYTES..HEADER_BYTES + wanted).ok_or("it ends too early")?;
        out.copy_from_slice(stored);
        return Ok(out);
    }
    let mut shuffled = vec![0; header.block.min(wanted)];
    for (number, block) in out.chunks_mut(header.block).enumerate() {
        let place = u32_at(data, HEADER_BYTES + 4 * number).ok_or("it ends within its places of blocks")?;
        let streams = data.get(place..).ok_or("a block lies behind its end")?;
        let is_whole = block.len() == header.block;
        if header.is_shuffled() {
            let shuffled = &mut shuffled[..block.len()];
            header.inflate(streams, is_whole, shuffled)?;
            header.unshuffle(shuffled, block);
        } else {
            header.inflate(streams, is_whole, block)?;
        }
    }
    Ok(out)
}

impl Header {
    fn of(data: &[u8]) -> Result<Self, String> {
        let &[version, _, flags, element, ..] = data.get(..HEADER_BYTES).ok_or("shorter than its header")? else {
            return Err("shorter than its header".into());
        };
        if !(1..=2).contains(&version) {
            return Err(format!("version {version} of Blosc, of which 1 and 2 are read"));
        }
        let [bytes, block] = [4, 8].map(|at| u32_at(data, at).unwrap_or(0));
        if element == 0 || block == 0 && bytes > 0 {
            return Err(format!("elements of {element} bytes in blocks of {block}"));
        }
        let compressor = match flags >> 5 {
            0 => Compressor::BloscLz,
            1 => Compressor::Lz4,
            3 => Compressor::Zlib,
            4 => Compressor::Zstd,
            2 => return Err("compressed by Snappy, which is not read".into()),
            other => return Err(format!("compressor {other}, which is not known")),
        };
        Ok(Self { flags, element: element.into(), bytes, block: block.max(1), compressor })
    }

    fn is_shuffled(&self) -> bool {
        self.element > 1 && self.flags & SHUFFLED != 0 || self.flags & BIT_SHUFFLED != 0
    }

    /// Decompresses the streams of a block; only whole blocks are split.
    fn inflate(&self, mut streams: &[u8], is_whole: bool, out: &mut [u8]) -> Result<(), String> {
        let splits = self.flags & NOT_SPLIT == 0
            && is_whole
            && self.element <= SPLITS_LIMIT
            && self.block / self.element >= STREAM_BYTES
            && self.block.is_multiple_of(self.element);
        let stream_bytes = if splits { self.block / self.element } else { out.len() };
        for part in out.chunks_mut(stream_bytes.max(1)) {
            let length = u32_at(streams, 0).ok_or("it ends within a block")?;
            let stream = streams.get(4..).and_then(|s| s.get(..length)).ok_or("a stream lies behind its end")?;
            streams = &streams[4 + length..];
            if length == part.len() {
                part.copy_from_slice(stream);
                continue;
            }
            let done = match self.compressor {
                Compressor::BloscLz => blosclz(stream, part),
                Compressor::Lz4 => lz4_flex::block::decompress_into(stream, part).ok(),
                Compressor::Zlib => exactly(flate2::bufread::ZlibDecoder::new(stream), part),
                Compressor::Zstd => zstd::bulk::decompress_to_buffer(stream, part).ok(),
            };
            if done != Some(part.len()) {
                return Err(format!("a stream of {:?} is damaged", self.compressor));
            }
        }
        Ok(())
    }

    fn unshuffle(&self, from: &[u8], to: &mut [u8]) {
        let element = self.element;
        let count = from.len() / element;
        let whole = count * element;
        if self.flags & SHUFFLED != 0 {
            unshuffle_bytes(&from[..whole], element, &mut to[..whole]);
        } else if count.is_multiple_of(8) {
            unshuffle_bits(&from[..whole], element, &mut to[..whole]);
        } else {
            to[..whole].copy_from_slice(&from[..whole]);
        }
        to[whole..].copy_from_slice(&from[whole..]);
    }
}

fn u32_at(data: &[u8], at: usize) -> Option<usize> {
    let bytes = data.get(at..)?.first_chunk()?;
    usize::try_from(u32::from_le_bytes(*bytes)).ok()
}

/// Fills `out` from a decoder; `None` if that fails.
fn exactly(mut decoder: impl Read, out: &mut [u8]) -> Option<usize> {
    decoder.read_exact(out).ok().map(|()| out.len())
}

/// Reverses the byte shuffle: first bytes of all elements, then their second bytes, and so on.
pub(super) fn unshuffle_bytes(from: &[u8], element: usize, to: &mut [u8]) {
    let count = from.len() / element;
    if count == 0 {
        return;
    }
    for (byte, plane) in from.chunks_exact(count).enumerate() {
        for (value, out) in plane.iter().zip(to.chunks_exact_mut(element)) {
            out[byte] = *value;
        }
    }
}

/// Reverses the bit shuffle: first bits of all elements, then their second bits, and so on. The number of elements is a
/// multiple of eight.
fn unshuffle_bits(from: &[u8], element: usize, to: &mut [u8]) {
    let row = from.len() / element / 8;
    for byte in 0..element {
        let planes = &from[byte * 8 * row..];
        for group in 0..row {
            let bits = u64::from_le_bytes(std::array::from_fn(|bit| planes[bit * row + group]));
            for (i, value) in transposed(bits).to_le_bytes().into_iter().enumerate() {
                to[(group * 8 + i) * element + byte] = value;
            }
        }
    }
}

/// Transposes a matrix of 8 x 8 bits (Warren, Hacker's Delight, 2nd edition, 7-3).
fn transposed(mut x: u64) -> u64 {
    for (mask, shift) in [(0x00aa_00aa_00aa_00aa, 7), (0x0000_cccc_0000_cccc, 14), (0x0000_0000_f0f0_f0f0, 28)] {
        let t = (x ^ (x >> shift)) & mask;
        x ^= t ^ (t << shift);
    }
    x
}

/// Decodes BloscLZ, Blosc's variant of FastLZ: literals, and matches of decoded bytes. Returns the number of decoded
/// bytes.
fn blosclz(input: &[u8], out: &mut [u8]) -> Option<usize> {
    let mut rest = input;
    let next = |rest: &mut &[u8]| rest.split_off_first().map(|byte| usize::from(*byte));
    let mut done = 0;
    let mut control = next(&mut rest)? & 31;
    loop {
        if control < 32 {
            let count = control + 1;
            out.get_mut(done..done + count)?.copy_from_slice(rest.split_off(..count)?);
            done += count;
        } else {
            let mut length = (control >> 5) - 1;
            if length == 6 {
                loop {
                    let more = next(&mut rest)?;
                    length += more;
                    if more != 255 {
                        break;
                    }
                }
            }
            length += 3;
            let (high, low) = ((control & 31) << 8, next(&mut rest)?);
            let mut back = high + low + 1;
            if low == 255 && high == 31 << 8 {
                let far = next(&mut rest)? << 8 | next(&mut rest)?;
                back = far + BLOSCLZ_NEAR + 1;
            }
            let start = done.checked_sub(back)?;
            if length > out.len() - done {
                return None;
            }
            // Byte by byte: a match may overlap its own output.
            for at in 0..length {
                out[done + at] = out[start + at];
            }
            done += length;
        }
        match next(&mut rest) {
            Some(byte) => control = byte,
            None => return Some(done),
        }
    }
}
