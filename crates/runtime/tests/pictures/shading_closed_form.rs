#![allow(clippy::print_stdout, reason = "measured errors are printed")]
//! Shading on grids that are stretched, rotated, mirrored and sheared, against a closed form of its own.
//!
//! The field is a linear ramp in *world* space. Trilinear interpolation and central differences reproduce it, so its
//! gradient is the ramp's direction on any grid. The right answer needs no matrix. The reference and the ray casters
//! share the function that turns index gradients into world gradients: a mistake in it shows here.

use glam::DVec3;
use supervol_format::{Geometry, Lod};
use supervol_runtime::lod::LodChoice;
use supervol_runtime::stream::classify::Skipping;
use supervol_scene::image::{GREY_LEVELS, Image, greatest};
use supervol_scene::scene::ResolvedScene;

use crate::gpu_support;
use gpu_support::{F32, TestVolume, gpu};

const FINEST: LodChoice = LodChoice::Fixed(Lod::FINEST);
const DIMS: [usize; 3] = [19, 23, 17];
const COLOR: [f64; 3] = [0.6, 0.3, 0.9];
const LIGHTS: [([f64; 3], f64); 2] = [([1.0, 2.0, -3.0], 0.7), ([-2.0, 0.5, -1.0], 0.4)];
const AMBIENT: f64 = 0.25;
const DIFFUSE: f64 = 0.6;
const SPECULAR: f64 = 0.3;
const SHININESS: f64 = 12.0;
/// Gradient of the ramp, world space; in no special direction of any grid.
const GRADIENT: [f64; 3] = [0.31, -0.17, 0.42];

/// Grids by name: spacing, and the rows of D.
const GRIDS: [(&str, [f64; 3], [f64; 9]); 5] = [
    ("stretched", [0.5, 2.0, 1.25], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
    ("oblique", [0.7, 1.6, 1.1], [0.36, 0.48, -0.8, -0.8, 0.6, 0.0, 0.48, 0.64, 0.6]),
    ("mirrored", [1.0, 1.5, 0.8], [-0.6, 0.8, 0.0, 0.8, 0.6, 0.0, 0.0, 0.0, 1.0]),
    ("sheared", [1.0, 1.3, 0.6], [1.0, 0.5, 0.0, 0.0, 0.9, -0.4, 0.0, 0.0, 1.1]),
    ("sheared and oblique", [2.5, 1.25, 0.4], [0.8, -0.6, 0.1, 0.6, 0.8, 0.3, -0.2, 0.2, 1.0]),
];

/// World position of an index point: `origin + D (spacing .* p)`, written out.
fn world(geometry: &Geometry, p: [f64; 3]) -> DVec3 {
    let s = geometry.spacing;
    let row = |r: usize| (0..3).map(|c| geometry.direction[3 * r + c] * s[c] * p[c]).sum::<f64>();
    DVec3::from_array(std::array::from_fn(|r| geometry.origin[r] + row(r)))
}

/// A ramp along [`GRADIENT`], 0 in the grid's middle.
fn ramp(geometry: Geometry) -> TestVolume {
    let middle = world(&geometry, DIMS.map(|n| 0.5 * (n as f64 - 1.0)));
    let gradient = DVec3::from_array(GRADIENT);
    TestVolume::new(DIMS, 16, geometry, F32, |voxel| gradient.dot(world(&geometry, voxel.map(|i| i as f64)) - middle))
}

/// The colour that a ray of this direction (world, unit) sees on the ramp: Blinn-Phong of RENDERING-MODEL.
fn shaded(direction: DVec3) -> [f64; 3] {
    let normal = -DVec3::from_array(GRADIENT).normalize();
    let to_eye = -direction;
    let (mut diffuse, mut specular) = (AMBIENT, 0.0);
    for (travels, intensity) in LIGHTS {
        let to_light = -DVec3::from_array(travels).normalize();
        diffuse += DIFFUSE * normal.dot(to_light).abs() * intensity;
        specular += SPECULAR * normal.dot((to_light + to_eye).normalize()).abs().powf(SHININESS) * intensity;
    }
    COLOR.map(|c| (c * diffuse + specular).clamp(0.0, 1.0))
}

/// Clipped one voxel inside the grid: beyond that, taps are clamped to the grid and the ramp ends.
fn scene(volume: &TestVolume, lens: &str, mode: &str) -> ResolvedScene {
    let target = world(&volume.geometry, DIMS.map(|n| 0.5 * (n as f64 - 1.0)));
    let radius = (world(&volume.geometry, DIMS.map(|n| n as f64)) - world(&volume.geometry, [0.0; 3])).length();
    let (eye, target) = ((target + radius * DVec3::new(0.9, -1.3, 0.8)).to_array(), target.to_array());
    let light = |(d, i): ([f64; 3], f64)| format!(r#"{{"direction": {d:?}, "intensity": {i}}}"#);
    let high = DIMS.map(|n| n as f64 - 2.0);
    let json = format!(
        r#"{{"camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0.1, 0.2, 1], {lens}}},
            "image": {{"width": 24, "height": 20}}, {mode},
            "shading": {{"ambient": {AMBIENT}, "diffuse": {DIFFUSE}, "specular": {SPECULAR},
                         "shininess": {SHININESS}, "lights": [{}]}},
            "transfer_function": {{"unit_distance": 2, "points": [
                {{"value": -99, "color": {COLOR:?}, "alpha": 0.3}}, {{"value": 99, "color": {COLOR:?}, "alpha": 0.3}}]}},
            "clip": {{"box": [[1, 1, 1], {high:?}]}}}}"#,
        LIGHTS.map(light).join(", "),
    );
    volume.scene(&json)
}

