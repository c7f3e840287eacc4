//! Batch builds: inputs, names of their containers, and results.
//!
//! 1. Inputs come from a list or from a folder that is searched ([`inputs`]).
//! 2. Each result is a line of a file beside the containers ([`results`]); the last line of an input counts.
//! 3. An input is done if its files, its container and the options are unchanged ([`Standing`]). All of them are read
//!    again; names and times are not trusted.
//! 4. Containers are named after their inputs ([`crate::naming`]).

pub mod inputs;
pub mod results;

use std::path::{Path, PathBuf};

use supervol_files::OutputError;
use supervol_format::Container;
use supervol_format::canceller::Canceller;
use supervol_sources::VolumeSource;
use supervol_sources::open::split_array;
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

use crate::error::BuildError;
use crate::kept::Reading;
use crate::pipeline::options::BuildOptions;
use crate::provenance::take_file;
use results::{Record, Status};

/// State of an input's container.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standing {
    /// Nothing lies at the container's path; it must be built.
    New,
    /// An interrupted batch has left a container built from this source, but no line that says so.
    Interrupted,
    /// Done: source, container and options are unchanged.
    Done,
}

/// Checksum of the options that influence voxels; memory, threads and overwriting do not.
#[must_use]
pub fn describe_options(options: &BuildOptions, reading: &Reading) -> String {
    let BuildOptions { layout, codec, max_error, lod_axes, reduce, .. } = options;
    let asked = format!("{layout:?} {codec:?} {max_error:?} {lod_axes:?} {reduce:?} {}", reading.describe());
    format!("{:016x}", xxh3_64(asked.as_bytes()))
}

/// Checksum of all files of an input: of the file and those it refers to, or of every file of a folder with its name.
/// For a single file it is the checksum of the file.
///
/// # Errors
/// If the folder cannot be listed, or a file cannot be read.
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

/// The files that a source reads besides the named one; empty for a folder, which counts as a whole.
#[must_use]
pub fn others_of(input: &Path, source: &dyn VolumeSource) -> Vec<PathBuf> {
    let (file, _) = split_array(input);
    if file.is_dir() {
        return Vec::new();
    }
    let files = source.info().files.iter().map(|file| file.path().to_path_buf());
    files.filter(|path| *path != file).collect()
}

/// Checksum of a container, and its size in bytes.
///
/// # Errors
/// If the container cannot be read.
pub fn checksum_of_container(path: &Path) -> Result<(String, u64), BuildError> {
    let mut hash = Xxh3Default::new();
    let bytes = take_file(path, &mut hash, &Canceller::default())?;
    Ok((format!("{:016x}", hash.digest()), bytes))
}

/// State of an input whose container has the path `output`.
///
/// # Errors
/// If a file exists there that does not match the record, and so is not the container of this input in its present
/// state.
pub fn standing(input: &Path, output: &Path, record: Option<&Record>, options: &str) -> Result<Standing, BuildError> {
    if !output.exists() {
        return Ok(Standing::New);
    }
    let kept = |what: String| Err(BuildError::Outdated { path: output.into(), what });
    let taken = || Err(OutputError::Exists { path: output.into() }.into());
    let Some(record) = record else { return taken() };
    let Some(expected) = &record.container_xxh3_64 else {
        // The record has no checksum of the container. The container itself tells whether it is whole, and from which
        // source.
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

/// Checks that containers are not written into an input, which would change it.
///
/// # Errors
/// If `folder` is inside `input`.
pub fn check_outside(input: &Path, folder: &Path) -> Result<(), BuildError> {
    let (file, _) = split_array(input);
    let inside = match (std::fs::canonicalize(&file), std::fs::canonicalize(folder)) {
        (Ok(file), Ok(folder)) => file.is_dir() && folder.starts_with(file),
        _ => false,
    };
    if inside { Err(BuildError::FolderInInput { input: input.into(), folder: folder.into() }) } else { Ok(()) }
}
