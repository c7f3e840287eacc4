//! Measured error of a finished picture: the reference integrator casts sample pixels again.
//!
//! The exact picture is that of one level, wholly in memory (see [`super::reference`]). The picture is divided into a
//! grid of fields of nearly equal size, and one pixel is chosen at random in each. So no pixel is chosen twice, and the
//! samples are spread evenly.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use serde::Serialize;
use supervol_format::cast::{narrow, whole};
use supervol_format::random::Random;
use supervol_format::{Container, Lod};
use supervol_scene::image::{GREY_LEVELS, Image, greatest};
use supervol_scene::scene::ResolvedScene;

use super::reference::{load_level, reference_bytes, scene_of_level};
use crate::engines::reference::ReferenceCaster;
use crate::render::error::RenderError;
use crate::render::options::{LevelChoice, RenderOptions};
use crate::stream::counters::milliseconds;

/// Seed of the choice of pixels.
pub const SEED: u64 = 20_261_121;
/// The percentile of `p999_grey_levels`, as a share.
const PERCENTILE: f64 = 0.999;

/// Differences between a picture and the exact one, over all channels (premultiplied red, green, blue, and opacity) of
/// the sample pixels. A grey level is 1/255 of full scale.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ErrorMeasured {
    /// Reference rays cast: number of sample pixels times samples per pixel.
    pub rays: u64,
    /// Sample pixels.
    pub pixels: u64,
    /// The level whose exact picture was compared.
    pub level: u8,
    /// Largest absolute difference of a channel; infinite (in JSON: null) if one is not a number.
    pub largest_grey_levels: f64,
    /// 99.9th percentile of the absolute differences.
    pub p999_grey_levels: f64,
    /// Mean difference, picture minus exact picture.
    pub mean_grey_levels: f64,
    /// Intervals at which the reference integrator did not converge.
    pub capped_pieces: u64,
    /// Seed of the choice of pixels.
    pub seed: u64,
    /// Wall time of the check, reading of the level included.
    pub check_ms: f64,
}

/// Progress of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CheckProgress {
    /// Pixels cast.
    pub pixels_done: u64,
    /// Pixels to cast.
    pub pixels: u64,
}

/// The level whose exact picture a frame is compared with: the requested level. The finest one if levels are chosen
/// brick by brick, because their bricks stand in for that level.
#[must_use]
pub fn level_to_check(container: &Container, level: LevelChoice) -> Lod {
    match level {
        LevelChoice::Auto => Lod::FINEST,
        LevelChoice::Fixed(lod) => lod.min(container.pyramid().coarsest()),
    }
}

/// Checks, before anything is drawn, whether the level that [`measure_error`] needs fits the host budget.
///
/// # Errors
/// [`RenderError::CheckTooLarge`], with the finest level that would fit.
pub fn check_fits(container: &Container, scene: &ResolvedScene, options: &RenderOptions) -> Result<(), RenderError> {
    let lod = level_to_check(container, options.level);
    let (needed_bytes, budget_bytes) = (reference_bytes(container, lod, scene), options.host_memory_bytes);
    if needed_bytes <= budget_bytes {
        return Ok(());
    }
    let coarser = (lod.0 + 1..=container.pyramid().coarsest().0).map(Lod);
    let fits = coarser.into_iter().find(|&coarser| reference_bytes(container, coarser, scene) <= budget_bytes);
    Err(RenderError::CheckTooLarge {
        level: lod.0,
        needed_bytes,
        budget_bytes,
        finest_that_fits: fits.map(|lod| lod.0),
    })
}

/// Casts about `rays` rays of a picture of `scene` again with the reference integrator, and compares. Runs on as many
/// threads as the frame; `progress` is called from any of them.
///
/// # Errors
/// If the level does not fit the host budget, threads cannot be started, or a brick cannot be read.
pub fn measure_error(
    container: &Container,
    scene: &ResolvedScene,
    options: &RenderOptions,
    image: &Image,
    rays: u64,
    progress: &(dyn Fn(CheckProgress) + Sync),
) -> Result<ErrorMeasured, RenderError> {
    let start = Instant::now();
    check_fits(container, scene, options)?;
    let lod = level_to_check(container, options.level);
    let rays_per_pixel = u64::from(scene.subgrid) * u64::from(scene.subgrid);
    let pixels = spread_pixels([image.width, image.height], rays.div_ceil(rays_per_pixel), SEED);
    let Exact { pixels: exact, capped_pieces } = cast_again(container, lod, scene, options, &pixels, progress)?;
    let found = |[x, y]: [u32; 2]| image.pixels[y as usize * image.width as usize + x as usize];
    let differences: Vec<f64> = pixels
        .iter()
        .zip(&exact)
        .flat_map(|(&pixel, exact)| {
            let found = found(pixel);
            [0, 1, 2, 3].map(|c| GREY_LEVELS * (f64::from(found[c]) - f64::from(exact[c])))
        })
        .collect();
    Ok(ErrorMeasured {
        rays: pixels.len() as u64 * rays_per_pixel,
        pixels: pixels.len() as u64,
        level: lod.0,
        largest_grey_levels: greatest(differences.iter().copied()),
        p999_grey_levels: percentile(&differences),
        mean_grey_levels: differences.iter().sum::<f64>() / differences.len() as f64,
        capped_pieces,
        seed: SEED,
        check_ms: milliseconds(start.elapsed()),
    })
}

