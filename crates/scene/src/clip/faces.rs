//! Faces of cuts: where rays enter what clipping leaves, and the normals there (RENDERING-MODEL, section 5).
//!
//! A part of a ray begins at a *cut face* if the clip box, a clip plane or a solid cuts it off there. It begins at none at the
//! volume's own ends and at the eye. Positions are those of [`clip_parts`], bit for bit. Normals are unit vectors of the world;
//! their sign has no meaning, as light is two-sided.

use glam::DVec3;
use supervol_format::{Dims, Geometry};

use super::interval::{half_space, slab};
use super::{Clip, IndexRay, clip_parts, solids};
use crate::camera::Ray;

/// Distance behind a cut face, in smallest spacings along the ray, up to which only the cut's normal counts. The central
/// differences of a voxel reach one voxel to each side.
pub const FACE_VOXELS: f64 = 2.0;
/// Distance from which on only the gradient counts.
pub const FADED_VOXELS: f64 = 4.0;

/// Cuts that light the matter behind their faces.
#[derive(Debug, Clone, PartialEq)]
pub struct CutNormals {
    /// The cuts. A picture may be drawn in parts, with further planes; these are no cuts.
    pub clip: Clip,
    /// For each axis, whether the least and the greatest face of the clip box are cuts. The others are ends of the volume.
    pub box_cuts: [[bool; 2]; 3],
    /// Normals of the box's faces.
    pub box_normals: [DVec3; 3],
    /// Lengths behind a face, along the ray: up to the first only the cut's normal counts, from the second on only the gradient.
    pub depths: [f64; 2],
}

/// A place at which a ray enters what clipping leaves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CutFace {
    /// World length.
    pub t: f64,
    /// Unit normal of the cut.
    pub normal: DVec3,
}

impl CutNormals {
    /// Cuts of a volume of this size and place.
    #[must_use]
    pub fn new(clip: &Clip, dims: Dims, geometry: &Geometry) -> Self {
        let to_world = geometry.world_from_index_gradient();
        let whole = Clip::default();
        let box_cuts = std::array::from_fn(|axis| {
            let [[low, high], [first, last]] = [clip, &whole].map(|clip| clip.slab_of(dims, axis));
            [low > first, high < last]
        });
        Self {
            clip: clip.clone(),
            box_cuts,
            box_normals: [0, 1, 2].map(|axis| to_world.col(axis).normalize_or_zero()),
            depths: [FACE_VOXELS, FADED_VOXELS].map(|voxels| voxels * geometry.smallest_spacing()),
        }
    }

    /// The cut faces of a ray, front to back.
    #[must_use]
    pub fn faces(&self, ray: &Ray, index_ray: &IndexRay, dims: Dims) -> Vec<CutFace> {
        let parts = clip_parts(ray, index_ray, dims, &self.clip);
        let (begin, first) = self.first_face(ray, index_ray, dims);
        let normal = |t: f64| match first {
            _ if t > begin => solids::normal_at(&self.clip.solids, ray, t),
            first => first,
        };
        let face = |t: f64| normal(t).filter(|n| *n != DVec3::ZERO).map(|normal| CutFace { t, normal });
        parts.into_iter().filter_map(|part| face(part.t0)).collect()
    }

    /// The face behind which the part of a ray lies that ends at `t1`. Only what lies in one part has one face.
    #[must_use]
    pub fn face_before(&self, t1: f64, ray: &Ray, index_ray: &IndexRay, dims: Dims) -> Option<CutFace> {
        self.faces(ray, index_ray, dims).into_iter().rev().find(|face| face.t < t1)
    }

    /// Beginning of what box and planes leave of a ray, and the normal there if it is a cut. Of several cuts in one place, the
    /// first counts.
    fn first_face(&self, ray: &Ray, index_ray: &IndexRay, dims: Dims) -> (f64, Option<DVec3>) {
        let mut first = (ray.t_min, None);
        for axis in 0..3 {
            let [origin, direction] = [index_ray.origin[axis], index_ray.direction[axis]];
            let (t, _) = slab(origin, direction, self.clip.slab_of(dims, axis));
            if t > first.0 {
                let is_cut = self.box_cuts[axis][usize::from(direction < 0.0)];
                first = (t, is_cut.then_some(self.box_normals[axis]));
            }
        }
        for plane in &self.clip.planes {
            let (t, _) = half_space(plane.normal.dot(ray.origin) - plane.offset, plane.normal.dot(ray.direction));
            if t > first.0 {
                first = (t, Some(plane.normal.normalize_or_zero()));
            }
        }
        first
    }

