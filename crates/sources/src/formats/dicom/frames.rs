//! The pixels of one frame, uncompressed or decompressed (RLE, JPEG, JPEG 2000).
//!
//! Frames are returned as little-endian numbers, those of a pixel adjacent. A frame is decoded as a whole, and only if
//! its own header has the size that the file announces. JPEG and JPEG 2000 use the crates `jpeg-decoder` and
//! `hayro-jpeg2000`. RLE is written by hand, because the decoder of `dicom-transfer-syntax-registry` panics on damaged
//! data.

use std::fs::File;
use std::path::Path;

use hayro_jpeg2000::{DecodeSettings, DecoderContext, Image as Jpeg2000};
use jpeg_decoder::{ColorTransform, PixelFormat, UnsupportedFeature};
use supervol_format::ByteSource;

use super::data_set::{DataSet, PixelsAt};
use super::header::{FRAMES_LIMIT, Image, of_fault, open};
use super::series::Member;
use super::syntax::Compression;
use crate::cast::{self, index, low_32};
use crate::grid::dense::swap_bytes;
use crate::input::spool::SpoolFolder;
use crate::{Endian, SourceError};

/// First bytes of a JPEG 2000 codestream, and the number of bytes in which they are searched.
const CODESTREAM: &[u8] = b"\xff\x4f\xff\x51";
const CODESTREAM_WITHIN: usize = 4096;
/// Bytes of a codestream's header before the first component's description.
const SIZE_BYTES: usize = 45;
/// Largest size in bytes of a compressed frame beyond twice its pixels: headers, profiles.
const ENCODED_OVERHEAD_BYTES: u64 = 1 << 20;
/// Bytes of an RLE frame's header with the segment offsets, and their largest number.
const RLE_HEADER_BYTES: usize = 64;
const RLE_SEGMENTS: usize = 15;

impl Image {
    /// Size of a decoded frame in bytes. A single bit becomes a byte.
    pub(super) fn frame_bytes(&self) -> u64 {
        self.frame_numbers() * u64::from(self.allocated.div_ceil(8))
    }

    /// Numbers of a frame.
    fn frame_numbers(&self) -> u64 {
        u64::from(self.rows) * u64::from(self.columns) * u64::from(self.samples)
    }

    /// Whether the numbers are single bits, 0 or 1, eight to a byte.
    pub(super) fn has_bits(&self) -> bool {
        self.allocated == 1
    }

    /// Size in the file of uncompressed frames. Frames of single bits follow each other without padding.
    pub(super) fn stored_bytes(&self, frames: u64) -> u64 {
        let numbers = self.frame_numbers().saturating_mul(frames);
        if self.has_bits() { numbers.div_ceil(8) } else { numbers.saturating_mul((self.allocated / 8).into()) }
    }
}

/// The frames of one file.
pub(super) struct Frames<'a> {
    path: &'a Path,
    image: &'a Image,
    file: File,
    pixels: PixelsAt,
    compression: Compression,
    endian: Endian,
    /// Positions and lengths of the fragments, the offset table first; empty for uncompressed pixels.
    fragments: Vec<(u64, u32)>,
    count: u64,
}

impl<'a> Frames<'a> {
    pub(super) fn open(member: &'a Member, pixels: PixelsAt, spool: &SpoolFolder) -> Result<Self, SourceError> {
        let Member { path, header } = member;
        let gone = || SourceError::Changed { path: path.clone(), what: "it is no DICOM any more".into() };
        let (mut file, ..) = open(path, spool)?.ok_or_else(gone)?;
        let compression = header.syntax.compression;
        let end = file.len().map_err(|e| SourceError::io(path, e))?;
        let fragments = match compression {
            Compression::None => Vec::new(),
            _ => DataSet::new(&mut file, pixels.offset, end)
                .map_err(|e| SourceError::io(path, e))?
                .fragments(4 * index(FRAMES_LIMIT))
                .map_err(|fault| of_fault(path, fault))?,
        };
        let (endian, count) = (header.syntax.spelling.endian, header.frame_count);
        Ok(Self { path, image: &header.image, file, pixels, compression, endian, fragments, count })
    }

