//! AVX2 with FMA: 8 lanes.
//!
//! Every function here is inlined into [`run`], which has the features. SAFETY of all intrinsics: [`super::dispatch`]
//! calls [`run`] only where [`is_available`] holds, and nothing else uses these types.

#![allow(clippy::undocumented_unsafe_blocks, reason = "the module's head says why every intrinsic may be called")]

use std::arch::x86_64::*;
use std::ops::{Add, BitAnd, BitOr, Div, Mul, Not, Sub};

use super::{LANES_LIMIT, Simd, Task, TaskOf};

/// Whether this processor has all the features of [`run`].
pub fn is_available() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") && is_x86_feature_detected!("bmi2")
}

/// Runs a task with the features switched on.
///
/// # Safety
/// [`is_available`] holds.
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
pub unsafe fn run<T: Task>(task: T) -> T::Output {
    task.run::<Avx2>()
}

/// See [`Simd::apart`].
///
/// # Safety
/// As for [`run`].
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
#[inline(never)]
unsafe fn run_apart<T: TaskOf<Avx2>>(task: T) -> T::Output {
    task.run_lanes()
}

#[derive(Clone, Copy)]
pub struct Avx2;

#[derive(Clone, Copy)]
#[repr(transparent)]
pub struct Floats(__m256);

#[derive(Clone, Copy)]
#[repr(transparent)]
pub struct Ints(__m256i);

#[derive(Clone, Copy)]
#[repr(transparent)]
pub struct Mask(__m256);

impl Add for Floats {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(unsafe { _mm256_add_ps(self.0, other.0) })
    }
}

impl Sub for Floats {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(unsafe { _mm256_sub_ps(self.0, other.0) })
    }
}

impl Mul for Floats {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(unsafe { _mm256_mul_ps(self.0, other.0) })
    }
}

impl Div for Floats {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(unsafe { _mm256_div_ps(self.0, other.0) })
    }
}

impl Add for Ints {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(unsafe { _mm256_add_epi32(self.0, other.0) })
    }
}

impl Mul for Ints {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self(unsafe { _mm256_mullo_epi32(self.0, other.0) })
    }
}

impl BitAnd for Mask {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        Self(unsafe { _mm256_and_ps(self.0, other.0) })
    }
}

impl BitOr for Mask {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        Self(unsafe { _mm256_or_ps(self.0, other.0) })
    }
}

impl Not for Mask {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        Self(unsafe { _mm256_xor_ps(self.0, _mm256_castsi256_ps(_mm256_set1_epi32(-1))) })
    }
}

impl Simd for Avx2 {
    const LANES: usize = 8;
    type F = Floats;
    type I = Ints;
    type M = Mask;

    #[inline(always)]
    fn splat(value: f32) -> Floats {
        Floats(unsafe { _mm256_set1_ps(value) })
    }

    #[inline(always)]
    fn splat_int(value: i32) -> Ints {
        Ints(unsafe { _mm256_set1_epi32(value) })
    }

    #[inline(always)]
    fn load(values: &[f32; LANES_LIMIT]) -> Floats {
        Floats(unsafe { _mm256_loadu_ps(values.as_ptr()) })
    }

    #[inline(always)]
    fn load_int(values: &[i32; LANES_LIMIT]) -> Ints {
        Ints(unsafe { _mm256_loadu_si256(values.as_ptr().cast()) })
    }

    #[inline(always)]
    fn store(values: Floats, into: &mut [f32; LANES_LIMIT]) {
        unsafe { _mm256_storeu_ps(into.as_mut_ptr(), values.0) }
    }

    #[inline(always)]
    fn store_int(values: Ints, into: &mut [i32; LANES_LIMIT]) {
        unsafe { _mm256_storeu_si256(into.as_mut_ptr().cast(), values.0) }
    }

