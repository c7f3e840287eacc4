//! TIFF compressions: the list of supported ones, and the decoding of JPEG and zstd chunks.
//!
//! The crate `tiff` would decode both only as streams, without knowledge of a chunk's size, and with another JPEG
//! decoder. This module reads a chunk at its stated offset and length and decodes at most as many bytes as its pixels
//! need. JPEG tables are in the page or in the chunk. Luma and chroma become red, green and blue, as in pictures and
//! DICOM. For zstd this module also reverses predictors and byte order. Chunks are returned as little-endian numbers,
//! row by row, including pixels outside the page.

use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;

use jpeg_decoder::{ColorTransform, PixelFormat};
use supervol_format::{ByteSource, VoxelType};
use tiff::decoder::Decoder;
use tiff::tags::Tag;

use super::page::{CHUNK_LIMIT_BYTES, Packing, Page, RATIO_LIMIT, refusal};
use crate::cast::index;
use crate::grid::dense::swap_bytes;
use crate::grid::elements::Number;
use crate::{Endian, SourceError};

/// A zstd block takes at least four bytes and holds at most 128 KiB.
const ZSTD_RATIO_LIMIT: u64 = (128 << 10) / 4;
/// Initial output buffer for zstd per compressed byte, a minimum for it, and the factor by which it grows if it is too
/// small.
const ZSTD_RATIO_LIKELY: usize = 64;
const SMALL_BYTES: usize = 64 << 10;
const ZSTD_GROWTH: usize = 8;
/// zstd's error text for an output buffer that is too small (`ZSTD_error_dstSize_tooSmall`).
const ZSTD_WANTS_MORE: &str = "buffer is too small";
/// Largest size in bytes of a compressed chunk beyond twice its pixels: headers, profiles, incompressible data.
const ENCODED_OVERHEAD_BYTES: usize = 1 << 20;
/// Largest size in bytes of the tables that the chunks of a page share.
const TABLES_LIMIT_BYTES: usize = 1 << 20;

const WHITE_IS_ZERO: u64 = 0;
const RGB: u64 = 2;
const YCBCR: u64 = 6;

/// First and last bytes of a JPEG image or of JPEG tables.
const JPEG_START: [u8; 2] = [0xff, 0xd8];
const JPEG_END: [u8; 2] = [0xff, 0xd9];
/// Offset of the JFIF mark, if there is one.
const JFIF_AT: usize = 6;

const BY_LIBTIFF: &str = "rewrite it first, for example with `tiffcp -c lzw IN OUT`";
const BY_BIO_FORMATS: &str =
    "rewrite it first, for example with `bfconvert -compression LZW IN OUT.tif` (Bio-Formats) or Fiji";
const BY_PYTHON: &str = "rewrite it first, for example with Python: `tifffile.imwrite(OUT, tifffile.imread(IN))`";

/// Compression of the chunks of a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Compression {
    /// None, or one that the crate `tiff` decodes.
    OfDecoder,
    Jpeg,
    Zstd,
}

impl Compression {
    /// The compression with this tag value. An unsupported one is refused by name, with a conversion.
    pub(super) fn of(path: &Path, code: u64) -> Result<Self, SourceError> {
        let (name, advice) = match code {
            1 | 5 | 8 | 32_773 | 32_946 => return Ok(Self::OfDecoder),
            7 => return Ok(Self::Jpeg),
            50_000 => return Ok(Self::Zstd),
            2..=4 => ("that of fax machines (CCITT)", BY_LIBTIFF),
            6 => ("JPEG of the old style, of before 1995", BY_LIBTIFF),
            34_661 => ("JBIG", BY_LIBTIFF),
            34_676 | 34_677 | 32_909 => ("that of colours of high range (SGILog, PixarLog)", BY_LIBTIFF),
            34_925 => ("LZMA", BY_LIBTIFF),
            50_001 => ("WebP", BY_LIBTIFF),
            33_003..=33_005 | 34_712 => ("JPEG 2000", BY_BIO_FORMATS),
            22_610 | 34_934 => ("JPEG XR", BY_BIO_FORMATS),
            34_887 => ("LERC", BY_PYTHON),
            34_933 => ("PNG", BY_PYTHON),
            50_002 | 52_546 => ("JPEG XL", BY_PYTHON),
            _ => ("one that we do not know", BY_PYTHON),
        };
        let what = format!("its pages are compressed by {name} (compression {code}), which is not read in TIFF");
        Err(SourceError::unsupported(path, what, advice))
    }

