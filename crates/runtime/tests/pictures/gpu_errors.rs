//! Sums of the shader over coarser bricks against `lod::deviation`, on random bricks, transfer functions and rays with
//! a fixed seed. They are equal up to rounding, and never less.

#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "measured errors are printed, and helpers of tests are tests"
)]

use bytemuck::{Pod, Zeroable};
use supervol_format::codec::Codec;
use supervol_format::container::toc::BrickEntry;
use supervol_format::random::Random;
use supervol_format::{BrickIndex, BrickKey, BrickLayout, Dims, Geometry, Lod, Pyramid, ValueRange};
use supervol_runtime::engines::gpu::deviations::{of_ray, on_device};
use supervol_runtime::engines::gpu::layout::{GpuDeviation, RayErrors, Scene as GpuScene};
use supervol_runtime::engines::gpu::shaders;
use supervol_runtime::lod::by_error::DataScale;
use supervol_runtime::lod::deviation::{Deviation, Deviations, Holes, RayDeviation};
use supervol_scene::facts::VolumeFacts;
use supervol_scene::scene::{Mode, Scene};

use crate::gpu_support;
use gpu_support::compute::{Resource, run};
use gpu_support::gpu;

const VALUES: ValueRange = ValueRange { min: 0.0, max: 100.0 };
const DEVIATIONS: usize = 500;
const CASES: usize = 4096;
/// Subtracted from all values.
const SHIFT: f64 = 40.0;

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Case {
    bricks: [u32; 4],
    lengths: [f32; 4],
    transmittance: [f32; 4],
    values: [f32; 4],
    there: u32,
    padding: [u32; 3],
}

#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Found {
    dvr: RayErrors,
    mip: RayErrors,
    minip: RayErrors,
    mean: RayErrors,
}

/// Deviations of random bricks under random transfer functions; exact and unknown ones among them.
fn deviations(random: &mut Random) -> Vec<Deviation> {
    let pyramid = Pyramid::new(Dims([32; 3]), BrickLayout::new(16).unwrap(), &[[2, 2, 2]]).unwrap();
    let facts = VolumeFacts::plain(Dims([32; 3]), Geometry::IDENTITY, VALUES);
    let mut found = vec![Deviation::NONE, Deviation::UNKNOWN];
    while found.len() < DEVIATIONS {
        let alpha = [0.01, 0.3, 1.0][random.below(3) as usize] * random.unit();
        let [from, to] = [60.0 * random.unit(), 60.0 + 40.0 * random.unit()];
        let json = format!(
            r#"{{"transfer_function": {{"points": [{{"value": {from}, "color": [1, 0.5, 0], "alpha": 0}},
            {{"value": {to}, "color": [0.2, 0.5, {}], "alpha": {alpha}}}]}}}}"#,
            random.unit()
        );
        let scene = Scene::from_json(&json).unwrap().resolve(&facts).unwrap();
        let geometry = &Geometry::IDENTITY;
        let data =
            DataScale { pyramid: &pyramid, geometry, scale: 1.0, offset: 0.0, value_range: VALUES, voxel_error: 0.0 };
        let rule = Deviations::new(&scene, &data, 0.0);
        for _ in 0..10 {
            let error = 30.0 * random.unit().powi(4);
            let min = 70.0 * random.unit();
            let range = ValueRange { min, max: min + 30.0 * random.unit() };
            let entry = BrickEntry {
                offset: 4096,
                payload_bytes: 1,
                macro_cell_bytes: 2,
                codec: Codec::Raw,
                absent: false,
                uniform: false,
                has_holes: false,
                checksum: 0,
                fill: 0,
                range,
                range_beneath: range.widened(error),
                error,
            };
            let holes = if random.below(8) == 0 { Holes::Possible } else { Holes::None };
            found.push(rule.of(BrickKey::new(Lod(1), BrickIndex([0; 3])), &entry, holes));
        }
    }
    found
}

