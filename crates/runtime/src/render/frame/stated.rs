//! The stated error of a frame: how far each pixel may be from the exact picture of the source's own voxels, for all reasons.
//!
//! Per pixel, the mean over its rays of what [`super::predict`] lists, along that very ray: the errors of its cells, what lies
//! behind its end, the fit of the transfer function, rounding, and what coarser levels do, and voxels that were moved ([`crate::lod::deviation`]). Pixels
//! that are not finished yet are taken from a picture of larger pixels: of those nothing is known but that all channels lie
//! in [0, 1]. Failed bricks need no word of their own: what stands in for them is a coarser level.
//!
//! It is no bound in the strict sense where the terms are not (see [`super::predict`]; in `mip`, `minip` and `mean` rounding of
//! values, in `iso` the places of crossings, are estimates); what levels do always is one.

use serde::Serialize;
use supervol_scene::image::{GREY_LEVELS, Image};

use crate::engines::totals::ErrorsByReason;

/// See the module. A grey level is 1/255 of full scale.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ErrorStated {
    /// Most that any channel of any pixel may be off.
    pub largest_grey_levels: f64,
    /// Mean over all pixels of the most that a channel may be off.
    pub mean_grey_levels: f64,
    /// Most that coarser levels may do to any ray of a finished tile of pixels: a bound.
    pub levels_grey_levels: f64,
    /// Whether some brick that was drawn from a coarser level may have a voxel where finer ones have none, or the other way
    /// round: the bound then holds for both.
    pub presence_may_change: bool,
    /// Pixels that are not finished: of those nothing is known but what they show.
    pub pixels_unknown: u64,
}

impl ErrorStated {
    /// Of a picture of which so much is known; see [`complete`].
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

/// What each pixel of a picture may be off by, grey, 1 being white, where `known` says it of finished pixels and is NaN
/// elsewhere.
#[must_use]
pub fn complete(mut known: Image, picture: &Image) -> Image {
    for (error, &shown) in known.pixels.iter_mut().zip(&picture.pixels) {
        let off = error_of(*error, shown);
        *error = [off, off, off, 1.0];
    }
    known
}

fn error_of(known: [f32; 4], shown: [f32; 4]) -> f32 {
    if known[0].is_nan() {
        shown.map(|channel| channel.max(1.0 - channel)).into_iter().fold(0.0, f32::max)
    } else {
        known[0]
    }
}

/// The colours of [`in_colors`]: grey levels and red, green, blue.
const COLORS: [(f64, [f32; 3]); 6] = [
    (0.1, [0.0, 0.0, 0.0]),
    (0.5, [0.1, 0.2, 0.7]),
    (2.0, [0.1, 0.6, 0.3]),
    (16.0, [0.95, 0.9, 0.2]),
    (64.0, [0.85, 0.2, 0.1]),
    (255.0, [1.0, 1.0, 1.0]),
];

/// An error map for people to look at: black up to a tenth of a grey level, then by the logarithm through blue (0.5), green
/// (2), yellow (16) and red (64) to white (255).
#[must_use]
pub fn in_colors(mut map: Image) -> Image {
    for pixel in &mut map.pixels {
        let levels = (f64::from(pixel[0]) * GREY_LEVELS).clamp(COLORS[0].0, COLORS[COLORS.len() - 1].0);
        let next = COLORS.partition_point(|color| color.0 < levels).clamp(1, COLORS.len() - 1);
        let [(low, before), (high, after)] = [COLORS[next - 1], COLORS[next]];
        let share = ((levels / low).ln() / (high / low).ln()) as f32;
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
