#![allow(clippy::print_stdout, reason = "measured errors are printed")]
//! The arithmetic of rays walking through bricks against its Rust twins, on random numbers with a fixed seed.

use bytemuck::{Pod, Zeroable};
use glam::{Mat3, Vec3};
use supervol_format::Geometry;
use supervol_format::random::Random;
use supervol_runtime::engines::cells::cell::{cubic_of_cell, monotone_intervals, trilinear};
use supervol_runtime::engines::cells::shade::Lighting;
use supervol_runtime::engines::gpu::cache::slot_at;
use supervol_runtime::engines::gpu::layout::{Dispatch, FLAG_ABSENT, FLAG_SURFACES, Scene as GpuScene, SlotGrid, View};
use supervol_runtime::engines::gpu::piece_table::PieceTable;
use supervol_runtime::engines::gpu::rays::RayGrid;
use supervol_runtime::engines::gpu::scene_tables::{Exactness, FeedbackPlaces, slot_edge};
use supervol_runtime::engines::gpu::texels::VoxelStorage;
use supervol_runtime::engines::gpu::twins::{
    PartVerdict, ValueSide, all_surfaces, bytes_of_square, cell_at, corners_of_stored, cubic_of_gradient, first_change,
    gradient_at, halves_of_pair, is_absent, light_cell, light_ray, macro_cell_at, macro_place, meets_surfaces,
    next_size, normal_at, range_of_corners, rebase, segment_end, shaded_pairs, sides_at, sides_of, value_at, value_in,
    values_of, world_direction,
};
use supervol_runtime::engines::gpu::{scene_tables, shaders};
use supervol_runtime::stream::classify::Skipping;
use supervol_scene::image::greatest;
use supervol_scene::transfer_function::RenderTransferFunction;

use crate::gpu_support;
use gpu_support::compute::{Resource, run};
use gpu_support::{TestVolume, U8, gpu, marschner_lobb};

const SEED: u64 = 20_261_124;
const CASES: usize = 4096;
const CORE: u32 = 32;
const ISOS: [f32; 3] = [0.3, 0.5, 0.7];
/// The stored number that means absent.
const ABSENT: u32 = 7;
/// A power of two.
const STRIDE: f32 = 8.0;
/// Textures of 12, 24 and 6 slots.
const GRIDS: [SlotGrid; 4] = [
    SlotGrid { slots: [3, 2, 2], first: 0 },
    SlotGrid { slots: [4, 3, 2], first: 12 },
    SlotGrid { slots: [1, 2, 3], first: 36 },
    SlotGrid { slots: [1; 3], first: u32::MAX },
];
const WIDTH: u32 = 100;
const FIRST_ROW: u32 = 40;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Case {
    low: [f32; 4],
    high: [f32; 4],
    a_value: [f32; 4],
    b_u: [f32; 4],
    texel: [u32; 4],
    slot: u32,
    padding: u32,
    place: [u32; 2],
    place_in_row: u32,
    padding_1: [u32; 3],
    macro_cell: [u32; 3],
    ray: u32,
    sides: u32,
    crossed: u32,
    present: u32,
    strides: u32,
}

/// Output of `test_slots.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
struct Marks {
    slot: [u32; 4],
    square: [u32; 4],
    pair: [u32; 4],
    surfaces: [u32; 4],
    marks: [u32; 4],
    along: [f32; 4],
}

/// Output of `test_walk.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Found {
    /// Checked by [`check_counts`].
    counts: [u32; 4],
    values: [f32; 4],
    inverse: [f32; 4],
    offset: [f32; 4],
    cell: [f32; 4],
    macro_cell: [f32; 4],
    field: [f32; 4],
    stored: [f32; 4],
    gradient: [f32; 4],
    cubic: [f32; 4],
    normal: [f32; 4],
    direction: [f32; 4],
}

