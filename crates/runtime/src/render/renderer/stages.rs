//! A picture by a GPU and a deadline: large pixels first, then as small ones as there is time for.
//!
//! A sketch is always finished, from the bricks that are there and the coarsest level. Pictures of smaller pixels follow while
//! there is time; rays that stop when it is up go on when the same scene is drawn next.
//!
//! Graphics hardware may draw a whole picture in less time than there is. What pictures took is remembered from scene to scene there
//! ([`Pace`]), and the first one has pixels as small as there was time for last time; bricks are waited for until it must be begun.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use super::drawing::{LEAST_SURE_SHARE, next_pixel, options_for, sketch_pixel, with_pixels};
use super::resident::Resident;
use crate::engines::gpu::device::GpuDevice;
use crate::engines::maps::Maps;
use crate::engines::totals::ErrorsByReason;
use crate::render::error::RenderError;
use crate::render::frame::gpu::GpuBackend;
use crate::render::frame::on_device::{GpuDrawn, GpuPicture};
use crate::render::frame::stated::{ErrorStated, complete};
use crate::render::options::RenderOptions;
use crate::render::stats::FrameStats;
use crate::stop::{LEAST_STEP, Stop};

/// The best picture of a scene so far.
#[derive(Debug, Clone)]
pub struct Best {
    /// As large as it is wanted, once [`draw`] hands it over.
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

/// What pictures took, but for fetching bricks, by the size of their pixels, when they were drawn last.
#[derive(Debug, Default)]
pub struct Pace {
    /// Of the whole picture.
    size: [u32; 2],
    took: BTreeMap<u32, Duration>,
}

impl Pace {
    fn note(&mut self, size: [u32; 2], pixel: u32, took: Duration) {
        if self.size != size {
            *self = Self { size, took: BTreeMap::new() };
        }
        self.took.insert(pixel, took);
    }

    /// The smallest pixels whose picture there is time for, and what it took, if any is known.
    fn fitting(&self, size: [u32; 2], left: Duration) -> Option<(u32, Duration)> {
        let sure = left.mul_f64(LEAST_SURE_SHARE);
        let fitting = self.took.iter().find(|(_, took)| **took <= sure).filter(|_| self.size == size);
        fitting.map(|(pixel, took)| (*pixel, *took))
    }
}

/// A device, and how fast it is.
pub struct Device {
    /// The device, and what it holds.
    pub backend: GpuBackend,
    pace: Pace,
}

impl Device {
    /// Nothing is known of it yet.
    #[must_use]
    pub fn new(device: GpuDevice) -> Self {
        Self { backend: GpuBackend::new(device), pace: Pace::default() }
    }
}

/// The first picture of a scene that has a deadline: its pixels, and until when bricks are waited for.
fn first_picture(Device { backend, pace }: &Device, scene: &ResolvedScene, deadline: Instant) -> (u32, Instant) {
    let now = Instant::now();
    // What software adapters take varies too much: nothing stops a picture that is to be completed.
    let known = pace
        .fitting(scene.image_size, deadline.saturating_duration_since(now))
        .filter(|_| !backend.device().deals_as_software());
    match known {
        Some((pixel, took)) => (pixel, deadline.checked_sub(took.div_f64(LEAST_SURE_SHARE)).unwrap_or(now)),
        None => (sketch_pixel(scene), now),
    }
}

/// Makes the picture better while there is time; without a deadline, until it is finished.
///
/// # Errors
/// As any picture; [`RenderError::Cancelled`] where there is none yet.
pub fn draw(
    device: &mut Device,
    resident: &mut Resident,
    scene: &ResolvedScene,
    options: &RenderOptions,
    stop: &Stop,
    best: Option<Best>,
) -> Result<Best, RenderError> {
    let (mut best, stop) = match (best, stop.deadline()) {
        // However short steps are, each comes some way.
        (Some(best), _) => (best, stop.not_before(Instant::now() + LEAST_STEP)),
        (None, Some(deadline)) => {
            let (pixel, latest) = first_picture(device, scene, deadline);
            let in_time = stop.instead_at(Some(latest));
            let begun = Begun { pixel, is_paused_when_due: false, before: FrameStats::default() };
            (stage(device, resident, scene, options, &in_time, begun)?, stop.clone())
        }
        (None, None) => {
            let begun = Begun { pixel: 1, is_paused_when_due: true, before: FrameStats::default() };
            return stage(device, resident, scene, options, stop, begun);
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
        match stage(device, resident, scene, options, &stop, begun) {
            Ok(better) => {
                let before = std::mem::replace(&mut best, better).image;
                if before.pixels.len() as u64 == scene.pixels() {
                    device.backend.take_back(before);
                }
            }
            Err(RenderError::Cancelled) => best.begun = Some(pixel),
            Err(error) => return Err(error),
        }
        if best.pixel == 1 && best.begun.is_none() {
            break;
        }
    }
    let is_small = [best.image.width, best.image.height] != scene.image_size;
    if is_small {
        best.image = device.backend.enlarged(best.image, best.pixel, scene.image_size);
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
    device: &mut Device,
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
    let GpuDrawn { image, mut stats, maps, errors: by_reason, fetching } =
        device.backend.draw(resident.streamer(), &picture, &GpuDevice::open)?;
    if pixel > 1 {
        stats.converged = false;
        (stats.pixels_unfinished, stats.coarsest_pixel) = (scene.pixels(), pixel);
    } else {
        (stats.pixels_unfinished, stats.coarsest_pixel) = (0, 0);
    }
    let took = began.elapsed();
    device.pace.note(scene.image_size, pixel, took.saturating_sub(fetching));
    // Of pixels that are taken from larger ones nothing is known.
    let (errors, by_reason) = match pixel {
        1 => (maps.errors, by_reason),
        _ => (maps.errors.map(|_| Image::unknown(scene.image_size)), ErrorsByReason::default()),
    };
    Ok(Best { image, stats, pixel, begun: None, took, errors, by_reason })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_pixels_that_fit_are_taken_first() {
        let ms = Duration::from_millis;
        let (size, mut pace) = ([1920, 1080], Pace::default());
        assert_eq!(pace.fitting(size, ms(1_000)), None);
        [(16, 2), (8, 3), (4, 4), (1, 9)].into_iter().for_each(|(pixel, took)| pace.note(size, pixel, ms(took)));
        assert_eq!(pace.fitting(size, ms(16)), Some((1, ms(9))));
        assert_eq!(pace.fitting(size, ms(14)), Some((4, ms(4))), "9 of 14 ms are not sure enough");
        assert_eq!(pace.fitting(size, ms(1)), None);
        pace.note(size, 1, ms(30));
        assert_eq!(pace.fitting(size, ms(16)), Some((4, ms(4))), "what it took last");
        assert_eq!(pace.fitting([64, 64], ms(16)), None, "another picture");
        pace.note([64, 64], 2, ms(1));
        assert_eq!(pace.fitting(size, ms(1_000)), None, "one size is remembered");
    }
}
