//! Unfinished files and folders ("partials"): random names, created exclusively, removed however their process ends.
//!
//! 1. A partial is created under a random name in the folder of the output (`O_EXCL`, so never through a symbolic
//!    link). It is entered in the list of this process, and locked (`flock`) until it is closed.
//! 2. It leaves the list when it is renamed or dropped. A program that is ended by a signal calls [`remove_all`], which
//!    removes all partials in the list; afterwards none can be begun or renamed.
//! 3. The kernel releases the lock of a killed process. A partial that can be locked therefore has no writer: [`sweep`]
//!    removes it, [`list`] lists it. The partials of a build stay: the same build continues them
//!    (`supervol_preprocess::journal`), and any other build to that folder removes them ([`sweep_builds`]). On file
//!    systems without locks all partials stay: a leftover is better than a loss.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs::{File, Permissions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tempfile::{NamedTempFile, TempDir, TempPath};

/// Beginning and end of the names of partials.
const PREFIX: &str = ".supervol-";
const SUFFIX: &str = ".partial";
/// Beginning of the names of a build's partials. The next build may continue them (`supervol_preprocess::journal`), so
/// only builds remove them.
const BUILD_PREFIX: &str = ".supervol-build-";

/// Number of attempts to remove a folder to which other threads of this process still write.
const REMOVAL_ATTEMPTS: usize = 8;

/// Partials of this process.
static UNFINISHED: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// The locked list of partials. While it is held, this process cannot begin or rename any.
pub type Unfinished = MutexGuard<'static, BTreeSet<PathBuf>>;

fn unfinished() -> Unfinished {
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// An entry in the list of partials; dropping it removes it from the list.
#[derive(Debug)]
struct Entry(PathBuf);

impl Drop for Entry {
    fn drop(&mut self) {
        unfinished().remove(&self.0);
    }
}

/// An unfinished file. Dropping it removes it.
#[derive(Debug)]
pub struct UnfinishedFile {
    // The fields are dropped in this order: the file is removed before its entry.
    file: NamedTempFile,
    _entry: Entry,
}

/// An unfinished folder. Dropping it removes it with all its contents.
#[derive(Debug)]
pub struct UnfinishedFolder {
    folder: TempDir,
    _lock: Option<File>,
    _entry: Entry,
}

impl UnfinishedFile {
    /// Creates a file in this folder, with these permissions reduced by the process's mask. Also removes partials of
    /// dead processes.
    ///
    /// # Errors
    /// If the folder is not writable.
    pub fn create_in(folder: &Path, permissions: Permissions) -> io::Result<Self> {
        sweep(folder);
        Self::create(PREFIX, folder, permissions)
    }

    /// Creates a file that a later build may continue. Removes nothing, see [`sweep_builds`].
    ///
    /// # Errors
    /// If the folder is not writable.
    pub fn create_for_build(folder: &Path, permissions: Permissions) -> io::Result<Self> {
        Self::create(BUILD_PREFIX, folder, permissions)
    }

    fn create(prefix: &str, folder: &Path, permissions: Permissions) -> io::Result<Self> {
        loop {
            let (file, entry) = {
                let mut list = unfinished();
                let mut builder = tempfile::Builder::new();
                let file = builder.prefix(prefix).suffix(SUFFIX).permissions(permissions.clone()).tempfile_in(folder);
                let file = file.map_err(without_path)?;
                list.insert(file.path().into());
                let entry = Entry(file.path().into());
                (file, entry)
            };
            if is_held(file.as_file()) {
                return Ok(Self { file, _entry: entry });
            }
        }
    }

    /// Takes over the partial of a killed process; `None` if another process holds it, or it belongs to another user.
    ///
    /// # Errors
    /// If the file cannot be opened.
    pub fn adopt(path: &Path) -> io::Result<Option<Self>> {
        let mut list = unfinished();
        // Not through a symbolic link.
        if !std::fs::symlink_metadata(path)?.is_file() {
            return Ok(None);
        }
        let file = File::options().read(true).write(true).open(path)?;
        if file.try_lock().is_err() || !is_of_this_user(&file)? {
            return Ok(None);
        }
        list.insert(path.into());
        let entry = Entry(path.into());
        let file = NamedTempFile::from_parts(file, TempPath::try_from_path(path)?);
        Ok(Some(Self { file, _entry: entry }))
    }

    /// Name of the file in its folder.
    #[expect(clippy::missing_panics_doc, reason = "every file has a name")]
    #[must_use]
    pub fn file_name(&self) -> &OsStr {
        self.file.path().file_name().expect("a file has a name")
    }

    /// Leaves the file behind, as a killed process does; returns its path.
    ///
    /// # Errors
    /// If the system does not let the file be kept; then it is removed.
    pub fn abandon(self) -> io::Result<PathBuf> {
        self.file.keep().map(|(_, path)| path).map_err(|e| e.error)
    }

    /// The open file.
    #[must_use]
    pub fn as_file(&self) -> &File {
        self.file.as_file()
    }

    /// Renames the file to `path`; replaces an existing file.
    ///
    /// # Errors
    /// If the file cannot be renamed.
    pub fn replace(self, path: &Path) -> io::Result<()> {
        let _list = unfinished();
        self.file.persist(path).map(drop).map_err(|e| e.error)
    }

    /// Renames the file to `path`, which must not exist.
    ///
    /// # Errors
    /// If `path` exists, or the file cannot be renamed.
    pub fn keep(self, path: &Path) -> io::Result<()> {
        let _list = unfinished();
        self.file.persist_noclobber(path).map(drop).map_err(|e| e.error)
    }
}

impl UnfinishedFolder {
    /// Creates a folder in this one. Also removes partials of dead processes.
    ///
    /// # Errors
    /// If the folder is not writable.
    pub fn create_in(folder: &Path) -> io::Result<Self> {
        sweep(folder);
        loop {
            let (made, entry) = {
                let mut list = unfinished();
                let made =
                    tempfile::Builder::new().prefix(PREFIX).suffix(SUFFIX).tempdir_in(folder).map_err(without_path)?;
                list.insert(made.path().into());
                let entry = Entry(made.path().into());
                (made, entry)
            };
            // Not every system can lock folders; without a lock only this process removes the folder.
            let lock = File::open(made.path()).ok().filter(|handle| handle.lock().is_ok());
            if made.path().is_dir() {
                return Ok(Self { folder: made, _lock: lock, _entry: entry });
            }
        }
    }

    /// Path of the folder.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Renames the folder to `path`, which must not exist.
    ///
    /// # Errors
    /// The system's error; then the folder is removed.
    pub fn publish(self, path: &Path) -> io::Result<()> {
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // Temporary folders are private to their owner; this one gets the mode of its parent.
            let beside = std::fs::metadata(super::folder_of(path))?.permissions().mode();
            std::fs::set_permissions(self.folder.path(), Permissions::from_mode(beside & 0o777))?;
        }
        std::fs::rename(self.folder.path(), path)?;
        // The old path no longer exists, so dropping removes nothing.
        Ok(())
    }
}

