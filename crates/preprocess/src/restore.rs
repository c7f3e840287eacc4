//! Begins the files of a build, or takes over those of the same build that was killed: see [`crate::journal`].

use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

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

use crate::bricker::{Tile, key_of};
use crate::error::BuildError;
use crate::journal::{Frame, Journal, Unfinished};
use crate::pipeline::{BuildOptions, WRITE_BUFFER_BYTES, tally};
use crate::report::LevelReport;
use crate::statistics::Statistics;

/// What a build writes to, and what is there already.
pub(crate) struct Begun {
    pub container: OutputFile,
    /// None where no other build can be known to make the same bytes.
    pub journal: Option<Journal>,
    pub writer: ContainerWriter<BufWriter<File>>,
    /// Of the voxels of level 0 that are there.
    pub statistics: Statistics,
    /// Levels of which something is there, finest first; all but the last are whole.
    pub levels: Vec<Restored>,
}

/// What is there of a level.
#[derive(Debug, Default, Clone)]
pub(crate) struct Restored {
    /// Tiles, in the level's order.
    pub tiles: usize,
    pub report: LevelReport,
}

/// What is to be built.
pub(crate) struct Plan<'a> {
    pub output: &'a Path,
    pub descriptor: &'a Descriptor,
    pub options: &'a BuildOptions,
    /// See [`crate::journal::identity`]; none where the source's voxels have no checksum.
    pub identity: Option<u64>,
    /// The tiles of a level, in its order.
    pub tiles: &'a (dyn Fn(usize) -> Vec<Tile> + Sync),
    pub pool: &'a rayon::ThreadPool,
}

