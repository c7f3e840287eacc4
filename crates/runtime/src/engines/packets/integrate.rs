//! Emission and absorption on a chord by antiderivatives of the transfer function, with the error of the rule.
//!
//! Along a chord of length h, u from 0 to 1, the field is a cubic s(u). It is replaced by the line with the same
//! difference d between its ends and the same mean m, from a = m - d/2 to b = m + d/2. Channels f (extinction,
//! emission) then have the exact mean `(F(b) - F(a)) / (b - a)`, with F their antiderivative, for any steps in between.
//! With `tau = h mean(kappa)` the opacity is `1 - exp(-tau)`, and the colour
//!
//! ```text
//! C = mean(e) h (1 - exp(-tau)) / tau  -  h^2 (de mean(kappa) - mean(e) dkappa) R(tau)
//! R ~ 1 / (12 + 6 tau + 1.2 tau^2)
//! ```
//!
//! where de and dkappa are the differences between the ends. The second term is the effect of the order of emission and
//! absorption. It is exact for small tau, and within 6 % of the exact rational of exponentials up to tau = 3. It
//! assumes linear extinction and emission. Elsewhere it is limited to the largest effect of order on two colours that
//! differ by D: `D (1 - exp(-tau/2))^2 / 2`, below `D ((1 - exp(-tau)) (1 - exp(-tau)/2))^2 / 2`.
//!
//! Error of the line ([`Part::error`], opacity or colour as a share of the light in front), with r = s - line:
//! - a step of height J inside is misplaced by at most the share of the chord on which |line - step| <= |r|;
//! - a bend (change of slope Q) adds at most Q mean|r| / 2, because the mean of r is zero;
//! - varying colour may be in the wrong order.

use supervol_scene::transfer_function::pieces::{CHANNELS, Column, Limits};

