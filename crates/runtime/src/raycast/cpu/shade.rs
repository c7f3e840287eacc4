//! Shading of the cells that show something: two-sided Blinn-Phong (RENDERING-MODEL, section 5).
//!
//! A part of a ray has a mean colour c and an opacity; shading makes of c, at a place with gradient g,
//! `f = min(c D + S, 1)`, D and S functions of the direction of g alone. f is taken at the part's beginning, middle and
//! end, and its mean weighted by where the light comes from: if that varies evenly from w0 at the beginning to w1 at the
//! end, the mean of a quadratic f is `(w0 f0 + w1 f1 + 2 (w0 + w1) fm) / (3 (w0 + w1))`, Simpson's rule where w0 = w1.
//!
//! What that misses ([`PacketLighting::shade`] states it): the light does not vary evenly ([`Part::misplaced`]), f bends, or
//! the normal turns so far that there may be a highlight between the three places.
//!
//! Gradients are differences over two voxels, interpolated (`scalar::shade` says why that is the definition): the 32 voxels
//! around a cell are gathered once, and along the ray the gradient is one cubic per axis.

use glam::{DMat3, DVec3};
use supervol_format::Geometry;

use super::integrate::Part;
use super::simd::{Simd, exp_minus, for_three, minus_ln};
use crate::raycast::scalar::shade::Lighting;

/// Share of f's second difference that its mean may be off by where f may have a kink: 1/6 at the worst place.
pub const KINK_SHARE: f32 = 0.25;
/// The same where f is smooth: 1/50 and less, and the turn of the normal has an error of its own.
pub const BEND_SHARE: f32 = 0.05;
/// Share of f's range that its mean may be off by, for a colour that varies by 1.
pub const COLOR_SHARE: f32 = 0.15;
/// Multiple of what is uneven, where nothing else is uncertain any more: then it is not outweighed by what is estimated too
/// high.
pub const UNEVEN_SHARE: f32 = 4.0;
/// Share of what is cut off at 1 that the mean may be off by where colour varies.
pub const CUT_SHARE: f32 = 0.25;
/// Share of the diffuse light that its mean may be off by, for a normal that turns by one radian; falls with the square.
pub const TURN_SHARE: f32 = 0.1;
/// Share of the highlights that their mean may be off by, where the square of the turn is the shininess's inverse: that is
/// how wide a highlight is. Falls with the fourth power.
pub const HIGHLIGHT_SHARE: f32 = 0.006;
/// What |n.h| may be between two places more than at either of them, over the distance of their normals.
pub const HIGHLIGHT_REACH: f32 = 0.5;
/// Share of the second difference of gradients by which the gradient may leave the line between two places: 1/8 of a quadratic's,
/// twice as much since it is a cubic.
pub const BOW_SHARE: f32 = 0.25;
/// Greatest whole half of a shininess that is reached by multiplications.
const WHOLE_LIMIT: u32 = 128;
/// Least square of |n.h|: a normal `f32`.
const LEAST_SQUARE: f32 = 1e-37;

/// The lighting of a frame as the voxels of one level see it.
#[derive(Debug, Clone, Copy)]
pub struct PacketLighting<'a> {
    /// Lights, and what the material makes of them.
    pub lighting: &'a Lighting,
    /// World gradient, values per world length, from differences of stored numbers over two voxels; columns.
    pub world_from_differences: [[f32; 3]; 3],
    /// World vectors from vectors in cells; columns.
    pub world_from_cells: [[f32; 3]; 3],
    /// Intensity of all lights.
    pub light: f32,
    /// Most that a colour can be multiplied by.
    gain: f32,
    /// Half the shininess, where that is a whole number that multiplications reach sooner than a logarithm.
    whole_half: Option<u32>,
}

/// A matrix, by columns, times a vector.
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

#[inline(always)]
fn dot<S: Simd>(a: &[S::F; 3], b: &[S::F; 3]) -> S::F {
    S::mul_add(a[0], b[0], S::mul_add(a[1], b[1], a[2] * b[2]))
}

