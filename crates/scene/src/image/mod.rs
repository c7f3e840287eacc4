//! Images: premultiplied RGBA without the background, and image files (RENDERING-MODEL, section 10).
//!
//! Row 0 is the top row; x runs fastest. A file is written under a temporary name in the same folder and then renamed.
//! So a file with the image's name is always complete.

use supervol_format::cast::{single, whole};
use supervol_format::container::checksum;

pub mod enlarge;
#[cfg(feature = "images")]
pub mod read;
pub mod stored;

#[cfg(feature = "images")]
use std::io::{BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

/// Grey levels of full scale in an 8-bit channel.
pub const GREY_LEVELS: f64 = 255.0;

/// The greatest magnitude of some numbers; 0 if there are none. NaN counts as infinite: `f64::max` ignores NaN, so that
/// a picture full of NaN would satisfy every bound.
#[must_use]
pub fn greatest(sizes: impl IntoIterator<Item = f64>) -> f64 {
    sizes.into_iter().map(|v| if v.is_nan() { f64::INFINITY } else { v.abs() }).fold(0.0, f64::max)
}

/// A picture before the background is added.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Pixels along x.
    pub width: u32,
    /// Pixels along y.
    pub height: u32,
    /// Premultiplied red, green, blue, and alpha; row by row from the top.
    pub pixels: Vec<[f32; 4]>,
}

/// File formats of images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageFormat {
    /// 8 bit RGB, background added.
    Png,
    /// OpenEXR, 32-bit float, premultiplied RGBA without the background.
    Exr,
    /// NumPy array, float32, shape (height, width, 4), premultiplied RGBA without the background.
    Npy,
}

/// Key of the record in a PNG text chunk and an EXR attribute.
pub const RECORD_KEY: &str = "supervol";

/// The text of a picture's record (ASCII), from the checksum of its stored pixels ([`Image::stored_checksum`]).
pub type RecordText<'a> = &'a dyn Fn(u64) -> String;

/// Reason why an image was not written.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum ImageError {
    #[error("{path}: expected a name that ends in .png, .exr or .npy")]
    Format { path: PathBuf },
    #[error("{path}: {source}")]
    Io { path: PathBuf, source: std::io::Error },
    #[error("{path}: the picture cannot be encoded: {message}")]
    Encode { path: PathBuf, message: String },
}

impl ImageFormat {
    /// All formats.
    pub const ALL: [Self; 3] = [Self::Png, Self::Exr, Self::Npy];

    /// File name extension, without the dot.
    #[must_use]
    pub fn ending(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Exr => "exr",
            Self::Npy => "npy",
        }
    }

    /// The format of a file name, by its extension.
    ///
    /// # Errors
    /// If the extension is not known.
    pub fn from_path(path: &Path) -> Result<Self, ImageError> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        let format = Self::ALL.into_iter().find(|format| format.ending() == extension);
        format.ok_or_else(|| ImageError::Format { path: path.into() })
    }
}

impl Image {
    /// The image made smaller: each pixel is the mean of a block of `factor` x `factor` pixels.
    ///
    /// # Panics
    /// If width or height is no multiple of `factor`.
    #[must_use]
    pub fn downsampled(self, factor: u32) -> Self {
        if factor == 1 {
            return self;
        }
        assert!(
            factor > 0 && self.width.is_multiple_of(factor) && self.height.is_multiple_of(factor),
            "{} x {} pixels are no whole number of blocks of {factor}",
            self.width,
            self.height
        );
        let (width, height) = (self.width / factor, self.height / factor);
        let mut pixels = Vec::with_capacity(width as usize * height as usize);
        for y in 0..height {
            for x in 0..width {
                let mut sum = [0.0f64; 4];
                for row in 0..factor {
                    let first = ((y * factor + row) as usize) * self.width as usize + (x * factor) as usize;
                    for pixel in &self.pixels[first..first + factor as usize] {
                        (0..4).for_each(|c| sum[c] += f64::from(pixel[c]));
                    }
                }
                pixels.push(sum.map(|s| single(s / f64::from(factor * factor))));
            }
        }
        Self { width, height, pixels }
    }

    /// A picture of unknown pixels: all channels are NaN.
    #[must_use]
    pub fn unknown([width, height]: [u32; 2]) -> Self {
        Self { width, height, pixels: vec![[f32::NAN; 4]; width as usize * height as usize] }
    }

