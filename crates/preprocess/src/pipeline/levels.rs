//! Levels of a build, finest first. Each tile is read, reduced, encoded and recorded.
//!
//! Level 0 is read from the source. A coarser level is downsampled from the next finer one and compared with it for the
//! error bound. If there is room for the whole level ([`NextLevel`]), this is done while the finer level's tiles are in
//! memory. Otherwise the finer level is read back from the container's bricks.

use supervol_files::folder_of;
use supervol_format::Lod;
use supervol_format::cast::index;
use supervol_format::container::manifest::Source;
use supervol_sources::SourceError;

use super::encode::{Encoder, TakeBrick};
use super::plan::BuildPlan;
use super::plan::memory::Spares;
use super::plan::tiles::Tile;
use super::read::{SourceTiles, one_ahead};
use super::record::Record;
use super::record::journal::Frame;
use super::record::restore::Restored;
use super::reduce::Reducer;
use super::reduce::downsample::VoxelBlock;
use super::reduce::error_bound::step_error;
use super::reduce::next_level::NextLevel;
use crate::error::BuildError;
use crate::level_reader::by_all_threads;
use crate::report::LevelReport;

/// Encodes a tile with these voxels and hands over its bricks.
type EncodeTile<'a> = dyn FnMut(Tile, Vec<u8>, &mut TakeBrick<'_>) -> Result<(), BuildError> + 'a;

/// Steps that a tile goes through.
pub(super) struct Levels<'a> {
    pub(super) plan: &'a BuildPlan<'a>,
    pub(super) reducer: Reducer<'a>,
    pub(super) encoder: Encoder<'a>,
    pub(super) record: &'a Record<'a>,
    pub(super) pool: &'a rayon::ThreadPool,
    /// Buffers: two for tiles that are read, one for coarser voxels.
    pub(super) spares: &'a Spares,
}

