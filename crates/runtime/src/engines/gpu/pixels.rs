//! Buffers for the read-back of finished rays, piece by piece: see [`super::read_back`].

use crate::engines::gpu::device::GpuDevice;
use crate::engines::gpu::error::GpuError;
use crate::engines::gpu::layout::RayErrors;
use crate::engines::gpu::pipelines::Pipelines;

/// Most bytes of a piece.
const PIECE_LIMIT: u64 = 4 << 20;
/// Pieces that are on their way at once.
pub(super) const PIECES_IN_FLIGHT: usize = 2;

/// Values gathered by a ray: premultiplied colour and transmittance. In modes that count by value: the value (mean: its
/// integral), its present world length, 0, and the transmittance.
pub(super) type DeviceRay = [f32; 4];

pub(super) const GATHERED_BYTES: u64 = size_of::<DeviceRay>() as u64;
pub(super) const ERROR_BYTES: u64 = size_of::<RayErrors>() as u64;

/// Buffers in which pieces are assembled and read.
pub(super) struct PixelBuffers {
    pub(super) gathered: wgpu::Buffer,
    pub(super) errors: wgpu::Buffer,
    pub(super) read_back: Vec<wgpu::Buffer>,
    /// Rays of a piece.
    pub(super) rays: u64,
}

/// Bindings of `gather_pixels.wgsl`.
pub(super) struct BoundPixels {
    pub(super) view: wgpu::BindGroup,
    pub(super) buffers: wgpu::BindGroup,
}

impl PixelBuffers {
    pub(super) fn new(gpu: &GpuDevice, (places, sums_errors): (u64, bool)) -> Result<Self, GpuError> {
        let storage = wgpu::BufferUsages::STORAGE;
        let (rays, [gathered, errors]) = Self::sizes((places, sums_errors));
        let read_back = (0..PIECES_IN_FLIGHT).map(|_| gpu.read_buffer("pixels on their way", gathered + errors));
        Ok(Self {
            gathered: gpu.buffer("what rays have gathered", gathered, storage)?,
            errors: gpu.buffer("what pixels may be off by", errors, storage)?,
            read_back: read_back.collect::<Result<_, _>>()?,
            rays,
        })
    }

    /// Bytes of all buffers.
    pub(super) fn bytes((places, sums_errors): (u64, bool)) -> u64 {
        let (_, [gathered, errors]) = Self::sizes((places, sums_errors));
        (gathered + errors) * (1 + PIECES_IN_FLIGHT as u64)
    }

    /// Rays of a piece, and bytes of either part. Without errors, their part has room for one.
    fn sizes((places, sums_errors): (u64, bool)) -> (u64, [u64; 2]) {
        let of_a_ray = GATHERED_BYTES + if sums_errors { ERROR_BYTES } else { 0 };
        let rays = places.min(PIECE_LIMIT / of_a_ray).max(1);
        (rays, [rays * GATHERED_BYTES, ERROR_BYTES * if sums_errors { rays } else { 1 }])
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
