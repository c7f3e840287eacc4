//! Keys of bricks: level of detail and position, packed into 64 bits.
//!
//! Bit layout of a key, from the top: 1 zero bit, 6 bits LOD, then 19 bits each of z, y, x.
//! 19 bits allow 524,288 bricks along an axis: [`crate::BrickLayout::voxels_limit`] voxels.

/// Level of detail: 0 is the source grid, greater is coarser.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Lod(pub u8);

impl Lod {
    /// The source grid.
    pub const FINEST: Self = Self(0);
    /// Largest number of levels of a container. 524,288 bricks along each axis need 19 halvings per axis, or 57 if
    /// every level halves only one axis.
    pub const LIMIT: usize = 64;
}

/// Position of a brick in its level's grid of bricks, `[x, y, z]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BrickIndex(pub [u32; 3]);

/// Key of one brick of a container.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BrickKey(u64);

const AXIS_BITS: u32 = 19;
const AXIS_MASK: u64 = (1 << AXIS_BITS) - 1;

impl BrickKey {
    /// Number of bricks that a key can address along one axis; every index is below it.
    pub const AXIS_LIMIT: u32 = 1 << AXIS_BITS;

    /// Key of a brick.
    ///
    /// # Panics
    /// If the LOD or an index exceeds its field. Opening or beginning a container checks its grids against these
    /// limits.
    #[must_use]
    pub fn new(lod: Lod, brick: BrickIndex) -> Self {
        assert!((lod.0 as usize) < Lod::LIMIT, "LOD {} is not below {}", lod.0, Lod::LIMIT);
        let [x, y, z] = brick.0.map(|i| {
            assert!(i < Self::AXIS_LIMIT, "brick index {i} is not below {}", Self::AXIS_LIMIT);
            u64::from(i)
        });
        Self(u64::from(lod.0) << (3 * AXIS_BITS) | z << (2 * AXIS_BITS) | y << AXIS_BITS | x)
    }

    /// Level of detail of the brick.
    #[must_use]
    pub fn lod(self) -> Lod {
        Lod((self.0 >> (3 * AXIS_BITS)) as u8)
    }

    /// Position of the brick in its level's grid of bricks.
    #[must_use]
    pub fn brick(self) -> BrickIndex {
        BrickIndex([0, 1, 2].map(|a| (self.0 >> (a * AXIS_BITS) & AXIS_MASK) as u32))
    }

    /// The packed 64 bits.
    #[must_use]
    pub fn bits(self) -> u64 {
        self.0
    }
}

impl std::fmt::Display for BrickKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y, z] = self.brick().0;
        write!(f, "brick ({x}, {y}, {z}) of LOD {}", self.lod().0)
    }
}

impl std::fmt::Debug for BrickKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}

/// Position along the Morton (Z-order) curve: bits of x, y, z interleaved, x lowest. The eight children of one brick
/// are neighbours on the curve.
#[must_use]
pub fn morton(brick: BrickIndex) -> u64 {
    fn spread(v: u32) -> u64 {
        let mut v = u64::from(v) & 0x1f_ffff;
        v = (v | v << 32) & 0x001f_0000_0000_ffff;
        v = (v | v << 16) & 0x001f_0000_ff00_00ff;
        v = (v | v << 8) & 0x100f_00f0_0f00_f00f;
        v = (v | v << 4) & 0x10c3_0c30_c30c_30c3;
        (v | v << 2) & 0x1249_2492_4924_9249
    }
    spread(brick.0[0]) | spread(brick.0[1]) << 1 | spread(brick.0[2]) << 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_survive_packing_at_their_limits() {
        for (lod, brick) in [(0, [0, 0, 0]), (63, [BrickKey::AXIS_LIMIT - 1; 3]), (7, [1, 2, 3]), (0, [0, 524_287, 1])]
        {
            let key = BrickKey::new(Lod(lod), BrickIndex(brick));
            assert_eq!((key.lod(), key.brick()), (Lod(lod), BrickIndex(brick)));
        }
    }

    #[test]
    fn morton_order_keeps_siblings_together() {
        let siblings: Vec<u64> =
            (0..8).map(|i| morton(BrickIndex([2 + (i & 1), 4 + (i >> 1 & 1), 6 + (i >> 2)]))).collect();
        let first = morton(BrickIndex([2, 4, 6]));
        assert_eq!(siblings, (first..first + 8).collect::<Vec<_>>());
    }
}
