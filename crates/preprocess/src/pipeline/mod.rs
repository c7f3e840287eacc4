//! The build: source -> tiles -> bricks -> container, level by level, in bounded memory.
//!
//! The folders are the steps of the data path:
//!
//! 1. [`plan`] samples the source and chooses levels, memory and tiles.
//! 2. [`read`] reads one tile ahead, from the source or from finer bricks.
//! 3. [`reduce`] makes coarser voxels and measures their distance from the finer ones.
//! 4. [`encode`] cuts and compresses the bricks of a tile on all threads.
//! 5. [`record`] writes the bricks and keeps journal, statistics and manifest.
//!
//! `levels` takes each tile of each level through steps 2 to 5.
//!
//! Bricks are written in tile order, and in Morton order inside a tile. The bytes therefore do not depend on the number
//! of threads. The output has a temporary name beside the final one until it is whole and synced. A build that was
//! killed or stopped, or that failed with the machine, can be continued ([`record::journal`]). It ends with the same
//! bytes.

pub mod encode;
mod levels;
pub mod options;
pub mod plan;
pub mod read;
pub mod record;
pub mod reduce;

use std::path::Path;
use std::time::Instant;

use supervol_files::{check_distinct, check_free};
use supervol_format::container::manifest::Source;
use supervol_format::{Lod, VoxelBox};
use supervol_sources::VolumeSource;
use supervol_sources::input::file::SourceFile;
use supervol_sources::stop::Stoppable;

use self::encode::Encoder;
use self::levels::Levels;
use self::options::{BuildOptions, OnProgress};
use self::plan::BuildPlan;
use self::plan::memory::Spares;
use self::read::SourceTiles;
use self::read::slabs::read_in_slabs;
use self::record::Record;
use self::record::summary::report_of;
use self::reduce::Reducer;
use crate::error::BuildError;
use crate::provenance::ChecksumAlong;
use crate::report::BuildReport;

/// Builds a container from a source.
///
/// `origin` names the source in the manifest.
///
/// # Errors
/// If the source cannot be read, the output cannot be written, the memory does not suffice, or the build is stopped.
/// There is no output then. If the machine failed (a full disk, a failed read) or the caller stopped the build, its
/// unfinished files are kept for the same build ([`BuildError::Kept`], [`BuildError::Stopped`]).
pub fn build(
    source: &dyn VolumeSource,
    mut origin: Source,
    output: &Path,
    options: &BuildOptions,
    on_progress: OnProgress<'_>,
) -> Result<BuildReport, BuildError> {
    let started = Instant::now();
    let source: &dyn VolumeSource = &Stoppable { source, canceller: &options.canceller };
    // Checked before the source is sampled. The file is created later, once the memory is known to suffice.
    check_free(output, options.existing)?;
    check_distinct(output, source.info().files.iter().map(SourceFile::path))?;

    // Plan: levels, memory, tiles, and the quantizer of the voxels.
    let mut plan = BuildPlan::of(source, output, options)?;
    let threads = plan.memory.threads;
    let pool = thread_pool(threads)?;
    let read = |voxels: VoxelBox, bytes: &mut [u8]| read_in_slabs(source, threads, voxels, bytes);
    plan.choose_quantizer(&read)?;
    let plan = &plan;

    // Record: open new files, or those of an interrupted build.
    let checksum = ChecksumAlong::begin(source, &mut origin, &options.canceller)?;
    let record = Record::begin(plan, plan.identity(source, &origin), &pool, on_progress)?;

    // Read, reduce, encode: all levels, tile by tile.
    let tiles_left = plan.tiles(Lod::FINEST).len() - record.restored(Lod::FINEST).tiles;
    let tiles = SourceTiles::new(plan, source, &read, checksum, tiles_left);
    let spares = Spares::default();
    let reducer = Reducer { plan, pool: &pool, spares: &spares };
    let cell_errors_of = |key, entry: &_| record.cell_errors(key, entry);
    let encoder = Encoder { plan, pool: &pool, entry_of: &|key| record.entry(key), cell_errors_of: &cell_errors_of };
    let levels = Levels { plan, reducer, encoder, record: &record, pool: &pool, spares: &spares };
    let levels = levels.write_all(tiles, &mut origin);

    // Record: write manifest and tables, then give the container its final name.
    let written = record.close(levels, source.info(), origin)?;
    Ok(report_of(plan, written, &source.info().notes, started))
}

fn thread_pool(threads: usize) -> Result<rayon::ThreadPool, BuildError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|source| BuildError::Threads { threads, source })
}