fn case(random: &mut Random) -> Case {
    let mut transmittance = [1.0f32; 4];
    for i in 1..4 {
        let through = if random.below(20) == 0 { 0.0 } else { random.unit().powi(3) };
        transmittance[i] = transmittance[i - 1] * (1.0 - through as f32);
    }
    // Some bricks change nothing.
    let mut values = [0.0, 60.0 * (random.unit() - 0.5) as f32, 0.0, 0.0];
    for i in 2..4 {
        values[i] = if random.below(3) == 0 { values[i - 1] } else { 60.0 * (random.unit() - 0.5) as f32 };
    }
    let lengths = [0; 4].map(|_| (20.0 * random.unit().powi(2)) as f32);
    let numbers = [0; 3].map(|_| random.below(DEVIATIONS as u64) as u32);
    Case {
        bricks: [numbers[0], numbers[1], numbers[2], random.below(8) as u32],
        lengths,
        transmittance,
        values,
        // Nothing in front; values are present from some brick on.
        there: [0b1110, 0b1100, 0b1000, 0][random.below(4) as usize],
        padding: [0; 3],
    }
}

/// The same in Rust: modes dvr, mip, minip and mean.
fn expected(case: &Case, deviations: &[Deviation]) -> [RayDeviation; 4] {
    let mut rays = [RayDeviation::NONE; 4];
    for i in 0..3 {
        let deviation = &deviations[case.bricks[i] as usize];
        let [before, after] = [i, i + 1].map(|at| f64::from(case.transmittance[at]));
        let value = |at: usize| {
            if case.there >> at & 1 == 1 { f64::from(case.values[at]) + SHIFT } else { f64::NAN }
        };
        let length = f64::from(case.lengths[i]);
        let is_drawn = case.bricks[3] >> i & 1 == 1;
        rays[0].note_brick(before, is_drawn.then_some(after), length, deviation);
        rays[1].note_greatest([value(i), value(i + 1)], deviation);
        rays[2].note_least([value(i), value(i + 1)], deviation);
        rays[3].note_mean(length, deviation);
    }
    rays
}

#[test]
fn bricks_are_off_by_what_rust_says() {
    let Some(gpu) = gpu() else { return };
    let mut random = Random::new(20_261_125);
    let bricks = deviations(&mut random);
    let table: Vec<GpuDeviation> = bricks.iter().map(|deviation| on_device(deviation, SHIFT)).collect();
    let cases: Vec<Case> = (0..CASES).map(|_| case(&mut random)).collect();
    let scene = GpuScene::zeroed();
    let resources =
        [(0, Resource::Storage(bytemuck::bytes_of(&scene))), (12, Resource::Storage(bytemuck::cast_slice(&table)))];
    let found: Vec<Found> = run(&gpu, shaders::TEST_ERRORS, &resources, &cases);
    let (mut worst, mut tested) = (0.0f64, 0);
    for (case, found) in cases.iter().zip(&found) {
        let [dvr, mip, minip, mean] = expected(case, &bricks);
        let behind = f64::from(case.transmittance[3]);
        let [found_mip, found_minip] =
            [(Mode::Mip, &found.mip), (Mode::Minip, &found.minip)].map(|(mode, errors)| of_ray(mode, errors).reach());
        let pairs = [
            (dvr.of_ray(0.0), of_ray(Mode::Dvr, &found.dvr).of_ray(0.0)),
            (dvr.of_ray(behind), of_ray(Mode::Dvr, &found.dvr).of_ray(behind)),
            (mip.reach()[0], found_mip[0]),
            (mip.reach()[1], found_mip[1]),
            (minip.reach()[0], found_minip[0]),
            (minip.reach()[1], found_minip[1]),
            (mean.mean_reach(7.0)[0], of_ray(Mode::Mean, &found.mean).mean_reach(7.0)[0]),
        ];
        for (i, (exact, found)) in pairs.into_iter().enumerate() {
            if exact.is_infinite() {
                assert!(found.is_infinite(), "{i}: {found} of {exact}, {case:?}");
                continue;
            }
            assert!(found.is_finite(), "{i}: {found} of {exact}, {case:?}");
            // Rounding of `f32`: for numbers of at most 1, and for values of about a hundred.
            let allowed = 2e-6 + 2e-6 * exact.abs() + if i > 1 { 3e-5 } else { 0.0 };
            assert!((found - exact).abs() <= allowed.max(1e-4 * exact), "{i}: {found} of {exact}, {case:?}");
            assert!(found >= exact - allowed, "{i}: {found} of {exact}, {case:?}");
            worst = worst.max(exact - found);
            tested += usize::from(exact > 1e-3);
        }
    }
    println!("at most {worst:.2e} below what Rust says; {tested} numbers above a thousandth");
    assert!(tested > CASES, "{tested}");
}
