//! The build: source -> tiles -> bricks -> container, level by level, in bounded memory.
//!
//! Level 0 is read from the source. Each coarser level is averaged from the finer one, and compared with it for the error bound: while
//! the finer one's tiles are in memory, if there is room for the level (`next_level`), or else from the container's own bricks.
//! Of each level one tile is read ahead while another is encoded on all threads; encoded bricks are written as they come, in tile order,
//! Morton order inside a tile, so that the bytes do not depend on the number of threads. The output is written under a temporary name
//! beside the final one, synced, and renamed when it is whole. A build that was killed, or that the machine has failed, goes on where it
//! was ([`crate::journal`]), and ends with the same bytes.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use rayon::prelude::*;
use supervol_files::{Existing, OutputFile, check_distinct, check_free, folder_of};
use supervol_format::brick::APRON;
use supervol_format::canceller::Canceller;
use supervol_format::codec::quantize::Quantizer;
use supervol_format::codec::{BrickShape, Codec, CodecChoice};
use supervol_format::container::ContainerError;
use supervol_format::container::header::{self, Descriptor, Sections};
use supervol_format::container::manifest::Source;
use supervol_format::container::reader::decode_record;
use supervol_format::container::seal::seal_brick;
use supervol_format::container::toc::{BrickEntry, ENTRY_BYTES};
use supervol_format::container::writer::{ContainerWriter, EncodedBrick};
use supervol_format::level_reader::BrickStore;
use supervol_format::voxel_type::Absence;
use supervol_format::{BrickKey, BrickLayout, ByteSource, Level, Lod, Pyramid, ValueRange, VoxelBox};
use supervol_sources::input::file::SourceFile;
use supervol_sources::stop::{Stoppable, check};
use supervol_sources::{AccessOrder, SourceError, VolumeSource};

use crate::bounded::{MaxError, range_of};
use crate::bricker::{Tile, cut_brick, key_of, tiles};
use crate::downsample::{Reduce, VoxelBlock, downsample, finer_box};
use crate::error::BuildError;
use crate::error_bound::{brick_error, step_error};
use crate::journal::{self, Frame, Journal};
use crate::labels::{look_like_labels, may_be_labels};
use crate::level_reader::by_all_threads;
use crate::lod_axes::{self, LodAxes};
use crate::memory::{MemoryPlan, Spares, tile_bytes};
use crate::next_level::NextLevel;
use crate::ordered::in_order;
use crate::provenance::{ChecksumAlong, Chosen, bounded_notes, check_unchanged, manifest};
use crate::report::{BuildReport, LevelReport, Progress};
use crate::restore::{Begun, Plan, Restored};
use crate::slabs::read_in_slabs;
use crate::statistics::Statistics;

/// Voxels of margin around a tile's core when it is read: the apron.
const MARGIN: u64 = APRON as u64;
/// Bytes buffered before the file is written to.
pub(crate) const WRITE_BUFFER_BYTES: usize = 1 << 20;

/// How to build.
#[derive(Debug, Clone)]
pub struct BuildOptions {
    /// Size of the bricks.
    pub layout: BrickLayout,
    /// Codecs that may be used.
    pub codec: CodecChoice,
    /// How far voxels may be from the source's; labels are kept as they are.
    pub max_error: MaxError,
    /// Which axes coarser levels halve.
    pub lod_axes: LodAxes,
    /// What stands for several voxels in coarser levels; `None`: the majority of labels ([`crate::labels`]), the mean of all
    /// else.
    pub reduce: Option<Reduce>,
    /// Most bytes of memory to use, without the program itself.
    pub memory_bytes: u64,
    /// Threads that encode; fewer are started where the memory does not suffice for all.
    pub threads: usize,
    /// What to do when the output exists.
    pub existing: Existing,
    /// Stops the build from another thread.
    pub canceller: Canceller,
}

/// Bricks of 64, the smallest codec, no error, levels by measurement, 1 GiB, all processors, nothing overwritten.
impl Default for BuildOptions {
    fn default() -> Self {
        Self {
            layout: BrickLayout::DEFAULT,
            codec: CodecChoice::Smallest,
            max_error: MaxError::Exact,
            lod_axes: LodAxes::Auto,
            reduce: None,
            memory_bytes: 1 << 30,
            threads: std::thread::available_parallelism().map_or(1, std::num::NonZero::get),
            existing: Existing::Keep,
            canceller: Canceller::default(),
        }
    }
}

/// Receives progress; may be called from any thread, many times a second.
pub type OnProgress<'a> = &'a (dyn Fn(Progress) + Sync);

