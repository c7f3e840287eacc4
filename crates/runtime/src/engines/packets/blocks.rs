//! Visible blocks of a brick: cubes of [`BLOCK`] cells, eight in a macro cell.
//!
//! Containers store ranges of macro cells. Around thin structures, most of a visible macro cell is invisible. There the
//! ranges of its blocks are computed from the voxels, once for a brick and a transfer function. If most macro cells are
//! visible this does not pay, and all their blocks count as visible.

use supervol_scene::value_map::ValueMap;

use super::leap::{AxisDirection, ProximityCloud, macro_cells_of};
use crate::engines::blocks::{BLOCK, HALVES, ranges_of_blocks};
use crate::engines::rules::VALUE_ERROR;
use crate::stream::residency::DecodedBrick;

/// Greatest share of visible macro cells, in quarters, for which voxels are examined.
const SPARSE_QUARTERS: usize = 3;
/// Share of a range by which the line that replaces the field in a cell may overshoot it.
pub const OVERSHOOT: f32 = 0.25;
/// The same of the range of a block, with room for the rounding of positions in its cells.
const OVERSHOOT_OF_BLOCK: f32 = 0.26;

/// The cloud of a brick's blocks; `shows` is called with ranges of render values.
#[must_use]
pub fn cloud_of_blocks(
    brick: &DecodedBrick,
    apron: usize,
    ahead: [AxisDirection; 3],
    map: &ValueMap,
    shows: impl Fn([f32; 2]) -> bool,
) -> ProximityCloud<BLOCK> {
    let counts = macro_cells_of(brick, apron);
    let shown: Vec<bool> = brick.macro_ranges.iter().map(|&range| shows(range)).collect();
    let shown_count = shown.iter().filter(|&&shows| shows).count();
    let core = brick.extent.map(|n| n as usize - 2 * apron);
    let blocks = core.map(|n| n.div_ceil(BLOCK));
    let mut of_blocks = vec![false; blocks.iter().product()];
    let is_sparse = 4 * shown_count <= SPARSE_QUARTERS * shown.len();
    for (i, _) in shown.iter().enumerate().filter(|(_, shows)| **shows) {
        let cell = [i % counts[0], i / counts[0] % counts[1], i / (counts[0] * counts[1])];
        let ranges = is_sparse.then(|| ranges_of_blocks(brick, apron, cell, map));
        for half in 0..HALVES.pow(3) {
            let block: [usize; 3] = std::array::from_fn(|a| HALVES * cell[a] + half_along(half, a));
            if (0..3).all(|a| block[a] < blocks[a]) {
                let place = block[0] + blocks[0] * (block[1] + blocks[1] * block[2]);
                of_blocks[place] = ranges.is_none_or(|ranges| shows(widened(ranges[half], map.offset)));
            }
        }
    }
    ProximityCloud::of_shown(blocks, ahead, of_blocks.into_iter())
}

/// 0 for the lower block of a macro cell along an axis, 1 for the upper.
fn half_along(half: usize, axis: usize) -> usize {
    half >> axis & 1
}

/// A range widened by what packets may add to it: interpolation in `f32`, and lines in place of curves. So no block is
/// leapt over that would contribute, however little. The empty range, `low > high`, stays empty.
fn widened([low, high]: [f32; 2], offset: f32) -> [f32; 2] {
    if low > high {
        return [low, high];
    }
    let rounding = 2.0 * VALUE_ERROR * (low.abs().max(high.abs()) + offset.abs());
    let margin = OVERSHOOT_OF_BLOCK * (high - low) + rounding;
    [low - margin, high + margin]
}

#[cfg(test)]
mod tests {
    use supervol_format::{BrickIndex, BrickKey, Lod, ValueRange, VoxelType};
    use supervol_scene::transfer_function::render::RenderTransferFunction;
    use supervol_scene::transfer_function::{ControlPoint, TransferFunction};

    use super::*;
    use crate::stream::residency::Voxels;

    const NOTHING: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

    #[test]
    fn blocks_in_which_nothing_is_present_show_nothing() {
        // Two macro cells along x: in the first the lower half is present, in the second nothing.
        let (apron, extent) = (2, [20, 12, 12]);
        let value = |i: usize| if i % 20 < apron + BLOCK { 0.5 } else { f32::NAN };
        let brick = DecodedBrick {
            key: BrickKey::new(Lod::FINEST, BrickIndex([0; 3])),
            extent,
            voxels: Voxels::F32((0..extent.iter().product::<u32>() as usize).map(value).collect()),
            macro_ranges: vec![[0.5; 2], NOTHING],
            rounding: 0.0,
            unrounded: None,
            macro_errors: Vec::new(),
        };
        let full = ValueRange { min: 0.0, max: 1.0 };
        let map = ValueMap::for_container(VoxelType::F32, 1.0, 0.0, None, full);
        let ranges = ranges_of_blocks(&brick, apron, [0; 3], &map);
        for (half, range) in ranges.into_iter().enumerate() {
            let is_present = half_along(half, 0) == 0;
            assert_eq!(range, if is_present { [0.5; 2] } else { NOTHING }, "{half}");
            let [low, high] = widened(range, map.offset);
            assert!(
                if is_present { low < 0.5 && 0.5 < high } else { [low, high] == NOTHING },
                "{half}: {low} to {high}"
            );
        }
        // Everything is visible, whatever its value.
        let point = |value| ControlPoint { value, color: [1.0; 3], alpha: 1.0 };
        let function = TransferFunction::new(vec![point(0.0), point(1.0)], 1.0).unwrap();
        let render = RenderTransferFunction::new(&function, map.shift);
        let cloud =
            cloud_of_blocks(&brick, apron, [AxisDirection::Both; 3], &map, |[low, high]| render.is_visible(low, high));
        assert_eq!(cloud.cells, [4, 2, 2]);
        for (i, &distance) in cloud.distances[..16].iter().enumerate() {
            assert_eq!(usize::from(distance), i % 4, "block {i}");
        }
    }
}
