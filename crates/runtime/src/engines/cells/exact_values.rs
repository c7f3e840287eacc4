//! Values of rays from the container's own numbers, in `f64`: modes `mip`, `minip` and `mean`.
//!
//! Packets take this way through a brick if the rounding of `f32` might show.

use supervol_format::BrickKey;
use supervol_scene::scene::Mode;

use super::bounded::present;
use super::cell::{cubic_extremes, cubic_mean, cubic_of_cell, monotone_intervals};
use super::integrator::Integrator;
use super::visit::{BrickVisit, LevelVisit, StoredVoxel};
use crate::engines::ray::RayState;
use crate::engines::value_error::POSITION_ROUNDING;
use crate::stream::counters::RayCounters;
use crate::stream::residency::{DecodedBrick, Voxels};

/// Gathers over a ray's interval `t` in a brick.
pub(crate) fn gather_exact_values(
    level: LevelVisit<'_>,
    (key, brick): (BrickKey, &DecodedBrick),
    t: [f64; 2],
    state: &mut RayState,
    counters: &mut RayCounters,
) {
    let visit = BrickVisit::new(level, brick, key);
    state.t = t[0];
    // Packets count cells, and the macro cells that they leap over.
    let mut work = RayCounters::default();
    visit.march(t[1], &ExactValues, state, &mut work);
    counters.cells += work.cells;
    counters.cells_exact += work.cells;
    counters.macro_cells_skipped += work.macro_cells_skipped;
}

/// Gathers over the part of a ray in one trilinear cell of a brick. The cell's first corner lies `base` voxels from the brick's first;
/// `t` is the ray's interval in the brick.
pub(crate) fn gather_exact_value_cell(
    level: LevelVisit<'_>,
    (key, brick): (BrickKey, &DecodedBrick),
    base: usize,
    t: [f64; 2],
    state: &mut RayState,
) {
    let visit = BrickVisit::new(level, brick, key);
    let (index, t) = visit.chord_at_base(base, t);
    if t[0] < t[1] {
        match visit.voxels() {
            Voxels::U8(voxels) => gather_cell(&visit, (voxels, index), t, state),
            Voxels::U16(voxels) => gather_cell(&visit, (voxels, index), t, state),
            Voxels::F32(voxels) => gather_cell(&visit, (voxels, index), t, state),
        }
    }
}

/// Gathers over an interval in which every voxel has this data value.
pub(crate) fn gather_exact_uniform(level: &LevelVisit<'_>, data_value: f64, t: [f64; 2], state: &mut RayState) {
    if !level.axis_ray.is_rounding(t) {
        let value = data_value - level.map().shift;
        gather(level.scene.mode, value, [value; 2], t, state);
    }
}

/// Gathers values cell by cell.
#[derive(Debug)]
struct ExactValues;

impl Integrator for ExactValues {
    fn gather_macro_cell(
        &self,
        visit: &BrickVisit<'_>,
        index: [i64; 3],
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut RayCounters,
    ) {
        match visit.voxels() {
            Voxels::U8(voxels) => march(visit, (voxels, index), t, state, counters),
            Voxels::U16(voxels) => march(visit, (voxels, index), t, state, counters),
            Voxels::F32(voxels) => march(visit, (voxels, index), t, state, counters),
        }
    }

    fn gather_uniform(
        &self,
        visit: &LevelVisit<'_>,
        value: f32,
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut RayCounters,
    ) {
        counters.cells += 1;
        gather_exact_uniform(visit, visit.map().to_data(value), t, state);
    }
}

/// Gathers over the cells of one macro cell.
fn march<T: StoredVoxel>(
    visit: &BrickVisit<'_>,
    (voxels, index): (&[T], [i64; 3]),
    t: [f64; 2],
    state: &mut RayState,
    counters: &mut RayCounters,
) {
    visit.for_each_cell(index, t, |index, t| {
        counters.cells += 1;
        gather_cell(visit, (voxels, index), t, state);
        true
    });
}

fn gather_cell<T: StoredVoxel>(
    visit: &BrickVisit<'_>,
    (voxels, index): (&[T], [i64; 3]),
    t: [f64; 2],
    state: &mut RayState,
) {
    let (level, base) = (&visit.level, visit.base(index));
    if level.axis_ray.is_rounding(t) || cannot_change(level, &visit.corners(voxels, base), state) {
        return;
    }
    let [a, b] = t.map(|t| visit.cell_planes.fractions(level.axis_ray, t, index).map(snapped));
    let Some(corners) = present(visit.data_corners(voxels, base), a, b) else { return };
    // Render values without their rounding.
    let corners = corners.map(|value| value - level.map().shift);
    let [low, high] =
        corners.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &c| [low.min(c), high.max(c)]);
    let mode = level.scene.mode;
    let cubic = cubic_of_cell(&corners, a, b);
    let range = match mode {
        Mode::Mip | Mode::Minip => cubic_extremes(&cubic, monotone_intervals(&cubic).as_slice()),
        _ => (low, high),
    };
    // Rounding must not leave the corners' range.
    let range = [range.0, range.1].map(|value| value.clamp(low, high));
    gather(mode, cubic_mean(&cubic), range, t, state);
}

/// A position in a cell, moved onto a face within rounding: at a voxel, the transfer function may step.
fn snapped(position: f64) -> f64 {
    if position < POSITION_ROUNDING {
        0.0
    } else if position > 1.0 - POSITION_ROUNDING {
        1.0
    } else {
        position
    }
}

/// Whether a cell with these render values at its corners holds no extreme, whichever of them are absent.
fn cannot_change(level: &LevelVisit<'_>, corners: &[f32; 8], state: &RayState) -> bool {
    // `max` and `min` ignore NaN.
    let off = |end: f32| f64::from(level.map().distance_from_data(end.abs()));
    match level.scene.mode {
        Mode::Mip => {
            let high = corners.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            f64::from(high) + off(high) <= state.value
        }
        Mode::Minip => {
            let low = corners.iter().copied().fold(f32::INFINITY, f32::min);
            f64::from(low) - off(low) >= state.value
        }
        _ => false,
    }
}

/// Adds a part with this mean and these extremes to a ray.
fn gather(mode: Mode, mean: f64, [low, high]: [f64; 2], [begin, end]: [f64; 2], state: &mut RayState) {
    match mode {
        // `max` and `min` ignore NaN, which a ray has at first.
        Mode::Mip => state.value = high.max(state.value),
        Mode::Minip => state.value = low.min(state.value),
        Mode::Mean => {
            state.value = if state.value.is_nan() { 0.0 } else { state.value } + mean * (end - begin);
            state.length += end - begin;
        }
        Mode::Dvr | Mode::Iso | Mode::Slice => {}
    }
}
