#![allow(clippy::print_stdout, reason = "measured errors are printed")]
//! GPU pictures against the reference integrator and against the CPU ray caster.

use supervol_format::{BrickIndex, BrickKey, Geometry, Lod};
use supervol_runtime::engines::gpu::caster::{GpuRenderer, Insertion, KnownAnswers, PageEntry};
use supervol_runtime::engines::gpu::device::GpuDevice;
use supervol_runtime::engines::gpu::options::GpuOptions;
use supervol_runtime::engines::gpu::shaders::TexelAccess;
use supervol_runtime::lod::LodChoice;
use supervol_runtime::stream::classify::Skipping;

use crate::gpu_support;
use gpu_support::{F32, I16, Storage, TestVolume, U8, greatest_difference, marschner_lobb, noise, shared_gpu};

const FINEST: LodChoice = LodChoice::Fixed(Lod::FINEST);
/// Half a grey level.
const TOLERANCE: f64 = 0.5;
const SMOOTH: &str = r#""transfer_function": {"unit_distance": 4.0, "points": [
    {"value": 0.0, "color": [0.1, 0.2, 0.9], "alpha": 0.0},
    {"value": 0.35, "color": [0.2, 0.9, 0.3], "alpha": 0.05},
    {"value": 0.7, "color": [0.9, 0.6, 0.1], "alpha": 0.4},
    {"value": 1.0, "color": [1.0, 0.1, 0.1], "alpha": 0.8}]}"#;
const STEPS: &str = r#""transfer_function": {"unit_distance": 1.0, "points": [
    {"value": 0.0, "color": [0.2, 0.4, 0.9], "alpha": 0.01}, {"value": 0.5, "color": [0.2, 0.4, 0.9], "alpha": 0.01},
    {"value": 0.5, "color": [1.0, 0.8, 0.3], "alpha": 0.7}, {"value": 1.0, "color": [1.0, 0.2, 0.1], "alpha": 0.9}]}"#;
const CAMERA: &str =
    r#""camera": {"eye": [75.0, 55.0, 95.0], "target": [20.0, 20.0, 20.0], "up": [0, 1, 0], "fov_y": 30.0}"#;

