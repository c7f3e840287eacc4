//! Tests: stated errors of the light are bounds, by three places of a part ([`super::shade`]) and by sixteen ([`super::turning`]).
//!
//! Cases are random, and those that an adversary finds, who changes numbers as long as the true error gets nearer to the stated one.

use glam::{DVec3, Vec3};
use supervol_format::random::Random;
use supervol_scene::transfer_function::pieces::CHANNELS;

use super::integrate::Part;
use super::shade::PacketLighting;
use super::shaded_cells::AlongRay;
use super::simd::{InstructionSet, LANES_LIMIT, Simd, Task, dispatch};
use super::turning::{SettleLight, TurningCells};
use crate::engines::cells::shade::Lighting;

/// Roundings of `f32`, and of the sum that is held for the truth.
const ROUNDED: f64 = 2e-5;
/// Terms of that sum.
const TERMS: usize = 4096;
const OPACITY: f64 = 0.5;

/// A part of a ray, and its light.
#[derive(Clone, Debug)]
struct Case {
    /// Coefficients of the gradient, from its beginning on.
    gradient: [DVec3; 4],
    to_lights: Vec<DVec3>,
    /// Ambient, diffuse and specular light, and the shininess.
    material: [f64; 4],
    /// Colour in the middle, and its change over the part; and how the density of opacity changes: linearly, and as behind this depth.
    colors: [[f64; 2]; 3],
    change: f64,
    depth: f64,
}

const TO_EYE: DVec3 = DVec3::Z;

impl Case {
    fn random(random: &mut impl FnMut() -> f64) -> Self {
        // The last is below the floor: there is no normal.
        let size = [1.0, 1.0, 0.1, 1e-3, 1e-7][(random() * 5.0) as usize];
        let turn = [0.02, 0.1, 0.3, 1.0, 4.0][(random() * 5.0) as usize];
        let cubic = [0.0, 0.1, 1.0][(random() * 3.0) as usize];
        let mut vector = |size: f64| DVec3::new(random() - 0.5, random() - 0.5, random() - 0.5) * 2.0 * size;
        let gradient = [vector(size), vector(size * turn), vector(size * turn), vector(size * turn * cubic)];
        let to_lights = [vector(1.0), vector(1.0)];
        let count = 1 + usize::from(random() < 0.3);
        let at_eye = random() < 0.4;
        let mut to_lights: Vec<DVec3> = to_lights[..count].iter().map(|l| l.normalize_or(DVec3::X)).collect();
        if at_eye {
            to_lights[0] = TO_EYE;
        }
        let shininess = [32.0, 10.0, 33.5, 4.0, 128.0, 2.0, 1.0][(random() * 7.0) as usize];
        let is_flat = random() < 0.3;
        let colors = [0; 3].map(|_| [random(), if is_flat { 0.0 } else { 0.4 * (random() - 0.5) }]);
        Self {
            gradient,
            to_lights,
            material: [0.5 * random(), random(), 0.6 * random(), shininess],
            colors,
            change: if is_flat { 0.0 } else { 3.0 * (random() - 0.5) },
            depth: [0.0, 0.0, 1.0, 10.0][(random() * 4.0) as usize] * random(),
        }
    }

    /// The case with one number changed.
    fn changed(&self, size: f64, random: &mut impl FnMut() -> f64) -> Self {
        let mut case = self.clone();
        let by = size * (random() - 0.5);
        let axis = (random() * 3.0) as usize;
        match (random() * 4.0) as usize {
            0 | 1 => {
                let most = case.gradient.iter().map(|g| g.length()).fold(0.0, f64::max);
                case.gradient[(random() * 4.0) as usize][axis] += 2.0 * by * most;
            }
            2 => {
                let number = (random() * case.to_lights.len() as f64) as usize;
                let mut light = case.to_lights[number];
                light[axis] += by;
                case.to_lights[number] = light.normalize_or(DVec3::X);
            }
            _ => {
                let number = (random() * 4.0) as usize;
                if number == 3 {
                    case.change = (case.change + 2.0 * by).clamp(-1.9, 1.9);
                } else if random() < 0.5 {
                    case.colors[axis][0] = (case.colors[axis][0] + by).clamp(0.0, 1.0);
                } else {
                    case.material[number] = (case.material[number] + by).clamp(0.0, 1.0);
                }
            }
        }
        case
    }

