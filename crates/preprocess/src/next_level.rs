//! The next coarser level, made tile by tile while the finer one is in memory anyway: its voxels, and how far each of its bricks is from
//! the finer ones. Whoever writes it has it at once; otherwise every brick of the finer level is read back and decoded once more.
//!
//! It is kept in memory, where that suffices for the whole level, and makes the same bytes as reading back does.

use supervol_format::container::header::Descriptor;
use supervol_format::{BrickIndex, BrickKey, Lod, VoxelBox};

use crate::bricker::{Tile, key_of};
use crate::downsample::VoxelBlock;

/// Voxels around a tile's part of the level on which the distance from the finer one leans.
const REACH: u64 = 1;

/// See the module.
pub(crate) struct NextLevel {
    lod: usize,
    factors: [u32; 3],
    bricks: [u32; 3],
    /// All voxels of the level, x fastest.
    whole: VoxelBox,
    voxels: Vec<u8>,
    /// Of each brick, x fastest.
    steps: Vec<f64>,
}

/// What a tile of the finer level is in the next one.
pub(crate) struct Part {
    /// Voxels that it makes.
    core: VoxelBox,
    /// These, and those around.
    pub around: VoxelBox,
    /// Bricks that it makes.
    pub bricks: Vec<BrickKey>,
}

impl NextLevel {
    /// None where there is no such level, where tiles of the finer one cut its bricks to pieces, or where it takes more than
    /// `most_bytes`.
    pub fn begin(descriptor: &Descriptor, lod: usize, finer_tiles: &[Tile], most_bytes: u64) -> Option<Self> {
        let level = *descriptor.pyramid.levels().get(lod)?;
        let finer = descriptor.pyramid.level_at(Lod(lod as u8 - 1));
        let whole_bricks = |tile: &Tile| {
            (0..3).all(|a| {
                let is_whole = |end: u32| end.is_multiple_of(level.factors[a]) || end == finer.bricks[a];
                is_whole(tile.start[a]) && is_whole(tile.end[a])
            })
        };
        let voxel_bytes = level.dims.bytes(descriptor.voxel_type)?;
        let bytes = voxel_bytes.checked_add(level.brick_count() * size_of::<f64>() as u64)?;
        if bytes > most_bytes || !finer_tiles.iter().all(whole_bricks) {
            return None;
        }
        Some(Self {
            lod,
            factors: level.factors,
            bricks: level.bricks,
            whole: level.dims.full_box(),
            voxels: vec![0; usize::try_from(voxel_bytes).ok()?],
            steps: vec![0.0; usize::try_from(level.brick_count()).ok()?],
        })
    }

    /// What it takes in memory.
    pub fn bytes(&self) -> u64 {
        (self.voxels.len() + size_of_val(&self.steps[..])) as u64
    }

    /// What its axes halve of the finer level's.
    pub fn factors(&self) -> [u32; 3] {
        self.factors
    }

    /// What a tile of the finer level is in this one.
    pub fn part_of(&self, descriptor: &Descriptor, finer: Tile) -> Part {
        let halved = |v: [u32; 3]| std::array::from_fn(|a| v[a].div_ceil(self.factors[a]));
        let tile = Tile { start: halved(finer.start), end: halved(finer.end) };
        let dims = descriptor.pyramid.level_at(Lod(self.lod as u8)).dims;
        let voxels = |margin| tile.voxels(descriptor.pyramid.layout().core(), dims, margin);
        let bricks = tile.bricks().into_iter().map(|brick| key_of(self.lod, brick)).collect();
        Part { core: voxels(0), around: voxels(REACH), bricks }
    }

    /// Keeps a part: its voxels, and how far each of its bricks is from the finer level.
    pub fn put(&mut self, part: &Part, voxels: VoxelBlock<'_>, steps: Vec<f64>) {
        let size = self.voxel_bytes();
        for (from, to) in rows(part.core, voxels.voxels).zip(rows(part.core, self.whole)) {
            let bytes = part.core.extent()[0] * size;
            self.voxels[to * size..][..bytes].copy_from_slice(&voxels.bytes[from * size..][..bytes]);
        }
        for (key, step) in part.bricks.iter().zip(steps) {
            let at = self.number(key.brick());
            self.steps[at] = step;
        }
    }

    /// Fills `out` with the voxels of a box.
    pub fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) {
        let (size, bytes) = (self.voxel_bytes(), voxels.extent()[0] * self.voxel_bytes());
        for (from, to) in rows(voxels, self.whole).zip(out.chunks_exact_mut(bytes)) {
            to.copy_from_slice(&self.voxels[from * size..][..bytes]);
        }
    }

    /// How far a brick is from the finer level.
    pub fn step(&self, key: BrickKey) -> f64 {
        self.steps[self.number(key.brick())]
    }

    fn voxel_bytes(&self) -> usize {
        self.voxels.len() / self.whole.voxels()
    }

    fn number(&self, BrickIndex(brick): BrickIndex) -> usize {
        let [x, y, z] = brick.map(|i| i as usize);
        let [nx, ny, _] = self.bricks.map(|n| n as usize);
        (z * ny + y) * nx + x
    }
}

