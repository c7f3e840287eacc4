//! The `.svol` file format, byte by byte. The writer writes version 4; the reader also reads versions 1 to 3. The
//! versions differ in three things: the quantizer step (offset 440), the length of the last TOC page, and the error bounds
//! in brick records.
//!
//! ```text
//! +-------------+-----------------------------+-----------+----------+-------------+
//! | header page | brick records, append-only  | TOC pages | manifest | footer page |
//! |    4096     |   finest level ... coarsest | n of 65536|   JSON   |    4096     |
//! +-------------+-----------------------------+-----------+----------+-------------+
//! ```
//!
//! All numbers are little endian. Reserved bytes are zero, and readers check that they are. A reader needs one read at
//! the end of the file, and the header page to recognize a container. The footer repeats the header and adds the
//! positions of the TOC and the manifest. The coarsest bricks lie next to the TOC, and their entries at its end.
//!
//! # Header and footer page
//! Both pages have one layout ([`header`]). The header is written before the sections, so its section fields are zero;
//! the footer has them. The first bytes of both pages are the same in all future versions.
//!
//! | offset | size | type | unit | meaning |
//! |---|---|---|---|---|
//! | 0 | 8 | bytes | | magic `89 53 56 4f 4c 0d 0a 1a` (`\x89SVOL\r\n\x1a`) |
//! | 8 | 4 | u32 | | format version: 4; older files: 3; before: 1 if the step (offset 440) is 0, else 2 |
//! | 12 | 4 | u32 | bytes | size of this page: 4096 |
//! | 16 | 4 | u32 | | voxel type: 1 u8, 2 i8, 3 u16, 4 i16, 5 u32, 6 i32, 7 f32, 8 f64 |
//! | 20 | 4 | u32 | voxels | core of a brick: 16, 32, 64 or 128 |
//! | 24 | 4 | u32 | voxels | apron: 2 |
//! | 28 | 4 | u32 | voxels | macro cell: 8 |
//! | 32 | 4 | u32 | | number of levels, 1 to 64 |
//! | 36 | 4 | u32 | | flags: bit 0: a nodata value is declared |
//! | 40 | 24 | 3 x u64 | voxels | dims of level 0 |
//! | 64 | 8 | f64 | | scale: value = stored * scale + offset |
//! | 72 | 8 | f64 | | offset |
//! | 80 | 8 | f64 | stored | nodata value, 0 if none is declared |
//! | 88 | 24 | 3 x f64 | world | spacing |
//! | 112 | 24 | 3 x f64 | world | origin |
//! | 136 | 72 | 9 x f64 | | direction, row-major |
//! | 208 | 192 | 64 x 3 x u8 | | factors of levels 1, 2, ...: 1 or 2 per axis; 0 beyond the last level |
//! | 400 | 8 | u64 | bytes | offset of the TOC (header: 0) |
//! | 408 | 8 | u64 | bytes | length of the TOC (header: 0) |
//! | 416 | 8 | u64 | bytes | offset of the manifest (header: 0) |
//! | 424 | 8 | u64 | bytes | length of the manifest (header: 0) |
//! | 432 | 8 | u64 | | XXH3-64 of the manifest (header: 0) |
//! | 440 | 8 | f64 | stored | quantizer step, or 0 |
//! | 448 | 3640 | | | reserved, zero |
//! | 4088 | 8 | u64 | | XXH3-64 of bytes 0 to 4087 of this page |
//!
//! The step: voxels of all levels are moved to multiples of it ([`crate::codec::quantize`]). With 0, which is always
//! the case in version 1 and never in version 2, the voxels of level 0 are the source's own.
//!
//! # Brick record
//! The payload (see [`crate::codec`]), directly followed by the macro cells (see [`crate::macro_cells`]): two bytes
//! each, x fastest, for all macro cells of the brick's core. Records follow one another without gaps, in the order in
//! which the bricks were written. A brick with the codec *uniform* has no record: its offset and lengths are zero.
//!
//! From version 4 on, the macro cells of a brick of level 1 or more are followed by their error bounds
//! ([`crate::cell_errors`]): one byte each, x fastest. They count as part of the macro cells. In older versions, at level
//! 0, in levels with fewer than 8 voxels along an axis, and in uniform bricks, the error bound of the brick holds in all of
//! its macro cells.
//!
//! # TOC
//! One entry per brick in entry order ([`crate::Pyramid::entry`]: level by level, finest first, x fastest). Entries are
//! packed into pages of 65536 bytes, so that each page can be read and checked alone:
//!
//! | offset in page | size | meaning |
//! |---|---|---|
//! | 0 | 818 x 80 | entries; unused ones at the end are zero |
//! | 65440 | 88 | reserved, zero |
//! | 65528 | 8 | XXH3-64 of bytes 0 to 65527 of this page |
//!
//! The last page is cut: the file does not hold the bytes between its entries and its checksum ([`toc::cut`]). In
//! versions 1 and 2 the last page is whole.
//!
//! # TOC entry ([`toc`])
//!
//! | offset | size | type | unit | meaning |
//! |---|---|---|---|---|
//! | 0 | 8 | u64 | bytes | offset of the record |
//! | 8 | 4 | u32 | bytes | length of the payload |
//! | 12 | 4 | u32 | bytes | length of the macro cells |
//! | 16 | 1 | u8 | | codec: 0 uniform, 1 raw, 2 rle, 3 zstd, 4 wavelet, 5 trimmed |
//! | 17 | 1 | u8 | | flags: bit 0 absent (no voxel of the core is present), bit 1 uniform, bit 2 has holes |
//! | 18 | 1 | u8 | | stored scale: log2 of the coarsening the brick is stored at; 0 in this version |
//! | 19 | 5 | | | reserved, zero |
//! | 24 | 8 | u64 | | XXH3-64 of the record; 0 without one |
//! | 32 | 8 | u64 | | fill: the bits of every stored voxel of a uniform codec; otherwise 0 |
//! | 40 | 8 | f64 | stored | least value that interpolation reaches in the brick (+inf if nothing is present) |
//! | 48 | 8 | f64 | stored | greatest value (-inf if nothing is present) |
//! | 56 | 8 | f64 | stored | least value of this brick and of all finer bricks under it |
//! | 64 | 8 | f64 | stored | greatest value of the same |
//! | 72 | 8 | f64 | stored | error bound |
//!
//! The error bound limits the distance between the trilinear interpolation of this level and that of the source. It
//! holds at every point of the brick's region at which both, and all levels between them, are present. At level 0 it is
//! the greatest distance that a stored voxel was moved.
//!
//! # Manifest
//! UTF-8 JSON of at most 256 KiB ([`manifest::BYTES_LIMIT`]), see [`manifest::Manifest`]: a description of the data and
//! its origin. Decoding needs nothing from it. Fields that a reader does not know are kept and ignored.
//!
//! The field `distribution` is optional ([`manifest::Distribution`]). With it, percentiles and histogram resolve the
//! range of the values. Without it, as in containers of release 0.1.0, those of voxels wider than 16 bits are resolved
//! to 1/128 of the value.

