//! The picture does not depend on cache, threads, bands or speed; bricks are fetched front to back, once.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "helpers of tests are tests")]

use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::{Container, Lod, VoxelType};
use supervol_runtime::engines::cells::CellRule;
use supervol_runtime::engines::cpu::{Caster, CpuQuality};
use supervol_runtime::engines::packets::PacketRule;
use supervol_runtime::lod::LodChoice;
use supervol_runtime::lod::by_error::ANY_ERROR;
use supervol_runtime::render::error::RenderError;
use supervol_runtime::render::frame::plan_host;
use supervol_runtime::render::options::{Backend, LevelChoice, Refining, RenderOptions};
use supervol_runtime::render::renderer::render;
use supervol_runtime::render::stats::FrameStats;
use supervol_runtime::stream::budget::MADE_LIMIT;
use supervol_runtime::stream::classify::Skipping;
use supervol_runtime::stream::held::BrickForm;
use supervol_scene::image::Image;

use crate::{containers, support};
use containers::{Faulty, container_bytes, open, plan, render_planned};
use support::{Bricked, Volume, difference, marschner_lobb, noise, points, scene};

const OUTSIDE: &str = r#""eye": [190, -130, 120], "target": [31, 31, 31], "up": [0, 0, 1], "fov_y": 25"#;
const INSIDE: &str = r#""eye": [30, 20, 25], "target": [50, 60, 40], "up": [0, 0, 1], "fov_y": 90"#;
const PARALLEL: &str = r#""eye": [90, 130, 120], "target": [31, 31, 31], "up": [0, 0, 1], "height": 90"#;
const FINEST: RenderOptions = RenderOptions {
    backend: Backend::Cpu,
    level: LevelChoice::Fixed(Lod(0)),
    host_memory_bytes: 512 << 20,
    process_bytes: 0,
    cache_bytes: None,
    brick_form: BrickForm::ByBudget,
    gpu_memory_bytes: Some(0),
    threads: None,
    skipping: Skipping::On,
    caster: Caster::DEFAULT,
    time_budget_ms: None,
    max_error: PacketRule::DEFAULT.max_error,
    predict_error: false,
    count_work: false,
    refining: Refining::Tiles,
    progress: None,
    rays_finished: None,
};

fn json(camera: &str, mode: &str) -> String {
    let tf = points(4.0, &[(0.0, [0.1, 0.2, 0.9], 0.0), (0.6, [0.9, 0.8, 0.1], 0.02), (1.0, [0.9, 0.1, 0.1], 0.2)]);
    let image = r#""image": {"width": 40, "height": 36}"#;
    format!(r#"{{"camera": {{{camera}}}, {image}, "mode": {mode}, "transfer_function": {tf}}}"#)
}

/// 4 x 4 x 4 bricks of 16 and two coarser levels: a smooth part, a noisy corner, an empty half, a hole.
fn volume() -> Volume {
    let signal = marschner_lobb(64);
    Volume::new([64, 60, 50], VoxelType::F32, move |p| {
        if p[0] > 40.0 && p[1] > 30.0 {
            0.0
        } else if p[2] > 40.0 {
            noise(p)
        } else {
            signal(p)
        }
    })
    .with_holes(|p| p[0] < 10 && p[1] < 20 && p[2] < 33)
}

#[test]
fn the_picture_is_the_same_for_every_cache_and_number_of_threads_in_every_mode() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let all = Bricked::new(&volume, 16);
    let iso = r#""iso", "iso": [{"value": 0.45, "color": [1, 0.5, 0.2], "alpha": 0.5},
        {"value": 0.8, "color": [0.2, 0.5, 1]}], "shading": {}"#;
    for camera in [OUTSIDE, INSIDE, PARALLEL] {
        for mode in [r#""dvr""#, r#""mip""#, r#""minip""#, r#""mean""#, iso] {
            let scene = scene(&volume, &json(camera, mode));
            let expected = all.render(&scene);
            for (bricks, threads) in [(1, 1), (2, 8), (3, 1), (7, 2), (200, 8)] {
                let plan = plan(&container, &scene, bricks);
                let (image, stats) = render_planned(&container, &scene, &FINEST, plan, threads).unwrap();
                let change = difference(&image, &expected);
                assert!(
                    image == expected,
                    "{mode} with {bricks} bricks and {threads} threads: {change}/255, {stats:#?}"
                );
                assert!(stats.converged && stats.bricks_failed == 0);
                assert!(stats.host_cache_peak_bytes <= stats.host_cache_budget_bytes);
            }
        }
    }
}

