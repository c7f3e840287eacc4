//! The step of floats that are whole multiples of one: those of a container within a stated error, and integers.
//!
//! A step is the greatest common divisor of all values, as integers of the least power of two among their last bits. It
//! serves if every value is `k * step` for an integer k of at most 24 bits: the product and the quotient are then exact.

use supervol_format::cast::{single, whole};

/// Most steps from zero: integers up to here are exact in `f32`.
const STEPS_LIMIT: f32 = (1u32 << f32::MANTISSA_DIGITS) as f32;
/// Most bits by which a value is shifted to the least power of two.
const SHIFT_LIMIT: i32 = 39;
/// Exponent of the last bit of a denormal `f32`.
const LEAST_EXPONENT: i32 = -149;
/// Bits of a stored mantissa.
const STORED_BITS: u32 = f32::MANTISSA_DIGITS - 1;

/// Number of steps from zero to a value; `None` if it is no multiple.
#[inline(always)]
pub(super) fn steps_of(value: f32, step: f32) -> Option<i32> {
    let quotient = value / step;
    let steps = whole::<i32>(quotient);
    let is_exact = (steps as f32 * step).to_bits() == value.to_bits() && quotient.abs() <= STEPS_LIMIT;
    is_exact.then_some(steps)
}

/// The step of these values, holes (`f32::NAN`) left out; `None` if they have none, or if all are 0.
pub(super) fn common_step(values: &[f32]) -> Option<f32> {
    // The step is `divisor * 2^exponent`.
    let (mut divisor, mut exponent, mut step, mut greatest) = (0u64, 0, f32::NAN, 0.0f32);
    for &value in values {
        if steps_of(value, step).is_some() || value.to_bits() == f32::NAN.to_bits() || value.to_bits() == 0 {
            continue;
        }
        let (whole, last) = parts_of(value)?;
        if divisor == 0 {
            (divisor, exponent) = (whole, last);
        } else {
            let least = last.min(exponent);
            if last - least > SHIFT_LIMIT || exponent - least > SHIFT_LIMIT || divisor > 1 << f32::MANTISSA_DIGITS {
                return None;
            }
            (divisor, exponent) = (gcd(divisor << (exponent - least), whole << (last - least)), least);
        }
        step = single(divisor as f64 * f64::from(exponent).exp2());
        // Most floats without a step show it soon.
        greatest = greatest.max(value.abs());
        steps_of(greatest, step)?;
    }
    (divisor != 0).then_some(step)
}

/// A value as an odd integer times a power of two; `None` for negative zero and what is not finite.
fn parts_of(value: f32) -> Option<(u64, i32)> {
    let bits = value.to_bits();
    let mantissa = bits & ((1 << STORED_BITS) - 1);
    let exponent = (bits >> STORED_BITS & 0xff).cast_signed();
    if !value.is_finite() || value == 0.0 {
        return None;
    }
    let (whole, exponent) = if exponent == 0 {
        (mantissa, LEAST_EXPONENT)
    } else {
        (mantissa | 1 << STORED_BITS, exponent - 1 + LEAST_EXPONENT)
    };
    let zeros = whole.trailing_zeros();
    Some((u64::from(whole >> zeros), exponent + zeros.cast_signed()))
}

/// Greatest common divisor (Euclid).
pub(super) fn gcd(mut a: u64, mut b: u64) -> u64 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn multiples_have_the_step_that_they_were_made_of() {
        for step in [1.0f32, 3.0, 0.75, 0.078_125, 3.0 * 2f32.powi(80), f32::from_bits(3)] {
            let values: Vec<f32> = [0, 15, -6, 21, 1000, -70_003].iter().map(|&k: &i32| k as f32 * step).collect();
            assert_eq!(common_step(&values), Some(step));
        }
        assert_eq!(common_step(&[6.0, f32::NAN, 0.0, -9.0, 300.0]), Some(3.0));
        assert_eq!(common_step(&[0.375, 0.625]), Some(0.125));
    }

    #[test]
    fn values_without_a_step_have_none() {
        assert_eq!(common_step(&[]), None);
        assert_eq!(common_step(&[0.0, f32::NAN]), None);
        assert_eq!(common_step(&[1.0, -0.0]), None, "minus zero is no multiple that keeps its sign");
        assert_eq!(common_step(&[1.0, f32::INFINITY]), None);
        assert_eq!(common_step(&[1e9, 1.000_001]), None, "too many steps");
        assert_eq!(common_step(&[std::f32::consts::PI * 1e6, 1.1, -std::f32::consts::E * 1e-3]), None);
    }
}
