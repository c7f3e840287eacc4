//! The reference integrator against an integration that knows no cells, cuts or cubics: it samples the definition, and halves
//! steps of 1/128 voxel until a halving changes nothing.

use supervol_format::{Dims, VoxelType};
use supervol_runtime::engines::reference::ReferenceCaster;
use supervol_scene::clip::{IndexRay, clip_ray};
use supervol_scene::scene::{ResolvedScene, Shading};

use crate::support::{Volume, marschner_lobb, noise, points, scene};

/// Error of a ray that the reference promises, of full scale.
const PROMISED: f64 = 1e-5;
/// Rounding of the pixels that it returns.
const ROUNDING: f64 = 1e-7;
/// First steps of the integration here, per voxel.
const STEPS: f64 = 128.0;
/// Change of a step that counts as none.
const NOTHING: f64 = 1e-13;
/// Most halvings of a step.
const HALVINGS: u32 = 36;

type Vector = [f64; 3];
/// Colour and transmittance.
type State = [f64; 4];

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(a: Vector) -> Vector {
    let length = dot(a, a).sqrt();
    a.map(|x| x / length)
}

/// One ray of a scene, integrated by the definition alone.
struct Brute<'a> {
    volume: &'a Volume,
    scene: &'a ResolvedScene,
    ray: IndexRay,
    to_eye: Vector,
    floor: f64,
    /// Beginning and normal of a cut face.
    face: Option<(f64, Vector)>,
}

