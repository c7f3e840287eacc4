//! Clipping by solids: spheres, boxes, cylinders and closed meshes. The inside or the outside of each is kept
//! (docs/decisions/022-solids-and-picking.md).
//!
//! The points at which a ray enters and leaves a solid are computed in closed form, in `f64`. Several solids keep the
//! intersection of their kept regions. The result for a ray is a sorted list of disjoint segments. Points, axes and
//! lengths are in the units of a picture ([`crate::units`]); t is a world length.

use std::sync::Arc;

use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::interval::{Segment, clip_slab, slab};
use super::mesh::ClosedMesh;
use crate::camera::Ray;

/// Most solids of one scene.
pub const SOLID_LIMIT: usize = 64;
/// The whole line.
const EVERYTHING: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

/// Side of a solid that is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Keep {
    /// Keeps the inside.
    #[default]
    Inside,
    /// Keeps the outside.
    Outside,
}

/// A solid and the side of it that is kept.
#[derive(Debug, Clone, PartialEq)]
pub struct Solid {
    /// Shape and position.
    pub shape: Shape,
    /// The side that is kept.
    pub keep: Keep,
}

/// Shape and position of a solid, in units of a picture.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// All points nearer to `center` than `radius`.
    Sphere {
        /// Centre.
        center: DVec3,
        /// Length, positive.
        radius: f64,
    },
    /// All points whose distance from `center` along each axis is less than half an edge.
    Cuboid {
        /// Centre.
        center: DVec3,
        /// Unit vectors at right angles to each other.
        axes: [DVec3; 3],
        /// Lengths, positive.
        half_edges: [f64; 3],
    },
    /// All points nearer than `radius` to a line segment, between the planes across its ends.
    Cylinder {
        /// Beginning of the line segment.
        from: DVec3,
        /// Direction of the line segment, a unit vector.
        axis: DVec3,
        /// Length of the line segment, positive.
        length: f64,
        /// Length, positive.
        radius: f64,
    },
    /// All points inside a closed mesh.
    Mesh(PlacedMesh),
}

/// A mesh in world coordinates with the conversion from units. Rays are converted to world coordinates before they are
/// cut.
#[derive(Debug, Clone)]
pub struct PlacedMesh {
    /// The mesh, in world coordinates.
    pub mesh: Arc<ClosedMesh>,
    /// World position of the origin of units.
    pub anchor: DVec3,
    /// World length of one unit.
    pub length: f64,
}

impl PartialEq for PlacedMesh {
    /// Compares pointers first: usually both are the same mesh, and comparing all triangles is expensive.
    fn eq(&self, other: &Self) -> bool {
        (self.anchor, self.length) == (other.anchor, other.length)
            && (Arc::ptr_eq(&self.mesh, &other.mesh) || self.mesh == other.mesh)
    }
}

/// The parts of a segment that all solids keep, front to back, none of them empty.
#[must_use]
pub fn kept(solids: &[Solid], ray: &Ray, segment: Segment) -> Vec<Segment> {
    let mut kept = vec![(segment.t0, segment.t1)];
    for solid in solids {
        let inside = solid.shape.spans(ray);
        kept = match solid.keep {
            Keep::Inside => common(&kept, &inside),
            Keep::Outside => common(&kept, &complement(&inside)),
        };
        if kept.is_empty() {
            break;
        }
    }
    kept.into_iter().map(|(t0, t1)| Segment { t0, t1 }).collect()
}

/// The normal of the solid at whose face a kept part of a ray begins at `t`, exactly; `None` if none does. Of several, the first
/// counts.
#[must_use]
pub fn normal_at(solids: &[Solid], ray: &Ray, t: f64) -> Option<DVec3> {
    let begins = |solid: &&Solid| {
        let inside = solid.shape.spans(ray);
        match solid.keep {
            Keep::Inside => inside.iter().any(|span| span.0 == t),
            Keep::Outside => inside.iter().any(|span| span.1 == t),
        }
    };
    solids.iter().find(begins).map(|solid| solid.shape.normal_at(ray, t))
}

impl Solid {
    /// Whether a point is kept. Points on a face belong to the inside.
    #[must_use]
    pub fn keeps(&self, point: DVec3) -> bool {
        let ray = Ray { origin: point, direction: DVec3::Z, t_min: f64::NEG_INFINITY };
        let is_inside = self.shape.spans(&ray).iter().any(|&(t0, t1)| t0 <= 0.0 && 0.0 <= t1);
        is_inside == (self.keep == Keep::Inside)
    }

