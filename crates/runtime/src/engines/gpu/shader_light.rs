//! The shader's rule for the light of a part, and its error, in the packets' form: the twin that tests hold the shader to.
//!
//! A part of a ray has a mean colour c and an opacity. At a position with gradient g, shading gives `f = min(c D + S,
//! 1)`; D and S depend on the direction of g alone. f is computed at the part's beginning, middle and end, and its mean
//! is weighted by the origin of the light. Let the weight vary evenly from w0 at the beginning to w1 at the end. The
//! mean of a quadratic f is then `(w0 f0 + w1 f1 + 2 (w0 + w1) fm) / (3 (w0 + w1))`: Simpson's rule if w0 = w1.
//!
//! The error is an estimate: the light does not vary evenly, f bends, or the normal turns so far that there may be a highlight
//! between the three positions. Packets have a bound instead (`packets::shade`).

use crate::engines::cells::shade::Lighting;
use crate::engines::packets::shade::{LightAt, PacketLighting, dot, greatest_of, inverse_of_sum, least_of};
use crate::engines::packets::simd::{Simd, for_three};
use crate::engines::rules::{
    BEND_SHARE, BOW_SHARE, COLOR_SHARE, CUT_SHARE, DEPARTURE_SHARE, GREATEST_TURN, HIGHLIGHT_REACH, HIGHLIGHT_SHARE,
    KINK_SHARE, KINKED_BELOW, STEEP_FALL, STEEP_SHARE, TURN_SHARE,
};

/// Contribution of a part of a ray, before it is lit.
#[derive(Clone, Copy)]
pub struct LitPart<S: Simd> {
    /// Premultiplied colour.
    pub color: [S::F; 3],
    /// Share of light from behind that passes.
    pub transmittance: S::F,
    /// Error of colour and opacity.
    pub error: S::F,
    /// Light from the front end, as a share of that from both ends, if it varies evenly in between.
    pub front_share: S::F,
    /// Share of the part by which evenly varying light may be misplaced.
    pub misplaced: S::F,
    /// Variation of colour over the part.
    pub colors: S::F,
}

/// The rule for one lighting.
pub struct ShaderLight<'a> {
    /// The lighting.
    pub lighting: &'a PacketLighting<'a>,
}

/// Light between positions.
struct Between<S: Simd>(std::marker::PhantomData<S>);

impl<S: Simd> Between<S> {
    /// Lanes with a normal at all three positions.
    #[inline(always)]
    pub fn have_normals(along: &[LightAt<S>; 3]) -> S::M {
        S::lt(S::splat(0.0), along[0].inverse_length * along[1].inverse_length * along[2].inverse_length)
    }

    /// Square of the difference between two normals.
    #[inline(always)]
    fn turn(a: &LightAt<S>, b: &LightAt<S>) -> S::F {
        let zero = S::splat(0.0);
        let scale = a.inverse_length * b.inverse_length;
        let difference = S::mul_add(S::splat(-2.0) * dot::<S>(&a.gradient, &b.gradient), scale, S::splat(2.0));
        S::select(S::lt(zero, scale), S::max(difference, zero), zero)
    }

    /// Share of a half of a part in which the gradient may be shorter than `floor` unseen. The gradients are those at
    /// its ends. The model is a gradient that varies evenly, on the chord through a sphere. The share is 0 if both ends
    /// are that short: then it is seen.
    #[inline(always)]
    fn without_normal(a: &LightAt<S>, b: &LightAt<S>, floor: f32) -> S::F {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let (aa, ab) = (dot::<S>(&a.gradient, &a.gradient), dot::<S>(&a.gradient, &b.gradient));
        let bb = dot::<S>(&b.gradient, &b.gradient);
        let way = S::max(S::mul_add(S::splat(-2.0), ab, aa + bb), S::splat(f32::MIN_POSITIVE));
        // Twice as wide, since it does not vary exactly evenly.
        let floor = S::splat(2.0 * floor);
        let nearest = S::max(S::mul_add(aa, bb, zero - ab * ab), zero) / way;
        let has_normal = S::lt(zero, a.inverse_length + b.inverse_length);
        let is_passed = S::lt(ab, aa) & S::lt(ab, bb) & S::lt(nearest, floor * floor) & has_normal;
        S::select(is_passed, S::min(floor / S::sqrt(way), one), zero)
    }

