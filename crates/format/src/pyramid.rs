//! The levels of a container, their sizes, and the bricks that cover them.
//!
//! Level 0 is the source grid. Level l+1 halves the axes whose factor is 2 (rounding up) and keeps those whose factor
//! is 1. The last level fits one brick. Bricks of a level are numbered x fastest. The bricks of all levels are numbered
//! level by level, finest first; this number is the brick's *entry* in the table of contents.

use crate::brick::{APRON, BrickLayout, MACRO_CELL};
use crate::{BrickIndex, BrickKey, Dims, Lod, VoxelBox, VoxelType};

/// One level of detail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Level {
    /// 1 or 2 per axis: voxels of the next finer level per voxel of this one. All 1 at level 0.
    pub factors: [u32; 3],
    /// Voxels of level 0 per voxel of this level, per axis: the product of all factors up to this level.
    pub scale: [u64; 3],
    /// Size of the level in voxels.
    pub dims: Dims,
    /// Number of bricks along each axis.
    pub bricks: [u32; 3],
    /// Entry number of this level's first brick.
    pub first_entry: u64,
}

impl Level {
    /// Number of bricks of this level.
    #[must_use]
    pub fn brick_count(&self) -> u64 {
        self.bricks.iter().map(|&n| u64::from(n)).product()
    }

    /// Converts an index point of level 0 to one of this level: `(p + 1/2) / scale - 1/2`.
    #[must_use]
    pub fn from_level_0(&self, p: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| (p[a] + 0.5) / self.scale[a] as f64 - 0.5)
    }
}

/// All levels of one container.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pyramid {
    layout: BrickLayout,
    levels: Vec<Level>,
}

/// Reason why a list of factors is not a valid pyramid.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum PyramidError {
    #[error("dims {dims} are not between 1 and {limit} on every axis", limit = Dims::LIMIT)]
    Dims { dims: Dims },
    #[error("level {level} has factors {factors:?}; expected 1 or 2 on each axis and at least one 2")]
    Factors { level: usize, factors: [u32; 3] },
    #[error("level {level} has {dims} voxels, as the one before; expected fewer")]
    NothingShrinks { level: usize, dims: Dims },
    #[error("a voxel of level {level} covers {scale:?} voxels of level 0; expected at most {limit} along an axis",
        limit = Pyramid::SCALE_LIMIT)]
    Scale { level: usize, scale: [u64; 3] },
    #[error("{levels} levels; expected 1 to {limit}", limit = Lod::LIMIT)]
    LevelCount { levels: usize },
    #[error("the last level has {bricks:?} bricks; expected one")]
    Unfinished { bricks: [u32; 3] },
    #[error("{bricks} bricks in all levels; expected at most {limit}", limit = Pyramid::BRICKS_LIMIT)]
    BrickCount { bricks: u64 },
    #[error("{bricks:?} bricks on an axis; a brick key holds at most {limit}", limit = BrickKey::AXIS_LIMIT)]
    TooManyBricks { bricks: [u64; 3] },
}

impl Pyramid {
    /// Largest number of bricks of all levels together. Their entries take 80 TiB, and no product of sizes overflows.
    pub const BRICKS_LIMIT: u64 = 1 << 40;
    /// Largest number of level-0 voxels per coarser voxel along an axis, so that shifts by its logarithm fit 32 bits.
    pub const SCALE_LIMIT: u64 = 1 << 31;

