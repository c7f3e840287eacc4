//! Clipping: cuts a ray to the segments that are drawn (RENDERING-MODEL, section 7).
//!
//! The volume's domain, the clip box (index space) and the clip planes (world space) are convex: together they leave at
//! most one segment ([`clip_ray`]). Solids ([`solids`]) cut it into several parts ([`clip_parts`]). All numbers are
//! `f64`; t is a world length. Direction components may be zero, negative zero, or so small that a crossing overflows.

pub mod faces;
mod interval;
pub mod mesh;
pub mod mesh_file;
pub mod solids;

use glam::{DMat3, DVec3};
use supervol_format::space::HALF_VOXEL;
use supervol_format::{Dims, Geometry};

pub use self::interval::{Segment, clip_half_space, clip_slab, cut, half_space, slab};
use self::solids::{Shape, Solid};
use crate::camera::Ray;

/// Parts of a ray of at most this length, in voxels of level 0 along any axis, may be rounding errors. Modes in which a
/// value counts whatever the length of its chord (`mip`, `minip`, `mean`) ignore them.
pub const ROUNDED_LENGTH: f64 = 1e-7;

/// A half-space of world points: those with `normal . x >= offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipPlane {
    /// World vector, not zero; any length.
    pub normal: DVec3,
    /// Least `normal . x` that is kept.
    pub offset: f64,
}

/// Regions of the volume's domain that are kept.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Clip {
    /// Least and greatest corner in index coordinates.
    pub index_box: Option<[[f64; 3]; 2]>,
    /// Half-spaces; a point must lie in all of them.
    pub planes: Vec<ClipPlane>,
    /// Solids; a point must lie on the kept side of each.
    pub solids: Vec<Solid>,
}

impl Clip {
    /// Bytes of memory of all meshes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let bytes = |solid: &Solid| if let Shape::Mesh(placed) = &solid.shape { placed.mesh.bytes() } else { 0 };
        self.solids.iter().map(bytes).sum()
    }

    /// Index coordinates along an axis that the domain and the clip box leave: least and greatest.
    #[must_use]
    pub fn slab_of(&self, dims: Dims, axis: usize) -> [f64; 2] {
        let (low, high) = (-HALF_VOXEL, dims.0[axis] as f64 - HALF_VOXEL);
        self.index_box.map_or([low, high], |corners| [low.max(corners[0][axis]), high.min(corners[1][axis])])
    }
}

/// A ray in index space: `origin + t * direction`, t still a world length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IndexRay {
    /// Index point at t = 0.
    pub origin: [f64; 3],
    /// Index offset per world length.
    pub direction: [f64; 3],
}

/// Transform from world space to the index space of a grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToIndex {
    index_from_world: DMat3,
    origin: DVec3,
}

impl ToIndex {
    /// The transform into the index space of this grid.
    #[must_use]
    pub fn new(geometry: &Geometry) -> Self {
        Self { index_from_world: geometry.linear().inverse(), origin: DVec3::from_array(geometry.origin) }
    }

    /// A world point in index space.
    #[inline(always)]
    #[must_use]
    pub fn point(&self, world: DVec3) -> [f64; 3] {
        (self.index_from_world * (world - self.origin)).to_array()
    }

    /// The ray in index space.
    #[inline(always)]
    #[must_use]
    pub fn ray(&self, ray: &Ray) -> IndexRay {
        IndexRay { origin: self.point(ray.origin), direction: (self.index_from_world * ray.direction).to_array() }
    }
}

impl IndexRay {
    /// The ray in the index space of a grid.
    #[must_use]
    pub fn new(ray: &Ray, geometry: &Geometry) -> Self {
        ToIndex::new(geometry).ray(ray)
    }

    /// The index point at t.
    #[must_use]
    pub fn at(&self, t: f64) -> [f64; 3] {
        std::array::from_fn(|a| self.origin[a] + t * self.direction[a])
    }
}

/// The parts of a ray inside the domain, the clip box and all clip planes that all solids keep: disjoint, front to
/// back. Their number is at most the number of solid faces on the ray.
#[must_use]
pub fn clip_parts(ray: &Ray, index_ray: &IndexRay, dims: Dims, clip: &Clip) -> Vec<Segment> {
    let segment = clip_ray(ray, index_ray, dims, clip);
    segment.map_or_else(Vec::new, |segment| solids::kept(&clip.solids, ray, segment))
}