    /// Square of the second difference of the gradients at three positions.
    #[inline(always)]
    fn second_difference(along: &[LightAt<S>; 3]) -> S::F {
        let [a, b, c] = along;
        let second = for_three!(i => (a.gradient[i] - b.gradient[i]) + (c.gradient[i] - b.gradient[i]));
        dot::<S>(&second, &second)
    }

    /// Inverse lengths of the longest and the shortest gradient at three positions.
    #[inline(always)]
    fn inverse_lengths(along: &[LightAt<S>; 3]) -> [S::F; 2] {
        let inverse = for_three!(i => along[i].inverse_length);
        [least_of::<S>(inverse), greatest_of::<S>(inverse)]
    }

    /// Share of a part, given by its three positions, in which there may be a normal although neither end of that half
    /// has one. This is where the gradient may reach `floor` in between, by the square of its second difference.
    #[inline(always)]
    fn hidden_normal(along: &[LightAt<S>; 3], second: S::F, floor: f32) -> S::F {
        let zero = S::splat(0.0);
        let [a, b, c] = along;
        let lacks = [(a, b), (b, c)].map(|(a, b)| S::le(a.inverse_length + b.inverse_length, zero));
        if S::bits(lacks[0] | lacks[1]) == 0 {
            return zero;
        }
        let squares = for_three!(i => dot::<S>(&along[i].gradient, &along[i].gradient));
        let bow = S::sqrt(second) * S::splat(BOW_SHARE);
        let mut share = zero;
        for (i, lacks) in lacks.into_iter().enumerate() {
            let reach = S::sqrt(S::max(squares[i], squares[i + 1])) + bow;
            let is_hidden = lacks & S::le(S::splat(floor), reach);
            share = share + S::select(is_hidden, S::splat(0.5), zero);
        }
        share
    }
}