    /// Largest number of decoded bytes per byte of the file.
    pub(super) fn ratio_limit(self) -> u64 {
        if self == Self::Zstd { ZSTD_RATIO_LIMIT } else { RATIO_LIMIT }
    }
}

/// The chunks of one page.
pub(super) struct CodedChunks {
    page: Page,
    endian: Endian,
    offsets: Vec<u64>,
    lengths: Vec<u64>,
    photometric: u64,
    coding: Coding,
}

enum Coding {
    Zstd {
        decompressor: zstd::bulk::Decompressor<'static>,
        predictor: Predictor,
    },
    /// Bytes to put before each chunk's own segments.
    Jpeg {
        tables: Vec<u8>,
    },
}

/// Transform of the rows before their compression.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Predictor {
    None,
    Horizontal,
    FloatingPoint,
}

impl CodedChunks {
    /// The chunks of the current page; `None` if the crate decodes its compression.
    pub(super) fn of<R: Read + Seek>(
        path: &Path,
        decoder: &mut Decoder<R>,
        (page, endian): (Page, Endian),
        compression: Compression,
    ) -> Result<Option<Self>, SourceError> {
        let wrong = |e| refusal(path, e);
        let coding = match compression {
            Compression::OfDecoder => return Ok(None),
            Compression::Jpeg => Coding::Jpeg { tables: tables(path, decoder)? },
            Compression::Zstd => {
                let decompressor = zstd::bulk::Decompressor::new().map_err(|e| SourceError::io(path, e))?;
                let code: Option<u64> = decoder.find_tag_unsigned(Tag::Predictor).map_err(wrong)?;
                Coding::Zstd { decompressor, predictor: Predictor::of(path, code.unwrap_or(1), page)? }
            }
        };
        let mut list = |of_strips, of_tiles| -> Result<Vec<u64>, SourceError> {
            let strips = decoder.find_tag_unsigned_vec(of_strips).map_err(wrong)?;
            Ok(strips.or(decoder.find_tag_unsigned_vec(of_tiles).map_err(wrong)?).unwrap_or_default())
        };
        let offsets = list(Tag::StripOffsets, Tag::TileOffsets)?;
        let lengths = list(Tag::StripByteCounts, Tag::TileByteCounts)?;
        let photometric = decoder.find_tag_unsigned(Tag::PhotometricInterpretation).map_err(wrong)?.unwrap_or(1);
        Ok(Some(Self { page, endian, offsets, lengths, photometric, coding }))
    }

    /// Decodes a chunk of at most `most` pixels along x and y; returns its size in pixels and its numbers.
    pub(super) fn decode(
        &mut self,
        path: &Path,
        file: &File,
        chunk: u32,
        most: [usize; 2],
    ) -> Result<([usize; 2], Vec<u8>), SourceError> {
        let most_bytes = self.row_bytes(most[0]).saturating_mul(most[1]);
        if most_bytes > CHUNK_LIMIT_BYTES {
            return Err(refusal(path, tiff::TiffError::LimitsExceeded));
        }
        let encoded = self.encoded(path, file, chunk, most_bytes)?;
        let row_bytes = self.row_bytes(most[0]);
        let decoded = match &mut self.coding {
            Coding::Jpeg { tables } => jpeg(&encoded, tables, self.photometric, self.page, most),
            Coding::Zstd { decompressor, predictor } => unpacked_zstd(decompressor, &encoded, most_bytes)
                .and_then(|bytes| self.page.unpredicted(bytes, row_bytes, (*predictor, self.endian))),
        };
        let (size, mut numbers) = decoded.map_err(|found| {
            let expected = format!("at most {} x {} of {}", most[0], most[1], self.page);
            SourceError::invalid(path, format!("compressed chunk {chunk}"), expected, found)
        })?;
        if self.photometric == WHITE_IS_ZERO {
            self.page.turn_round(path, &mut numbers)?;
        }
        Ok((size.unwrap_or([most[0], numbers.len() / row_bytes.max(1)]), numbers))
    }

