//! Rays for the GPU: the shader makes them, from numbers that change linearly from pixel to pixel.
//!
//! With depth as parameter, a ray of either projection is a line. Its origin and its direction in index space change
//! linearly from pixel to pixel. Both are passed in fixed point with 64 bits of fraction ([`Fixed`]). So the shader
//! computes any position on any ray with integers alone, for any size of volume and any number of strides. No
//! coordinate is ever stored in a single `f32`, and no compiler can round differently. `f32` holds only offsets of some
//! voxels.
//!
//! Rays are stored tile by tile (8 x 8 rays, x fastest, rows of tiles from the top). So the lanes of a workgroup stay
//! together in the volume. Places beyond the picture's edge hold finished rays.

use bytemuck::Zeroable;
use glam::{DMat3, DVec3};
use supervol_format::cast::{narrow, single, whole};
use supervol_format::space::HALF_VOXEL;
use supervol_format::{Dims, Geometry};
use supervol_scene::camera::{Camera, Projection, Ray};
use supervol_scene::clip::{Clip, ClipPlane};

use super::layout::{Affine, Fixed, PlaneLine, View, WORKGROUP_RAYS};
use crate::engines::gpu::error::GpuError;

/// Edge of a tile, pixels.
pub const TILE: u32 = 8;

/// Most voxels of a stride along each axis: the distance of a ray's base point behind the brick it enters.
const STRIDE_VOXELS: f64 = 8.0;

/// Distance of the rays' begin in front of the volume, voxels along the view.
const MARGIN_VOXELS: f64 = 4.0;

/// Largest position on rays for fixed-point numbers, voxels from the volume's origin along an axis.
const PLACE_LIMIT: f64 = (1 << 30) as f64;

/// A grid of rays, with their storage order.
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

    /// The pixel at a place; may lie beyond the edge. Tiles are stored row by row, and so are the blocks of 4 x 2
    /// pixels within a tile. Rays cast together by groups of lanes are then closer than in rows of 8.
    #[must_use]
    pub fn pixel(self, place: u64) -> [u32; 2] {
        let (tile, lane) = (place / u64::from(WORKGROUP_RAYS), narrow::<u32>(place % u64::from(WORKGROUP_RAYS)));
        let tiles_x = u64::from(self.tiles()[0]);
        let [tx, ty] = [tile % tiles_x, tile / tiles_x].map(narrow::<u32>);
        let block = lane / 8;
        [tx * TILE + block % 2 * 4 + lane % 4, ty * TILE + block / 2 * 2 + lane / 4 % 2]
    }

    /// The place of a pixel.
    #[must_use]
    pub fn place_of(self, [x, y]: [u32; 2]) -> u64 {
        let block = x % TILE / 4 + y % TILE / 2 * 2;
        let tile = u64::from(x / TILE) + u64::from(self.tiles()[0]) * u64::from(y / TILE);
        tile * u64::from(WORKGROUP_RAYS) + u64::from(block * 8 + y % 2 * 4 + x % 4)
    }
}

/// A number that changes linearly from pixel to pixel, as `f64`.
#[derive(Debug, Clone, Copy)]
struct LinearNumber<T> {
    base: T,
    per_x: T,
    per_y: T,
}

impl<T> LinearNumber<T> {
    fn map<U>(self, f: impl Fn(T) -> U) -> LinearNumber<U> {
        LinearNumber { base: f(self.base), per_x: f(self.per_x), per_y: f(self.per_y) }
    }
}

impl LinearNumber<DVec3> {
    fn at(&self, x: f64, y: f64) -> DVec3 {
        self.base + x * self.per_x + y * self.per_y
    }

    fn plus(self, other: Self, factor: f64) -> Self {
        Self {
            base: self.base + factor * other.base,
            per_x: self.per_x + factor * other.per_x,
            per_y: self.per_y + factor * other.per_y,
        }
    }

    fn axis(&self, axis: usize) -> LinearNumber<f64> {
        self.map(|v| v[axis])
    }
}

/// The rays of a picture, in `f64`; [`View`] holds the same in fixed point.
#[derive(Debug, Clone, Copy)]
pub struct ViewLines {
    /// World points at t = 0, and the rays' directions per unit of t.
    origin: LinearNumber<DVec3>,
    direction: LinearNumber<DVec3>,
    /// Depth of the origins, from the eye.
    depth: f64,
    /// A stride in units of t.
    stride: f64,
}

