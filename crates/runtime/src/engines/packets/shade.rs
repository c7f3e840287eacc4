//! Shading of visible cells: two-sided Blinn-Phong (RENDERING-MODEL, section 5).
//!
//! A part of a ray has a mean colour c and an opacity. At a position with gradient g, shading gives `f = min(c D + S,
//! 1)`; D and S depend on the direction of g alone. They are computed at the part's beginning, middle and end, and
//! averaged by the density of colour, or of opacity, that is linear along the part ([`Part::moments`]):
//! `(f0 + 4 fm + f1) / 6` times its sum, and `f1 - f0` times its first moment.
//!
//! The error of this has a bound ([`PacketLighting::shade`]):
//! - D and S are no quadratics: [`super::turn`];
//! - the density is not linear ([`Part::misplaced`]): as much light in a wrong place as D and S change over that way;
//! - `|n.l|` has a kink where the light passes from one side to the other, f where it is cut off at 1, and light may jump where
//!   the gradient vanishes;
//! - gradients of rounded values are off by as much as these ([`PacketLighting::with_rounded_values`]).
//!
//! Gradients are interpolated differences over two voxels (`cells::shade` explains this definition). The 32 voxels
//! around a cell are gathered once, and along the ray the gradient is one cubic per axis.

use glam::{DMat3, DVec3, Vec3};
use supervol_format::Geometry;

use super::highlight::{Highlight, HighlightBounds, LEAST_COSINE, VERTICAL};
use super::integrate::Part;
use super::simd::{Simd, exp_minus, for_three, minus_ln};
use super::turn::{OF_THIRD, Turn};
use crate::engines::cells::shade::Lighting;

/// Greatest whole half of a shininess that is reached by multiplications.
const WHOLE_LIMIT: u32 = 128;
/// Mean of what it misses of any function, in parts of the greatest slope: 5/36, rounded up.
pub const OF_FIRST: f32 = 0.139;
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
    /// Half the shininess, if it is an integer for which multiplications are faster than a logarithm.
    whole_half: Option<u32>,
    /// Bounds of the change of highlights.
    pub highlight: Highlight,
    /// Bound on the length that a gradient is off by, because values are rounded.
    noise: f32,
}