/// Exact pixels of a picture.
#[derive(Debug)]
pub(super) struct Exact {
    /// Premultiplied red, green, blue and opacity before the background.
    pub pixels: Vec<[f32; 4]>,
    /// Intervals at which the reference integrator did not converge.
    pub capped_pieces: u64,
}

/// Casts pixels (column, row) of a scene by the reference integrator in one level, which fits the host budget.
pub(super) fn cast_again(
    container: &Container,
    lod: Lod,
    scene: &ResolvedScene,
    options: &RenderOptions,
    pixels: &[[u32; 2]],
    progress: &(dyn Fn(CheckProgress) + Sync),
) -> Result<Exact, RenderError> {
    options.thread_pool()?.install(|| {
        let volume = load_level(container, lod, scene, options.host_memory_bytes)?;
        let scene = scene_of_level(container, lod, scene);
        let caster = ReferenceCaster::new(&volume, &scene);
        let done = AtomicU64::new(0);
        let exact = caster.pixels(pixels, &|| {
            let pixels_done = done.fetch_add(1, Ordering::Relaxed) + 1;
            progress(CheckProgress { pixels_done, pixels: pixels.len() as u64 });
        });
        Ok(Exact { pixels: exact, capped_pieces: caster.capped_pieces() })
    })
}

/// The absolute difference that 99.9 % of the differences do not exceed.
fn percentile(differences: &[f64]) -> f64 {
    let mut sizes: Vec<f64> = differences.iter().map(|&d| greatest([d])).collect();
    sizes.sort_by(f64::total_cmp);
    let rank = whole::<usize>((sizes.len() as f64 * PERCENTILE).ceil());
    sizes[rank.clamp(1, sizes.len()) - 1]
}

/// `count` different pixels of a picture, or all of them if it has fewer; at least one.
pub(super) fn spread_pixels([width, height]: [u32; 2], count: u64, seed: u64) -> Vec<[u32; 2]> {
    let (w, h) = (u64::from(width), u64::from(height));
    let count = count.clamp(1, w * h);
    // Fields are as square as the picture allows; more columns if that gives too few fields.
    let columns = whole::<u64>((count as f64 * w as f64 / h as f64).sqrt().ceil()).clamp(count.div_ceil(h), w);
    let rows = count.div_ceil(columns);
    let mut random = Random::new(seed);
    (0..count)
        .map(|i| {
            // If the grid has more fields than needed, the skipped ones are spread as well.
            let field = (2 * i + 1) * rows * columns / (2 * count);
            let mut within = |i: u64, fields: u64, size: u64| {
                let (low, high) = (i * size / fields, (i + 1) * size / fields);
                narrow::<u32>(low + random.below(high - low))
            };
            [within(field % columns, columns, w), within(field / columns, rows, h)]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn pixels_are_different_and_spread() {
        for size in [[1, 1], [1, 500], [500, 1], [7, 3], [40, 30], [1024, 768]] {
            let all = u64::from(size[0]) * u64::from(size[1]);
            for count in [0, 1, 2, 9, 20, 100, 1000, all - 1, all, all + 5] {
                let pixels = spread_pixels(size, count, SEED);
                assert_eq!(pixels.len() as u64, count.clamp(1, all), "{count} of {size:?}");
                assert!(pixels.iter().all(|p| p[0] < size[0] && p[1] < size[1]), "{count} of {size:?}: {pixels:?}");
                let different: BTreeSet<[u32; 2]> = pixels.iter().copied().collect();
                assert_eq!(different.len(), pixels.len(), "{count} of {size:?}: a pixel comes twice");
            }
        }
        // A quarter of the picture gets a quarter of the rays.
        let pixels = spread_pixels([1024, 768], 1000, SEED);
        for quarter in 0..4 {
            let is_inside = |p: &&[u32; 2]| (p[0] >= 512) == (quarter & 1 == 1) && (p[1] >= 384) == (quarter >> 1 == 1);
            let share = pixels.iter().filter(is_inside).count();
            assert!((230..=270).contains(&share), "quarter {quarter}: {share} of 1000");
        }
        assert_ne!(spread_pixels([64, 64], 100, SEED), spread_pixels([64, 64], 100, SEED + 1));
    }

    #[test]
    fn the_percentile_leaves_one_in_a_thousand_out() {
        let differences: Vec<f64> = (1..=2000).map(|i| if i % 2 == 0 { f64::from(i) } else { -f64::from(i) }).collect();
        assert_eq!(percentile(&differences), 1998.0);
        assert_eq!(percentile(&[f64::NAN]), f64::INFINITY);
    }
}