/// Greatest distance of a shown colour, divided by its opacity, from the closed form, grey levels; and the number of
/// pixels judged.
fn off(scene: &ResolvedScene, image: &Image) -> (f64, usize) {
    let shown = (0..image.height).flat_map(|y| (0..image.width).map(move |x| [x, y])).filter_map(|[x, y]| {
        let [r, g, b, alpha] = image.pixels[(y * image.width + x) as usize].map(f64::from);
        // A colour divided by nearly nothing is noise.
        (alpha.is_nan() || alpha > 0.1).then(|| {
            let exact = shaded(scene.camera.ray(x, y).direction);
            greatest([r, g, b].into_iter().zip(exact).map(|(c, exact)| GREY_LEVELS * (c / alpha - exact)))
        })
    });
    let shown: Vec<f64> = shown.collect();
    (greatest(shown.iter().copied()), shown.len())
}

#[test]
fn a_ramp_in_the_world_is_lit_the_same_on_every_grid() {
    let gpu = gpu();
    let surface = r#""mode": "iso", "iso": [{"value": 0, "color": [0.6, 0.3, 0.9]}]"#;
    for (grid, spacing, direction) in GRIDS {
        let volume = ramp(Geometry { spacing, origin: [1000.0, -500.0, 10.0], direction });
        for lens in [r#""fov_y": 35"#, r#""height": 30"#] {
            for mode in [r#""mode": "dvr""#, surface] {
                let scene = scene(&volume, lens, mode);
                let name = format!("{grid}, {lens}, {}", &mode[9..12]);
                let check = |backend: &str, image: &Image, bound: f64| {
                    let (worst, judged) = off(&scene, image);
                    println!("{name}, {backend}: {worst:.5}/255 over {judged} pixels");
                    assert!(judged > 40, "{name}: only {judged} pixels show the ramp");
                    assert!(worst <= bound, "{name}, {backend}: {worst}/255, bound {bound}/255");
                };
                check("reference", &volume.reference_image(&scene), REFERENCE_BOUND);
                check("cpu", &volume.cpu_image(&scene, FINEST), CASTER_BOUND);
                // A pipeline takes seconds to compile on a CPU: only the grid with all properties is tested.
                if let Some(gpu) = gpu.as_ref().filter(|_| grid == "sheared and oblique") {
                    check("gpu", &volume.gpu_image(gpu, &scene, FINEST, 64, Skipping::On).0, CASTER_BOUND);
                }
            }
        }
    }
}

/// Grey levels: the ramp is stored in `f32`, and images hold `f32`.
const REFERENCE_BOUND: f64 = 0.01;
/// Grey levels: shading in `f32`.
const CASTER_BOUND: f64 = 0.02;
