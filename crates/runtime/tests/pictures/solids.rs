//! Volumes clipped by solids: the CPU backend against the reference integrator, for all modes and solids; in steps,
//! with small caches, from coarser levels; against closed forms.

#![allow(clippy::unwrap_used, reason = "helpers of tests are tests")]

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use glam::DVec3;
use supervol_format::{Container, Lod, VoxelType};
use supervol_runtime::engines::cells::CellRule;
use supervol_runtime::engines::cpu::Caster;
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::{Renderer, render, render_on_device, render_with_errors};
use supervol_runtime::render::volume::PlacedVolume;
use supervol_scene::image::{GREY_LEVELS, Image, greatest};
use supervol_scene::scene::{ResolvedScene, Scene};

use crate::{containers, gpu_support, support};
use containers::{container_bytes, open};
use support::{Volume, difference, marschner_lobb, points, reference, scene};

const SIZE: [u32; 2] = [44, 32];
const ISO: &str = r#", "mode": "iso", "iso": [{"value": 130, "color": [1, 0.5, 0.2], "alpha": 0.5}, {"value": 190, "color": [0.2, 0.5, 1]}]"#;

fn volume() -> Volume {
    let signal = marschner_lobb(40);
    let volume = Volume::new([40, 36, 30], VoxelType::U8, move |p| 5.0 + 250.0 * signal(p));
    let volume = volume.with_geometry([1.0, 1.2, 0.8], [3.0, -2.0, 7.0], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let holed = volume.with_holes(|[i, j, k]| (14..18).contains(&i) && (20..24).contains(&j) && k < 9);
    Volume { nodata: Some(0.0), ..holed }
}

/// A scene with these solids; more keys may follow.
fn wanted(solids: &str, more: &str) -> String {
    let tf = points(3.0, &[(90.0, [0.1, 0.2, 0.9], 0.0), (150.0, [0.9, 0.8, 0.1], 0.1), (255.0, [0.9, 0.1, 0.1], 0.4)]);
    let camera = r#"{"eye": [110.0, -70.0, 60.0], "target": [22, 19, 18], "up": [0, 0, 1], "fov_y": 28}"#;
    let camera = if more.contains("\"camera\"") { String::new() } else { format!("\"camera\": {camera},") };
    let [width, height] = SIZE;
    format!(
        r#"{{{camera} "image": {{"width": {width}, "height": {height}}}, "transfer_function": {tf},
            "clip": {{"solids": [{solids}]}}{more}}}"#
    )
}

fn options(level: LevelChoice) -> RenderOptions {
    RenderOptions { backend: Backend::Cpu, level, threads: Some(2), ..RenderOptions::default() }
}

fn drawn(container: &Arc<Container>, scene: &ResolvedScene) -> Image {
    render(container, scene, &options(LevelChoice::Auto)).unwrap().0
}

/// A ball that is removed from the middle, and a rotated box that is kept.
const BALL_AND_BOX: &str = r#"{"keep": "outside", "sphere": {"center": [24, 18, 17], "radius": 9}},
    {"box": {"center": [22, 19, 18], "edges": [30, 34, 22], "axes": [[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]]}}"#;

const DRUM: &str = r#"{"keep": "outside", "cylinder": {"from": [5, -5, 10], "to": [40, 45, 24], "radius": 6}}"#;
const PARALLEL: &str = r#", "camera": {"eye": [80, 60, -40], "target": [22, 19, 18], "up": [0, 0, 1], "height": 50}"#;
const INSIDE: &str = r#", "camera": {"eye": [24, 18, 17], "target": [30, 30, 20], "up": [0, 0, 1], "fov_y": 70}"#;

