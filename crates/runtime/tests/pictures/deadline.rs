//! Pictures with a deadline: always complete, better with more time, and final if there is enough.

#![allow(clippy::unwrap_used, reason = "helpers of tests are tests")]

use std::sync::Arc;
use std::time::Duration;

use supervol_format::{Container, Lod, VoxelType};
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::render;
use supervol_runtime::render::stats::FrameStats;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use crate::{containers, support};
use containers::{Faulty, container_bytes, open};
use support::{Volume, marschner_lobb, points, scene};

/// Pixels along x and y: more than a sketch has, and not a multiple of its pixels.
const SIZE: [u32; 2] = [205, 171];

fn volume() -> Volume {
    let signal = marschner_lobb(64);
    Volume::new([64, 60, 50], VoxelType::U8, move |p| 255.0 * signal(p))
}

/// The scene in a mode, with `samples` samples per pixel.
fn scene_of(volume: &Volume, mode: &str, samples: u32) -> ResolvedScene {
    let tf =
        points(4.0, &[(90.0, [0.1, 0.2, 0.9], 0.0), (160.0, [0.9, 0.8, 0.1], 0.05), (255.0, [0.9, 0.1, 0.1], 0.3)]);
    let camera = r#""eye": [190, -130, 120], "target": [31, 29, 24], "up": [0, 0, 1], "fov_y": 25"#;
    let [width, height] = SIZE;
    let image = format!(r#""image": {{"width": {width}, "height": {height}}}, "samples_per_pixel": {samples}"#);
    scene(volume, &format!(r#"{{"camera": {{{camera}}}, {image}, "mode": "{mode}", "transfer_function": {tf}}}"#))
}

fn options(time_budget_ms: Option<u64>) -> RenderOptions {
    let level = LevelChoice::Fixed(Lod::FINEST);
    RenderOptions { backend: Backend::Cpu, level, threads: Some(2), time_budget_ms, ..RenderOptions::default() }
}

/// Mean difference of the channels, grey levels.
fn mean_difference(a: &Image, b: &Image) -> f64 {
    let pairs = a.pixels.as_flattened().iter().zip(b.pixels.as_flattened());
    255.0 * pairs.map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / a.pixels.as_flattened().len() as f64
}

/// Properties of every picture, however little time there was.
fn assert_whole(image: &Image, stats: &FrameStats) {
    assert!([image.width, image.height] == SIZE && image.is_finite(), "{stats:#?}");
    assert_eq!(stats.converged, stats.pixels_unfinished == 0, "{stats:#?}");
    assert_eq!(stats.coarsest_pixel == 0, stats.pixels_unfinished == 0, "{stats:#?}");
}

#[test]
fn where_there_is_time_enough_it_is_the_very_picture() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    for (mode, samples) in [("dvr", 1), ("mip", 1), ("dvr", 9)] {
        let scene = scene_of(&volume, mode, samples);
        let (expected, _) = render(&container, &scene, &options(None)).unwrap();
        let (image, stats) = render(&container, &scene, &options(Some(600_000))).unwrap();
        assert_whole(&image, &stats);
        assert!(stats.converged && image == expected, "{mode}, {samples}: {stats:#?}");
    }
}

#[test]
fn without_any_time_it_is_a_sketch_of_the_whole() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    for (mode, samples) in [("dvr", 1), ("mip", 1), ("mean", 1), ("dvr", 9)] {
        let scene = scene_of(&volume, mode, samples);
        let (expected, _) = render(&container, &scene, &options(None)).unwrap();
        let (image, stats) = render(&container, &scene, &options(Some(0))).unwrap();
        assert_whole(&image, &stats);
        let pixels = u64::from(SIZE[0]) * u64::from(SIZE[1]);
        assert!(stats.pixels_unfinished == pixels && stats.coarsest_pixel == 4, "{stats:#?}");
        assert_eq!(stats.streaming.page_ins, 1, "only the coarsest brick is read");
        let black = Image { pixels: vec![[0.0; 4]; expected.pixels.len()], ..expected.clone() };
        let (sketch, nothing) = (mean_difference(&image, &expected), mean_difference(&black, &expected));
        assert!(sketch < 0.25 * nothing, "{mode}: off by {sketch} where black is off by {nothing}");
    }
}

/// Reads are slow, so that the deadline passes while bricks are fetched.
#[test]
fn a_slow_source_does_not_keep_the_picture() {
    let volume = volume();
    let bytes = container_bytes(&volume, 16);
    let scene = scene_of(&volume, "dvr", 1);
    let (expected, _) = render(&open(&bytes), &scene, &options(None)).unwrap();
    let draw = |time_budget_ms| {
        let slow = Faulty::slow(bytes.clone(), Duration::from_millis(20));
        let container = Arc::new(Container::from_source(slow).unwrap());
        let (image, stats) = render(&container, &scene, &options(Some(time_budget_ms))).unwrap();
        assert_whole(&image, &stats);
        (mean_difference(&image, &expected), stats)
    };
    let (sketch, _) = draw(0);
    let (early, stats) = draw(100);
    assert!(!stats.converged && stats.pixels_unfinished > 0, "{stats:#?}");
    assert!(early <= sketch, "off by {early}, the sketch by {sketch}");
    let (late, stats) = draw(600_000);
    assert!(stats.converged && late == 0.0, "{stats:#?}");
}
