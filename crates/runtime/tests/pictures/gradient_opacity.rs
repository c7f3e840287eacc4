//! Opacity by the gradient, against closed forms and against the reference.

#![allow(clippy::print_stdout, reason = "measured errors are printed")]

use supervol_format::{Lod, VoxelType};
use supervol_runtime::engines::rules::DEFAULT_ERROR;
use supervol_runtime::lod::LodChoice;
use supervol_runtime::render::error::RenderError;
use supervol_runtime::render::options::{Backend, RenderOptions};
use supervol_runtime::render::renderer::render;
use supervol_runtime::stream::classify::Skipping;
use supervol_scene::image::GREY_LEVELS;

use crate::{containers, support};
use containers::{container_bytes, open};
use support::{Bricked, Volume, difference, marschner_lobb, noise, points, reference, scene};

const FINEST: LodChoice = LodChoice::Fixed(Lod::FINEST);
/// The same in grey levels.
const DEFAULT_LEVELS: f64 = GREY_LEVELS * DEFAULT_ERROR;
/// Error of the reference, with the rounding of its pixels.
const REFERENCE_ERROR: f64 = 1.1e-5;

/// The greatest opacity of a small picture of a box of the volume, by the reference and by the CPU. Orthographic, along x.
#[track_caller]
fn opacities(volume: &Volume, [low, high]: [[f64; 3]; 2], alpha: f64, ends: [f64; 2]) -> [f64; 2] {
    let world = |p: [f64; 3]| volume.geometry.world_from_index().transform_point3(p.into());
    let middle = world(std::array::from_fn(|a| 0.5 * (low[a] + high[a])));
    let along = volume.geometry.linear() * glam::DVec3::X;
    let up = volume.geometry.linear() * glam::DVec3::Z;
    let (eye, target) = ((middle - 90.0 * along.normalize()).to_array(), middle.to_array());
    let json = format!(
        r#"{{"camera": {{"eye": {eye:?}, "target": {target:?}, "up": {:?}, "height": 0.01}},
            "image": {{"width": 2, "height": 2}}, "gradient_opacity": {ends:?},
            "clip": {{"box": [{low:?}, {high:?}]}}, "transfer_function": {}}}"#,
        up.to_array(),
        points(1.0, &[(0.0, [0.25, 0.5, 1.0], alpha)])
    );
    let scene = scene(volume, &json);
    let cast = Bricked::new(volume, 16).render(&scene);
    [reference(volume, &scene), cast].map(|image| {
        let [first, ..] = image.pixels[..] else { panic!("an empty picture") };
        assert!(image.pixels.iter().all(|pixel| (pixel[3] - first[3]).abs() < 1e-4), "{:?}", image.pixels);
        // Colours are constant: each is its share of the opacity.
        for (channel, share) in [0.25, 0.5, 1.0].into_iter().enumerate() {
            assert!((first[channel] - share * first[3]).abs() < 3e-4, "{first:?}");
        }
        f64::from(first[3])
    })
}

#[track_caller]
fn check([by_reference, by_cpu]: [f64; 2], expected: f64) {
    assert!((by_reference - expected).abs() < REFERENCE_ERROR, "reference: {by_reference} instead of {expected}");
    assert!((by_cpu - expected).abs() < DEFAULT_ERROR, "cpu: {by_cpu} instead of {expected}");
}

/// The gradient of a ramp has one length, by the spacing of each axis.
#[test]
fn a_ramp_on_stretched_grids() {
    let turned = [0.0, 0.6, -0.8, 1.0, 0.0, 0.0, 0.0, 0.8, 0.6];
    let [a, b, c] = [0.5, 3.0, -4.0];
    let length = (0.5f64.powi(2) + 1.5f64.powi(2) + 0.8f64.powi(2)).sqrt();
    for direction in [[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], turned] {
        let ramp = Volume::new([24, 9, 9], VoxelType::F32, |p| a * p[0] + b * p[1] + c * p[2]);
        let ramp = ramp.with_geometry([1.0, 2.0, 5.0], [100.0, -7.0, 3.0], direction);
        let whole = [[1.5, 3.1, 3.2], [21.5, 5.2, 5.3]];
        for (ends, factor) in [
            ([0.0, 2.0 * length], 0.5),
            ([0.5 * length, 2.5 * length], 0.25),
            ([0.3 * length, 0.99 * length], 1.0),
            ([1.01 * length, 9.0], 0.0),
        ] {
            check(opacities(&ramp, whole, 0.05, ends), 1.0 - 0.95f64.powf(20.0 * factor));
        }
    }
}

