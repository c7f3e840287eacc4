//! What every measurement is handed: how big it may be, where it may write, whom it tells how far it is.

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

/// How much is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Sizes of the report.
    Full,
    /// The smallest sizes that still reach the failure: tests, `--quick`.
    Small,
}

/// Why something could not be measured.
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
    /// A measurement whose own preconditions do not hold: a mistake of ours.
    #[error("a mistake of supervol: {0}")]
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

/// What every measurement is handed.
pub struct Context<'a> {
    /// How much is measured.
    pub scale: Scale,
    /// Folder for containers; whoever made the context removes it.
    pub folder: &'a Path,
    /// Called with one line whenever something that takes time begins.
    pub say: &'a (dyn Fn(&str) + Sync),
}

impl Context<'_> {
    /// `full` or `small`, whichever the scale asks for.
    #[must_use]
    pub fn pick<T>(&self, full: T, small: T) -> T {
        match self.scale {
            Scale::Full => full,
            Scale::Small => small,
        }
    }
}

/// Least time between two lines of one [`Pace`].
const PACE: Duration = Duration::from_secs(2);

/// Progress of something that may be over at once: says nothing in the beginning, and then a line every now and then.
pub struct Pace<'a> {
    say: &'a (dyn Fn(&str) + Sync),
    last: Mutex<Instant>,
}

impl<'a> Pace<'a> {
    /// The clock starts now.
    #[must_use]
    pub fn new(say: &'a (dyn Fn(&str) + Sync)) -> Self {
        Self { say, last: Mutex::new(Instant::now()) }
    }

    /// Says a line if nothing was said for two seconds.
    pub fn tell(&self, line: impl FnOnce() -> String) {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if last.elapsed() >= PACE {
            *last = Instant::now();
            (self.say)(&line());
        }
    }
}
