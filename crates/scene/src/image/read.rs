//! Pictures read back from files, with the records that they carry ([`RECORD_KEY`]).
//!
//! Files are untrusted. Sizes are checked before memory is taken: at most [`RAY_LIMIT`] pixels, and a record of at most
//! [`RECORD_LIMIT_BYTES`].

use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::stored::{StoredPicture, StoredPixels, record_path};
use super::{ImageFormat, RECORD_KEY};
use crate::scene::RAY_LIMIT;

/// Longest record that is read, in bytes.
pub const RECORD_LIMIT_BYTES: u64 = 16 << 20;
/// Longest header of a NumPy file that is read, in bytes.
const NPY_HEADER_LIMIT: usize = 4096;

/// First bytes of the formats.
const MAGICS: [(&[u8], ImageFormat); 3] = [
    (b"\x89PNG\r\n\x1a\n", ImageFormat::Png),
    (b"\x76\x2f\x31\x01", ImageFormat::Exr),
    (b"\x93NUMPY\x01\x00", ImageFormat::Npy),
];

/// Reason why a picture was not read.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum StoredError {
    #[error("{path}: {source}")]
    Io { path: PathBuf, source: std::io::Error },
    #[error("{path}: expected a picture (.png, .exr, or .npy as `supervol render` writes it), found another file")]
    NoPicture { path: PathBuf },
    #[error("{path}: the picture is cut short or damaged: {message}")]
    Damaged { path: PathBuf, message: String },
    #[error("{path}: expected {expected}, found {found}")]
    Kind { path: PathBuf, expected: String, found: String },
}

/// Whether a file is a picture in one of the formats, by its first bytes.
#[must_use]
pub fn is_picture(path: &Path) -> bool {
    supervol_format::byte_source::check_is_file(path).is_ok()
        && File::open(path).is_ok_and(|mut file| format_of(&mut file).is_ok_and(|format| format.is_some()))
}

impl StoredPicture {
    /// Reads a picture and its record.
    ///
    /// # Errors
    /// If the file cannot be read, is no picture, is damaged, or is too large.
    pub fn read(path: &Path) -> Result<Self, StoredError> {
        let reading = Reading { path };
        supervol_format::byte_source::check_is_file(path).map_err(|source| reading.io(source))?;
        let mut file = File::open(path).map_err(|source| reading.io(source))?;
        let format = format_of(&mut file).map_err(|source| reading.io(source))?;
        let mut file = BufReader::new(file);
        match format {
            None => Err(StoredError::NoPicture { path: path.into() }),
            Some(ImageFormat::Png) => reading.png(file),
            Some(ImageFormat::Exr) => reading.exr(),
            Some(ImageFormat::Npy) => reading.npy(&mut file),
        }
    }
}

/// Format by the first bytes; the file is at its start afterwards.
fn format_of(file: &mut File) -> std::io::Result<Option<ImageFormat>> {
    let mut start = Vec::new();
    file.by_ref().take(8).read_to_end(&mut start)?;
    file.seek(SeekFrom::Start(0))?;
    Ok(MAGICS.into_iter().find(|(magic, _)| start.starts_with(magic)).map(|(_, format)| format))
}

/// A file that is read; names it in errors.
struct Reading<'a> {
    path: &'a Path,
}

