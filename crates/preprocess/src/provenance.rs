//! What a container says of its volume beside the voxels: where they came from, what they are, what a reader noticed.
//!
//! Names, units and notes come from files, and are bounded here: no file makes a manifest that no reader takes.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use supervol_format::VoxelType;
use supervol_format::canceller::Canceller;
use supervol_format::container::header::Descriptor;
use supervol_format::container::manifest::{AxisName, Json, Manifest, Source};
use supervol_sources::input::file::SourceFile;
use supervol_sources::input::selection::Selection;
use supervol_sources::open::split_array;
use supervol_sources::stop::check;
use supervol_sources::{Message, SourceError, SourceInfo, VolumeSource};

use crate::bounded::MaxError;
use crate::downsample::Reduce;
use crate::error::BuildError;
use crate::lod_axes::Plan;
use crate::pipeline::BuildOptions;
use crate::report::LevelReport;
use crate::statistics::{self, Statistics, Values};

/// Longest name or unit, longest note, and most notes that the manifest keeps.
const LABEL_CHARACTERS: usize = 256;
const NOTE_CHARACTERS: usize = 500;
const NOTES: usize = 50;
/// Least size of a file whose checksum is taken while its voxels are read: to read a smaller one twice takes no time worth saving.
const TAKEN_ALONG_BYTES: u64 = 256 << 20;

/// The parameter that says what stands for several voxels in coarser levels.
const REDUCE: &str = "reduce";
/// What begins the names of parameters that say how files were read.
const READER: &str = "reader_";
/// The parameter that says what each axis would have kept, where that was measured.
const RMS_KEPT: &str = "lod_axes_rms_kept";
/// The parameter that says what means in coarser levels are rounded to, where they are.
const STEPS: &str = "coarse_steps";

/// What stands for several voxels in the coarser levels of a container with this manifest: the mean, where nothing is said.
///
/// # Errors
/// With what is said, if that is none of [`Reduce::ALL`].
pub fn reduce_of(manifest: &Manifest) -> Result<Reduce, String> {
    let Some(name) = manifest.parameters.get(REDUCE) else { return Ok(Reduce::Mean) };
    Reduce::ALL.into_iter().find(|reduce| reduce.name() == name).ok_or_else(|| name.clone())
}

/// What means are rounded to in the coarser levels of a container with this manifest and type of voxels, from level 1 on, stored units:
/// none, and 0, where they are not.
///
/// # Errors
/// With what is said, if these are no steps.
pub fn steps_of(manifest: &Manifest, voxel_type: VoxelType) -> Result<Vec<f64>, String> {
    let Some(text) = manifest.parameters.get(STEPS) else { return Ok(Vec::new()) };
    Plan::steps_from(text, voxel_type).ok_or_else(|| text.clone())
}

/// What a build was asked for, and what it chose by itself.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chosen<'a> {
    pub options: &'a BuildOptions,
    pub reduce: Reduce,
    pub levels: &'a Plan,
}

/// What halving each axis keeps of the levels before, as [`Plan::rms_kept_from`] has it; none where the manifest does not say it.
#[must_use]
pub fn rms_kept_of(manifest: &Manifest) -> Option<Vec<[f64; 3]>> {
    Plan::rms_kept_from(manifest.parameters.get(RMS_KEPT)?)
}

/// The manifest of a container whose levels have been written.
pub(crate) fn manifest(
    source: &dyn VolumeSource,
    origin: Source,
    descriptor: &Descriptor,
    Chosen { options, reduce, levels: plan }: Chosen<'_>,
    statistics: &Statistics,
    levels: &[LevelReport],
) -> Manifest {
    let info = source.info();
    let values = Values::of(descriptor, statistics);
    let codec = options.codec.name();
    // Where nothing is moved, manifests are what they were before anything could be.
    let max_error = (options.max_error != MaxError::Exact).then(|| ("max_error", options.max_error.describe()));
    let rms_kept = plan.describe().map(|kept| (RMS_KEPT, kept));
    let steps = plan.describe_steps().map(|steps| (STEPS, steps));
    let reading = info.reading.iter().map(|(option, said)| (format!("{READER}{option}"), said.clone()));
    let parameters = [
        ("brick", options.layout.core().to_string()),
        ("codec", codec.to_string()),
        ("lod_axes", format!("{:?}", options.lod_axes).to_lowercase()),
        ("memory_bytes", options.memory_bytes.to_string()),
        (REDUCE, reduce.name().to_string()),
    ];
    Manifest {
        tool: format!("supervol {}", env!("CARGO_PKG_VERSION")),
        parameters: parameters
            .into_iter()
            .chain(max_error)
            .chain(rms_kept)
            .chain(steps)
            .map(|(k, v)| (k.to_string(), v))
            .chain(reading)
            .collect(),
        source: origin,
        space: info.space.name().into(),
        axes: info.axes.clone().map(|a| AxisName { name: label(&a.name), unit: label(&a.unit) }),
        unit: label(&info.unit),
        value_range: values.range,
        present_voxels: values.present,
        histogram: values.histogram,
        percentiles: values.percentiles,
        level_errors: levels.iter().map(|l| statistics::finite(l.error)).collect(),
        survey: info.survey.as_ref().and_then(|s| serde_json::to_value(s).and_then(|s| Json::of(&s)).ok()),
        notes: bounded_notes(&info.notes),
        others: std::collections::BTreeMap::default(),
    }
}