impl Brute<'_> {
    fn field(&self, p: Vector) -> Option<f64> {
        let mut sum = 0.0;
        for corner in 0..8 {
            let bit = [corner & 1, corner >> 1 & 1, corner >> 2];
            let weight = |a: usize| if bit[a] == 1 { p[a] - p[a].floor() } else { 1.0 - (p[a] - p[a].floor()) };
            let weight = weight(0) * weight(1) * weight(2);
            if weight != 0.0 {
                let value = self.volume.clamped([0, 1, 2].map(|a| p[a].floor() as i64 + bit[a]));
                if value.is_nan() {
                    return None;
                }
                sum += weight * value;
            }
        }
        Some(sum)
    }

    fn gradient(&self, p: Vector) -> Option<Vector> {
        let mut gradient = [0.0; 3];
        for axis in 0..3 {
            let tap = |step: f64| {
                let mut q = p;
                q[axis] += step;
                self.field(q)
            };
            gradient[axis] = (tap(1.0)? - tap(-1.0)?) / 2.0;
        }
        let world = self.volume.geometry.linear().inverse().transpose() * glam::DVec3::from_array(gradient);
        Some(world.to_array())
    }

    /// Extinction and colour, by sections 3 and 5 of the model.
    fn light(&self, t: f64) -> (f64, Vector) {
        let p = self.ray.at(t);
        let Some(value) = self.field(p) else { return (0.0, [0.0; 3]) };
        let (color, alpha) = self.scene.transfer_function.classify(value);
        let kappa = -(1.0 - alpha.min(0.9999)).ln() / self.scene.transfer_function.unit_distance();
        let gradient = self.gradient(p);
        let kappa = match self.scene.gradient_opacity {
            Some(ramp) => {
                let length = gradient.map_or(0.0, |gradient| dot(gradient, gradient).sqrt());
                kappa * ((length - ramp.from) / (ramp.to - ramp.from)).clamp(0.0, 1.0)
            }
            None => kappa,
        };
        let Some(shading) = &self.scene.shading else { return (kappa, color) };
        let by_gradient = match gradient {
            Some(gradient) if gradient != [0.0; 3] && dot(gradient, gradient).sqrt() >= self.floor => {
                self.lit(shading, color, unit(gradient))
            }
            _ => color,
        };
        let Some((begin, normal)) = self.face else { return (kappa, by_gradient) };
        // Two smallest spacings of the cut's light alone, two in which it fades.
        let voxels = (t - begin) / self.volume.geometry.smallest_spacing();
        let weight = (0.5 * (4.0 - voxels)).clamp(0.0, 1.0);
        let by_face = self.lit(shading, color, normal);
        (kappa, [0, 1, 2].map(|c| weight * by_face[c] + (1.0 - weight) * by_gradient[c]))
    }

    fn lit(&self, shading: &Shading, color: Vector, normal: Vector) -> Vector {
        let (mut diffuse, mut specular) = (shading.ambient, 0.0);
        for light in &shading.lights {
            let to_light = light.to_light.to_array();
            let half = unit([0, 1, 2].map(|a| to_light[a] + self.to_eye[a]));
            diffuse += shading.diffuse * dot(normal, to_light).abs() * light.intensity;
            specular += shading.specular * dot(normal, half).abs().powf(shading.shininess) * light.intensity;
        }
        color.map(|c| (c * diffuse + specular).min(1.0))
    }

    /// A step by the method of Runge and Kutta (1901): `T' = -kappa T`, `C' = c kappa T`.
    fn step(state: State, h: f64, lights: [(f64, Vector); 3]) -> State {
        let slope = |(kappa, [r, g, b]): (f64, Vector), [.., t]: State| {
            let emitted = kappa * t;
            [r * emitted, g * emitted, b * emitted, -emitted]
        };
        let moved = |by: State, h: f64| std::array::from_fn(|c| state[c] + h * by[c]);
        let first = slope(lights[0], state);
        let second = slope(lights[1], moved(first, 0.5 * h));
        let third = slope(lights[1], moved(second, 0.5 * h));
        let last = slope(lights[2], moved(third, h));
        std::array::from_fn(|c| state[c] + h / 6.0 * (first[c] + 2.0 * (second[c] + third[c]) + last[c]))
    }

    fn refined(&self, state: State, [t0, t1]: [f64; 2], lights: [(f64, Vector); 3], left: u32) -> State {
        let middle = 0.5 * (t0 + t1);
        let between = [0.5 * (t0 + middle), 0.5 * (middle + t1)].map(|t| self.light(t));
        let halves = [[lights[0], between[0], lights[1]], [lights[1], between[1], lights[2]]];
        let whole = Self::step(state, t1 - t0, lights);
        let [first, second] = [[t0, middle], [middle, t1]];
        let fine = Self::step(Self::step(state, middle - t0, halves[0]), t1 - middle, halves[1]);
        if left == 0 || (0..4).all(|c| (whole[c] - fine[c]).abs() < NOTHING) {
            return fine;
        }
        self.refined(self.refined(state, first, halves[0], left - 1), second, halves[1], left - 1)
    }

    fn pixel(&self, [t0, t1]: [f64; 2]) -> [f64; 4] {
        let voxels = (t1 - t0) * self.ray.direction.map(f64::abs).into_iter().fold(0.0, f64::max);
        let steps = (STEPS * voxels).ceil();
        let mut state = [0.0, 0.0, 0.0, 1.0];
        for i in 0..steps as u32 {
            let ends = [0.0, 1.0].map(|after| t0 + (t1 - t0) * (f64::from(i) + after) / steps);
            let lights = [ends[0], 0.5 * (ends[0] + ends[1]), ends[1]].map(|t| self.light(t));
            state = self.refined(state, ends, lights, HALVINGS);
        }
        let [r, g, b, transmittance] = state;
        [r, g, b, 1.0 - transmittance]
    }
}

/// Compares all rays of a small picture with the reference.
#[track_caller]
fn compare(volume: &Volume, size: [u32; 2], json: &str) {
    compare_behind_faces(volume, size, json, &|_| None);
}