/// A ring around an axis, as a mesh.
fn write_ring(path: &Path, center: DVec3, [outer, inner]: [f64; 2]) {
    let (along, around) = (24, 12);
    let mut text = String::new();
    let angle = |i: u32, n: u32| std::f64::consts::TAU * f64::from(i) / f64::from(n);
    for (i, j) in (0..along).flat_map(|i| (0..around).map(move |j| (i, j))) {
        let (u, v) = (angle(i, along), angle(j, around));
        let r = outer + inner * v.cos();
        let p = center + DVec3::new(r * u.cos(), inner * v.sin(), r * u.sin());
        writeln!(text, "v {} {} {}", p.x, p.y, p.z).unwrap();
    }
    for (i, j) in (0..along).flat_map(|i| (0..around).map(move |j| (i, j))) {
        let number = |i: u32, j: u32| i % along * around + j % around + 1;
        writeln!(text, "f {} {} {} {}", number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1))
            .unwrap();
    }
    std::fs::write(path, text).unwrap();
}

fn assert_agree(exact: &Image, picture: &Image, silhouettes: usize, what: &str) {
    let pairs = exact.pixels.iter().zip(&picture.pixels);
    let off = pairs.filter(|(a, b)| (0..4).any(|c| f64::from((a[c] - b[c]).abs()) * GREY_LEVELS > 0.5)).count();
    assert!(off <= silhouettes, "{what}: {off} pixels, {} levels off", difference(exact, picture));
}

#[test]
fn pictures_clipped_by_solids_are_those_of_the_reference() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ring.obj");
    write_ring(&path, DVec3::new(24.0, 19.0, 17.0), [9.0, 4.0]);
    let ring = |keep: &str| format!(r#"{{"keep": "{keep}", "mesh": {:?}}}"#, path.to_str().unwrap());
    for more in ["", r#", "shading": {}"#, r#", "mode": "mip""#, r#", "mode": "minip""#, r#", "mode": "mean""#, ISO] {
        let whole = reference(&volume, &scene(&volume, &wanted("", more)));
        for solids in [BALL_AND_BOX.to_owned(), ring("inside"), format!("{},{DRUM}", ring("outside"))] {
            let scene = scene(&volume, &wanted(&solids, more));
            let (exact, picture) = (reference(&volume, &scene), drawn(&container, &scene));
            assert_agree(&exact, &picture, 0, &format!("{more} {solids}"));
            assert!(difference(&exact, &whole) > 20.0, "{more} {solids}: nothing is cut away");
        }
    }
    for more in [PARALLEL, INSIDE, r#", "samples_per_pixel": 4"#] {
        let scene = scene(&volume, &wanted(BALL_AND_BOX, more));
        assert_agree(&reference(&volume, &scene), &drawn(&container, &scene), 0, more);
    }
    // With a slice, whose plane is cut as well.
    let slice = r#", "slices": [{"normal": [1, 0.3, 0.2], "offset": 32,
        "colors": [{"value": 0, "color": [0, 0.1, 0]}, {"value": 255, "color": [0.9, 1, 0.8]}]}]"#;
    let scene = scene(&volume, &wanted(BALL_AND_BOX, slice));
    assert_agree(&reference(&volume, &scene), &drawn(&container, &scene), 0, slice);
}

/// Twelve slabs are removed across the rays: more parts of a ray than are found at once.
#[test]
fn rays_in_many_parts_are_drawn_whole() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let slab = |i: u32| {
        let x = 5.0 + 3.0 * f64::from(i);
        format!(r#"{{"keep": "outside", "box": {{"center": [{x}, 19, 18], "edges": [1.1, 90, 90]}}}}"#)
    };
    let slabs: Vec<String> = (0..12).map(slab).collect();
    let along = r#", "camera": {"eye": [120, 15, 25], "target": [22, 19, 18], "up": [0, 0, 1], "fov_y": 22}"#;
    for mode in ["", r#", "mode": "mean""#, r#", "mode": "mip""#, ISO] {
        let more = format!("{along}{mode}");
        let scene = scene(&volume, &wanted(&slabs.join(","), &more));
        let exact = reference(&volume, &scene);
        assert_agree(&exact, &drawn(&container, &scene), 0, mode);
        // In each of their parts, rays may wait for bricks.
        let memory = RenderOptions { host_memory_bytes: 4 << 20, ..options(LevelChoice::Auto) };
        assert_agree(&exact, &render(&container, &scene, &memory).unwrap().0, 0, mode);
    }
}

