//! Errors of the GPU backend. They name no type of wgpu, because builds without wgpu have them, too.

use supervol_format::BrickKey;
use supervol_format::readable::Mib;

/// Reason why the GPU could not do something.
#[derive(Debug, Clone, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum GpuError {
    #[error("this build has no GPU backend (cargo feature `gpu`); use the CPU backend")]
    NotBuilt,
    #[error("no GPU adapter: {reason}; install a Vulkan driver (Mesa's lavapipe suffices) or use the CPU backend")]
    NoAdapter { reason: String },
    #[error("the adapter {adapter} has no usable limits: {reason}; use the CPU backend")]
    TooSmall { adapter: String, reason: String },
    #[error("the GPU is out of memory in {doing}: {message}; lower the GPU memory budget or the image size")]
    OutOfMemory { doing: String, message: String },
    #[error("the GPU driver refused {doing}: {message}")]
    Refused { doing: String, message: String },
    #[error("the GPU device was lost ({message}); build a new device and renderer")]
    DeviceLost { message: String },
    #[error(
        "the GPU budget of {} is too small: {} for rays and tables and {} for each of at least {min_slots} bricks make \
         {}; raise the GPU memory budget, or lower the image size",
        Mib(*budget), Mib(*fixed), Mib(*slot_bytes), Mib(*needed)
    )]
    Budget { budget: u64, fixed: u64, slot_bytes: u64, min_slots: u64, needed: u64 },
    #[error("{what} needs {}, the adapter binds at most {}; {advice}", Mib(*needed), Mib(*limit))]
    TableLimit { what: String, needed: u64, limit: u64, advice: String },
    #[error("the scene cannot be drawn on the GPU: {reason}")]
    Scene { reason: String },
    #[error("{key} cannot be inserted: {reason}")]
    Brick { key: BrickKey, reason: String },
    #[error("all {slots} slots hold bricks that are wanted in this pass; no room for {key}")]
    NoRoom { key: BrickKey, slots: usize },
}
