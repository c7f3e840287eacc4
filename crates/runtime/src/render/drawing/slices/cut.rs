//! Rays, and the slices that cut them into parts.

use glam::DVec3;
use supervol_format::{Container, Dims};
use supervol_scene::camera::PixelRays;
use supervol_scene::clip::{ClipPlane, ToIndex, clip_ray};
use supervol_scene::scene::ResolvedScene;
use supervol_scene::slices::{SLICE_LIMIT, SlicePlane, crossings};
use supervol_scene::units::InUnits;

/// Least length of a part of a ray, as a share of it. Shorter parts, between two slices in one place, are ignored.
const LEAST_PART: f64 = 1e-12;

/// A region's side of each slice: bit `i` is set on the side that the normal of slice `i` points to.
pub(super) type Sides = u16;
const _: () = assert!(SLICE_LIMIT <= Sides::BITS as usize);

/// A part of a ray, front to back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum RayPart {
    Volume(Sides),
    /// Slice number, and position on the ray.
    Slice(usize, f64),
}

/// Rays, and the slices that cut them.
pub(super) struct Cut {
    rays: PixelRays,
    pub(super) to_index: ToIndex,
    pub(super) dims: Dims,
    pub(super) scene: ResolvedScene,
}

impl Cut {
    /// The rays of a scene.
    pub(super) fn new(scene: &ResolvedScene, container: &Container) -> Self {
        Self {
            rays: scene.camera.rays(),
            to_index: ToIndex::new(&InUnits::of(container).geometry),
            dims: container.descriptor().dims(),
            scene: scene.clone(),
        }
    }

    /// Number of rays along x and y.
    pub(super) fn rays_size(&self) -> [u32; 2] {
        [self.scene.camera.width, self.scene.camera.height]
    }

    /// The parts of a ray, front to back.
    pub(super) fn parts(&self, x: u32, y: u32) -> Vec<RayPart> {
        let ray = self.rays.ray(x, y);
        let Some(segment) = clip_ray(&ray, &self.to_index.ray(&ray), self.dims, &self.scene.clip) else {
            return Vec::new();
        };
        let slices = &self.scene.slices;
        let least = LEAST_PART * (segment.t1 - segment.t0);
        let mut parts = Vec::with_capacity(2 * slices.len() + 1);
        let mut before = segment.t0;
        let volume = |from: f64, to: f64| {
            let middle = ray.origin + 0.5 * (from + to) * ray.direction;
            (to - from > least).then(|| RayPart::Volume(sides_of(slices, middle)))
        };
        for (t, number) in crossings(slices, &ray, segment) {
            parts.extend(volume(before, t));
            let point = ray.origin + t * ray.direction;
            if self.scene.clip.solids.iter().all(|solid| solid.keeps(point)) {
                parts.push(RayPart::Slice(number, t));
            }
            before = t;
        }
        parts.extend(volume(before, segment.t1));
        parts
    }

    /// The scene of one region, with a pixel for each ray.
    pub(super) fn region(&self, sides: Sides) -> ResolvedScene {
        let mut scene =
            ResolvedScene { image_size: self.rays_size(), subgrid: 1, slices: Vec::new(), ..self.scene.clone() };
        scene.clip.planes.extend(self.scene.slices.iter().enumerate().map(|(i, slice)| {
            let side = if sides >> i & 1 == 1 { 1.0 } else { -1.0 };
            ClipPlane { normal: side * slice.normal, offset: side * slice.offset }
        }));
        scene
    }

    /// The point at which a ray meets a slice.
    pub(super) fn point_on(&self, number: usize, x: u32, y: u32) -> Option<DVec3> {
        let at = self.parts(x, y).into_iter().find_map(|part| match part {
            RayPart::Slice(of, t) if of == number => Some(t),
            _ => None,
        })?;
        let ray = self.rays.ray(x, y);
        Some(ray.origin + at * ray.direction)
    }
}

/// The sides of the slices at a point.
fn sides_of(slices: &[SlicePlane], p: DVec3) -> Sides {
    slices.iter().enumerate().map(|(i, slice)| Sides::from(slice.is_before(p)) << i).sum()
}