/// The same with cut faces of these normals at these points.
#[track_caller]
fn compare_behind_faces(volume: &Volume, size: [u32; 2], json: &str, face: &dyn Fn(Vector) -> Option<Vector>) {
    let [width, height] = size;
    let json = format!(r#"{{"image": {{"width": {width}, "height": {height}}}, {json}}}"#);
    let scene = scene(volume, &json);
    let reference = volume.reference();
    let caster = ReferenceCaster::new(&reference, &scene);
    let pixels: Vec<[u32; 2]> = (0..height).flat_map(|y| (0..width).map(move |x| [x, y])).collect();
    let found = caster.pixels(&pixels, &|| ());
    assert_eq!(caster.capped_pieces(), 0);
    let range = volume.range();
    let floor = (1e-6 * range.width()).max(1e-13 * range.min.abs().max(range.max.abs()));
    let mut visible = 0;
    for ([x, y], found) in pixels.into_iter().zip(found) {
        let ray = scene.camera.ray(x, y);
        let index = IndexRay::new(&ray, &volume.geometry);
        let Some(segment) = clip_ray(&ray, &index, Dims(volume.dims.map(|n| n as u64)), &scene.clip) else { continue };
        let to_eye = (-ray.direction).to_array();
        let floor = floor / volume.geometry.smallest_spacing();
        let begin = segment.t0;
        let face = face((ray.origin + begin * ray.direction).to_array()).map(|normal| (begin, normal));
        let brute = Brute { volume, scene: &scene, ray: index, to_eye, floor, face };
        let expected = brute.pixel([segment.t0, segment.t1]);
        visible += u32::from(expected[3] > 0.01);
        for c in 0..4 {
            let off = (f64::from(found[c]) - expected[c]).abs();
            assert!(off <= PROMISED + ROUNDING, "pixel {x} {y}, channel {c}: {} instead of {}", found[c], expected[c]);
        }
    }
    assert!(visible >= 2, "{visible} pixels show something");
}

const NARROW: &str = r#""shading": {"ambient": 0.2, "diffuse": 0.7, "specular": 0.4, "shininess": 60}"#;
/// Two lights from the sides, colours that are cut off at 1.
const GLARING: &str = r#""shading": {"ambient": 0.3, "diffuse": 0.9, "specular": 0.9, "shininess": 9,
    "lights": [{"direction": [1, 0.2, -0.4]}, {"direction": [-0.3, 1, 0.2], "intensity": 0.7}]}"#;

fn camera(eye: Vector, target: Vector, fov: f64) -> String {
    format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0.1, 0.2, 1], "fov_y": {fov}}}"#)
}

fn along_z(cells: f64) -> String {
    format!(
        r#""camera": {{"eye": [3.3, 3.6, {}], "target": [3.5, 3.5, {}], "up": [0, 1, 0], "height": 6}}"#,
        -cells,
        0.5 * cells
    )
}

fn thin() -> String {
    let (a, b) = ([0.2, 0.4, 1.0], [1.0, 0.7, 0.1]);
    points(1.0, &[(0.0, [1.0; 3], 0.0005), (0.35, a, 0.04), (0.6, b, 0.002), (1.0, [0.9, 0.1, 0.1], 0.02)])
}

