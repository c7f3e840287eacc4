//! A picture by a deadline, on the CPU: ever smaller pixels, until the time is up.
//!
//! ```text
//! sketch: large pixels, the coarsest level --> smaller pixels, finer levels --> ... --> the picture that is wanted
//! ```
//!
//! The sketch is always finished. Each later picture begins as the last one, enlarged, and its tiles are written over as they
//! are finished; levels follow the size of its pixels, so that it takes some eight times as long as one of pixels twice as
//! large. How long the last one took says which are left out. When the time is up, rays stop between two bricks: what has been
//! finished stands, the rest is what the picture before shows there ([`FrameStats::pixels_unfinished`]).

use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::{Container, Lod};

use super::caster::CpuCaster;
use super::{FrameWalk, LevelChoice, RenderError, RenderOptions, classifier_for, cpu_frame, streamer_for};
use crate::image::Image;
use crate::lod::by_error::ANY_ERROR;
use crate::scene::ResolvedScene;
use crate::stats::FrameStats;
use crate::streamer::budget::HostPlan;

/// Rays of a sketch, at most: some milliseconds.
const SKETCH_RAYS: u64 = 8192;
/// A picture of half as large pixels takes so many times as long: four times the rays, through twice the cells.
const TIME_PER_HALVING: f64 = 8.0;
/// The picture that is wanted takes so many times as long as one whose levels follow the size of its pixels alone.
const TIME_PER_ERROR: f64 = 1.5;
/// Share of the time left that a picture may be expected to take.
const LEAST_SURE_SHARE: f64 = 0.6;

/// Makes the picture, or as much of it as there is time for.
///
/// # Errors
/// As [`super::render`].
pub fn render_until(
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions<'_>,
    plan: HostPlan,
    start: Instant,
    budget: Duration,
) -> Result<(Image, FrameStats), RenderError> {
    let deadline = start + budget;
    let mut pixel = sketch_pixel(scene);
    let sketch = with_pixels(scene, pixel);
    let sketch_options = RenderOptions { time_budget_ms: Some(0), ..options_for(container, options, pixel) };
    let mut streamer = streamer_for(container, &sketch, &sketch_options, plan);
    let mut walk = FrameWalk::new(&mut streamer, plan, &sketch_options, start);
    let mut began = Instant::now();
    let mut picture =
        walk.run(&mut CpuCaster::new(cpu_frame(container, &sketch, &sketch_options, &plan)), sketch.image_size)?;
    let mut stats = walk.into_stats();
    // Pixels of the wanted picture that are finished, and what the others are taken from.
    let (mut finished, mut coarsest) = (0, pixel);
    let mut is_last = false;
    while !is_last && Instant::now() < deadline {
        let next = next_pixel(pixel, began.elapsed(), deadline.saturating_duration_since(Instant::now()));
        is_last = next == 1;
        let finer = with_pixels(scene, next);
        let finer_options = options_for(container, options, next);
        streamer.set_classifier(classifier_for(container, &finer, &finer_options));
        began = Instant::now();
        picture = picture.enlarged(pixel / next, finer.image_size);
        let mut caster = CpuCaster::new(cpu_frame(container, &finer, &finer_options, &plan).until(deadline));
        let mut walk = FrameWalk::new(&mut streamer, plan, &finer_options, start).until(deadline, stats);
        let written = walk.run_over(&mut caster, &mut picture)?;
        stats = walk.into_stats();
        coarsest = if written < picture.pixels.len() as u64 { pixel } else { next };
        finished = if is_last { written } else { 0 };
        pixel = next;
    }
    picture = picture.enlarged(pixel, scene.image_size);
    stats.pixels_unfinished = picture.pixels.len() as u64 - finished;
    if stats.pixels_unfinished > 0 {
        stats.coarsest_pixel = coarsest;
        stats.converged = false;
        // What a coarser picture is off by, nobody has summed up.
        stats.error_predicted = None;
    }
    Ok((picture, FrameStats { backend: "cpu", ..stats }))
}

/// How many pixels along an edge a pixel of the sketch covers: a power of two.
fn sketch_pixel(scene: &ResolvedScene) -> u32 {
    let [width, height] = scene.image_size;
    let rays = |pixel: u32| u64::from(width.div_ceil(pixel)) * u64::from(height.div_ceil(pixel));
    (0..16).map(|k| 1 << k).find(|&pixel| rays(pixel) <= SKETCH_RAYS).unwrap_or(1 << 16)
}

/// The smallest pixels whose picture there is likely time for, after one of these that took so long; at least half as large
/// ones.
fn next_pixel(pixel: u32, took: Duration, left: Duration) -> u32 {
    let expected = |next: u32| {
        let halvings = (pixel / next).ilog2();
        let error = if next == 1 { TIME_PER_ERROR } else { 1.0 };
        took.mul_f64(error * TIME_PER_HALVING.powi(halvings as i32))
    };
    let sure = left.mul_f64(LEAST_SURE_SHARE);
    let half = (pixel / 2).max(1);
    (0..=half.ilog2()).map(|k| 1 << k).find(|&next| expected(next) <= sure).unwrap_or(half)
}

/// The scene seen through pixels that cover so many along an edge; the scene itself for 1.
fn with_pixels(scene: &ResolvedScene, pixel: u32) -> ResolvedScene {
    if pixel == 1 {
        return scene.clone();
    }
    let camera = scene.camera.coarser(scene.subgrid * pixel);
    ResolvedScene { camera, image_size: [camera.width, camera.height], subgrid: 1, ..scene.clone() }
}

/// What such a picture is made with: what was asked for where pixels have their size.
fn options_for<'a>(container: &Container, options: &RenderOptions<'a>, pixel: u32) -> RenderOptions<'a> {
    if pixel == 1 {
        return options.clone();
    }
    let level = match options.level {
        LevelChoice::Auto => LevelChoice::Auto,
        LevelChoice::Fixed(lod) => {
            let coarser = lod.0.saturating_add(pixel.ilog2() as u8);
            LevelChoice::Fixed(Lod(coarser).min(container.pyramid().coarsest()))
        }
    };
    RenderOptions { level, max_error: ANY_ERROR, predict_error: false, ..options.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_that_there_is_time_for_anyway_are_left_out() {
        let ms = Duration::from_millis;
        // 8^3 times 10 ms and half as much again for the picture itself.
        assert_eq!(next_pixel(8, ms(10), ms(20_000)), 1);
        assert_eq!(next_pixel(8, ms(10), ms(12_000)), 2);
        assert_eq!(next_pixel(8, ms(10), ms(1_000)), 4);
        assert_eq!(next_pixel(8, ms(10), ms(1)), 4, "the next one, as far as it comes");
        assert_eq!(next_pixel(2, ms(1_000), ms(0)), 1);
        assert_eq!(next_pixel(1, ms(1_000), ms(0)), 1);
    }
}
