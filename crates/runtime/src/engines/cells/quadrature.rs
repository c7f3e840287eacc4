//! Emission and absorption along a chord: the number of Gauss pairs, and the contribution of one pair.
//!
//! Between the values at which the transfer function bends or steps, kappa and colour are smooth in u. A two-point
//! Gauss rule is then of fourth order. `h` is a world length, `kappa` extinction per world length.

use supervol_format::cast::{single, whole};
use supervol_scene::transfer_function::RenderTransferFunction;

use super::cell::{Parameters, Real, cubic_at, cubic_roots, monotone_intervals};
use crate::engines::rules::{
    MIN_WEIGHT, PAIR_NORMAL_CHANGE, PAIR_NORMAL_DEPTH, PAIR_VARIATION, PAIR_VARIATION_DEPTH, PAIRS_PER_VARIATION,
};

/// Position of the first Gauss point in [0, 1]: `(1 - 1/sqrt(3)) / 2`; the second lies symmetric.
pub const GAUSS_OFFSET: Real = 0.211_324_865_405_187_1;
/// Distance between the two Gauss points, as a share of the interval: `1/sqrt(3)`.
pub const GAUSS_DISTANCE: f32 = 0.577_350_3;
/// A chord is split at the transfer function's knots if at most this many lie in its cell's range.
pub const KNOT_LIMIT: usize = 8;
/// Most Gauss pairs between two splits.
pub const PAIR_LIMIT: u32 = 64;

/// Ends of the parts of a chord: 0, up to 3 crossings of each of [`KNOT_LIMIT`] knots, 1.
pub type Splits = Parameters<{ 2 + 3 * KNOT_LIMIT }>;

/// `1 - exp(-tau)`, accurate for small tau.
#[inline]
#[must_use]
pub fn opacity_of(tau: f32) -> f32 {
    if tau < 0.0625 {
        // Taylor series; the first omitted term is below 2^-24 of the sum.
        tau - tau * tau * (1.0 / 2.0 - tau * (1.0 / 6.0 - tau * (1.0 / 24.0 - tau * (1.0 / 120.0))))
    } else {
        1.0 - (-tau).exp()
    }
}

/// Premultiplied colour and opacity of an interval of length `h` from its two Gauss points, nearer one first.
///
/// The opacity is `1 - exp(-tau)` with Gauss's `tau = (kappa_1 + kappa_2) h / 2`. The colour is the mean of the two
/// colours, with Gauss's weights for the emission that gets out, `kappa_i T_i`. For extinction that is linear in
/// between, `T_2 / T_1 = exp(-tau / sqrt(3))` exactly. So a constant colour is exact, and the error is of fourth order
/// in both. The rule is inaccurate if tau is large and the colour changes: there the pairs must be short
/// ([`pair_count`]).
#[inline]
#[must_use]
pub fn integrate_pair(kappa: [f32; 2], color: [[f32; 3]; 2], h: f32) -> ([f32; 3], f32) {
    let tau = 0.5 * (kappa[0] + kappa[1]) * h;
    if tau <= 0.0 || tau.is_nan() {
        return ([0.0; 3], 0.0);
    }
    let opacity = opacity_of(tau);
    let near = kappa[0];
    let far = kappa[1] * (-tau * GAUSS_DISTANCE).exp().max(MIN_WEIGHT);
    let share = opacity / (near + far);
    (std::array::from_fn(|c| share * (near * color[0][c] + far * color[1][c])), opacity)
}

/// Number of Gauss pairs for an interval with this variation of the transfer function, and of optical depth `tau`.
#[inline]
#[must_use]
pub fn pair_count(variation: f32, tau: f32) -> u32 {
    let root = (variation * (1.0 / PAIR_VARIATION)).sqrt().sqrt();
    let wanted = root + variation * (PAIRS_PER_VARIATION + tau * (1.0 / PAIR_VARIATION_DEPTH));
    // `as` saturates, and maps NaN to 0.
    whole::<u32>(wanted.ceil()).clamp(1, PAIR_LIMIT)
}

