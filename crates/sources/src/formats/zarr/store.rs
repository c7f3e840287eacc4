//! The folder or archive of a Zarr or N5, with its metadata and chunks; all must lie inside it.
//!
//! A file in an archive has the path of the archive followed by its own, as if the archive were a folder.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use serde::de::DeserializeOwned;
use supervol_format::ByteSource;

use super::archive::{Archive, Member};
use crate::input::data_files::{FILES_LIMIT, Outside};
use crate::input::file::SourceFile;
use crate::input::spool::SpoolFolder;
use crate::input::text::shortened;
use crate::{Message, ReadOption, SourceError};

/// Longest metadata that is read, in bytes; a group may contain the metadata of all arrays below it.
const METADATA_LIMIT_BYTES: u64 = 16 << 20;
/// Largest depth of subfolders with chunks.
const DEPTH_LIMIT: usize = 24;

/// A folder or an archive, and the rule which files may be read.
#[derive(Debug, Clone)]
pub(super) struct Store {
    /// The folder or archive as given, for messages.
    pub(super) path: PathBuf,
    /// The same path with links resolved.
    whole: PathBuf,
    outside: Outside,
    archive: Option<Arc<Archive>>,
}

impl Store {
    pub(super) fn new(path: &Path, outside: Outside, spool: &SpoolFolder) -> Result<Self, SourceError> {
        let whole = std::fs::canonicalize(path).map_err(|e| SourceError::io(path, e))?;
        let archive = if whole.is_dir() { None } else { Some(Arc::new(Archive::open(path, spool)?)) };
        // An archive has no links to the outside.
        let outside = if archive.is_some() { Outside::Refused } else { outside };
        Ok(Self { path: path.into(), whole, outside, archive })
    }

    /// Whether the store is an archive.
    pub(super) fn is_archive(&self) -> bool {
        self.archive.is_some()
    }

    /// Name of a path in the archive.
    fn name_in_archive(&self, path: &Path) -> String {
        let parts = path.strip_prefix(&self.path).unwrap_or(path).components();
        let plain = parts.filter(|part| *part != Component::CurDir);
        plain.map(|part| part.as_os_str().to_string_lossy().into_owned()).collect::<Vec<_>>().join("/")
    }

    /// Name of a folder in the archive, as the prefix of its entries.
    fn folder_in_archive(&self, folder: &Path) -> String {
        let name = self.name_in_archive(folder);
        if name.is_empty() { name } else { name + "/" }
    }

    /// Whether there is a file at this path.
    pub(super) fn has(&self, path: &Path) -> bool {
        match &self.archive {
            None => path.is_file(),
            Some(archive) => archive.entry(&self.name_in_archive(path)).is_some(),
        }
    }

    /// The only folder of an archive, if it contains everything; else the store itself.
    pub(super) fn root(&self, descriptions: &[&str]) -> PathBuf {
        let is_described = |folder: &Path| descriptions.iter().any(|name| self.has(&folder.join(name)));
        match &self.folders(&self.path)[..] {
            [only] if self.is_archive() && !is_described(&self.path) && is_described(&self.path.join(only)) => {
                self.path.join(only)
            }
            _ => self.path.clone(),
        }
    }

    /// Names of the subfolders of a folder, in natural order.
    pub(super) fn folders(&self, folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = match &self.archive {
            None => {
                let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().take(FILES_LIMIT);
                let folders = entries.filter(|entry| entry.path().is_dir());
                folders.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect()
            }
            Some(archive) => {
                let below = self.folder_in_archive(folder);
                let names = archive.below(&below).filter_map(|name| name.split_once('/'));
                let names: BTreeSet<&str> = names.map(|(first, _)| first).collect();
                names.into_iter().take(FILES_LIMIT).map(str::to_owned).collect()
            }
        };
        names.sort_by(|a, b| crate::input::folder::natural(Path::new(a), Path::new(b)));
        names
    }

    /// Path of a name inside the store; it must not lead outside.
    pub(super) fn inside(&self, name: &str) -> Result<PathBuf, SourceError> {
        let is_plain = |part| matches!(part, Component::Normal(_) | Component::CurDir);
        if self.outside == Outside::Allowed || Path::new(name).components().all(is_plain) {
            return Ok(self.path.join(name));
        }
        Err(self.leads_out(name))
    }

    fn leads_out(&self, name: &str) -> SourceError {
        let what = format!("`{}` lies outside the folder", shortened(name));
        let advice = Message::from("give ").option(ReadOption::Outside);
        SourceError::unsupported(&self.path, what, advice.text(" if you know where the folder comes from"))
    }