impl ShaderLight<'_> {
    /// The part's colour after shading, and its error, from the light at its beginning, middle and end.
    #[inline(always)]
    pub fn shade<S: Simd>(&self, part: &LitPart<S>, along: &[LightAt<S>; 3], to_eye: &[S::F; 3]) -> ([S::F; 3], S::F) {
        let one = S::splat(1.0);
        let opacity = one - part.transmittance;
        let per_opacity = one / S::max(opacity, S::splat(f32::MIN_POSITIVE));
        let plain = for_three!(c => part.color[c] * per_opacity);
        let strongest = greatest_of::<S>(plain);
        let (diffuse, specular) = (for_three!(i => along[i].diffuse), for_three!(i => along[i].specular));
        let (mean_diffuse, mean_specular) = (mean_along::<S>(part, diffuse), mean_along::<S>(part, specular));
        let of_specular = opacity * mean_specular;
        let mut color = for_three!(c => S::mul_add(part.color[c], mean_diffuse, of_specular));
        let (of_sides, goes_over) = self.error_of_sides::<S>(along, to_eye);
        // Range and bend of a channel are convex in its colour: greatest at the strongest channel, or at black.
        let brightest = for_three!(i => along[i].of(strongest));
        let range = S::max(range_of::<S>(brightest), range_of::<S>(specular));
        let bend = S::max(bend_of::<S>(brightest), bend_of::<S>(specular));
        let uneven = uneven(part);
        let has_kink = goes_over | !Between::have_normals(along);
        let share = S::select(has_kink, S::splat(KINK_SHARE), share_of_bend::<S>(along));
        let mut of_place = S::mul_add(share, bend, range * uneven);
        let most = greatest_of::<S>(brightest);
        let spread = part.colors * greatest_of::<S>(diffuse);
        let is_near = S::lt(one, most + spread);
        if S::bits(is_near) != 0 {
            for c in 0..3 {
                let f = for_three!(i => S::min(along[i].of(plain[c]), one));
                color[c] = S::select(is_near, opacity * mean_along::<S>(part, f), color[c]);
            }
            let darkest = least_of::<S>(plain);
            let dark = for_three!(i => along[i].of(darkest));
            let low = least_of::<S>(dark);
            let half = spread * S::splat(0.5);
            let is_cut = S::lt(one, most + half) & S::lt(low, one + half);
            let of_cut = S::mul_add(S::splat(KINK_SHARE), S::mul_add(range, S::splat(0.5), bend), range * uneven);
            let of_colors = S::select(is_near, cut_from_colors::<S>(spread, [low, most], one), S::splat(0.0));
            of_place = S::select(is_cut, of_cut, of_place) + of_colors;
        }
        let of_place = S::max(of_place, of_sides) + self.error_of_turn::<S>(along);
        // The part's own colour error is lit like the part; its opacity error is not.
        let lit = for_three!(i => along[i].diffuse + along[i].specular);
        let gain = S::max(greatest_of::<S>(lit), one);
        (color, S::mul_add(opacity, S::min(of_place, one), part.error * gain))
    }

    /// Error of the light between three positions: a highlight where the normal turns, and a gradient that is too short
    /// or long enough for a normal only in between.
    #[inline(always)]
    fn error_of_turn<S: Simd>(&self, along: &[LightAt<S>; 3]) -> S::F {
        let mut turn = S::splat(0.0);
        let second = Between::second_difference(along);
        let [_, inverse] = Between::inverse_lengths(along);
        let aside = second * S::splat(DEPARTURE_SHARE * DEPARTURE_SHARE) * inverse * inverse;
        let (mut flat, mut widest) = (Between::hidden_normal(along, second, self.lighting.floor()), turn);
        for [a, b] in [[0, 1], [1, 2]] {
            let of_pair = S::min(Between::turn(&along[a], &along[b]) + aside, S::splat(GREATEST_TURN));
            turn = turn + of_pair;
            widest = S::max(widest, of_pair);
            flat = flat + Between::without_normal(&along[a], &along[b], self.lighting.floor());
        }
        let nearest = greatest_of::<S>(for_three!(i => along[i].nearest));
        let nearest = S::mul_add(S::sqrt(widest), S::splat(HIGHLIGHT_REACH), nearest);
        let [seen] = self.lighting.highlights::<S, 1>([S::min(nearest * nearest, S::splat(1.0))]);
        S::mul_add(flat, S::splat(self.gain()), self.missed_by_turn::<S>(turn, seen))
    }

    /// Error of the light for a turn of the normal (given as a square), with highlights of at most the strength `seen`.
    /// A wide highlight behaves like diffuse light.
    #[inline(always)]
    fn missed_by_turn<S: Simd>(&self, turn: S::F, seen: S::F) -> S::F {
        let Lighting { diffuse, specular, shininess, .. } = *self.lighting.lighting;
        let (square, widths) = (turn * turn, turn * S::splat(shininess));
        let of_width = widths * widths * S::splat(HIGHLIGHT_SHARE);
        let highlight = S::min(S::mul_add(square, S::splat(TURN_SHARE), of_width), S::splat(1.0));
        let of_highlight = highlight * seen * S::splat(specular * self.lighting.light);
        S::mul_add(square, S::splat(TURN_SHARE * diffuse * self.lighting.light), of_highlight)
    }

    /// Error, not seen by the second difference, of light that passes from one side to the other between two positions
    /// and vanishes in between. Also returns whether it does.
    #[inline(always)]
    fn error_of_sides<S: Simd>(&self, along: &[LightAt<S>; 3], to_eye: &[S::F; 3]) -> (S::F, S::M) {
        let zero = S::splat(0.0);
        let (mut error, mut goes_over) = (zero, S::lt(zero, zero));
        let Lighting { diffuse, specular, shininess, .. } = *self.lighting.lighting;
        for (to_light, intensity) in &self.lighting.lighting.lights {
            let to_light = [S::splat(to_light.x), S::splat(to_light.y), S::splat(to_light.z)];
            let cosines = for_three!(i => dot::<S>(&along[i].gradient, &to_light) * along[i].inverse_length);
            let (dip, goes) = dip_between::<S>(&cosines, &for_three!(i => S::abs(cosines[i])));
            (error, goes_over) = (S::mul_add(dip, S::splat(diffuse * intensity), error), goes_over | goes);
            if shininess < KINKED_BELOW {
                let half = for_three!(a => to_light[a] + to_eye[a]);
                let per_half = inverse_of_sum::<S>(&to_light, to_eye);
                let cosines =
                    for_three!(i => dot::<S>(&along[i].gradient, &half) * (per_half * along[i].inverse_length));
                let powers =
                    self.lighting.highlights::<S, 3>(for_three!(i => S::min(cosines[i] * cosines[i], S::splat(1.0))));
                let (dip, goes) = dip_between::<S>(&cosines, &powers);
                (error, goes_over) = (S::mul_add(dip, S::splat(specular * intensity), error), goes_over | goes);
            }
        }
        (error, goes_over)
    }

    /// Largest factor of a colour.
    #[inline(always)]
    fn gain(&self) -> f32 {
        let Lighting { ambient, diffuse, specular, .. } = *self.lighting.lighting;
        (ambient + (diffuse + specular) * self.lighting.light).max(1.0)
    }
}

