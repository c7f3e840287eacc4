//! What rays may be off by, as the shader has summed it up, made into what each pixel may be off by: see
//! docs/decisions/013-stated-error.md.

use supervol_format::BrickKey;

use super::{GpuError, GpuRenderer, Picture, pixel};
use crate::gpu::deviations;
use crate::gpu::layout::{RayErrors, RayState};
use crate::gpu::rays::RayGrid;
use crate::image::Image;
use crate::lod::deviation::{Deviation, Deviations, FinishedRay};
use crate::raycast::cpu::levels::ErrorsByReason;
use crate::raycast::cpu::{END_SHARE, fit_error, own_error, rounding_error};
use crate::scene::Mode;

/// Below this, tables and `f32` do not let roots and pairs of Gauss reach the error that is asked for.
const LEAST_AIMED: f64 = 0.25 / 255.0;

/// What a brick may be off by under a look, for pictures that say it.
pub type DeviationOf = Box<dyn Fn(BrickKey) -> Deviation + Send>;

/// What the rays of a band may be off by.
#[derive(Debug, Clone, PartialEq)]
pub struct BandErrors {
    /// Of each pixel the mean over its rays: grey, 1 being white.
    pub pixels: Image,
    /// The greatest of all rays, reason by reason.
    pub greatest: ErrorsByReason,
    /// Rays in mode `dvr` that ended before they left the volume.
    pub ended_early: u64,
}

impl GpuRenderer {
    /// [`GpuRenderer::image`], and what it may be off by where that is summed up, by the same rule that said it of bricks.
    ///
    /// # Errors
    /// A lost device.
    pub fn image_with_errors(&mut self, deviations: &Deviations) -> Result<(Image, Option<BandErrors>), GpuError> {
        if !self.sums_errors() {
            return Ok((self.image()?, None));
        }
        let RayGrid { width, height } = self.caster.grid();
        let mut pixels = vec![[0.0; 4]; width as usize * height as usize];
        let mut off = pixels.clone();
        let (mut greatest, mut ended_early) = (ErrorsByReason::default(), 0);
        let (picture, core) = (&self.picture, self.pyramid.layout().core());
        self.caster.read_rays(true, |[x, y], state, errors| {
            if x < width && y < height {
                let ray = y as usize * width as usize + x as usize;
                pixels[ray] = pixel(picture.mode, &picture.tf, state);
                let (error, by_reason) = picture.error_of(deviations, state, errors, (pixels[ray], core));
                off[ray] = [error, error, error, 1.0];
                greatest = greatest.or(by_reason);
                ended_early += u64::from(picture.has_ended(state));
            }
        })?;
        let [image, off] = [pixels, off].map(|pixels| Image { width, height, pixels }.downsampled(picture.subgrid));
        Ok((image, Some(BandErrors { pixels: off, greatest, ended_early })))
    }

    /// Whether what cells miss is part of what is summed up: in mode `dvr` without steps.
    #[must_use]
    pub fn sums_cells(&self) -> bool {
        self.sums_errors() && self.picture.mode == Mode::Dvr && self.picture.light.is_resolved
    }

    /// What is not summed up ray by ray, 1 being white: what lies behind the end of a ray, what the fit of the transfer function and `f32` do.
    #[must_use]
    pub fn common_errors(&self) -> [f64; 3] {
        let max_error = self.picture.exactness.max_error;
        [END_SHARE * max_error, fit_error(max_error), rounding_error(self.pyramid.layout().core())]
    }
}

impl Picture {
    /// Whether a finished ray ended before it left the volume.
    fn has_ended(&self, state: &RayState) -> bool {
        self.mode == Mode::Dvr && state.transmittance <= (END_SHARE * self.exactness.max_error) as f32
    }

    /// What a finished ray may be off by, and for which reasons; `core`: voxels along an edge of a full brick's core.
    fn error_of(
        &self,
        deviations: &Deviations,
        state: &RayState,
        errors: &RayErrors,
        (pixel, core): ([f32; 4], usize),
    ) -> (f32, ErrorsByReason) {
        let max_error = self.exactness.max_error;
        let transmittance = f64::from(state.transmittance);
        // Roots and pairs of Gauss, like surfaces, aim at the error that is asked for, and nobody sums up what they miss.
        let only_aims = self.has_surfaces || !self.light.is_resolved;
        let aimed = if self.light.is_resolved { max_error } else { max_error.max(LEAST_AIMED) };
        let length = f64::from(state.present);
        let value = match self.mode {
            Mode::Mip | Mode::Minip | Mode::Mean if length <= 0.0 => f64::NAN,
            Mode::Mean => f64::from(state.color[0]) / length,
            _ => f64::from(state.color[0]),
        };
        let cells = f64::from(errors.cells);
        let finished = FinishedRay {
            behind: if self.has_ended(state) { transmittance } else { 0.0 },
            value: value + self.shift,
            length,
            own: cells + own_error(self.mode, 1.0 - transmittance, (aimed, only_aims), core),
            pixel,
        };
        let [off, levels] = deviations.of_finished(&deviations::of_ray(self.mode, errors), &finished);
        let by_reason = ErrorsByReason { cells, levels, presence_may_change: errors.presence_may_change != 0 };
        (off as f32, by_reason)
    }
}
