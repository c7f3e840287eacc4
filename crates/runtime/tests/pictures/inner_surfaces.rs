//! Iso surfaces inside the semi-transparent volume (mode `dvr` with `iso`): against closed forms and the reference, for
//! any bricks, levels, cuts and caches.

#![allow(
    clippy::print_stderr,
    clippy::unwrap_used,
    reason = "tests show the errors they measure; helpers of tests are tests"
)]

use supervol_format::random::Random;
use supervol_format::{Lod, VoxelType};
use supervol_runtime::lod::LodChoice;
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::{PickedOn, Renderer, render, render_on_device, render_with_errors};
use supervol_runtime::render::volume::PlacedVolume;
use supervol_runtime::stream::classify::Skipping;
use supervol_scene::image::{GREY_LEVELS, Image, greatest};
use supervol_scene::scene::{ResolvedScene, Scene};

use crate::{containers, gpu_support, support};
use containers::{container_bytes, open};
use support::{Bricked, Volume, difference, marschner_lobb, noise, points, reference, scene, stable};

const SEED: u64 = 25;
/// Grey levels off silhouettes.
const BOUND: f64 = 0.5;
/// Divisor: largest share of the pixels of all random pictures that may lie on silhouettes.
const JUDGED: usize = 4;

fn options(level: LevelChoice) -> RenderOptions {
    RenderOptions { backend: Backend::Cpu, level, threads: Some(2), ..RenderOptions::default() }
}

/// Greatest difference off silhouettes, grey levels, and the number of pixels judged.
fn judged(volume: &Volume, scene: &ResolvedScene, found: &Image) -> (f64, usize) {
    let exact = reference(volume, scene);
    assert!(found.is_finite() && exact.is_finite());
    let is_stable = stable(volume, scene, &exact);
    (found.distance_where(&exact, |i| is_stable[i]), is_stable.iter().filter(|s| **s).count())
}

/// Fog of even extinction over a ramp along x, with surfaces across it: each ray's colour is a sum of four terms.
fn ramp() -> Volume {
    Volume::new([24, 20, 18], VoxelType::F32, |p| p[0])
}

fn ramp_scene(volume: &Volume, rest: &str) -> ResolvedScene {
    let tf = points(1.0, &[(0.0, [0.0, 1.0, 0.0], 0.1), (30.0, [0.0, 1.0, 0.0], 0.1)]);
    let json = format!(
        r#"{{"camera": {{"eye": [-30, 9, 9], "target": [12, 9, 9], "up": [0, 0, 1], "height": 10}}, "mode": "dvr",
            "image": {{"width": 20, "height": 20}}, "transfer_function": {tf}, "shading": null{rest}}}"#
    );
    scene(volume, &json)
}

#[test]
fn surfaces_lie_exactly_in_the_fog() {
    let volume = ramp();
    let surfaces = r#", "iso": [{"value": 14.25, "color": [1, 0, 0], "alpha": 0.5}, {"value": 5.5, "color": [0, 0, 1], "alpha": 0.25}]"#;
    let scene = ramp_scene(&volume, surfaces);
    let through = |length: f64| 0.9f64.powf(length);
    // From -0.5 to 5.5, to 14.25, to 23.5.
    let lengths = [6.0, 8.75, 9.25].map(through);
    let blue = lengths[0] * 0.25;
    let red = lengths[0] * 0.75 * lengths[1] * 0.5;
    let left = lengths[0] * 0.75 * lengths[1] * 0.5 * lengths[2];
    let expected = [red, 1.0 - left - red - blue, blue, 1.0 - left];
    for image in [reference(&volume, &scene), Bricked::new(&volume, 16).render(&scene)] {
        for pixel in &image.pixels {
            for c in 0..4 {
                let off = (f64::from(pixel[c]) - expected[c]).abs() * GREY_LEVELS;
                assert!(off < 0.05, "channel {c}: {off}/255, {pixel:?}, expected {expected:?}");
            }
        }
    }
}

