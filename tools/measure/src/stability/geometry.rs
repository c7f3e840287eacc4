//! Regimes of rays and grids: S24, S25, S36, S37.
//!
//! Effects of rounding, unusual camera positions and unusual grid shapes on pictures that are otherwise easy.

use glam::{DMat3, DVec3};
use supervol_format::cast::narrow;
use supervol_format::{Geometry, VoxelType};
use supervol_runtime::render::options::Backend;
use supervol_scene::camera::Camera;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;
use supervol_sources::VolumeSource;
use supervol_sources::computed::Computed;

use super::borders::waves;
use super::regime::{CurvePoint, Gate, Outcome, Regime};
use super::views::{BLUE, GOLD, HALF_A_LEVEL, SHADED, fractions, grey_levels, orthographic, perspective, smooth};
use crate::context::{ChartError, Context};
use crate::fixtures;
use crate::volume::{Volume, build_options, image_size, transfer_function};

/// The regimes of this module.
pub const REGIMES: &[Regime] = &[
    Regime {
        id: "S24",
        title: "Rays along axes and diagonals",
        recipe: "18 orthographic cameras along axes and face diagonals, rays exactly on voxel planes and on faces of bricks; \
                 some directions have components of -0 or 1e-30. Held against the same camera turned and moved by a little.",
        x_label: "by how much the compared camera is turned and moved: 10^-x",
        y_label: "greatest difference between the two pictures, grey levels of 255",
        run: axis_parallel,
    },
    Regime {
        id: "S25",
        title: "Camera inside, on a face, in an empty brick",
        recipe: "SPHERE seen from outside, exactly on its bounds, on a corner of bricks, in a brick that shows nothing, and \
                 from its centre.",
        x_label: "depth of the eye below the volume's surface, voxels",
        y_label: "greatest difference from the reference, grey levels of 255",
        run: camera_inside,
    },
    Regime {
        id: "S36",
        title: "Voxels that are not cubes, grids that are not orthogonal",
        recipe: "Spacing 25, 12.5, 4 on a survey grid that is sheared by up to 60 degrees; unshaded, shaded, mean and \
                 iso pictures; and CONST, whose opacity along each ray has a closed form.",
        x_label: "shear, degrees",
        y_label: "greatest difference from the reference, grey levels of 255",
        run: sheared,
    },
    Regime {
        id: "S37",
        title: "Degenerate sizes",
        recipe: "Volumes one voxel thin along one, two or three axes, of odd sizes, and one voxel larger than a brick.",
        x_label: "voxels of the volume",
        y_label: "greatest difference from the reference, grey levels of 255",
        run: degenerate,
    },
];

/// A light that no camera of S24 faces. If the light is opposite to the view, the halfway vector is a normalised zero,
/// and even the exact picture jumps.
const SLANTED_LIGHT: &str = r#""shading": {"lights": [{"direction": [0.3, -0.5, -0.8]}]}"#;

/// Whether every channel is a finite number.
fn is_finite(image: &Image) -> bool {
    image.pixels.as_flattened().iter().all(|v| v.is_finite())
}

/// The 6 axes, 12 face diagonals, and directions with negligible small components.
fn directions() -> Vec<DVec3> {
    let mut all = Vec::new();
    for x in -1..=1i32 {
        for y in -1..=1i32 {
            for z in -1..=1i32 {
                if (1..=2).contains(&(x.abs() + y.abs() + z.abs())) {
                    all.push(DVec3::new(f64::from(x), f64::from(y), f64::from(z)).normalize());
                }
            }
        }
    }
    all.extend([DVec3::new(1.0, 1e-30, 0.0), DVec3::new(1.0, -0.0, 0.0), DVec3::new(-0.0, -1e-30, 1.0)]);
    all
}

/// Orthographic camera along `forward`, which is not normalised again. Pixel centres are half a voxel apart; the centre
/// of the picture lies on a voxel.
fn camera_along(scene: &ResolvedScene, target: DVec3, forward: DVec3) -> Camera {
    let side = if forward.z.abs() > 0.9 { DVec3::Y } else { DVec3::Z };
    let right = forward.cross(side).normalize();
    Camera { eye: target, forward, right, up: right.cross(forward), ..scene.camera }
}

