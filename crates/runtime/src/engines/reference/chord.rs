//! The part of a ray in one trilinear cell: field and gradient are cubics there.
//!
//! The interpolant of a cell is linear in each coordinate, and these are linear along a ray. Central differences one
//! voxel apart interpolate the differences at the corners: so each component of the gradient is a cubic as well. The
//! cubics are those through four samples of the definition. Their parameter v runs from -1/2 to 1/2.
//!
//! With opacity by the gradient, the squared length of the gradient is a polynomial of degree 6. Extinction has kinks where it
//! passes the squared ends of the ramp, and may turn sharply where it is least. All these places are found, and cut the chord.
//! Behind a cut face that is lit by its own normal, both lights are mixed, by a weight that is linear between two more cuts.

use std::ops::{Add, Mul, Sub};

use glam::{BVec3, DMat3, DVec3};
use supervol_format::cast::whole;
use supervol_scene::clip::IndexRay;
use supervol_scene::clip::faces::{CutFace, CutNormals};
use supervol_scene::scene::{GradientOpacity, Shading};
use supervol_scene::transfer_function::{ALPHA_LIMIT, TransferFunction};

use super::integral::Light;
use super::{ReferenceVolume, bisect, interpolated, unlimited_light};

/// The parameter's interval.
const ENDS: [f64; 2] = [-0.5, 0.5];
/// Parameters of the samples that define a cubic. None is an end, where the neighbouring cell begins.
const PLACES: [f64; 4] = [-0.375, -0.125, 0.125, 0.375];
/// Largest turn of the normal along an interval, as a length, for wide highlights. For narrow ones the shininess
/// reduces it.
const NORMAL_CHANGE: f64 = 0.5;
/// Shininess of such wide highlights.
const WIDE_SHININESS: f64 = 4.0;
/// Intervals of a chord that are searched for colours that reach 1.
const LIMIT_SAMPLES: usize = 8;
/// Samples of an interval that show whether a colour may reach 1 between them.
const HIDDEN_SAMPLES: usize = 5;
/// Greatest excess of a parabola's top over five samples, in parts of their range: 0.11 for a top in the worst place.
const HIDDEN_SHARE: f64 = 0.25;

/// A cubic: coefficients of 1, v, v^2, v^3.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cubic<V>([V; 4]);

impl<V: Copy + Add<Output = V> + Sub<Output = V> + Mul<f64, Output = V>> Cubic<V> {
    /// The cubic through values at [`PLACES`]. Equal values give exactly a constant.
    fn through([a, b, c, d]: [V; 4]) -> Self {
        // Even and odd parts: c0 + c2 v^2 and c1 v + c3 v^3, at v = 1/8 and 3/8.
        let (even_near, even_far) = ((b + c) * 0.5, (a + d) * 0.5);
        let (odd_near, odd_far) = ((c - b) * 0.5, (d - a) * 0.5);
        let square = (even_far - even_near) * 8.0;
        let cube = (odd_far - odd_near * 3.0) * (64.0 / 3.0);
        Self([even_near - square * (1.0 / 64.0), odd_near * 8.0 - cube * (1.0 / 64.0), square, cube])
    }

    /// Value.
    pub(super) fn at(&self, v: f64) -> V {
        let [a, b, c, d] = self.0;
        a + (b + (c + d * v) * v) * v
    }

    /// Derivatives: first, second, third.
    fn derivatives(&self, v: f64) -> [V; 3] {
        let [_, b, c, d] = self.0;
        [b + (c * 2.0 + d * (3.0 * v)) * v, c * 2.0 + d * (6.0 * v), d * 6.0]
    }
}

impl Cubic<f64> {
    /// Ends of the intervals in which the cubic is monotone, ascending.
    fn monotone_ends(&self) -> Vec<f64> {
        let [_, b, c, d] = self.0;
        let mut ends = ENDS.to_vec();
        // Roots of b + 2 c v + 3 d v^2, in the form that subtracts no equal numbers.
        let discriminant = c * c - 3.0 * d * b;
        if discriminant > 0.0 {
            let q = -(c + discriminant.sqrt().copysign(c));
            ends.extend([q / (3.0 * d), b / q].into_iter().filter(|v| ENDS[0] < *v && *v < ENDS[1]));
        }
        ends.sort_by(f64::total_cmp);
        ends
    }