    #[inline(always)]
    fn compress(values: Floats, mask: Mask, into: &mut [f32; LANES_LIMIT]) {
        // The numbers of the lanes of the mask, one per byte, moved together.
        unsafe {
            let lane_bytes = _pdep_u64(u64::from(Self::bits(mask)), 0x0101_0101_0101_0101) * 0xff;
            let lanes = _pext_u64(0x0706_0504_0302_0100, lane_bytes);
            let lanes = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(lanes.cast_signed()));
            Self::store(Floats(_mm256_permutevar8x32_ps(values.0, lanes)), into);
        }
    }

    #[inline(always)]
    fn expand(values: Floats, mask: Mask, others: Floats) -> Floats {
        // The inverse of `compress`.
        let moved = unsafe {
            let lane_bytes = _pdep_u64(u64::from(Self::bits(mask)), 0x0101_0101_0101_0101) * 0xff;
            let lanes = _pdep_u64(0x0706_0504_0302_0100, lane_bytes);
            let lanes = _mm256_cvtepu8_epi32(_mm_cvtsi64_si128(lanes.cast_signed()));
            Floats(_mm256_permutevar8x32_ps(values.0, lanes))
        };
        Self::select(mask, moved, others)
    }

    #[inline(always)]
    fn mul_add(a: Floats, b: Floats, c: Floats) -> Floats {
        Floats(unsafe { _mm256_fmadd_ps(a.0, b.0, c.0) })
    }

    #[inline(always)]
    fn min(a: Floats, b: Floats) -> Floats {
        Floats(unsafe { _mm256_min_ps(a.0, b.0) })
    }

    #[inline(always)]
    fn max(a: Floats, b: Floats) -> Floats {
        Floats(unsafe { _mm256_max_ps(a.0, b.0) })
    }

    #[inline(always)]
    fn abs(a: Floats) -> Floats {
        Floats(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), a.0) })
    }

    #[inline(always)]
    fn sum(a: Floats) -> f32 {
        unsafe {
            let four = _mm_add_ps(_mm256_castps256_ps128(a.0), _mm256_extractf128_ps::<1>(a.0));
            let two = _mm_add_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_add_ss(two, _mm_movehdup_ps(two)))
        }
    }

    #[inline(always)]
    fn sqrt(a: Floats) -> Floats {
        Floats(unsafe { _mm256_sqrt_ps(a.0) })
    }

    #[inline(always)]
    fn floor(a: Floats) -> Floats {
        Floats(unsafe { _mm256_floor_ps(a.0) })
    }

    #[inline(always)]
    fn exp2_whole(n: Floats) -> Floats {
        // n + 127 is the exponent's field.
        Floats(unsafe {
            let field = _mm256_add_epi32(_mm256_cvttps_epi32(n.0), _mm256_set1_epi32(127));
            _mm256_castsi256_ps(_mm256_slli_epi32::<23>(field))
        })
    }

    #[inline(always)]
    fn to_int(a: Floats) -> Ints {
        Ints(unsafe { _mm256_cvttps_epi32(a.0) })
    }

    #[inline(always)]
    fn to_float(a: Ints) -> Floats {
        Floats(unsafe { _mm256_cvtepi32_ps(a.0) })
    }

    #[inline(always)]
    fn shift_right<const SHIFT: u32>(a: Ints) -> Ints {
        Ints(unsafe { _mm256_sra_epi32(a.0, _mm_cvtsi32_si128(SHIFT.cast_signed())) })
    }

    #[inline(always)]
    fn and_int(a: Ints, b: Ints) -> Ints {
        Ints(unsafe { _mm256_and_si256(a.0, b.0) })
    }

    #[inline(always)]
    fn lt(a: Floats, b: Floats) -> Mask {
        Mask(unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(a.0, b.0) })
    }

    #[inline(always)]
    fn le(a: Floats, b: Floats) -> Mask {
        Mask(unsafe { _mm256_cmp_ps::<_CMP_LE_OQ>(a.0, b.0) })
    }

    #[inline(always)]
    fn is_nan(a: Floats) -> Mask {
        Mask(unsafe { _mm256_cmp_ps::<_CMP_UNORD_Q>(a.0, a.0) })
    }

    #[inline(always)]
    fn lt_int(a: Ints, b: Ints) -> Mask {
        Mask(unsafe { _mm256_castsi256_ps(_mm256_cmpgt_epi32(b.0, a.0)) })
    }

    #[inline(always)]
    fn eq_int(a: Ints, b: Ints) -> Mask {
        Mask(unsafe { _mm256_castsi256_ps(_mm256_cmpeq_epi32(a.0, b.0)) })
    }

    #[inline(always)]
    fn select(mask: Mask, a: Floats, b: Floats) -> Floats {
        Floats(unsafe { _mm256_blendv_ps(b.0, a.0, mask.0) })
    }

    #[inline(always)]
    fn select_int(mask: Mask, a: Ints, b: Ints) -> Ints {
        Ints(unsafe { _mm256_blendv_epi8(b.0, a.0, _mm256_castps_si256(mask.0)) })
    }

    #[inline(always)]
    fn mask_from_bits(bits: u32) -> Mask {
        Mask(unsafe {
            let lane_bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let set = _mm256_and_si256(_mm256_set1_epi32(bits.cast_signed()), lane_bits);
            _mm256_castsi256_ps(_mm256_cmpeq_epi32(set, lane_bits))
        })
    }

    #[inline(always)]
    fn bits(mask: Mask) -> u32 {
        unsafe { _mm256_movemask_ps(mask.0).cast_unsigned() }
    }

    #[inline(always)]
    fn lookup16(table: &[f32; 16], index: Ints) -> Floats {
        Floats(unsafe {
            let low = _mm256_permutevar8x32_ps(_mm256_loadu_ps(table.as_ptr()), index.0);
            let high = _mm256_permutevar8x32_ps(_mm256_loadu_ps(table[8..].as_ptr()), index.0);
            // Bit 3 of the index, moved to the sign.
            _mm256_blendv_ps(low, high, _mm256_castsi256_ps(_mm256_slli_epi32::<28>(index.0)))
        })
    }

    #[inline(always)]
    fn lookup32(table: &[f32; 32], index: Ints) -> Floats {
        Floats(unsafe {
            let inside = _mm256_and_si256(index.0, _mm256_set1_epi32(31));
            _mm256_i32gather_ps::<4>(table.as_ptr(), inside)
        })
    }

    #[inline(always)]
    unsafe fn gather(base: *const u8, offsets: Ints, mask: Mask) -> Ints {
        let lanes = unsafe { _mm256_castps_si256(mask.0) };
        Ints(unsafe { _mm256_mask_i32gather_epi32::<1>(_mm256_setzero_si256(), base.cast(), offsets.0, lanes) })
    }

    #[inline(always)]
    fn prefetch(address: *const u8) {
        unsafe { _mm_prefetch::<_MM_HINT_T0>(address.cast()) };
    }

    #[inline(always)]
    fn float_from_bits(a: Ints) -> Floats {
        Floats(unsafe { _mm256_castsi256_ps(a.0) })
    }

    #[inline(always)]
    fn bits_from_float(a: Floats) -> Ints {
        Ints(unsafe { _mm256_castps_si256(a.0) })
    }

    #[inline(always)]
    fn apart<T: TaskOf<Self>>(task: T) -> T::Output {
        unsafe { run_apart(task) }
    }
}
