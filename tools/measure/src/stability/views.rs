//! Shared parts of regimes with pictures: cameras, transfer functions, grey levels.

use glam::DVec3;
use supervol_runtime::render::options::{LevelChoice, RenderOptions};
use supervol_scene::image::Image;

pub use crate::measure::HALF_A_LEVEL;
use crate::measure::{GREY_LEVELS, distance};
use crate::volume::{Point, Volume, transfer_function};

/// One grey level of 255, as a fraction of full scale.
pub const GREY_LEVEL: f64 = 1.0 / GREY_LEVELS;

/// `"shading"` with default settings.
pub const SHADED: &str = r#""shading": {}"#;

/// A colour of transfer functions.
pub const BLUE: [f64; 3] = [0.1, 0.3, 0.9];
/// A colour of transfer functions.
pub const GOLD: [f64; 3] = [1.0, 0.75, 0.2];
/// A colour of transfer functions.
pub const RED: [f64; 3] = [0.9, 0.15, 0.1];
/// A colour of transfer functions.
pub const WHITE: [f64; 3] = [1.0; 3];

/// Greatest difference between two pictures (L-infinity), grey levels of 255.
#[must_use]
pub fn grey_levels(picture: &Image, exact: &Image) -> f64 {
    distance(picture, exact).linf / GREY_LEVEL
}

/// Mean opacity over the whole picture.
#[must_use]
pub fn mean_opacity(picture: &Image) -> f64 {
    picture.pixels.iter().map(|p| f64::from(p[3])).sum::<f64>() / picture.pixels.len() as f64
}

/// `"camera"`: orthographic, looking along `direction` at `target` (index coordinates). `height` is a world length.
#[must_use]
pub fn orthographic(volume: &Volume, target: [f64; 3], direction: DVec3, up: [f64; 3], height: f64) -> String {
    let target = volume.world(target);
    let eye = (target - direction.normalize() * volume.radius() * 3.0).to_array();
    let target = target.to_array();
    format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": {up:?}, "height": {height:?}}}"#)
}

/// `"camera"`: perspective, from one world point to another; `fov_y` in degrees.
#[must_use]
pub fn perspective(eye: DVec3, target: DVec3, fov_y: f64) -> String {
    let (eye, target) = (eye.to_array(), target.to_array());
    format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0.02, 0.013, 1], "fov_y": {fov_y:?}}}"#)
}

/// A smooth transfer function over fractions of the value range: transparent at the bottom, nearly opaque at the top.
#[must_use]
pub fn smooth(volume: &Volume, unit_distance: f64) -> String {
    fractions(volume, unit_distance, &[(0.0, BLUE, 0.0), (0.3, BLUE, 0.01), (0.6, GOLD, 0.08), (1.0, RED, 0.3)])
}

/// A transfer function with values as fractions of the value range.
#[must_use]
pub fn fractions(volume: &Volume, unit_distance: f64, points: &[Point]) -> String {
    let points: Vec<Point> = points.iter().map(|&(f, color, alpha)| (volume.value(f), color, alpha)).collect();
    transfer_function(unit_distance, &points)
}

/// The same options with automatic levels.
#[must_use]
pub fn automatic(options: RenderOptions) -> RenderOptions {
    RenderOptions { level: LevelChoice::Auto, ..options }
}