impl Reading<'_> {
    fn io(&self, source: std::io::Error) -> StoredError {
        StoredError::Io { path: self.path.into(), source }
    }

    fn damaged(&self, message: impl ToString) -> StoredError {
        StoredError::Damaged { path: self.path.into(), message: message.to_string() }
    }

    fn kind(&self, expected: impl ToString, found: impl ToString) -> StoredError {
        StoredError::Kind { path: self.path.into(), expected: expected.to_string(), found: found.to_string() }
    }

    /// Size of a picture with a bounded number of pixels.
    fn size(&self, [width, height]: [usize; 2]) -> Result<[u32; 2], StoredError> {
        let pixels = (width as u64).saturating_mul(height as u64);
        match (u32::try_from(width), u32::try_from(height)) {
            (Ok(width), Ok(height)) if (1..=RAY_LIMIT).contains(&pixels) => Ok([width, height]),
            _ => Err(self.kind(format!("1 to {RAY_LIMIT} pixels"), format!("{width} x {height}"))),
        }
    }

    fn png(&self, file: impl std::io::BufRead + Seek) -> Result<StoredPicture, StoredError> {
        let mut decoder = png::Decoder::new(file);
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().map_err(|e| self.damaged(e))?;
        let size = self.size([reader.info().width as usize, reader.info().height as usize])?;
        let (color, depth) = reader.output_color_type();
        if depth != png::BitDepth::Eight {
            return Err(self.kind("8 bits a channel", format!("{depth:?}")));
        }
        let bytes = reader.output_buffer_size().ok_or_else(|| self.kind("a picture that fits into memory", "none"))?;
        let mut stored = vec![0; bytes];
        reader.next_frame(&mut stored).map_err(|e| self.damaged(e))?;
        // The record lies behind the pixels.
        reader.finish().map_err(|e| self.damaged(e))?;
        let opaque = |alpha: u8| if alpha == u8::MAX { Ok(()) } else { Err(self.kind("opaque pixels", "others")) };
        let pixels: Result<Vec<[u8; 3]>, StoredError> = match color {
            png::ColorType::Grayscale => Ok(stored.iter().map(|&v| [v; 3]).collect()),
            png::ColorType::GrayscaleAlpha => {
                stored.as_chunks::<2>().0.iter().map(|&[v, a]| opaque(a).map(|()| [v; 3])).collect()
            }
            png::ColorType::Rgba => {
                stored.as_chunks::<4>().0.iter().map(|&[r, g, b, a]| opaque(a).map(|()| [r, g, b])).collect()
            }
            png::ColorType::Rgb => Ok(stored.as_chunks::<3>().0.to_vec()),
            png::ColorType::Indexed => Err(self.kind("a palette that is expanded", "indices")),
        };
        let record = self.png_record(reader.info())?;
        Ok(StoredPicture { format: ImageFormat::Png, size, pixels: StoredPixels::Rgb8(pixels?), record })
    }

    /// Record in a text chunk of any kind: programs that save a PNG anew may change the kind.
    fn png_record(&self, info: &png::Info<'_>) -> Result<Option<String>, StoredError> {
        let limit = usize::try_from(RECORD_LIMIT_BYTES).unwrap_or(usize::MAX);
        let found = if let Some(chunk) = info.utf8_text.iter().find(|chunk| chunk.keyword == RECORD_KEY) {
            let mut chunk = chunk.clone();
            Some(chunk.decompress_text_with_limit(limit).and_then(|()| chunk.get_text()))
        } else if let Some(chunk) = info.compressed_latin1_text.iter().find(|chunk| chunk.keyword == RECORD_KEY) {
            let mut chunk = chunk.clone();
            Some(chunk.decompress_text_with_limit(limit).and_then(|()| chunk.get_text()))
        } else {
            let chunk = info.uncompressed_latin1_text.iter().find(|chunk| chunk.keyword == RECORD_KEY);
            chunk.map(|chunk| Ok(chunk.text.clone()))
        };
        found.transpose().map_err(|e| self.damaged(e))?.map(|text| self.bounded(text)).transpose()
    }

    fn bounded(&self, record: String) -> Result<String, StoredError> {
        if record.len() as u64 <= RECORD_LIMIT_BYTES {
            return Ok(record);
        }
        let expected = format!("a record of at most {RECORD_LIMIT_BYTES} bytes");
        Err(self.kind(expected, format!("{} bytes", record.len())))
    }

    fn exr(&self) -> Result<StoredPicture, StoredError> {
        use exr::prelude::{AttributeValue, Text};
        let open = || File::open(self.path).map(BufReader::new).map_err(|source| self.io(source));
        let meta = exr::meta::MetaData::read_from_buffered(open()?, false).map_err(|e| self.damaged(e))?;
        let [header] = &meta.headers[..] else {
            return Err(self.kind("one layer", format!("{}", meta.headers.len())));
        };
        let size = self.size([header.layer_size.width(), header.layer_size.height()])?;
        let read = exr::prelude::read_first_rgba_layer_from_file(
            self.path,
            |size, _| (size.width(), vec![[0.0f32; 4]; size.width() * size.height()]),
            |(width, pixels), at, (r, g, b, a): (f32, f32, f32, f32)| pixels[at.y() * *width + at.x()] = [r, g, b, a],
        );
        let read = read.map_err(|e| self.damaged(e))?;
        let record = match read.layer_data.attributes.other.get(&Text::from(RECORD_KEY)) {
            Some(AttributeValue::Text(text)) => Some(self.bounded(text.to_string())?),
            _ => None,
        };
        let pixels = StoredPixels::Floats(read.layer_data.channel_data.pixels.1);
        Ok(StoredPicture { format: ImageFormat::Exr, size, pixels, record })
    }

    fn npy(&self, file: &mut impl Read) -> Result<StoredPicture, StoredError> {
        let mut start = [0; 10];
        file.read_exact(&mut start).map_err(|e| self.damaged(e))?;
        let length = usize::from(u16::from_le_bytes([start[8], start[9]]));
        if length > NPY_HEADER_LIMIT {
            return Err(self.kind(format!("a header of at most {NPY_HEADER_LIMIT} bytes"), length));
        }
        let mut header = vec![0; length];
        file.read_exact(&mut header).map_err(|e| self.damaged(e))?;
        let header = String::from_utf8_lossy(&header);
        let expected = "float32 of shape (height, width, 4) in C order";
        let shape = header.split_once("'shape': (").and_then(|(_, rest)| rest.split_once(')'));
        let sizes: Option<Vec<usize>> = shape.and_then(|(s, _)| s.split(',').map(|n| n.trim().parse().ok()).collect());
        let Some([height, width, 4]) = sizes.as_deref() else { return Err(self.kind(expected, header.trim())) };
        if !header.contains("'descr': '<f4'") || !header.contains("'fortran_order': False") {
            return Err(self.kind(expected, header.trim()));
        }
        let size = self.size([*width, *height])?;
        let mut pixels = Vec::new();
        let mut row = vec![0; 16 * width];
        for _ in 0..*height {
            file.read_exact(&mut row).map_err(|e| self.damaged(e))?;
            let channel = |bytes: &[u8; 16], c: usize| f32::from_le_bytes(std::array::from_fn(|i| bytes[4 * c + i]));
            pixels.extend(row.as_chunks::<16>().0.iter().map(|bytes| [0, 1, 2, 3].map(|c| channel(bytes, c))));
        }
        let record = self.npy_record()?;
        Ok(StoredPicture { format: ImageFormat::Npy, size, pixels: StoredPixels::Floats(pixels), record })
    }

    /// The record beside a NumPy file.
    fn npy_record(&self) -> Result<Option<String>, StoredError> {
        let path = record_path(self.path);
        let file = match supervol_format::byte_source::check_is_file(&path).and_then(|()| File::open(&path)) {
            Ok(file) => file,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(StoredError::Io { path, source }),
        };
        let mut text = String::new();
        let read = file.take(RECORD_LIMIT_BYTES + 1).read_to_string(&mut text);
        read.map_err(|source| StoredError::Io { path, source })?;
        self.bounded(text).map(Some)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;

    fn image() -> Image {
        let pixels = (0..35).map(|i| [0.02 * i as f32, 0.5, 0.01 * i as f32, 0.9]).collect();
        Image { width: 7, height: 5, pixels }
    }

    /// A picture with a record of its checksum, in a file of this name.
    fn written(folder: &Path, name: &str) -> PathBuf {
        let path = folder.join(name);
        image().write_with(&path, [0.2; 3], Some(&|sum| format!("{{\"sum\":\"{sum:016x}\"}}"))).unwrap();
        path
    }

    #[test]
    fn pictures_come_back_with_their_records_in_every_format() {
        let folder = tempfile::tempdir().unwrap();
        for (name, format) in [("a.png", ImageFormat::Png), ("a.exr", ImageFormat::Exr), ("a.npy", ImageFormat::Npy)] {
            let path = written(folder.path(), name);
            let sum = image().stored_checksum(format, [0.2; 3]);
            if format == ImageFormat::Npy {
                assert_eq!(StoredPicture::read(&path).unwrap().record, None);
                std::fs::write(record_path(&path), format!("{{\"sum\":\"{sum:016x}\"}}")).unwrap();
            }
            let stored = StoredPicture::read(&path).unwrap();
            assert_eq!((stored.format, stored.size, stored.checksum()), (format, [7, 5], sum), "{name}");
            assert_eq!(stored.record.as_deref(), Some(&*format!("{{\"sum\":\"{sum:016x}\"}}")), "{name}");
            match stored.pixels {
                StoredPixels::Rgb8(pixels) => assert_eq!(pixels.as_flattened(), image().to_rgb8([0.2; 3])),
                StoredPixels::Floats(pixels) => assert_eq!(pixels, image().pixels),
            }
            assert!(is_picture(&path));
        }
    }

    #[test]
    fn the_same_picture_gives_the_same_bytes_and_a_record_changes_no_pixel() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.png", "a.exr"] {
            let [one, other] = [0, 1].map(|_| std::fs::read(written(folder.path(), name)).unwrap());
            assert!(one == other, "{name}");
            let plain = folder.path().join(format!("plain-{name}"));
            image().write(&plain, [0.2; 3]).unwrap();
            let [with, without] = [folder.path().join(name), plain].map(|path| StoredPicture::read(&path).unwrap());
            assert_eq!((&with.pixels, without.record), (&without.pixels, None), "{name}");
        }
    }

    #[test]
    fn every_file_that_is_cut_short_or_is_none_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.png", "a.exr", "a.npy"] {
            let bytes = std::fs::read(written(folder.path(), name)).unwrap();
            let cut = folder.path().join(format!("cut-{name}"));
            for length in (0..bytes.len()).step_by(bytes.len() / 40) {
                std::fs::write(&cut, &bytes[..length]).unwrap();
                assert!(StoredPicture::read(&cut).is_err(), "{length} of {} bytes of {name}", bytes.len());
            }
        }
        let text = folder.path().join("a.txt");
        std::fs::write(&text, "no picture").unwrap();
        assert!(matches!(StoredPicture::read(&text), Err(StoredError::NoPicture { .. })) && !is_picture(&text));
        assert!(matches!(StoredPicture::read(folder.path()), Err(StoredError::Io { .. })));
    }

    /// Bytes from outside: any of them may be wrong, and reading ends with a picture or an error.
    #[test]
    fn damaged_files_do_no_harm() {
        let folder = tempfile::tempdir().unwrap();
        let mut random = supervol_format::random::Random::new(7);
        for name in ["a.png", "a.exr", "a.npy"] {
            let bytes = std::fs::read(written(folder.path(), name)).unwrap();
            let damaged = folder.path().join(format!("damaged-{name}"));
            for _ in 0..300 {
                let mut bytes = bytes.clone();
                for _ in 0..1 + random.below(3) {
                    let at = random.below(bytes.len() as u64) as usize;
                    bytes[at] = random.below(256) as u8;
                }
                std::fs::write(&damaged, bytes).unwrap();
                drop(StoredPicture::read(&damaged));
            }
        }
    }
}
