//! A renderer of successive pictures: for any settings, each equals the picture of a new renderer.

#![allow(clippy::unwrap_used, reason = "helpers of tests are tests")]

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

use supervol_format::byte_source::ReadShape;
use supervol_format::{BrickIndex, BrickKey, ByteSource, Container, Lod, VoxelType};
use supervol_runtime::render::options::{Backend, LevelChoice, Progress, Refining, RenderOptions};
use supervol_runtime::render::renderer::{Renderer, render};
use supervol_runtime::stop::LEAST_STEP;
use supervol_runtime::stream::state::StateKind;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use crate::{containers, support};
use containers::{Faulty, container_bytes, open};
use support::{Volume, marschner_lobb, points, scene};

/// More rays than a sketch has.
const SIZE: [u32; 2] = [150, 110];

fn volume() -> Volume {
    let signal = marschner_lobb(64);
    Volume::new([64, 60, 50], VoxelType::U8, move |p| 255.0 * signal(p))
}

/// Settings that may change from picture to picture.
#[derive(Clone, Copy)]
struct Wanted {
    mode: &'static str,
    eye: [f64; 3],
    opacity: f64,
    size: [u32; 2],
}

/// Mode `dvr`, with surfaces inside the volume.
const SURFACES_INSIDE: &str = "dvr with iso";

const FIRST: Wanted = Wanted { mode: "dvr", eye: [190.0, -130.0, 120.0], opacity: 0.3, size: SIZE };

