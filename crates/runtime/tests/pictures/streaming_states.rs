//! The streamer under long random sequences of requests, frames and faults: states and cache always agree.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "helpers of tests are tests")]

use std::collections::BTreeSet;
use std::mem::discriminant;
use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::random::Random;
use supervol_format::{BrickIndex, BrickKey, Container, Lod, VoxelType};
use supervol_runtime::engines::cpu::{CpuFrame, CpuQuality};
use supervol_runtime::engines::engine::{Engine, InSteps};
use supervol_runtime::lod::LodChoice;
use supervol_runtime::render::frame::cpu::CpuCaster;
use supervol_runtime::render::frame::{FrameWalk, classifier_for, cpu_frame, streamer_for};
use supervol_runtime::render::options::{LevelChoice, RenderOptions};
use supervol_runtime::stop::Stop;
use supervol_runtime::stream::budget::HostPlan;
use supervol_runtime::stream::classify::{Classifier, Skipping};
use supervol_runtime::stream::field::{Field, FieldBrick};
use supervol_runtime::stream::priority::BrickOrder;
use supervol_runtime::stream::residency::{BrickView, Resident};
use supervol_runtime::stream::state::{ALLOWED, StateKind};
use supervol_runtime::stream::streamer::{Fetched, OnMissing, Room, Streamer};
use supervol_scene::scene::ResolvedScene;
use supervol_scene::value_map::value_map;

use crate::{containers, support};
use containers::{Fault, Faulty, container_bytes, open, plan};
use supervol_runtime::engines::ray_scene::DrawnVolume;
use support::{Volume, noise, points, scene};

/// 4 x 3 x 3 bricks: noise whose peaks coarser levels lose, a constant part, an absent part.
fn volume() -> Volume {
    let field = |p: [f64; 3]| if p[1] > 29.0 { 70.0 } else { 20.0 + 60.0 * noise(p) };
    let mut volume = Volume::new([64, 48, 48], VoxelType::F32, field);
    volume.values.iter_mut().enumerate().filter(|(n, _)| n % 64 > 40).for_each(|(_, v)| *v = f64::NAN);
    volume
}

/// A scene in which values from `visible` on are visible.
fn scene_from(volume: &Volume, visible: f64) -> ResolvedScene {
    scene_with(volume, visible, "")
}

