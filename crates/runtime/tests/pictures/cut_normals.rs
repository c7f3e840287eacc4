//! Light by the normals of cuts, against closed forms and against the reference.

#![allow(clippy::print_stdout, reason = "measured errors are printed")]

use std::sync::Arc;

use glam::DVec3;
use supervol_format::{Container, Lod, VoxelType};
use supervol_runtime::engines::rules::DEFAULT_ERROR;
use supervol_runtime::lod::LodChoice;
use supervol_runtime::render::error::RenderError;
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::{render, render_with_errors};
use supervol_runtime::stream::classify::Skipping;
use supervol_scene::image::GREY_LEVELS;
use supervol_scene::scene::{ResolvedScene, Scene};

use crate::gradient_opacity::{LIGHT, looks, scaled, seen, volumes};
use crate::{containers, support};
use containers::{container_bytes, open};
use support::{Bricked, Volume, difference, noise, points, reference, scene};

const FINEST: LodChoice = LodChoice::Fixed(Lod::FINEST);
/// The default error in grey levels.
const DEFAULT_LEVELS: f64 = GREY_LEVELS * DEFAULT_ERROR;
/// Error of the reference, with the rounding of its pixels.
const REFERENCE_ERROR: f64 = 1.1e-5;
const COLOR: [f64; 3] = [0.5, 0.3, 0.9];
/// Direction of the rays of closed forms.
const ALONG: [f64; 3] = [1.0, 0.4, -0.3];
const DIMS: [usize; 3] = [24; 3];

/// The colour by a normal: two lights as in [`LIGHT`], written out.
fn lit(normal: DVec3, along: DVec3) -> [f64; 3] {
    let normal = normal.normalize();
    let (mut diffuse, mut specular) = (0.2, 0.0);
    for (travels, intensity) in [([1.0, 0.4, -0.6], 1.0), ([-0.3, 1.0, 0.2], 0.6)] {
        let to_light = -DVec3::from(travels).normalize();
        let half = (to_light - along).normalize();
        diffuse += 0.8 * normal.dot(to_light).abs() * intensity;
        specular += 0.6 * normal.dot(half).abs().powf(24.0) * intensity;
    }
    COLOR.map(|c| (c * diffuse + specular).min(1.0))
}

/// Share of the light that comes by the face's normal: the integral of `k exp(-k t) w(t)`, with the weight w 1 up to the first
/// depth, and linear from there to 0 at the second.
fn share_of_face(kappa: f64, [full, none]: [f64; 2]) -> f64 {
    1.0 - ((-kappa * full).exp() - (-kappa * none).exp()) / (kappa * (none - full))
}

fn ramp_of(gradient: DVec3, volume: &Volume) -> Volume {
    let world = volume.geometry.world_from_index();
    let ramp = Volume::new(volume.dims, VoxelType::F32, |p| gradient.dot(world.transform_point3(p.into())));
    Volume { geometry: volume.geometry, ..ramp }
}

fn scene_along(volume: &Volume, (through, along): (DVec3, DVec3), alpha: f64, more: &str) -> ResolvedScene {
    let (eye, target) = ((through - 90.0 * along).to_array(), through.to_array());
    let json = format!(
        r#"{{"camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0.1, 0.2, 1], "height": 0.00001}},
            "image": {{"width": 2, "height": 2}}, {LIGHT}, {more}, "transfer_function": {}}}"#,
        points(1.0, &[(0.0, COLOR, alpha)])
    );
    scene(volume, &json)
}

/// Checks the pixels along a ray by the reference and by the CPU, on bricks and in a container, against the sum over these colours,
/// each with the share of the opacity behind it that it takes.
#[track_caller]
fn check(volume: &Volume, scene: &ResolvedScene, name: &str, expected: impl Fn(f64) -> [f64; 3]) {
    let container = open(&container_bytes(volume, 16));
    let by_container = draw(&container, scene, RenderOptions::default());
    let by_cpu = Bricked::new(volume, 16).render(scene);
    for (engine, image, allowed) in [
        ("reference", reference(volume, scene), REFERENCE_ERROR),
        ("cpu", by_cpu, DEFAULT_ERROR),
        ("container", by_container, DEFAULT_ERROR),
    ] {
        let [r, g, b, alpha] = image.pixels[0].map(f64::from);
        assert!(alpha > 0.1, "{name}, {engine}: nothing shows");
        for (found, expected) in [r, g, b].into_iter().zip(expected(alpha)) {
            let off = (found - expected).abs();
            assert!(off <= allowed, "{name}, {engine}: {found} instead of {expected}");
        }
    }
}

