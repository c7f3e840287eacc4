//! Outputs: the one rule for every command that writes a file, and files that appear only when they are whole.
//!
//! 1. An output is never an input of the same command, nor another output of it: by device and inode, links followed, so
//!    that no other name helps, nor `--force` ([`check_distinct`]).
//! 2. A file that exists is not replaced ([`Existing::Keep`]), except pictures by pictures and statistics by statistics
//!    ([`Existing::ReplacePicture`], [`Existing::ReplaceStatistics`]; what it is, its bytes say: [`kind`]). `--force`
//!    replaces any file ([`Existing::Replace`]).
//! 3. A symbolic link is followed: the file it names is replaced, the link stays. One that names nothing is refused.
//! 4. What is no file is never replaced. FIFOs, character devices and the program's own standard output are written to
//!    directly; a container cannot be, since it is read back while it is built. Folders, disks and sockets are refused.
//! 5. A file is written under a temporary name beside its own ([`unfinished`]), synced, and renamed. It gets the mode and
//!    owner of the file it replaces, or those that the process's mask leaves.

mod error;
pub mod kind;
pub mod unfinished;

use std::fs::{File, Metadata, Permissions};
use std::io;
use std::path::{Path, PathBuf};

pub use error::{OutputError, advice, is_full_disk};
use kind::FileKind;
use unfinished::UnfinishedFile;

/// What to do with a file that is already there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Existing {
    /// Refuse.
    Keep,
    /// Replace a picture, refuse all else.
    ReplacePicture,
    /// Replace statistics of a picture, refuse all else.
    ReplaceStatistics,
    /// Replace it once the new one is whole.
    Replace,
}

/// A file being written. Dropped without [`OutputFile::publish`], it leaves nothing behind.
#[derive(Debug)]
pub struct OutputFile(Target);

#[derive(Debug)]
enum Target {
    /// Renamed to `path`, with links followed, when it is whole.
    File { unfinished: UnfinishedFile, path: PathBuf, existing: Existing },
    /// Written to as it is.
    Stream { stream: File, path: PathBuf },
}

/// What a path leads to.
enum Place {
    /// No file yet.
    New(PathBuf),
    /// A file, with links followed.
    Taken(PathBuf, Metadata),
    /// A FIFO or character device.
    Stream,
}

/// The folder that a path lies in.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Whether a container may be written to a path.
///
/// # Errors
/// If the path is taken and not to be replaced, or leads to what is no file.
pub fn check_free(path: &Path, existing: Existing) -> Result<(), OutputError> {
    find_file(path, existing).map(drop)
}

/// Where a container is to be written, with links followed, and what it replaces.
fn find_file(path: &Path, existing: Existing) -> Result<(PathBuf, Option<Metadata>), OutputError> {
    find_replaceable(path, existing)?.ok_or_else(|| OutputError::NoFile {
        path: path.into(),
        found: "a FIFO or device, but a container is read back while it is built".into(),
    })
}

/// Where a file is to be written, with links followed, and what it replaces; `None` where a FIFO or device is written to.
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

/// # Errors
/// If the output is one of the inputs, or of the other outputs, of its command.
pub fn check_distinct<'a>(output: &Path, others: impl IntoIterator<Item = &'a Path>) -> Result<(), OutputError> {
    match others.into_iter().find(|other| is_same_file(output, other)) {
        Some(other) => Err(OutputError::SameFile { path: output.into(), other: other.into() }),
        None => Ok(()),
    }
}

/// Whether two paths lead to one file; what is no file (a device, a FIFO) is never one that could be lost.
#[must_use]
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    match (std::fs::metadata(a), std::fs::metadata(b)) {
        (Ok(a_is), Ok(b_is)) => a_is.is_file() && b_is.is_file() && is_same(&a_is, &b_is, a, b),
        // Neither is there yet: the same name in the same folder.
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

/// A second handle to the standard output. Opening `/dev/stdout` anew would begin at the first byte again, and overwrite
/// what the program has written and will write.
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
    };
    if metadata.len() == 0 {
        return Ok(());
    }
    let found = FileKind::of(path).map_err(|e| OutputError::write(path, e))?;
    if found == expected { Ok(()) } else { Err(OutputError::OtherKind { path: path.into(), expected, found }) }
}

impl OutputFile {
    /// Begins a file that will be called `path`.
    ///
    /// # Errors
    /// If the path is taken and not to be replaced, leads to what is no file, or its folder cannot be written.
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

    /// Where a container that will be called `path` is to be written, with links followed, and with which permissions.
    ///
    /// # Errors
    /// As [`check_free`].
    pub fn place(path: &Path, existing: Existing) -> Result<(PathBuf, Permissions), OutputError> {
        let (resolved, replaced) = find_file(path, existing)?;
        Ok((resolved, first_permissions(replaced.as_ref()).map_err(|e| OutputError::write(path, e))?))
    }

    /// A file that was begun, and will be called `path`, which is no link.
    #[must_use]
    pub fn of(unfinished: UnfinishedFile, path: PathBuf, existing: Existing) -> Self {
        Self(Target::File { unfinished, path, existing })
    }

    /// The file, to write to; to be read back and sought in unless it [is a stream](Self::is_stream).
    #[must_use]
    pub fn file(&self) -> &File {
        match &self.0 {
            Target::File { unfinished, .. } => unfinished.as_file(),
            Target::Stream { stream, .. } => stream,
        }
    }

    /// Whether it is a FIFO or device, which is written to from its beginning to its end and no other way.
    #[must_use]
    pub fn is_stream(&self) -> bool {
        matches!(self.0, Target::Stream { .. })
    }

    /// Leaves a file behind unfinished, under its temporary name, which is returned; nothing of a stream.
    ///
    /// # Errors
    /// If the system does not let it be kept; then it is removed.
    pub fn abandon(self) -> io::Result<Option<PathBuf>> {
        match self.0 {
            Target::File { unfinished, .. } => unfinished.abandon().map(Some),
            Target::Stream { .. } => Ok(None),
        }
    }

    /// Syncs the file, gives it its name, and makes the name last. Returns its length in bytes; of a stream, 0.
    ///
    /// # Errors
    /// If the disk does not take it, or the name was taken meanwhile and is not to be replaced.
    pub fn publish(self) -> Result<u64, OutputError> {
        let (unfinished, path, existing) = match self.0 {
            Target::File { unfinished, path, existing } => (unfinished, path, existing),
            Target::Stream { stream, path } => {
                return io::Write::flush(&mut &stream).map(|()| 0).map_err(|e| OutputError::write(&path, e));
            }
        };
        let write_error = |e| OutputError::write(&path, e);
        // Looked at again: what is there now need not be what was there when the file was begun.
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
        // The rename itself is durable once the folder is; folders cannot be opened everywhere, and then nothing is lost.
        if let Ok(folder) = File::open(folder_of(&path)) {
            folder.sync_all().map_err(write_error)?;
        }
        Ok(bytes)
    }
}

/// Permissions to create a file with: those of every new file, of which the system takes the process's mask away; or for
/// nobody else, where the file to be replaced will say whom it is for.
#[cfg(unix)]
fn first_permissions(replaced: Option<&Metadata>) -> io::Result<Permissions> {
    use std::os::unix::fs::PermissionsExt;
    Ok(Permissions::from_mode(if replaced.is_some() { 0o600 } else { 0o666 }))
}

#[cfg(not(unix))]
fn first_permissions(_: Option<&Metadata>) -> io::Result<Permissions> {
    Ok(std::fs::metadata(".")?.permissions())
}

/// Gives the new file owner and mode of the one it replaces; where the owner cannot be kept, nobody else may read it.
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
