//! Contents of a VTK header: the grid, its arrays, and their encoding.

use std::path::Path;

use supervol_format::{Dims, Geometry};

use crate::grid::elements::Number;
use crate::input::selection::Selection;
use crate::input::text::shortened;
use crate::{Endian, Message, SourceError};

/// Largest number of arrays of a file.
pub(super) const ARRAYS_LIMIT: usize = 1024;
/// Largest number of arrays that a message lists.
const LISTED_LIMIT: usize = 20;

/// Encoding of an array's bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Unencoded; in XML, behind a word with their number.
    Raw,
    /// Numbers as text.
    Text,
    /// Colours as text: fractions of 255.
    Shares,
    /// Base64 of the bytes that `Raw` would have.
    Base64,
}

/// One array of a file.
#[derive(Debug, Clone)]
pub(super) struct Array {
    pub(super) name: String,
    pub(super) number: Number,
    pub(super) components: u64,
    /// Whether the array belongs to the cells, not to the points.
    pub(super) is_of_cells: bool,
    /// Whether the array is the active one of the file.
    pub(super) is_active: bool,
    /// Whether the components are colours.
    pub(super) is_colour: bool,
    pub(super) encoding: Encoding,
    /// Offset of the array in bytes.
    pub(super) offset: u64,
}

/// Block format of the arrays of an XML file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Blocks {
    /// Size in bytes of a word that counts bytes.
    pub(super) word_bytes: usize,
    pub(super) compressor: Option<Compressor>,
}

/// Compression of the blocks of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Compressor {
    Zlib,
    Lz4,
}

/// Contents of a header.
#[derive(Debug)]
pub(super) struct Header {
    /// Number of points along the axes.
    pub(super) points: [u64; 3],
    /// Index of the first point.
    pub(super) first: [i64; 3],
    pub(super) geometry: Geometry,
    pub(super) endian: Endian,
    pub(super) arrays: Vec<Array>,
    /// `None` for a legacy file, whose arrays have no headers.
    pub(super) blocks: Option<Blocks>,
}

impl Header {
    /// Makes negative spacings positive: each turns its axis round.
    pub(super) fn turn_negative_axes(&mut self) {
        for axis in 0..3 {
            let sign = if self.geometry.spacing[axis] < 0.0 { -1.0 } else { 1.0 };
            self.geometry.spacing[axis] *= sign;
            (0..3).for_each(|row| self.geometry.direction[3 * row + axis] *= sign);
        }
    }

    /// The named array, else the active one, else the first; arrays of points before those of cells.
    pub(super) fn choose(
        &self,
        path: &Path,
        selection: &Selection,
        notes: &mut Vec<Message>,
    ) -> Result<&Array, SourceError> {
        let names: Vec<&str> = self.arrays.iter().take(LISTED_LIMIT).map(|array| array.name.as_str()).collect();
        let list = names.join(", ");
        if let Some(wanted) = &selection.array {
            return self.arrays.iter().find(|array| array.name == *wanted).ok_or_else(|| {
                SourceError::options(format!("{}: no array `{}`; there are: {list}", path.display(), shortened(wanted)))
            });
        }
        let best = self.arrays.iter().min_by_key(|array| (!array.is_active, array.is_of_cells));
        let best = best.ok_or_else(|| SourceError::invalid(path, "arrays", "at least one", "none"))?;
        if self.arrays.len() > 1 {
            let (count, name) = (self.arrays.len(), &best.name);
            notes.push(format!("{count} arrays ({list}); `{name}` is used; FILE:/NAME takes another").into());
        }
        Ok(best)
    }

    /// Number of voxels along the axes: points, or the cells between them.
    pub(super) fn dims(&self, array: &Array) -> Dims {
        Dims(self.points.map(|points| if array.is_of_cells { (points - 1).max(1) } else { points }))
    }

    /// Geometry with the origin at the first voxel.
    pub(super) fn placed(&self, path: &Path, array: &Array) -> Result<Geometry, SourceError> {
        if let Some(defect) = self.geometry.defect() {
            return Err(SourceError::invalid(path, "place", "origin, spacing and direction of a grid", defect));
        }
        let half = |axis: usize| if array.is_of_cells && self.points[axis] > 1 { 0.5 } else { 0.0 };
        let index: [f64; 3] = std::array::from_fn(|axis| self.first[axis] as f64 + half(axis));
        let origin = self.geometry.world_from_index().transform_point3(index.into()).to_array();
        Ok(Geometry { origin, ..self.geometry })
    }
}

/// A word of four or eight bytes.
pub(super) fn number(bytes: &[u8], endian: Endian) -> u64 {
    let mut word = [0; 8];
    word[..bytes.len()].copy_from_slice(bytes);
    if endian == Endian::Big {
        word[..bytes.len()].reverse();
    }
    u64::from_le_bytes(word)
}
