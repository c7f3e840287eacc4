//! Tiles: parts of a level that are read at once.
//!
//! A *tile* is a box of whole bricks. It is read with the apron of its outermost bricks, so that each of its bricks can
//! be cut out of it.

use supervol_format::brick_key::morton;
use supervol_format::{BrickIndex, Dims, Level, VoxelBox};
use supervol_sources::AccessOrder;

/// A box of bricks of one level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tile {
    /// First brick.
    pub start: [u32; 3],
    /// One past the last brick.
    pub end: [u32; 3],
}

impl Tile {
    /// The tile's bricks in Morton order, so that siblings lie together in the container.
    #[must_use]
    pub fn bricks(&self) -> Vec<BrickIndex> {
        let mut bricks = Vec::new();
        for z in self.start[2]..self.end[2] {
            for y in self.start[1]..self.end[1] {
                bricks.extend((self.start[0]..self.end[0]).map(|x| BrickIndex([x, y, z])));
            }
        }
        bricks.sort_by_key(|b| morton(*b));
        bricks
    }

    /// Voxels that the tile's bricks own, grown by `margin` voxels and clipped to the grid.
    #[must_use]
    pub fn voxels(&self, core: usize, dims: Dims, margin: u64) -> VoxelBox {
        let at = |v: [u32; 3]| v.map(|i| u64::from(i) * core as u64);
        VoxelBox { start: at(self.start), end: at(self.end) }.grown(margin, dims)
    }
}

/// The tiles of a level, in the order in which they are read.
///
/// A tile first grows to two bricks along each axis, then further along the source's fastest axis, then along the
/// others, as far as `fits` allows. The argument of `fits` is the tile's size in bricks.
#[must_use]
pub fn tiles(level: &Level, order: AccessOrder, fits: &dyn Fn([u32; 3]) -> bool) -> Vec<Tile> {
    let bricks = level.bricks;
    let [slow, middle, fast] = order.0;
    let mut size = [1; 3];
    let try_grow = |size: &mut [u32; 3], axis: usize| {
        let mut grown = *size;
        grown[axis] = (grown[axis] * 2).min(bricks[axis]);
        let grows = grown[axis] > size[axis] && fits(grown);
        if grows {
            *size = grown;
        }
        grows
    };
    for axis in [fast, middle, slow] {
        try_grow(&mut size, axis);
    }
    for axis in [fast, middle, slow] {
        while try_grow(&mut size, axis) {}
    }
    let counts: [u32; 3] = std::array::from_fn(|a| bricks[a].div_ceil(size[a]));
    let mut out = Vec::new();
    for s in 0..counts[slow] {
        for m in 0..counts[middle] {
            for f in 0..counts[fast] {
                let mut at = [0; 3];
                (at[slow], at[middle], at[fast]) = (s, m, f);
                let start: [u32; 3] = std::array::from_fn(|a| at[a] * size[a]);
                out.push(Tile { start, end: std::array::from_fn(|a| (start[a] + size[a]).min(bricks[a])) });
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use supervol_format::{BrickLayout, Lod, Pyramid};

    use super::*;

    #[test]
    fn tiles_cover_every_brick_once_and_follow_the_source() {
        let pyramid =
            Pyramid::new(Dims([100, 70, 50]), BrickLayout::new(16).expect("16 is a core"), &[[2; 3], [2; 3], [2; 3]])
                .expect("a valid pyramid");
        let level = pyramid.level_at(Lod(0));
        for order in [AccessOrder::X_FASTEST, AccessOrder([1, 0, 2])] {
            let tiles = tiles(level, order, &|size| size.iter().product::<u32>() <= 16);
            let mut all: Vec<BrickIndex> = tiles.iter().flat_map(Tile::bricks).collect();
            assert_eq!(all.len() as u64, level.brick_count());
            all.sort();
            all.dedup();
            assert_eq!(all.len() as u64, level.brick_count());
            let fast = order.0[2];
            assert!(tiles[0].end[fast] >= 4, "the fastest axis grows first: {:?}", tiles[0]);
        }
    }
}