fn scene_with(volume: &Volume, visible: f64, more: &str) -> ResolvedScene {
    let black = [0.0; 3];
    let tf = points(8.0, &[(visible, black, 0.0), (visible, black, 0.2), (visible + 200.0, black, 0.2)]);
    let camera = r#""eye": [150, -90, 80], "target": [23, 21, 15], "up": [0, 0, 1], "fov_y": 28"#;
    let image = r#""image": {"width": 30, "height": 30}"#;
    scene(volume, &format!(r#"{{"camera": {{{camera}}}, {image}, "transfer_function": {tf}{more}}}"#))
}

fn check(streamer: &Streamer, keys: &[FieldBrick]) {
    let (states, cache) = (streamer.states(), streamer.cache());
    let view = streamer.view(OnMissing::Wait);
    let mut in_host = 0;
    for &key in keys {
        let kind = states.state(key).kind();
        assert_eq!(kind == StateKind::InHost, cache.get(key).is_some(), "{key} is {kind:?}");
        assert!(kind != StateKind::Decoding, "{key} was left {kind:?}");
        in_host += u64::from(kind == StateKind::InHost);
        let resident = view.stand_in(key.brick);
        let as_promised = match kind {
            StateKind::InHost => matches!(resident, Resident::Brick(brick) if brick.facts().key == key.brick),
            StateKind::Nothing => matches!(resident, Resident::Nothing),
            StateKind::Uniform => matches!(resident, Resident::Uniform(_)),
            StateKind::Failed => matches!(resident, Resident::UseParent),
            _ => matches!(resident, Resident::Missing),
        };
        assert!(as_promised, "{key} is {kind:?} but seen as {resident:?}");
        // Rays get the same answer, unless they are to continue in the children.
        let drawn = view.lookup(key.brick);
        let is_too_coarse = matches!(drawn, Resident::TooCoarse);
        assert!(is_too_coarse || kind != StateKind::TooCoarse, "{key} is {kind:?} but drawn as {drawn:?}");
        assert!(is_too_coarse || discriminant(&drawn) == discriminant(&resident), "{key}: {drawn:?}, {resident:?}");
        assert!(!is_too_coarse || key.lod() > Lod::FINEST, "{key} has no children");
    }
    assert_eq!((states.total(StateKind::InHost), cache.len() as u64), (in_host, in_host));
    assert!(cache.bytes() + cache.reserved_bytes() <= cache.budget_bytes());
    let loading = states.total(StateKind::Reading);
    assert_eq!(loading > 0, cache.reserved_bytes() > 0, "room is reserved for what is read, and for nothing else");
    assert!(loading == 0 || !streamer.is_idle());
}

fn check_answers(streamer: &Streamer, wanted: &[FieldBrick], fetched: &Fetched) {
    let distinct: BTreeSet<FieldBrick> = wanted.iter().copied().collect();
    assert_eq!(fetched.bricks.len() + fetched.answered.len() + fetched.left, distinct.len());
    let kind = |key: &FieldBrick| streamer.states().state(*key).kind();
    assert!(fetched.bricks.iter().all(|key| kind(key) == StateKind::InHost));
    let answers = [StateKind::Nothing, StateKind::Uniform, StateKind::TooCoarse, StateKind::Failed];
    assert!(fetched.answered.iter().chain(&fetched.neighbours).all(|key| answers.contains(&kind(key))));
}

/// Fetches without waiting, until a brick has arrived, or until all that fit have.
fn fetch_somehow(streamer: &mut Streamer, wanted: &[FieldBrick], bricks: usize, random: &mut Random) -> Fetched {
    let room = |stop, patience| Room { bricks, stop, patience };
    let how = random.below(4);
    let fetched = match how {
        // Requested bricks arrive or are cancelled later.
        0 => streamer.fetch(wanted, room(Stop::at(Some(Instant::now())), None)),
        1 => streamer.fetch(wanted, room(Stop::NEVER, Some(Duration::ZERO))),
        _ => streamer.fetch(wanted, room(Stop::NEVER, None)),
    };
    let fetched = fetched.unwrap();
    assert!(how == 0 || wanted.is_empty() || fetched.is_progress(), "one brick at least");
    assert!(how < 2 || streamer.states().total(StateKind::Reading) == 0, "all is here");
    fetched
}

#[test]
fn states_and_cache_agree_under_random_wishes_and_faults() {
    let volume = volume();
    let mut bytes = container_bytes(&volume, 16);
    // One record is damaged permanently; two of five reads fail. In every second run the tail is not read at once, so
    // the table of contents is not in memory from the start.
    let container = open(&bytes);
    let pyramid = container.pyramid();
    let keys = Field::FIRST.bricks((0..pyramid.brick_count()).filter_map(|e| pyramid.key(e)));
    let entry = |key: &FieldBrick| container.entry(key.brick).unwrap();
    let damaged = keys.iter().filter(|&key| entry(key).record_bytes() > 0).nth(5).unwrap();
    bytes[entry(damaged).offset as usize] ^= 1;
    let descriptor = container.descriptor().clone();

    let mut seen = BTreeSet::new();
    let mut random = Random::new(2024);
    for run in 0..12u64 {
        let fails = move |n: u64| if n < 5 { n == 1 && run % 2 == 0 } else { (n + run) % 5 < 2 };
        let faulty = Faulty::new(bytes.clone(), move |n, _| if fails(n) { Fault::Error } else { Fault::None });
        let container = Arc::new(Container::from_source(faulty).unwrap());
        let iso = scene_with(&volume, 0.0, r#", "mode": "iso", "iso": [{"value": 79, "color": [1, 1, 1]}]"#);
        let scenes = [scene_from(&volume, 30.0), scene_from(&volume, 79.0), scene_from(&volume, 500.0), iso];
        let classifier = |s: &ResolvedScene, are_levels_free: bool| {
            if are_levels_free {
                return classifier_for(&container, s, &RenderOptions::default());
            }
            Classifier::new(s, descriptor.voxel_type, value_map(&container), Skipping::On)
        };
        let state_limit = [10, 30, 1 << 20][run as usize % 3];
        let plan = HostPlan { state_limit, ..plan(&container, &scenes[0], 1 + run) };
        let mut streamer = streamer_for(&container, &scenes[0], &RenderOptions::default(), plan);
        streamer.begin_frame();
        for _ in 0..3000 {
            match random.below(20) {
                0 => streamer.begin_frame(),
                1 => {
                    let scene = &scenes[random.below(4) as usize];
                    streamer.set_classifier(classifier(scene, random.below(2) == 0));
                }
                2 => streamer.set_order(BrickOrder::front_to_back(&scenes[0].camera, &descriptor.geometry)),
                3 => streamer
                    .set_plan(HostPlan { state_limit, ..self::plan(&container, &scenes[0], 1 + random.below(7)) }),
                _ => {
                    streamer.begin_pass();
                    let most = [4, 4, 4, 40][random.below(4) as usize];
                    let count = random.below(most);
                    let wanted: Vec<FieldBrick> =
                        (0..count).map(|_| keys[random.below(keys.len() as u64) as usize]).collect();
                    let bricks = 1 + random.below(5) as usize;
                    let fetched = fetch_somehow(&mut streamer, &wanted, bricks, &mut random);
                    check_answers(&streamer, &wanted, &fetched);
                    streamer.note_uses(&wanted, count);
                }
            }
            check(&streamer, &keys);
        }
        for (from, to) in ALLOWED {
            if streamer.states().transitions(from, to) > 0 {
                seen.insert((from as usize, to as usize));
            }
        }
    }
    // A TOC page stays in memory once read: the entry of a brick that it was read for cannot fail here.
    let rare = [StateKind::Evicted, StateKind::TooCoarse].map(|from| (from, StateKind::Failed));
    for (from, to) in ALLOWED.into_iter().filter(|t| !rare.contains(t)) {
        assert!(seen.contains(&(from as usize, to as usize)), "{from:?} to {to:?} never happened");
    }
}

/// Answers of the table of contents are given again under another look or camera, without a read; bricks to be drawn
/// are left to rays.
#[test]
fn what_was_answered_is_answered_again() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let options = RenderOptions { level: LevelChoice::Fixed(Lod(0)), ..RenderOptions::default() };
    // Under the second look the constant part is invisible.
    let scenes = [30.0, 75.0].map(|visible| scene_from(&volume, visible));
    let mut streamer = streamer_for(&container, &scenes[0], &options, plan(&container, &scenes[0], 100));
    let keys: Vec<FieldBrick> = Field::FIRST.bricks(container.pyramid().keys_of(Lod(0)));
    let room = Room { bricks: usize::MAX, stop: Stop::NEVER, patience: None };
    let fetched = streamer.fetch(&keys, room).unwrap();
    let answered: BTreeSet<FieldBrick> = fetched.answered.iter().copied().collect();
    assert!(answered.len() > 3 && !fetched.bricks.is_empty(), "{fetched:?}");
    assert!(streamer.answer_again(keys.clone()).is_empty(), "all is known");
    for scene in &scenes {
        streamer.set_classifier(classifier_for(&container, scene, &options));
        let read = streamer.counters().bytes_read;
        let again = streamer.answer_again(answered.iter().copied());
        assert_eq!(again.iter().copied().collect::<BTreeSet<_>>(), answered);
        let view = streamer.view(OnMissing::Wait);
        let answers = again.iter().map(|key| view.lookup(key.brick));
        let shows = answers.filter(|answer| matches!(answer, Resident::Uniform(_))).count();
        assert_eq!(shows > 0, std::ptr::eq(scene, &scenes[0]), "the constant part");
        assert_eq!(streamer.counters().bytes_read, read, "nothing is read for it");
    }
}

/// Passes that begin after the deadline still request a brick, and take it when it has arrived.
#[test]
fn a_pass_that_begins_late_comes_some_way() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let scene = scene_from(&volume, 30.0);
    let options = RenderOptions { level: LevelChoice::Fixed(Lod(0)), ..RenderOptions::default() };
    let plan = plan(&container, &scene, 100);
    let mut streamer = streamer_for(&container, &scene, &options, plan);
    let mut caster = CpuCaster::new(cpu_frame(&container, &scene, &options, &plan));
    let late = Stop::at(Some(Instant::now()));
    caster.stop_at(&late);
    caster.begin(0..scene.image_size[1]).unwrap();
    let mut passes = 0;
    loop {
        passes += 1;
        assert!(passes < 2_000, "{:?}", streamer.counters());
        streamer.begin_pass();
        let report = caster.advance(&streamer.view(OnMissing::Wait)).unwrap();
        if report.remaining == 0 && !report.is_stopped {
            break;
        }
        assert!(!report.wanted.is_empty() || !report.used.is_empty(), "pass {passes}");
        streamer.note_uses(&report.used, report.wanted.len() as u64);
        let room = Room { bricks: usize::MAX, stop: late.clone(), patience: Some(Duration::ZERO) };
        streamer.fetch(&report.wanted, room).unwrap();
        std::thread::sleep(Duration::from_millis(1));
    }
    let mut at_once = streamer_for(&container, &scene, &options, plan);
    let mut walk = FrameWalk::new(&mut at_once, plan, &options, Instant::now());
    let mut expected = CpuCaster::new(cpu_frame(&container, &scene, &options, &plan));
    let expected = walk.run(&mut expected, scene.image_size).unwrap();
    let mut pixels = vec![[0.0; 4]; expected.pixels.len()];
    caster.write_image(&mut pixels).unwrap();
    assert!(pixels == expected.pixels);
}

/// A second field is not read from the first one's record.
#[test]
#[should_panic(expected = "brick (0, 0, 0) of LOD 0 of field 1 is wanted of a container of one field")]
fn a_field_that_the_container_does_not_have_is_refused() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let scene = scene_from(&volume, 30.0);
    let plan = plan(&container, &scene, 100);
    let mut streamer = streamer_for(&container, &scene, &RenderOptions::default(), plan);
    let key = BrickKey::new(Lod(0), BrickIndex([0; 3]));
    let room = Room { bricks: usize::MAX, stop: Stop::NEVER, patience: None };
    streamer.fetch(&[Field(0), Field(1)].map(|field| field.brick(key)), room).unwrap();
}

