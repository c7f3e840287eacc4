//! The folder of a Zarr or N5: its metadata and its chunks, none of which lies outside it.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Component, Path, PathBuf};

use serde::de::DeserializeOwned;
use supervol_format::ByteSource;

use super::super::SourceError;
use super::super::data_files::{FILES_LIMIT, Outside};
use super::super::file::SourceFile;
use super::super::text::shortened;

/// Longest metadata that are read: those of a group may hold those of all arrays below it.
const METADATA_LIMIT_BYTES: u64 = 16 << 20;
/// Folders inside folders that chunks lie in.
const DEPTH_LIMIT: usize = 24;

/// A folder and what may be read of it.
#[derive(Debug, Clone)]
pub(super) struct Store {
    /// The folder as it was given, for messages.
    pub(super) path: PathBuf,
    /// The same, links followed.
    whole: PathBuf,
    outside: Outside,
}

impl Store {
    pub(super) fn new(path: &Path, outside: Outside) -> Result<Self, SourceError> {
        let whole = std::fs::canonicalize(path).map_err(|e| SourceError::io(path, e))?;
        Ok(Self { path: path.into(), whole, outside })
    }

    /// The path of something in it, which must not lead out of it.
    pub(super) fn inside(&self, name: &str) -> Result<PathBuf, SourceError> {
        let is_plain = |part| matches!(part, Component::Normal(_) | Component::CurDir);
        if self.outside == Outside::Allowed || Path::new(name).components().all(is_plain) {
            return Ok(self.path.join(name));
        }
        Err(self.leads_out(name))
    }

    fn leads_out(&self, name: &str) -> SourceError {
        let what = format!("`{}` lies outside the folder", shortened(name));
        SourceError::unsupported(&self.path, what, "give --allow-outside if you know where the folder comes from")
    }

    /// A file of it; `None` where there is none.
    pub(super) fn open(&self, path: &Path) -> Result<Option<File>, SourceError> {
        let found = match std::fs::canonicalize(path) {
            Ok(found) => found,
            // A file where a folder is expected: nothing lies in it.
            Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => return Ok(None),
            Err(e) => return Err(SourceError::io(path, e)),
        };
        if self.outside == Outside::Refused && !found.starts_with(&self.whole) {
            return Err(self.leads_out(&path.strip_prefix(&self.path).unwrap_or(path).to_string_lossy()));
        }
        // Before it is opened: a FIFO would keep us waiting.
        supervol_format::byte_source::check_is_file(&found).map_err(|e| SourceError::io(path, e))?;
        File::open(&found).map(Some).map_err(|e| SourceError::io(path, e))
    }

    /// Metadata of this kind; `None` where there are none.
    pub(super) fn metadata<T: DeserializeOwned>(&self, path: &Path) -> Result<Option<T>, SourceError> {
        let Some(file) = self.open(path)? else { return Ok(None) };
        let mut text = Vec::new();
        let read = file.take(METADATA_LIMIT_BYTES + 1).read_to_end(&mut text);
        read.map_err(|e| SourceError::io(path, e))?;
        if text.len() as u64 > METADATA_LIMIT_BYTES {
            let expected = format!("at most {METADATA_LIMIT_BYTES} bytes");
            return Err(SourceError::invalid(path, "metadata", expected, "more"));
        }
        let found = serde_json::from_slice(&text);
        found.map(Some).map_err(|e| SourceError::invalid(path, "metadata", "what Zarr or N5 has there", e.to_string()))
    }

    /// A whole file of at most so many bytes.
    pub(super) fn read(&self, path: &Path, limit: u64) -> Result<Option<Vec<u8>>, SourceError> {
        let Some(file) = self.open(path)? else { return Ok(None) };
        let length = file.len().map_err(|e| SourceError::io(path, e))?;
        if length > limit {
            let expected = format!("at most {limit} bytes, which is more than its voxels need");
            return Err(SourceError::invalid(path, "chunk", expected, format!("{length} bytes")));
        }
        let mut data = vec![0; usize::try_from(length).unwrap_or(usize::MAX)];
        file.read_exact_at(0, &mut data).map_err(|e| SourceError::io(path, e))?;
        Ok(Some(data))
    }

    /// The files below a folder, those of arrays below it left out, and whether these are all of them.
    pub(super) fn files(&self, folder: &Path) -> Result<(Vec<SourceFile>, bool), SourceError> {
        let mut files = Vec::new();
        let is_whole = list(folder, DEPTH_LIMIT, &mut files)?;
        files.sort();
        Ok((files.iter().map(|path| SourceFile::of(path)).collect::<Result<_, _>>()?, is_whole))
    }

    /// Names of folders in a folder that hold one of these files, in natural order; as many as a message can list.
    pub(super) fn nodes(&self, folder: &Path, metadata: &[&str]) -> Vec<String> {
        let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
        let is_node = |path: &Path| metadata.iter().any(|name| path.join(name).is_file());
        let nodes = entries.flatten().take(FILES_LIMIT).filter(|entry| is_node(&entry.path()));
        let mut names: Vec<String> = nodes.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
        names.sort_by(|a, b| super::super::folder::natural(Path::new(a), Path::new(b)));
        names
    }
}

/// Adds the files of a folder; false where there are too many of them.
fn list(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) -> Result<bool, SourceError> {
    let io = |e| SourceError::io(folder, e);
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let entry = entry.map_err(io)?;
        if files.len() >= FILES_LIMIT {
            return Ok(false);
        }
        let path = entry.path();
        // Links to folders could lead round in circles; chunks are reached through them all the same.
        if entry.file_type().map_err(io)?.is_dir() {
            let is_whole = depth > 0 && list(&path, depth - 1, files)?;
            if !is_whole {
                return Ok(false);
            }
        } else if path.is_file() {
            files.push(path);
        }
    }
    Ok(true)
}
