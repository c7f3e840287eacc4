//! Methods of comparison: each converges to the right value at its known order. Brick size, skipping and accumulation
//! do not change the result unless the method asks for it.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "tests use small numbers"
)]

// The volumes are bricked in memory as in the renderer's own tests.
#[path = "../../../crates/runtime/tests/pictures/support/mod.rs"]
mod support;

use supervol_format::{Lod, VoxelType};
use supervol_measure::comparison::{
    Accumulation, Classification, GradientOperator, Offset, Reconstruction, Rule, Sampling,
};
use supervol_runtime::engines::cells::{CellRule, Pairs};
use supervol_runtime::engines::cpu::{Caster, CpuQuality};
use supervol_runtime::lod::LodChoice;
use supervol_runtime::stream::classify::Skipping;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use support::{Bricked, Volume, difference, marschner_lobb, points, reference, scene};

const CAMERA: &str = r#""camera": {"eye": [95, -70, 62], "target": [20, 20, 20], "up": [0, 0, 1], "fov_y": 30}"#;
const SMALL: &str = r#""image": {"width": 26, "height": 22}"#;
/// No early termination: it would cost far more than the errors whose order is measured.
const NEVER: f64 = 2.0;

/// A transfer function without a bend inside the value range.
fn smooth() -> String {
    points(1.0, &[(0.0, [0.1, 0.2, 0.9], 0.0), (1.0, [0.9, 0.7, 0.1], 0.2)])
}

/// A transfer function with one step inside the value range; colour and opacity are constant on both sides.
fn step() -> String {
    let (low, high) = ([0.2, 0.4, 0.9], [1.0, 0.8, 0.3]);
    points(1.0, &[(0.0, low, 0.01), (0.5, low, 0.01), (0.5, high, 0.3), (1.0, high, 0.3)])
}

fn ml() -> Volume {
    Volume::new([41, 41, 41], VoxelType::F32, marschner_lobb(41))
}