/// A name or unit that a file gives, cut where it is none any more.
fn label(text: &str) -> String {
    cut(text, LABEL_CHARACTERS)
}

fn cut(text: &str, characters: usize) -> String {
    match text.char_indices().nth(characters) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.into(),
    }
}

/// The first notes, and how many more there are: a file must not fill the manifest with what it made us notice.
pub(crate) fn bounded_notes(notes: &[Message]) -> Vec<String> {
    let mut kept: Vec<String> = notes.iter().take(NOTES).map(|note| cut(&note.to_string(), NOTE_CHARACTERS)).collect();
    if notes.len() > NOTES {
        kept.push(format!("and {} more notes", notes.len() - NOTES));
    }
    kept
}

/// Whether a source whose voxels have all been read still is what it was when it was opened, and when `origin` was told.
pub(crate) fn check_unchanged(
    source: &dyn VolumeSource,
    origin: &Source,
    canceller: &Canceller,
) -> Result<(), BuildError> {
    let files = &source.info().files;
    files.iter().try_for_each(SourceFile::check_unchanged)?;
    // Times may be too coarse to tell two versions apart.
    let is_one = source.info().folder.is_none() && !origin.xxh3_64.is_empty();
    if let Some(first) = files.first().filter(|_| is_one) {
        let now = identify_unless(first.path(), &origin.format, canceller)?.xxh3_64;
        if now != origin.xxh3_64 {
            let what = format!("its checksum was {}, now it is {now}", origin.xxh3_64);
            return Err(SourceError::Changed { path: first.path().into(), what }.into());
        }
    }
    Ok(())
}

/// Name, size and checksum of what a source is read from: of the file that was asked for, or of all files of a folder, their names
/// included. What was chosen of it follows the name: builds of two volumes of one file are two builds. The checksum of one large file
/// is left to the build, which takes it while it reads the voxels.
///
/// # Errors
/// If a file cannot be read.
pub fn identify_source(path: &Path, selection: &Selection, source: &dyn VolumeSource) -> Result<Source, BuildError> {
    identify_source_unless(path, selection, source, &Canceller::default())
}

/// The same, unless somebody stops it.
pub(crate) fn identify_source_unless(
    path: &Path,
    selection: &Selection,
    source: &dyn VolumeSource,
    canceller: &Canceller,
) -> Result<Source, BuildError> {
    let (file, array) = split_array(path);
    let mut found = match &source.info().folder {
        Some(folder) => identify_folder(folder, source.info(), canceller)?,
        None => match &source.info().files[..] {
            [only] if only.bytes() >= TAKEN_ALONG_BYTES => unsummed(&file, source.info().format, only.bytes()),
            _ => identify_unless(&file, source.info().format, canceller)?,
        },
    };
    found.name += &Selection { array: array.or(selection.array.clone()), ..selection.clone() }.to_string();
    Ok(found)
}

fn identify_folder(folder: &Path, info: &SourceInfo, canceller: &Canceller) -> Result<Source, BuildError> {
    let mut hash = xxhash_rust::xxh3::Xxh3Default::new();
    let mut bytes = 0;
    for file in &info.files {
        let name = file.path().strip_prefix(folder).unwrap_or(file.path());
        hash.update(name.to_string_lossy().as_bytes());
        bytes += take_file(file.path(), &mut hash, canceller)?;
    }
    Ok(origin(folder, info.format, bytes, &hash))
}