#[test]
fn long_rays_through_noise() {
    let volume = Volume::new([8, 8, 301], VoxelType::F32, noise);
    compare(&volume, [2, 2], &format!(r#"{}, {NARROW}, "transfer_function": {}"#, along_z(300.0), thin()));
    compare(&volume, [2, 1], &format!(r#"{}, {GLARING}, "transfer_function": {}"#, along_z(300.0), thin()));
}

#[test]
fn noise_with_steps_and_kinks() {
    let volume = Volume::new([12; 3], VoxelType::F32, noise);
    let (a, b) = ([0.2, 0.4, 1.0], [1.0, 0.9, 0.1]);
    let steps =
        [(0.0, a, 0.0), (0.3, a, 0.0), (0.3, b, 0.3), (0.5, b, 0.1), (0.5, a, 0.0), (0.8, a, 0.01), (1.0, b, 1.0)];
    let seen = camera([31.0, 17.0, 24.0], [5.5; 3], 25.0);
    for light in [r#""shading": null"#, NARROW, GLARING] {
        compare(&volume, [4, 3], &format!(r#"{seen}, {light}, "transfer_function": {}"#, points(1.0, &steps)));
    }
}

#[test]
fn smooth_fields_of_any_shape() {
    let turned = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let waves =
        Volume::new([24; 3], VoxelType::F32, marschner_lobb(24)).with_geometry([1.0, 0.5, 2.0], [3.0; 3], turned);
    let shown = points(0.5, &[(0.2, [0.9, 0.6, 0.3], 0.0), (0.5, [1.0; 3], 0.2), (0.9, [0.2, 0.9, 0.3], 0.9)]);
    let seen = camera([60.0, 40.0, 70.0], [-3.0, 15.0, 26.0], 20.0);
    for light in [NARROW, GLARING] {
        compare(&waves, [4, 3], &format!(r#"{seen}, {light}, "transfer_function": {shown}"#));
    }
}

/// Gradients that vanish on planes, and voxels that are absent.
#[test]
fn gradients_that_vanish_and_holes() {
    let (a, b) = ([0.2, 0.4, 1.0], [1.0, 0.9, 0.1]);
    let shown = points(1.0, &[(0.0, a, 0.02), (1.0, b, 0.3)]);
    let wave = |cycles: f64| {
        move |p: Vector| 0.5 + 0.5 * (std::f64::consts::TAU * cycles * (p[0] + 0.83 * p[1] + 0.71 * p[2])).sin()
    };
    let seen = camera([31.0, 17.0, 24.0], [5.5; 3], 25.0);
    let waves = Volume::new([12; 3], VoxelType::F32, wave(0.45));
    let even = Volume::new([12; 3], VoxelType::F32, |p| (p[0] - 5.0).abs() / 7.0);
    let holed = Volume::new([12; 3], VoxelType::F32, wave(0.1)).with_holes(|p| p.iter().sum::<usize>() % 11 == 0);
    for volume in [waves, even, holed] {
        compare(&volume, [4, 3], &format!(r#"{seen}, {NARROW}, "transfer_function": {shown}"#));
    }
}

/// Opacity by the gradient: kinks where its length passes the ends of a ramp, and where it vanishes.
#[test]
fn opacity_by_the_gradient() {
    let (a, b) = ([0.2, 0.4, 1.0], [1.0, 0.9, 0.1]);
    let shown = points(1.0, &[(0.0, a, 0.3), (0.5, b, 0.3), (0.5, b, 0.8), (1.0, a, 0.1)]);
    let seen = camera([31.0, 17.0, 24.0], [5.5; 3], 25.0);
    let wave = |p: Vector| 0.5 + 0.5 * (0.7 * (p[0] + 0.83 * p[1] + 0.71 * p[2])).sin();
    let turned = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let noisy = Volume::new([12; 3], VoxelType::F32, noise);
    let waves = Volume::new([12; 3], VoxelType::F32, wave);
    let stretched = waves.clone().with_geometry([1.0, 0.6, 1.4], [9.0, -1.0, 1.0], turned);
    let holed = waves.clone().with_holes(|p| p.iter().sum::<usize>() % 11 == 0);
    for volume in [noisy, waves, stretched, holed] {
        for (light, ends) in [(r#""shading": null"#, "[0, 0.3]"), (NARROW, "[0.1, 0.25]"), (GLARING, "[0.2, 0.21]")] {
            let look = format!(r#""gradient_opacity": {ends}, {light}, "transfer_function": {shown}"#);
            compare(&volume, [3, 3], &format!("{seen}, {look}"));
        }
    }
}

/// Light by the normals of a clip box and of a clip plane, kinks of its weight, and colours that reach 1.
#[test]
fn light_by_the_normals_of_cuts() {
    let (a, b) = ([0.2, 0.4, 1.0], [1.0, 0.9, 0.1]);
    let shown = points(1.0, &[(0.0, a, 0.1), (0.5, b, 0.3), (0.5, b, 0.8), (1.0, a, 0.1)]);
    let seen = camera([31.0, 17.0, 24.0], [5.5; 3], 25.0);
    let wave = |p: Vector| 0.5 + 0.5 * (0.7 * (p[0] + 0.83 * p[1] + 0.71 * p[2])).sin();
    let noisy = Volume::new([12; 3], VoxelType::F32, noise);
    let waves = Volume::new([12; 3], VoxelType::F32, wave);
    let holed = waves.clone().with_holes(|p| p.iter().sum::<usize>() % 11 == 0);
    let even = Volume::new([12; 3], VoxelType::F32, |_| 0.7);
    let normal = unit([-1.0, -0.3, -0.4]);
    let clip = r#""cut_normals": true, "clip": {"box": [[-0.5, -0.5, -0.5], [99, 9.25, 99]],
        "planes": [{"normal": [-1, -0.3, -0.4], "offset": -9.5}]}"#;
    let near = |x: f64| x.abs() < 1e-9;
    let face = |p: Vector| {
        let of_plane = near(dot(p, [-1.0, -0.3, -0.4]) + 9.5).then_some(normal);
        of_plane.or_else(|| near(p[1] - 9.25).then_some([0.0, 1.0, 0.0]))
    };
    for volume in [noisy, waves, holed, even] {
        for (light, ramp) in [(NARROW, ""), (GLARING, ""), (GLARING, r#", "gradient_opacity": [0.1, 0.25]"#)] {
            if volume.range().width() == 0.0 && !ramp.is_empty() {
                continue;
            }
            let look = format!(r#"{clip}, {light}{ramp}, "transfer_function": {shown}"#);
            compare_behind_faces(&volume, [3, 3], &format!("{seen}, {look}"), &face);
        }
    }
}
