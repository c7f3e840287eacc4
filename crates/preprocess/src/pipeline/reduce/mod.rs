//! Step 3, reduce: voxels of a coarser level, and their distance from the finer ones.
//!
//! - [`downsample`](mod@downsample) makes coarser voxels.
//! - [`error_bound`] measures distances between levels.
//! - [`next_level`] holds the coarser level that is made while the finer one is in memory.

pub mod downsample;
pub mod error_bound;
pub mod next_level;

use rayon::prelude::*;
use supervol_files::folder_of;
use supervol_format::codec::quantize::Quantizer;
use supervol_format::container::header::Descriptor;
use supervol_format::{Lod, VoxelBox};

use self::downsample::{VoxelBlock, downsample, finer_box};
use self::error_bound::step_error;
use self::next_level::NextLevel;
use super::plan::BuildPlan;
use super::plan::memory::Spares;
use super::plan::tiles::Tile;

/// Quantizer of a level's voxels: the container's, or the one that rounds means. `steps` are those of means from level
/// 1 on.
pub(crate) fn quantizer_of(descriptor: &Descriptor, steps: &[f64], lod: Lod) -> Option<Quantizer> {
    let of_level = || Quantizer::new(descriptor.voxel_type, *steps.get(usize::from(lod.0.checked_sub(1)?))?);
    descriptor.quantizer.or_else(of_level)
}

/// Makes coarser voxels on all threads of a pool.
pub(super) struct Reducer<'a> {
    pub(super) plan: &'a BuildPlan<'a>,
    pub(super) pool: &'a rayon::ThreadPool,
    pub(super) spares: &'a Spares,
}

impl Reducer<'_> {
    /// Box of the finer voxels that a tile of a coarser level is made of.
    pub(super) fn finer_box(&self, lod: Lod, tile: &Tile) -> VoxelBox {
        let finer_dims = self.plan.level(Lod(lod.0 - 1)).dims;
        finer_box(self.plan.tile_box(lod, tile), self.plan.level(lod).factors, finer_dims)
    }

    /// Writes the voxels of the box `coarse` of level `lod` to `out`, made of those of the finer level.
    pub(super) fn reduce(&self, lod: Lod, finer: VoxelBlock<'_>, coarse: VoxelBox, out: &mut [u8]) {
        let Descriptor { voxel_type, absence, .. } = self.plan.descriptor;
        let factors = self.plan.level(lod).factors;
        self.pool.install(|| downsample(self.plan.reduce, voxel_type, absence, factors, finer, coarse, out));
        self.quantize(lod, out);
    }

    /// Quantizes voxels of a level, if the level has a quantizer.
    pub(super) fn quantize(&self, lod: Lod, bytes: &mut [u8]) {
        let Descriptor { voxel_type, absence, .. } = self.plan.descriptor;
        let quantizer = quantizer_of(&self.plan.descriptor, &self.plan.levels.steps, lod);
        let Some(quantizer) = quantizer else { return };
        let part = bytes.len() / voxel_type.bytes() / self.plan.memory.threads + 1;
        self.pool.install(|| {
            bytes.par_chunks_mut(part * voxel_type.bytes()).for_each(|part| {
                quantizer.snap(voxel_type, absence, part);
            });
        });
    }

    /// Begins the level after `finer`, so that `finer` need not be read back. `None` if tiles do not hold whole coarse
    /// bricks, or there is no room. `now` is the copy of `finer` itself that is in memory.
    pub(super) fn begin_next(&self, finer: Lod, tiles: &[Tile], now: Option<&NextLevel>) -> Option<NextLevel> {
        let Descriptor { pyramid, voxel_type, .. } = &self.plan.descriptor;
        let level = self.plan.level(finer);
        let size = tiles.first().map(|tile| std::array::from_fn(|a| tile.end[a] - tile.start[a]))?;
        let is_finest = finer == Lod::FINEST;
        let factors = if is_finest { [1; 3] } else { level.factors };
        let most = self.plan.memory.next_level_bytes(pyramid, level, factors, size, *voxel_type);
        // A level that is read back needs the cache of decoded bricks.
        let read_back = if is_finest { 0 } else { self.plan.memory.cache_bytes };
        let taken = now.map_or(read_back, NextLevel::bytes);
        let folder = folder_of(self.plan.output);
        NextLevel::begin(&self.plan.descriptor, finer, tiles, most.saturating_sub(taken), folder)
    }

    /// Makes a tile's part of the next coarser level. Drops that level (`None`) if its file cannot be written.
    pub(super) fn add_to_next(&self, kept: &mut Option<NextLevel>, lod: Lod, tile: Tile, block: VoxelBlock<'_>) {
        let Some(next) = kept else { return };
        let Descriptor { voxel_type, absence, ref pyramid, .. } = self.plan.descriptor;
        let part = next.part_of(&self.plan.descriptor, tile);
        let mut voxels = self.spares.take(part.around.voxels() * voxel_type.bytes());
        self.reduce(Lod(lod.0 + 1), block, part.around, &mut voxels);
        let coarse = VoxelBlock { voxels: part.around, bytes: &voxels };
        let step = |key| step_error(voxel_type, absence, next.factors(), block, coarse, pyramid.core_box(key));
        let steps = self.pool.install(|| part.bricks.par_iter().map(|&key| step(key)).collect());
        if next.put(&part, coarse, steps).is_err() {
            // The container gets the room on the disk, and the finer level is read back.
            *kept = None;
        }
        self.spares.give_back(voxels);
    }
}
