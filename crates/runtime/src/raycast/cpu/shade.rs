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

use super::fetch::Around;
use super::integrate::Part;
use super::packet::Lanes;
use super::pending::{RefineQueue, RoundParts};
use super::queue::Queue;
use super::simd::{LANES_LIMIT, Simd, Task, exp_minus, for_three, minus_ln};
use super::walk::{PacketBrick, ROUND};
use crate::raycast::scalar::shade::Lighting;

/// Share of f's second difference that its mean may be off by: 1/6 for a kink at the worst place, 1/50 where f is smooth.
const BEND_SHARE: f32 = 0.25;
/// Share of f's range that its mean may be off by, for a colour that varies by 1.
const COLOR_SHARE: f32 = 0.15;
/// Share of what is cut off at 1 that the mean may be off by where colour varies.
const CUT_SHARE: f32 = 0.25;
/// Share of the diffuse light that its mean may be off by, for a normal that turns by one radian; falls with the square.
const TURN_SHARE: f32 = 0.1;
/// Share of the highlights that their mean may be off by, where the square of the turn is the shininess's inverse: that is
/// how wide a highlight is. Falls with the fourth power.
const HIGHLIGHT_SHARE: f32 = 0.006;
/// Greatest whole half of a shininess that is reached by multiplications.
const WHOLE_LIMIT: u32 = 128;
/// Least square of |n.h|: a normal `f32`.
const LEAST_SQUARE: f32 = 1e-37;

/// Numbers of a cell beside those of all: position of its beginning, and of its part the colour, optical depth, front
/// share and misplaced share.
pub type ShadeQueue = Queue<{ (ROUND + 1) * LANES_LIMIT }, 10>;

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
    light: f32,
    /// Most that a colour can be multiplied by.
    gain: f32,
    /// Half the shininess, where that is a whole number that multiplications reach sooner than a logarithm.
    whole_half: Option<u32>,
}

/// A gradient in world space at the beginning, the middle and the end of a part.
pub type Gradients<S> = [[<S as Simd>::F; 3]; 3];

/// A matrix, by columns, times a vector.
#[inline(always)]
fn transform<S: Simd>(columns: &[[f32; 3]; 3], v: [S::F; 3]) -> [S::F; 3] {
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
    gradient: [S::F; 3],
    /// 0 where there is no normal.
    inverse_length: S::F,
    /// D and S.
    diffuse: S::F,
    specular: S::F,
}

impl<S: Simd> LightAt<S> {
    /// Dark.
    #[inline(always)]
    pub fn nothing() -> Self {
        let zero = S::splat(0.0);
        Self { gradient: [zero; 3], inverse_length: zero, diffuse: zero, specular: zero }
    }

