//! Conversions between kinds of numbers. Each says why its loss is wanted, or why there is none.
//!
//! All of them saturate, and NaN becomes 0, as `as` defines it.

/// The nearest `f32`: rounding to single precision is wanted. Too large numbers become infinite.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "rounding to single precision is wanted")]
pub const fn single(value: f64) -> f32 {
    value as f32
}

/// The whole number of an `f64` that was rounded before.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "saturating; the number has no fraction")]
pub const fn integer(value: f64) -> i64 {
    value as i64
}

/// An index or a count from a position: rounded towards zero, and 0 for negative positions.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating; rounding down is wanted")]
pub const fn index(place: f64) -> usize {
    place as usize
}

/// An index or a length as a signed number.
#[inline(always)]
#[expect(clippy::cast_possible_wrap, reason = "lengths in memory are below 2^63")]
pub const fn signed(n: usize) -> i64 {
    n as i64
}

/// The number of an item in a list: vertices, triangles, control points, pixels of a row.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "every list here has a limit far below 2^32")]
pub const fn number(n: usize) -> u32 {
    n as u32
}

/// A row or column of a picture from a position: rounded down; not negative.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating; rounding down is wanted")]
pub const fn pixel(place: f64) -> u32 {
    place as u32
}

/// A bin from a position in single precision: rounded towards zero, and 0 for negative positions.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating; rounding down is wanted")]
pub const fn bin(place: f32) -> usize {
    place as usize
}

/// A channel of 8 bits from a whole number between 0 and 255.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating; the number is in range")]
pub const fn byte(value: f64) -> u8 {
    value as u8
}

/// A stored number of 16 bits from a whole number in its range.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating; the number is in range")]
pub const fn short(value: f64) -> u16 {
    value as u16
}

/// The number of a level of detail.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "a pyramid has at most 64 levels")]
pub const fn level(number: usize) -> u8 {
    number as u8
}

/// The number of a vertex from a whole number between 0 and `u32::MAX`.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating; the number is in range")]
pub const fn vertex(value: f64) -> u32 {
    value as u32
}

/// The number of a label: a whole number that is not negative.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturating; the number is in range")]
pub const fn label(value: f64) -> u64 {
    value as u64
}

/// The binary exponent of a number; infinite ones saturate.
#[expect(clippy::cast_possible_truncation, reason = "saturating; exponents of f64 have 11 bits")]
pub const fn exponent(value: f64) -> i32 {
    value as i32
}

/// The radius of a kernel in texels, from a whole number.
#[expect(clippy::cast_possible_truncation, reason = "saturating; sizes of filters have a limit")]
pub const fn radius(value: f32) -> i32 {
    value as i32
}

/// The index of a texel that was clamped to the grid.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the crate runs where usize has 64 bits")]
pub const fn unsigned(n: i64) -> usize {
    n as usize
}

/// The length of the header of a NumPy file.
#[cfg(feature = "images")]
#[expect(clippy::cast_possible_truncation, reason = "the header has about 100 bytes")]
pub const fn header_length(bytes: usize) -> u16 {
    bytes as u16
}