    /// Whether all of the box between two corners is surely kept. Known without casting a ray, but only for meshes, and
    /// only if no triangle comes near the box.
    #[must_use]
    pub fn surely_keeps(&self, low: DVec3, high: DVec3) -> bool {
        let Shape::Mesh(PlacedMesh { mesh, anchor, length }) = &self.shape else { return false };
        let [from, to] = [low, high].map(|corner| *anchor + *length * corner);
        !mesh.may_enter(from, to) && self.keeps(low)
    }
}

impl Shape {
    /// The intervals of a ray's whole line inside the solid, sorted and disjoint, each with `t0 < t1`.
    fn spans(&self, ray: &Ray) -> Vec<(f64, f64)> {
        let one = match self {
            Self::Sphere { center, radius } => round(ray.origin - center, ray.direction, *radius),
            Self::Cuboid { center, axes, half_edges } => {
                let from_center = ray.origin - center;
                (0..3).try_fold(EVERYTHING, |span, a| {
                    let (at, rate) = (axes[a].dot(from_center), axes[a].dot(ray.direction));
                    clip_slab(at, rate, -half_edges[a], half_edges[a], span)
                })
            }
            Self::Cylinder { from, axis, length, radius } => {
                let from_end = ray.origin - from;
                let (at, rate) = (axis.dot(from_end), axis.dot(ray.direction));
                let around = round(from_end - at * axis, ray.direction - rate * axis, *radius);
                around.and_then(|span| clip_slab(at, rate, 0.0, *length, span))
            }
            Self::Mesh(PlacedMesh { mesh, anchor, length }) => {
                let crossings = mesh.crossings(*anchor + *length * ray.origin, ray.direction);
                let spans = crossings.chunks_exact(2).map(|pair| (pair[0] / length, pair[1] / length));
                return spans.filter(|(t0, t1)| t0 < t1).collect();
            }
        };
        one.into_iter().filter(|(t0, t1)| t0 < t1).collect()
    }

    /// The unit normal where a ray enters or leaves the solid, at an end of one of its spans. Where faces meet, the first counts.
    fn normal_at(&self, ray: &Ray, t: f64) -> DVec3 {
        let point = ray.origin + t * ray.direction;
        match self {
            Self::Sphere { center, .. } => (point - center).normalize_or_zero(),
            Self::Cuboid { center, axes, half_edges } => {
                let from_center = ray.origin - center;
                let is_on = |a: &usize| {
                    let (at, rate) = (axes[*a].dot(from_center), axes[*a].dot(ray.direction));
                    let (first, last) = slab(at, rate, [-half_edges[*a], half_edges[*a]]);
                    first == t || last == t
                };
                (0..3).find(is_on).map_or(DVec3::ZERO, |a| axes[a])
            }
            Self::Cylinder { from, axis, radius, .. } => {
                let from_end = ray.origin - from;
                let (at, rate) = (axis.dot(from_end), axis.dot(ray.direction));
                let around = round(from_end - at * axis, ray.direction - rate * axis, *radius);
                let is_around = around.is_some_and(|(first, last)| first == t || last == t);
                let from_end = point - from;
                if is_around { (from_end - axis.dot(from_end) * axis).normalize_or_zero() } else { *axis }
            }
            Self::Mesh(PlacedMesh { mesh, anchor, length }) => {
                let faces = mesh.faces(*anchor + *length * ray.origin, ray.direction);
                faces.into_iter().find(|(at, _)| at / length == t).map_or(DVec3::ZERO, |(_, normal)| normal)
            }
        }
    }
}

/// The t at which `origin + t * direction` is nearer to zero than `radius`. The direction need not be a unit vector.
fn round(origin: DVec3, direction: DVec3, radius: f64) -> Option<(f64, f64)> {
    let speed = direction.length();
    if speed == 0.0 {
        return (origin.length() < radius).then_some(EVERYTHING);
    }
    // Start from the nearest point: this avoids differences of large squares, however far away the ray begins.
    let nearest = -origin.dot(direction) / (speed * speed);
    let distance = (origin + nearest * direction).length();
    let half = ((radius - distance) * (radius + distance)).sqrt() / speed;
    (distance < radius && half.is_finite()).then_some((nearest - half, nearest + half))
}

