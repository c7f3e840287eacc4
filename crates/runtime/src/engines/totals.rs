//! Sums over a picture, and the errors that an engine states of it.

use crate::stream::counters::{DeviceCounters, RayCounters};

/// What an engine has done and knows, over all passes and bands.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EngineTotals {
    /// What was counted; an engine without rays counts none, and samples and cells all the same.
    pub rays: RayCounters,
    /// Instructions of packets.
    pub instructions: Option<&'static str>,
    /// What the picture may be off by, where the engine was asked to sum it up and can.
    pub errors: Option<EngineErrors>,
    /// What its graphics device did for this picture, if it has one.
    pub device: Option<GpuStats>,
}

/// What the device holds, and what it did since the renderer was made.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GpuStats {
    /// Name and kind of the adapter.
    pub adapter: String,
    /// Bytes planned, all of them allocated.
    pub planned_bytes: u64,
    /// Slots in all.
    pub slots: u64,
    /// Slots that hold a brick.
    pub slots_used: u64,
    /// The slowest dispatch of the picture.
    pub dispatch_ms_max: f64,
    /// What it did.
    pub counters: DeviceCounters,
}

/// What an engine says of its own errors; 1 is white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EngineErrors {
    /// The greatest sum, over all rays, of what cells may be off by.
    pub cells: f64,
    /// Most that coarser levels may do to a ray, against the finest.
    pub levels: f64,
    /// Most that is left out behind the end of a ray that ends early.
    pub ray_ends: f64,
    /// What the fit of the transfer function may do to a ray.
    pub transfer_function: f64,
    /// What sums of `f32` over the cells of a brick may do to a ray.
    pub rounding: f64,
}

/// What rays may be off by at most, reason by reason; 1 is white.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ErrorsByReason {
    /// Integration of cells.
    pub cells: f64,
    /// Coarser levels.
    pub levels: f64,
    /// Whether a voxel may be there in one level and not in the other.
    pub presence_may_change: bool,
}

impl ErrorsByReason {
    /// The greater of both.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            cells: self.cells.max(other.cells),
            levels: self.levels.max(other.levels),
            presence_may_change: self.presence_may_change | other.presence_may_change,
        }
    }
}