/// Where the rows of a box begin in one around it, voxels.
fn rows(part: VoxelBox, whole: VoxelBox) -> impl Iterator<Item = usize> {
    let [nx, ny, _] = whole.extent();
    let from: [usize; 3] = std::array::from_fn(|a| (part.start[a] - whole.start[a]) as usize);
    let [_, rows, slices] = part.extent();
    (0..slices).flat_map(move |z| (0..rows).map(move |y| ((from[2] + z) * ny + from[1] + y) * nx + from[0]))
}

#[cfg(test)]
mod tests {
    use supervol_format::voxel_type::Absence;
    use supervol_format::{BrickLayout, Dims, Geometry, Pyramid, VoxelType};

    use super::*;
    use crate::bricker::tiles;
    use crate::source::AccessOrder;

    /// Four levels, of which the first coarser one has these factors.
    fn descriptor(factors: [u32; 3]) -> Descriptor {
        let layout = BrickLayout::new(16).expect("16 is a core");
        let factors = [factors, [2; 3], [2; 3]];
        Descriptor {
            voxel_type: VoxelType::U16,
            pyramid: Pyramid::new(Dims([63, 50, 33]), layout, &factors).expect("a valid pyramid"),
            geometry: Geometry::IDENTITY,
            scale: 1.0,
            offset: 0.0,
            absence: Absence::NON_FINITE_ONLY,
            quantizer: None,
        }
    }

    fn tiles_of(descriptor: &Descriptor, most_bricks: u32) -> Vec<Tile> {
        let fits = |size: [u32; 3]| size.iter().product::<u32>() <= most_bricks;
        tiles(descriptor.pyramid.level_at(Lod::FINEST), AccessOrder::X_FASTEST, &fits)
    }

    #[test]
    fn what_tiles_put_is_read_back_whole() {
        for factors in [[2; 3], [2, 2, 1], [1, 2, 1]] {
            let descriptor = descriptor(factors);
            let level = *descriptor.pyramid.level_at(Lod(1));
            let whole = level.dims.full_box();
            let voxels: Vec<u8> = (0..whole.voxels() as u16).flat_map(u16::to_le_bytes).collect();
            let of = |part: VoxelBox| -> Vec<u8> {
                rows(part, whole).flat_map(|from| voxels[2 * from..][..2 * part.extent()[0]].to_vec()).collect()
            };
            for most_bricks in [8, 16, 1000] {
                let finer = tiles_of(&descriptor, most_bricks);
                let mut next = NextLevel::begin(&descriptor, 1, &finer, u64::MAX).expect("bricks are whole");
                for &tile in &finer {
                    let part = next.part_of(&descriptor, tile);
                    let bytes = of(part.around);
                    let steps = part.bricks.iter().map(|key| f64::from(key.brick().0[0])).collect();
                    next.put(&part, VoxelBlock { voxels: part.around, bytes: &bytes }, steps);
                }
                for tile in tiles(&level, AccessOrder::X_FASTEST, &|size| size.iter().product::<u32>() <= 3) {
                    let part = tile.voxels(descriptor.pyramid.layout().core(), level.dims, 2);
                    let mut read = vec![0; of(part).len()];
                    next.read_box(part, &mut read);
                    assert_eq!(read, of(part), "{part:?} of {factors:?}");
                }
                let all = Tile { start: [0; 3], end: level.bricks };
                for key in all.bricks().into_iter().map(|brick| key_of(1, brick)) {
                    assert_eq!(next.step(key), f64::from(key.brick().0[0]), "{key}");
                }
            }
        }
    }

    #[test]
    fn it_is_not_kept_where_tiles_cut_bricks_or_the_memory_does_not_suffice() {
        let descriptor = descriptor([2; 3]);
        assert!(NextLevel::begin(&descriptor, 1, &tiles_of(&descriptor, 4), u64::MAX).is_none(), "one brick along z");
        let tiles = tiles_of(&descriptor, 8);
        let bytes = NextLevel::begin(&descriptor, 1, &tiles, u64::MAX).expect("bricks are whole").bytes();
        assert!(NextLevel::begin(&descriptor, 1, &tiles, bytes).is_some());
        assert!(NextLevel::begin(&descriptor, 1, &tiles, bytes - 1).is_none());
        assert!(NextLevel::begin(&descriptor, 4, &tiles, u64::MAX).is_none(), "there is no such level");
    }
}