/// The light at one place of a part.
#[derive(Clone, Copy)]
pub struct LightAt<S: Simd> {
    /// In world space.
    pub gradient: [S::F; 3],
    /// 0 where there is no normal.
    pub inverse_length: S::F,
    /// D and S.
    pub diffuse: S::F,
    pub specular: S::F,
    /// Greatest |n.h| of all lights.
    pub nearest: S::F,
}

impl<S: Simd> LightAt<S> {
    /// Dark.
    #[inline(always)]
    pub fn nothing() -> Self {
        let zero = S::splat(0.0);
        Self { gradient: [zero; 3], inverse_length: zero, diffuse: zero, specular: zero, nearest: zero }
    }

    /// Where the mask holds `other`.
    #[inline(always)]
    pub fn replace(&mut self, mask: S::M, other: &Self) {
        self.gradient = for_three!(a => S::select(mask, other.gradient[a], self.gradient[a]));
        self.inverse_length = S::select(mask, other.inverse_length, self.inverse_length);
        self.diffuse = S::select(mask, other.diffuse, self.diffuse);
        self.specular = S::select(mask, other.specular, self.specular);
        self.nearest = S::select(mask, other.nearest, self.nearest);
    }

    /// Whether there is a normal at all three places.
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

    /// Share of a part, of whose half the gradient is these at the ends, in which it may be shorter than `floor` unseen: if
    /// it varies evenly, on the chord through a sphere. Nothing where it is so at both ends: then that is seen.
    #[inline(always)]
    fn without_normal(a: &Self, b: &Self, floor: f32) -> S::F {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let (aa, ab) = (dot::<S>(&a.gradient, &a.gradient), dot::<S>(&a.gradient, &b.gradient));
        let bb = dot::<S>(&b.gradient, &b.gradient);
        let way = S::max(S::mul_add(S::splat(-2.0), ab, aa + bb), S::splat(f32::MIN_POSITIVE));
        // Twice as wide, since it does not vary quite evenly.
        let floor = S::splat(2.0 * floor);
        let nearest = S::max(S::mul_add(aa, bb, zero - ab * ab), zero) / way;
        let has_normal = S::lt(zero, a.inverse_length + b.inverse_length);
        let is_passed = S::lt(ab, aa) & S::lt(ab, bb) & S::lt(nearest, floor * floor) & has_normal;
        S::select(is_passed, S::min(floor / S::sqrt(way), one), zero)
    }

