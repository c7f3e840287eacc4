//! Shared parts of regimes with parallel rays through small volumes.
//!
//! If the field is constant along a ray, or depends only on depth, the picture has a closed form. Most of these regimes
//! are one small picture: orthographic camera, black background, level 0, CPU ray caster.

use supervol_runtime::engines::cells::{CellRule, Pairs};
use supervol_runtime::engines::cpu::Caster;
use supervol_runtime::render::options::{Backend, RenderOptions};
use supervol_scene::image::Image;

use crate::comparison::Sampling;
use crate::context::ChartError;
pub(crate) use crate::measure::{GREY_LEVELS, HALF_A_LEVEL};
use crate::volume::{Volume, finest};

/// Termination opacity that no ray reaches, so that early termination has no effect on the result.
pub(crate) const NEVER: f64 = 2.0;

/// `"camera"`: orthographic, looking along +x (0), +y (1) or +z (2) at the volume's centre. `height` is a world length.
///
/// Looking along z, x runs to the right and y downwards, as voxels lie in memory.
pub(crate) fn looking_along(volume: &Volume, axis: usize, height: f64) -> String {
    let target = volume.world(volume.middle()).to_array();
    let mut eye = target;
    eye[axis] -= 2.0 * volume.radius();
    let up = [[0, 0, 1], [0, 0, 1], [0, -1, 0]][axis];
    format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": {up:?}, "height": {height:?}}}"#)
}

/// Options of the default integration without early termination.
pub(crate) fn default_unterminated() -> RenderOptions {
    by_cells(CellRule { termination_opacity: NEVER, ..CellRule::DEFAULT })
}

/// Options with a fixed number of Gauss pairs between two splits and without early termination.
pub(crate) fn fixed_pairs(pairs: u32) -> RenderOptions {
    by_cells(CellRule { pairs: Pairs::Fixed(pairs), termination_opacity: NEVER })
}

/// Options for cells with this rule.
pub(crate) fn by_cells(rule: CellRule) -> RenderOptions {
    RenderOptions { caster: Caster::Cells(rule), ..finest(Backend::Cpu) }
}

/// Options for a method of comparison.
pub(crate) fn by_samples(sampling: Sampling) -> RenderOptions {
    RenderOptions { caster: sampling.caster(), ..finest(Backend::Cpu) }
}

/// Channels of a pixel, in `f64`.
///
/// # Errors
/// If the picture has no such pixel.
pub(crate) fn pixel(image: &Image, x: u32, y: u32) -> Result<[f64; 4], ChartError> {
    let (width, height) = (image.width, image.height);
    let place = || ChartError::Broken(format!("pixel ({x}, {y}) of a picture of {width} x {height}"));
    let index = (x < width).then_some(y as usize * width as usize + x as usize);
    let found = index.and_then(|i| image.pixels.get(i)).ok_or_else(place)?;
    Ok(found.map(f64::from))
}

/// Greatest value; NaN counts as infinite, so that no gate holds for it.
pub(crate) fn worst(sizes: impl IntoIterator<Item = f64>) -> f64 {
    supervol_scene::image::greatest(sizes)
}
