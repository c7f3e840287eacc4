//! Integer conversions that lose nothing on the 64-bit targets that this crate compiles for.
//!
//! The standard library has no such conversion, because it also serves 32-bit targets. Byte sizes and numbers of bricks
//! are `u64`; lengths and indices in memory are `usize`. Conversions that can lose bits do not belong here.

/// Index or length in memory of a 64-bit number. Lossless on the 64-bit targets that this crate compiles for.
///
/// The result is not checked against the length of any buffer.
#[inline(always)]
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "the crate compiles only where usize has 64 bits")]
pub const fn index(n: u64) -> usize {
    n as usize
}