/// Intersection of two sorted lists of intervals.
fn common(a: &[(f64, f64)], b: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let (mut i, mut j) = (0, 0);
    let mut both = Vec::new();
    while i < a.len() && j < b.len() {
        let span = (a[i].0.max(b[j].0), a[i].1.min(b[j].1));
        if span.0 < span.1 {
            both.push(span);
        }
        if a[i].1 < b[j].1 { i += 1 } else { j += 1 }
    }
    both
}

/// The rest of the line outside these intervals.
fn complement(spans: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let begins = std::iter::once(EVERYTHING.0).chain(spans.iter().map(|span| span.1));
    let ends = spans.iter().map(|span| span.0).chain(std::iter::once(EVERYTHING.1));
    begins.zip(ends).filter(|(t0, t1)| t0 < t1).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray { origin: origin.into(), direction: DVec3::from(direction).normalize(), t_min: 0.0 }
    }

    fn cut(solids: &[Solid], ray: &Ray, t0: f64, t1: f64) -> Vec<(f64, f64)> {
        kept(solids, ray, Segment { t0, t1 }).into_iter().map(|s| (s.t0, s.t1)).collect()
    }

    fn sphere(center: [f64; 3], radius: f64, keep: Keep) -> Solid {
        Solid { shape: Shape::Sphere { center: center.into(), radius }, keep }
    }

    #[test]
    fn rays_are_cut_where_solids_stand() {
        let along_x = ray([-10.0, 3.0, 0.0], [1.0, 0.0, 0.0]);
        let outside = |center, radius| sphere(center, radius, Keep::Outside);
        assert_eq!(cut(&[sphere([0.0; 3], 5.0, Keep::Inside)], &along_x, 0.0, 100.0), [(6.0, 14.0)]);
        assert_eq!(cut(&[outside([0.0; 3], 5.0)], &along_x, 0.0, 100.0), [(0.0, 6.0), (14.0, 100.0)]);
        assert_eq!(cut(&[outside([0.0; 3], 2.0)], &along_x, 0.0, 100.0), [(0.0, 100.0)]);
        assert_eq!(cut(&[sphere([0.0; 3], 2.0, Keep::Inside)], &along_x, 0.0, 100.0), []);
        let both = [outside([0.0; 3], 5.0), sphere([0.0, 3.0, 0.0], 8.0, Keep::Inside)];
        assert_eq!(cut(&both, &along_x, 3.0, 100.0), [(3.0, 6.0), (14.0, 18.0)]);
        let drum = |axis: DVec3| Solid {
            shape: Shape::Cylinder { from: DVec3::ZERO, axis, length: 4.0, radius: 5.0 },
            keep: Keep::Inside,
        };
        assert_eq!(cut(&[drum(DVec3::X)], &along_x, 0.0, 100.0), [(10.0, 14.0)]);
        assert_eq!(cut(&[drum(DVec3::Y)], &along_x, 0.0, 100.0), [(5.0, 15.0)]);
        assert_eq!(cut(&[drum(DVec3::Z)], &along_x, 0.0, 100.0), [(6.0, 14.0)]);
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let axes = [DVec3::new(half, half, 0.0), DVec3::new(-half, half, 0.0), DVec3::Z];
        let shape = Shape::Cuboid { center: DVec3::new(0.0, 3.0, 0.0), axes, half_edges: [1.0, 1.0, 9.0] };
        let found = cut(&[Solid { shape, keep: Keep::Inside }], &along_x, 0.0, 100.0);
        let expected = 2f64.sqrt();
        assert!(found.len() == 1 && (found[0].0 - 10.0 + expected).abs() < 1e-12, "{found:?}");
        assert!((found[0].1 - 10.0 - expected).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn far_away_eyes_cut_as_exactly_as_near_ones() {
        let far = ray([-1e9, 3.0, 0.0], [1.0, 0.0, 0.0]);
        let found = cut(&[sphere([0.0; 3], 5.0, Keep::Inside)], &far, 0.0, 2e9);
        assert!((found[0].0 - (1e9 - 4.0)).abs() < 1e-6 && (found[0].1 - (1e9 + 4.0)).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn what_a_mesh_surely_keeps_is_known_without_rays() {
        let corners: Vec<DVec3> =
            (0..8).map(|n| 8.0 * DVec3::from([n & 1, n >> 1 & 1, n >> 2].map(f64::from))).collect();
        let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let faces: Vec<[u32; 3]> = sides.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let mesh = Arc::new(ClosedMesh::new(&corners, &faces).expect("a cube is closed"));
        // One unit of the picture is half a world unit; its origin is the world point (1, 1, 1).
        let placed = PlacedMesh { mesh, anchor: DVec3::ONE, length: 0.5 };
        let [inside, outside] =
            [Keep::Inside, Keep::Outside].map(|keep| Solid { shape: Shape::Mesh(placed.clone()), keep });
        let keeps = |low: f64, high: f64| {
            [&inside, &outside].map(|solid| solid.surely_keeps(DVec3::splat(low), DVec3::splat(high)))
        };
        assert_eq!(keeps(-1.0, 1.0), [true, false]);
        assert_eq!(keeps(20.0, 30.0), [false, true]);
        assert_eq!(keeps(-3.0, 1.0), [false, false]);
        let sphere = sphere([0.0; 3], 100.0, Keep::Inside);
        assert!(!sphere.surely_keeps(DVec3::ZERO, DVec3::ONE), "rays tell it of spheres");
    }

    proptest! {
        /// The kept segments of a ray hold exactly the kept points, apart from points on a face.
        #[test]
        fn segments_hold_the_points_that_are_kept(
            origin in prop::array::uniform3(-9.0..9.0f64),
            direction in prop::array::uniform3(-1.0..1.0f64),
            centers in prop::collection::vec(prop::array::uniform3(-4.0..4.0f64), 4),
            sizes in prop::collection::vec(0.5..6.0f64, 4),
            sides in prop::collection::vec(any::<bool>(), 3),
        ) {
            let d = DVec3::from(direction);
            prop_assume!(d.length() > 1e-3);
            let axis = (d + DVec3::new(0.3, -0.2, 0.7)).normalize_or(DVec3::X);
            let across = axis.any_orthonormal_vector();
            let keep = |side: bool| if side { Keep::Inside } else { Keep::Outside };
            let axes = [axis, across, axis.cross(across)];
            let [a, b, c, _] = [0, 1, 2, 3].map(|i| DVec3::from(centers[i]));
            let solids = [
                Solid { shape: Shape::Sphere { center: a, radius: sizes[0] }, keep: keep(sides[0]) },
                Solid { shape: Shape::Cuboid { center: b, axes, half_edges: [sizes[1], sizes[2], sizes[3]] }, keep: keep(sides[1]) },
                Solid { shape: Shape::Cylinder { from: c, axis, length: sizes[3], radius: sizes[2] }, keep: keep(sides[2]) },
            ];
            let is_kept = |p: DVec3| {
                let q = [axes[0].dot(p - b), axes[1].dot(p - b), axes[2].dot(p - b)];
                let along = axis.dot(p - c);
                let inside = [
                    (p - a).length() < sizes[0],
                    (0..3).all(|i| q[i].abs() < [sizes[1], sizes[2], sizes[3]][i]),
                    (0.0..sizes[3]).contains(&along) && (p - c - along * axis).length() < sizes[2],
                ];
                (0..3).all(|i| inside[i] == sides[i])
            };
            let ray = ray(origin, direction);
            let found = cut(&solids, &ray, 0.0, 20.0);
            prop_assert!(found.windows(2).all(|w| w[0].1 <= w[1].0) && found.iter().all(|s| s.0 < s.1));
            for i in 0..400 {
                let t = 20.0 * (f64::from(i) + 0.5) / 400.0;
                let is_near_an_end = found.iter().any(|s| (s.0 - t).abs() < 1e-9 || (s.1 - t).abs() < 1e-9);
                let is_in = found.iter().any(|s| s.0 < t && t < s.1);
                let point = ray.origin + t * ray.direction;
                prop_assert!(is_near_an_end || is_in == is_kept(point), "at {t}: {found:?}");
                prop_assert!(is_near_an_end || is_in == solids.iter().all(|solid| solid.keeps(point)), "at {t}");
            }
        }
    }
}
