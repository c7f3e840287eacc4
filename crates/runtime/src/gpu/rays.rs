//! Rays for the GPU: clipped in `f64`, then split into a voxel and small numbers.
//!
//! Rays are stored tile by tile (8 x 8 pixels, x fastest, rows of tiles from the top), so that the lanes of a workgroup
//! stay together in the volume. Tiles beyond the picture's edge hold finished rays.

use rayon::prelude::*;
use supervol_format::{Dims, Geometry};

use super::layout::{GpuRay, RayState, STATUS_ACTIVE, STATUS_DONE, WORKGROUP_RAYS};
use crate::camera::Camera;
use crate::clip::{Clip, IndexRay, Segment, clip_ray};

/// Edge of a tile, pixels.
pub const TILE: u32 = 8;

/// Voxels that a stride spans at most: how far a ray's base point lies behind the brick it enters.
const STRIDE_VOXELS: f64 = 16.0;

/// A grid of rays and where each of them is stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RayGrid {
    /// Rays along x.
    pub width: u32,
    /// Rays along y.
    pub height: u32,
}

impl RayGrid {
    /// Tiles along x and y.
    #[must_use]
    pub fn tiles(self) -> [u32; 2] {
        [self.width.div_ceil(TILE), self.height.div_ceil(TILE)]
    }

    /// Places for rays, those beyond the edge included.
    #[must_use]
    pub fn places(self) -> u64 {
        self.tiles().iter().map(|&n| u64::from(n)).product::<u64>() * u64::from(WORKGROUP_RAYS)
    }

    /// The pixel at a place; may lie beyond the edge.
    #[must_use]
    pub fn pixel(self, place: u64) -> [u32; 2] {
        let (tile, lane) = (place / u64::from(WORKGROUP_RAYS), (place % u64::from(WORKGROUP_RAYS)) as u32);
        let tiles_x = u64::from(self.tiles()[0]);
        let [tx, ty] = [tile % tiles_x, tile / tiles_x].map(|n| n as u32);
        [tx * TILE + lane % TILE, ty * TILE + lane / TILE]
    }
}

/// World length of a stride: the greatest power of two that spans no more than 16 voxels.
#[must_use]
pub fn stride_world(geometry: &Geometry) -> f64 {
    (STRIDE_VOXELS * geometry.smallest_spacing()).log2().floor().exp2()
}

/// What every ray of a picture shares.
#[derive(Debug, Clone, Copy)]
pub struct RayFactory<'a> {
    /// The camera over the grid of rays.
    pub camera: &'a Camera,
    /// Place of the volume.
    pub geometry: &'a Geometry,
    /// Voxels of level 0.
    pub dims: Dims,
    /// What is kept.
    pub clip: &'a Clip,
    /// First value of every ray's accumulator.
    pub first_value: f32,
}

impl RayFactory<'_> {
    /// Rays and first states of the places `first .. first + count`.
    #[must_use]
    pub fn make(&self, first: u64, count: usize) -> (Vec<GpuRay>, Vec<RayState>) {
        let grid = RayGrid { width: self.camera.width, height: self.camera.height };
        (0..count as u64).into_par_iter().map(|i| self.ray(grid.pixel(first + i))).unzip()
    }

    fn ray(&self, [x, y]: [u32; 2]) -> (GpuRay, RayState) {
        let idle = RayState { transmittance: 1.0, status: STATUS_DONE, value: self.first_value, ..zeroed() };
        if x >= self.camera.width || y >= self.camera.height {
            return (zeroed(), idle);
        }
        let ray = self.camera.ray(x, y);
        let index_ray = IndexRay::new(&ray, self.geometry);
        let Some(segment) = clip_ray(&ray, &index_ray, self.dims, self.clip) else {
            return (zeroed(), idle);
        };
        (gpu_ray(&index_ray, segment, stride_world(self.geometry)), RayState { status: STATUS_ACTIVE, ..idle })
    }
}

fn zeroed<T: bytemuck::Zeroable>() -> T {
    T::zeroed()
}

/// The part of a ray that is drawn; its parameter begins at 0 where the segment begins.
#[must_use]
pub fn gpu_ray(ray: &IndexRay, segment: Segment, stride: f64) -> GpuRay {
    let first = ray.at(segment.t0);
    let voxel = first.map(f64::floor);
    let length = segment.t1 - segment.t0;
    let strides = (length / stride).floor();
    GpuRay {
        voxel: voxel.map(|v| v as i32),
        strides: strides as u32,
        fraction: std::array::from_fn(|a| (first[a] - voxel[a]) as f32),
        rest: (length - strides * stride) as f32,
        direction: ray.direction.map(|d| d as f32),
        padding_0: 0.0,
        direction_low: ray.direction.map(|d| (d - f64::from(d as f32)) as f32),
        padding_1: 0.0,
    }
}
