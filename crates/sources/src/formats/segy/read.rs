//! Boxes of voxels out of traces.
//!
//! The file has samples fastest; voxels are wanted x fastest. A box is cut into tiles of neighbouring traces small
//! enough for the processor's cache; each tile is read in as few reads as the file's order allows, decoded trace by
//! trace, and transposed in blocks. Scratch memory per call: at most 6 MiB, whatever the box.

use std::ops::Range;

use supervol_format::voxel_type::Voxel;
use supervol_format::{Dims, VoxelBox, with_voxel};

use super::grid::Grid;
use super::input::Input;
use super::layout::Layout;
use super::nodata::Absent;
use super::samples::{decode, say_format};
use crate::SourceError;
use crate::cast::index;

/// Bytes of samples in one tile, and of one read.
const TILE_BYTES: usize = 1 << 20;

/// Most samples of a trace in one tile.
const TILE_SAMPLES: usize = 1 << 14;

/// Bytes between two wanted stretches that are cheaper to read through than to skip.
const READ_THROUGH_BYTES: u64 = 8 << 10;

/// Bytes of a cache line: the transposition writes whole ones where it can.
const LINE_BYTES: usize = 64;

/// Everything a read needs.
pub(super) struct Reader<'a> {
    pub(super) input: Input<'a>,
    pub(super) layout: &'a Layout,
    pub(super) grid: &'a Grid,
    pub(super) absent: Absent,
    /// Whether neighbours along x, rather than along y, are neighbours in the file.
    pub(super) neighbours: Neighbours,
}

/// The axis along which traces follow each other in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Neighbours {
    /// Inline-sorted: crosslines follow each other.
    AlongX,
    /// Crossline-sorted: inlines follow each other.
    AlongY,
}

/// Scratch memory of one call.
#[derive(Default)]
struct Scratch {
    /// Traces of the tile, from 0, and their cell in the tile.
    wanted: Vec<(u64, usize)>,
    /// Bytes as the file has them.
    raw: Vec<u8>,
    /// Decoded voxels, `[cell][sample]`.
    voxels: Vec<u8>,
}