    /// Weight of the light by a cut's normal, at this length behind its face: 1 at the face, 0 deep inside.
    #[inline]
    #[must_use]
    pub fn weight(&self, behind: f64) -> f64 {
        let [full, none] = self.depths;
        ((none - behind) / (none - full)).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use proptest::prelude::*;

    use super::*;
    use crate::clip::mesh::ClosedMesh;
    use crate::clip::solids::{Keep, PlacedMesh, Shape, Solid};
    use crate::clip::{ClipPlane, ROUNDED_LENGTH};

    const DIMS: Dims = Dims([20, 20, 20]);

    fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray { origin: origin.into(), direction: DVec3::from(direction).normalize(), t_min: 0.0 }
    }

    fn found(clip: &Clip, ray: &Ray) -> Vec<(f64, [f64; 3])> {
        let cuts = CutNormals::new(clip, DIMS, &Geometry::IDENTITY);
        let faces = cuts.faces(ray, &IndexRay::new(ray, &Geometry::IDENTITY), DIMS);
        // Roots are rounded.
        let rounded = |x: f64| (x * 1e12).round() / 1e12 + 0.0;
        faces.into_iter().map(|face| (rounded(face.t), face.normal.to_array().map(rounded))).collect()
    }

    fn sphere(keep: Keep) -> Solid {
        Solid { shape: Shape::Sphere { center: DVec3::splat(10.0), radius: 5.0 }, keep }
    }

    #[test]
    fn each_cut_has_its_own_normal() {
        let along_x = ray([-5.0, 10.0, 10.0], [1.0, 0.0, 0.0]);
        // The ends of the volume are no cuts, nor is a box's face there, nor the eye.
        assert_eq!(found(&Clip::default(), &along_x), []);
        let index_box = Some([[-0.5, -0.5, -0.5], [9.0, 19.5, 19.5]]);
        let cropped = Clip { index_box, ..Clip::default() };
        assert_eq!(found(&cropped, &along_x), []);
        assert_eq!(found(&cropped, &ray([30.0, 10.0, 10.0], [-1.0, 0.0, 0.0])), [(21.0, [1.0, 0.0, 0.0])]);
        let inside = ray([5.0, 10.0, 10.0], [1.0, 0.0, 0.0]);
        assert_eq!(found(&cropped, &inside), []);
        let plane = ClipPlane { normal: DVec3::new(3.0, 4.0, 0.0), offset: 76.0 };
        let cut = Clip { planes: vec![plane], ..cropped.clone() };
        assert_eq!(found(&cut, &along_x), [], "a plane behind the box leaves nothing");
        let cut = Clip { planes: vec![plane], ..Clip::default() };
        assert_eq!(found(&cut, &along_x), [(17.0, [0.6, 0.8, 0.0])]);
        let solids = vec![sphere(Keep::Inside)];
        assert_eq!(found(&Clip { solids, ..Clip::default() }, &along_x), [(10.0, [-1.0, 0.0, 0.0])]);
        // A hole: the ray begins at the end of the volume, and enters again behind the hole.
        let solids = vec![sphere(Keep::Outside)];
        assert_eq!(found(&Clip { solids: solids.clone(), ..Clip::default() }, &along_x), [(20.0, [1.0, 0.0, 0.0])]);
        let plane = ClipPlane { normal: DVec3::new(2.0, 0.0, 0.0), offset: 6.0 };
        let both = Clip { solids, planes: vec![plane], index_box: None };
        assert_eq!(found(&both, &along_x), [(8.0, [1.0, 0.0, 0.0]), (20.0, [1.0, 0.0, 0.0])]);
    }

