//! Packed bricks in the host cache: pictures are those of plain bricks, bit for bit, and the form follows the budget.

#![allow(clippy::unwrap_used, reason = "helpers of tests are tests")]

use std::sync::Arc;

use supervol_format::{Container, Lod, VoxelType};
use supervol_runtime::engines::cells::CellRule;
use supervol_runtime::engines::cpu::Caster;
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::{Renderer, render, render_on_device};
use supervol_runtime::render::stats::FrameStats;
use supervol_runtime::render::volume::PlacedVolume;
use supervol_runtime::stream::held::BrickForm;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use crate::{containers, gpu_support, support};
use containers::{container_bytes, open};
use support::{Volume, marschner_lobb, noise, points, scene};

/// Bytes of the cache: all bricks fit, and packing pays.
const CACHE: u64 = 4 << 20;

fn options(brick_form: BrickForm) -> RenderOptions {
    let level = LevelChoice::Auto;
    RenderOptions {
        backend: Backend::Cpu,
        level,
        threads: Some(2),
        cache_bytes: Some(CACHE),
        brick_form,
        ..RenderOptions::default()
    }
}

/// Volumes of several voxel types, with and without holes; values from 0 to 250.
fn volumes() -> Vec<(&'static str, Volume)> {
    let signal = marschner_lobb(40);
    let field = |p: [f64; 3]| 250.0 * signal(p);
    let dims = [40, 37, 33];
    let hole = |[i, j, k]: [usize; 3]| (10..16).contains(&i) && (8..30).contains(&j) && k < 20;
    let volume = |voxel_type| Volume::new(dims, voxel_type, field);
    let labels = |p: [f64; 3]| (signal(p) * 5.0).floor() * 50.0;
    let noisy = |p: [f64; 3]| 120.0 + 100.0 * noise(p) + 20.0 * signal(p);
    let holed = |voxel_type| Volume { nodata: Some(255.0), ..volume(voxel_type).with_holes(hole) };
    vec![
        ("u8", volume(VoxelType::U8)),
        ("u8 with holes", holed(VoxelType::U8)),
        ("u16 with holes", holed(VoxelType::U16)),
        ("i16", volume(VoxelType::I16)),
        ("f32", volume(VoxelType::F32)),
        ("f32 with holes", volume(VoxelType::F32).with_holes(hole)),
        ("f32 in steps", Volume::new(dims, VoxelType::F32, |p| (field(p) * 2.0).round() * 0.5)),
        ("labels", Volume::new(dims, VoxelType::U8, labels)),
        ("noise", Volume::new(dims, VoxelType::U16, noisy)),
        ("a section", Volume::new([1, 60, 55], VoxelType::F32, |p| 250.0 * noise([p[1].floor(), p[2], 0.0]))),
    ]
}

fn scenes(volume: &Volume) -> Vec<(String, ResolvedScene)> {
    let [x, y, z] = volume.dims.map(|n| n as f64 * 0.5);
    let tf = points(4.0, &[(60.0, [0.1, 0.2, 0.9], 0.0), (140.0, [0.9, 0.8, 0.1], 0.1), (250.0, [0.9, 0.1, 0.1], 0.6)]);
    let camera = format!(
        r#""eye": [{}, {}, {}], "target": [{x}, {y}, {z}], "up": [0, 0, 1], "fov_y": 30"#,
        x + 90.0,
        y - 70.0,
        z + 40.0
    );
    let iso = r#", "iso": [{"value": 130, "color": [1, 0.5, 0.2], "alpha": 0.6}]"#;
    let slice = format!(
        r#", "slices": [{{"normal": [1, 0.2, 0.1], "offset": {x}, "colors": [{{"value": 0, "color": [0, 0, 0]}}, {{"value": 250, "color": [1, 1, 1]}}]}}]"#
    );
    let mut scenes = Vec::new();
    for (mode, more) in
        [("dvr", ""), ("dvr", iso), ("iso", iso), ("mip", ""), ("minip", ""), ("mean", ""), ("dvr", slice.as_str())]
    {
        for shading in ["null", "{}"] {
            let json = format!(
                r#"{{"camera": {{{camera}}}, "image": {{"width": 40, "height": 36}}, "mode": "{mode}",
                    "transfer_function": {tf}, "shading": {shading}{more}}}"#
            );
            scenes.push((format!("{mode}{more}, shading {shading}"), scene(volume, &json)));
        }
    }
    scenes
}

#[test]
fn pictures_of_packed_bricks_are_those_of_plain_ones() {
    for (name, volume) in volumes() {
        let container = open(&container_bytes(&volume, 16));
        let mut packed_bricks = 0;
        for (what, scene) in scenes(&volume) {
            let drawn = |form| render(&container, &scene, &options(form)).unwrap();
            let ((plain, stats), (packed, of_packed)) = (drawn(BrickForm::Plain), drawn(BrickForm::Packed));
            assert!(plain == packed, "{name}, {what}");
            assert_eq!(stats.streaming.page_ins, of_packed.streaming.page_ins, "{name}, {what}");
            assert_eq!((stats.streaming.bricks_packed, stats.host_unpacked_peak_bytes), (0, 0));
            assert_eq!(of_packed.host_cache_bytes < stats.host_cache_bytes, of_packed.streaming.bricks_packed > 0);
            packed_bricks += of_packed.streaming.bricks_packed;
        }
        assert!(packed_bricks > 0, "{name}");
    }
}

