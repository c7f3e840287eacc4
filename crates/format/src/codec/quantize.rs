//! Quantization: voxels as integer multiples of a step. It bounds the error of a container, and [`super::wavelet`]
//! transforms the multiples.
//!
//! A voxel v has the index `i = round(v / step)`, ties to even. The index decodes to the voxel `i * step`, clamped to
//! the limits of its type. [`Quantizer::snap`] encodes and decodes. It treats each voxel alone, so aprons still repeat
//! their neighbours' cores afterwards, with any codec. Snapping twice equals snapping once.
//!
//! Steps from [`Quantizer::within`] are odd integers for integer types, and have [`STEP_BITS`] significant bits for
//! floats. For them `i * step` is exact in the voxel's own type for all indices up to the limit. No voxel moves by more
//! than half a step. Three kinds of voxels stay unchanged: those with a larger index, holes, and those that snapping
//! would turn into holes.

use std::marker::PhantomData;

use crate::vectors::{Vectorized, vectorized};
use crate::voxel_type::{Absence, Voxel};
use crate::{VoxelType, with_voxel};

/// Significant bits of a float's step. The step is less than one sixteenth shorter than twice the allowed error.
pub const STEP_BITS: u32 = 5;
/// Greatest index of an f32 voxel: its product with a step fits the 24 significant bits of f32.
const SINGLE_INDEX_LIMIT: i32 = 1 << 19;
/// Greatest index of all other types: sums of a few indices do not overflow 32 bits.
const INDEX_LIMIT: i32 = 1 << 29;

/// Quantizer with one step, see the module head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantizer {
    step: f64,
}

impl Quantizer {
    /// Step 1: integers stay unchanged.
    pub const WHOLE: Self = Self { step: 1.0 };

    /// Quantizer with this step. `None` unless the step is positive and finite. For integer types it must also be a
    /// whole number, at most twice the range of the type plus 1.
    #[must_use]
    pub fn new(voxel_type: VoxelType, step: f64) -> Option<Self> {
        let (least, greatest) = voxel_type.limits();
        let is_whole = step.fract() == 0.0 && step <= 2.0 * (greatest - least) + 1.0;
        (step > 0.0 && step.is_finite() && (is_whole || voxel_type.is_float())).then_some(Self { step })
    }

    /// Quantizer with the longest step that moves no voxel by more than `max_error` (stored units). `None` if even that
    /// step would move no voxel.
    #[must_use]
    pub fn within(voxel_type: VoxelType, max_error: f64) -> Option<Self> {
        if !(max_error > 0.0 && max_error.is_finite()) {
            return None;
        }
        if !voxel_type.is_float() {
            let (least, greatest) = voxel_type.limits();
            // An error beyond the range of the type has no further effect.
            let whole = max_error.min(greatest - least).floor();
            return (whole >= 1.0).then_some(Self { step: 2.0 * whole + 1.0 });
        }
        let low_bits = (1u64 << (f64::MANTISSA_DIGITS - STEP_BITS)) - 1;
        let step = f64::from_bits((2.0 * max_error).to_bits() & !low_bits);
        let least = if voxel_type == VoxelType::F32 { f64::from(f32::MIN_POSITIVE) } else { f64::MIN_POSITIVE };
        Self::new(voxel_type, step).filter(|_| step >= least)
    }

    /// Length of the step in stored units.
    #[must_use]
    pub fn step(self) -> f64 {
        self.step
    }

    /// Largest distance in stored units by which a voxel moves.
    #[must_use]
    pub fn bound(self, voxel_type: VoxelType) -> f64 {
        if voxel_type.is_float() { 0.5 * self.step } else { ((self.step - 1.0) / 2.0).max(0.0) }
    }