    /// Bytes of `width` pixels of a row.
    fn row_bytes(&self, width: usize) -> usize {
        match self.page.packing {
            Packing::Bits => width.div_ceil(8),
            _ => width.saturating_mul(self.page.piece_bytes()),
        }
    }

    /// A chunk as stored in the file.
    fn encoded(&self, path: &Path, file: &File, chunk: u32, most_bytes: usize) -> Result<Vec<u8>, SourceError> {
        let (offset, length) = match (self.offsets.get(chunk as usize), self.lengths.get(chunk as usize)) {
            (Some(offset), Some(length)) => (*offset, *length),
            _ => return Err(SourceError::invalid(path, format!("chunk {chunk}"), "its place and length", "none")),
        };
        let end = file.len().map_err(|e| SourceError::io(path, e))?;
        let limit = most_bytes.saturating_mul(2).saturating_add(ENCODED_OVERHEAD_BYTES) as u64;
        if offset.checked_add(length).is_none_or(|ends| ends > end) || length > limit {
            let expected = format!("at most {limit} bytes inside a file of {end}");
            let found = format!("{length} bytes at byte {offset}");
            return Err(SourceError::invalid(path, format!("compressed chunk {chunk}"), expected, found));
        }
        let mut encoded = vec![0; index(length)];
        file.read_exact_at(offset, &mut encoded).map_err(|e| SourceError::io(path, e))?;
        Ok(encoded)
    }
}

/// Decompresses a zstd chunk to at most `most` bytes. The buffer grows beyond its likely size only when the data have
/// filled it.
fn unpacked_zstd(
    decompressor: &mut zstd::bulk::Decompressor<'_>,
    encoded: &[u8],
    most: usize,
) -> Result<Vec<u8>, String> {
    let mut capacity = most.min(encoded.len().saturating_mul(ZSTD_RATIO_LIKELY).saturating_add(SMALL_BYTES));
    loop {
        match decompressor.decompress(encoded, capacity) {
            Ok(bytes) => return Ok(bytes),
            Err(e) if capacity < most && e.to_string().contains(ZSTD_WANTS_MORE) => {
                capacity = most.min(capacity.saturating_mul(ZSTD_GROWTH));
            }
            Err(e) => return Err(e.to_string()),
        }
    }
}

/// Bytes that all chunks of a page begin with: its tables without their end mark, or the start mark of an image.
fn tables<R: Read + Seek>(path: &Path, decoder: &mut Decoder<R>) -> Result<Vec<u8>, SourceError> {
    let Some(value) = decoder.find_tag(Tag::JPEGTables).map_err(|e| refusal(path, e))? else {
        return Ok(JPEG_START.to_vec());
    };
    let mut tables = value.into_u8_vec().map_err(|e| refusal(path, e))?;
    if !tables.starts_with(&JPEG_START) || !tables.ends_with(&JPEG_END) || tables.len() > TABLES_LIMIT_BYTES {
        let found = format!("{} bytes, of other marks or too many", tables.len());
        return Err(SourceError::invalid(path, "tables of JPEG (tag 347)", "tables between two marks", found));
    }
    tables.truncate(tables.len() - JPEG_END.len());
    Ok(tables)
}

/// Size in pixels and numbers of a chunk; `None` if the size follows from the bytes. An error describes the found data.
type Decoded = Result<(Option<[usize; 2]>, Vec<u8>), String>;

