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

use supervol_scene::transfer_function::pieces::{CHANNELS, Column};

use super::lookup::{Channels, PieceLookup, Place, channels};
use super::simd::{Simd, exp_minus};
use crate::engines::rules::{
    AVERAGE_OF_BUMP, AVERAGE_OF_CUBIC, FALL_END, FALL_MISPLACED, GREATEST_OF_CUBIC, ORDER_REST, ORDER_SQUARE,
    OUT_OF_ORDER, UNEVEN_MISPLACED,
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
    /// Rounding error of the values.
    pub noise: S::F,
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
    /// Light from the front end, as a share of that from both ends, if it varies evenly in between.
    pub front_share: S::F,
    /// Share of the part by which evenly varying light may be misplaced.
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
            front_share: zero,
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
    /// No cell.
    #[inline(always)]
    pub fn nothing() -> Self {
        let zero = S::splat(0.0);
        Self { values: [zero; 3], cubic: zero, length: zero, noise: zero }
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
        [S::min(S::min(first, last), middle) - margin, S::max(S::max(first, last), middle) + margin]
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
        Line { ends, range: self.range(), most, average, length: self.length, disorder: S::splat(0.0) }
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
    /// World length.
    length: S::F,
    /// Share of the light whose order may differ from that along the line.
    disorder: S::F,
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
        let disorder = S::min((most + most) / S::max(S::abs(rise), S::splat(f32::MIN_POSITIVE)), one);
        // Beside a hole nothing is known, and minimum and maximum ignore NaN.
        let (has_hole, unknown) = (S::is_nan(sum), S::splat(f32::NAN));
        let range = [S::select(has_hole, unknown, low - inside), S::select(has_hole, unknown, high + inside)];
        Self { ends, range, most, average: area * per_length, length, disorder }
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

/// Position of a line in a table.
#[derive(Clone, Copy)]
pub struct Located<S: Simd> {
    line: Line<S>,
    /// Positions of its ends.
    ends: [Place<S>; 2],
    /// Distance between its ends after rounding, used for the antiderivatives.
    width: S::F,
    /// Bounds of the field.
    range: [Place<S>; 2],
}

impl<S: Simd> Located<S> {
    /// A position that was not looked up.
    #[inline(always)]
    pub fn nothing() -> Self {
        let place = Place { piece: S::splat_int(0), y: S::splat(0.0) };
        Self { line: Chord::nothing().line(), ends: [place; 2], width: S::splat(0.0), range: [place; 2] }
    }

    /// Lanes that have anything to integrate.
    #[inline(always)]
    pub fn crosses(&self) -> S::M {
        self.line.crosses()
    }
}

/// Looks up the position of a line.
#[inline(always)]
pub fn locate<S: Simd, L: PieceLookup>(table: &L, line: &Line<S>) -> Located<S> {
    let [a, b] = line.ends;
    let [low, high] = line.range;
    let ends = [table.place::<S>(a), table.place::<S>(b)];
    Located { line: *line, ends, width: b - a, range: [table.place::<S>(low), table.place::<S>(high)] }
}

/// Integrates a chord. `narrow` is the table's.
#[inline(always)]
pub fn integrate<S: Simd, L: PieceLookup>(table: &L, narrow: S::F, chord: &Chord<S>) -> Part<S> {
    integrate_at(table, narrow, &locate(table, &chord.line()))
}

/// Integrates along a line whose position in the table is known.
#[inline(always)]
pub fn integrate_at<S: Simd, L: PieceLookup>(table: &L, narrow: S::F, at: &Located<S>) -> Part<S> {
    let (zero, one) = (S::splat(0.0), S::splat(1.0));
    let (at_a, at_b) = (channels(table, at.ends[0]), channels(table, at.ends[1]));
    let by_ends = S::eq_int(at.ends[0].piece, at.ends[1].piece) | S::le(S::abs(at.width), narrow);
    let means = means(&at_a, &at_b, at.width, by_ends);
    let h = at.line.length;
    let kappa = means[0];
    let tau = kappa * h;
    let transmittance = exp_minus::<S>(tau);
    let opacity = one - transmittance;
    let is_clear = S::lt(tau, S::splat(1e-6));
    let emitting = S::select(is_clear, h, opacity / S::select(is_clear, one, kappa));
    let order = h * h / S::mul_add(tau, S::mul_add(tau, S::splat(ORDER_SQUARE), S::splat(6.0)), S::splat(12.0));
    let kappa_rise = at_b.value[0] - at_a.value[0];
    let [error, misplaced, colors] = error(table, narrow, at, [kappa, opacity]);
    let reach = opacity * S::mul_add(S::splat(-0.5), transmittance, one);
    let most = S::splat(0.5) * colors * reach * reach;
    let mut color = [zero; 3];
    for c in 0..3 {
        let emission = means[c + 1];
        let emission_rise = at_b.value[c + 1] - at_a.value[c + 1];
        let ordered = order * (emission_rise * kappa - emission * kappa_rise);
        let ordered = S::min(S::max(ordered, zero - most), most);
        color[c] = S::min(S::max(emission * emitting - ordered, zero), opacity);
    }
    // If both ends are dark, the light in between may come from anywhere.
    let dim = S::mul_add(kappa, S::splat(1e-3), S::splat(f32::MIN_POSITIVE));
    let at_front = S::max(at_a.value[0], zero) + dim;
    let at_back = S::mul_add(S::max(at_b.value[0], zero), transmittance, dim);
    let front_share = at_front / (at_front + at_back);
    Part { color, tau, transmittance, error, front_share, misplaced, colors }
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

/// Error of [`integrate`] (see the module), [`Part::misplaced`] and [`Part::colors`].
#[inline(always)]
fn error<S: Simd, L: PieceLookup>(table: &L, narrow: S::F, at: &Located<S>, [kappa, opacity]: [S::F; 2]) -> [S::F; 3] {
    let (zero, one, half) = (S::splat(0.0), S::splat(1.0), S::splat(0.5));
    let Line { most, average, length, disorder, .. } = at.line;
    let [low, high] = at.range;
    let steps = table.column::<S>(Column::Steps, 0, high.piece) - table.column::<S>(Column::Steps, 0, low.piece);
    let [bend_low, bend_high] =
        [per_value(table, Column::BendsPerValue, low), per_value(table, Column::BendsPerValue, high)];
    let bends = sum_up_to(table, Column::Bends, bend_high, high) - sum_up_to(table, Column::Bends, bend_low, low);
    let per_color = Column::ColorVariationPerValue;
    let [slope_low, slope_high] = [per_value(table, per_color, low), per_value(table, per_color, high)];
    let color = Column::ColorVariation;
    let colors = sum_up_to(table, color, slope_high, high) - sum_up_to(table, color, slope_low, low);
    let even_colors = S::min(slope_low, slope_high) * (at.line.range[1] - at.line.range[0]);
    let rise = S::abs(at.width);
    // A narrow interval has the mean of its ends, wherever a step lies in between.
    let misplaced = S::min((most + most + narrow) / S::max(rise, S::splat(1e-30)), one);
    let of_mean = S::mul_add(steps, misplaced, half * bends * average) * length;
    // If extinction is even, evenly changing colour is in the order that the second term of the colour assumes. If
    // extinction is concentrated, all of the colour may be in the wrong order.
    let uneven = S::mul_add(bends * rise, S::splat(0.25), steps);
    let uneven = S::min(uneven / S::max(kappa, S::splat(1e-12)), one);
    // Colour may also be the uneven part: even at first, and then not, behind a control point.
    let out_of_order = S::max(colors * S::max(uneven, disorder), colors - even_colors);
    let out_of_order = S::mul_add(S::splat(OUT_OF_ORDER), out_of_order, S::splat(ORDER_REST) * colors);
    let tau = kappa * length;
    let of_order = opacity * out_of_order * tau / (S::splat(4.0) + tau);
    // Evenly from end to end is not how light falls off in a part that is nearly opaque.
    let fall = S::splat(FALL_MISPLACED) * tau * tau / S::mul_add(tau * tau, S::splat(FALL_END), one);
    let misplaced = S::mul_add(uneven, S::splat(UNEVEN_MISPLACED), fall);
    [S::min(S::max(of_mean, zero), one) + of_order, misplaced, S::min(colors, one)]
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

#[cfg(test)]
mod tests {
    use supervol_format::random::Random;
    use supervol_scene::transfer_function::pieces::TransferPieces;
    use supervol_scene::transfer_function::{ControlPoint, TransferFunction};

    use super::super::lookup::ManyPieces;
    use super::super::simd::{LANES_LIMIT, Portable, Task};
    use super::*;
    use crate::engines::cubics::{Cubic, cubic, exact};

    /// Colour, transmittance and error of consecutive chords, by one line.
    struct Integrate<'a> {
        pieces: &'a TransferPieces,
        cubics: &'a [Cubic],
    }

    impl Task for Integrate<'_> {
        type Output = [f32; 5];

        #[inline(always)]
        fn run<S: Simd>(self) -> [f32; 5] {
            let chord = |&(k, length): &Cubic| Chord::<S> {
                values: [0.0, 0.5, 1.0].map(|u| S::splat(cubic(k, u) as f32)),
                cubic: S::splat(k[3] as f32),
                length: S::splat(length as f32),
                noise: S::splat(0.0),
            };
            let chords: Vec<_> = self.cubics.iter().map(chord).collect();
            let line = if chords.len() == 1 { chords[0].line() } else { Line::over(&chords) };
            let table = ManyPieces::new(self.pieces);
            let part = integrate_at::<S, _>(&table, S::splat(self.pieces.narrow), &locate(&table, &line));
            let [r, g, b] = part.color;
            [r, g, b, part.transmittance, part.error].map(|v| {
                let mut lanes = [0.0; LANES_LIMIT];
                S::store(v, &mut lanes);
                lanes[0]
            })
        }
    }

    /// The stated error of a part is never far below its true error: for one cell, and for spans of several, along
    /// which the field bends and whose lengths differ.
    #[test]
    fn stated_errors_are_errors() {
        let mut numbers = Random::new(11);
        let mut random = || numbers.unit();
        let (mut worst, mut looked_at) = (0.0f64, 0);
        for _ in 0..6000 {
            let mut values: Vec<f64> = (0..2 + (random() * 4.0) as usize).map(|_| 100.0 + 20.0 * random()).collect();
            values.sort_by(f64::total_cmp);
            if random() < 0.3 {
                values[1] = values[0];
            }
            let steep = if random() < 0.5 { 0.05 } else { 0.9 };
            let points = values.into_iter().map(|value| ControlPoint {
                value: f64::from(value as f32),
                color: [0; 3].map(|_| random()),
                alpha: if random() < 0.3 { 0.0 } else { steep * random() },
            });
            let tf = TransferFunction::new(points.collect(), 1.0).unwrap();
            let pieces = TransferPieces::new(&tf, 0.0, 1e-3);
            let wide = if random() < 0.5 { 1.0 } else { 0.1 };
            let middle = 100.0 + 20.0 * random();
            let cells = [1, 3, 6][(random() * 3.0) as usize];
            // The slope shared by the cells of a span, and each cell's own share.
            let (slope, own) = (10.0 * (random() - 0.5), if cells == 1 { 0.0 } else { random() });
            let mut cubics: Vec<Cubic> = Vec::new();
            for _ in 0..cells {
                let begin = cubics.last().map_or(middle, |&(k, _)| cubic(k, 1.0));
                let slope = wide * (slope + own * 10.0 * (random() - 0.5));
                let k = [begin, slope, wide * 6.0 * (random() - 0.5), wide * (random() - 0.5)];
                // A cell in which a ray waits has no length, and one value.
                let is_waited_in = cells > 1 && random() < 0.1;
                cubics.push(if is_waited_in { ([begin, 0.0, 0.0, 0.0], 0.0) } else { (k, 1.5 * random()) });
            }
            let found = Integrate { pieces: &pieces, cubics: &cubics }.run::<Portable>();
            let expected = exact(&tf, &cubics);
            let error = (0..4).map(|c| (f64::from(found[c]) - expected[c]).abs()).fold(0.0, f64::max);
            // Error of the fit of the pieces, and the step size of the exact sum.
            let allowed = 1.2e-3 + 1.5 * f64::from(found[4]);
            worst = worst.max(error / allowed);
            looked_at += usize::from(error > 1.5e-3);
            assert!(
                error <= allowed,
                "{found:?} for {expected:?}: error {error}, stated {}; {cubics:?}, {:?}",
                found[4],
                tf.points()
            );
        }
        assert!(looked_at > 100 && worst > 0.3, "{looked_at} chords with an error; at worst {worst} of what is stated");
    }

    /// In a shell that is thin against its chord hardly anything is in front of anything else: changing colour there
    /// becomes the mean colour.
    #[test]
    fn order_does_no_more_than_it_can() {
        let point = |value, color, alpha| ControlPoint { value, color, alpha };
        let (before, behind) = ([0.08, 0.77, 0.98], [0.97, 0.78, 0.38]);
        let points = vec![point(0.842, [0.1; 3], 0.0), point(0.842, before, 0.61), point(0.846, behind, 0.82)];
        let tf = TransferFunction::new(points, 0.4).unwrap();
        let pieces = TransferPieces::new(&tf, 0.0, 1e-4);
        for length in [0.3, 1.0, 3.0] {
            // The chord ends in the shell, which the exact sum treats separately.
            let line = |[from, to]: [f64; 2]| ([from, to - from, 0.0, 0.0], length * (to - from) / 0.646);
            let found = Integrate { pieces: &pieces, cubics: &[line([0.2, 0.846])] }.run::<Portable>();
            let expected = exact(&tf, &[line([0.2, 0.842]), line([0.842, 0.846])]);
            let opacity = 1.0 - expected[3];
            assert!(opacity > 0.001, "nothing is seen");
            let error = (0..3).map(|c| (f64::from(found[c]) - expected[c]).abs()).fold(0.0, f64::max);
            // The effect of order in both directions, and the fit.
            let allowed = opacity * (0.25 * opacity + 1e-3);
            assert!(error < allowed, "{length}: {error} of {opacity}, {found:?} for {expected:?}");
        }
    }
}
