//! Order of bricks: front to back along rays.
//!
//! The pyramid is descended from its coarsest brick. A brick that is fine enough is visited; for all others the
//! children follow, nearest first. For rays from one eye, or of one direction, this order is right for all of them.

use glam::DVec3;
use supervol_format::space::HALF_VOXEL;
use supervol_format::{BrickKey, Lod, Pyramid};

use super::leap::AxisDirection;
use super::tile::IndexBox;

/// Origin of rays, in index space of level 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RayOrigin {
    /// From a point.
    Eye(DVec3),
    /// All in one direction.
    Direction(DVec3),
}

/// The part of index space that a brick draws; infinite at the volume's ends.
#[must_use]
pub fn region_of(pyramid: &Pyramid, key: BrickKey) -> IndexBox {
    let level = pyramid.level_at(key.lod());
    let core = pyramid.layout().core() as f64;
    let mut region = IndexBox { low: [f64::NEG_INFINITY; 3], high: [f64::INFINITY; 3] };
    for a in 0..3 {
        let (brick, side) = (key.brick().0[a], level.scale[a] as f64 * core);
        // The same numbers as the planes of every other level there: no rounding below 2^53.
        if brick > 0 {
            region.low[a] = -HALF_VOXEL + f64::from(brick) * side;
        }
        if brick + 1 < level.bricks[a] {
            region.high[a] = -HALF_VOXEL + f64::from(brick + 1) * side;
        }
    }
    region
}

/// Directions that rays of a view may have in a brick, along each axis.
#[must_use]
pub fn ways_through(pyramid: &Pyramid, key: BrickKey, view: RayOrigin) -> [AxisDirection; 3] {
    let level = pyramid.level_at(key.lod());
    std::array::from_fn(|a| {
        let side = level.scale[a] as f64 * pyramid.layout().core() as f64;
        let low = -HALF_VOXEL + f64::from(key.brick().0[a]) * side;
        match view {
            RayOrigin::Direction(direction) if direction[a] > 0.0 => AxisDirection::Up,
            RayOrigin::Direction(direction) if direction[a] < 0.0 => AxisDirection::Down,
            RayOrigin::Eye(eye) if eye[a] <= low => AxisDirection::Up,
            RayOrigin::Eye(eye) if eye[a] >= low + side => AxisDirection::Down,
            RayOrigin::Direction(_) | RayOrigin::Eye(_) => AxisDirection::Both,
        }
    })
}

/// Pushes the children of a brick, the farthest first: the nearest is popped first.
pub fn push_children(pyramid: &Pyramid, key: BrickKey, view: RayOrigin, stack: &mut Vec<BrickKey>) {
    let Some(finer) = key.lod().0.checked_sub(1).map(Lod) else { return };
    let level = pyramid.level_at(key.lod());
    let bricks = pyramid.level_at(finer).bricks;
    let side = pyramid.level_at(finer).scale.map(|s| s as f64 * pyramid.layout().core() as f64);
    let first: [u32; 3] = std::array::from_fn(|a| key.brick().0[a] * level.factors[a]);
    let far_bits: u32 = (0..3)
        .map(|a| {
            let comes_from_above = match view {
                RayOrigin::Direction(direction) => direction[a] < 0.0,
                RayOrigin::Eye(eye) => eye[a] > -HALF_VOXEL + f64::from(first[a] + 1) * side[a],
            };
            // The nearer child is on the eye's side.
            u32::from(!comes_from_above) << a
        })
        .sum();
    for i in 0..8u32 {
        let corner = i ^ far_bits;
        let bit = [corner & 1, corner >> 1 & 1, corner >> 2];
        let child: [u32; 3] = std::array::from_fn(|a| first[a] + bit[a]);
        if (0..3).all(|a| bit[a] < level.factors[a] && child[a] < bricks[a]) {
            stack.push(BrickKey::new(finer, supervol_format::BrickIndex(child)));
        }
    }
}
