//! The transfer function along a line of values: how it is uneven there, what of that is computed, and bounds of the rest.
//!
//! docs/bounds.md, sections 2 and 3, has the proofs.

use supervol_scene::transfer_function::pieces::{CHANNELS, Column, Limits};

use super::chord::Line;
use super::lookup::{Channels, PieceLookup, Place};
use super::simd::{Simd, for_three};
use crate::engines::rules::{
    LEAST_TILT, MOMENT_OF_KINK, OF_ANY_BENDS, OF_BENDS, OF_CURVE, OF_CURVES, OF_KINK, OF_STEP, OF_UNSETTLED_KINK,
    OPAQUE_TILT, ORDER_OF_DEPTH, ORDER_OF_TILT, SERIES_UP_TO, SHORT_BESIDE_NOISE, TILT_LIMIT,
};

/// Positions of a line in a table: all of it that is kept from one stage to the next.
#[derive(Clone, Copy)]
pub struct Located<S: Simd> {
    /// Positions of its ends.
    ends: [Place<S>; 2],
    /// Bounds of the field.
    range: [Place<S>; 2],
    /// Whether in any lane that counts the range reaches over a knot.
    pub(super) has_knots: bool,
}

impl<S: Simd> Located<S> {
    /// Positions that were not looked up.
    #[inline(always)]
    pub fn nothing() -> Self {
        let place = Place { piece: S::splat_int(0), y: S::splat(0.0) };
        Self { ends: [place; 2], range: [place; 2], has_knots: false }
    }
}

/// Looks up the positions of a line. Only the lanes in `counts` count.
#[inline(always)]
pub fn locate<S: Simd, L: PieceLookup>(table: &L, line: &Line<S>, counts: S::M) -> Located<S> {
    let ([a, b], [low, high]) = (line.ends, line.range);
    let first = table.piece_of::<S>(low);
    // Behind the last row of a table comes the first again: then, too, there are knots.
    let next = table.column::<S>(Column::Knot, 0, first + S::splat_int(1));
    let has_knots = S::bits(S::le(next, high) & counts) != 0;
    if has_knots {
        let range = [table.place_in::<S>(first, low), table.place::<S>(high)];
        return Located { ends: [table.place::<S>(a), table.place::<S>(b)], range, has_knots };
    }
    // The line's ends lie in the range.
    let ends = [table.place_in::<S>(first, a), table.place_in::<S>(first, b)];
    Located { ends, range: [table.place_in::<S>(first, low), table.place_in::<S>(first, high)], has_knots }
}

/// A line and its positions.
pub struct LineInTable<S: Simd> {
    pub(super) line: Line<S>,
    pub(super) ends: [Place<S>; 2],
    /// Distance between its ends after rounding, used for the antiderivatives.
    pub(super) width: S::F,
    /// The inverse of its size.
    pub(super) per_rise: S::F,
    pub(super) range: [Place<S>; 2],
    /// Lanes in which the field certainly rises or falls all the way, as its line does.
    pub(super) is_monotone: S::M,
    /// There, the inverse of its least slope.
    pub(super) per_slope: S::F,
}

impl<S: Simd> LineInTable<S> {
    /// The inverse of the line's rise.
    #[inline(always)]
    pub fn per_width(&self) -> S::F {
        S::select(S::lt(S::splat(0.0), self.width), self.per_rise, S::splat(0.0) - self.per_rise)
    }

    /// Bound on the mean of (u - 1/2) r.
    #[inline(always)]
    pub fn moment(&self) -> S::F {
        if self.line.is_span { self.line.swing[1] } else { S::abs(self.line.moments[1]) }
    }

    /// Bound on the effect of a kink, for a change of slope of 1, where the field is on its other side than the line. If the field is
    /// monotone, that is one triangle at most.
    #[inline(always)]
    pub fn beside(&self) -> S::F {
        let Line { most, average, .. } = self.line;
        S::select(self.is_monotone, S::min(S::splat(0.5) * most * (most * self.per_slope), average), average)
    }

