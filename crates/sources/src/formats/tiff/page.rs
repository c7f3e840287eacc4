//! Properties of a TIFF page, limits of its chunks, and the conversion of the decoder's errors.

use std::path::Path;

use supervol_format::VoxelType;
use tiff::{TiffError, TiffFormatError};

use crate::SourceError;
use crate::cast::index;
use crate::grid::elements::{Meaning, Number};

/// Largest size in bytes of a decoded strip or tile, and of a band of tiles.
pub(super) const CHUNK_LIMIT_BYTES: usize = 256 << 20;
/// Largest expansion of all codecs but zstd: deflate 1032 to 1, LZW and JPEG about 1365 to 1.
pub(crate) const RATIO_LIMIT: u64 = 1400;

/// Properties that all pages of a volume share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Page {
    /// Size in pixels along x and y.
    pub(crate) size: [u64; 2],
    /// Numbers per pixel.
    pub(crate) samples: u64,
    /// Type of the numbers.
    pub(crate) number: Number,
    /// Arrangement of the numbers in the chunks of the page.
    pub(super) packing: Packing,
    /// Meaning of the numbers of one pixel.
    pub(crate) meaning: Meaning,
}

/// Arrangement of the numbers of a page in its chunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Packing {
    /// The numbers of a pixel are adjacent.
    Together,
    /// Each chunk holds one number of every pixel; all chunks of the first number precede those of the second.
    InPlanes,
    /// Single bits; each row begins at a byte boundary.
    Bits,
}

impl std::fmt::Display for Page {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [width, height] = self.size;
        let number = match (self.number, self.packing) {
            (Number::Voxel(_), Packing::Bits) => "bit",
            (Number::Voxel(voxel_type), _) => voxel_type.name(),
            (Number::Whole { signed: true }, _) => "int64",
            (Number::Whole { signed: false }, _) => "uint64",
            (Number::Half, _) => "half-precision float",
        };
        write!(f, "{width} x {height} pixels of {} {number}", self.samples)
    }
}

impl Page {
    pub(crate) fn bytes(self) -> u64 {
        // The sizes have 32 bits, so their product has fewer than 128 bits, but possibly more than 64.
        self.size[0].saturating_mul(self.size[1]).saturating_mul(self.pixel_bytes() as u64)
    }

    /// Grey or colour page with the numbers of a pixel adjacent.
    pub(crate) fn plain(size: [u64; 2], samples: u64, number: Number) -> Self {
        Self { size, samples, number, packing: Packing::Together, meaning: Meaning::Colours }
    }

    pub(super) fn pixel_bytes(self) -> usize {
        index(self.samples) * self.stored().bytes()
    }

    /// Number of planes of the page.
    pub(super) fn planes(self) -> u64 {
        if self.packing == Packing::InPlanes { self.samples } else { 1 }
    }

    /// Voxel type of the numbers in a grid.
    pub(crate) fn stored(self) -> VoxelType {
        self.number.stored()
    }
}

/// Converts an error of the decoder.
pub(super) fn refusal(path: &Path, error: TiffError) -> SourceError {
    match error {
        TiffError::IoError(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => SourceError::io(path, e),
        TiffError::UnsupportedError(what) => {
            let advice = "rewrite it first, for example with `tiffcp -c lzw IN OUT` or Fiji";
            SourceError::unsupported(path, format!("this kind of TIFF is not read ({what})"), advice)
        }
        TiffError::FormatError(TiffFormatError::StripTileTagConflict) => {
            let what = "a page has neither strips nor tiles, as those by JPEG of the old style (of before 1995)";
            SourceError::unsupported(path, what, "rewrite it first, for example with `tiffcp -c lzw IN OUT`")
        }
        TiffError::LimitsExceeded => {
            let advice = "rewrite it with smaller strips or tiles, for example with `tiffcp -r 16 IN OUT`";
            SourceError::unsupported(path, "a strip, tile or field is larger than 256 MiB", advice)
        }
        other => SourceError::invalid(path, "TIFF", "what the format allows", other.to_string()),
    }
}
