//! Many volumes at once: which there are, what their containers are called, and what came of each.
//!
//! 1. Inputs come from a list or from a folder that is searched ([`inputs`]).
//! 2. What came of each is a line of a file beside the containers ([`results`]): the last line of an input counts.
//! 3. An input is done if its files are what they were, its container is what was written, and the same was asked for
//!    ([`Standing`]): all of that is read again, nothing is taken from a name or a time.
//! 4. Containers are called after their inputs ([`crate::naming`]).

pub mod inputs;
pub mod results;

use std::path::{Path, PathBuf};

use supervol_files::OutputError;
use supervol_format::Container;
use supervol_format::canceller::Canceller;
use supervol_sources::open::split_array;
use supervol_sources::{SourceError, VolumeSource};
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

use crate::error::BuildError;
use crate::kept::Reading;
use crate::pipeline::BuildOptions;
use crate::provenance::take_file;
use results::{Record, Status};

/// What there is of an input already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standing {
    /// Its container is to be built, and nothing lies where it goes.
    New,
    /// A batch that was interrupted has left a container of these bytes of the source, but no line that says so.
    Interrupted,
    /// Done: source, container and options are what they were.
    Done,
}

/// What was asked for, as far as it decides voxels: memory, threads and what may be overwritten do not.
#[must_use]
pub fn describe_options(options: &BuildOptions, reading: &Reading) -> String {
    let BuildOptions { layout, codec, max_error, lod_axes, reduce, .. } = options;
    let asked = format!("{layout:?} {codec:?} {max_error:?} {lod_axes:?} {reduce:?} {}", reading.describe());
    format!("{:016x}", xxh3_64(asked.as_bytes()))
}

/// A checksum of all that an input is read from: of the file and the others it is read from, or of every file of a folder with
/// its name. Of a file that stands alone it is the checksum of the file.
///
/// # Errors
/// If a file cannot be read.
pub fn checksum_of(input: &Path, others: &[PathBuf]) -> Result<String, BuildError> {
    let (file, _) = split_array(input);
    let mut hash = Xxh3Default::new();
    if file.is_dir() {
        inputs::for_each_file(&file, &mut |path| {
            hash.update(path.strip_prefix(&file).unwrap_or(path).as_os_str().as_encoded_bytes());
            let bytes = take_file(path, &mut hash, &Canceller::default())?;
            hash.update(&bytes.to_le_bytes());
            Ok(())
        })?;
    } else {
        for path in std::iter::once(&file).chain(others) {
            take_file(path, &mut hash, &Canceller::default())?;
        }
    }
    Ok(format!("{:016x}", hash.digest()))
}

/// The files that a source is read from beside the one that was asked for; none of a folder, all of which counts.
#[must_use]
pub fn others_of(input: &Path, source: &dyn VolumeSource) -> Vec<PathBuf> {
    let (file, _) = split_array(input);
    if file.is_dir() {
        return Vec::new();
    }
    let files = source.info().files.iter().map(|file| file.path().to_path_buf());
    files.filter(|path| *path != file).collect()
}

/// The checksum of a container, and its bytes.
///
/// # Errors
/// If it cannot be read.
pub fn checksum_of_container(path: &Path) -> Result<(String, u64), BuildError> {
    let mut hash = Xxh3Default::new();
    let bytes = take_file(path, &mut hash, &Canceller::default())?;
    Ok((format!("{:016x}", hash.digest()), bytes))
}

/// What there is of an input whose container goes to `output`.
///
/// # Errors
/// If something lies there that is not what the record says, so that it must not be taken for the container of this input as
/// it is now.
pub fn standing(input: &Path, output: &Path, record: Option<&Record>, options: &str) -> Result<Standing, BuildError> {
    if !output.exists() {
        return Ok(Standing::New);
    }
    let kept = |what: String| Err(BuildError::Outdated { path: output.into(), what });
    let taken = || Err(OutputError::Exists { path: output.into() }.into());
    let Some(record) = record else { return taken() };
    let Some(expected) = &record.container_xxh3_64 else {
        // Nothing says what its bytes were; that it is whole, and of which source, it says itself.
        let is_ours = || Container::open(output).is_ok_and(|c| c.manifest().source.xxh3_64 == record.manifest_xxh3_64);
        return if record.status == Status::Begun && is_ours() { Ok(Standing::Interrupted) } else { taken() };
    };
    let (found, _) = checksum_of_container(output)?;
    if *expected != found {
        return kept(format!("its checksum was {expected} when it was built, now it is {found}"));
    }
    if record.options != options {
        return kept("it was built with other options".into());
    }
    let others: Vec<PathBuf> = record.source_files.iter().map(PathBuf::from).collect();
    let now = checksum_of(input, &others)?;
    if record.source_xxh3_64 != now {
        let what =
            format!("{} has changed: its checksum was {}, now it is {now}", input.display(), record.source_xxh3_64);
        return kept(what);
    }
    Ok(Standing::Done)
}

/// # Errors
/// If containers would be written into an input: it would be another one then.
pub fn check_outside(input: &Path, folder: &Path) -> Result<(), BuildError> {
    let (file, _) = split_array(input);
    let inside = match (std::fs::canonicalize(&file), std::fs::canonicalize(folder)) {
        (Ok(file), Ok(folder)) => file.is_dir() && folder.starts_with(file),
        _ => false,
    };
    let message =
        || format!("{}: the output folder {} lies in it. Choose another with -o", input.display(), folder.display());
    if inside { Err(SourceError::Options(message()).into()) } else { Ok(()) }
}
