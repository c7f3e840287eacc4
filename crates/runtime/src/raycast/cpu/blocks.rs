//! Which blocks of a brick may show something: cubes of [`BLOCK`] cells, eight in a macro cell.
//!
//! Containers keep ranges of macro cells. Where thin things run through nothing, most of a macro cell that shows something
//! shows nothing: there the ranges of its blocks are found from the voxels, once for a brick and a transfer function. Where
//! most macro cells show something that would not pay, and their blocks are all taken to.

use supervol_format::brick::MACRO_CELL;

use super::leap::{Ahead, BLOCK, ProximityCloud, macro_cells_of};
use super::walk::VALUE_ERROR;
use crate::raycast::volume::{DecodedBrick, ValueMap, Voxels};

/// Greatest share of macro cells that show something, in quarters, up to which voxels are looked at.
const SPARSE_QUARTERS: usize = 3;
/// Blocks along an edge of a macro cell.
const HALVES: usize = MACRO_CELL / BLOCK;
/// Voxels that are read at once along x: those of a macro cell's cells, and some.
const ROW: usize = 16;
/// Share of a range by which the line that stands for the field in a cell may reach beyond it and see something there.
const OVERSHOOT: f32 = 0.25;

/// The cloud of a brick's blocks; `shows` is asked for ranges of render values.
#[must_use]
pub fn cloud_of_blocks(
    brick: &DecodedBrick,
    apron: usize,
    ahead: [Ahead; 3],
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
                of_blocks[place] = ranges.is_none_or(|ranges| shows(ranges[half]));
            }
        }
    }
    ProximityCloud::of_shown(blocks, ahead, of_blocks.into_iter())
}

/// 0 for the lower block of a macro cell along an axis, 1 for the upper.
fn half_along(half: usize, axis: usize) -> usize {
    half >> axis & 1
}

/// Ranges of render values of the eight blocks of a macro cell.
fn ranges_of_blocks(brick: &DecodedBrick, apron: usize, cell: [usize; 3], map: &ValueMap) -> [[f32; 2]; 8] {
    let extent = brick.extent.map(|n| n as usize);
    let of_numbers = |[low, high]: [f32; 2]| {
        if low > high {
            return [low, high];
        }
        let ends = [low, high].map(|number| map.from_stored_number(number));
        widened([ends[0].min(ends[1]), ends[0].max(ends[1])], map.offset)
    };
    match &brick.voxels {
        Voxels::U8(v) => extremes(v, [u8::MAX, u8::MIN], extent, apron, cell).map(|r| of_numbers(r.map(f32::from))),
        Voxels::U16(v) => extremes(v, [u16::MAX, u16::MIN], extent, apron, cell).map(|r| of_numbers(r.map(f32::from))),
        Voxels::F32(v) => extremes(v, [f32::INFINITY, f32::NEG_INFINITY], extent, apron, cell).map(|r| widened(r, 0.0)),
    }
}

/// A range and what packets may find beside it: interpolation in `f32`, and lines that stand for curves. What the walk through
/// a block would add, however little, is not leapt over. The empty range, `low > high`, stays empty.
fn widened([low, high]: [f32; 2], offset: f32) -> [f32; 2] {
    if low > high {
        return [low, high];
    }
    let rounding = 2.0 * VALUE_ERROR * (low.abs().max(high.abs()) + offset.abs());
    let margin = OVERSHOOT * (high - low) + rounding;
    [low - margin, high + margin]
}

/// Least and greatest number of the voxels that interpolation in each of the eight blocks of a macro cell reaches; the ends
/// of the type where there are none. NaN is passed over.
fn extremes<T: Copy + PartialOrd>(
    voxels: &[T],
    ends: [T; 2],
    extent: [usize; 3],
    apron: usize,
    cell: [usize; 3],
) -> [[T; 2]; 8] {
    let mut found = [ends; 8];
    // The first cell of a brick is -1.
    let voxels_of = |axis: usize, half: usize| {
        let first = cell[axis] * MACRO_CELL + half * BLOCK;
        let last = (first + BLOCK + apron).min(extent[axis] - 1);
        first + apron - usize::from(first == 0)..=last
    };
    let first_x = cell[0] * MACRO_CELL + apron - 1;
    for rows in 0..HALVES * HALVES {
        let (half_y, half_z) = (rows % HALVES, rows / HALVES);
        let (mut low, mut high) = ([ends[0]; ROW], [ends[1]; ROW]);
        for z in voxels_of(2, half_z) {
            for y in voxels_of(1, half_y) {
                let row = row_from(voxels, first_x + extent[0] * (y + extent[1] * z), ends[0]);
                for i in 0..ROW {
                    low[i] = if row[i] < low[i] { row[i] } else { low[i] };
                    high[i] = if row[i] > high[i] { row[i] } else { high[i] };
                }
            }
        }
        for half_x in 0..HALVES {
            let range = &mut found[half_x + HALVES * rows];
            for x in voxels_of(0, half_x) {
                let i = x - first_x;
                range[0] = if low[i] < range[0] { low[i] } else { range[0] };
                range[1] = if high[i] > range[1] { high[i] } else { range[1] };
            }
        }
    }
    found
}

/// [`ROW`] voxels from a place on; `behind` where the array ends.
#[inline(always)]
fn row_from<T: Copy>(voxels: &[T], place: usize, behind: T) -> [T; ROW] {
    match voxels.get(place..place + ROW) {
        Some(row) => row.try_into().expect("a slice of ROW voxels"),
        None => {
            let mut row = [behind; ROW];
            row.iter_mut().zip(&voxels[place.min(voxels.len())..]).for_each(|(to, from)| *to = *from);
            row
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer_function::render::RenderTransferFunction;
    use crate::transfer_function::{ControlPoint, TransferFunction};
    use supervol_format::{BrickIndex, BrickKey, Lod, ValueRange, VoxelType};

    const NOTHING: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

    #[test]
    fn blocks_in_which_nothing_is_present_show_nothing() {
        // Two macro cells along x; of the first the lower half is present, of the second nothing.
        let (apron, extent) = (2, [20, 12, 12]);
        let value = |i: usize| if i % 20 < apron + BLOCK { 0.5 } else { f32::NAN };
        let brick = DecodedBrick {
            key: BrickKey::new(Lod::FINEST, BrickIndex([0; 3])),
            extent,
            voxels: Voxels::F32((0..extent.iter().product::<u32>() as usize).map(value).collect()),
            macro_ranges: vec![[0.5; 2], NOTHING],
        };
        let full = ValueRange { min: 0.0, max: 1.0 };
        let map = ValueMap::for_container(VoxelType::F32, 1.0, 0.0, None, full);
        let ranges = ranges_of_blocks(&brick, apron, [0; 3], &map);
        for (half, range) in ranges.into_iter().enumerate() {
            let is_present = half_along(half, 0) == 0;
            assert!(if is_present { range[0] < 0.5 && 0.5 < range[1] } else { range == NOTHING }, "{half}: {range:?}");
        }
        // Everything shows, whatever its value.
        let point = |value| ControlPoint { value, color: [1.0; 3], alpha: 1.0 };
        let function = TransferFunction::new(vec![point(0.0), point(1.0)], 1.0).unwrap();
        let render = RenderTransferFunction::new(&function, map.shift);
        let cloud = cloud_of_blocks(&brick, apron, [Ahead::Both; 3], &map, |[low, high]| render.is_visible(low, high));
        assert_eq!(cloud.cells, [4, 2, 2]);
        for (i, &distance) in cloud.distances[..16].iter().enumerate() {
            assert_eq!(usize::from(distance), i % 4, "block {i}");
        }
    }
}
