//! Single rays through the Marschner-Lobb signal, in `f64`: four rules against a converged integral.
//!
//! Lengths along rays are in voxels of the 40^3 grid, for the analytic signal too. A ray is a chord of the cube
//! [-1, 1]^3 through a random point of its inner half, in a random direction.

use glam::DVec3;
use rayon::prelude::*;
use supervol_format::cast::whole;
use supervol_format::random::Random;
use supervol_scene::transfer_function::TransferFunction;

use super::{Case, FUNCTIONS, KNOWN, OrderRow, function};
use crate::comparison::preintegration::{Attenuation, PreIntegration};
use crate::context::{ChartError, Context};
use crate::fixtures::marschner_lobb_at;
use crate::measure::order_of;

/// Names of the rules, in the order of the table.
pub(super) const RULES: [&str; 4] =
    ["left Riemann", "midpoint", "pre-integration with attenuation", "pre-integration neglecting it"];
/// Voxels of the grid along each axis.
const EDGE: usize = 40;
/// Number of rays in a set.
const SET: usize = 24;
/// Samples per voxel, from coarse to fine.
const SAMPLES_PER_VOXEL: [f64; 6] = [2.75, 5.5, 11.0, 22.0, 44.0, 88.0];
/// Intervals per voxel of the converged integral of the signal. Its error is 1/64 of the error at the finest sampling.
const CONVERGED_PER_VOXEL: f64 = 704.0;
/// Intervals of the converged integral of the interpolated field between two cell faces, where the field bends.
const CONVERGED_PER_PIECE: u32 = 400;
/// Seed of the rays.
const SEED: u64 = 24;

/// Premultiplied red, green and blue, and opacity.
type Gathered = [f64; 4];

/// Field along a ray.
enum Field {
    Analytic,
    Trilinear(Vec<f64>),
}

impl Field {
    /// ML on the grid, x fastest.
    fn sampled() -> Self {
        let at = |i: usize| {
            let index = [i % EDGE, i / EDGE % EDGE, i / EDGE / EDGE].map(|v| v as f64);
            marschner_lobb_at(DVec3::from_array(index) * (2.0 / (EDGE as f64 - 1.0)) - DVec3::ONE)
        };
        Self::Trilinear((0..EDGE * EDGE * EDGE).map(at).collect())
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Analytic => "analytic",
            Self::Trilinear(_) => "trilinear 40^3",
        }
    }

    /// Value at a point in index coordinates of the grid.
    fn at(&self, p: DVec3) -> f64 {
        let voxels = match self {
            Self::Analytic => return marschner_lobb_at(p * (2.0 / (EDGE as f64 - 1.0)) - DVec3::ONE),
            Self::Trilinear(voxels) => voxels,
        };
        let cell = p.to_array().map(|v| whole::<usize>(v.max(0.0)).min(EDGE - 2));
        let u: [f64; 3] = std::array::from_fn(|a| p[a] - cell[a] as f64);
        let mut sum = 0.0;
        for corner in 0..8 {
            let bit = [corner & 1, corner >> 1 & 1, corner >> 2];
            let weight: f64 = (0..3).map(|a| if bit[a] == 1 { u[a] } else { 1.0 - u[a] }).product();
            sum += weight * voxels[cell[0] + bit[0] + EDGE * (cell[1] + bit[1] + EDGE * (cell[2] + bit[2]))];
        }
        sum
    }
}

/// A chord in index coordinates.
#[derive(Clone, Copy)]
struct Chord {
    begin: DVec3,
    /// Unit vector.
    direction: DVec3,
    /// Voxels.
    length: f64,
}

impl Chord {
    /// A random chord, from the first to the last voxel centres of the grid.
    fn random(random: &mut Random) -> Self {
        let last = EDGE as f64 - 1.0;
        let through = DVec3::from_array(std::array::from_fn(|_| last * (0.25 + 0.5 * random.unit())));
        let direction = DVec3::from_array(random.direction());
        let (low, high) = ((DVec3::ZERO - through) / direction, (DVec3::splat(last) - through) / direction);
        let (enter, exit) = (low.min(high).max_element(), low.max(high).min_element());
        Self { begin: through + enter * direction, direction, length: exit - enter }
    }

