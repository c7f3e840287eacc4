//! Tolerances of the integral: every number by which an engine decides what is exact enough, once.
//!
//! E is the error that is asked for: of any channel of any pixel, 1 being white. Numbers that shaders use as well are written
//! into `shaders/shared/layout.wgsl` by [`super::gpu::layout`]. The measurements are in docs/decisions, by number.

use supervol_scene::scene::Mode;

// What E sets.

/// Least and greatest E that packets and the GPU aim at: below, `f32` ends; above, nothing is gained.
pub const MAX_ERROR_LIMITS: [f64; 2] = [0.05 / 255.0, 16.0 / 255.0];
/// E that users get: half a grey level, which no screen shows.
pub const DEFAULT_ERROR: f64 = 0.5 / 255.0;
/// Opacity at which a ray of the cell caster, and a ray of any caster in mode `iso`, ends. What lies behind changes no channel
/// by more than 0.08/255, and no mean of channels by a tenth of a grey level.
pub const TERMINATION_OPACITY: f64 = 0.9997;
/// Opacity that no ray has.
pub const NEVER: f64 = 2.0;
/// Share of E that cells of packets may be off by per opacity: no ray gathers more than one whole. A greater share left less to cells
/// that need more, and took more time on six of seven pictures (045).
pub const BY_OPACITY: f64 = 0.15;
/// Part of what is left of a ray's reserve that one cell may use. With 0.03 to 0.05 time is least, and 0.15 takes up to seven times
/// as much: cells that come late are cut too finely (045).
pub const RESERVE_SHARE: f32 = 0.05;
/// Share of that which a part may be off by in the order of its light, without a closer look at it.
pub const ORDER_SHARE: f32 = 0.1;
/// Least share of E that is kept for cells, whatever rounding takes.
const LEAST_RESERVE: f64 = 0.1;
/// Share of E that is left out behind the point where a ray ends in mode `dvr`: a bound (006).
pub const END_SHARE: f64 = 0.15;
/// Share of E that extinction, in parts of itself, may be off by: the fit of the transfer function's pieces; emission as much.
pub const FIT_SHARE: f64 = 0.05;
/// Share of E that a cell's light may be, and not be shaded: 2,000 such cells in a row make E.
pub const LEAST_SHADED_SHARE: f64 = 5e-4;
/// Roundings of colour and of optical depth in a cell.
const ROUNDINGS: f64 = 4.0;
/// Half the distance of 1 from the next `f32`.
const HALF_EPSILON: f64 = 0.5 * f32::EPSILON as f64;
/// Error below which tables and `f32` of the GPU do not let roots and pairs of Gauss come, whatever E is.
pub const LEAST_AIMED: f64 = 0.25 / 255.0;

/// Error that those cells of a ray of packets may have together which need more than [`BY_OPACITY`] gives them: what the other terms
/// leave of E. `core`: see [`rounding_error`].
#[must_use]
pub fn reserve(max_error: f64, core: usize) -> f64 {
    let left = (1.0 - BY_OPACITY - END_SHARE) * max_error - fit_error(max_error) - rounding_error(core);
    left.max(LEAST_RESERVE * max_error)
}

/// Share of E for everything but surfaces, in pictures with surfaces inside the volume. Surfaces were off by 0.007 levels at most
/// in three pictures of a carp; with half of E for all else, these took 1.34 times as long.
pub const BESIDE_SURFACES: f64 = 0.8;

/// Error of a ray that surfaces inside the volume aim at, where all else has this share of E.
#[must_use]
pub fn surfaces_error(beside: f64) -> f64 {
    beside * (1.0 - BESIDE_SURFACES) / BESIDE_SURFACES
}

/// Error of a ray that roots and pairs of Gauss aim at: what the other terms leave of E. `core`: see [`rounding_error`].
#[must_use]
pub fn aimed_error(max_error: f64, core: usize) -> f64 {
    ((1.0 - END_SHARE) * max_error - fit_error(max_error) - rounding_error(core)).max(LEAST_RESERVE * max_error)
}

/// Error of a ray by the fit of the transfer function's pieces: extinction and emission are each off by at most
/// [`FIT_SHARE`] of E times the extinction, and no ray gathers more than one whole.
#[must_use]
pub fn fit_error(max_error: f64) -> f64 {
    2.0 * FIT_SHARE * max_error
}

/// Error of a ray that has gathered something, by `f32`: sums over the cells of a brick whose core has so many voxels along an edge.
#[must_use]
pub fn rounding_error(core: usize) -> f64 {
    // A ray leaves a cell through a plane of voxels.
    let cells_per_brick = 3 * core + 1;
    ROUNDINGS * cells_per_brick as f64 * HALF_EPSILON
}

