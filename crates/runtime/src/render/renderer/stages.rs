//! Progressive picture by a GPU with a deadline: large pixels first, then smaller ones as time allows.
//!
//! A sketch is always finished, from resident bricks and the coarsest level. Pictures of smaller pixels follow while
//! there is time. Rays that pause at the deadline continue when the same scene is drawn next.
//!
//! Graphics hardware may draw a whole picture before the deadline. So [`Pace`] remembers drawing times across scenes,
//! and the first picture begins with the pixel size that fitted last time. It waits for bricks until it must begin.

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
    /// The image, at full size once [`draw`] returns it.
    pub image: Image,
    /// Statistics of it and the pictures before it.
    pub stats: FrameStats,
    /// Edge of one of its pixels, in pixels of the full picture.
    pixel: u32,
    /// Pixel size of the picture that was begun and is not finished.
    begun: Option<u32>,
    took: Duration,
    /// Errors of its pixels, if requested; NaN where unknown.
    errors: Option<Image>,
    /// Errors of its rays, by reason.
    by_reason: ErrorsByReason,
}

impl Best {
    /// Error map: error of each pixel, grey, 1 is white, if requested.
    #[must_use]
    pub fn error_map(&self) -> Option<Image> {
        Some(complete(self.errors.clone()?, &self.image))
    }

    /// The stated errors in numbers.
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

/// Drawing times of the last pictures by pixel size, without fetching bricks.
#[derive(Debug, Default)]
pub struct Pace {
    /// Size of the full picture, pixels.
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

    /// The smallest pixel size whose picture fits into the time left, with its drawing time; `None` if none is known.
    fn fitting(&self, size: [u32; 2], left: Duration) -> Option<(u32, Duration)> {
        let sure = left.mul_f64(LEAST_SURE_SHARE);
        let fitting = self.took.iter().find(|(_, took)| **took <= sure).filter(|_| self.size == size);
        fitting.map(|(pixel, took)| (*pixel, *took))
    }
}

/// A device and its speed.
pub struct Device {
    /// The device and the data on it.
    pub backend: GpuBackend,
    pace: Pace,
}

impl Device {
    /// A device of unknown speed.
    #[must_use]
    pub fn new(device: GpuDevice) -> Self {
        Self { backend: GpuBackend::new(device), pace: Pace::default() }
    }
}

/// The first picture of a scene with a deadline: its pixel size, and how long to wait for bricks.
fn first_picture(Device { backend, pace }: &Device, scene: &ResolvedScene, deadline: Instant) -> (u32, Instant) {
    let now = Instant::now();
    // Times of software adapters vary too much, and a picture that must be completed cannot be stopped.
    let known = pace
        .fitting(scene.image_size, deadline.saturating_duration_since(now))
        .filter(|_| !backend.device().deals_as_software());
    match known {
        Some((pixel, took)) => (pixel, deadline.checked_sub(took.div_f64(LEAST_SURE_SHARE)).unwrap_or(now)),
        None => (sketch_pixel(scene), now),
    }
}

/// Improves the picture while there is time; without a deadline, until it is finished.
///
/// # Errors
/// As any picture; [`RenderError::Cancelled`] if there is no picture yet.
pub fn draw(
    device: &mut Device,
    resident: &mut Resident,
    scene: &ResolvedScene,
    options: &RenderOptions,
    stop: &Stop,
    best: Option<Best>,
) -> Result<Best, RenderError> {
    let (mut best, stop) = match (best, stop.deadline()) {
        // Each step makes progress, however short it is.
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

/// Parameters of a stage that begins.
struct Begun {
    pixel: u32,
    /// Whether its rays pause at the deadline; otherwise it is completed from resident bricks.
    is_paused_when_due: bool,
    before: FrameStats,
}

/// Draws the picture of one pixel size.
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
    // Shaders that sum up errors differ. If the final picture needs errors, all stages use these shaders.
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
    // Pixels taken from larger ones have no known error.
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