    fn at(&self, t: f64) -> DVec3 {
        self.begin + t * self.direction
    }

    /// Ray parameters t of both ends and of all cell faces between them, ascending.
    fn faces(&self) -> Vec<f64> {
        let mut faces = vec![0.0, self.length];
        for axis in 0..3 {
            let crossing = |plane: usize| (plane as f64 - self.begin[axis]) / self.direction[axis];
            faces.extend((0..EDGE).map(crossing).filter(|t| *t > 0.0 && *t < self.length));
        }
        faces.sort_by(f64::total_cmp);
        faces
    }
}

/// A transfer function and its prefix sums.
struct Classifier {
    function: TransferFunction,
    sums: PreIntegration,
}

/// Sums of a ray, front to back.
struct Ray {
    color: [f64; 3],
    transmittance: f64,
}

impl Ray {
    const EMPTY: Self = Self { color: [0.0; 3], transmittance: 1.0 };

    fn add(&mut self, (color, opacity): ([f64; 3], f64)) {
        (0..3).for_each(|c| self.color[c] += self.transmittance * color[c]);
        self.transmittance *= 1.0 - opacity;
    }

    fn gathered(&self) -> Gathered {
        let [r, g, b] = self.color;
        [r, g, b, 1.0 - self.transmittance]
    }
}

/// Colour and opacity of an interval of length h with one sample of this value.
fn point(function: &TransferFunction, value: f64, h: f64) -> ([f64; 3], f64) {
    let (color, alpha) = function.classify(value);
    let opacity = -(-function.kappa(alpha) * h).exp_m1();
    (color.map(|c| c * opacity), opacity)
}

/// Integrals by all four rules, from the values at the ends and midpoints of equal intervals of length h.
fn by_rules(classifier: &Classifier, ends: &[f64], middles: &[f64], h: f64) -> [Gathered; 4] {
    let mut rays = [Ray::EMPTY; 4];
    for (pair, &middle) in ends.windows(2).zip(middles) {
        rays[0].add(point(&classifier.function, pair[0], h));
        rays[1].add(point(&classifier.function, middle, h));
        rays[2].add(classifier.sums.interval(pair[0], pair[1], h, Attenuation::Included));
        rays[3].add(classifier.sums.interval(pair[0], pair[1], h, Attenuation::Neglected));
    }
    rays.map(|ray| ray.gathered())
}

/// The converged integral: pre-integrated intervals, so many that any transfer function converges.
fn converged(field: &Field, chord: &Chord, classifiers: &[Classifier]) -> Vec<Gathered> {
    let pieces = match field {
        Field::Analytic => vec![0.0, chord.length],
        Field::Trilinear(_) => chord.faces(),
    };
    let mut rays: Vec<Ray> = classifiers.iter().map(|_| Ray::EMPTY).collect();
    for ends in pieces.windows(2).filter(|ends| ends[1] > ends[0]) {
        let n = match field {
            Field::Analytic => (chord.length * CONVERGED_PER_VOXEL).ceil(),
            Field::Trilinear(_) => f64::from(CONVERGED_PER_PIECE),
        };
        let h = (ends[1] - ends[0]) / n;
        let mut front = field.at(chord.at(ends[0]));
        for i in 1..=whole::<u64>(n) {
            let back = field.at(chord.at(ends[0] + i as f64 * h));
            for (ray, classifier) in rays.iter_mut().zip(classifiers) {
                ray.add(classifier.sums.interval(front, back, h, Attenuation::Included));
            }
            front = back;
        }
    }
    rays.iter().map(Ray::gathered).collect()
}

/// Error of the worst channel of one ray, by transfer function, sampling and rule.
type RayErrors = Vec<[[f64; 4]; SAMPLES_PER_VOXEL.len()]>;