/// The same camera, shifted sideways and turned by `amount`.
fn disturbed(camera: &Camera, amount: f64) -> Camera {
    let forward = (camera.forward + amount * (0.7 * camera.right - 0.4 * camera.up)).normalize();
    let right = forward.cross(camera.up).normalize();
    let eye = camera.eye + amount * (0.6 * camera.right + 0.8 * camera.up);
    Camera { eye, forward, right, up: right.cross(forward), ..*camera }
}

fn axis_parallel(context: &Context<'_>) -> Result<Outcome, ChartError> {
    const EDGE: u64 = 48;
    // The gate uses the first exponent.
    let exponents: &[i32] = context.pick(&[7, 2, 4, 10, 15, 30], &[7, 2]);
    let field = Volume::build(context, "S24 waves", &waves([EDGE; 3]), &build_options(16))?;
    let constant = Volume::build(context, "S24 CONST", &fixtures::constant([EDGE; 3], 1.0), &build_options(16))?;
    // 33 pixels over 16.5 voxels: rays at all integers and halves from 16 to 32, and two brick faces (15.5 and 31.5).
    let pixels = context.pick(49, 33);
    let height = format!(
        r#""camera": {{"eye": [0,0,0], "target": [1,0,0], "up": [0,0,1], "height": {}}}"#,
        f64::from(pixels) / 2.0
    );
    let size = image_size(pixels, pixels);
    let tf = smooth(&field, 1.0);
    let mut worst = vec![0.0f64; exponents.len()];
    let (mut missed, mut not_finite) = (0.0, 0.0);
    for direction in directions() {
        let mut scene = field.scene(&[&height, &size, &tf, SLANTED_LIGHT])?;
        let camera = camera_along(&scene, DVec3::splat(24.0), direction);
        scene.camera = camera;
        let exact = field.finest(&scene, Backend::Cpu)?;
        not_finite += if is_finite(&exact) { 0.0 } else { 1.0 };
        for (exponent, worst) in exponents.iter().zip(&mut worst) {
            scene.camera = disturbed(&camera, 10f64.powi(-exponent));
            *worst = worst.max(grey_levels(&field.finest(&scene, Backend::Cpu)?, &exact));
        }
        missed += missed_columns(&constant, &size, &height, direction)?;
    }
    let points = exponents.iter().zip(&worst);
    let mut curve: Vec<_> = points.map(|(&x, &worst)| CurvePoint::new("default", f64::from(x), worst, None)).collect();
    curve.sort_by(|a, b| a.x.total_cmp(&b.x));
    let gates = vec![
        Gate::at_most("difference from the picture disturbed by 1e-7, grey levels", worst[0], HALF_A_LEVEL),
        Gate::at_most("rays through CONST whose opacity is not that of their chord", missed, 0.0),
        Gate::at_most("pictures with a pixel that is not finite", not_finite, 0.0),
    ];
    let note = "6 axes, 12 face diagonals, (1, 1e-30, 0), (1, -0, 0), (-0, -1e-30, 1); shaded.".into();
    Ok(Outcome { curve, gates, note })
}

/// Pixels of CONST more than half a grey level from `1 - exp(-kappa chord)`, with the chord computed here.
fn missed_columns(constant: &Volume, size: &str, camera: &str, direction: DVec3) -> Result<f64, ChartError> {
    const ALPHA: f64 = 0.02;
    let tf = transfer_function(1.0, &[(1.0, GOLD, ALPHA)]);
    let mut scene = constant.scene(&[camera, size, &tf])?;
    scene.camera = camera_along(&scene, DVec3::splat(24.0), direction);
    let picture = constant.finest(&scene, Backend::Cpu)?;
    let opacity = |chord: f64| 1.0 - (1.0 - ALPHA).powf(chord);
    let faces = constant.facts.dims.0.map(|n| n as f64 - 0.5);
    Ok(pixels_off(&scene.camera, &picture, opacity, |ray_origin, ray_direction| {
        chord_in_box(ray_origin, ray_direction, faces)
    }))
}