/// Reads a box of the source's voxels.
type ReadSource<'a> = &'a (dyn Fn(VoxelBox, &mut [u8]) -> Result<(), BuildError> + Sync);

/// Builds a container from a source.
///
/// `origin` names the source in the manifest.
///
/// # Errors
/// If the source cannot be read, the output not written, the memory does not suffice, or it is stopped. No output is left then; where
/// the machine has failed (a full disk, a read that failed), or somebody has stopped it, what the same build goes on with is
/// ([`BuildError::Kept`], [`BuildError::Stopped`]).
pub fn build(
    source: &dyn VolumeSource,
    mut origin: Source,
    output: &Path,
    options: &BuildOptions,
    on_progress: OnProgress<'_>,
) -> Result<BuildReport, BuildError> {
    let started = Instant::now();
    let source: &dyn VolumeSource = &Stoppable { source, canceller: &options.canceller };
    // Before the source is sampled; the file itself is begun only once the memory is known to suffice.
    check_free(output, options.existing)?;
    check_distinct(output, source.info().files.iter().map(SourceFile::path))?;
    let (mut descriptor, mut levels_plan, reduce) = describe(source, options)?;
    let source_bytes = source.info().memory_bytes;
    let voxel_type = descriptor.voxel_type;
    let plan = MemoryPlan::new(options.memory_bytes, options.threads, source_bytes, &descriptor.pyramid, voxel_type)?;
    let pool = thread_pool(plan.threads)?;
    let order = source.info().access_order;
    let tiles = tiles_of(&descriptor, plan, order, 0);
    let read = |voxels, bytes: &mut [u8]| read_in_slabs(source, plan.threads, voxels, bytes);
    if reduce != Reduce::Majority {
        descriptor.quantizer = options.max_error.quantizer(&descriptor, || range_of(&descriptor, &tiles, read))?;
    }
    if reduce != Reduce::Mean || descriptor.quantizer.is_some() {
        levels_plan.steps.clear();
    }

    let checksum = ChecksumAlong::begin(source, &mut origin, &options.canceller)?;
    let begun = Begun::new(&Plan {
        output,
        descriptor: &descriptor,
        options,
        identity: identity_of(&descriptor, (source, &origin), (options, reduce, &levels_plan), plan),
        tiles: &|lod| tiles_of(&descriptor, plan, order, lod),
        pool: &pool,
    })?;
    let restored: u64 = begun.levels.iter().map(|level| level.report.bricks).sum();
    let counter = ProgressCounter::new(&descriptor, on_progress);
    counter.restore(&begun.levels, &descriptor);
    let build = Build {
        output,
        descriptor: &descriptor,
        options,
        reduce,
        steps: &levels_plan.steps,
        plan,
        pool: &pool,
        file: begun.container.file(),
        journal: begun.journal.as_ref(),
        restored: begun.levels,
        writer: Mutex::new(begun.writer),
        statistics: Mutex::new(begun.statistics),
        checksum: Mutex::new(checksum),
        counter,
        spares: Spares::default(),
    };
    let written = build.write_levels(source, &mut origin, (&tiles, &read));
    let progress = build.counter.now();
    let Build { writer, statistics, .. } = build;
    let statistics = statistics.into_inner().unwrap_or_else(PoisonError::into_inner);
    let writer = writer.into_inner().unwrap_or_else(PoisonError::into_inner);
    let finished = written.and_then(|levels| {
        let chosen = Chosen { options, reduce, levels: &levels_plan };
        let manifest = manifest(source, origin, &descriptor, chosen, &statistics, &levels);
        writer.finish(&manifest).map_err(|e| BuildError::write(output, e))?;
        Ok(levels)
    });
    let levels = match finished {
        Ok(levels) => levels,
        Err(error) => return Err(leave(error, begun.container, begun.journal, progress)),
    };
    // Whoever wants it to stop now gets it whole.
    let container_bytes = begun.container.publish()?;

    let mut notes = notes_of(source, (options, reduce), plan, &descriptor);
    notes.extend(note_of_restored(restored, &descriptor));
    Ok(report_of(levels, container_bytes, (&descriptor, plan), started, notes))
}

/// What a build that is done says of itself.
fn report_of(
    levels: Vec<LevelReport>,
    container_bytes: u64,
    (descriptor, plan): (&Descriptor, MemoryPlan),
    started: Instant,
    notes: Vec<String>,
) -> BuildReport {
    let source_bytes = descriptor.dims().bytes(descriptor.voxel_type).unwrap_or(u64::MAX);
    let wall = started.elapsed().as_secs_f64();
    BuildReport {
        bricks: levels.iter().map(|l| l.bricks).sum(),
        levels,
        source_bytes,
        container_bytes,
        memory_budget_bytes: plan.budget_bytes,
        memory_planned_bytes: plan.planned_bytes(),
        threads: plan.threads,
        wall_ms: wall * 1e3,
        bytes_per_second: source_bytes as f64 / wall,
        notes,
    }
}