    /// A file of the store, to be read in parts; `None` if it does not exist.
    pub(super) fn open(&self, path: &Path) -> Result<Option<Member<'_>>, SourceError> {
        if let Some(archive) = &self.archive {
            let entry = archive.entry(&self.name_in_archive(path));
            return entry.map(|entry| Member::of(archive, path, entry)).transpose();
        }
        let Some(file) = self.open_file(path)? else { return Ok(None) };
        let length = file.len().map_err(|e| SourceError::io(path, e))?;
        Ok(Some(Member::File(file, length)))
    }

    /// A file of the folder.
    fn open_file(&self, path: &Path) -> Result<Option<File>, SourceError> {
        let found = match std::fs::canonicalize(path) {
            Ok(found) => found,
            // If a file is found instead of a folder, nothing lies in it.
            Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => return Ok(None),
            Err(e) => return Err(SourceError::io(path, e)),
        };
        if self.outside == Outside::Refused && !found.starts_with(&self.whole) {
            return Err(self.leads_out(&path.strip_prefix(&self.path).unwrap_or(path).to_string_lossy()));
        }
        // Before opening: opening a FIFO would block.
        supervol_format::byte_source::check_is_file(&found).map_err(|e| SourceError::io(path, e))?;
        File::open(&found).map(Some).map_err(|e| SourceError::io(path, e))
    }

    /// Metadata of this kind; `None` if the file does not exist.
    pub(super) fn metadata<T: DeserializeOwned>(&self, path: &Path) -> Result<Option<T>, SourceError> {
        let Some(text) = self.read(path, METADATA_LIMIT_BYTES)? else { return Ok(None) };
        let found = serde_json::from_slice(&text).or_else(|e| {
            // Python writes NaN and infinities as words, which are no JSON.
            serde_json::from_slice(&without_words(&text)).map_err(|_| e)
        });
        found.map(Some).map_err(|e| SourceError::invalid(path, "metadata", "what Zarr or N5 has there", e.to_string()))
    }

    /// A whole file of at most `limit` bytes; `None` if it does not exist.
    pub(super) fn read(&self, path: &Path, limit: u64) -> Result<Option<Vec<u8>>, SourceError> {
        if let Some(archive) = &self.archive {
            let entry = archive.entry(&self.name_in_archive(path));
            return entry.map(|entry| archive.read(path, entry, limit)).transpose();
        }
        let Some(file) = self.open(path)? else { return Ok(None) };
        let length = file.length();
        if length > limit {
            let expected = format!("at most {limit} bytes, which is more than it needs");
            return Err(SourceError::invalid(path, "chunk or metadata", expected, format!("{length} bytes")));
        }
        let mut data = vec![0; usize::try_from(length).unwrap_or(usize::MAX)];
        file.read_at(path, 0, &mut data)?;
        Ok(Some(data))
    }

    /// All files below a folder, and whether the list is complete.
    pub(super) fn files(&self, folder: &Path) -> Result<(Vec<SourceFile>, bool), SourceError> {
        if self.is_archive() {
            return Ok((vec![SourceFile::of(&self.path)?], true));
        }
        let mut files = Vec::new();
        let is_whole = list(folder, DEPTH_LIMIT, &mut files)?;
        files.sort();
        Ok((files.iter().map(|path| SourceFile::of(path)).collect::<Result<_, _>>()?, is_whole))
    }

    /// Names of the subfolders that hold one of these files, in natural order.
    pub(super) fn nodes(&self, folder: &Path, metadata: &[&str]) -> Vec<String> {
        let is_node = |name: &String| metadata.iter().any(|file| self.has(&folder.join(name).join(file)));
        self.folders(folder).into_iter().filter(is_node).collect()
    }
}

/// Python's JSON with its words for NaN and infinities as strings.
fn without_words(text: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(text.len());
    let (mut rest, mut is_string) = (text, false);
    while let Some((&byte, behind)) = rest.split_first() {
        let word = [&b"NaN"[..], b"-Infinity", b"Infinity"].into_iter().find(|word| rest.starts_with(word));
        if let Some(word) = word.filter(|_| !is_string) {
            out.extend([b"\"", word, b"\""].concat());
            rest = &rest[word.len()..];
            continue;
        }
        out.push(byte);
        rest = behind;
        if is_string && byte == b'\\' {
            out.extend(rest.split_off_first());
        } else if byte == b'"' {
            is_string = !is_string;
        }
    }
    out
}

/// Adds the files of a folder; false if there are too many.
fn list(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) -> Result<bool, SourceError> {
    let io = |e| SourceError::io(folder, e);
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let entry = entry.map_err(io)?;
        if files.len() >= FILES_LIMIT {
            return Ok(false);
        }
        let path = entry.path();
        // Links to folders could make cycles, so they are not listed; chunks behind them are still read.
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
