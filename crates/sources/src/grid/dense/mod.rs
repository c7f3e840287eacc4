//! A dense grid of voxels in a file. The readers of raw, NRRD, NIfTI and npy use it once they know the header.
//!
//! The grid starts at a byte offset. Its voxels are packed, in one byte order, with the axes in any order (C and
//! Fortran alike). It lies in one file or in several with equal shares (slices, NRRD file lists). Reads are positional,
//! so threads share no cursor. Voxels are returned little endian and x fastest, as [`VolumeSource`] promises.
//! Opening checks all lengths. A read uses the caller's buffer and at most [`SCRATCH_BYTES`] of its own. This module
//! does not decompress ([`crate::input::spool`] does) and does not parse headers.

pub mod shape;
mod storage;

use std::fs::File;
use std::path::Path;

use supervol_format::{Dims, VoxelBox, VoxelType};

use super::elements::{Elements, NumberGrid};
pub use super::layout::{GridLayout, SCRATCH_BYTES};
use crate::cast::index;
use crate::{Endian, SourceError, SourceInfo, VolumeSource};
pub use storage::Part;
use storage::Storage;

/// Rows with smaller gaps than this are read as one span, gaps included: the system fetches whole pages anyway.
const GAP_LIMIT_BYTES: u64 = 4096;

/// Voxels along x that a transposing read collects before it writes, so that it writes whole cache lines.
const TRANSPOSE_RUN_VOXELS: usize = 64;

/// A dense grid that can be read box by box.
#[derive(Debug)]
pub struct GridFile {
    layout: GridLayout,
    storage: Storage,
}

impl GridFile {
    /// Grid that starts at byte `offset` of an open file. `path` is for messages.
    ///
    /// # Errors
    /// If the dims are not allowed, or the file ends before the grid does.
    pub fn single(path: &Path, file: File, offset: u64, layout: GridLayout) -> Result<Self, SourceError> {
        let bytes = checked_bytes(path, layout.dims, layout.voxel_type)?;
        let storage = Storage::single(path, file, offset, bytes)?;
        Ok(Self { layout, storage })
    }

    /// Grid in several files, in file order, an equal share in each. `header` is the file that lists them, for
    /// messages.
    ///
    /// # Errors
    /// If the dims are not allowed, do not divide into that many parts, or a file is missing or ends too early.
    pub fn parts(header: &Path, parts: Vec<Part>, layout: GridLayout) -> Result<Self, SourceError> {
        let bytes = checked_bytes(header, layout.dims, layout.voxel_type)?;
        let storage = Storage::parts(header, parts, bytes)?;
        Ok(Self { layout, storage })
    }

    /// Arrangement of the voxels in the file.
    #[must_use]
    pub fn layout(&self) -> &GridLayout {
        &self.layout
    }