impl ViewLines {
    /// Rays of this camera through a volume.
    #[must_use]
    pub fn new(camera: &Camera, geometry: &Geometry, dims: Dims) -> Self {
        let rays = camera.rays();
        let corner = |x: f64, y: f64| rays.offset([x, y]);
        let offset = LinearNumber {
            base: corner(0.0, 0.0),
            per_x: corner(1.0, 0.0) - corner(0.0, 0.0),
            per_y: corner(0.0, 1.0) - corner(0.0, 0.0),
        };
        let none = LinearNumber { base: DVec3::ZERO, per_x: DVec3::ZERO, per_y: DVec3::ZERO };
        let (eye, forward) = (LinearNumber { base: camera.eye, ..none }, LinearNumber { base: camera.forward, ..none });
        let is_perspective = matches!(camera.projection, Projection::Perspective { .. });
        let (from, direction) =
            if is_perspective { (eye, forward.plus(offset, 1.0)) } else { (eye.plus(offset, 1.0), forward) };
        let nearest = nearest_depth(camera, geometry, dims) - MARGIN_VOXELS * greatest_step(geometry);
        let depth = if is_perspective { nearest.max(0.0) } else { nearest };
        let origin = from.plus(direction, depth);
        let to_index = geometry.linear().inverse();
        let longest = corners_of(camera).map(|[x, y]| (to_index * direction.at(x, y)).abs().max_element());
        let stride = (STRIDE_VOXELS / longest.into_iter().fold(0.0, f64::max)).log2().floor().exp2();
        Self { origin, direction, depth, stride }
    }

    /// A stride, in units of t.
    #[must_use]
    pub fn stride(&self) -> f64 {
        self.stride
    }

    /// Depth of the rays' origins from the eye, in units of t.
    #[must_use]
    pub fn depth(&self) -> f64 {
        self.depth
    }

    /// Number of whole strides to a position on a pixel's ray, and the parameter beyond them; `length` is the world
    /// length from the ray's begin.
    #[must_use]
    pub fn strides_to(&self, ray: &Ray, [x, y]: [u32; 2], length: f64) -> (u32, f32) {
        let [origin, direction] = [self.origin, self.direction].map(|line| line.at(f64::from(x), f64::from(y)));
        let beyond = length - (origin - ray.origin).dot(ray.direction);
        let strides = (beyond / direction.length() / self.stride).max(0.0);
        // The number of strides through the largest volume is far below 32 bits.
        let full = strides.floor().min(f64::from(u32::MAX));
        (whole::<u32>(full), single((strides - full) * self.stride))
    }

    /// The view in the form for the shader.
    ///
    /// # Errors
    /// If rays of the picture lie further from the volume than fixed-point numbers reach.
    pub fn view(&self, camera: &Camera, geometry: &Geometry, dims: Dims, clip: &Clip) -> Result<View, GpuError> {
        let to_index = geometry.linear().inverse();
        let place = self.origin.map(|p| to_index * p);
        let place = LinearNumber { base: to_index * (self.origin.base - DVec3::from_array(geometry.origin)), ..place };
        let step = self.direction.map(|d| to_index * d * self.stride);
        for [x, y] in corners_of(camera) {
            let far = place.at(x, y).abs().max_element();
            if far.is_nan() || far >= PLACE_LIMIT {
                let reason =
                    format!("a ray passes {far:.3e} voxels from the volume; use the CPU backend, or move nearer");
                return Err(GpuError::Scene { reason });
            }
        }
        let mut view = View {
            origin: [0, 1, 2].map(|a| affine(place.axis(a))),
            stride: [0, 1, 2].map(|a| affine(step.axis(a))),
            length: self.length(camera),
            width: camera.width,
            height: camera.height,
            ..View::zeroed()
        };
        for a in 0..3 {
            let [low, high] = clip.index_box.unwrap_or([[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]]).map(|c| c[a]);
            let low = low.clamp(-HALF_VOXEL, dims.0[a] as f64);
            let high = high.clamp(-1.0, dims.0[a] as f64 - HALF_VOXEL);
            (view.box_low[a], view.box_low_rest[a]) = (whole::<i32>(low.floor()), single(low - low.floor()));
            (view.box_high[a], view.box_high_rest[a]) = (whole::<i32>(high.floor()), single(high - high.floor()));
        }
        // Planes that do not meet the volume cut off nothing or all of it; heights above all others are representable.
        let corners = corners_of_volume(geometry, dims);
        let is_above = |plane: &ClipPlane, p: &DVec3| plane.normal.dot(*p) >= plane.offset;
        if clip.planes.iter().any(|plane| corners.iter().all(|p| !is_above(plane, p))) {
            view.box_high = [i32::MIN / 2; 3];
        }
        let cutting = clip.planes.iter().filter(|plane| !corners.iter().all(|p| is_above(plane, p)));
        for (line, plane) in view.planes.iter_mut().zip(cutting) {
            *line = self.plane_line(plane, geometry.linear());
            view.plane_count += 1;
        }
        Ok(view)
    }

