//! Step 5, record: bricks are written, entered in the journal, and counted; the manifest is written last.
//!
//! - [`journal`] and `restore` keep the finished tiles, so that an interrupted build can be continued.
//! - [`manifest`] describes the volume: origin, options, statistics, notes.
//! - `progress`, `tally` and `summary` count for the progress callback and for the report.
//!
//! Protocol of a tile: `Record::append` for each of its bricks, then `Record::end_tile`. The latter enters the tile
//! in the journal once its bricks have left the process.

pub mod journal;
pub mod manifest;
mod progress;
pub(super) mod restore;
pub(super) mod summary;
mod tally;

use std::fs::File;
use std::io::{self, BufWriter};
use std::sync::{Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;
use supervol_files::OutputFile;
use supervol_format::cast::{index, whole};
use supervol_format::codec::BrickShape;
use supervol_format::container::ContainerError;
use supervol_format::container::header::{self, Descriptor};
use supervol_format::container::manifest::Source;
use supervol_format::container::reader::{decode_record, read_cell_errors};
use supervol_format::container::toc::{BrickEntry, ENTRY_BYTES};
use supervol_format::container::writer::{ContainerWriter, EncodedBrick};
use supervol_format::level_reader::BrickStore;
use supervol_format::{BrickKey, ByteSource, Lod};
use supervol_sources::SourceInfo;

use self::journal::{Frame, Journal};
use self::manifest::manifest;
use self::progress::ProgressCounter;
use self::restore::{Begun, Restored};
use self::tally::tally;
use super::options::OnProgress;
use super::plan::BuildPlan;
use super::plan::tiles::Tile;
use super::reduce::downsample::VoxelBlock;
use crate::error::BuildError;
use crate::report::{LevelReport, Progress};
use crate::statistics::Statistics;

/// Files of a running build, and their statistics.
pub(super) struct Record<'a> {
    plan: &'a BuildPlan<'a>,
    container: OutputFile,
    /// `None` if the build has no identity, so that it cannot be continued.
    journal: Option<Journal>,
    /// Finished tiles of an interrupted build, by level.
    restored: Vec<Restored>,
    writer: Mutex<ContainerWriter<BufWriter<File>>>,
    statistics: Mutex<Statistics>,
    progress: ProgressCounter<'a>,
}

/// A finished container.
pub(super) struct Written {
    /// Reports of the levels, finest first.
    pub(super) levels: Vec<LevelReport>,
    pub(super) container_bytes: u64,
    /// Number of bricks taken over from an interrupted build.
    pub(super) restored: u64,
}

impl<'a> Record<'a> {
    /// Begins the container and its journal, or continues those of an interrupted build with the same identity.
    pub(super) fn begin(
        plan: &'a BuildPlan<'a>,
        identity: Option<u64>,
        pool: &rayon::ThreadPool,
        on_progress: OnProgress<'a>,
    ) -> Result<Self, BuildError> {
        let Begun { container, journal, writer, statistics, levels } = Begun::new(plan, identity, pool)?;
        let progress = ProgressCounter::new(&plan.descriptor, on_progress);
        progress.restore(&levels, &plan.descriptor);
        Ok(Self {
            plan,
            container,
            journal,
            restored: levels,
            writer: Mutex::new(writer),
            statistics: Mutex::new(statistics),
            progress,
        })
    }

    /// Finished tiles of a level from an interrupted build; none if there was no such build.
    pub(super) fn restored(&self, lod: Lod) -> Restored {
        let level = self.plan.level(lod);
        let new = || LevelReport { factors: level.factors, dims: level.dims.0, ..LevelReport::default() };
        let found = self.restored.get(usize::from(lod.0)).cloned();
        found.unwrap_or_else(|| Restored { tiles: 0, report: new() })
    }

    fn writer(&self) -> MutexGuard<'_, ContainerWriter<BufWriter<File>>> {
        self.writer.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes buffered bytes to the file, so that they can be read back.
    pub(super) fn flush(&self) -> Result<(), BuildError> {
        self.writer().flush().map_err(|e| BuildError::write(self.plan.output, e))
    }

    /// Entry of a brick that is written already.
    pub(super) fn entry(&self, key: BrickKey) -> Result<BrickEntry, BuildError> {
        self.writer().entry(key).map_err(|e| BuildError::container(self.plan.output, e))
    }

    /// Error bounds of the macro cells of a brick that has left the process ([`Self::flush`]), in stored units.
    pub(super) fn cell_errors(&self, key: BrickKey, entry: &BrickEntry) -> Result<Vec<f64>, BuildError> {
        read_cell_errors(self.container.file(), (&self.plan.descriptor, header::VERSION), key, entry)
            .map_err(|e| BuildError::container(self.plan.output, e))
    }

    /// Writes a brick, and adds it to the frame of its tile and to the report of its level.
    pub(super) fn append(
        &self,
        brick: EncodedBrick,
        frame: &mut Frame,
        report: &mut LevelReport,
    ) -> Result<(), BuildError> {
        let number = self.plan.descriptor.pyramid.entry(brick.key);
        let entry = self.writer().append(brick).map_err(|e| BuildError::write(self.plan.output, e))?;
        frame.bricks.push((number, entry.encode()));
        tally(report, &entry, self.plan.descriptor.scale);
        Ok(())
    }