/// Error of the mean of a varying quantity along a part, as a share of its variation.
#[inline(always)]
fn uneven<S: Simd>(part: &LitPart<S>) -> S::F {
    S::mul_add(part.colors, S::splat(COLOR_SHARE), part.misplaced)
}

/// Excess of the mean of lines between three values of a light over the light's true mean. It occurs where the cosine
/// changes its sign between two positions and passes zero on a line: the triangles in between. Also returns where it
/// occurs.
#[inline(always)]
fn dip_between<S: Simd>(cosines: &[S::F; 3], lights: &[S::F; 3]) -> (S::F, S::M) {
    let zero = S::splat(0.0);
    let (mut dip, mut passes) = (zero, S::lt(zero, zero));
    for [a, b] in [[0, 1], [1, 2]] {
        let has_zero = S::lt(cosines[a] * cosines[b], zero);
        let sum = S::max(lights[a] + lights[b], S::splat(f32::MIN_POSITIVE));
        // Only half of the part.
        let triangle = S::splat(0.5) * (lights[a] * lights[b]) / sum;
        (dip, passes) = (dip + S::select(has_zero, triangle, zero), passes | has_zero);
    }
    (dip, passes)
}

/// Error from clipping at `white` after averaging instead of before: at most `(r - d)^2 / 4r` for a range r and a mean
/// that is d from white. The worst case is the brightest colour next to the darkest. Means lie between these two.
#[inline(always)]
fn cut_from_colors<S: Simd>(range: S::F, [low, most]: [S::F; 2], white: S::F) -> S::F {
    let zero = S::splat(0.0);
    let apart = S::max(S::max(white - most, low - white), zero);
    let reach = S::max(range - apart, zero);
    S::splat(CUT_SHARE) * reach * reach / S::max(range, S::splat(f32::MIN_POSITIVE))
}

/// Error of the mean of a smooth f as a share of its second difference.
#[inline(always)]
fn share_of_bend<S: Simd>(along: &[LightAt<S>; 3]) -> S::F {
    let [longest, shortest] = Between::inverse_lengths(along);
    let is_steep = S::lt(longest, shortest * S::splat(STEEP_FALL));
    S::select(is_steep, S::splat(STEEP_SHARE), S::splat(BEND_SHARE))
}

/// The mean over a part of a quadratic between three positions, weighted by the origin of the light.
#[inline(always)]
fn mean_along<S: Simd>(part: &LitPart<S>, f: [S::F; 3]) -> S::F {
    let ends = S::mul_add(part.front_share, f[0] - f[2], f[2]);
    (ends + f[1] + f[1]) * S::splat(1.0 / 3.0)
}

/// The second difference.
#[inline(always)]
fn bend_of<S: Simd>(f: [S::F; 3]) -> S::F {
    S::abs((f[0] - f[1]) + (f[2] - f[1]))
}

#[inline(always)]
fn range_of<S: Simd>(f: [S::F; 3]) -> S::F {
    greatest_of::<S>(f) - least_of::<S>(f)
}
