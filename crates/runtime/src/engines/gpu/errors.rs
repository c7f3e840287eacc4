//! Errors of pixels from the shader's sums of errors of rays: see docs/decisions/013-stated-error.md.

use rayon::prelude::*;
use supervol_format::cast::single;
use supervol_scene::image::Image;
use supervol_scene::scene::Mode;

use super::pixels::DeviceRay;
use crate::engines::gpu::caster::GpuRenderer;
use crate::engines::gpu::deviations;
use crate::engines::gpu::error::GpuError;
use crate::engines::gpu::layout::RayErrors;
use crate::engines::gpu::picture::{PIXELS_TOGETHER, Picture, over_rays, pixel};
use crate::engines::rules::{END_SHARE, ErrorKnowledge, LEAST_AIMED, fit_error, own_error, rounding_error};
use crate::engines::totals::ErrorsByReason;
use crate::lod::deviation::{Deviations, FinishedRay};

/// Error of a pixel of which nothing is known, 1 is white.
const WHOLE: f64 = 1.0;

/// Errors of the rays of a band.
#[derive(Debug, Clone, PartialEq)]
pub struct BandErrors {
    /// Mean over the rays of each pixel: grey, 1 is white.
    pub pixels: Image,
    /// Greatest error of all rays, by reason.
    pub greatest: ErrorsByReason,
    /// Rays in mode `dvr` that ended before they left the volume.
    pub ended_early: u64,
}

impl GpuRenderer {
    /// [`GpuRenderer::write_image`], with errors of the picture if they are summed up; the deviations of bricks use the
    /// same rules.
    ///
    /// # Errors
    /// A lost device.
    ///
    /// # Panics
    /// If the number of pixels differs.
    pub fn write_image_with_errors(
        &mut self,
        deviations: &Deviations,
        to: &mut [[f32; 4]],
    ) -> Result<Option<BandErrors>, GpuError> {
        if !self.sums_errors() {
            return self.write_image(to).map(|()| None);
        }
        let (grid, subgrid) = (self.caster.grid(), self.picture.subgrid);
        let mut off = vec![[0.0; 4]; grid.width as usize * grid.height as usize];
        let (mut greatest, mut ended_early) = (ErrorsByReason::default(), 0);
        let (caster, picture, core) = (&mut self.caster, &self.picture, self.pyramid.layout().core());
        over_rays(grid, subgrid, to, |rays| {
            caster.read_pixels(true, |first, gathered, errors| {
                let places = rays[first..].par_iter_mut().zip(&mut off[first..]);
                let rays = places.zip(gathered.par_iter().zip(errors)).with_min_len(PIXELS_TOGETHER);
                let of_all = rays.map(|((to, off), (gathered, errors))| {
                    *to = pixel(picture.mode, &picture.tf, gathered);
                    let (error, by_reason) = picture.error_of(deviations, gathered, errors, (*to, core));
                    *off = [error, error, error, 1.0];
                    (by_reason, u64::from(picture.has_ended(gathered)))
                });
                let (by_reason, ended) =
                    of_all.reduce(Default::default, |(a, ended), (b, more)| (a.or(b), ended + more));
                greatest = greatest.or(by_reason);
                ended_early += ended;
            })
        })?;
        let pixels = Image { width: grid.width, height: grid.height, pixels: off }.downsampled(subgrid);
        Ok(Some(BandErrors { pixels, greatest, ended_early }))
    }

    /// Whether the errors of cells are summed up: in mode `dvr` without steps.
    #[must_use]
    pub fn sums_cells(&self) -> bool {
        self.sums_errors() && self.picture.mode == Mode::Dvr && self.picture.light.is_resolved
    }

    /// Errors not summed up ray by ray, 1 is white: light behind the end of a ray, the fit of the transfer function,
    /// and `f32`.
    #[must_use]
    pub fn common_errors(&self) -> [f64; 3] {
        let max_error = self.picture.exactness.max_error;
        [END_SHARE * max_error, fit_error(max_error), rounding_error(self.pyramid.layout().core())]
    }
}

impl Picture {
    /// Whether a finished ray ended before it left the volume.
    fn has_ended(&self, [.., transmittance]: &DeviceRay) -> bool {
        self.mode == Mode::Dvr && *transmittance <= single(END_SHARE * self.exactness.max_error)
    }

    /// Errors of a finished ray, by reason; `core`: voxels along an edge of a full brick's core.
    fn error_of(
        &self,
        deviations: &Deviations,
        gathered: &DeviceRay,
        errors: &RayErrors,
        (pixel, core): ([f32; 4], usize),
    ) -> (f32, ErrorsByReason) {
        let max_error = self.exactness.max_error;
        let [first, length, _, transmittance] = gathered.map(f64::from);
        // Roots and Gauss pairs, like surfaces, aim at the requested error; their errors are not summed up.
        let is_bounded = !self.has_surfaces && self.light.is_resolved;
        let known = if is_bounded { ErrorKnowledge::Bounded } else { ErrorKnowledge::Aimed };
        let aimed = match self.light.is_resolved {
            true => max_error,
            // On which side of a step a rounded value lies is not known.
            false if self.is_rounded => WHOLE,
            false => max_error.max(LEAST_AIMED),
        };
        let value = match self.mode {
            Mode::Mip | Mode::Minip | Mode::Mean if length <= 0.0 => f64::NAN,
            Mode::Mean => first / length,
            _ => first,
        };
        let cells = f64::from(errors.cells);
        let finished = FinishedRay {
            behind: if self.has_ended(gathered) { transmittance } else { 0.0 },
            value: value + self.shift,
            length,
            own: cells + own_error(self.mode, 1.0 - transmittance, (aimed, known), core),
            pixel,
        };
        let [off, levels] = deviations.of_finished(&deviations::of_ray(self.mode, errors), &finished);
        let by_reason = ErrorsByReason { cells, levels, presence_may_change: errors.presence_may_change != 0 };
        (single(off), by_reason)
    }
}
