//! The next coarser level, made tile by tile while the finer one is in memory: its voxels, and the distance of each brick
//! from the finer level. Without it every brick of the finer level is read back and decoded once more.
//!
//! The level is kept in memory if it fits. Otherwise it is kept in a nameless file beside the container, which vanishes
//! with the process, if the disk has room for this file and the largest possible container. Both ways make the same
//! bytes as reading back.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;

use supervol_format::brick::MACRO_CELL;
use supervol_format::byte_source::ByteSource;
use supervol_format::cast::index;
use supervol_format::container::header::Descriptor;
use supervol_format::{BrickIndex, BrickKey, Lod, VoxelBox};

use crate::pipeline::plan::tiles::Tile;
use crate::pipeline::reduce::downsample::VoxelBlock;
use crate::pipeline::reduce::error_bound::StepErrors;

/// Voxels around a tile's part of the level that its distance from the finer level depends on.
const REACH: u64 = 1;

/// Voxels and distances of the next coarser level (see the module).
pub(crate) struct NextLevel {
    lod: Lod,
    factors: [u32; 3],
    bricks: [u32; 3],
    /// All voxels of the level, x fastest.
    whole: VoxelBox,
    voxel_bytes: usize,
    voxels: Kept,
    /// Distances of each brick and of its macro cells from the finer level in stored units, x fastest.
    steps: Vec<StepErrors>,
    steps_bytes: u64,
}

/// Storage of the voxels, addressed in bytes.
enum Kept {
    Memory(Vec<u8>),
    File(File),
}

impl Kept {
    fn write(&mut self, at: usize, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Memory(all) => all[at..][..bytes.len()].copy_from_slice(bytes),
            Self::File(file) => {
                file.seek(SeekFrom::Start(at as u64))?;
                file.write_all(bytes)?;
            }
        }
        Ok(())
    }

    fn read(&self, at: usize, out: &mut [u8]) -> io::Result<()> {
        match self {
            Self::Memory(all) => out.copy_from_slice(&all[at..][..out.len()]),
            Self::File(file) => file.read_exact_at(at as u64, out)?,
        }
        Ok(())
    }
}

/// Part of the level that a tile of the finer level makes.
pub(crate) struct Part {
    /// Voxels that the tile makes.
    core: VoxelBox,
    /// The same, grown by `REACH`.
    pub around: VoxelBox,
    /// Bricks that the tile makes.
    pub bricks: Vec<BrickKey>,
}

impl NextLevel {
    /// Begins the level above `finer`. `None` if there is no such level, if tiles of the finer level cut its bricks, or if it takes
    /// more than `most_bytes` of memory and `folder` has no room for a file.
    pub fn begin(
        descriptor: &Descriptor,
        finer: Lod,
        finer_tiles: &[Tile],
        most_bytes: u64,
        folder: &Path,
    ) -> Option<Self> {
        let lod = Lod(finer.0 + 1);
        let level = *descriptor.pyramid.levels().get(usize::from(lod.0))?;
        let finer = descriptor.pyramid.level_at(finer);
        let whole_bricks = |tile: &Tile| {
            (0..3).all(|a| {
                let is_whole = |end: u32| end.is_multiple_of(level.factors[a]) || end == finer.bricks[a];
                is_whole(tile.start[a]) && is_whole(tile.end[a])
            })
        };
        let bytes = level.dims.bytes(descriptor.voxel_type)?;
        let cells = (descriptor.pyramid.layout().core() / MACRO_CELL).pow(3);
        let steps_bytes = level.brick_count() * (size_of::<StepErrors>() + cells * size_of::<f64>()) as u64;
        if steps_bytes > most_bytes || !finer_tiles.iter().all(whole_bricks) {
            return None;
        }
        let voxels = if bytes <= most_bytes - steps_bytes {
            Kept::Memory(vec![0; usize::try_from(bytes).ok()?])
        } else {
            let largest = descriptor.pyramid.largest_brick_bytes(descriptor.voxel_type);
            let container = descriptor.pyramid.brick_count().saturating_mul(largest);
            if free_bytes(folder)? < container.saturating_add(bytes) {
                return None;
            }
            Kept::File(tempfile::tempfile_in(folder).ok()?)
        };
        Some(Self {
            lod,
            factors: level.factors,
            bricks: level.bricks,
            whole: level.dims.full_box(),
            voxel_bytes: descriptor.voxel_type.bytes(),
            voxels,
            steps: vec![StepErrors::default(); usize::try_from(level.brick_count()).ok()?],
            steps_bytes,
        })
    }