impl Reader<'_> {
    /// See [`crate::VolumeSource::read_box`].
    pub(super) fn read_box(&self, dims: Dims, wanted: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let inside = (0..3).all(|a| wanted.start[a] <= wanted.end[a] && wanted.end[a] <= dims.0[a]);
        assert!(inside, "box {wanted:?} is not inside the grid {dims}");
        let voxel_bytes = self.absent.voxel_type.bytes();
        assert_eq!(out.len(), wanted.voxels() * voxel_bytes, "bytes handed in for the box {wanted:?}");
        let extent = wanted.extent();
        if extent.contains(&0) {
            return Ok(());
        }
        let tile = self.tile_extent(extent);
        let mut scratch = Scratch::default();
        for z in (0..extent[2]).step_by(tile[2]) {
            for y in (0..extent[1]).step_by(tile[1]) {
                for x in (0..extent[0]).step_by(tile[0]) {
                    let at = [x, y, z];
                    let size: [usize; 3] = std::array::from_fn(|a| tile[a].min(extent[a] - at[a]));
                    let start: [u64; 3] = std::array::from_fn(|a| wanted.start[a] + at[a] as u64);
                    self.read_tile(start, size, &mut scratch)?;
                    let place = Place { extent, at, size };
                    match voxel_bytes {
                        1 => transpose::<1>(&scratch.voxels, out, place),
                        2 => transpose::<2>(&scratch.voxels, out, place),
                        4 => transpose::<4>(&scratch.voxels, out, place),
                        _ => transpose::<8>(&scratch.voxels, out, place),
                    }
                }
            }
        }
        Ok(())
    }

    /// Voxels of a tile: long in the file's direction, and at least a cache line wide in x.
    fn tile_extent(&self, extent: [usize; 3]) -> [usize; 3] {
        let voxel_bytes = self.absent.voxel_type.bytes();
        let z = extent[2].min(TILE_SAMPLES);
        let cells = (TILE_BYTES / (z * voxel_bytes)).max(1);
        let line = (LINE_BYTES / voxel_bytes).min(extent[0]);
        let x = match self.neighbours {
            Neighbours::AlongX => extent[0].min(cells.max(line)),
            Neighbours::AlongY => line,
        };
        [x, extent[1].min((cells / x).max(1)), z]
    }

    /// Decodes a tile into `scratch.voxels`.
    fn read_tile(&self, start: [u64; 3], size: [usize; 3], scratch: &mut Scratch) -> Result<(), SourceError> {
        let Scratch { wanted, raw, voxels } = scratch;
        let trace_voxel_bytes = size[2] * self.absent.voxel_type.bytes();
        voxels.resize(size[0] * size[1] * trace_voxel_bytes, 0);
        wanted.clear();
        for cell in 0..size[0] * size[1] {
            match self.grid.trace(start[0] + (cell % size[0]) as u64, start[1] + (cell / size[0]) as u64) {
                Some(trace) => wanted.push((trace, cell)),
                None => self.fill_absent(&mut voxels[cell * trace_voxel_bytes..][..trace_voxel_bytes]),
            }
        }
        wanted.sort_unstable();
        let samples = start[2]..start[2] + size[2] as u64;
        let mut rest = wanted.as_slice();
        while !rest.is_empty() {
            let (group, after) = rest.split_at(self.group_length(rest, &samples));
            self.read_group(group, &samples, raw, voxels)?;
            rest = after;
        }
        Ok(())
    }

    /// How many of the traces, sorted, are read at once.
    fn group_length(&self, wanted: &[(u64, usize)], samples: &Range<u64>) -> usize {
        let (first, trace_bytes) = (wanted[0].0, self.layout.trace_bytes());
        let needed = (samples.end - samples.start) * self.layout.format.bytes() as u64;
        let joins = |(index, pair): (usize, &[(u64, usize)])| {
            let gap = (pair[1].0 - pair[0].0) * trace_bytes - needed;
            let span = (pair[1].0 - first) * trace_bytes + needed;
            (gap <= READ_THROUGH_BYTES && span <= TILE_BYTES as u64).then_some(index)
        };
        1 + wanted.windows(2).enumerate().map_while(joins).count()
    }

    /// Reads and decodes traces that lie close together in the file.
    fn read_group(
        &self,
        group: &[(u64, usize)],
        samples: &Range<u64>,
        raw: &mut Vec<u8>,
        voxels: &mut [u8],
    ) -> Result<(), SourceError> {
        let layout = self.layout;
        let count = index(samples.end - samples.start);
        let (raw_bytes, voxel_bytes) = (count * layout.format.bytes(), count * self.absent.voxel_type.bytes());
        let (first, last) = (group[0].0, group[group.len() - 1].0);
        let span = index((last - first) * layout.trace_bytes()) + raw_bytes;
        if raw.len() < span {
            raw.resize(span, 0);
        }
        let raw = &mut raw[..span];
        let offset = layout.sample_offset(first, samples.start);
        self.input.read(offset, raw)?;
        for &(trace, cell) in group {
            let from = index((trace - first) * layout.trace_bytes());
            let out = &mut voxels[cell * voxel_bytes..][..voxel_bytes];
            decode(layout.format, layout.endian, self.absent.voxel_type, &raw[from..from + raw_bytes], out).map_err(
                |bad| {
                    let sample = samples.start + bad.index as u64;
                    let place = layout.sample_offset(trace, sample);
                    self.input.invalid(
                        format!("trace {}, sample {} (byte {place})", trace + 1, sample + 1),
                        say_format(
                            &format!("a number that {} can hold (if the format is wrong, say ", self.absent.voxel_type),
                            "N)",
                        ),
                        bad.reason,
                    )
                },
            )?;
        }
        Ok(())
    }

    /// Fills voxels with the absent value.
    fn fill_absent(&self, voxels: &mut [u8]) {
        let Absent { voxel_type, value } = self.absent;
        with_voxel!(voxel_type, V => {
            const BYTES: usize = size_of::<V>();
            let mut voxel = [0; BYTES];
            V::from_f64(value).write_le(&mut voxel);
            voxels.as_chunks_mut::<BYTES>().0.fill(voxel);
        });
    }
}

/// Place of a tile: extent of the box, and the tile's place and size in it, voxels.
#[derive(Clone, Copy)]
struct Place {
    extent: [usize; 3],
    at: [usize; 3],
    size: [usize; 3],
}

/// Copies a tile `[y][x][z]` into the box `[z][y][x]`, in blocks of one cache line of samples, so that both sides stay
/// in the first-level cache.
fn transpose<const N: usize>(tile: &[u8], out: &mut [u8], place: Place) {
    let Place { extent, at, size } = place;
    let (tile, out) = (tile.as_chunks::<N>().0, out.as_chunks_mut::<N>().0);
    let block = LINE_BYTES / N;
    for z in (0..size[2]).step_by(block) {
        let depth = block.min(size[2] - z);
        for y in 0..size[1] {
            let row = ((at[2] + z) * extent[1] + at[1] + y) * extent[0] + at[0];
            for x in 0..size[0] {
                let from = &tile[(y * size[0] + x) * size[2] + z..][..depth];
                for (k, voxel) in from.iter().enumerate() {
                    out[row + k * extent[0] * extent[1] + x] = *voxel;
                }
            }
        }
    }
}
