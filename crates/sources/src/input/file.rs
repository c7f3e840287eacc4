//! The files behind a volume: their state when they were opened, and the check that it is the same after reading.
//!
//! If somebody writes to a file during reading, the voxels belong to neither version, and no checksum of the file
//! describes them.

use std::collections::HashSet;
use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use crate::error::SourceError;

/// Minimum age of a file's last change, so that every later change shows in its times. No usual file system stores
/// times in coarser steps than two seconds.
const SETTLED_AFTER: Duration = Duration::from_secs(3);

/// State of a file at the time it was first examined.
#[derive(Debug, Clone)]
pub struct SourceFile {
    path: PathBuf,
    stamp: Stamp,
    looked_at: SystemTime,
}

/// Properties that change if the file changes, or if another file takes its name.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stamp {
    bytes: u64,
    modified: Option<SystemTime>,
    /// Device, inode, and the time of the last status change in nanoseconds, which no program can set back.
    identity: [i128; 3],
}

/// The time of examination is not compared.
impl PartialEq for SourceFile {
    fn eq(&self, other: &Self) -> bool {
        (&self.path, self.stamp) == (&other.path, other.stamp)
    }
}

impl SourceFile {
    /// Examines a file. Call this before opening it.
    ///
    /// # Errors
    /// If the file does not exist or is not a regular file: a FIFO or a device might never end and has no random
    /// access.
    pub fn of(path: &Path) -> Result<Self, SourceError> {
        supervol_format::byte_source::check_is_file(path).map_err(|e| SourceError::io(path, e))?;
        let metadata = std::fs::metadata(path).map_err(|e| SourceError::io(path, e))?;
        Ok(Self { path: path.into(), stamp: Stamp::of(&metadata), looked_at: SystemTime::now() })
    }

    /// The files without repetitions: a header's file may hold the voxels, too.
    pub(crate) fn distinct(files: Vec<Self>) -> Vec<Self> {
        let mut distinct: Vec<Self> = Vec::with_capacity(files.len());
        let mut known = HashSet::new();
        for file in files {
            if known.insert(file.path.clone()) {
                distinct.push(file);
            }
        }
        distinct
    }

    /// Whether the file was old enough when examined that every later change shows in its times
    /// ([`Self::check_unchanged`]).
    #[must_use]
    pub fn is_settled(&self) -> bool {
        self.stamp.changed_at().is_some_and(|changed| changed + SETTLED_AFTER <= self.looked_at)
    }

    /// Waits, a few seconds at most, until the file is settled, and examines it again. Does not wait if the file's
    /// times lie in the future or are unknown.
    ///
    /// # Errors
    /// If the file has changed.
    pub fn settled(&self) -> Result<Self, SourceError> {
        let left = self.stamp.changed_at().and_then(|at| (at + SETTLED_AFTER).duration_since(SystemTime::now()).ok());
        std::thread::sleep(left.filter(|left| *left <= SETTLED_AFTER).unwrap_or_default());
        self.check_unchanged()?;
        Ok(Self { looked_at: SystemTime::now(), ..self.clone() })
    }

    /// Path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Text that identifies this state of this file.
    #[must_use]
    pub fn describe(&self) -> String {
        format!("{:?} {:?}", self.path, self.stamp)
    }

    /// Size of the file in bytes when it was examined.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.stamp.bytes
    }

    /// Compares the file with its state when it was examined.
    ///
    /// # Errors
    /// If the file has changed.
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
    /// Time of the last change of any kind; `None` if the system does not tell it.
    fn changed_at(&self) -> Option<SystemTime> {
        let changed_ns = u64::try_from(self.identity[2]).ok().filter(|ns| *ns > 0)?;
        Some(self.modified?.max(SystemTime::UNIX_EPOCH + Duration::from_nanos(changed_ns)))
    }

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

#[cfg(all(test, unix))]
mod tests {
    use std::fs::File;

    use super::*;

    #[test]
    fn a_file_settles_and_shows_each_change_from_then_on() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("a");
        std::fs::write(&path, b"abc").expect("room");
        let fresh = SourceFile::of(&path).expect("it is there");
        assert!(!fresh.is_settled());
        let settled = fresh.settled().expect("nobody has changed it");
        assert!(settled.is_settled() && settled == fresh && settled.check_unchanged().is_ok());
        // A program that sets the modification time back has changed the file, too.
        let modified = std::fs::metadata(&path).and_then(|m| m.modified()).expect("times");
        std::fs::write(&path, b"abd").expect("room");
        File::options().write(true).open(&path).and_then(|f| f.set_modified(modified)).expect("it is ours");
        assert!(matches!(settled.check_unchanged(), Err(SourceError::Changed { .. })));
        assert!(settled.settled().is_err());
        // Times in the future give no information; nobody waits for them.
        let ahead = SystemTime::now() + Duration::from_secs(3600);
        File::options().write(true).open(&path).and_then(|f| f.set_modified(ahead)).expect("it is ours");
        assert!(!SourceFile::of(&path).and_then(|file| file.settled()).expect("it is there").is_settled());
    }
}