    /// The pyramid over a grid of `dims`. `factors` has one triple for each level from level 1 on.
    ///
    /// # Errors
    /// If a limit is exceeded, or a factor is neither 1 nor 2. If a level has as many voxels as the level before, or
    /// the last level does not fit one brick.
    pub fn new(dims: Dims, layout: BrickLayout, factors: &[[u32; 3]]) -> Result<Self, PyramidError> {
        if !dims.is_valid() {
            return Err(PyramidError::Dims { dims });
        }
        if factors.len() + 1 > Lod::LIMIT {
            return Err(PyramidError::LevelCount { levels: factors.len() + 1 });
        }
        let mut last = Self::level([1; 3], [1; 3], dims, layout, 0)?;
        let mut levels = vec![last];
        for (i, &f) in factors.iter().enumerate() {
            if f.iter().any(|&v| v != 1 && v != 2) || f == [1; 3] {
                return Err(PyramidError::Factors { level: i + 1, factors: f });
            }
            let finer = last;
            let coarse = Dims(std::array::from_fn(|a| finer.dims.0[a].div_ceil(u64::from(f[a]))));
            if coarse == finer.dims {
                return Err(PyramidError::NothingShrinks { level: i + 1, dims: coarse });
            }
            let scale: [u64; 3] = std::array::from_fn(|a| finer.scale[a] * u64::from(f[a]));
            if scale.iter().any(|&s| s > Self::SCALE_LIMIT) {
                return Err(PyramidError::Scale { level: i + 1, scale });
            }
            last = Self::level(f, scale, coarse, layout, finer.first_entry + finer.brick_count())?;
            levels.push(last);
        }
        if last.bricks != [1; 3] {
            return Err(PyramidError::Unfinished { bricks: last.bricks });
        }
        // At most 64 levels of 2^57 bricks: the sum fits 64 bits.
        let bricks = levels.iter().map(Level::brick_count).sum();
        if bricks > Self::BRICKS_LIMIT {
            return Err(PyramidError::BrickCount { bricks });
        }
        Ok(Self { layout, levels })
    }

    fn level(
        factors: [u32; 3],
        scale: [u64; 3],
        dims: Dims,
        layout: BrickLayout,
        first_entry: u64,
    ) -> Result<Level, PyramidError> {
        let bricks = dims.0.map(|n| layout.bricks_along(n));
        if bricks.iter().any(|&n| n > u64::from(BrickKey::AXIS_LIMIT)) {
            return Err(PyramidError::TooManyBricks { bricks });
        }
        Ok(Level { factors, scale, dims, bricks: bricks.map(axis_number), first_entry })
    }

    /// Size of the bricks.
    #[must_use]
    pub fn layout(&self) -> BrickLayout {
        self.layout
    }

    /// Stored bytes of the largest brick, apron included.
    #[must_use]
    pub fn largest_brick_bytes(&self, voxel_type: VoxelType) -> u64 {
        let core = self.layout.core() as u64;
        // The finest level is the longest on every axis.
        let extent = self.levels[0].dims.0.map(|n| n.min(core) + 2 * APRON as u64);
        extent.iter().product::<u64>() * voxel_type.bytes() as u64
    }

    /// All levels, finest first; at least one.
    #[must_use]
    pub fn levels(&self) -> &[Level] {
        &self.levels
    }

    /// Numbers of the levels, finest first.
    pub fn lods(&self) -> impl ExactSizeIterator<Item = Lod> + use<> {
        (0..self.levels.len()).map(lod_of)
    }

    /// The level with this number.
    ///
    /// # Panics
    /// If there is no such level.
    #[must_use]
    pub fn level_at(&self, lod: Lod) -> &Level {
        &self.levels[lod.0 as usize]
    }

    /// The coarsest level; it has one brick.
    #[must_use]
    pub fn coarsest(&self) -> Lod {
        lod_of(self.levels.len() - 1)
    }

    /// Number of bricks of all levels.
    #[must_use]
    pub fn brick_count(&self) -> u64 {
        self.levels.iter().map(Level::brick_count).sum()
    }

    /// Whether the key is a brick of this pyramid.
    #[must_use]
    pub fn contains(&self, key: BrickKey) -> bool {
        self.levels.get(key.lod().0 as usize).is_some_and(|l| (0..3).all(|a| key.brick().0[a] < l.bricks[a]))
    }

    /// Number of a brick's entry in the table of contents.
    ///
    /// # Panics
    /// If the key is not a brick of this pyramid.
    #[must_use]
    pub fn entry(&self, key: BrickKey) -> u64 {
        assert!(self.contains(key), "{key} is outside the pyramid");
        let level = self.level_at(key.lod());
        let [x, y, z] = key.brick().0.map(u64::from);
        level.first_entry + x + u64::from(level.bricks[0]) * (y + u64::from(level.bricks[1]) * z)
    }

