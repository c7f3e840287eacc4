//! Twins of shader functions that the CPU does not use: places in textures, marks of surfaces, rays in a brick. They
//! have the names of the shader functions. `tests/pictures/gpu_walk_twins.rs` compares both. `tests/pictures/gpu_twin_list.rs` lists the
//! functions without a twin, with the reason.

use glam::{Mat3, Vec3};
use supervol_format::brick::MACRO_CELL;
use supervol_format::cast::{narrow, single, whole};

use super::layout::{Config, STEP_OF_BYTES};
use crate::engines::cells::cell::{cubic_at, monotone_root};
use crate::engines::cells::quadrature::shaded_pair_count;
use crate::engines::gpu::limits::{FAR, LEAP_MARGIN};
use crate::engines::rules::{EASY, HARD, LEAST_PART, PARTS_LIMIT, PARTS_PER_ROOT};

/// Number of a macro cell among those of all slots.
#[must_use]
pub fn macro_place(slot: u32, core: u32, [x, y, z]: [u32; 3]) -> u32 {
    let edge = core / narrow::<u32>(MACRO_CELL);
    slot * edge.pow(3) + x + edge * (y + edge * z)
}

/// A byte of four rows of four, and its neighbours along the row, in the next row, and both.
#[must_use]
pub fn bytes_of_square(texel: [u32; 4], [x, y]: [u32; 2]) -> [u32; 4] {
    let bytes: Vec<u8> = texel.iter().flat_map(|word| word.to_le_bytes()).collect();
    let row = STEP_OF_BYTES + 1;
    [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| u32::from(bytes[(x + dx + row * (y + dy)) as usize]))
}

/// A number of eight of 16 bits, and the next one.
#[must_use]
pub fn halves_of_pair(texel: [u32; 4], place: u32) -> [u32; 2] {
    let halves: Vec<u32> = texel.iter().flat_map(|word| [word & 0xffff, word >> 16]).collect();
    [place, place + 1].map(|i| halves[i as usize])
}

/// One bit for each surface whose value is not above this one.
#[must_use]
pub fn sides_of(isos: &[f32], value: f32) -> u32 {
    isos.iter().enumerate().map(|(i, &iso)| u32::from(value >= iso) << i).sum()
}

/// One bit for each surface.
#[must_use]
pub fn all_surfaces(isos: &[f32]) -> u32 {
    (0..isos.len()).map(|i| 1 << i).sum()
}

/// Whether surfaces that count lie between two values, or between them and the ray's side, if it is known.
#[must_use]
pub fn meets_surfaces(isos: &[f32], range: [f32; 2], sides: Option<u32>, crossed: u32) -> bool {
    (0..isos.len()).any(|i| {
        let inside = range[0] < isos[i] && isos[i] <= range[1];
        let jumped = sides.is_some_and(|sides| (sides >> i & 1 == 1) != (range[0] >= isos[i]));
        (inside || jumped) && crossed >> i & 1 == 0
    })
}

/// Stored numbers as values of the transfer function's pieces.
#[must_use]
pub fn values_of(config: &Config, numbers: [u32; 4]) -> [f32; 4] {
    numbers.map(|n| (n as f32 - config.light_centre) * config.light_scale + config.light_offset)
}

/// A ray in a brick: the parameter per voxel and the parameter of plane 0 for each axis, and the distance by which a
/// leap ends behind a face.
#[must_use]
pub fn light_ray(origin: [f32; 3], direction: [f32; 3]) -> ([f32; 3], [f32; 3], f32) {
    let inverse = direction.map(|d| if d == 0.0 { 0.0 } else { 1.0 / d });
    let offset = std::array::from_fn(|a| if direction[a] == 0.0 { FAR } else { -origin[a] * inverse[a] });
    (inverse, offset, LEAP_MARGIN / direction.iter().fold(0.0f32, |most, d| most.max(d.abs())))
}

/// The cell at a position of a ray in a brick.
#[must_use]
pub fn cell_at(core: u32, origin: [f32; 3], direction: [f32; 3], t: f32) -> [f32; 3] {
    std::array::from_fn(|a| (origin[a] + t * direction[a]).floor().clamp(-1.0, core as f32 - 1.0))
}

/// The macro cell at a position of a ray in a brick: faces lie half a voxel before multiples of its edge.
#[must_use]
pub fn macro_cell_at(origin: [f32; 3], direction: [f32; 3], t: f32) -> [f32; 3] {
    std::array::from_fn(|a| ((origin[a] + t * direction[a] + 0.5) / MACRO_CELL as f32).floor())
}

/// Whether the error of a part of a ray was small enough.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PartVerdict {
    /// It was: the next part lies behind this one.
    Taken,
    /// It was not: a smaller part takes its place.
    Refused,
}

/// Length of the part behind one that was taken, or in place of one that was refused; `ratio`: its error in parts of what it may spend.
#[must_use]
pub fn next_size(size: f32, ratio: f32, verdict: PartVerdict) -> f32 {
    let factor = match verdict {
        PartVerdict::Taken if ratio < EASY => 2.0,
        PartVerdict::Taken => 1.0,
        // For a whole cell, the error falls with the square of the number of parts.
        PartVerdict::Refused if size == 1.0 => {
            let parts = (PARTS_PER_ROOT * ratio.min(PARTS_LIMIT * PARTS_LIMIT).sqrt()).floor() + 1.0;
            1.0 / parts.clamp(2.0, PARTS_LIMIT)
        }
        PartVerdict::Refused if ratio > HARD => 0.25,
        PartVerdict::Refused => 0.5,
    };
    (size * factor).max(LEAST_PART)
}

