//! Number conversions that can lose something, each with the reason why the loss is wanted or impossible.
//!
//! A number from a file is never converted by these without a check: it is compared with its limits first, or
//! `try_from` gives an error.

pub(crate) use supervol_format::cast::{index, single, whole};

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

/// A count or position as a signed number, for differences.
///
/// # Panics
/// If it is 2^63 or more: callers compare counts with smaller limits before.
#[inline(always)]
pub(crate) fn signed(n: u64) -> i64 {
    i64::try_from(n).expect("counts and positions are below 2^63")
}