/// Central differences of sampled squares are 2 x at voxels, and linear between them.
#[test]
fn a_parabola_whose_gradient_grows_along_the_ray() {
    let squares = Volume::new([34, 5, 5], VoxelType::F32, |p| p[0] * p[0]);
    let (from, to, alpha) = (13.0, 41.0, 0.1f64);
    // The factor is 0 up to x = 6.5, and 1 from x = 20.5 on.
    let gathered = 0.5 * 14.0 + (30.25 - 20.5);
    check(
        opacities(&squares, [[2.0, 1.2, 1.2], [30.25, 3.1, 3.1]], alpha, [from, to]),
        1.0 - (1.0 - alpha).powf(gathered),
    );
    // The same on voxels three times as long: the gradient is a third, and the way three times as long.
    let long = squares.with_geometry([3.0, 1.0, 1.0], [0.0; 3], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let found = opacities(&long, [[2.0, 1.2, 1.2], [30.25, 3.1, 3.1]], alpha, [from / 3.0, to / 3.0]);
    check(found, 1.0 - (1.0 - alpha).powf(3.0 * gathered));
}

/// Beside an absent voxel, the gradient is unknown and counts as none.
#[test]
fn beside_holes_nothing_shows() {
    let ramp = Volume::new([20, 5, 5], VoxelType::F32, |p| p[0]).with_holes(|p| p[0] == 10);
    let found = opacities(&ramp, [[1.5, 1.2, 1.2], [18.0, 3.1, 3.1]], 0.1, [0.0, 0.5]);
    // Absent from 9 to 11; no gradient at voxels 9 and 11, thus from 8 to 12.
    check(found, 1.0 - 0.9f64.powf(6.5 + 6.0));
}

pub const LIGHT: &str = r#""shading": {"ambient": 0.2, "diffuse": 0.8, "specular": 0.6, "shininess": 24,
    "lights": [{"direction": [1, 0.4, -0.6]}, {"direction": [-0.3, 1, 0.2], "intensity": 0.6}]}"#;

pub fn looks() -> [String; 3] {
    let (a, b) = ([0.2, 0.4, 1.0], [1.0, 0.9, 0.1]);
    let steps =
        [(0.0, a, 0.0), (0.3, a, 0.0), (0.3, b, 0.6), (0.5, b, 0.1), (0.5, a, 0.0), (0.8, a, 1.0), (1.0, b, 1.0)];
    [
        points(1.0, &[(0.0, a, 0.02), (1.0, b, 0.05)]),
        points(0.7, &[(0.0, a, 0.0), (0.3, b, 0.5), (0.6, [1.0, 0.1, 0.1], 0.2), (1.0, b, 0.95)]),
        points(1.0, &steps),
    ]
}

/// Fields with edges, noise, holes and even parts, in several types.
pub fn volumes() -> Vec<(&'static str, Volume, f64)> {
    let ball = |p: [f64; 3]| {
        let r = p.iter().map(|x| (x - 10.0).powi(2)).sum::<f64>().sqrt();
        (7.0 - r).clamp(0.0, 1.0)
    };
    let bytes = |field: Box<dyn Fn([f64; 3]) -> f64>| move |p| 255.0 * field(p);
    let turned = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    vec![
        ("ball", Volume::new([21; 3], VoxelType::F32, ball), 1.0),
        ("ball of bytes", Volume::new([21; 3], VoxelType::U8, bytes(Box::new(ball))), 255.0),
        ("noise", Volume::new([13; 3], VoxelType::F32, noise), 1.0),
        ("waves", Volume::new([21; 3], VoxelType::F32, marschner_lobb(21)), 1.0),
        (
            "stretched waves",
            Volume::new([21; 3], VoxelType::F32, marschner_lobb(21)).with_geometry([1.0, 0.5, 2.0], [3.0; 3], turned),
            1.0,
        ),
        (
            "holes",
            Volume::new([17; 3], VoxelType::F32, marschner_lobb(17)).with_holes(|p| p.iter().sum::<usize>() % 13 == 0),
            1.0,
        ),
    ]
}

/// The transfer function of values from 0 to 1 for values that are larger.
pub fn scaled(look: &str, factor: f64) -> String {
    let mut look: serde_json::Value = serde_json::from_str(look).unwrap();
    for point in look["points"].as_array_mut().unwrap() {
        point["value"] = (point["value"].as_f64().unwrap() * factor).into();
    }
    look.to_string()
}