/// Number of Gauss pairs for an interval in which the normal turns this far (a length), of optical depth `tau`.
#[inline]
#[must_use]
pub fn shaded_pair_count(turn: f32, tau: f32) -> u32 {
    let wanted = turn * (1.0 / PAIR_NORMAL_CHANGE) + turn * tau * (1.0 / PAIR_NORMAL_DEPTH);
    whole::<u32>(wanted.ceil()).clamp(1, PAIR_LIMIT)
}

/// Positions at which the chord is split: its ends, and the crossings of its cubic with the knots. There are at most
/// [`KNOT_LIMIT`] knots.
#[inline]
#[must_use]
pub fn splits_of_chord(cubic: &[Real; 4], knots: &[f32]) -> Splits {
    let mut splits = Splits::new();
    splits.insert(0.0);
    let intervals = monotone_intervals(cubic);
    for &knot in knots {
        cubic_roots(cubic, intervals.as_slice(), Real::from(knot), &mut splits);
    }
    splits.insert(1.0);
    splits
}

/// Number of Gauss pairs between two splits, from the values there and in the middle.
#[inline]
#[must_use]
pub fn pairs_between(tf: &RenderTransferFunction, cubic: &[Real; 4], u: [Real; 2], h: Real) -> u32 {
    let values = [u[0], 0.5 * (u[0] + u[1]), u[1]].map(|u| single(cubic_at(cubic, u)));
    let low = values[0].min(values[1]).min(values[2]);
    let high = values[0].max(values[1]).max(values[2]);
    let variation = tf.variation(low, high);
    if variation == 0.0 {
        return 1;
    }
    pair_count(variation, tf.extinction(tf.classify(values[1])[3]) * single(h * (u[1] - u[0])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opacity_is_accurate() {
        for i in 1..4000 {
            let tau = i as f32 * 1e-3;
            let exact = -(-f64::from(tau)).exp_m1();
            assert!((f64::from(opacity_of(tau)) / exact - 1.0).abs() < 1e-6, "tau {tau}");
        }
    }

    /// S02 and S09: the closed forms for constant fields.
    #[test]
    fn constant_intervals_are_exact() {
        for tau in [1e-7f32, 0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 50.0, 1e6] {
            let (color, opacity) = integrate_pair([tau; 2], [[0.8; 3]; 2], 1.0);
            let exact = -(-f64::from(tau)).exp_m1();
            assert!((f64::from(opacity) / exact - 1.0).abs() < 1e-6);
            assert!((color[0] / (0.8 * opacity) - 1.0).abs() < 1e-6);
        }
        assert_eq!(integrate_pair([0.0; 2], [[1.0; 3]; 2], 1.0), ([0.0; 3], 0.0));
        assert!(integrate_pair([0.0, 1e4], [[1.0; 3]; 2], 10.0).0[0].is_finite());
    }

    /// The order of the pair rule, colour and extinction linear: halving h divides the error by 16 and more.
    #[test]
    fn the_pair_rule_is_of_fourth_order() {
        let exact = {
            let n = 200_000;
            let (mut color, mut transmittance) = (0.0, 1.0);
            for i in 0..n {
                let x = (f64::from(i) + 0.5) / f64::from(n);
                let opacity = -(-(0.2 + 1.3 * x) / f64::from(n)).exp_m1();
                color += transmittance * opacity * (0.9 - 0.8 * x);
                transmittance *= 1.0 - opacity;
            }
            color
        };
        let error = |n: u32| {
            let (mut color, mut transmittance) = (0.0, 1.0);
            let h = 1.0 / n as f32;
            for i in 0..n {
                let x = [GAUSS_OFFSET, 1.0 - GAUSS_OFFSET].map(|g| (i as f32 + g as f32) * h);
                let (c, a) = integrate_pair(x.map(|x| 0.2 + 1.3 * x), x.map(|x| [0.9 - 0.8 * x; 3]), h);
                color += transmittance * f64::from(c[0]);
                transmittance *= 1.0 - f64::from(a);
            }
            (color - exact).abs()
        };
        let (coarse, fine) = (error(1), error(2));
        assert!(coarse < 2e-3 && fine < coarse / 12.0, "{coarse} {fine}");
    }
}
