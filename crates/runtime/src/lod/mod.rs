//! Level-of-detail rules: how fine a brick must be. Pure functions without state.
//!
//! Both rules decide about whole bricks, so that all rays of a picture agree about a brick. [`LodRule`] compares voxel
//! and pixel sizes: at the brick's point nearest to the eye, a voxel may cover at most the tolerated number of pixels.
//! It depends on the camera alone; larger voxels are never drawn. [`by_error`] decides whether the picture stays right
//! when the brick is drawn. It depends on the table of contents and the transfer function; a brick that is too coarse
//! is replaced by its children. [`deviation`] states how far a drawn picture may be off.

pub mod by_error;
pub mod deviation;

use glam::{DMat3, DVec3};
use supervol_format::space::HALF_VOXEL;
use supervol_format::{BrickKey, Geometry, Lod, Pyramid};
use supervol_scene::camera::{Camera, Projection};

/// Choice of the level of bricks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LodChoice {
    /// This level everywhere; the coarsest one if the pyramid has fewer levels.
    Fixed(Lod),
    /// The coarsest level whose voxels cover at most this many pixels (1 for a full-quality picture).
    Auto {
        /// Pixels that one voxel may cover.
        voxel_pixels: f64,
    },
}

/// [`LodChoice`] for one camera and one volume.
#[derive(Debug, Clone)]
pub struct LodRule {
    choice: LodChoice,
    /// Index offsets of level 0 to world offsets.
    world_from_index: DMat3,
    /// The eye in index coordinates of level 0.
    eye: DVec3,
    /// World height of a pixel: at distance 1 for perspective cameras, everywhere for orthographic ones.
    pixel_height: f64,
    projection: Projection,
}

impl LodRule {
    /// The rule for this camera.
    #[must_use]
    pub fn new(choice: LodChoice, camera: &Camera, geometry: &Geometry) -> Self {
        let world_from_index = geometry.linear();
        let eye = world_from_index.inverse() * (camera.eye - DVec3::from_array(geometry.origin));
        let pixel_height = camera.pixel_height();
        Self { choice, world_from_index, eye, pixel_height, projection: camera.projection }
    }

    /// Whether the brick need not be refined. Level 0 is always fine enough.
    #[must_use]
    pub fn is_fine_enough(&self, pyramid: &Pyramid, key: BrickKey) -> bool {
        if key.lod() == Lod::FINEST {
            return true;
        }
        let voxel_pixels = match self.choice {
            LodChoice::Fixed(lod) => return key.lod() <= lod,
            LodChoice::Auto { voxel_pixels } => voxel_pixels,
        };
        let (voxel_world, pixel_world) = self.sizes(pyramid, key);
        voxel_world <= voxel_pixels * pixel_world
    }

    /// Pixels covered by the longest edge of one of the brick's voxels, at the brick's point nearest to the eye.
    /// Infinite if the eye lies in the brick.
    #[must_use]
    pub fn voxel_pixels(&self, pyramid: &Pyramid, key: BrickKey) -> f64 {
        let (voxel_world, pixel_world) = self.sizes(pyramid, key);
        voxel_world / pixel_world
    }

    /// World length of the longest edge of one of the brick's voxels, and of a pixel at the brick's point nearest to
    /// the eye.
    fn sizes(&self, pyramid: &Pyramid, key: BrickKey) -> (f64, f64) {
        let scale = pyramid.level_at(key.lod()).scale;
        let m = &self.world_from_index;
        let voxel_edges = [m.x_axis.length(), m.y_axis.length(), m.z_axis.length()];
        let voxel_world = (0..3).map(|a| voxel_edges[a] * scale[a] as f64).fold(0.0, f64::max);
        let pixel_world = match self.projection {
            Projection::Perspective { .. } => self.pixel_height * self.distance(pyramid, key),
            Projection::Orthographic { .. } => self.pixel_height,
        };
        (voxel_world, pixel_world)
    }

    /// World distance from the eye to the brick; exact if the grid's axes are orthogonal.
    #[must_use]
    pub fn distance(&self, pyramid: &Pyramid, key: BrickKey) -> f64 {
        let level = pyramid.level_at(key.lod());
        let dims = pyramid.level_at(Lod::FINEST).dims.0;
        let core = pyramid.core_box(key);
        let nearest = DVec3::from_array(std::array::from_fn(|a| {
            let low = (core.start[a] * level.scale[a]) as f64 - HALF_VOXEL;
            let high = (core.end[a] * level.scale[a]).min(dims[a]) as f64 - HALF_VOXEL;
            self.eye[a].clamp(low, high)
        }));
        (self.world_from_index * (nearest - self.eye)).length()
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::{BrickIndex, BrickLayout, Dims};

    use super::*;

    #[test]
    fn farther_bricks_may_be_coarser() {
        let layout = BrickLayout::new(16).unwrap();
        let pyramid = Pyramid::new(Dims([64, 16, 16]), layout, &[[2, 2, 2], [2, 2, 2]]).unwrap();
        let camera = |distance: f64| {
            let eye = DVec3::new(-0.5 - distance, 7.5, 7.5);
            let projection = Projection::Perspective { fov_y: 2.0 * 0.5f64.atan().to_degrees() };
            Camera::look_at(eye, eye + DVec3::X, DVec3::Z, projection, [100, 100]).unwrap()
        };
        let rule =
            |distance: f64| LodRule::new(LodChoice::Auto { voxel_pixels: 1.0 }, &camera(distance), &Geometry::IDENTITY);
        let key = |lod, x| BrickKey::new(Lod(lod), BrickIndex([x, 0, 0]));
        // A pixel is 1/100 high at distance 1: voxels of 2 cover one pixel from distance 200 on.
        assert!(!rule(199.9).is_fine_enough(&pyramid, key(1, 0)));
        assert!(rule(200.1).is_fine_enough(&pyramid, key(1, 0)));
        assert!(rule(199.9).is_fine_enough(&pyramid, key(1, 1)), "the second brick begins 32 voxels later");
        assert!(!rule(200.1).is_fine_enough(&pyramid, key(2, 0)));
        assert!(rule(-8.0).is_fine_enough(&pyramid, key(0, 0)) && !rule(-8.0).is_fine_enough(&pyramid, key(1, 0)));
        let fixed = LodRule::new(LodChoice::Fixed(Lod(1)), &camera(5.0), &Geometry::IDENTITY);
        assert!(fixed.is_fine_enough(&pyramid, key(1, 0)) && !fixed.is_fine_enough(&pyramid, key(2, 0)));
    }
}
