//! Errors of engines.

use std::error::Error;

use super::gpu::error::GpuError;

/// Failure of an engine. The message is that of its cause.
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    /// The GPU engine failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The stop condition is due. The engine keeps its state and continues when the picture does.
    #[error("the engine stopped before its picture was whole")]
    Stopped,
    /// An engine from outside this crate failed.
    #[error(transparent)]
    Other(Box<dyn Error + Send + Sync>),
}
