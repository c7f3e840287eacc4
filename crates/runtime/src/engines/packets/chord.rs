//! The field along a ray: a cubic in each cell, and the line that replaces it.

use super::simd::Simd;
use crate::engines::rules::{
    AVERAGE_OF_BUMP, AVERAGE_OF_CUBIC, GREATEST_OF_CUBIC, SQUARE_OF_BUMP, SQUARE_OF_CUBIC, SWING_OF_BUMP,
    SWING_OF_CUBIC,
};

/// The field along a chord: three values and the cubic coefficient.
#[derive(Clone, Copy)]
pub struct Chord<S: Simd> {
    /// s(0), s(1/2), s(1).
    pub values: [S::F; 3],
    /// Coefficient of u^3.
    pub cubic: S::F,
    /// World length.
    pub length: S::F,
    /// Bound on the rounding of the values.
    pub noise: S::F,
    /// Bounds of the field by the corners of its cell, and of the line that replaces it.
    pub bounds: [S::F; 2],
}

/// `k0 + k1 u + k2 u^2 + k3 u^3` from its values at 0, 1/2 and 1 and from k3.
#[inline(always)]
pub fn cubic_through<S: Simd>([first, middle, last]: [S::F; 3], cubic: S::F) -> [S::F; 4] {
    let rise = last - first;
    let square = S::mul_add(S::splat(-1.5), cubic, S::splat(2.0) * ((first - middle) + (last - middle)));
    [first, rise - square - cubic, square, cubic]
}

/// The cubic with these coefficients at u.
#[inline(always)]
pub fn cubic_at<S: Simd>([k0, k1, k2, k3]: [S::F; 4], u: S::F) -> S::F {
    S::mul_add(u, S::mul_add(u, S::mul_add(u, k3, k2), k1), k0)
}

impl<S: Simd> Chord<S> {
    /// Bounds of any field.
    pub const UNBOUNDED: [f32; 2] = [f32::NEG_INFINITY, f32::INFINITY];

    /// No cell.
    #[inline(always)]
    pub fn nothing() -> Self {
        let zero = S::splat(0.0);
        Self { values: [zero; 3], cubic: zero, length: zero, noise: zero, bounds: Self::UNBOUNDED.map(S::splat) }
    }

    /// Distance of the middle from the line between the ends, upwards.
    #[inline(always)]
    fn signed_bump(&self) -> S::F {
        let [first, middle, last] = self.values;
        S::mul_add(first + last, S::splat(-0.5), middle)
    }

    /// Its size.
    #[inline(always)]
    fn bump(&self) -> S::F {
        S::abs(self.signed_bump())
    }

    /// Greatest and mean distance of the field from its line. It is the sum of the parabola `4 bump (u (1 - u) - 1/6)`,
    /// the cubic's odd part, and rounding.
    #[inline(always)]
    fn departure(&self) -> [S::F; 2] {
        let (bump, cubic) = (self.bump(), S::abs(self.cubic));
        let most = S::mul_add(bump, S::splat(2.0 / 3.0), S::mul_add(cubic, S::splat(GREATEST_OF_CUBIC), self.noise));
        [most, S::mul_add(bump, S::splat(AVERAGE_OF_BUMP), cubic * S::splat(AVERAGE_OF_CUBIC))]
    }

    /// Greatest slope of the field's distance from its line, per u: `4 bump (1 - 2 u)` and of the cubic's odd part `3 u^2 - 3 u + 1/2`.
    #[inline(always)]
    fn turn(&self) -> S::F {
        S::mul_add(self.bump(), S::splat(4.0), S::abs(self.cubic) * S::splat(0.5))
    }

    /// Bounds of the field, and of its line.
    #[inline(always)]
    pub fn range(&self) -> [S::F; 2] {
        let [first, middle, last] = self.values;
        let (zero, quarter, bump) = (S::splat(0.0), S::splat(0.25), self.signed_bump());
        // Between its three values the field leaves the connecting lines by a quarter of the bump, plus the cubic part.
        let of_cubic = S::mul_add(S::abs(self.cubic), S::splat(GREATEST_OF_CUBIC), self.noise);
        let below = S::mul_add(S::max(zero - bump, zero), quarter, of_cubic);
        let above = S::mul_add(S::max(bump, zero), quarter, of_cubic);
        let (low, high) = (S::min(S::min(first, last), middle) - below, S::max(S::max(first, last), middle) + above);
        let [a, b] = self.ends();
        let (low, high) = (S::min(low, S::min(a, b)), S::max(high, S::max(a, b)));
        // The second, if one is NaN: beside a hole.
        [S::max(self.bounds[0], low), S::min(self.bounds[1], high)]
    }

    /// Mean of the field: Simpson's rule, exact for cubics.
    #[inline(always)]
    fn mean(&self) -> S::F {
        let [first, middle, last] = self.values;
        S::mul_add(middle, S::splat(4.0 / 6.0), (first + last) * S::splat(1.0 / 6.0))
    }

    /// Ends of the line that replaces the field: the same mean, and the same rise.
    #[inline(always)]
    fn ends(&self) -> [S::F; 2] {
        let [first, _, last] = self.values;
        ends_of::<S>(self.mean(), last - first)
    }