/// Parameter from a ray's base point to the end of its segment.
#[must_use]
pub fn segment_end(stride: f32, strides: u32, end_strides: u32, end_rest: f32) -> f32 {
    (i64::from(end_strides) - i64::from(strides)) as f32 * stride + end_rest
}

/// Strides and parameter of a ray once its base point has been moved to the last stride that it has passed.
#[must_use]
pub fn rebase(stride: f32, strides: u32, t: f32) -> (u32, f32) {
    let passed = (t / stride).floor();
    (strides + whole::<u32>(passed), t - passed * stride)
}

/// (Least, greatest) corner.
#[must_use]
pub fn range_of_corners(corners: &[f32; 8]) -> [f32; 2] {
    [corners.iter().fold(f32::INFINITY, |a, &b| a.min(b)), corners.iter().fold(f32::NEG_INFINITY, |a, &b| a.max(b))]
}

/// The field at u of a chord, within the range of its cell.
#[must_use]
pub fn value_at(cubic: &[f64; 4], range: [f32; 2], u: f64) -> f64 {
    cubic_at(cubic, u).clamp(f64::from(range[0]), f64::from(range[1]))
}

/// Side of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ValueSide {
    /// Less than the value.
    Below,
    /// The value, or more.
    AtOrAbove,
}

/// Position at which the field first lies on the other side of a value than `before`.
#[must_use]
pub fn first_change(cubic: &[f64; 4], intervals: &[f64], value: f64, before: ValueSide) -> Option<f64> {
    let at_begin = if cubic_at(cubic, 0.0) >= value { ValueSide::AtOrAbove } else { ValueSide::Below };
    if at_begin != before {
        return Some(0.0);
    }
    intervals.windows(2).find_map(|piece| monotone_root(cubic, piece[0], piece[1], value))
}

/// World-space gradient at u of a chord, from a cubic for each index axis; `scale`: from the brick's level to level 0.
#[must_use]
pub fn gradient_at(world_from_index: Mat3, cubics: &[[f32; 4]; 3], scale: Vec3, u: f32) -> Vec3 {
    let at = |c: &[f32; 4]| c[0] + u * (c[1] + u * (c[2] + u * c[3]));
    world_from_index * (Vec3::from_array(cubics.each_ref().map(at)) * scale)
}

/// Coefficient of the third power of the same gradient.
#[must_use]
pub fn cubic_of_gradient(world_from_index: Mat3, cubics: &[[f32; 4]; 3], scale: Vec3) -> Vec3 {
    world_from_index * (Vec3::from_array(cubics.each_ref().map(|c| c[3])) * scale)
}

/// Gauss pairs for light on a part of a chord, by the turn of the normal.
#[must_use]
pub fn shaded_pairs(normal_at: impl Fn(f32) -> Vec3, [u0, u1]: [f32; 2], tau: f32) -> u32 {
    let middle = normal_at(0.5 * (u0 + u1));
    shaded_pair_count(normal_at(u0).distance(middle) + middle.distance(normal_at(u1)), tau)
}

/// One bit for each number that means absent.
#[must_use]
pub fn is_absent(numbers: [u32; 4], absent: u32) -> u32 {
    (0..4).map(|i| u32::from(numbers[i] == absent) << i).sum()
}

/// A normal, from the gradient.
#[must_use]
pub fn normal_at(gradient: Vec3) -> Vec3 {
    gradient.normalize_or_zero()
}

/// Sides of surfaces of the field at u of a chord.
#[must_use]
pub fn sides_at(isos: &[f32], cubic: &[f64; 4], range: [f32; 2], u: f64) -> u32 {
    sides_of(isos, single(value_at(cubic, range, u)))
}

/// Unit world vector of a direction in index space.
#[must_use]
pub fn world_direction(world_from_index: Mat3, direction: Vec3) -> Vec3 {
    (world_from_index * direction).normalize()
}

/// Render values of a cell's stored numbers, those with x = 0 and those with x = 1; absent ones are 0.
#[must_use]
pub fn corners_of_stored(config: &Config, near: [u32; 4], far: [u32; 4]) -> [f32; 8] {
    let value = |n: u32| if n == config.absent { 0.0 } else { n as f32 * config.value_scale + config.value_offset };
    std::array::from_fn(|i| value(if i % 2 == 0 { near[i / 2] } else { far[i / 2] }))
}

/// The same as values of the transfer function's pieces, where no number is absent.
#[must_use]
pub fn light_cell(config: &Config, near: [u32; 4], far: [u32; 4]) -> [f32; 8] {
    let [near, far] = [near, far].map(|numbers| values_of(config, numbers));
    std::array::from_fn(|i| if i % 2 == 0 { near[i / 2] } else { far[i / 2] })
}

/// The value at a position in a cell. The cell is [0, 1]^3; corner c has the offsets (c & 1, c >> 1 & 1, c >> 2).
#[must_use]
pub fn value_in(corners: &[f32; 8], [x, y, z]: [f32; 3]) -> f32 {
    let row = |c: usize| corners[c] + x * (corners[c + 1] - corners[c]);
    let layer = |c: usize| row(c) + y * (row(c + 2) - row(c));
    layer(0) + z * (layer(4) - layer(0))
}

/// Coefficient of xyz.
#[must_use]
pub fn twist_of(corners: &[f32; 8]) -> f32 {
    let rise = |c: usize| corners[c + 1] - corners[c];
    (rise(6) - rise(4)) - (rise(2) - rise(0))
}