/// Locks a new file. False if another process took it for a leftover and removed it before it was locked.
fn is_held(file: &File) -> bool {
    // Without locks, no process takes files for leftovers either.
    let locked = file.lock().is_ok();
    #[cfg(unix)]
    if locked && let Ok(metadata) = file.metadata() {
        return std::os::unix::fs::MetadataExt::nlink(&metadata) > 0;
    }
    let _ = locked;
    true
}

/// Removes all partials of this process, for a program that is about to end. While the result lives, no partial is
/// begun or renamed.
#[must_use = "without the lock, other threads begin new partials"]
pub fn remove_all() -> Unfinished {
    let list = unfinished();
    for path in &*list {
        remove(path);
    }
    list
}

/// Blocks for ever if [`remove_all`] is ending the program, so that it ends in no other way.
pub fn wait_for_end() {
    drop(unfinished());
}

fn remove(path: &Path) {
    for _ in 0..REMOVAL_ATTEMPTS {
        let removed = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
        match removed {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {}
            _ => return,
        }
    }
}

/// State of a partial's writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Writer {
    /// A running process holds the partial.
    Alive,
    /// The process that wrote it has ended.
    Dead,
    /// Unknown: the partial cannot be opened, or the file system has no locks.
    Unknown,
}

/// A partial found in a folder.
#[derive(Debug)]
pub struct Leftover {
    /// Path of the partial.
    pub path: PathBuf,
    /// Size in bytes; for a folder, that of its directory.
    pub bytes: u64,
    /// State of its writer.
    pub writer: Writer,
    /// The lock, if no other process holds it.
    _lock: Option<File>,
}

