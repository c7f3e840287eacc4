//! Identity of a source for the manifest: name, format, size and checksum of its files, and checks that they have not
//! changed.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use supervol_format::canceller::Canceller;
use supervol_format::container::manifest::Source;
use supervol_sources::input::file::SourceFile;
use supervol_sources::input::selection::Selection;
use supervol_sources::open::split_array;
use supervol_sources::stop::check;
use supervol_sources::{SourceError, SourceInfo, VolumeSource};

use crate::error::BuildError;

/// Least size in bytes of a file whose checksum is computed while its voxels are read. A smaller file is read twice, at
/// little cost.
const TAKEN_ALONG_BYTES: u64 = 256 << 20;

/// Checks that the files of a source have not changed since it was opened and `origin` was computed.
pub(crate) fn check_unchanged(
    source: &dyn VolumeSource,
    origin: &Source,
    canceller: &Canceller,
) -> Result<(), BuildError> {
    let files = &source.info().files;
    files.iter().try_for_each(SourceFile::check_unchanged)?;
    // Times may be too coarse to distinguish two versions.
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

/// Name, size and checksum of a source: of its one file, or of all files of a folder including their names. The
/// selection follows the name, because two volumes of one file make two builds. A single large file gets no checksum
/// here; the build computes it while it reads the voxels.
///
/// # Errors
/// If a file cannot be read.
pub fn identify_source(path: &Path, selection: &Selection, source: &dyn VolumeSource) -> Result<Source, BuildError> {
    identify_source_unless(path, selection, source, &Canceller::default())
}

/// The same, with a canceller.
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

/// Name, size and checksum of a source file, which is read from start to end.
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
    // Paths such as `.` have no name of their own.
    let found = name_of(path).or_else(|| name_of(&std::fs::canonicalize(path).ok()?));
    let name = found.unwrap_or_default();
    Source { name, format: format.into(), bytes, xxh3_64: String::new() }
}

/// Checksum of a source's only file, computed piece by piece while its voxels are read. The bytes are then still in the
/// system's page cache.
pub(crate) struct ChecksumAlong {
    file: File,
    of: SourceFile,
    hash: xxhash_rust::xxh3::Xxh3Default,
    taken: u64,
}

impl ChecksumAlong {
    /// Begins the checksum of a source. `None` if `origin` has one already or the source is not a single file. If the
    /// file's time cannot reveal a change during the build, the checksum is computed at once.
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
        // After a sync, the first write through a memory map changes the file's time. Errors do not matter: a disk that
        // cannot be written has no writers.
        let _ = file.sync_data();
        let of = only.settled()?;
        if !of.is_settled() {
            origin.xxh3_64 = identify_unless(of.path(), info.format, canceller)?.xxh3_64;
            return Ok(None);
        }
        Ok(Some(Self { file, of, hash: xxhash_rust::xxh3::Xxh3Default::new(), taken: 0 }))
    }

    /// Advances by the file's share of one tile, if `tiles_left` tiles are still to be read.
    pub(crate) fn advance(&mut self, tiles_left: usize, canceller: &Canceller) -> Result<(), BuildError> {
        let left = self.of.bytes().saturating_sub(self.taken);
        let (taken, part) = (self.taken, left / tiles_left.max(1) as u64);
        self.taken += take_bytes(&mut (&self.file).take(part), self.of.path(), &mut self.hash, canceller)?;
        if self.taken < taken + part {
            self.of.check_unchanged()?;
        }
        Ok(())
    }

    /// Checksum of the whole file.
    ///
    /// # Errors
    /// If the file cannot be read, or has changed since the start.
    pub(crate) fn finish(mut self, canceller: &Canceller) -> Result<String, BuildError> {
        self.advance(1, canceller)?;
        self.of.check_unchanged()?;
        Ok(format!("{:016x}", self.hash.digest()))
    }
}

/// Adds the bytes of a file to a checksum, and returns their number.
pub(crate) fn take_file(
    path: &Path,
    hash: &mut xxhash_rust::xxh3::Xxh3Default,
    canceller: &Canceller,
) -> Result<u64, BuildError> {
    let mut file = File::open(path).map_err(|e| SourceError::io(path, e))?;
    take_bytes(&mut file, path, hash, canceller)
}

/// Adds the remaining bytes of a reader to a checksum, and returns their number. `path` is for errors.
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
