//! Arrays of 4 lanes: no intrinsics, correct everywhere; the compiler vectorises them as the target allows.

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Not, Sub};

use supervol_format::cast::whole;

use super::{LANES_LIMIT, Simd, TaskOf};

const LANES: usize = 4;

/// Lanes in plain arrays.
#[derive(Debug, Clone, Copy)]
pub struct Portable;

/// One `f32` per lane.
#[derive(Debug, Clone, Copy)]
pub struct Floats([f32; LANES]);

/// One `i32` per lane.
#[derive(Debug, Clone, Copy)]
pub struct Ints([i32; LANES]);

/// All ones or all zeros per lane.
#[derive(Debug, Clone, Copy)]
pub struct Mask([u32; LANES]);

/// An array of `f` for each lane. Unrolled by hand: with loops, the compiler spends half of its time for this crate on
/// unrolling.
#[inline(always)]
fn lanes<R>(f: impl Fn(usize) -> R) -> [R; LANES] {
    [f(0), f(1), f(2), f(3)]
}

#[inline(always)]
fn map<A: Copy, R>(a: [A; LANES], f: impl Fn(A) -> R) -> [R; LANES] {
    lanes(|lane| f(a[lane]))
}

#[inline(always)]
fn each<A: Copy, B: Copy, R>(a: [A; LANES], b: [B; LANES], f: impl Fn(A, B) -> R) -> [R; LANES] {
    lanes(|lane| f(a[lane], b[lane]))
}

#[inline(always)]
fn truth(holds: bool) -> u32 {
    if holds { u32::MAX } else { 0 }
}

impl Add for Floats {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a + b))
    }
}

impl Sub for Floats {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a - b))
    }
}

impl Mul for Floats {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a * b))
    }
}

impl Div for Floats {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a / b))
    }
}

impl Add for Ints {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(each(self.0, other.0, i32::wrapping_add))
    }
}

impl Mul for Ints {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(each(self.0, other.0, i32::wrapping_mul))
    }
}

impl BitAnd for Mask {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a & b))
    }
}

impl BitOr for Mask {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(each(self.0, other.0, |a, b| a | b))
    }
}

impl Not for Mask {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(map(self.0, |a| !a))
    }
}

impl Simd for Portable {
    const LANES: usize = LANES;
    type F = Floats;
    type I = Ints;
    type M = Mask;

    #[inline(always)]
    fn splat(value: f32) -> Floats {
        Floats([value; LANES])
    }

    #[inline(always)]
    fn splat_int(value: i32) -> Ints {
        Ints([value; LANES])
    }

    #[inline(always)]
    fn load(values: &[f32; LANES_LIMIT]) -> Floats {
        Floats(lanes(|lane| values[lane]))
    }

    #[inline(always)]
    fn load_int(values: &[i32; LANES_LIMIT]) -> Ints {
        Ints(lanes(|lane| values[lane]))
    }

    #[inline(always)]
    fn store(values: Floats, into: &mut [f32; LANES_LIMIT]) {
        into[..LANES].copy_from_slice(&values.0);
    }

    #[inline(always)]
    fn store_int(values: Ints, into: &mut [i32; LANES_LIMIT]) {
        into[..LANES].copy_from_slice(&values.0);
    }

    #[inline(always)]
    fn compress(values: Floats, mask: Mask, into: &mut [f32; LANES_LIMIT]) {
        let mut next = 0;
        for lane in 0..LANES {
            into[next] = values.0[lane];
            next += (mask.0[lane] & 1) as usize;
        }
    }

    #[inline(always)]
    fn expand(values: Floats, mask: Mask, others: Floats) -> Floats {
        let (mut out, mut next) = (others, 0);
        for lane in 0..LANES {
            if mask.0[lane] & 1 == 1 {
                out.0[lane] = values.0[next];
                next += 1;
            }
        }
        out
    }

    #[inline(always)]
    fn mul_add(a: Floats, b: Floats, c: Floats) -> Floats {
        // Not fused: without an instruction for it, fusing is a function call per lane.
        a * b + c
    }

    #[inline(always)]
    fn min(a: Floats, b: Floats) -> Floats {
        Floats(each(a.0, b.0, |a, b| if a < b { a } else { b }))
    }

    #[inline(always)]
    fn max(a: Floats, b: Floats) -> Floats {
        Floats(each(a.0, b.0, |a, b| if a > b { a } else { b }))
    }

    #[inline(always)]
    fn abs(a: Floats) -> Floats {
        Floats(map(a.0, f32::abs))
    }

