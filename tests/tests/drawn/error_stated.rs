//! Stated errors of pictures hold for every pixel, compared with the reference integrator on level 0.

#![allow(clippy::print_stdout, reason = "how tight the statements are is what these tests are for, too")]

use std::time::{Duration, Instant};

use supervol_format::random::Random;
use supervol_format::{Lod, VoxelType};
use supervol_preprocess::{BuildOptions, MaxError};
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::Renderer;
use supervol_runtime::render::stats::FrameStats;
use supervol_scene::image::{GREY_LEVELS, Image, greatest};
use supervol_scene::scene::ResolvedScene;
use supervol_sources::VolumeSource;
use supervol_tests::fields::{Content, Field, options};
use supervol_tests::pictures::{Subject, finest, gpu_name, new_renderer};

const SIZE: &str = r#""image": {"width": 24, "height": 20}"#;
/// Modes without iso surfaces.
const MODES: [&str; 5] = [
    r#""mode": "dvr""#,
    r#""mode": "dvr", "shading": {}"#,
    r#""mode": "mip""#,
    r#""mode": "minip""#,
    r#""mode": "mean""#,
];
/// Error of the reference itself, in grey levels.
pub(crate) const REFERENCE: f64 = 0.01;

/// A renderer that states errors.
pub(crate) fn renderer(subject: &Subject, backend: Backend) -> Renderer {
    let options = RenderOptions { predict_error: true, ..finest(backend) };
    new_renderer(subject, options)
}

/// A picture, the stated error of each pixel, and the statistics.
pub(crate) fn stated(
    renderer: &mut Renderer,
    scene: &ResolvedScene,
    level: LevelChoice,
    budget: Option<Duration>,
) -> (Image, Image, FrameStats) {
    renderer.set_options(RenderOptions { level, ..renderer.options().clone() }).expect("options are right");
    renderer.set_scene(scene.clone());
    renderer.advance(budget.map(|budget| Instant::now() + budget)).expect("a picture");
    let (errors, stats) = (renderer.error_map().expect("somebody asked"), renderer.stats());
    (renderer.picture().expect("there is one").into_owned(), errors, stats)
}

/// Greatest excess of a pixel's error over its stated error, and greatest error of all; in grey levels.
pub(crate) fn beyond(picture: &Image, exact: &Image, errors: &Image) -> (f64, f64) {
    let pixels = picture.pixels.iter().zip(&exact.pixels).zip(&errors.pixels);
    pixels.fold((f64::NEG_INFINITY, 0.0), |(beyond, largest), ((found, exact), stated)| {
        let off = greatest([0, 1, 2, 3].map(|c| f64::from(found[c] - exact[c])));
        assert!(stated[0].is_finite() && stated[3] == 1.0);
        (beyond.max(GREY_LEVELS * (off - f64::from(stated[0]))), largest.max(GREY_LEVELS * off))
    })
}

/// JSON member `"transfer_function"` with random points: much wider than the value range to much narrower, with steps.
fn random_function(random: &mut Random, subject: &Subject) -> String {
    let width = 8.0 * 0.02f64.powf(random.unit());
    let mut places: Vec<f64> = (0..2 + random.below(5)).map(|_| 0.5 + width * (random.unit() - 0.5)).collect();
    places.sort_by(f64::total_cmp);
    if random.below(4) == 0 {
        places[1] = places[0];
    }
    let most = [0.02, 0.3, 1.0][random.below(3) as usize];
    let points: Vec<_> =
        places.iter().map(|&p| (p, [random.unit(), random.unit(), 0.5], most * random.unit())).collect();
    subject.transfer_function(&points)
}

fn waves() -> Field {
    Field::new([48; 3], VoxelType::F32, |p| {
        let [x, y, z] = p.map(|v| v as f64 / 48.0);
        0.5 + 0.2 * (7.0 * x + 2.0 * z).sin() + 0.2 * (6.0 * y - 3.0 * x).cos() + 0.1 * (9.0 * z).sin()
    })
}

/// Default error, in grey levels.
pub(crate) const ASKED: f64 = 0.5;
/// Greatest error that a pixel of the finest level may state in other modes, where the rounding of values comes on top.
const MOST_OF_OTHERS: f64 = 1.0;

/// Settings of the pictures that a test draws of one field.
struct Drawn<'a> {
    backend: Backend,
    levels: &'a [LevelChoice],
    /// Number of random transfer functions per mode.
    functions: usize,
}

