//! Values that `f32` rounds: integers of 32 bits, `f64`, windows far from zero. Pictures of the CPU are right, and both engines state
//! how far off they are.

#![allow(clippy::print_stdout, reason = "how far values are rounded is what these tests are for, too")]

use supervol_format::VoxelType;
use supervol_format::random::mix;
use supervol_runtime::render::options::{Backend, LevelChoice};
use supervol_tests::fields::{Field, options};
use supervol_tests::pictures::{Subject, covered, finest, gpu_name};

use crate::error_stated::{ASKED, REFERENCE, beyond, renderer, stated};

const EDGE: u64 = 24;
/// Alpha of a place in a window, and its colour.
const WINDOW: [(f64, [f64; 3], f64); 3] =
    [(0.0, [0.1, 0.3, 0.9], 0.0), (0.5, [1.0, 0.7, 0.2], 0.05), (1.0, [0.9, 0.1, 0.1], 0.3)];

/// A field, and control points in data values.
struct Case {
    name: String,
    field: Field,
    points: Vec<(f64, [f64; 3], f64)>,
}

/// Waves between `base` and `base + width`, a window of that width, and the ends of the whole range.
fn window(voxel_type: VoxelType, range: [f64; 2], base: f64, width: f64) -> Case {
    window_beside_holes(voxel_type, range, (base, width), |_| false)
}

/// The same with voxels that are absent.
fn window_beside_holes(
    voxel_type: VoxelType,
    [low, high]: [f64; 2],
    (base, width): (f64, f64),
    is_hole: fn([u64; 3]) -> bool,
) -> Case {
    let field = Field::new([EDGE; 3], voxel_type, move |p| {
        let [x, y, z] = p.map(|v| v as f64);
        let wave = ((x * 0.41).sin() + (y * 0.37 + 1.0).sin() + (z * 0.51 + x * 0.2).cos()) / 3.0;
        match p {
            [0, 0, 0] => low,
            [n, 0, 0] if n == EDGE - 1 => high,
            hole if is_hole(hole) => f64::NAN,
            _ => base + width * (0.5 + 0.5 * wave),
        }
    });
    let points = WINDOW.map(|(share, color, alpha)| (base + share * width, color, alpha)).to_vec();
    Case { name: format!("window of {width:e} in {voxel_type}"), field, points }
}

/// Blocks of one of these values each, some larger than a brick, and a transfer function with a step at each.
fn blocks(voxel_type: VoxelType, values: &'static [f64]) -> Case {
    let field = Field::new([EDGE; 3], voxel_type, move |[x, y, z]| {
        let block = if z < 8 { 0 } else { mix(x / 4 + 8 * (y / 4) + 64 * (z / 4)) };
        values[(block % values.len() as u64) as usize]
    });
    let mut points = Vec::new();
    for (i, &value) in values.iter().enumerate() {
        let part = |n: usize| (i * n % 5) as f64 / 5.0;
        let before = points.last().map_or(([0.2; 3], 0.02), |&(_, color, alpha): &(f64, [f64; 3], f64)| (color, alpha));
        points.push((value, before.0, before.1));
        points.push((value, [part(1), part(2), part(3)], 0.02 + 0.1 * part(2)));
    }
    Case { name: format!("blocks of {voxel_type}"), field, points }
}

fn cases() -> Vec<Case> {
    let wide = [
        (VoxelType::U32, [0.0, 4_294_967_295.0], 3.0e9),
        (VoxelType::I32, [-2_147_483_648.0, 2_147_483_647.0], 1.5e9),
        (VoxelType::F64, [-1.0e6, 1.0e6], 7.0e5),
    ];
    let windows = wide.into_iter().flat_map(|(voxel_type, range, base)| {
        [-25, -20, -15].map(|log2| window(voxel_type, range, base, (range[1] - range[0]) * 2f64.powi(log2)))
    });
    // Neighbours that are one and the same number of `f32`.
    let ids = blocks(VoxelType::U32, &[22_638_508.0, 22_638_509.0, 22_638_510.0, 1_137_884_490.0, 2_044_805_113.0]);
    let doses = blocks(VoxelType::F64, &[0.1, 0.1 + 1e-12, 0.3, 0.7, 0.798]);
    windows.chain([ids, doses]).collect()
}