    /// As [`VolumeSource::read_box`].
    ///
    /// # Errors
    /// If a file cannot be read.
    ///
    /// # Panics
    /// If the box is not inside the grid, or the length of `out` is not that of the box.
    pub fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let extent = voxels.extent();
        let grid = self.layout.dims;
        assert!((0..3).all(|a| voxels.end[a] <= grid.0[a]), "box {voxels:?} leaves the grid {grid}");
        let expected = voxels.voxels() * self.layout.voxel_type.bytes();
        assert_eq!(out.len(), expected, "buffer of {} bytes for a box of {expected}", out.len());
        if out.is_empty() {
            return Ok(());
        }
        if self.layout.fastest_first == GridLayout::X_FASTEST {
            self.read_in_order(voxels, extent, out)?;
        } else {
            self.read_transposed(voxels, extent, out)?;
        }
        if self.layout.endian == Endian::Big {
            swap_bytes(out, self.layout.voxel_type.bytes());
        }
        Ok(())
    }

    /// Reads rows that are in the same order in file and buffer directly into the buffer, and merges adjacent rows.
    fn read_in_order(&self, voxels: VoxelBox, extent: [usize; 3], out: &mut [u8]) -> Result<(), SourceError> {
        let bytes = self.layout.voxel_type.bytes();
        let [nx, ny, _] = self.layout.dims.0;
        let whole_rows = extent[0] as u64 == nx;
        if whole_rows && extent[1] as u64 == ny {
            return self.read_run(voxels.start, out);
        }
        let layer_bytes = extent[0] * extent[1] * bytes;
        for (z, layer) in (voxels.start[2]..).zip(out.chunks_exact_mut(layer_bytes)) {
            let start = [voxels.start[0], voxels.start[1], z];
            if whole_rows {
                self.read_run(start, layer)?;
            } else {
                self.read_rows(start, extent[0] * bytes, layer)?;
            }
        }
        Ok(())
    }

    /// Fills `rows` with rows of `row_bytes`, starting at voxel `start`, one stride along the second axis apart.
    fn read_rows(&self, start: [u64; 3], row_bytes: usize, rows: &mut [u8]) -> Result<(), SourceError> {
        let [fast, middle, _] = self.layout.fastest_first;
        let stride_bytes = self.layout.dims.0[fast] * self.layout.voxel_type.bytes() as u64;
        let gap_bytes = stride_bytes - row_bytes as u64;
        let at_row = |row: usize| {
            let mut voxel = start;
            voxel[middle] += row as u64;
            voxel
        };
        // Rows with large gaps, or too long for the scratch memory, are read one by one.
        let gathered = if gap_bytes > GAP_LIMIT_BYTES { 1 } else { SCRATCH_BYTES as u64 / stride_bytes };
        if gathered < 2 {
            let mut in_file = rows.chunks_exact_mut(row_bytes).enumerate();
            return in_file.try_for_each(|(row, out)| self.read_run(at_row(row), out));
        }
        // Rows with small gaps are read as one span, from the first voxel of the first row to the last voxel of the
        // last row.
        let stride = index(stride_bytes);
        let mut span = Vec::new();
        for (group, group_out) in rows.chunks_mut(index(gathered) * row_bytes).enumerate() {
            let row_count = group_out.len() / row_bytes;
            span.resize((row_count - 1) * stride + row_bytes, 0);
            self.read_run(at_row(group * index(gathered)), &mut span)?;
            for (from, to) in span.chunks(stride).zip(group_out.chunks_exact_mut(row_bytes)) {
                to.copy_from_slice(&from[..row_bytes]);
            }
        }
        Ok(())
    }

    /// Reads block by block in file order and writes each block in x order.
    fn read_transposed(&self, voxels: VoxelBox, extent: [usize; 3], out: &mut [u8]) -> Result<(), SourceError> {
        let bytes = self.layout.voxel_type.bytes();
        let block = transpose_block(extent, self.layout.fastest_first, SCRATCH_BYTES / bytes);
        let mut scratch = vec![0; block.iter().product::<usize>() * bytes];
        for z in (0..extent[2]).step_by(block[2]) {
            for y in (0..extent[1]).step_by(block[1]) {
                for x in (0..extent[0]).step_by(block[0]) {
                    let at = [x, y, z];
                    let size = std::array::from_fn(|a| block[a].min(extent[a] - at[a]));
                    let scratch = &mut scratch[..size.iter().product::<usize>() * bytes];
                    let start = std::array::from_fn(|a| voxels.start[a] + at[a] as u64);
                    self.read_block_in_file_order(start, size, scratch)?;
                    let target = BlockTarget { extent, at, size, fastest_first: self.layout.fastest_first };
                    match bytes {
                        1 => target.scatter::<1>(scratch, out),
                        2 => target.scatter::<2>(scratch, out),
                        4 => target.scatter::<4>(scratch, out),
                        _ => target.scatter::<8>(scratch, out),
                    }
                }
            }
        }
        Ok(())
    }

    /// Reads the voxels of a block in file order, without the gaps.
    fn read_block_in_file_order(&self, start: [u64; 3], size: [usize; 3], out: &mut [u8]) -> Result<(), SourceError> {
        let [fast, middle, slow] = self.layout.fastest_first;
        let row_bytes = size[fast] * self.layout.voxel_type.bytes();
        for (layer, layer_out) in out.chunks_exact_mut(row_bytes * size[middle]).enumerate() {
            let mut at = start;
            at[slow] += layer as u64;
            self.read_rows(at, row_bytes, layer_out)?;
        }
        Ok(())
    }

    /// Reads the bytes from voxel `start` of the file on.
    fn read_run(&self, start: [u64; 3], out: &mut [u8]) -> Result<(), SourceError> {
        let dims = self.layout.dims.0;
        let [fast, middle, slow] = self.layout.fastest_first;
        // Cannot overflow: opening has checked that the byte count of the whole grid fits 64 bits.
        let voxel = start[fast] + dims[fast] * (start[middle] + dims[middle] * start[slow]);
        self.storage.read(voxel * self.layout.voxel_type.bytes() as u64, out)
    }
}

impl NumberGrid for GridFile {
    fn layout(&self) -> &GridLayout {
        &self.layout
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        Self::read_box(self, voxels, out)
    }
}

