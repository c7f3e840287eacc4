//! Cutting of stored bricks out of the voxels of a tile.
//!
//! Voxels beyond the grid repeat the nearest voxel of the grid, as the rendering model clamps indices.

use supervol_format::brick::APRON;
use supervol_format::{BrickKey, Pyramid};

use crate::pipeline::reduce::downsample::VoxelBlock;

/// Stored voxels of a brick, with its apron, from a block of its level's voxels.
///
/// # Panics
/// If the block lacks a voxel of the grid that the brick stores.
#[must_use]
pub fn cut_brick(pyramid: &Pyramid, key: BrickKey, voxel_bytes: usize, block: VoxelBlock<'_>) -> Vec<u8> {
    let core = pyramid.core_box(key);
    let dims = pyramid.level_at(key.lod()).dims;
    let extent = pyramid.stored_extent(key);
    let block_extent = block.voxels.extent();
    // Position of stored voxel i in the block, along one axis.
    let at = |axis: usize, i: usize| -> usize {
        let voxel = (core.start[axis] + i as u64).saturating_sub(APRON as u64).min(dims.0[axis] - 1);
        let offset = voxel.checked_sub(block.voxels.start[axis]).and_then(|o| usize::try_from(o).ok());
        offset
            .filter(|o| *o < block_extent[axis])
            .unwrap_or_else(|| panic!("voxel {voxel} of axis {axis} of {key} is outside the block {:?}", block.voxels))
    };
    let columns: Vec<usize> = (0..extent[0]).map(|x| at(0, x)).collect();
    // Columns are consecutive, except where they repeat the grid's last one.
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

#[cfg(test)]
mod tests {
    use supervol_format::{BrickIndex, BrickLayout, Dims, Lod};

    use super::*;

    #[test]
    fn bricks_at_the_grid_s_ends_repeat_their_last_voxels() {
        let dims = Dims([17, 1, 3]);
        let pyramid =
            Pyramid::new(dims, BrickLayout::new(16).expect("16 is a core"), &[[2, 1, 1]]).expect("a valid pyramid");
        let voxels: Vec<u8> = (0..51).collect();
        let block = VoxelBlock { voxels: dims.full_box(), bytes: &voxels };
        for x in 0..2u32 {
            let key = BrickKey::new(Lod::FINEST, BrickIndex([x, 0, 0]));
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