/// Draws cases in these modes: no pixel is farther off than it states, and none states more than is asked.
fn assert_stated(backend: Backend, cases: Vec<Case>, modes: &[&str]) {
    for Case { name, field, points } in cases {
        let subject = Subject::new(&name, &field, &options(16));
        let point = |&(value, color, alpha): &(f64, [f64; 3], f64)| {
            format!(r#"{{"value": {value:?}, "color": {color:?}, "alpha": {alpha}}}"#)
        };
        let points: Vec<String> = points.iter().map(point).collect();
        let function = format!(r#""transfer_function": {{"points": [{}]}}"#, points.join(", "));
        let clip = r#""clip": {"box": [[2, 2, 2], [21, 21, 21]]}"#;
        for mode in modes {
            let size = r#""image": {"width": 40, "height": 32}"#;
            let scene = subject.scene(&[&subject.outside(), size, &function, clip, mode]);
            let exact = subject.render(&scene, &finest(Backend::Reference)).0;
            assert!(covered(&exact) > 0.05, "{name}: nothing is to be seen");
            let level = LevelChoice::Fixed(supervol_format::Lod(0));
            let (picture, errors, stats) = stated(&mut renderer(&subject, backend), &scene, level, None);
            let (beyond, largest) = beyond(&picture, &exact, &errors);
            let said = stats.error_stated.expect("ray casters state their error").largest_grey_levels;
            println!("{name}, {mode}: {largest:.3} off, at most {said:.3} stated");
            assert!(beyond <= REFERENCE, "{name}, {mode}: {beyond} above what is stated");
            assert!(said <= ASKED, "{name}, {mode}: {said} stated");
        }
    }
}

const LIGHTS: [&str; 2] = [r#""mode": "dvr""#, r#""mode": "dvr", "shading": {}"#];
const VALUES: [&str; 3] = [r#""mode": "mip""#, r#""mode": "minip""#, r#""mode": "mean""#];

/// Windows in which a step of a few `f32` of a ray's value may show, and gentle ones; without and with holes.
fn steep_windows() -> Vec<Case> {
    let types = [
        (VoxelType::U8, [0.0, 255.0], 100.0, [-6, -3]),
        (VoxelType::U16, [0.0, 65535.0], 30_000.0, [-10, -4]),
        (VoxelType::F32, [-1.0, 1.0], 0.4, [-11, -4]),
        (VoxelType::I32, [-2_147_483_648.0, 2_147_483_647.0], 1.5e9, [-11, -4]),
        (VoxelType::F64, [100_000.0, 102_000.0], 101_000.0, [-11, -4]),
    ];
    let make = |(voxel_type, range, base, widths): (VoxelType, [f64; 2], f64, [i32; 2])| {
        widths.map(|log2| window(voxel_type, range, base, (range[1] - range[0]) * 2f64.powi(log2)))
    };
    let is_hole = |[x, y, z]: [u64; 3]| 3 * x + 2 * y < z + 20;
    let with_holes = |log2: i32| {
        let case = window_beside_holes(VoxelType::F32, [-1.0, 1.0], (0.4, 2f64.powi(log2)), is_hole);
        Case { name: format!("{} beside holes", case.name), ..case }
    };
    types.into_iter().flat_map(make).chain([-11, -4].map(with_holes)).collect()
}

/// Cells are integrated with the values of the data if rounding decides.
#[test]
fn rounded_values_cost_no_accuracy() {
    assert_stated(Backend::Cpu, cases(), &LIGHTS);
}

/// Values of rays are gathered in `f64` if rounding might show.
#[test]
fn steep_windows_of_a_rays_value_cost_no_accuracy() {
    assert_stated(Backend::Cpu, steep_windows(), &VALUES);
}

/// A device has the rounded values alone: where they may change too much, the CPU casts rays again.
#[test]
fn pictures_by_a_device_are_as_accurate() {
    if gpu_name().is_some() {
        assert_stated(Backend::Gpu, cases(), &LIGHTS);
        assert_stated(Backend::Gpu, steep_windows(), &VALUES);
    }
}
