//! Errors of builds, checks and exports.

use std::path::{Path, PathBuf};

use supervol_files::{OutputError, is_full_disk};
use supervol_format::container::ContainerError;
use supervol_format::pyramid::PyramidError;
use supervol_format::readable::Mib;
use supervol_sources::SourceError;
use supervol_sources::message::OptionName;

/// Reason of a failure. Each message says what was expected, what was found, and where.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum BuildError {
    #[error(transparent)]
    Source(#[from] SourceError),
    #[error("{path}: {source}")]
    Container { path: PathBuf, source: ContainerError },
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error("{error}. {}", kept_advice(kept, *written_bytes, *missing_bytes))]
    Kept { error: Box<BuildError>, kept: [PathBuf; 2], written_bytes: u64, missing_bytes: u64 },
    #[error("the build was stopped. {}", stopped_advice(kept.as_ref()))]
    Stopped { kept: Option<[PathBuf; 2]> },
    #[error("{path} is kept: {what}. --force builds it again")]
    Outdated { path: PathBuf, what: String },
    #[error("these levels make no pyramid: {0}")]
    Pyramid(#[from] PyramidError),
    #[error("{needed} of memory are needed ({what}), --memory allows {allowed}. {advice}")]
    Memory { needed: String, allowed: String, what: String, advice: String },
    #[error("cannot start {threads} threads: {source}")]
    Threads { threads: usize, source: rayon::ThreadPoolBuildError },
    #[error("cannot start a thread: {0}")]
    Thread(std::io::Error),
    #[error("{path}: {rule}: expected {expected}, found {found}")]
    Broken { path: PathBuf, rule: String, expected: String, found: String },
    #[error("{0}")]
    Options(String),
}

impl BuildError {
    /// Error for a file at `path` that cannot be written.
    #[must_use]
    pub fn write(path: &Path, source: std::io::Error) -> Self {
        OutputError::write(path, source).into()
    }

    /// Error for a `--memory` that is too small; `what` is the purpose of the memory.
    pub(crate) fn memory(needed: u64, allowed: u64, what: String, advice: &str) -> Self {
        // Rounded up to whole MiB, so that the user can give the printed number.
        let needed = Mib(needed.next_multiple_of(1 << 20)).to_string();
        Self::Memory { needed, allowed: Mib(allowed).to_string(), what, advice: advice.into() }
    }

    /// Error for a container at `path` that cannot be read.
    #[must_use]
    pub fn container(path: &Path, source: ContainerError) -> Self {
        Self::Container { path: path.into(), source }
    }

    /// Whether the command's input does not exist or is not a file.
    fn is_missing_input(&self) -> bool {
        let source = match self {
            Self::Source(SourceError::Io { source, .. })
            | Self::Container { source: ContainerError::Io { source, .. }, .. } => source,
            _ => return false,
        };
        matches!(source.kind(), std::io::ErrorKind::NotFound | std::io::ErrorKind::InvalidInput)
    }

    /// The message with the names that a program gives to the options of sources.
    #[must_use]
    pub fn named(&self, name: OptionName) -> String {
        match self {
            Self::Source(error) => error.named(name),
            Self::Kept { error, kept, written_bytes, missing_bytes } => {
                format!("{}. {}", error.named(name), kept_advice(kept, *written_bytes, *missing_bytes))
            }
            other => other.to_string(),
        }
    }

    /// Whether the disk or a quota is full, or the file would be longer than allowed.
    #[must_use]
    pub fn is_full_disk(&self) -> bool {
        match self {
            Self::Kept { error, .. } => error.is_full_disk(),
            Self::Output(error) => error.is_full_disk(),
            Self::Source(SourceError::Spool { source, .. }) => is_full_disk(source),
            _ => false,
        }
    }

    /// Whether the build was cancelled ([`supervol_sources::stop`]).
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        matches!(self, Self::Stopped { .. } | Self::Source(SourceError::Stopped))
    }

    /// Whether the source no longer exists.
    #[must_use]
    pub fn is_source_gone(&self) -> bool {
        matches!(self, Self::Source(SourceError::Io { source, .. }) if source.kind() == std::io::ErrorKind::NotFound)
    }

    /// Whether the machine failed (disk, memory, I/O), rather than the data or the command.
    #[must_use]
    pub fn is_machine_failure(&self) -> bool {
        if let Self::Kept { error, .. } = self {
            return error.is_machine_failure();
        }
        matches!(
            self,
            Self::Output(OutputError::Write { .. })
                | Self::Threads { .. }
                | Self::Thread(_)
                | Self::Source(SourceError::Io { .. } | SourceError::Spool { .. })
                | Self::Container { source: ContainerError::Io { .. }, .. }
        )
    }

    /// Whether the command was impossible.
    #[must_use]
    pub fn is_wrong_command(&self) -> bool {
        matches!(
            self,
            Self::Output(
                OutputError::Exists { .. }
                    | OutputError::OtherKind { .. }
                    | OutputError::SameFile { .. }
                    | OutputError::NoFile { .. },
            ) | Self::Outdated { .. }
                | Self::Options(_)
                | Self::Memory { .. }
        ) || matches!(self, Self::Source(error) if error.is_wrong_option())
            || self.is_missing_input()
    }
}

/// Advice on the kept files of a failed build.
fn kept_advice(kept: &[PathBuf; 2], written_bytes: u64, missing_bytes: u64) -> String {
    let (written, missing) = (Mib(written_bytes), Mib(missing_bytes));
    format!(
        "What was written is kept, about {written} in {} and its list {}; about {missing} more are needed. The same command goes \
         on from there; remove both to give it up",
        kept[0].display(),
        kept[1].display(),
    )
}

/// Advice on the kept files of a cancelled build.
fn stopped_advice(kept: Option<&[PathBuf; 2]>) -> String {
    let Some([container, list]) = kept else {
        return "Nothing of it was finished, and nothing is kept".into();
    };
    format!(
        "What it has finished is kept in {} and its list {}: the same build goes on from there; remove both to give it up",
        container.display(),
        list.display()
    )
}
