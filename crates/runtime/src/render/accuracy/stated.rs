//! Stated error of a frame: the difference of each pixel from the exact picture of the source's own voxels, for all
//! reasons.
//!
//! The error of a pixel is the mean over its rays of the terms in [`super::predict`], each along that ray: cells, ray
//! end, transfer function, rounding. It includes coarser levels and moved voxels ([`crate::lod::deviation`]).
//! Unfinished pixels come from a picture of larger pixels; for them it is only known that all channels lie in [0, 1].
//! Failed bricks have no term of their own: a coarser level stands in for them.
//!
//! It is no strict bound if a term is an estimate: see [`super::predict`], rounding of values in `mip`, `minip` and
//! `mean`, and positions of crossings in `iso`. The term of levels is always a bound.

use serde::{Deserialize, Serialize};
use supervol_format::cast::single;
use supervol_scene::image::{GREY_LEVELS, Image};

use crate::engines::totals::ErrorsByReason;

/// Stated error, see the module. A grey level is 1/255 of full scale.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ErrorStated {
    /// Largest error of any channel of any pixel.
    pub largest_grey_levels: f64,
    /// Mean over all pixels of the largest error of a channel.
    pub mean_grey_levels: f64,
    /// Largest error from coarser levels of any ray of a finished tile: a bound.
    pub levels_grey_levels: f64,
    /// Whether a brick drawn from a coarser level may have a voxel where finer levels have none, or the reverse. The
    /// bound then covers both.
    pub presence_may_change: bool,
    /// Unfinished pixels: only their shown colour is known.
    pub pixels_unknown: u64,
}

impl ErrorStated {
    /// Stated error of a picture with these known errors; see [`complete`].
    #[must_use]
    pub fn of(known: &Image, picture: &Image, rays: ErrorsByReason, pixels_unknown: u64) -> Self {
        let of_pixels =
            || known.pixels.iter().zip(&picture.pixels).map(|(&known, &shown)| f64::from(error_of(known, shown)));
        Self {
            largest_grey_levels: GREY_LEVELS * of_pixels().fold(0.0, f64::max),
            mean_grey_levels: GREY_LEVELS * of_pixels().sum::<f64>() / known.pixels.len().max(1) as f64,
            levels_grey_levels: GREY_LEVELS * rays.levels,
            presence_may_change: rays.presence_may_change,
            pixels_unknown,
        }
    }
}

/// Error of each pixel of a picture, grey, 1 is white. `known` holds it for finished pixels and NaN elsewhere.
#[must_use]
pub fn complete(mut known: Image, picture: &Image) -> Image {
    for (error, &shown) in known.pixels.iter_mut().zip(&picture.pixels) {
        let off = error_of(*error, shown);
        *error = [off, off, off, 1.0];
    }
    known
}

/// Error of a pixel: the known one, or the largest that its colour allows if `known` is NaN.
pub(crate) fn error_of(known: [f32; 4], shown: [f32; 4]) -> f32 {
    if known[0].is_nan() {
        shown.map(|channel| channel.max(1.0 - channel)).into_iter().fold(0.0, f32::max)
    } else {
        known[0]
    }
}

/// The colours of [`in_colors`]: grey levels, and red, green, blue.
const COLORS: [(f64, [f32; 3]); 6] = [
    (0.1, [0.0, 0.0, 0.0]),
    (0.5, [0.1, 0.2, 0.7]),
    (2.0, [0.1, 0.6, 0.3]),
    (16.0, [0.95, 0.9, 0.2]),
    (64.0, [0.85, 0.2, 0.1]),
    (255.0, [1.0, 1.0, 1.0]),
];

/// Error map in colours: black up to a tenth of a grey level, then on a logarithmic scale through blue (0.5), green
/// (2), yellow (16) and red (64) to white (255).
#[must_use]
pub fn in_colors(mut map: Image) -> Image {
    for pixel in &mut map.pixels {
        let levels = (f64::from(pixel[0]) * GREY_LEVELS).clamp(COLORS[0].0, COLORS[COLORS.len() - 1].0);
        let next = COLORS.partition_point(|color| color.0 < levels).clamp(1, COLORS.len() - 1);
        let [(low, before), (high, after)] = [COLORS[next - 1], COLORS[next]];
        let share = single((levels / low).ln() / (high / low).ln());
        let [r, g, b] = std::array::from_fn(|c| before[c] + share * (after[c] - before[c]));
        *pixel = [r, g, b, 1.0];
    }
    map
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_follow_the_logarithm_of_grey_levels() {
        let errors = [0.0, 0.01, 0.1, 0.5, 1.0, 64.0, 255.0].map(|levels| [(levels / 255.0) as f32, 0.0, 0.0, 1.0]);
        let map = in_colors(Image { width: 7, height: 1, pixels: errors.to_vec() });
        let expected = [[0.0; 3], [0.0; 3], [0.0; 3], [0.1, 0.2, 0.7], [0.1, 0.4, 0.5], [0.85, 0.2, 0.1], [1.0; 3]];
        for (pixel, color) in map.pixels.iter().zip(expected) {
            assert!(pixel[3] == 1.0 && (0..3).all(|c| (pixel[c] - color[c]).abs() < 1e-5), "{pixel:?}, {color:?}");
        }
    }

    #[test]
    fn nothing_is_known_of_pixels_that_are_not_finished() {
        let image = |pixels: Vec<[f32; 4]>| Image { width: 3, height: 1, pixels };
        let picture = image(vec![[0.5; 4], [0.2, 0.3, 0.1, 0.4], [0.0, 0.9, 0.0, 0.95]]);
        let known = image(vec![[0.125, 0.125, 0.125, 1.0], [f32::NAN; 4], [f32::NAN; 4]]);
        let errors = complete(known.clone(), &picture);
        let found: Vec<f32> = errors.pixels.iter().map(|p| p[0]).collect();
        assert_eq!(found, [0.125, 0.9, 1.0]);
        let rays = ErrorsByReason { levels: 0.1, ..ErrorsByReason::default() };
        let stated = ErrorStated::of(&known, &picture, rays, 2);
        assert_eq!((stated.largest_grey_levels, stated.levels_grey_levels), (255.0, 25.5));
        assert!((stated.mean_grey_levels - 255.0 * 2.025 / 3.0).abs() < 1e-4, "{stated:?}");
    }
}