/// Name, size and checksum of a source file, read once from end to end.
///
/// # Errors
/// If the file cannot be read.
pub fn identify(path: &Path, format: &str) -> Result<Source, BuildError> {
    identify_unless(path, format, &Canceller::default())
}

fn identify_unless(path: &Path, format: &str, canceller: &Canceller) -> Result<Source, BuildError> {
    let mut hash = xxhash_rust::xxh3::Xxh3Default::new();
    let bytes = take_file(path, &mut hash, canceller)?;
    Ok(origin(path, format, bytes, &hash))
}

fn origin(path: &Path, format: &str, bytes: u64, hash: &xxhash_rust::xxh3::Xxh3Default) -> Source {
    Source { xxh3_64: format!("{:016x}", hash.digest()), ..unsummed(path, format, bytes) }
}

fn unsummed(path: &Path, format: &str, bytes: u64) -> Source {
    let name_of = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
    // `.` has a name, too.
    let found = name_of(path).or_else(|| name_of(&std::fs::canonicalize(path).ok()?));
    let name = found.unwrap_or_default();
    Source { name, format: format.into(), bytes, xxh3_64: String::new() }
}

/// The checksum of the one file that a source is read from, taken piece by piece while its voxels are: what the disk has just given for
/// these, it need not give again.
pub(crate) struct ChecksumAlong {
    file: File,
    of: SourceFile,
    hash: xxhash_rust::xxh3::Xxh3Default,
    taken: u64,
}

impl ChecksumAlong {
    /// Of a source whose origin has none yet; none where there is no such file. Where times do not tell whether it is changed
    /// meanwhile, its checksum is taken at once.
    pub(crate) fn begin(
        source: &dyn VolumeSource,
        origin: &mut Source,
        canceller: &Canceller,
    ) -> Result<Option<Self>, BuildError> {
        let info = source.info();
        let [only] = &info.files[..] else { return Ok(None) };
        if !origin.xxh3_64.is_empty() || info.folder.is_some() {
            return Ok(None);
        }
        let file = File::open(only.path()).map_err(|e| SourceError::io(only.path(), e))?;
        // Whoever has the file mapped changes its time only with the first write to a page that the disk has. Where nothing can be
        // written, nobody writes.
        let _ = file.sync_data();
        let of = only.settled()?;
        if !of.is_settled() {
            origin.xxh3_64 = identify_unless(of.path(), info.format, canceller)?.xxh3_64;
            return Ok(None);
        }
        Ok(Some(Self { file, of, hash: xxhash_rust::xxh3::Xxh3Default::new(), taken: 0 }))
    }

    /// Goes on as far as a reader gets with one of so many tiles that are left to it.
    pub(crate) fn advance(&mut self, tiles_left: usize, canceller: &Canceller) -> Result<(), BuildError> {
        let left = self.of.bytes().saturating_sub(self.taken);
        let (taken, part) = (self.taken, left / tiles_left.max(1) as u64);
        self.taken += take_bytes(&mut (&self.file).take(part), self.of.path(), &mut self.hash, canceller)?;
        if self.taken < taken + part {
            self.of.check_unchanged()?;
        }
        Ok(())
    }

    /// The checksum of all of it.
    ///
    /// # Errors
    /// If it cannot be read, or is not the file any more that it was when this began.
    pub(crate) fn finish(mut self, canceller: &Canceller) -> Result<String, BuildError> {
        self.advance(1, canceller)?;
        self.of.check_unchanged()?;
        Ok(format!("{:016x}", self.hash.digest()))
    }
}

/// Adds the bytes of a file to a checksum; how many there are.
pub(crate) fn take_file(
    path: &Path,
    hash: &mut xxhash_rust::xxh3::Xxh3Default,
    canceller: &Canceller,
) -> Result<u64, BuildError> {
    let mut file = File::open(path).map_err(|e| SourceError::io(path, e))?;
    take_bytes(&mut file, path, hash, canceller)
}

/// Adds all that a reader of the file still gives to a checksum; how many bytes there are.
fn take_bytes(
    from: &mut dyn Read,
    path: &Path,
    hash: &mut xxhash_rust::xxh3::Xxh3Default,
    canceller: &Canceller,
) -> Result<u64, BuildError> {
    let mut buffer = vec![0; 1 << 20];
    let mut bytes = 0;
    loop {
        check(canceller)?;
        let n = from.read(&mut buffer).map_err(|e| SourceError::io(path, e))?;
        if n == 0 {
            return Ok(bytes);
        }
        bytes += n as u64;
        hash.update(&buffer[..n]);
    }
}