    /// A line at the positions that were looked up for it.
    #[inline(always)]
    pub fn new(line: &Line<S>, &Located { ends, range, .. }: &Located<S>) -> Self {
        let (one, width) = (S::splat(1.0), line.ends[1] - line.ends[0]);
        let rise = S::abs(width);
        let least = S::splat(1e-30);
        let is_monotone = S::lt(line.turn, rise);
        let per_slope = one / S::max(rise - line.turn, least);
        Self { line: *line, ends, width, per_rise: one / S::max(rise, least), range, is_monotone, per_slope }
    }
}

/// Unevenness of emissions less their mean shares of the extinction, between the ends of a line: bound on the integral of
/// their distance from linear ones with the same moments. Order does not move an emission that is a share of the extinction.
#[inline(always)]
pub fn twist<S: Simd>(
    at: &LineInTable<S>,
    (a, b): (&Channels<S>, &Channels<S>),
    kinks: &Kinks<S>,
    (means, per_kappa): (&[S::F; CHANNELS], S::F),
) -> S::F {
    let colors = for_three!(c => S::min(means[c + 1] * per_kappa, S::splat(1.0)));
    let mut bends = [S::splat(0.0); CHANNELS];
    for c in 0..CHANNELS {
        bends[c] = a.third_bend[c] + b.third_bend[c];
    }
    let rise = S::abs(at.width);
    let of_curve = S::splat(3.0 * OF_CURVE) * finite::<S>(rise * rise) * less_share::<S>(&bends, &colors);
    if S::bits(S::lt(S::splat(0.0), kinks.settled)) == 0 {
        return of_curve;
    }
    let [first, last] = &kinks.slopes;
    let of_kinks = less_share::<S>(first, &colors) + less_share::<S>(last, &colors);
    S::mul_add(S::splat(OF_KINK) * rise, of_kinks, of_curve)
}

/// Greatest of the emissions less these shares of the extinction.
#[inline(always)]
fn less_share<S: Simd>([extinction, emission @ ..]: &[S::F; CHANNELS], colors: &[S::F; 3]) -> S::F {
    let left = for_three!(c => S::abs(emission[c] - colors[c] * *extinction));
    S::max(left[0], S::max(left[1], left[2]))
}

/// Kinks between the ends of a line whose effects are computed: the first and the last one. Kinks are the control points between them.
pub struct Kinks<S: Simd> {
    /// First moments of the channels about the middle, less those of lines with the same rise.
    pub moments: [S::F; CHANNELS],
    /// Changes of slope of these kinks, of both together and of every channel.
    settled: S::F,
    slopes: [[S::F; CHANNELS]; 2],
    /// Bound on what the means are still off by.
    error: S::F,
}

impl<S: Simd> Kinks<S> {
    /// None.
    #[inline(always)]
    pub fn none() -> Self {
        let zero = S::splat(0.0);
        Self { moments: [zero; CHANNELS], settled: zero, slopes: [[zero; CHANNELS]; 2], error: zero }
    }

    /// Rise of the line that has a channel's moment, where `rise` is that between its ends.
    #[inline(always)]
    pub fn rise<const KNOTS: bool>(&self, channel: usize, rise: S::F) -> S::F {
        if KNOTS { S::mul_add(S::splat(12.0), self.moments[channel], rise) } else { rise }
    }

