//! Compression of a chunk: a list of stages, each decoded to a length that is known or bounded beforehand.

use std::io::Read;

use flate2::bufread::{MultiGzDecoder, ZlibDecoder};

use super::blosc;

/// One stage of the decoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Codec {
    Gzip,
    Zlib,
    Zstd,
    Blosc,
    /// LZ4 behind the decoded length (`numcodecs.lz4`).
    Lz4,
    /// LZ4 in blocks, as written by Java's `LZ4BlockOutputStream` (N5).
    Lz4Blocks,
    /// Four bytes at the end: CRC-32C of the bytes before them.
    Crc32c,
    /// Byte shuffle of elements with this many bytes.
    Shuffle(usize),
    /// Rounding of numbers before they were written: nothing is to be undone.
    Rounding,
}

/// Largest size of an intermediate result in bytes, for `bytes` bytes of voxels: adds checksums, headers,
/// incompressible data.
fn with_overhead(bytes: usize) -> usize {
    bytes + bytes / 8 + 65_536
}

/// Largest encoded size in bytes of a chunk of `bytes` bytes.
pub(super) fn encoded_limit(bytes: usize) -> usize {
    with_overhead(bytes)
}

/// Reverses the stages, last stage first; the result has exactly `wanted` bytes.
///
/// # Errors
/// A description of the defect.
pub(super) fn decode(stages: &[Codec], data: Vec<u8>, wanted: usize) -> Result<Vec<u8>, String> {
    let mut data = data;
    for (left, stage) in stages.iter().enumerate().rev() {
        // Only the first stage's input has a known length; intermediate results may be longer.
        let exact = stages[..left].iter().all(|s| matches!(s, Codec::Shuffle(_) | Codec::Rounding));
        let wanted = if exact { Length::Exactly(wanted) } else { Length::AtMost(with_overhead(wanted)) };
        data = stage.undo(data, wanted).map_err(|what| format!("{stage:?}: {what}"))?;
    }
    if data.len() == wanted { Ok(data) } else { Err(format!("{} bytes, where {wanted} were expected", data.len())) }
}

/// Output length of a stage in bytes.
#[derive(Debug, Clone, Copy)]
enum Length {
    Exactly(usize),
    AtMost(usize),
}

impl Codec {
    fn undo(self, mut data: Vec<u8>, wanted: Length) -> Result<Vec<u8>, String> {
        match self {
            Self::Gzip => inflated(MultiGzDecoder::new(&data[..]), wanted),
            Self::Zlib => inflated(ZlibDecoder::new(&data[..]), wanted),
            Self::Zstd => {
                let decoder = zstd::stream::read::Decoder::with_buffer(&data[..]).map_err(|e| e.to_string())?;
                inflated(decoder, wanted)
            }
            Self::Blosc => {
                let stated = data.get(4..8).and_then(|b| b.first_chunk()).map(|b| u32::from_le_bytes(*b) as usize);
                blosc::decode(&data, stated_within(stated, wanted)?)
            }
            Self::Lz4 => {
                let (length, rest) = data.split_first_chunk().ok_or("shorter than its length")?;
                let length = stated_within(usize::try_from(i32::from_le_bytes(*length)).ok(), wanted)?;
                lz4(rest, length)
            }
            Self::Lz4Blocks => lz4_blocks(&data, wanted),
            Self::Crc32c => {
                let at = data.len().checked_sub(4).ok_or("shorter than its checksum")?;
                let sum = data.split_off(at);
                let found = crc32c::crc32c(&data).to_le_bytes();
                if found == sum[..] { Ok(data) } else { Err("the checksum differs".into()) }
            }
            Self::Rounding => Ok(data),
            Self::Shuffle(element) => {
                let whole = data.len() / element * element;
                let mut out = data.clone();
                blosc::unshuffle_bytes(&data[..whole], element, &mut out[..whole]);
                Ok(out)
            }
        }
    }
}

/// A length from a header, checked against the expected one.
fn stated_within(stated: Option<usize>, wanted: Length) -> Result<usize, String> {
    let stated = stated.ok_or("no length")?;
    match wanted {
        Length::Exactly(n) if stated != n => Err(format!("{stated} bytes, where {n} were expected")),
        Length::AtMost(n) if stated > n => Err(format!("{stated} bytes, where at most {n} were expected")),
        _ => Ok(stated),
    }
}

/// Reads a decoder to its end, but never more than one byte beyond the expected length.
fn inflated(decoder: impl Read, wanted: Length) -> Result<Vec<u8>, String> {
    let (room, most) = match wanted {
        Length::Exactly(n) => (n, n),
        Length::AtMost(n) => (0, n),
    };
    let mut out = Vec::with_capacity(room);
    decoder.take(most as u64 + 1).read_to_end(&mut out).map_err(|e| e.to_string())?;
    if out.len() > most { Err(format!("more than {most} bytes")) } else { Ok(out) }
}

fn lz4(data: &[u8], length: usize) -> Result<Vec<u8>, String> {
    let mut out = vec![0; length];
    let done = lz4_flex::block::decompress_into(data, &mut out).map_err(|e| e.to_string())?;
    if done == length { Ok(out) } else { Err(format!("{done} bytes, where {length} were expected")) }
}

/// `LZ4Block`, a token (16: stored, 32: LZ4, plus the level), compressed length, length, checksum; an empty block ends
/// the stream.
fn lz4_blocks(mut data: &[u8], wanted: Length) -> Result<Vec<u8>, String> {
    const STORED: u8 = 0x10;
    const COMPRESSED: u8 = 0x20;
    const HEADER_BYTES: usize = 21;
    let most = match wanted {
        Length::Exactly(n) | Length::AtMost(n) => n,
    };
    let mut out = Vec::new();
    while let Some(header) = data.split_off(..HEADER_BYTES) {
        let number = |at: usize| header[at..].first_chunk().map_or(0, |b| u32::from_le_bytes(*b) as usize);
        let (token, packed, length) = (header[8], number(9), number(13));
        if !header.starts_with(b"LZ4Block") {
            return Err("no mark `LZ4Block`".into());
        }
        if length == 0 {
            break;
        }
        if length > most - out.len() {
            return Err(format!("more than {most} bytes"));
        }
        let block = data.split_off(..packed).ok_or("it ends within a block")?;
        match token & 0xf0 {
            STORED if packed == length => out.extend_from_slice(block),
            COMPRESSED => out.append(&mut lz4(block, length)?),
            _ => return Err(format!("a block of kind {token}")),
        }
    }
    Ok(out)
}