    /// Adds the places at which a level is crossed; its own value counts as above it.
    fn add_roots(&self, ends: &[f64], level: f64, places: &mut Vec<f64>) {
        for end in ends.windows(2) {
            let before = self.at(end[0]) >= level;
            if before != (self.at(end[1]) >= level) {
                places.push(bisect(end[0], end[1], |v| (self.at(v) >= level) == before));
            }
        }
    }
}

/// Coefficients of the squared length of a gradient: of 1, v, ..., v^6.
fn squared_length(gradient: &Cubic<DVec3>) -> Vec<f64> {
    let mut square = vec![0.0; 2 * gradient.0.len() - 1];
    for (i, a) in gradient.0.iter().enumerate() {
        for (j, b) in gradient.0.iter().enumerate() {
            square[i + j] += a.dot(*b);
        }
    }
    square
}

/// Value of a polynomial, coefficients of the lowest power first.
fn polynomial_at(coefficients: &[f64], v: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * v + c)
}

/// Coefficients of a polynomial's derivative.
fn derivative(coefficients: &[f64]) -> Vec<f64> {
    coefficients.iter().enumerate().skip(1).map(|(power, c)| power as f64 * c).collect()
}

/// Ends of the intervals in which a polynomial is monotone, ascending: found from those of its derivative.
fn monotone_ends(coefficients: &[f64]) -> Vec<f64> {
    let slope = derivative(coefficients);
    if slope.is_empty() {
        return ENDS.to_vec();
    }
    let mut ends = ENDS.to_vec();
    add_crossings_of(&slope, &monotone_ends(&slope), 0.0, &mut ends);
    ends.sort_by(f64::total_cmp);
    ends
}

/// Adds the places at which a polynomial passes a level; `ends` are those of its monotone intervals.
fn add_crossings_of(coefficients: &[f64], ends: &[f64], level: f64, places: &mut Vec<f64>) {
    for end in ends.windows(2) {
        let is_above = |v: f64| polynomial_at(coefficients, v) >= level;
        let before = is_above(end[0]);
        if before != is_above(end[1]) {
            places.push(bisect(end[0], end[1], |v| is_above(v) == before));
        }
    }
}

/// Scene of all chords of a picture.
#[derive(Debug)]
pub(super) struct ChordScene<'a> {
    pub(super) transfer_function: &'a TransferFunction,
    pub(super) shading: Option<&'a Shading>,
    gradient_opacity: Option<GradientOpacity>,
    cut_normals: Option<&'a CutNormals>,
    pub(super) world_from_index_gradient: DMat3,
    pub(super) gradient_floor: f64,
    /// Values at which the transfer function bends or steps, ascending.
    kinks: Vec<f64>,
}

impl<'a> ChordScene<'a> {
    pub(super) fn new(
        transfer_function: &'a TransferFunction,
        shading: Option<&'a Shading>,
        (gradient_opacity, cut_normals): (Option<GradientOpacity>, Option<&'a CutNormals>),
        (world_from_index_gradient, gradient_floor): (DMat3, f64),
    ) -> Self {
        let points = transfer_function.points();
        let mut kinks: Vec<f64> = points.iter().map(|point| point.value).collect();
        // Extinction stays even where alpha exceeds its limit.
        for pair in points.windows(2) {
            let share = (ALPHA_LIMIT - pair[0].alpha) / (pair[1].alpha - pair[0].alpha);
            if share > 0.0 && share < 1.0 {
                kinks.push(pair[0].value + share * (pair[1].value - pair[0].value));
            }
        }
        kinks.sort_by(f64::total_cmp);
        Self {
            transfer_function,
            shading,
            gradient_opacity,
            cut_normals,
            world_from_index_gradient,
            gradient_floor,
            kinks,
        }
    }
}

/// The chord of a ray in a cell.
pub(super) struct Chord<'a> {
    scene: &'a ChordScene<'a>,
    value: Cubic<f64>,
    /// World gradient; `None`: unknown, or of no use.
    gradient: Option<Cubic<DVec3>>,
    /// The cut face in front of the chord, if it lights some of it.
    face: Option<FaceInFront<'a>>,
    to_eye: DVec3,
    length: f64,
}

/// A cut face in front of a chord.
struct FaceInFront<'a> {
    cuts: &'a CutNormals,
    normal: DVec3,
    /// Length from the face to the chord's middle.
    behind: f64,
    /// Length of the chord.
    length: f64,
}

