//! The frame loop with the GPU ray caster draws the CPU's picture, for every budget. Skipped with a message without an
//! adapter.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "helpers of tests are tests")]

use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::{BrickIndex, BrickKey, Container, Lod, VoxelType};
use supervol_runtime::engines::error::EngineError;
use supervol_runtime::engines::gpu::device::GpuDevice;
use supervol_runtime::engines::gpu::error::GpuError;
use supervol_runtime::render::error::RenderError;
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::{Renderer, render};
use supervol_runtime::render::volume::PlacedVolume;
use supervol_scene::scene::ResolvedScene;

use crate::{containers, support};
use containers::{Fault, Faulty, container_bytes, open};
use support::{Volume, difference, marschner_lobb, points, scene};

/// Greatest difference between the backends, in grey levels of 255.
const TOLERANCE: f64 = 0.5;

/// The same between pictures of the GPU whose rays stopped at different places.
const ROUNDING: f64 = 1e-3;

/// Whether there is a GPU; with `SUPERVOL_REQUIRE_GPU=1` its absence is a failure.
pub fn has_adapter() -> bool {
    let Err(error) = GpuDevice::open() else { return true };
    assert!(std::env::var_os("SUPERVOL_REQUIRE_GPU").is_none_or(|v| v != "1"), "SUPERVOL_REQUIRE_GPU=1, but {error}");
    eprintln!("SKIPPED: no GPU adapter ({error})");
    false
}

fn volume() -> Volume {
    let signal = marschner_lobb(64);
    Volume::new([64, 60, 50], VoxelType::U8, move |p| if p[0] > 40.0 && p[1] > 30.0 { 0.0 } else { 255.0 * signal(p) })
}

fn the_scene(volume: &Volume, mode: &str) -> ResolvedScene {
    scene_of_size(volume, mode, [40, 36], 25)
}