/// Half of a shininess, if it is an integer for which multiplications are used.
pub fn whole_half_of(shininess: f32) -> Option<u32> {
    (1..=WHOLE_LIMIT).find(|&half| half as f32 * 2.0 == shininess)
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
pub fn inverse_of_sum<S: Simd>(a: &[S::F; 3], b: &[S::F; 3]) -> S::F {
    let (zero, one) = (S::splat(0.0), S::splat(1.0));
    // |a + b|^2 = 2 + 2 a.b.
    let square = S::mul_add(S::splat(2.0), dot::<S>(a, b), S::splat(2.0));
    let is_there = S::lt(S::splat(1e-12), square);
    S::select(is_there, one / S::sqrt(S::select(is_there, square, one)), zero)
}

/// Scalar product.
#[inline(always)]
pub fn dot<S: Simd>(a: &[S::F; 3], b: &[S::F; 3]) -> S::F {
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
            highlight: Highlight::new(lighting.shininess),
            whole_half: whole_half_of(lighting.shininess),
            noise: 0.0,
        }
    }

    /// The lighting for stored numbers that may be off by this much, each: a difference by twice that.
    #[must_use]
    pub fn with_rounded_values(self, rounding: f32) -> Self {
        let lengths = self.world_from_differences.map(|column| Vec3::from_array(column).length());
        Self { noise: 2.0 * rounding * lengths.iter().sum::<f32>(), ..self }
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

    /// The part's colour after shading, and its error, from the light at its beginning, middle and end; `cubic` is the
    /// cubic coefficient of the gradient.
    #[inline(always)]
    pub fn shade<S: Simd>(&self, part: &Part<S>, along: &[LightAt<S>; 3], cubic: &[S::F; 3]) -> Shaded<S> {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let opacity = one - part.transmittance;
        let (diffuse, specular) = (for_three!(i => along[i].diffuse), for_three!(i => along[i].specular));
        let [mean_diffuse, mean_specular] = [simpson::<S>(diffuse), simpson::<S>(specular)];
        let [rise, rise_of_specular] = [diffuse[2] - diffuse[0], specular[2] - specular[0]];
        let of_specular = S::mul_add(part.moments[0], rise_of_specular, opacity * mean_specular);
        let mut color = for_three!(c => {
            S::mul_add(part.color[c], mean_diffuse, S::mul_add(part.moments[c + 1], rise, of_specular))
        });
        let turn = Turn::<S>::along(along, cubic, self.floors());
        let lit = self.light_between::<S>(along, &turn);
        // What three places miss, by a density that is linear.
        let strongest = greatest_of::<S>(part.color);
        let moment = greatest_of::<S>(for_three!(c => S::abs(part.moments[c + 1])));
        let of_diffuse = self.error_of_diffuse::<S>(along, &turn, [strongest, moment]);
        let moment_of_opacity = S::abs(part.moments[0]);
        let of_highlight = S::mul_add(opacity, lit.highlight.missed, moment_of_opacity * lit.highlight.of_moment);
        let of_place = of_diffuse + of_highlight * S::splat(self.lighting.specular * self.light);
        let of_place = S::mul_add(part.misplaced, lit.change, of_place);
        let of_place = S::select(turn.is_dark, zero, S::select(turn.is_known, of_place, one));
        let of_cut = self.cut::<S>(part, &lit, &mut color);
        let of_part = part.error * lit.gain();
        let mut error = S::min(of_place + of_cut, opacity) + of_part;
        let mut rounding = zero;
        if self.has_noise() {
            rounding = opacity * self.light_of_noise::<S>(turn.inverse);
            error = error + rounding;
        }
        Shaded { color, error, of_part, rounding }
    }

    /// Whether gradients are off because values are rounded.
    #[inline(always)]
    pub fn has_noise(&self) -> bool {
        self.noise > 0.0
    }

    /// Light that the noise of a gradient may change, whose inverse length is at most this: the normal turns by at most twice the share
    /// of the noise.
    #[inline(always)]
    pub fn light_of_noise<S: Simd>(&self, inverse: S::F) -> S::F {
        let one = S::splat(1.0);
        let [_, diffuse, specular] = self.strengths();
        // The steepest slope of a power of a cosine is at most the root of the exponent; of exponents below 1 it has no limit.
        let shininess = self.lighting.shininess;
        let steepest = if shininess < 1.0 { VERTICAL } else { shininess.sqrt() };
        let angle = S::splat(2.0 * self.noise) * inverse;
        let highlight = S::min(angle * S::splat(steepest), one) * S::splat(specular);
        S::min(S::mul_add(angle, S::splat(diffuse), highlight), one)
    }

    /// Bounds of the light anywhere between three positions.
    #[inline(always)]
    fn light_between<S: Simd>(&self, along: &[LightAt<S>; 3], turn: &Turn<S>) -> LightBetween<S> {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let [ambient, diffuse, specular] = self.strengths().map(S::splat);
        // No place is further from one of the three than a quarter.
        let [first, second, ..] = turn.anywhere;
        let angle = S::splat(0.25) * first;
        // Nor is a cosine further from the line between two of them.
        let reach = S::min(angle, second * S::splat(1.0 / 32.0));
        let nearest = greatest_of::<S>(for_three!(i => along[i].nearest));
        let nearest = S::min(nearest_within::<S>(nearest, angle), S::max(nearest + reach, S::splat(LEAST_COSINE)));
        let [power] = self.highlights::<S, 1>([nearest * nearest]);
        let highlight = self.highlight.along::<S>(turn, nearest, power);
        let (seen, shine) = (for_three!(i => along[i].diffuse), for_three!(i => along[i].specular));
        let most = S::min(S::mul_add(reach, diffuse, greatest_of::<S>(seen)), ambient + diffuse);
        let least = S::max(S::mul_add(zero - reach, diffuse, least_of::<S>(seen)), ambient);
        let dimmer = S::splat(0.25) * highlight.first * specular;
        let least_shine = S::max(least_of::<S>(shine) - dimmer, zero);
        // Without a normal there is the colour itself.
        let unknown = [[S::min(ambient, one), S::max(ambient + diffuse, one)], [zero, specular]];
        LightBetween {
            diffuse: turn.choose([least, most], unknown[0], one),
            specular: turn.choose([least_shine, power * specular], unknown[1], zero),
            change: S::mul_add(turn.mean_first, diffuse, highlight.mean_first * specular),
            highlight,
        }
    }

    /// Ambient, diffuse and specular light, of all lights together.
    #[inline(always)]
    pub fn strengths(&self) -> [f32; 3] {
        [self.lighting.ambient, self.lighting.diffuse * self.light, self.lighting.specular * self.light]
    }

    /// Error of the diffuse light by three places, for a density with this sum and this moment.
    #[inline(always)]
    fn error_of_diffuse<S: Simd>(&self, along: &[LightAt<S>; 3], turn: &Turn<S>, [sum, moment]: [S::F; 2]) -> S::F {
        let zero = S::splat(0.0);
        let [first, second, third, _] = turn.anywhere;
        let of_moment = S::min(third * S::splat(OF_THIRD), second * S::splat(1.0 / 16.0));
        let smooth = S::mul_add(sum, turn.missed(), moment * of_moment);
        let any = first * S::mul_add(sum, S::splat(OF_FIRST), moment * S::splat(0.5));
        let mut error = zero;
        for (to_light, intensity) in &self.lighting.lights {
            let to_light = [S::splat(to_light.x), S::splat(to_light.y), S::splat(to_light.z)];
            let cosines = for_three!(i => dot::<S>(&along[i].gradient, &to_light) * along[i].inverse_length);
            // Between two places the cosine is off their line by at most an eighth of the square of the way.
            let bow = second * S::splat(1.0 / 32.0);
            let [low, high] = [least_of::<S>(cosines) - bow, greatest_of::<S>(cosines) + bow];
            // The part of it that may lie on the other side.
            let over = S::max(S::min(zero - low, high), zero);
            let kinked = S::min(S::mul_add(over + over, sum + moment, smooth), any);
            let of_light = S::select(S::lt(zero, over), kinked, smooth);
            error = S::mul_add(of_light, S::splat(self.lighting.diffuse * intensity), error);
        }
        error
    }

    /// Distance of `|n.l|` from its line on each side of a place, in the mean, where n.l changes its sign within this reach; weighted by the
    /// diffuse light.
    #[inline(always)]
    pub fn kinks<S: Simd>(&self, at: &LightAt<S>, reach: S::F) -> S::F {
        let zero = S::splat(0.0);
        let mut sum = zero;
        for (to_light, intensity) in &self.lighting.lights {
            let to_light = [S::splat(to_light.x), S::splat(to_light.y), S::splat(to_light.z)];
            let cosine = S::abs(dot::<S>(&at.gradient, &to_light) * at.inverse_length);
            let beyond = S::max(reach - cosine, zero);
            sum = S::mul_add(beyond, S::splat(0.5 * self.lighting.diffuse * intensity), sum);
        }
        sum
    }

    /// Cuts colours off at 1; returns the error of doing so after averaging.
    #[inline(always)]
    fn cut<S: Simd>(&self, part: &Part<S>, lit: &LightBetween<S>, color: &mut [S::F; 3]) -> S::F {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let opacity = one - part.transmittance;
        let per_opacity = one / S::max(opacity, S::splat(f32::MIN_POSITIVE));
        let plain = for_three!(c => part.color[c] * per_opacity);
        let strongest = S::min(greatest_of::<S>(plain) + part.colors, one);
        let goes_over = S::lt(one, S::mul_add(strongest, lit.diffuse[1], lit.specular[1]));
        if S::bits(goes_over) == 0 {
            return zero;
        }
        let mut error = zero;
        for c in 0..3 {
            let least = S::mul_add(S::max(plain[c] - part.colors, zero), lit.diffuse[0], lit.specular[0]);
            let most = S::mul_add(S::min(plain[c] + part.colors, one), lit.diffuse[1], lit.specular[1]);
            let of_channel = S::max(S::min(most - one, one - least), zero);
            error = S::max(error, of_channel);
            color[c] = S::min(S::select(S::lt(one, least), opacity, color[c]), opacity);
        }
        error * opacity
    }

    /// Lengths of a gradient below which there certainly is no normal, and above which there is one.
    #[inline(always)]
    pub fn floors(&self) -> [f32; 2] {
        let floor = self.floor();
        [floor - self.noise, floor + self.noise]
    }

    /// Length of a gradient below which there is no normal.
    #[inline(always)]
    pub fn floor(&self) -> f32 {
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

/// A part after shading.
pub struct Shaded<S: Simd> {
    /// Premultiplied colour.
    pub color: [S::F; 3],
    /// Bound on the error of colour and opacity, and what of it does not come from the light.
    pub error: S::F,
    pub of_part: S::F,
    /// Share of the error that rounded values make of the light.
    pub rounding: S::F,
}

/// Bounds of the light along a part.
struct LightBetween<S: Simd> {
    /// Least and greatest D.
    diffuse: [S::F; 2],
    /// Least and greatest S.
    specular: [S::F; 2],
    /// Change of D and S together over the part, there and back.
    change: S::F,
    highlight: HighlightBounds<S>,
}

impl<S: Simd> LightBetween<S> {
    /// Bound on the light of a colour and an opacity that are off by 1 each; not below 1, for opacity itself is not lit.
    #[inline(always)]
    pub fn gain(&self) -> S::F {
        S::max(self.diffuse[1] + self.specular[1], S::splat(1.0))
    }
}

/// Greatest cosine within an angle of a direction with this one; not below [`LEAST_COSINE`], and at most 1.
#[inline(always)]
pub fn nearest_within<S: Simd>(cosine: S::F, angle: S::F) -> S::F {
    let one = S::splat(1.0);
    let cosine = S::min(cosine, one);
    let sine = S::sqrt(S::max(one - cosine * cosine, S::splat(0.0)));
    S::min(S::max(S::mul_add(angle, sine, cosine), S::splat(LEAST_COSINE)), one)
}

/// Mean of a quadratic from its values at the beginning, the middle and the end.
#[inline(always)]
fn simpson<S: Simd>([first, middle, last]: [S::F; 3]) -> S::F {
    S::mul_add(middle, S::splat(4.0 / 6.0), (first + last) * S::splat(1.0 / 6.0))
}

#[inline(always)]
pub fn greatest_of<S: Simd>(f: [S::F; 3]) -> S::F {
    S::max(S::max(f[0], f[1]), f[2])
}

#[inline(always)]
pub fn least_of<S: Simd>(f: [S::F; 3]) -> S::F {
    S::min(S::min(f[0], f[1]), f[2])
}