    /// Writes a band over the rows from `first_row` on and skips its NaN pixels. Returns the number of pixels written.
    ///
    /// # Panics
    /// If the band is not as wide as the picture, or reaches beyond its last row.
    pub fn write_over(&mut self, first_row: u32, band: &Self) -> u64 {
        assert_eq!(self.width, band.width, "pixels along x");
        let first = first_row as usize * self.width as usize;
        let mut written = 0;
        for (pixel, new) in self.pixels[first..first + band.pixels.len()].iter_mut().zip(&band.pixels) {
            if !new[0].is_nan() {
                *pixel = *new;
                written += 1;
            }
        }
        written
    }

    /// Whether every channel of every pixel is a finite number.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.pixels.as_flattened().iter().all(|v| v.is_finite())
    }

    /// Greatest difference of any channel in grey levels (1/255); infinite if a channel of either picture is not
    /// finite.
    ///
    /// # Panics
    /// If the pictures differ in size.
    #[must_use]
    pub fn distance(&self, other: &Self) -> f64 {
        self.distance_where(other, |_| true)
    }

    /// As [`Image::distance`], over the pixels whose index `is_judged` accepts. Channels that are not finite count in
    /// all pixels.
    ///
    /// # Panics
    /// If the pictures differ in size.
    #[must_use]
    pub fn distance_where(&self, other: &Self, is_judged: impl Fn(usize) -> bool) -> f64 {
        assert_eq!((self.width, self.height), (other.width, other.height), "sizes of two pictures to compare");
        if !self.is_finite() || !other.is_finite() {
            return f64::INFINITY;
        }
        let judged = self.pixels.iter().zip(&other.pixels).enumerate().filter(|&(i, _)| is_judged(i));
        greatest(judged.flat_map(|(_, (p, q))| [0, 1, 2, 3].map(|c| GREY_LEVELS * f64::from((p[c] - q[c]).abs()))))
    }

    /// 8-bit RGB over a background: `round(255 * clamp(C + (1 - A) * background, 0, 1))`.
    #[must_use]
    pub fn to_rgb8(&self, background: [f64; 3]) -> Vec<u8> {
        rgb8(&self.pixels, background)
    }

    /// Writes the image; the extension of the name gives the format. An existing file is replaced.
    ///
    /// # Errors
    /// If the name has no known extension, or the file cannot be written; no partial file stays behind.
    #[cfg(feature = "images")]
    pub fn write(&self, path: &Path, background: [f64; 3]) -> Result<(), ImageError> {
        self.write_with(path, background, None)
    }

    /// The same with a record, which `.npy` does not hold.
    ///
    /// # Errors
    /// As [`Self::write`].
    #[cfg(feature = "images")]
    pub fn write_with(
        &self,
        path: &Path,
        background: [f64; 3],
        record: Option<RecordText<'_>>,
    ) -> Result<(), ImageError> {
        let format = ImageFormat::from_path(path)?;
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let write = || {
            let mut builder = tempfile::Builder::new();
            // The usual permissions of new files: the process's umask applies.
            #[cfg(unix)]
            builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
            // Not the prefix of unfinished output files: this file is not locked and would be taken for a leftover.
            let mut file = builder.prefix(".supervol-").suffix(".picture").tempfile_in(folder)?;
            self.encode_with(format, background, record, file.as_file_mut())?;
            file.as_file().sync_all()?;
            file.persist(path).map_err(|e| e.error)?;
            Ok(())
        };
        write().map_err(|failure| match failure {
            EncodeError::Io(source) => ImageError::Io { path: path.into(), source },
            EncodeError::Encode(message) => ImageError::Encode { path: path.into(), message },
        })
    }

    /// Writes the bytes of an image file to `out`.
    ///
    /// # Errors
    /// If `out` fails, or the format cannot hold the picture.
    #[cfg(feature = "images")]
    pub fn encode(
        &self,
        format: ImageFormat,
        background: [f64; 3],
        out: &mut (impl Write + Seek),
    ) -> Result<(), EncodeError> {
        self.encode_with(format, background, None, out)
    }

    /// The same with a record: a text chunk of PNG, an attribute of OpenEXR. NumPy files hold no text; their record is a
    /// file of its own.
    ///
    /// # Errors
    /// As [`Self::encode`].
    #[cfg(feature = "images")]
    pub fn encode_with(
        &self,
        format: ImageFormat,
        background: [f64; 3],
        record: Option<RecordText<'_>>,
        out: &mut (impl Write + Seek),
    ) -> Result<(), EncodeError> {
        let mut out = BufWriter::new(out);
        match format {
            ImageFormat::Png => self.encode_png(&mut out, background, record)?,
            ImageFormat::Exr => self.encode_exr(&mut out, record)?,
            ImageFormat::Npy => self.encode_npy(&mut out)?,
        }
        Ok(out.flush()?)
    }

    /// Checksum of the pixels as a file of this format stores them: the XXH3-64 of the XXH3-64s of all rows, eight
    /// bytes each. A row of PNG is its red, green and blue bytes; a row of the others is its floats, little endian.
    #[must_use]
    pub fn stored_checksum(&self, format: ImageFormat, background: [f64; 3]) -> u64 {
        let rows = self.pixels.chunks_exact(self.width.max(1) as usize);
        checksum_of_rows(rows.map(|row| match format {
            ImageFormat::Png => checksum(&rgb8(row, background)),
            ImageFormat::Exr | ImageFormat::Npy => float_checksum(row),
        }))
    }

    #[cfg(feature = "images")]
    fn encode_png(
        &self,
        out: &mut impl Write,
        background: [f64; 3],
        record: Option<RecordText<'_>>,
    ) -> Result<(), EncodeError> {
        let mut encoder = png::Encoder::new(out, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_compression(png::Compression::Fast);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        // Row by row: a second picture of 3 bytes per pixel would exceed the memory budget.
        let mut rows = writer.stream_writer()?;
        let mut sums = Vec::with_capacity(self.height as usize);
        for row in self.pixels.chunks_exact(self.width as usize) {
            let bytes = rgb8(row, background);
            sums.push(checksum(&bytes));
            rows.write_all(&bytes)?;
        }
        rows.finish()?;
        // Behind the pixels, because the record holds their checksum.
        if let Some(record) = record {
            writer.write_text_chunk(&png::text_metadata::ITXtChunk::new(RECORD_KEY, record(checksum_of_rows(sums))))?;
        }
        Ok(writer.finish()?)
    }

    #[cfg(feature = "images")]
    fn encode_exr(&self, out: &mut (impl Write + Seek), record: Option<RecordText<'_>>) -> Result<(), EncodeError> {
        use exr::prelude::{AttributeValue, SpecificChannels, Text, Vec2, WritableImage};
        let (width, height) = (self.width as usize, self.height as usize);
        let channels = SpecificChannels::rgba(|Vec2(x, y)| {
            let [r, g, b, a] = self.pixels[y * width + x];
            (r, g, b, a)
        });
        let mut image = exr::prelude::Image::from_channels((width, height), channels);
        if let Some(record) = record {
            let text = Text::new_or_none(record(self.stored_checksum(ImageFormat::Exr, [0.0; 3])));
            let text = text.ok_or_else(|| EncodeError::Encode("its record has letters beyond Latin-1".into()))?;
            image.layer_data.attributes.other.insert(Text::from(RECORD_KEY), AttributeValue::Text(text));
        }
        image.write().to_buffered(out).map_err(|error| match error {
            exr::error::Error::Io(source) => EncodeError::Io(source),
            other => EncodeError::Encode(other.to_string()),
        })
    }

    /// NumPy format 1.0: magic, version, header length (u16), header padded so that the data begin at a multiple of 64
    /// bytes.
    #[cfg(feature = "images")]
    fn encode_npy(&self, out: &mut impl Write) -> Result<(), EncodeError> {
        const PREFIX: usize = 10;
        let mut header =
            format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}, {}, 4), }}", self.height, self.width);
        while !(PREFIX + header.len() + 1).is_multiple_of(64) {
            header.push(' ');
        }
        header.push('\n');
        out.write_all(b"\x93NUMPY\x01\x00")?;
        out.write_all(&supervol_format::cast::narrow::<u16>(header.len()).to_le_bytes())?;
        out.write_all(header.as_bytes())?;
        for value in self.pixels.iter().flatten() {
            out.write_all(&value.to_le_bytes())?;
        }
        Ok(())
    }
}

