//! Read-back of the finished rays of a band. The device sorts them into the order of the pixels, piece by piece. While
//! the host makes pixels of one piece, the next one is on its way.

use std::collections::VecDeque;

use supervol_format::cast::{index, narrow};

use super::pass::DeviceCaster;
use super::pixels::{DeviceRay, ERROR_BYTES, GATHERED_BYTES, PIECES_IN_FLIGHT};
use crate::engines::gpu::error::GpuError;
use crate::engines::gpu::layout::{RayErrors, WORKGROUP_RAYS};

/// A piece on its way.
struct Piece {
    /// Number of its first pixel in the band, and how many there are.
    first: u64,
    rays: u64,
    buffer: usize,
    submission: wgpu::SubmissionIndex,
}

impl DeviceCaster {
    /// Passes the rays of the band to `visit`, row by row: the number of the first pixel, the states of the rays, and
    /// their errors if these are summed up.
    pub(super) fn read_pixels(
        &mut self,
        sums_errors: bool,
        mut visit: impl FnMut(usize, &[DeviceRay], &[RayErrors]),
    ) -> Result<(), GpuError> {
        let grid = self.grid();
        let pixels = u64::from(grid.width) * u64::from(grid.height);
        let mut flying: VecDeque<Piece> = VecDeque::new();
        for (number, first) in (0..pixels).step_by(index(self.pixels.rays)).enumerate() {
            if flying.len() == PIECES_IN_FLIGHT
                && let Some(piece) = flying.pop_front()
            {
                self.land_piece(piece, sums_errors, &mut visit)?;
            }
            let rays = self.pixels.rays.min(pixels - first);
            let buffer = number % PIECES_IN_FLIGHT;
            flying.push_back(Piece {
                first,
                rays,
                buffer,
                submission: self.submit_piece(first, rays, buffer, sums_errors),
            });
        }
        flying.into_iter().try_for_each(|piece| self.land_piece(piece, sums_errors, &mut visit))
    }

    fn submit_piece(&self, first: u64, rays: u64, buffer: usize, sums_errors: bool) -> wgpu::SubmissionIndex {
        self.write_job(narrow::<u32>(first), 0);
        let (pixels, bound) = (&self.pixels, self.bound());
        let mut encoder = self.encoder();
        let groups = narrow::<u32>(rays.div_ceil(u64::from(WORKGROUP_RAYS)));
        let bindings = [&bound.pixels.view, &bound.pixels.buffers];
        self.dispatch_on(&mut encoder, &bound.pipelines.gather_pixels, bindings, groups);
        let (to, bytes) = (&pixels.read_back[buffer], rays * GATHERED_BYTES);
        encoder.copy_buffer_to_buffer(&pixels.gathered, 0, to, 0, bytes);
        if sums_errors {
            encoder.copy_buffer_to_buffer(&pixels.errors, 0, to, bytes, rays * ERROR_BYTES);
        }
        self.gpu.submit(encoder)
    }

    fn land_piece(
        &self,
        Piece { first, rays, buffer, submission }: Piece,
        sums_errors: bool,
        visit: &mut impl FnMut(usize, &[DeviceRay], &[RayErrors]),
    ) -> Result<(), GpuError> {
        let bytes = rays * (GATHERED_BYTES + if sums_errors { ERROR_BYTES } else { 0 });
        self.gpu.read_after(Some(submission), &self.pixels.read_back[buffer], bytes, |bytes| {
            let (gathered, errors) = bytes.split_at(index(rays * GATHERED_BYTES));
            visit(index(first), bytemuck::cast_slice(gathered), bytemuck::cast_slice(errors));
        })
    }
}