/// Without extinction around them, surfaces that are crossed once look as in mode `iso`.
#[test]
fn in_clear_fog_surfaces_are_those_of_mode_iso() {
    let volume =
        Volume::new([41, 41, 41], VoxelType::F32, |p| (0..3).map(|a| (p[a] - 20.0).powi(2)).sum::<f64>().sqrt());
    let picture = |mode: &str| {
        let tf = points(1.0, &[(0.0, [1.0; 3], 0.0), (1.0, [1.0; 3], 0.0)]);
        let json = format!(
            r#"{{"camera": {{"eye": [80, -60, 50], "target": [20, 20, 20], "up": [0, 0, 1], "fov_y": 30}}, "mode": "{mode}",
                "image": {{"width": 60, "height": 50}}, "transfer_function": {tf}, "iso": [{{"value": 12.3, "color": [0.9, 0.7, 0.4]}}]}}"#
        );
        Bricked::new(&volume, 16).render(&scene(&volume, &json))
    };
    let off = difference(&picture("dvr"), &picture("iso"));
    assert!(off < 0.01, "{off}/255");
}

fn random_scene(random: &mut Random, volume: &Volume, size: f64, rest: &str) -> ResolvedScene {
    let world = volume.geometry.world_from_index();
    let centre = volume.dims.map(|n| n as f64 / 2.0);
    let direction = [0; 3].map(|_| random.unit() - 0.5);
    let length = direction.iter().map(|d| d * d).sum::<f64>().sqrt().max(0.01);
    let far = [70.0, 45.0, 6.0][random.index(3)];
    let eye: [f64; 3] = std::array::from_fn(|a| centre[a] + far * direction[a] / length);
    let [eye, target] = [eye, centre].map(|p| world.transform_point3(p.into()).to_array());
    let lens = if random.index(3) == 0 { r#""height": 40"# } else { r#""fov_y": 40"# };
    let alpha = random.between(0.02, 0.2);
    let tf = points(
        1.0,
        &[(0.2 * size, [0.1, 0.2, 0.9], 0.0), (0.6 * size, [0.9, 0.8, 0.1], alpha), (size, [1.0, 0.1, 0.3], 0.3)],
    );
    let of = |random: &mut Random, alpha: f64| {
        let value = size * random.between(0.15, 0.9);
        let value = if size > 1.0 && random.index(2) == 0 { value.round() } else { value };
        format!(r#"{{"value": {value}, "color": [0.9, {alpha}, 0.4], "alpha": {alpha}}}"#)
    };
    let all: Vec<String> = [0.3, 0.6, 1.0].map(|alpha| of(random, alpha)).into();
    let surfaces = all[..1 + random.index(3)].join(", ");
    let shading = if random.index(2) == 0 { r#"{}"# } else { "null" };
    let json = format!(
        r#"{{"camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0.1, 0.2, 1], {lens}}}, "mode": "dvr",
            "image": {{"width": 15, "height": 12}}, "transfer_function": {tf}, "iso": [{surfaces}], "shading": {shading}{rest}}}"#
    );
    scene(volume, &json)
}

fn random_volume(random: &mut Random, index: usize) -> (Volume, f64) {
    let dims = [0; 3].map(|_| 18 + random.index(20));
    let voxel_type = [VoxelType::F32, VoxelType::U8, VoxelType::I16][index % 3];
    let size = if voxel_type == VoxelType::F32 { 1.0 } else { 120.0 };
    let frequency = random.between(0.2, 0.7);
    let wave = move |p: [f64; 3]| 0.5 + 0.5 * (frequency * (p[0] + 0.7 * p[1] + 1.3 * p[2])).sin();
    let volume = match random.index(3) {
        0 => Volume::new(dims, voxel_type, move |p| size * wave(p)),
        1 => Volume::new(dims, voxel_type, move |p| size * noise(p)),
        _ => Volume::new(dims, voxel_type, move |p| size * marschner_lobb(dims[0])(p)),
    };
    let volume = if index % 4 == 3 {
        Volume { nodata: Some(121.0), ..volume }.with_holes(|[i, j, k]| i == 9 || (3 * i + 5 * j + 7 * k) % 41 == 0)
    } else {
        volume
    };
    let direction = [0.8, -0.6, 0.1, 0.6, 0.8, 0.0, 0.0, 0.2, 1.0];
    match index % 3 {
        0 => (volume.with_geometry([1.5, 0.75, 1.0], [40.0, -20.0, 5.0], direction), size),
        _ => (volume, size),
    }
}

#[test]
fn random_scenes_agree_with_the_reference() {
    let mut random = Random::new(SEED);
    let (mut pixels, mut all) = (0, 0);
    for index in 0..12 {
        let (volume, size) = random_volume(&mut random, index);
        let scene = random_scene(&mut random, &volume, size, "");
        let found = Bricked::new(&volume, 16).render(&scene);
        let (error, count) = judged(&volume, &scene, &found);
        eprintln!(
            "scene {index}, {:?}: {error:.4}/255, {count} of {} pixels judged",
            volume.voxel_type,
            found.pixels.len()
        );
        assert!(error <= BOUND, "seed {SEED}, scene {index}: {error}/255");
        (pixels, all) = (pixels + count, all + found.pixels.len());
    }
    assert!(JUDGED * (all - pixels) < all, "{pixels} of {all} pixels judged");
}

fn smooth() -> Volume {
    Volume::new([36, 32, 28], VoxelType::F32, |p| {
        0.5 + 0.25 * (0.31 * p[0]).sin() + 0.25 * (0.27 * p[1] + 0.2 * p[2]).cos()
    })
}

const SURFACES: &str = r#", "iso": [{"value": 0.6, "color": [0.9, 0.5, 0.3], "alpha": 0.4}, {"value": 0.8, "color": [0.3, 0.7, 0.9], "alpha": 0.9}]"#;

fn smooth_json(rest: &str) -> String {
    smooth_json_with(&[(0.2, [0.1, 0.2, 0.9], 0.0), (1.0, [0.9, 0.8, 0.1], 0.1)], rest)
}

fn smooth_json_with(transfer_function: &[(f64, [f64; 3], f64)], rest: &str) -> String {
    let tf = points(1.0, transfer_function);
    format!(
        r#"{{"camera": {{"eye": [80, -50, 50], "target": [18, 16, 14], "up": [0, 0, 1], "fov_y": 32}}, "mode": "dvr",
            "image": {{"width": 32, "height": 26}}, "transfer_function": {tf}{SURFACES}{rest}}}"#
    )
}

