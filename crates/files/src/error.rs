//! Errors of output files.

use std::path::{Path, PathBuf};

use crate::kind::FileKind;

/// An output file that was refused or could not be written.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum OutputError {
    #[error("cannot write {path}: {source}{}", advice(source))]
    Write { path: PathBuf, source: std::io::Error },
    #[error("{path} exists: expected the name of a new file, or the option `existing` set to `Replace`")]
    Exists { path: PathBuf },
    #[error(
        "{path} exists: expected {expected} to replace, found {found}. Choose another name, or set the option `existing` to `Replace`"
    )]
    OtherKind { path: PathBuf, expected: FileKind, found: FileKind },
    #[error("cannot write {path}: it is {other}, which this command reads or writes, too. Choose another name")]
    SameFile { path: PathBuf, other: PathBuf },
    #[error("cannot write {path}: expected a file or the name of a new one, found {found}")]
    NoFile { path: PathBuf, found: String },
}

impl OutputError {
    /// Error for a file at `path` that cannot be written.
    #[must_use]
    pub fn write(path: &Path, source: std::io::Error) -> Self {
        Self::Write { path: path.into(), source }
    }

    /// Whether the disk is full, a quota is used up, or the file would be longer than allowed.
    #[must_use]
    pub fn is_full_disk(&self) -> bool {
        matches!(self, Self::Write { source, .. } if is_full_disk(source))
    }
}

/// Whether an I/O error means that the disk is full, a quota is used up, or the file would be longer than allowed.
#[must_use]
pub fn is_full_disk(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
    matches!(error.kind(), StorageFull | QuotaExceeded | FileTooLarge)
}

/// Whether writing to another place can help against an I/O error on an output.
#[must_use]
pub fn is_bound_to_place(error: &std::io::Error) -> bool {
    is_full_disk(error) || error.kind() == std::io::ErrorKind::PermissionDenied
}

/// Advice for an I/O error on an output, as a sentence without its full stop; empty if there is none. If
/// [`is_bound_to_place`], it ends with the choice of another place, so that a program can append its option for that.
#[must_use]
pub fn advice(error: &std::io::Error) -> &'static str {
    match error.kind() {
        std::io::ErrorKind::StorageFull => ". The disk is full: free space, or write to another one",
        std::io::ErrorKind::QuotaExceeded => ". Your share of the disk is full: free space, or write to another one",
        std::io::ErrorKind::FileTooLarge => {
            ". Files may not be so long here: see `ulimit -f`, or write to another disk"
        }
        std::io::ErrorKind::PermissionDenied => ". Choose a folder you may write to",
        std::io::ErrorKind::NotFound => ". The folder does not exist",
        _ => "",
    }
}