#[test]
fn levels_chosen_by_distance_converge_too() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let scene = scene(&volume, &json(OUTSIDE, r#""dvr""#));
    // By the size of voxels alone.
    let automatic = RenderOptions { level: LevelChoice::Auto, max_error: ANY_ERROR, ..FINEST };
    let caster = Caster::DEFAULT.with_max_error(ANY_ERROR);
    let quality = CpuQuality { lod: LodChoice::Auto { voxel_pixels: 1.0 }, caster, ..CpuQuality::default() };
    let expected = Bricked::new(&volume, 16).render_of(&scene, quality).0;
    for bricks in [1, 2, 5, 100] {
        let plan = plan(&container, &scene, bricks);
        let (image, stats) = render_planned(&container, &scene, &automatic, plan, 2).unwrap();
        assert!(image == expected);
        assert!(stats.bricks_by_level[1..].iter().any(|l| l.page_ins > 0), "some brick is coarse: {stats:#?}");
    }
}

/// S16, S18: from so far that eight voxels are a pixel, averages of a checkerboard are transparent, and only the finest
/// level shows it.
#[test]
fn what_vanishes_in_coarser_levels_is_drawn_from_finer_ones() {
    let check = |p: [f64; 3]| if p.iter().sum::<f64>() as i64 % 2 == 0 { 1.0 } else { -1.0 };
    // A ball that coarser levels show, in the middle of clear space; the checkerboard in one corner.
    let ball = |p: [f64; 3]| if p.iter().map(|x| (x - 44.0) * (x - 44.0)).sum::<f64>() < 150.0 { 1.0 } else { 0.0 };
    let volume =
        Volume::new([64, 64, 64], VoxelType::F32, move |p| if p[0] < 16.0 && p[1] < 32.0 { check(p) } else { ball(p) });
    let container = open(&container_bytes(&volume, 16));
    let gold = [1.0, 0.8, 0.2];
    let tf = points(1.0, &[(-1.0, gold, 0.3), (-0.2, gold, 0.0), (0.2, gold, 0.0), (1.0, gold, 0.3)]);
    let camera = r#""eye": [900, -700, 500], "target": [31, 31, 31], "up": [0, 0, 1], "fov_y": 4.7"#;
    let scene = scene(
        &volume,
        &format!(r#"{{"camera": {{{camera}}}, "image": {{"width": 14, "height": 12}}, "transfer_function": {tf}}}"#),
    );
    let opacity = |image: &Image| image.pixels.iter().map(|p| f64::from(p[3])).sum::<f64>() / image.pixels.len() as f64;
    let (exact, _) = render(&container, &scene, &FINEST).unwrap();
    let level_1 = RenderOptions { level: LevelChoice::Fixed(Lod(1)), ..FINEST };
    let lost = opacity(&exact) - opacity(&render(&container, &scene, &level_1).unwrap().0);
    assert!(lost > 0.02, "the checkerboard is gone where a level is forced: {lost}");
    let automatic = RenderOptions { level: LevelChoice::Auto, ..FINEST };
    let (image, stats) = render(&container, &scene, &automatic).unwrap();
    assert!((opacity(&image) - opacity(&exact)).abs() < 0.1 * lost, "{} {}", opacity(&image), opacity(&exact));
    let levels: Vec<u64> = stats.bricks_by_level.iter().map(|level| level.page_ins).collect();
    assert!(levels[0] >= 8 && levels[1..].iter().any(|&n| n > 0), "both fine and coarse bricks are drawn: {levels:?}");
    let no_skipping = RenderOptions { skipping: Skipping::Off, ..automatic.clone() };
    assert_eq!(render(&container, &scene, &no_skipping).unwrap().0, image);
    let late = RenderOptions { time_budget_ms: Some(0), ..automatic.clone() };
    assert!(!render(&container, &scene, &late).unwrap().1.converged);
    let twin = RenderOptions { caster: Caster::Cells(CellRule::DEFAULT), ..automatic.clone() };
    let twin = render(&container, &scene, &twin).unwrap().0;
    // By another rule than the twin's: each keeps its requested error.
    let asked = 0.1;
    let on_gpu = RenderOptions {
        backend: Backend::Gpu,
        gpu_memory_bytes: Some(64 << 20),
        max_error: asked / 255.0,
        ..automatic.clone()
    };
    match render(&container, &scene, &on_gpu) {
        Ok((from_gpu, _)) => assert!(difference(&from_gpu, &twin) < asked, "{}", difference(&from_gpu, &twin)),
        Err(error) => {
            let is_required = std::env::var_os("SUPERVOL_REQUIRE_GPU").is_some_and(|v| v == "1");
            assert!(!is_required, "SUPERVOL_REQUIRE_GPU=1, but {error}");
            eprintln!("SKIPPED: no GPU adapter ({error})");
        }
    }
}

#[test]
fn skipping_bands_and_slow_sources_change_nothing() {
    let volume = volume();
    let bytes = container_bytes(&volume, 16);
    let container = open(&bytes);
    let scene = scene(&volume, &json(OUTSIDE, r#""dvr", "samples_per_pixel": 4"#));
    let plan = plan(&container, &scene, 9);
    let (expected, whole) = render_planned(&container, &scene, &FINEST, plan, 2).unwrap();
    let no_skipping = RenderOptions { skipping: Skipping::Off, ..FINEST };
    let (image, stats) = render_planned(&container, &scene, &no_skipping, plan, 2).unwrap();
    assert!(
        image == expected && stats.streaming.page_ins > whole.streaming.page_ins,
        "invisible bricks are read where nothing is skipped"
    );
    for band_rows in [1, 7, 35] {
        let plan = supervol_runtime::stream::budget::HostPlan { band_rows, ..plan };
        let (image, stats) = render_planned(&container, &scene, &FINEST, plan, 2).unwrap();
        assert!(image == expected);
        assert_eq!((stats.bands, stats.casting.rays), (36u64.div_ceil(u64::from(band_rows)), 4 * 40 * 36));
    }
    let slow = Faulty::slow(bytes, Duration::from_millis(2));
    let container = Arc::new(Container::from_source(slow).unwrap());
    let (image, stats) = render_planned(&container, &scene, &FINEST, plan, 2).unwrap();
    assert!(image == expected && stats.streaming.read_ms >= 2.0 * stats.streaming.reads as f64);
}

/// Page-ins per distinct brick, for a cache with this share of the working set.
fn repeats(
    container: &Arc<Container>,
    scene_json: &str,
    volume: &Volume,
    level: LevelChoice,
    share: f64,
) -> FrameStats {
    let scene = scene(volume, scene_json);
    let options = RenderOptions { level, ..FINEST };
    let (expected, all) = render_planned(container, &scene, &options, plan(container, &scene, 10_000), 2).unwrap();
    assert_eq!(all.streaming.repeated_page_ins, 0);
    let bricks = ((all.streaming.page_ins as f64 * share) as u64).max(1);
    let (image, stats) = render_planned(container, &scene, &options, plan(container, &scene, bricks), 2).unwrap();
    assert!(image == expected);
    assert_eq!(
        stats.streaming.page_ins - stats.streaming.repeated_page_ins,
        all.streaming.page_ins,
        "the same bricks are wanted"
    );
    eprintln!(
        "{level:?}, cache {bricks} of {} bricks: {} passes instead of {}, {} page-ins repeated ({:.3}x), {} reads",
        all.streaming.page_ins,
        stats.passes,
        all.passes,
        stats.streaming.repeated_page_ins,
        stats.streaming.page_ins as f64 / all.streaming.page_ins as f64,
        stats.streaming.reads
    );
    stats
}

#[test]
fn each_brick_is_read_once_even_with_a_cache_far_smaller_than_the_working_set() {
    let signal = marschner_lobb(128);
    let volume = Volume::new([128, 128, 96], VoxelType::U8, move |p| 1.0 + 200.0 * signal(p));
    let container = open(&container_bytes(&volume, 16));
    let tf = points(64.0, &[(0.0, [0.1, 0.2, 0.9], 0.01), (255.0, [0.9, 0.8, 0.1], 0.3)]);
    let cameras = [
        r#""eye": [400, -300, 250], "target": [63, 63, 47], "up": [0, 0, 1], "fov_y": 22"#,
        r#""eye": [63, 63, 300], "target": [63, 63.1, 47], "up": [0, 1, 0], "fov_y": 40"#,
        r#""eye": [60, 50, 40], "target": [100, 110, 60], "up": [0, 0, 1], "fov_y": 100"#,
        r#""eye": [300, 200, 250], "target": [63, 63, 47], "up": [0, 0, 1], "height": 180"#,
        r#""eye": [300, 63, 47], "target": [63, 63, 47], "up": [0, 0, 1], "height": 180"#,
    ];
    for camera in cameras {
        let image = r#""image": {"width": 96, "height": 80}"#;
        let json = format!(r#"{{"camera": {{{camera}}}, {image}, "transfer_function": {tf}}}"#);
        for share in [0.25, 0.05, 0.0] {
            let stats = repeats(&container, &json, &volume, LevelChoice::Fixed(Lod(0)), share);
            assert_eq!(stats.streaming.repeated_page_ins, 0, "share {share}, camera {camera}");
        }
        let stats = repeats(&container, &json, &volume, LevelChoice::Auto, 0.25);
        assert!(
            stats.streaming.page_ins as f64
                <= 1.5 * (stats.streaming.page_ins - stats.streaming.repeated_page_ins) as f64
        );
    }
}

#[test]
fn the_least_host_budget_is_told_and_suffices() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let scene = scene(&volume, &json(OUTSIDE, r#""dvr""#));
    let (expected, _) = render(&container, &scene, &FINEST).unwrap();
    let mut budget = 1;
    let (image, stats) = loop {
        let options = RenderOptions { host_memory_bytes: budget, threads: Some(1), ..FINEST };
        match render(&container, &scene, &options) {
            Ok(done) => break done,
            Err(RenderError::Budget(error)) => {
                assert!(error.needed_bytes > budget, "{error}");
                budget = error.needed_bytes;
            }
            Err(error) => panic!("{error}"),
        }
    };
    assert!(image == expected);
    assert!(stats.host_cache_budget_bytes < 2 * 40_000, "about one brick of 20^3 floats: {stats:#?}");
    assert!(stats.host_budget_bytes == budget && stats.bands > 1, "bands of rays: {stats:#?}");
}

#[test]
fn the_plan_counts_what_packets_hold() {
    let container = open(&container_bytes(&volume(), 16));
    let scene = scene(&volume(), &json(OUTSIDE, r#""dvr""#));
    let cells = RenderOptions { caster: Caster::Cells(CellRule::DEFAULT), ..FINEST };
    let [packets, cells] = [FINEST, cells].map(|options| {
        let held = options.caster.bytes(16);
        (held, plan_host(&container, &scene, &options).unwrap())
    });
    let rays = 40 * 36;
    let thread_bytes = rayon::current_num_threads() as u64 * packets.0.thread;
    // 3 x 3 tiles of 16 x 16.
    let difference = (9 * packets.0.group + thread_bytes) - rays * cells.0.group;
    assert_eq!(packets.1.fixed_bytes - cells.1.fixed_bytes, difference);
    assert!(packets.0.group >= 256 * 80 && packets.0.thread > packets.0.group, "{:?}", packets.0);
    // 4^3 blocks of a cloud, and boxes for a third of them: 24 bytes each, 16 side by side. Or 2^3 ranges of macro
    // cells and 32 iso values.
    assert!((64 + 32 * 24..1024 + 32 * 24).contains(&packets.0.made_of_brick), "{:?}", packets.0);
    assert_eq!((packets.1.made_bytes, cells.1.made_bytes), (MADE_LIMIT, 0));
}

#[test]
fn a_time_budget_of_nothing_gives_a_complete_coarse_picture() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    for mode in [r#""dvr""#, r#""mip""#] {
        let scene = scene(&volume, &json(OUTSIDE, mode));
        let options = RenderOptions { time_budget_ms: Some(0), ..FINEST };
        let (image, stats) = render(&container, &scene, &options).unwrap();
        assert!(!stats.converged && stats.fallbacks > 0, "{stats:#?}");
        assert_eq!((stats.passes, stats.streaming.page_ins), (1, 1), "only the coarsest brick is read");
        assert!(stats.error_bound > 0.9, "the coarsest level's bound");
        let coarsest = RenderOptions { level: LevelChoice::Fixed(Lod(2)), ..FINEST };
        let (expected, _) = render(&container, &scene, &coarsest).unwrap();
        let error = difference(&image, &expected);
        assert!(error < 2.0, "the coarse picture, in brick-sized steps: {error}/255");
    }
}

#[test]
fn a_time_budget_in_the_middle_gives_a_complete_picture_that_gets_better() {
    let volume = volume();
    let bytes = container_bytes(&volume, 16);
    let scene = scene(&volume, &json(OUTSIDE, r#""dvr""#));
    let (expected, _) = render(&open(&bytes), &scene, &FINEST).unwrap();
    let error_after = |ms: u64| -> (Image, FrameStats) {
        let slow = Faulty::slow(bytes.clone(), Duration::from_millis(5));
        let container = Arc::new(Container::from_source(slow).unwrap());
        let start = Instant::now();
        let options = RenderOptions { time_budget_ms: Some(ms), ..FINEST };
        let result = render_planned(&container, &scene, &options, plan(&container, &scene, 4), 2).unwrap();
        assert!(start.elapsed() < Duration::from_millis(ms + 2000), "one batch late at most");
        result
    };
    let (early, stats) = error_after(40);
    assert!(!stats.converged && stats.streaming.page_ins > 1 && stats.bricks_missing_at_deadline > 0, "{stats:#?}");
    assert!(early != expected);
    let (late, stats) = error_after(60_000);
    assert!(stats.converged && late == expected && stats.error_bound == 0.0, "{stats:#?}");
}

#[test]
fn the_reference_backend_loads_a_level_within_the_budget() {
    let volume =
        Volume::new([21, 18, 17], VoxelType::F32, |p| noise(p.map(|v| (v / 4.0).floor()))).with_holes(|p| p[0] == 3);
    let container = open(&container_bytes(&volume, 16));
    let camera = r#""eye": [70, -50, 50], "target": [10, 9, 8], "up": [0, 0, 1], "fov_y": 25"#;
    let scene = scene(&volume, &json(camera, r#""dvr""#));
    let options = RenderOptions { backend: Backend::Reference, ..FINEST };
    let (image, stats) = render(&container, &scene, &options).unwrap();
    let (expected, _) = render(&container, &scene, &FINEST).unwrap();
    assert!(difference(&image, &expected) < 0.5 && stats.backend == "reference");
    let coarse = LevelChoice::Fixed(Lod(1));
    let (image, _) = render(&container, &scene, &RenderOptions { level: coarse, ..options.clone() }).unwrap();
    let (expected, _) = render(&container, &scene, &RenderOptions { level: coarse, ..FINEST }).unwrap();
    assert!(difference(&image, &expected) < 0.5, "level 1: {}/255", difference(&image, &expected));
    let error = render(&container, &scene, &RenderOptions { host_memory_bytes: 60_000, ..options }).unwrap_err();
    assert!(matches!(error, RenderError::ReferenceTooLarge { .. }), "{error}");
}

#[test]
fn statistics_are_one_flat_object_with_the_promised_keys() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let scene = scene(&volume, &json(OUTSIDE, r#""dvr""#));
    let (_, stats) = render(&container, &scene, &FINEST).unwrap();
    let json = serde_json::to_value(&stats).unwrap();
    for key in ["render_ms", "cpu_ms", "peak_rss_bytes", "page_ins", "total_ms", "bytes_read", "error_bound"] {
        assert!(json[key].is_number(), "{key}");
    }
    assert!(stats.render_ms > 0.0 && stats.total_ms >= stats.render_ms);
    assert!(
        stats.casting.rays == 40 * 36 && stats.casting.samples > 0 && stats.casting.macro_cells_skipped > 0,
        "{stats:#?}"
    );
    assert_eq!(stats.streaming.page_ins, stats.bricks_by_level.iter().map(|l| l.page_ins).sum::<u64>());
    assert!(stats.bricks_by_state["nothing"] > 0 && stats.bricks_by_level[0].nothing > 0, "{stats:#?}");
}
