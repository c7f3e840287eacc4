//! Gates that do not hold yet, each with its distance and the remedy. A test here fails as soon as its gate holds. Then
//! it moves to `stability.rs` and into the changelog.

#![allow(clippy::print_stdout, reason = "the distances measured are what these tests are for")]

use supervol_format::VoxelType;
use supervol_runtime::render::options::Backend;
use supervol_tests::fields::{Field, options};
use supervol_tests::pictures::{BOUND, Subject, covered, distance, finest};
use supervol_tests::stability::{broken_gates, measured};

/// Asserts that exactly one gate of the regime is broken, and that its text contains `what`.
fn is_still_broken(id: &str, what: &str) {
    if let Some(outcome) = measured(id) {
        let broken = broken_gates(&outcome);
        assert!(
            broken.len() == 1 && broken[0].contains(what),
            "{id}: expected one broken gate, about '{what}', found {broken:#?}"
        );
    }
}

/// A forced checkerboard of two levels. Errors of opposite sign cancel along a ray in one level, but not along a ray
/// that changes levels. A pixel can then leave the interval between its two pure colours, by up to 11.1 grey levels at
/// full size. No change of the integration can remove this. If levels are chosen by error, both pure pictures are
/// within the target, and so is their mixture.
#[test]
fn s15_level_seams() {
    is_still_broken("S15", "interval");
}

/// Jittered sampling, one sample per voxel (a method for comparison). The mean over frames is taken of opacities, not
/// of optical depths. So noise of the depth leaves half its variance as a bias, most of all if the transfer function
/// steps at a ray's end. The default method does not jitter and has no such bias.
#[test]
fn s43_jitter() {
    is_still_broken("S43", "samples 1 voxel apart");
}

/// Volumes with a value range that `f32` cannot resolve: voxel type, range, and a value in it.
const WIDE: [(VoxelType, [f64; 2], f64); 3] = [
    (VoxelType::U32, [0.0, 4_294_967_295.0], 3.0e9),
    (VoxelType::I32, [-2_147_483_648.0, 2_147_483_647.0], 1.5e9),
    (VoxelType::F64, [-1.0e6, 1.0e6], 7.0e5),
];

/// Distance in grey levels of the CPU's picture from the reference. The field has waves between `base` and
/// `base + width`, and the transfer function has that width. Two clipped voxels hold the ends of the value range.
fn distance_in_window(voxel_type: VoxelType, [low, high]: [f64; 2], base: f64, width: f64) -> f64 {
    const EDGE: u64 = 24;
    let field = Field::new([EDGE; 3], voxel_type, move |p| {
        let [x, y, z] = p.map(|v| v as f64);
        let wave = ((x * 0.41).sin() + (y * 0.37 + 1.0).sin() + (z * 0.51 + x * 0.2).cos()) / 3.0;
        match p {
            [0, 0, 0] => low,
            [n, 0, 0] if n == EDGE - 1 => high,
            _ => base + width * (0.5 + 0.5 * wave),
        }
    });
    let subject = Subject::new(&format!("window of {width:e} in {voxel_type}"), &field, &options(16));
    let point = |&(share, color, alpha): &(f64, [f64; 3], f64)| {
        format!(r#"{{"value": {:?}, "color": {color:?}, "alpha": {alpha}}}"#, base + share * width)
    };
    let points = [(0.0, [0.1, 0.3, 0.9], 0.0), (0.5, [1.0, 0.7, 0.2], 0.05), (1.0, [0.9, 0.1, 0.1], 0.3)];
    let tf = format!(r#""transfer_function": {{"points": [{}]}}"#, points.each_ref().map(point).join(", "));
    let clip = r#""clip": {"box": [[2, 2, 2], [21, 21, 21]]}"#;
    let scene = subject.scene(&[&subject.outside(), r#""image": {"width": 40, "height": 32}"#, &tf, clip]);
    let exact = subject.render(&scene, &finest(Backend::Reference)).0;
    assert!(covered(&exact) > 0.05, "the window shows nothing");
    distance(&subject.finest(&scene, Backend::Cpu), &exact)
}

/// Render values are `f32` (`ValueMap`): 24 bits of a value's distance from the middle or from zero. A smooth transfer
/// function over a small part of the range shows steps. Measured: 115 to 167 grey levels at 2^-25 of the range, 4.5 to
/// 7.4 at 2^-20. At 2^-16 the error is at most half a level. Remedy: render values relative to the transfer function's
/// window instead of the volume's middle.
#[test]
fn windows_of_values_that_f32_does_not_resolve() {
    for (voxel_type, range, base) in WIDE {
        let at = |log2: i32| distance_in_window(voxel_type, range, base, (range[1] - range[0]) * 2f64.powi(log2));
        let [lost, coarse, fine] = [-25, -20, -15].map(at);
        println!("{voxel_type}: 2^-25 of the range {lost:.3}/255, 2^-20 {coarse:.3}/255, 2^-15 {fine:.3}/255");
        assert!(lost > 100.0 * BOUND && coarse > BOUND, "{voxel_type}: narrow windows are resolved");
        assert!(fine <= BOUND, "{voxel_type}: 2^-15 of the range is beyond the limit, too");
    }
}
