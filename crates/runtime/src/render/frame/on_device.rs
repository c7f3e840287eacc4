//! A picture that a device is to make, and one that it has made.
#![cfg_attr(not(feature = "gpu"), allow(dead_code, reason = "builds without a device make no such picture"))]

use std::time::Duration;

use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

#[cfg(feature = "gpu")]
use crate::engines::gpu::engine::WhenToStop;
use crate::engines::maps::Maps;
use crate::engines::totals::{ErrorsByReason, PixelsAbove};
use crate::render::options::RenderOptions;
use crate::render::stats::FrameStats;
use crate::stop::{Stop, WhenDue};
use crate::stream::budget::{EngineBytes, HostPlan, PIXEL_BYTES, RAY_BYTES};

/// Input of a picture.
pub(crate) struct GpuPicture<'a> {
    pub(crate) scene: &'a ResolvedScene,
    pub(crate) options: &'a RenderOptions,
    pub(crate) plan: HostPlan,
    pub(crate) stop: &'a Stop,
    /// Handling of rays that wait when `stop` is due. A pause is reported as [`RenderError::Cancelled`].
    pub(crate) when_due: WhenDue,
    /// Cost of the earlier pictures of the same scene.
    pub(crate) before: FrameStats,
    /// The largest picture of the scene: rays along x and y, and whether it is asked what they may be off by.
    pub(crate) room: ([u32; 2], bool),
}

/// A finished picture.
pub(crate) struct GpuDrawn {
    pub(crate) image: Image,
    pub(crate) stats: FrameStats,
    /// Requested maps of its pixels.
    pub(crate) maps: Maps,
    /// Largest errors of its rays, if requested.
    pub(crate) errors: ErrorsByReason,
    /// Pixels that may be off by more than requested, if errors are summed up and there are some.
    pub(crate) above: Option<PixelsAbove>,
    /// Time that went into fetching bricks.
    pub(crate) fetching: Duration,
}

#[cfg(feature = "gpu")]
impl GpuPicture<'_> {
    /// Stop condition of its rays.
    pub(super) fn stops(&self) -> WhenToStop {
        WhenToStop { stop: self.stop.clone(), when_due: self.when_due }
    }
}

/// Bytes per pixel of the error that a device states, and of a copy to hand out.
const STATED_BYTES: u64 = 2 * PIXEL_BYTES;
/// Bytes per pixel of the mark that the CPU is to cast it again.
const MARK_BYTES: u64 = 1;

/// Host memory of a picture by a device, which casts all rays at once, whatever the bands are. The CPU casts the rays again that the device may have wrong by more than requested; `core`:
/// voxels along an edge of a full brick's core.
pub(crate) fn device_bytes(options: &RenderOptions, core: usize) -> EngineBytes {
    let by_cpu = options.ray_caster().bytes(core);
    EngineBytes { of_pixel: by_cpu.of_pixel.max(STATED_BYTES) + MARK_BYTES, of_ray: RAY_BYTES, ..by_cpu }
}
