//! Cells are refined only as far as they are visible.

use supervol_format::{Lod, VoxelType};
use supervol_runtime::lod::LodChoice;
use supervol_runtime::stream::classify::Skipping;

use crate::support;
use support::{Bricked, Volume, difference, noise, points, reference, scene};

/// Noise in one brick, behind an opaque wall on the sides that the camera sees, or behind the same wall made
/// transparent.
#[test]
fn what_a_wall_hides_in_its_own_brick_is_not_refined() {
    const WALL: f64 = 250.0;
    let is_wall = |p: [f64; 3]| p.iter().any(|&x| x > 57.0);
    let volume = Volume::new([64; 3], VoxelType::U8, |p| if is_wall(p) { WALL } else { 20.0 + 150.0 * noise(p) });
    let bricks = Bricked::new(&volume, 64);
    let (dim, bright) = ([0.3, 0.5, 0.9], [1.0, 0.9, 0.2]);
    let refined = |opacity: f64| {
        let tf = points(
            1.0,
            &[
                (0.0, dim, 0.0),
                (90.0, dim, 0.0),
                (100.0, bright, 0.3),
                (110.0, dim, 0.0),
                (200.0, dim, 0.0),
                (WALL, bright, opacity),
            ],
        );
        let camera =
            r#""camera": {"eye": [150, 120, 110], "target": [31.5, 31.5, 31.5], "up": [0, 0, 1], "fov_y": 30}"#;
        let scene = scene(
            &volume,
            &format!(r#"{{{camera}, "image": {{"width": 40, "height": 32}}, "transfer_function": {tf}}}"#),
        );
        let (image, counters) = bricks.render_with(&scene, LodChoice::Fixed(Lod(0)), Skipping::On);
        let error = difference(&image, &reference(&volume, &scene));
        assert!(error < 0.5, "opacity {opacity}: {error} grey levels");
        counters.cells_refined
    };
    // About a thousandth of the light passes the wall, more than the limit that ends a ray.
    let [glass, wall] = [0.0, 0.65].map(refined);
    assert!(glass > 10_000 && wall < glass / 5, "{wall} cells behind the wall, {glass} behind glass");
}