    /// Numbers of a frame.
    pub(super) fn read(&self, frame: u64) -> Result<Vec<u8>, SourceError> {
        let bytes = self.image.frame_bytes();
        let decoded = match self.compression {
            Compression::None if self.image.has_bits() => self.read_bits(frame),
            Compression::None => {
                let mut out = vec![0; index(bytes)];
                let at = self.pixels.offset + frame * bytes;
                self.file.read_exact_at(at, &mut out).map_err(|e| SourceError::io(self.path, e))?;
                if self.endian == Endian::Big {
                    swap_bytes(&mut out, self.image.allocated as usize / 8);
                }
                Ok(out)
            }
            Compression::Rle => rle(&self.encoded(frame)?, self.image),
            Compression::Jpeg => jpeg(&self.encoded(frame)?, self.image),
            Compression::Jpeg2000 => jpeg_2000(&self.encoded(frame)?, self.image),
            Compression::NotRead(name) => Err(format!("{name}, which is not read")),
        };
        let mut decoded = decoded.map_err(|found| {
            let Image { columns, rows, samples, allocated, .. } = self.image;
            let expected = format!("{columns} x {rows} pixels of {samples} numbers of {allocated} bits");
            SourceError::invalid(self.path, format!("compressed frame {frame}"), expected, found)
        })?;
        // Decoders return the numbers of a pixel adjacent to each other.
        if self.image.is_planar && self.image.samples > 1 && matches!(self.compression, Compression::None) {
            decoded = interleaved(&decoded, self.image);
        }
        Ok(decoded)
    }

    /// Numbers of an uncompressed frame of single bits: PS3.5, section 8.1.1. The first pixel is the lowest bit.
    fn read_bits(&self, frame: u64) -> Result<Vec<u8>, String> {
        let count = self.image.frame_numbers();
        let (first, end) = (frame * count, (frame + 1) * count);
        let mut packed = vec![0; index(end.div_ceil(8) - first / 8)];
        self.file.read_exact_at(self.pixels.offset + first / 8, &mut packed).map_err(|e| e.to_string())?;
        let bit = |at: u64| {
            let at = at - first / 8 * 8;
            packed[index(at / 8)] >> (at % 8) & 1
        };
        Ok((first..end).map(bit).collect())
    }

    /// The fragments of a frame, concatenated.
    fn encoded(&self, frame: u64) -> Result<Vec<u8>, SourceError> {
        let (Some(&(table_at, table_bytes)), data) = (self.fragments.first(), self.fragments.get(1..).unwrap_or(&[]))
        else {
            return Err(SourceError::invalid(self.path, "pixels", "fragments", "none"));
        };
        let of_frame = if self.count == 1 {
            data
        } else if data.len() as u64 == self.count {
            &data[index(frame)..=index(frame)]
        } else {
            let starts = self.starts(table_at, table_bytes)?;
            let (from, to) = (starts[index(frame)], starts.get(index(frame) + 1).copied().unwrap_or(u64::MAX));
            // Offsets count from the first fragment's item, eight bytes before its data.
            let first = data.first().map_or(0, |(at, _)| at - 8);
            let number = |offset: u64| data.iter().take_while(|(at, _)| at - 8 - first < offset).count();
            &data[number(from)..number(to).max(number(from))]
        };
        let bytes = of_frame.iter().fold(0u64, |sum, (_, length)| sum.saturating_add((*length).into()));
        let most = self.image.frame_bytes().saturating_mul(2).saturating_add(ENCODED_OVERHEAD_BYTES);
        if bytes > most {
            let found = format!("{bytes} bytes for frame {frame}");
            return Err(SourceError::invalid(self.path, "pixels", format!("at most {most} bytes"), found));
        }
        let mut out = Vec::new();
        for &(at, length) in of_frame {
            let begun = out.len();
            out.resize(begun + length as usize, 0);
            self.file.read_exact_at(at, &mut out[begun..]).map_err(|e| SourceError::io(self.path, e))?;
        }
        Ok(out)
    }