    /// Finds them, and adds to the means what the field's distance from the line does at them.
    ///
    /// Let a slope change by Q at u = p, and let the field be monotone, with `|r'| <= turn < |b - a|`. This changes the mean of a
    /// channel by `-Q R(p)` on a rising line and `Q R(p)` on a falling one, with R the integral of r, and by
    /// `Q r(p)^2 / (2 |b - a|)`, up to the share `turn / (|b - a| - turn)` of the latter. It changes the first moment by
    /// `Q |b - a| p (1 - p) (1 - 2 p) / 12`.
    #[inline(always)]
    pub fn inside<L: PieceLookup>(table: &L, at: &LineInTable<S>, means: &mut [S::F; CHANNELS]) -> Self {
        let (zero, one, half) = (S::splat(0.0), S::splat(1.0), S::splat(0.5));
        let mut found = Self::none();
        let [a, b] = [at.ends[0].piece, at.ends[1].piece];
        let ascends = S::lt(zero, at.width);
        let (lower, upper) = (S::select_int(ascends, a, b), S::select_int(ascends, b, a));
        let first = table.column::<S>(Column::KinkAbove, 0, lower);
        let last = table.column::<S>(Column::KinkBelow, 0, upper);
        let has_first = S::le(first, last) & at.is_monotone;
        if S::bits(has_first) == 0 {
            return found;
        }
        let has_last = S::lt(first, last) & at.is_monotone;
        let [bump, cubic] = at.line.bow;
        let Line { turn, average, .. } = at.line;
        let size = S::abs(at.width);
        let per_width = at.per_width();
        let kinks = [
            (first, lower, Column::ChangesAbove, Column::ChangeAbove, has_first),
            (last, upper, Column::ChangesBelow, Column::ChangeBelow, has_last),
        ];
        for (i, (kink, piece, changes, greatest, is_there)) in kinks.into_iter().enumerate() {
            let p = S::min(S::max((kink - at.line.ends[0]) * per_width, zero), one);
            let (both, aside) = (p * (one - p), S::mul_add(S::splat(-2.0), p, one));
            let swing = both * S::mul_add(S::splat(0.25) * cubic, both, S::splat(-2.0 / 3.0) * bump * aside);
            let r = S::mul_add(half * cubic * both, aside, S::splat(4.0) * bump * (both - S::splat(1.0 / 6.0)));
            // In other lanes these may be beyond any number.
            let second = half * r * (r * at.per_rise);
            let to_mean = S::select(is_there, second + S::select(ascends, zero - swing, swing), zero);
            let to_moment = S::select(is_there, size * both * aside * S::splat(1.0 / 12.0), zero);
            for c in 0..CHANNELS {
                let slope = S::select(is_there, table.column::<S>(changes, c, piece), zero);
                means[c] = S::max(S::mul_add(slope, to_mean, means[c]), zero);
                found.moments[c] = S::mul_add(slope, to_moment, found.moments[c]);
                found.slopes[i][c] = slope;
            }
            let change = S::select(is_there, table.column::<S>(greatest, 0, piece), zero);
            found.settled = found.settled + change;
            // The second term is smaller, or missing, if the field crosses the kink beyond the part's ends.
            let is_inside = S::le(S::abs(r), (size - turn) * both);
            let share = S::select(is_inside, turn * at.per_rise, one);
            let most = S::min(half * r * (r * at.per_slope), average);
            let of_rounding = S::abs(to_mean) * S::splat(4.0 * f32::EPSILON);
            found.error = S::mul_add(change, S::mul_add(most, share, of_rounding), found.error);
        }
        found
    }
}

/// Curvature of the transfer function over the range of a part.
pub struct Stretch<S: Simd> {
    /// Lanes in which the range lies between two control points.
    pub is_one: S::M,
    /// Greatest curvature, and its greatest distance from the mean of those at the line's ends; from 0 if the range is no one stretch.
    bend: S::F,
    curvature: S::F,
}

impl<S: Simd> Stretch<S> {
    /// The stretch of a range; `KNOTS`: see [`Around`].
    #[inline(always)]
    pub fn of<L: PieceLookup, const KNOTS: bool>(table: &L, limits: Limits, at: &LineInTable<S>) -> Self {
        let ([low, high], [a, b]) = (at.range, at.ends);
        if !KNOTS {
            let zero = S::splat(0.0);
            let bend = per_value(table, Column::BendOfStretch, low);
            return Self { is_one: S::le(zero, zero), bend, curvature: zero };
        }
        let between = |column| table.column::<S>(column, 0, high.piece) - table.column::<S>(column, 0, low.piece);
        let numbers = between(Column::Stretch);
        let of_stretch = Column::BendOfStretch;
        let bend = S::max(per_value(table, of_stretch, low), per_value(table, of_stretch, high));
        let bend = S::select(S::lt(numbers, S::splat(1.5)), bend, S::splat(limits.bend));
        let is_one = S::lt(numbers, S::splat(0.5));
        // On the way from one to the other each is passed by what changes in all.
        let between_ends = S::abs(per_value(table, Column::Curvatures, b) - per_value(table, Column::Curvatures, a));
        let away = S::mul_add(between_ends, S::splat(-0.5), between(Column::Curvatures));
        Self { is_one, bend, curvature: S::select(is_one, S::min(away, bend + bend), bend) }
    }
}

