//! AVX-512: 16 lanes.
//!
//! Every function here is inlined into [`run`], which has the features. SAFETY of all intrinsics: [`super::dispatch`]
//! calls [`run`] only where [`is_available`] holds, and nothing else uses these types.

#![allow(clippy::undocumented_unsafe_blocks, reason = "the module's head says why every intrinsic may be called")]

use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Not, Sub};

use super::{LANES_LIMIT, Simd, Task, TaskOf};

/// Whether this processor has all the features of [`run`].
pub fn is_available() -> bool {
    is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("fma")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("popcnt")
}

/// Runs a task with the features switched on.
///
/// # Safety
/// [`is_available`] holds.
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
pub unsafe fn run<T: Task>(task: T) -> T::Output {
    task.run::<Avx512>()
}

/// See [`Simd::apart`].
///
/// # Safety
/// As for [`run`].
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
#[inline(never)]
unsafe fn run_apart<T: TaskOf<Avx512>>(task: T) -> T::Output {
    task.run_lanes()
}

#[derive(Clone, Copy)]
pub struct Avx512;

#[derive(Clone, Copy)]
#[repr(transparent)]
pub struct Floats(__m512);

#[derive(Clone, Copy)]
#[repr(transparent)]
pub struct Ints(__m512i);

#[derive(Clone, Copy)]
#[repr(transparent)]
pub struct Mask(__mmask16);

impl Add for Floats {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(unsafe { _mm512_add_ps(self.0, other.0) })
    }
}

impl Sub for Floats {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(unsafe { _mm512_sub_ps(self.0, other.0) })
    }
}

impl Mul for Floats {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(unsafe { _mm512_mul_ps(self.0, other.0) })
    }
}

impl Div for Floats {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(unsafe { _mm512_div_ps(self.0, other.0) })
    }
}

impl Add for Ints {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(unsafe { _mm512_add_epi32(self.0, other.0) })
    }
}

impl Mul for Ints {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(unsafe { _mm512_mullo_epi32(self.0, other.0) })
    }
}

impl BitAnd for Mask {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

impl BitOr for Mask {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl Not for Mask {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(!self.0)
    }
}

impl Simd for Avx512 {
    const LANES: usize = 16;
    type F = Floats;
    type I = Ints;
    type M = Mask;

    #[inline(always)]
    fn splat(value: f32) -> Floats {
        Floats(unsafe { _mm512_set1_ps(value) })
    }

    #[inline(always)]
    fn splat_int(value: i32) -> Ints {
        Ints(unsafe { _mm512_set1_epi32(value) })
    }

    #[inline(always)]
    fn load(values: &[f32; LANES_LIMIT]) -> Floats {
        Floats(unsafe { _mm512_loadu_ps(values.as_ptr()) })
    }

    #[inline(always)]
    fn load_int(values: &[i32; LANES_LIMIT]) -> Ints {
        Ints(unsafe { _mm512_loadu_si512(values.as_ptr().cast()) })
    }

    #[inline(always)]
    fn store(values: Floats, into: &mut [f32; LANES_LIMIT]) {
        unsafe { _mm512_storeu_ps(into.as_mut_ptr(), values.0) }
    }

    #[inline(always)]
    fn store_int(values: Ints, into: &mut [i32; LANES_LIMIT]) {
        unsafe { _mm512_storeu_si512(into.as_mut_ptr().cast(), values.0) }
    }

    #[inline(always)]
    fn compress(values: Floats, mask: Mask, into: &mut [f32; LANES_LIMIT]) {
        // Via a register: storing directly to memory takes a hundred cycles on Zen 4.
        Self::store(Floats(unsafe { _mm512_maskz_compress_ps(mask.0, values.0) }), into);
    }

    #[inline(always)]
    fn expand(values: Floats, mask: Mask, others: Floats) -> Floats {
        Floats(unsafe { _mm512_mask_expand_ps(others.0, mask.0, values.0) })
    }

    #[inline(always)]
    fn mul_add(a: Floats, b: Floats, c: Floats) -> Floats {
        Floats(unsafe { _mm512_fmadd_ps(a.0, b.0, c.0) })
    }

    #[inline(always)]
    fn min(a: Floats, b: Floats) -> Floats {
        Floats(unsafe { _mm512_min_ps(a.0, b.0) })
    }

    #[inline(always)]
    fn max(a: Floats, b: Floats) -> Floats {
        Floats(unsafe { _mm512_max_ps(a.0, b.0) })
    }