/// Size along x, y, z of the blocks of a transposing read, at most `budget` voxels. A block is long enough along x to
/// write whole cache lines, and as long as possible along the file's fastest axis.
fn transpose_block(extent: [usize; 3], fastest_first: [usize; 3], budget: usize) -> [usize; 3] {
    let mut block = [1; 3];
    block[0] = extent[0].min(TRANSPOSE_RUN_VOXELS);
    for axis in fastest_first {
        let others: usize = (0..3).filter(|a| *a != axis).map(|a| block[a]).product();
        block[axis] = extent[axis].min(budget / others).max(block[axis]);
    }
    block
}

/// Position of a block, read in file order, in a box that is x fastest.
struct BlockTarget {
    extent: [usize; 3],
    at: [usize; 3],
    size: [usize; 3],
    fastest_first: [usize; 3],
}

impl BlockTarget {
    fn scatter<const BYTES: usize>(&self, block: &[u8], out: &mut [u8]) {
        let (from, _) = block.as_chunks::<BYTES>();
        let (to, _) = out.as_chunks_mut::<BYTES>();
        let mut stride = [0; 3];
        let mut product = 1;
        for axis in self.fastest_first {
            stride[axis] = product;
            product *= self.size[axis];
        }
        let [nx, ny, _] = self.extent;
        for z in 0..self.size[2] {
            for y in 0..self.size[1] {
                let first = self.at[0] + nx * (self.at[1] + y + ny * (self.at[2] + z));
                let row = &mut to[first..first + self.size[0]];
                let column = from[y * stride[1] + z * stride[2]..].iter().step_by(stride[0]);
                for (to, from) in row.iter_mut().zip(column) {
                    *to = *from;
                }
            }
        }
    }
}

/// Reverses the bytes of each voxel.
pub(crate) fn swap_bytes(out: &mut [u8], voxel_bytes: usize) {
    match voxel_bytes {
        1 => {}
        2 => out.as_chunks_mut::<2>().0.iter_mut().for_each(|voxel| voxel.reverse()),
        4 => out.as_chunks_mut::<4>().0.iter_mut().for_each(|voxel| voxel.reverse()),
        _ => out.as_chunks_mut::<8>().0.iter_mut().for_each(|voxel| voxel.reverse()),
    }
}

/// Size of the grid in bytes, after a check of its dims.
///
/// # Errors
/// If an axis has no voxel or too many, or the byte count does not fit 64 bits.
pub fn checked_bytes(path: &Path, dims: Dims, voxel_type: VoxelType) -> Result<u64, SourceError> {
    let allowed = || format!("1 to {} voxels on each axis and less than 2^64 bytes in all", Dims::LIMIT);
    let bytes = if dims.is_valid() { dims.bytes(voxel_type) } else { None };
    bytes.ok_or_else(|| SourceError::invalid(path, "dims", allowed(), format!("{dims} voxels of {voxel_type}")))
}

/// A [`VolumeSource`] over a grid file.
#[derive(Debug)]
pub struct GridSource {
    info: SourceInfo,
    grid: GridFile,
    elements: Elements,
}

impl GridSource {
    /// Source with this description over this grid.
    ///
    /// # Panics
    /// If dims or voxel type of the two differ.
    #[must_use]
    pub fn new(info: SourceInfo, grid: GridFile) -> Self {
        let elements = Elements::plain(grid.layout.voxel_type);
        Self::with_elements(info, grid, elements)
    }

    /// As [`Self::new`], but the grid's numbers are converted to voxels.
    pub(crate) fn with_elements(mut info: SourceInfo, grid: GridFile, elements: Elements) -> Self {
        let (dims, voxel_type) = (elements.dims(&grid), elements.voxel_type);
        assert_eq!((info.dims, info.voxel_type), (dims, voxel_type), "header against grid");
        info.access_order = grid.layout.access_order();
        Self { info, grid, elements }
    }
}

impl VolumeSource for GridSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.elements.read_box(&self.grid, voxels, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_stay_inside_budget_and_box() {
        for order in [[2, 1, 0], [1, 0, 2], [0, 2, 1], [2, 0, 1], [1, 2, 0]] {
            for extent in [[1, 1, 1], [5, 1, 7], [64, 64, 64], [2048, 2048, 3], [3, 1, 1 << 23], [1 << 23, 1, 2]] {
                for budget in [SCRATCH_BYTES, SCRATCH_BYTES / 8] {
                    let block = transpose_block(extent, order, budget);
                    assert!(block.iter().product::<usize>() <= budget, "{extent:?} {order:?}: {block:?}");
                    assert!((0..3).all(|a| (1..=extent[a]).contains(&block[a])), "{extent:?} {order:?}: {block:?}");
                }
            }
        }
    }
}
