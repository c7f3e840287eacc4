//! Voxels written brick by brick, each row to its place in the file: every brick is decoded once, however little memory
//! there is. In file order, boxes smaller than a brick's slab would have bricks decoded again and again.

use std::io::{self, Seek, SeekFrom, Write};

use rayon::prelude::*;
use supervol_format::brick::APRON;
use supervol_format::level_reader::{LevelReader, StoredBrick};
use supervol_format::{BrickIndex, BrickKey, Container, VoxelBox, VoxelType, cast};
use supervol_preprocess::error::BuildError;

use super::{Extraction, Plan, needs_scaling, scaled};

/// A file that takes voxels at any place.
pub(super) trait SeekWrite: Write + Seek + Send {}

impl<W: Write + Seek + Send> SeekWrite for W {}

/// Writes the voxels of a box, x fastest, from the place on at which `file` is, and leaves it behind them.
pub(super) fn write_bricks(
    container: &Container,
    what: &Extraction,
    (voxels, written_type): (VoxelBox, VoxelType),
    file: &mut dyn SeekWrite,
    failed: &(dyn Fn(io::Error) -> BuildError + Sync),
) -> Result<(), BuildError> {
    let descriptor = container.descriptor();
    let plan = Plan::new(descriptor, written_type, what.memory_bytes)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(plan.threads).build();
    let pool = pool.map_err(|source| BuildError::Threads { threads: plan.threads, source })?;
    let reader = LevelReader::new(container, what.lod, 0);
    let unreadable = |e| BuildError::container(container.path(), e);
    let at_once = plan.cache_bytes / cast::index(descriptor.pyramid.largest_brick_bytes(descriptor.voxel_type));
    let begin = file.stream_position().map_err(failed)?;
    let mut out = Out { file, voxels, begin, container, written_type, most_voxels: cast::index(plan.box_voxels) };
    pool.install(|| {
        for keys in rows_of_bricks(container, what, voxels, at_once.max(1)) {
            let decoded = keys.par_iter().map(|&key| Ok((key, reader.brick(key)?))).collect::<Result<Vec<_>, _>>();
            out.write(&decoded.map_err(unreadable)?).map_err(failed)?;
        }
        let bytes = (voxels.voxels() * written_type.bytes()) as u64;
        out.file.seek(SeekFrom::Start(begin + bytes)).map_err(failed)?;
        Ok(())
    })
}

/// Bricks of a box of voxels, in parts of rows along x with at most `most` bricks.
fn rows_of_bricks(
    container: &Container,
    what: &Extraction,
    voxels: VoxelBox,
    most: usize,
) -> impl Iterator<Item = Vec<BrickKey>> {
    let (core, lod) = (container.pyramid().layout().core() as u64, what.lod);
    let [x, y, z] = std::array::from_fn(|a| {
        cast::narrow::<u32>(voxels.start[a] / core)..cast::narrow::<u32>(voxels.end[a].div_ceil(core))
    });
    let rows = z.flat_map(move |z| y.clone().map(move |y| [y, z]));
    rows.flat_map(move |[y, z]| {
        let keys: Vec<BrickKey> = x.clone().map(|x| BrickKey::new(lod, BrickIndex([x, y, z]))).collect();
        keys.chunks(most).map(<[BrickKey]>::to_vec).collect::<Vec<_>>()
    })
}

/// The file, and the voxels that it holds.
struct Out<'a> {
    file: &'a mut dyn SeekWrite,
    voxels: VoxelBox,
    /// Place of the first voxel in the file.
    begin: u64,
    container: &'a Container,
    written_type: VoxelType,
    /// Voxels in flight, at most.
    most_voxels: usize,
}

impl Out<'_> {
    /// Writes the voxels of neighbours along x.
    fn write(&mut self, bricks: &[(BrickKey, StoredBrick)]) -> io::Result<()> {
        let pyramid = self.container.pyramid();
        let parts = bricks.iter().map(|(key, _)| pyramid.core_box(*key).intersect(self.voxels));
        let Some(part) = parts.reduce(|a, b| VoxelBox { start: a.start, end: b.end }) else { return Ok(()) };
        let [columns, rows, _] = part.extent();
        let rows_at_once = (self.most_voxels / columns).clamp(1, rows);
        for z in part.start[2]..part.end[2] {
            for y in (part.start[1]..part.end[1]).step_by(rows_at_once) {
                let end = (y + rows_at_once as u64).min(part.end[1]);
                let bytes = self.rows(bricks, part, (y..end, z));
                self.write_rows(bytes, [part.start[0], y, z], columns)?;
            }
        }
        Ok(())
    }

    /// Stored voxels of some rows of neighbours along x.
    fn rows(
        &self,
        bricks: &[(BrickKey, StoredBrick)],
        part: VoxelBox,
        (rows, z): (std::ops::Range<u64>, u64),
    ) -> Vec<u8> {
        let pyramid = self.container.pyramid();
        let size = self.container.descriptor().voxel_type.bytes();
        let mut bytes = Vec::with_capacity(cast::index(rows.end - rows.start) * part.extent()[0] * size);
        for y in rows {
            for (key, brick) in bricks {
                let core = pyramid.core_box(*key);
                let stored = pyramid.stored_extent(*key);
                let held = core.intersect(part);
                let [x, y, z]: [usize; 3] =
                    [(held.start[0], 0), (y, 1), (z, 2)].map(|(at, a)| cast::index(at - core.start[a]) + APRON);
                let first = ((z * stored[1] + y) * stored[0] + x) * size;
                bytes.extend_from_slice(&brick[first..first + held.extent()[0] * size]);
            }
        }
        bytes
    }

    /// Writes rows of this many voxels, of which the first begins at a voxel.
    fn write_rows(&mut self, stored: Vec<u8>, first: [u64; 3], columns: usize) -> io::Result<()> {
        let descriptor = self.container.descriptor();
        let scales = needs_scaling(descriptor, self.written_type);
        let bytes = if scales { scaled(descriptor, &stored, self.written_type) } else { stored };
        let [x, y, z]: [u64; 3] = std::array::from_fn(|a| first[a] - self.voxels.start[a]);
        let [nx, ny, _] = self.voxels.extent().map(|n| n as u64);
        let size = self.written_type.bytes();
        // Whole rows of the file follow each other.
        let run = if columns as u64 == nx { bytes.len() } else { columns * size };
        for (row, run) in (y..).zip(bytes.chunks(run)) {
            let place = self.begin + ((z * ny + row) * nx + x) * size as u64;
            self.file.seek(SeekFrom::Start(place))?;
            self.file.write_all(run)?;
        }
        Ok(())
    }
}