/// Ray by ray in `f64`: the caster that packets are compared with.
#[test]
fn the_scalar_caster_cuts_as_packets_do() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let scene = scene(&volume, &wanted(BALL_AND_BOX, ""));
    let caster = Caster::Cells(CellRule::DEFAULT);
    let (picture, stats) = render(&container, &scene, &RenderOptions { caster, ..options(LevelChoice::Auto) }).unwrap();
    assert!(stats.converged);
    assert_agree(&reference(&volume, &scene), &picture, 0, "cells");
}

/// Fog clipped by a ball: the picture shows the length of the rays in it.
#[test]
fn fog_in_a_ball_is_as_thick_as_the_ball() {
    let volume = Volume::new([20, 20, 20], VoxelType::F32, |_| 1.0);
    let container = open(&container_bytes(&volume, 16));
    let tf = points(1.0, &[(0.0, [1.0, 0.0, 0.0], 0.1), (2.0, [1.0, 0.0, 0.0], 0.1)]);
    let picture = |keep: &str| {
        let json = format!(
            r#"{{"camera": {{"eye": [9.5, 9.5, -30], "target": [9.5, 9.5, 9.5], "up": [0, 1, 0], "height": 16}},
                "image": {{"width": 32, "height": 32}}, "transfer_function": {tf},
                "clip": {{"solids": [{{"keep": "{keep}", "sphere": {{"center": [9.5, 9.5, 9.5], "radius": 6}}}}]}}}}"#
        );
        drawn(&container, &scene(&volume, &json))
    };
    let (inside, outside) = (picture("inside"), picture("outside"));
    for (n, (a, b)) in inside.pixels.iter().zip(&outside.pixels).enumerate() {
        let [x, y] = [n % 32, n / 32].map(|p| (p as f64 + 0.5) * 0.5 - 8.0);
        let chord = 2.0 * (36.0 - x * x - y * y).max(0.0).sqrt();
        let opacity = |length: f64| 1.0 - 0.9f64.powf(length);
        let off = [f64::from(a[3]) - opacity(chord), f64::from(b[3]) - opacity(20.0 - chord)];
        assert!(off.iter().all(|off| off.abs() * GREY_LEVELS < 0.1), "pixel {n}: {off:?}");
    }
}

/// A mesh of a box is a box.
#[test]
fn a_box_of_triangles_cuts_like_a_box() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("box.obj");
    let text = "v 10 5 12\nv 30 5 12\nv 30 31 12\nv 10 31 12\nv 10 5 25\nv 30 5 25\nv 30 31 25\nv 10 31 25\n\
        f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
    std::fs::write(&path, text).unwrap();
    let mesh = format!(r#"{{"keep": "outside", "mesh": {:?}}}"#, path.to_str().unwrap());
    let cuboid = r#"{"keep": "outside", "box": {"center": [20, 18, 18.5], "edges": [20, 26, 13]}}"#;
    let [by_mesh, by_box] = [&mesh[..], cuboid].map(|solid| drawn(&container, &scene(&volume, &wanted(solid, ISO))));
    assert!(difference(&by_mesh, &by_box) < 0.01, "{}", difference(&by_mesh, &by_box));
    let open = text.replace("f 4 1 5 8\n", "");
    std::fs::write(&path, open).unwrap();
    let refused = Scene::from_json(&wanted(&mesh, "")).unwrap().resolve(&volume.facts()).unwrap_err().to_string();
    assert!(refused.contains("clip.solids[0].mesh") && refused.contains("open edge"), "{refused}");
}

