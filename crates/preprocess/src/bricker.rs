//! Tiles and bricks: which part of a level is read at once, and cutting stored bricks out of it.
//!
//! A *tile* is a box of whole bricks. It is read with the apron of its outermost bricks, so that each of its bricks can
//! be cut out of it; voxels beyond the grid repeat the nearest one, which is the model's clamping of indices.

use supervol_format::brick::APRON;
use supervol_format::brick_key::morton;
use supervol_format::{BrickIndex, BrickKey, Dims, Level, Lod, Pyramid, VoxelBox};
use supervol_sources::AccessOrder;

use crate::downsample::VoxelBlock;

/// A box of bricks of one level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tile {
    /// First brick.
    pub start: [u32; 3],
    /// One past the last brick.
    pub end: [u32; 3],
}

impl Tile {
    /// The tile's bricks in Morton order, so that siblings lie together in the container.
    #[must_use]
    pub fn bricks(&self) -> Vec<BrickIndex> {
        let mut bricks = Vec::new();
        for z in self.start[2]..self.end[2] {
            for y in self.start[1]..self.end[1] {
                bricks.extend((self.start[0]..self.end[0]).map(|x| BrickIndex([x, y, z])));
            }
        }
        bricks.sort_by_key(|b| morton(*b));
        bricks
    }

    /// The voxels the tile's bricks own, grown by `margin` voxels and clipped to the grid.
    #[must_use]
    pub fn voxels(&self, core: usize, dims: Dims, margin: u64) -> VoxelBox {
        let at = |v: [u32; 3]| v.map(|i| u64::from(i) * core as u64);
        VoxelBox { start: at(self.start), end: at(self.end) }.grown(margin, dims)
    }
}

/// The tiles of a level, in the order in which they are read.
///
/// A tile has two bricks along each axis where `fits` allows, is then grown along the source's fastest axis as far as
/// `fits` allows, and then along the others. `fits` is told the tile's bricks along each axis.
#[must_use]
pub fn tiles(level: &Level, order: AccessOrder, fits: &dyn Fn([u32; 3]) -> bool) -> Vec<Tile> {
    let bricks = level.bricks;
    let [slow, middle, fast] = order.0;
    let mut size = [1; 3];
    let try_grow = |size: &mut [u32; 3], axis: usize| {
        let mut grown = *size;
        grown[axis] = (grown[axis] * 2).min(bricks[axis]);
        let grows = grown[axis] > size[axis] && fits(grown);
        if grows {
            *size = grown;
        }
        grows
    };
    for axis in [fast, middle, slow] {
        try_grow(&mut size, axis);
    }
    for axis in [fast, middle, slow] {
        while try_grow(&mut size, axis) {}
    }
    let counts: [u32; 3] = std::array::from_fn(|a| bricks[a].div_ceil(size[a]));
    let mut out = Vec::new();
    for s in 0..counts[slow] {
        for m in 0..counts[middle] {
            for f in 0..counts[fast] {
                let mut at = [0; 3];
                (at[slow], at[middle], at[fast]) = (s, m, f);
                let start: [u32; 3] = std::array::from_fn(|a| at[a] * size[a]);
                out.push(Tile { start, end: std::array::from_fn(|a| (start[a] + size[a]).min(bricks[a])) });
            }
        }
    }
    out
}

