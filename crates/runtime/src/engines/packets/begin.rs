//! Creation of a tile's rays: all rays at once, transformed to index space and clipped, with packet instructions. Each
//! ray equals the result of [`PixelRays::ray`], [`ToIndex::ray`] and [`clip_ray`](supervol_scene::clip::clip_ray) for
//! its pixel, bit for bit: the operations and their order are the same.

use supervol_format::Dims;
use supervol_scene::camera::{PixelRays, Ray};
use supervol_scene::clip::{Clip, ToIndex, cut, half_space, slab};

use super::simd::{Simd, Task};
use super::tile::{PerRay, TileRays};
use crate::engines::cells::walk::PARALLEL;
use crate::engines::packets::places::{TILE_RAYS, place_of};

/// Positions of rays within a tile, along x and y.
static PLACES: [PerRay; 2] = places();

const fn places() -> [PerRay; 2] {
    let mut places = [[0.0; TILE_RAYS]; 2];
    let mut ray = 0;
    while ray < TILE_RAYS {
        let [x, y] = place_of(ray);
        (places[0][ray], places[1][ray]) = (x as f64, y as f64);
        ray += 1;
    }
    places
}

/// Creates all rays of a tile, inside and outside of the picture.
pub(super) struct MakeRays<'a> {
    pub(super) pixel_rays: &'a PixelRays,
    pub(super) to_index: &'a ToIndex,
    /// Clipping of the scene; solids are cut elsewhere.
    pub(super) clip: &'a Clip,
    pub(super) dims: Dims,
    /// The tile's first pixel, in the whole picture.
    pub(super) corner: [u32; 2],
    pub(super) rays: &'a mut TileRays,
}

impl Task for MakeRays<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { pixel_rays, to_index, clip, dims, corner, rays } = self;
        let [x, y] = corner.map(f64::from);
        let TileRays { origin, direction, inverse, stop: t1, gathered, .. } = rays;
        let t0 = &mut gathered.t;
        let mut world = [[[0.0; TILE_RAYS]; 3]; 2];
        for ray in 0..TILE_RAYS {
            let world_ray = pixel_rays.ray_at([x + PLACES[0][ray], y + PLACES[1][ray]]);
            let index_ray = to_index.ray(&world_ray);
            let Ray { origin: o, direction: d, t_min } = world_ray;
            for (a, (o, d)) in o.to_array().into_iter().zip(d.to_array()).enumerate() {
                (world[0][a][ray], world[1][a][ray]) = (o, d);
                (origin[a][ray], direction[a][ray]) = (index_ray.origin[a], index_ray.direction[a]);
            }
            (t0[ray], t1[ray]) = (t_min, f64::INFINITY);
        }
        for axis in 0..3 {
            let kept = clip.slab_of(dims, axis);
            for ray in 0..TILE_RAYS {
                let of_axis = slab(origin[axis][ray], direction[axis][ray], kept);
                (t0[ray], t1[ray]) = cut((t0[ray], t1[ray]), of_axis);
            }
        }
        for plane in &clip.planes {
            let [nx, ny, nz] = plane.normal.to_array();
            let along = |v: &[PerRay; 3], ray: usize| nx * v[0][ray] + ny * v[1][ray] + nz * v[2][ray];
            for ray in 0..TILE_RAYS {
                let of_plane = half_space(along(&world[0], ray) - plane.offset, along(&world[1], ray));
                (t0[ray], t1[ray]) = cut((t0[ray], t1[ray]), of_plane);
            }
        }
        for ray in 0..TILE_RAYS {
            let is_kept = t0[ray].is_finite() & t1[ray].is_finite() & (t0[ray] < t1[ray]);
            t1[ray] = if is_kept { t1[ray] } else { f64::NEG_INFINITY };
        }
        for axis in 0..3 {
            for ray in 0..TILE_RAYS {
                let d = direction[axis][ray];
                let d = if d.abs() < PARALLEL { 0.0 } else { d };
                (direction[axis][ray], inverse[axis][ray]) = (d, d.recip());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use supervol_format::Geometry;
    use supervol_format::random::Random;
    use supervol_scene::camera::{Camera, Projection};
    use supervol_scene::clip::{ClipPlane, clip_ray};

    use super::*;
    use crate::engines::packets::simd::{InstructionSet, dispatch};

    /// All rays at once equal rays made one by one, bit for bit, with every instruction set: perspective or not, along
    /// axes, clipped or not.
    #[test]
    fn rays_are_what_they_are_one_by_one() {
        let mut random = Random::new(31);
        let dims = Dims([40, 25, 60]);
        let mut kept = 0;
        for case in 0..60 {
            let mut unit = || random.unit();
            let geometry = Geometry { spacing: [0.5 + unit(), 1.0, 2.0 * unit() + 0.1], ..Geometry::IDENTITY };
            let to_index = ToIndex::new(&geometry);
            let eye =
                if case % 3 == 0 { DVec3::new(-50.0, 12.0, 30.0) } else { 90.0 * DVec3::new(unit(), unit(), unit()) };
            let target =
                if case % 3 == 0 { DVec3::new(0.0, 12.0, 30.0) } else { 20.0 * DVec3::new(unit(), unit(), unit()) };
            let projection = match case % 2 {
                0 => Projection::Orthographic { height: 40.0 },
                _ => Projection::Perspective { fov_y: 40.0 },
            };
            let camera = Camera::look_at(eye, target, DVec3::Z, projection, [64, 48]).expect("a camera");
            let plane = ClipPlane { normal: DVec3::new(unit() - 0.5, unit() - 0.5, unit()), offset: 5.0 * unit() };
            let clip = match case % 4 {
                0 => Clip::default(),
                1 => Clip { index_box: Some([[3.0, 4.0, 5.5], [30.0, 22.0, 40.0]]), ..Clip::default() },
                _ => Clip { planes: vec![plane], ..Clip::default() },
            };
            let (pixel_rays, corner) = (camera.rays(), [16 * (case % 4), 16 * (case % 3)]);
            for set in InstructionSet::available() {
                let mut rays = TileRays::new();
                let pixel_rays = &pixel_rays;
                dispatch(set, MakeRays { pixel_rays, to_index: &to_index, clip: &clip, dims, corner, rays: &mut rays });
                for ray in 0..TILE_RAYS {
                    let [x, y] = place_of(ray);
                    let world_ray = pixel_rays.ray(corner[0] + x, corner[1] + y);
                    let index_ray = to_index.ray(&world_ray);
                    let at = |v: &[PerRay; 3]| [v[0][ray], v[1][ray], v[2][ray]];
                    assert_eq!(at(&rays.origin), index_ray.origin, "{set:?}, case {case}, ray {ray}");
                    let direction = index_ray.direction.map(|d| if d.abs() < PARALLEL { 0.0 } else { d });
                    assert_eq!(at(&rays.direction), direction, "{set:?}, case {case}, ray {ray}");
                    assert_eq!(at(&rays.inverse), direction.map(f64::recip), "{set:?}, case {case}, ray {ray}");
                    let expected = clip_ray(&world_ray, &index_ray, dims, &clip).map(|s| (s.t0, s.t1));
                    let found = (rays.gathered.t[ray], rays.stop[ray]);
                    let found = (found.1 > f64::NEG_INFINITY).then_some(found);
                    assert_eq!(found, expected, "{set:?}, case {case}, ray {ray}");
                    kept += u64::from(found.is_some());
                }
            }
        }
        assert!(kept > 5_000, "only {kept} rays meet the volume");
    }
}
