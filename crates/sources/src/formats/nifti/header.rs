//! Parser of the binary headers of NIfTI-1 (348 bytes), NIfTI-2 (540 bytes) and ANALYZE 7.5 (348 bytes), in either byte
//! order.
//!
//! Formats: <https://nifti.nimh.nih.gov/nifti-1/> and <https://nifti.nimh.nih.gov/nifti-2/>, with their byte offsets.
//! ANALYZE has no magic at NIfTI-1's position. It has the same sizes, spacings and types, no placement in the world,
//! and a scale if SPM wrote it.
//! Written by hand: the crate `nifti` reads whole volumes into memory and rescales them, and few fields are needed
//! here. This module checks only what it needs to find the fields.

use std::path::Path;

use crate::{Endian, SourceError};

/// Size of the longer header in bytes.
pub(super) const HEADER_BYTES: usize = 540;

const NIFTI1_BYTES: usize = 348;

/// Location of the voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// Behind the header, in the same file (`n+1`, `n+2`).
    SingleFile,
    /// In the `.img` of a pair (`ni1`, `ni2`).
    Pair,
    /// In the `.img` of a pair with an ANALYZE 7.5 header.
    Analyze,
}

/// The used fields, in the same form for all versions.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Header {
    pub(super) endian: Endian,
    pub(super) form: Form,
    /// Size of the header in bytes; the voxels of a single file follow it.
    pub(super) header_bytes: u64,
    pub(super) datatype: i16,
    pub(super) bits_per_voxel: i16,
    /// Number of axes, then their sizes.
    pub(super) dim: [i64; 8],
    /// Handedness of the qform, then the spacings.
    pub(super) pixdim: [f64; 8],
    pub(super) vox_offset: f64,
    pub(super) slope: f64,
    pub(super) inter: f64,
    pub(super) qform_code: i32,
    pub(super) sform_code: i32,
    /// Quaternion b, c, d.
    pub(super) quaternion: [f64; 3],
    pub(super) quaternion_offset: [f64; 3],
    /// Rows of the affine from index to world.
    pub(super) affine_rows: [[f64; 4]; 3],
    pub(super) units: i32,
    /// Meaning of the values.
    pub(super) intent_code: i32,
}

impl Header {
    /// Parses the first bytes of a header file.
    pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Self, SourceError> {
        let size_field: [u8; 4] = match bytes.first_chunk() {
            Some(field) => *field,
            None => return Err(too_short(path, NIFTI1_BYTES, bytes.len())),
        };
        let (little, big) = (i32::from_le_bytes(size_field), i32::from_be_bytes(size_field));
        let (endian, size) = match (little, big) {
            (348 | 540, _) => (Endian::Little, little.unsigned_abs() as usize),
            (_, 348 | 540) => (Endian::Big, big.unsigned_abs() as usize),
            _ => {
                let found = format!("{little}");
                return Err(SourceError::invalid(
                    path,
                    "header size (bytes 0 to 3)",
                    "348 or 540: NIfTI-1 or 2",
                    found,
                ));
            }
        };
        if bytes.len() < size {
            return Err(too_short(path, size, bytes.len()));
        }
        let fields = Fields { bytes, endian };
        if size == NIFTI1_BYTES { Self::version_1(path, &fields) } else { Self::version_2(path, &fields) }
    }

    fn version_1(path: &Path, fields: &Fields<'_>) -> Result<Self, SourceError> {
        let form = match &fields.bytes[344..348] {
            b"n+1\0" => Form::SingleFile,
            b"ni1\0" => Form::Pair,
            b"\0\0\0\0" => return Ok(Self::analyze(fields)),
            other => return Err(wrong_magic(path, other)),
        };
        Ok(Self {
            endian: fields.endian,
            form,
            header_bytes: NIFTI1_BYTES as u64,
            datatype: fields.i16(70),
            bits_per_voxel: fields.i16(72),
            dim: std::array::from_fn(|i| fields.i16(40 + 2 * i).into()),
            pixdim: std::array::from_fn(|i| fields.f32(76 + 4 * i)),
            vox_offset: fields.f32(108),
            slope: fields.f32(112),
            inter: fields.f32(116),
            qform_code: fields.i16(252).into(),
            sform_code: fields.i16(254).into(),
            quaternion: std::array::from_fn(|i| fields.f32(256 + 4 * i)),
            quaternion_offset: std::array::from_fn(|i| fields.f32(268 + 4 * i)),
            affine_rows: std::array::from_fn(|row| std::array::from_fn(|i| fields.f32(280 + 16 * row + 4 * i))),
            units: fields.bytes[123].into(),
            intent_code: fields.i16(68).into(),
        })
    }