impl FaceInFront<'_> {
    /// Weight of the light by the face's normal.
    fn weight(&self, v: f64) -> f64 {
        self.cuts.weight(self.behind + v * self.length)
    }

    /// Places at which the weight has a kink.
    fn kinks(&self) -> impl Iterator<Item = f64> {
        let place = |depth: f64| (depth - self.behind) / self.length;
        self.cuts.depths.map(place).into_iter().filter(|v| ENDS[0] < *v && *v < ENDS[1])
    }
}

impl<'a> Chord<'a> {
    /// The chord from t0 to t1, which lies in one cell, behind this cut face; `None` if the field is absent there. `direction`
    /// is the ray's unit vector.
    pub(super) fn new(
        volume: &ReferenceVolume,
        scene: &'a ChordScene<'a>,
        (ray, face): (&IndexRay, Option<CutFace>),
        direction: DVec3,
        [t0, t1]: [f64; 2],
    ) -> Option<Self> {
        let middle = ray.at(0.5 * (t0 + t1));
        let cell = middle.map(|x| whole::<i64>(x.floor()));
        let fractions =
            PLACES.map(|v| std::array::from_fn(|a| middle[a] - middle[a].floor() + v * (t1 - t0) * ray.direction[a]));
        let cubic = |cell: [i64; 3]| {
            let corners = volume.corners(cell);
            let [a, b, c, d] = fractions.map(|place| interpolated(&corners, place));
            Some([a?, b?, c?, d?])
        };
        let value = Cubic::through(cubic(cell)?);
        let differences = |axis: usize| {
            let beside = |step: i64| {
                let mut beside = cell;
                beside[axis] = beside[axis].saturating_add(step);
                cubic(beside)
            };
            let (after, before) = (beside(1)?, beside(-1)?);
            Some([0, 1, 2, 3].map(|i| 0.5 * (after[i] - before[i])))
        };
        let gradient = || {
            let [x, y, z] = [differences(0)?, differences(1)?, differences(2)?];
            let at = |i: usize| scene.world_from_index_gradient * DVec3::new(x[i], y[i], z[i]);
            Some(Cubic::through([at(0), at(1), at(2), at(3)]))
        };
        let needs_gradient = scene.shading.is_some() || scene.gradient_opacity.is_some();
        let gradient = if needs_gradient { gradient() } else { None };
        let length = t1 - t0;
        let face = scene.cut_normals.zip(face).map(|(cuts, face)| {
            let behind = 0.5 * (t0 + t1) - face.t;
            FaceInFront { cuts, normal: face.normal, behind, length }
        });
        let face = face.filter(|face| face.weight(ENDS[0]) > 0.0);
        Some(Self { scene, value, gradient, face, to_eye: -direction, length })
    }