fn scene_of(volume: &Volume, wanted: Wanted) -> ResolvedScene {
    let Wanted { mode, eye, opacity, size: [width, height] } = wanted;
    let tf =
        points(4.0, &[(90.0, [0.1, 0.2, 0.9], 0.0), (160.0, [0.9, 0.8, 0.1], 0.05), (255.0, [0.9, 0.1, 0.1], opacity)]);
    let camera = format!(r#""eye": {eye:?}, "target": [31, 29, 24], "up": [0, 0, 1], "fov_y": 25"#);
    let image = format!(r#""image": {{"width": {width}, "height": {height}}}"#);
    let surface = r#", "iso": [{"value": 130, "color": [1, 1, 1], "alpha": 0.6}]"#;
    let (mode, iso) = match mode {
        "iso" => (mode, surface),
        SURFACES_INSIDE => ("dvr", surface),
        _ => (mode, ""),
    };
    scene(volume, &format!(r#"{{"camera": {{{camera}}}, {image}, "mode": "{mode}", "transfer_function": {tf}{iso}}}"#))
}

fn options(level: LevelChoice) -> RenderOptions {
    RenderOptions { backend: Backend::Cpu, level, threads: Some(2), ..RenderOptions::default() }
}

fn renderer(container: &Arc<Container>, options: RenderOptions) -> Renderer {
    Renderer::new(supervol_runtime::render::volume::PlacedVolume::of(container.clone()), options).unwrap()
}

/// Advances until the picture has converged; returns the number of steps.
fn converge(renderer: &mut Renderer, step: Duration) -> u32 {
    for steps in 1..10_000 {
        let done = renderer.advance(Some(Instant::now() + step)).unwrap();
        let picture = renderer.picture().expect("with a deadline there is always a picture");
        assert!(picture.is_finite() && !done.is_cancelled, "{done:?}");
        assert_eq!(done.is_finished, done.pixels_unfinished == 0, "{done:?}");
        if done.is_finished {
            return steps;
        }
    }
    panic!("10,000 steps did not suffice");
}

fn expected(container: &Arc<Container>, scene: &ResolvedScene, level: LevelChoice) -> Image {
    render(container, scene, &options(level)).unwrap().0
}

/// Whatever changes, and however often the picture is interrupted, it becomes the one that a new renderer draws at
/// once.
#[test]
fn every_picture_becomes_that_of_a_new_renderer() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let changes = [
        FIRST,
        Wanted { eye: [150.0, -160.0, 120.0], ..FIRST },
        Wanted { opacity: 0.9, ..FIRST },
        Wanted { size: [70, 131], ..FIRST },
        Wanted { mode: "mip", ..FIRST },
        Wanted { mode: "iso", ..FIRST },
        Wanted { eye: [33.0, 20.0, 20.0], ..FIRST },
        FIRST,
        Wanted { mode: SURFACES_INSIDE, ..FIRST },
        Wanted { mode: SURFACES_INSIDE, eye: [33.0, 20.0, 20.0], ..FIRST },
    ];
    for level in [LevelChoice::Auto, LevelChoice::Fixed(Lod::FINEST), LevelChoice::Fixed(Lod(1))] {
        // A cache that holds all bricks, and one that holds a few.
        for cache_bytes in [None, Some(60_000)] {
            let mut renderer = renderer(&container, RenderOptions { cache_bytes, ..options(level) });
            for (i, wanted) in changes.into_iter().enumerate() {
                let scene = scene_of(&volume, wanted);
                renderer.set_scene(scene.clone());
                let is_in_steps = i % 3 != 2;
                if is_in_steps {
                    // Even steps without any time make progress.
                    converge(&mut renderer, Duration::from_millis(i as u64 % 3 * 2));
                } else {
                    assert!(renderer.advance(None).unwrap().is_finished);
                }
                let picture = renderer.picture().unwrap();
                assert!(*picture == expected(&container, &scene, level), "{level:?}, {cache_bytes:?}: picture {i}");
                let stats = renderer.stats();
                assert_eq!([stats.image_width, stats.image_height], wanted.size);
                assert!(stats.host_cache_peak_bytes <= stats.host_cache_budget_bytes, "{stats:#?}");
            }
        }
    }
}

/// On a busy machine each pass may take longer than a step: bricks read in the meantime are taken by the next step.
#[test]
fn steps_that_are_over_before_anything_is_fetched_come_some_way() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let level = LevelChoice::Fixed(Lod::FINEST);
    let scene = scene_of(&volume, Wanted { eye: [33.0, 20.0, 20.0], ..FIRST });
    let progress = |_: Progress| std::thread::sleep(2 * LEAST_STEP);
    let options = RenderOptions { progress: Some(Arc::new(progress)), cache_bytes: Some(60_000), ..options(level) };
    let mut renderer = renderer(&container, options);
    renderer.set_scene(scene.clone());
    let steps = converge(&mut renderer, Duration::ZERO);
    assert!((10..300).contains(&steps), "{steps} steps, where some 25 bricks are wanted, a few at a time");
    assert!(*renderer.picture().unwrap() == expected(&container, &scene, level));
}

/// Loaded bricks serve every later picture: from another side, through another transfer function, or repeated.
#[test]
fn nothing_that_is_loaded_is_read_again() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let mut renderer = renderer(&container, options(LevelChoice::Fixed(Lod::FINEST)));
    renderer.set_scene(scene_of(&volume, FIRST));
    renderer.advance(None).unwrap();
    let first = renderer.stats();
    assert!(first.streaming.page_ins > 20 && first.streaming.repeated_page_ins == 0, "{first:#?}");
    for wanted in [FIRST, Wanted { eye: [180.0, -140.0, 110.0], ..FIRST }, Wanted { opacity: 0.8, ..FIRST }] {
        renderer.set_scene(scene_of(&volume, wanted));
        renderer.begin_anew();
        renderer.advance(None).unwrap();
        let stats = renderer.stats();
        assert!(
            stats.streaming.page_ins <= 4 && stats.streaming.repeated_page_ins == 0 && stats.converged,
            "{stats:#?}"
        );
    }
    // A converged picture is not drawn again.
    renderer.set_scene(scene_of(&volume, Wanted { opacity: 0.8, ..FIRST }));
    let passes = renderer.stats().passes;
    assert!(renderer.advance(None).unwrap().is_finished);
    assert_eq!(renderer.stats().passes, passes);
}

/// A cancelled picture continues; its finished parts stay.
#[test]
fn a_cancelled_picture_goes_on() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    // From far away voxels are smaller than pixels: a sketch takes coarser bricks than the requested error allows.
    let from_afar = Wanted { eye: [590.0, -450.0, 400.0], ..FIRST };
    let cases = [(LevelChoice::Fixed(Lod::FINEST), FIRST), (LevelChoice::Auto, from_afar)];
    for ((level, wanted), cancel_after) in cases.into_iter().flat_map(|case| [0, 1, 2, 4].map(|passes| (case, passes)))
    {
        let scene = scene_of(&volume, wanted);
        let expected = expected(&container, &scene, level);
        let slot: Arc<std::sync::OnceLock<supervol_runtime::stop::Canceller>> = Arc::default();
        let canceller = slot.clone();
        let progress = move |progress: Progress| {
            if progress.passes == cancel_after {
                canceller.get().unwrap().cancel();
            }
        };
        // One brick at a time: many passes.
        let options = RenderOptions { progress: Some(Arc::new(progress)), cache_bytes: Some(30_000), ..options(level) };
        let mut renderer = renderer(&container, options);
        slot.set(renderer.canceller()).unwrap();
        renderer.set_scene(scene.clone());
        if cancel_after == 0 {
            renderer.canceller().cancel();
        }
        let step = renderer.advance(None).unwrap();
        assert!(step.is_cancelled && !step.is_finished && renderer.picture().is_none(), "{cancel_after}: {step:?}");
        // The next step gives a whole picture; later ones reach the final picture.
        let step = renderer.advance(Some(Instant::now())).unwrap();
        assert!(!step.is_cancelled && step.coarsest_pixel > 1, "{cancel_after}: {step:?}");
        assert!(renderer.picture().unwrap().is_finite());
        assert!(renderer.advance(None).unwrap().is_finished);
        assert!(*renderer.picture().unwrap() == expected, "{level:?}, cancelled after {cancel_after} passes");
        assert_eq!(renderer.streamer().unwrap().states().total(StateKind::Queued), 0);
    }
}

