//! Errors of the library.

use std::path::PathBuf;

use supervol_format::container::ContainerError;
use supervol_format::{Dims, VoxelBox};
#[cfg(feature = "sources")]
use supervol_preprocess::BuildError;
use supervol_runtime::render::accuracy::proof::ProofError;
use supervol_runtime::render::error::{ErrorKind, RenderError};
#[cfg(feature = "images")]
use supervol_scene::image::ImageError;
#[cfg(feature = "images")]
use supervol_scene::image::read::StoredError;
use supervol_scene::scene::SceneError;

/// Failure of a call of this library. The message says what was expected, what was found, and where.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A container cannot be opened or read.
    #[error("{path}: {source}")]
    Container {
        /// The file; empty where the container was not opened as one.
        path: PathBuf,
        /// The reason.
        source: ContainerError,
    },
    /// A volume file cannot be read, or no container can be built of it.
    #[cfg(feature = "sources")]
    #[error(transparent)]
    Build(#[from] BuildError),
    /// A scene is not valid, or cannot be drawn of this volume.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A picture cannot be drawn.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A picture cannot be written.
    #[cfg(feature = "images")]
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A picture file cannot be read.
    #[cfg(feature = "images")]
    #[error(transparent)]
    Stored(#[from] StoredError),
    /// A picture can neither be proved nor refuted.
    #[error("{path}: {source}")]
    Proof {
        /// The picture.
        path: PathBuf,
        /// The reason.
        source: Box<ProofError>,
    },
    /// A container has no such level.
    #[error("level {level}: expected one of 0 to {coarsest}")]
    Level {
        /// The level that was asked for.
        level: u8,
        /// The coarsest level of the container.
        coarsest: u8,
    },
    /// A box leaves the grid of its level, or is too large for the memory of the machine.
    #[error("voxels {start:?} to {end:?}: expected a box inside the grid of {dims} that fits into memory", start = voxels.start, end = voxels.end)]
    Box {
        /// The box that was asked for, ends not included.
        voxels: VoxelBox,
        /// Voxels of the level.
        dims: Dims,
    },
    /// Voxels in memory do not fill the grid that they are said to fill.
    #[error("a grid of {dims} needs {expected} voxels, found {found}")]
    Voxels {
        /// Voxels along x, y and z.
        dims: Dims,
        /// Their product.
        expected: u64,
        /// Voxels that were given.
        found: u64,
    },
}

impl Error {
    /// The side at fault.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Container { source: ContainerError::Io { source, .. }, .. } => kind_of_io(source),
            Self::Container { .. } => ErrorKind::Data,
            #[cfg(feature = "sources")]
            Self::Build(error) if error.is_stopped() => ErrorKind::Cancelled,
            #[cfg(feature = "sources")]
            Self::Build(error) if error.is_wrong_command() => ErrorKind::Request,
            #[cfg(feature = "sources")]
            Self::Build(error) if error.is_machine_failure() => ErrorKind::Machine,
            #[cfg(feature = "sources")]
            Self::Build(_) => ErrorKind::Data,
            Self::Scene(_) | Self::Level { .. } | Self::Box { .. } | Self::Voxels { .. } => ErrorKind::Request,
            #[cfg(feature = "images")]
            Self::Image(ImageError::Format { .. }) => ErrorKind::Request,
            #[cfg(feature = "images")]
            Self::Image(_) => ErrorKind::Machine,
            #[cfg(feature = "images")]
            Self::Stored(StoredError::Io { source, .. }) => kind_of_io(source),
            #[cfg(feature = "images")]
            Self::Stored(_) => ErrorKind::Data,
            Self::Proof { source, .. } => source.kind(),
            Self::Render(error) => error.kind(),
        }
    }
}

/// The side at fault where a file cannot be read: whoever named a file that is not there, or the machine.
fn kind_of_io(error: &std::io::Error) -> ErrorKind {
    match error.kind() {
        std::io::ErrorKind::NotFound | std::io::ErrorKind::InvalidInput => ErrorKind::Request,
        _ => ErrorKind::Machine,
    }
}
