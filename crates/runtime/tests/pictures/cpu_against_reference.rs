//! The CPU ray caster against the reference integrator: every mode, field and regime, with bounds in grey levels.
//!
//! Early ray termination alone may cost 0.0765/255 ([`TERMINATION_OPACITY`]); the bounds leave little room beside it.

#![allow(clippy::print_stderr, reason = "tests show the errors they measure")]

use supervol_format::{Geometry, Lod, VoxelType};
use supervol_runtime::engines::reference::render_reference;
use supervol_runtime::lod::LodChoice;
use supervol_runtime::stream::classify::Skipping;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use crate::support;
use support::{Bricked, Volume, difference, marschner_lobb, noise, points, reference, scene};

const CAMERA: &str = r#""camera": {"eye": [95, -70, 62], "target": [20, 20, 20], "up": [0, 0, 1], "fov_y": 30}"#;
const NEAR: &str = r#""camera": {"eye": [50, -30, 34], "target": [10, 8, 6], "up": [0, 0, 1], "fov_y": 28}"#;
const SMALL: &str = r#""image": {"width": 26, "height": 22}"#;
const SHADED: &str = r#", "shading": {}"#;
/// Grey levels of 255: early termination, and quadrature.
const BOUND: f64 = 0.25;

fn smooth() -> String {
    points(1.0, &[(0.0, [0.1, 0.2, 0.9], 0.0), (0.5, [0.9, 0.8, 0.1], 0.06), (1.0, [0.9, 0.1, 0.1], 0.25)])
}

fn hat() -> String {
    let c = [1.0, 0.7, 0.2];
    points(1.0, &[(0.0, c, 0.0), (0.45, c, 0.0), (0.5, [0.2, 0.7, 1.0], 0.6), (0.55, c, 0.0), (1.0, c, 0.0)])
}

fn step() -> String {
    let (low, high, top) = ([0.2, 0.4, 0.9], [1.0, 0.8, 0.3], [1.0, 0.2, 0.1]);
    points(1.0, &[(0.0, low, 0.01), (0.5, low, 0.01), (0.5, high, 0.7), (1.0, top, 0.9)])
}

/// The same with values from 0 to 255.
fn bytes() -> String {
    points(1.0, &[(0.0, [0.0, 0.1, 0.9], 0.0), (80.0, [0.0, 0.9, 0.2], 0.02), (255.0, [1.0, 0.7, 0.0], 0.3)])
}

fn error(name: &str, volume: &Volume, scene: &ResolvedScene) -> f64 {
    let error = difference(&Bricked::new(volume, 16).render(scene), &reference(volume, scene));
    eprintln!("{name}: {error:.4}/255");
    error
}

fn check(name: &str, volume: &Volume, json: &str, bound: f64) {
    let error = error(name, volume, &scene(volume, json));
    assert!(error <= bound, "{name}: {error}/255, bound {bound}/255");
}