/// The transfer function over the range of a part: sums of what is uneven in it.
///
/// `KNOTS`: false if no range reaches over a knot, so that each lies in one piece. Bounds of such a part have the same bits either way,
/// for which other parts are integrated with it depends on the packing of lanes.
pub struct Around<S: Simd, const KNOTS: bool> {
    /// Heights of steps.
    steps: S::F,
    /// Changes of slope in all, those at knots whose effect is not computed, and those whose effect is.
    bends: S::F,
    kinks: S::F,
    settled: S::F,
    /// Changes of slope at those knots of the former that the line does not reach.
    beyond: S::F,
    /// Bound on what the means are off by at the latter.
    left: S::F,
    /// See [`Stretch`].
    bend: S::F,
    curvature: S::F,
    /// Variation of colour, and of that what is even.
    pub colors: S::F,
}

impl<S: Simd, const KNOTS: bool> Around<S, KNOTS> {
    #[inline(always)]
    pub fn of<L: PieceLookup>(
        table: &L,
        limits: Limits,
        at: &LineInTable<S>,
        (settled, stretch): (&Kinks<S>, &Stretch<S>),
    ) -> Self {
        let zero = S::splat(0.0);
        let ([low, high], [a, b]) = (at.range, at.ends);
        let wide = high.y - low.y;
        let (bend, slope) =
            (per_value(table, Column::BendsPerValue, low), per_value(table, Column::ColorVariationPerValue, low));
        let mut around = Self {
            steps: zero,
            bends: wide * bend,
            kinks: zero,
            settled: zero,
            beyond: zero,
            left: zero,
            bend: stretch.bend,
            curvature: stretch.curvature,
            colors: wide * slope,
        };
        if !KNOTS {
            return around;
        }
        let is_one_piece = S::eq_int(low.piece, high.piece);
        let rounded = limits.rounded.map(|rounded| S::select(is_one_piece, zero, S::splat(rounded)));
        let between = |column| table.column::<S>(column, 0, high.piece) - table.column::<S>(column, 0, low.piece);
        let between_ends = |column| S::abs(per_value(table, column, b) - per_value(table, column, a));
        let bend_high = per_value(table, Column::BendsPerValue, high);
        let bends = sum_up_to(table, Column::Bends, bend_high, high) - sum_up_to(table, Column::Bends, bend, low);
        let slope_high = per_value(table, Column::ColorVariationPerValue, high);
        let color = Column::ColorVariation;
        let colors = sum_up_to(table, color, slope_high, high) - sum_up_to(table, color, slope, low);
        let (kinks, inside) = (between(Column::Kinks), between_ends(Column::Kinks));
        around.steps = between(Column::Steps);
        around.bends = S::select(is_one_piece, around.bends, bends + rounded[0]);
        around.colors = S::select(is_one_piece, around.colors, colors);
        around.kinks = S::max(inside - settled.settled, zero) + rounded[1];
        around.beyond = kinks - inside;
        (around.settled, around.left) = (settled.settled, settled.error);
        around
    }

