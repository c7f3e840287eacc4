//! Intervals of a ray parameter t: intersection, slabs and half-spaces. All numbers are `f64`. Direction components may
//! be zero, negative zero, or so small that a crossing overflows.

/// The part of a ray with `t0 <= t <= t1`; never empty: `t0 < t1`, both finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// World length at which the segment begins.
    pub t0: f64,
    /// World length at which it ends.
    pub t1: f64,
}

/// The t in `interval` with `low <= origin + t * direction <= high`.
#[must_use]
pub fn clip_slab(origin: f64, direction: f64, low: f64, high: f64, interval: (f64, f64)) -> Option<(f64, f64)> {
    let clipped = cut(interval, slab(origin, direction, [low, high]));
    (clipped.0 < clipped.1).then_some(clipped)
}

/// The t in `interval` with `distance + t * rate >= 0`.
#[must_use]
pub fn clip_half_space(distance: f64, rate: f64, interval: (f64, f64)) -> Option<(f64, f64)> {
    let clipped = cut(interval, half_space(distance, rate));
    (clipped.0 < clipped.1).then_some(clipped)
}

/// The interval of every t, and the empty interval.
const ALWAYS: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);
const NEVER: (f64, f64) = (f64::INFINITY, f64::NEG_INFINITY);

/// The t with `low <= origin + t * direction <= high`; branch-free, so that loops over many rays vectorise.
#[inline(always)]
#[must_use]
pub fn slab(origin: f64, direction: f64, [low, high]: [f64; 2]) -> (f64, f64) {
    // 0 / tiny is 0 and x / tiny may be infinite. NaN occurs only if the direction is 0, which the last line handles.
    let (a, b) = ((low - origin) / direction, (high - origin) / direction);
    let across = if direction > 0.0 { (a, b) } else { (b, a) };
    let along = if (low <= origin) & (origin <= high) { ALWAYS } else { NEVER };
    if direction == 0.0 { along } else { across }
}

/// The t with `distance + t * rate >= 0`; branch-free.
#[inline(always)]
#[must_use]
pub fn half_space(distance: f64, rate: f64) -> (f64, f64) {
    let t = -distance / rate;
    let across = if rate > 0.0 { (t, ALWAYS.1) } else { (ALWAYS.0, t) };
    let along = if distance >= 0.0 { ALWAYS } else { NEVER };
    if rate == 0.0 { along } else { across }
}

/// Intersection of two intervals; if it is empty, its end is not greater than its beginning.
#[inline(always)]
#[must_use]
pub fn cut((a0, a1): (f64, f64), (b0, b1): (f64, f64)) -> (f64, f64) {
    (if b0 > a0 { b0 } else { a0 }, if b1 < a1 { b1 } else { a1 })
}