/// Pixels with an opacity more than half a grey level from `opacity(chord(origin, direction))`.
fn pixels_off(
    camera: &Camera,
    picture: &Image,
    opacity: impl Fn(f64) -> f64,
    chord: impl Fn(DVec3, DVec3) -> f64,
) -> f64 {
    let off = picture.pixels.iter().enumerate().filter(|(i, pixel)| {
        let (x, y) = (narrow::<u32>(*i) % picture.width, narrow::<u32>(*i) / picture.width);
        let ray = camera.ray(x, y);
        let expected = opacity(chord(ray.origin, ray.direction));
        let grey_levels = 255.0 * (f64::from(pixel[3]) - expected).abs();
        grey_levels.is_nan() || grey_levels > HALF_A_LEVEL
    });
    off.count() as f64
}

/// Length in t of the part of `origin + t * direction` between -1/2 and `high`. Components below 1e-20 count as 0.
fn chord_in_box(origin: DVec3, direction: DVec3, high: [f64; 3]) -> f64 {
    let mut interval = [f64::NEG_INFINITY, f64::INFINITY];
    for a in 0..3 {
        if direction[a].abs() < 1e-20 {
            if origin[a] < -0.5 || origin[a] > high[a] {
                return 0.0;
            }
            continue;
        }
        let ends = [-0.5, high[a]].map(|face| (face - origin[a]) / direction[a]);
        interval = [interval[0].max(ends[0].min(ends[1])), interval[1].min(ends[0].max(ends[1]))];
    }
    (interval[1] - interval[0]).max(0.0)
}

fn camera_inside(context: &Context<'_>) -> Result<Outcome, ChartError> {
    const EDGE: u64 = 48;
    let volume = Volume::build(context, "S25", &fixtures::sphere(EDGE), &build_options(16))?;
    let size = context.pick(image_size(64, 48), image_size(24, 18));
    // Nothing is visible more than 20 voxels from the centre: the corners of the outermost bricks are empty.
    let range = volume.facts.value_range;
    let at = |radius: f64| (radius - range.min) / range.width();
    let tf =
        fractions(&volume, 1.0, &[(0.0, GOLD, 0.02), (at(12.0), BLUE, 0.05), (at(20.0), BLUE, 0.0), (1.0, BLUE, 0.0)]);
    let middle = DVec3::splat(23.5);
    let eyes = [
        ("outside", DVec3::new(-8.5, 21.0, 22.0), middle),
        ("on the bounds", DVec3::new(-0.5, 20.25, 21.5), middle),
        ("on a corner of the bounds", DVec3::splat(-0.5), middle),
        ("in an empty brick", DVec3::new(3.0, 4.0, 2.0), middle),
        ("on a face of bricks", DVec3::new(15.5, 20.0, 21.0), middle),
        ("on a corner of bricks", DVec3::splat(15.5), middle),
        ("on a corner of bricks, looking out", DVec3::splat(15.5), DVec3::new(-3.0, 2.0, 5.0)),
        ("on a voxel", DVec3::splat(20.0), DVec3::new(40.0, 20.0, 20.0)),
        ("at the centre", middle, DVec3::new(47.0, 20.0, 30.0)),
    ];
    let (mut curve, mut worst, mut empty) = (Vec::new(), 0.0f64, 0.0);
    for (_, eye, target) in eyes {
        let depth = (0..3).map(|a| (eye[a] + 0.5).min(EDGE as f64 - 0.5 - eye[a])).fold(f64::MAX, f64::min);
        let scene = volume.scene(&[&perspective(eye, target, 70.0), &size, &tf])?;
        let exact = volume.finest(&scene, Backend::Reference)?;
        let off = grey_levels(&volume.finest(&scene, Backend::Cpu)?, &exact);
        empty += if exact.pixels.iter().any(|p| p[3] > 0.0) { 0.0 } else { 1.0 };
        curve.push(CurvePoint::new("default", depth, off, Some(0.0)));
        worst = worst.max(off);
    }
    let gates = vec![
        Gate::at_most("difference from the reference, grey levels", worst, HALF_A_LEVEL),
        Gate::at_most("pictures that show nothing, and so test nothing", empty, 0.0),
    ];
    curve.sort_by(|a, b| a.x.total_cmp(&b.x));
    let note = format!("Perspective, 70 degrees. Eyes: {}.", eyes.map(|(name, _, _)| name).join(", "));
    Ok(Outcome { curve, gates, note })
}

