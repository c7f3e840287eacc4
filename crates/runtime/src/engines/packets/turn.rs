//! Bounds of the derivatives of the normal along a part of a ray.
//!
//! Along a part, u from -1/2 to 1/2, the gradient is a cubic `g = G + A u + B u^2 + K u^3`, and the normal is `n = g / |g|`. Let
//! `r1`, `r2`, `r3` be bounds of the lengths of g's derivatives, each over a lower bound p of |g|. The derivatives of n with
//! respect to g are at most `C_k / |g|^k` in any directions, where
//!
//! ```text
//! C_1 = 1    C_2 = 2 / sqrt(3)    C_3 = 3    C_4 = 9.88
//! ```
//!
//! for a symmetric form is greatest on its diagonal (Banach 1938), and along a straight line n is a series of Legendre
//! polynomials. By the chain rule of higher order, derivatives of n along the ray have at most the lengths
//!
//! ```text
//! n1 = r1
//! n2 = C_2 r1^2 + r2
//! n3 = C_3 r1^3 + 3 C_2 r1 r2 + r3
//! n4 = C_4 r1^4 + 6 C_3 r1^2 r2 + C_2 (3 r2^2 + 4 r1 r3)
//! ```
//!
//! and so have those of `n.l` for any unit vector l.
//!
//! Simpson's rule misses the integral of the fourth derivative times a kernel, which is small near the ends (Peano 1913). The lower
//! bound p is linear on each half of the part, and powers of its inverse are convex. Hence a bound in powers of 1/p counts at the
//! ends with 1/23040 each, and in the middle with 1/3840: 1/2880 in all.

use super::shade::{LightAt, dot, greatest_of, least_of};
use super::simd::{Simd, for_three};

/// C_2, rounded up.
pub const SECOND: f32 = 1.15471;
/// C_3.
pub const THIRD: f32 = 3.0;
/// C_4, rounded up.
pub const FOURTH: f32 = 9.8815;
/// Weights of Simpson's kernel: at an end, and in the middle.
pub const KERNEL: [f32; 2] = [1.0 / 23040.0, 1.0 / 3840.0];
/// Error of Simpson's rule, in parts of the second derivative: 1/81, rounded up.
pub const OF_SECOND: f32 = 0.01235;
/// Error of a quadratic through three places in the first moment about the middle, times 12: in parts of the third derivative.
pub const OF_THIRD: f32 = 1.0 / 60.0;
/// Greatest distance of `u^2` from its line over half a part, and of `u^3`, rounded up.
pub const AWAY: [f32; 2] = [1.0 / 16.0, 0.094];

/// Bounds of the lengths of the normal's derivatives at a place, from the first order on.
pub type Derivatives<S> = [<S as Simd>::F; 4];

/// Bounds along a part.
pub struct Turn<S: Simd> {
    /// At the beginning, in the middle and at the end, as the kernel of Simpson's rule weighs them.
    pub places: [Derivatives<S>; 3],
    /// Anywhere.
    pub anywhere: Derivatives<S>,
    /// Of first order, in the mean.
    pub mean_first: S::F,
    /// Lanes where the gradient nowhere is too short for a normal.
    pub is_known: S::M,
    /// Lanes where it is so everywhere.
    pub is_dark: S::M,
    /// Inverse of the least length of the gradient where it is known, else 0.
    pub inverse: S::F,
}

/// Bounds of the normal's derivatives, from bounds of the gradient's and the inverse of its least length.
#[inline(always)]
pub fn derivatives<S: Simd>([first, second, third]: [S::F; 3], inverse: S::F) -> Derivatives<S> {
    let (r1, r2, r3) = (first * inverse, second * inverse, third * inverse);
    let square = r1 * r1;
    let of_square = S::mul_add(square, S::splat(FOURTH), S::splat(6.0 * THIRD) * r2);
    let rest = S::mul_add(S::splat(3.0) * r2, r2, S::splat(4.0) * r1 * r3);
    [
        r1,
        S::mul_add(square, S::splat(SECOND), r2),
        S::mul_add(r1, S::mul_add(square, S::splat(THIRD), S::splat(3.0 * SECOND) * r2), r3),
        S::mul_add(square, of_square, rest * S::splat(SECOND)),
    ]
}