/// S32: a still camera reads nothing more once its bricks are in the cache.
#[test]
fn a_second_frame_of_a_still_camera_reads_nothing() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let scene = scene_from(&volume, 30.0);
    let options = RenderOptions { level: LevelChoice::Fixed(Lod(0)), ..RenderOptions::default() };
    let plan = plan(&container, &scene, 100);
    let quality = CpuQuality { lod: LodChoice::Fixed(Lod(0)), ..CpuQuality::default() };
    let (descriptor, map) = (container.descriptor(), value_map(&container));
    let (pyramid, geometry) = (&descriptor.pyramid, &descriptor.geometry);
    let drawn = DrawnVolume { pyramid, geometry, map, value_range: volume.range() };
    let frame = CpuFrame::new(&scene, &drawn, quality);
    let mut streamer = streamer_for(&container, &scene, &options, plan);
    let mut run = || {
        let mut walk = FrameWalk::new(&mut streamer, plan, &options, Instant::now());
        let image = walk.run(&mut CpuCaster::new(frame.clone()), scene.image_size).unwrap();
        (image, walk.into_stats())
    };
    let (first, cold) = run();
    let (second, warm) = run();
    assert!(first == second && cold.streaming.page_ins > 0);
    assert_eq!(
        (warm.streaming.page_ins, warm.streaming.reads, warm.passes),
        (cold.streaming.page_ins, cold.streaming.reads, 1),
        "totals since the start"
    );
}