/// Draws every mode and level with random transfer functions. The stated error is never less than the measured one.
fn assert_stated(name: &str, field: &Field, drawn: &Drawn<'_>, random: &mut Random) {
    let subject = Subject::new(name, field as &dyn VolumeSource, &options(16));
    let mut renderer = renderer(&subject, drawn.backend);
    let iso =
        format!(r#""mode": "iso", "iso": [{{"value": {:?}, "color": [1, 0.5, 0], "alpha": 0.6}}]"#, subject.value(0.6));
    let mut statements = 0;
    for mode in MODES.into_iter().chain([&*iso]) {
        let (mut tightest, mut useful) = (f64::INFINITY, 0);
        for _ in 0..drawn.functions {
            let function = random_function(random, &subject);
            let scene = subject.scene(&[&subject.outside(), SIZE, &function, mode]);
            let exact = subject.finest(&scene, Backend::Reference);
            for &level in drawn.levels {
                let (picture, errors, stats) = stated(&mut renderer, &scene, level, None);
                let (beyond, largest) = beyond(&picture, &exact, &errors);
                let said = stats.error_stated.expect("ray casters state their error");
                assert!(beyond <= REFERENCE, "{name}, {mode}, {level:?}: {beyond} above, {said:?}; {function}");
                assert!(said.largest_grey_levels + 1e-4 >= largest && said.pixels_unknown == 0, "{said:?}");
                if largest > 0.5 {
                    tightest = tightest.min(said.largest_grey_levels / largest);
                    useful += usize::from(said.largest_grey_levels < 250.0);
                }
                if level == LevelChoice::Fixed(Lod(0)) {
                    assert!(said.levels_grey_levels == 0.0 && !said.presence_may_change, "{said:?}");
                    let most = if mode.contains("dvr") { ASKED } else { MOST_OF_OTHERS };
                    assert!(said.largest_grey_levels <= most, "{name}, {mode}: {said:?}");
                }
            }
        }
        println!("{name}, {mode}: stated / measured at best {tightest:.2}; {useful} statements below 250 levels");
        statements += useful;
    }
    assert!(statements >= drawn.functions, "{name}: only {statements} pictures are off and said to be");
}

const LEVELS: [LevelChoice; 4] =
    [LevelChoice::Auto, LevelChoice::Fixed(Lod(0)), LevelChoice::Fixed(Lod(1)), LevelChoice::Fixed(Lod(2))];

/// A smooth field with spikes and a step, each in a macro cell of its own.
fn spikes() -> Field {
    Field::new([72, 40, 33], VoxelType::F32, |p| match p {
        [20 | 21, 9, 13] | [52, 31, 4] => 1.0,
        [40..44, 20..24, 24..28] => 0.0,
        [x, y, z] => 0.5 + 0.002 * (x + 2 * y + z) as f64,
    })
}

fn contents() -> [(&'static str, Field); 6] {
    let field = |content| Field::of(content, [40, 33, 27], VoxelType::U8);
    [
        ("waves", waves()),
        ("spikes", spikes()),
        ("noise", field(Content::Noise)),
        ("smooth", field(Content::Smooth)),
        ("holes", field(Content::Holes)),
        ("shells", field(Content::Shells)),
    ]
}

#[test]
fn no_pixel_is_farther_off_than_is_stated() {
    let mut random = Random::new(7);
    let drawn = Drawn { backend: Backend::Cpu, levels: &LEVELS, functions: 4 };
    for (name, field) in contents() {
        assert_stated(name, &field, &drawn, &mut random);
    }
}

/// A spike makes its macro cell uncertain, and leaves the rest of its brick as it is.
#[test]
fn a_pixel_beside_the_macro_cell_of_a_spike_states_little() {
    // One brick of 64^3 at level 1. Its spike lies in macro cell (5, 1, 1); the rest is even along x.
    let field = Field::new([128; 3], VoxelType::F32, |p| match p {
        [88, 24, 24] => 1.0,
        [_, y, z] => 0.002 * (y + z) as f64 / 128.0,
    });
    let subject = Subject::new("spike", &field as &dyn VolumeSource, &options(64));
    let mut renderer = renderer(&subject, Backend::Cpu);
    // Everything shows a little, and the spike much. Rays go along x, a pixel is as large as a macro cell.
    let function = r#""transfer_function": {"unit_distance": 1, "points": [{"value": 0, "color": [1, 1, 1], "alpha": 0.001},
        {"value": 1, "color": [1, 1, 1], "alpha": 0.9}]}"#;
    let camera = r#""camera": {"eye": [-100, 63.5, 63.5], "target": [0, 63.5, 63.5], "up": [0, 0, 1], "height": 128}"#;
    let scene = subject.scene(&[camera, r#""image": {"width": 8, "height": 8}"#, function, r#""mode": "dvr""#]);
    let exact = subject.finest(&scene, Backend::Reference);
    let (picture, errors, stats) = stated(&mut renderer, &scene, LevelChoice::Fixed(Lod(1)), None);
    let (beyond, _) = beyond(&picture, &exact, &errors);
    assert!(beyond <= REFERENCE, "{beyond} above, {:?}", stats.error_stated);
    let said: Vec<f64> = errors.pixels.iter().map(|error| GREY_LEVELS * f64::from(error[0])).collect();
    // Two outermost rows also see the even field clamped.
    let (near, beside) = said.iter().partition::<Vec<_>, _>(|&&said| said > 64.0);
    assert!(near.len() == 1 && beside.into_iter().all(|&said| said < 4.0), "the pixel of the spike alone: {said:?}");
}

/// No pixel of a picture by the GPU is, either.
#[test]
fn no_pixel_of_a_device_is_farther_off_than_is_stated() {
    if gpu_name().is_none() {
        return;
    }
    let mut random = Random::new(8);
    let drawn = Drawn { backend: Backend::Gpu, levels: &LEVELS[..3], functions: 2 };
    for (name, field) in contents() {
        assert_stated(name, &field, &drawn, &mut random);
    }
}

/// The statement reports that the presence of voxels may change between levels.
#[test]
fn voxels_that_may_be_there_or_not_are_told() {
    let subject = Subject::new("holes", &Field::of(Content::Holes, [40; 3], VoxelType::U8), &options(16));
    let seen = subject.transfer_function(&[(0.0, [1.0; 3], 0.05), (1.0, [0.5; 3], 0.1)]);
    let scene = subject.scene(&[&subject.outside(), SIZE, &seen]);
    let (_, _, coarse) = stated(&mut renderer(&subject, Backend::Cpu), &scene, LevelChoice::Fixed(Lod(1)), None);
    assert!(coarse.error_stated.is_some_and(|said| said.presence_may_change), "{coarse:#?}");
}

/// A picture with a deadline states the error of its unfinished parts, which decreases.
#[test]
fn unfinished_pictures_state_what_they_do_not_know() {
    let subject = Subject::new("waves", &waves(), &options(16));
    let seen = subject.transfer_function(&[(0.3, [0.9, 0.3, 0.1], 0.0), (0.8, [0.2, 0.7, 0.9], 0.4)]);
    let scene = subject.scene(&[&subject.outside(), r#""image": {"width": 140, "height": 100}"#, &seen]);
    let exact = subject.finest(&scene, Backend::Reference);
    let (picture, errors, stats) =
        stated(&mut renderer(&subject, Backend::Cpu), &scene, LevelChoice::Auto, Some(Duration::ZERO));
    let said = stats.error_stated.unwrap();
    assert!(said.pixels_unknown == 14_000 && said.largest_grey_levels > 100.0, "{said:?}");
    let (beyond, largest) = beyond(&picture, &exact, &errors);
    assert!(beyond <= REFERENCE && largest > 1.0, "{beyond}, {largest}");
    let (_, _, whole) =
        stated(&mut renderer(&subject, Backend::Cpu), &scene, LevelChoice::Auto, Some(Duration::from_secs(60)));
    let whole = whole.error_stated.unwrap();
    assert!(whole.pixels_unknown == 0 && whole.largest_grey_levels < 4.0, "{whole:?}");
}

/// Pictures of quantised voxels, `functions` per mode: the stated error holds relative to the source's own voxels.
fn assert_moved_counts(backend: Backend, functions: usize) {
    let field = waves();
    let exact = Subject::new("waves", &field as &dyn VolumeSource, &options(16));
    let bounded = BuildOptions { max_error: MaxError::Percent(2.0), ..options(16) };
    let moved = Subject::new("moved", &field as &dyn VolumeSource, &bounded);
    let bound = moved.container.descriptor().voxel_error();
    assert!(bound > 0.0 && exact.container.descriptor().voxel_error() == 0.0);
    let mut renderer = renderer(&moved, backend);
    let mut random = Random::new(11);
    let mut largest_of_all = 0.0f64;
    for mode in MODES {
        for _ in 0..functions {
            let function = random_function(&mut random, &exact);
            let scene = exact.scene(&[&exact.outside(), SIZE, &function, mode]);
            let reference = exact.finest(&scene, Backend::Reference);
            for level in [LevelChoice::Auto, LevelChoice::Fixed(Lod(0)), LevelChoice::Fixed(Lod(1))] {
                let (picture, errors, stats) = stated(&mut renderer, &scene, level, None);
                let (beyond, largest) = beyond(&picture, &reference, &errors);
                let said = stats.error_stated.expect("ray casters state their error");
                assert!(beyond <= REFERENCE, "{mode}, {level:?}: {beyond} above, {said:?}; {function}");
                assert!(!said.presence_may_change, "{said:?}");
                if level == LevelChoice::Fixed(Lod(0)) {
                    largest_of_all = largest_of_all.max(largest);
                    assert!(stats.error_bound > 0.0 && stats.error_bound <= bound, "{}", stats.error_bound);
                }
            }
        }
    }
    assert!(largest_of_all > 4.0, "pictures of moved voxels are off by at most {largest_of_all}: nothing is tested");
}

/// The stated error includes the quantisation of voxels.
#[test]
fn moved_voxels_are_part_of_what_is_stated() {
    assert_moved_counts(Backend::Cpu, 6);
}

/// As above, drawn by the GPU.
#[test]
fn moved_voxels_are_part_of_what_a_device_states() {
    if gpu_name().is_some() {
        assert_moved_counts(Backend::Gpu, 3);
    }
}
