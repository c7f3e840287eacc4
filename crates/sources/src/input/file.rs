//! The files behind a volume: what they were when they were opened, and whether they still are when all is read.
//!
//! Voxels of a file that somebody writes to meanwhile are of neither version, and no checksum of the file stands for them.

use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use crate::error::SourceError;

/// How long ago a file must have been changed for each later change to show in its times: no usual file system keeps them in coarser
/// steps than two seconds.
const SETTLED_AFTER: Duration = Duration::from_secs(3);

/// A file that voxels or headers are read from, as it was when it was looked at first.
#[derive(Debug, Clone)]
pub struct SourceFile {
    path: PathBuf,
    stamp: Stamp,
    looked_at: SystemTime,
}

/// What changes when a file does, or when another takes its name.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stamp {
    bytes: u64,
    modified: Option<SystemTime>,
    /// Device, inode, and the time of the last change, which no program can set back.
    identity: [i128; 3],
}

/// When it was looked at makes no difference.
impl PartialEq for SourceFile {
    fn eq(&self, other: &Self) -> bool {
        (&self.path, self.stamp) == (&other.path, other.stamp)
    }
}

impl SourceFile {
    /// Looks at a file. To be called before it is opened.
    ///
    /// # Errors
    /// If it is not there, or is no file: a FIFO or a device might never end, and cannot be read at random.
    pub fn of(path: &Path) -> Result<Self, SourceError> {
        supervol_format::byte_source::check_is_file(path).map_err(|e| SourceError::io(path, e))?;
        let metadata = std::fs::metadata(path).map_err(|e| SourceError::io(path, e))?;
        Ok(Self { path: path.into(), stamp: Stamp::of(&metadata), looked_at: SystemTime::now() })
    }

    /// Whether nobody can have changed it since it was looked at without its times saying so ([`Self::check_unchanged`]).
    #[must_use]
    pub fn is_settled(&self) -> bool {
        self.stamp.changed_at().is_some_and(|changed| changed + SETTLED_AFTER <= self.looked_at)
    }

    /// The same file, looked at when it has settled, some seconds from now at most; itself where its times lie in the future, or say
    /// nothing.
    ///
    /// # Errors
    /// If it is not what it was.
    pub fn settled(&self) -> Result<Self, SourceError> {
        let left = self.stamp.changed_at().and_then(|at| (at + SETTLED_AFTER).duration_since(SystemTime::now()).ok());
        std::thread::sleep(left.filter(|left| *left <= SETTLED_AFTER).unwrap_or_default());
        self.check_unchanged()?;
        Ok(Self { looked_at: SystemTime::now(), ..self.clone() })
    }

    /// Where it is.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What tells it from all other files, and from itself after a change.
    #[must_use]
    pub fn describe(&self) -> String {
        format!("{:?} {:?}", self.path, self.stamp)
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
    /// The last change of any kind; none where the system does not tell it.
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
        // Whoever sets the time back to what it was has changed it, too.
        let modified = std::fs::metadata(&path).and_then(|m| m.modified()).expect("times");
        std::fs::write(&path, b"abd").expect("room");
        File::options().write(true).open(&path).and_then(|f| f.set_modified(modified)).expect("it is ours");
        assert!(matches!(settled.check_unchanged(), Err(SourceError::Changed { .. })));
        assert!(settled.settled().is_err());
        // Times that have not come yet tell nothing, and nobody waits for them.
        let ahead = SystemTime::now() + Duration::from_secs(3600);
        File::options().write(true).open(&path).and_then(|f| f.set_modified(ahead)).expect("it is ours");
        assert!(!SourceFile::of(&path).and_then(|file| file.settled()).expect("it is there").is_settled());
    }
}