    /// The brick with this entry number, or `None` beyond the last one.
    #[must_use]
    pub fn key(&self, entry: u64) -> Option<BrickKey> {
        let lod = self.levels.iter().rposition(|l| l.first_entry <= entry)?;
        let level = &self.levels[lod];
        let i = entry - level.first_entry;
        if i >= level.brick_count() {
            return None;
        }
        let [nx, ny] = [u64::from(level.bricks[0]), u64::from(level.bricks[1])];
        let brick = [i % nx, i / nx % ny, i / (nx * ny)];
        Some(BrickKey::new(lod_of(lod), BrickIndex(brick.map(axis_number))))
    }

    /// All bricks of a level, x fastest.
    ///
    /// # Panics
    /// If there is no such level.
    pub fn keys_of(&self, lod: Lod) -> impl Iterator<Item = BrickKey> + '_ {
        let level = self.level_at(lod);
        (level.first_entry..level.first_entry + level.brick_count())
            .map(|e| self.key(e).expect("every entry of a level has a key"))
    }

    /// The brick of the next coarser level that covers this one, or `None` at the coarsest level.
    #[must_use]
    pub fn parent(&self, key: BrickKey) -> Option<BrickKey> {
        let coarser = self.levels.get(key.lod().0 as usize + 1)?;
        let brick = std::array::from_fn(|a| key.brick().0[a] / coarser.factors[a]);
        Some(BrickKey::new(Lod(key.lod().0 + 1), BrickIndex(brick)))
    }

    /// The bricks of the next finer level that this one covers: 1 to 8, none at level 0.
    pub fn children(&self, key: BrickKey) -> impl Iterator<Item = BrickKey> + '_ {
        let finer = key.lod().0.checked_sub(1).map(|l| (Lod(l), self.level_at(Lod(l)).bricks));
        let factors = self.level_at(key.lod()).factors;
        (0..8u32).filter_map(move |corner| {
            let (lod, bricks) = finer?;
            let bit = [corner & 1, corner >> 1 & 1, corner >> 2];
            let child: [u32; 3] = std::array::from_fn(|a| key.brick().0[a] * factors[a] + bit[a]);
            let inside = (0..3).all(|a| bit[a] < factors[a] && child[a] < bricks[a]);
            inside.then(|| BrickKey::new(lod, BrickIndex(child)))
        })
    }

    /// Box of the voxels that the brick owns, in voxels of its level.
    #[must_use]
    pub fn core_box(&self, key: BrickKey) -> VoxelBox {
        let core = self.layout.core() as u64;
        let dims = self.level_at(key.lod()).dims;
        let start = key.brick().0.map(|i| u64::from(i) * core);
        VoxelBox { start, end: std::array::from_fn(|a| (start[a] + core).min(dims.0[a])) }
    }

    /// Number of stored voxels along each axis: the extent of the core and the apron on both sides.
    #[must_use]
    pub fn stored_extent(&self, key: BrickKey) -> [usize; 3] {
        self.core_box(key).extent().map(|n| n + 2 * APRON)
    }

    /// Macro cells along each axis of the brick's core.
    #[must_use]
    pub fn macro_cells(&self, key: BrickKey) -> [usize; 3] {
        self.core_box(key).extent().map(|n| n.div_ceil(MACRO_CELL))
    }
}

/// Level of detail at a place in the list of levels.
fn lod_of(place: usize) -> Lod {
    Lod(u8::try_from(place).expect("a pyramid has at most Lod::LIMIT levels"))
}

