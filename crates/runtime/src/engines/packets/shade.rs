//! Shading of visible cells: two-sided Blinn-Phong (RENDERING-MODEL, section 5).
//!
//! A part of a ray has a mean colour c and an opacity. At a position with gradient g, shading gives `f = min(c D + S,
//! 1)`; D and S depend on the direction of g alone. f is computed at the part's beginning, middle and end, and its mean
//! is weighted by the origin of the light. Let the weight vary evenly from w0 at the beginning to w1 at the end. The
//! mean of a quadratic f is then `(w0 f0 + w1 f1 + 2 (w0 + w1) fm) / (3 (w0 + w1))`: Simpson's rule if w0 = w1.
//!
//! [`PacketLighting::shade`] states the error of this: the light does not vary evenly ([`Part::misplaced`]), f bends,
//! or the normal turns so far that there may be a highlight between the three positions.
//!
//! Gradients are interpolated differences over two voxels (`cells::shade` explains this definition). The 32 voxels
//! around a cell are gathered once, and along the ray the gradient is one cubic per axis.

use glam::{DMat3, DVec3};
use supervol_format::Geometry;

use super::integrate::Part;
use super::simd::{Simd, exp_minus, for_three, minus_ln};
use crate::engines::cells::shade::Lighting;
use crate::engines::rules::{
    BEND_SHARE, BOW_SHARE, COLOR_SHARE, CUT_SHARE, DEPARTURE_SHARE, GREATEST_TURN, HIGHLIGHT_REACH, HIGHLIGHT_SHARE,
    KINK_SHARE, KINKED_BELOW, STEEP_FALL, STEEP_SHARE, TURN_SHARE, UNEVEN_SHARE,
};

/// Greatest whole half of a shininess that is reached by multiplications.
const WHOLE_LIMIT: u32 = 128;
/// Least square of |n.h|: a normal `f32`.
const LEAST_SQUARE: f32 = 1e-37;

/// The lighting of a frame for the voxels of one level.
#[derive(Debug, Clone, Copy)]
pub struct PacketLighting<'a> {
    /// Lights and material.
    pub lighting: &'a Lighting,
    /// World gradient, values per world length, from differences of stored numbers over two voxels; columns.
    pub world_from_differences: [[f32; 3]; 3],
    /// World vectors from vectors in cells; columns.
    pub world_from_cells: [[f32; 3]; 3],
    /// Intensity of all lights.
    pub light: f32,
    /// Largest factor of a colour.
    gain: f32,
    /// Half the shininess, if it is an integer for which multiplications are faster than a logarithm.
    whole_half: Option<u32>,
}

/// Product of a matrix, given by columns, and a vector.
#[inline(always)]
pub fn transform<S: Simd>(columns: &[[f32; 3]; 3], v: [S::F; 3]) -> [S::F; 3] {
    let mut out = v;
    for row in 0..3 {
        let sum = v[0] * S::splat(columns[0][row]);
        let sum = S::mul_add(v[1], S::splat(columns[1][row]), sum);
        out[row] = S::mul_add(v[2], S::splat(columns[2][row]), sum);
    }
    out
}

/// Inverse of the length of the sum of two unit vectors; 0 if the sum vanishes.
#[inline(always)]
fn inverse_of_sum<S: Simd>(a: &[S::F; 3], b: &[S::F; 3]) -> S::F {
    let (zero, one) = (S::splat(0.0), S::splat(1.0));
    // |a + b|^2 = 2 + 2 a.b.
    let square = S::mul_add(S::splat(2.0), dot::<S>(a, b), S::splat(2.0));
    let is_there = S::lt(S::splat(1e-12), square);
    S::select(is_there, one / S::sqrt(S::select(is_there, square, one)), zero)
}

#[inline(always)]
fn dot<S: Simd>(a: &[S::F; 3], b: &[S::F; 3]) -> S::F {
    S::mul_add(a[0], b[0], S::mul_add(a[1], b[1], a[2] * b[2]))
}