/// Layers that average to nothing appear in the sketch, and the camera shows all of them; the final picture is exact.
#[test]
fn a_sketch_shows_what_averages_lose() {
    let volume = Volume::new([64, 64, 64], VoxelType::U8, |[_, _, k]| if k % 2.0 == 0.0 { 20.0 } else { 220.0 });
    let container = open(&container_bytes(&volume, 16));
    let tf = points(
        8.0,
        &[
            (20.0, [1.0, 0.0, 0.0], 0.5),
            (60.0, [1.0, 0.0, 0.0], 0.0),
            (180.0, [0.0, 0.0, 1.0], 0.0),
            (220.0, [0.0, 0.0, 1.0], 0.5),
        ],
    );
    let scene = scene(
        &volume,
        &format!(
            r#"{{"camera": {{"eye": [31.5, -150, 31.5], "target": [31.5, 31.5, 31.5], "up": [0, 0, 1], "height": 60}},
            "image": {{"width": 200, "height": 160}}, "transfer_function": {tf}}}"#
        ),
    );
    let mut renderer = renderer(&container, options(LevelChoice::Fixed(Lod::FINEST)));
    renderer.set_scene(scene.clone());
    assert!(renderer.advance(Some(Instant::now())).unwrap().coarsest_pixel > 1);
    let middle = |renderer: &Renderer| renderer.picture().unwrap().pixels[80 * 200 + 100];
    let sketched = middle(&renderer);
    renderer.advance(None).unwrap();
    let exact = expected(&container, &scene, LevelChoice::Fixed(Lod::FINEST)).pixels;
    assert_eq!(middle(&renderer), exact[80 * 200 + 100]);
    // Both colours have equal shares: half of the voxels lie above the mean, half below it.
    assert!(sketched[3] > 0.5 && (sketched[0] - sketched[2]).abs() < 1e-3 && sketched[1] == 0.0, "{sketched:?}");
}

/// Reads continue between steps: bricks that arrive in the meantime serve the next step.
#[test]
fn reading_goes_on_between_two_steps() {
    let volume = volume();
    let delay = Duration::from_millis(15);
    let container = Arc::new(Container::from_source(Faulty::slow(container_bytes(&volume, 16), delay)).unwrap());
    let scene = scene_of(&volume, FIRST);
    let level = LevelChoice::Fixed(Lod::FINEST);
    let mut renderer = renderer(&container, options(level));
    renderer.set_scene(scene.clone());
    // The first step waits for the coarsest level in any case. Later ones are too short for any read that they begin.
    renderer.advance(Some(Instant::now())).unwrap();
    let coarse = renderer.stats().streaming.page_ins;
    let mut stats = renderer.stats();
    while !stats.converged {
        renderer.advance(Some(Instant::now() + delay / 3)).unwrap();
        stats = renderer.stats();
        std::thread::sleep(2 * delay);
    }
    assert!(stats.streaming.page_ins > coarse && stats.fallbacks > 0, "{stats:#?}");
    assert!(*renderer.picture().unwrap() == expected(&open(&container_bytes(&volume, 16)), &scene, level));
    assert_eq!(stats.streaming.repeated_page_ins, 0);
}

/// A source that holds one record back until two passes have ended since its read began.
struct HeldBack {
    bytes: Vec<u8>,
    record: u64,
    passes: Arc<(Mutex<u64>, Condvar)>,
    /// Whether two passes have ended during the read.
    is_overlapped: AtomicBool,
}

