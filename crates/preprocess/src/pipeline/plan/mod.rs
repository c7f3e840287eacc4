//! Step 1, plan: the container's description and the division of the work.
//!
//! - [`labels`] and [`lod_axes`] sample the source to choose the kind of data and the levels.
//! - [`max_error`] chooses the quantizer of the voxels.
//! - [`memory`] divides the memory.
//! - [`tiles`](mod@tiles) lists the tiles of a level in their order.
//!
//! The plan and the source's voxels decide every byte of the container. The number of threads decides none.

pub mod labels;
pub mod lod_axes;
pub mod max_error;
pub mod memory;
pub mod tiles;

use std::path::Path;

use supervol_format::brick::APRON;
use supervol_format::container::header::{self, Descriptor, Sections};
use supervol_format::container::manifest::Source;
use supervol_format::voxel_type::Absence;
use supervol_format::{Level, Lod, Pyramid, VoxelBox};
use supervol_sources::input::file::SourceFile;
use supervol_sources::{AccessOrder, VolumeSource};
use xxhash_rust::xxh3::Xxh3Default;

use self::labels::{Labels, may_be_labels};
use self::lod_axes::{LevelPlan, LodAxes};
use self::max_error::range_of;
use self::memory::{MemoryPlan, tile_bytes};
use self::tiles::{Tile, tiles};
use super::options::{BuildOptions, Reduce};
use crate::error::BuildError;

/// Margin in voxels around a tile's core when it is read: the apron.
const MARGIN: u64 = APRON as u64;

/// Function that reads a box of the source's voxels.
pub(crate) type ReadSource<'a> = &'a (dyn Fn(VoxelBox, &mut [u8]) -> Result<(), BuildError> + Sync);

/// Plan of one build.
#[derive(Debug)]
pub(crate) struct BuildPlan<'a> {
    /// Path of the container.
    pub output: &'a Path,
    /// Options of the caller.
    pub options: &'a BuildOptions,
    /// Description of the container.
    pub descriptor: Descriptor,
    /// Whether the voxels are labels, and why.
    pub labels: Labels,
    /// Operation that makes one voxel of several in coarser levels.
    pub reduce: Reduce,
    /// Factors of the levels and the measurements that chose them.
    pub levels: LevelPlan,
    /// Division of the memory.
    pub memory: MemoryPlan,
    /// Order in which the source is read fastest.
    order: AccessOrder,
}

impl<'a> BuildPlan<'a> {
    /// Samples the source, chooses the levels and divides the memory.
    ///
    /// # Errors
    /// If the volume cannot be placed in the world, the source cannot be read, or the memory does not suffice.
    pub fn of(source: &dyn VolumeSource, output: &'a Path, options: &'a BuildOptions) -> Result<Self, BuildError> {
        let info = source.info();
        if let Some(defect) = info.geometry.defect() {
            return Err(BuildError::Options(format!("the volume cannot be placed in the world: {defect}")));
        }
        let named = Labels::named(options, info);
        let is_sampled = named.is_none() && may_be_labels(info) || options.lod_axes == LodAxes::Auto;
        let samples = if is_sampled { lod_axes::sample_boxes(source)? } else { Vec::new() };
        let labels = named.unwrap_or_else(|| Labels::recognised(info, &samples));
        let by_kind = if labels == Labels::None { Reduce::Mean } else { Reduce::Majority };
        let reduce = options.reduce.unwrap_or(by_kind);
        let levels = lod_axes::plan(info, samples, options.layout, options.lod_axes);
        let pyramid = Pyramid::new(info.dims, options.layout, &levels.factors)?;
        let memory =
            MemoryPlan::new(options.memory_bytes, options.threads, info.memory_bytes, &pyramid, info.voxel_type)?;
        let descriptor = Descriptor {
            voxel_type: info.voxel_type,
            pyramid,
            geometry: info.geometry,
            scale: info.scale,
            offset: info.offset,
            absence: Absence::declared(info.nodata, info.voxel_type),
            quantizer: None,
        };
        Ok(Self { output, options, descriptor, labels, reduce, levels, memory, order: info.access_order })
    }

    /// Chooses the quantizer of the voxels. Labels are never quantized. Means are rounded in exact containers only.
    ///
    /// # Errors
    /// If the quantizer needs the range of all voxels and the source cannot be read.
    pub fn choose_quantizer(&mut self, read: ReadSource<'_>) -> Result<(), BuildError> {
        if self.reduce != Reduce::Majority && self.labels == Labels::None {
            let range = || range_of(&self.descriptor, &self.tiles(Lod::FINEST), read);
            self.descriptor.quantizer = self.options.max_error.quantizer(&self.descriptor, range)?;
        }
        if self.reduce != Reduce::Mean || self.descriptor.quantizer.is_some() {
            self.levels.steps.clear();
        }
        Ok(())
    }

    /// A level of the container.
    pub fn level(&self, lod: Lod) -> &Level {
        self.descriptor.pyramid.level_at(lod)
    }

    /// Tiles of a level, in the order in which they are read and written.
    pub fn tiles(&self, lod: Lod) -> Vec<Tile> {
        let Descriptor { pyramid, voxel_type, .. } = &self.descriptor;
        let level = self.level(lod);
        let (factors, order) =
            if lod == Lod::FINEST { ([1; 3], self.order) } else { (level.factors, AccessOrder::X_FASTEST) };
        let fits = |size: [u32; 3]| tile_bytes(pyramid, level, factors, size, *voxel_type) <= self.memory.tile_bytes;
        tiles(level, order, &fits)
    }

    /// Box of a tile's voxels, with its apron.
    pub fn tile_box(&self, lod: Lod, tile: &Tile) -> VoxelBox {
        tile.voxels(self.options.layout.core(), self.level(lod).dims, MARGIN)
    }

    /// Checksum of everything that decides the container's bytes. The source's checksum, or the sizes and times of its
    /// files, represent its voxels. `None` if the source has neither.
    pub fn identity(&self, source: &dyn VolumeSource, origin: &Source) -> Option<u64> {
        // Files of a source without a checksum are identified by size and time.
        if origin.xxh3_64.is_empty() && source.info().files.is_empty() {
            return None;
        }
        let page = header::encode(&self.descriptor, Sections::default());
        // The memory decides the tiles, and the tiles decide the order of the bricks.
        let files: Vec<_> = source.info().files.iter().map(SourceFile::describe).collect();
        let reading = &source.info().reading;
        let BuildOptions { codec, max_error: error, kind, memory_bytes: memory, .. } = self.options;
        let (labels, reduce, steps, tile) = (self.labels, self.reduce, &self.levels.steps, self.memory.tile_bytes);
        let choices = format!(
            "{origin:?} {files:?} {reading:?} {codec:?} {error:?} {kind:?} {labels:?} {reduce:?} {steps:?} {memory} {tile}"
        );
        Some(identity(&[env!("CARGO_PKG_VERSION").as_bytes(), &page[..], choices.as_bytes()]))
    }
}

/// Checksum of `parts`, which must hold everything that decides a container's bytes. Two builds with the same number
/// make the same bytes.
#[must_use]
pub fn identity(parts: &[&[u8]]) -> u64 {
    let mut hash = Xxh3Default::new();
    for part in parts {
        hash.update(&(part.len() as u64).to_le_bytes());
        hash.update(part);
    }
    hash.digest()
}