/// What is left of a build that the machine has failed or somebody has stopped, so that it can go on later; where nothing is finished,
/// the source is gone, or nobody could tell that it is the same build, nothing is.
fn leave(error: BuildError, container: OutputFile, journal: Option<Journal>, progress: Progress) -> BuildError {
    let is_stopped = error.is_stopped();
    let may_go_on = (error.is_machine_failure() && !error.is_source_gone()) || is_stopped;
    let Some(journal) = journal.filter(|_| may_go_on && progress.bricks_done > 0) else {
        return if is_stopped { BuildError::Stopped { kept: None } } else { error };
    };
    let written_bytes = container.file().metadata().map_or(0, |metadata| metadata.len());
    let left = progress.bricks_total - progress.bricks_done;
    let records = written_bytes as f64 / progress.bricks_done as f64 * left as f64;
    let missing_bytes = records as u64 + progress.bricks_total * ENTRY_BYTES as u64 + 2 * header::PAGE_BYTES as u64;
    let kept = container.abandon().and_then(|container| Ok((container, journal.abandon()?)));
    match kept {
        Ok((Some(container), journal)) if is_stopped => BuildError::Stopped { kept: Some([container, journal]) },
        Ok((Some(container), journal)) => {
            BuildError::Kept { error: Box::new(error), kept: [container, journal], written_bytes, missing_bytes }
        }
        _ => error,
    }
}

fn thread_pool(threads: usize) -> Result<rayon::ThreadPool, BuildError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|source| BuildError::Threads { threads, source })
}

/// What people should know of a build that went on with so many bricks of another.
fn note_of_restored(restored: u64, descriptor: &Descriptor) -> Option<String> {
    let total = descriptor.pyramid.brick_count();
    let note = || format!("went on with a build that was interrupted: {restored} of {total} bricks were there");
    (restored > 0).then(note)
}

/// What people should know of a build.
fn notes_of(
    source: &dyn VolumeSource,
    (options, reduce): (&BuildOptions, Reduce),
    plan: MemoryPlan,
    descriptor: &Descriptor,
) -> Vec<String> {
    let mut notes = bounded_notes(&source.info().notes);
    if options.reduce.is_none() && reduce == Reduce::Majority {
        notes.push("these are labels: coarser levels hold the most frequent one, not the mean (--reduce)".into());
    }
    if descriptor.quantizer.is_some() {
        let error = descriptor.voxel_error() * descriptor.scale.abs();
        notes.push(format!("voxels are within {error} of the source's (--max-error)"));
    } else if options.max_error != MaxError::Exact {
        let why = if reduce == Reduce::Majority {
            "labels are kept as they are"
        } else {
            "voxels cannot be moved by so little"
        };
        notes.push(format!("{why}: --max-error is not applied"));
    }
    if plan.threads < options.threads {
        notes.push(format!("--memory suffices for {} of {} threads", plan.threads, options.threads));
    }
    notes
}

/// All that decides the bytes of a container but the source's voxels, which its checksum stands for; where there are several
/// files, size and time of the others.
fn identity_of(
    descriptor: &Descriptor,
    (source, origin): (&dyn VolumeSource, &Source),
    (options, reduce, levels): (&BuildOptions, Reduce, &lod_axes::Plan),
    plan: MemoryPlan,
) -> Option<u64> {
    // Files that are settled are told by their times.
    if origin.xxh3_64.is_empty() && source.info().files.is_empty() {
        return None;
    }
    let page = header::encode(descriptor, Sections::default());
    // The order of bricks follows the tiles, and those the memory.
    let files: Vec<_> = source.info().files.iter().map(SourceFile::describe).collect();
    let reading = &source.info().reading;
    let (codec, error, memory, tile) = (options.codec, options.max_error, options.memory_bytes, plan.tile_bytes);
    let steps = &levels.steps;
    let choices = format!("{origin:?} {files:?} {reading:?} {codec:?} {error:?} {reduce:?} {steps:?} {memory} {tile}");
    Some(journal::identity(&[env!("CARGO_PKG_VERSION").as_bytes(), &page[..], choices.as_bytes()]))
}

