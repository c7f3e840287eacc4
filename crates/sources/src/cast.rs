//! Number conversions that can lose something, each with the reason why the loss is wanted or impossible.
//!
//! A number from a file is never converted by these without a check: it is compared with its limits first, or
//! `try_from` gives an error.

pub(crate) use supervol_format::cast::index;

/// The nearest f32. Rounding is wanted: the voxels are f32.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is wanted")]
pub(crate) const fn single(n: f64) -> f32 {
    n as f32
}

/// The whole part of a number, saturating; NaN gives 0.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "the fraction is dropped on purpose; the cast saturates")]
pub(crate) const fn whole(n: f64) -> i64 {
    n as i64
}

/// The whole part of a number, saturating at the limits of i32; NaN gives 0.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "the fraction is dropped on purpose; the cast saturates")]
pub(crate) const fn whole_i32(n: f64) -> i32 {
    n as i32
}

/// The whole part of an f32, saturating at the limits of i32; NaN gives 0.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "the fraction is dropped on purpose; the cast saturates")]
pub(crate) const fn whole_of_single(n: f32) -> i32 {
    n as i32
}

/// The whole part of a number, saturating; negative numbers and NaN give 0.
#[inline(always)]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the fraction is dropped on purpose; the cast saturates"
)]
pub(crate) const fn whole_u64(n: f64) -> u64 {
    n as u64
}

/// The lowest 32 bits of a number.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "the lowest bits are wanted")]
pub(crate) const fn low_32(n: u64) -> u32 {
    n as u32
}

/// The lowest 16 bits of a number.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "the lowest bits are wanted")]
pub(crate) const fn low_16(n: u32) -> u16 {
    n as u16
}

/// The lowest 8 bits of a number.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "the lowest bits are wanted")]
pub(crate) const fn low_8(n: u32) -> u8 {
    n as u8
}

/// The whole part of a number, exactly for all finite numbers below 2^127; others saturate.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "the fraction is dropped on purpose; the cast saturates")]
pub(crate) const fn whole_i128(n: f64) -> i128 {
    n as i128
}

/// A count or position as a signed number, for differences.
///
/// # Panics
/// If it is 2^63 or more: callers compare counts with smaller limits before.
#[inline(always)]
pub(crate) fn signed(n: u64) -> i64 {
    i64::try_from(n).expect("counts and positions are below 2^63")
}
