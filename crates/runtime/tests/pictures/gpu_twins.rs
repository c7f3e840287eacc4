#![allow(clippy::print_stdout, reason = "measured errors are printed")]
//! Shader functions against their Rust twins, on random numbers with a fixed seed.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use supervol_format::Geometry;
use supervol_format::random::Random;
use supervol_runtime::engines::cells::cell::{
    cubic_extremes, cubic_mean, cubic_of_cell, monotone_intervals, monotone_root, trilinear,
};
use supervol_runtime::engines::cells::quadrature::{
    PAIR_LIMIT, integrate_pair, opacity_of, pair_count, pairs_between, shaded_pair_count,
};
use supervol_runtime::engines::cells::shade::{Lighting, shade};
use supervol_runtime::engines::gpu::device::GpuDevice;
use supervol_runtime::engines::gpu::layout::{Dispatch, Scene as GpuScene, SlotGrid, View};
use supervol_runtime::engines::gpu::part_twins::{
    LightChord, LightLine, LightPart, channels_at, integrate_chord, integrate_line, line_of, line_over, no_line,
    shade_part,
};
use supervol_runtime::engines::gpu::piece_table::PieceTable;
use supervol_runtime::engines::gpu::scene_tables::{Exactness, FeedbackPlaces};
use supervol_runtime::engines::gpu::twins::{range_of_corners, twist_of, value_in};
use supervol_runtime::engines::gpu::{scene_tables, shaders};
use supervol_runtime::stream::classify::Skipping;
use supervol_scene::image::greatest;
use supervol_scene::transfer_function::RenderTransferFunction;
use supervol_scene::transfer_function::pieces::Column;
use supervol_scene::transfer_function::render::absorbance;

use crate::gpu_support;
use gpu_support::compute::{Resource, run};
use gpu_support::{F32, TestVolume, gpu, marschner_lobb};

