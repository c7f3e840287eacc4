//! Slot contents of a decoded brick: its voxels as texels, the ranges of its macro cells, and those of their blocks.

use supervol_format::brick::{APRON, MACRO_CELL};
use supervol_format::cast::whole;

use crate::engines::blocks::ranges_of_blocks;
use crate::engines::gpu::cache::{BlockRanges, EMPTY_BLOCK, EMPTY_RANGE, SlotContents, WHOLE_BLOCK};
use crate::engines::gpu::caster::GpuRenderer;
use crate::engines::gpu::error::GpuError;
use crate::engines::gpu::texels::VoxelStorage;
use crate::stream::residency::{DecodedBrick, Voxels};

/// Width of a macro cell's range, relative to its values, below which `f32` cannot divide it: its blocks get the whole
/// range.
const LEAST_WIDTH: f32 = 1.0 / 1024.0;
/// Margin for rounding at the end of a part, in parts.
const PART_MARGIN: f32 = 1.0 / 16.0;

impl GpuRenderer {
    /// The slot contents of a brick.
    ///
    /// # Errors
    /// [`GpuError::Brick`] if the brick does not match the pyramid.
    pub(super) fn contents_of(&self, brick: &DecodedBrick) -> Result<SlotContents, GpuError> {
        let voxels = self.checked_voxels(brick)?;
        let (ranges, blocks) = self.slot_ranges(brick);
        Ok(SlotContents { texels: self.storage.texels_of(brick.extent, voxels), ranges, blocks })
    }

    fn checked_voxels<'b>(&self, brick: &'b DecodedBrick) -> Result<&'b [u8], GpuError> {
        let wrong = |reason: String| Err(GpuError::Brick { key: brick.key, reason });
        let (storage, voxels): (_, &[u8]) = match &brick.voxels {
            Voxels::U8(v) => (VoxelStorage::U8, v),
            Voxels::U16(v) => (VoxelStorage::U16, bytemuck::cast_slice(v)),
            Voxels::F32(v) => (VoxelStorage::F32, bytemuck::cast_slice(v)),
        };
        if !self.pyramid.contains(brick.key) {
            return wrong("the pyramid has no such brick".to_owned());
        }
        let expected = self.pyramid.stored_extent(brick.key);
        if brick.extent.map(|n| n as usize) != expected {
            return wrong(format!("its extent is {:?}, expected {expected:?}", brick.extent));
        }
        if storage != self.storage {
            return wrong(format!("its voxels are {storage:?}, expected {:?}", self.storage));
        }
        let bytes = expected.iter().product::<usize>() * storage.bytes() as usize;
        if voxels.len() != bytes {
            return wrong(format!("it has {} bytes of voxels, expected {bytes}", voxels.len()));
        }
        let cells = self.pyramid.macro_cells(brick.key).iter().product::<usize>();
        if brick.macro_ranges.len() != cells {
            return wrong(format!("it has {} macro ranges, expected {cells}", brick.macro_ranges.len()));
        }
        Ok(voxels)
    }

    /// The ranges of a full slot's macro cells, and of their blocks; those without a value are empty.
    fn slot_ranges(&self, brick: &DecodedBrick) -> (Vec<[f32; 2]>, Vec<BlockRanges>) {
        let edge = self.pyramid.layout().core() / MACRO_CELL;
        let [nx, ny, _] = self.pyramid.macro_cells(brick.key);
        let mut ranges = vec![EMPTY_RANGE; edge.pow(3)];
        let mut blocks = vec![[EMPTY_BLOCK; 8]; edge.pow(3)];
        for (i, &[low, high]) in brick.macro_ranges.iter().enumerate() {
            if low <= high && low.is_finite() && high.is_finite() {
                let cell @ [x, y, z] = [i % nx, i / nx % ny, i / (nx * ny)];
                let place = x + edge * (y + edge * z);
                ranges[place] = [low, high];
                blocks[place] = self.blocks_of(brick, cell, [low, high]);
            }
        }
        (ranges, blocks)
    }

    /// The ranges of a macro cell's blocks within its own.
    fn blocks_of(&self, brick: &DecodedBrick, cell: [usize; 3], range @ [low, high]: [f32; 2]) -> BlockRanges {
        let width = high - low;
        if !(width.is_finite() && width > LEAST_WIDTH * low.abs().max(high.abs())) {
            return [WHOLE_BLOCK; 8];
        }
        ranges_of_blocks(brick, APRON, cell, &self.value_map).map(|block| share_of(range, block))
    }
}

/// Begin and end of a block's range within that of its macro cell, in parts of it, rounded outwards.
fn share_of([low, high]: [f32; 2], block: [f32; 2]) -> [u8; 2] {
    if block[0] > block[1] {
        return EMPTY_BLOCK;
    }
    let parts = block.map(|end| (end - low) / (high - low) * f32::from(u8::MAX));
    [whole::<u8>((parts[0] - PART_MARGIN).floor()), whole::<u8>((parts[1] + PART_MARGIN).ceil())]
}

#[cfg(test)]
mod tests {
    use supervol_format::random::Random;

    use super::*;

    #[test]
    fn shares_hold_their_blocks() {
        // The same formula as in classify_cells.wgsl.
        let end = |[low, high]: [f32; 2], part: u8| match part {
            u8::MAX => high,
            part => low + (high - low) * (f32::from(part) / f32::from(u8::MAX)),
        };
        let mut random = Random::new(5);
        let mut greatest = 0.0f32;
        for _ in 0..20_000 {
            let middle = (random.unit() as f32 - 0.5) * 1e4;
            let width = (middle.abs() * 2.0 * LEAST_WIDTH).max(1e-3) * (1.0 + 100.0 * random.unit() as f32);
            let range = [middle - 0.5 * width, middle + 0.5 * width];
            let mut block = [0, 1].map(|_| (range[0] + width * random.unit() as f32).clamp(range[0], range[1]));
            block.sort_by(f32::total_cmp);
            let share = share_of(range, block);
            let found = [end(range, share[0]), end(range, share[1])];
            assert!(found[0] <= block[0] && block[1] <= found[1], "{block:?} of {range:?}: {share:?}, {found:?}");
            greatest = greatest.max((block[0] - found[0]).max(found[1] - block[1]) / width);
        }
        assert!(greatest < 1.2 / 255.0, "{greatest} of a range");
        assert_eq!(share_of([1.0, 2.0], [1.0, 2.0]), WHOLE_BLOCK);
        assert_eq!(share_of([1.0, 2.0], [f32::INFINITY, f32::NEG_INFINITY]), EMPTY_BLOCK);
    }
}