fn cases() -> Vec<Case> {
    let mut random = Random::new(SEED);
    println!("seed {SEED}");
    let mut case = || {
        let mut four = || std::array::from_fn(|_| random.between(1e-3, 1.0) as f32);
        let (low, high, a_value, b_u) = (four(), four(), four(), four());
        let mut below = |n: u32| (random.unit() * f64::from(n)) as u32;
        Case {
            low,
            high,
            a_value,
            b_u,
            texel: std::array::from_fn(|_| below(1 << 16) << 16 | below(1 << 16)),
            slot: below(42),
            padding: 0,
            place: [below(3), below(3)],
            place_in_row: below(7),
            padding_1: [0; 3],
            macro_cell: std::array::from_fn(|_| below(CORE / 8)),
            ray: below(40_000),
            sides: below(8),
            crossed: below(8),
            present: below(2),
            strides: below(1 << 20),
        }
    };
    (0..CASES).map(|_| case()).collect()
}

/// Input of the shader beside the cases.
struct Setting {
    scene: GpuScene,
    lighting: Lighting,
}

/// Places and marks by the Rust functions: integers, or exact numbers.
fn marks(case: &Case) -> Marks {
    let texels = VoxelStorage::U8.texels([slot_edge_of_core(); 3]);
    let (texture, [x, y, z]) = slot_at(&GRIDS, texels, case.slot);
    let [first, second] = halves_of_pair(case.texel, case.place_in_row);
    let [px, py] = RayGrid { width: WIDTH, height: 4000 }.pixel(u64::from(case.ray));
    let (_, range) = field_of(case);
    let meets = meets_surfaces(&ISOS, range, (case.present != 0).then_some(case.sides), case.crossed);
    let place = macro_place(case.slot, CORE, case.macro_cell);
    let (strides, t) = rebase(STRIDE, case.strides, 3.5 * STRIDE * case.b_u[3]);
    let end = segment_end(STRIDE, case.strides, case.strides + case.place[0], case.a_value[3]);
    Marks {
        slot: [texture as u32, x, y, z],
        square: bytes_of_square(case.texel, case.place),
        pair: [first, second, px, FIRST_ROW + py],
        surfaces: [sides_of(&ISOS, case.a_value[3]), all_surfaces(&ISOS), u32::from(meets), place],
        marks: [is_absent(case.texel.map(|word| word & 0xff), ABSENT), strides, 0, 0],
        along: [end, t, 0.0, 0.0],
    }
}

/// Cells and values along the ray, by the Rust functions.
fn expected(case: &Case, setting: &Setting) -> Found {
    let Setting { scene: GpuScene { config, .. }, lighting } = setting;
    let (value, u) = (case.a_value[3], case.b_u[3]);
    // A power of two, because the adapter decides whether products are rounded before an addition.
    let (origin, along) = ([0, 1, 2].map(|a| 32.0 * case.a_value[a] - 1.0), [0, 1, 2].map(|a| case.b_u[a] - 0.5));
    let direction = [0, 1, 2].map(|a| if a as u32 == case.ray % 4 { 0.0 } else { along[a] });
    let (inverse, offset, margin) = light_ray(origin, direction);
    let verdict = if case.low[2] > 0.5 { PartVerdict::Taken } else { PartVerdict::Refused };
    let next = next_size(case.low[0], 20.0 * case.low[1] * case.low[1], verdict);
    let (cubic, range) = field_of(case);
    let intervals = monotone_intervals(&cubic);
    let before = if case.present == 0 { ValueSide::Below } else { ValueSide::AtOrAbove };
    let change = first_change(&cubic, intervals.as_slice(), f64::from(value), before).unwrap_or(2.0);
    let gradient = gradient_of(case, lighting, u);
    let [near, far] = [0, 8].map(|shift| case.texel.map(|word| word >> shift & 0xff));
    let a = [case.a_value[0], case.a_value[1], case.a_value[2]];
    let in_values = trilinear(&corners_of_stored(config, near, far), a.map(f64::from)) as f32;
    let with = |v: [f32; 3], w: f32| [v[0], v[1], v[2], w];
    Found {
        counts: [0; 4],
        values: values_of(config, near),
        inverse: with(inverse, margin),
        offset: with(offset, 1.0 + u),
        cell: with(cell_at(CORE, origin, direction, 40.0 * u), next),
        macro_cell: with(macro_cell_at(origin, direction, 40.0 * u), 0.0),
        field: [range[0], range[1], value_at(&cubic, range, f64::from(u)) as f32, change as f32],
        stored: [value_in(&light_cell(config, near, far), a), in_values, 0.0, 0.0],
        gradient: with(gradient.to_array(), 0.0),
        cubic: with(cubic_of_case(case, lighting).to_array(), 0.0),
        normal: with(normal_at(gradient).to_array(), 0.0),
        direction: with(world_direction(Mat3::IDENTITY, Vec3::from_array(along)).to_array(), 0.0),
    }
}