fn errors_of_ray(field: &Field, chord: &Chord, classifiers: &[Classifier]) -> RayErrors {
    let exact = converged(field, chord, classifiers);
    let mut errors = vec![[[0.0; 4]; SAMPLES_PER_VOXEL.len()]; classifiers.len()];
    for (rung, samples) in SAMPLES_PER_VOXEL.iter().enumerate() {
        let n = (samples * chord.length).round().max(1.0);
        let h = chord.length / n;
        let ends: Vec<f64> = (0..=whole::<u64>(n)).map(|i| field.at(chord.at(i as f64 * h))).collect();
        let middles: Vec<f64> = (0..whole::<u64>(n)).map(|i| field.at(chord.at((i as f64 + 0.5) * h))).collect();
        for (function, classifier) in classifiers.iter().enumerate() {
            let found = by_rules(classifier, &ends, &middles, h);
            for (rule, gathered) in found.iter().enumerate() {
                let channels = gathered.iter().zip(exact[function]).map(|(a, b)| (a - b).abs());
                errors[function][rung][rule] = supervol_scene::image::greatest(channels);
            }
        }
    }
    errors
}

/// Rows of both fields.
pub(super) fn rows(context: &Context<'_>) -> Result<Vec<OrderRow>, ChartError> {
    let classifier = |name: &&str| {
        let function = function(name, 1.0).map_err(|e| ChartError::Broken(e.to_string()))?;
        Ok(Classifier { sums: PreIntegration::new(&function), function })
    };
    let classifiers: Vec<Classifier> = FUNCTIONS.iter().map(classifier).collect::<Result<_, ChartError>>()?;
    let sets = context.pick(16, 6);
    let mut random = Random::new(SEED);
    let chords: Vec<Chord> = (0..sets * SET).map(|_| Chord::random(&mut random)).collect();
    let mut rows = Vec::new();
    for (known, field) in KNOWN.iter().zip([Field::Analytic, Field::sampled()]) {
        (context.say)(&format!("orders of convergence: {} rays, {}", chords.len(), field.name()));
        let errors: Vec<RayErrors> =
            chords.par_iter().map(|chord| errors_of_ray(&field, chord, &classifiers)).collect();
        for (function, name) in FUNCTIONS.into_iter().enumerate() {
            for (rule, rule_name) in RULES.into_iter().enumerate() {
                let of_set = |set: &[RayErrors], rung: usize| {
                    supervol_scene::image::greatest(set.iter().map(|ray| ray[function][rung][rule]))
                };
                let (curve, spread) = over_sets(&errors, of_set);
                let case = Case { field: field.name(), transfer_function: name, rule: rule_name };
                rows.push(OrderRow::new(case, curve, spread, Some(known[function][rule]))?);
            }
        }
    }
    Ok(rows)
}

/// Geometric mean over sets of the error at each sampling (its slope is the mean order); standard deviation of the
/// order.
fn over_sets(errors: &[RayErrors], of_set: impl Fn(&[RayErrors], usize) -> f64) -> (Vec<(f64, f64)>, f64) {
    let curves: Vec<Vec<(f64, f64)>> = errors
        .chunks(SET)
        .map(|set| SAMPLES_PER_VOXEL.iter().enumerate().map(|(rung, &x)| (x, of_set(set, rung))).collect())
        .collect();
    let n = curves.len() as f64;
    let mean = |rung: usize| (curves.iter().map(|c| c[rung].1.ln()).sum::<f64>() / n).exp();
    let orders: Vec<f64> = curves.iter().filter_map(|c| order_of(c)).collect();
    let centre = orders.iter().sum::<f64>() / n;
    let spread = (orders.iter().map(|o| (o - centre).powi(2)).sum::<f64>() / n).sqrt();
    (SAMPLES_PER_VOXEL.iter().enumerate().map(|(rung, &x)| (x, mean(rung))).collect(), spread)
}