const SEED: u64 = 20_261_120;
const CASES: usize = 4096;
const EXACTNESS: Exactness = Exactness { skipping: Skipping::On, max_error: 0.5 / 255.0, sums_errors: false };
/// Value of a missing root; all roots lie in [0, 1].
const NO_ROOT: f32 = 2.0;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Case {
    low: [f32; 4],
    high: [f32; 4],
    a_value: [f32; 4],
    b_u: [f32; 4],
    near: [f32; 4],
    far: [f32; 4],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Outcome {
    cubic: [f32; 4],
    intervals: [f32; 4],
    field: [f32; 4],
    rgba: [f32; 4],
    light: [f32; 4],
    pair: [f32; 4],
    shaded: [f32; 4],
    search: [f32; 4],
    /// Numbers of Gauss pairs; checked by [`check_counts`].
    counts: [f32; 4],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct LightOutcome {
    cell: [f32; 4],
    channels: [f32; 4],
    part: [f32; 4],
    moments: [f32; 4],
    lit: [f32; 4],
    both: [f32; 4],
    line: [f32; 4],
    errors: [f32; 4],
}

/// The same through the Rust functions.
fn outcome(case: &Case, tf: &RenderTransferFunction, lighting: &Lighting) -> Outcome {
    let corners = corners(case);
    let [a, b] = [case.a_value, case.b_u].map(|v| [v[0], v[1], v[2]].map(f64::from));
    let (value, u) = (case.a_value[3], case.b_u[3]);
    let cubic = cubic_of_cell(&corners, a, b);
    let ends = monotone_intervals(&cubic);
    let ends = ends.as_slice();
    let extremes = cubic_extremes(&cubic, ends);
    let colors = [case.near, case.far].map(|c| [c[0], c[1], c[2]]);
    let (pair, opacity) = integrate_pair([case.near[3], case.far[3]], colors, 4.0 * u);
    let shaded = shade(lighting, colors[0], Vec3::new(case.low[0], case.low[1], case.low[2]), to_eye(case));
    let knots = tf.knots_in(value, value + u);
    let first = tf.knots.iter().position(|k| knots.first() == Some(k)).unwrap_or(0);
    let mut intervals = [1.0; 4];
    ends.iter().enumerate().for_each(|(i, &e)| intervals[i] = e as f32);
    Outcome {
        cubic: cubic.map(|c| c as f32),
        intervals,
        field: [trilinear(&corners, a), cubic_mean(&cubic), extremes.0, extremes.1].map(|v| v as f32),
        rgba: tf.classify(value),
        light: [tf.variation(value, value + u), absorbance(u), opacity_of(4.0 * u), tf.extinction(u)],
        pair: [pair[0], pair[1], pair[2], opacity],
        shaded: [shaded[0], shaded[1], shaded[2], 0.0],
        search: [
            monotone_root(&cubic, ends[0], ends[1], f64::from(value)).map_or(NO_ROOT, |r| r as f32),
            f32::from(u8::from(tf.is_visible(value, value + u))),
            first as f32,
            knots.len() as f32,
        ],
        counts: [0.0; 4],
    }
}

/// The line along a chord, and that along it and another one behind it.
fn lines(case: &Case) -> [LightLine; 2] {
    let chord = chord_of(case);
    let [x, y, z] = chord.values;
    let behind = LightChord {
        values: [z + 0.1 * (y - x), y, x + 0.1 * (z - x)],
        cubic: 0.05 * case.high[3].powi(4) * case.high[1],
        extent: 2.0 * case.near[0],
        noise: chord.noise,
    };
    [line_of(&chord), line_over(&line_over(&no_line(), &line_of(&chord)), &line_of(&behind))]
}

/// Values inside the table and outside.
fn values_of(case: &Case) -> [f32; 4] {
    case.low.map(|v| 1.2 * v - 0.1)
}

/// A chord within one piece, or across many.
fn chord_of(case: &Case) -> LightChord {
    let (values, spread) = (values_of(case), case.high[3].powi(4));
    LightChord {
        values: [0, 1, 2].map(|i| values[0] * (1.0 - spread) + values[i] * spread),
        cubic: 0.1 * spread * case.high[0],
        extent: 4.0 * case.b_u[3],
        noise: 1e-4 * case.near[3],
    }
}

/// Parts of rays with their light, computed by the Rust functions.
fn light_outcome(case: &Case, light: &PieceTable, lighting: &Lighting) -> LightOutcome {
    let part = integrate_chord(light, &chord_of(case));
    let [_, line] = lines(case);
    let both = integrate_line(light, &line);
    let [of_both_r, of_both_g, of_both_b] = both.color;
    let [low, high] = line.range;
    let LightPart { color: [r, g, blue], transmittance, error, rounding, moments, misplaced, colors } = part;
    let (corners, place) = (corners(case), [case.a_value[0], case.a_value[1], case.a_value[2]]);
    let [least, most] = range_of_corners(&corners);
    let [lit_r, lit_g, lit_b, lit_error] =
        shade_part(lighting, (light, &chord_of(case)), gradients(case), to_eye(case));
    LightOutcome {
        cell: [value_in(&corners, place), twist_of(&corners), least, most],
        channels: channels_at(light, values_of(case)[3]),
        part: [r, g, blue, transmittance],
        moments,
        lit: [lit_r, lit_g, lit_b, colors],
        both: [of_both_r, of_both_g, of_both_b, both.transmittance],
        line: [line.average, line.most, high - low, rounding],
        errors: [error, lit_error, both.error, misplaced],
    }
}

/// Corner by corner.
fn corners(case: &Case) -> [f32; 8] {
    std::array::from_fn(|i| if i < 4 { case.low[i] } else { case.high[i - 4] })
}

/// A direction to the eye.
fn to_eye(case: &Case) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|i| case.a_value[i] - case.b_u[i])).normalize()
}

/// Normals of all directions, some of which turn little, and some gradients too short for a normal; and their cubic coefficient.
fn gradients(case: &Case) -> ([Vec3; 3], Vec3) {
    let [low, high, near] = [case.low, case.high, case.near].map(|v| Vec3::new(v[0], v[1], v[2]) - 0.5);
    let turn = case.far[0] * case.far[0];
    let size = if case.far[1] < 0.1 { 1e-8 } else { 1.0 };
    let cubic = 0.1 * turn * (Vec3::new(case.far[0], case.far[1], case.far[2]) - 0.5);
    ([low, low + turn * high, size * (low + turn * near)], cubic)
}