    /// Where the mask holds `other`.
    #[inline(always)]
    pub fn replace(&mut self, mask: S::M, other: &Self) {
        self.gradient = for_three!(a => S::select(mask, other.gradient[a], self.gradient[a]));
        self.inverse_length = S::select(mask, other.inverse_length, self.inverse_length);
        self.diffuse = S::select(mask, other.diffuse, self.diffuse);
        self.specular = S::select(mask, other.specular, self.specular);
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
    /// it varies evenly, on the chord through a sphere.
    #[inline(always)]
    fn without_normal(a: &Self, b: &Self, floor: f32) -> S::F {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let (aa, ab) = (dot::<S>(&a.gradient, &a.gradient), dot::<S>(&a.gradient, &b.gradient));
        let bb = dot::<S>(&b.gradient, &b.gradient);
        let way = S::max(S::mul_add(S::splat(-2.0), ab, aa + bb), S::splat(f32::MIN_POSITIVE));
        // Twice as wide, since it does not vary quite evenly.
        let floor = S::splat(2.0 * floor);
        let nearest = S::max(S::mul_add(aa, bb, zero - ab * ab), zero) / way;
        let is_passed = S::lt(ab, aa) & S::lt(ab, bb) & S::lt(nearest, floor * floor);
        S::select(is_passed, S::min(floor / S::sqrt(way), one), zero)
    }

    /// A colour after shading.
    #[inline(always)]
    fn of(&self, color: S::F) -> S::F {
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

    /// The light where the gradient is this, seen from there.
    #[inline(always)]
    pub fn at<S: Simd>(&self, gradient: [S::F; 3], to_eye: &[S::F; 3]) -> LightAt<S> {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let lighting = self.lighting;
        let floor = S::splat(self.floor());
        let length = S::sqrt(dot::<S>(&gradient, &gradient));
        let has_normal = S::le(floor, length);
        let inverse_length = S::select(has_normal, one / S::max(length, floor), zero);
        let against_ray = dot::<S>(&gradient, to_eye);
        let (mut diffuse, mut specular) = (S::splat(lighting.ambient), zero);
        for (to_light, intensity) in &lighting.lights {
            let to_light = [S::splat(to_light.x), S::splat(to_light.y), S::splat(to_light.z)];
            // |l + v|^2 = 2 + 2 l.v.
            let square = S::mul_add(S::splat(2.0), dot::<S>(&to_light, to_eye), S::splat(2.0));
            let has_half = S::lt(S::splat(1e-12), square);
            let per_half = S::select(has_half, one / S::sqrt(S::select(has_half, square, one)), zero);
            let along_light = dot::<S>(&gradient, &to_light);
            let cosine = S::abs(along_light * inverse_length);
            diffuse = S::mul_add(cosine, S::splat(lighting.diffuse * intensity), diffuse);
            let along_half = (along_light + against_ray) * (per_half * inverse_length);
            let power = self.highlight::<S>(S::min(along_half * along_half, one));
            specular = S::mul_add(power, S::splat(lighting.specular * intensity), specular);
        }
        LightAt {
            gradient,
            inverse_length,
            diffuse: S::select(has_normal, diffuse, one),
            specular: S::select(has_normal, specular, zero),
        }
    }

    /// The part's colour after shading, and its error, from the light at its beginning, middle and end.
    #[inline(always)]
    pub fn shade<S: Simd>(&self, part: &Part<S>, along: &[LightAt<S>; 3]) -> ([S::F; 3], S::F) {
        let one = S::splat(1.0);
        let opacity = one - part.transmittance;
        let per_opacity = one / S::max(opacity, S::splat(f32::MIN_POSITIVE));
        let mut color = part.color;
        let mut of_place = S::splat(0.0);
        for c in 0..3 {
            let plain = part.color[c] * per_opacity;
            let f = for_three!(i => along[i].of(plain));
            let (mean, error) = mean_of_channel::<S>(part, f);
            color[c] = opacity * mean;
            of_place = S::max(of_place, error);
        }
        let of_place = S::max(of_place, self.error_of_sides::<S>(along)) + self.error_of_turn::<S>(along);
        (color, S::mul_add(opacity, S::min(of_place, one), part.error * S::splat(self.gain)))
    }

    /// What three places can miss of the light between them: a highlight where the normal turns, and a gradient that is too
    /// short for a normal.
    #[inline(always)]
    fn error_of_turn<S: Simd>(&self, along: &[LightAt<S>; 3]) -> S::F {
        let lighting = self.lighting;
        let mut turn = S::splat(0.0);
        let mut flat = turn;
        for [a, b] in [[0, 1], [1, 2]] {
            let of_pair = LightAt::turn(&along[a], &along[b]);
            turn = turn + of_pair;
            flat = flat + LightAt::without_normal(&along[a], &along[b], self.floor());
        }
        let widths = turn * S::splat(lighting.shininess);
        let highlight = S::min(widths * widths * S::splat(HIGHLIGHT_SHARE), S::splat(1.0));
        let of_highlight = highlight * S::splat(lighting.specular * self.light);
        let of_turn = S::mul_add(turn * turn, S::splat(TURN_SHARE * lighting.diffuse * self.light), of_highlight);
        S::mul_add(flat, S::splat(self.gain), of_turn)
    }

    /// What the second difference can miss of diffuse light of which one side goes over into the other between two places:
    /// in the middle, nothing is left.
    #[inline(always)]
    fn error_of_sides<S: Simd>(&self, along: &[LightAt<S>; 3]) -> S::F {
        let zero = S::splat(0.0);
        let mut error = zero;
        for (to_light, intensity) in &self.lighting.lights {
            let to_light = [S::splat(to_light.x), S::splat(to_light.y), S::splat(to_light.z)];
            let cosines = for_three!(i => dot::<S>(&along[i].gradient, &to_light) * along[i].inverse_length);
            for [a, b] in [[0, 1], [1, 2]] {
                // The triangles between |cosine| and the line over it, if the cosine itself is a line: of half the part.
                let product = S::max(zero - cosines[a] * cosines[b], zero);
                let sum = S::max(S::abs(cosines[a] - cosines[b]), S::splat(f32::MIN_POSITIVE));
                error = S::mul_add(product / sum, S::splat(0.5 * self.lighting.diffuse * intensity), error);
            }
        }
        error
    }

    /// Length of a gradient below which there is no normal.
    #[inline(always)]
    fn floor(&self) -> f32 {
        self.lighting.gradient_floor.max(f32::MIN_POSITIVE.sqrt())
    }

    /// |n.h| to the power of the shininess, from its square, at most 1.
    #[inline(always)]
    fn highlight<S: Simd>(&self, square: S::F) -> S::F {
        let Some(mut left) = self.whole_half else {
            return exp_minus::<S>(
                minus_ln::<S>(S::max(square, S::splat(LEAST_SQUARE))) * S::splat(0.5 * self.lighting.shininess),
            );
        };
        let (mut power, mut factor) = (S::splat(1.0), square);
        while left > 1 {
            if left & 1 == 1 {
                power = power * factor;
            }
            factor = factor * factor;
            left >>= 1;
        }
        power * factor
    }
}

/// The mean of a channel over a part, cut off at 1, from its values at the three places, and what they can miss of it: the
/// light does not vary evenly, it bends, or it is cut off where the colour varies.
#[inline(always)]
fn mean_of_channel<S: Simd>(part: &Part<S>, uncut: [S::F; 3]) -> (S::F, S::F) {
    let (zero, one, third) = (S::splat(0.0), S::splat(1.0), S::splat(1.0 / 3.0));
    let f = for_three!(i => S::min(uncut[i], one));
    let ends = S::mul_add(part.front_share, f[0] - f[2], f[2]);
    let mean = (ends + f[1] + f[1]) * third;
    let bend = S::abs((f[0] - f[1]) + (f[2] - f[1]));
    let range = S::max(S::max(f[0], f[2]), f[1]) - S::min(S::min(f[0], f[2]), f[1]);
    let uneven = S::mul_add(part.colors, S::splat(COLOR_SHARE), part.misplaced);
    let half = part.colors * S::splat(0.5);
    let low = S::min(S::min(uncut[0], uncut[2]), uncut[1]) - half;
    let high = S::max(S::max(uncut[0], uncut[2]), uncut[1]) + half;
    let cut = S::select(S::lt(low, one), S::min(S::max(high - one, zero), part.colors), zero);
    (mean, S::mul_add(S::splat(BEND_SHARE), bend, S::mul_add(range, uneven, cut * S::splat(CUT_SHARE))))
}

/// Shades the cells of a round that show something.
pub struct ShadeCells<'a> {
    /// Where the voxels are.
    pub brick: &'a PacketBrick<'a>,
    /// The brick's.
    pub lighting: &'a PacketLighting<'a>,
    /// Rays of the packet.
    pub lanes: &'a Lanes,
    /// The cells; none are left.
    pub cells: &'a mut ShadeQueue,
    /// Cells that one rule does not settle.
    pub unsettled: &'a mut RefineQueue,
    /// Where colours go.
    pub parts: &'a mut RoundParts,
}

/// The gradient along the rays through some cells.
#[derive(Clone, Copy)]
struct AlongRay<S: Simd> {
    gradients: Gradients<S>,
    /// Coefficients of the third power.
    cubics: [S::F; 3],
    /// Beside a hole there is no gradient.
    is_unknown: S::M,
}

/// Packets of cells that are taken through one stage, and then through the next: stages are short, so that the processor
/// overlaps several packets.
const GROUP: usize = ROUND;

impl Task for ShadeCells<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self) {
        let zero = S::splat(0.0);
        let nothing = AlongRay { gradients: [[zero; 3]; 3], cubics: [zero; 3], is_unknown: S::lt(zero, zero) };
        for group in (0..self.cells.len()).step_by(GROUP * S::LANES) {
            let mut along = [nothing; GROUP];
            let end = self.cells.len().min(group + GROUP * S::LANES);
            for (i, first) in (group..end).step_by(S::LANES).enumerate() {
                self.gradients::<S>(first, &mut along[i]);
            }
            for (i, first) in (group..end).step_by(S::LANES).enumerate() {
                self.shade::<S>(first, &along[i]);
            }
        }
        self.cells.clear();
    }
}