/// The light at one position of a part.
#[derive(Clone, Copy)]
pub struct LightAt<S: Simd> {
    /// In world space.
    pub gradient: [S::F; 3],
    /// 0 if there is no normal.
    pub inverse_length: S::F,
    /// D and S.
    pub diffuse: S::F,
    pub specular: S::F,
    /// Greatest |n.h| of all lights.
    pub nearest: S::F,
}

impl<S: Simd> LightAt<S> {
    /// No light.
    #[inline(always)]
    pub fn nothing() -> Self {
        let zero = S::splat(0.0);
        Self { gradient: [zero; 3], inverse_length: zero, diffuse: zero, specular: zero, nearest: zero }
    }

    /// Replaces lanes of the mask by those of `other`.
    #[inline(always)]
    pub fn replace(&mut self, mask: S::M, other: &Self) {
        self.gradient = for_three!(a => S::select(mask, other.gradient[a], self.gradient[a]));
        self.inverse_length = S::select(mask, other.inverse_length, self.inverse_length);
        self.diffuse = S::select(mask, other.diffuse, self.diffuse);
        self.specular = S::select(mask, other.specular, self.specular);
        self.nearest = S::select(mask, other.nearest, self.nearest);
    }

    /// Lanes with a normal at all three positions.
    #[inline(always)]
    pub fn have_normals(along: &[Self; 3]) -> S::M {
        S::lt(S::splat(0.0), along[0].inverse_length * along[1].inverse_length * along[2].inverse_length)
    }

    /// Square of the difference between two normals.
    #[inline(always)]
    fn turn(a: &Self, b: &Self) -> S::F {
        let zero = S::splat(0.0);
        let scale = a.inverse_length * b.inverse_length;
        let difference = S::mul_add(S::splat(-2.0) * dot::<S>(&a.gradient, &b.gradient), scale, S::splat(2.0));
        S::select(S::lt(zero, scale), S::max(difference, zero), zero)
    }

