//! Bounds of single chords hold, and stay within what a cell may be off by: random chords, and those that an adversary finds, who
//! changes numbers as long as the true error gets nearer to the stated one.

use glam::Vec3;
use supervol_format::random::Random;
use supervol_scene::transfer_function::ControlPoint;

use super::*;

/// Parts of a chord that are held for the truth, and half as many, whose distance from it is what the truth is off by.
const TERMS: usize = 1 << 14;
/// Least that is compared.
const ROUNDED: f64 = 1e-9;
/// Tolerances of a cell: twentieths of a tenth of a grey level, and of eight.
const TOLERANCES: [f64; 2] = [0.1 / 255.0 / 20.0, 8.0 / 255.0 / 20.0];

/// A chord, with everything that its light depends on.
#[derive(Clone, Debug)]
struct Case {
    value: [f64; 4],
    gradient: [[f64; 4]; 3],
    points: Vec<ControlPoint>,
    to_light: DVec3,
    /// Ambient, diffuse and specular light, and the shininess; `None`: unlit.
    material: Option<[f32; 4]>,
    length: f64,
}

const TO_EYE: Vec3 = Vec3::Z;

impl Case {
    fn random(random: &mut impl FnMut() -> f64) -> Self {
        let turn = [0.05, 0.3, 1.0, 3.0][(random() * 4.0) as usize];
        let mut vector = |size: f64| [0; 4].map(|_| size * (random() - 0.5));
        let mut value = vector(turn);
        let mut gradient = [vector(turn), vector(turn), vector(turn)];
        value[0] = random();
        for component in &mut gradient {
            component[0] = random() - 0.5;
        }
        let count = 2 + (random() * 4.0) as usize;
        let mut values: Vec<f64> = (0..count).map(|_| random()).collect();
        values.sort_by(f64::total_cmp);
        if random() < 0.5 {
            // A step.
            values[1] = values[0];
        }
        let point = |value| ControlPoint { value, color: [0; 3].map(|_| random()), alpha: random() * random() };
        let points = values.into_iter().map(point).collect();
        let [x, y, z] = [0; 3].map(|_| random() - 0.5);
        let shininess = [32.0, 10.0, 4.0, 33.5, 1.0][(random() * 5.0) as usize];
        let light = [0; 3].map(|_| random() as f32);
        let material = (random() < 0.7).then_some([light[0], light[1], light[2], shininess]);
        let length = 0.1 + 3.0 * random();
        Self { value, gradient, points, to_light: DVec3::new(x, y, z).normalize_or(DVec3::X), material, length }
    }

    /// The case with one number changed.
    fn changed(&self, size: f64, random: &mut impl FnMut() -> f64) -> Self {
        let mut case = self.clone();
        let by = size * (random() - 0.5);
        match (random() * 4.0) as usize {
            0 => case.value[(random() * 4.0) as usize] += by,
            1 | 2 => case.gradient[(random() * 3.0) as usize][(random() * 4.0) as usize] += by,
            _ => case.to_light = (case.to_light + by * DVec3::new(random(), random(), random())).normalize_or(DVec3::X),
        }
        case
    }

    fn lighting(&self) -> Option<Lighting> {
        self.material.map(|[ambient, diffuse, specular, shininess]| Lighting {
            ambient,
            diffuse,
            specular,
            shininess,
            lights: vec![(self.to_light.as_vec3(), 0.7)],
            gradient_floor: 1e-6,
            world_from_index_gradient: DMat3::IDENTITY,
        })
    }

    fn function(&self) -> TransferFunction {
        TransferFunction::new(self.points.clone(), 1.0).expect("a valid transfer function")
    }

    /// Colour after shading, by its definition.
    fn lit(&self, lighting: &Lighting, color: DVec3, u: f64) -> DVec3 {
        let gradient = DVec3::from_array(self.gradient.map(|cubic| cubic_at(&cubic, u)));
        if gradient.length() < f64::from(lighting.gradient_floor) {
            return color;
        }
        let normal = gradient.normalize();
        let (to_light, intensity) = (lighting.lights[0].0.as_dvec3(), f64::from(lighting.lights[0].1));
        let half = (to_light + TO_EYE.as_dvec3()).normalize();
        let [diffuse, specular] = [normal.dot(to_light).abs(), normal.dot(half).abs()];
        let diffuse = f64::from(lighting.ambient) + intensity * f64::from(lighting.diffuse) * diffuse;
        let shine = intensity * f64::from(lighting.specular) * specular.powf(f64::from(lighting.shininess));
        (color * diffuse + shine).clamp(DVec3::ZERO, DVec3::ONE)
    }