    /// Places at which light has a kink or a step, and both ends, ascending: crossings of s with control points,
    /// normals at right angles to a light or a highlight, colours that reach 1, and lengths of the gradient at which the
    /// extinction bends.
    pub(super) fn cuts(&self) -> Vec<f64> {
        let mut cuts = ENDS.to_vec();
        let ends = self.value.monotone_ends();
        let values = ends.iter().map(|v| self.value.at(*v));
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), s| (a.min(s), b.max(s)));
        let kinks = &self.scene.kinks;
        let first = kinks.partition_point(|kink| *kink < low);
        for kink in kinks[first..].iter().take_while(|kink| **kink <= high) {
            self.value.add_roots(&ends, *kink, &mut cuts);
        }
        if let (Some(shading), Some(gradient)) = (self.scene.shading, &self.gradient) {
            for light in &shading.lights {
                for direction in [light.to_light, light.to_light + self.to_eye] {
                    let along = Cubic(gradient.0.map(|k| k.dot(direction)));
                    along.add_roots(&along.monotone_ends(), 0.0, &mut cuts);
                }
            }
            add_limits(|v| self.unlimited(shading, gradient, v), shading, &mut cuts);
        }
        if let (Some(shading), Some(face)) = (self.scene.shading, &self.face) {
            add_limits(|v| self.unlimited_by_face(shading, face, v), shading, &mut cuts);
            cuts.extend(face.kinks());
        }
        if let (Some(ramp), Some(gradient)) = (self.scene.gradient_opacity, &self.gradient) {
            let square = squared_length(gradient);
            let ends = monotone_ends(&square);
            for level in [ramp.from, ramp.to] {
                add_crossings_of(&square, &ends, level * level, &mut cuts);
            }
            cuts.extend(ends);
        }
        cuts.sort_by(f64::total_cmp);
        cuts
    }

    /// Colour after shading, not cut off at 1.
    fn unlimited(&self, shading: &Shading, gradient: &Cubic<DVec3>, v: f64) -> DVec3 {
        let color = self.scene.transfer_function.classify(self.value.at(v)).0.into();
        self.lit(shading, gradient, color, v)
    }

    /// The same by the normal of the face in front.
    fn unlimited_by_face(&self, shading: &Shading, face: &FaceInFront<'_>, v: f64) -> DVec3 {
        let color = self.scene.transfer_function.classify(self.value.at(v)).0.into();
        unlimited_light(shading, color, face.normal, 0.0, self.to_eye)
    }

    /// Factor of extinction by the gradient. An unknown gradient counts as none.
    fn share_of_extinction(&self, v: f64) -> f64 {
        let Some(ramp) = self.scene.gradient_opacity else { return 1.0 };
        self.gradient.as_ref().map_or(0.0, |gradient| ramp.factor(gradient.at(v).length()))
    }

    fn lit(&self, shading: &Shading, gradient: &Cubic<DVec3>, color: DVec3, v: f64) -> DVec3 {
        unlimited_light(shading, color, gradient.at(v), self.scene.gradient_floor, self.to_eye)
    }

    /// Whether the normal may turn far in an interval, or there is one in some of it only. The gradient's way from the
    /// middle is at most that of its Taylor series.
    fn turns_far(&self, shading: &Shading, gradient: &Cubic<DVec3>, [begin, end]: [f64; 2]) -> bool {
        let most = NORMAL_CHANGE / (shading.shininess / WIDE_SHININESS).max(1.0).sqrt();
        let (middle, half) = (0.5 * (begin + end), 0.5 * (end - begin));
        let [first, second, third] = gradient.derivatives(middle).map(DVec3::length);
        let away = half * (first + half * (second / 2.0 + half * third / 6.0));
        let long = gradient.at(middle).length();
        let floor = self.scene.gradient_floor;
        long + away >= floor && (long - away < floor || 2.0 * away > most * (long - away))
    }
}

impl Light for Chord<'_> {
    fn at(&self, v: f64) -> (f64, DVec3) {
        let (color, alpha) = self.scene.transfer_function.classify(self.value.at(v));
        let share = self.share_of_extinction(v);
        if alpha == 0.0 || share == 0.0 {
            return (0.0, DVec3::ZERO);
        }
        let color = DVec3::from(color);
        let by_gradient = || match (self.scene.shading, &self.gradient) {
            (Some(shading), Some(gradient)) => self.lit(shading, gradient, color, v).min(DVec3::ONE),
            _ => color,
        };
        let color = match (self.scene.shading, &self.face) {
            (Some(shading), Some(face)) => {
                let by_face = unlimited_light(shading, color, face.normal, 0.0, self.to_eye).min(DVec3::ONE);
                let weight = face.weight(v);
                weight * by_face + (1.0 - weight) * by_gradient()
            }
            _ => by_gradient(),
        };
        (share * self.scene.transfer_function.kappa(alpha), color)
    }

    fn hidden(&self, interval: [f64; 2]) -> f64 {
        let Some(shading) = self.scene.shading else { return 0.0 };
        let face = self.face.as_ref();
        let by_face =
            face.map_or(0.0, |face| hidden_limit(|v| self.unlimited_by_face(shading, face, v), shading, interval));
        // The weight falls along the ray.
        let is_all_by_face = face.is_some_and(|face| face.weight(interval[1]) >= 1.0);
        match &self.gradient {
            Some(_) if is_all_by_face => by_face,
            Some(gradient) if self.turns_far(shading, gradient, interval) => 1.0,
            Some(gradient) => by_face.max(hidden_limit(|v| self.unlimited(shading, gradient, v), shading, interval)),
            None => by_face,
        }
    }

    fn scale(&self) -> f64 {
        self.length
    }
}

/// Adds places at which a channel of some light reaches 1, where it is cut off. Two of them near each other may be missed:
/// [`Light::hidden`] sees these.
fn add_limits(unlimited: impl Fn(f64) -> DVec3, shading: &Shading, cuts: &mut Vec<f64>) {
    if brightest(shading) <= 1.0 {
        return;
    }
    let is_limited = |v: f64| unlimited(v).cmpge(DVec3::ONE);
    let place = |i: usize| ENDS[0] + (ENDS[1] - ENDS[0]) * i as f64 / LIMIT_SAMPLES as f64;
    let found: [BVec3; LIMIT_SAMPLES + 1] = std::array::from_fn(|i| is_limited(place(i)));
    for (i, pair) in found.windows(2).enumerate() {
        for channel in (0..3).filter(|channel| pair[0].test(*channel) != pair[1].test(*channel)) {
            let before = pair[0].test(channel);
            cuts.push(bisect(place(i), place(i + 1), |v| is_limited(v).test(channel) == before));
        }
    }
}