    #[inline(always)]
    fn sum(a: Floats) -> f32 {
        let [a, b, c, d] = a.0;
        a + b + c + d
    }

    #[inline(always)]
    fn sqrt(a: Floats) -> Floats {
        Floats(map(a.0, f32::sqrt))
    }

    #[inline(always)]
    fn floor(a: Floats) -> Floats {
        Floats(map(a.0, f32::floor))
    }

    #[inline(always)]
    fn exp2_whole(n: Floats) -> Floats {
        // n + 127 is the exponent's field.
        Floats(map(n.0, |n| f32::from_bits((whole::<i32>(n) + 127).cast_unsigned() << 23)))
    }

    #[inline(always)]
    fn to_int(a: Floats) -> Ints {
        Ints(map(a.0, whole::<i32>))
    }

    #[inline(always)]
    fn to_float(a: Ints) -> Floats {
        Floats(map(a.0, |a| a as f32))
    }

    #[inline(always)]
    fn shift_right<const SHIFT: u32>(a: Ints) -> Ints {
        Ints(map(a.0, |a| a >> SHIFT))
    }

    #[inline(always)]
    fn and_int(a: Ints, b: Ints) -> Ints {
        Ints(each(a.0, b.0, |a, b| a & b))
    }

    #[inline(always)]
    fn lt(a: Floats, b: Floats) -> Mask {
        Mask(each(a.0, b.0, |a, b| truth(a < b)))
    }

    #[inline(always)]
    fn le(a: Floats, b: Floats) -> Mask {
        Mask(each(a.0, b.0, |a, b| truth(a <= b)))
    }

    #[inline(always)]
    fn is_nan(a: Floats) -> Mask {
        Mask(map(a.0, |a| truth(a.is_nan())))
    }

    #[inline(always)]
    fn lt_int(a: Ints, b: Ints) -> Mask {
        Mask(each(a.0, b.0, |a, b| truth(a < b)))
    }

    #[inline(always)]
    fn eq_int(a: Ints, b: Ints) -> Mask {
        Mask(each(a.0, b.0, |a, b| truth(a == b)))
    }

    #[inline(always)]
    fn select(mask: Mask, a: Floats, b: Floats) -> Floats {
        let chosen = each(a.0, b.0, |a, b| (a.to_bits(), b.to_bits()));
        Floats(each(mask.0, chosen, |mask, (a, b)| f32::from_bits(a & mask | b & !mask)))
    }

    #[inline(always)]
    fn select_int(mask: Mask, a: Ints, b: Ints) -> Ints {
        let chosen = each(a.0, b.0, |a, b| (a, b));
        Ints(each(mask.0, chosen, |mask, (a, b)| a & mask.cast_signed() | b & !mask.cast_signed()))
    }

    #[inline(always)]
    fn mask_from_bits(bits: u32) -> Mask {
        Mask(lanes(|lane| truth(bits >> lane & 1 == 1)))
    }

    #[inline(always)]
    fn bits(mask: Mask) -> u32 {
        let [a, b, c, d] = lanes(|lane| (mask.0[lane] & 1) << lane);
        a | b | c | d
    }

    #[inline(always)]
    fn lookup16(table: &[f32; 16], index: Ints) -> Floats {
        Floats(map(index.0, |i| table[i.cast_unsigned() as usize & 15]))
    }

    #[inline(always)]
    fn lookup32(table: &[f32; 32], index: Ints) -> Floats {
        Floats(map(index.0, |i| table[i.cast_unsigned() as usize & 31]))
    }

    #[inline(always)]
    unsafe fn gather(base: *const u8, offsets: Ints, mask: Mask) -> Ints {
        Ints(lanes(|lane| {
            if mask.0[lane] == 0 {
                return 0;
            }
            // SAFETY: the caller's promise.
            i32::from_le_bytes(unsafe { base.offset(offsets.0[lane] as isize).cast::<[u8; 4]>().read() })
        }))
    }

    #[inline(always)]
    fn float_from_bits(a: Ints) -> Floats {
        Floats(map(a.0, |a| f32::from_bits(a.cast_unsigned())))
    }

    #[inline(always)]
    fn bits_from_float(a: Floats) -> Ints {
        Ints(map(a.0, |a| a.to_bits().cast_signed()))
    }

    #[inline(never)]
    fn apart<T: TaskOf<Self>>(task: T) -> T::Output {
        task.run_lanes()
    }
}