pub fn seen(volume: &Volume, lens: &str) -> String {
    let middle = volume.dims.map(|n| 0.5 * (n as f64 - 1.0));
    let target = volume.geometry.world_from_index().transform_point3(middle.into());
    let eye = (target + 2.5 * middle[0] * glam::DVec3::new(0.9, -1.1, 0.7)).to_array();
    format!(
        r#""camera": {{"eye": {eye:?}, "target": {:?}, "up": [0.1, 0.2, 1], {lens}}}, "image": {{"width": 20, "height": 16}}"#,
        target.to_array()
    )
}

#[test]
fn the_cpu_stays_within_the_error() {
    for (name, volume, size) in volumes() {
        let bricked = Bricked::new(&volume, 16);
        for (i, look) in looks().into_iter().enumerate() {
            for (light, ends) in
                [("null", [0.0, 0.4]), (LIGHT, [0.05, 0.2]), (LIGHT, [0.3, 0.300_01])].map(|(light, ends)| {
                    (if light == "null" { r#""shading": null"# } else { light }, ends.map(|end: f64| end * size))
                })
            {
                let json = format!(
                    r#"{{{}, {light}, "gradient_opacity": {ends:?}, "transfer_function": {}}}"#,
                    seen(&volume, r#""fov_y": 30"#),
                    scaled(&look, size)
                );
                let scene = scene(&volume, &json);
                let off = difference(&bricked.render(&scene), &reference(&volume, &scene));
                println!("{name}, look {i}, {ends:?}: {off:.4}/255");
                assert!(off <= DEFAULT_LEVELS, "{name}, look {i}, {ends:?}: {off} in\n{json}");
            }
        }
    }
}

/// Cells are left out because they show nothing: the picture is the same to the last bit without skipping.
#[test]
fn skipping_and_bricks_change_nothing_that_shows() {
    let (_, volume, _) = volumes().swap_remove(0);
    let json = format!(
        r#"{{{}, {LIGHT}, "gradient_opacity": [0.05, 0.3], "transfer_function": {}}}"#,
        seen(&volume, r#""height": 24"#),
        looks()[1]
    );
    let scene = scene(&volume, &json);
    let bricked = Bricked::new(&volume, 16);
    let (skipped, work) = bricked.render_with(&scene, FINEST, Skipping::On);
    let (walked, all) = bricked.render_with(&scene, FINEST, Skipping::Off);
    assert_eq!(skipped, walked);
    assert!(work.cells == all.cells && work.cells > 0, "{} of {} cells", work.cells, all.cells);
    let larger = Bricked::new(&volume, 32).render(&scene);
    assert!(difference(&skipped, &larger) <= DEFAULT_LEVELS);
}

/// Without a ramp that bends, and with all gradients beyond it, the picture is that of the plain extinction.
#[test]
fn steep_gradients_show_all() {
    let ramp = Volume::new([20, 12, 12], VoxelType::F32, |p| 0.05 * p[0]);
    let json = |more: &str| {
        format!(
            r#"{{{}, {LIGHT}{more}, "transfer_function": {}, "clip": {{"box": [[1, 1, 1], [18, 10, 10]]}}}}"#,
            seen(&ramp, r#""fov_y": 30"#),
            looks()[1]
        )
    };
    let [plain, by_gradient] = ["", r#", "gradient_opacity": [0.01, 0.049]"#].map(|more| scene(&ramp, &json(more)));
    let bricked = Bricked::new(&ramp, 16);
    assert!(difference(&bricked.render(&plain), &bricked.render(&by_gradient)) <= DEFAULT_LEVELS);
    assert!(
        difference(&reference(&ramp, &plain), &reference(&ramp, &by_gradient)) <= 2.0 * GREY_LEVELS * REFERENCE_ERROR
    );
}

#[test]
fn a_device_refuses_it_and_auto_takes_the_processor() {
    let (_, volume, _) = volumes().swap_remove(0);
    let container = open(&container_bytes(&volume, 16));
    let json = format!(
        r#"{{{}, "gradient_opacity": [0, 1], "transfer_function": {}}}"#,
        seen(&volume, r#""fov_y": 30"#),
        looks()[0]
    );
    let scene = scene(&volume, &json);
    let by = |backend: Backend| {
        render(&container, &scene, &RenderOptions { backend, threads: Some(1), ..RenderOptions::default() })
    };
    assert!(matches!(by(Backend::Gpu), Err(RenderError::GradientsOnGpu)));
    let (_, stats) = by(Backend::Auto).unwrap();
    assert_eq!(stats.backend, "cpu");
}