/// Numbers of Gauss pairs: if the unrounded number is next to an integer, either neighbour is right.
fn check_counts(cases: &[Case], found: &[Outcome], tf: &RenderTransferFunction) {
    const ROUNDING: f32 = 1e-5;
    let between = |found: f32, count: &dyn Fn(f32) -> u32, what: &str| {
        let [least, most] = [1.0 - ROUNDING, 1.0 + ROUNDING].map(|factor| count(factor) as f32);
        assert!(least <= found && found <= most, "{what}: {found}, not {least} to {most}");
        usize::from(least < most)
    };
    let (mut undecided, mut other_pairs) = (0, 0);
    for (case, found) in cases.iter().zip(found) {
        // From nearly nothing to more than the limit of pairs.
        let (change, tau) = (case.near[0] * case.near[0], 8.0 * case.near[1]);
        undecided += between(found.counts[0], &|f| pair_count(f * change, f * tau), "pair_count");
        let (turn, tau) = (2.0 * case.far[0], 8.0 * case.far[1]);
        // For a part of a chord, the variation is rounded as well.
        let u = f64::from(case.b_u[3]);
        let [a, b] = [case.a_value, case.b_u].map(|v| [v[0], v[1], v[2]].map(f64::from));
        let cubic = cubic_of_cell(&corners(case), a, b);
        let expected = pairs_between(tf, &cubic, [0.2 * u, u], 4.0);
        let is_near = (found.counts[2] - expected as f32).abs() <= 1.0 + ROUNDING * expected as f32;
        assert!(is_near, "pairs_between: {}, not {expected}", found.counts[2]);
        other_pairs += usize::from(found.counts[2] != expected as f32);
        undecided += between(found.counts[1], &|f| shaded_pair_count(f * turn, f * tau), "shaded_pair_count");
    }
    println!("counts: {undecided} of {} next to a whole number", 2 * cases.len());
    assert!(other_pairs * 50 < cases.len(), "parts of chords get other pairs: {other_pairs}");
    assert!(undecided * 50 < cases.len(), "rounding decides too often: {undecided}");
    for i in 0..2 {
        let most = PAIR_LIMIT as f32;
        let all = found.iter().map(|f| f.counts[i]);
        assert!(all.clone().any(|n| n == 1.0) && all.clone().any(|n| n == most) && all.clone().any(|n| n == 5.0));
    }
}

fn cases() -> Vec<Case> {
    let mut random = Random::new(SEED);
    println!("seed {SEED}");
    let mut number = |low: f64, high: f64| random.between(low, high) as f32;
    (0..CASES)
        .map(|_| {
            let mut four = |low, high| std::array::from_fn(|_| number(low, high));
            Case {
                low: four(0.0, 1.0),
                high: four(0.0, 1.0),
                a_value: four(0.0, 1.0),
                b_u: four(1e-3, 1.0),
                near: four(0.0, 1.0),
                far: four(0.0, 1.0),
            }
        })
        .collect()
}

#[test]
fn shader_functions_equal_their_twins() {
    let Some(gpu) = gpu() else { return };
    // Narrow highlights, and highlights with a kink.
    [32, 1].into_iter().for_each(|shininess| compare_with_twins(&gpu, shininess));
}