    /// Share of a half of a part in which the gradient may be shorter than `floor` unseen. The gradients are those at
    /// its ends. The model is a gradient that varies evenly, on the chord through a sphere. The share is 0 if both ends
    /// are that short: then it is seen.
    #[inline(always)]
    fn without_normal(a: &Self, b: &Self, floor: f32) -> S::F {
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
    fn second_difference(along: &[Self; 3]) -> S::F {
        let [a, b, c] = along;
        let second = for_three!(i => (a.gradient[i] - b.gradient[i]) + (c.gradient[i] - b.gradient[i]));
        dot::<S>(&second, &second)
    }

    /// Inverse lengths of the longest and the shortest gradient at three positions.
    #[inline(always)]
    fn inverse_lengths(along: &[Self; 3]) -> [S::F; 2] {
        let inverse = for_three!(i => along[i].inverse_length);
        [least_of::<S>(inverse), greatest_of::<S>(inverse)]
    }

    /// Share of a part, given by its three positions, in which there may be a normal although neither end of that half
    /// has one. This is where the gradient may reach `floor` in between, by the square of its second difference.
    #[inline(always)]
    fn hidden_normal(along: &[Self; 3], second: S::F, floor: f32) -> S::F {
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

    /// A colour after shading.
    #[inline(always)]
    pub fn of(&self, color: S::F) -> S::F {
        S::mul_add(color, self.diffuse, self.specular)
    }
}

impl<'a> PacketLighting<'a> {
    /// The lighting for a level of this scale; `value_scale` is the value difference per stored number.
    #[must_use]
    pub fn new(lighting: &'a Lighting, geometry: &Geometry, scale: [u64; 3], value_scale: f32) -> Self {
        let world_from_cells = geometry.linear() * DMat3::from_diagonal(DVec3::from_array(scale.map(|s| s as f64)));
        let per_difference = 0.5 * value_scale;
        let light: f32 = lighting.lights.iter().map(|l| l.1).sum();
        Self {
            lighting,
            world_from_differences: (lighting.world_from_level_gradient(scale) * per_difference).to_cols_array_2d(),
            world_from_cells: world_from_cells.as_mat3().to_cols_array_2d(),
            light,
            whole_half: (1..=WHOLE_LIMIT).find(|&half| half as f32 * 2.0 == lighting.shininess),
            gain: (lighting.ambient + (lighting.diffuse + lighting.specular) * light).max(1.0),
        }
    }

    /// Unit vectors toward the eye, against rays of these directions, in cells per world length.
    #[inline(always)]
    pub fn toward_eye<S: Simd>(&self, direction: [S::F; 3]) -> [S::F; 3] {
        let along = transform::<S>(&self.world_from_cells, direction);
        for_three!(a => along[a] * S::splat(-1.0))
    }

    /// The light at positions with these gradients, seen from `to_eye`.
    #[inline(always)]
    pub fn at<S: Simd, const PLACES: usize>(
        &self,
        gradients: &[[S::F; 3]; PLACES],
        to_eye: &[S::F; 3],
    ) -> [LightAt<S>; PLACES] {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let lighting = self.lighting;
        let floor = S::splat(self.floor());
        let mut at = [LightAt::<S>::nothing(); PLACES];
        for (at, gradient) in at.iter_mut().zip(gradients) {
            let length = S::sqrt(dot::<S>(gradient, gradient));
            at.inverse_length = S::select(S::le(floor, length), one / S::max(length, floor), zero);
            at.gradient = *gradient;
            at.diffuse = S::splat(lighting.ambient);
        }
        for (to_light, intensity) in &lighting.lights {
            let to_light = [S::splat(to_light.x), S::splat(to_light.y), S::splat(to_light.z)];
            let per_half = inverse_of_sum::<S>(&to_light, to_eye);
            let mut squares = [zero; PLACES];
            for (at, square) in at.iter_mut().zip(&mut squares) {
                let along_light = dot::<S>(&at.gradient, &to_light);
                let cosine = S::abs(along_light * at.inverse_length);
                at.diffuse = S::mul_add(cosine, S::splat(lighting.diffuse * intensity), at.diffuse);
                let along_half = (along_light + dot::<S>(&at.gradient, to_eye)) * (per_half * at.inverse_length);
                at.nearest = S::max(at.nearest, S::abs(along_half));
                *square = S::min(along_half * along_half, one);
            }
            let powers = self.highlights::<S, PLACES>(squares);
            for (at, power) in at.iter_mut().zip(powers) {
                at.specular = S::mul_add(power, S::splat(lighting.specular * intensity), at.specular);
            }
        }
        for at in &mut at {
            let has_normal = S::lt(zero, at.inverse_length);
            at.diffuse = S::select(has_normal, at.diffuse, one);
            at.specular = S::select(has_normal, at.specular, zero);
        }
        at
    }

    /// The part's colour after shading, and its error, from the light at its beginning, middle and end.
    #[inline(always)]
    pub fn shade<S: Simd>(&self, part: &Part<S>, along: &[LightAt<S>; 3], to_eye: &[S::F; 3]) -> ([S::F; 3], S::F) {
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
        let has_kink = goes_over | !LightAt::have_normals(along);
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

    /// Error of a part's colour that does not come from the light.
    #[inline(always)]
    pub fn error_but_light<S: Simd>(&self, part: &Part<S>, along: &[LightAt<S>; 3]) -> ErrorButLight<S> {
        let opacity = S::splat(1.0) - part.transmittance;
        let strongest = greatest_of::<S>(part.color);
        let darkest = least_of::<S>(part.color);
        let lit = |color: S::F| for_three!(i => S::mul_add(color, along[i].diffuse, opacity * along[i].specular));
        let (brightest, dark) = (lit(strongest), lit(darkest));
        let most = greatest_of::<S>(brightest);
        let low = least_of::<S>(dark);
        let diffuse = for_three!(i => along[i].diffuse);
        let spread = opacity * part.colors * greatest_of::<S>(diffuse);
        let cut = cut_from_colors::<S>(spread, [low, most], opacity);
        let certain = S::mul_add(part.error, S::splat(self.gain), cut);
        let varies = range_of::<S>(diffuse);
        let at_most = S::mul_add(opacity * varies, S::splat(UNEVEN_SHARE) * uneven(part), certain);
        ErrorButLight { certain, at_most }
    }

    /// Error of the light between three positions: a highlight where the normal turns, and a gradient that is too short
    /// or long enough for a normal only in between.
    #[inline(always)]
    fn error_of_turn<S: Simd>(&self, along: &[LightAt<S>; 3]) -> S::F {
        let mut turn = S::splat(0.0);
        let second = LightAt::second_difference(along);
        let [_, inverse] = LightAt::inverse_lengths(along);
        let aside = second * S::splat(DEPARTURE_SHARE * DEPARTURE_SHARE) * inverse * inverse;
        let (mut flat, mut widest) = (LightAt::hidden_normal(along, second, self.floor()), turn);
        for [a, b] in [[0, 1], [1, 2]] {
            let of_pair = S::min(LightAt::turn(&along[a], &along[b]) + aside, S::splat(GREATEST_TURN));
            turn = turn + of_pair;
            widest = S::max(widest, of_pair);
            flat = flat + LightAt::without_normal(&along[a], &along[b], self.floor());
        }
        let nearest = greatest_of::<S>(for_three!(i => along[i].nearest));
        let nearest = S::mul_add(S::sqrt(widest), S::splat(HIGHLIGHT_REACH), nearest);
        let [seen] = self.highlights::<S, 1>([S::min(nearest * nearest, S::splat(1.0))]);
        S::mul_add(flat, S::splat(self.gain), self.missed_by_turn::<S>(turn, seen))
    }

    /// Error of the light for a turn of the normal (given as a square), with highlights of at most the strength `seen`.
    /// A wide highlight behaves like diffuse light.
    #[inline(always)]
    pub fn missed_by_turn<S: Simd>(&self, turn: S::F, seen: S::F) -> S::F {
        let Lighting { diffuse, specular, shininess, .. } = *self.lighting;
        let (square, widths) = (turn * turn, turn * S::splat(shininess));
        let of_width = widths * widths * S::splat(HIGHLIGHT_SHARE);
        let highlight = S::min(S::mul_add(square, S::splat(TURN_SHARE), of_width), S::splat(1.0));
        let of_highlight = highlight * seen * S::splat(specular * self.light);
        S::mul_add(square, S::splat(TURN_SHARE * diffuse * self.light), of_highlight)
    }

    /// Error of the light between two positions with these gradients, by the turn of the normal.
    #[inline(always)]
    pub fn error_between<S: Simd>(&self, a: &[S::F; 3], b: &[S::F; 3]) -> S::F {
        let floor = S::splat(f32::MIN_POSITIVE);
        let product = S::sqrt(S::max(dot::<S>(a, a), floor)) * S::sqrt(S::max(dot::<S>(b, b), floor));
        let cosine = dot::<S>(a, b) / S::max(product, floor);
        let turn = S::max(S::mul_add(S::splat(-2.0), cosine, S::splat(2.0)), S::splat(0.0));
        self.missed_by_turn::<S>(turn, S::splat(1.0))
    }

    /// Error, not seen by the second difference, of light that passes from one side to the other between two positions
    /// and vanishes in between. Also returns whether it does.
    #[inline(always)]
    fn error_of_sides<S: Simd>(&self, along: &[LightAt<S>; 3], to_eye: &[S::F; 3]) -> (S::F, S::M) {
        let zero = S::splat(0.0);
        let (mut error, mut goes_over) = (zero, S::lt(zero, zero));
        let Lighting { diffuse, specular, shininess, .. } = *self.lighting;
        for (to_light, intensity) in &self.lighting.lights {
            let to_light = [S::splat(to_light.x), S::splat(to_light.y), S::splat(to_light.z)];
            let cosines = for_three!(i => dot::<S>(&along[i].gradient, &to_light) * along[i].inverse_length);
            let (dip, goes) = dip_between::<S>(&cosines, &for_three!(i => S::abs(cosines[i])));
            (error, goes_over) = (S::mul_add(dip, S::splat(diffuse * intensity), error), goes_over | goes);
            if shininess < KINKED_BELOW {
                let half = for_three!(a => to_light[a] + to_eye[a]);
                let per_half = inverse_of_sum::<S>(&to_light, to_eye);
                let cosines =
                    for_three!(i => dot::<S>(&along[i].gradient, &half) * (per_half * along[i].inverse_length));
                let powers = self.highlights::<S, 3>(for_three!(i => S::min(cosines[i] * cosines[i], S::splat(1.0))));
                let (dip, goes) = dip_between::<S>(&cosines, &powers);
                (error, goes_over) = (S::mul_add(dip, S::splat(specular * intensity), error), goes_over | goes);
            }
        }
        (error, goes_over)
    }

    /// Length of a gradient below which there is no normal.
    #[inline(always)]
    fn floor(&self) -> f32 {
        self.lighting.gradient_floor.max(f32::MIN_POSITIVE.sqrt())
    }

    /// Computes |n.h| to the power of the shininess, from its square; at most 1. Several positions at once, so
    /// that none waits for another.
    #[inline(always)]
    pub fn highlights<S: Simd, const PLACES: usize>(&self, squares: [S::F; PLACES]) -> [S::F; PLACES] {
        let (mut powers, mut factors) = ([S::splat(1.0); PLACES], squares);
        let Some(mut left) = self.whole_half else {
            for (power, square) in powers.iter_mut().zip(squares) {
                let depth = minus_ln::<S>(S::max(square, S::splat(LEAST_SQUARE)));
                *power = exp_minus::<S>(depth * S::splat(0.5 * self.lighting.shininess));
            }
            return powers;
        };
        while left > 1 {
            for (power, factor) in powers.iter_mut().zip(&mut factors) {
                if left & 1 == 1 {
                    *power = *power * *factor;
                }
                *factor = *factor * *factor;
            }
            left >>= 1;
        }
        for (power, factor) in powers.iter_mut().zip(factors) {
            *power = *power * factor;
        }
        powers
    }
}

/// Error of a part's colour that does not come from the light.
pub struct ErrorButLight<S: Simd> {
    /// The error whatever the light does.
    pub certain: S::F,
    /// The error including light that varies where colour or extinction do.
    pub at_most: S::F,
}

/// Error of the mean of a varying quantity along a part, as a share of its variation.
#[inline(always)]
pub fn uneven<S: Simd>(part: &Part<S>) -> S::F {
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
    let [longest, shortest] = LightAt::inverse_lengths(along);
    let is_steep = S::lt(longest, shortest * S::splat(STEEP_FALL));
    S::select(is_steep, S::splat(STEEP_SHARE), S::splat(BEND_SHARE))
}

/// The mean over a part of a quadratic between three positions, weighted by the origin of the light.
#[inline(always)]
fn mean_along<S: Simd>(part: &Part<S>, f: [S::F; 3]) -> S::F {
    let ends = S::mul_add(part.front_share, f[0] - f[2], f[2]);
    (ends + f[1] + f[1]) * S::splat(1.0 / 3.0)
}

/// The second difference.
#[inline(always)]
fn bend_of<S: Simd>(f: [S::F; 3]) -> S::F {
    S::abs((f[0] - f[1]) + (f[2] - f[1]))
}

#[inline(always)]
fn greatest_of<S: Simd>(f: [S::F; 3]) -> S::F {
    S::max(S::max(f[0], f[1]), f[2])
}

#[inline(always)]
fn least_of<S: Simd>(f: [S::F; 3]) -> S::F {
    S::min(S::min(f[0], f[1]), f[2])
}

#[inline(always)]
fn range_of<S: Simd>(f: [S::F; 3]) -> S::F {
    greatest_of::<S>(f) - least_of::<S>(f)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::simd::{LANES_LIMIT, Portable};
    use super::*;

    type S = Portable;

    fn first(lanes: <S as Simd>::F) -> f64 {
        let mut numbers = [0.0; LANES_LIMIT];
        S::store(lanes, &mut numbers);
        f64::from(numbers[0])
    }

    /// Two consecutive colours, clipped: their distance from the clipped mean is at most the stated bound, and reaches
    /// it.
    #[test]
    fn colors_that_are_cut_off_are_no_further_off_than_said() {
        let (splat, mut worst) = (<S as Simd>::splat, 0.0f64);
        for number in 0..20_000u32 {
            let [low, range, share] = [number % 31, number / 31 % 29, number / 899].map(f64::from);
            let (low, range, share) = (low / 25.0, (range + 1.0) / 20.0, share / 22.0);
            let mean = low + share * range;
            let cut = |color: f64| color.min(1.0);
            let missed = (cut(mean) - ((1.0 - share) * cut(low) + share * cut(low + range))).abs();
            let mean = splat(mean as f32);
            let stated = first(cut_from_colors::<S>(splat(range as f32), [mean, mean], splat(1.0)));
            assert!(missed <= stated + 1e-6, "{missed} missed, {stated} stated: {low}, {range}, {share}");
            worst = worst.max(missed / (stated + 1e-6));
        }
        assert!(worst > 0.99, "at worst {worst} of what is stated is missed");
    }

    /// Brightness of a part between these gradients by three positions, its error, and brightness by many positions.
    fn brightness(lighting: &Lighting, gradients: [[f32; 3]; 3]) -> [f64; 3] {
        let splat = <S as Simd>::splat;
        let lighting = PacketLighting::new(lighting, &Geometry::IDENTITY, [1; 3], 1.0);
        let to_eye = [splat(0.0), splat(0.0), splat(1.0)];
        let (grey, opacity) = (0.4, 0.5);
        let part = Part::<S> {
            color: [splat(grey * opacity); 3],
            transmittance: splat(1.0 - opacity),
            front_share: splat(0.5),
            ..Part::nothing()
        };
        let along = lighting.at::<S, 3>(&gradients.map(|g| g.map(splat)), &to_eye);
        let ([found, ..], stated) = lighting.shade::<S>(&part, &along, &to_eye);
        let [begin, middle, end] = gradients.map(Vec3::from_array);
        let (mut sum, many) = (0.0, 20_000);
        for i in 0..many {
            let u = (i as f32 + 0.5) / many as f32;
            let at = begin + u * (4.0 * middle - 3.0 * begin - end + u * (2.0 * (begin + end) - 4.0 * middle));
            let [lit] = lighting.at::<S, 1>(&[at.to_array().map(splat)], &to_eye);
            sum += first(lit.of(splat(grey))).min(1.0);
        }
        [first(found), first(stated), f64::from(opacity) * sum / f64::from(many)]
    }

    /// Cases that three positions miss where the gradient nearly vanishes. A turn close to an end; a turn aside and
    /// back; a wide highlight that passes over to the other side.
    #[test]
    fn turns_that_three_places_do_not_see_are_stated() {
        let light = |direction: Vec3, shininess: f32| Lighting {
            ambient: 0.3,
            diffuse: 0.7,
            specular: 0.4,
            shininess,
            lights: vec![(direction.normalize(), 1.0)],
            gradient_floor: 1e-6,
            world_from_index_gradient: DMat3::IDENTITY,
        };
        let near_end = [[0.19, 0.04, 0.23], [0.085, 0.019, 0.103], [0.0035, 0.0026, 0.0042]];
        let aside = [[-0.103, -0.04, -0.031], [-0.115, -0.04, -0.032], [-0.704, -0.1, -0.031]];
        let other_side = [[0.62, -0.71, 0.1], [0.43, -0.87, 0.22], [0.4, -0.9, 0.23]];
        for (name, lighting, gradients) in [
            ("near an end", light(Vec3::Y, 32.0), near_end),
            ("aside", light(Vec3::new(0.3, 0.9, 0.3), 32.0), aside),
            ("highlight", light(Vec3::new(0.85, 0.53, -0.02), 1.0), other_side),
        ] {
            let [found, stated, expected] = brightness(&lighting, gradients);
            let missed = (found - expected).abs();
            println!("{name}: {missed:.5} missed, {stated:.5} stated");
            assert!(missed <= stated, "{name}: {missed} missed, {stated} stated");
        }
    }
}
