//! Output files: one rule for every command that writes a file, and files that appear only when they are whole.
//!
//! 1. An output is never an input or another output of the same command, not even with [`Existing::Replace`]. Files
//!    are compared by device and inode, with links followed ([`check_distinct`]).
//! 2. An existing file is not replaced ([`Existing::Keep`]), except by a file of its kind: a picture by a picture
//!    ([`Existing::ReplacePicture`]), and so on for statistics, records and fidelity of pictures. The contents decide which a file is ([`kind`]).
//!    [`Existing::Replace`] replaces any file.
//! 3. A symbolic link is followed: the file it names is replaced, the link stays. A link to a missing file is refused.
//! 4. Only files are replaced. FIFOs, character devices and the program's own standard output are written to directly.
//!    A container cannot be, because it is read back while it is built. Folders, disks and sockets are refused.
//! 5. A file is written under a temporary name in the same folder ([`unfinished`]), synced, and renamed. It gets the
//!    mode and owner of the file it replaces; a new file gets the process's default mode.

mod error;
pub mod kind;
pub mod unfinished;

use std::fs::{File, Metadata, Permissions};
use std::io;
use std::path::{Path, PathBuf};

pub use error::{OutputError, advice, is_bound_to_place, is_full_disk};
use kind::FileKind;
use unfinished::UnfinishedFile;

/// Reaction to an existing file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Existing {
    /// Refuse.
    Keep,
    /// Replace a picture, refuse all other files.
    ReplacePicture,
    /// Replace statistics of a picture, refuse all other files.
    ReplaceStatistics,
    /// Replace the record of a picture, refuse all other files.
    ReplaceRecord,
    /// Replace the fidelity of a picture, refuse all other files.
    ReplaceFidelity,
    /// Replace any file once the new one is whole.
    Replace,
}

/// A file being written. If it is dropped without [`OutputFile::publish`], nothing remains.
#[derive(Debug)]
pub struct OutputFile(Target);

#[derive(Debug)]
enum Target {
    /// Renamed to `path` (with links resolved) when it is whole.
    File { unfinished: UnfinishedFile, path: PathBuf, existing: Existing },
    /// A FIFO or device, written to directly.
    Stream { stream: File, path: PathBuf },
}

/// Target of a path.
enum Place {
    /// No file yet.
    New(PathBuf),
    /// An existing file, with links resolved.
    Taken(PathBuf, Metadata),
    /// A FIFO or character device.
    Stream,
}

/// The folder that contains a path.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Checks whether a container may be written to a path.
///
/// # Errors
/// If the path exists and must not be replaced, or is not a file.
pub fn check_free(path: &Path, existing: Existing) -> Result<(), OutputError> {
    find_file(path, existing).map(drop)
}

/// Path of a container to write, with links resolved, and the file it replaces.
fn find_file(path: &Path, existing: Existing) -> Result<(PathBuf, Option<Metadata>), OutputError> {
    find_replaceable(path, existing)?.ok_or_else(|| OutputError::NoFile {
        path: path.into(),
        found: "a FIFO or device, but a container is read back while it is built".into(),
    })
}

/// Path of a file to write, with links resolved, and the file it replaces; `None` for a FIFO or device.
fn find_replaceable(path: &Path, existing: Existing) -> Result<Option<(PathBuf, Option<Metadata>)>, OutputError> {
    match find(path)? {
        Place::New(resolved) => Ok(Some((resolved, None))),
        Place::Taken(resolved, metadata) => {
            check_replaceable(path, &metadata, existing)?;
            Ok(Some((resolved, Some(metadata))))
        }
        Place::Stream => Ok(None),
    }
}

/// Checks that an output is different from the other files of its command.
///
/// # Errors
/// If the output is one of `others`, the command's inputs and other outputs.
pub fn check_distinct<'a>(output: &Path, others: impl IntoIterator<Item = &'a Path>) -> Result<(), OutputError> {
    match others.into_iter().find(|other| is_same_file(output, other)) {
        Some(other) => Err(OutputError::SameFile { path: output.into(), other: other.into() }),
        None => Ok(()),
    }
}

/// Whether two paths lead to the same file. Devices and FIFOs never count: nothing in them could be lost.
#[must_use]
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    match (std::fs::metadata(a), std::fs::metadata(b)) {
        (Ok(a_is), Ok(b_is)) => a_is.is_file() && b_is.is_file() && is_same(&a_is, &b_is, a, b),
        // Neither exists yet: compare name and folder.
        (Err(_), Err(_)) => {
            let folder = |path: &Path| std::fs::canonicalize(folder_of(path)).ok();
            a.file_name() == b.file_name() && folder(a).is_some() && folder(a) == folder(b)
        }
        _ => false,
    }
}

