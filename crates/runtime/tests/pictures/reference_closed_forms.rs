//! The reference integrator against closed forms: constant fields, ramps, spheres.

use supervol_format::VoxelType;
use supervol_runtime::engines::reference::{ReferenceCaster, render_reference};

use crate::support;
use support::{Volume, points, reference, scene};

/// One ray along +x through the middle of the volume, orthographic.
fn along_x(volume: &Volume, rest: &str) -> [f64; 4] {
    let centre = volume.dims.map(|n| (n as f64 - 1.0) / 2.0);
    let world = |p: [f64; 3]| volume.geometry.world_from_index().transform_point3(p.into()).to_array();
    let eye = world([-10.0, centre[1], centre[2]]);
    let target = world(centre);
    let json = format!(
        r#"{{"camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0, 0, 1], "height": 0.001}},
            "image": {{"width": 1, "height": 1}}, {rest}}}"#
    );
    reference(volume, &scene(volume, &json)).pixels[0].map(f64::from)
}

fn constant(alpha: f64) -> String {
    points(1.0, &[(0.0, [0.5, 1.0, 0.25], alpha)])
}

#[track_caller]
fn assert_close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} instead of {expected}");
}

/// S06: alpha 0.1 per voxel over 20 voxels gives 1 - 0.9^20 = 0.8784. S09: thousands of faint voxels.
#[test]
fn constant_fields() {
    for (n, alpha) in [(20, 0.1), (1000, 0.0015), (500, 0.003), (4000, 5e-4), (20_000, 1e-4)] {
        let volume = Volume::new([n, 2, 2], VoxelType::F32, |_| 3.0);
        let pixel = along_x(&volume, &format!(r#""transfer_function": {}"#, constant(alpha)));
        let opacity = 1.0 - (1.0 - alpha).powi(n as i32);
        assert_close(pixel[3], opacity, 1e-6);
        assert_close(pixel[0], 0.5 * opacity, 1e-6);
        let cast = {
            let bricked = support::Bricked::new(&volume, 64);
            let json = format!(
                r#"{{"camera": {{"eye": [-9, 0.5, 0.5], "target": [0, 0.5, 0.5], "up": [0, 0, 1], "height": 0.1}},
                    "image": {{"width": 1, "height": 1}}, "transfer_function": {}}}"#,
                constant(alpha)
            );
            bricked.render(&scene(&volume, &json)).pixels[0]
        };
        assert_close(f64::from(cast[3]), opacity, 1e-5);
    }
    assert_close(1.0 - 0.9f64.powi(20), 0.8784, 1e-4);
}