/// Cuts a brick with its apron out of a block of its level's voxels.
///
/// # Panics
/// If the block lacks a voxel of the brick's stored extent that lies in the grid.
#[must_use]
pub fn cut_brick(pyramid: &Pyramid, key: BrickKey, voxel_bytes: usize, block: VoxelBlock<'_>) -> Vec<u8> {
    let core = pyramid.core_box(key);
    let dims = pyramid.level_at(key.lod()).dims;
    let extent = pyramid.stored_extent(key);
    let block_extent = block.voxels.extent();
    // Position in the block of stored voxel i on an axis.
    let at = |axis: usize, i: usize| -> usize {
        let voxel = (core.start[axis] + i as u64).saturating_sub(APRON as u64).min(dims.0[axis] - 1);
        let offset = voxel.checked_sub(block.voxels.start[axis]).and_then(|o| usize::try_from(o).ok());
        offset
            .filter(|o| *o < block_extent[axis])
            .unwrap_or_else(|| panic!("voxel {voxel} of axis {axis} of {key} is outside the block {:?}", block.voxels))
    };
    let columns: Vec<usize> = (0..extent[0]).map(|x| at(0, x)).collect();
    // Columns are consecutive but where the grid's end repeats one.
    let run_start = columns.iter().rposition(|c| *c == columns[0]).expect("a brick has columns");
    let last = *columns.last().expect("a brick has columns");
    let run_end = columns.iter().position(|c| *c == last).expect("the last column is there") + 1;
    let mut out = Vec::with_capacity(extent.iter().product::<usize>() * voxel_bytes);
    for z in 0..extent[2] {
        for y in 0..extent[1] {
            let row_start = (at(2, z) * block_extent[1] + at(1, y)) * block_extent[0];
            let voxel = |column: usize| {
                let start = (row_start + column) * voxel_bytes;
                &block.bytes[start..start + voxel_bytes]
            };
            let run_start = run_start.min(run_end - 1);
            for _ in 0..run_start {
                out.extend_from_slice(voxel(columns[0]));
            }
            let (first, end) = (columns[run_start], columns[run_end - 1] + 1);
            out.extend_from_slice(&block.bytes[(row_start + first) * voxel_bytes..(row_start + end) * voxel_bytes]);
            for _ in run_end..extent[0] {
                out.extend_from_slice(voxel(last));
            }
        }
    }
    out
}

/// The key of a brick of a level.
#[must_use]
pub fn key_of(lod: usize, brick: BrickIndex) -> BrickKey {
    BrickKey::new(Lod(lod as u8), brick)
}

#[cfg(test)]
mod tests {
    use supervol_format::BrickLayout;

    use super::*;

    #[test]
    fn tiles_cover_every_brick_once_and_follow_the_source() {
        let pyramid =
            Pyramid::new(Dims([100, 70, 50]), BrickLayout::new(16).expect("16 is a core"), &[[2; 3], [2; 3], [2; 3]])
                .expect("a valid pyramid");
        let level = pyramid.level_at(Lod(0));
        for order in [AccessOrder::X_FASTEST, AccessOrder([1, 0, 2])] {
            let tiles = tiles(level, order, &|size| size.iter().product::<u32>() <= 16);
            let mut all: Vec<BrickIndex> = tiles.iter().flat_map(Tile::bricks).collect();
            assert_eq!(all.len() as u64, level.brick_count());
            all.sort();
            all.dedup();
            assert_eq!(all.len() as u64, level.brick_count());
            let fast = order.0[2];
            assert!(tiles[0].end[fast] >= 4, "the fastest axis grows first: {:?}", tiles[0]);
        }
    }

    #[test]
    fn bricks_at_the_grid_s_ends_repeat_their_last_voxels() {
        let dims = Dims([17, 1, 3]);
        let pyramid =
            Pyramid::new(dims, BrickLayout::new(16).expect("16 is a core"), &[[2, 1, 1]]).expect("a valid pyramid");
        let voxels: Vec<u8> = (0..51).collect();
        let block = VoxelBlock { voxels: dims.full_box(), bytes: &voxels };
        for x in 0..2u32 {
            let key = key_of(0, BrickIndex([x, 0, 0]));
            let [nx, ny, nz] = pyramid.stored_extent(key);
            let brick = cut_brick(&pyramid, key, 1, block);
            for (i, &value) in brick.iter().enumerate() {
                let local = [i % nx, i / nx % ny, i / nx / ny];
                let start = [i64::from(x) * 16, 0, 0];
                let voxel: [i64; 3] =
                    std::array::from_fn(|a| (start[a] + local[a] as i64 - 2).clamp(0, dims.0[a] as i64 - 1));
                assert_eq!(i64::from(value), voxel[0] + 17 * (voxel[1] + voxel[2]), "voxel {local:?} of {key}");
            }
            assert_eq!(brick.len(), nx * ny * nz);
        }
    }
}