/// The order of bricks, the size of the cache and interruptions do not change a bit.
#[test]
fn pictures_in_steps_are_those_in_one_go() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    for more in ["", ISO, r#", "mode": "mean""#] {
        let scene = scene(&volume, &wanted(BALL_AND_BOX, more));
        let expected = drawn(&container, &scene);
        let few = RenderOptions { cache_bytes: Some(64 << 10), ..options(LevelChoice::Auto) };
        let (picture, stats) = render(&container, &scene, &few).unwrap();
        assert!(stats.streaming.evictions > 0, "the cache holds everything");
        assert_eq!(picture.pixels, expected.pixels, "{more}: small cache");
        let mut renderer = Renderer::new(PlacedVolume::of(container.clone()), options(LevelChoice::Auto)).unwrap();
        renderer.set_scene(scene);
        let mut steps = 0;
        while !renderer.advance(Some(Instant::now() + Duration::from_micros(200))).unwrap().is_finished {
            steps += 1;
            assert!(steps < 10_000, "no end");
        }
        assert_eq!(renderer.picture().unwrap().pixels, expected.pixels, "{more}: after {steps} steps");
    }
}

#[test]
fn the_stated_error_holds() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    for more in ["", r#", "mode": "mip""#, ISO] {
        let scene = scene(&volume, &wanted(BALL_AND_BOX, more));
        let exact = reference(&volume, &scene);
        for level in [LevelChoice::Auto, LevelChoice::Fixed(Lod(1))] {
            let options = RenderOptions { predict_error: true, ..options(level) };
            let (picture, errors, stats) = render_with_errors(&container, &scene, &options).unwrap();
            let errors = errors.unwrap();
            assert!(stats.error_stated.is_some(), "{more}: nothing is stated");
            for (n, (a, b)) in exact.pixels.iter().zip(&picture.pixels).enumerate() {
                let off = greatest((0..4).map(|c| f64::from(a[c] - b[c])));
                assert!(
                    off <= f64::from(errors.pixels[n][0]) + 1e-4,
                    "{more} {level:?}: pixel {n}: {off} > {}",
                    errors.pixels[n][0]
                );
            }
        }
    }
}

/// The host computes the list of parts, mode by mode. With few slots, rays wait for bricks in each part.
#[test]
fn graphics_devices_cut_by_solids_as_the_reference_does() {
    let Some(gpu) = gpu_support::shared_gpu() else { return };
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ring.obj");
    write_ring(&path, DVec3::new(24.0, 19.0, 17.0), [9.0, 4.0]);
    let ring = format!(r#"{{"keep": "outside", "mesh": {:?}}},{DRUM}"#, path.to_str().unwrap());
    let device = RenderOptions { backend: Backend::Gpu, ..options(LevelChoice::Auto) };
    for more in [
        "",
        r#", "shading": {}"#,
        r#", "mode": "mip""#,
        r#", "mode": "minip""#,
        r#", "mode": "mean""#,
        ISO,
        PARALLEL,
        INSIDE,
    ] {
        for solids in [BALL_AND_BOX, &ring] {
            let scene = scene(&volume, &wanted(solids, more));
            let (picture, _, stats) = render_on_device(gpu.clone(), &container, &scene, &device).unwrap();
            assert!(stats.converged && stats.backend == "gpu", "{stats:?}");
            assert_agree(&reference(&volume, &scene), &picture, 0, &format!("{more} {solids}"));
        }
    }
    let scene = scene(&volume, &wanted(&format!("{BALL_AND_BOX},{ring}"), r#", "samples_per_pixel": 4"#));
    let (expected, ..) = render_on_device(gpu.clone(), &container, &scene, &device).unwrap();
    assert_agree(&reference(&volume, &scene), &expected, 0, "several rays a pixel");
    let few = RenderOptions { cache_bytes: Some(64 << 10), ..device };
    assert_eq!(render_on_device(gpu.clone(), &container, &scene, &few).unwrap().0, expected, "small cache");
    let mut renderer = Renderer::on_device(PlacedVolume::of(container), few, gpu).unwrap();
    renderer.set_scene(scene);
    let mut steps = 0;
    while !renderer.advance(Some(Instant::now() + Duration::from_millis(2))).unwrap().is_finished {
        steps += 1;
        assert!(steps < 10_000, "no end");
    }
    assert_eq!(*renderer.picture().unwrap(), expected, "after {steps} steps");
}