/// S07, S05: the opacity depends on the world length, for any spacing and any cut of the ray.
#[test]
fn lengths_are_world_lengths() {
    for spacing in [[1.0, 1.0, 1.0], [0.25, 0.25, 4.0], [25.0, 12.5, 4.0]] {
        let volume = Volume::new([8, 4, 4], VoxelType::F32, |_| 1.0).with_geometry(
            spacing,
            [100.0, -5.0, 3.0],
            [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        );
        for offset in [0.0, 0.1, 1.7] {
            let rest = format!(
                r#""transfer_function": {}, "clip": {{"box": [[{offset}, -1, -1], [99, 9, 9]]}}"#,
                constant(0.02)
            );
            let low = if offset == 0.0 { 0.0 } else { offset };
            let length = (7.5 - low) * spacing[0];
            assert_close(along_x(&volume, &rest)[3], 1.0 - 0.98f64.powf(length), 1e-6);
        }
    }
}

/// Linear kappa along a ramp: alpha = 1 - exp(-k s) at unit distance, sampled finely, gives tau = k n^2 / 2.
#[test]
fn a_ramp_of_extinction() {
    let n = 16;
    let volume = Volume::new([n + 1, 2, 2], VoxelType::F32, |p| p[0]);
    let k = 0.01;
    let table: Vec<(f64, [f64; 3], f64)> =
        (0..=1600).map(|i| f64::from(i) / 100.0).map(|s| (s, [s / n as f64, 0.0, 1.0], 1.0 - (-k * s).exp())).collect();
    let pixel = along_x(&volume, &format!(r#""transfer_function": {}"#, points(1.0, &table)));
    // Half a voxel of the last value lies behind the ramp; before it the value is 0.
    let end = n as f64;
    let tau = k * end * end / 2.0 + k * end * 0.5;
    assert_close(pixel[3], 1.0 - (-tau).exp(), 1e-5);
    assert_close(pixel[2], pixel[3], 1e-6);
    // Integral of (s/n) k s exp(-k s^2 / 2) ds by a fine sum, and the last half voxel.
    let steps = 200_000;
    let h = end / f64::from(steps);
    let ramp: f64 =
        (0..steps).map(|i| (f64::from(i) + 0.5) * h).map(|s| s / end * k * s * (-k * s * s / 2.0).exp() * h).sum();
    let rest = (-k * end * end / 2.0).exp() * (1.0 - (-k * end * 0.5).exp());
    assert_close(pixel[0], ramp + rest, 1e-5);
}

#[test]
fn value_modes_of_a_ramp() {
    let volume = Volume::new([11, 2, 2], VoxelType::F32, |p| p[0]);
    let tf = points(1.0, &[(0.0, [1.0; 3], 0.0), (10.0, [1.0; 3], 1.0)]);
    let mode =
        |mode: &str, more: &str| along_x(&volume, &format!(r#""mode": "{mode}", "transfer_function": {tf}{more}"#))[3];
    assert_close(mode("mip", ""), 1.0, 1e-6);
    assert_close(mode("minip", ""), 0.0, 1e-6);
    assert_close(mode("mean", ""), 0.5, 1e-6);
    let clip = r#", "clip": {"box": [[2.5, -1, -1], [6.25, 9, 9]]}"#;
    assert_close(mode("mip", clip), 0.625, 1e-6);
    assert_close(mode("minip", clip), 0.25, 1e-6);
    assert_close(mode("mean", clip), 0.4375, 1e-6);
    // The mean divides by the present length: a hole at voxel 5 takes (4, 6) away, and its mean is 5 as well.
    let holed = volume.clone().with_holes(|p| p[0] == 8);
    let pixel = along_x(&holed, &format!(r#""mode": "mean", "transfer_function": {tf}"#));
    // Present: [-1/2, 7] (value 0 before 0) and [9, 10.5] (value 10 behind 10).
    let expected = (24.5 + 9.5 + 5.0) / (7.5 + 1.5) / 10.0;
    assert_close(pixel[3], expected, 1e-6);
}

/// A sphere's surface: unshaded colour inside its disc, none outside; head-on shading (ka + kd) c + ks.
#[test]
fn iso_sphere() {
    let centre = [16.0; 3];
    let volume =
        Volume::new([33, 33, 33], VoxelType::F32, |p| (0..3).map(|a| (p[a] - centre[a]).powi(2)).sum::<f64>().sqrt());
    let json = |rest: &str| {
        format!(
            r#"{{"camera": {{"eye": [-20, 16, 16], "target": [16, 16, 16], "up": [0, 0, 1], "height": 32}},
                "image": {{"width": 65, "height": 65}}, "mode": "iso",
                "iso": [{{"value": 9, "color": [0.5, 0.25, 1.0], "alpha": 0.5}}]{rest}}}"#
        )
    };
    let unlit = r#", "shading": null"#;
    let flat = render_reference(&volume.reference(), &scene(&volume, &json(unlit)));
    let shaded = render_reference(&volume.reference(), &scene(&volume, &json(r#", "shading": {}"#)));
    for y in 0..65i32 {
        for x in 0..65i32 {
            let r = f64::from((x - 32).pow(2) + (y - 32).pow(2)).sqrt() * 32.0 / 65.0;
            let i = (y * 65 + x) as usize;
            if (r - 9.0).abs() > 0.3 {
                let expected = if r < 9.0 { [0.25, 0.125, 0.5, 0.5] } else { [0.0; 4] };
                assert_eq!(flat.pixels[i], expected, "pixel {x} {y}");
            }
        }
    }
    let middle = shaded.pixels[32 * 65 + 32].map(f64::from);
    assert_close(middle[0], 0.5 * (0.5 + 0.2), 1e-5);
    assert_close(middle[2], 0.5, 1e-5);
    // Off the centre by r the normal's cosine is sqrt(1 - (r/9)^2); trilinear interpolation costs a little.
    let pixel = shaded.pixels[32 * 65 + 32 + 12].map(f64::from);
    let cosine = (1.0 - (12.0 * 32.0 / 65.0 / 9.0f64).powi(2)).sqrt();
    assert_close(pixel[0], 0.5 * (0.5 * (0.3 + 0.7 * cosine) + 0.2 * cosine.powi(32)), 5e-3);
}

/// Pixels requested one by one equal those of the whole picture, also with several rays per pixel.
#[test]
fn single_pixels_are_those_of_the_picture() {
    let volume = Volume::new([9, 8, 7], VoxelType::F32, support::noise);
    for samples in [1, 4] {
        let json = format!(
            r#"{{"camera": {{"eye": [30, -20, 18], "target": [4, 3.5, 3], "up": [0, 0, 1], "fov_y": 20}},
                "image": {{"width": 12, "height": 9}}, "samples_per_pixel": {samples}, "transfer_function": {}}}"#,
            points(1.0, &[(-1.0, [0.2, 0.4, 0.9], 0.0), (1.0, [1.0, 0.7, 0.1], 0.6)])
        );
        let scene = scene(&volume, &json);
        let whole = reference(&volume, &scene);
        let asked: Vec<[u32; 2]> = (0..9).flat_map(|y| (0..12).map(move |x| [x, y])).rev().collect();
        let reference_volume = volume.reference();
        let caster = ReferenceCaster::new(&reference_volume, &scene);
        let found = caster.pixels(&asked, &|| ());
        assert_eq!(caster.capped_pieces(), 0);
        assert!(whole.pixels.iter().filter(|p| p[3] > 0.1).count() > 20, "the volume is hardly seen");
        for ([x, y], pixel) in asked.iter().zip(&found) {
            let expected = whole.pixels[(y * 12 + x) as usize];
            (0..4).for_each(|c| assert_close(f64::from(pixel[c]), f64::from(expected[c]), 1e-6));
        }
    }
}