    /// Index of a voxel, saturating.
    #[inline(always)]
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        reason = "f32 holds all small integers and their steps; the index is the low 32 bits of the sum"
    )]
    pub fn index<V: Voxel>(self, voxel: V) -> i32 {
        // A double of this size has no fraction bits: adding it rounds the sum to an integer, which is in the lowest
        // bits.
        const ROUNDER: f64 = 1.5 * (1u64 << 52) as f64;
        if is_small(V::TYPE) && self.step % 2.0 == 1.0 {
            // For an odd step the quotient is at least 1 / (2 step) away from any tie; f32 arithmetic is off by 2^-22
            // of the index.
            return rounded(voxel.to_f64() as f32 * (1.0 / self.step as f32));
        }
        let steps = (voxel.to_f64() / self.step).max(f64::from(i32::MIN)).min(f64::from(i32::MAX));
        (steps + ROUNDER).to_bits() as i32
    }

    /// Voxel of an index.
    #[inline(always)]
    #[must_use]
    pub fn voxel<V: Voxel>(self, index: i32) -> V {
        self.voxels::<V>()(index)
    }

    /// Function from indices to voxels. It computes once all that depends on the step alone: a division per row of a
    /// brick would take longer than the row's voxels.
    #[inline(always)]
    #[expect(
        clippy::cast_possible_truncation,
        reason = "saturating: only small integer types use the step as i32, and every whole step fits i64"
    )]
    pub(super) fn voxels<V: Voxel>(self) -> impl Fn(i32) -> V {
        // Steps of small integer types fit 32 bits. Indices beyond `limit` decode to values beyond the type's limits in
        // any case.
        let step = self.step as i32;
        let limit = i32::MAX / step.max(1);
        move |index| {
            if V::TYPE.is_float() {
                V::from_f64(f64::from(index) * self.step)
            } else if is_small(V::TYPE) {
                V::from_word(index.clamp(-limit, limit) * step)
            } else if self.step == 1.0 {
                V::from_word(index)
            } else {
                V::from_whole(i64::from(index).saturating_mul(self.step as i64))
            }
        }
    }

    /// Index of a voxel, and whether decoding the index gives exactly this voxel.
    #[inline(always)]
    pub(super) fn indexed<V: Voxel>(self, voxel: V) -> (i32, bool) {
        let index = self.index(voxel);
        let stands_for: V = self.voxel(index);
        // -0 is not 0.
        let same_sign =
            !V::TYPE.is_float() || stands_for.to_f64().is_sign_negative() == voxel.to_f64().is_sign_negative();
        let is_same = (stands_for == voxel) & same_sign;
        (index, is_same & (index.unsigned_abs() <= INDEX_LIMIT as u32))
    }

    /// Index of a voxel, or `None` if decoding the index does not give exactly this voxel.
    #[inline(always)]
    pub(super) fn exact_index<V: Voxel>(self, voxel: V) -> Option<i32> {
        let (index, is_exact) = self.indexed(voxel);
        is_exact.then_some(index)
    }

    #[inline(always)]
    fn snapped<V: Voxel>(self, voxel: V, absence: Absence) -> V {
        let index = self.index(voxel);
        let moved: V = self.voxel(index);
        if is_small(V::TYPE) && !absence.possible(V::TYPE) {
            // These types have a multiple near every voxel, and no holes.
            return moved;
        }
        let limit = if V::TYPE == VoxelType::F32 { SINGLE_INDEX_LIMIT } else { INDEX_LIMIT };
        let is_near = (moved.to_f64() - voxel.to_f64()).abs() <= self.bound(V::TYPE);
        let is_known = index.unsigned_abs() <= limit as u32;
        let is_hole = absence.is_absent(voxel.to_f64()) | absence.is_absent(moved.to_f64());
        if is_near & is_known & !is_hole { moved } else { voxel }
    }

    /// Moves each voxel to the nearest multiple of the step. Returns the greatest distance that a voxel moved, in
    /// stored units.
    ///
    /// # Panics
    /// If the length of `voxels` is not a whole number of voxels.
    pub fn snap(self, voxel_type: VoxelType, absence: Absence, voxels: &mut [u8]) -> f64 {
        assert_eq!(voxels.len() % voxel_type.bytes(), 0, "{} bytes of {voxel_type} voxels", voxels.len());
        with_voxel!(voxel_type, V => vectorized(Snapping { quantizer: self, absence, voxels, typed: PhantomData::<V> }))
    }
}