#[cfg(unix)]
fn is_same(a: &Metadata, b: &Metadata, _: &Path, _: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
fn is_same(_: &Metadata, _: &Metadata, a: &Path, b: &Path) -> bool {
    matches!((std::fs::canonicalize(a), std::fs::canonicalize(b)), (Ok(a), Ok(b)) if a == b)
}

fn find(path: &Path) -> Result<Place, OutputError> {
    let write_error = |e| OutputError::write(path, e);
    let refused = |found: &str| OutputError::NoFile { path: path.into(), found: found.into() };
    let metadata = match std::fs::metadata(path) {
        Ok(metadata) => metadata,
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            return if path.is_symlink() {
                Err(refused("a symbolic link to a file that is not there"))
            } else {
                Ok(Place::New(path.into()))
            };
        }
        Err(error) => return Err(write_error(error)),
    };
    if metadata.is_file() && !is_standard_output(&metadata) {
        return Ok(Place::Taken(std::fs::canonicalize(path).map_err(write_error)?, metadata));
    }
    if metadata.is_dir() {
        return Err(refused("a folder"));
    }
    if is_stream(&metadata) || is_standard_output(&metadata) {
        return Ok(Place::Stream);
    }
    Err(refused("a disk or a socket"))
}

#[cfg(unix)]
fn is_stream(metadata: &Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    metadata.file_type().is_fifo() || metadata.file_type().is_char_device()
}

#[cfg(not(unix))]
fn is_stream(_: &Metadata) -> bool {
    false
}

/// A second handle to the standard output. Opening `/dev/stdout` instead would start at the first byte and overwrite
/// the program's other output.
#[cfg(unix)]
fn standard_output() -> io::Result<File> {
    use std::os::fd::AsFd;
    Ok(File::from(io::stdout().as_fd().try_clone_to_owned()?))
}

#[cfg(unix)]
fn is_standard_output(metadata: &Metadata) -> bool {
    let output = standard_output().and_then(|output| output.metadata());
    output.is_ok_and(|output| is_same(metadata, &output, Path::new(""), Path::new("")))
}

#[cfg(not(unix))]
fn standard_output() -> io::Result<File> {
    Err(io::ErrorKind::Unsupported.into())
}

#[cfg(not(unix))]
fn is_standard_output(_: &Metadata) -> bool {
    false
}

fn open_stream(path: &Path) -> io::Result<File> {
    if is_standard_output(&std::fs::metadata(path)?) {
        return standard_output();
    }
    File::options().write(true).open(path)
}

fn check_replaceable(path: &Path, metadata: &Metadata, existing: Existing) -> Result<(), OutputError> {
    let expected = match existing {
        Existing::Replace => return Ok(()),
        Existing::Keep => return Err(OutputError::Exists { path: path.into() }),
        Existing::ReplacePicture => FileKind::Picture,
        Existing::ReplaceStatistics => FileKind::Statistics,
        Existing::ReplaceRecord => FileKind::Record,
        Existing::ReplaceFidelity => FileKind::Fidelity,
    };
    if metadata.len() == 0 {
        return Ok(());
    }
    let found = FileKind::of(path).map_err(|e| OutputError::write(path, e))?;
    if found == expected { Ok(()) } else { Err(OutputError::OtherKind { path: path.into(), expected, found }) }
}

impl OutputFile {
    /// Begins a file with the final name `path`.
    ///
    /// # Errors
    /// If the path exists and must not be replaced, is not a file, or its folder is not writable.
    pub fn begin(path: &Path, existing: Existing) -> Result<Self, OutputError> {
        let write_error = |e| OutputError::write(path, e);
        let Some((resolved, replaced)) = find_replaceable(path, existing)? else {
            let stream = open_stream(path).map_err(write_error)?;
            return Ok(Self(Target::Stream { stream, path: path.into() }));
        };
        let permissions = first_permissions(replaced.as_ref()).map_err(write_error)?;
        let unfinished = UnfinishedFile::create_in(folder_of(&resolved), permissions).map_err(write_error)?;
        Ok(Self(Target::File { unfinished, path: resolved, existing }))
    }