/// The greatest value of the corners of a cell of stored numbers, at least 1.
fn greatest_value(case: &Case, Setting { scene: GpuScene { config, .. }, .. }: &Setting) -> f32 {
    let values = [0, 8].map(|shift| values_of(config, case.texel.map(|word| word >> shift & 0xff)));
    values.into_iter().flatten().fold(1.0, |most, value| most.max(value.abs()))
}

/// The field along the chord in the cell, and the range of its corners.
fn field_of(case: &Case) -> ([f64; 4], [f32; 2]) {
    let corners: [f32; 8] = std::array::from_fn(|i| if i < 4 { case.low[i] } else { case.high[i - 4] });
    let [a, b] = [case.a_value, case.b_u].map(|v| [v[0], v[1], v[2]].map(f64::from));
    (cubic_of_cell(&corners, a, b), range_of_corners(&corners))
}

fn slot_edge_of_core() -> u32 {
    slot_edge(&gpu_support::pyramid([41; 3], CORE))
}

fn gradient_of(case: &Case, lighting: &Lighting, u: f32) -> Vec3 {
    let scale = Vec3::new(case.low[0], case.low[1], case.low[2]);
    gradient_at(lighting.world_from_level_gradient([1; 3]), &[case.low, case.high, case.a_value], scale, u)
}

fn cubic_of_case(case: &Case, lighting: &Lighting) -> Vec3 {
    let scale = Vec3::new(case.low[0], case.low[1], case.low[2]);
    cubic_of_gradient(lighting.world_from_level_gradient([1; 3]), &[case.low, case.high, case.a_value], scale)
}

fn setting() -> Setting {
    let volume = TestVolume::new([41; 3], CORE, Geometry::IDENTITY, U8, marschner_lobb(41));
    let scene = volume.scene(
        r#"{"image": {"width": 100, "height": 80}, "transfer_function": {"unit_distance": 2, "points": [
            {"value": 0.1, "color": [0, 0, 1], "alpha": 0}, {"value": 0.9, "color": [1, 1, 0], "alpha": 0.5}]},
            "shading": {}}"#,
    );
    let tf = RenderTransferFunction::new(&scene.transfer_function, volume.map.shift);
    let light = PieceTable::new(&scene.transfer_function, volume.map.shift, 0.01);
    let shading = scene.shading.as_ref().expect("the scene is shaded");
    let lighting = Lighting::new(shading, &volume.geometry, volume.range.width());
    let exactness = Exactness { skipping: Skipping::On, max_error: 0.5 / 255.0, sums_errors: false };
    let places = FeedbackPlaces { grids: GRIDS, slots: 42, entries: 1 };
    let mut config =
        scene_tables::config(&volume.gpu_volume(), &scene, &tf, &light, exactness, places).expect("a configuration");
    config.flags |= FLAG_ABSENT | FLAG_SURFACES;
    config.absent = ABSENT;
    config.stride = STRIDE;
    config.iso_count = ISOS.len() as u32;
    let mut tables = scene_tables::tables(&volume.gpu_volume(), &scene).expect("tables");
    tables.isos.iter_mut().zip(ISOS).for_each(|(iso, value)| iso.value = value);
    let tiles_x = RayGrid { width: WIDTH, height: 1 }.tiles()[0];
    let view = View { tiles_x, first_row: FIRST_ROW, ..View::zeroed() };
    Setting { scene: GpuScene { config, tables, view, job: Dispatch::zeroed() }, lighting }
}

