//! The CPU ray caster against the reference integrator: every mode, field and regime, with bounds in grey levels.

mod support;

use supervol_format::{Lod, VoxelType};
use supervol_runtime::lod::LodChoice;
use supervol_runtime::raycast::cpu::Skipping;
use support::{Bricked, Volume, difference, marschner_lobb, noise, points, reference, scene};

const CAMERA: &str = r#""camera": {"eye": [95, -70, 62], "target": [20, 20, 20], "up": [0, 0, 1], "fov_y": 30}"#;
const SMALL: &str = r#""image": {"width": 48, "height": 40}"#;

fn smooth() -> String {
    points(1.0, &[(0.0, [0.1, 0.2, 0.9], 0.0), (0.5, [0.9, 0.8, 0.1], 0.06), (1.0, [0.9, 0.1, 0.1], 0.25)])
}

fn hat() -> String {
    let c = [1.0, 0.7, 0.2];
    points(1.0, &[(0.0, c, 0.0), (0.45, c, 0.0), (0.5, [0.2, 0.7, 1.0], 0.6), (0.55, c, 0.0), (1.0, c, 0.0)])
}

fn step() -> String {
    points(
        1.0,
        &[
            (0.0, [0.2, 0.4, 0.9], 0.01),
            (0.5, [0.2, 0.4, 0.9], 0.01),
            (0.5, [1.0, 0.8, 0.3], 0.7),
            (1.0, [1.0, 0.2, 0.1], 0.9),
        ],
    )
}

fn check(name: &str, volume: &Volume, json: &str, bound: f64) {
    let scene = scene(volume, json);
    let error = difference(&Bricked::new(volume, 16).render(&scene), &reference(volume, &scene));
    eprintln!("{name}: {error:.4}/255");
    if std::env::var("X").is_ok() {
        return;
    }
    assert!(error <= bound, "{name}: {error}/255, bound {bound}/255");
}

fn dvr(tf: &str, shading: &str) -> String {
    format!(r#"{{{CAMERA}, {SMALL}, "transfer_function": {tf}{shading}}}"#)
}

const SHADED: &str = r#", "shading": {}"#;

#[test]
fn dvr_of_marschner_lobb() {
    let volume = Volume::new([41, 41, 41], VoxelType::F32, marschner_lobb(41));
    check("ML smooth", &volume, &dvr(&smooth(), ""), 0.5);
    check("ML hat", &volume, &dvr(&hat(), ""), 0.5);
    check("ML step", &volume, &dvr(&step(), ""), 0.5);
    check("ML smooth shaded", &volume, &dvr(&smooth(), SHADED), 0.5);
    check("ML hat shaded", &volume, &dvr(&hat(), SHADED), 0.5);
    check("ML step shaded", &volume, &dvr(&step(), SHADED), 0.5);
}

#[test]
fn dvr_of_noise() {
    let volume = Volume::new([20, 17, 13], VoxelType::F32, noise);
    let camera = r#""camera": {"eye": [50, -30, 34], "target": [10, 8, 6], "up": [0, 0, 1], "fov_y": 28}"#;
    for (name, tf) in [("smooth", smooth()), ("hat", hat()), ("step", step())] {
        for shading in ["", SHADED] {
            let json = format!(r#"{{{camera}, {SMALL}, "transfer_function": {tf}{shading}}}"#);
            check(&format!("noise {name} {shading}"), &volume, &json, 0.5);
        }
    }
}

#[test]
fn value_modes() {
    let volume = Volume::new([41, 41, 41], VoxelType::F32, marschner_lobb(41));
    let rough = Volume::new([41, 35, 37], VoxelType::U8, |p| 255.0 * noise(p));
    let bytes = points(1.0, &[(0.0, [0.0, 0.1, 0.9], 0.1), (255.0, [1.0, 0.7, 0.0], 1.0)]);
    for mode in ["mip", "minip", "mean"] {
        let json = |tf: &str| format!(r#"{{{CAMERA}, {SMALL}, "mode": "{mode}", "transfer_function": {tf}}}"#);
        check(&format!("ML {mode}"), &volume, &json(&smooth()), 0.01);
        check(&format!("noise u8 {mode}"), &rough, &json(&bytes), 0.01);
    }
}