    /// Share of a part, of which these are the three places, in which there may be a normal although neither end of that half has
    /// one: where the gradient may reach `floor` in between.
    #[inline(always)]
    fn hidden_normal(along: &[Self; 3], floor: f32) -> S::F {
        let zero = S::splat(0.0);
        let [a, b, c] = along;
        let lacks = [(a, b), (b, c)].map(|(a, b)| S::le(a.inverse_length + b.inverse_length, zero));
        if S::bits(lacks[0] | lacks[1]) == 0 {
            return zero;
        }
        let squares = for_three!(i => dot::<S>(&along[i].gradient, &along[i].gradient));
        let second = for_three!(i => (a.gradient[i] - b.gradient[i]) + (c.gradient[i] - b.gradient[i]));
        let bow = S::sqrt(dot::<S>(&second, &second)) * S::splat(BOW_SHARE);
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
    /// The lighting for a level of this scale, whose values rise by `value_scale` per stored number.
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

    /// Unit vectors against rays of these directions, in cells per world length.
    #[inline(always)]
    pub fn toward_eye<S: Simd>(&self, direction: [S::F; 3]) -> [S::F; 3] {
        let along = transform::<S>(&self.world_from_cells, direction);
        for_three!(a => along[a] * S::splat(-1.0))
    }

    /// The light where the gradients are these, seen from there.
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
            // |l + v|^2 = 2 + 2 l.v.
            let square = S::mul_add(S::splat(2.0), dot::<S>(&to_light, to_eye), S::splat(2.0));
            let has_half = S::lt(S::splat(1e-12), square);
            let per_half = S::select(has_half, one / S::sqrt(S::select(has_half, square, one)), zero);
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
    pub fn shade<S: Simd>(&self, part: &Part<S>, along: &[LightAt<S>; 3]) -> ([S::F; 3], S::F) {
        let one = S::splat(1.0);
        let opacity = one - part.transmittance;
        let per_opacity = one / S::max(opacity, S::splat(f32::MIN_POSITIVE));
        let plain = for_three!(c => part.color[c] * per_opacity);
        let strongest = S::max(S::max(plain[0], plain[1]), plain[2]);
        let (diffuse, specular) = (for_three!(i => along[i].diffuse), for_three!(i => along[i].specular));
        let (mean_diffuse, mean_specular) = (mean_along::<S>(part, diffuse), mean_along::<S>(part, specular));
        let of_specular = opacity * mean_specular;
        let mut color = for_three!(c => S::mul_add(part.color[c], mean_diffuse, of_specular));
        let (of_sides, goes_over) = self.error_of_sides::<S>(along);
        // Range and bend of a channel are convex in its colour: greatest at the strongest, or at black.
        let brightest = for_three!(i => along[i].of(strongest));
        let range = S::max(range_of::<S>(brightest), range_of::<S>(specular));
        let bend = S::max(bend_of::<S>(brightest), bend_of::<S>(specular));
        let uneven = uneven(part);
        let has_kink = goes_over | !LightAt::have_normals(along);
        let share = S::select(has_kink, S::splat(KINK_SHARE), S::splat(BEND_SHARE));
        let mut of_place = S::mul_add(share, bend, range * uneven);
        let most = S::max(S::max(brightest[0], brightest[1]), brightest[2]);
        let half = part.colors * S::splat(0.5);
        let is_cut = S::lt(one, most + half);
        if S::bits(is_cut) != 0 {
            for c in 0..3 {
                let f = for_three!(i => S::min(along[i].of(plain[c]), one));
                color[c] = S::select(is_cut, opacity * mean_along::<S>(part, f), color[c]);
            }
            let darkest = S::min(S::min(plain[0], plain[1]), plain[2]);
            let dark = for_three!(i => along[i].of(darkest));
            let low = S::min(S::min(dark[0], dark[1]), dark[2]) - half;
            let of_colors = S::min(most + half - one, part.colors) * S::splat(CUT_SHARE);
            let of_cut = S::mul_add(
                S::splat(KINK_SHARE),
                S::mul_add(range, S::splat(0.5), bend),
                S::mul_add(range, uneven, of_colors),
            );
            of_place = S::select(is_cut & S::lt(low, one), of_cut, of_place);
        }
        let of_place = S::max(of_place, of_sides) + self.error_of_turn::<S>(along);
        // What the part itself is off by is lit as the part is; its opacity is not.
        let lit = for_three!(i => along[i].diffuse + along[i].specular);
        let gain = S::max(S::max(S::max(lit[0], lit[1]), lit[2]), one);
        (color, S::mul_add(opacity, S::min(of_place, one), part.error * gain))
    }

    /// What a part's colour is off by, however well its light is known.
    #[inline(always)]
    pub fn error_but_light<S: Simd>(&self, part: &Part<S>, along: &[LightAt<S>; 3]) -> ErrorButLight<S> {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let opacity = one - part.transmittance;
        let strongest = S::max(S::max(part.color[0], part.color[1]), part.color[2]);
        let brightest = for_three!(i => S::mul_add(strongest, along[i].diffuse, opacity * along[i].specular));
        let most = S::max(S::max(brightest[0], brightest[1]), brightest[2]);
        let of_colors = opacity * part.colors;
        let cut = S::min(S::max(S::mul_add(of_colors, S::splat(0.5), most) - opacity, zero), of_colors);
        let certain = S::mul_add(part.error, S::splat(self.gain), cut);
        let varies = range_of::<S>(for_three!(i => along[i].diffuse));
        let at_most = S::mul_add(opacity * varies, S::splat(UNEVEN_SHARE) * uneven(part), certain);
        ErrorButLight { certain, at_most }
    }

    /// What three places can miss of the light between them: a highlight where the normal turns, and a gradient that is too
    /// short for a normal, or long enough, between two places only.
    #[inline(always)]
    fn error_of_turn<S: Simd>(&self, along: &[LightAt<S>; 3]) -> S::F {
        let lighting = self.lighting;
        let mut turn = S::splat(0.0);
        let (mut flat, mut widest) = (LightAt::hidden_normal(along, self.floor()), turn);
        for [a, b] in [[0, 1], [1, 2]] {
            let of_pair = LightAt::turn(&along[a], &along[b]);
            turn = turn + of_pair;
            widest = S::max(widest, of_pair);
            flat = flat + LightAt::without_normal(&along[a], &along[b], self.floor());
        }
        let widths = turn * S::splat(lighting.shininess);
        let highlight = S::min(widths * widths * S::splat(HIGHLIGHT_SHARE), S::splat(1.0));
        let nearest = S::max(S::max(along[0].nearest, along[2].nearest), along[1].nearest);
        let nearest = S::mul_add(S::sqrt(widest), S::splat(HIGHLIGHT_REACH), nearest);
        let [seen] = self.highlights::<S, 1>([S::min(nearest * nearest, S::splat(1.0))]);
        let of_highlight = highlight * seen * S::splat(lighting.specular * self.light);
        let of_turn = S::mul_add(turn * turn, S::splat(TURN_SHARE * lighting.diffuse * self.light), of_highlight);
        S::mul_add(flat, S::splat(self.gain), of_turn)
    }

    /// What the second difference can miss of diffuse light of which one side goes over into the other between two places:
    /// in the middle, nothing is left.
    #[inline(always)]
    fn error_of_sides<S: Simd>(&self, along: &[LightAt<S>; 3]) -> (S::F, S::M) {
        let zero = S::splat(0.0);
        let mut error = zero;
        let mut goes_over = S::lt(zero, zero);
        for (to_light, intensity) in &self.lighting.lights {
            let to_light = [S::splat(to_light.x), S::splat(to_light.y), S::splat(to_light.z)];
            let cosines = for_three!(i => dot::<S>(&along[i].gradient, &to_light) * along[i].inverse_length);
            for [a, b] in [[0, 1], [1, 2]] {
                // The triangles between |cosine| and the line over it, if the cosine itself is a line: of half the part.
                let product = S::max(zero - cosines[a] * cosines[b], zero);
                goes_over = goes_over | S::lt(zero, product);
                let sum = S::max(S::abs(cosines[a] - cosines[b]), S::splat(f32::MIN_POSITIVE));
                error = S::mul_add(product / sum, S::splat(0.5 * self.lighting.diffuse * intensity), error);
            }
        }
        (error, goes_over)
    }

    /// Length of a gradient below which there is no normal.
    #[inline(always)]
    fn floor(&self) -> f32 {
        self.lighting.gradient_floor.max(f32::MIN_POSITIVE.sqrt())
    }

    /// |n.h| to the power of the shininess, from its square, at most 1; of several places, so that none waits for another.
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

/// What a part's colour is off by, however well its light is known.
pub struct ErrorButLight<S: Simd> {
    /// Whatever the light does.
    pub certain: S::F,
    /// With what there is because the light varies where colour or extinction do.
    pub at_most: S::F,
}

/// Share of what varies along a part that its mean may be off by.
#[inline(always)]
pub fn uneven<S: Simd>(part: &Part<S>) -> S::F {
    S::mul_add(part.colors, S::splat(COLOR_SHARE), part.misplaced)
}

/// The mean over a part of what varies as a quadratic between three places, where light comes from.
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
fn range_of<S: Simd>(f: [S::F; 3]) -> S::F {
    S::max(S::max(f[0], f[2]), f[1]) - S::min(S::min(f[0], f[2]), f[1])
}