fn checksum_of_rows(sums: impl IntoIterator<Item = u64>) -> u64 {
    let bytes: Vec<u8> = sums.into_iter().flat_map(u64::to_le_bytes).collect();
    checksum(&bytes)
}

fn float_checksum(row: &[[f32; 4]]) -> u64 {
    let bytes: Vec<u8> = row.iter().flatten().flat_map(|channel| channel.to_le_bytes()).collect();
    checksum(&bytes)
}

fn rgb8(pixels: &[[f32; 4]], background: [f64; 3]) -> Vec<u8> {
    let over = |p: &[f32; 4], c: usize| f64::from(p[c]) + (1.0 - f64::from(p[3])) * background[c];
    pixels.iter().flat_map(|p| [0, 1, 2].map(|c| whole::<u8>((255.0 * over(p, c).clamp(0.0, 1.0)).round()))).collect()
}

/// Reason why an image was not encoded.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum EncodeError {
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error("the picture cannot be encoded: {0}")]
    Encode(String),
}

#[cfg(feature = "images")]
impl From<png::EncodingError> for EncodeError {
    fn from(error: png::EncodingError) -> Self {
        match error {
            png::EncodingError::IoError(source) => Self::Io(source),
            other => Self::Encode(other.to_string()),
        }
    }
}