fn draw(container: &Arc<Container>, scene: &ResolvedScene, options: RenderOptions) -> supervol_scene::image::Image {
    let options = RenderOptions { backend: Backend::Cpu, threads: Some(2), ..options };
    render(container, scene, &RenderOptions { level: LevelChoice::Fixed(Lod::FINEST), ..options }).unwrap().0
}

/// Point at which a ray through `through` enters a sphere, or leaves it.
fn on_sphere(center: DVec3, radius: f64, (through, along): (DVec3, DVec3), side: f64) -> DVec3 {
    let from = through - center;
    let half = (from.dot(along).powi(2) - from.length_squared() + radius * radius).sqrt();
    through + (side * half - from.dot(along)) * along
}

/// A ramp has one gradient, so that a pixel has two colours: by the cut's normal, and by the ramp's.
#[test]
fn each_cut_lights_its_face_and_fades_into_the_gradient() {
    let gradient = DVec3::new(0.31, -0.17, 0.42);
    let (through, along) = (DVec3::splat(11.7), DVec3::from(ALONG).normalize());
    let volume = ramp_of(gradient, &Volume::new(DIMS, VoxelType::F32, |_| 0.0));
    let center = DVec3::new(12.0, 11.0, 12.5);
    let entry = on_sphere(center, 8.0, (through, along), -1.0);
    let exit = on_sphere(DVec3::new(1.0, 8.0, 14.0), 7.0, (through, along), 1.0);
    let axis = DVec3::Z;
    let around = on_sphere(DVec3::new(12.0, 11.0, 0.0), 7.0, (through * (DVec3::ONE - axis), flat(along)), -1.0);
    // Clipped away at the ends of the volume, where differences are halved.
    let inner = r#""box": [[-0.5, 1, 1], [22, 22, 22]]"#;
    let cases = [
        ("box", r#""box": [[5.25, 1, 1], [22, 22, 22]]"#.to_owned(), DVec3::X),
        ("plane", format!(r#""planes": [{{"normal": [2, 1, 0], "offset": 20}}], {inner}"#), DVec3::new(2.0, 1.0, 0.0)),
        (
            "later plane",
            format!(
                r#""planes": [{{"normal": [1, 0, 0], "offset": 4}}, {{"normal": [1, 1, 1], "offset": 30}}], {inner}"#
            ),
            DVec3::ONE,
        ),
        (
            "inside of a sphere",
            format!(r#""solids": [{{"sphere": {{"center": {:?}, "radius": 8}}}}]"#, center.to_array()),
            entry - center,
        ),
        (
            "outside of a sphere",
            format!(r#""solids": [{{"keep": "outside", "sphere": {{"center": [1, 8, 14], "radius": 7}}}}], {inner}"#),
            exit - DVec3::new(1.0, 8.0, 14.0),
        ),
        (
            "cylinder",
            r#""solids": [{"cylinder": {"from": [12, 11, 1], "to": [12, 11, 22], "radius": 7}}]"#.to_owned(),
            around - DVec3::new(12.0, 11.0, 0.0),
        ),
        (
            "end of a cylinder",
            r#""solids": [{"cylinder": {"from": [6, 11, 12], "to": [22, 11, 12], "radius": 9}}]"#.to_owned(),
            DVec3::X,
        ),
        (
            "turned box",
            r#""solids": [{"box": {"center": [12, 11, 12], "edges": [10, 30, 30],
                "axes": [[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]]}}], "box": [[-0.5, 1, 1], [22, 22, 22]]"#
                .to_owned(),
            DVec3::new(0.8, 0.6, 0.0),
        ),
    ];
    for (name, clip, normal) in cases {
        for alpha in [0.03f64, 0.4] {
            let share = share_of_face(-(1.0 - alpha).ln(), [2.0, 4.0]);
            let by = |cut_normals: bool| {
                let more = format!(r#""cut_normals": {cut_normals}, "clip": {{{clip}}}"#);
                scene_along(&volume, (through, along), alpha, &more)
            };
            let (of_face, of_gradient) = (lit(normal, along), lit(gradient, along));
            let mixed = |opacity: f64| [0, 1, 2].map(|c| share * of_face[c] + (opacity - share) * of_gradient[c]);
            check(&volume, &by(true), name, mixed);
            check(&volume, &by(false), name, |opacity| of_gradient.map(|c| c * opacity));
        }
    }
}

fn flat(along: DVec3) -> DVec3 {
    (along * DVec3::new(1.0, 1.0, 0.0)).normalize()
}

/// Lengths behind a face are by the smallest spacing; the normal of the clip box is across its plane of voxels.
#[test]
fn grids_may_be_stretched_and_sheared() {
    let gradient = DVec3::new(0.3, 0.1, -0.2);
    let direction = [0.8, -0.6, 0.1, 0.6, 0.8, 0.3, -0.2, 0.2, 1.0];
    let empty = Volume::new(DIMS, VoxelType::F32, |_| 0.0).with_geometry([1.0, 0.5, 2.0], [5.0, 3.0, -8.0], direction);
    let volume = ramp_of(gradient, &empty);
    let linear = volume.geometry.linear();
    let through = volume.geometry.world_from_index().transform_point3(DVec3::splat(11.6));
    let along = (linear * DVec3::new(0.2, 1.0, 0.1)).normalize();
    let clip = r#""clip": {"box": [[1, 4.5, 1], [22, 22, 22]]}"#;
    let scene = scene_along(&volume, (through, along), 0.4, &format!(r#""cut_normals": true, {clip}"#));
    let share = share_of_face(-(0.6f64).ln(), [1.0, 2.0]);
    let across = linear.col(0).cross(linear.col(2));
    let (of_face, of_gradient) = (lit(across, along), lit(gradient, along));
    check(&volume, &scene, "sheared", |opacity| {
        [0, 1, 2].map(|c| share * of_face[c] + (opacity - share) * of_gradient[c])
    });
}

/// Without a gradient the light fades into the colour itself. Such bricks have a single value.
#[test]
fn even_matter_is_lit_at_its_faces_alone() {
    let even = Volume::new(DIMS, VoxelType::F32, |_| 3.0);
    let (through, along) = (DVec3::splat(11.7), DVec3::from(ALONG).normalize());
    let clip = r#""clip": {"box": [[6.25, 1, 1], [22, 22, 22]]}"#;
    for alpha in [0.05f64, 0.5] {
        let scene = scene_along(&even, (through, along), alpha, &format!(r#""cut_normals": true, {clip}"#));
        let share = share_of_face(-(1.0 - alpha).ln(), [2.0, 4.0]);
        let of_face = lit(DVec3::X, along);
        check(&even, &scene, "even", |opacity| [0, 1, 2].map(|c| share * of_face[c] + (opacity - share) * COLOR[c]));
    }
}

/// A ray that leaves a hole enters again at a face of its own; the volume's end and the eye are none.
#[test]
fn each_part_of_a_ray_has_its_own_face() {
    let gradient = DVec3::new(0.31, -0.17, 0.42);
    let volume = ramp_of(gradient, &Volume::new([34, 24, 24], VoxelType::F32, |_| 0.0));
    let (through, along, alpha) = (DVec3::new(16.2, 11.0, 12.0), DVec3::X, 0.05f64);
    let kappa = -(1.0 - alpha).ln();
    // From -0.5 to 10.2, and from 22.2 to 32; the first voxel is left out by a plane that is a face.
    let clip = r#""clip": {"solids": [{"keep": "outside", "sphere": {"center": [16.2, 11, 12], "radius": 6}}],
        "planes": [{"normal": [1, 0, 0], "offset": 1}, {"normal": [-1, 0, 0], "offset": -32}]}"#;
    let scene = scene_along(&volume, (through, along), alpha, &format!(r#""cut_normals": true, {clip}"#));
    let (of_face, of_gradient) = (lit(DVec3::X, along), lit(gradient, along));
    let share = share_of_face(kappa, [2.0, 4.0]);
    let passed = (-kappa * 9.2).exp();
    check(&volume, &scene, "hole", |opacity| {
        let of_faces = share * (1.0 + passed);
        [0, 1, 2].map(|c| of_faces * of_face[c] + (opacity - of_faces) * of_gradient[c])
    });
    // An eye between the hole and the face in front of it sees no face before the hole.
    let json = format!(
        r#"{{"camera": {{"eye": [3, 11, 12], "target": [16.2, 11, 12], "up": [0, 0, 1], "fov_y": 0.001}},
            "image": {{"width": 2, "height": 2}}, {LIGHT}, "cut_normals": true, {clip}, "transfer_function": {}}}"#,
        points(1.0, &[(0.0, COLOR, alpha)])
    );
    let passed = (-kappa * 7.2).exp();
    check(&volume, &support::scene(&volume, &json), "eye", |opacity| {
        let of_face_behind = share * passed;
        [0, 1, 2].map(|c| of_face_behind * of_face[c] + (opacity - of_face_behind) * of_gradient[c])
    });
}

/// A cut through opaque noise has one colour; by the gradient, each pixel has another.
#[test]
fn a_face_of_noise_is_even() {
    let noisy = Volume::new(DIMS, VoxelType::F32, noise);
    let picture = |cut_normals: bool| {
        let json = format!(
            r#"{{"camera": {{"eye": [70, 30, -10], "target": [12, 12, 12], "up": [0, 0, 1], "height": 9}},
                "image": {{"width": 20, "height": 20}}, {LIGHT}, "cut_normals": {cut_normals},
                "clip": {{"planes": [{{"normal": [-1, 0, 0], "offset": -12}}]}}, "transfer_function": {}}}"#,
            points(1.0, &[(0.0, COLOR, 1.0)])
        );
        let scene = scene(&noisy, &json);
        let along = scene.camera.ray(0, 0).direction;
        (Bricked::new(&noisy, 16).render(&scene), lit(DVec3::X, along))
    };
    let (even, expected) = picture(true);
    for pixel in &even.pixels {
        for (found, expected) in pixel.iter().zip(expected) {
            assert!((f64::from(*found) - expected).abs() < DEFAULT_ERROR, "{pixel:?} instead of {expected}");
        }
    }
    let (uneven, _) = picture(false);
    let mean = uneven.pixels.iter().map(|pixel| pixel[0]).sum::<f32>() / 400.0;
    let spread = uneven.pixels.iter().map(|pixel| (pixel[0] - mean).powi(2)).sum::<f32>() / 400.0;
    assert!(255.0 * spread.sqrt() > 8.0, "{}", spread.sqrt());
}

/// Cuts of all kinds, for volumes of about 20 voxels.
const CLIPS: [&str; 4] = [
    r#""box": [[3.3, -0.5, 4.2], [99, 12.6, 99]]"#,
    r#""planes": [{"normal": [-0.9, 1.1, -0.7], "offset": -8}, {"normal": [-1, 0.2, 0.1], "offset": -11}]"#,
    r#""solids": [{"keep": "outside", "sphere": {"center": [16, 5, 14], "radius": 8}}]"#,
    r#""box": [[-0.5, 1.5, -0.5], [17, 99, 99]], "solids": [{"cylinder": {"from": [4, 12, 6], "to": [18, 3, 16], "radius": 7}},
        {"keep": "outside", "box": {"center": [11, 8, 11], "edges": [4, 5, 3], "axes": [[0.8, 0.6, 0], [-0.6, 0.8, 0], [0, 0, 1]]}}]"#,
];

#[test]
fn the_cpu_stays_within_the_error() {
    for (n, (name, volume, size)) in volumes().into_iter().enumerate() {
        let bricked = Bricked::new(&volume, 16);
        for (i, look) in looks().into_iter().enumerate() {
            for (j, more) in ["", r#", "gradient_opacity": [0.05, 0.2]"#].into_iter().enumerate() {
                let clip = CLIPS[(n + i + j) % CLIPS.len()];
                let more = if size == 1.0 { more } else { "" };
                let lens = ["\"fov_y\": 30", "\"height\": 20"][j];
                let json = format!(
                    r#"{{{}, {LIGHT}, "cut_normals": true, "clip": {{{clip}}}{more}, "transfer_function": {}}}"#,
                    seen(&volume, lens),
                    scaled(&look, size)
                );
                let scene = scene(&volume, &json);
                let exact = reference(&volume, &scene);
                let off = difference(&bricked.render(&scene), &exact);
                println!("{name}, look {i}, {clip}: {off:.4}/255");
                assert!(off <= DEFAULT_LEVELS, "{name}, look {i}: {off} in\n{json}");
            }
        }
    }
}

/// Pixels state at least what they are off by, and at most what is asked for; surfaces and slices take part.
#[test]
fn what_is_stated_holds_with_surfaces_and_slices() {
    let (_, volume, _) = volumes().swap_remove(0);
    let container = open(&container_bytes(&volume, 16));
    let slice = r#""slices": [{"normal": [0.3, -0.8, 0.4], "offset": 3, "opacity": 0.4,
        "colors": [{"value": 0, "color": [0, 0.1, 0]}, {"value": 1, "color": [0.9, 1, 0.8]}]}]"#;
    let surface = r#""iso": [{"value": 0.4, "color": [0.2, 0.9, 0.4], "alpha": 0.5}]"#;
    for (clip, more) in
        [(CLIPS[1], r#""samples_per_pixel": 1"#), (CLIPS[1], slice), (CLIPS[2], slice), (CLIPS[0], surface)]
    {
        let json = format!(
            r#"{{{}, {LIGHT}, "mode": "dvr", "cut_normals": true, "clip": {{{clip}}}, {more}, "transfer_function": {}}}"#,
            seen(&volume, r#""fov_y": 30"#),
            looks()[0]
        );
        let scene = scene(&volume, &json);
        let exact = reference(&volume, &scene);
        let options = RenderOptions {
            backend: Backend::Cpu,
            level: LevelChoice::Fixed(Lod::FINEST),
            threads: Some(2),
            predict_error: true,
            ..RenderOptions::default()
        };
        let drawn = render_with_errors(&container, &scene, &options).unwrap();
        let (picture, errors) = (drawn.0, drawn.1.expect("errors are summed up"));
        assert!(exact.pixels.iter().filter(|pixel| pixel[3] > 0.1).count() > 60, "hardly anything shows");
        for ((found, exact), stated) in picture.pixels.iter().zip(&exact.pixels).zip(&errors.pixels) {
            let off = (0..4).map(|c| (found[c] - exact[c]).abs()).fold(0.0, f32::max);
            assert!(
                f64::from(off) <= f64::from(stated[0]) + REFERENCE_ERROR,
                "{off} but {} is stated\n{json}",
                stated[0]
            );
            assert!(f64::from(stated[0]) <= DEFAULT_ERROR * 1.000_001, "{} is stated", stated[0]);
        }
    }
}

/// Neither skipping nor bricks change what shows.
#[test]
fn skipping_and_bricks_change_nothing_that_shows() {
    let (_, volume, _) = volumes().swap_remove(0);
    let json = format!(
        r#"{{{}, {LIGHT}, "cut_normals": true, "clip": {{{}}}, "transfer_function": {}}}"#,
        seen(&volume, r#""height": 24"#),
        CLIPS[1],
        looks()[1]
    );
    let scene = scene(&volume, &json);
    let bricked = Bricked::new(&volume, 16);
    let skipped = bricked.render_with(&scene, FINEST, Skipping::On).0;
    assert_eq!(skipped, bricked.render_with(&scene, FINEST, Skipping::Off).0);
    assert!(difference(&skipped, &Bricked::new(&volume, 32).render(&scene)) <= DEFAULT_LEVELS);
}

#[test]
fn a_device_refuses_it_and_auto_takes_the_processor() {
    let (_, volume, _) = volumes().swap_remove(0);
    let container = open(&container_bytes(&volume, 16));
    let json = format!(
        r#"{{{}, {LIGHT}, "cut_normals": true, "clip": {{{}}}, "transfer_function": {}}}"#,
        seen(&volume, r#""fov_y": 30"#),
        CLIPS[0],
        looks()[0]
    );
    let scene: ResolvedScene = Scene::from_json(&json).unwrap().resolve(&volume.facts()).unwrap();
    let by = |backend: Backend| {
        render(&container, &scene, &RenderOptions { backend, threads: Some(1), ..RenderOptions::default() })
    };
    assert!(matches!(by(Backend::Gpu), Err(RenderError::CutNormalsOnGpu)));
    let (_, stats) = by(Backend::Auto).unwrap();
    assert_eq!(stats.backend, "cpu");
}
