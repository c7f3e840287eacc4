//! Failing sources: a bad brick costs only itself, there is always a picture, nothing panics, everything is counted.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "helpers of tests are tests")]

use std::collections::HashMap;
use std::ops::Range;
#[cfg(unix)]
use std::os::unix::fs::FileExt;
use std::sync::{Arc, Mutex};

use supervol_format::{BrickIndex, BrickKey, Container, Lod, VoxelType};
use supervol_runtime::render::options::{LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::Renderer;
use supervol_runtime::render::stats::FrameStats;
use supervol_runtime::render::volume;
use supervol_runtime::stream::io::RETRY_AFTER;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use crate::{containers, support};
use containers::{Fault, Faulty, container_bytes, open, plan, render_planned};
use support::{Volume, difference, noise, points, scene};

const CACHE_BRICKS: u64 = 5;

fn options() -> RenderOptions {
    RenderOptions { level: LevelChoice::Fixed(Lod(0)), ..RenderOptions::default() }
}

/// 3 x 3 x 2 bricks of 16, two coarser levels; nothing is empty.
fn volume() -> Volume {
    Volume::new([48, 44, 30], VoxelType::U8, |p| 20.0 + 180.0 * noise(p.map(|v| (v / 3.0).floor())))
}

fn the_scene(volume: &Volume) -> ResolvedScene {
    let camera = r#""eye": [120, -90, 80], "target": [23, 21, 15], "up": [0, 0, 1], "fov_y": 28"#;
    scene_seen_from(volume, camera, [36, 30])
}

fn scene_seen_from(volume: &Volume, camera: &str, [width, height]: [u32; 2]) -> ResolvedScene {
    let tf = points(16.0, &[(0.0, [0.1, 0.2, 0.9], 0.02), (255.0, [0.9, 0.8, 0.1], 0.6)]);
    let image = format!(r#""image": {{"width": {width}, "height": {height}}}"#);
    scene(volume, &format!(r#"{{"camera": {{{camera}}}, {image}, "transfer_function": {tf}}}"#))
}

fn overlaps(a: &Range<u64>, b: &Range<u64>) -> bool {
    a.start < b.end && b.start < a.end
}

/// Range of the record of a brick, bytes.
fn record(bytes: &[u8], key: BrickKey) -> Range<u64> {
    let entry = open(bytes).entry(key).unwrap();
    assert!(entry.record_bytes() > 0, "{key} has a record");
    entry.offset..entry.offset + entry.record_bytes()
}

fn render_faulty(
    volume: &Volume,
    bytes: &[u8],
    rule: impl Fn(u64, Range<u64>) -> Fault + Send + Sync + 'static,
) -> (Image, FrameStats) {
    let container = Arc::new(Container::from_source(Faulty::new(bytes.to_vec(), rule)).expect("opens"));
    let scene = the_scene(volume);
    render_planned(&container, &scene, &options(), plan(&container, &scene, CACHE_BRICKS), 2).expect("renders")
}

fn good(volume: &Volume, bytes: &[u8]) -> (Image, FrameStats) {
    render_faulty(volume, bytes, |_, _| Fault::None)
}

fn key(lod: u8, brick: [u32; 3]) -> BrickKey {
    BrickKey::new(Lod(lod), BrickIndex(brick))
}

#[test]
fn a_brick_that_always_fails_is_drawn_from_its_parent_and_costs_no_other() {
    let volume = volume();
    let bytes = container_bytes(&volume, 16);
    let (expected, healthy) = good(&volume, &bytes);
    for fault in [Fault::Error, Fault::Short] {
        let bad = record(&bytes, key(0, [1, 0, 1]));
        let (image, stats) =
            render_faulty(&volume, &bytes, move |_, read| if overlaps(&read, &bad) { fault } else { Fault::None });
        assert!(!stats.converged && stats.bricks_failed == 1 && stats.fallbacks > 0, "{stats:#?}");
        assert_eq!(stats.failures.len(), 1);
        assert!(stats.failures[0].brick.contains("(1, 0, 1)"), "{:?}", stats.failures);
        assert_eq!(stats.bricks_by_level[0].failed, 1);
        assert_eq!(
            stats.streaming.page_ins - stats.streaming.repeated_page_ins,
            healthy.streaming.page_ins,
            "one brick less, its parent more"
        );
        assert!(stats.error_bound > 0.0 && healthy.error_bound == 0.0);
        assert!(image != expected && image.pixels.iter().flatten().all(|v| v.is_finite()));
        let changed = image.pixels.iter().zip(&expected.pixels).filter(|(a, b)| a != b).count();
        assert!(changed * 2 < image.pixels.len(), "{changed} pixels changed: only those that see the brick");
    }
}

/// A brick that is too coarse to be drawn stands in for a child that has failed, or for which there is no time.
#[test]
fn bricks_that_are_too_coarse_stand_in_for_their_children() {
    let volume = volume();
    let bytes = container_bytes(&volume, 16);
    let far = r#""eye": [360, -270, 240], "target": [23, 21, 15], "up": [0, 0, 1], "fov_y": 9.5"#;
    let scene = scene_seen_from(&volume, far, [18, 15]);
    let draw = |level, time_budget_ms, bad: Option<Range<u64>>, bricks| {
        let rule = move |_, read: Range<u64>| {
            let is_bad = bad.as_ref().is_some_and(|bad| overlaps(&read, bad));
            if is_bad { Fault::Error } else { Fault::None }
        };
        let container = Arc::new(Container::from_source(Faulty::new(bytes.clone(), rule)).unwrap());
        let options = RenderOptions { level, time_budget_ms, ..options() };
        render_planned(&container, &scene, &options, plan(&container, &scene, bricks), 2).unwrap()
    };
    // From here a pixel is larger than a voxel of level 1, but any error is visible.
    let (_, stats) = draw(LevelChoice::Auto, None, None, CACHE_BRICKS);
    let too_coarse: u64 = stats.bricks_by_level.iter().map(|level| level.too_coarse).sum();
    assert!(too_coarse > 0 && stats.error_bound == 0.0 && stats.bricks_without_bound == 0, "{stats:#?}");
    assert!(stats.bricks_by_level[1..].iter().all(|level| level.page_ins == 0), "{stats:#?}");

    let bad = record(&bytes, key(0, [1, 0, 1]));
    for bricks in [1, CACHE_BRICKS, 100] {
        let (expected, _) = draw(LevelChoice::Fixed(Lod(0)), None, Some(bad.clone()), bricks);
        let (image, stats) = draw(LevelChoice::Auto, None, Some(bad.clone()), bricks);
        assert!(!stats.converged && stats.bricks_failed == 1 && stats.fallbacks > 0, "{stats:#?}");
        assert!(image == expected && stats.error_bound > 0.0, "{bricks} bricks");
        assert_eq!(stats.bricks_without_bound, 1, "the one that stands in");
    }
    let (expected, _) = draw(LevelChoice::Fixed(Lod(0)), Some(0), None, CACHE_BRICKS);
    let (image, stats) = draw(LevelChoice::Auto, Some(0), None, CACHE_BRICKS);
    assert!(!stats.converged && stats.error_bound > 0.0, "{stats:#?}");
    // The same brick, entered and left at the faces of the bricks that it stands in for.
    assert!(difference(&image, &expected) < 0.5, "{}/255", difference(&image, &expected));
}

#[test]
fn flipped_bits_are_noticed_and_named() {
    let volume = volume();
    let bytes = container_bytes(&volume, 16);
    let record = record(&bytes, key(0, [0, 1, 0]));
    for step in 0..16 {
        let mut damaged = bytes.clone();
        let at = record.start + step * (record.end - record.start - 1) / 15;
        damaged[at as usize] ^= 1 << (step % 8);
        let (_, stats) = good(&volume, &damaged);
        assert_eq!(stats.bricks_failed, 1, "byte {at}");
        assert!(stats.failures[0].reason.contains("checksum"), "{:?}", stats.failures);
    }
}

#[test]
fn a_chain_of_failures_up_to_the_coarsest_draws_nothing_there_and_says_so() {
    let volume = volume();
    let bytes = container_bytes(&volume, 16);
    let container = open(&bytes);
    let mut bad = vec![];
    for entry in 0..container.pyramid().brick_count() {
        bad.push(record(&bytes, container.pyramid().key(entry).unwrap()));
    }
    let rule = move |_, read: Range<u64>| {
        if bad.iter().any(|b| overlaps(b, &read)) { Fault::Error } else { Fault::None }
    };
    let (image, stats) = render_faulty(&volume, &bytes, rule);
    assert!(image.pixels.iter().all(|p| *p == [0.0; 4]), "nothing can be drawn");
    assert_eq!(stats.streaming.page_ins, 0);
    assert_eq!(stats.failures.len(), 16, "the first sixteen are listed");
    assert!(stats.bricks_failed > 16 && stats.bricks_by_level[2].failed == 1, "{stats:#?}");
}

#[test]
fn a_table_of_contents_that_cannot_be_read_fails_its_bricks() {
    let volume = volume();
    let bytes = container_bytes(&volume, 16);
    let sections = open(&bytes).sections();
    let toc = sections.toc_offset..sections.toc_offset + sections.toc_bytes;
    let (image, stats) =
        render_faulty(&volume, &bytes, move |_, read| if overlaps(&read, &toc) { Fault::Error } else { Fault::None });
    assert!(image.pixels.iter().all(|p| *p == [0.0; 4]));
    assert!(
        stats.bricks_failed > 0 && stats.streaming.reads == 0 && stats.failures[0].reason.contains("TOC page"),
        "{stats:#?}"
    );

    let mut damaged = bytes.clone();
    damaged[sections.toc_offset as usize + 100] ^= 4;
    let (_, stats) = good(&volume, &damaged);
    assert!(stats.bricks_failed > 0 && stats.failures[0].reason.contains("checksum"), "{stats:#?}");
}

#[test]
fn any_single_read_may_fail() {
    let volume = volume();
    let bytes = container_bytes(&volume, 16);
    let source = Faulty::new(bytes.clone(), |_, _| Fault::None);
    let container = Arc::new(Container::from_source(source.clone()).unwrap());
    let opening = source.reads();
    let scene = the_scene(&volume);
    let (expected, _) =
        render_planned(&container, &scene, &options(), plan(&container, &scene, CACHE_BRICKS), 2).unwrap();
    let all = source.reads();
    assert!(all > opening + 5);
    for bad in 0..opening {
        // After a failed merged read, its parts are read one by one, the first and the last page before all others.
        let opened = |worst| {
            let rule = move |n, _| if (bad..=worst).contains(&n) { Fault::Error } else { Fault::None };
            Container::from_source(Faulty::new(bytes.clone(), rule))
        };
        assert!(opened(bad).is_ok() && opened(u64::MAX).is_err(), "read {bad} of the opening");
    }
    for fault in [Fault::Error, Fault::Short] {
        for bad in opening..all {
            let (image, stats) = render_faulty(&volume, &bytes, move |n, _| if n == bad { fault } else { Fault::None });
            // A read of records that fails once is retried; a failed page of the TOC fails the bricks wanted at that
            // time.
            if stats.bricks_failed == 0 {
                assert!(image == expected && stats.streaming.failed_reads == 1, "read {bad}");
            } else {
                assert!(stats.failures[0].reason.contains("TOC page"), "read {bad}: {:?}", stats.failures);
            }
            assert!(image.is_finite() && stats.converged == (stats.bricks_failed == 0));
        }
    }
}

/// A network that fails twice at every place costs time, but no brick: neither records nor the table of contents.
#[test]
fn reads_that_time_out_twice_leave_no_trace_in_the_picture() {
    let volume = volume();
    let bytes = container_bytes(&volume, 16);
    let (expected, healthy) = good(&volume, &bytes);
    let opening = {
        let source = Faulty::new(bytes.clone(), |_, _| Fault::None);
        Container::from_source(source.clone()).unwrap();
        source.reads()
    };
    let attempts = Mutex::new(HashMap::new());
    let rule = move |n, read: Range<u64>| {
        let mut attempts = attempts.lock().unwrap();
        let attempt = attempts.entry(read.start).or_insert(0);
        *attempt += 1;
        if n >= opening && *attempt <= RETRY_AFTER.len() { Fault::TimedOut } else { Fault::None }
    };
    let (image, stats) = render_faulty(&volume, &bytes, rule);
    assert!(image == expected && stats.converged && stats.bricks_failed == 0, "{stats:#?}");
    assert_eq!(stats.streaming.page_ins, healthy.streaming.page_ins);
    let retried = stats.streaming.retried_reads;
    assert!(retried >= RETRY_AFTER.len() as u64 && retried == stats.streaming.failed_reads, "{stats:#?}");
}

/// Another program truncates or overwrites the file while a picture is drawn: affected bricks fail and are named,
/// bricks in memory are drawn, and nothing stops.
#[cfg(unix)]
#[test]
fn a_file_may_shrink_or_change_under_an_open_renderer() {
    let volume = volume();
    let folder = tempfile::tempdir().unwrap();
    let near = the_scene(&volume);
    let far = scene_seen_from(
        &volume,
        r#""eye": [-90, 120, -60], "target": [23, 21, 15], "up": [0, 0, 1], "fov_y": 28"#,
        [36, 30],
    );
    type Harm = fn(&std::fs::File, u64);
    let harms: [(Harm, &str); 2] = [
        (|file, records_end| file.set_len(records_end / 2).unwrap(), "cannot read"),
        (|file, records_end| file.write_all_at(&vec![0x5a; records_end as usize - 4096], 4096).unwrap(), "checksum"),
    ];
    for (harm, reason) in harms {
        let path = folder.path().join("changing.svol");
        std::fs::write(&path, container_bytes(&volume, 16)).unwrap();
        let container = Arc::new(Container::open(&path).unwrap());
        // Room for a few bricks: the picture after the damage must read.
        let options = RenderOptions { threads: Some(2), cache_bytes: Some(60_000), ..options() };
        let mut renderer = Renderer::new(volume::PlacedVolume::of(container.clone()), options).unwrap();
        renderer.set_scene(near.clone());
        assert!(renderer.advance(None).unwrap().is_finished && renderer.stats().bricks_failed == 0);
        harm(&std::fs::File::options().write(true).open(&path).unwrap(), container.sections().toc_offset);
        renderer.set_scene(far.clone());
        renderer.advance(None).unwrap();
        let stats = renderer.stats();
        assert!(renderer.picture().unwrap().is_finite() && !stats.converged && stats.bricks_failed > 0, "{stats:#?}");
        assert!(stats.failures[0].reason.contains(reason), "{:?}", stats.failures);
    }
}

#[test]
fn all_reads_from_some_read_on_may_fail() {
    let volume = volume();
    let bytes = container_bytes(&volume, 16);
    let mut failed = vec![];
    for first_bad in 3..40u64 {
        let rule = move |n, _| if n >= first_bad { Fault::Error } else { Fault::None };
        let (image, stats) = render_faulty(&volume, &bytes, rule);
        assert!(image.pixels.iter().flatten().all(|v| v.is_finite()));
        failed.push(stats.bricks_failed);
    }
    assert!(failed[0] > 0 && failed.last() == Some(&0), "{failed:?}");
}

#[test]
fn every_truncation_is_refused_or_drawn_with_failures() {
    let volume = volume();
    let bytes = container_bytes(&volume, 16);
    for cut in (0..bytes.len()).step_by(997) {
        assert!(Container::from_source(Arc::new(bytes[..cut].to_vec())).is_err(), "a container cut at {cut}");
    }
    // A file that loses its records after it was opened, like a network share that went away.
    for cut in [4096u64, 10_000, 30_000, 60_000] {
        let footer = bytes.len() as u64 - 4096;
        let toc = open(&bytes).sections().toc_offset;
        let rule = move |_, read: Range<u64>| {
            if read.end > cut && read.start < toc && read.end <= footer && read.start >= 4096 {
                Fault::Short
            } else {
                Fault::None
            }
        };
        let (image, stats) = render_faulty(&volume, &bytes, rule);
        assert!(image.is_finite() && stats.converged == (stats.bricks_failed == 0));
        assert_eq!(stats.bricks_failed == 0, cut > toc, "cut {cut}, records end at {toc}");
    }
}

#[test]
fn failures_are_the_same_for_every_number_of_threads() {
    let volume = volume();
    let mut bytes = container_bytes(&volume, 16);
    for brick in [[0, 0, 0], [2, 1, 0], [1, 2, 1]] {
        let at = record(&bytes, key(0, brick)).start as usize;
        bytes[at] ^= 1;
    }
    let container = open(&bytes);
    let scene = the_scene(&volume);
    let render = |bricks, threads| {
        render_planned(&container, &scene, &options(), plan(&container, &scene, bricks), threads).unwrap()
    };
    let (expected, first) = render(40, 1);
    assert_eq!(first.bricks_failed, 3);
    for (bricks, threads) in [(1, 1), (2, 8), (5, 2), (40, 8)] {
        let (image, stats) = render(bricks, threads);
        assert!(image == expected && stats.bricks_failed == 3, "{bricks} bricks, {threads} threads");
    }
}
