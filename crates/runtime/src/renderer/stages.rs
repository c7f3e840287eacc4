//! A picture by a GPU and a deadline: large pixels first, then as small ones as there is time for.
//!
//! A sketch is always finished, from the bricks that are there and the coarsest level. Pictures of smaller pixels follow while
//! there is time; rays that stop when it is up go on when the same scene is drawn next.

use std::time::{Duration, Instant};

use super::drawing::{next_pixel, options_for, sketch_pixel, with_pixels};
use super::resident::Resident;
use crate::frame::gpu::{GpuBackend, GpuDrawn, GpuPicture};
use crate::frame::maps::Maps;
use crate::frame::stated::{ErrorStated, complete};
use crate::frame::{RenderError, RenderOptions};
use crate::image::Image;
use crate::raycast::cpu::levels::ErrorsByReason;
use crate::raycast::gpu::GpuDevice;
use crate::scene::ResolvedScene;
use crate::stats::FrameStats;
use crate::stop::{LEAST_STEP, Stop};

/// The best picture of a scene so far.
#[derive(Debug, Clone)]
pub struct Best {
    /// As large as it is wanted.
    pub image: Image,
    /// What it and those before it have cost.
    pub stats: FrameStats,
    /// How many pixels along an edge one of its pixels covers.
    pixel: u32,
    /// The size of pixels that was begun and is not finished.
    begun: Option<u32>,
    took: Duration,
    /// What its pixels may be off by, where that is asked for; NaN where nothing is known.
    errors: Option<Image>,
    /// What its rays may be off by, reason by reason.
    by_reason: ErrorsByReason,
}

impl Best {
    /// What each pixel may be off by, grey, 1 being white, where that is asked for.
    #[must_use]
    pub fn error_map(&self) -> Option<Image> {
        Some(complete(self.errors.clone()?, &self.image))
    }

    /// The same in numbers.
    #[must_use]
    pub fn error_stated(&self) -> Option<ErrorStated> {
        let unknown = self.stats.pixels_unfinished;
        Some(ErrorStated::of(self.errors.as_ref()?, &self.image, self.by_reason, unknown))
    }

    /// The picture, and the map.
    #[must_use]
    pub fn into_pictures(self) -> (Image, Maps) {
        let errors = self.errors.map(|known| complete(known, &self.image));
        (self.image, Maps { errors, work: None })
    }
}

/// Makes the picture better while there is time; without a deadline, until it is finished.
///
/// # Errors
/// As any picture; [`RenderError::Cancelled`] where there is none yet.
pub fn draw(
    backend: &mut GpuBackend,
    resident: &mut Resident,
    scene: &ResolvedScene,
    options: &RenderOptions,
    stop: &Stop,
    best: Option<Best>,
) -> Result<Best, RenderError> {
    let (mut best, stop) = match (best, stop.deadline()) {
        // However short steps are, each comes some way.
        (Some(best), _) => (best, stop.not_before(Instant::now() + LEAST_STEP)),
        (None, Some(_)) => {
            let (began, pixel) = (Instant::now(), sketch_pixel(scene));
            let at_once = stop.instead_at(Some(began));
            let begun = Begun { pixel, is_paused_when_due: false, before: FrameStats::default() };
            (stage(backend, resident, scene, options, &at_once, begun)?, stop.clone())
        }
        (None, None) => {
            let begun = Begun { pixel: 1, is_paused_when_due: true, before: FrameStats::default() };
            return stage(backend, resident, scene, options, stop, begun);
        }
    };
    while !best.stats.converged && !stop.is_due() {
        let left = stop.deadline().map(|deadline| deadline.saturating_duration_since(Instant::now()));
        let pixel = match (left, best.begun) {
            (None, _) => 1,
            (Some(_), Some(begun)) => begun,
            (Some(left), None) => next_pixel(best.pixel, best.took, left),
        };
        let begun = Begun { pixel, is_paused_when_due: true, before: best.stats.clone() };
        match stage(backend, resident, scene, options, &stop, begun) {
            Ok(better) => best = better,
            Err(RenderError::Cancelled) => best.begun = Some(pixel),
            Err(error) => return Err(error),
        }
        if best.pixel == 1 && best.begun.is_none() {
            break;
        }
    }
    Ok(best)
}

/// What a picture is begun with.
struct Begun {
    pixel: u32,
    /// Whether its rays stop when it is time to; if not, it is completed from what is there.
    is_paused_when_due: bool,
    before: FrameStats,
}

/// The picture of pixels of one size.
fn stage(
    backend: &mut GpuBackend,
    resident: &mut Resident,
    scene: &ResolvedScene,
    options: &RenderOptions,
    stop: &Stop,
    begun: Begun,
) -> Result<Best, RenderError> {
    let began = Instant::now();
    let Begun { pixel, is_paused_when_due, before } = begun;
    let room = ([scene.camera.width, scene.camera.height], options.predict_error);
    // Shaders that sum up errors are others: whoever wants that of the last picture has all drawn by the same.
    let options =
        RenderOptions { predict_error: options.predict_error, ..options_for(resident.container(), options, pixel) };
    let seen = with_pixels(scene, pixel);
    resident.aim(&seen, &options);
    let plan = resident.plan();
    let picture = GpuPicture { scene: &seen, options: &options, plan, stop, is_paused_when_due, before, room };
    let GpuDrawn { image, mut stats, maps, errors: by_reason } =
        backend.draw(resident.streamer(), &picture, &GpuDevice::open)?;
    if pixel > 1 {
        stats.converged = false;
        (stats.pixels_unfinished, stats.coarsest_pixel) = (scene.pixels(), pixel);
    } else {
        (stats.pixels_unfinished, stats.coarsest_pixel) = (0, 0);
    }
    let image = image.enlarged(pixel, scene.image_size);
    // Of pixels that are taken from larger ones nothing is known.
    let (errors, by_reason) = match pixel {
        1 => (maps.errors, by_reason),
        _ => (maps.errors.map(|_| Image::unknown(scene.image_size)), ErrorsByReason::default()),
    };
    Ok(Best { image, stats, pixel, begun: None, took: began.elapsed(), errors, by_reason })
}