/// Error of a ray of this opacity that belongs to no single cell: in mode `dvr` of the fit and of rounding, and what surfaces, roots and
/// pairs of Gauss aim at (`aimed`, 0 without these); in mode `iso` E, which is aimed at. `core`: see [`rounding_error`].
#[must_use]
pub fn own_error(mode: Mode, opacity: f64, max_error: f64, aimed: f64, core: usize) -> f64 {
    match mode {
        Mode::Dvr if opacity > 0.0 => fit_error(max_error) * opacity + rounding_error(core) + aimed,
        Mode::Iso if opacity > 0.0 => max_error.max(aimed),
        _ => 0.0,
    }
}

// Places and values in `f32`.

/// Bound on the rounding of a position, in cells: `f32` over the 132 voxels of the largest brick.
pub const POSITION_ERROR: f32 = 2e-5;
/// Bound on the rounding of an interpolated value, in parts of it.
pub const VALUE_ERROR: f32 = 5e-7;
/// Noise, in parts of the difference between a line's ends, up to which these tell where on the line a value lies.
pub const SHORT_BESIDE_NOISE: f32 = 0.25;

// One chord by antiderivatives: see `packets::integrate`, which derives the rule.

/// Mean distance of a parabola from its mean, in parts of its bump: 0.2566, rounded up.
pub const AVERAGE_OF_BUMP: f32 = 0.2567;
/// The same of a cubic's odd part, in parts of its coefficient: 1/32. The parabola's is rounded up by more than this is down.
pub const AVERAGE_OF_CUBIC: f32 = 0.03126;
/// Mean square distance of a parabola from its mean, in parts of the square of its bump.
pub const SQUARE_OF_BUMP: f32 = 4.0 / 45.0;
/// The same of a cubic's odd part, in parts of the square of its coefficient.
pub const SQUARE_OF_CUBIC: f32 = 1.0 / 840.0;
/// Greatest integral of a parabola's distance from its mean, from its beginning on, in parts of its bump: `1 / (9 sqrt(3))`.
pub const SWING_OF_BUMP: f32 = 0.06416;
/// The same of a cubic's odd part, in parts of its coefficient.
pub const SWING_OF_CUBIC: f32 = 1.0 / 64.0;
/// Greatest distance of a cubic's odd part, in parts of its coefficient: 0.0481, rounded up.
pub const GREATEST_OF_CUBIC: f32 = 0.05;
/// Coefficient of the squared depth in `R(tau) ~ 1 / (12 + 6 tau + 1.2 tau^2 + 0.1 tau^3)`, and of its cube: the series of the exact
/// rational of exponentials.
pub const ORDER_SQUARE: f32 = 1.2;
/// See [`ORDER_SQUARE`].
pub const ORDER_CUBE: f32 = 0.1;
/// Greatest effect of order on two colours that differ by 1: it is below `tau^2 / (8 + MOST_OF_ORDER tau + tau^2)`, by up to 3 %.
pub const MOST_OF_ORDER: f32 = 3.7;
/// Depth up to which R goes by that series: beyond, the rational loses nothing by rounding.
pub const SERIES_UP_TO: f32 = 1.0;
/// Error of R, in parts of the opacity and the cubed depth: 9.92e-6, rounded up.
pub const ORDER_OF_DEPTH: f32 = 1.0e-5;
/// Error of R, in parts of opacity, depth and squared tilt, where the extinction rises by the tilt t from end to end, relative to its
/// mean, and R is multiplied by `1 + t tau / 20`: up to [`TILT_LIMIT`], and from [`LEAST_TILT`] on. Below that, the tilt falls only once.
pub const ORDER_OF_TILT: f32 = 1.65e-4;
/// See [`ORDER_OF_TILT`].
pub const LEAST_TILT: f32 = 1.9;
/// Depth beyond which that grows no more, for tilts up to 2.
pub const OPAQUE_TILT: f32 = 4.0;
/// See [`ORDER_OF_TILT`]: the greatest of a quadratic that is nowhere negative is 3.46.
pub const TILT_LIMIT: f32 = 4.0;
/// Mean origin of light of even extinction, before the middle: `tau / (12 + LEAN_SQUARE tau^2)`, within `1e-5 tau^5` of the
/// exact `coth(tau / 2) / 2 - 1 / tau`.
pub const LEAN_SQUARE: f32 = 0.2;
/// Its mean square distance from there: `1 / (12 + SPREAD_SQUARE tau^2)`, within `5e-5 tau^4`.
pub const SPREAD_SQUARE: f32 = 0.6;
/// Greatest distance of the integral of a density from that of the line with the same sum and moment, in parts of its greatest second
/// derivative: 0.00802, rounded up.
pub const OF_CURVE: f32 = 0.0081;
/// The same where the line's moment is that of the density's ends: a moment that is off by 1/192 moves the integral by 1.5 times that.
pub const OF_CURVES: f32 = 0.0159;
/// In parts of a change of slope: 0.01616, rounded up.
pub const OF_KINK: f32 = 0.0162;
/// The same where the line's moment is that of the density's ends: 1/54, rounded up.
pub const OF_UNSETTLED_KINK: f32 = 0.0186;
/// The same of any bends, where the line has the density's ends, shifted to the same sum: 1/32, rounded up.
pub const OF_BENDS: f32 = 0.0313;
/// The same where the line has the moment of some of them, which moves the integral by up to 1.5 times [`MOMENT_OF_KINK`] more.
pub const OF_ANY_BENDS: f32 = 0.0434;
/// Most that a kink moves the first moment by where the line has the density's ends, in parts of a change of slope: `1 / (72 sqrt(3))`,
/// rounded up.
pub const MOMENT_OF_KINK: f32 = 0.00803;
/// In parts of the height of a step, where the line's moment is that of the density's ends: 1/8.
pub const OF_STEP: f32 = 0.125;

