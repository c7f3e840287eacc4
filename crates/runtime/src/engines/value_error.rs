//! Values of rays in the modes `mip`, `minip` and `mean`: what they may be off by, and what the picture allows
//! (docs/bounds.md, "Values of rays"). Data units.

use supervol_format::ValueRange;
use supervol_scene::clip::ROUNDED_LENGTH;
use supervol_scene::scene::Mode;
use supervol_scene::transfer_function::TransferFunction;
use supervol_scene::value_map::ValueMap;

use super::rules::{POSITION_ERROR, VALUE_ERROR, rounding_error};

/// Moves of a place by the rounding of positions: on each axis, at an end of a chord and beside it.
const MOVES: f64 = 6.0;
/// Greatest coefficient of a chord's cubic, in widths of the range of its cell's corners.
const COEFFICIENTS: f64 = 8.0;
/// Positions that a chord of the mode `mean` may lack or have too much of: those of both ends, on both sides.
const ENDS: f64 = 4.0;
/// Bound on the rounding of a position in `f64`, in cells, up to a million voxels along an axis.
pub const POSITION_ROUNDING: f64 = 1e-9;
/// Twice that, for a position that is moved onto a face, with parts of rays that are too short to count ([`ROUNDED_LENGTH`]).
const EXACT_POSITION: f64 = ROUNDED_LENGTH + 2.0 * POSITION_ROUNDING;
/// Bound on the rounding of an interpolated value in `f64`, in parts of it.
const EXACT_VALUE: f64 = 1e-14;
/// Error of a value by the positions and sums of a graphics device, as a share of the range of all values.
const DEVICE_ESTIMATE: f64 = 1e-5;
/// Share of E that the change of the transfer function over the error of a value may take. The rest is for the square of that error.
const SHARE: f64 = 0.9;

/// Bound on what the value of a ray is off by if it is computed in `f32`; all values lie in `range`. `core`: voxels along an edge of a
/// full brick's core.
#[must_use]
pub fn by_f32(mode: Mode, map: &ValueMap, range: ValueRange, core: usize) -> f64 {
    if range.is_empty() {
        return 0.0;
    }
    let greatest = map.greatest_within(range);
    let of_positions = MOVES * f64::from(POSITION_ERROR) * range.width();
    let of_values = f64::from(VALUE_ERROR) * (f64::from(greatest) + COEFFICIENTS * range.width());
    let of_sums = match mode {
        Mode::Mean => (ENDS * f64::from(POSITION_ERROR) + rounding_error(core)) * range.width(),
        _ => 0.0,
    };
    of_positions + of_values + of_sums + f64::from(map.distance_from_data(greatest))
}

/// The same on a graphics device: an estimate, and no bound, of what positions and sums do.
#[must_use]
pub fn by_device(map: &ValueMap, range: ValueRange) -> f64 {
    if range.is_empty() {
        return 0.0;
    }
    DEVICE_ESTIMATE * range.width() + f64::from(map.distance_from_data(map.greatest_within(range)))
}

/// The same for a value that is computed in `f64` from the container's own numbers.
#[must_use]
pub fn by_f64(range: ValueRange) -> f64 {
    if range.is_empty() {
        return 0.0;
    }
    MOVES * EXACT_POSITION * range.width() + EXACT_VALUE * range.min.abs().max(range.max.abs())
}

/// Greatest error of a value that keeps the picture within `max_error`: 0 if the transfer function has a step.
#[must_use]
pub fn tolerated(transfer_function: &TransferFunction, max_error: f64) -> f64 {
    let steepness = transfer_function.points().windows(2).map(|pair| {
        let color = (0..3).map(|c| (pair[1].color[c] - pair[0].color[c]).abs()).fold(0.0, f64::max);
        let change = color + (pair[1].alpha - pair[0].alpha).abs();
        if change == 0.0 { 0.0 } else { change / (pair[1].value - pair[0].value) }
    });
    let steepest = steepness.fold(0.0, f64::max);
    if steepest == 0.0 { f64::INFINITY } else { SHARE * max_error / steepest }
}

#[cfg(test)]
mod tests {
    use supervol_format::VoxelType;
    use supervol_scene::transfer_function::ControlPoint;

    use super::*;

    const RANGE: ValueRange = ValueRange { min: 0.0, max: 200.0 };

    fn function(points: &[(f64, f64, f64)]) -> TransferFunction {
        let point = |&(value, red, alpha): &(f64, f64, f64)| ControlPoint { value, color: [red, 0.0, 0.0], alpha };
        TransferFunction::new(points.iter().map(point).collect(), 1.0).unwrap()
    }

    #[test]
    fn steep_functions_tolerate_little_and_steps_nothing() {
        let gentle = function(&[(0.0, 0.0, 0.0), (100.0, 0.5, 0.5)]);
        assert!((tolerated(&gentle, 0.01) - 0.9 * 0.01 * 100.0).abs() < 1e-12);
        assert_eq!(tolerated(&function(&[(0.0, 0.3, 0.4), (9.0, 0.3, 0.4)]), 0.01), f64::INFINITY);
        assert_eq!(tolerated(&function(&[(0.0, 0.3, 0.4), (5.0, 0.3, 0.4), (5.0, 0.3, 0.6)]), 0.01), 0.0);
    }

    #[test]
    fn scaled_numbers_are_farther_off_than_whole_ones() {
        let of = |scale| ValueMap::for_container(VoxelType::U8, scale, 0.0, None, RANGE);
        let [whole, scaled] = [of(1.0), of(0.1)].map(|map| by_f32(Mode::Mip, &map, RANGE, 64));
        assert!(whole < scaled && scaled < whole + 1e-4, "{whole} and {scaled}");
        assert!(by_f32(Mode::Mean, &of(1.0), RANGE, 64) > whole && by_f64(RANGE) < 1e-2 * whole);
        assert!(by_device(&of(1.0), RANGE) > by_f64(RANGE) && by_device(&of(0.1), RANGE) > by_device(&of(1.0), RANGE));
        assert_eq!(by_f32(Mode::Mip, &of(1.0), ValueRange::EMPTY, 64), 0.0);
    }
}