#[test]
fn places_and_marks_equal_their_twins() {
    let Some(gpu) = gpu() else { return };
    let setting = setting();
    let group_0 = [(0, Resource::Storage(bytemuck::bytes_of(&setting.scene)))];
    let cases = cases();
    let found: Vec<Marks> = run(&gpu, shaders::TEST_SLOTS, &group_0, &cases);
    for (case, found) in cases.iter().zip(&found) {
        assert_eq!(*found, marks(case));
    }
}

#[test]
fn rays_on_their_way_equal_their_twins() {
    let Some(gpu) = gpu() else { return };
    let setting = setting();
    let group_0 = [(0, Resource::Storage(bytemuck::bytes_of(&setting.scene)))];
    let cases = cases();
    let found: Vec<Found> = run(&gpu, shaders::TEST_WALK, &group_0, &cases);
    let mut worst = [0.0f64; 10];
    let (mut at_a_face, mut at_a_root) = (0, 0);
    for (case, found) in cases.iter().zip(&found) {
        let expected = expected(case, &setting);
        check_counts(case, found, &setting);
        // Rounding may move a position on a face to either side of it, and find or lose a root where the field only
        // touches a value.
        let is_elsewhere = found.cell[..3] != expected.cell[..3] || found.macro_cell != expected.macro_cell;
        at_a_face += usize::from(is_elsewhere);
        at_a_root += usize::from((found.field[3] - expected.field[3]).abs() > 2e-3);
        let without_change = |[low, high, value, _]: [f32; 4]| [low, high, value, 0.0];
        let pairs = [
            (found.values, expected.values, 1e-4),
            (found.inverse, expected.inverse, 1e-6),
            (found.offset, expected.offset, 1e-6),
            ([found.cell[3]; 4], [expected.cell[3]; 4], 1e-6),
            (without_change(found.field), without_change(expected.field), 2e-6),
            (found.stored, expected.stored, 1e-5),
            (found.gradient, expected.gradient, 2e-5),
            (found.cubic, expected.cubic, 2e-5),
            (found.normal, expected.normal, 2e-5),
            (found.direction, expected.direction, 1e-6),
        ];
        for (i, (f, e, tolerance)) in pairs.into_iter().enumerate() {
            // Interpolated numbers are as exact as the greatest of their inputs.
            let least = if i == 5 { greatest_value(case, &setting) } else { 1.0 };
            let off = f.iter().zip(e).map(|(f, e)| f64::from((f - e).abs() / e.abs().max(least)) / tolerance);
            let off = greatest(off);
            if off > 1.0 {
                println!("number {i} of ray {}: {f:?}, not {e:?}", case.ray);
            }
            worst[i] = worst[i].max(off);
        }
    }
    println!("shares of what is tolerated: {worst:?}; {at_a_face} at a face, {at_a_root} at a root");
    assert!(worst.iter().all(|&share| share <= 1.0), "shares of what is tolerated: {worst:?}");
    assert!(at_a_face * 500 < CASES && at_a_root * 200 < CASES, "{at_a_face} at a face, {at_a_root} at a root");
}

/// Sides and numbers of pairs, up to rounding.
fn check_counts(case: &Case, found: &Found, setting: &Setting) {
    let u = case.b_u[3];
    let (cubic, range) = field_of(case);
    let [low, high] = [4e-6, -4e-6].map(|off| sides_at(&ISOS.map(|iso| iso + off), &cubic, range, f64::from(u)));
    let [sides, pairs, ..] = found.counts;
    assert!(low & !sides == 0 && sides & !high == 0, "sides {sides}, not {low} to {high}");
    let normal = |u: f32| normal_at(gradient_of(case, &setting.lighting, u));
    let [fewest, most] = [0.999, 1.001].map(|share| shaded_pairs(normal, [0.2 * u, u], share * case.a_value[3]));
    assert!(fewest <= pairs + 1 && pairs <= most + 1, "{pairs} pairs, not {fewest} to {most}");
}