impl Begun {
    /// Goes on with what is there, or begins; what other builds have left in the folder is removed.
    ///
    /// # Errors
    /// If the output is taken, its folder cannot be written to, or it is stopped while it looks at what is there.
    pub fn new(plan: &Plan<'_>) -> Result<Self, BuildError> {
        let write_error = |e| BuildError::write(plan.output, e);
        let (path, permissions) = OutputFile::place(plan.output, plan.options.existing)?;
        let folder: PathBuf = folder_of(&path).into();
        let found = plan.identity.and_then(|identity| Unfinished::find(&folder, identity));
        sweep(&folder);
        sweep_builds(&folder);
        if let Some(unfinished) = found
            && let Some(begun) = plan.go_on(unfinished, path.clone())?
        {
            return Ok(begun);
        }
        let container = UnfinishedFile::create_for_build(&folder, permissions).map_err(write_error)?;
        let begin = |identity| Journal::begin(&folder, &container, identity);
        let journal = plan.identity.map(begin).transpose().map_err(write_error)?;
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

impl Plan<'_> {
    /// Believes as much of an unfinished build as can be proven; none where that is nothing.
    fn go_on(&self, mut unfinished: Unfinished, path: PathBuf) -> Result<Option<Begun>, BuildError> {
        let write_error = |e| BuildError::write(self.output, e);
        let mut file = unfinished.container.as_file().try_clone().map_err(write_error)?;
        let expected = header::encode(self.descriptor, Sections::default());
        let mut found = vec![0; expected.len()];
        file.seek(SeekFrom::Start(0)).map_err(write_error)?;
        if file.read_exact(&mut found).is_err() || found != expected[..] {
            return Ok(None);
        }
        let out = BufWriter::with_capacity(WRITE_BUFFER_BYTES, file);
        let mut writer = ContainerWriter::resume(out, self.descriptor.clone()).map_err(write_error)?;
        let mut statistics = Statistics::new(self.descriptor.voxel_type);
        let levels = self.restore(&mut unfinished, &mut writer, &mut statistics);
        if self.options.canceller.is_cancelled() {
            // All of it: what has not been looked at is cut off by nobody.
            let kept = unfinished.abandon().map_err(write_error)?;
            return Err(BuildError::Stopped { kept: Some(kept) });
        }
        if levels.is_empty() {
            return Ok(None);
        }
        let (container, journal) = unfinished.go_on(writer.position()).map_err(write_error)?;
        let container = OutputFile::of(container, path, self.options.existing);
        Ok(Some(Begun { container, journal: Some(journal), writer, statistics, levels }))
    }

    /// Restores tiles in the order in which they are written, as far as they are there.
    fn restore(
        &self,
        unfinished: &mut Unfinished,
        writer: &mut ContainerWriter<BufWriter<File>>,
        statistics: &mut Statistics,
    ) -> Vec<Restored> {
        let mut levels: Vec<Restored> = Vec::new();
        for (lod, level) in self.descriptor.pyramid.levels().iter().enumerate() {
            for tile in (self.tiles)(lod) {
                if self.options.canceller.is_cancelled() {
                    return levels;
                }
                let keys: Vec<BrickKey> = tile.bricks().into_iter().map(|brick| key_of(lod, brick)).collect();
                let frame = unfinished.next_frame(keys.len());
                let Some(frame) = frame.filter(|frame| frame.lod as usize == lod) else { return levels };
                let Some(entries) = self.entries(&keys, &frame, writer.position()) else { return levels };
                let Some(counted) = self.check_records(unfinished, &keys, &entries) else { return levels };
                if levels.len() <= lod {
                    let report = LevelReport { factors: level.factors, dims: level.dims.0, ..LevelReport::default() };
                    levels.push(Restored { tiles: 0, report });
                }
                for (key, entry) in keys.into_iter().zip(&entries) {
                    assert!(writer.restore(key, entry), "{key} is written once, and its record lies where it should");
                    tally(&mut levels[lod].report, entry, self.descriptor.scale);
                }
                statistics.merge(&counted);
                levels[lod].tiles += 1;
                unfinished.accept(&frame);
            }
        }
        levels
    }

    /// The entries of a tile's bricks where the frame is of this tile, and its records lie one behind the other.
    fn entries(&self, keys: &[BrickKey], frame: &Frame, start: u64) -> Option<Vec<BrickEntry>> {
        let mut end = start;
        let entries = keys.iter().zip(&frame.bricks).map(|(&key, (number, bytes))| {
            let entry = BrickEntry::decode(bytes, key, 0).ok()?;
            let has_record = entry.codec != Codec::Uniform;
            if *number != self.descriptor.pyramid.entry(key) || (has_record && entry.offset != end) {
                return None;
            }
            end = end.checked_add(if has_record { entry.record_bytes() } else { 0 })?;
            Some(entry)
        });
        let entries = entries.collect::<Option<Vec<_>>>()?;
        (entries.len() == keys.len() && frame.bricks.len() == keys.len() && frame.end == end).then_some(entries)
    }

    /// The statistics of the voxels of level 0 in a tile's records, where all records are what their entries say.
    fn check_records(&self, unfinished: &Unfinished, keys: &[BrickKey], entries: &[BrickEntry]) -> Option<Statistics> {
        let file = unfinished.container.as_file();
        let none = || Statistics::new(self.descriptor.voxel_type);
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
        // One part for each thread: statistics take half a megabyte.
        let part = keys.len().div_ceil(self.pool.current_num_threads());
        let bricks = || keys.par_iter().zip(entries).with_min_len(part);
        self.pool.install(|| bricks().try_fold(none, check).try_reduce(none, merge))
    }

    /// Counts the voxels that a brick owns.
    fn count(&self, key: BrickKey, entry: &BrickEntry, record: &[u8], statistics: &mut Statistics) -> Option<()> {
        let Descriptor { voxel_type, absence, pyramid, .. } = self.descriptor;
        let shape = BrickShape { voxel_type: *voxel_type, extent: pyramid.stored_extent(key) };
        let mut voxels = vec![0; shape.bytes()];
        decode_record(self.descriptor, key, entry, record, &mut voxels).ok()?;
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

/// The record that an entry names, where it is whole; empty where there is none.
fn read_record(file: &File, entry: &BrickEntry) -> Option<Vec<u8>> {
    if entry.codec == Codec::Uniform {
        return Some(Vec::new());
    }
    // No more is read than is there.
    let end = entry.offset.checked_add(entry.record_bytes())?;
    if end > file.metadata().ok()?.len() {
        return None;
    }
    let mut record = vec![0; usize::try_from(entry.record_bytes()).ok()?];
    ByteSource::read_exact_at(file, entry.offset, &mut record).ok()?;
    (checksum(&record) == entry.checksum).then_some(record)
}
