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
use crate::engines::rules::{
    END_SHARE, LEAST_AIMED, aimed_error, fit_error, own_error, rounding_error, surfaces_error,
};
use crate::engines::totals::ErrorsByReason;
use crate::lod::deviation::{Deviations, FinishedRay, RayDeviation};

/// Error of a pixel of which nothing is known, 1 is white.
const WHOLE: f64 = 1.0;

/// Errors of the rays of a band.
#[derive(Debug, Clone, PartialEq)]
pub struct BandErrors {
    /// Mean over the rays of each pixel: grey, 1 is white.
    pub pixels: Image,
    /// Greatest error of all rays, by reason.
    pub greatest: ErrorsByReason,
    /// The same without rays that may be off by more than requested, coarser levels apart.
    pub greatest_within: ErrorsByReason,
    /// Whether a pixel has such a ray, row by row.
    pub is_above: Vec<bool>,
    /// Rays in mode `dvr` that ended before they left the volume.
    pub ended_early: u64,
}

/// Error of a finished ray.
struct RayError {
    /// For all reasons; 1 is white.
    off: f32,
    by_reason: ErrorsByReason,
    /// Whether it may be off by more than requested, coarser levels apart.
    is_above: bool,
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
        let count = grid.width as usize * grid.height as usize;
        let (mut off, mut above) = (vec![[0.0; 4]; count], vec![false; count]);
        let (mut greatest, mut greatest_within, mut ended_early) =
            (ErrorsByReason::default(), ErrorsByReason::default(), 0);
        let (caster, picture, core) = (&mut self.caster, &self.picture, self.pyramid.layout().core());
        over_rays(grid, subgrid, to, |rays| {
            caster.read_pixels(true, |first, gathered, errors| {
                let places = rays[first..].par_iter_mut().zip(&mut off[first..]).zip(&mut above[first..]);
                let rays = places.zip(gathered.par_iter().zip(errors)).with_min_len(PIXELS_TOGETHER);
                let of_all = rays.map(|(((to, off), above), (gathered, errors))| {
                    *to = pixel(picture.mode, &picture.tf, gathered);
                    let RayError { off: error, by_reason, is_above } =
                        picture.error_of(deviations, gathered, errors, (*to, core));
                    (*off, *above) = ([error, error, error, 1.0], is_above);
                    let within = if is_above { ErrorsByReason::default() } else { by_reason };
                    (by_reason, within, u64::from(picture.has_ended(gathered)))
                });
                let join = |(a, within, ended): (ErrorsByReason, ErrorsByReason, u64), (b, more_within, more)| {
                    (a.or(b), within.or(more_within), ended + more)
                };
                let (by_reason, within, ended) = of_all.reduce(Default::default, join);
                (greatest, greatest_within) = (greatest.or(by_reason), greatest_within.or(within));
                ended_early += ended;
            })
        })?;
        let pixels = Image { width: grid.width, height: grid.height, pixels: off }.downsampled(subgrid);
        let is_above = of_pixels(&above, grid.width as usize, subgrid as usize);
        Ok(Some(BandErrors { pixels, greatest, greatest_within, is_above, ended_early }))
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
    ) -> RayError {
        let max_error = self.exactness.max_error;
        let [first, length, _, transmittance] = gathered.map(f64::from);
        let of_surfaces = if self.has_surfaces { surfaces_error(max_error) } else { 0.0 };
        // Roots and pairs of Gauss, like surfaces, aim at an error; theirs are not summed up.
        let of_roots = match self.light.is_resolved {
            true => 0.0,
            // On which side of a step a rounded value lies is not known.
            false if self.is_rounded => WHOLE,
            false => aimed_error(max_error, core).max(LEAST_AIMED),
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
            own: cells + own_error(self.mode, 1.0 - transmittance, max_error, of_surfaces + of_roots, core),
            pixel,
        };
        let [off, levels] = deviations.of_finished(&deviations::of_ray(self.mode, errors), &finished);
        let by_reason = ErrorsByReason { cells, levels, presence_may_change: errors.presence_may_change != 0 };
        let requested = max_error + of_surfaces;
        let is_above = || deviations.of_finished(&RayDeviation::NONE, &finished)[0] > requested;
        RayError { off: single(off), by_reason, is_above: off > requested && is_above() }
    }
}

/// Whether a ray of each pixel is marked, row by row; `width`: rays along x.
fn of_pixels(rays: &[bool], width: usize, subgrid: usize) -> Vec<bool> {
    if subgrid == 1 {
        return rays.to_vec();
    }
    let mut pixels = vec![false; rays.len() / (subgrid * subgrid)];
    for (row, rays) in rays.chunks_exact(width).enumerate() {
        let first = row / subgrid * (width / subgrid);
        for (pixel, rays) in pixels[first..].iter_mut().zip(rays.chunks_exact(subgrid)) {
            *pixel |= rays.contains(&true);
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::of_pixels;

    #[test]
    fn one_ray_marks_its_pixel() {
        let mut rays = [false; 24];
        rays[6 + 3] = true;
        rays[2 * 6 + 5] = true;
        assert_eq!(of_pixels(&rays, 6, 2), [false, true, false, false, false, true]);
        assert_eq!(of_pixels(&rays, 6, 1), rays);
    }
}