impl Levels<'_> {
    /// Writes all levels, finest first. The source's checksum goes to `origin`.
    pub(super) fn write_all(
        &self,
        source: SourceTiles<'_>,
        origin: &mut Source,
    ) -> Result<Vec<LevelReport>, BuildError> {
        let (finest, mut next) = self.write_finest(&source)?;
        let mut levels = vec![finest];
        source.finish(origin)?;
        for lod in self.plan.descriptor.pyramid.lods().skip(1) {
            let (level, coarser) = self.write_coarser(lod, next)?;
            levels.push(level);
            next = coarser;
        }
        Ok(levels)
    }

    /// Writes level 0 from the source; begins level 1 if there is room for it.
    fn write_finest(&self, source: &SourceTiles<'_>) -> Result<(LevelReport, Option<NextLevel>), BuildError> {
        let lod = Lod::FINEST;
        let tiles = self.plan.tiles(lod);
        let mut next = self.begin_next(lod, &tiles, None);
        let read = |tile: &Tile| source.read(tile, self.spares);
        let report = self.write_level(lod, &tiles, &read, &mut |tile, mut bytes, take| {
            let voxels = self.plan.tile_box(lod, &tile);
            // Each brick quantizes its own voxels and measures their error. The statistics count the quantized voxels.
            self.encoder.encode_tile(lod, tile, VoxelBlock { voxels, bytes: &bytes }, None, take)?;
            self.reducer.quantize(lod, &mut bytes);
            let block = VoxelBlock { voxels, bytes: &bytes };
            self.pool.install(|| self.record.count(tile, block));
            self.reducer.add_to_next(&mut next, lod, tile, block);
            self.spares.give_back(bytes);
            Ok(())
        })?;
        Ok((report, next))
    }

    /// Writes a coarser level: from memory if it is `kept` there, else from the finer level's bricks.
    fn write_coarser(&self, lod: Lod, kept: Option<NextLevel>) -> Result<(LevelReport, Option<NextLevel>), BuildError> {
        // The finer level's error bounds are read back.
        self.record.flush()?;
        let tiles = self.plan.tiles(lod);
        let mut next = self.begin_next(lod, &tiles, kept.as_ref());
        let report = match kept {
            Some(kept) => self.write_kept(lod, &tiles, &kept, &mut next),
            None => self.write_read_back(lod, &tiles, &mut next),
        };
        Ok((report?, next))
    }

    /// Writes a coarser level whose voxels were made while the finer one was written.
    fn write_kept(
        &self,
        lod: Lod,
        tiles: &[Tile],
        kept: &NextLevel,
        next: &mut Option<NextLevel>,
    ) -> Result<LevelReport, BuildError> {
        let read = |tile: &Tile| {
            let voxels = self.plan.tile_box(lod, tile);
            let mut bytes = self.spares.take(voxels.voxels() * self.plan.descriptor.voxel_type.bytes());
            let read = kept.read_box(voxels, &mut bytes);
            read.map_err(|e| SourceError::spool(folder_of(self.plan.output), e))?;
            Ok(bytes)
        };
        self.write_level(lod, tiles, &read, &mut |tile, bytes, take| {
            let block = VoxelBlock { voxels: self.plan.tile_box(lod, &tile), bytes: &bytes };
            self.encoder.encode_tile(lod, tile, block, Some(&|key| kept.step(key)), take)?;
            self.reducer.add_to_next(next, lod, tile, block);
            self.spares.give_back(bytes);
            Ok(())
        })
    }

    /// Writes a coarser level from the bricks of the finer one.
    fn write_read_back(
        &self,
        lod: Lod,
        tiles: &[Tile],
        next: &mut Option<NextLevel>,
    ) -> Result<LevelReport, BuildError> {
        let descriptor = &self.plan.descriptor;
        let (voxel_type, absence, pyramid) = (descriptor.voxel_type, descriptor.absence, &descriptor.pyramid);
        let factors = self.plan.level(lod).factors;
        let reader = by_all_threads(self.record, Lod(lod.0 - 1), index(self.plan.memory.cache_bytes));
        let read = |tile: &Tile| {
            let voxels = self.reducer.finer_box(lod, tile);
            let mut bytes = self.spares.take(voxels.voxels() * voxel_type.bytes());
            let read = self.pool.install(|| reader.read_box(voxels, &mut bytes));
            read.map_err(|e| BuildError::container(self.plan.output, e))?;
            Ok(bytes)
        };
        self.write_level(lod, tiles, &read, &mut |tile, bytes, take| {
            let finer = VoxelBlock { voxels: self.reducer.finer_box(lod, &tile), bytes: &bytes };
            let coarse = self.plan.tile_box(lod, &tile);
            let mut voxels = self.spares.take(coarse.voxels() * voxel_type.bytes());
            self.reducer.reduce(lod, finer, coarse, &mut voxels);
            let block = VoxelBlock { voxels: coarse, bytes: &voxels };
            let step = |key| step_error(voxel_type, absence, factors, finer, block, pyramid.core_box(key));
            self.encoder.encode_tile(lod, tile, block, Some(&step), take)?;
            self.spares.give_back(bytes);
            self.reducer.add_to_next(next, lod, tile, block);
            self.spares.give_back(voxels);
            Ok(())
        })
    }

    /// Begins the next coarser level in memory. `None` if an interrupted build has written tiles of `finer` already.
    fn begin_next(&self, finer: Lod, tiles: &[Tile], now: Option<&NextLevel>) -> Option<NextLevel> {
        if self.record.restored(finer).tiles > 0 {
            return None;
        }
        self.reducer.begin_next(finer, tiles, now)
    }

    /// Reads the level's tiles one ahead, encodes each, and records its bricks.
    fn write_level(
        &self,
        lod: Lod,
        tiles: &[Tile],
        read: &(dyn Fn(&Tile) -> Result<Vec<u8>, BuildError> + Sync),
        encode: &mut EncodeTile<'_>,
    ) -> Result<LevelReport, BuildError> {
        let Restored { tiles: done, mut report } = self.record.restored(lod);
        one_ahead(&tiles[done..], read, &mut |tile, bytes| {
            let mut frame = Frame { lod: u32::from(lod.0), end: 0, bricks: Vec::new() };
            encode(tile, bytes, &mut |brick| self.record.append(brick, &mut frame, &mut report))?;
            self.record.end_tile(lod, frame, self.bytes_behind(lod, &tile))
        })?;
        Ok(report)
    }

    /// Size in bytes of the voxels that a tile is made of: those of the source, or of the finer level.
    fn bytes_behind(&self, lod: Lod, tile: &Tile) -> u64 {
        let is_finest = lod == Lod::FINEST;
        let voxels = if is_finest { self.plan.tile_box(lod, tile) } else { self.reducer.finer_box(lod, tile) };
        (voxels.voxels() * self.plan.descriptor.voxel_type.bytes()) as u64
    }
}