    /// Resolved path and permissions for a container with the final name `path`.
    ///
    /// # Errors
    /// As [`check_free`].
    pub fn place(path: &Path, existing: Existing) -> Result<(PathBuf, Permissions), OutputError> {
        let (resolved, replaced) = find_file(path, existing)?;
        Ok((resolved, first_permissions(replaced.as_ref()).map_err(|e| OutputError::write(path, e))?))
    }

    /// Output for an unfinished file that will be renamed to `path`, which must not be a link.
    #[must_use]
    pub fn of(unfinished: UnfinishedFile, path: PathBuf, existing: Existing) -> Self {
        Self(Target::File { unfinished, path, existing })
    }

    /// The file, for writing. It can be read and sought unless it [is a stream](Self::is_stream).
    #[must_use]
    pub fn file(&self) -> &File {
        match &self.0 {
            Target::File { unfinished, .. } => unfinished.as_file(),
            Target::Stream { stream, .. } => stream,
        }
    }

    /// Whether the output is a FIFO or device, which allows only sequential writing.
    #[must_use]
    pub fn is_stream(&self) -> bool {
        matches!(self.0, Target::Stream { .. })
    }

    /// Leaves the unfinished file behind and returns its temporary name; `None` for a stream.
    ///
    /// # Errors
    /// If the system does not let the file be kept; then it is removed.
    pub fn abandon(self) -> io::Result<Option<PathBuf>> {
        match self.0 {
            Target::File { unfinished, .. } => unfinished.abandon().map(Some),
            Target::Stream { .. } => Ok(None),
        }
    }

    /// Syncs the file, renames it to its final name, and syncs the folder. Returns its length in bytes; 0 for a stream.
    ///
    /// # Errors
    /// If the disk refuses it, or the name is now taken and must not be replaced.
    pub fn publish(self) -> Result<u64, OutputError> {
        let (unfinished, path, existing) = match self.0 {
            Target::File { unfinished, path, existing } => (unfinished, path, existing),
            Target::Stream { stream, path } => {
                return io::Write::flush(&mut &stream).map(|()| 0).map_err(|e| OutputError::write(&path, e));
            }
        };
        let write_error = |e| OutputError::write(&path, e);
        // Checked again: another file may have appeared since the output was begun.
        let replaced = match find(&path)? {
            Place::Taken(_, metadata) => {
                check_replaceable(&path, &metadata, existing)?;
                Some(metadata)
            }
            _ => None,
        };
        if let Some(replaced) = &replaced {
            take_over(unfinished.as_file(), replaced).map_err(write_error)?;
        }
        unfinished.as_file().sync_all().map_err(write_error)?;
        let bytes = unfinished.as_file().metadata().map_err(write_error)?.len();
        let replaces = replaced.is_some() || existing == Existing::Replace;
        let renamed = if replaces { unfinished.replace(&path) } else { unfinished.keep(&path) };
        renamed.map_err(|e| match e.kind() {
            io::ErrorKind::AlreadyExists => OutputError::Exists { path: path.clone() },
            _ => write_error(e),
        })?;
        // The rename is durable once the folder is synced. Some systems cannot open folders; there this step is
        // skipped.
        if let Ok(folder) = File::open(folder_of(&path)) {
            folder.sync_all().map_err(write_error)?;
        }
        Ok(bytes)
    }
}

/// Permissions for the new file: the default ones, which the system reduces by the process's mask. If a file will be
/// replaced, only the owner's, until [`take_over`] sets the final ones.
#[cfg(unix)]
fn first_permissions(replaced: Option<&Metadata>) -> io::Result<Permissions> {
    use std::os::unix::fs::PermissionsExt;
    Ok(Permissions::from_mode(if replaced.is_some() { 0o600 } else { 0o666 }))
}

#[cfg(not(unix))]
fn first_permissions(_: Option<&Metadata>) -> io::Result<Permissions> {
    Ok(std::fs::metadata(".")?.permissions())
}

/// Gives the new file the owner and mode of the file it replaces. If the owner cannot be kept, only the new owner gets
/// access.
#[cfg(unix)]
fn take_over(file: &File, replaced: &Metadata) -> io::Result<()> {
    use std::os::unix::fs::{MetadataExt, PermissionsExt, fchown};
    let is_owned = fchown(file, Some(replaced.uid()), Some(replaced.gid())).is_ok();
    let mode = replaced.mode() & if is_owned { 0o777 } else { 0o700 };
    file.set_permissions(Permissions::from_mode(mode))
}

#[cfg(not(unix))]
fn take_over(_: &File, _: &Metadata) -> io::Result<()> {
    Ok(())
}