    /// Enters a tile in the journal and reports progress. The tile was made of `bytes_behind` bytes of voxels.
    pub(super) fn end_tile(&self, lod: Lod, frame: Frame, bytes_behind: u64) -> Result<(), BuildError> {
        let bricks = frame.bricks.len() as u64;
        self.add_to_journal(frame).map_err(|e| BuildError::write(self.plan.output, e))?;
        self.progress.add(lod, bricks, bytes_behind);
        Ok(())
    }

    /// Enters a tile in the journal after its bricks have left the process.
    fn add_to_journal(&self, mut frame: Frame) -> io::Result<()> {
        let mut writer = self.writer();
        writer.flush()?;
        frame.end = writer.position();
        self.journal.as_ref().map_or(Ok(()), |journal| journal.append(&frame))
    }

    /// Adds the voxels that a tile of level 0 owns to the statistics, one z-slab per task.
    pub(super) fn count(&self, tile: Tile, block: VoxelBlock<'_>) {
        let BuildPlan { descriptor, options, memory, .. } = self.plan;
        let (voxel_type, absence) = (descriptor.voxel_type, descriptor.absence);
        let core = tile.voxels(options.layout.core(), descriptor.dims(), 0);
        let extent = block.voxels.extent();
        let offset: [usize; 3] = std::array::from_fn(|a| index(core.start[a] - block.voxels.start[a]));
        let [nx, ny, nz] = core.extent();
        let size = voxel_type.bytes();
        let slab = nz.div_ceil(memory.threads);
        (0..memory.threads).into_par_iter().for_each(|part| {
            let mut statistics = self.statistics().beside();
            for z in (part * slab).min(nz)..((part + 1) * slab).min(nz) {
                for y in 0..ny {
                    let row = ((offset[2] + z) * extent[1] + offset[1] + y) * extent[0] + offset[0];
                    statistics.add(&block.bytes[row * size..(row + nx) * size], absence);
                }
            }
            self.statistics().merge(&statistics);
        });
    }

    fn statistics(&self) -> MutexGuard<'_, Statistics> {
        self.statistics.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes manifest and tables after all levels, and publishes the container. After an error it keeps the unfinished
    /// files if the build can be continued.
    pub(super) fn close(
        self,
        levels: Result<Vec<LevelReport>, BuildError>,
        info: &SourceInfo,
        origin: Source,
    ) -> Result<Written, BuildError> {
        let Self { plan, container, journal, restored, writer, statistics, progress } = self;
        let statistics = statistics.into_inner().unwrap_or_else(PoisonError::into_inner);
        let writer = writer.into_inner().unwrap_or_else(PoisonError::into_inner);
        let finished = levels.and_then(|levels| {
            let manifest = manifest(info, origin, plan, &statistics, &levels);
            writer.finish(&manifest).map_err(|e| BuildError::write(plan.output, e))?;
            Ok(levels)
        });
        let levels = match finished {
            Ok(levels) => levels,
            Err(error) => return Err(keep_unfinished(error, container, journal, progress.now())),
        };
        // From here on the build can no longer be stopped.
        let container_bytes = container.publish()?;
        let restored = restored.iter().map(|level| level.report.bricks).sum();
        Ok(Written { levels, container_bytes, restored })
    }
}

/// Keeps the files of a build that failed with the machine or was stopped, so that it can be continued. Keeps nothing if
/// no brick is finished, the source is gone, or the build has no identity.
fn keep_unfinished(
    error: BuildError,
    container: OutputFile,
    journal: Option<Journal>,
    progress: Progress,
) -> BuildError {
    let is_stopped = error.is_stopped();
    let may_go_on = (error.is_machine_failure() && !error.is_source_gone()) || is_stopped;
    let Some(journal) = journal.filter(|_| may_go_on && progress.bricks_done > 0) else {
        return if is_stopped { BuildError::Stopped { kept: None } } else { error };
    };
    let written_bytes = container.file().metadata().map_or(0, |metadata| metadata.len());
    let left = progress.bricks_total - progress.bricks_done;
    let records = written_bytes as f64 / progress.bricks_done as f64 * left as f64;
    let missing_bytes =
        whole::<u64>(records) + progress.bricks_total * ENTRY_BYTES as u64 + 2 * header::PAGE_BYTES as u64;
    let kept = container.abandon().and_then(|container| Ok((container, journal.abandon()?)));
    match kept {
        Ok((Some(container), journal)) if is_stopped => BuildError::Stopped { kept: Some([container, journal]) },
        Ok((Some(container), journal)) => {
            BuildError::Kept { error: Box::new(error), kept: [container, journal], written_bytes, missing_bytes }
        }
        _ => error,
    }
}

/// Bricks of the unfinished container, for reading finer levels back.
impl BrickStore for Record<'_> {
    fn descriptor(&self) -> &Descriptor {
        &self.plan.descriptor
    }

    fn read_brick(&self, key: BrickKey, mut spare: Vec<u8>) -> Result<Vec<u8>, ContainerError> {
        let descriptor = &self.plan.descriptor;
        let entry = self.writer().entry(key)?;
        let mut record = vec![0; index(entry.record_bytes())];
        ByteSource::read_exact_at(self.container.file(), entry.offset, &mut record).map_err(|source| {
            ContainerError::Io { what: key.to_string(), offset: entry.offset, bytes: entry.record_bytes(), source }
        })?;
        let shape = BrickShape { voxel_type: descriptor.voxel_type, extent: descriptor.pyramid.stored_extent(key) };
        spare.resize(shape.bytes(), 0);
        decode_record(descriptor, key, &entry, &record, &mut spare)?;
        Ok(spare)
    }
}
