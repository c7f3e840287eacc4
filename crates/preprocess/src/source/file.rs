//! The files behind a volume: what they were when they were opened, and whether they still are when all is read.
//!
//! Voxels of a file that somebody writes to meanwhile are of neither version, and no checksum of the file stands for them.

use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::SourceError;

/// A file that voxels or headers are read from, as it was when it was looked at first.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceFile {
    path: PathBuf,
    stamp: Stamp,
}

/// What changes when a file does, or when another takes its name.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stamp {
    bytes: u64,
    modified: Option<SystemTime>,
    /// Device, inode, and the time of the last change, which no program can set back.
    identity: [i128; 3],
}

impl SourceFile {
    /// Looks at a file. To be called before it is opened.
    ///
    /// # Errors
    /// If it is not there, or is no file: a FIFO or a device might never end, and cannot be read at random.
    pub fn of(path: &Path) -> Result<Self, SourceError> {
        supervol_format::byte_source::check_is_file(path).map_err(|e| SourceError::io(path, e))?;
        let metadata = std::fs::metadata(path).map_err(|e| SourceError::io(path, e))?;
        Ok(Self { path: path.into(), stamp: Stamp::of(&metadata) })
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes that it had when it was looked at.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.stamp.bytes
    }

    /// # Errors
    /// If the file is not what it was.
    pub fn check_unchanged(&self) -> Result<(), SourceError> {
        let metadata = std::fs::metadata(&self.path).map_err(|e| SourceError::io(&self.path, e))?;
        let (was, is) = (self.stamp, Stamp::of(&metadata));
        if was == is {
            return Ok(());
        }
        let what = match (was.bytes == is.bytes, was.identity[..2] == is.identity[..2]) {
            (false, _) => format!("it had {} bytes, now it has {}", was.bytes, is.bytes),
            (true, false) => "another file has taken its name".into(),
            (true, true) => "it was written to".into(),
        };
        Err(SourceError::Changed { path: self.path.clone(), what })
    }
}

impl Stamp {
    fn of(metadata: &Metadata) -> Self {
        Self { bytes: metadata.len(), modified: metadata.modified().ok(), identity: identity(metadata) }
    }
}

#[cfg(unix)]
fn identity(metadata: &Metadata) -> [i128; 3] {
    use std::os::unix::fs::MetadataExt;
    let changed_ns = i128::from(metadata.ctime()) * 1_000_000_000 + i128::from(metadata.ctime_nsec());
    [metadata.dev().into(), metadata.ino().into(), changed_ns]
}

#[cfg(not(unix))]
fn identity(_: &Metadata) -> [i128; 3] {
    [0; 3]
}
