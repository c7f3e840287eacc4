//! A stage: the picture of one pixel size, and the canvas that it is drawn on.

use std::time::{Duration, Instant};

use supervol_format::cast::narrow;
use supervol_format::{Container, Lod};
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use super::device::LEAST_SURE_SHARE;
use super::means::Tools;
use crate::engines::maps::{AskedMaps, Maps};
use crate::engines::totals::ErrorsByReason;
use crate::lod::by_error::ANY_ERROR;
use crate::render::error::RenderError;
use crate::render::options::{LevelChoice, RenderOptions};
use crate::render::stats::FrameStats;
use crate::stop::Stop;

/// Most rays of a sketch: some milliseconds.
pub(super) const SKETCH_RAYS: u64 = 8192;
/// Time factor for half the pixel size: four times the rays, through twice the cells.
const TIME_PER_HALVING: f64 = 8.0;
/// Time factor of the requested picture over one whose levels follow the pixel size alone.
const TIME_PER_ERROR: f64 = 1.5;

/// The picture as far as it has come, with all that is known of it.
pub(super) struct Canvas {
    /// The requested picture's scene.
    pub(super) scene: ResolvedScene,
    /// The best picture so far; NaN where nothing is known.
    pub(super) picture: Option<Image>,
    /// Edge of a pixel of `picture`, in pixels of the requested picture.
    pub(super) pixel: u32,
    /// The last finished stage and its pixel size, while the next one is cast, if only whole stages are shown.
    pub(super) whole: Option<(Image, u32)>,
    /// Pixel size of the picture that unfinished pixels are taken from; `None` if nothing is known of them.
    pub(super) behind: Option<u32>,
    /// Maps of the pixels of the requested picture; NaN where they are not finished.
    pub(super) maps: Maps,
    /// Errors of its rays, by reason.
    pub(super) by_reason: ErrorsByReason,
    /// Finished pixels of the requested picture.
    pub(super) finished: u64,
    /// Those of them that may be off by more than requested, and are cast again.
    pub(super) above: u64,
    /// Statistics of all stages.
    pub(super) stats: FrameStats,
}

/// A stage that begins or is paused.
#[derive(Debug, Clone, Copy)]
pub(super) struct Begun {
    /// Edge of a pixel, in pixels of the requested picture.
    pub(super) pixel: u32,
    /// Time of earlier steps.
    pub(super) spent: Duration,
}

/// Result of casting the rays of a stage.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Cast {
    /// Whether the stage is finished; else its rays are paused.
    pub(super) is_finished: bool,
    /// Time of the stage, including earlier steps.
    pub(super) took: Duration,
    /// Whether this time says how long the next stage takes: it does not if the stage waited for bricks.
    pub(super) is_typical: bool,
}

/// Casts the rays of stages.
pub(super) trait StageCaster: Send + Sync {
    /// Name in the statistics.
    fn backend(&self) -> &'static str;

    /// The maps that it can make, of those that the options ask for.
    fn maps(&self, options: &RenderOptions) -> AskedMaps;

    /// Whether the rays of a paused stage are still there after a sketch.
    fn keeps_rays_over_sketch(&self) -> bool;