const CLIPS: [&str; 3] = [
    r#", "clip": {"box": [[3.5, 2, 4], [30, 28.25, 22]], "planes": [{"normal": [1, 0.3, -0.2], "offset": 11}]}"#,
    r#", "clip": {"solids": [{"keep": "outside", "sphere": {"center": [22, 10, 18], "radius": 9}}]}"#,
    r#", "slices": [{"normal": [0, 1, 0.2], "offset": 14.3, "opacity": 0.5}]"#,
];

#[test]
fn cuts_and_slices_go_with_surfaces() {
    let volume = smooth();
    let container = open(&container_bytes(&volume, 16));
    for clip in CLIPS {
        let scene = scene(&volume, &smooth_json(clip));
        let options = options(LevelChoice::Fixed(Lod::FINEST));
        let (found, stats) = render(&container, &scene, &options).expect("a picture");
        assert!(stats.converged);
        let (error, count) = judged(&volume, &scene, &found);
        eprintln!("{clip}: {error:.4}/255, {count} pixels judged");
        assert!(error <= BOUND && count > found.pixels.len() / 2, "{clip}: {error}/255, {count} judged");
    }
}

/// The size of bricks, skipping, the cache and the order of arrival change nothing visible; coarser levels give the
/// picture of the coarser volume.
#[test]
fn bricks_caches_and_levels() {
    let volume = smooth();
    let scene = scene(&volume, &smooth_json(""));
    let bricked = Bricked::new(&volume, 16);
    let picture = bricked.render(&scene);
    let (error, _) = judged(&volume, &scene, &picture);
    assert!(error <= BOUND, "{error}/255");
    assert!(difference(&Bricked::new(&volume, 32).render(&scene), &picture) < 0.25);
    let (walked, _) = bricked.render_with(&scene, LodChoice::Fixed(Lod::FINEST), Skipping::Off);
    assert!(difference(&walked, &picture) < 0.01);
    let (coarse, _) = bricked.render_with(&scene, LodChoice::Fixed(Lod(1)), Skipping::On);
    let (off, count) = judged(&volume.coarser([2, 2, 2]), &scene, &coarse);
    eprintln!("level 1: {off:.3}/255, {count} pixels judged");
    assert!(off <= BOUND && count > coarse.pixels.len() / 2, "level 1: {off}/255, {count} judged");
    let container = open(&container_bytes(&volume, 16));
    let options = |bytes| RenderOptions { cache_bytes: bytes, ..options(LevelChoice::Fixed(Lod::FINEST)) };
    let of = |bytes: Option<u64>| render(&container, &scene, &options(bytes)).expect("a picture").0;
    let wide = of(None);
    assert_eq!(wide, of(Some(40_000)), "a small cache changes the picture");
    assert!(difference(&wide, &picture) < 0.01);
}