/// Grid of S36: spacing 25, 12.5, 4. The y axis is sheared by this angle towards x, the z axis slightly.
fn survey_grid(shear_degrees: f64) -> Geometry {
    let (sin, cos) = shear_degrees.to_radians().sin_cos();
    Geometry {
        spacing: [25.0, 12.5, 4.0],
        origin: [4.5e5, 6.1e6, -30.0],
        direction: [0.8, 0.8 * sin - 0.6 * cos, 0.1 * sin, 0.6, 0.6 * sin + 0.8 * cos, 0.0, 0.0, 0.0, 1.0],
    }
}

fn placed(source: Computed, geometry: Geometry) -> Computed {
    source.with_info(|info| info.geometry = geometry)
}

fn sheared(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let dims = [22, 26, 37];
    let size = context.pick(image_size(64, 48), image_size(24, 18));
    let (mut curve, mut worst, mut off) = (Vec::new(), 0.0f64, 0.0);
    for shear in [0.0, 15.0, 30.0, 45.0, 60.0] {
        let geometry = survey_grid(shear);
        let field = Volume::build(context, "S36 waves", &placed(waves(dims), geometry), &build_options(16))?;
        let camera = field.looking_from(DVec3::new(0.4, -0.7, 0.5), 2.2);
        let iso = format!(
            r#""mode": "iso", "shading": null, "iso": [{{"value": {:?}, "color": [0.9, 0.7, 0.4], "alpha": 0.5}}]"#,
            field.value(0.45)
        );
        let tf = smooth(&field, 12.0);
        for (name, members) in [("dvr", ""), ("shaded", SHADED), ("mean", r#""mode": "mean""#), ("iso", iso.as_str())] {
            let all: Vec<&str> = [&camera, &size, &tf, members].into_iter().filter(|m| !m.is_empty()).collect();
            let scene = field.scene(&all)?;
            let exact = field.finest(&scene, Backend::Reference)?;
            let distance = grey_levels(&field.finest(&scene, Backend::Cpu)?, &exact);
            curve.push(CurvePoint::new(&format!("default: {name}"), shear, distance, Some(0.0)));
            worst = worst.max(distance);
        }
        let constant = fixtures::constant(dims, 1.0);
        let constant = Volume::build(context, "S36 CONST", &placed(constant, geometry), &build_options(16))?;
        off += chords_off(&constant, &geometry, &camera, &size)?;
    }
    let gates = vec![
        Gate::at_most("difference from the reference, grey levels", worst, HALF_A_LEVEL),
        Gate::at_most("rays through CONST whose opacity is not that of their world-space chord", off, 0.0),
    ];
    let note =
        "The reference shares the geometry of the grid with the ray caster; the chords through CONST are computed \
                apart, by a matrix inverse of their own."
            .into();
    Ok(Outcome { curve, gates, note })
}

fn chords_off(constant: &Volume, geometry: &Geometry, camera: &str, size: &str) -> Result<f64, ChartError> {
    const ALPHA: f64 = 0.01;
    const UNIT: f64 = 5.0;
    let scene = constant.scene(&[camera, size, &transfer_function(UNIT, &[(1.0, GOLD, ALPHA)])])?;
    let picture = constant.finest(&scene, Backend::Cpu)?;
    let d = geometry.direction;
    let columns = [0, 1, 2].map(|a| DVec3::new(d[a], d[3 + a], d[6 + a]) * geometry.spacing[a]);
    let index_from_world = DMat3::from_cols(columns[0], columns[1], columns[2]).inverse();
    let faces = constant.facts.dims.0.map(|n| n as f64 - 0.5);
    let origin = DVec3::from_array(geometry.origin);
    let opacity = |chord: f64| 1.0 - (1.0 - ALPHA).powf(chord / UNIT);
    Ok(pixels_off(&scene.camera, &picture, opacity, |ray_origin, ray_direction| {
        // Directions are unit vectors of the world, so t is a world length in index space too.
        chord_in_box(index_from_world * (ray_origin - origin), index_from_world * ray_direction, faces)
    }))
}

/// Sizes of S37, voxels; bricks of 16.
const ODD_SIZES: [[u64; 3]; 12] = [
    [1, 1, 1],
    [2, 2, 2],
    [1, 1, 40],
    [40, 1, 1],
    [1, 33, 1],
    [1, 20, 24],
    [16, 16, 16],
    [17, 17, 17],
    [17, 1, 16],
    [33, 16, 15],
    [3, 50, 2],
    [31, 67, 127],
];

fn degenerate(context: &Context<'_>) -> Result<Outcome, ChartError> {
    // Odd, so that the middle ray meets the centre of the thinnest volume.
    let size = context.pick(image_size(29, 21), image_size(17, 13));
    let (mut curve, mut worst, mut not_finite, mut empty) = (Vec::new(), 0.0f64, 0.0, 0.0);
    const TYPES: [VoxelType; 2] = [VoxelType::F32, VoxelType::U8];
    for (i, dims) in ODD_SIZES.into_iter().enumerate() {
        // The small scale alternates between the two types.
        for &voxel_type in context.pick(&TYPES[..], &TYPES[i % 2..=i % 2]) {
            let scale = if voxel_type == VoxelType::U8 { 255.0 } else { 1.0 };
            let field = Computed::new(dims, voxel_type, move |v| scale * fixtures::waves_at(fixtures::point(v)));
            let source: &dyn VolumeSource = &field;
            let name = format!("S37 {dims:?} {voxel_type}").replace([',', '[', ']'], "");
            let volume = Volume::build(context, &name, source, &build_options(16))?;
            // A single voxel has one value: a transfer function over all of [0, 1] shows it.
            let tf = transfer_function(1.0, &[(0.0, BLUE, 0.1), (0.5 * scale, GOLD, 0.2), (scale, GOLD, 0.5)]);
            let slanted = orthographic(&volume, volume.middle(), DVec3::new(0.3, 0.9, -0.2), [0.1, 0.0, 1.0], 1.5);
            for camera in [volume.outside(), slanted] {
                let scene = volume.scene(&[&camera, &size, &tf, SHADED])?;
                let picture = volume.finest(&scene, Backend::Cpu)?;
                let exact = volume.finest(&scene, Backend::Reference)?;
                let off = grey_levels(&picture, &exact);
                let voxels: u64 = dims.iter().product();
                curve.push(CurvePoint::new(&format!("default, {voxel_type}"), voxels as f64, off, Some(0.0)));
                worst = worst.max(off);
                not_finite += if is_finite(&picture) { 0.0 } else { 1.0 };
                empty += if exact.pixels.iter().any(|p| p[3] > 0.0) { 0.0 } else { 1.0 };
            }
        }
    }
    let gates = vec![
        Gate::at_most("difference from the reference, grey levels", worst, HALF_A_LEVEL),
        Gate::at_most("pictures with a pixel that is not finite", not_finite, 0.0),
        Gate::at_most("pictures that show nothing, and so test nothing", empty, 0.0),
    ];
    let sizes = ODD_SIZES.map(|[x, y, z]| format!("{x} x {y} x {z}")).join(", ");
    Ok(Outcome { curve, gates, note: format!("Sizes: {sizes}; bricks of 16.") })
}
