//! Number conversions that the standard library lacks, each with the reason why nothing is lost, or why a loss is wanted.
//!
//! They compile to a plain `as`. With debug assertions, as in all tests, [`narrow`] checks that nothing is lost. A number
//! from a file is never converted by these: it is compared with its limits first, or `try_from` gives an error.

/// Index or length in memory of a 64-bit number. Lossless on the 64-bit targets that this crate compiles for.
///
/// The result is not checked against the length of any buffer.
#[inline(always)]
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "the crate compiles only where usize has 64 bits")]
pub const fn index(n: u64) -> usize {
    n as usize
}

/// The nearest `f32`: single precision is enough there.
#[inline(always)]
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is wanted")]
pub const fn single(x: f64) -> f32 {
    x as f32
}

/// The number in another integer type, which holds it: the program's own limits see to that.
///
/// # Panics
/// With debug assertions, if the type does not hold it.
#[inline(always)]
#[must_use]
pub fn narrow<T>(n: impl Narrow<T>) -> T {
    n.narrow()
}

/// The whole part of a number, towards zero. It saturates at the limits of the type; NaN gives 0.
#[inline(always)]
#[must_use]
pub fn whole<T>(x: impl Whole<T>) -> T {
    x.whole()
}

/// Integers that [`narrow`] converts to `T`.
pub trait Narrow<T> {
    /// See [`narrow`].
    fn narrow(self) -> T;
}

/// Floating-point numbers that [`whole`] converts to `T`.
pub trait Whole<T> {
    /// See [`whole`].
    fn whole(self) -> T;
}

macro_rules! narrow {
    ($($from:ty => $($to:ty),+;)+) => {$($(
        impl Narrow<$to> for $from {
            #[inline(always)]
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_possible_wrap,
                clippy::cast_sign_loss,
                reason = "checked with debug assertions"
            )]
            fn narrow(self) -> $to {
                debug_assert!(<$to>::try_from(self).is_ok(), "{self} does not fit {}", stringify!($to));
                self as $to
            }
        }
    )+)+};
}

narrow! {
    usize => u8, u16, u32, i32, i64, isize;
    u64 => u8, u16, u32, usize, i32, i64;
    u32 => u8, u16, i16, i32;
    i64 => u8, u16, u32, u64, usize, i32;
    i32 => u8, u16, u32, usize;
    isize => usize;
}

macro_rules! whole {
    ($($from:ty => $($to:ty),+;)+) => {$($(
        impl Whole<$to> for $from {
            #[inline(always)]
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "the fraction is dropped on purpose; the cast saturates"
            )]
            fn whole(self) -> $to {
                self as $to
            }
        }
    )+)+};
}

whole! {
    f32 => u8, u16, u32, u64, usize, i32, i64;
    f64 => u8, u16, u32, u64, usize, i16, i32, i64, i128;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_parts_saturate() {
        assert_eq!([whole::<u8>(-3.5f64), whole(255.9f64), whole(1e9f64), whole(f64::NAN)], [0, 255, 255, 0]);
        assert_eq!([whole::<i32>(-3.5f32), whole(f32::INFINITY), whole(f32::NAN)], [-3, i32::MAX, 0]);
        assert_eq!(single(0.1).to_bits(), 0.1f32.to_bits());
    }

    #[test]
    fn narrow_numbers_stay_what_they_are() {
        assert_eq!((narrow::<u32>(7usize), narrow::<i32>(7usize), narrow::<usize>(7i64)), (7, 7, 7));
    }

    #[test]
    #[cfg(debug_assertions)]
    #[should_panic(expected = "256 does not fit u8")]
    fn numbers_that_do_not_fit_are_found() {
        let _: u8 = narrow(256usize);
    }
}
