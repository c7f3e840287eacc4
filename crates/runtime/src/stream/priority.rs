//! Order in which wanted bricks are fetched: front to back, as rays meet them; or slab by slab, for an engine with that
//! order.
//!
//! Reason for this order: a ray continues only when the brick it waits for is resident, and it never returns to a
//! brick. Suppose that the rank of bricks grows strictly along every ray. A ray that needs the wanted brick of least
//! rank is not yet beyond it. It cannot wait before it, because that would be a lesser rank. So it waits *at* it. One
//! pass over that brick then serves all rays that will ever need it, and bricks of lesser rank are not needed again in
//! this frame. Fetched in this order, each brick is read once, however small the cache.
//!
//! On a grid of equal boxes, the Manhattan distance is such a rank. A ray moves away from the eye along each axis. So
//! the sum over axes of |brick - eye brick| grows by one with each face it crosses. (Rays into different octants do not
//! meet.) For parallel rays, the axes are summed with the sign of the common direction. Axes without movement do not
//! count.
//!
//! Bricks of several levels are compared by the corner farthest from the eye, in voxels of level 0. This keeps the
//! order strict from finer to coarser bricks, the usual direction along a ray. From coarser to finer bricks the order
//! is only nearly strict: a brick may be fetched twice, and the picture is the same.

use glam::DVec3;
use supervol_format::cast::{narrow, whole};
use supervol_format::space::HALF_VOXEL;
use supervol_format::{BrickKey, Geometry, Pyramid};
use supervol_scene::camera::{Camera, Projection};

use crate::stream::field::FieldBrick;

/// Position in the order: less is nearer to the eye. Unit: voxels of level 0, summed over axes.
pub type Rank = i64;

/// Farthest eye, in voxels of level 0: eyes beyond it give the same order as an eye at this distance.
const EYE_LIMIT: f64 = (1u64 << 40) as f64;

/// The order in which an engine visits bricks.
#[derive(Debug, Clone)]
pub struct BrickOrder {
    view: View,
}

#[derive(Debug, Clone)]
enum View {
    /// The eye in index coordinates of level 0, plus half a voxel: bricks begin at multiples of their size.
    Eye([f64; 3]),
    /// Sign of the view direction along each index axis: -1, 0 or 1.
    Direction([Rank; 3]),
}

/// A wanted brick with its position in the order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Ranked {
    /// Position in the order.
    pub rank: Rank,
    /// The brick; ties are broken by its field and its bits.
    pub key: FieldBrick,
}

impl BrickOrder {
    /// The order in which this camera's rays meet bricks.
    #[must_use]
    pub fn front_to_back(camera: &Camera, geometry: &Geometry) -> Self {
        let index_from_world = geometry.index_from_world();
        let view = match camera.projection {
            Projection::Perspective { .. } => {
                let eye = index_from_world.transform_point3(camera.eye) + DVec3::splat(HALF_VOXEL);
                View::Eye(eye.to_array().map(|v| v.clamp(-EYE_LIMIT, EYE_LIMIT)))
            }
            Projection::Orthographic { .. } => {
                let direction = index_from_world.transform_vector3(camera.forward);
                View::Direction(direction.to_array().map(|v| if v == 0.0 { 0 } else { whole::<i64>(v.signum()) }))
            }
        };
        Self { view }
    }

    /// The order of an engine that visits slabs of bricks along the index axes. `signs`: direction along each axis, -1,
    /// 0 or 1; axes with 0 do not count.
    ///
    /// # Panics
    /// If a sign is not -1, 0 or 1.
    #[must_use]
    pub fn along(signs: [Rank; 3]) -> Self {
        assert!(signs.iter().all(|sign| (-1..=1).contains(sign)), "signs {signs:?}");
        Self { view: View::Direction(signs) }
    }