/// The tiles of a level, in the order in which they are read and written.
fn tiles_of(descriptor: &Descriptor, plan: MemoryPlan, order: AccessOrder, lod: usize) -> Vec<Tile> {
    let level = descriptor.pyramid.level_at(Lod(lod as u8));
    let (factors, order) = if lod == 0 { ([1; 3], order) } else { (level.factors, AccessOrder::X_FASTEST) };
    let fits = |size: [u32; 3]| {
        tile_bytes(&descriptor.pyramid, level, factors, size, descriptor.voxel_type) <= plan.tile_bytes
    };
    tiles(level, order, &fits)
}

/// What the container will be, how its levels were chosen, and what stands there for several voxels.
fn describe(
    source: &dyn VolumeSource,
    options: &BuildOptions,
) -> Result<(Descriptor, lod_axes::Plan, Reduce), BuildError> {
    let info = source.info();
    if let Some(defect) = info.geometry.defect() {
        return Err(BuildError::Options(format!("the volume cannot be placed in the world: {defect}")));
    }
    let asks_for_kind = options.reduce.is_none() && may_be_labels(info);
    let is_sampled = asks_for_kind || options.lod_axes == LodAxes::Auto;
    let samples = if is_sampled { lod_axes::sample_boxes(source)? } else { Vec::new() };
    let by_kind = || if asks_for_kind && look_like_labels(&samples) { Reduce::Majority } else { Reduce::Mean };
    let reduce = options.reduce.unwrap_or_else(by_kind);
    let plan = lod_axes::plan(info, samples, options.layout, options.lod_axes);
    let descriptor = Descriptor {
        voxel_type: info.voxel_type,
        pyramid: Pyramid::new(info.dims, options.layout, &plan.factors)?,
        geometry: info.geometry,
        scale: info.scale,
        offset: info.offset,
        absence: Absence::declared(info.nodata, info.voxel_type),
        quantizer: None,
    };
    Ok((descriptor, plan, reduce))
}

/// What voxels of a level are moved to, where its means are rounded to `steps`, from level 1 on.
pub(crate) fn quantizer_of(descriptor: &Descriptor, steps: &[f64], lod: usize) -> Option<Quantizer> {
    let of_level = || Quantizer::new(descriptor.voxel_type, *steps.get(lod.checked_sub(1)?)?);
    descriptor.quantizer.or_else(of_level)
}

/// One build under way.
struct Build<'a> {
    output: &'a Path,
    descriptor: &'a Descriptor,
    options: &'a BuildOptions,
    reduce: Reduce,
    /// See [`lod_axes::Plan::steps`].
    steps: &'a [f64],
    plan: MemoryPlan,
    pool: &'a rayon::ThreadPool,
    /// The unfinished container, for reading finer levels back.
    file: &'a File,
    journal: Option<&'a Journal>,
    /// What an interrupted build has left of each level.
    restored: Vec<Restored>,
    writer: Mutex<ContainerWriter<BufWriter<File>>>,
    statistics: Mutex<Statistics>,
    /// That of the source, where it is taken while level 0 is read.
    checksum: Mutex<Option<ChecksumAlong>>,
    counter: ProgressCounter<'a>,
    /// Two tiles that are read, and one of coarser voxels.
    spares: Spares,
}

/// Takes a brick that is encoded.
type TakeBrick<'a> = dyn FnMut(EncodedBrick) -> Result<(), BuildError> + 'a;
/// Encodes a tile of these voxels.
type EncodeTile<'a> = dyn FnMut(Tile, Vec<u8>, &mut TakeBrick<'_>) -> Result<(), BuildError> + 'a;
/// How far a coarse brick's voxels are from those of the finer level.
type StepOf<'a> = dyn Fn(BrickKey) -> f64 + Sync + 'a;