/// Decodes one JPEG image, which may have fewer rows than its chunk.
fn jpeg(encoded: &[u8], tables: &[u8], photometric: u64, page: Page, most: [usize; 2]) -> Decoded {
    let words = |e: jpeg_decoder::Error| e.to_string();
    let own = encoded.strip_prefix(&JPEG_START).ok_or("no image by JPEG")?;
    let mut decoder = jpeg_decoder::Decoder::new(tables.chain(own));
    let is_jfif = encoded.get(JFIF_AT..).is_some_and(|rest| rest.starts_with(b"JFIF"));
    match photometric {
        YCBCR => decoder.set_color_transform(ColorTransform::YCbCr),
        // A JFIF image is luma and chroma, whatever the page says.
        RGB if is_jfif => {}
        _ if page.piece_bytes() == 3 => decoder.set_color_transform(ColorTransform::RGB),
        _ => {}
    }
    decoder.read_info().map_err(words)?;
    let info = decoder.info().ok_or("no header")?;
    let size = [info.width, info.height].map(usize::from);
    let expected = match (page.piece_bytes(), page.stored()) {
        (1, VoxelType::U8) => PixelFormat::L8,
        (2, VoxelType::U16) => PixelFormat::L16,
        (3, VoxelType::U8) => PixelFormat::RGB24,
        _ => return Err(format!("pixels by JPEG ({:?})", info.pixel_format)),
    };
    if size[0] != most[0] || size[1] > most[1] || info.pixel_format != expected {
        return Err(format!("{} x {} of {:?}", size[0], size[1], info.pixel_format));
    }
    let bytes = size[0] * size[1] * page.piece_bytes();
    decoder.set_max_decoding_buffer_size(bytes);
    let mut numbers = decoder.decode().map_err(words)?;
    if numbers.len() != bytes {
        return Err(format!("{} bytes", numbers.len()));
    }
    if cfg!(target_endian = "big") {
        swap_bytes(&mut numbers, page.stored().bytes());
    }
    Ok((Some(size), numbers))
}

impl Predictor {
    fn of(path: &Path, code: u64, page: Page) -> Result<Self, SourceError> {
        let is_float = matches!(page.number, Number::Half | Number::Voxel(VoxelType::F32 | VoxelType::F64));
        match code {
            1 => Ok(Self::None),
            2 if page.packing != Packing::Bits => Ok(Self::Horizontal),
            3 if is_float => Ok(Self::FloatingPoint),
            _ => {
                let expected = "1, 2 or, of floats, 3";
                Err(SourceError::invalid(path, "predictor (tag 317)", expected, format!("{code}, of {page}")))
            }
        }
    }
}

impl Page {
    /// Bytes of a pixel in a chunk.
    pub(super) fn piece_bytes(self) -> usize {
        self.pixel_bytes() / index(self.planes())
    }

    /// Reverses predictor and byte order; returns whole rows of little-endian numbers.
    fn unpredicted(self, mut bytes: Vec<u8>, row_bytes: usize, (predictor, endian): (Predictor, Endian)) -> Decoded {
        let (size, samples) = (self.stored().bytes(), index(self.samples / self.planes()));
        if row_bytes == 0 || bytes.is_empty() || !bytes.len().is_multiple_of(row_bytes) {
            return Err(format!("{} bytes, where rows have {row_bytes}", bytes.len()));
        }
        // The float predictor has its own byte order.
        if endian == Endian::Big && predictor != Predictor::FloatingPoint {
            swap_bytes(&mut bytes, size);
        }
        match predictor {
            Predictor::None => {}
            Predictor::Horizontal => bytes.chunks_exact_mut(row_bytes).for_each(|row| sum_up(row, samples, size)),
            Predictor::FloatingPoint => {
                bytes.chunks_exact_mut(row_bytes).for_each(|row| put_together(row, samples, size));
            }
        }
        Ok((None, bytes))
    }

    /// Inverts the numbers of a white-is-zero page, so that greater is brighter.
    fn turn_round(self, path: &Path, numbers: &mut [u8]) -> Result<(), SourceError> {
        let is_unsigned = match self.number {
            Number::Voxel(voxel_type) => matches!(voxel_type, VoxelType::U8 | VoxelType::U16 | VoxelType::U32),
            Number::Whole { signed } => !signed,
            Number::Half => false,
        };
        if !is_unsigned || self.samples > 1 {
            let what = format!("zero is white, in {self}");
            return Err(SourceError::unsupported(path, what, BY_PYTHON));
        }
        numbers.iter_mut().for_each(|byte| *byte = !*byte);
        Ok(())
    }
}

