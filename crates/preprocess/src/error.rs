//! Errors of builds, checks and exports.

use std::path::{Path, PathBuf};

use supervol_files::{OutputError, is_full_disk};
use supervol_format::ValueRange;
use supervol_format::container::ContainerError;
use supervol_format::pyramid::PyramidError;
use supervol_format::readable::Mib;
use supervol_sources::SourceError;

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
    #[error("{path} is kept: {what}. The option `existing` set to `Replace` builds it again")]
    Outdated { path: PathBuf, what: String },
    #[error("no cache folder: expected one from the caller, or one named by the environment (`HOME`)")]
    NoCacheFolder,
    #[error("{}: the output folder {} lies in it. Choose another", input.display(), folder.display())]
    FolderInInput { input: PathBuf, folder: PathBuf },
    #[error("these levels make no pyramid: {0}")]
    Pyramid(#[from] PyramidError),
    #[error(
        "{} of memory are needed ({purpose}), the option `memory_bytes` allows {}. {}",
        Mib(*needed_bytes), Mib(*allowed_bytes), purpose.advice()
    )]
    Memory { needed_bytes: u64, allowed_bytes: u64, purpose: MemoryPurpose },
    #[error("cannot start {threads} threads: {source}")]
    Threads { threads: usize, source: rayon::ThreadPoolBuildError },
    #[error("cannot start a thread: {0}")]
    Thread(std::io::Error),
    #[error("{path}: {rule}: expected {expected}, found {found}")]
    Broken { path: PathBuf, rule: String, expected: String, found: String },
    #[error("no surface at the value {iso}; {} has {}", path.display(), describe_values(*range))]
    NoSurface { path: PathBuf, iso: f64, range: Option<ValueRange> },
    #[error(
        "{}: expected a surface of less than 2^32 vertices and triangles, found {vertices} and {triangles}. Choose a part (option \
         `voxels`) or a coarser level (option `lod`)",
        path.display()
    )]
    LargeSurface { path: PathBuf, vertices: u64, triangles: u64 },
    #[error("{0}")]
    Options(String),
}

/// Purpose of memory that is too small ([`BuildError::Memory`]).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MemoryPurpose {
    /// A build.
    Build {
        /// Bytes of the tables of the source and of the bricks.
        table_bytes: u64,
        /// Number of bricks of the container.
        bricks: u64,
        /// Bytes that one thread takes.
        thread_bytes: u64,
    },
    /// A check of a container.
    Verify {
        /// Number of bricks of the container.
        bricks: u64,
    },
    /// Other work, in words that follow "memory is needed".
    Other(&'static str),
}

impl std::fmt::Display for MemoryPurpose {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match *self {
            Self::Build { table_bytes, bricks, thread_bytes } => write!(
                f,
                "{} for the tables of the source and of {bricks} bricks, {} for one thread, the rest for tiles of one brick",
                Mib(table_bytes),
                Mib(thread_bytes)
            ),
            Self::Verify { bricks } => write!(f, "to check bricks on one thread, and the places of {bricks} of them"),
            Self::Other(what) => f.write_str(what),
        }
    }
}

impl MemoryPurpose {
    /// Advice, as a sentence without its full stop.
    fn advice(self) -> &'static str {
        match self {
            Self::Build { .. } => "Allow more, or use smaller bricks (option `layout`)",
            Self::Verify { .. } | Self::Other(_) => "Allow more",
        }
    }
}

impl BuildError {
    /// Error for a file at `path` that cannot be written.
    #[must_use]
    pub fn write(path: &Path, source: std::io::Error) -> Self {
        OutputError::write(path, source).into()
    }

    /// Error for a memory limit that is too small.
    pub(crate) fn memory(needed_bytes: u64, allowed_bytes: u64, purpose: MemoryPurpose) -> Self {
        // Rounded up to whole MiB, so that the user can give the printed number.
        Self::Memory { needed_bytes: needed_bytes.next_multiple_of(1 << 20), allowed_bytes, purpose }
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
                | Self::NoCacheFolder
                | Self::FolderInInput { .. }
                | Self::NoSurface { .. }
                | Self::LargeSurface { .. }
                | Self::Options(_)
                | Self::Memory { .. }
        ) || matches!(self, Self::Source(error) if error.is_wrong_option())
            || self.is_missing_input()
    }
}

/// Values of a volume, in words.
fn describe_values(range: Option<ValueRange>) -> String {
    range.map_or("no values".into(), |range| format!("values of {} to {}", range.min, range.max))
}

/// Advice on the kept files of a failed build ([`BuildError::Kept`]), as a sentence without its full stop.
#[must_use]
pub fn kept_advice(kept: &[PathBuf; 2], written_bytes: u64, missing_bytes: u64) -> String {
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
