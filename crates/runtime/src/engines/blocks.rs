//! Ranges of blocks: cubes of [`BLOCK`] cells of a brick, eight in a macro cell.
//!
//! Containers keep ranges of macro cells. Around thin structures, most of a visible macro cell shows nothing. Ranges of
//! its blocks, computed from the voxels, let rays leap over these parts. The first cell of a brick, -1, belongs to its
//! first block.

use supervol_format::brick::MACRO_CELL;
use supervol_scene::value_map::ValueMap;

use crate::stream::residency::{DecodedBrick, Voxels};

/// Edge of a block, in cells.
pub const BLOCK: usize = MACRO_CELL / 2;
/// Blocks along an edge of a macro cell.
pub const HALVES: usize = MACRO_CELL / BLOCK;
/// Voxels that are read at once along x: those of a macro cell's cells, and some.
const ROW: usize = 16;

/// Ranges of render values of the eight blocks of a macro cell, x fastest; `low > high`: no voxel is present.
#[must_use]
pub fn ranges_of_blocks(brick: &DecodedBrick, apron: usize, cell: [usize; 3], map: &ValueMap) -> [[f32; 2]; 8] {
    let extent = brick.extent.map(|n| n as usize);
    let of_numbers = |[low, high]: [f32; 2]| {
        if low > high {
            return [low, high];
        }
        let ends = [low, high].map(|number| map.from_stored_number(number));
        [ends[0].min(ends[1]), ends[0].max(ends[1])]
    };
    match &brick.voxels {
        Voxels::U8(v) => extremes(v, [u8::MAX, u8::MIN], extent, apron, cell).map(|r| of_numbers(r.map(f32::from))),
        Voxels::U16(v) => extremes(v, [u16::MAX, u16::MIN], extent, apron, cell).map(|r| of_numbers(r.map(f32::from))),
        Voxels::F32(v) => extremes(v, [f32::INFINITY, f32::NEG_INFINITY], extent, apron, cell),
    }
}

/// Least and greatest number of each of the eight blocks of a macro cell, over the voxels that interpolation in the
/// block reaches. Without such voxels: the ends of the type. NaN is ignored.
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