    /// Offsets of the frames, from the offset table.
    fn starts(&self, at: u64, bytes: u32) -> Result<Vec<u64>, SourceError> {
        if u64::from(bytes) != 4 * self.count {
            let expected = format!("one fragment for each of {} frames, or a table of their places", self.count);
            let found = format!("{} fragments, a table of {bytes} bytes", self.fragments.len() - 1);
            return Err(SourceError::invalid(self.path, "pixels", expected, found));
        }
        let mut table = vec![0; bytes as usize];
        self.file.read_exact_at(at, &mut table).map_err(|e| SourceError::io(self.path, e))?;
        Ok(table.as_chunks::<4>().0.iter().map(|word| u32::from_le_bytes(*word).into()).collect())
    }
}

/// Converts planes to pixels with adjacent numbers.
fn interleaved(planes: &[u8], image: &Image) -> Vec<u8> {
    let (samples, size) = (image.samples as usize, image.allocated as usize / 8);
    let pixels = planes.len() / samples / size;
    let mut out = vec![0; planes.len()];
    for (i, number) in out.chunks_exact_mut(size).enumerate() {
        let from = (i % samples * pixels + i / samples) * size;
        number.copy_from_slice(&planes[from..from + size]);
    }
    out
}

/// PS3.5, annex G: one PackBits segment for each byte of each number of a pixel, highest byte first.
fn rle(encoded: &[u8], image: &Image) -> Result<Vec<u8>, String> {
    let size = image.allocated as usize / 8;
    let wanted = image.samples as usize * size;
    let header = encoded.get(..RLE_HEADER_BYTES).ok_or("fewer bytes than a header takes")?.as_chunks::<4>().0;
    let word = |i: usize| u32::from_le_bytes(header[i]) as usize;
    if word(0) != wanted || wanted > RLE_SEGMENTS {
        return Err(format!("{} segments", word(0)));
    }
    let pixels = image.rows as usize * image.columns as usize;
    // PackBits expands by at most 64.
    if pixels > 64 * encoded.len() {
        return Err(format!("{} bytes", encoded.len()));
    }
    let mut out = vec![0; pixels * wanted];
    for segment in 0..wanted {
        let end = if segment + 1 < wanted { word(segment + 2) } else { encoded.len() };
        let packed = encoded.get(word(segment + 1)..end).ok_or("segments behind the end")?;
        let (sample, byte) = (segment / size, size - 1 - segment % size);
        let mut targets = out.iter_mut().skip(sample * size + byte).step_by(wanted);
        unpack_bits(packed, |value| targets.next().map(|target| *target = value).is_some());
        if targets.next().is_some() {
            return Err(format!("too few bytes in segment {segment}"));
        }
    }
    Ok(out)
}

/// Passes the bytes of a PackBits stream to `put` until the stream ends or `put` returns false.
fn unpack_bits(mut packed: &[u8], mut put: impl FnMut(u8) -> bool) {
    while let Some((&control, rest)) = packed.split_first() {
        packed = rest;
        let count = usize::from(control) + 1;
        let goes_on = match control {
            0..128 => {
                let literal = &packed[..count.min(packed.len())];
                packed = &packed[literal.len()..];
                literal.iter().all(|byte| put(*byte))
            }
            128 => true,
            _ => match packed.split_first() {
                None => false,
                Some((&byte, rest)) => {
                    packed = rest;
                    (0..258 - count).all(|_| put(byte))
                }
            },
        };
        if !goes_on {
            return;
        }
    }
}

/// Describes a JPEG error. For a kind that is not supported, the text names a conversion.
fn jpeg_words(error: jpeg_decoder::Error) -> String {
    let kind = match error {
        jpeg_decoder::Error::Unsupported(UnsupportedFeature::SamplePrecision(bits)) => {
            format!("JPEG with loss of {bits} bits")
        }
        jpeg_decoder::Error::Unsupported(what) => format!("JPEG of another kind ({what:?})"),
        other => return other.to_string(),
    };
    format!("{kind}, which is not read; decompress the series first, for example with `gdcmconv --raw IN OUT`")
}