    /// The line that replaces the field.
    #[inline(always)]
    pub fn line(&self) -> Line<S> {
        let [most, average] = self.departure();
        let ends = self.ends();
        let (bump, cubic) = (self.bump(), S::abs(self.cubic));
        let of_cubic = (self.cubic * self.cubic) * S::splat(SQUARE_OF_CUBIC);
        let square = S::mul_add(bump * bump, S::splat(SQUARE_OF_BUMP), of_cubic);
        let swing = [
            S::mul_add(bump, S::splat(SWING_OF_BUMP), cubic * S::splat(SWING_OF_CUBIC)),
            S::mul_add(bump, S::splat(1.0 / 24.0), cubic * S::splat(1.0 / 120.0)),
        ];
        let moments = [square, self.cubic * S::splat(-1.0 / 120.0)];
        let bow = [self.signed_bump(), self.cubic];
        let (range, length, turn, noise) = (self.range(), self.length, self.turn(), self.noise);
        Line { ends, range, most, average, square, swing, moments, is_span: false, bow, turn, length, noise }
    }
}

/// Ends of the line with this mean and rise.
#[inline(always)]
fn ends_of<S: Simd>(mean: S::F, rise: S::F) -> [S::F; 2] {
    [S::mul_add(rise, S::splat(-0.5), mean), S::mul_add(rise, S::splat(0.5), mean)]
}

/// The line that replaces the field along a chord, or along several consecutive chords.
#[derive(Clone, Copy)]
pub struct Line<S: Simd> {
    pub(crate) ends: [S::F; 2],
    /// Bounds of field and line.
    pub(crate) range: [S::F; 2],
    /// Greatest distance of the field from the line.
    pub(crate) most: S::F,
    /// Bound on its mean distance.
    pub(crate) average: S::F,
    /// Bound on the mean of its square.
    pub(super) square: S::F,
    /// Greatest integral of the distance r from the beginning to anywhere, and bound on the mean of its size.
    pub(super) swing: [S::F; 2],
    /// Mean of r^2, and of (u - 1/2) r, of one chord.
    pub(super) moments: [S::F; 2],
    /// Whether it replaces several chords, so that r is not one parabola and one cubic: its moments are not known.
    pub(super) is_span: bool,
    /// Signed bump and cubic coefficient, of one chord.
    pub(super) bow: [S::F; 2],
    /// Greatest slope of r.
    pub(super) turn: S::F,
    /// World length.
    pub(super) length: S::F,
    /// Bound on the rounding of the field.
    pub(super) noise: S::F,
}

impl<S: Simd> Line<S> {
    /// The line that replaces several consecutive chords; those of length 0 are ignored.
    #[inline(always)]
    pub fn over(chords: &[Chord<S>]) -> Self {
        let (zero, one, half) = (S::splat(0.0), S::splat(1.0), S::splat(0.5));
        let (mut length, mut sum) = (zero, zero);
        for chord in chords {
            length = length + chord.length;
            sum = S::mul_add(chord.mean(), chord.length, sum);
        }
        let per_length = one / S::max(length, S::splat(f32::MIN_POSITIVE));
        let rise = chords[chords.len() - 1].values[2] - chords[0].values[0];
        let ends = ends_of::<S>(sum * per_length, rise);
        let slope = rise * per_length;
        // At a chord's beginning: the line, and the field's distance from it.
        let mut line = ends[0];
        let mut before = S::abs(chords[0].values[0] - line);
        let (mut most, mut area, mut inside, mut noise) = (before, zero, zero, zero);
        // The line may begin or end outside the field's range.
        let mut low = S::min(chords[0].values[0], S::min(ends[0], ends[1]));
        let mut high = S::max(chords[0].values[0], S::max(ends[0], ends[1]));
        for chord in chords {
            let [_, middle, last] = chord.values;
            let to_middle = slope * (half * chord.length);
            let at_middle = S::abs(middle - (line + to_middle));
            line = line + (to_middle + to_middle);
            let behind = S::abs(last - line);
            // Between the three positions, the field leaves the connecting lines by a quarter of the bump, plus the
            // cubic part.
            let (bump, cubic) = (chord.bump(), S::abs(chord.cubic));
            inside = S::max(inside, S::mul_add(bump, S::splat(0.25), cubic * S::splat(GREATEST_OF_CUBIC)));
            let between = S::mul_add(bump, S::splat(1.0 / 6.0), cubic * S::splat(AVERAGE_OF_CUBIC));
            let sides = S::mul_add(before + behind, S::splat(0.25), half * at_middle);
            area = S::mul_add(sides + between, chord.length, area);
            most = S::max(most, S::max(at_middle, behind));
            low = S::min(low, S::min(middle, last));
            high = S::max(high, S::max(middle, last));
            noise = S::max(noise, chord.noise);
            before = behind;
        }
        let (most, inside) = (most + inside + noise, inside + noise);
        // Beside a hole nothing is known, and minimum and maximum ignore NaN.
        let (has_hole, unknown) = (S::is_nan(sum), S::splat(f32::NAN));
        let range = [S::select(has_hole, unknown, low - inside), S::select(has_hole, unknown, high + inside)];
        Self::span((ends, range), [most, area * per_length], [length, noise])
    }

    /// A line of several chords, of which only the greatest and the mean distance of the field are known, beside length and noise.
    #[inline(always)]
    pub fn span((ends, range): ([S::F; 2], [S::F; 2]), [most, average]: [S::F; 2], [length, noise]: [S::F; 2]) -> Self {
        let (square, swing, turn) = (most * average, [S::splat(0.5) * average; 2], S::splat(f32::INFINITY));
        let (moments, bow) = ([S::splat(0.0); 2], [S::splat(0.0); 2]);
        Self { ends, range, most, average, square, swing, moments, is_span: true, bow, turn, length, noise }
    }

    /// Bounds of the field, and of the line; NaN beside a hole.
    #[inline(always)]
    pub fn range(&self) -> [S::F; 2] {
        self.range
    }

    /// Lanes that have anything to integrate.
    #[inline(always)]
    pub fn crosses(&self) -> S::M {
        S::lt(S::splat(0.0), self.length)
    }
}