#[test]
fn single_rays_and_graphics_devices_read_packed_bricks_too() {
    for (name, volume) in volumes().into_iter().filter(|(name, _)| name.contains("holes") || *name == "a section") {
        let container = open(&container_bytes(&volume, 16));
        for (what, scene) in scenes(&volume).into_iter().filter(|(what, _)| what.starts_with("dvr, shading")) {
            let cells = |form| RenderOptions { caster: Caster::Cells(CellRule::DEFAULT), ..options(form) };
            let drawn = |form| render(&container, &scene, &cells(form)).unwrap().0;
            assert!(drawn(BrickForm::Plain) == drawn(BrickForm::Packed), "{name}, {what}, by cells");
            if let Some(gpu) = gpu_support::shared_gpu() {
                let drawn = |form| {
                    let options = RenderOptions { backend: Backend::Gpu, ..options(form) };
                    render_on_device(gpu.clone(), &container, &scene, &options).unwrap().0
                };
                assert!(drawn(BrickForm::Plain) == drawn(BrickForm::Packed), "{name}, {what}, on a device");
            }
        }
    }
}

fn renderer(container: &Arc<Container>, options: RenderOptions) -> Renderer {
    Renderer::new(PlacedVolume::of(container.clone()), options).unwrap()
}

/// A camera on its way around the volume.
fn around(volume: &Volume, step: usize, height: f64) -> ResolvedScene {
    let (sin, cos) = (step as f64 * 0.1).sin_cos();
    let tf = points(4.0, &[(60.0, [0.1, 0.2, 0.9], 0.0), (250.0, [0.9, 0.1, 0.1], 0.05)]);
    let eye = [32.0 + 100.0 * cos, 32.0 + 100.0 * sin, 60.0];
    scene(
        volume,
        &format!(
            r#"{{"camera": {{"eye": {eye:?}, "target": [32, 32, 32], "up": [0, 0, 1], "height": {height}}}, "mode": "dvr",
                "image": {{"width": 48, "height": 48}}, "transfer_function": {tf}, "shading": null}}"#
        ),
    )
}

fn draw(renderer: &mut Renderer, scene: &ResolvedScene) -> (Image, FrameStats) {
    renderer.set_scene(scene.clone());
    assert!(renderer.advance(None).unwrap().is_finished);
    ((*renderer.picture().unwrap()).clone(), renderer.stats())
}

#[test]
fn an_orbit_that_does_not_fit_is_packed_and_reads_less_and_is_plain_again_once_it_fits() {
    let signal = marschner_lobb(64);
    let volume = Volume::new([64; 3], VoxelType::U8, move |p| 3.0 * signal(p) + 60.0);
    let container = open(&container_bytes(&volume, 16));
    // 64 bricks of 20^3 voxels are 528 kB; packed they take a third.
    let sized = |form| RenderOptions {
        cache_bytes: Some(340_000),
        threads: Some(1),
        level: LevelChoice::Fixed(Lod::FINEST),
        ..options(form)
    };
    let [mut plain, mut by_budget] =
        [BrickForm::Plain, BrickForm::ByBudget].map(|form| renderer(&container, sized(form)));
    let mut read = [0; 2];
    for step in 0..8 {
        let scene = around(&volume, step, 90.0);
        let ((expected, of_plain), (found, stats)) = (draw(&mut plain, &scene), draw(&mut by_budget, &scene));
        assert!(found == expected, "picture {step}");
        assert!(step > 0 || stats.streaming.bricks_packed == 0, "the first picture packs nothing");
        assert!(stats.host_cache_peak_bytes + stats.host_unpacked_peak_bytes <= stats.host_cache_budget_bytes * 9 / 8);
        read = [read[0] + of_plain.streaming.page_ins, read[1] + stats.streaming.page_ins];
    }
    assert!(read[1] < read[0] * 3 / 4, "{read:?} bricks read");
    // A view of a few bricks: plain again after some pictures, and as before.
    let mut unpacked = Vec::new();
    for step in 0..14 {
        let scene = around(&volume, step, 12.0);
        let ((expected, _), (found, stats)) = (draw(&mut plain, &scene), draw(&mut by_budget, &scene));
        assert!(found == expected, "near picture {step}");
        unpacked.push(stats.streaming.bricks_unpacked);
    }
    // Bricks of other views are still packed where the camera comes to them.
    let [packed, plain] = [&unpacked[..8], &unpacked[8..]].map(|counts| counts.iter().sum::<u64>());
    assert!(packed > 300 && plain < 10, "{unpacked:?}");
}