    /// Size in memory, in bytes.
    pub fn bytes(&self) -> u64 {
        let voxels = match &self.voxels {
            Kept::Memory(all) => all.len(),
            Kept::File(_) => 0,
        };
        voxels as u64 + self.steps_bytes
    }

    /// Factors of the level relative to the finer one.
    pub fn factors(&self) -> [u32; 3] {
        self.factors
    }

    /// Part of this level that a tile of the finer level makes.
    pub fn part_of(&self, descriptor: &Descriptor, finer: Tile) -> Part {
        let halved = |v: [u32; 3]| std::array::from_fn(|a| v[a].div_ceil(self.factors[a]));
        let tile = Tile { start: halved(finer.start), end: halved(finer.end) };
        let dims = descriptor.pyramid.level_at(self.lod).dims;
        let voxels = |margin| tile.voxels(descriptor.pyramid.layout().core(), dims, margin);
        let bricks = tile.bricks().into_iter().map(|brick| BrickKey::new(self.lod, brick)).collect();
        Part { core: voxels(0), around: voxels(REACH), bricks }
    }

    /// Stores a part: its voxels, and the distances of each of its bricks from the finer level.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn put(&mut self, part: &Part, voxels: VoxelBlock<'_>, steps: Vec<StepErrors>) -> io::Result<()> {
        let size = self.voxel_bytes;
        let row_bytes = part.core.extent()[0] * size;
        let places: Vec<_> = rows(part.core, voxels.voxels).zip(rows(part.core, self.whole)).collect();
        let mut bytes = Vec::new();
        for run in places.chunks(self.rows_at_once(part.core)) {
            bytes.clear();
            run.iter().for_each(|(from, _)| bytes.extend_from_slice(&voxels.bytes[from * size..][..row_bytes]));
            self.voxels.write(run[0].1 * size, &bytes)?;
        }
        for (key, step) in part.bricks.iter().zip(steps) {
            let at = self.number(key.brick());
            self.steps[at] = step;
        }
        Ok(())
    }

    /// Fills `out` with the voxels of a box.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> io::Result<()> {
        let rows_at_once = self.rows_at_once(voxels);
        let bytes = rows_at_once * voxels.extent()[0] * self.voxel_bytes;
        let mut runs = rows(voxels, self.whole).step_by(rows_at_once).zip(out.chunks_exact_mut(bytes));
        runs.try_for_each(|(from, to)| self.voxels.read(from * self.voxel_bytes, to))
    }

    /// Number of a box's rows that lie one behind the other: all of a slice if the box spans the level in x, else one.
    fn rows_at_once(&self, part: VoxelBox) -> usize {
        if part.extent()[0] == self.whole.extent()[0] { part.extent()[1] } else { 1 }
    }

    /// Distances of a brick from the finer level, in stored units.
    pub fn step(&self, key: BrickKey) -> StepErrors {
        self.steps[self.number(key.brick())].clone()
    }

    fn number(&self, BrickIndex(brick): BrickIndex) -> usize {
        let [x, y, z] = brick.map(|i| i as usize);
        let [nx, ny, _] = self.bricks.map(|n| n as usize);
        (z * ny + y) * nx + x
    }
}

/// Free bytes on the disk of a folder. `None` if the system does not tell.
#[cfg(unix)]
fn free_bytes(folder: &Path) -> Option<u64> {
    rustix::fs::statvfs(folder).ok().map(|disk| disk.f_bavail.saturating_mul(disk.f_frsize))
}

#[cfg(not(unix))]
fn free_bytes(_: &Path) -> Option<u64> {
    None
}

/// Start of each row of the box `part` inside the box `whole`, in voxels.
fn rows(part: VoxelBox, whole: VoxelBox) -> impl Iterator<Item = usize> {
    let [nx, ny, _] = whole.extent();
    let from: [usize; 3] = std::array::from_fn(|a| index(part.start[a] - whole.start[a]));
    let [_, rows, slices] = part.extent();
    (0..slices).flat_map(move |z| (0..rows).map(move |y| ((from[2] + z) * ny + from[1] + y) * nx + from[0]))
}

