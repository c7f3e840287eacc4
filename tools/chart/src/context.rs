//! What every measurement is handed: how big it may be, where it may write, whom it tells how far it is.

use std::path::{Path, PathBuf};

use supervol_format::container::ContainerError;
use supervol_preprocess::BuildError;
use supervol_preprocess::source::SourceError;
use supervol_runtime::frame::RenderError;
use supervol_runtime::raycast::gpu::GpuError;
use supervol_runtime::scene::SceneError;

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