    /// Rank of a brick.
    #[must_use]
    pub fn rank(&self, pyramid: &Pyramid, key: BrickKey) -> Rank {
        let core = pyramid.layout().core() as u64;
        let scale = pyramid.level_at(key.lod()).scale;
        (0..3)
            .map(|a| {
                let edge = narrow::<i64>(core * scale[a]);
                let brick = Rank::from(key.brick().0[a]);
                match &self.view {
                    View::Eye(eye) => {
                        let eye_brick = whole::<i64>((eye[a] / edge as f64).floor());
                        ((brick - eye_brick).abs() + 1) * edge
                    }
                    View::Direction(sign) => match sign[a] {
                        0 => 0,
                        1 => (brick + 1) * edge,
                        _ => -brick * edge,
                    },
                }
            })
            .sum()
    }

    /// Wanted bricks, in this order.
    #[must_use]
    pub fn ranked(&self, pyramid: &Pyramid, wanted: impl IntoIterator<Item = FieldBrick>) -> Vec<Ranked> {
        let mut ranked: Vec<Ranked> =
            wanted.into_iter().map(|key| Ranked { rank: self.rank(pyramid, key.brick), key }).collect();
        ranked.sort_unstable();
        ranked.dedup();
        ranked
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use supervol_format::{BrickIndex, BrickLayout, Dims, Lod};

    use super::*;
    use crate::stream::field::Field;

    const EDGE: f64 = 16.0;

    fn pyramid() -> Pyramid {
        let factors = [[2, 2, 2], [2, 2, 1], [2, 2, 2]];
        Pyramid::new(Dims([128, 128, 64]), BrickLayout::new(16).unwrap(), &factors).unwrap()
    }

    fn camera(eye: DVec3, forward: DVec3, projection: Projection) -> Camera {
        let up = if forward.x.abs() < 0.5 { DVec3::X } else { DVec3::Y };
        Camera::look_at(eye, eye + forward, up, projection, [8, 8]).unwrap()
    }

    /// Bricks of level 0 that a ray from `p` along `d` meets, in order, found by small steps.
    fn bricks_along(p: DVec3, d: DVec3) -> Vec<BrickKey> {
        let mut keys: Vec<BrickKey> = Vec::new();
        for i in 0..60_000 {
            let q = p + d * (f64::from(i) * 0.01) + DVec3::splat(HALF_VOXEL);
            let brick = (q / EDGE).floor();
            if brick.cmplt(DVec3::ZERO).any() || brick.cmpge(DVec3::new(8.0, 8.0, 4.0)).any() {
                continue;
            }
            let key = BrickKey::new(Lod(0), BrickIndex(brick.to_array().map(|v| v as u32)));
            if keys.last() != Some(&key) {
                keys.push(key);
            }
        }
        keys
    }

    fn unit(v: [f64; 3]) -> DVec3 {
        DVec3::from_array(v).try_normalize().unwrap_or(DVec3::X)
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 32, ..ProptestConfig::default() })]
        #[test]
        fn ranks_grow_strictly_along_every_ray(
            eye in prop::array::uniform3(-100.0f64..230.0), d in prop::array::uniform3(-1.0f64..1.0), parallel: bool,
        ) {
            let (eye, d) = (DVec3::from_array(eye), unit(d));
            let projection = if parallel {
                Projection::Orthographic { height: 10.0 }
            } else {
                Projection::Perspective { fov_y: 40.0 }
            };
            let order = BrickOrder::front_to_back(&camera(eye, d, projection), &Geometry::IDENTITY);
            let ranks: Vec<Rank> = bricks_along(eye, d).iter().map(|&k| order.rank(&pyramid(), k)).collect();
            prop_assert!(ranks.windows(2).all(|w| w[0] < w[1]), "{ranks:?}");
        }

        #[test]
        fn a_coarser_neighbour_behind_ranks_higher(
            eye in prop::array::uniform3(-100.0f64..230.0), brick in prop::array::uniform3(0u32..8), axis in 0usize..3,
        ) {
            let p = pyramid();
            let camera = camera(DVec3::from_array(eye), DVec3::X, Projection::Perspective { fov_y: 40.0 });
            let order = BrickOrder::front_to_back(&camera, &Geometry::IDENTITY);
            let fine = BrickKey::new(Lod(0), BrickIndex([brick[0], brick[1], brick[2] % 4]));
            // Behind: the next fine brick away from the eye along the axis, replaced by its parent.
            let away = (f64::from(fine.brick().0[axis]) + 0.5) * EDGE - HALF_VOXEL > eye[axis];
            let mut next = fine.brick().0;
            let Some(index) = (if away { next[axis].checked_add(1) } else { next[axis].checked_sub(1) }) else {
                return Ok(());
            };
            next[axis] = index;
            if next.iter().zip(p.level_at(Lod(0)).bricks).any(|(&i, n)| i >= n) {
                return Ok(());
            }
            let parent = p.parent(BrickKey::new(Lod(0), BrickIndex(next))).unwrap();
            if Some(parent) != p.parent(fine) {
                prop_assert!(order.rank(&p, fine) < order.rank(&p, parent));
            }
        }
    }

    #[test]
    fn ties_are_broken_by_the_key_and_doubles_are_dropped() {
        let camera = camera(DVec3::splat(-50.0), DVec3::ONE, Projection::Perspective { fov_y: 40.0 });
        let order = BrickOrder::front_to_back(&camera, &Geometry::IDENTITY);
        let key = |b| BrickKey::new(Lod(0), BrickIndex(b));
        let wanted = [[0, 0, 1], [1, 0, 0], [3, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0, 0]].map(key);
        let ranked = |wanted: Vec<FieldBrick>| order.ranked(&pyramid(), wanted).into_iter().map(|r| r.key);
        let keys = ranked(Field::FIRST.bricks(wanted));
        let places = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [3, 0, 0]].map(key);
        assert!(keys.eq(Field::FIRST.bricks(places)));
        // Bricks of two fields at one place are different bricks, and adjacent among those of the same rank.
        let of_two = [Field(1), Field(0)].into_iter().flat_map(|field| field.bricks([key([3, 0, 0]), key([0, 0, 0])]));
        let expected = [(0, [0; 3]), (1, [0; 3]), (0, [3, 0, 0]), (1, [3, 0, 0])];
        assert!(ranked(of_two.collect()).eq(expected.map(|(field, place)| Field(field).brick(key(place)))));
    }

    #[test]
    fn slabs_come_one_after_the_other() {
        let ranks = |order: &BrickOrder, axis: usize| {
            let place = |n: u32| std::array::from_fn(|a| if a == axis { n } else { 1 });
            [0, 1, 2, 3].map(|n| order.rank(&pyramid(), BrickKey::new(Lod(0), BrickIndex(place(n)))))
        };
        let order = BrickOrder::along([0, 0, -1]);
        assert!(
            ranks(&order, 2).windows(2).all(|w| w[0] > w[1]) && ranks(&BrickOrder::along([0, 0, 1]), 2).is_sorted()
        );
        assert!(ranks(&order, 0).windows(2).all(|w| w[0] == w[1]), "other axes do not count");
    }

    #[test]
    fn an_eye_at_any_distance_gives_an_order() {
        for eye in [DVec3::splat(1e300), DVec3::new(-1e25, 0.0, 3.0), DVec3::splat(0.0)] {
            let near = camera(DVec3::ZERO, DVec3::new(1.0, 0.2, 0.1), Projection::Orthographic { height: 1.0 });
            let camera = Camera { eye, ..near };
            let perspective = Camera { projection: Projection::Perspective { fov_y: 30.0 }, ..camera };
            for camera in [camera, perspective] {
                let order = BrickOrder::front_to_back(&camera, &Geometry::IDENTITY);
                let all: Vec<BrickKey> = (0..pyramid().brick_count()).filter_map(|e| pyramid().key(e)).collect();
                assert_eq!(order.ranked(&pyramid(), Field::FIRST.bricks(all.iter().copied())).len(), all.len());
            }
        }
    }
}