impl Build<'_> {
    fn writer(&self) -> MutexGuard<'_, ContainerWriter<BufWriter<File>>> {
        self.writer.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn checksum(&self) -> MutexGuard<'_, Option<ChecksumAlong>> {
        self.checksum.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes all levels, finest first.
    fn write_levels(
        &self,
        source: &dyn VolumeSource,
        origin: &mut Source,
        (tiles, read): (&[Tile], ReadSource<'_>),
    ) -> Result<Vec<LevelReport>, BuildError> {
        let (finest, mut next) = self.write_finest(tiles, read)?;
        let mut levels = vec![finest];
        match self.checksum().take() {
            Some(checksum) => origin.xxh3_64 = checksum.finish(&self.options.canceller)?,
            None => check_unchanged(source, origin, &self.options.canceller)?,
        }
        for lod in 1..self.descriptor.pyramid.levels().len() {
            let (level, coarser) = self.write_coarser(lod, next)?;
            levels.push(level);
            next = coarser;
        }
        Ok(levels)
    }

    fn write_finest(
        &self,
        tiles: &[Tile],
        read_source: ReadSource<'_>,
    ) -> Result<(LevelReport, Option<NextLevel>), BuildError> {
        let level = *self.descriptor.pyramid.level_at(Lod::FINEST);
        let done = self.restored.first().map_or(0, |level| level.tiles);
        let tiles_left = AtomicUsize::new(tiles.len() - done);
        let read = |tile: &Tile| {
            let voxels = tile.voxels(self.options.layout.core(), level.dims, MARGIN);
            let mut bytes = self.spares.take(voxels.voxels() * self.descriptor.voxel_type.bytes());
            read_source(voxels, &mut bytes)?;
            let left = tiles_left.fetch_sub(1, Ordering::Relaxed);
            let canceller = &self.options.canceller;
            self.checksum().as_mut().map_or(Ok(()), |checksum| checksum.advance(left, canceller))?;
            Ok(bytes)
        };
        let mut next = self.begin_next(0, tiles, None);
        let report = self.write_level(0, tiles, &read, &mut |tile, mut bytes, take| {
            let voxels = tile.voxels(self.options.layout.core(), level.dims, MARGIN);
            // Each brick moves its own voxels, to know how far; what is counted is what is stored.
            self.encode_tile(0, tile, VoxelBlock { voxels, bytes: &bytes }, None, take)?;
            self.move_voxels(0, &mut bytes);
            let block = VoxelBlock { voxels, bytes: &bytes };
            self.pool.install(|| self.count_voxels(tile, block));
            self.go_on_with(&mut next, 0, tile, block);
            self.spares.give_back(bytes);
            Ok(())
        })?;
        Ok((report, next))
    }

    /// Moves voxels of a level to multiples of the container's step, or of the level's, if it has one.
    fn move_voxels(&self, lod: usize, bytes: &mut [u8]) {
        let Descriptor { voxel_type, absence, .. } = *self.descriptor;
        let Some(quantizer) = quantizer_of(self.descriptor, self.steps, lod) else { return };
        let part = bytes.len() / voxel_type.bytes() / self.plan.threads + 1;
        self.pool.install(|| {
            bytes.par_chunks_mut(part * voxel_type.bytes()).for_each(|part| {
                quantizer.snap(voxel_type, absence, part);
            });
        });
    }

    /// What stands in for reading a finer level back while the next coarser one is written; none where not all of it is written now, the
    /// tiles do not hold whole coarse bricks, or there is no room for it.
    fn begin_next(&self, finer: usize, tiles: &[Tile], now: Option<&NextLevel>) -> Option<NextLevel> {
        if self.restored.get(finer).is_some_and(|level| level.tiles > 0) {
            return None;
        }
        let Descriptor { pyramid, voxel_type, .. } = self.descriptor;
        let level = pyramid.level_at(Lod(finer as u8));
        let size = tiles.first().map(|tile| std::array::from_fn(|a| tile.end[a] - tile.start[a]))?;
        let factors = if finer == 0 { [1; 3] } else { level.factors };
        let most = self.plan.next_level_bytes(pyramid, level, factors, size, *voxel_type);
        // Who reads back keeps decoded bricks.
        let read_back = if finer > 0 { self.plan.cache_bytes } else { 0 };
        let taken = now.map_or(read_back, NextLevel::bytes);
        NextLevel::begin(self.descriptor, finer + 1, tiles, most.saturating_sub(taken), folder_of(self.output))
    }

    /// Makes a tile's part of the next coarser level, if that is kept: no more where its file cannot be written.
    fn go_on_with(&self, kept: &mut Option<NextLevel>, lod: usize, tile: Tile, block: VoxelBlock<'_>) {
        let Some(next) = kept else { return };
        let Descriptor { voxel_type, absence, .. } = *self.descriptor;
        let part = next.part_of(self.descriptor, tile);
        let mut voxels = self.spares.take(part.around.voxels() * voxel_type.bytes());
        self.reduce(lod + 1, block, part.around, &mut voxels);
        let coarse = VoxelBlock { voxels: part.around, bytes: &voxels };
        let step =
            |key| step_error(voxel_type, absence, next.factors(), block, coarse, self.descriptor.pyramid.core_box(key));
        let steps = self.pool.install(|| part.bricks.par_iter().map(|&key| step(key)).collect());
        if next.put(&part, coarse, steps).is_err() {
            // Its room on the disk goes to the container; the finer level is read back.
            *kept = None;
        }
        self.spares.give_back(voxels);
    }

    /// The voxels of a box of a coarser level, from those of the finer one.
    fn reduce(&self, lod: usize, finer: VoxelBlock<'_>, coarse: VoxelBox, out: &mut [u8]) {
        let Descriptor { voxel_type, absence, .. } = *self.descriptor;
        let factors = self.descriptor.pyramid.level_at(Lod(lod as u8)).factors;
        self.pool.install(|| downsample(self.reduce, voxel_type, absence, factors, finer, coarse, out));
        self.move_voxels(lod, out);
    }

    /// Writes a coarser level, from what is kept of it, or else from the finer level's bricks.
    fn write_coarser(
        &self,
        lod: usize,
        kept: Option<NextLevel>,
    ) -> Result<(LevelReport, Option<NextLevel>), BuildError> {
        let level = *self.descriptor.pyramid.level_at(Lod(lod as u8));
        let voxel_bytes = self.descriptor.voxel_type.bytes();
        let coarse_box = |tile: &Tile| tile.voxels(self.options.layout.core(), level.dims, MARGIN);
        let tiles = tiles_of(self.descriptor, self.plan, AccessOrder::X_FASTEST, lod);
        let mut next = self.begin_next(lod, &tiles, kept.as_ref());
        let report = if let Some(kept) = kept {
            let read = |tile: &Tile| {
                let voxels = coarse_box(tile);
                let mut bytes = self.spares.take(voxels.voxels() * voxel_bytes);
                let read = kept.read_box(voxels, &mut bytes);
                read.map_err(|e| SourceError::spool(folder_of(self.output), e))?;
                Ok(bytes)
            };
            self.write_level(lod, &tiles, &read, &mut |tile, bytes, take| {
                let block = VoxelBlock { voxels: coarse_box(&tile), bytes: &bytes };
                self.encode_tile(lod, tile, block, Some(&|key| kept.step(key)), take)?;
                self.go_on_with(&mut next, lod, tile, block);
                self.spares.give_back(bytes);
                Ok(())
            })
        } else {
            self.write_read_back(lod, &tiles, &mut next)
        };
        Ok((report?, next))
    }

    /// Writes a coarser level from the bricks of the finer one.
    fn write_read_back(
        &self,
        lod: usize,
        tiles: &[Tile],
        next: &mut Option<NextLevel>,
    ) -> Result<LevelReport, BuildError> {
        self.writer().flush().map_err(|e| BuildError::write(self.output, e))?;
        let pyramid = &self.descriptor.pyramid;
        let level = *pyramid.level_at(Lod(lod as u8));
        let finer_lod = Lod(lod as u8 - 1);
        let finer_dims = pyramid.level_at(finer_lod).dims;
        let reader = by_all_threads(self, finer_lod, self.plan.cache_bytes as usize);
        let (voxel_type, absence) = (self.descriptor.voxel_type, self.descriptor.absence);
        let coarse_box = |tile: &Tile| tile.voxels(self.options.layout.core(), level.dims, MARGIN);
        let fine_box = |tile: &Tile| finer_box(coarse_box(tile), level.factors, finer_dims);
        let read = |tile: &Tile| {
            let mut bytes = self.spares.take(fine_box(tile).voxels() * voxel_type.bytes());
            let read = self.pool.install(|| reader.read_box(fine_box(tile), &mut bytes));
            read.map_err(|e| BuildError::container(self.output, e))?;
            Ok(bytes)
        };
        self.write_level(lod, tiles, &read, &mut |tile, bytes, take| {
            let finer = VoxelBlock { voxels: fine_box(&tile), bytes: &bytes };
            let mut voxels = self.spares.take(coarse_box(&tile).voxels() * voxel_type.bytes());
            self.reduce(lod, finer, coarse_box(&tile), &mut voxels);
            let block = VoxelBlock { voxels: coarse_box(&tile), bytes: &voxels };
            let step = |key| step_error(voxel_type, absence, level.factors, finer, block, pyramid.core_box(key));
            self.encode_tile(lod, tile, block, Some(&step), take)?;
            self.spares.give_back(bytes);
            self.go_on_with(next, lod, tile, block);
            self.spares.give_back(voxels);
            Ok(())
        })
    }

    /// Reads the level's tiles one ahead, has each encoded, and writes its bricks as they come.
    fn write_level(
        &self,
        lod: usize,
        tiles: &[Tile],
        read: &(dyn Fn(&Tile) -> Result<Vec<u8>, BuildError> + Sync),
        encode: &mut EncodeTile<'_>,
    ) -> Result<LevelReport, BuildError> {
        let level = *self.descriptor.pyramid.level_at(Lod(lod as u8));
        let new = LevelReport { factors: level.factors, dims: level.dims.0, ..LevelReport::default() };
        let Restored { tiles: done, mut report } =
            self.restored.get(lod).cloned().unwrap_or(Restored { tiles: 0, report: new });
        std::thread::scope(|scope| {
            // Room for none: one tile waits in the reader's hands while another is encoded, and that is all.
            let (send, receive) = crossbeam_channel::bounded(0);
            let reader = std::thread::Builder::new().spawn_scoped(scope, move || {
                for tile in &tiles[done..] {
                    let result = read(tile);
                    let failed = result.is_err();
                    // The receiver is gone only when encoding or writing failed: then there is nothing left to read for.
                    if send.send((*tile, result)).is_err() || failed {
                        return;
                    }
                }
            });
            reader.map_err(BuildError::Thread)?;
            for (tile, bytes) in receive {
                let mut frame = Frame { lod: lod as u32, end: 0, bricks: Vec::new() };
                encode(tile, bytes?, &mut |brick| self.append(brick, &mut frame, &mut report))?;
                let bricks = frame.bricks.len() as u64;
                self.note(frame).map_err(|e| BuildError::write(self.output, e))?;
                self.counter.add(lod, bricks, self.bytes_behind(lod, &tile));
            }
            Ok(report)
        })
    }

    /// Bytes of the voxels that a tile is made of: of the source, or of the finer level.
    fn bytes_behind(&self, lod: usize, tile: &Tile) -> u64 {
        let pyramid = &self.descriptor.pyramid;
        let level = pyramid.level_at(Lod(lod as u8));
        let own = tile.voxels(self.options.layout.core(), level.dims, MARGIN);
        let voxels = match lod.checked_sub(1) {
            None => own.voxels(),
            Some(finer) => finer_box(own, level.factors, pyramid.level_at(Lod(finer as u8)).dims).voxels(),
        };
        (voxels * self.descriptor.voxel_type.bytes()) as u64
    }

    /// Writes a brick.
    fn append(&self, brick: EncodedBrick, frame: &mut Frame, report: &mut LevelReport) -> Result<(), BuildError> {
        let number = self.descriptor.pyramid.entry(brick.key);
        let entry = self.writer().append(brick).map_err(|e| BuildError::write(self.output, e))?;
        frame.bricks.push((number, entry.encode()));
        tally(report, &entry, self.descriptor.scale);
        Ok(())
    }

    /// Notes the bricks of a tile once they have left the process.
    fn note(&self, mut frame: Frame) -> io::Result<()> {
        let mut writer = self.writer();
        writer.flush()?;
        frame.end = writer.position();
        self.journal.map_or(Ok(()), |journal| journal.append(&frame))
    }

    /// Encodes all bricks of a tile; hands them over in Morton order while others are encoded.
    fn encode_tile(
        &self,
        lod: usize,
        tile: Tile,
        block: VoxelBlock<'_>,
        step: Option<&StepOf<'_>>,
        take: &mut TakeBrick<'_>,
    ) -> Result<(), BuildError> {
        let bricks = tile.bricks();
        in_order(self.pool, bricks.len(), &|i| self.encode_brick(key_of(lod, bricks[i]), block, step), take)
    }

    /// Adds the tile's own voxels to the statistics, one z-slab per task.
    fn count_voxels(&self, tile: Tile, block: VoxelBlock<'_>) {
        let (voxel_type, absence) = (self.descriptor.voxel_type, self.descriptor.absence);
        let core = tile.voxels(self.options.layout.core(), self.descriptor.dims(), 0);
        let extent = block.voxels.extent();
        let offset: [usize; 3] = std::array::from_fn(|a| (core.start[a] - block.voxels.start[a]) as usize);
        let [nx, ny, nz] = core.extent();
        let size = voxel_type.bytes();
        let slab = nz.div_ceil(self.plan.threads);
        (0..self.plan.threads).into_par_iter().for_each(|part| {
            let mut statistics = Statistics::new(voxel_type);
            for z in (part * slab).min(nz)..((part + 1) * slab).min(nz) {
                for y in 0..ny {
                    let row = ((offset[2] + z) * extent[1] + offset[1] + y) * extent[0] + offset[0];
                    statistics.add(&block.bytes[row * size..(row + nx) * size], absence);
                }
            }
            self.statistics.lock().unwrap_or_else(PoisonError::into_inner).merge(&statistics);
        });
    }

    fn encode_brick(
        &self,
        key: BrickKey,
        block: VoxelBlock<'_>,
        step: Option<&StepOf<'_>>,
    ) -> Result<EncodedBrick, BuildError> {
        check(&self.options.canceller)?;
        let pyramid = &self.descriptor.pyramid;
        let (voxel_type, absence) = (self.descriptor.voxel_type, self.descriptor.absence);
        let mut voxels = cut_brick(pyramid, key, voxel_type.bytes(), block);
        let (mut beneath, mut children_error) = (ValueRange::EMPTY, 0.0f64);
        if step.is_some() {
            for child in pyramid.children(key) {
                let child = self.writer().entry(child).map_err(|e| BuildError::container(self.output, e))?;
                beneath = beneath.union(child.range_beneath);
                children_error = children_error.max(child.error);
            }
        }
        let moved = self.descriptor.quantizer.filter(|_| step.is_none());
        let moved = moved.map_or(0.0, |quantizer| quantizer.snap(voxel_type, absence, &mut voxels));
        let mut sealed =
            seal_brick(self.descriptor, key, &voxels, self.options.codec, beneath, moved).map_err(|e| {
                BuildError::Broken {
                    path: self.output.into(),
                    rule: format!("encoding of {key}"),
                    expected: "a payload".into(),
                    found: e.to_string(),
                }
            })?;
        if let Some(step) = step {
            let own = sealed.entry.range;
            sealed.entry.error = brick_error(children_error, step(key), own, beneath, self.descriptor.voxel_error());
        }
        Ok(sealed)
    }
}

