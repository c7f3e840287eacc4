//! Slices within pictures: the CPU backend against the reference integrator, for all modes, cameras and interpolations;
//! in steps; and against closed forms.

#![allow(clippy::unwrap_used, reason = "helpers of tests are tests")]

use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::{Container, Lod, VoxelType};
use supervol_runtime::render::error::RenderError;
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::{Renderer, render, render_on_device, render_with_errors};
use supervol_runtime::render::volume::PlacedVolume;
use supervol_scene::image::{GREY_LEVELS, Image};
use supervol_scene::scene::{ResolvedScene, Scene};

use crate::{containers, gpu_support, support};
use containers::{container_bytes, open};
use support::{Volume, difference, marschner_lobb, points, reference, scene};

const SIZE: [u32; 2] = [60, 44];

fn volume() -> Volume {
    let signal = marschner_lobb(40);
    let volume = Volume::new([40, 36, 30], VoxelType::U8, move |p| 5.0 + 250.0 * signal(p));
    let volume = volume.with_geometry([1.0, 1.2, 0.8], [3.0, -2.0, 7.0], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let holed = volume.with_holes(|[i, j, k]| (14..18).contains(&i) && (20..24).contains(&j) && k < 9);
    Volume { nodata: Some(0.0), ..holed }
}

/// A scene with these slices; more keys may follow.
fn wanted(slices: &str, more: &str) -> String {
    let tf = points(3.0, &[(90.0, [0.1, 0.2, 0.9], 0.0), (150.0, [0.9, 0.8, 0.1], 0.1), (255.0, [0.9, 0.1, 0.1], 0.4)]);
    let camera = r#"{"eye": [110.0, -70.0, 60.0], "target": [22, 19, 18], "up": [0, 0, 1], "fov_y": 28}"#;
    let camera = if more.contains("\"camera\"") { String::new() } else { format!("\"camera\": {camera},") };
    let [width, height] = SIZE;
    format!(
        r#"{{{camera} "image": {{"width": {width}, "height": {height}}}, "transfer_function": {tf}, "slices": [{slices}]{more}}}"#
    )
}

fn plane(normal: [f64; 3], offset: f64, more: &str) -> String {
    let colors = r#"[{"value": 0, "color": [0, 0.1, 0]}, {"value": 255, "color": [0.9, 1, 0.8]}]"#;
    format!(r#"{{"normal": {normal:?}, "offset": {offset}, "colors": {colors}{more}}}"#)
}

fn options(level: LevelChoice) -> RenderOptions {
    RenderOptions { backend: Backend::Cpu, level, threads: Some(2), ..RenderOptions::default() }
}

fn drawn(container: &Arc<Container>, scene: &ResolvedScene) -> Image {
    render(container, scene, &options(LevelChoice::Auto)).unwrap().0
}

/// Three slices, oblique and aligned, opaque and semi-transparent.
fn three(more: &str) -> String {
    [
        plane([1.0, 0.3, 0.2], 32.0, more),
        plane([0.0, 0.0, -2.0], -34.0, r#", "opacity": 0.6"#),
        plane([0.0, 1.0, 0.0], 12.0, r#", "opacity": 0.3"#),
    ]
    .join(",")
}

/// Slices, and further keys of the scene.
fn cases() -> Vec<(String, &'static str)> {
    let lit = r#", "shading": {}"#;
    let iso = r#", "mode": "iso", "iso": [{"value": 130, "color": [1, 0.5, 0.2], "alpha": 0.5}]"#;
    let parallel = r#", "camera": {"eye": [80, 60, -40], "target": [22, 19, 18], "up": [0, 0, 1], "height": 50}"#;
    vec![
        (three(""), ""),
        (three(r#", "interpolation": "cubic""#), lit),
        (three(r#", "interpolation": "nearest""#), parallel),
        (three(""), iso),
        (three(r#", "opacity": 0.5"#), r#", "samples_per_pixel": 4"#),
        (three(""), r#", "mode": "slice""#),
        (three(""), r#", "clip": {"box": [[3, 4, 2], [30, 30, 25]], "planes": [{"normal": [0, 1, 1], "offset": 20}]}"#),
        // Slices in one place, beside the volume, and along the rays.
        (
            [
                plane([1.0, 0.0, 0.0], 20.0, r#", "opacity": 0.4"#),
                plane([-2.0, 0.0, 0.0], -40.0, r#", "opacity": 0.4"#),
                plane([1.0, 0.0, 0.0], 900.0, ""),
            ]
            .join(","),
            "",
        ),
        (
            plane([1.0, 0.0, 0.0], 20.0, ""),
            r#", "camera": {"eye": [20, -70, 18], "target": [20, 0, 18], "up": [0, 0, 1], "height": 50}"#,
        ),
    ]
}

fn assert_agree(exact: &Image, picture: &Image, slices: &str, more: &str) {
    // The nearest voxel changes abruptly: a ray may fall on either side of the face between two.
    let off = exact
        .pixels
        .iter()
        .zip(&picture.pixels)
        .filter(|(a, b)| (0..4).any(|c| f64::from((a[c] - b[c]).abs()) * GREY_LEVELS > 0.6));
    let allowed = if slices.contains("nearest") { 3 } else { 0 };
    assert!(off.count() <= allowed, "{more}: {} levels off", difference(exact, picture));
}

#[test]
fn pictures_with_slices_are_those_of_the_reference() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    for (slices, more) in cases() {
        let scene = scene(&volume, &wanted(&slices, more));
        let (exact, picture) = (reference(&volume, &scene), drawn(&container, &scene));
        assert_agree(&exact, &picture, &slices, more);
        // A slice seen along its plane has no width.
        if more.contains("[20, -70, 18]") {
            continue;
        }
        let without = support::scene(&volume, &wanted("", &more.replace("slice", "dvr")));
        assert!(difference(&picture, &reference(&volume, &without)) > 20.0, "{more}: the slices cannot be seen");
    }
}

/// A device draws the volume between slices, the CPU their colours; at once and in steps.
#[test]
fn graphics_devices_draw_the_volume_between_slices() {
    let Some(gpu) = gpu_support::shared_gpu() else { return };
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let device = RenderOptions { backend: Backend::Gpu, ..options(LevelChoice::Auto) };
    for (slices, more) in cases().into_iter().filter(|(_, more)| !more.contains(r#""slice""#)) {
        let scene = scene(&volume, &wanted(&slices, more));
        let (picture, _, stats) = render_on_device(gpu.clone(), &container, &scene, &device).unwrap();
        assert!(stats.converged && stats.backend == "gpu", "{more}: {stats:?}");
        assert_agree(&reference(&volume, &scene), &picture, &slices, more);
        let mut renderer =
            Renderer::on_device(PlacedVolume::of(container.clone()), device.clone(), gpu.clone()).unwrap();
        renderer.set_scene(scene);
        let converged = (0..10_000).any(|n| {
            let step = renderer.advance(Some(Instant::now() + Duration::from_millis(n % 8))).unwrap();
            assert!(renderer.picture().unwrap().is_finite());
            step.is_finished
        });
        assert!(converged && *renderer.picture().unwrap() == picture, "{more}: in steps");
    }
}

#[test]
fn filtered_slices_are_those_of_the_reference() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    for filter in [
        r#"{"kind": "gaussian", "size": 1.5}"#,
        r#"{"kind": "median"}"#,
        r#"{"kind": "sobel"}"#,
        r#"{"kind": "laplacian"}"#,
        r#"{"kind": "marr-hildreth", "size": 2}"#,
    ] {
        let slice = format!(r#"{{"normal": [0, 0.1, 1], "offset": 19, "filter": {filter}}}"#);
        let scene = scene(&volume, &wanted(&slice, r#", "mode": "slice""#));
        let (exact, picture) = (reference(&volume, &scene), drawn(&container, &scene));
        assert!(difference(&exact, &picture) <= 0.6, "{filter}: {}", difference(&exact, &picture));
        assert!(picture.pixels.iter().any(|p| p[3] == 1.0 && p[0] > 0.1), "{filter}: nothing is shown");
    }
}

/// A semi-transparent slice in fog: the fog in front of it, the slice, the fog behind it.
#[test]
fn a_slice_lies_at_its_exact_depth() {
    let volume = Volume::new([20, 20, 20], VoxelType::F32, |_| 1.0);
    let container = open(&container_bytes(&volume, 16));
    let tf = points(1.0, &[(0.0, [1.0, 0.0, 0.0], 0.1), (2.0, [1.0, 0.0, 0.0], 0.1)]);
    let json = format!(
        r#"{{"camera": {{"eye": [9.5, 9.5, -50], "target": [9.5, 9.5, 0], "up": [0, 1, 0], "height": 10}},
        "image": {{"width": 8, "height": 8}}, "transfer_function": {tf},
        "slices": [{{"normal": [0, 0, 1], "offset": 4.5, "opacity": 0.25, "colors": [{{"value": 1, "color": [0, 0, 1]}}]}}]}}"#
    );
    let scene = scene(&volume, &json);
    let through = |length: f64| 0.9f64.powf(length);
    let (before, all) = (through(5.0), through(20.0));
    let expected = [1.0 - before + before * 0.75 * (1.0 - through(15.0)), 0.0, 0.25 * before, 1.0 - 0.75 * all];
    for picture in [drawn(&container, &scene), reference(&volume, &scene)] {
        for pixel in &picture.pixels {
            assert!((0..4).all(|c| (f64::from(pixel[c]) - expected[c]).abs() < 1e-3), "{pixel:?}, {expected:?}");
        }
    }
}

#[test]
fn in_steps_it_becomes_the_picture_that_is_drawn_at_once_and_states_its_error() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let larger = wanted(&three(""), "").replace("60", "150").replace("44", "110");
    let scene = scene(&volume, &larger);
    for level in [LevelChoice::Auto, LevelChoice::Fixed(Lod(1))] {
        let options = RenderOptions { predict_error: true, cache_bytes: Some(60_000), ..options(level) };
        let (expected, errors, stats) = render_with_errors(&container, &scene, &options).unwrap();
        let mut renderer = Renderer::new(PlacedVolume::of(container.clone()), options).unwrap();
        renderer.set_scene(scene.clone());
        // Each step makes progress, however short it is.
        let converged = (0..10_000).any(|n| {
            let step = renderer.advance(Some(Instant::now() + Duration::from_millis(n % 3))).unwrap();
            assert!(renderer.picture().unwrap().is_finite());
            step.is_finished
        });
        assert!(converged && *renderer.picture().unwrap() == expected, "{level:?}");
        let stated = stats.error_stated.expect("the error is stated");
        let exact = difference(&reference(&volume, &scene), &expected);
        assert!(exact <= stated.largest_grey_levels, "{level:?}: {exact} off, {stated:?}");
        // Exact slices have no error; that of coarser ones is unknown.
        let is_coarse = matches!(level, LevelChoice::Fixed(_));
        assert_eq!(stated.largest_grey_levels > 100.0, is_coarse, "{stated:?}");
        assert!(errors.is_some_and(|map| map.pixels.len() == expected.pixels.len()));
    }
}

#[test]
fn slices_that_cannot_be_drawn_are_refused_by_name() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let json = |slices: &str, more: &str| Scene::from_json(&wanted(slices, more)).map_err(|e| e.to_string());
    for (slices, more, word) in [
        (plane([0.0; 3], 1.0, ""), "", "slices[0].normal"),
        (plane([1.0, 0.0, 0.0], 1.0, r#", "opacity": 2"#), "", "slices[0].opacity"),
        (plane([1.0, 0.0, 0.0], 1.0, r#", "filter": {"kind": "sobel", "size": 2}"#), "", "has no size"),
        (plane([1.0, 0.0, 0.0], 1.0, r#", "filter": {"kind": "median", "size": 99}"#), "", "1 to 8"),
        (vec![plane([1.0, 0.0, 0.0], 1.0, ""); 9].join(","), "", "at most 8"),
        (three(""), r#", "mode": "mip""#, "without depth"),
        (String::new(), r#", "mode": "slice""#, "at least one"),
    ] {
        let message = json(&slices, more).unwrap_err();
        assert!(message.contains(word), "{message}");
    }
    let scene = scene(&volume, &wanted(&three(""), r#", "mode": "slice""#));
    let gpu = RenderOptions { backend: Backend::Gpu, ..options(LevelChoice::Auto) };
    // A machine without a graphics device reports that instead.
    let refused = render(&container, &scene, &gpu);
    assert!(matches!(refused, Err(RenderError::SlicesOnGpu | RenderError::Engine(_))));
}

/// Three slices make eight regions. A picture of all rays for each of them would take 160 bytes per ray.
#[test]
fn memory_does_not_grow_with_the_number_of_regions() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let (width, height) = (2000, 1500);
    let needed = |slices: &str| {
        let size = format!(r#""width": {width}, "height": {height}"#);
        let scene = scene(&volume, &wanted(slices, "").replace(r#""width": 60, "height": 44"#, &size));
        let options = RenderOptions { host_memory_bytes: 1 << 20, ..options(LevelChoice::Auto) };
        match render(&container, &scene, &options) {
            Err(RenderError::Budget(error)) => error.needed_bytes as f64 / f64::from(width * height),
            other => panic!("{:?}", other.map(|(_, stats)| stats)),
        }
    };
    let (one, all) = (needed(&plane([1.0, 0.3, 0.2], 32.0, "")), needed(&three("")));
    assert!((50.0..90.0).contains(&one) && all < one + 25.0, "{one} and {all} bytes per ray");
}