    /// Colour of channel c, not premultiplied.
    fn color(&self, c: usize, u: f64) -> f64 {
        let [middle, change] = self.colors[c];
        (middle + change * (u - 0.5)).clamp(0.0, 1.0)
    }

    fn lighting(&self) -> Lighting {
        let [ambient, diffuse, specular, shininess] = self.material.map(|v| v as f32);
        Lighting {
            ambient,
            diffuse,
            specular,
            shininess,
            lights: self.to_lights.iter().map(|l| (l.as_vec3().normalize_or(Vec3::X), 0.7)).collect(),
            gradient_floor: 1e-6,
            world_from_index_gradient: glam::DMat3::IDENTITY,
        }
    }

    fn gradient_at(&self, u: f64) -> DVec3 {
        let [a, b, c, d] = self.gradient;
        a + u * (b + u * (c + u * d))
    }

    /// D and S at u, from their definition.
    fn light(&self, lighting: &Lighting, u: f64) -> [f64; 2] {
        let gradient = self.gradient_at(u);
        if gradient.length() < f64::from(lighting.gradient_floor) {
            return [1.0, 0.0];
        }
        let normal = gradient / gradient.length();
        let (mut diffuse, mut specular) = (f64::from(lighting.ambient), 0.0);
        for (to_light, intensity) in &lighting.lights {
            let (to_light, intensity) = (to_light.as_dvec3(), f64::from(*intensity));
            let half = (to_light + TO_EYE).normalize_or_zero();
            diffuse += f64::from(lighting.diffuse) * intensity * normal.dot(to_light).abs();
            specular +=
                f64::from(lighting.specular) * intensity * normal.dot(half).abs().powf(f64::from(lighting.shininess));
        }
        [diffuse, specular]
    }

    /// Sums over the part: opacity and colours without light, their first moments, colours with light, and the distance of the
    /// integrals of the densities from lines; and the variation of colour.
    fn truth(&self) -> Truth {
        let lighting = self.lighting();
        let mut truth =
            Truth { sums: [0.0; CHANNELS], moments: [0.0; CHANNELS], lit: [0.0; 3], misplaced: 0.0, colors: 0.0 };
        let mut densities = Vec::new();
        let place = |i: usize| (i as f64 + 0.5) / TERMS as f64;
        let weight = |u: f64| (1.0 + self.change * (u - 0.5)) * (-self.depth * u).exp();
        let all: f64 = (0..TERMS).map(|i| weight(place(i))).sum();
        for i in 0..TERMS {
            let u = place(i);
            let part = OPACITY * weight(u) / all;
            let [diffuse, specular] = self.light(&lighting, u);
            let mut density = [part; CHANNELS];
            for c in 0..3 {
                let color = self.color(c, u);
                density[c + 1] = part * color;
                truth.lit[c] += part * (color * diffuse + specular).min(1.0);
            }
            for (c, part) in density.into_iter().enumerate() {
                truth.sums[c] += part;
                truth.moments[c] += part * (u - 0.5);
            }
            densities.push(density);
        }
        for c in 0..CHANNELS {
            let mut integral = 0.0;
            for (i, density) in densities.iter().enumerate() {
                integral += density[c];
                let u = (i as f64 + 1.0) / TERMS as f64;
                let line = truth.sums[c] * u + 6.0 * truth.moments[c] * (u * u - u);
                truth.misplaced = truth.misplaced.max((integral - line).abs());
            }
        }
        for c in 0..3 {
            let mean = truth.sums[c + 1] / truth.sums[0];
            let range = [0.0, 1.0].map(|u| (self.color(c, u) - mean).abs());
            truth.colors = truth.colors.max(range[0].max(range[1]));
        }
        truth
    }

    /// Error and stated error, by three places and by sixteen.
    fn errors(&self) -> [[f64; 2]; 2] {
        let (truth, lighting) = (self.truth(), self.lighting());
        let lighting = PacketLighting::new(&lighting, &supervol_format::Geometry::IDENTITY, [1; 3], 1.0);
        let found = dispatch(InstructionSet::default(), LightTask { case: self, truth: &truth, lighting: &lighting });
        found.map(|[r, g, b, stated]| {
            let color = [r, g, b].map(f64::from);
            let off = (0..3).map(|c| (color[c] - truth.lit[c]).abs()).fold(0.0, f64::max);
            [off, f64::from(stated)]
        })
    }
}