    /// Colour and transmittance, by this many short parts, and the depth of those parts in which a step lies.
    fn truth(&self, terms: usize) -> ([f64; 4], f64) {
        let (function, lighting) = (self.function(), self.lighting());
        let steps = self.points.windows(2).filter(|pair| pair[0].value == pair[1].value).map(|pair| pair[0].value);
        let steps: Vec<f64> = steps.collect();
        let (mut sum, mut passing, mut unsure) = (DVec3::ZERO, 1.0, 0.0);
        for i in 0..terms {
            let [a, b] = [i, i + 1].map(|i| cubic_at(&self.value, i as f64 / terms as f64));
            if steps.iter().any(|step| a.min(b) <= *step && *step <= a.max(b)) {
                let depth = [a, b].map(|value| function.kappa(function.classify(value).1));
                unsure += (depth[0] + depth[1]) * self.length / terms as f64;
            }
            let u = (i as f64 + 0.5) / terms as f64;
            let (color, alpha) = function.classify(cubic_at(&self.value, u));
            let color = lighting.as_ref().map_or(color.into(), |lighting| self.lit(lighting, color.into(), u));
            let through = (-function.kappa(alpha) * self.length / terms as f64).exp();
            sum += passing * (1.0 - through) * color;
            passing *= through;
        }
        ([sum.x, sum.y, sum.z, passing], unsure)
    }

    /// True error, what that may be off by, and the stated error, for a cell that may be off by `tolerance`.
    fn errors(&self, tolerance: f64) -> [f64; 3] {
        let (modulation, lighting) = (Modulation::new(None, None, &self.function()), self.lighting());
        let setup =
            ShadeSetup { lighting: lighting.as_ref(), to_eye: TO_EYE, world_from_level_gradient: glam::Mat3::IDENTITY };
        let chord = BoundedChord::of(&modulation, &setup, self.value, ([0.0, self.length], None));
        let chord = BoundedChord { gradient: Some(self.gradient), ..chord };
        let mut parts = 0;
        let (seen, _) = chord.seen(&CellBudget::of_one(tolerance), &mut parts);
        assert!(
            parts < PARTS_LIMIT && seen.error <= tolerance,
            "{parts} parts, {} of {tolerance}: {self:?}",
            seen.error
        );
        let [x, y, z] = seen.color.to_array();
        let ((truth, of_steps), (coarse, _)) = (self.truth(TERMS), self.truth(TERMS / 2));
        let distance = |a: [f64; 4], b: [f64; 4]| {
            let passing = a[3] - b[3];
            (0..3).map(|c| (a[c] - b[c]).abs().max((a[c] - b[c] + passing).abs())).fold(0.0, f64::max)
        };
        [distance([x, y, z, seen.transmittance], truth), distance(coarse, truth) + of_steps, seen.error]
    }
}

/// True error in parts of the stated one, if that is enough to tell; no more than 1.
fn ratio(case: &Case, tolerance: f64) -> f64 {
    let [off, unsure, stated] = case.errors(tolerance);
    assert!(off <= stated + unsure + ROUNDED, "{off} off, {stated} stated, unsure {unsure}: {case:?}");
    if unsure < 0.1 * off { off / (stated + ROUNDED) } else { 0.0 }
}

#[test]
fn stated_errors_are_bounds_and_within_what_a_cell_may_be_off_by() {
    let mut numbers = Random::new(7);
    let mut random = || numbers.unit();
    for tolerance in TOLERANCES {
        let mut worst = Vec::new();
        for _ in 0..300 {
            let case = Case::random(&mut random);
            worst.push((ratio(&case, tolerance), case));
        }
        worst.sort_by(|a, b| b.0.total_cmp(&a.0));
        let told = worst.iter().filter(|(ratio, _)| *ratio > 0.0).count();
        assert!(told > 30, "{told} cases tell something");
        worst.truncate(8);
        for (best, case) in &mut worst {
            for step in 0..60 {
                let next = case.changed(0.3f64.powi(step / 15), &mut random);
                let ratio = ratio(&next, tolerance);
                if ratio > *best {
                    (*best, *case) = (ratio, next);
                }
            }
        }
    }
}