    /// Bound on what the mean of a channel is off by.
    #[inline(always)]
    pub fn error_of_mean(&self, at: &LineInTable<S>, limits: Limits, by_ends: S::M) -> S::F {
        let narrow = S::splat(limits.narrow);
        let (zero, one, half) = (S::splat(0.0), S::splat(1.0), S::splat(0.5));
        let Line { most, average, square, swing, .. } = at.line;
        let rise = S::abs(at.width);
        if !KNOTS && !at.line.is_span {
            return zero;
        }
        // A narrow interval has the mean of its ends, wherever a step or a kink lies in between.
        let of_steps = self.steps * S::min((most + most + narrow) * at.per_rise, one);
        let curvature = if at.line.is_span { self.bend } else { self.curvature };
        let smooth = curvature * finite::<S>(S::mul_add(half, square, rise * swing[1]));
        if !KNOTS {
            return smooth;
        }
        // A kink that a monotone field crosses: what r does to first order, and where the field is on its other side than the line.
        // Any other moves it by at most half of the mean distance: as often the field is above its line as it is below.
        let (beside, any) = (at.beside(), half * average);
        let of_kinks = S::mul_add(self.kinks, S::select(at.is_monotone, beside + swing[0], any), self.left);
        let of_kinks = S::mul_add(self.beyond, S::select(at.is_monotone, beside, any), of_kinks);
        let of_ends = (self.kinks + self.settled) * (narrow * S::splat(0.125));
        let rounded = S::select(by_ends, zero, S::splat(limits.difference) * at.per_rise);
        of_steps + smooth + of_kinks + of_ends + rounded
    }

    /// Bound on what the mean of a channel changes by if the field is off by its rounding. It moves by at most the slope times that; and,
    /// for a field from end to end, the integral over values changes at its ends, and the way per value.
    #[inline(always)]
    pub fn error_of_noise(&self, at: &LineInTable<S>, a: &Channels<S>, of_ends: S::F) -> S::F {
        let (one, noise) = (S::splat(1.0), at.line.noise);
        let slope = a.slope + self.bends;
        let share = noise * at.per_rise;
        // Beyond its ends the function may grow.
        let of_ends = S::mul_add(noise + noise, slope, of_ends);
        let by_ends = of_ends * at.per_rise * S::mul_add(S::splat(4.0), share, one);
        noise * S::select(S::le(share, S::splat(SHORT_BESIDE_NOISE)), S::min(slope, by_ends), slope)
    }

    /// Bound on the error of a mean by steps that rounding misplaces.
    #[inline(always)]
    pub fn error_of_rounded_steps(&self, at: &LineInTable<S>, limits: Limits) -> S::F {
        if !KNOTS {
            return S::splat(0.0);
        }
        let noise = at.line.noise + at.line.noise + S::splat(limits.narrow);
        let is_long = S::le(at.line.noise * at.per_rise, S::splat(SHORT_BESIDE_NOISE));
        self.steps * S::select(is_long, S::min(noise * at.per_rise, S::splat(1.0)), S::splat(1.0))
    }