impl ByteSource for HeldBack {
    fn len(&self) -> std::io::Result<u64> {
        Ok(self.bytes.len() as u64)
    }

    fn read_exact_at(&self, offset: u64, buffer: &mut [u8]) -> std::io::Result<()> {
        if offset == self.record {
            let (passes, more) = &*self.passes;
            let begun = passes.lock().unwrap();
            let enough = *begun + 2;
            let long = Duration::from_secs(20);
            let (_ended, waited) = more.wait_timeout_while(begun, long, |passes| *passes < enough).unwrap();
            self.is_overlapped.store(!waited.timed_out(), Ordering::Relaxed);
        }
        self.bytes.read_exact_at(offset, buffer)
    }

    /// Each record is read alone.
    fn read_shape(&self) -> ReadShape {
        ReadShape { gap_bytes: 0, read_bytes: 1 }
    }
}

/// One call without a deadline casts the rays that can continue while the record of another brick is being read.
#[test]
fn rays_are_cast_while_bricks_are_read() {
    let volume = volume();
    let bytes = container_bytes(&volume, 16);
    let container = open(&bytes);
    let scene = scene_of(&volume, FIRST);
    let level = LevelChoice::Fixed(Lod::FINEST);
    let record = container.entry(BrickKey::new(Lod::FINEST, BrickIndex([2, 1, 1]))).unwrap().offset;
    let passes: Arc<(Mutex<u64>, Condvar)> = Arc::default();
    let source = Arc::new(HeldBack { bytes, record, passes: passes.clone(), is_overlapped: AtomicBool::new(false) });
    let progress = move |progress: Progress| {
        *passes.0.lock().unwrap() = progress.passes;
        passes.1.notify_all();
    };
    let options = RenderOptions { progress: Some(Arc::new(progress)), ..options(level) };
    let slow = Arc::new(Container::from_source(source.clone()).unwrap());
    let mut renderer = renderer(&slow, options);
    renderer.set_scene(scene.clone());
    assert!(renderer.advance(None).unwrap().is_finished);
    assert!(source.is_overlapped.load(Ordering::Relaxed), "no pass ended while the record was being read");
    assert!(*renderer.picture().unwrap() == expected(&container, &scene, level));
}

/// A budget that is too small for one picture is an error of that picture alone.
#[test]
fn a_renderer_survives_an_error() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let level = LevelChoice::Fixed(Lod::FINEST);
    let mut renderer = renderer(&container, RenderOptions { host_memory_bytes: 4 << 20, ..options(level) });
    let small = scene_of(&volume, FIRST);
    for scene in [small.clone(), scene_of(&volume, Wanted { size: [4000, 3000], ..FIRST }), small.clone()] {
        renderer.set_scene(scene.clone());
        let step = renderer.advance(None);
        assert_eq!(step.is_ok(), scene == small);
        assert_eq!(renderer.picture().is_some(), scene == small);
        assert_eq!(renderer.stats().converged, scene == small);
    }
    assert!(*renderer.picture().unwrap() == expected(&container, &small, level));
}

#[test]
fn rays_are_counted_while_they_are_cast() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let scene = scene_of(&volume, FIRST);
    for threads in [1, 3] {
        let finished = Arc::new(std::sync::atomic::AtomicU64::new(0));
        // Many passes; each finishes some rays.
        let options = RenderOptions {
            rays_finished: Some(finished.clone()),
            cache_bytes: Some(30_000),
            threads: Some(threads),
            ..options(LevelChoice::Auto)
        };
        let mut renderer = renderer(&container, options);
        renderer.set_scene(scene.clone());
        assert!(renderer.advance(None).unwrap().is_finished);
        let rays = u64::from(scene.camera.width) * u64::from(scene.camera.height);
        assert_eq!(finished.load(Ordering::Relaxed), rays);
    }
}

