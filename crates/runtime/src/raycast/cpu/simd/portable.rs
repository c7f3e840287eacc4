//! Arrays of 4 lanes: no intrinsics, right everywhere; the compiler makes of them what the target has.

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Not, Sub};

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

#[inline(always)]
fn each<A: Copy, B: Copy, R: Copy + Default>(a: [A; LANES], b: [B; LANES], f: impl Fn(A, B) -> R) -> [R; LANES] {
    let mut out = [R::default(); LANES];
    for i in 0..LANES {
        out[i] = f(a[i], b[i]);
    }
    out
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
        Self(self.0.map(|a| !a))
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
        let mut out = [0.0; LANES];
        out.copy_from_slice(&values[..LANES]);
        Floats(out)
    }

    #[inline(always)]
    fn load_int(values: &[i32; LANES_LIMIT]) -> Ints {
        let mut out = [0; LANES];
        out.copy_from_slice(&values[..LANES]);
        Ints(out)
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
        Floats(a.0.map(f32::abs))
    }

    #[inline(always)]
    fn sum(a: Floats) -> f32 {
        a.0.iter().sum()
    }

    #[inline(always)]
    fn sqrt(a: Floats) -> Floats {
        Floats(a.0.map(f32::sqrt))
    }

    #[inline(always)]
    fn floor(a: Floats) -> Floats {
        Floats(a.0.map(f32::floor))
    }

    #[inline(always)]
    fn exp2_whole(n: Floats) -> Floats {
        // n + 127 is the exponent's field.
        Floats(n.0.map(|n| f32::from_bits(((n as i32 + 127) as u32) << 23)))
    }

    #[inline(always)]
    fn to_int(a: Floats) -> Ints {
        Ints(a.0.map(|a| a as i32))
    }

    #[inline(always)]
    fn to_float(a: Ints) -> Floats {
        Floats(a.0.map(|a| a as f32))
    }

    #[inline(always)]
    fn shift_right<const SHIFT: u32>(a: Ints) -> Ints {
        Ints(a.0.map(|a| a >> SHIFT))
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
        Mask(a.0.map(|a| truth(a.is_nan())))
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
        Ints(each(mask.0, chosen, |mask, (a, b)| a & mask as i32 | b & !mask as i32))
    }

    #[inline(always)]
    fn mask_from_bits(bits: u32) -> Mask {
        let mut out = [0; LANES];
        for (lane, truth_of_lane) in out.iter_mut().enumerate() {
            *truth_of_lane = truth(bits >> lane & 1 == 1);
        }
        Mask(out)
    }

    #[inline(always)]
    fn bits(mask: Mask) -> u32 {
        let mut bits = 0;
        for (lane, truth_of_lane) in mask.0.into_iter().enumerate() {
            bits |= (truth_of_lane & 1) << lane;
        }
        bits
    }

    #[inline(always)]
    fn lookup16(table: &[f32; 16], index: Ints) -> Floats {
        Floats(index.0.map(|i| table[i as usize & 15]))
    }

    #[inline(always)]
    fn lookup32(table: &[f32; 32], index: Ints) -> Floats {
        Floats(index.0.map(|i| table[i as usize & 31]))
    }

    #[inline(always)]
    unsafe fn gather(base: *const u8, offsets: Ints, mask: Mask) -> Ints {
        let mut out = [0; LANES];
        for (lane, value) in out.iter_mut().enumerate() {
            if mask.0[lane] != 0 {
                // SAFETY: the caller's promise.
                let bytes = unsafe { base.offset(offsets.0[lane] as isize).cast::<[u8; 4]>().read() };
                *value = i32::from_le_bytes(bytes);
            }
        }
        Ints(out)
    }

    #[inline(always)]
    fn float_from_bits(a: Ints) -> Floats {
        Floats(a.0.map(|a| f32::from_bits(a as u32)))
    }

    #[inline(always)]
    fn bits_from_float(a: Floats) -> Ints {
        Ints(a.0.map(|a| a.to_bits() as i32))
    }

    #[inline(never)]
    fn apart<T: TaskOf<Self>>(task: T) -> T::Output {
        task.run_lanes()
    }
}
