//! Bounds of the derivatives of a highlight `q^s`, q = |n.h|, where the normal turns.
//!
//! The derivatives of q along the ray are at most those of the normal ([`super::turn`]), and the first is at most
//! `n1 sqrt(1 - q^2)`, for n' is perpendicular to n. Hence those of the highlight are at most
//!
//! ```text
//! s n1 [q^(s-1) sqrt(1 - q^2)]
//! s^2 n1^2 [q^(s-2) (1 - q^2)] + s n2 [q^(s-1)]
//! s^3 n1^3 [q^(s-3) (1 - q^2)] + (3 s^2 n1 n2 + s n3) [q^(s-4)]
//! s^4 n1^4 [q^(s-4) (1 - q^2)^2] + 6 s^3 n1^2 n2 [q^(s-3) (1 - q^2)] + (s^2 (4 n1 n3 + 3 n2^2) + s n4) [q^(s-4)]
//! ```
//!
//! A bracket is at most its greatest value, and at most its first factor at the greatest q.

use supervol_format::cast::single;

use super::simd::{Simd, for_three};
use super::turn::{Derivatives, OF_SECOND, OF_THIRD, Turn, simpson_misses};

/// Shininess below which a highlight has no fourth derivative where q vanishes.
pub const SMOOTH_FROM: f32 = 4.0;
/// Least q of which brackets are taken: they grow with it.
pub const LEAST_COSINE: f32 = 0.1;
/// Slope that stands for none: below a shininess of 1.
pub const VERTICAL: f32 = 1e6;

/// The brackets of the module's head for one shininess.
#[derive(Debug, Clone, Copy)]
pub struct Highlight {
    shininess: f32,
    /// Greatest values, in the order of the head.
    pub greatest: [f32; 4],
}

/// Bounds of a highlight along a part, of one light of intensity 1.
pub struct HighlightBounds<S: Simd> {
    /// Errors of Simpson's rule, and of a quadratic's first moment about the middle, times 12.
    pub missed: S::F,
    pub of_moment: S::F,
    /// First derivative, anywhere and in the mean.
    pub first: S::F,
    pub mean_first: S::F,
}

/// The brackets, and the powers `q^(s-1)` and `q^(s-4)`.
struct Brackets<S: Simd> {
    of: [S::F; 4],
    powers: [S::F; 2],
}

/// Greatest `q^a (1 - q^2)^b`, rounded up.
fn greatest_power(a: f64, b: f64) -> f32 {
    let aside = 2.0 * b / (a + 2.0 * b);
    single(1.000_001 * aside.powf(b) * (1.0 - aside).powf(0.5 * a))
}

impl Highlight {
    /// Highlights of this shininess.
    #[must_use]
    pub fn new(shininess: f32) -> Self {
        let s = f64::from(shininess.max(SMOOTH_FROM));
        let exponents = [(s - 1.0, 0.5), (s - 2.0, 1.0), (s - 3.0, 1.0), (s - 4.0, 2.0)];
        Self { shininess, greatest: exponents.map(|(a, b)| greatest_power(a, b)) }
    }

    /// Bounds along a part where q is at most `nearest`, which is not below [`LEAST_COSINE`], and `power` its power.
    #[inline(always)]
    pub fn along<S: Simd>(&self, turn: &Turn<S>, nearest: S::F, power: S::F) -> HighlightBounds<S> {
        if self.shininess < SMOOTH_FROM {
            let first = self.rough::<S>(turn.anywhere[0]);
            // Any function with this slope.
            let missed = S::min(first * S::splat(0.139), power);
            let mean_first = self.rough::<S>(turn.mean_first);
            return HighlightBounds {
                missed,
                first,
                mean_first,
                of_moment: S::min(first * S::splat(0.5), power * S::splat(3.0)),
            };
        }
        let brackets = self.brackets::<S>(nearest, power);
        let [first, second, middle, _] = brackets.of;
        let (s, s2) = (S::splat(self.shininess), S::splat(self.shininess * self.shininess));
        let [n1, n2, n3, _] = turn.anywhere;
        let second = s * S::mul_add(s * n1, n1 * second, n2 * brackets.powers[0]);
        let of_power = S::mul_add(S::splat(3.0) * s2 * n1, n2, s * n3);
        let third = S::mul_add(s * s2 * n1 * n1, n1 * middle, of_power * brackets.powers[1]);
        let by_fourth = simpson_misses::<S>(for_three!(i => self.fourth::<S>(&turn.places[i], &brackets)));
        HighlightBounds {
            missed: S::min(S::min(by_fourth, second * S::splat(OF_SECOND)), power),
            first: s * n1 * first,
            mean_first: s * turn.mean_first * first,
            of_moment: S::min(third * S::splat(OF_THIRD), power * S::splat(3.0)),
        }
    }

    /// Bounds of the first two derivatives, from those of the normal. Where there is no second one: such that over a stretch of
    /// this length it stands for any function of the same slope.
    #[inline(always)]
    pub fn first_two<S: Simd>(&self, [n1, n2]: [S::F; 2], nearest: S::F, power: S::F, stretch: f32) -> [S::F; 2] {
        if self.shininess < SMOOTH_FROM {
            let first = self.rough::<S>(n1);
            return [first, first * S::splat(6.0 / stretch)];
        }
        let brackets = self.brackets::<S>(nearest, power);
        let [first, second, ..] = brackets.of;
        let s = S::splat(self.shininess);
        [s * n1 * first, s * S::mul_add(s * n1, n1 * second, n2 * brackets.powers[0])]
    }

    /// Bound of the fourth derivative.
    #[inline(always)]
    fn fourth<S: Simd>(&self, [n1, n2, n3, n4]: &Derivatives<S>, brackets: &Brackets<S>) -> S::F {
        let (n1, n2, n3, n4) = (*n1, *n2, *n3, *n4);
        let (s, s2) = (S::splat(self.shininess), S::splat(self.shininess * self.shininess));
        let [_, _, middle, last] = brackets.of;
        let square = n1 * n1;
        let of_power = S::mul_add(s2, S::mul_add(S::splat(4.0) * n1, n3, S::splat(3.0) * n2 * n2), s * n4);
        let of_middle = S::splat(6.0) * s * s2 * square * n2;
        let of_last = s2 * s2 * square * square;
        S::mul_add(of_power, brackets.powers[1], S::mul_add(of_middle, middle, of_last * last))
    }

    /// Slope of a highlight that is not smooth.
    #[inline(always)]
    fn rough<S: Simd>(&self, turn: S::F) -> S::F {
        turn * S::splat(if self.shininess < 1.0 { VERTICAL } else { self.shininess })
    }

    /// The brackets where q is at most `nearest`.
    #[inline(always)]
    fn brackets<S: Simd>(&self, nearest: S::F, power: S::F) -> Brackets<S> {
        let one = S::splat(1.0);
        let per = one / nearest;
        let second = power * per * per;
        let fourth = second * per * per;
        let [a, b, c, d] = self.greatest;
        let of = [
            S::min(power * per, S::splat(a)),
            S::min(second, S::splat(b)),
            S::min(second * per, S::splat(c)),
            S::min(fourth, S::splat(d)),
        ];
        Brackets { of, powers: [S::min(power * per, one), S::min(fourth, one)] }
    }
}