use super::lookup::{Channels, PieceLookup, Place, channels};
use super::simd::{Simd, exp_minus};
use crate::engines::rules::{
    AVERAGE_OF_BUMP, AVERAGE_OF_CUBIC, GREATEST_OF_CUBIC, LEAN_SQUARE, OF_CURVE, OF_CURVES, OF_KINK, OF_STEP,
    OF_UNSETTLED_KINK, ORDER_OF_DEPTH, ORDER_SQUARE, SPREAD_SQUARE, SQUARE_OF_BUMP, SQUARE_OF_CUBIC, SWING_OF_BUMP,
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

/// Contribution of a part of a ray.
#[derive(Clone, Copy)]
pub struct Part<S: Simd> {
    /// Premultiplied colour.
    pub color: [S::F; 3],
    /// Optical depth.
    pub tau: S::F,
    /// Share of light from behind that passes: `exp(-tau)`.
    pub transmittance: S::F,
    /// Bound on the error of colour and opacity, with the limits stated in the module's head.
    pub error: S::F,
    /// Share of that error which rounding makes.
    pub rounding: S::F,
    /// Origin of opacity and of the colours along the part: first moments about its middle.
    pub moments: [S::F; CHANNELS],
    /// Bound on how far each of the four is from a density that is linear from end to end, and has its sum and its moment:
    /// the greatest distance of their integrals from the beginning.
    pub misplaced: S::F,
    /// Variation of colour over the part.
    pub colors: S::F,
}

impl<S: Simd> Part<S> {
    /// An empty part.
    #[inline(always)]
    pub fn nothing() -> Self {
        let zero = S::splat(0.0);
        let transmittance = S::splat(1.0);
        Self {
            color: [zero; 3],
            tau: zero,
            transmittance,
            error: zero,
            rounding: zero,
            moments: [zero; CHANNELS],
            misplaced: zero,
            colors: zero,
        }
    }

    /// Lower bound on the optical depth; 0 if its error is unlimited or unknown.
    #[inline(always)]
    pub fn least_depth(&self) -> S::F {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let least = S::max(S::mul_add(S::splat(-2.0), self.error, self.tau), zero);
        S::select(S::lt(self.error, one), least, zero)
    }
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

    /// Distance of the middle from the line between the ends.
    #[inline(always)]
    fn bump(&self) -> S::F {
        let [first, middle, last] = self.values;
        S::abs(S::mul_add(first + last, S::splat(-0.5), middle))
    }

    /// Greatest and mean distance of the field from its line. It is the sum of the parabola `4 bump (u (1 - u) - 1/6)`,
    /// the cubic's odd part, and rounding.
    #[inline(always)]
    fn departure(&self) -> [S::F; 2] {
        let (bump, cubic) = (self.bump(), S::abs(self.cubic));
        let most = S::mul_add(bump, S::splat(2.0 / 3.0), S::mul_add(cubic, S::splat(GREATEST_OF_CUBIC), self.noise));
        [most, S::mul_add(bump, S::splat(AVERAGE_OF_BUMP), cubic * S::splat(AVERAGE_OF_CUBIC))]
    }

    /// Bounds of the field.
    #[inline(always)]
    pub fn range(&self) -> [S::F; 2] {
        let [first, middle, last] = self.values;
        let margin = S::mul_add(S::abs(self.cubic), S::splat(GREATEST_OF_CUBIC), self.departure()[0]);
        let low = S::min(S::min(first, last), middle) - margin;
        let high = S::max(S::max(first, last), middle) + margin;
        // The second, if one is NaN: beside a hole.
        [S::max(self.bounds[0], low), S::min(self.bounds[1], high)]
    }

    /// Mean of the field: Simpson's rule, exact for cubics.
    #[inline(always)]
    fn mean(&self) -> S::F {
        let [first, middle, last] = self.values;
        S::mul_add(middle, S::splat(4.0 / 6.0), (first + last) * S::splat(1.0 / 6.0))
    }

    /// The line that replaces the field.
    #[inline(always)]
    pub fn line(&self) -> Line<S> {
        let [most, average] = self.departure();
        let [first, _, last] = self.values;
        let ends = ends_of::<S>(self.mean(), last - first);
        let (bump, cubic) = (self.bump(), S::abs(self.cubic));
        let of_cubic = (self.cubic * self.cubic) * S::splat(SQUARE_OF_CUBIC);
        let square = S::mul_add(bump * bump, S::splat(SQUARE_OF_BUMP), of_cubic);
        let swing = [
            S::mul_add(bump, S::splat(SWING_OF_BUMP), cubic * S::splat(SWING_OF_CUBIC)),
            S::mul_add(bump, S::splat(1.0 / 24.0), cubic * S::splat(1.0 / 120.0)),
        ];
        let moments = [square, self.cubic * S::splat(-1.0 / 120.0)];
        let [first, middle, last] = self.values;
        let bow = [S::mul_add(first + last, S::splat(-0.5), middle), self.cubic];
        let (range, length, unknown) = (self.range(), self.length, [S::splat(0.0); 2]);
        Line { ends, range, most, average, square, swing, moments, unknown, bow, length, noise: self.noise }
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
    ends: [S::F; 2],
    /// Bounds of field and line.
    range: [S::F; 2],
    /// Greatest distance of the field from the line.
    most: S::F,
    /// Bound on its mean distance.
    average: S::F,
    /// Bound on the mean of its square.
    square: S::F,
    /// Greatest integral of the distance r from the beginning to anywhere, and bound on the mean of its size.
    swing: [S::F; 2],
    /// Mean of r^2, and of (u - 1/2) r, if known.
    moments: [S::F; 2],
    /// Bounds on these where they are not known.
    unknown: [S::F; 2],
    /// Signed bump and cubic coefficient; 0 where r is not one parabola and one cubic.
    bow: [S::F; 2],
    /// World length.
    length: S::F,
    /// Bound on the rounding of the field.
    noise: S::F,
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
        let average = area * per_length;
        let (square, swing) = (most * average, half * average);
        let (swing, moments, unknown) = ([swing; 2], [zero; 2], [square, swing]);
        Self { ends, range, most, average, square, swing, moments, unknown, bow: moments, length, noise }
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

/// Positions of a line in a table: all of it that is kept from one stage to the next.
#[derive(Clone, Copy)]
pub struct Located<S: Simd> {
    /// Positions of its ends.
    ends: [Place<S>; 2],
    /// Bounds of the field.
    range: [Place<S>; 2],
}

impl<S: Simd> Located<S> {
    /// Positions that were not looked up.
    #[inline(always)]
    pub fn nothing() -> Self {
        let place = Place { piece: S::splat_int(0), y: S::splat(0.0) };
        Self { ends: [place; 2], range: [place; 2] }
    }
}

/// Looks up the positions of a line.
#[inline(always)]
pub fn locate<S: Simd, L: PieceLookup>(table: &L, line: &Line<S>) -> Located<S> {
    let ([a, b], [low, high]) = (line.ends, line.range);
    Located { ends: [table.place::<S>(a), table.place::<S>(b)], range: [table.place::<S>(low), table.place::<S>(high)] }
}

/// A line and its positions.
struct LineInTable<S: Simd> {
    line: Line<S>,
    ends: [Place<S>; 2],
    /// Distance between its ends after rounding, used for the antiderivatives.
    width: S::F,
    range: [Place<S>; 2],
}

/// Integrates a chord. `limits` is the table's.
#[inline(always)]
pub fn integrate<S: Simd, L: PieceLookup>(table: &L, limits: Limits, chord: &Chord<S>) -> Part<S> {
    let line = chord.line();
    integrate_at(table, limits, &line, &locate(table, &line))
}

/// Integrates along a line whose position in the table is known.
#[inline(always)]
pub fn integrate_at<S: Simd, L: PieceLookup>(
    table: &L,
    limits: Limits,
    line: &Line<S>,
    &Located { ends, range }: &Located<S>,
) -> Part<S> {
    let at = &LineInTable { line: *line, ends, width: line.ends[1] - line.ends[0], range };
    let (zero, one) = (S::splat(0.0), S::splat(1.0));
    let (at_a, at_b) = (channels(table, at.ends[0]), channels(table, at.ends[1]));
    let by_ends = S::eq_int(at.ends[0].piece, at.ends[1].piece) | S::le(S::abs(at.width), S::splat(limits.narrow));
    let mut means = means(&at_a, &at_b, at.width, by_ends);
    add_moments(&mut means, &at_a, at);
    let kinks = Kinks::inside(table, at, &mut means);
    let h = at.line.length;
    let kappa = means[0];
    let tau = kappa * h;
    let transmittance = exp_minus::<S>(tau);
    let opacity = one - transmittance;
    let is_clear = S::lt(tau, S::splat(1e-6));
    let emitting = S::select(is_clear, h, opacity / S::select(is_clear, one, kappa));
    let order = h * h / S::mul_add(tau, S::mul_add(tau, S::splat(ORDER_SQUARE), S::splat(6.0)), S::splat(12.0));
    let kappa_rise = at_b.value[0] - at_a.value[0];
    let around = Around::of(table, limits, at, kinks.settled);
    let reach = opacity * S::mul_add(S::splat(-0.5), transmittance, one);
    let most = S::splat(0.5) * around.colors * reach * reach;
    let square = tau * tau;
    // Where evenly emitted light comes from, about the middle; and how far light of a rise does.
    let lean = zero - tau / S::mul_add(square, S::splat(LEAN_SQUARE), S::splat(12.0));
    let of_rise = emitting / S::mul_add(square, S::splat(SPREAD_SQUARE), S::splat(12.0));
    let extinction_rise = S::mul_add(S::splat(12.0), kinks.moments[0], kappa_rise);
    let mut moments = [moment::<S>(opacity, lean, of_rise * extinction_rise); CHANNELS];
    let mut color = [zero; 3];
    let (mut turn, mut ordered_most) = (zero, zero);
    for c in 0..3 {
        let emission = means[c + 1];
        let emission_rise = at_b.value[c + 1] - at_a.value[c + 1];
        let rise = S::mul_add(S::splat(12.0), kinks.moments[c + 1], emission_rise);
        let of_color = rise * kappa - emission * extinction_rise;
        turn = S::max(turn, S::abs(of_color));
        let ordered = S::min(S::max(order * of_color, zero - most), most);
        ordered_most = S::max(ordered_most, S::abs(ordered));
        color[c] = S::min(S::max(emission * emitting - ordered, zero), opacity);
        moments[c + 1] = moment::<S>(color[c], lean, of_rise * rise);
    }
    let of_ends = S::max(at_a.value[0], zero) + S::max(at_b.value[0], zero) + kappa + kappa;
    let of_noise = around.error_of_noise(at, &at_a, of_ends);
    let of_mean = (around.error_of_mean(at, limits, by_ends) + of_noise) * h;
    let rounding = (around.error_of_rounded_steps(at, limits) + of_noise) * h;
    let of_order = S::min(around.error_of_order(at, &at_a, [kappa, opacity, kappa_rise, turn]), most + ordered_most);
    // What is missed of a mean shows less in a part that is opaque.
    let least = S::max(tau - of_mean, zero);
    let seen = of_mean / S::max(S::splat(0.5) * least, one);
    let error = S::min(seen, one) + of_order;
    let misplaced = around.misplaced(at, &at_a, [kappa, opacity + error, S::splat(limits.narrow)]);
    let rounding = rounding * transmittance;
    Part { color, tau, transmittance, error, rounding, moments, misplaced, colors: S::min(around.colors, one) }
}

/// First moment of a density with this sum; at most half of it, as any has.
#[inline(always)]
fn moment<S: Simd>(sum: S::F, lean: S::F, of_rise: S::F) -> S::F {
    let most = sum * S::splat(0.5);
    S::min(S::max(S::mul_add(sum, lean, of_rise), S::splat(0.0) - most), most)
}

/// Means of the channels over the line between two places; never negative.
///
/// In one piece, the mean of a quadratic follows from its ends, without cancellation: `(f(a) + f(b)) / 2 - bend (b -
/// a)^2 / 6`.
#[inline(always)]
fn means<S: Simd>(a: &Channels<S>, b: &Channels<S>, width: S::F, by_ends: S::M) -> [S::F; CHANNELS] {
    let (zero, one, half) = (S::splat(0.0), S::splat(1.0), S::splat(0.5));
    let per_width = one / S::select(by_ends, one, width);
    let square = width * width;
    let mut means = [zero; CHANNELS];
    for c in 0..CHANNELS {
        let of_sums = ((b.start[c] - a.start[c]) + (b.rest[c] - a.rest[c])) * per_width;
        let of_ends = half * S::mul_add(zero - a.third_bend[c], square, a.value[c] + b.value[c]);
        means[c] = S::max(S::select(by_ends, of_ends, of_sums), zero);
    }
    means
}

/// Makes means exact where field and line stay in one piece: `f'' (mean(r^2) / 2 + (b - a) mean((u - 1/2) r))` is what the line
/// misses of a quadratic.
#[inline(always)]
fn add_moments<S: Simd>(means: &mut [S::F; CHANNELS], a: &Channels<S>, at: &LineInTable<S>) {
    let zero = S::splat(0.0);
    let is_one_piece = S::eq_int(at.range[0].piece, at.range[1].piece);
    let [square, moment] = at.line.moments;
    let missed = S::mul_add(S::splat(3.0), square, S::splat(6.0) * (at.width * moment));
    let missed = S::select(is_one_piece, missed, zero);
    for c in 0..CHANNELS {
        means[c] = S::max(S::mul_add(a.third_bend[c], missed, means[c]), zero);
    }
}

/// Kinks between the ends of a line whose effects are computed: the first and the last one.
struct Kinks<S: Simd> {
    /// First moments of the channels about the middle, less those of lines with the same rise.
    moments: [S::F; CHANNELS],
    /// Changes of slope of these kinks.
    settled: S::F,
}

impl<S: Simd> Kinks<S> {
    /// Finds them, and adds to the means what the field's distance from the line does at them.
    ///
    /// A slope that changes by Q at u = p changes the mean of a channel by `-Q R(p)` on a rising line and `Q R(p)` on a falling
    /// one, with R the integral of r, to first order in r; and its first moment by `Q |b - a| p (1 - p) (1 - 2 p) / 12`.
    #[inline(always)]
    fn inside<L: PieceLookup>(table: &L, at: &LineInTable<S>, means: &mut [S::F; CHANNELS]) -> Self {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let mut found = Self { moments: [zero; CHANNELS], settled: zero };
        let [a, b] = [at.ends[0].piece, at.ends[1].piece];
        let ascends = S::lt(zero, at.width);
        let (lower, upper) = (S::select_int(ascends, a, b), S::select_int(ascends, b, a));
        let first = lower + S::splat_int(1);
        let (has_first, has_last) = (S::lt_int(lower, upper), S::lt_int(first, upper));
        if S::bits(has_first) == 0 {
            return found;
        }
        let per_width = one / S::select(has_first, at.width, one);
        let [bump, cubic] = at.line.bow;
        let size = S::abs(at.width);
        for (piece, is_there) in [(first, has_first), (upper, has_last)] {
            let from_a = table.column::<S>(Column::Anchor, 0, piece) - at.line.ends[0];
            let p = S::min(S::max(from_a * per_width, zero), one);
            let (both, aside) = (p * (one - p), S::mul_add(S::splat(-2.0), p, one));
            let swing = both * S::mul_add(S::splat(0.25) * cubic, both, S::splat(-2.0 / 3.0) * bump * aside);
            let to_mean = S::select(ascends, zero - swing, swing);
            let to_moment = size * both * aside * S::splat(1.0 / 12.0);
            for c in 0..CHANNELS {
                let kink = S::select(is_there, table.column::<S>(Column::Kink, c, piece), zero);
                means[c] = S::max(S::mul_add(kink, to_mean, means[c]), zero);
                found.moments[c] = S::mul_add(kink, to_moment, found.moments[c]);
            }
            let sum = |piece| table.column::<S>(Column::Kinks, 0, piece);
            let change = sum(piece) - sum(piece + S::splat_int(-1));
            found.settled = found.settled + S::select(is_there, change, zero);
        }
        found
    }
}

/// The transfer function over the range of a part: sums of what is uneven in it.
struct Around<S: Simd> {
    /// Heights of steps.
    steps: S::F,
    /// Changes of slope in all, those at knots whose effect is not computed, and those whose effect is.
    bends: S::F,
    kinks: S::F,
    settled: S::F,
    /// Greatest change of slope per value.
    bend: S::F,
    /// Lanes in which the range touches one piece.
    is_one_piece: S::M,
    /// Variation of colour, and of that what is even.
    colors: S::F,
}

impl<S: Simd> Around<S> {
    #[inline(always)]
    fn of<L: PieceLookup>(table: &L, limits: Limits, at: &LineInTable<S>, settled: S::F) -> Self {
        let [low, high] = at.range;
        let between = |column| table.column::<S>(column, 0, high.piece) - table.column::<S>(column, 0, low.piece);
        let [bend_low, bend_high] =
            [per_value(table, Column::BendsPerValue, low), per_value(table, Column::BendsPerValue, high)];
        let bends = sum_up_to(table, Column::Bends, bend_high, high) - sum_up_to(table, Column::Bends, bend_low, low);
        let per_color = Column::ColorVariationPerValue;
        let [slope_low, slope_high] = [per_value(table, per_color, low), per_value(table, per_color, high)];
        let color = Column::ColorVariation;
        let of_stretch = Column::BendOfStretch;
        let bend = S::max(per_value(table, of_stretch, low), per_value(table, of_stretch, high));
        let is_near = S::lt(between(Column::Stretch), S::splat(1.5));
        Self {
            steps: between(Column::Steps),
            bends,
            kinks: S::max(between(Column::Kinks) - settled, S::splat(0.0)),
            settled,
            bend: S::select(is_near, bend, S::splat(limits.bend)),
            is_one_piece: S::eq_int(low.piece, high.piece),
            colors: sum_up_to(table, color, slope_high, high) - sum_up_to(table, color, slope_low, low),
        }
    }

    /// Bound on what the mean of a channel is off by.
    #[inline(always)]
    fn error_of_mean(&self, at: &LineInTable<S>, limits: Limits, by_ends: S::M) -> S::F {
        let narrow = S::splat(limits.narrow);
        let (zero, one, half) = (S::splat(0.0), S::splat(1.0), S::splat(0.5));
        let Line { most, average, square, swing, unknown, .. } = at.line;
        let rise = S::abs(at.width);
        let per_rise = one / S::max(rise, S::splat(1e-30));
        // A narrow interval has the mean of its ends, wherever a step or a kink lies in between.
        let of_steps = self.steps * S::min((most + most + narrow) * per_rise, one);
        let any = half * self.bends * S::mul_add(narrow, S::splat(0.25), average);
        let left_out = S::mul_add(half, unknown[0], rise * unknown[1]);
        let smooth = S::mul_add(half, square, rise * swing[1]);
        let smooth = self.bend * S::select(self.is_one_piece, left_out, smooth);
        // What r does at kinks to second order, and to first order where that is not computed.
        let is_span = S::lt(zero, unknown[1]);
        let first_order = self.kinks + S::select(is_span, self.settled, zero);
        let second = S::mul_add(most * most, per_rise, narrow * S::splat(0.125));
        let crossed = S::mul_add(first_order, swing[0], (self.kinks + self.settled) * second);
        let rounded = S::select(by_ends, zero, S::splat(limits.difference) * per_rise);
        of_steps + S::max(S::min(any, smooth + crossed), zero) + rounded
    }

    /// Bound on what the mean of a channel changes by if the field is off by its rounding. It moves by at most the slope times that; and,
    /// for a field from end to end, the integral over values changes at its ends, and the way per value.
    #[inline(always)]
    fn error_of_noise(&self, at: &LineInTable<S>, a: &Channels<S>, of_ends: S::F) -> S::F {
        let per_rise = S::splat(1.0) / S::max(S::abs(at.width), S::splat(1e-30));
        at.line.noise * S::min(a.slope + self.bends, of_ends * per_rise)
    }

    /// Bound on the error of a mean by steps that rounding misplaces.
    #[inline(always)]
    fn error_of_rounded_steps(&self, at: &LineInTable<S>, limits: Limits) -> S::F {
        let noise = at.line.noise + at.line.noise + S::splat(limits.narrow);
        self.steps * S::min(noise / S::max(S::abs(at.width), S::splat(1e-30)), S::splat(1.0))
    }

    /// Bound on what is missed of the effect of order.
    #[inline(always)]
    fn error_of_order(
        &self,
        at: &LineInTable<S>,
        a: &Channels<S>,
        [kappa, opacity, kappa_rise, turn]: [S::F; 4],
    ) -> S::F {
        let one = S::splat(1.0);
        let Line { most, average, square, swing, length, .. } = at.line;
        let rise = S::abs(at.width);
        let per_rise = one / S::max(rise, S::splat(1e-30));
        let per_kappa = one / S::max(kappa, S::splat(1e-20));
        let tau = kappa * length;
        let (slope, curve) = (a.slope + self.bends, self.bend * (rise * rise));
        let (kink, misplaced) = (self.kinks * rise, S::min((most + most) * per_rise, one));
        let settled = self.settled * rise;
        let tilt = S::abs(kappa_rise) * per_kappa;
        // How far extinction, relative to its mean, is from a line; and how far light comes from elsewhere than evenly.
        let shape = S::mul_add(curve, S::splat(0.0322), (kink + settled) * S::splat(1.0 / 16.0));
        let shape = S::min(shape, self.bends * rise * S::splat(1.0 / 16.0));
        let rest = S::min((shape + slope * average + self.steps) * per_kappa, S::splat(2.0));
        let from = S::mul_add(tilt, S::splat(0.25), rest) * S::mul_add(tau, S::splat(0.6), one);
        let from = S::min(S::mul_add(tau, S::splat(0.6), from), S::splat(2.0));
        let from = S::select(S::le(tau, one), from, S::splat(2.0));
        // The integral of what emission and extinction, each, are from lines: where the field is one, and where it is not.
        let of_curve = curve * S::splat(0.00802) * S::select(self.is_one_piece, from, one);
        let of_kinks = kink * S::mul_add(from, S::splat(0.0313), S::splat(0.00803));
        let of_kinks = S::mul_add(settled * from, S::splat(0.0434), of_kinks);
        let on = of_curve + of_kinks;
        let bow = S::mul_add(slope, from, self.bends + self.bends) * swing[0];
        let off = S::mul_add(S::splat(0.5) * self.bend, square, bow + slope * S::abs(at.line.moments[1]));
        let off = S::mul_add(self.kinks + self.settled, most * most * per_rise, off + slope * at.line.unknown[1]);
        let near = on + off;
        let any = S::mul_add(self.bends * rise, S::splat(1.0 / 32.0), slope * average);
        let uneven = S::min(near, any) + self.steps * S::mul_add(S::splat(0.25), one, misplaced);
        let shape = opacity * length * (uneven + uneven);
        // Where order is counted by the line.
        let moved = tau * S::mul_add(tilt, S::splat(0.125), rest * S::splat(0.5));
        let of_tilt = opacity * tau * S::mul_add(tau * tau, S::splat(ORDER_OF_DEPTH), tilt * S::splat(1.0 / 240.0));
        let of_rest = S::splat(0.125) * S::mul_add(moved, moved, tau * rest);
        S::mul_add(turn * per_kappa * length, of_tilt + of_rest, shape)
    }

    /// See [`Part::misplaced`].
    ///
    /// Of a density that is not linear: what its curvature does, [`OF_CURVE`] times it; what a change of slope does; what a
    /// step does. To each is added what the moment is off by, for the line has the stated one.
    #[inline(always)]
    fn misplaced(&self, at: &LineInTable<S>, a: &Channels<S>, [kappa, opacity, narrow]: [S::F; 3]) -> S::F {
        let one = S::splat(1.0);
        let Line { most, average, square, swing, length, .. } = at.line;
        let rise = S::abs(at.width);
        let per_rise = one / S::max(rise, S::splat(1e-30));
        let slope = a.slope + self.bends;
        // The transfer function along the line, and what the field's distance from it does.
        let curve = self.bend * (rise * rise) * S::select(self.is_one_piece, S::splat(OF_CURVE), S::splat(OF_CURVES));
        let kinks = rise * S::mul_add(self.kinks, S::splat(OF_UNSETTLED_KINK), self.settled * S::splat(OF_KINK));
        let bow = S::mul_add(S::splat(3.0), self.bends, slope) * swing[0];
        let off = S::mul_add(S::splat(0.5) * self.bend, square, bow + slope * S::abs(at.line.moments[1]));
        let off = S::mul_add(self.kinks + self.settled, most * most * per_rise, off + slope * at.line.unknown[1]);
        let any = S::mul_add(self.bends * rise, S::splat(1.0 / 8.0), (slope + slope) * average);
        let moved = S::min((most + most + narrow) * per_rise, one);
        let of_field = S::min(curve + kinks + off, any) + self.steps * (S::splat(OF_STEP) + moved);
        let of_field = of_field * length;
        // Light from behind is dimmed: the density bends, although emission may not.
        let changed = length * slope * S::mul_add(S::splat(2.0), most, rise) + length * self.steps;
        let tau = kappa * length;
        let deepest = tau + changed;
        let of_depth = S::splat(OF_CURVE) * deepest * S::mul_add(deepest, deepest, S::splat(3.0) * changed);
        let of_moment = changed * S::mul_add(opacity * tau, S::splat(0.03), changed * S::splat(0.0075));
        let turned = S::mul_add(changed, S::splat(0.125), of_field);
        let of_turned = opacity * S::mul_add(turned, turned, of_field);
        let fourth = tau * tau * tau * tau;
        let of_fit = opacity * fourth * tau * S::splat(1e-5) + changed * fourth * S::splat(5e-5);
        let near = S::mul_add(of_field, one + opacity, of_depth + of_moment + of_turned + of_fit);
        // No density is further from any line whose moment is at most half of its sum.
        S::min(near, opacity * S::splat(1.5))
    }
}

/// Growth per value over the piece of a place.
#[inline(always)]
fn per_value<S: Simd, L: PieceLookup>(table: &L, column: Column, place: Place<S>) -> S::F {
    table.column::<S>(column, 0, place.piece)
}

/// Sum over the pieces before a place, plus that in its own piece, which grows by `slope` per value.
#[inline(always)]
fn sum_up_to<S: Simd, L: PieceLookup>(table: &L, column: Column, slope: S::F, place: Place<S>) -> S::F {
    S::mul_add(place.y, slope, table.column::<S>(column, 0, place.piece))
}