struct Truth {
    sums: [f64; CHANNELS],
    moments: [f64; CHANNELS],
    lit: [f64; 3],
    misplaced: f64,
    colors: f64,
}

/// Colour and stated error by three places, and by sixteen.
struct LightTask<'a> {
    case: &'a Case,
    truth: &'a Truth,
    lighting: &'a PacketLighting<'a>,
}

impl Task for LightTask<'_> {
    type Output = [[f32; 4]; 2];

    #[inline(always)]
    fn run<S: Simd>(self) -> Self::Output {
        let Self { case, truth, lighting } = self;
        let three = |v: DVec3| v.to_array().map(|v| S::splat(v as f32));
        let transmittance = S::splat(1.0 - truth.sums[0] as f32);
        let part = Part::<S> {
            color: [truth.sums[1], truth.sums[2], truth.sums[3]].map(|c| S::splat(c as f32)),
            transmittance,
            moments: truth.moments.map(|m| S::splat(m as f32)),
            misplaced: S::splat(truth.misplaced as f32),
            colors: S::splat(truth.colors as f32),
            ..Part::nothing()
        };
        let mut along = AlongRay::<S>::nothing();
        along.gradients = [0.0, 0.5, 1.0].map(|u| three(case.gradient_at(u)));
        along.cubics = three(case.gradient[3]);
        let to_eye = three(TO_EYE);
        let lit = lighting.at::<S, 3>(&along.gradients, &to_eye);
        let shaded = lighting.shade::<S>(&part, &lit, &along.cubics);
        let mut cells = TurningCells::new::<S>(&part, &along, &to_eye, S::splat(0.0));
        SettleLight { lighting, cells: &mut cells, lanes: 1 }.run::<S>();
        let (color, error) = cells.outcome::<S>();
        [(shaded.color, shaded.error), (color, error)].map(|([r, g, b], error)| {
            [r, g, b, error].map(|lanes| {
                let mut numbers = [0.0; LANES_LIMIT];
                S::store(lanes, &mut numbers);
                numbers[0]
            })
        })
    }
}

fn check(case: &Case, [off, stated]: [f64; 2], by: &str) {
    assert!(off <= stated + ROUNDED, "{by}: {off} off, {stated} stated: {case:?}");
}

/// No stated error of the light is below the true one.
#[test]
fn stated_errors_of_light_are_errors() {
    let mut numbers = Random::new(5);
    let mut random = || numbers.unit();
    for (way, by) in ["three places", "sixteen places"].into_iter().enumerate() {
        let (mut worst, mut ratios) = (Vec::new(), Vec::new());
        for _ in 0..10_000 {
            let case = Case::random(&mut random);
            let errors = case.errors()[way];
            check(&case, errors, by);
            if errors[0] > 1e-4 {
                ratios.push(errors[1] / errors[0]);
            }
            worst.push((errors[0] / (errors[1] + ROUNDED), case));
            if worst.len() > 200 {
                worst.sort_by(|a, b| b.0.total_cmp(&a.0));
                worst.truncate(20);
            }
        }
        ratios.sort_by(f64::total_cmp);
        println!("{by}: {} off by over 1e-4; stated / true: median {}", ratios.len(), ratios[ratios.len() / 2]);
        worst.truncate(20);
        println!("random: {:?}", worst[0].0);
        for (ratio, case) in &mut worst {
            for step in 0..500 {
                let next = case.changed(0.3f64.powi(step / 80), &mut random);
                let errors = next.errors()[way];
                check(&next, errors, by);
                let better = errors[0] / (errors[1] + ROUNDED);
                if better > *ratio && errors[0] > 10.0 * ROUNDED {
                    (*ratio, *case) = (better, next);
                }
            }
        }
        worst.sort_by(|a, b| b.0.total_cmp(&a.0));
        println!("adversary: {:?} {:?}", worst[0], worst[0].1.errors()[way]);
        assert!(ratios.len() > 1000, "too few cells are off at all");
    }
}
