//! Cells that are integrated together: only where the field is smooth, and with the same picture.

use supervol_format::{Lod, VoxelType};
use supervol_runtime::lod::LodChoice;
use supervol_runtime::stream::classify::Skipping;
use supervol_runtime::stream::counters::RayCounters;
use supervol_scene::scene::ResolvedScene;

use crate::support;
use support::{Bricked, Volume, difference, marschner_lobb, noise, points, reference, scene};

const CAMERA: &str = r#""camera": {"eye": [150, 100, 80], "target": [31.5, 31.5, 31.5], "up": [0, 0, 1], "fov_y": 30}"#;
const LEVEL_0: LodChoice = LodChoice::Fixed(Lod(0));

/// A volume of bytes, and a scene of it.
fn scene_of(volume: &Volume, tf: &str) -> ResolvedScene {
    scene(volume, &format!(r#"{{{CAMERA}, "image": {{"width": 40, "height": 32}}, "transfer_function": {tf}}}"#))
}

/// A transfer function that shows every value.
fn everywhere() -> String {
    points(1.0, &[(0.0, [0.2, 0.3, 0.9], 0.002), (255.0, [1.0, 0.8, 0.3], 0.06)])
}

/// Values classified per cell: two if cells are integrated one by one.
fn samples_per_cell(counters: &RayCounters) -> f64 {
    counters.samples as f64 / counters.cells as f64
}

fn slow_waves(p: [f64; 3]) -> f64 {
    128.0 + 40.0 * ((p[0] / 23.0).sin() + (p[1] / 19.0 + p[0] / 31.0).cos() + (p[2] / 27.0).sin())
}

#[test]
fn smooth_bricks_are_taken_several_cells_at_a_time() {
    let volume = Volume::new([64; 3], VoxelType::U8, slow_waves);
    let scene = scene_of(&volume, &everywhere());
    let bricks = Bricked::new(&volume, 32);
    let (image, counters) = bricks.render_with(&scene, LEVEL_0, Skipping::On);
    let samples = samples_per_cell(&counters);
    assert!(samples < 0.7, "{samples} samples per cell of {}", counters.cells);
    let error = difference(&image, &reference(&volume, &scene));
    assert!(error < 0.5, "{error} grey levels");
}

#[test]
fn noise_is_taken_cell_by_cell() {
    let volume = Volume::new([64; 3], VoxelType::U8, |p| 20.0 + 200.0 * noise(p));
    let (_, counters) = Bricked::new(&volume, 32).render_with(&scene_of(&volume, &everywhere()), LEVEL_0, Skipping::On);
    assert!(samples_per_cell(&counters) > 1.9, "{counters:?}");
}

/// A step that few cells of a brick meet: the cells of their spans wait, and are right.
#[test]
fn what_a_span_does_not_settle_is_settled_cell_by_cell() {
    let volume = Volume::new([64; 3], VoxelType::U8, slow_waves);
    let (dim, bright) = ([0.3, 0.5, 0.9], [1.0, 0.9, 0.2]);
    let steps = points(1.0, &[(0.0, dim, 0.004), (216.5, dim, 0.004), (216.5, bright, 0.9), (255.0, bright, 0.9)]);
    let scene = scene_of(&volume, &steps);
    let (image, counters) = Bricked::new(&volume, 32).render_with(&scene, LEVEL_0, Skipping::On);
    let samples = samples_per_cell(&counters);
    assert!(samples < 1.0 && counters.cells_refined > 100, "{samples} samples per cell, {counters:?}");
    let error = difference(&image, &reference(&volume, &scene));
    assert!(error < 0.5, "{error} grey levels");
}

/// In bricks whose rays leap, cells are integrated one by one, whether rays leap or not: so leaps change nothing.
#[test]
fn leaps_and_spans_do_not_meet() {
    let volume = Volume::new([64; 3], VoxelType::U8, |p| 250.0 * marschner_lobb(64)(p));
    let hat =
        points(1.0, &[(120.0, [0.9, 0.2, 0.1], 0.0), (200.0, [1.0, 0.9, 0.3], 0.1), (255.0, [0.1, 0.9, 0.3], 0.0)]);
    let scene = scene_of(&volume, &hat);
    let bricks = Bricked::new(&volume, 32);
    let (leaping, counters) = bricks.render_with(&scene, LEVEL_0, Skipping::On);
    let (walking, _) = bricks.render_with(&scene, LEVEL_0, Skipping::Off);
    assert!(counters.macro_cells_skipped > 100, "{counters:?}");
    assert_eq!(leaping.pixels, walking.pixels);
}

/// A span beside a hole is split: the parts in front of the hole and behind it are drawn.
#[test]
fn holes_take_spans_apart() {
    let is_hole = |[x, y, z]: [usize; 3]| (x * 7 + y * 13 + z * 29).is_multiple_of(997);
    let volume = Volume::new([64; 3], VoxelType::F32, slow_waves).with_holes(is_hole);
    // Transparent below the middle of the values: visible parts must not be dropped because of unknown ones.
    let half = points(1.0, &[(100.0, [0.2, 0.3, 0.9], 0.0), (255.0, [1.0, 0.8, 0.3], 0.06)]);
    for tf in [everywhere(), half] {
        let scene = scene_of(&volume, &tf);
        let (image, counters) = Bricked::new(&volume, 32).render_with(&scene, LEVEL_0, Skipping::On);
        let error = difference(&image, &reference(&volume, &scene));
        assert!(error < 0.5, "{error} grey levels");
        assert!(samples_per_cell(&counters) < 1.5 && counters.cells_refined > 100, "{counters:?}");
    }
}
