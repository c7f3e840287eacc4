//! Errors of rendering.

use supervol_format::container::ContainerError;
use supervol_format::readable::Mib;

use crate::engines::error::EngineError;
use crate::engines::gpu::error::GpuError;
use crate::render::options::Backend;
use crate::stream::budget::BudgetError;
use crate::stream::streamer::StreamError;

/// Reason why there is no picture.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum RenderError {
    #[error(transparent)]
    Budget(#[from] BudgetError),
    #[error(transparent)]
    Stream(#[from] StreamError),
    #[error(transparent)]
    Container(#[from] ContainerError),
    #[error(
        "level {level} needs {} for the reference integrator, but the host budget is {}; give more memory or choose a \
         coarser level",
        Mib(*needed_bytes), Mib(*budget_bytes)
    )]
    ReferenceTooLarge { level: u8, needed_bytes: u64, budget_bytes: u64 },
    #[error(
        "the check of level {level} needs {} for the reference integrator, but the host budget is {}; give more memory, \
         or draw and check a coarser level (finest that fits: {finest_that_fits:?})",
        Mib(*needed_bytes), Mib(*budget_bytes)
    )]
    CheckTooLarge { level: u8, needed_bytes: u64, budget_bytes: u64, finest_that_fits: Option<u8> },
    #[error(transparent)]
    Engine(EngineError),
    #[error("option `{option}`: expected {expected}, found {found}")]
    Option { option: &'static str, expected: &'static str, found: f64 },
    #[error("there is no scene to draw: expected one to be set before")]
    NoScene,
    #[error("methods of comparison are for the cpu backend and mode dvr; found backend {backend:?} and mode {mode}")]
    Method { backend: Backend, mode: &'static str },
    #[error(
        "sections (mode slice) are drawn by the backends cpu and reference (and auto, which takes cpu then); found gpu"
    )]
    SlicesOnGpu,
    #[error(
        "opacity by the gradient (gradient_opacity) is drawn by the backends cpu and reference (and auto, which takes cpu \
         then); found gpu"
    )]
    GradientsOnGpu,
    #[error(
        "light by the normals of cuts (cut_normals) is drawn by the backends cpu and reference (and auto, which takes cpu then); \
         found gpu"
    )]
    CutNormalsOnGpu,
    #[error("cannot pick in mode mean: a mean has no depth; use another mode")]
    NoPlace,
    #[error("pixel {},{}: the picture has {} x {} pixels, the first is 0,0", pixel[0], pixel[1], size[0], size[1])]
    NoSuchPixel { pixel: [u32; 2], size: [u32; 2] },
    #[error("{threads} threads cannot be started: {message}")]
    Threads { threads: usize, message: String },
    #[error(
        "bug in Supervol, please report it: after pass {pass}, {remaining} rays wait for {wanted} bricks, and none of \
         these can be fetched; the first is {first}"
    )]
    NoProgress { pass: u64, remaining: u64, wanted: usize, first: String },
    #[error("the picture was cancelled before it was whole")]
    Cancelled,
    #[error("bug in Supervol, please report it: {remaining} rays are unfinished after the limit of {limit} passes")]
    TooManyPasses { remaining: u64, limit: u64 },
}

/// The side at fault, by which a program chooses what to tell its user.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorKind {
    /// A file is damaged, or does not follow its format.
    Data,
    /// The caller asked for something impossible: a file that is not there, a scene out of range, too little memory.
    Request,
    /// The machine failed: an I/O error, a full disk, a lost graphics device.
    Machine,
    /// A [`Canceller`](crate::stop::Canceller) stopped the work.
    Cancelled,
}

impl RenderError {
    /// The side at fault.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Cancelled => ErrorKind::Cancelled,
            Self::Container(_) => ErrorKind::Data,
            Self::Budget(_)
            | Self::ReferenceTooLarge { .. }
            | Self::CheckTooLarge { .. }
            | Self::Engine(EngineError::Gpu(GpuError::Budget { .. }))
            | Self::NoPlace
            | Self::NoSuchPixel { .. }
            | Self::SlicesOnGpu
            | Self::GradientsOnGpu
            | Self::CutNormalsOnGpu
            | Self::Option { .. }
            | Self::NoScene
            | Self::Method { .. } => ErrorKind::Request,
            _ => ErrorKind::Machine,
        }
    }
}

impl From<EngineError> for RenderError {
    fn from(error: EngineError) -> Self {
        match error {
            EngineError::Stopped => Self::Cancelled,
            error => Self::Engine(error),
        }
    }
}

impl From<GpuError> for RenderError {
    fn from(error: GpuError) -> Self {
        Self::Engine(error.into())
    }
}