fn dvr(camera: &str, tf: &str, rest: &str) -> String {
    format!(r#"{{{camera}, {SMALL}, "transfer_function": {tf}{rest}}}"#)
}

#[test]
fn dvr_of_marschner_lobb() {
    let volume = Volume::new([41, 41, 41], VoxelType::F32, marschner_lobb(41));
    for (name, tf) in [("smooth", smooth()), ("hat", hat()), ("step", step())] {
        check(&format!("ML {name}"), &volume, &dvr(CAMERA, &tf, ""), BOUND);
        check(&format!("ML {name} shaded"), &volume, &dvr(CAMERA, &tf, SHADED), BOUND);
    }
}

#[test]
fn dvr_of_noise() {
    let volume = Volume::new([20, 17, 13], VoxelType::F32, noise);
    for (name, tf) in [("smooth", smooth()), ("hat", hat()), ("step", step())] {
        check(&format!("noise {name}"), &volume, &dvr(NEAR, &tf, ""), 0.4);
        check(&format!("noise {name} shaded"), &volume, &dvr(NEAR, &tf, SHADED), 0.4);
    }
}

#[test]
fn value_modes() {
    let volume = Volume::new([41, 41, 41], VoxelType::F32, marschner_lobb(41));
    let rough = Volume::new([41, 35, 37], VoxelType::U8, |p| 255.0 * noise(p));
    let holed = rough.clone().with_holes(|[i, j, k]| i == 9 || (j + k) % 13 == 0);
    let holed = Volume { voxel_type: VoxelType::U16, nodata: Some(999.0), ..holed };
    for mode in ["mip", "minip", "mean"] {
        let json = |tf: &str| dvr(CAMERA, tf, &format!(r#", "mode": "{mode}""#));
        check(&format!("ML {mode}"), &volume, &json(&smooth()), 0.01);
        check(&format!("noise u8 {mode}"), &rough, &json(&bytes()), 0.01);
        check(&format!("noise u16 with holes {mode}"), &holed, &json(&bytes()), 0.01);
    }
}

/// At silhouettes of surfaces the picture jumps, and `f32` and `f64` may disagree. Pixels at which the reference itself
/// changes when the eye moves by a ten-thousandth of a voxel are not judged; they must be few.
#[test]
fn iso_surfaces() {
    let volume = Volume::new([41, 41, 41], VoxelType::F32, marschner_lobb(41));
    let surfaces = r#", "mode": "iso", "iso": [{"value": 0.5, "color": [0.9, 0.7, 0.4], "alpha": 0.5},
        {"value": 0.55, "color": [0.3, 0.7, 0.9], "alpha": 0.7}, {"value": 0.2, "color": [1, 1, 1]}]"#;
    for shading in [r#", "shading": null"#, SHADED] {
        let s = scene(&volume, &dvr(CAMERA, &smooth(), &format!("{surfaces}{shading}")));
        let exact = reference(&volume, &s);
        let cast = Bricked::new(&volume, 16).render(&s);
        let is_stable =
            |i: usize, other: &Image| (0..4).all(|c| (other.pixels[i][c] - exact.pixels[i][c]).abs() < 0.01);
        let moved: Vec<Image> = [(1e-4, 0.0), (-1e-4, 0.0), (0.0, 1e-4), (0.0, -1e-4)]
            .map(|(x, y)| {
                let mut moved = s.clone();
                moved.camera.eye += x * s.camera.right + y * s.camera.up;
                reference(&volume, &moved)
            })
            .into();
        assert!(moved.iter().all(Image::is_finite), "the reference holds what is no number");
        let stable: Vec<bool> = (0..exact.pixels.len()).map(|i| moved.iter().all(|m| is_stable(i, m))).collect();
        let worst = cast.distance_where(&exact, |i| stable[i]);
        let left_out = stable.iter().filter(|stable| !**stable).count();
        eprintln!("ML iso {shading}: {worst:.4}/255, {left_out} of {} pixels not judged", exact.pixels.len());
        assert!(worst < 0.1 && left_out * 100 < exact.pixels.len());
    }
}

/// S37.
#[test]
fn degenerate_grids() {
    for dims in [[1, 1, 9], [9, 1, 1], [1, 1, 1], [2, 2, 2], [17, 17, 17], [31, 67, 5]] {
        let volume = Volume::new(dims, VoxelType::F32, noise);
        let centre: [f64; 3] = dims.map(|n| (n as f64 - 1.0) / 2.0);
        let eye: [f64; 3] = std::array::from_fn(|a| centre[a] + [1.1, -2.3, 0.9][a] * dims[2].max(dims[1]) as f64);
        let camera = format!(r#""camera": {{"eye": {eye:?}, "target": {centre:?}, "up": [0, 0, 1], "fov_y": 40}}"#);
        check(&format!("{dims:?}"), &volume, &dvr(&camera, &smooth(), ""), BOUND);
        check(&format!("{dims:?} shaded"), &volume, &dvr(&camera, &hat(), SHADED), BOUND);
    }
}

/// S25: the eye at the centre, exactly on a brick's corner, and on the bounds.
#[test]
fn the_eye_may_be_inside() {
    let volume = Volume::new([31, 67, 41], VoxelType::F32, marschner_lobb(41));
    for eye in [[15.0, 33.0, 20.0], [15.5, 15.5, 15.5], [-0.5, 33.0, 20.0], [16.0, 33.25, 15.5]] {
        let camera =
            format!(r#""camera": {{"eye": {eye:?}, "target": [40, 38, 20.5], "up": [0, 0, 1], "fov_y": 100}}"#);
        check(&format!("eye {eye:?}"), &volume, &dvr(&camera, &smooth(), SHADED), BOUND);
    }
}

/// S24: rays along the axes, on voxel planes and macro-cell faces, with components 0, -0 and 1e-30.
#[test]
fn axis_parallel_rays() {
    let volume = Volume::new([20, 19, 17], VoxelType::F32, noise).with_holes(|[_, j, k]| j == 9 || k == 12);
    let axes =
        [([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]), ([0.0, -1.0, 0.0], [0.0, 0.0, 1.0]), ([1.0, 0.0, -0.0], [0.0, 0.0, 1.0])];
    for ((forward, up), tilt) in axes.into_iter().zip([0.0, -0.0, 1e-30]) {
        for sign in [1.0, -1.0] {
            let eye = [8.0, 8.0, 8.0];
            let target: [f64; 3] = std::array::from_fn(|a| eye[a] + sign * forward[a] + tilt);
            // 16 pixels over 16 voxels, rays through the middle of even pixels: every ray lies on a plane of voxels or
            // on a face.
            for height in [16.0, 8.0] {
                let camera =
                    format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": {up:?}, "height": {height}}}"#);
                let json = format!(
                    r#"{{{camera}, "image": {{"width": 17, "height": 16}}, "transfer_function": {}, "shading": {{}}}}"#,
                    smooth()
                );
                check(&format!("axis {forward:?} {sign} {height}"), &volume, &json, BOUND);
            }
        }
    }
}

/// S38: single voxels, slabs, whole bricks.
#[test]
fn holes() {
    type IsHole = fn([usize; 3]) -> bool;
    let fields: [(&str, IsHole); 4] = [
        ("voxel", |p| p == [7, 8, 6]),
        ("slab", |p| (9..11).contains(&p[0])),
        ("brick", |p| p[0] >= 16),
        ("all", |_| true),
    ];
    for (name, is_hole) in fields {
        let volume = Volume::new([20, 17, 13], VoxelType::F32, noise).with_holes(is_hole);
        check(&format!("hole {name}"), &volume, &dvr(NEAR, &smooth(), SHADED), 0.4);
        let bytes_volume = Volume::new([20, 17, 13], VoxelType::U8, |p| 250.0 * noise(p)).with_holes(is_hole);
        let nodata = Volume { nodata: Some(255.0), ..bytes_volume };
        check(&format!("nodata {name}"), &nodata, &dvr(NEAR, &bytes(), SHADED), 0.4);
    }
}

/// S36, S07: spacing, rotation, shear; clip box and planes; orthographic.
#[test]
fn geometry_and_clipping() {
    let direction = [0.8, -0.6, 0.1, 0.6, 0.8, 0.0, 0.0, 0.2, 1.0];
    let volume = Volume::new([25, 31, 17], VoxelType::F32, marschner_lobb(31)).with_geometry(
        [2.5, 1.25, 0.4],
        [1000.0, -500.0, 10.0],
        direction,
    );
    let target = volume.geometry.world_from_index().transform_point3([12.0, 15.0, 8.0].into()).to_array();
    let eye = [target[0] + 80.0, target[1] - 110.0, target[2] + 60.0];
    let clip = format!(
        r#", "clip": {{"box": [[2.25, -3, 1], [99, 28.5, 15.5]],
            "planes": [{{"normal": [1, 0.3, -0.2], "offset": {}}}]}}"#,
        target[0] + 0.3 * target[1] - 0.2 * target[2] - 8.0
    );
    for lens in [r#""fov_y": 35"#, r#""height": 70"#] {
        let camera = format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0, 0, 1], {lens}}}"#);
        for rest in ["", &clip] {
            check(
                &format!("affine {lens} {}", rest.len()),
                &volume,
                &dvr(&camera, &smooth(), &format!("{SHADED}{rest}")),
                BOUND,
            );
        }
    }
}