fn jpeg(encoded: &[u8], image: &Image) -> Result<Vec<u8>, String> {
    let words = jpeg_words;
    let mut decoder = jpeg_decoder::Decoder::new(encoded);
    // Not `None`: with it the decoder returns the rows of each colour one after another.
    if image.photometric == "RGB" && image.samples == 3 {
        decoder.set_color_transform(ColorTransform::RGB);
    }
    decoder.read_info().map_err(words)?;
    let info = decoder.info().ok_or("no header")?;
    let samples = match info.pixel_format {
        PixelFormat::L8 | PixelFormat::L16 => 1,
        PixelFormat::RGB24 => 3,
        PixelFormat::CMYK32 => 4,
    };
    let size = if info.pixel_format == PixelFormat::L16 { 2 } else { 1 };
    let is_as_announced = u32::from(info.width) == image.columns
        && u32::from(info.height) == image.rows
        && samples == image.samples
        && size <= image.allocated / 8;
    if !is_as_announced {
        return Err(format!("{} x {} of {:?}", info.width, info.height, info.pixel_format));
    }
    let numbers = decoder.decode().map_err(words)?;
    if numbers.len() as u64 != u64::from(image.rows) * u64::from(image.columns) * u64::from(samples * size) {
        return Err(format!("{} bytes", numbers.len()));
    }
    let native =
        |number: &[u8]| if size == 2 { u16::from_ne_bytes([number[0], number[1]]).into() } else { number[0].into() };
    Ok(widened(numbers.chunks_exact(size as usize).map(native), image))
}

fn jpeg_2000(encoded: &[u8], image: &Image) -> Result<Vec<u8>, String> {
    let near = &encoded[..encoded.len().min(CODESTREAM_WITHIN)];
    let begin = near.windows(4).position(|bytes| bytes == CODESTREAM).ok_or("no codestream of JPEG 2000")?;
    let codestream = &encoded[begin..];
    let header = codestream.get(..SIZE_BYTES).ok_or("a codestream cut short")?;
    let components = u32::from(u16::from_be_bytes([header[40], header[41]]));
    let is_signed = header[42] & 0x80 != 0;
    let settings = DecodeSettings { resolve_palette_indices: false, ..DecodeSettings::default() };
    let decoder = Jpeg2000::new(codestream, &settings).map_err(|e| e.to_string())?;
    let (width, height) = (decoder.width(), decoder.height());
    if (width, height, components) != (image.columns, image.rows, image.samples) {
        return Err(format!("{width} x {height} of {components} numbers"));
    }
    let mut context = DecoderContext::default();
    let decoded = decoder.decode(&mut context).map_err(|e| e.to_string())?;
    let (planes, pixels) = (decoded.components(), width as usize * height as usize);
    if planes.len() != components as usize || planes.iter().any(|plane| plane.samples().len() != pixels) {
        return Err(format!("{} components", planes.len()));
    }
    let bits = planes.iter().map(|plane| plane.bit_depth()).max().unwrap_or_default();
    if u32::from(bits) > image.allocated {
        return Err(format!("numbers of {bits} bits"));
    }
    // The decoder adds half the range to signed numbers, too.
    let shift = if is_signed { 1i64 << (planes[0].bit_depth().clamp(1, 32) - 1) } else { 0 };
    let number = |i: usize| {
        let sample = cast::whole::<i64>(planes[i % planes.len()].samples()[i / planes.len()].round());
        low_32((sample - shift).cast_unsigned())
    };
    Ok(widened((0..pixels * planes.len()).map(number), image))
}

/// Converts numbers to the width that the file announces.
fn widened(numbers: impl Iterator<Item = u32>, image: &Image) -> Vec<u8> {
    let size = image.allocated as usize / 8;
    let mut out = Vec::with_capacity(index(image.frame_bytes()));
    numbers.for_each(|number| out.extend_from_slice(&number.to_le_bytes()[..size]));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_bits_are_unpacked_and_cut_short_without_harm() {
        let unpacked = |packed: &[u8]| {
            let mut out = Vec::new();
            unpack_bits(packed, |byte| {
                out.push(byte);
                out.len() < 100
            });
            out
        };
        assert_eq!(unpacked(&[2, 7, 8, 9, 254, 5, 128, 0, 1]), [7, 8, 9, 5, 5, 5, 1]);
        assert_eq!(unpacked(&[5, 1]), [1]);
        assert_eq!(unpacked(&[129]), [0u8; 0]);
        assert_eq!(unpacked(&[129, 3]).len(), 100);
    }
}