/// Greatest part of some light that a channel may lose, or keep, at 1 between samples: a parabola with its top
/// between two of five places exceeds them by less than a quarter of their range.
fn hidden_limit(unlimited: impl Fn(f64) -> DVec3, shading: &Shading, [begin, end]: [f64; 2]) -> f64 {
    if brightest(shading) <= 1.0 {
        return 0.0;
    }
    let place = |i: usize| begin + (end - begin) * i as f64 / (HIDDEN_SAMPLES - 1) as f64;
    let found: [DVec3; HIDDEN_SAMPLES] = std::array::from_fn(|i| unlimited(place(i)));
    let low = found.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let high = found.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    let beyond = HIDDEN_SHARE * (high - low);
    let hidden = |channel: usize| {
        let [low, high, beyond] = [low, high, beyond].map(|of| of[channel]);
        let is_near = high <= 1.0 && high + beyond > 1.0 || low >= 1.0 && low - beyond < 1.0;
        if is_near { beyond } else { 0.0 }
    };
    hidden(0).max(hidden(1)).max(hidden(2))
}

/// Greatest light of a channel before it is cut off.
fn brightest(shading: &Shading) -> f64 {
    let of_light =
        (shading.diffuse + shading.specular) * shading.lights.iter().map(|light| light.intensity).sum::<f64>();
    shading.ambient + of_light
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubics_go_through_their_samples() {
        let expected = |v: f64| 0.7 + v * (-1.3 + v * (2.1 - 4.4 * v));
        let cubic = Cubic::through(PLACES.map(expected));
        for v in [-0.5, -0.3, 0.0, 0.25, 0.5] {
            assert!((cubic.at(v) - expected(v)).abs() < 1e-14, "{v}");
            let h = 1e-5;
            let slope = (expected(v + h) - expected(v - h)) / (2.0 * h);
            assert!((cubic.derivatives(v)[0] - slope).abs() < 1e-8, "{v}");
        }
        assert_eq!(Cubic::through([0.1; 4]).0, [0.1, 0.0, 0.0, 0.0]);
        assert_eq!(Cubic::through(PLACES.map(expected)).derivatives(0.1)[2].round(), -26.0);
    }

    #[test]
    fn a_polynomial_is_cut_at_all_turns_and_crossings() {
        // (v^2 - 0.01) (v^2 - 0.09) (v^2 - 0.16): six roots, and five turns between them.
        let roots = [-0.4, -0.3, -0.1, 0.1, 0.3, 0.4];
        let coefficients = [-0.000_144, 0.0, 0.0169, 0.0, -0.26, 0.0, 1.0];
        let ends = monotone_ends(&coefficients);
        assert_eq!(ends.len(), 7, "{ends:?}");
        let mut found = Vec::new();
        add_crossings_of(&coefficients, &ends, 0.0, &mut found);
        assert_eq!(found.len(), 6, "{found:?}");
        for (found, root) in found.iter().zip(roots) {
            assert!((found - root).abs() < 1e-9, "{found} instead of {root}");
        }
        let gradient = Cubic([DVec3::X, DVec3::Y, DVec3::ZERO, DVec3::new(0.0, 2.0, 1.0)]);
        let v: f64 = 0.3;
        let length = gradient.at(v).length_squared();
        assert!((polynomial_at(&squared_length(&gradient), v) - length).abs() < 1e-14);
        assert_eq!(monotone_ends(&[3.0]), ENDS);
    }

    #[test]
    fn every_crossing_is_found() {
        // (v + 0.4) v (v - 0.001): two crossings near each other.
        let cubic = Cubic([0.0, -0.0004, 0.399, 1.0]);
        let mut places = Vec::new();
        cubic.add_roots(&cubic.monotone_ends(), 0.0, &mut places);
        for (found, expected) in places.iter().zip([-0.4, 0.0, 0.001]) {
            assert!((found - expected).abs() < 1e-12, "{places:?}");
        }
        assert_eq!(places.len(), 3);
    }
}