/// A coarser level is the reference picture of the coarser volume.
#[test]
fn levels_of_detail() {
    let volume = Volume::new([32, 48, 40], VoxelType::F32, marschner_lobb(41));
    let scene = scene(&volume, &dvr(CAMERA, &smooth(), SHADED));
    let bricked = Bricked::new(&volume, 16);
    let (cast, _) = bricked.render_with(&scene, LodChoice::Fixed(Lod(1)), Skipping::On);
    let coarse = volume.coarser([2, 2, 2]);
    let mut exact = coarse.reference();
    // The threshold of shading is the finest level's; the spacing affects nothing else.
    exact.value_range = volume.range();
    let error = difference(&cast, &render_reference(&exact, &scene));
    eprintln!("LOD 1: {error:.4}/255");
    assert!(error < BOUND);
    let near = bricked.render_with(&scene, LodChoice::Auto { voxel_pixels: 0.01 }, Skipping::On).0;
    assert_eq!(near, bricked.render(&scene));
    let far = bricked.render_with(&scene, LodChoice::Auto { voxel_pixels: 1e6 }, Skipping::On).0;
    assert_eq!(far, bricked.render_with(&scene, LodChoice::Fixed(Lod(60)), Skipping::On).0);
    assert_eq!(Geometry::IDENTITY, bricked.geometry);
}
