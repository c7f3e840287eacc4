//! Reads back the values gathered by the rays of a band. The device puts them in the order of pixels, piece by piece;
//! the host converts one piece while the next is in flight.

use std::collections::VecDeque;

use super::pass::{Capacity, Caster};
use crate::engines::gpu::device::{GpuDevice, GpuError};
use crate::engines::gpu::layout::{RayErrors, WORKGROUP_RAYS};
use crate::engines::gpu::pipelines::Pipelines;

/// Most bytes of a piece.
const PIECE_LIMIT: u64 = 4 << 20;
/// Pieces in flight at once.
const PIECES_IN_FLIGHT: usize = 2;

/// Values gathered by a ray: premultiplied colour and transmittance. In modes that count by value: the value (mean: its
/// integral), its present world length, 0, and the transmittance.
pub(super) type Gathered = [f32; 4];

const GATHERED_BYTES: u64 = size_of::<Gathered>() as u64;
const ERROR_BYTES: u64 = size_of::<RayErrors>() as u64;

/// Buffers in which pieces are assembled and read.
pub(super) struct PixelBuffers {
    gathered: wgpu::Buffer,
    errors: wgpu::Buffer,
    read_back: Vec<wgpu::Buffer>,
    /// Rays of a piece.
    rays: u64,
}

/// Bindings of `gather_pixels.wgsl`.
pub(super) struct BoundPixels {
    view: wgpu::BindGroup,
    buffers: wgpu::BindGroup,
}

/// A piece in flight.
struct Piece {
    /// Number of its first pixel in the band, and its rays.
    first: u64,
    rays: u64,
    buffer: usize,
    submission: wgpu::SubmissionIndex,
}

impl PixelBuffers {
    pub(super) fn new(gpu: &GpuDevice, capacity: &Capacity) -> Result<Self, GpuError> {
        let storage = wgpu::BufferUsages::STORAGE;
        let (rays, [gathered, errors]) = Self::sizes(capacity);
        let read_back = (0..PIECES_IN_FLIGHT).map(|_| gpu.read_buffer("pixels on their way", gathered + errors));
        Ok(Self {
            gathered: gpu.buffer("what rays have gathered", gathered, storage)?,
            errors: gpu.buffer("what pixels may be off by", errors, storage)?,
            read_back: read_back.collect::<Result<_, _>>()?,
            rays,
        })
    }

    /// Bytes of all buffers.
    pub(super) fn bytes(capacity: &Capacity) -> u64 {
        let (_, [gathered, errors]) = Self::sizes(capacity);
        (gathered + errors) * (1 + PIECES_IN_FLIGHT as u64)
    }

    /// Rays of a piece, and bytes of either part; one place for errors if they are not requested.
    fn sizes(capacity: &Capacity) -> (u64, [u64; 2]) {
        let of_a_ray = GATHERED_BYTES + if capacity.sums_errors { ERROR_BYTES } else { 0 };
        let rays = capacity.places.min(PIECE_LIMIT / of_a_ray).max(1);
        (rays, [rays * GATHERED_BYTES, ERROR_BYTES * if capacity.sums_errors { rays } else { 1 }])
    }

    /// Binds the buffers, the scene and all rays: their states and errors.
    pub(super) fn bind(
        &self,
        gpu: &GpuDevice,
        pipelines: &Pipelines,
        (scene, states, errors): (&wgpu::Buffer, &wgpu::Buffer, &wgpu::Buffer),
    ) -> Result<BoundPixels, GpuError> {
        let buffers = [states, errors, &self.gathered, &self.errors];
        Ok(BoundPixels {
            view: pipelines.bind_view(gpu, scene)?,
            buffers: pipelines.gather_pixels.bind(gpu, &buffers)?,
        })
    }
}

impl Caster {
    /// Passes the values gathered by the rays of the band to `visit`, row by row. Arguments: the number of the first
    /// pixel, the values from there on, and their errors if they are summed up.
    pub(super) fn read_pixels(
        &mut self,
        sums_errors: bool,
        mut visit: impl FnMut(usize, &[Gathered], &[RayErrors]),
    ) -> Result<(), GpuError> {
        let grid = self.grid();
        let pixels = u64::from(grid.width) * u64::from(grid.height);
        let mut flying: VecDeque<Piece> = VecDeque::new();
        for (number, first) in (0..pixels).step_by(self.pixels.rays as usize).enumerate() {
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
        self.write_job(first as u32, 0);
        let (pixels, bound) = (&self.pixels, self.bound());
        let mut encoder = self.encoder();
        let groups = rays.div_ceil(u64::from(WORKGROUP_RAYS)) as u32;
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
        visit: &mut impl FnMut(usize, &[Gathered], &[RayErrors]),
    ) -> Result<(), GpuError> {
        let bytes = rays * (GATHERED_BYTES + if sums_errors { ERROR_BYTES } else { 0 });
        self.gpu.read_after(Some(submission), &self.pixels.read_back[buffer], bytes, |bytes| {
            let (gathered, errors) = bytes.split_at((rays * GATHERED_BYTES) as usize);
            visit(first as usize, bytemuck::cast_slice(gathered), bytemuck::cast_slice(errors));
        })
    }
}