pub mod header;
pub mod identity;
pub mod manifest;
mod opening;
pub mod reader;
pub mod seal;
pub mod toc;
mod toc_pages;
pub mod validate;
pub mod writer;

use std::io;

use crate::codec::CodecError;
use crate::pyramid::PyramidError;
use crate::{BrickKey, VoxelType};

/// Reason why a container cannot be opened or a part of it cannot be used.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum ContainerError {
    /// Reading failed, or the file is shorter than it says.
    #[error("cannot read {what} ({bytes} bytes at offset {offset}): {source}")]
    Io { what: String, offset: u64, bytes: u64, source: io::Error },
    /// The first bytes are not those of a container.
    #[error(
        "no Supervol container; `supervol build` makes one of a volume file (first bytes of the {what}: expected \
         {expected}, found {found})"
    )]
    Magic { what: String, offset: u64, expected: String, found: String },
    /// The file breaks a rule of the specification in this module's head.
    #[error("{what} at offset {offset}: expected {expected}, found {found}")]
    Invalid { what: String, offset: u64, expected: String, found: String },
    /// A container of a version that this program does not know.
    #[error(
        "container format version {found}; this program reads versions up to {known}. Use a newer supervol, or build the container anew"
    )]
    Version { found: u32, known: u32 },
    /// The levels are not a valid pyramid.
    #[error("levels in the header: {0}")]
    Pyramid(#[from] PyramidError),
    /// A brick's payload cannot be decoded.
    #[error("{key} at offset {offset}: {source}")]
    Decode { key: BrickKey, offset: u64, source: CodecError },
}

impl ContainerError {
    pub(crate) fn invalid(
        what: impl Into<String>,
        offset: u64,
        expected: impl std::fmt::Display,
        found: impl std::fmt::Display,
    ) -> Self {
        Self::Invalid { what: what.into(), offset, expected: expected.to_string(), found: found.to_string() }
    }
}

/// Stored value of a fill: its low bytes are a little-endian voxel.
#[must_use]
pub fn fill_value(voxel_type: VoxelType, fill: u64) -> f64 {
    use crate::voxel_type::Voxel;
    crate::with_voxel!(voxel_type, V => V::read_le(&fill.to_le_bytes()[..size_of::<V>()]).to_f64())
}

/// Checksum of all parts of a container: XXH3-64.
#[must_use]
pub fn checksum(bytes: &[u8]) -> u64 {
    xxhash_rust::xxh3::xxh3_64(bytes)
}