/// Nearest integer to a number within +-2^22; written for vectors.
#[inline(always)]
fn rounded(number: f32) -> i32 {
    /// As in [`Quantizer::index`].
    const ROUNDER: f32 = 1.5 * (1u32 << 23) as f32;
    (number + ROUNDER).to_bits().wrapping_sub(ROUNDER.to_bits()) as i32
}

/// Whether f32 holds all values of an integer type.
fn is_small(voxel_type: VoxelType) -> bool {
    !voxel_type.is_float() && voxel_type.bytes() < 4
}

/// Task of [`Quantizer::snap`].
struct Snapping<'a, V> {
    quantizer: Quantizer,
    absence: Absence,
    voxels: &'a mut [u8],
    typed: PhantomData<V>,
}

impl<V: Voxel> Vectorized for Snapping<'_, V> {
    type Output = f64;

    #[inline(always)]
    fn run(self) -> f64 {
        let Self { quantizer, absence, voxels, .. } = self;
        // The greatest distance, as an integer, or as the bits of a non-negative double, which have the same order as
        // the doubles. Vector instructions find the maximum of integers.
        let (mut whole, mut bits) = (0, 0);
        for bytes in voxels.chunks_exact_mut(size_of::<V>()) {
            let voxel = V::read_le(bytes);
            let moved = quantizer.snapped(voxel, absence);
            moved.write_le(bytes);
            if is_small(V::TYPE) {
                #[expect(clippy::cast_possible_truncation, reason = "f32 holds all small integers")]
                let [from, to] = [voxel, moved].map(|v| rounded(v.to_f64() as f32));
                whole = whole.max((from - to).abs());
            } else {
                let by = (moved.to_f64() - voxel.to_f64()).abs();
                // A voxel that stays as it is may be NaN.
                bits = bits.max(if by > 0.0 { by.to_bits() } else { 0 });
            }
        }
        f64::from(whole).max(f64::from_bits(bits))
    }
}

/// Quantizer with the longest common step of all present voxels: for integers their greatest common divisor, for floats
/// the longest power of two. `None` if indices would be too large.
pub(crate) fn common_step<V: Voxel>(voxels: &[V], absence: Absence) -> Option<Quantizer> {
    if !V::TYPE.is_float() {
        return Some(common_divisor(voxels, absence));
    }
    let (mut lowest_bit, mut greatest, mut limit) = (i32::MAX, 0.0f64, f64::INFINITY);
    for value in voxels.iter().map(|v| v.to_f64()).filter(|&v| v != 0.0 && !absence.is_absent(v)) {
        let bits = value.to_bits();
        let exponent = (bits >> 52 & 0x7ff) as i32 - 1075;
        let mantissa = bits & ((1 << 52) - 1) | 1 << 52;
        let lowest = exponent + mantissa.trailing_zeros() as i32;
        if lowest < lowest_bit {
            lowest_bit = lowest;
            limit = f64::from(INDEX_LIMIT) * 2f64.powi(lowest);
        }
        greatest = greatest.max(value.abs());
        // Most float fields have no common step; a few voxels show it.
        if greatest > limit {
            return None;
        }
    }
    Quantizer::new(V::TYPE, if lowest_bit == i32::MAX { 1.0 } else { 2f64.powi(lowest_bit) })
}