/// Reads finer levels of the unfinished container back.
impl BrickStore for Build<'_> {
    fn descriptor(&self) -> &Descriptor {
        self.descriptor
    }

    fn read_brick(&self, key: BrickKey, mut spare: Vec<u8>) -> Result<Vec<u8>, ContainerError> {
        let entry = self.writer().entry(key)?;
        let mut record = vec![0; entry.record_bytes() as usize];
        ByteSource::read_exact_at(self.file, entry.offset, &mut record).map_err(|source| ContainerError::Io {
            what: key.to_string(),
            offset: entry.offset,
            bytes: entry.record_bytes(),
            source,
        })?;
        let shape =
            BrickShape { voxel_type: self.descriptor.voxel_type, extent: self.descriptor.pyramid.stored_extent(key) };
        spare.resize(shape.bytes(), 0);
        decode_record(self.descriptor, key, &entry, &record, &mut spare)?;
        Ok(spare)
    }
}

pub(crate) fn tally(report: &mut LevelReport, entry: &BrickEntry, scale: f64) {
    report.bricks += 1;
    report.uniform_bricks += u64::from(entry.uniform);
    report.absent_bricks += u64::from(entry.absent);
    report.raw_bricks += u64::from(entry.codec == Codec::Raw);
    report.rle_bricks += u64::from(entry.codec == Codec::Rle);
    report.zstd_bricks += u64::from(entry.codec == Codec::Zstd);
    report.wavelet_bricks += u64::from(entry.codec == Codec::Wavelet);
    report.trimmed_bricks += u64::from(entry.codec == Codec::Trimmed);
    report.bytes += entry.record_bytes();
    report.error = report.error.max(entry.error * scale.abs());
}

