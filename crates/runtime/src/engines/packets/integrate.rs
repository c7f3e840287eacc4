//! Emission and absorption on a chord by antiderivatives of the transfer function, with the error of the rule.
//!
//! Along a chord of length h, u from 0 to 1, the field is a cubic s(u). It is replaced by the line with the same
//! difference d between its ends and the same mean m, from a = m - d/2 to b = m + d/2. Channels f (extinction,
//! emission) then have the exact mean `(F(b) - F(a)) / (b - a)`, with F their antiderivative, for any steps in between.
//! With `tau = h mean(kappa)` the opacity is `1 - exp(-tau)`, and the colour
//!
//! ```text
//! C = mean(e) h (1 - exp(-tau)) / tau  -  h^2 (de mean(kappa) - mean(e) dkappa) R
//! R = (1 + t tau / 20) (tau - 2 + (tau + 2) exp(-tau)) / (2 tau^3),    t = dkappa / mean(kappa)
//! ```
//!
//! where de and dkappa are the differences between the ends. The second term is the effect of the order of emission and
//! absorption. It is exact for even extinction, and to first order in its tilt t for small tau. It assumes linear extinction
//! and emission. Elsewhere it is limited to the largest effect of order on two colours that
//! differ by D: with m = (1 - exp(-tau)) / tau that is `D (1 - m + m ln m)`, below `D tau^2 / (8 + 3.7 tau + tau^2)`.
//!
//! Error of the line ([`Part::error`], opacity or colour as a share of the light in front), with r = s - line; proofs are in
//! docs/bounds.md, section 2:
//! - a step of height J inside is misplaced by at most the share of the chord on which |line - step| <= |r|;
//! - a kink (change of slope Q) adds at most Q mean|r| / 2, because the mean of r is zero. Where the field is monotone, what r
//!   does at the first and the last kink is computed to second order;
//! - curvature is computed as far as it is even;
//! - varying colour may be in the wrong order.

use supervol_scene::transfer_function::pieces::{CHANNELS, Limits};

use super::chord::{Chord, Line};
use super::lookup::{Channels, PieceLookup, quadratics};
use super::simd::{Simd, exp_minus};
use super::uneven::{Around, Kinks, LineInTable, Located, Stretch, finite, locate, twist};
use crate::engines::rules::{LEAN_SQUARE, MOST_OF_ORDER, ORDER_CUBE, ORDER_SQUARE, SERIES_UP_TO, SPREAD_SQUARE};

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

/// Share of light that passes a part, and bound on what it is off by.
#[derive(Clone, Copy)]
pub struct Passed<S: Simd> {
    pub transmittance: S::F,
    pub error: S::F,
}