/// Rays that end inside the volume are counted once, however often the picture is interrupted.
#[test]
fn rays_that_end_early_are_counted_once() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let tf = points(1.0, &[(0.0, [1.0; 3], 1.0)]);
    let camera = r#""camera": {"eye": [190, -130, 120], "target": [31, 29, 24], "up": [0, 0, 1], "fov_y": 25}"#;
    let image = r#""image": {"width": 80, "height": 80}"#;
    let scene = scene(&volume, &format!(r#"{{{camera}, {image}, "mode": "dvr", "transfer_function": {tf}}}"#));
    let level = LevelChoice::Fixed(Lod::FINEST);
    let (_, cold) = render(&container, &scene, &options(level)).unwrap();
    let mut renderer = renderer(&container, RenderOptions { cache_bytes: Some(30_000), ..options(level) });
    renderer.set_scene(scene);
    let steps = converge(&mut renderer, Duration::ZERO);
    let found = renderer.stats().casting.rays_terminated_early;
    assert!(steps > 3 && found > 1000, "{steps} steps, {found} rays");
    assert_eq!(found, cold.casting.rays_terminated_early);
}

/// Prefetched bricks are not read again by the picture that wants them. The picture is the same, and no brick of the
/// last one has left the cache.
#[test]
fn looking_ahead_reads_what_the_next_picture_wants() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    // From inside, looking across the middle.
    let station = |i: u32| {
        let (sin, cos) = (0.4 * f64::from(i)).sin_cos();
        scene_of(&volume, Wanted { eye: [31.0 + 20.0 * cos, 29.0 + 20.0 * sin, 24.0], ..FIRST })
    };
    for cache_bytes in [None, Some(400_000), Some(60_000)] {
        let ride = |is_ahead: bool| {
            let options = RenderOptions { cache_bytes, ..options(LevelChoice::Fixed(Lod::FINEST)) };
            let mut renderer = renderer(&container, options);
            let (mut of_frames, mut of_ahead) = (0, 0);
            assert_eq!(renderer.look_ahead(None).unwrap(), Default::default(), "there is no picture");
            for i in 0..5 {
                let scene = station(i);
                renderer.set_scene(scene.clone());
                assert!(renderer.advance(None).unwrap().is_finished);
                assert!(*renderer.picture().unwrap() == expected(&container, &scene, LevelChoice::Fixed(Lod::FINEST)));
                of_frames += if i < 2 { 0 } else { renderer.stats().streaming.page_ins };
                if is_ahead {
                    let ahead = renderer.look_ahead(None).unwrap();
                    assert!(i > 0 || ahead.page_ins == 0, "the camera has not moved");
                    assert!(cache_bytes.is_some() || i == 0 || ahead.is_complete, "{i}: {ahead:?}");
                    of_ahead += ahead.page_ins;
                    // The picture stays, without further cost.
                    assert!(renderer.advance(None).unwrap().is_finished);
                    renderer.begin_anew();
                    renderer.advance(None).unwrap();
                    assert!(
                        renderer.stats().streaming.page_ins == 0 || cache_bytes == Some(60_000),
                        "bricks of it have left"
                    );
                }
                let stats = renderer.stats();
                assert!(stats.host_cache_peak_bytes <= stats.host_cache_budget_bytes);
            }
            (of_frames, of_ahead)
        };
        let ((without, none), (with, ahead)) = (ride(false), ride(true));
        assert_eq!(none, 0);
        assert!(without > 0, "the path wants new bricks");
        match cache_bytes {
            None => assert!(with * 4 <= without && ahead > 0, "{with} of {without}, {ahead} ahead"),
            Some(_) => assert!(with <= without, "{with} of {without}, {ahead} ahead: too little room for harm"),
        }
    }
}

/// Shown pictures are evenly sharp: each is that of one pixel size, and there are few sizes.
#[test]
fn windows_show_whole_stages() {
    let volume = volume();
    let container = open(&container_bytes(&volume, 16));
    let level = LevelChoice::Fixed(Lod::FINEST);
    let scene = scene_of(&volume, Wanted { size: [220, 180], ..FIRST });
    let shown = |refining| {
        let progress = |_: Progress| std::thread::sleep(2 * LEAST_STEP);
        let options =
            RenderOptions { refining, progress: Some(Arc::new(progress)), cache_bytes: Some(60_000), ..options(level) };
        let mut renderer = renderer(&container, options);
        renderer.set_scene(scene.clone());
        let mut pictures: Vec<Image> = Vec::new();
        loop {
            let is_finished = renderer.advance(Some(Instant::now())).unwrap().is_finished;
            let picture = renderer.picture().unwrap();
            if pictures.last() != Some(&*picture) {
                pictures.push(picture.into_owned());
            }
            if is_finished {
                return pictures;
            }
        }
    };
    let (stages, tiles) = (shown(Refining::WholeStages), shown(Refining::Tiles));
    // The sketch has pixels of at most 4 x 4.
    assert!((2..=4).contains(&stages.len()) && tiles.len() > 6, "{} and {} pictures", stages.len(), tiles.len());
    assert!(stages.last() == tiles.last() && *stages.last().unwrap() == expected(&container, &scene, level));
}