/// Quantizer with the greatest common divisor of all present voxels, which are integers of at most 32 bits. In most
/// fields it is 1 after a few voxels.
fn common_divisor<V: Voxel>(voxels: &[V], absence: Absence) -> Quantizer {
    let holes_possible = absence.possible(V::TYPE);
    let mut divisor = 0u32;
    for value in voxels.iter().map(|v| v.to_f64()).filter(|&v| !(holes_possible && absence.is_absent(v))) {
        #[expect(clippy::cast_possible_truncation, reason = "the value is an integer, and its magnitude is below 2^32")]
        let mut rest = value.abs() as u32;
        if divisor == 0 || !rest.is_multiple_of(divisor) {
            while rest != 0 {
                (divisor, rest) = (rest, divisor % rest);
            }
            if divisor == 1 {
                break;
            }
        }
    }
    Quantizer::new(V::TYPE, f64::from(divisor)).unwrap_or(Quantizer::WHOLE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const NO_HOLES: Absence = Absence::NON_FINITE_ONLY;

    fn snap_one<V: Voxel>(quantizer: Quantizer, voxel: V, absence: Absence) -> (V, f64) {
        let mut bytes = vec![0; size_of::<V>()];
        voxel.write_le(&mut bytes);
        let moved = quantizer.snap(V::TYPE, absence, &mut bytes);
        (V::read_le(&bytes), moved)
    }

    #[test]
    fn integers_go_to_odd_steps_and_never_beyond_their_type() {
        let step = |e| Quantizer::within(VoxelType::U8, e).map(Quantizer::step);
        assert_eq!([0.0, 0.9, 1.0, 2.7, 1e300].map(step), [None, None, Some(3.0), Some(5.0), Some(511.0)]);
        for error in 1..=255 {
            let quantizer = Quantizer::within(VoxelType::I8, f64::from(error)).expect("an error of 1 and more");
            for voxel in i8::MIN..=i8::MAX {
                let (moved, by) = snap_one(quantizer, voxel, NO_HOLES);
                let side = quantizer.index(voxel).signum();
                assert_eq!(quantizer.voxel::<i8>(side * i32::MAX), [i8::MIN, 0, i8::MAX][(side + 1) as usize]);
                assert_eq!((i32::from(moved) - i32::from(voxel)).abs(), by as i32);
                assert!(by <= f64::from(error), "{voxel} became {moved} within {error}");
                assert_eq!(snap_one(quantizer, moved, NO_HOLES), (moved, 0.0), "twice is once");
                assert_eq!(quantizer.exact_index(moved).map(|i| quantizer.voxel(i)), Some(moved));
            }
        }
    }

    /// The f32 path and the f64 path agree.
    #[test]
    fn small_integers_go_to_the_nearest_multiple() {
        for step in (1..=255).step_by(2).chain([1001, 21_845, 32_767, 65_535, 131_071]) {
            let quantizer = Quantizer::new(VoxelType::U16, f64::from(step)).expect("a whole step");
            for voxel in 0..=u16::MAX {
                let nearest = (f64::from(voxel) / f64::from(step)).round_ties_even();
                assert_eq!(f64::from(quantizer.index(voxel)), nearest, "{voxel} in steps of {step}");
                let signed = voxel.wrapping_sub(1 << 15).cast_signed();
                let nearest = (f64::from(signed) / f64::from(step)).round_ties_even();
                assert_eq!(f64::from(quantizer.index(signed)), nearest, "{signed} in steps of {step}");
            }
        }
        let even = Quantizer::new(VoxelType::U8, 2.0).expect("a whole step");
        assert_eq!([3u8, 5].map(|voxel| even.index(voxel)), [2, 2], "ties go to even indices");
    }

    #[test]
    fn the_longest_step_and_the_greatest_index_stay_within_the_type() {
        let quantizer = Quantizer::within(VoxelType::U32, f64::MAX).expect("a positive error");
        assert_eq!([i32::MIN, 0, i32::MAX].map(|i| quantizer.voxel::<u32>(i)), [0, 0, u32::MAX]);
        let longer = quantizer.step() + 2.0;
        let refused =
            [(VoxelType::U32, longer), (VoxelType::U8, 1.5), (VoxelType::F32, 0.0), (VoxelType::F64, f64::NAN)];
        assert!(refused.into_iter().all(|(voxel_type, step)| Quantizer::new(voxel_type, step).is_none()));
    }

    #[test]
    fn what_is_too_large_has_no_index() {
        let [least, greatest] = [i32::MIN, i32::MAX].map(|v| Quantizer::WHOLE.exact_index(v));
        assert_eq!([least, greatest, Quantizer::WHOLE.exact_index(u32::MAX)], [None; 3]);
        assert_eq!(Quantizer::WHOLE.exact_index(-INDEX_LIMIT), Some(-INDEX_LIMIT));
    }

    #[test]
    fn holes_stay_and_nothing_becomes_one() {
        let quantizer = Quantizer::within(VoxelType::F32, 0.5).expect("a positive error");
        let nodata = Absence { nodata: Some(-999.0) };
        assert!(snap_one(quantizer, f32::NAN, nodata).0.is_nan());
        assert_eq!(snap_one(quantizer, f32::INFINITY, nodata), (f32::INFINITY, 0.0));
        assert_eq!(snap_one(quantizer, -999.0f32, nodata), (-999.0, 0.0));
        assert_eq!(snap_one(quantizer, -999.25f32, nodata), (-999.25, 0.0), "it would be taken for a hole");
        assert_eq!(snap_one(quantizer, -999.25f32, NO_HOLES), (-999.0, 0.25));
        assert_eq!(snap_one(quantizer, 1e30f32, NO_HOLES), (1e30, 0.0), "too far away to be counted in steps");
    }

    #[test]
    fn the_common_step_of_floats_is_a_power_of_two() {
        let step = |v: &[f32]| common_step(v, NO_HOLES).map(Quantizer::step);
        assert_eq!(step(&[3.0, -8.0, 0.0, f32::NAN]), Some(1.0));
        assert_eq!(step(&[0.75, 1024.0]), Some(0.25));
        assert_eq!(step(&[4096.0, -12288.0]), Some(4096.0));
        assert_eq!(
            (step(&[0.0; 3]), step(&[1e-20, 1.0]), step(&[f32::MIN_POSITIVE / 8.0, 1.0])),
            (Some(1.0), None, None)
        );
    }

    #[test]
    fn the_common_step_of_integers_is_their_greatest_common_divisor() {
        fn step<V: Voxel>(v: &[V], absence: Absence) -> f64 {
            common_step(v, absence).expect("integers have one").step()
        }
        assert_eq!(
            [&[0u8, 255, 0][..], &[12, 0, 18], &[0; 3], &[7, 9, 14]].map(|v| step(v, NO_HOLES)),
            [255.0, 6.0, 1.0, 1.0]
        );
        assert_eq!(step(&[-32_768i16, 24], NO_HOLES), 8.0);
        assert_eq!([step(&[i32::MIN], NO_HOLES), step(&[u32::MAX, 0], NO_HOLES)], [2f64.powi(31), f64::from(u32::MAX)]);
        let holes = Absence { nodata: Some(17.0) };
        assert_eq!([step(&[17i16, 40, -60], holes), step(&[17i16, 17], holes)], [20.0, 1.0]);
        let quantizer = common_step(&[i32::MIN, 0], NO_HOLES).expect("integers have one");
        assert_eq!(quantizer.exact_index(i32::MIN).map(|index| quantizer.voxel::<i32>(index)), Some(i32::MIN));
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn floats_move_by_no_more_than_they_may(value in any::<f32>(), exponent in -100i32..100, mantissa in 1.0f64..2.0) {
            let error = mantissa * 2f64.powi(exponent);
            let quantizer = Quantizer::within(VoxelType::F32, error).expect("a positive error");
            prop_assert!(quantizer.step() <= 2.0 * error && quantizer.step() > 1.88 * error, "{}", quantizer.step());
            let (moved, by) = snap_one(quantizer, value, NO_HOLES);
            prop_assert!(by <= error && by <= quantizer.bound(VoxelType::F32), "{value} became {moved}");
            if value.is_finite() {
                prop_assert!((f64::from(moved) - f64::from(value)).abs() <= by);
                prop_assert_eq!(snap_one(quantizer, moved, NO_HOLES), (moved, 0.0));
                // Within the limit every voxel is a multiple, and its index decodes to it.
                if f64::from(value).abs() < quantizer.step() * f64::from(SINGLE_INDEX_LIMIT - 1) {
                    prop_assert_eq!(quantizer.exact_index(moved).map(|i| quantizer.voxel::<f32>(i)), Some(moved));
                }
            }
        }
    }
}