fn dvr(volume: &Volume, tf: &str, rest: &str) -> ResolvedScene {
    scene(volume, &format!(r#"{{{CAMERA}, {SMALL}, "transfer_function": {tf}{rest}}}"#))
}

fn picture(bricks: &Bricked, scene: &ResolvedScene, caster: Caster, skipping: Skipping) -> (Image, u64) {
    let quality = CpuQuality { lod: LodChoice::Fixed(Lod(0)), skipping, caster, ..CpuQuality::default() };
    let frame = bricks.frame_of(scene, quality);
    let mut states = frame.begin();
    let feedback = states.cast_pass(bricks);
    assert!(feedback.is_converged());
    (states.image(), feedback.counters.samples)
}

fn sampled(step_voxels: f64, rule: Rule) -> Sampling {
    Sampling { step_voxels, rule, termination_opacity: NEVER, ..Sampling::default() }
}

fn root_mean_square(a: &Image, b: &Image) -> f64 {
    let pairs = a.pixels.as_flattened().iter().zip(b.pixels.as_flattened());
    let squares: Vec<f64> = pairs.map(|(x, y)| f64::from(x - y).powi(2)).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// Order between two step lengths, from the root mean square over all channels.
fn order(bricks: &Bricked, scene: &ResolvedScene, exact: &Image, casters: [Caster; 2], ratio: f64) -> f64 {
    let [coarse, fine] = casters.map(|caster| root_mean_square(&picture(bricks, scene, caster, Skipping::On).0, exact));
    (coarse / fine).ln() / ratio.ln()
}

#[test]
fn methods_have_their_orders() {
    let volume = ml();
    let bricks = Bricked::new(&volume, 16);
    let (smooth, step) = (dvr(&volume, &smooth(), ""), dvr(&volume, &step(), ""));
    let (exact_smooth, exact_step) = (reference(&volume, &smooth), reference(&volume, &step));
    let at = |rule| [0.5, 0.0625].map(|h| sampled(h, rule).caster());
    let on_smooth = |casters| order(&bricks, &smooth, &exact_smooth, casters, 8.0);
    let on_step = |casters| order(&bricks, &step, &exact_step, casters, 8.0);
    let near = |found: f64, low: f64, high: f64| assert!((low..high).contains(&found), "order {found}");
    near(on_smooth(at(Rule::LeftRiemann)), 0.9, 1.1);
    near(on_smooth(at(Rule::Midpoint)), 1.7, 2.2);
    near(on_smooth(at(Rule::PreIntegrated)), 1.8, 2.2);
    near(on_smooth(at(Rule::PreIntegratedNeglecting)), 0.9, 1.1);
    near(on_step(at(Rule::Midpoint)), 0.6, 1.2);
    near(on_step(at(Rule::PreIntegrated)), 1.7, 2.3);
    // The default has fourth order. It cuts at the step and is constant between cuts, so one pair is exact.
    let cells = |n| Caster::Cells(CellRule { pairs: Pairs::Fixed(n), termination_opacity: NEVER });
    near(order(&bricks, &smooth, &exact_smooth, [cells(1), cells(2)], 2.0), 3.5, 4.5);
    assert!(root_mean_square(&picture(&bricks, &step, cells(1), Skipping::On).0, &exact_step) < 1e-6);
}

#[test]
fn bricks_and_skipping_change_no_bit() {
    let volume = ml();
    let tf =
        points(1.0, &[(0.0, [0.5; 3], 0.0), (0.6, [0.5; 3], 0.0), (0.7, [0.9, 0.3, 0.1], 0.4), (1.0, [1.0; 3], 0.4)]);
    for rest in ["", r#", "shading": {}"#] {
        let scene = dvr(&volume, &tf, rest);
        for rule in [Rule::LeftRiemann, Rule::Midpoint, Rule::PreIntegrated, Rule::LinearOpacity] {
            let sampling = sampled(0.7, rule);
            let (expected, samples) = picture(&Bricked::new(&volume, 64), &scene, sampling.caster(), Skipping::Off);
            let bricks = Bricked::new(&volume, 16);
            assert_eq!(picture(&bricks, &scene, sampling.caster(), Skipping::Off).0, expected, "{rule:?}");
            let (skipped, fewer) = picture(&bricks, &scene, sampling.caster(), Skipping::On);
            assert_eq!(skipped, expected, "{rule:?}");
            assert!(fewer < samples, "{fewer} of {samples} samples");
        }
    }
}

#[test]
fn gradients_and_filters_stay_near_the_model() {
    let volume = ml();
    let bricks = Bricked::new(&volume, 16);
    let scene = dvr(&volume, &smooth(), r#", "shading": {}"#);
    let exact = reference(&volume, &scene);
    let fine = sampled(0.05, Rule::Midpoint);
    let distance =
        |sampling: Sampling, skipping| difference(&picture(&bricks, &scene, sampling.caster(), skipping).0, &exact);
    assert!(distance(fine, Skipping::On) < 1.0);
    for gradient in [GradientOperator::Intermediate, GradientOperator::Sobel] {
        let d = distance(Sampling { gradient, ..fine }, Skipping::On);
        assert!((0.2..60.0).contains(&d), "{gradient:?}: {d}");
    }
    for (reconstruction, most) in [
        (Reconstruction::TrilinearByteFractions, 4.0),
        (Reconstruction::Nearest, 90.0),
        (Reconstruction::CatmullRom, 60.0),
        (Reconstruction::CubicBSpline, 90.0),
    ] {
        let d = distance(Sampling { reconstruction, ..fine }, Skipping::Off);
        assert!((1e-3..most).contains(&d), "{reconstruction:?}: {d}");
    }
}

/// One frame of jittered sampling is noisy; the mean of many frames is not.
#[test]
fn jitter_averages_out_and_is_reproducible() {
    let volume = ml();
    let bricks = Bricked::new(&volume, 16);
    let scene = dvr(&volume, &step(), "");
    let exact = reference(&volume, &scene);
    let frame = |frame| {
        let sampling = Sampling { offset: Offset::Jittered { frame }, ..sampled(1.0, Rule::Midpoint) };
        picture(&bricks, &scene, sampling.caster(), Skipping::On).0
    };
    assert_eq!(frame(3), frame(3));
    assert_ne!(frame(3), frame(4));
    let mean = |frames: u32| {
        let mut sum = vec![[0.0f64; 4]; exact.pixels.len()];
        for i in 0..frames {
            for (s, p) in sum.iter_mut().zip(frame(i).pixels) {
                (0..4).for_each(|c| s[c] += f64::from(p[c]) / f64::from(frames));
            }
        }
        Image { pixels: sum.into_iter().map(|p| p.map(|v| v as f32)).collect(), ..exact.clone() }
    };
    let (one, many) = (root_mean_square(&mean(1), &exact), root_mean_square(&mean(32), &exact));
    assert!(many < one / 8.0, "{one} {many}");
}

/// S09: 500 intervals of opacity 0.003.
#[test]
fn sums_are_rounded_to_what_was_asked_for() {
    let volume = Volume::new([500, 3, 3], VoxelType::F32, |_| 1.0);
    let camera = r#""camera": {"eye": [-10, 1, 1], "target": [1, 1, 1], "up": [0, 0, 1], "height": 1}"#;
    let tf = points(1.0, &[(0.0, [1.0; 3], 0.003)]);
    let scene =
        scene(&volume, &format!(r#"{{{camera}, "image": {{"width": 1, "height": 1}}, "transfer_function": {tf}}}"#));
    let bricks = Bricked::new(&volume, 16);
    let alpha = |accumulation| {
        let sampling = Sampling { accumulation, ..sampled(1.0, Rule::Midpoint) };
        f64::from(picture(&bricks, &scene, sampling.caster(), Skipping::On).0.pixels[0][3])
    };
    let exact = 1.0 - 0.997f64.powi(500);
    for (accumulation, expected) in [
        (Accumulation::Double, exact),
        (Accumulation::Single, exact),
        (Accumulation::Half, 0.775),
        (Accumulation::Byte, 0.349),
    ] {
        assert!((alpha(accumulation) - expected).abs() < 1e-3, "{accumulation:?}: {}", alpha(accumulation));
    }
}

/// S01: on a ramp with a step, pre-classification blurs the step over a whole voxel.
#[test]
fn classification_before_interpolation_smears_edges() {
    let volume = Volume::new([8, 8, 8], VoxelType::F32, |p| p[0]);
    let camera = r#""camera": {"eye": [3.5, 3.5, -9], "target": [3.5, 3.5, 3], "up": [0, 1, 0], "height": 0.1}"#;
    let tf = points(1.0, &[(0.0, [1.0; 3], 0.0), (3.5, [1.0; 3], 0.0), (3.5, [1.0; 3], 0.2), (7.0, [1.0; 3], 0.2)]);
    let scene =
        scene(&volume, &format!(r#"{{{camera}, "image": {{"width": 80, "height": 1}}, "transfer_function": {tf}}}"#));
    let bricks = Bricked::new(&volume, 16);
    let partial = |classification| {
        let sampling = Sampling { classification, ..sampled(0.5, Rule::Midpoint) };
        let image = picture(&bricks, &scene, sampling.caster(), Skipping::On).0;
        assert!(image.is_finite());
        let most = image.pixels.iter().map(|p| p[3]).fold(0.0, f32::max);
        image.pixels.iter().filter(|p| p[3] > 0.001 && p[3] < most - 0.001).count()
    };
    assert!(partial(Classification::Post) <= 1);
    assert!(partial(Classification::Pre) >= 3, "{}", partial(Classification::Pre));
}