/// The part of a ray inside the domain, the clip box and all clip planes. Solids are ignored.
#[must_use]
pub fn clip_ray(ray: &Ray, index_ray: &IndexRay, dims: Dims, clip: &Clip) -> Option<Segment> {
    let mut interval = (ray.t_min, f64::INFINITY);
    for axis in 0..3 {
        let [low, high] = clip.slab_of(dims, axis);
        interval = clip_slab(index_ray.origin[axis], index_ray.direction[axis], low, high, interval)?;
    }
    for plane in &clip.planes {
        let distance = plane.normal.dot(ray.origin) - plane.offset;
        interval = clip_half_space(distance, plane.normal.dot(ray.direction), interval)?;
    }
    let (t0, t1) = interval;
    // A line leaves the bounded domain, so both ends are finite, except for components near underflow.
    (t0.is_finite() && t1.is_finite() && t0 < t1).then_some(Segment { t0, t1 })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ray(origin: [f64; 3], direction: [f64; 3], t_min: f64) -> Ray {
        Ray { origin: origin.into(), direction: direction.into(), t_min }
    }

    fn clipped(ray: &Ray, clip: &Clip) -> Option<(f64, f64)> {
        let index_ray = IndexRay::new(ray, &Geometry::IDENTITY);
        clip_ray(ray, &index_ray, Dims([10, 10, 10]), clip).map(|s| (s.t0, s.t1))
    }

    #[test]
    fn the_domain_is_cell_centred() {
        let r = ray([-5.0, 4.0, 4.0], [1.0, 0.0, 0.0], 0.0);
        assert_eq!(clipped(&r, &Clip::default()), Some((4.5, 14.5)));
        let r = ray([4.0, 4.0, 4.0], [1.0, 0.0, -0.0], 0.0);
        assert_eq!(clipped(&r, &Clip::default()), Some((0.0, 5.5)));
        let r = ray([4.0, 4.0, 4.0], [-1.0, 1e-30, 0.0], f64::NEG_INFINITY);
        assert_eq!(clipped(&r, &Clip::default()), Some((-5.5, 4.5)));
        assert_eq!(clipped(&ray([4.0, 11.0, 4.0], [1.0, 0.0, 0.0], 0.0), &Clip::default()), None);
        assert_eq!(clipped(&ray([4.0, 11.0, 4.0], [1.0, 1e-30, 0.0], 0.0), &Clip::default()), None);
        assert_eq!(clipped(&ray([14.0, 4.0, 4.0], [1.0, 0.0, 0.0], 0.0), &Clip::default()), None);
    }

    #[test]
    fn boxes_and_planes_cut_where_they_stand() {
        let r = ray([-5.0, 4.0, 4.0], [1.0, 0.0, 0.0], 0.0);
        let index_box = Some([[1.25, -9.0, -9.0], [3.75, 99.0, 99.0]]);
        assert_eq!(clipped(&r, &Clip { index_box, ..Clip::default() }), Some((6.25, 8.75)));
        let plane = |normal: [f64; 3], offset| ClipPlane { normal: normal.into(), offset };
        let planes = vec![plane([2.0, 0.0, 0.0], 4.0), plane([-1.0, 0.0, 0.0], -6.0)];
        assert_eq!(clipped(&r, &Clip { planes, ..Clip::default() }), Some((7.0, 11.0)));
        let planes = vec![plane([0.0, 1.0, 0.0], 4.5)];
        assert_eq!(clipped(&r, &Clip { planes, ..Clip::default() }), None);
        let planes = vec![plane([1.0, 0.0, 0.0], 20.0)];
        assert_eq!(clipped(&r, &Clip { planes, ..Clip::default() }), None);
    }

    #[test]
    fn rays_aimed_at_the_corner_never_make_nan() {
        for ulps in -3i64..=3 {
            let nudge = |v: f64| f64::from_bits((v.to_bits() as i64 + ulps) as u64);
            let direction = DVec3::new(nudge(1.0), 1.0, nudge(1.0)).normalize();
            let r = Ray { origin: DVec3::splat(-10.5), direction, t_min: 0.0 };
            if let Some((t0, t1)) = clipped(&r, &Clip::default()) {
                assert!(t0.is_finite() && t1 > t0);
            }
        }
    }
}