fn scene_of_size(volume: &Volume, mode: &str, [width, height]: [u32; 2], fov_y: u32) -> ResolvedScene {
    let tf =
        points(8.0, &[(20.0, [0.1, 0.2, 0.9], 0.0), (150.0, [0.9, 0.8, 0.1], 0.05), (255.0, [1.0, 0.1, 0.1], 0.3)]);
    let camera = format!(r#""eye": [190, -130, 120], "target": [31, 31, 31], "up": [0, 0, 1], "fov_y": {fov_y}"#);
    let image = format!(r#""image": {{"width": {width}, "height": {height}}}"#);
    scene(volume, &format!(r#"{{"camera": {{{camera}}}, {image}, "mode": {mode}, "transfer_function": {tf}}}"#))
}

fn options(backend: Backend) -> RenderOptions {
    RenderOptions { backend, level: LevelChoice::Fixed(Lod(0)), ..RenderOptions::default() }
}

/// The least GPU memory that suffices for this picture.
fn least_gpu_memory(container: &Arc<Container>, scene: &ResolvedScene) -> u64 {
    match render(container, scene, &RenderOptions { gpu_memory_bytes: Some(1), ..options(Backend::Gpu) }) {
        Err(RenderError::Engine(EngineError::Gpu(GpuError::Budget { needed, .. }))) => needed,
        other => panic!("one byte of GPU memory suffices, or another error: {:?}", other.err()),
    }
}

#[test]
fn the_picture_is_the_cpu_s_for_every_budget() {
    if !has_adapter() {
        return;
    }
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let iso = r#""iso", "shading": null, "iso": [{"value": 120, "color": [1, 0.5, 0.2]}]"#;
    let modes = [r#""dvr""#, r#""mip""#, r#""mean""#, iso];
    for mode in modes {
        let scene = the_scene(&volume, mode);
        let (expected, cpu) = render(&container, &scene, &options(Backend::Cpu)).unwrap();
        let least = least_gpu_memory(&container, &scene);
        for gpu_memory_bytes in [least, least + 100_000, 256 << 20] {
            let options = RenderOptions { gpu_memory_bytes: Some(gpu_memory_bytes), ..options(Backend::Gpu) };
            let (image, stats) = render(&container, &scene, &options).unwrap();
            let error = difference(&image, &expected);
            eprintln!(
                "{mode}, {gpu_memory_bytes} bytes: {error:.4}/255, {} passes, {} uploads, {} page-ins",
                stats.passes, stats.device.page_ins, stats.streaming.page_ins
            );
            assert!(error <= TOLERANCE, "{mode}: {error}/255");
            assert!(stats.converged && stats.backend == "gpu" && stats.adapter.is_some());
            assert!(
                stats.gpu_bytes <= gpu_memory_bytes && stats.streaming.page_ins <= cpu.streaming.page_ins * 3 / 2,
                "{stats:#?}"
            );
        }
    }
}

#[test]
fn a_host_cache_of_about_one_brick_feeds_the_gpu_too() {
    if !has_adapter() {
        return;
    }
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let scene = the_scene(&volume, r#""dvr""#);
    let (expected, _) = render(&container, &scene, &options(Backend::Cpu)).unwrap();
    let least_gpu = least_gpu_memory(&container, &scene);
    let small = |host_memory_bytes, gpu_memory_bytes: u64| {
        let threads = Some(1);
        render(
            &container,
            &scene,
            &RenderOptions {
                host_memory_bytes,
                gpu_memory_bytes: Some(gpu_memory_bytes),
                threads,
                ..options(Backend::Gpu)
            },
        )
    };
    let Err(RenderError::Budget(budget)) = small(1, least_gpu) else { panic!("one byte of host memory suffices") };
    for gpu_memory_bytes in [least_gpu, least_gpu + 100_000] {
        let (image, stats) = small(budget.needed_bytes, gpu_memory_bytes).unwrap();
        assert!(difference(&image, &expected) <= TOLERANCE);
        let page_ins = (stats.streaming.page_ins, stats.streaming.repeated_page_ins);
        eprintln!(
            "{} bytes of cache: {page_ins:?} page-ins, {} uploads",
            stats.host_cache_budget_bytes, stats.device.page_ins
        );
        assert!(
            stats.host_cache_budget_bytes < 30_000 && stats.streaming.repeated_page_ins * 2 <= stats.streaming.page_ins,
            "{stats:#?}"
        );
    }
}

/// Bricks, pipelines and answers stay from picture to picture; each picture equals that of a new renderer.
#[test]
fn the_next_picture_reads_and_uploads_nothing() {
    if !has_adapter() {
        return;
    }
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let options = options(Backend::Gpu);
    let mut renderer = Renderer::new(PlacedVolume::of(container.clone()), options.clone()).unwrap();
    let mut scene = the_scene(&volume, r#""dvr""#);
    for side in 0..3 {
        scene.camera.eye.x -= f64::from(side);
        renderer.set_scene(scene.clone());
        assert!(renderer.advance(None).unwrap().is_finished);
        let (expected, _) = render(&container, &scene, &options).unwrap();
        assert!(difference(&renderer.picture().unwrap(), &expected) < ROUNDING, "picture {side}");
        let stats = renderer.stats();
        assert_eq!((stats.device.page_ins > 0, stats.streaming.page_ins > 0), (side == 0, side == 0), "{stats:#?}");
    }
    // Another look: newly wanted bricks are in the host's cache or on the device.
    let other = the_scene(&volume, r#""mip""#);
    renderer.set_scene(other.clone());
    renderer.advance(None).unwrap();
    let (expected, _) = render(&container, &other, &options).unwrap();
    assert!(difference(&renderer.picture().unwrap(), &expected) < ROUNDING);
}

/// Whether a level is fine enough is not decided by the table of contents: it changes with the requested level.
#[test]
fn a_level_that_is_asked_for_is_drawn_from_then_on() {
    if !has_adapter() {
        return;
    }
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let scene = the_scene(&volume, r#""dvr""#);
    let mut renderer = Renderer::new(PlacedVolume::of(container.clone()), options(Backend::Gpu)).unwrap();
    renderer.set_scene(scene.clone());
    for level in [0, 1, 0] {
        let options = RenderOptions { level: LevelChoice::Fixed(Lod(level)), ..options(Backend::Gpu) };
        renderer.set_options(options.clone()).expect("options are right");
        assert!(renderer.advance(None).unwrap().is_finished);
        let (expected, _) = render(&container, &scene, &options).unwrap();
        assert!(difference(&renderer.picture().unwrap(), &expected) < ROUNDING, "level {level}");
    }
    let stats = renderer.stats();
    assert_eq!(stats.device.page_ins, 0, "level 0 was there: {stats:#?}");
}

/// A sketch leaves its bricks for the larger picture after it.
#[test]
fn what_a_sketch_has_uploaded_stays() {
    if !has_adapter() {
        return;
    }
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let coarsest = LevelChoice::Fixed(container.pyramid().coarsest());
    let options = RenderOptions { level: coarsest, predict_error: true, ..options(Backend::Gpu) };
    let scene = scene_of_size(&volume, r#""dvr""#, [200, 150], 25);
    let mut renderer = Renderer::new(PlacedVolume::of(container), options).unwrap();
    renderer.set_scene(scene);
    let step = renderer.advance(Some(Instant::now())).unwrap();
    assert!(!step.is_finished && renderer.stats().device.page_ins == 1, "a sketch of the coarsest level");
    let unknown = renderer.stats().error_stated.unwrap();
    assert_eq!(unknown.pixels_unknown, 200 * 150, "of pixels that are larger than asked for nothing is known");
    assert!(renderer.advance(None).unwrap().is_finished);
    let stats = renderer.stats();
    assert_eq!(stats.device.page_ins, 0, "{stats:#?}");
    assert_eq!(stats.error_stated.unwrap().pixels_unknown, 0);
}

/// After a deadline there is a whole and correct picture; with more time it becomes the final one.
#[test]
fn what_a_deadline_left_out_is_drawn_with_more_time() {
    if !has_adapter() {
        return;
    }
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let options = options(Backend::Gpu);
    let scene = the_scene(&volume, r#""dvr""#);
    let (expected, _) = render(&container, &scene, &options).unwrap();
    let mut renderer = Renderer::new(PlacedVolume::of(container), options).unwrap();
    renderer.set_scene(scene.clone());
    let step = renderer.advance(Some(Instant::now())).unwrap();
    assert!(!step.is_finished);
    assert!(difference(&renderer.picture().unwrap(), &expected) > TOLERANCE, "coarse bricks are the picture");
    // Rays pause in any pass, and continue.
    for ms in [1, 5, 20] {
        renderer.advance(Some(Instant::now() + Duration::from_millis(ms))).unwrap();
        assert_eq!(renderer.picture().unwrap().pixels.len(), 40 * 36);
    }
    assert!(renderer.advance(None).unwrap().is_finished);
    assert!(difference(&renderer.picture().unwrap(), &expected) < ROUNDING);
}

/// Bands that are finished at the stop are kept, and rays of the band in progress continue. However short the steps
/// are, a picture of several bands gets finished.
#[test]
fn bands_are_kept_when_it_is_time_to_stop() {
    if !has_adapter() {
        return;
    }
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let options = options(Backend::Gpu);
    // More rays than a band holds; nearly all of them miss the volume.
    let scene = scene_of_size(&volume, r#""dvr""#, [1400, 1200], 150);
    let (expected, stats) = render(&container, &scene, &options).unwrap();
    assert!(stats.bands > 1, "{} bands", stats.bands);
    let (by_cpu, _) = render(&container, &scene, &RenderOptions { backend: Backend::Cpu, ..options.clone() }).unwrap();
    assert!(difference(&expected, &by_cpu) <= TOLERANCE, "bands are not the picture");
    let mut renderer = Renderer::new(PlacedVolume::of(container), options).unwrap();
    renderer.set_scene(scene);
    let mut steps = 1;
    while !renderer.advance(Some(Instant::now() + Duration::from_millis(50))).unwrap().is_finished {
        steps += 1;
        assert!(steps < 10_000, "the picture is begun again and again");
    }
    assert!(steps > 2, "one step was long enough");
    assert!(difference(&renderer.picture().unwrap(), &expected) < ROUNDING);
}

/// A pass may take longer than the step, as on slow adapters: the bricks that its rays wait for are fetched, and they
/// continue.
#[test]
fn steps_that_are_over_before_a_pass_is_come_some_way() {
    if !has_adapter() {
        return;
    }
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let options = options(Backend::Gpu);
    let scene = scene_of_size(&volume, r#""dvr""#, [160, 120], 25);
    let (expected, _) = render(&container, &scene, &options).unwrap();
    let mut renderer = Renderer::new(PlacedVolume::of(container), options).unwrap();
    renderer.set_scene(scene);
    let mut steps = 1;
    while !renderer.advance(Some(Instant::now())).unwrap().is_finished {
        steps += 1;
        assert!(steps < 3_000, "rays wait for bricks that nobody fetches");
    }
    eprintln!("{steps} steps");
    assert!(difference(&renderer.picture().unwrap(), &expected) < ROUNDING);
}

#[test]
fn time_budgets_and_failed_bricks_work_the_same_way() {
    if !has_adapter() {
        return;
    }
    let volume = volume();
    let bytes = container_bytes(&volume, 16);
    let container = open(&bytes);
    let scene = the_scene(&volume, r#""dvr""#);
    let late = |backend| RenderOptions { time_budget_ms: Some(0), ..options(backend) };
    let (expected, _) = render(&container, &scene, &late(Backend::Cpu)).unwrap();
    let (image, stats) = render(&container, &scene, &late(Backend::Gpu)).unwrap();
    assert!(!stats.converged && stats.passes == 1 && stats.fallbacks > 0, "{stats:#?}");
    assert!(difference(&image, &expected) <= TOLERANCE);

    let entry = container.entry(BrickKey::new(Lod(0), BrickIndex([1, 1, 1]))).unwrap();
    let bad = entry.offset..entry.offset + entry.record_bytes();
    let faulty =
        Faulty::new(
            bytes,
            move |_, read| {
                if read.start < bad.end && bad.start < read.end { Fault::Error } else { Fault::None }
            },
        );
    let container = Arc::new(Container::from_source(faulty).unwrap());
    // If levels are chosen by brick, the parent that stands in is too coarse to be drawn otherwise.
    for level in [LevelChoice::Fixed(Lod(0)), LevelChoice::Auto] {
        let at_level = |backend| RenderOptions { level, ..options(backend) };
        let (expected, _) = render(&container, &scene, &at_level(Backend::Cpu)).unwrap();
        let (image, stats) = render(&container, &scene, &at_level(Backend::Gpu)).unwrap();
        assert!(!stats.converged && stats.bricks_failed == 1 && stats.fallbacks > 0, "{stats:#?}");
        assert!(difference(&image, &expected) <= TOLERANCE);
        let in_time = |backend| RenderOptions { level, ..late(backend) };
        let (expected, _) = render(&container, &scene, &in_time(Backend::Cpu)).unwrap();
        let (image, _) = render(&container, &scene, &in_time(Backend::Gpu)).unwrap();
        assert!(difference(&image, &expected) <= TOLERANCE);
    }
}

#[test]
fn auto_takes_whatever_there_is_and_says_why() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let scene = the_scene(&volume, r#""dvr""#);
    let (expected, _) = render(&container, &scene, &options(Backend::Cpu)).unwrap();
    let (image, stats) = render(&container, &scene, &options(Backend::Auto)).unwrap();
    assert!(difference(&image, &expected) <= TOLERANCE);
    assert_eq!(stats.no_gpu_because.is_none(), stats.backend == "gpu", "{stats:#?}");
}
