//! Stated errors of pixels, for scenes drawn from coarser levels: whether they are bounds, and how tight they are.

use serde::Serialize;
use supervol_format::Lod;
use supervol_runtime::render::options::{LevelChoice, RenderOptions};
use supervol_runtime::render::stats::FrameStats;
use supervol_scene::image::{GREY_LEVELS, Image, greatest};
use supervol_scene::scene::ResolvedScene;

use crate::context::ChartError;
use crate::volume::Volume;

/// Pictures of one level against the exact pictures of level 0, pixel by pixel. All errors are in grey levels of 255.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AtLevel {
    /// Level of detail.
    pub level: u8,
    /// The requested error (`--max-error`).
    pub asked_grey_levels: f64,
    /// Pixels with a true error above 0.01 grey levels.
    pub pixels: u64,
    /// Numbers of the scenes in which the true error of a pixel exceeds its stated error.
    pub scenes_above_stated: Vec<u64>,
    /// Greatest ratio of true to stated error, over all pixels.
    pub largest_share_of_stated: f64,
    /// Median ratio of stated to true error, over all pixels.
    pub median_stated_over_true: f64,
    /// Median true error.
    pub median_true_grey_levels: f64,
    /// Median stated error.
    pub median_stated_grey_levels: f64,
    /// Greatest true error, of all pixels.
    pub largest_true_grey_levels: f64,
    /// Greatest stated error, of all pixels.
    pub largest_stated_grey_levels: f64,
    /// Fraction of the pixels whose stated error is smaller than the whole range of a channel.
    pub share_with_a_bound: f64,
}

/// Pixels of one level, collected scene by scene: true and stated error of each, grey levels of 255.
#[derive(Debug)]
pub struct Pixels {
    level: u8,
    asked: f64,
    errors: Vec<[f64; 2]>,
    largest_true: f64,
    largest_stated: f64,
    scenes_above: Vec<u64>,
}

/// Smallest error that counts, grey levels: the reference's own error is far smaller.
const LEAST: f64 = 0.01;
/// A stated error from this on, in grey levels, counts as no bound.
const NO_BOUND: f64 = 254.0;

impl Pixels {
    /// Starts with no pixels of this level, drawn with this requested error, grey levels.
    #[must_use]
    pub fn new(level: u8, asked: f64) -> Self {
        Self { level, asked, errors: Vec::new(), largest_true: 0.0, largest_stated: 0.0, scenes_above: Vec::new() }
    }

    /// Draws scene `number` from this level (or the coarsest one) and compares it with `exact`. Returns the picture.
    ///
    /// # Errors
    /// If the picture or its stated errors cannot be computed.
    pub fn draw(
        &mut self,
        number: u64,
        volume: &Volume,
        scene: &ResolvedScene,
        exact: &Image,
        aimed: RenderOptions,
    ) -> Result<(Image, FrameStats), ChartError> {
        let max_error = self.asked / GREY_LEVELS;
        let options = RenderOptions { level: LevelChoice::Fixed(Lod(self.level)), max_error, ..aimed };
        let (picture, maps, stats) = volume.render_with_maps(scene, &options)?;
        volume.check_whole(&picture, &stats)?;
        let errors = maps.errors.ok_or_else(|| ChartError::Broken(format!("nothing is stated: {stats:?}")))?;
        self.add(number, &picture, exact, &errors);
        Ok((picture, stats))
    }

    fn add(&mut self, number: u64, picture: &Image, exact: &Image, stated: &Image) {
        let mut is_above = false;
        for ((found, exact), stated) in picture.pixels.iter().zip(&exact.pixels).zip(&stated.pixels) {
            let off = greatest([0, 1, 2, 3].map(|c| f64::from(found[c] - exact[c]))) * GREY_LEVELS;
            let stated = f64::from(stated[0]) * GREY_LEVELS;
            is_above |= off > stated + LEAST || stated.is_nan();
            self.largest_true = self.largest_true.max(off);
            self.largest_stated = self.largest_stated.max(stated);
            if off > LEAST {
                self.errors.push([off, stated]);
            }
        }
        if is_above {
            self.scenes_above.push(number);
        }
    }

    /// Statistics of the collected pixels.
    #[must_use]
    pub fn finish(self) -> AtLevel {
        let median = |of: &dyn Fn(&[f64; 2]) -> f64| {
            let mut sorted: Vec<f64> = self.errors.iter().map(of).collect();
            sorted.sort_by(f64::total_cmp);
            sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
        };
        let bounded = self.errors.iter().filter(|[_, stated]| *stated < NO_BOUND).count();
        AtLevel {
            level: self.level,
            asked_grey_levels: self.asked,
            largest_true_grey_levels: self.largest_true,
            largest_stated_grey_levels: self.largest_stated,
            pixels: self.errors.len() as u64,
            largest_share_of_stated: self.errors.iter().map(|[off, stated]| off / stated).fold(0.0, f64::max),
            median_stated_over_true: median(&|[off, stated]| stated / off),
            median_true_grey_levels: median(&|[off, _]| *off),
            median_stated_grey_levels: median(&|[_, stated]| *stated),
            share_with_a_bound: bounded as f64 / self.errors.len().max(1) as f64,
            scenes_above_stated: self.scenes_above,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_that_are_farther_off_than_is_stated_are_found() {
        let image = |values: [f32; 3]| Image { width: 3, height: 1, pixels: values.map(|v| [v; 4]).to_vec() };
        let (exact, picture) = (image([0.0, 0.5, 1.0]), image([0.0, 0.4, 0.8]));
        let mut pixels = Pixels::new(1, 0.5);
        pixels.add(4, &picture, &exact, &image([0.0, 0.2, 0.25]));
        assert!(pixels.scenes_above.is_empty());
        pixels.add(5, &picture, &exact, &image([0.0, 0.05, 1.0]));
        let found = pixels.finish();
        assert_eq!((found.pixels, found.scenes_above_stated.as_slice()), (4, &[5u64][..]));
        assert!((found.largest_true_grey_levels - 51.0).abs() < 1e-4, "{found:?}");
        assert!((found.largest_share_of_stated - 2.0).abs() < 1e-5 && found.share_with_a_bound == 0.75, "{found:?}");
        assert!((found.median_stated_over_true - 2.0).abs() < 1e-5, "{found:?}");
        let mut none = Pixels::new(1, 0.5);
        none.add(6, &image([f32::NAN; 3]), &exact, &image([0.5; 3]));
        assert_eq!(none.finish().scenes_above_stated, [6]);
    }
}