/// Number of bricks along an axis of a pyramid, or position of a brick there, in 32 bits.
pub(crate) fn axis_number(number: u64) -> u32 {
    u32::try_from(number).expect("a pyramid has at most BrickKey::AXIS_LIMIT bricks along an axis")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pyramid(dims: [u64; 3], core: u32, factors: &[[u32; 3]]) -> Pyramid {
        Pyramid::new(Dims(dims), BrickLayout::new(core).expect("a valid core"), factors).expect("a valid pyramid")
    }

    #[test]
    fn entries_and_keys_are_inverse_and_cover_every_level() {
        let p = pyramid([65, 100, 17], 16, &[[2, 2, 1], [2, 2, 2], [2, 2, 2]]);
        assert_eq!(
            p.levels().iter().map(|l| l.bricks).collect::<Vec<_>>(),
            [[5, 7, 2], [3, 4, 2], [2, 2, 1], [1, 1, 1]]
        );
        for entry in 0..p.brick_count() {
            let key = p.key(entry).expect("an entry below the count has a key");
            assert_eq!(p.entry(key), entry);
        }
        assert_eq!(p.key(p.brick_count()), None);
    }

    #[test]
    fn children_and_parents_agree_and_children_tile_the_level() {
        let p = pyramid([65, 100, 17], 16, &[[2, 2, 1], [2, 2, 2], [2, 2, 2]]);
        for lod in 1..p.levels().len() {
            let mut seen = 0;
            for key in p.keys_of(Lod(lod as u8)) {
                for child in p.children(key) {
                    assert_eq!(p.parent(child), Some(key));
                    seen += 1;
                }
            }
            assert_eq!(seen, p.level_at(Lod(lod as u8 - 1)).brick_count());
        }
    }

    #[test]
    fn one_voxel_more_than_a_brick_makes_a_brick_of_one_voxel() {
        let p = pyramid([17, 1, 1], 16, &[[2, 1, 1]]);
        let last = BrickKey::new(Lod(0), BrickIndex([1, 0, 0]));
        assert_eq!(p.stored_extent(last), [5, 5, 5]);
        assert_eq!(p.macro_cells(last), [1, 1, 1]);
    }

    #[test]
    fn bad_factors_are_refused() {
        let bad = |f: &[[u32; 3]]| Pyramid::new(Dims([100; 3]), BrickLayout::DEFAULT, f).unwrap_err();
        assert!(matches!(bad(&[[3, 1, 1]]), PyramidError::Factors { level: 1, .. }));
        assert!(matches!(bad(&[[1, 1, 1]]), PyramidError::Factors { .. }));
        assert!(matches!(bad(&[[2, 2, 1]]), PyramidError::Unfinished { .. }));
        assert!(matches!(bad(&[]), PyramidError::Unfinished { .. }));
        let line = |dims, f: &[[u32; 3]]| Pyramid::new(Dims(dims), BrickLayout::DEFAULT, f).unwrap_err();
        // An axis of one voxel does not shrink, but its scale doubles.
        let refused = line([100, 1, 1], &[[2, 2, 1], [1, 2, 1]]);
        assert!(matches!(refused, PyramidError::NothingShrinks { level: 2, .. }), "{refused}");
        let sheet = Dims([1 << 26, 1, 1 << 26]);
        let one_after_the_other = [[[2, 2, 1]; 26], [[1, 2, 2]; 26]].concat();
        let refused = Pyramid::new(sheet, BrickLayout::LARGEST, &one_after_the_other).unwrap_err();
        assert!(matches!(refused, PyramidError::Scale { level: 32, .. }), "{refused}");
    }

    #[test]
    fn each_brick_size_addresses_as_many_voxels_as_its_keys_can_name() {
        for core in crate::brick::CORE_SIZES {
            let layout = BrickLayout::new(core).expect("it is one of the sizes");
            let along = |n: u64| Pyramid::new(Dims([n, 1, 1]), layout, &[[2, 1, 1]; 19]);
            let most = layout.voxels_limit();
            assert!(along(most).is_ok_and(|p| p.level_at(Lod(0)).bricks[0] == BrickKey::AXIS_LIMIT), "core {core}");
            let refused = along(most + 1).unwrap_err();
            match refused {
                PyramidError::TooManyBricks { .. } => assert!(most < Dims::LIMIT, "core {core}"),
                PyramidError::Dims { .. } => assert_eq!(most, Dims::LIMIT, "core {core}"),
                other => panic!("core {core}: {other}"),
            }
        }
    }

    /// 2^57 bricks of 80 bytes exceed 2^64 bytes: sizes computed from such a header would wrap around.
    #[test]
    fn more_bricks_than_any_table_can_name_are_refused() {
        let layout = BrickLayout::new(16).expect("16 is a core");
        let halvings = [[2; 3]; 19];
        let most = Dims([layout.voxels_limit(); 3]);
        let refused = Pyramid::new(most, layout, &halvings).unwrap_err();
        assert!(matches!(refused, PyramidError::BrickCount { .. }), "{refused}");
        let largest_useful = Pyramid::new(Dims([65_536; 3]), BrickLayout::DEFAULT, &halvings[..10]);
        assert!(largest_useful.is_ok_and(|p| p.brick_count() > 1_000_000_000));
    }
}