#[cfg(test)]
mod tests {
    use supervol_format::voxel_type::Absence;
    use supervol_format::{BrickLayout, Dims, Geometry, Pyramid, VoxelType};
    use supervol_sources::AccessOrder;

    use super::*;
    use crate::pipeline::plan::tiles::tiles;

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
            let step_of = |key: &BrickKey| {
                let brick = f64::from(key.brick().0[0]);
                StepErrors { brick, cells: vec![0.5 * brick; 8] }
            };
            for most_bricks in [8, 16, 1000] {
                let finer = tiles_of(&descriptor, most_bricks);
                let folder = tempfile::tempdir().expect("a folder");
                // In memory, and in a file.
                let steps_bytes = level.brick_count() * (size_of::<StepErrors>() + 8 * size_of::<f64>()) as u64;
                let memory = if most_bricks == 16 { steps_bytes } else { u64::MAX };
                let mut next =
                    NextLevel::begin(&descriptor, Lod::FINEST, &finer, memory, folder.path()).expect("whole bricks");
                assert_eq!(matches!(next.voxels, Kept::File(_)), most_bricks == 16);
                for &tile in &finer {
                    let part = next.part_of(&descriptor, tile);
                    let bytes = of(part.around);
                    let steps = part.bricks.iter().map(step_of).collect();
                    next.put(&part, VoxelBlock { voxels: part.around, bytes: &bytes }, steps).expect("room for it");
                }
                for most_bricks in [3, 1000] {
                    let fits = |size: [u32; 3]| size.iter().product::<u32>() <= most_bricks;
                    for tile in tiles(&level, AccessOrder::X_FASTEST, &fits) {
                        let part = tile.voxels(descriptor.pyramid.layout().core(), level.dims, 2);
                        let mut read = vec![0; of(part).len()];
                        next.read_box(part, &mut read).expect("it is there");
                        assert_eq!(read, of(part), "{part:?} of {factors:?}");
                    }
                }
                let all = Tile { start: [0; 3], end: level.bricks };
                for key in all.bricks().into_iter().map(|brick| BrickKey::new(Lod(1), brick)) {
                    assert_eq!(next.step(key), step_of(&key), "{key}");
                }
            }
        }
    }

    #[test]
    fn it_is_kept_where_there_is_room_unless_tiles_cut_bricks() {
        let descriptor = descriptor([2; 3]);
        let folder = tempfile::tempdir().expect("a folder");
        let begin = |lod, tiles: &[Tile], memory, folder: &Path| {
            NextLevel::begin(&descriptor, lod, tiles, memory, folder).map(|next| next.bytes())
        };
        assert_eq!(begin(Lod::FINEST, &tiles_of(&descriptor, 4), u64::MAX, folder.path()), None, "one brick along z");
        let tiles = tiles_of(&descriptor, 8);
        // Eight macro cells in a brick.
        let of_brick = (size_of::<StepErrors>() + 8 * size_of::<f64>()) as u64;
        let steps = descriptor.pyramid.level_at(Lod(1)).brick_count() * of_brick;
        let bytes = begin(Lod::FINEST, &tiles, u64::MAX, folder.path()).expect("bricks are whole");
        assert_eq!(begin(Lod::FINEST, &tiles, bytes, Path::new("/nowhere")), Some(bytes));
        assert_eq!(begin(Lod::FINEST, &tiles, bytes - 1, folder.path()), Some(steps), "in a file");
        assert_eq!(begin(Lod::FINEST, &tiles, bytes - 1, Path::new("/nowhere")), None);
        assert_eq!(begin(Lod::FINEST, &tiles, steps - 1, folder.path()), None);
        assert_eq!(begin(Lod(3), &tiles, u64::MAX, folder.path()), None, "there is no such level");
        // More than any disk has.
        let dims = Dims([1 << 20; 3]);
        let layout = BrickLayout::LARGEST;
        let pyramid = Pyramid::new(dims, layout, &[[2; 3]; 13]).expect("a valid pyramid");
        let all = Tile { start: [0; 3], end: pyramid.level_at(Lod(0)).bricks };
        let descriptor = Descriptor { pyramid, ..descriptor };
        assert!(NextLevel::begin(&descriptor, Lod(1), &[all], 1 << 40, folder.path()).is_none());
        let left = folder.path().read_dir().expect("a folder").count();
        assert_eq!(left, 0, "files have no names");
    }
}