    /// Bound on what is missed of the effect of order.
    #[inline(always)]
    pub fn error_of_order(
        &self,
        at: &LineInTable<S>,
        a: &Channels<S>,
        [tau, per_kappa, opacity, kappa_rise, turn, twist]: [S::F; 6],
    ) -> S::F {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let Line { most, average, square, swing, length, .. } = at.line;
        let rise = S::abs(at.width);
        let (slope, curve) = (a.slope + self.bends, self.bend * finite::<S>(rise * rise));
        let kink = self.kinks * rise;
        let tilt = S::abs(kappa_rise) * per_kappa;
        // How far extinction, relative to its mean, is from a line; and how far light comes from elsewhere than evenly.
        let of_kinks = if KNOTS { S::mul_add(self.settled, rise, kink) * S::splat(1.0 / 16.0) } else { zero };
        let shape = S::mul_add(curve, S::splat(0.0322), of_kinks);
        let shape = S::min(shape, self.bends * rise * S::splat(1.0 / 16.0));
        let of_line = shape + slope * average;
        let rest = S::min(if KNOTS { of_line + self.steps } else { of_line } * per_kappa, S::splat(2.0));
        let from = S::mul_add(tilt, S::splat(0.25), rest) * S::mul_add(tau, S::splat(0.6), one);
        // Nowhere more light comes from than there is.
        let from = S::min(S::mul_add(tau, S::splat(0.6), from), one);
        let from = S::select(S::le(tau, one), from, one);
        // The integral of what emission and extinction, each, are from lines: where the field is one, and where it is not.
        let bow = S::mul_add(slope, from, self.bends) * swing[0];
        let mut near = S::mul_add(S::splat(0.5) * self.bend, square, bow + slope * at.moment());
        if KNOTS {
            let of_kinks =
                kink * S::min(S::mul_add(from, S::splat(OF_BENDS), S::splat(MOMENT_OF_KINK)), S::splat(OF_BENDS));
            let on = S::mul_add(self.curvature * finite::<S>(rise * rise), S::splat(OF_CURVE), of_kinks);
            near = S::mul_add(self.kinks + self.beyond + self.settled, at.beside(), on + near);
        }
        let any = S::mul_add(self.bends * rise, S::splat(OF_ANY_BENDS), slope * average);
        let mut uneven = S::min(S::mul_add(twist, from, near), any);
        if KNOTS {
            let misplaced = S::min((most + most) * at.per_rise, one);
            uneven = S::mul_add(self.steps, S::mul_add(S::splat(0.25), one, misplaced), uneven);
        }
        let shape = opacity * length * uneven;
        // Error of what the line counts of order.
        let is_deep = S::lt(S::splat(SERIES_UP_TO), tau);
        let of_depth = S::select(is_deep, zero, tau * tau * tau * S::splat(ORDER_OF_DEPTH));
        let is_opaque = S::lt(S::splat(OPAQUE_TILT), tau);
        let of_tilt = tilt * S::max(tilt, S::splat(LEAST_TILT)) * S::splat(ORDER_OF_TILT);
        let of_line = S::mul_add(S::min(tau, S::splat(OPAQUE_TILT)), of_tilt, of_depth) * (opacity * tau);
        let of_rest = S::splat(0.125) * tau * rest * S::mul_add(tau, S::splat(0.25), one);
        let limit = S::select(is_opaque, S::splat(2.0), S::splat(TILT_LIMIT));
        let most = S::select(S::lt(tilt, limit), zero, S::splat(f32::INFINITY));
        S::mul_add(turn * per_kappa * length, of_line + of_rest, shape) + most
    }

    /// See [`Part::misplaced`].
    ///
    /// A density that is not linear has curvature, changes of slope and steps. Each adds its own bound, such as [`OF_CURVE`] times the
    /// curvature, and the error of the moment, for the line has the stated one.
    #[inline(always)]
    pub fn misplaced(&self, at: &LineInTable<S>, a: &Channels<S>, [kappa, opacity, narrow]: [S::F; 3]) -> S::F {
        let one = S::splat(1.0);
        let Line { most, average, square, swing, length, .. } = at.line;
        let rise = S::abs(at.width);
        let slope = a.slope + self.bends;
        // The transfer function along the line, and what the field's distance from it does.
        let square_of_rise = finite::<S>(rise * rise);
        let mut curve = self.bend * S::splat(OF_CURVE) * square_of_rise;
        let bow = S::mul_add(S::splat(3.0), self.bends, slope) * swing[0];
        let mut off = S::mul_add(S::splat(0.5) * self.bend, square, bow + slope * at.moment());
        if KNOTS {
            let kinks = rise * S::mul_add(self.kinks, S::splat(OF_UNSETTLED_KINK), self.settled * S::splat(OF_KINK));
            curve = S::mul_add(self.curvature * square_of_rise, S::splat(OF_CURVES - OF_CURVE), curve) + kinks;
            off = S::mul_add(self.kinks + self.beyond + self.settled, at.beside(), off);
        }
        let any = S::mul_add(self.bends * rise, S::splat(1.0 / 8.0), (slope + slope) * average);
        let mut of_field = S::min(curve + off, any);
        if KNOTS {
            let moved = S::min((most + most + narrow) * at.per_rise, one);
            of_field = of_field + self.steps * (S::splat(OF_STEP) + moved);
        }
        let of_field = of_field * length;
        // Light from behind is dimmed: the density bends, although emission may not.
        let of_slope = length * slope * S::mul_add(S::splat(2.0), most, rise);
        let changed = if KNOTS { of_slope + length * self.steps } else { of_slope };
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

/// A product of distances of values. Beside values of 1e20 it overflows, although curvature is 0 there.
#[inline(always)]
pub fn finite<S: Simd>(product: S::F) -> S::F {
    S::min(S::max(product, S::splat(f32::MIN)), S::splat(f32::MAX))
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