/// Length of a vector.
#[inline(always)]
pub fn length<S: Simd>(v: &[S::F; 3]) -> S::F {
    S::sqrt(dot::<S>(v, v))
}

/// Error of Simpson's rule for a function, from bounds of its fourth derivative at the three places.
#[inline(always)]
pub fn simpson_misses<S: Simd>([begin, middle, end]: [S::F; 3]) -> S::F {
    S::mul_add(begin + end, S::splat(KERNEL[0]), middle * S::splat(KERNEL[1]))
}

impl<S: Simd> Turn<S> {
    /// Bounds along a part from the gradient at its beginning, middle and end, and its cubic coefficient. There certainly is a normal
    /// above the second of `floors`, and none below the first.
    #[inline(always)]
    pub fn along(light: &[LightAt<S>; 3], cubic: &[S::F; 3], floors: [f32; 2]) -> Self {
        let (one, two) = (S::splat(1.0), S::splat(2.0));
        let [begin, middle, end] = for_three!(i => light[i].gradient);
        let bow = for_three!(a => two * ((begin[a] - middle[a]) + (end[a] - middle[a])));
        let slope = for_three!(a => S::mul_add(S::splat(-0.25), cubic[a], end[a] - begin[a]));
        let (ahead, behind) = (for_three!(a => slope[a] + bow[a]), for_three!(a => slope[a] - bow[a]));
        let (of_bow, of_cubic) = (length::<S>(&bow), length::<S>(cubic));
        let steepest = S::sqrt(S::max(dot::<S>(&ahead, &ahead), dot::<S>(&behind, &behind)));
        let first = S::mul_add(of_cubic, S::splat(0.75), steepest);
        let second = S::mul_add(of_cubic, S::splat(3.0), of_bow + of_bow);
        let orders = [first, second, of_cubic * S::splat(6.0)];
        // The gradient is at least as long as its part along the middle one.
        let axis = for_three!(a => middle[a] * light[1].inverse_length);
        let [of_square, of_cube] = AWAY.map(S::splat);
        let aside = S::mul_add(S::abs(dot::<S>(cubic, &axis)), of_cube, S::abs(dot::<S>(&bow, &axis)) * of_square);
        let lengths = for_three!(i => dot::<S>(&light[i].gradient, &axis) - aside);
        let [dark, bright] = floors.map(S::splat);
        let is_known = S::lt(bright, least_of::<S>(lengths));
        let squares = for_three!(i => dot::<S>(&light[i].gradient, &light[i].gradient));
        let reach = S::mul_add(of_cubic, of_cube, of_bow * of_square);
        let is_dark = S::lt(S::sqrt(greatest_of::<S>(squares)) + reach, dark);
        let inverses = for_three!(i => one / S::select(is_known, lengths[i], one));
        let inverse = greatest_of::<S>(inverses);
        Self {
            places: for_three!(i => derivatives::<S>(orders, inverses[i])),
            mean_first: first * S::splat(0.25) * (inverses[0] + inverses[2] + inverses[1] + inverses[1]),
            anywhere: derivatives::<S>(orders, inverse),
            is_known,
            is_dark,
            inverse: S::select(is_known, inverse, S::splat(0.0)),
        }
    }

    /// Error of Simpson's rule for the cosine of the normal to any direction.
    #[inline(always)]
    pub fn missed(&self) -> S::F {
        let by_fourth = simpson_misses::<S>(for_three!(i => self.places[i][3]));
        S::min(by_fourth, self.anywhere[1] * S::splat(OF_SECOND))
    }

    /// Two bounds where there is a normal, where there may be one, and where there is none.
    #[inline(always)]
    pub fn choose(&self, known: [S::F; 2], unknown: [S::F; 2], dark: S::F) -> [S::F; 2] {
        let of = [S::select(self.is_known, known[0], unknown[0]), S::select(self.is_known, known[1], unknown[1])];
        [S::select(self.is_dark, dark, of[0]), S::select(self.is_dark, dark, of[1])]
    }
}