fn scene(camera: &str, rest: &str) -> String {
    format!(r#"{{{camera}, "image": {{"width": 64, "height": 48}}, {SMOOTH}{rest}}}"#)
}

fn ml(core: u32, storage: Storage) -> TestVolume {
    TestVolume::new([41; 3], core, Geometry::IDENTITY, storage, marschner_lobb(41))
}

const MODES: [(&str, &str); 7] = [
    ("dvr", r#", "mode": "dvr""#),
    ("dvr shaded", r#", "mode": "dvr", "shading": {}"#),
    ("mip", r#", "mode": "mip""#),
    ("minip", r#", "mode": "minip""#),
    ("mean", r#", "mode": "mean""#),
    (
        "iso",
        r#", "mode": "iso", "shading": null, "iso": [{"value": 0.5, "color": [0.9, 0.8, 0.2], "alpha": 0.5},
                                     {"value": 0.7, "color": [0.1, 0.8, 0.9]}]"#,
    ),
    ("iso shaded", r#", "mode": "iso", "shading": {}, "iso": [{"value": 0.5, "color": [0.9, 0.8, 0.2]}]"#),
];

#[test]
fn every_mode_equals_the_reference() {
    let Some(gpu) = shared_gpu() else { return };
    let volume = ml(16, F32);
    for (mode, rest) in MODES {
        let scene = volume
            .scene(&scene(CAMERA, rest).replace("\"width\": 64, \"height\": 48", "\"width\": 40, \"height\": 30"));
        let expected = volume.reference_image(&scene);
        let (image, stats) = volume.gpu_image(&gpu, &scene, FINEST, 64, Skipping::On);
        let error = greatest_difference(&image, &expected);
        let cpu = greatest_difference(&volume.cpu_image(&scene, FINEST), &expected);
        println!(
            "{mode}: {error:.4}/255 (cpu {cpu:.4}), {} passes, {:.0} ms",
            stats.counters.passes, stats.counters.pass_ms
        );
        assert!(error <= TOLERANCE, "{mode}: {error}/255");
    }
}

/// Compares with the CPU's picture of the same bricks; both backends use the same rules, so only rounding may differ.
fn check(gpu: &GpuDevice, name: &str, volume: &TestVolume, scene: &str, lod: LodChoice, slots: u64) {
    let scene = volume.scene(scene);
    let expected = volume.cpu_image(&scene, lod);
    let covered = expected.pixels.iter().filter(|p| p[3] > 0.0).count();
    assert!(covered > 10, "{name}: only {covered} pixels show anything");
    for skipping in [Skipping::On, Skipping::Off] {
        let (image, stats) = volume.gpu_image(gpu, &scene, lod, slots, skipping);
        let error = greatest_difference(&image, &expected);
        println!(
            "{name}, skipping {skipping:?}: {error:.4}/255, {} slots, {} passes",
            stats.slots, stats.counters.passes
        );
        assert!(error <= TOLERANCE, "{name}, skipping {skipping:?}: {error}/255, {stats:?}");
    }
}

/// S21, S44: slots, order of arrival and skipping do not change the picture.
#[test]
fn few_slots_draw_the_same_picture() {
    let Some(gpu) = shared_gpu() else { return };
    let volume = ml(16, U8);
    for (mode, rest) in MODES {
        for slots in [2, 5, 16] {
            if slots != 2 || matches!(mode, "dvr shaded" | "iso") {
                check(&gpu, &format!("{mode}, {slots} slots"), &volume, &scene(CAMERA, rest), FINEST, slots);
            }
        }
    }
}

#[test]
fn noise_of_every_storage_and_brick_size() {
    let Some(gpu) = shared_gpu() else { return };
    for (core, storage) in [(16, U8), (32, I16), (64, F32)] {
        let volume = TestVolume::new([37, 35, 33], core, Geometry::IDENTITY, storage, noise);
        for (mode, rest) in MODES {
            check(&gpu, &format!("noise, core {core}, {mode}"), &volume, &scene(CAMERA, rest), FINEST, 64);
        }
    }
}

/// Sheets two voxels thick, one in each macro cell: all macro cells are visible, and half of their blocks.
#[test]
fn rays_leap_over_blocks_that_show_nothing() {
    let Some(gpu) = shared_gpu() else { return };
    let sheets = |[_, _, z]: [usize; 3]| if (1..3).contains(&(z % 8)) { 0.9 } else { 0.1 };
    let look = r#""transfer_function": {"unit_distance": 4.0, "points": [
        {"value": 0.5, "color": [0.1, 0.2, 0.9], "alpha": 0.0}, {"value": 0.9, "color": [0.9, 0.9, 0.3], "alpha": 0.2}]}"#;
    for (core, storage) in [(16, U8), (32, I16), (64, F32)] {
        let volume = TestVolume::new([64; 3], core, Geometry::IDENTITY, storage, sheets);
        let camera = CAMERA.replace("[20.0, 20.0, 20.0]", "[32.0, 32.0, 32.0]");
        let json = format!(r#"{{{camera}, "image": {{"width": 64, "height": 48}}, {look}}}"#);
        check(&gpu, &format!("sheets, core {core}"), &volume, &json, FINEST, 64);
        let scene = volume.scene(&json);
        let cells = [Skipping::On, Skipping::Off].map(|skipping| {
            let memory_bytes = volume.memory_for(&gpu, &scene, FINEST, 64);
            let options = GpuOptions { memory_bytes, skipping, ..GpuOptions::default() };
            let mut renderer = GpuRenderer::new(&gpu, &volume.gpu_volume(), &scene, FINEST, options, None).unwrap();
            for brick in volume.bricks.values().filter(|brick| brick.key.lod() == Lod::FINEST) {
                assert_eq!(renderer.insert(brick).unwrap(), Insertion::Placed { evicted: None });
            }
            let feedback = renderer.cast_pass().unwrap();
            assert!(feedback.is_converged());
            feedback.counters.cells
        });
        println!("sheets, core {core}: {} of {} cells", cells[0], cells[1]);
        assert!(4 * cells[0] < 3 * cells[1], "core {core}: {} of {} cells", cells[0], cells[1]);
    }
}

/// Software adapters read storage textures, others sampled ones: the texels are the same.
#[test]
fn textures_are_read_alike_either_way() {
    let Some(gpu) = shared_gpu() else { return };
    for (core, storage) in [(16, U8), (32, I16), (64, F32)] {
        let volume = TestVolume::new([37, 35, 33], core, Geometry::IDENTITY, storage, noise);
        for (mode, rest) in MODES.into_iter().filter(|(mode, _)| mode.starts_with("dvr") || *mode == "mip") {
            let scene = volume.scene(&scene(CAMERA, rest));
            let [stored, sampled] = [TexelAccess::Stored, TexelAccess::Sampled].map(|texels| {
                let gpu = gpu.clone().with_texels(texels);
                volume.gpu_image(&gpu, &scene, FINEST, 64, Skipping::On).0
            });
            assert!(stored == sampled, "core {core}, {mode}: {:.1e}", greatest_difference(&stored, &sampled));
            assert!(stored.pixels.iter().any(|pixel| pixel[3] > 0.1), "core {core}, {mode}: nothing shows");
        }
    }
}

/// A card casts all rays at once, has no scouts, and its shaders read other textures: the picture is the same.
#[test]
fn work_for_a_card_makes_the_same_picture() {
    let Some(gpu) = shared_gpu() else { return };
    let card = gpu.clone().dealt_as_card();
    let volume = ml(16, U8);
    for (mode, rest) in MODES {
        // High enough that some rows of tiles are scouts on software adapters.
        let json = scene(CAMERA, rest).replace(r#""height": 48"#, r#""height": 136"#);
        let [own, as_card] = [&gpu, &card].map(|gpu| {
            let (image, stats) = volume.gpu_image(gpu, &volume.scene(&json), FINEST, 20, Skipping::On);
            (image, stats.counters)
        });
        let [many, few] = [own.1.dispatches, as_card.1.dispatches];
        assert!(!gpu.is_software() || few < many, "{mode}: {few} dispatches for a card, {many} for a software adapter");
        assert!(own.0 == as_card.0, "{mode}: {:.1e} apart", greatest_difference(&own.0, &as_card.0));
    }
}

#[test]
fn cameras_inside_and_along_the_axes() {
    let Some(gpu) = shared_gpu() else { return };
    let volume = ml(16, F32);
    let inside = r#""camera": {"eye": [20.3, 18.1, 22.7], "target": [0, 5, 3], "up": [0, 0, 1], "fov_y": 70.0}"#;
    // Rays run exactly along voxel planes, and exactly along brick and macro-cell faces.
    let on_voxels = r#""camera": {"eye": [20.0, 20.0, 90], "target": [20.0, 20.0, 0], "up": [0, 1, 0], "height": 48}"#;
    let on_faces = r#""camera": {"eye": [-9, 23.5, 23.5], "target": [20, 23.5, 23.5], "up": [0, 1, 0], "height": 24}"#;
    let diagonal = r#""camera": {"eye": [-30, -30, -30], "target": [20, 20, 20], "up": [0, 1, 0], "height": 50}"#;
    for (name, camera) in [("inside", inside), ("voxels", on_voxels), ("faces", on_faces), ("diagonal", diagonal)] {
        for (mode, rest) in MODES {
            check(&gpu, &format!("{name}, {mode}"), &volume, &scene(camera, rest), FINEST, 64);
        }
    }
}

#[test]
fn holes_uniform_absent_and_failed_bricks() {
    let Some(gpu) = shared_gpu() else { return };
    for storage in [F32, I16] {
        let mut volume = TestVolume::new([41; 3], 16, Geometry::IDENTITY, storage, |voxel| {
            let [x, y, z] = voxel;
            if (x + 2 * y + 3 * z) % 97 == 0 || (x > 28 && y < 9) {
                f64::NAN
            } else if x > 13 && x < 35 && y > 13 && y < 35 && z > 13 && z < 35 {
                0.6
            } else {
                marschner_lobb(41)(voxel)
            }
        });
        let key = |lod, brick| BrickKey::new(Lod(lod), BrickIndex(brick));
        volume.states.insert(key(0, [1, 1, 1]), PageEntry::Uniform(volume.map.from_data(0.6)));
        volume.states.insert(key(0, [0, 0, 0]), PageEntry::Nothing);
        volume.states.insert(key(0, [2, 2, 0]), PageEntry::Failed);
        volume.states.insert(key(0, [0, 2, 2]), PageEntry::Failed);
        volume.states.insert(key(1, [0, 1, 1]), PageEntry::Failed);
        for (mode, rest) in MODES {
            let name = format!("holes in {}, {mode}", storage.voxel_type);
            check(&gpu, &name, &volume, &scene(CAMERA, rest), FINEST, 8);
        }
    }
}

/// Clipped on a plane of voxels behind which all is absent: cells in front of it that exist only by rounding are not
/// visible.
#[test]
fn nothing_is_seen_of_what_is_cut_off_beside_holes() {
    let Some(gpu) = shared_gpu() else { return };
    for axis in 0..3 {
        let volume = TestVolume::new([41; 3], 16, Geometry::IDENTITY, F32, |voxel| {
            if voxel[axis] >= 12 { f64::NAN } else { noise(voxel) }
        });
        let mut low = [-1.0; 3];
        low[axis] = 11.0;
        for mode in ["mip", "minip", "mean"] {
            let tf = r#""transfer_function": {"points": [{"value": 0, "color": [1, 1, 1], "alpha": 1}]}"#;
            let rest = format!(r#""mode": "{mode}", "clip": {{"box": [{low:?}, [99, 99, 99]]}}"#);
            let scene = format!(r#"{{{CAMERA}, "image": {{"width": 64, "height": 48}}, {tf}, {rest}}}"#);
            let scene = volume.scene(&scene);
            let (image, _) = volume.gpu_image(&gpu, &scene, FINEST, 64, Skipping::On);
            let seen = image.pixels.iter().filter(|p| p[3] > 0.0).count();
            assert_eq!(seen, 0, "axis {axis}, {mode}: pixels with something");
        }
    }
}

/// A surface on a plane of voxels is met there, and nowhere else on the chords on either side, whichever way they
/// round.
#[test]
fn surfaces_in_planes_of_voxels_are_lit_where_they_are() {
    let Some(gpu) = shared_gpu() else { return };
    let field = |[x, y, z]: [usize; 3]| {
        let [x, y, z] = [x, y, z].map(|n| n as f64);
        72.0 + (14.0 - z) * (4.0 + 2.0 * (1.3 * y + 0.4 * x).sin())
    };
    let volume = TestVolume::new([30, 40, 28], 16, Geometry::IDENTITY, F32, field);
    let iso = r#", "mode": "iso", "shading": {}, "iso": [{"value": 72, "color": [1, 1, 1]}]"#;
    let camera = r#""camera": {"eye": [5, 30, -60], "target": [15, 20, 14], "up": [0, 1, 0], "fov_y": 12}"#;
    let scene = volume.scene(&scene(camera, iso));
    let expected = volume.reference_image(&scene);
    assert!(expected.pixels.iter().all(|p| p[3] == 1.0), "every ray sees the surface");
    let (image, _) = volume.gpu_image(&gpu, &scene, FINEST, 64, Skipping::On);
    let error = greatest_difference(&image, &expected);
    assert!(error <= TOLERANCE, "{error}/255");
}

#[test]
fn levels_of_detail_geometry_clipping_and_subgrid() {
    let Some(gpu) = shared_gpu() else { return };
    let geometry = Geometry {
        spacing: [0.5, 2.0, 1.0],
        origin: [6.5e6, -300.0, 12.0],
        direction: [0.6, -0.8, 0.0, 0.8, 0.6, 0.0, 0.0, 0.0, 1.0],
    };
    let volume = TestVolume::new([70, 41, 50], 16, geometry, I16, marschner_lobb(41));
    let [x, y, z] = geometry.world_from_index().transform_point3(glam::DVec3::new(35.0, 20.0, 25.0)).to_array();
    let camera = format!(
        r#""camera": {{"eye": [{}, {}, {}], "target": [{x}, {y}, {z}], "up": [0, 0, 1], "fov_y": 40.0}}"#,
        x + 60.0,
        y - 70.0,
        z + 50.0
    );
    let clip = format!(
        r#", "clip": {{"box": [[3.2, 1, -5], [66, 37.7, 44]], "planes": [{{"normal": [1, 1, 0.5], "offset": {}}}]}}"#,
        x + y + 0.5 * z - 20.0
    );
    for lod in
        [FINEST, LodChoice::Fixed(Lod(1)), LodChoice::Auto { voxel_pixels: 1.0 }, LodChoice::Auto { voxel_pixels: 2.5 }]
    {
        for (mode, rest) in MODES {
            let rest = format!("{rest}{clip}, \"samples_per_pixel\": 4");
            let scene = scene(&camera, &rest).replace("\"width\": 64, \"height\": 48", "\"width\": 29, \"height\": 23");
            check(&gpu, &format!("{lod:?}, {mode}"), &volume, &scene, lod, 20);
        }
    }
}

/// The requested error decides how finely cells are cut, and is kept; also in a renderer that continues.
#[test]
fn the_error_asked_for_steers_the_shader() {
    let Some(gpu) = shared_gpu() else { return };
    for (name, transfer_function) in [("smooth", SMOOTH), ("steps", STEPS)] {
        let samples = samples_by_error(&gpu, &scene(CAMERA, "").replace(SMOOTH, transfer_function));
        println!("{name}: {samples:?}");
        assert!(samples.is_sorted() && 3 * samples[3] > 4 * samples[0], "{name}: {samples:?}");
    }
}

/// Number of look-ups of the transfer function for 16, 2, 0.5 and 0.1 grey levels; each error is kept.
fn samples_by_error(gpu: &GpuDevice, scene: &str) -> Vec<u64> {
    let volume = TestVolume::new([37, 35, 33], 16, Geometry::IDENTITY, F32, noise);
    let scene = volume.scene(scene);
    let expected = volume.reference_image(&scene);
    let mut samples = Vec::new();
    let options = GpuOptions { max_error: 16.0 / 255.0, ..GpuOptions::default() };
    let mut renderer = GpuRenderer::new(gpu, &volume.gpu_volume(), &scene, FINEST, options, None).expect("a renderer");
    volume.bricks.values().for_each(|brick| assert!(matches!(renderer.insert(brick), Ok(Insertion::Placed { .. }))));
    for levels in [16.0, 2.0, 0.5, 0.1] {
        renderer.set_max_error(levels / 255.0);
        assert!(renderer.set_scene(&volume.gpu_volume(), &scene, FINEST, KnownAnswers::Keep).expect("a scene"));
        let feedback = renderer.cast_pass().expect("a pass");
        assert!(feedback.is_converged());
        let error = greatest_difference(&renderer.image().expect("an image"), &expected);
        println!("{levels}: {error:.4}/255, {} samples", feedback.counters.samples);
        assert!(error <= levels, "{error} of {levels}");
        samples.push(feedback.counters.samples);
    }
    samples
}

/// Steps and narrow peaks: if a ray grazes one, an error e of the value moves the crossing by the square root of e.
#[test]
fn steep_transfer_functions() {
    let Some(gpu) = shared_gpu() else { return };
    let volume = ml(16, F32);
    let peak = r#""transfer_function": {"unit_distance": 1.0, "points": [
        {"value": 0.49, "color": [1.0, 0.7, 0.2], "alpha": 0.0}, {"value": 0.5, "color": [0.2, 0.7, 1.0], "alpha": 0.9},
        {"value": 0.51, "color": [1.0, 0.7, 0.2], "alpha": 0.0}]}"#;
    let far = r#""camera": {"eye": [75000, 55000, 95000], "target": [20, 20, 20], "up": [0, 1, 0], "height": 60}"#;
    for (name, tf) in [("step", STEPS), ("peak", peak)] {
        for camera in [CAMERA, far] {
            for (mode, rest) in &MODES[..2] {
                let scene = scene(camera, rest).replace(SMOOTH, tf);
                check(&gpu, &format!("{name}, {mode}"), &volume, &scene, FINEST, 64);
            }
        }
    }
}
