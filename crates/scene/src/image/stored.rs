//! Pictures as their files hold them.

use std::path::{Path, PathBuf};

use supervol_format::container::checksum;

use super::{ImageFormat, checksum_of_rows, float_checksum};

/// A picture as its file holds it.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredPicture {
    /// Format of the file, by its first bytes.
    pub format: ImageFormat,
    /// Pixels along x and y.
    pub size: [u32; 2],
    /// The pixels, row by row from the top.
    pub pixels: StoredPixels,
    /// Text of its record, if it has one.
    pub record: Option<String>,
}

/// Pixels of a picture file.
#[derive(Debug, Clone, PartialEq)]
pub enum StoredPixels {
    /// Red, green and blue bytes over the background.
    Rgb8(Vec<[u8; 3]>),
    /// Premultiplied red, green, blue and opacity, without background.
    Floats(Vec<[f32; 4]>),
}

/// Path of the record of a NumPy picture: its name with `.json` appended.
#[must_use]
pub fn record_path(picture: &Path) -> PathBuf {
    let mut name = picture.as_os_str().to_owned();
    name.push(".json");
    name.into()
}

impl StoredPicture {
    /// Checksum of the pixels, as [`Image::stored_checksum`](super::Image::stored_checksum) computes it.
    #[must_use]
    pub fn checksum(&self) -> u64 {
        let width = self.size[0].max(1) as usize;
        match &self.pixels {
            StoredPixels::Rgb8(pixels) => {
                checksum_of_rows(pixels.chunks_exact(width).map(|row| checksum(row.as_flattened())))
            }
            StoredPixels::Floats(pixels) => checksum_of_rows(pixels.chunks_exact(width).map(float_checksum)),
        }
    }
}