fn compare_with_twins(gpu: &GpuDevice, shininess: u32) {
    let volume = TestVolume::new([9; 3], 16, Geometry::IDENTITY, F32, marschner_lobb(9));
    let lights = r#"[{"direction": [1, 2, 3], "intensity": 0.7}, {"direction": [-1, 0, 1]}]"#;
    let scene = volume.scene(&format!(
        r#"{{"transfer_function": {{"unit_distance": 2, "points": [
            {{"value": 0.1, "color": [0, 0, 1], "alpha": 0}}, {{"value": 0.4, "color": [1, 0, 1], "alpha": 0.3}},
            {{"value": 0.4, "color": [0, 1, 0], "alpha": 0}}, {{"value": 0.6, "color": [0, 1, 1], "alpha": 0}},
            {{"value": 0.9, "color": [1, 1, 0], "alpha": 1}}]}},
            "shading": {{"shininess": {shininess}, "lights": {lights}}}}}"#
    ));
    let tf = RenderTransferFunction::new(&scene.transfer_function, volume.map.shift);
    let light = PieceTable::new(&scene.transfer_function, volume.map.shift, 0.01);
    let shading = scene.shading.as_ref().expect("the scene is shaded");
    let lighting = Lighting::new(shading, &volume.geometry, volume.range.width());
    let grids = [SlotGrid { slots: [1; 3], first: 0 }; 4];
    let places = FeedbackPlaces { grids, slots: 1, entries: 1 };
    let config =
        scene_tables::config(&volume.gpu_volume(), &scene, &tf, &light, EXACTNESS, places).expect("a configuration");
    let tables = scene_tables::tables(&volume.gpu_volume(), &scene).expect("tables");
    let scene = GpuScene { config, tables, view: View::zeroed(), job: Dispatch::zeroed() };
    let (points, index) = (scene_tables::points(&tf), scene_tables::transfer_index(&tf));
    let group_0 = [
        (0, Resource::Storage(bytemuck::bytes_of(&scene))),
        (2, Resource::Table(bytemuck::cast_slice(&points), 4)),
        (3, Resource::Table(&index, 1)),
    ];
    let light_group_0 = [(0, Resource::Storage(bytemuck::bytes_of(&scene))), (4, Resource::Table(&light.words, 4))];
    let cases = cases();
    let found: Vec<Outcome> = run(gpu, shaders::TEST_TWINS, &group_0, &cases);
    check_counts(&cases, &found, &tf);

    let expected: Vec<Outcome> = cases.iter().map(|case| outcome(case, &tf, &lighting)).collect();
    // Roots and turning points are ill-conditioned where the cubic is flat.
    compare(
        [
            ("cubic", 2e-6),
            ("intervals", 2e-3),
            ("field", 2e-6),
            ("rgba", 2e-6),
            ("light", 4e-6),
            ("pair", 4e-6),
            ("shaded", 2e-5),
            ("search", 2e-3),
            ("counts", f64::INFINITY),
        ],
        &bytemuck::pod_collect_to_vec(&found),
        &bytemuck::pod_collect_to_vec(&expected),
    );

    let mut found: Vec<LightOutcome> = run(gpu, shaders::TEST_LIGHT, &light_group_0, &cases);
    let expected: Vec<LightOutcome> = cases.iter().map(|case| light_outcome(case, &light, &lighting)).collect();
    leave_out_next_to_knots(&cases, &light, &mut found, &expected);
    compare(
        [
            ("cell", 2e-6),
            ("channels", 2e-6),
            ("part", 2e-5),
            ("moments", 2e-5),
            ("lit", 2e-5),
            ("both", 2e-5),
            ("line", 2e-6),
            // Beside a step, by the quotient of two small numbers.
            ("errors", 1e-2),
        ],
        &bytemuck::pod_collect_to_vec(&found),
        &bytemuck::pod_collect_to_vec(&expected),
    );
}

/// Numbers jump from piece to piece: if a line ends within rounding of a knot, either piece is right.
fn leave_out_next_to_knots(cases: &[Case], table: &PieceTable, found: &mut [LightOutcome], expected: &[LightOutcome]) {
    const ROUNDING: f32 = 1e-6;
    let knots = &table.pieces.column(Column::Knot, 0)[..table.pieces.count()];
    let is_near = |line: &LightLine| {
        line.range.iter().chain(&line.ends).any(|value| knots.iter().any(|knot| (value - knot).abs() < ROUNDING))
    };
    let mut left_out = 0;
    for (case, (found, expected)) in cases.iter().zip(found.iter_mut().zip(expected)) {
        if lines(case).iter().any(is_near) {
            *found = *expected;
            left_out += 1;
        }
    }
    println!("bounds: {left_out} of {} next to a knot", cases.len());
    assert!(left_out * 100 < cases.len(), "{left_out} of {} next to a knot", cases.len());
}

/// Compares the numbers of each case, by name and tolerance, with the expected ones.
fn compare<const N: usize>(names: [(&str, f64); N], found: &[[[f32; 4]; N]], expected: &[[[f32; 4]; N]]) {
    for (i, (name, tolerance)) in names.into_iter().enumerate() {
        let pairs = found.iter().zip(expected).flat_map(|(f, e)| (0..4).map(move |c| [f[i][c], e[i][c]]));
        let worst = greatest(pairs.map(|[f, e]| f64::from(f) - f64::from(e)));
        println!("{name}: {worst:e}");
        let is_off = |f: &[f32; 4], e: &[f32; 4]| (0..4).any(|c| f64::from((f[c] - e[c]).abs()) > tolerance);
        let cases = (0..).zip(found.iter().zip(expected)).filter(|(_, (f, e))| is_off(&f[i], &e[i]));
        let told: Vec<(usize, [f32; 4], [f32; 4])> = cases.map(|(case, (f, e))| (case, f[i], e[i])).take(4).collect();
        assert!(worst <= tolerance, "{name}: {worst} exceeds {tolerance}: (case, found, expected) {told:?}");
    }
}
