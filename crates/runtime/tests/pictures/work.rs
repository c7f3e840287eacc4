//! Work of each ray: the picture does not change, the sums equal the statistics, and neither order nor interruptions
//! change a count.

#![allow(clippy::unwrap_used, reason = "helpers of tests are tests")]

use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::{Container, Lod, VoxelType};
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::{Renderer, render, render_with_maps};
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use crate::{containers, support};
use containers::{container_bytes, open};
use support::{Volume, marschner_lobb, points, scene};

const SIZE: [u32; 2] = [60, 44];

fn volume() -> Volume {
    let signal = marschner_lobb(40);
    // Nothing is visible in the upper half.
    Volume::new([40, 36, 48], VoxelType::U8, move |p| if p[2] > 24.0 { 0.0 } else { 255.0 * signal(p) })
}

/// A scene of this mode; more keys may follow.
fn wanted(volume: &Volume, mode: &str, more: &str) -> ResolvedScene {
    let tf = points(3.0, &[(90.0, [0.1, 0.2, 0.9], 0.0), (150.0, [0.9, 0.8, 0.1], 0.1), (255.0, [0.9, 0.1, 0.1], 0.4)]);
    let camera = r#"{"eye": [130.0, -80.0, 70.0], "target": [20, 18, 24], "up": [0, 0, 1], "fov_y": 26}"#;
    let [width, height] = SIZE;
    scene(
        volume,
        &format!(
            r#"{{"camera": {camera}, "image": {{"width": {width}, "height": {height}}}, "mode": "{mode}",
                "transfer_function": {tf}{more}}}"#
        ),
    )
}

fn options() -> RenderOptions {
    let level = LevelChoice::Fixed(Lod(0));
    RenderOptions { backend: Backend::Cpu, level, threads: Some(2), ..RenderOptions::default() }
}

fn counting() -> RenderOptions {
    RenderOptions { count_work: true, ..options() }
}

fn counted(container: &Arc<Container>, scene: &ResolvedScene) -> Image {
    render_with_maps(container, scene, &counting()).unwrap().1.work.expect("it was asked for")
}

fn sum(map: &Image, channel: usize) -> f64 {
    map.pixels.iter().map(|pixel| f64::from(pixel[channel])).sum()
}

#[test]
fn pictures_stay_and_sums_are_those_of_the_statistics() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let surface = r#", "iso": [{"value": 130, "color": [1, 1, 1], "alpha": 0.6}]"#;
    let lit = r#", "shading": {}"#;
    let ball = r#", "clip": {"solids": [{"keep": "outside", "sphere": {"center": [20, 18, 14], "radius": 9}}]}"#;
    let cases =
        [("dvr", ""), ("dvr", lit), ("dvr", ball), ("dvr", surface), ("iso", surface), ("mip", ""), ("mean", "")];
    for (mode, more) in cases {
        let scene = wanted(&volume, mode, more);
        let (plain, packets) = render(&container, &scene, &options()).unwrap();
        let (picture, maps, stats) = render_with_maps(&container, &scene, &counting()).unwrap();
        assert!(picture == plain && maps.errors.is_none(), "{mode}{more}: another picture");
        let map = maps.work.expect("it was asked for");
        let [cells, leaps] = [0, 1].map(|channel| sum(&map, channel));
        assert_eq!(
            (cells, leaps),
            (stats.casting.cells as f64, stats.casting.macro_cells_skipped as f64),
            "{mode}{more}"
        );
        // In a shared packet, rays learn at other times that they have ended.
        let share = cells / packets.casting.cells as f64;
        assert!((0.98..=1.02).contains(&share), "{mode}{more}: {cells} cells, {} in packets", packets.casting.cells);
        assert!(map.pixels.iter().all(|pixel| pixel[2..] == [0.0, 1.0]), "{mode}{more}");
    }
}

/// A ray beside the volume costs nothing, nor does one through invisible bricks. A ray through visible parts crosses
/// cells, and leaps between separate visible parts.
#[test]
fn work_lies_where_something_shows() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let camera = r#""camera": {"eye": [200, 18, 24], "target": [20, 18, 24], "up": [0, 0, 1], "height": 88}"#;
    let from = |volume: &Volume, least: f64| {
        let tf = points(3.0, &[(least, [1.0; 3], 0.0), (255.0, [1.0; 3], 0.02)]);
        let json = format!(
            r#"{{"mode": "dvr", "image": {{"width": 60, "height": 44}}, {camera}, "transfer_function": {tf}}}"#
        );
        scene(volume, &json)
    };
    let map = counted(&container, &from(&volume, 1.0));
    let at = |x: usize, y: usize| map.pixels[y * 60 + x];
    // Rows of two voxels: the volume reaches from row 10 to 34, its lower half is visible.
    assert_eq!(at(30, 4)[..2], [0.0, 0.0], "beside the volume");
    assert_eq!(at(30, 14)[0], 0.0, "through what shows nothing");
    assert!((39.0..=45.0).contains(&at(30, 28)[0]), "{} cells straight through 40 voxels", at(30, 28)[0]);
    // A ball of four voxels in a corner of a brick: rays leap to it, and away from it.
    let distance = |p: [f64; 3]| ((p[0] - 3.0).powi(2) + (p[1] - 3.0).powi(2) + (p[2] - 3.0).powi(2)).sqrt();
    let ball = Volume::new([16, 16, 16], VoxelType::U8, move |p| (255.0 - 30.0 * distance(p)).max(0.0));
    let bricks = open(&container_bytes(&ball, 16));
    let of_ball = counted(&bricks, &from(&ball, 135.0));
    let [cells, leaps] = [0, 1].map(|channel| sum(&of_ball, channel));
    assert!(leaps > 20.0 && cells > 20.0, "{cells} cells, {leaps} leaps");
}

#[test]
fn counts_depend_on_no_order_and_no_interruption() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let scene = wanted(&volume, "dvr", r#", "shading": {}, "samples_per_pixel": 4"#);
    let expected = counted(&container, &scene);
    let small = RenderOptions { cache_bytes: Some(60_000), threads: Some(1), ..counting() };
    let opened = supervol_runtime::render::volume::PlacedVolume::of(container.clone());
    let mut renderer = Renderer::new(opened, small).unwrap();
    renderer.set_scene(scene.clone());
    assert!(renderer.work_map().is_none(), "nothing is known yet");
    for _ in 0..100_000 {
        if renderer.advance(Some(Instant::now() + Duration::from_millis(2))).unwrap().is_finished {
            break;
        }
    }
    assert!(renderer.work_map().expect("it has converged") == expected);
    // Not requested, so there is none.
    renderer.set_options(options()).expect("options are right");
    renderer.advance(None).unwrap();
    assert!(renderer.work_map().is_none());
}
