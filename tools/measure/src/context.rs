//! Context of a measurement: scale, folder for its files, and a callback for progress.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use supervol_arguments::failure::Failure;
use supervol_files::OutputError;
use supervol_format::container::ContainerError;
use supervol_preprocess::BuildError;
use supervol_runtime::engines::gpu::error::GpuError;
use supervol_runtime::render::error::RenderError;
use supervol_scene::scene::SceneError;
use supervol_sources::SourceError;

/// Extent of the measurements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Sizes for the report.
    Full,
    /// The smallest sizes that still reach the failure: tests, `--quick`.
    Small,
}

/// Error of a measurement.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum ChartError {
    #[error(transparent)]
    Source(#[from] SourceError),
    #[error(transparent)]
    Build(#[from] BuildError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Container(#[from] ContainerError),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    Render(#[from] RenderError),
    #[error(transparent)]
    Gpu(#[from] GpuError),
    #[error("cannot write {path}: {source}")]
    Write { path: PathBuf, source: std::io::Error },
    #[error("{0}")]
    Command(String),
    /// A precondition of the measurement does not hold: a programming error.
    #[error("bug in supervol: {0}")]
    Broken(String),
}

impl From<ChartError> for Failure {
    fn from(error: ChartError) -> Self {
        match error {
            ChartError::Build(error) => error.into(),
            ChartError::Output(error) => error.into(),
            ChartError::Source(error) => BuildError::from(error).into(),
            ChartError::Command(message) => Self::Command(message),
            ChartError::Container(error) if !matches!(error, ContainerError::Io { .. }) => {
                Self::Data(error.to_string())
            }
            other => Self::Machine(other.to_string()),
        }
    }
}

/// Context of a measurement.
pub struct Context<'a> {
    /// Extent of the measurements.
    pub scale: Scale,
    /// Folder for containers; the creator of the context removes it.
    pub folder: &'a Path,
    /// Callback for one line of progress, called at the start of each slow operation.
    pub say: &'a (dyn Fn(&str) + Sync),
}

impl std::fmt::Debug for Context<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Context").field("scale", &self.scale).field("folder", &self.folder).finish_non_exhaustive()
    }
}

impl Context<'_> {
    /// `full` or `small`, depending on the scale.
    #[must_use]
    pub fn pick<T>(&self, full: T, small: T) -> T {
        match self.scale {
            Scale::Full => full,
            Scale::Small => small,
        }
    }
}

/// Shortest time between two lines of one [`Pace`].
const PACE: Duration = Duration::from_secs(2);

/// Rate-limited progress of an operation that may be short: no line in the first two seconds.
pub struct Pace<'a> {
    say: &'a (dyn Fn(&str) + Sync),
    last: Mutex<Instant>,
}

impl std::fmt::Debug for Pace<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Pace").field("last", &self.last).finish_non_exhaustive()
    }
}

impl<'a> Pace<'a> {
    /// Starts the clock.
    #[must_use]
    pub fn new(say: &'a (dyn Fn(&str) + Sync)) -> Self {
        Self { say, last: Mutex::new(Instant::now()) }
    }

    /// Prints a line if the last one is at least two seconds old.
    pub fn tell(&self, line: impl FnOnce() -> String) {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if last.elapsed() >= PACE {
            *last = Instant::now();
            (self.say)(&line());
        }
    }
}
