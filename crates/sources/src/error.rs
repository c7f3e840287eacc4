//! Errors of sources.

use std::path::{Path, PathBuf};

/// Error of opening or reading a volume. The message of each variant is complete; callers add only their own context.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum SourceError {
    /// The machine failed: exit code 3.
    #[error("cannot read {path}: {source}")]
    Io { path: PathBuf, source: std::io::Error },
    /// Decoded voxels could not be kept: exit code 3.
    #[error("cannot keep decoded voxels in {folder}: {source}{}", supervol_files::advice(source))]
    Spool { folder: PathBuf, source: std::io::Error },
    /// The file breaks its format's rules: exit code 1.
    #[error("{path}: {location}: expected {expected}, found {found}")]
    Invalid { path: PathBuf, location: String, expected: String, found: String },
    /// The file is right but is not what we read; `advice` says what to do: exit code 1.
    #[error("{path}: {what}; {advice}")]
    Unsupported { path: PathBuf, what: String, advice: String },
    /// The file was not left alone: exit code 1.
    #[error("{path} changed while it was read: {what}. Build again when nothing writes to it")]
    Changed { path: PathBuf, what: String },
    /// Somebody wanted it to stop ([`crate::stop`]).
    #[error("stopped before anything was finished; nothing is kept")]
    Stopped,
    /// The options given contradict the file or each other: exit code 2.
    #[error("{0}")]
    Options(String),
}

impl SourceError {
    /// Shorthand for [`SourceError::Invalid`].
    pub fn invalid(
        path: &Path,
        location: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Invalid { path: path.into(), location: location.into(), expected: expected.into(), found: found.into() }
    }

    /// Shorthand for [`SourceError::Unsupported`].
    pub fn unsupported(path: &Path, what: impl Into<String>, advice: impl Into<String>) -> Self {
        Self::Unsupported { path: path.into(), what: what.into(), advice: advice.into() }
    }

    /// Shorthand for [`SourceError::Spool`].
    pub fn spool(folder: &Path, source: std::io::Error) -> Self {
        Self::Spool { folder: folder.into(), source }
    }

    /// Shorthand for [`SourceError::Io`].
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.into(), source }
    }
}