    /// Pixel size of the first picture with this deadline, and the time until which it may wait for bricks.
    fn first(&self, scene: &ResolvedScene, tools: &mut Tools<'_>, deadline: Instant) -> (u32, Instant);

    /// Draws the first picture onto an empty canvas. It is always finished: rays do not wait after the deadline of `stop`.
    ///
    /// # Errors
    /// As [`Drawing::advance`](super::Drawing::advance).
    fn sketch(
        &mut self,
        canvas: &mut Canvas,
        pixel: u32,
        tools: &mut Tools<'_>,
        stop: &Stop,
    ) -> Result<Cast, RenderError>;

    /// Draws the picture of one pixel size over the canvas, or continues it, until `stop` is due.
    ///
    /// # Errors
    /// As [`Drawing::advance`](super::Drawing::advance).
    fn cast(
        &mut self,
        canvas: &mut Canvas,
        stage: Begun,
        tools: &mut Tools<'_>,
        stop: &Stop,
    ) -> Result<Cast, RenderError>;

    /// Prepares the canvas for being shown, after the last stage of a step.
    fn show(&mut self, _canvas: &mut Canvas, _tools: &mut Tools<'_>) {}
}

impl Canvas {
    /// An empty canvas.
    pub(super) fn new(scene: ResolvedScene) -> Self {
        Self {
            scene,
            picture: None,
            pixel: 1,
            whole: None,
            behind: None,
            maps: Maps::default(),
            by_reason: ErrorsByReason::default(),
            finished: 0,
            above: 0,
            stats: FrameStats::default(),
        }
    }
}

impl Canvas {
    /// The picture that is shown, and its pixel size.
    pub(super) fn shown(&self) -> Option<(&Image, u32)> {
        let whole = self.whole.as_ref().map(|(picture, pixel)| (picture, *pixel));
        whole.or_else(|| Some((self.picture.as_ref()?, self.pixel)))
    }
}

/// Edge of a pixel of the sketch, in pixels of the picture: a power of two.
pub(crate) fn sketch_pixel(scene: &ResolvedScene) -> u32 {
    let [width, height] = scene.image_size;
    let rays = |pixel: u32| u64::from(width.div_ceil(pixel)) * u64::from(height.div_ceil(pixel));
    (0..16).map(|k| 1 << k).find(|&pixel| rays(pixel) <= SKETCH_RAYS).unwrap_or(1 << 16)
}

/// The smallest pixel size whose picture likely fits into the time left, given that the last size took `took`. At most
/// half the last size.
pub(super) fn next_pixel(pixel: u32, took: Duration, left: Duration) -> u32 {
    let expected = |next: u32| {
        let halvings = (pixel / next).ilog2();
        let error = if next == 1 { TIME_PER_ERROR } else { 1.0 };
        took.mul_f64(error * TIME_PER_HALVING.powi(narrow::<i32>(halvings)))
    };
    let sure = left.mul_f64(LEAST_SURE_SHARE);
    let half = (pixel / 2).max(1);
    (0..=half.ilog2()).map(|k| 1 << k).find(|&next| expected(next) <= sure).unwrap_or(half)
}

/// The scene with pixels `pixel` times as large along an edge; the scene itself for 1.
pub(crate) fn with_pixels(scene: &ResolvedScene, pixel: u32) -> ResolvedScene {
    if pixel == 1 {
        return scene.clone();
    }
    let camera = scene.camera.coarser(scene.subgrid * pixel);
    ResolvedScene { camera, image_size: [camera.width, camera.height], subgrid: 1, ..scene.clone() }
}

/// Options of such a stage: the requested options for pixel size 1.
pub(super) fn options_for(container: &Container, options: &RenderOptions, pixel: u32) -> RenderOptions {
    if pixel == 1 {
        return options.clone();
    }
    let level = match options.level {
        LevelChoice::Auto => LevelChoice::Auto,
        LevelChoice::Fixed(lod) => {
            let coarser = lod.0.saturating_add(narrow::<u8>(pixel.ilog2()));
            LevelChoice::Fixed(Lod(coarser).min(container.pyramid().coarsest()))
        }
    };
    RenderOptions { level, max_error: ANY_ERROR, predict_error: false, count_work: false, ..options.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_that_there_is_time_for_anyway_are_left_out() {
        let ms = Duration::from_millis;
        // 8^3 times 10 ms, and half as much again for the requested picture itself.
        assert_eq!(next_pixel(8, ms(10), ms(20_000)), 1);
        assert_eq!(next_pixel(8, ms(10), ms(12_000)), 2);
        assert_eq!(next_pixel(8, ms(10), ms(1_000)), 4);
        assert_eq!(next_pixel(8, ms(10), ms(1)), 4, "the next one, as far as it comes");
        assert_eq!(next_pixel(2, ms(1_000), ms(0)), 1);
        assert_eq!(next_pixel(1, ms(1_000), ms(0)), 1);
    }
}