/// Adds to each number of a row the previous one of the same sample (TIFF 6.0, section 14).
fn sum_up(row: &mut [u8], samples: usize, size: usize) {
    match size {
        1 => sums::<1>(row, samples, |a, b| [a[0].wrapping_add(b[0])]),
        2 => sums(row, samples, |a, b| u16::from_le_bytes(a).wrapping_add(u16::from_le_bytes(b)).to_le_bytes()),
        4 => sums(row, samples, |a, b| u32::from_le_bytes(a).wrapping_add(u32::from_le_bytes(b)).to_le_bytes()),
        _ => sums(row, samples, |a, b| u64::from_le_bytes(a).wrapping_add(u64::from_le_bytes(b)).to_le_bytes()),
    }
}

fn sums<const N: usize>(row: &mut [u8], samples: usize, add: impl Fn([u8; N], [u8; N]) -> [u8; N]) {
    let numbers = row.as_chunks_mut::<N>().0;
    for i in samples..numbers.len() {
        numbers[i] = add(numbers[i], numbers[i - samples]);
    }
}

/// Reverses the float predictor: byte differences; the highest bytes of all numbers of a row come first (Adobe, TIFF
/// technical note 3).
fn put_together(row: &mut [u8], samples: usize, size: usize) {
    sums::<1>(row, samples, |a, b| [a[0].wrapping_add(b[0])]);
    let (planes, count) = (row.to_vec(), row.len() / size);
    for (i, number) in row.chunks_exact_mut(size).enumerate() {
        number.iter_mut().rev().enumerate().for_each(|(plane, byte)| *byte = planes[plane * count + i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_summed_up_by_kind_and_width() {
        let mut row = [1, 10, 1, 10, 255, 0];
        sum_up(&mut row, 2, 1);
        assert_eq!(row, [1, 10, 2, 20, 1, 20]);
        let mut row = [0x00ffu16, 1, 0xffff].map(u16::to_le_bytes);
        sum_up(row.as_flattened_mut(), 1, 2);
        assert_eq!(row.map(u16::from_le_bytes), [0x00ff, 0x0100, 0x00ff]);
    }

    #[test]
    fn floats_are_put_together_of_their_bytes() {
        let values = [1.5f32, -2.25, 1e-3];
        let mut planes: Vec<u8> = (0..4).flat_map(|byte| values.map(|v| v.to_be_bytes()[byte])).collect();
        for i in (1..planes.len()).rev() {
            planes[i] = planes[i].wrapping_sub(planes[i - 1]);
        }
        put_together(&mut planes, 1, 4);
        assert_eq!(planes, values.map(f32::to_le_bytes).as_flattened());
    }

    #[test]
    fn zeros_by_zstd_get_room_as_they_need_it() {
        let mut decompressor = zstd::bulk::Decompressor::new().unwrap();
        let zeros = vec![0; 40 << 20];
        let encoded = zstd::bulk::compress(&zeros, 3).unwrap();
        assert!(encoded.len() * ZSTD_RATIO_LIKELY * ZSTD_GROWTH < zeros.len());
        assert!(unpacked_zstd(&mut decompressor, &encoded, zeros.len()).unwrap() == zeros);
        let message = unpacked_zstd(&mut decompressor, &encoded, zeros.len() - 1).unwrap_err();
        assert!(message.contains(ZSTD_WANTS_MORE), "{message}");
    }

    #[test]
    fn compressions_that_are_not_read_say_what_converts_them() {
        for (code, words) in [(6, "old style"), (34_925, "LZMA"), (50_001, "WebP"), (33_005, "JPEG 2000"), (9, "9")] {
            let message = Compression::of(Path::new("a.tif"), code).unwrap_err().to_string();
            assert!(message.contains(words) && message.contains("rewrite it first"), "{message}");
        }
        assert_eq!(Compression::of(Path::new("a.tif"), 50_000).unwrap(), Compression::Zstd);
    }
}
