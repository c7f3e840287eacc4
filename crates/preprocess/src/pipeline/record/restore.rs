//! Start of a build's files, or continuation of those of an interrupted build ([`super::journal`]).

use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom};
use std::path::PathBuf;

use rayon::prelude::*;
use supervol_files::unfinished::{UnfinishedFile, sweep, sweep_builds};
use supervol_files::{OutputFile, folder_of};
use supervol_format::brick::APRON;
use supervol_format::codec::{BrickShape, Codec};
use supervol_format::container::checksum;
use supervol_format::container::header::{self, Descriptor, Sections};
use supervol_format::container::reader::decode_record;
use supervol_format::container::toc::BrickEntry;
use supervol_format::container::writer::ContainerWriter;
use supervol_format::{BrickKey, ByteSource, Lod};

use super::journal::{Frame, Journal, Unfinished};
use super::tally::tally;
use crate::error::BuildError;
use crate::pipeline::plan::BuildPlan;
use crate::report::LevelReport;
use crate::statistics::Statistics;

/// Size in bytes of the write buffer.
const WRITE_BUFFER_BYTES: usize = 1 << 20;

/// Files of a build, and the tiles that are in them already.
pub(crate) struct Begun {
    pub container: OutputFile,
    /// `None` if the build has no identity, so that it cannot be continued.
    pub journal: Option<Journal>,
    pub writer: ContainerWriter<BufWriter<File>>,
    /// Statistics of the restored voxels of level 0.
    pub statistics: Statistics,
    /// Levels with restored tiles, finest first. All but the last are complete.
    pub levels: Vec<Restored>,
}

/// Restored tiles of a level.
#[derive(Debug, Default, Clone)]
pub(crate) struct Restored {
    /// Number of restored tiles: the first ones in the level's order.
    pub tiles: usize,
    pub report: LevelReport,
}

/// Checks an interrupted build against a plan, on all threads of a pool.
struct Restorer<'a> {
    plan: &'a BuildPlan<'a>,
    pool: &'a rayon::ThreadPool,
}

impl Begun {
    /// Continues an interrupted build, or begins a new one. Unfinished files of other builds in the folder are removed.
    ///
    /// # Errors
    /// If the output exists, its folder cannot be written, or the build is stopped during the checks.
    pub fn new(plan: &BuildPlan<'_>, identity: Option<u64>, pool: &rayon::ThreadPool) -> Result<Self, BuildError> {
        let write_error = |e| BuildError::write(plan.output, e);
        let (path, permissions) = OutputFile::place(plan.output, plan.options.existing)?;
        let folder: PathBuf = folder_of(&path).into();
        let found = identity.and_then(|identity| Unfinished::find(&folder, identity));
        sweep(&folder);
        sweep_builds(&folder);
        if let Some(unfinished) = found
            && let Some(begun) = (Restorer { plan, pool }).resume(unfinished, path.clone())?
        {
            return Ok(begun);
        }
        let container = UnfinishedFile::create_for_build(&folder, permissions).map_err(write_error)?;
        let begin = |identity| Journal::begin(&folder, &container, identity);
        let journal = identity.map(begin).transpose().map_err(write_error)?;
        let file = container.as_file().try_clone().map_err(write_error)?;
        let out = BufWriter::with_capacity(WRITE_BUFFER_BYTES, file);
        Ok(Self {
            writer: ContainerWriter::begin(out, plan.descriptor.clone()).map_err(write_error)?,
            container: OutputFile::of(container, path, plan.options.existing),
            journal,
            statistics: Statistics::new(plan.descriptor.voxel_type),
            levels: Vec::new(),
        })
    }
}