/// Counts what is done and tells whoever wants to know.
struct ProgressCounter<'a> {
    on_progress: OnProgress<'a>,
    state: Mutex<Progress>,
}

impl<'a> ProgressCounter<'a> {
    fn new(descriptor: &Descriptor, on_progress: OnProgress<'a>) -> Self {
        let levels = descriptor.pyramid.levels();
        let bytes = |l: &Level| l.dims.bytes(descriptor.voxel_type).unwrap_or(u64::MAX);
        // Each level but the last is read twice: as itself, and for the next coarser one.
        let bytes_total = levels.iter().take(levels.len() - 1).map(bytes).fold(bytes(&levels[0]), u64::saturating_add);
        let bricks_total = descriptor.pyramid.brick_count();
        let start =
            Progress { level: 0, levels: levels.len(), bricks_done: 0, bricks_total, bytes_done: 0, bytes_total };
        Self { on_progress, state: Mutex::new(start) }
    }

    fn now(&self) -> Progress {
        *self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What an interrupted build has left counts as done.
    fn restore(&self, levels: &[Restored], descriptor: &Descriptor) {
        for (lod, level) in levels.iter().enumerate() {
            let of_level = descriptor.pyramid.level_at(Lod(lod as u8));
            let bytes = of_level.dims.bytes(descriptor.voxel_type).unwrap_or(u64::MAX);
            let share = level.report.bricks as f64 / of_level.brick_count() as f64;
            self.add(lod, level.report.bricks, (bytes as f64 * share) as u64);
        }
    }

    fn add(&self, level: usize, bricks: u64, bytes: u64) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.level = level;
        state.bricks_done += bricks;
        // Aprons are read more than once; the total does not know by how much.
        state.bytes_done = (state.bytes_done + bytes).min(state.bytes_total);
        (self.on_progress)(*state);
    }
}