impl<S: Simd> Part<S> {
    /// The part as a budget counts it.
    #[inline(always)]
    pub fn passed(&self) -> Passed<S> {
        Passed { transmittance: self.transmittance, error: self.error }
    }

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

/// Extinction below which colours are not known.
const LEAST_KAPPA: f32 = 1e-20;

/// Lanes of a packet, and how exactly their parts are wanted.
#[derive(Clone, Copy)]
pub struct Wanted<S: Simd> {
    /// Lanes that count: the parts of others have no meaning.
    pub lanes: S::M,
    /// Error of order up to which a bound that costs little will do, though another may be smaller.
    pub order: S::F,
    /// Whether the parts will be lit: else their moments, and how they are misplaced, have no meaning.
    pub lit: bool,
}

/// Integrates a chord. `limits` is the table's.
#[inline(always)]
pub fn integrate<S: Simd, L: PieceLookup>(table: &L, limits: Limits, chord: &Chord<S>, wanted: &Wanted<S>) -> Part<S> {
    let line = chord.line();
    integrate_at(table, limits, (&line, &locate(table, &line, wanted.lanes)), wanted)
}

/// Integrates along a line whose position in the table is known.
#[inline(always)]
pub fn integrate_at<S: Simd, L: PieceLookup>(
    table: &L,
    limits: Limits,
    (line, located): (&Line<S>, &Located<S>),
    wanted: &Wanted<S>,
) -> Part<S> {
    let at = &LineInTable::new(line, located);
    match located.has_knots {
        true => integrate_over::<S, L, true>(table, limits, at, wanted),
        false => integrate_over::<S, L, false>(table, limits, at, wanted),
    }
}

/// See [`integrate_at`]; `KNOTS`: see [`Around`].
#[inline(always)]
fn integrate_over<S: Simd, L: PieceLookup, const KNOTS: bool>(
    table: &L,
    limits: Limits,
    at: &LineInTable<S>,
    wanted: &Wanted<S>,
) -> Part<S> {
    let (zero, one) = (S::splat(0.0), S::splat(1.0));
    let [a, b] = at.ends;
    let of_a = quadratics(table, a.piece);
    let of_b = if KNOTS { quadratics(table, b.piece) } else { of_a };
    let (at_a, at_b) = (of_a.at(a.y), of_b.at(b.y));
    let by_ends = S::eq_int(a.piece, b.piece) | S::le(S::abs(at.width), S::splat(limits.narrow));
    let mut means = if KNOTS { means(&at_a, &at_b, at, by_ends) } else { means_by_ends(&at_a, &at_b, at) };
    let stretch = Stretch::of::<L, KNOTS>(table, limits, at);
    add_moments(&mut means, (&at_a, &at_b), at, &stretch);
    let kinks = if KNOTS { Kinks::inside(table, at, &mut means) } else { Kinks::none() };
    let h = at.line.length;
    let kappa = means[0];
    let tau = kappa * h;
    let transmittance = exp_minus::<S>(tau);
    let opacity = one - transmittance;
    let is_clear = S::lt(tau, S::splat(1e-6));
    let per_kappa = one / S::max(kappa, S::splat(LEAST_KAPPA));
    let emitting = S::select(is_clear, h, opacity * per_kappa);
    let kappa_rise = at_b.value[0] - at_a.value[0];
    let order = h * h * S::mul_add(kappa_rise * h, S::splat(0.05), one) * order_of_even::<S>(tau, transmittance);
    let around = Around::<S, KNOTS>::of(table, limits, at, (&kinks, &stretch));
    let square = finite::<S>(tau * tau);
    let most = around.colors * (square / S::mul_add(S::splat(MOST_OF_ORDER), tau, square + S::splat(8.0)));
    // Where evenly emitted light comes from, about the middle; and how far light of a rise does.
    let lean = zero - tau / S::mul_add(square, S::splat(LEAN_SQUARE), S::splat(12.0));
    let of_rise = emitting / S::mul_add(square, S::splat(SPREAD_SQUARE), S::splat(12.0));
    let extinction_rise = kinks.rise::<KNOTS>(0, kappa_rise);
    let mut moments = [moment::<S>(opacity, lean, of_rise * extinction_rise); CHANNELS];
    let mut color = [zero; 3];
    let (mut turn, mut ordered_most) = (zero, zero);
    for c in 0..3 {
        let emission = means[c + 1];
        let emission_rise = at_b.value[c + 1] - at_a.value[c + 1];
        let rise = kinks.rise::<KNOTS>(c + 1, emission_rise);
        let of_color = rise * kappa - emission * extinction_rise;
        turn = S::max(turn, S::abs(of_color));
        let ordered = S::min(S::max(order * of_color, zero - most), most);
        ordered_most = S::max(ordered_most, S::abs(ordered));
        color[c] = S::min(S::max(emission * emitting - ordered, zero), opacity);
        if wanted.lit {
            moments[c + 1] = moment::<S>(color[c], lean, of_rise * rise);
        }
    }
    let of_ends = S::max(at_a.value[0], zero) + S::max(at_b.value[0], zero) + kappa + kappa;
    let of_noise = around.error_of_noise(at, &at_a, of_ends);
    let of_mean = (around.error_of_mean(at, limits, by_ends) + of_noise) * h;
    let rounding = (around.error_of_rounded_steps(at, limits) + of_noise) * h;
    let of_order = most + ordered_most;
    let is_closer = S::lt(wanted.order, of_order);
    let of_order = match S::bits(is_closer & wanted.lanes) {
        0 => of_order,
        _ => {
            let twist = twist(at, (&at_a, &at_b), &kinks, (&means, per_kappa));
            let close = around.error_of_order(at, &at_a, [tau, per_kappa, opacity, kappa_rise, turn, twist]);
            S::select(is_closer, S::min(close, of_order), of_order)
        }
    };
    // An error of a mean shows less in a part that is opaque.
    let least = S::max(tau - of_mean, zero);
    let seen = of_mean / S::max(S::splat(0.5) * least, one);
    let error = S::min(seen, one) + of_order;
    let misplaced = match wanted.lit {
        true => around.misplaced(at, &at_a, [kappa, opacity + error, S::splat(limits.narrow)]),
        false => zero,
    };
    let rounding = rounding * transmittance;
    Part { color, tau, transmittance, error, rounding, moments, misplaced, colors: S::min(around.colors, one) }
}

/// R of the head, of even extinction: `(tau - 2 + (tau + 2) exp(-tau)) / (2 tau^3)`, for small tau by its series.
#[inline(always)]
pub fn order_of_even<S: Simd>(tau: S::F, transmittance: S::F) -> S::F {
    let (one, two) = (S::splat(1.0), S::splat(2.0));
    let is_deep = S::lt(S::splat(SERIES_UP_TO), tau);
    let series = S::mul_add(tau, S::mul_add(tau, S::splat(ORDER_CUBE), S::splat(ORDER_SQUARE)), S::splat(6.0));
    let series = S::mul_add(tau, series, S::splat(12.0));
    let above = S::select(is_deep, S::mul_add(tau + two, transmittance, tau - two), one);
    let below = S::select(is_deep, (tau + tau) * tau * tau, series);
    above / below
}

/// First moment of a density with this sum; at most half of it, as any has.
#[inline(always)]
fn moment<S: Simd>(sum: S::F, lean: S::F, of_rise: S::F) -> S::F {
    let most = sum * S::splat(0.5);
    S::min(S::max(S::mul_add(sum, lean, of_rise), S::splat(0.0) - most), most)
}

/// Means of the channels over the line between two places; never negative.
#[inline(always)]
fn means<S: Simd>(a: &Channels<S>, b: &Channels<S>, at: &LineInTable<S>, by_ends: S::M) -> [S::F; CHANNELS] {
    let per_width = at.per_width();
    let mut means = means_by_ends(a, b, at);
    for c in 0..CHANNELS {
        let of_sums = ((b.start[c] - a.start[c]) + (b.rest[c] - a.rest[c])) * per_width;
        means[c] = S::select(by_ends, means[c], S::max(of_sums, S::splat(0.0)));
    }
    means
}

/// Means between two places in one piece. The mean of a quadratic follows from its ends, without cancellation: `(f(a) + f(b)) / 2 - bend
/// (b - a)^2 / 6`.
#[inline(always)]
fn means_by_ends<S: Simd>(a: &Channels<S>, b: &Channels<S>, at: &LineInTable<S>) -> [S::F; CHANNELS] {
    let (zero, half) = (S::splat(0.0), S::splat(0.5));
    let square = finite::<S>(at.width * at.width);
    let mut means = [zero; CHANNELS];
    for c in 0..CHANNELS {
        means[c] = S::max(half * S::mul_add(zero - a.third_bend[c], square, a.value[c] + b.value[c]), zero);
    }
    means
}

/// Adds to means what r makes of the curvature between their ends: `f'' (mean(r^2) / 2 + (b - a) mean((u - 1/2) r))`, exact in one
/// piece. Elsewhere between two control points f'' is the mean of those at the ends.
#[inline(always)]
fn add_moments<S: Simd>(
    means: &mut [S::F; CHANNELS],
    (a, b): (&Channels<S>, &Channels<S>),
    at: &LineInTable<S>,
    stretch: &Stretch<S>,
) {
    if at.line.is_span {
        return;
    }
    let [square, moment] = at.line.moments;
    let missed = S::mul_add(S::splat(1.5), square, S::splat(3.0) * (at.width * moment));
    let missed = S::select(stretch.is_one, finite::<S>(missed), S::splat(0.0));
    for c in 0..CHANNELS {
        means[c] = S::max(S::mul_add(a.third_bend[c] + b.third_bend[c], missed, means[c]), S::splat(0.0));
    }
}