impl ShadeCells<'_> {
    /// Gathers around the cells from number `first` on.
    #[inline(always)]
    fn gradients<S: Simd>(&self, first: usize, along: &mut AlongRay<S>) {
        let (brick, lighting) = (self.brick, self.lighting);
        let cell = self.cells.cells::<S>(first);
        // What lies behind the last cell may be the offset of another brick's cell.
        let base = S::select_int(self.cells.used::<S>(first), cell.base, S::splat_int(brick.first_base()));
        let around = Around::<S> { stored: brick.stored, voxels: brick.voxels, base, absent: brick.absent };
        // SAFETY: the bases are those of cells of the core.
        let slopes = unsafe { around.slopes(brick.strides) };
        let fraction = self.cells.three::<S>(0, first);
        let direction = self.lanes.direction::<S>(cell.slot);
        let travelled = for_three!(a => direction[a] * cell.chord.length);
        for (gradient, share) in along.gradients.iter_mut().zip([0.0, 0.5, 1.0]) {
            let at = for_three!(a => S::mul_add(travelled[a], S::splat(share), fraction[a]));
            let differences = for_three!(a => slopes[a].at(at));
            *gradient = transform::<S>(&lighting.world_from_differences, differences);
        }
        let volume = travelled[0] * travelled[1] * travelled[2];
        let twists = for_three!(a => slopes[a].twist() * volume);
        along.cubics = transform::<S>(&lighting.world_from_differences, twists);
        let middle = along.gradients[1];
        along.is_unknown = S::is_nan(middle[0] + middle[1] + middle[2]);
        for gradient in along.gradients.iter_mut().chain([&mut along.cubics]) {
            for a in 0..3 {
                gradient[a] = S::select(along.is_unknown, S::splat(0.0), gradient[a]);
            }
        }
    }

    /// Shades the cells from number `first` on; what three places do not settle goes on to refinement.
    #[inline(always)]
    fn shade<S: Simd>(&mut self, first: usize, along: &AlongRay<S>) {
        let mut cell = self.cells.cells::<S>(first);
        let [tau, front_share, misplaced] = self.cells.three::<S>(6, first);
        let part = Part {
            color: self.cells.three::<S>(3, first),
            tau,
            transmittance: exp_minus::<S>(tau),
            error: cell.error,
            front_share,
            misplaced,
            colors: self.cells.one::<S>(9, first),
        };
        let to_eye = self.lanes.toward_eye::<S>(self.lighting, cell.slot);
        let lit = for_three!(i => self.lighting.at::<S>(along.gradients[i], &to_eye));
        let (shaded, error) = self.lighting.shade::<S>(&part, &lit);
        // Rays for which the hole beside them has no weight have a gradient after all.
        let is_in_plane = S::lt(S::splat(0.0), S::lookup16(&self.lanes.in_plane, cell.slot));
        cell.error = S::select(along.is_unknown & is_in_plane, S::splat(f32::NAN), error);
        let ([r, g, b], count) = (shaded, (self.cells.len() - first).min(S::LANES));
        self.parts.write_colors::<S>(cell.slot, count, [r, g, b, cell.error]);
        let per_error = S::lookup16(&self.lanes.per_error, cell.slot);
        // Also NaN.
        let is_unsettled = !S::le(cell.error * per_error, S::splat(1.0)) & self.cells.used::<S>(first);
        if S::bits(is_unsettled) != 0 {
            let [[a, b, c], [d, e, f], [g, h, i]] = along.gradients;
            let [j, k, l] = along.cubics;
            self.unsettled.push::<S, 12>(is_unsettled, &cell, [a, b, c, d, e, f, g, h, i, j, k, l]);
        }
    }
}
