//! Integers that transforms compute with: 16 bits for voxels of one byte, which halves the memory traffic, else 32 bits.
//! All arithmetic wraps, so that a transform can be reversed exactly for any samples.

/// Integer with wrapping arithmetic.
pub trait Sample: Copy + Default + PartialEq {
    /// The lowest bits of a number.
    fn wrap(number: i32) -> Self;
    fn number(self) -> i32;
    fn plus(self, other: Self) -> Self;
    fn minus(self, other: Self) -> Self;
    /// `floor(self / 2^BITS)`.
    fn shifted<const BITS: u32>(self) -> Self;
    /// Unsigned zigzag number: 0, -1, 1, -2, ... become 0, 1, 2, 3, ...
    fn zigzagged(self) -> u32;
    /// Reverses [`Sample::zigzagged`]; the bits of `self` are the unsigned number.
    fn unzigzagged(self) -> Self;
}

macro_rules! sample {
    ($t:ty, $unsigned:ty) => {
        impl Sample for $t {
            #[inline(always)]
            #[allow(clippy::cast_possible_truncation, reason = "the lowest bits are wanted; i32 keeps all")]
            fn wrap(number: i32) -> Self {
                number as Self
            }
            #[inline(always)]
            fn number(self) -> i32 {
                i32::from(self)
            }
            #[inline(always)]
            fn plus(self, other: Self) -> Self {
                self.wrapping_add(other)
            }
            #[inline(always)]
            fn minus(self, other: Self) -> Self {
                self.wrapping_sub(other)
            }
            #[inline(always)]
            fn shifted<const BITS: u32>(self) -> Self {
                self >> BITS
            }
            #[inline(always)]
            fn zigzagged(self) -> u32 {
                ((self << 1) ^ (self >> (Self::BITS - 1))) as $unsigned as u32
            }
            #[inline(always)]
            fn unzigzagged(self) -> Self {
                (self as $unsigned >> 1) as Self ^ (self & 1).wrapping_neg()
            }
        }
    };
}
sample!(i16, u16);
sample!(i32, u32);