// Refinement: cells cut into parts (006, "What 6,000 scenes showed").

/// Most parts that a cell is cut into at once.
pub const PARTS_LIMIT: f32 = 64.0;
/// Most parts that are tried for one cell, without light and with it; then it is integrated in `f64` (053). Without light, 32 took
/// 0.81 of the time of 512 for seismic data, and 16 took 0.91; with it, 128 took 0.95 to 0.99, and 64 up to 1.37.
pub const TRIES_LIMITS: [f32; 2] = [32.0, 128.0];
/// Shortest part, in cells.
pub const LEAST_PART: f32 = 1.0 / 16384.0;
/// Parts that are not halved any more: half of one, and what is left over behind it, would be one part again.
pub const SHORTEST: f32 = 2.0 * LEAST_PART;
/// Length of parts, in cells, from which on a cell is integrated in `f64` if rounding alone makes more than its tolerance.
pub const ROUNDED_BELOW: f32 = 1.0 / 64.0;
/// Parts per square root of the error: what is left is then well below the tolerance. 1.0 made within 3 % as many parts.
pub const PARTS_PER_ROOT: f32 = 1.4;
/// Share of a cell's tolerance that its parts are cut for. The rest is for parts that are not halved any more: around the places where
/// the gradient becomes too short for a normal.
pub const PARTS_SHARE: f32 = 0.8;
/// Least share of a cell's tolerance that a part may use up, however short it is: few parts of a cell are so hard.
pub const LEAST_SHARE: f32 = 1.0 / 4.0;
/// Share of what is allowed, below which the next part is twice as long. Another one made within 3 % as many parts.
pub const EASY: f32 = 1.0 / 8.0;
/// Multiple of what is allowed, from which the next part is a quarter as long, not half.
pub const HARD: f32 = 16.0;
/// Error left after refinement, in tolerances, from which a cell is integrated in `f64`.
pub const EXACT_FROM: f32 = 1.001;
/// Share of a cell's tolerance that all but the light may use up, for the light alone to be made certain: parts of the cell
/// would make the rest certain too. 0.6 left a seventh to a third fewer cells to refinement, in the same time.
pub const REST_SHARE: f32 = 0.25;

// Gauss pairs between roots: the cell caster, and shaders where the transfer function has steps.

/// Change of opacity and colour that one Gauss pair may bridge; the error falls with the fourth power of their number.
pub const PAIR_VARIATION: f32 = 0.006;
/// E that the numbers of pairs are for: others take (this / E)^(1/4) times as many (026).
pub const PAIR_ERROR: f64 = 0.5 / 255.0;
/// More pairs per change: extinction is not linear in opacity, so that steep pieces need more than the fourth root says.
pub const PAIRS_PER_VARIATION: f32 = 1.3;
/// Product of that change and of the optical depth that one Gauss pair may bridge.
pub const PAIR_VARIATION_DEPTH: f32 = 0.07;
/// Change of the normal's direction, as a length, that one Gauss pair may bridge.
pub const PAIR_NORMAL_CHANGE: f32 = 0.085;
/// Product of that change and of the optical depth that one Gauss pair may bridge.
pub const PAIR_NORMAL_DEPTH: f32 = 0.3;
/// Least weight of the farther Gauss point, where the exponential underflows.
pub const MIN_WEIGHT: f32 = 1e-20;
/// Turn of the normal, as a length, from which a part of a chord is halved: where the gradient passes by zero, the normal turns
/// over in a small share of it.
pub const PART_NORMAL_CHANGE: f32 = 1.0;

// Pieces of the transfer function on the GPU.

/// Share of the greatest channel by which a channel may change within 1/4096 of the function's width; where one changes by more, roots
/// find the step.
pub const STEEPEST_BIN: f64 = 1.0 / 8.0;