#[cfg(all(test, feature = "images"))]
mod tests {
    use super::*;

    #[test]
    fn only_numbers_are_written_over_a_picture() {
        let mut picture = Image { width: 2, height: 3, pixels: vec![[1.0; 4]; 6] };
        let band = Image { width: 2, height: 1, pixels: vec![[2.0; 4], [f32::NAN; 4]] };
        assert_eq!(picture.write_over(1, &band), 1);
        assert_eq!(picture.pixels.iter().map(|p| p[0]).collect::<Vec<_>>(), [1.0, 1.0, 2.0, 1.0, 1.0, 1.0]);
    }

    fn image() -> Image {
        let pixels = (0..6).map(|i| [0.1 * i as f32, 0.5, 0.0, 0.5]).collect();
        Image { width: 3, height: 2, pixels }
    }

    #[test]
    fn files_hold_what_they_should_and_no_partial_file_stays() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.png", "a.exr", "a.npy"] {
            image().write(&folder.path().join(name), [1.0, 1.0, 0.5]).unwrap();
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);

        let npy = std::fs::read(folder.path().join("a.npy")).unwrap();
        assert_eq!(&npy[..8], b"\x93NUMPY\x01\x00");
        let data = 10 + usize::from(u16::from_le_bytes([npy[8], npy[9]]));
        assert_eq!((data % 64, npy.len() - data), (0, 6 * 16));
        assert!(String::from_utf8_lossy(&npy[10..data]).contains("(2, 3, 4)"));
        assert_eq!(f32::from_le_bytes(npy[data + 16..data + 20].try_into().unwrap()), 0.1);

        let file = std::io::BufReader::new(std::fs::File::open(folder.path().join("a.png")).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut rgb).unwrap();
        assert_eq!(&rgb[3..6], &[(0.6f64 * 255.0).round() as u8, 255, 64]);

        let read = exr::prelude::read_first_rgba_layer_from_file(
            folder.path().join("a.exr"),
            |size, _| vec![[0.0f32; 4]; size.width() * size.height()],
            |pixels, at, (r, g, b, a): (f32, f32, f32, f32)| pixels[at.y() * 3 + at.x()] = [r, g, b, a],
        )
        .unwrap();
        assert_eq!(read.layer_data.channel_data.pixels, image().pixels);
    }

    #[test]
    fn unknown_names_and_folders_are_refused() {
        assert!(matches!(image().write(Path::new("a.jpg"), [0.0; 3]), Err(ImageError::Format { .. })));
        let missing = Path::new("no/such/folder/a.png");
        assert!(matches!(image().write(missing, [0.0; 3]), Err(ImageError::Io { .. })));
    }

    #[test]
    fn no_bound_holds_for_what_is_no_number() {
        assert_eq!(greatest([0.5, -2.0]), 2.0);
        assert_eq!(greatest([]), 0.0);
        for position in 0..3 {
            let mut sizes = [0.5, -2.0, 0.0];
            sizes[position] = f64::NAN;
            assert_eq!(greatest(sizes), f64::INFINITY, "{sizes:?}");
        }
        let exact = image();
        let mut other = exact.clone();
        other.pixels[4][1] += 1.0 / 255.0;
        assert!((exact.distance(&other) - 1.0).abs() < 1e-5);
        assert_eq!(exact.distance_where(&other, |i| i != 4), 0.0);
        for wrong in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            other.pixels[4][1] = wrong;
            assert_eq!(exact.distance(&other), f64::INFINITY);
            assert_eq!(other.distance(&other.clone()), f64::INFINITY, "two pictures of nothing are not the same");
            assert_eq!(other.distance_where(&exact, |i| i != 4), f64::INFINITY, "a pixel that is not judged is drawn");
        }
    }

    #[test]
    fn downsampling_takes_block_means() {
        let pixels = (0..16).map(|i| [i as f32; 4]).collect();
        let small = Image { width: 4, height: 4, pixels }.downsampled(2);
        assert_eq!(small.pixels.iter().map(|p| p[0]).collect::<Vec<_>>(), [2.5, 4.5, 10.5, 12.5]);
    }
}