    /// Heights above a plane, in units of their largest change per voxel.
    fn plane_line(&self, plane: &ClipPlane, linear: DMat3) -> PlaneLine {
        let unit = (linear.transpose() * plane.normal).length();
        let height = self.origin.map(|v| plane.normal.dot(v) / unit);
        let height = LinearNumber { base: (plane.normal.dot(self.origin.base) - plane.offset) / unit, ..height };
        // A plane that does not meet the volume remains only beside another that leaves nothing.
        let height = height.map(|h| h.clamp(-PLACE_LIMIT, PLACE_LIMIT));
        PlaneLine {
            origin: affine(height),
            stride: affine(self.direction.map(|d| plane.normal.dot(d) / unit * self.stride)),
        }
    }

    /// [`View::length`].
    fn length(&self, camera: &Camera) -> [f32; 4] {
        let along =
            |v: LinearNumber<DVec3>, axis: DVec3| [single(v.base.dot(axis)), single((v.per_x + v.per_y).dot(axis))];
        let [[u, u_x], [v, v_y]] = [along(self.direction, camera.right), along(self.direction, camera.up)];
        [u, u_x, v, v_y]
    }
}

/// Corners of the volume's domain, world space.
fn corners_of_volume(geometry: &Geometry, dims: Dims) -> [DVec3; 8] {
    let (world, origin) = (geometry.linear(), DVec3::from_array(geometry.origin));
    std::array::from_fn(|corner| {
        let index = [0, 1, 2].map(|a| if corner >> a & 1 == 0 { 0.0 } else { dims.0[a] as f64 } - HALF_VOXEL);
        world * DVec3::from_array(index) + origin
    })
}

/// The least depth of a corner of the volume's domain, from the eye; may be negative.
fn nearest_depth(camera: &Camera, geometry: &Geometry, dims: Dims) -> f64 {
    let depth = |p: DVec3| (p - camera.eye).dot(camera.forward);
    corners_of_volume(geometry, dims).map(depth).into_iter().fold(f64::INFINITY, f64::min)
}

/// World length of the longest step from a voxel to its neighbour.
fn greatest_step(geometry: &Geometry) -> f64 {
    let world = geometry.linear();
    [world.x_axis, world.y_axis, world.z_axis].map(DVec3::length).into_iter().fold(0.0, f64::max)
}

fn corners_of(camera: &Camera) -> [[f64; 2]; 4] {
    let [x, y] = [camera.width - 1, camera.height - 1].map(f64::from);
    [[0.0, 0.0], [x, 0.0], [0.0, y], [x, y]]
}

fn affine(line: LinearNumber<f64>) -> Affine {
    Affine { base: fixed(line.base), per_x: fixed(line.per_x), per_y: fixed(line.per_y) }
}

/// The number in fixed point, rounded towards zero; its whole part must fit 32 bits.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the number is cut into words")]
fn fixed(value: f64) -> Fixed {
    // Multiplying by a power of two is exact.
    let bits = whole::<i128>(value * 2f64.powi(64));
    Fixed { whole: (bits >> 64) as i32, high: (bits >> 32) as u32, low: bits as u32 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_has_a_place_of_its_own() {
        let grid = RayGrid { width: 21, height: 19 };
        let tiles = grid.tiles();
        assert_eq!(grid.places(), u64::from(tiles[0] * tiles[1] * WORKGROUP_RAYS));
        (0..grid.places()).for_each(|place| assert_eq!(grid.place_of(grid.pixel(place)), place));
    }

    #[test]
    fn fixed_numbers_are_what_they_were() {
        for value in [0.0, 1.0, -1.0, 0.75, -2.125, 1e9 + 1.0 / 1024.0, -1e9 - 1.0 / 1024.0, 1e-12, -1e-12] {
            let f = fixed(value);
            let back = f64::from(f.whole) + f64::from(f.high) * 2f64.powi(-32) + f64::from(f.low) * 2f64.powi(-64);
            assert!((back - value).abs() <= value.abs() * 1e-15 + 2f64.powi(-63), "{value}: {f:?}, {back}");
        }
    }
}