/// In fog that shows nothing, bricks are read for their surfaces alone.
#[test]
fn bricks_are_read_for_surfaces_alone() {
    let volume = smooth();
    let clear = [(0.0, [1.0; 3], 0.0), (1.0, [1.0; 3], 0.0)];
    let scene = scene(&volume, &smooth_json_with(&clear, r#", "shading": {}"#));
    let container = open(&container_bytes(&volume, 16));
    let (found, stats) = render(&container, &scene, &options(LevelChoice::Auto)).expect("a picture");
    let (error, count) = judged(&volume, &scene, &found);
    assert!(stats.converged && error <= BOUND && count > found.pixels.len() / 2, "{error}/255, {count} judged");
    assert!(found.pixels.iter().any(|pixel| pixel[3] > 0.9));
}

/// The stated error is at least the true one, off silhouettes; on coarser levels nothing is known of surfaces.
#[test]
fn errors_are_stated_truthfully() {
    let volume = smooth();
    let container = open(&container_bytes(&volume, 16));
    let scene = scene(&volume, &smooth_json(""));
    for level in [LevelChoice::Auto, LevelChoice::Fixed(Lod(1))] {
        let options = RenderOptions { predict_error: true, ..options(level) };
        let (image, map, stats) = render_with_errors(&container, &scene, &options).expect("a picture");
        let map = map.expect("errors are summed up");
        let said = stats.error_stated.expect("errors are summed up");
        if level == LevelChoice::Auto {
            assert!(said.largest_grey_levels <= GREY_LEVELS * options.max_error + 1e-6, "{said:?}");
        }
        let exact = reference(&volume, &scene);
        let is_stable = stable(&volume, &scene, &exact);
        for i in (0..exact.pixels.len()).filter(|i| is_stable[*i]) {
            let off = greatest((0..4).map(|c| f64::from(image.pixels[i][c] - exact.pixels[i][c])));
            assert!(
                off <= f64::from(map.pixels[i][0]) + 1e-6,
                "{level:?}, pixel {i}: {off} off, {} stated",
                map.pixels[i][0]
            );
        }
    }
}

/// Picking returns the surface that takes the ray to half of its opacity, or the fog in front of it that does so.
#[test]
fn the_surface_that_hides_the_rest_is_picked() {
    let volume = ramp();
    let container = open(&container_bytes(&volume, 16));
    let picked = |alpha: f64| {
        let surface = format!(r#", "iso": [{{"value": 1.5, "color": [1, 0, 0], "alpha": {alpha}}}]"#);
        let opened = PlacedVolume::of(container.clone());
        let mut renderer = Renderer::new(opened, options(LevelChoice::Auto)).expect("a renderer");
        renderer.set_scene(ramp_scene(&volume, &surface));
        renderer.pick([10, 10]).expect("a ray").expect("something is to be seen")
    };
    let on = picked(0.9);
    assert_eq!(on.on, PickedOn::Surface(0));
    assert!((on.index[0] - 1.5).abs() < 1e-6 && (on.value - 1.5).abs() < 1e-6, "{on:?}");
    let behind = picked(0.1);
    assert_eq!(behind.on, PickedOn::Volume);
    // Half of the ray's whole opacity; the surface adds a tenth of the light left behind two voxels.
    let all = 1.0 - 0.9 * 0.9f64.powf(24.0);
    let x = (((1.0 - 0.5 * all) / 0.9).ln() / 0.9f64.ln()) - 0.5;
    assert!((behind.index[0] - x).abs() < 1e-4, "{behind:?}, expected {x}");
}

#[test]
fn limits_are_refused_by_name() {
    let nine = [r#"{"value": 1, "color": [1, 1, 1]}"#; 9].join(", ");
    let error = Scene::from_json(&format!(r#"{{"mode": "dvr", "iso": [{nine}]}}"#)).unwrap_err().to_string();
    assert!(error.contains("at most 8"), "{error}");
    assert!(Scene::from_json(r#"{"mode": "mip", "iso": [{"value": 1, "color": [1, 1, 1]}]}"#).is_err());
}

fn on_device(level: LevelChoice) -> RenderOptions {
    RenderOptions { backend: Backend::Gpu, ..options(level) }
}

/// The bound in random scenes with noise and holes, from outside and inside, for any brick size.
#[test]
fn graphics_devices_draw_random_scenes_as_the_reference_does() {
    let Some(gpu) = gpu_support::shared_gpu() else { return };
    let mut random = Random::new(SEED);
    let (mut pixels, mut all) = (0, 0);
    for index in 0..12 {
        let (volume, size) = random_volume(&mut random, index);
        let scene = random_scene(&mut random, &volume, size, "");
        let container = open(&container_bytes(&volume, 16));
        let (found, _, stats) =
            render_on_device(gpu.clone(), &container, &scene, &on_device(LevelChoice::Fixed(Lod::FINEST))).unwrap();
        assert!(stats.converged && stats.backend == "gpu", "{stats:?}");
        let (error, count) = judged(&volume, &scene, &found);
        eprintln!("scene {index}: {error:.4}/255, {count} of {} pixels judged", found.pixels.len());
        assert!(error <= BOUND, "seed {SEED}, scene {index}: {error}/255");
        (pixels, all) = (pixels + count, all + found.pixels.len());
    }
    assert!(JUDGED * (all - pixels) < all, "{pixels} of {all} pixels judged");
}

/// Steps of the transfer function are drawn by another loop than continuous ones; cuts, levels and small caches change
/// nothing.
#[test]
fn graphics_devices_meet_surfaces_between_steps_cuts_and_levels() {
    let Some(gpu) = gpu_support::shared_gpu() else { return };
    let volume = smooth();
    let container = open(&container_bytes(&volume, 16));
    let finest = on_device(LevelChoice::Fixed(Lod::FINEST));
    let steps = [
        (0.3, [0.1, 0.2, 0.9], 0.05),
        (0.55, [0.1, 0.2, 0.9], 0.0),
        (0.55, [0.9, 0.2, 0.1], 0.2),
        (1.0, [0.9, 0.8, 0.1], 0.1),
    ];
    let clear = [(0.0, [1.0; 3], 0.0), (1.0, [1.0; 3], 0.0)];
    let others = [smooth_json(""), smooth_json_with(&steps, ""), smooth_json_with(&clear, "")];
    for json in CLIPS.map(smooth_json).iter().chain(&others) {
        let scene = scene(&volume, json);
        let (found, _, stats) = render_on_device(gpu.clone(), &container, &scene, &finest).unwrap();
        assert!(stats.converged && stats.backend == "gpu", "{stats:?}");
        let (error, count) = judged(&volume, &scene, &found);
        eprintln!("{json}: {error:.4}/255, {count} pixels judged");
        assert!(error <= BOUND && count > found.pixels.len() / 2, "{json}: {error}/255, {count} judged");
    }
    let scene = scene(&volume, &smooth_json(""));
    let (coarse, ..) =
        render_on_device(gpu.clone(), &container, &scene, &on_device(LevelChoice::Fixed(Lod(1)))).unwrap();
    let (off, count) = judged(&volume.coarser([2, 2, 2]), &scene, &coarse);
    assert!(off <= BOUND && count > coarse.pixels.len() / 2, "level 1: {off}/255, {count} judged");
    let (wide, ..) = render_on_device(gpu.clone(), &container, &scene, &finest).unwrap();
    let few = RenderOptions { cache_bytes: Some(64 << 10), ..finest.clone() };
    assert_eq!(render_on_device(gpu.clone(), &container, &scene, &few).unwrap().0, wide, "small cache");
    let all = RenderOptions { skipping: Skipping::Off, ..finest };
    assert!(
        difference(&render_on_device(gpu.clone(), &container, &scene, &all).unwrap().0, &wide) < 0.01,
        "without skipping"
    );
}