    /// Parses ANALYZE 7.5, as in the Mayo Clinic's `dbh.h`. The scale is SPM's, in a field that no other program uses.
    fn analyze(fields: &Fields<'_>) -> Self {
        // The sizes of missing axes may be zero.
        let dim = std::array::from_fn(|i| {
            let size = i64::from(fields.i16(40 + 2 * i));
            if i > 3 && size == 0 { 1 } else { size }
        });
        let units = match &fields.bytes[56..58] {
            b"mm" => 2,
            b"um" => 3,
            _ => 0,
        };
        Self {
            endian: fields.endian,
            form: Form::Analyze,
            header_bytes: NIFTI1_BYTES as u64,
            datatype: fields.i16(70),
            bits_per_voxel: fields.i16(72),
            dim,
            pixdim: std::array::from_fn(|i| fields.f32(76 + 4 * i)),
            vox_offset: fields.f32(108),
            slope: fields.f32(112),
            inter: 0.0,
            qform_code: 0,
            sform_code: 0,
            quaternion: [0.0; 3],
            quaternion_offset: [0.0; 3],
            affine_rows: [[0.0; 4]; 3],
            units,
            intent_code: 0,
        }
    }

    fn version_2(path: &Path, fields: &Fields<'_>) -> Result<Self, SourceError> {
        let form = match &fields.bytes[4..12] {
            b"n+2\0\r\n\x1a\n" => Form::SingleFile,
            b"ni2\0\r\n\x1a\n" => Form::Pair,
            other => return Err(wrong_magic(path, other)),
        };
        Ok(Self {
            endian: fields.endian,
            form,
            header_bytes: HEADER_BYTES as u64,
            datatype: fields.i16(12),
            bits_per_voxel: fields.i16(14),
            dim: std::array::from_fn(|i| fields.i64(16 + 8 * i)),
            pixdim: std::array::from_fn(|i| fields.f64(104 + 8 * i)),
            // Offsets beyond 2^53 are beyond any file.
            vox_offset: fields.i64(168) as f64,
            slope: fields.f64(176),
            inter: fields.f64(184),
            qform_code: fields.i32(344),
            sform_code: fields.i32(348),
            quaternion: std::array::from_fn(|i| fields.f64(352 + 8 * i)),
            quaternion_offset: std::array::from_fn(|i| fields.f64(376 + 8 * i)),
            affine_rows: std::array::from_fn(|row| std::array::from_fn(|i| fields.f64(400 + 32 * row + 8 * i))),
            units: fields.i32(500),
            intent_code: fields.i32(504),
        })
    }
}

fn too_short(path: &Path, expected: usize, found: usize) -> SourceError {
    SourceError::invalid(path, "NIfTI header", format!("{expected} bytes"), format!("{found} bytes"))
}

fn wrong_magic(path: &Path, found: &[u8]) -> SourceError {
    let found = format!("`{}`", found.escape_ascii());
    SourceError::invalid(path, "magic of the header", "n+1, ni1, n+2 or ni2", found)
}

/// Numbers of a header that is long enough for all of them.
struct Fields<'a> {
    bytes: &'a [u8],
    endian: Endian,
}

impl Fields<'_> {
    fn ordered<const N: usize>(&self, offset: usize) -> [u8; N] {
        let mut field: [u8; N] = std::array::from_fn(|i| self.bytes[offset + i]);
        if self.endian == Endian::Big {
            field.reverse();
        }
        field
    }

    fn i16(&self, offset: usize) -> i16 {
        i16::from_le_bytes(self.ordered(offset))
    }

    fn i32(&self, offset: usize) -> i32 {
        i32::from_le_bytes(self.ordered(offset))
    }

    fn i64(&self, offset: usize) -> i64 {
        i64::from_le_bytes(self.ordered(offset))
    }

    fn f32(&self, offset: usize) -> f64 {
        f32::from_le_bytes(self.ordered(offset)).into()
    }

    fn f64(&self, offset: usize) -> f64 {
        f64::from_le_bytes(self.ordered(offset))
    }
}