    #[test]
    fn normals_of_a_box_are_those_of_its_planes_in_the_world() {
        // Sheared: the planes of voxels across y are not at right angles to the second axis.
        let direction = [1.0, 0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let geometry = Geometry { spacing: [1.0, 2.0, 3.0], direction, ..Geometry::IDENTITY };
        let cuts = CutNormals::new(&Clip::default(), DIMS, &geometry);
        let linear = geometry.linear();
        for axis in 0..3 {
            for other in (0..3).filter(|other| *other != axis) {
                assert!(cuts.box_normals[axis].dot(linear.col(other)).abs() < 1e-12, "{axis}, {other}");
            }
            assert!((cuts.box_normals[axis].length() - 1.0).abs() < 1e-12);
        }
        assert_eq!(cuts.depths, [2.0, 4.0]);
        assert_eq!([0.0, 2.0, 3.0, 4.0, 9.0].map(|behind| cuts.weight(behind)), [1.0, 1.0, 0.5, 0.0, 0.0]);
    }

    #[test]
    fn a_mesh_has_the_normals_of_its_triangles() {
        let corners: Vec<DVec3> =
            (0..8).map(|n| 8.0 * DVec3::from([n & 1, n >> 1 & 1, n >> 2].map(f64::from))).collect();
        let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let faces: Vec<[u32; 3]> = sides.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let mesh = Arc::new(ClosedMesh::new(&corners, &faces).expect("a cube is closed"));
        // Twice as large in units of the picture, and moved.
        let placed = PlacedMesh { mesh, anchor: DVec3::splat(-1.0), length: 0.5 };
        let solid = |keep| vec![Solid { shape: Shape::Mesh(placed.clone()), keep }];
        let along_y = ray([5.0, -5.0, 6.0], [0.0, 1.0, 0.0]);
        let inside = found(&Clip { solids: solid(Keep::Inside), ..Clip::default() }, &along_y);
        assert!(inside.len() == 1 && inside[0].0 == 7.0 && inside[0].1[1].abs() == 1.0, "{inside:?}");
        let outside = found(&Clip { solids: solid(Keep::Outside), ..Clip::default() }, &along_y);
        assert!(outside.len() == 1 && outside[0].0 == 23.0 && outside[0].1[1].abs() == 1.0, "{outside:?}");
    }

    proptest! {
        /// Every part that does not begin at the volume's end has a face, whose normal is that of a cut through its place.
        #[test]
        fn faces_lie_on_cuts(
            origin in prop::array::uniform3(-30.0..50.0f64),
            target in prop::array::uniform3(3.0..17.0f64),
            centers in prop::collection::vec(prop::array::uniform3(4.0..16.0f64), 4),
            sizes in prop::array::uniform3(1.0..7.0f64),
            keeps in prop::array::uniform3(any::<bool>()),
        ) {
            let direction = DVec3::from(target) - DVec3::from(origin);
            prop_assume!(direction.length() > 1.0);
            let ray = ray(origin, direction.to_array());
            let keep = |inside: bool| if inside { Keep::Inside } else { Keep::Outside };
            let [a, b, c, d] = [0, 1, 2, 3].map(|i| DVec3::from(centers[i]));
            let axis = (DVec3::from(target) - a + DVec3::new(0.1, 0.2, 0.3)).normalize_or(DVec3::X);
            let across = axis.any_orthonormal_vector();
            let axes = [axis, across, axis.cross(across)];
            let solids = vec![
                Solid { shape: Shape::Sphere { center: a, radius: sizes[0] }, keep: keep(keeps[0]) },
                Solid { shape: Shape::Cuboid { center: b, axes, half_edges: [2.0, sizes[1], 3.0] }, keep: keep(keeps[1]) },
                Solid { shape: Shape::Cylinder { from: c, axis, length: 6.0, radius: sizes[2] }, keep: keep(keeps[2]) },
            ];
            let plane = ClipPlane { normal: 3.0 * across, offset: 3.0 * across.dot(d) };
            let clip = Clip { index_box: Some([[2.0, -9.0, 1.5], [99.0, 18.0, 17.0]]), planes: vec![plane], solids };
            let index_ray = IndexRay::new(&ray, &Geometry::IDENTITY);
            let parts = clip_parts(&ray, &index_ray, DIMS, &clip);
            let cuts = CutNormals::new(&clip, DIMS, &Geometry::IDENTITY);
            let faces = cuts.faces(&ray, &index_ray, DIMS);
            for part in &parts {
                let p = ray.origin + part.t0 * ray.direction;
                let is_end = part.t0 == 0.0 || (p.x - 19.5).abs() < 1e-9 || (p.y + 0.5).abs() < 1e-9;
                let face = faces.iter().find(|face| face.t == part.t0);
                prop_assert!(is_end || face.is_some(), "no face at {p}");
                let Some(CutFace { normal, .. }) = face else { continue };
                // The cut lies across its normal: steps along the face change nothing but the curvature.
                let near = |x: f64| x.abs() < 1e-6;
                let radial = p - c - axis.dot(p - c) * axis;
                let along = |of: DVec3| normal.dot(of.normalize_or_zero()).abs() > 1.0 - 1e-9;
                let local = axes.map(|axis| axis.dot(p - b));
                let is_on = [
                    (near(p.x - 2.0) && along(DVec3::X)) || (near(p.y - 18.0) && along(DVec3::Y)),
                    (near(p.z - 1.5) || near(p.z - 17.0)) && along(DVec3::Z),
                    near(across.dot(p - d)) && along(across),
                    near((p - a).length() - sizes[0]) && along(p - a),
                    (0..3).any(|i| near(local[i].abs() - [2.0, sizes[1], 3.0][i]) && along(axes[i])),
                    near(radial.length() - sizes[2]) && along(radial),
                    (near(axis.dot(p - c)) || near(axis.dot(p - c) - 6.0)) && along(axis),
                ];
                prop_assert!(is_on.contains(&true), "{normal} at {p} belongs to no cut");
            }
            prop_assert!(faces.iter().all(|face| parts.iter().any(|part| part.t0 == face.t)));
            for part in parts.iter().filter(|part| part.t1 - part.t0 > ROUNDED_LENGTH) {
                let of_part = faces.iter().find(|face| face.t == part.t0).copied();
                let found = cuts.face_before(0.5 * (part.t0 + part.t1), &ray, &index_ray, DIMS);
                prop_assert!(of_part.is_none() || found == of_part, "{found:?} instead of {of_part:?}");
            }
        }
    }
}