/// The partials in a folder, sorted by name.
///
/// # Errors
/// If the folder cannot be read.
pub fn list(folder: &Path) -> io::Result<Vec<Leftover>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name();
        let name = name.to_string_lossy();
        // Metadata of the entry itself, not of a link's target: partials are never links.
        let Ok(metadata) = entry.metadata() else { continue };
        if !name.starts_with(PREFIX) || !name.ends_with(SUFFIX) || !(metadata.is_file() || metadata.is_dir()) {
            continue;
        }
        let (writer, lock) = match File::open(entry.path()) {
            Ok(file) => match file.try_lock() {
                Ok(()) => (Writer::Dead, Some(file)),
                Err(TryLockError::WouldBlock) => (Writer::Alive, None),
                Err(TryLockError::Error(_)) => (Writer::Unknown, None),
            },
            Err(_) => (Writer::Unknown, None),
        };
        found.push(Leftover { path: entry.path(), bytes: metadata.len(), writer, _lock: lock });
    }
    found.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(found)
}

/// The partials of builds in a folder.
///
/// # Errors
/// If the folder cannot be read.
pub fn list_builds(folder: &Path) -> io::Result<Vec<Leftover>> {
    Ok(list(folder)?.into_iter().filter(is_of_build).collect())
}

fn is_of_build(leftover: &Leftover) -> bool {
    leftover.path.file_name().is_some_and(|name| is_name_of_build(&name.to_string_lossy()))
}

/// Whether a build may have given a partial this name. Paths are refused.
#[must_use]
pub fn is_name_of_build(name: &str) -> bool {
    name.starts_with(BUILD_PREFIX) && name.ends_with(SUFFIX) && !name.contains(std::path::is_separator)
}

/// Removes the partials of dead processes in a folder, except those of builds. Errors are ignored.
pub fn sweep(folder: &Path) {
    let left = list(folder).unwrap_or_default();
    left.iter().filter(|leftover| !is_of_build(leftover)).for_each(remove_dead);
}

/// Removes the partials of dead builds in a folder.
pub fn sweep_builds(folder: &Path) {
    list_builds(folder).unwrap_or_default().iter().for_each(remove_dead);
}

fn remove_dead(leftover: &Leftover) {
    if leftover.writer == Writer::Dead {
        // Removed while locked: a process that has just created the file waits for the lock and then creates another.
        remove(&leftover.path);
    }
}

/// Whether a file belongs to the user of this process, that is, to the owner of files that it creates.
#[cfg(unix)]
fn is_of_this_user(file: &File) -> io::Result<bool> {
    use std::os::unix::fs::MetadataExt;
    let (own, found) = (tempfile::tempfile()?.metadata()?.uid(), file.metadata()?);
    Ok(found.uid() == own && found.nlink() == 1)
}

#[cfg(not(unix))]
fn is_of_this_user(_: &File) -> io::Result<bool> {
    Ok(true)
}

/// Removes the temporary path from an error: the user does not know that name.
fn without_path(error: io::Error) -> io::Error {
    match error.to_string().split_once(" at path ") {
        Some((reason, _)) => io::Error::new(error.kind(), reason),
        None => error,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).unwrap();
        entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect()
    }

    #[test]
    #[cfg(unix)]
    fn leftovers_without_a_writer_go_and_all_others_stay() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let mode = Permissions::from_mode(0o600);
        let mine = UnfinishedFile::create_in(folder.path(), mode.clone()).unwrap();
        let my_folder = UnfinishedFolder::create_in(folder.path()).unwrap();
        std::fs::write(my_folder.path().join("a"), b"a").unwrap();
        // Leftovers of a killed process: nobody holds a lock.
        std::fs::write(folder.path().join(".supervol-dead00.partial"), b"half").unwrap();
        std::fs::create_dir(folder.path().join(".supervol-dead01.partial")).unwrap();
        std::fs::write(folder.path().join(".supervol-dead01.partial/carp.svol"), b"half").unwrap();
        std::fs::write(folder.path().join(".supervol.svol"), b"a user's").unwrap();
        let outside = folder.path().join("target");
        std::fs::write(&outside, b"a user's").unwrap();
        std::os::unix::fs::symlink(&outside, folder.path().join(".supervol-link00.partial")).unwrap();

        let writers: Vec<_> = list(folder.path()).unwrap().iter().map(|l| l.writer).collect();
        assert_eq!(writers.iter().filter(|w| **w == Writer::Dead).count(), 2, "{writers:?}");
        assert_eq!(writers.iter().filter(|w| **w == Writer::Alive).count(), 2, "{writers:?}");

        let other = UnfinishedFile::create_in(folder.path(), mode).unwrap();
        let left = names(folder.path());
        assert_eq!(left.len(), 6, "{left:?}");
        assert!(!left.iter().any(|name| name.contains("dead")), "{left:?}");
        drop((mine, my_folder));
        other.keep(&folder.path().join("whole")).unwrap();
        let mut left = names(folder.path());
        left.sort();
        assert_eq!(left, [".supervol-link00.partial", ".supervol.svol", "target", "whole"]);
    }
}
