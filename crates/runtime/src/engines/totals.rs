//! Sums over a picture, and the errors that an engine states of it.

use crate::stream::counters::{DeviceCounters, RayCounters};

/// Counters and errors of an engine, over all passes and bands.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EngineTotals {
    /// Counters of rays. An engine without rays counts no rays, but samples and cells.
    pub rays: RayCounters,
    /// Instructions of packets.
    pub instructions: Option<&'static str>,
    /// Errors of the picture; `None` unless they were requested and the engine can sum them up.
    pub errors: Option<EngineErrors>,
    /// Work of its graphics device for this picture; `None` without a device.
    pub device: Option<GpuStats>,
}

/// Memory of a device, and its work since the renderer was made.
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
    /// Counters of its work.
    pub counters: DeviceCounters,
}

/// Errors that an engine states of its picture; 1 is white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EngineErrors {
    /// Greatest sum of the errors of cells along a ray.
    pub cells: f64,
    /// Largest error of a ray from coarser levels, compared with the finest.
    pub levels: f64,
    /// Largest light that is left out behind the end of a ray.
    pub ray_ends: f64,
    /// Error of a ray from the fit of the transfer function.
    pub transfer_function: f64,
    /// Error of a ray from sums of `f32` over the cells of a brick.
    pub rounding: f64,
}

/// Largest errors of rays by reason; 1 is white.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ErrorsByReason {
    /// Integration of cells.
    pub cells: f64,
    /// Coarser levels.
    pub levels: f64,
    /// Whether a voxel may be present in one level and absent in the other.
    pub presence_may_change: bool,
}

impl EngineErrors {
    /// The greater of both, each.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            cells: self.cells.max(other.cells),
            levels: self.levels.max(other.levels),
            ray_ends: self.ray_ends.max(other.ray_ends),
            transfer_function: self.transfer_function.max(other.transfer_function),
            rounding: self.rounding.max(other.rounding),
        }
    }
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

/// Pixels of a picture that may be off by more than requested, coarser levels apart.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PixelsAbove {
    /// Whether a pixel is one, row by row from the top.
    pub(crate) is_above: Vec<bool>,
    /// Largest errors of all other rays.
    pub(crate) within: ErrorsByReason,
    /// Totals of the picture, with these errors.
    pub(crate) totals_within: EngineTotals,
}
