//! Pixels of a graphics device that may be off by more than requested are the CPU's, and all others stay the device's. Skipped with
//! a message without an adapter.

use std::time::{Duration, Instant};

use supervol_format::{Lod, VoxelType};
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::{Renderer, render, render_with_errors};
use supervol_runtime::render::volume::PlacedVolume;
use supervol_scene::image::{GREY_LEVELS, Image};
use supervol_scene::scene::ResolvedScene;

use crate::streaming_gpu::has_adapter;
use crate::{containers, support};
use containers::{container_bytes, open};
use support::{Volume, difference, noise, points, scene};

/// An error that no device keeps to everywhere, in grey levels.
const ASKED: f64 = 0.05;
/// Greatest difference of a device's own pixels from the CPU's, in grey levels.
const TOLERANCE: f64 = 0.5;

/// Noise of single voxels in one half, and even in the other.
fn volume() -> Volume {
    Volume::new([48, 40, 36], VoxelType::U8, |p| if p[0] < 24.0 { 255.0 * noise(p) } else { 3.0 * p[2] })
}

/// The transfer function of most scenes: thin, so that the errors of many cells add up.
fn thin() -> String {
    let points = points(
        1.0,
        &[
            (0.0, [0.1, 0.2, 0.9], 0.0),
            (90.0, [0.9, 0.8, 0.1], 0.03),
            (110.0, [0.2, 0.9, 0.4], 0.001),
            (255.0, [1.0, 0.1, 0.1], 0.02),
        ],
    );
    format!(r#""transfer_function": {points}"#)
}

fn the_scene(volume: &Volume, function: &str, more: &str) -> ResolvedScene {
    let camera = r#""eye": [150, -110, 90], "target": [23, 19, 17], "up": [0, 0, 1], "fov_y": 25"#;
    scene(volume, &format!(r#"{{"camera": {{{camera}}}, {function}, {more}}}"#))
}

fn options(backend: Backend) -> RenderOptions {
    let max_error = ASKED / GREY_LEVELS;
    RenderOptions {
        backend,
        max_error,
        level: LevelChoice::Fixed(Lod(0)),
        predict_error: true,
        ..RenderOptions::default()
    }
}

/// Scenes of every kind: light, several rays for a pixel, parts of rays, modes.
fn scenes(volume: &Volume) -> Vec<(&'static str, ResolvedScene)> {
    let size = r#""image": {"width": 50, "height": 42}"#;
    let window = [(225.0, [0.0, 0.0, 1.0], 0.0), (230.0, [1.0, 1.0, 0.0], 1.0)];
    let steep = format!(r#""transfer_function": {}"#, points(1.0, &window));
    let ball = r#""clip": {"solids": [{"keep": "outside", "sphere": {"center": [20, 18, 18], "radius": 9}}]}"#;
    let four = r#""image": {"width": 25, "height": 21}, "samples_per_pixel": 4"#;
    let cases = [
        ("lit", format!(r#""mode": "dvr", "shading": {{}}, {size}"#)),
        ("four rays for a pixel", format!(r#""mode": "dvr", "shading": {{}}, {four}"#)),
        ("parts of rays", format!(r#""mode": "dvr", "shading": {{}}, {ball}, {size}"#)),
    ];
    let rise = [(0.0, [0.2, 0.5, 1.0], 0.001), (150.0, [0.2, 0.5, 1.0], 0.001), (150.001, [1.0, 0.2, 0.1], 0.3)];
    let rise = format!(r#""transfer_function": {}"#, points(1.0, &rise));
    let of_light = cases.into_iter().map(|(name, more)| (name, the_scene(volume, &thin(), &more)));
    let steep = [
        ("unlit, a steep rise", the_scene(volume, &rise, &format!(r#""mode": "dvr", {size}"#))),
        ("a steep window", the_scene(volume, &steep, &format!(r#""mode": "mip", {size}"#))),
    ];
    of_light.chain(steep).collect()
}

/// Pixels of `picture` that are `of` the other picture, bit for bit.
fn equal_pixels(picture: &Image, of: &Image) -> u64 {
    picture.pixels.iter().zip(&of.pixels).filter(|(a, b)| a == b).count() as u64
}

#[test]
fn pixels_above_the_requested_error_are_the_cpu_s() {
    if !has_adapter() {
        return;
    }
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    for (name, scene) in scenes(&volume) {
        let (by_cpu, _) = render(&container, &scene, &options(Backend::Cpu)).unwrap();
        let (picture, errors, stats) = render_with_errors(&container, &scene, &options(Backend::Gpu)).unwrap();
        let again = stats.pixels_cast_again;
        println!("{name}: {again} pixels cast again");
        assert!(again > 0 && again < scene.pixels(), "{name}: {again} pixels cast again");
        assert!(equal_pixels(&picture, &by_cpu) >= again, "{name}: others than the CPU's pixels");
        assert!(difference(&picture, &by_cpu) <= TOLERANCE, "{name}: pixels of neither");
        let said = stats.error_stated.expect("it is asked for").largest_grey_levels;
        assert!(said <= ASKED + 1e-9, "{name}: {said} stated");
        let greatest = errors.expect("they are asked for").pixels.iter().fold(0.0f32, |most, error| most.max(error[0]));
        assert!(
            f64::from(greatest) * GREY_LEVELS <= ASKED + 1e-9 && stats.converged && stats.backend == "gpu",
            "{name}"
        );
        // Nobody asks for errors, and the pixels are the same.
        let silent = RenderOptions { predict_error: false, ..options(Backend::Gpu) };
        let (unstated, stats) = render(&container, &scene, &silent).unwrap();
        assert!(unstated == picture && stats.error_stated.is_none() && stats.error_predicted.is_none(), "{name}");
        assert_eq!(stats.pixels_cast_again, again, "{name}");
    }
}

/// Bricks are counted that any ray has met, not those alone that rays meet which are cast again.
#[test]
fn bricks_of_all_rays_are_counted() {
    if !has_adapter() {
        return;
    }
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let (_, scene) = scenes(&volume).swap_remove(3);
    let [cpu, gpu] = [Backend::Cpu, Backend::Gpu].map(|backend| {
        let options = RenderOptions { level: LevelChoice::Fixed(Lod(1)), ..options(backend) };
        render(&container, &scene, &options).unwrap().1
    });
    assert!(gpu.pixels_cast_again > 0 && gpu.pixels_cast_again < scene.pixels(), "{}", gpu.pixels_cast_again);
    assert_eq!((gpu.bricks_without_bound, gpu.error_bound), (cpu.bricks_without_bound, cpu.error_bound));
}

/// With deadlines the device's picture is shown first. Pixels are cast again until none is left, and the picture has not converged before.
#[test]
fn rays_are_cast_again_in_steps() {
    if !has_adapter() {
        return;
    }
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let scene = the_scene(&volume, &thin(), r#""mode": "dvr", "shading": {}, "image": {"width": 180, "height": 140}"#);
    let (expected, _) = render(&container, &scene, &options(Backend::Gpu)).unwrap();
    let mut renderer = Renderer::new(PlacedVolume::of(container), options(Backend::Gpu)).unwrap();
    renderer.set_scene(scene);
    let (mut steps, mut above) = (0, 0);
    loop {
        let step = renderer.advance(Some(Instant::now() + Duration::from_millis(20))).unwrap();
        let said = renderer.stats().error_stated.expect("it is asked for").largest_grey_levels;
        if step.is_finished {
            assert!(said <= ASKED + 1e-9, "{said} stated");
            break;
        }
        if step.pixels_unfinished == 0 {
            assert!(said > ASKED && !renderer.stats().converged, "{said} stated, and not finished");
            above += 1;
        }
        steps += 1;
        assert!(steps < 10_000, "rays are cast again and again");
    }
    assert!(above > 0, "the device's picture was never shown");
    assert!(difference(&renderer.picture().unwrap(), &expected) < 1e-3, "steps change the picture");
}