    #[inline(always)]
    fn abs(a: Floats) -> Floats {
        Floats(unsafe { _mm512_abs_ps(a.0) })
    }

    #[inline(always)]
    fn sum(a: Floats) -> f32 {
        unsafe { _mm512_reduce_add_ps(a.0) }
    }

    #[inline(always)]
    fn sqrt(a: Floats) -> Floats {
        Floats(unsafe { _mm512_sqrt_ps(a.0) })
    }

    #[inline(always)]
    fn floor(a: Floats) -> Floats {
        Floats(unsafe { _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(a.0) })
    }

    #[inline(always)]
    fn exp2_whole(n: Floats) -> Floats {
        Floats(unsafe { _mm512_scalef_ps(_mm512_set1_ps(1.0), n.0) })
    }

    #[inline(always)]
    fn to_int(a: Floats) -> Ints {
        Ints(unsafe { _mm512_cvttps_epi32(a.0) })
    }

    #[inline(always)]
    fn to_float(a: Ints) -> Floats {
        Floats(unsafe { _mm512_cvtepi32_ps(a.0) })
    }

    #[inline(always)]
    fn shift_right<const SHIFT: u32>(a: Ints) -> Ints {
        Ints(unsafe { _mm512_srai_epi32::<SHIFT>(a.0) })
    }

    #[inline(always)]
    fn and_int(a: Ints, b: Ints) -> Ints {
        Ints(unsafe { _mm512_and_si512(a.0, b.0) })
    }

    #[inline(always)]
    fn lt(a: Floats, b: Floats) -> Mask {
        Mask(unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a.0, b.0) })
    }

    #[inline(always)]
    fn le(a: Floats, b: Floats) -> Mask {
        Mask(unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a.0, b.0) })
    }

    #[inline(always)]
    fn is_nan(a: Floats) -> Mask {
        Mask(unsafe { _mm512_cmp_ps_mask::<_CMP_UNORD_Q>(a.0, a.0) })
    }

    #[inline(always)]
    fn lt_int(a: Ints, b: Ints) -> Mask {
        Mask(unsafe { _mm512_cmplt_epi32_mask(a.0, b.0) })
    }

    #[inline(always)]
    fn eq_int(a: Ints, b: Ints) -> Mask {
        Mask(unsafe { _mm512_cmpeq_epi32_mask(a.0, b.0) })
    }

    #[inline(always)]
    fn select(mask: Mask, a: Floats, b: Floats) -> Floats {
        Floats(unsafe { _mm512_mask_mov_ps(b.0, mask.0, a.0) })
    }

    #[inline(always)]
    fn select_int(mask: Mask, a: Ints, b: Ints) -> Ints {
        Ints(unsafe { _mm512_mask_mov_epi32(b.0, mask.0, a.0) })
    }

    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "there are 16 lanes")]
    fn mask_from_bits(bits: u32) -> Mask {
        Mask(bits as u16)
    }

    #[inline(always)]
    fn bits(mask: Mask) -> u32 {
        u32::from(mask.0)
    }

    #[inline(always)]
    fn lookup16(table: &[f32; 16], index: Ints) -> Floats {
        Floats(unsafe { _mm512_permutexvar_ps(index.0, _mm512_loadu_ps(table.as_ptr())) })
    }

    #[inline(always)]
    fn lookup32(table: &[f32; 32], index: Ints) -> Floats {
        let (low, high) = (table.as_ptr(), table[16..].as_ptr());
        Floats(unsafe { _mm512_permutex2var_ps(_mm512_loadu_ps(low), index.0, _mm512_loadu_ps(high)) })
    }

    #[inline(always)]
    unsafe fn gather(base: *const u8, offsets: Ints, mask: Mask) -> Ints {
        Ints(unsafe { _mm512_mask_i32gather_epi32::<1>(_mm512_setzero_si512(), mask.0, offsets.0, base.cast()) })
    }

    #[inline(always)]
    fn prefetch(address: *const u8) {
        unsafe { _mm_prefetch::<_MM_HINT_T0>(address.cast()) };
    }

    #[inline(always)]
    fn float_from_bits(a: Ints) -> Floats {
        Floats(unsafe { _mm512_castsi512_ps(a.0) })
    }

    #[inline(always)]
    fn bits_from_float(a: Floats) -> Ints {
        Ints(unsafe { _mm512_castps_si512(a.0) })
    }

    #[inline(always)]
    fn apart<T: TaskOf<Self>>(task: T) -> T::Output {
        unsafe { run_apart(task) }
    }
}