impl Restorer<'_> {
    /// Restores the tiles of an unfinished build that pass all checks. `None` if there are none.
    fn resume(&self, mut unfinished: Unfinished, path: PathBuf) -> Result<Option<Begun>, BuildError> {
        let write_error = |e| BuildError::write(self.plan.output, e);
        let mut file = unfinished.container.as_file().try_clone().map_err(write_error)?;
        let expected = header::encode(&self.plan.descriptor, Sections::default());
        let mut found = vec![0; expected.len()];
        file.seek(SeekFrom::Start(0)).map_err(write_error)?;
        if file.read_exact(&mut found).is_err() || found != expected[..] {
            return Ok(None);
        }
        let out = BufWriter::with_capacity(WRITE_BUFFER_BYTES, file);
        let mut writer = ContainerWriter::resume(out, self.plan.descriptor.clone()).map_err(write_error)?;
        let mut statistics = Statistics::new(self.plan.descriptor.voxel_type);
        let levels = self.restore(&mut unfinished, &mut writer, &mut statistics);
        if self.plan.options.canceller.is_cancelled() {
            // Unchecked tiles are kept, too.
            let kept = unfinished.abandon().map_err(write_error)?;
            return Err(BuildError::Stopped { kept: Some(kept) });
        }
        if levels.is_empty() {
            return Ok(None);
        }
        let (container, journal) = unfinished.resume(writer.position()).map_err(write_error)?;
        let container = OutputFile::of(container, path, self.plan.options.existing);
        Ok(Some(Begun { container, journal: Some(journal), writer, statistics, levels }))
    }

    /// Restores tiles in the order of writing, up to the first missing or wrong one.
    fn restore(
        &self,
        unfinished: &mut Unfinished,
        writer: &mut ContainerWriter<BufWriter<File>>,
        statistics: &mut Statistics,
    ) -> Vec<Restored> {
        let mut levels: Vec<Restored> = Vec::new();
        let pyramid = &self.plan.descriptor.pyramid;
        for (lod, level) in pyramid.lods().zip(pyramid.levels()) {
            let place = usize::from(lod.0);
            for tile in self.plan.tiles(lod) {
                if self.plan.options.canceller.is_cancelled() {
                    return levels;
                }
                let keys: Vec<BrickKey> = tile.bricks().into_iter().map(|brick| BrickKey::new(lod, brick)).collect();
                let frame = unfinished.next_frame(keys.len());
                let Some(frame) = frame.filter(|frame| frame.lod == u32::from(lod.0)) else { return levels };
                let Some(entries) = self.entries(&keys, &frame, writer.position()) else { return levels };
                let Some(counted) = self.check_records(unfinished, &keys, &entries) else { return levels };
                if levels.len() <= place {
                    let report = LevelReport { factors: level.factors, dims: level.dims.0, ..LevelReport::default() };
                    levels.push(Restored { tiles: 0, report });
                }
                for (key, entry) in keys.into_iter().zip(&entries) {
                    assert!(
                        writer.restore(key, entry),
                        "the record of {key} ends where the next begins, and no frame names it twice"
                    );
                    tally(&mut levels[place].report, entry, self.plan.descriptor.scale);
                }
                statistics.merge(&counted);
                levels[place].tiles += 1;
                unfinished.accept(&frame);
            }
        }
        levels
    }

    /// Entries of a tile's bricks. `None` if the frame is of another tile, or the records do not follow each other.
    fn entries(&self, keys: &[BrickKey], frame: &Frame, start: u64) -> Option<Vec<BrickEntry>> {
        let mut end = start;
        let entries = keys.iter().zip(&frame.bricks).map(|(&key, (number, bytes))| {
            let entry = BrickEntry::decode(bytes, key, 0).ok()?;
            let has_record = entry.codec != Codec::Uniform;
            if *number != self.plan.descriptor.pyramid.entry(key) || (has_record && entry.offset != end) {
                return None;
            }
            end = end.checked_add(if has_record { entry.record_bytes() } else { 0 })?;
            Some(entry)
        });
        let entries = entries.collect::<Option<Vec<_>>>()?;
        (entries.len() == keys.len() && frame.bricks.len() == keys.len() && frame.end == end).then_some(entries)
    }

    /// Statistics of a tile's voxels (level 0 only). `None` if a record does not match its entry.
    fn check_records(&self, unfinished: &Unfinished, keys: &[BrickKey], entries: &[BrickEntry]) -> Option<Statistics> {
        let file = unfinished.container.as_file();
        let none = || Statistics::new(self.plan.descriptor.voxel_type);
        let check = |mut statistics: Statistics, (key, entry): (&BrickKey, &BrickEntry)| {
            let record = read_record(file, entry)?;
            if key.lod() == Lod::FINEST {
                self.count(*key, entry, &record, &mut statistics)?;
            }
            Some(statistics)
        };
        let merge = |mut all: Statistics, part: Statistics| {
            all.merge(&part);
            Some(all)
        };
        // One part per thread, because statistics take half a megabyte each.
        let part = keys.len().div_ceil(self.pool.current_num_threads());
        let bricks = || keys.par_iter().zip(entries).with_min_len(part);
        self.pool.install(|| bricks().try_fold(none, check).try_reduce(none, merge))
    }

    /// Adds the voxels that a brick owns to the statistics. `None` if the record cannot be decoded.
    fn count(&self, key: BrickKey, entry: &BrickEntry, record: &[u8], statistics: &mut Statistics) -> Option<()> {
        let Descriptor { voxel_type, absence, pyramid, .. } = &self.plan.descriptor;
        let shape = BrickShape { voxel_type: *voxel_type, extent: pyramid.stored_extent(key) };
        let mut voxels = vec![0; shape.bytes()];
        decode_record(&self.plan.descriptor, key, entry, record, &mut voxels).ok()?;
        let ([nx, ny, nz], size) = (pyramid.core_box(key).extent(), voxel_type.bytes());
        for z in APRON..APRON + nz {
            for y in APRON..APRON + ny {
                let row = ((z * shape.extent[1] + y) * shape.extent[0] + APRON) * size;
                statistics.add(&voxels[row..row + nx * size], *absence);
            }
        }
        Some(())
    }
}

/// Record of an entry; empty for uniform bricks. `None` if the record is incomplete or its checksum is wrong.
fn read_record(file: &File, entry: &BrickEntry) -> Option<Vec<u8>> {
    if entry.codec == Codec::Uniform {
        return Some(Vec::new());
    }
    // Checked before the allocation: the record must lie inside the file.
    let end = entry.offset.checked_add(entry.record_bytes())?;
    if end > file.metadata().ok()?.len() {
        return None;
    }
    let mut record = vec![0; usize::try_from(entry.record_bytes()).ok()?];
    ByteSource::read_exact_at(file, entry.offset, &mut record).ok()?;
    (checksum(&record) == entry.checksum).then_some(record)
}
