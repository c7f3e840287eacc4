//! Memory and precision that a renderer on a device may use.

use crate::engines::packets::PacketRule;
use crate::stream::classify::Skipping;

/// Limits and precision of a renderer on a device.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GpuOptions {
    /// Bytes of GPU memory in all: cache, tables, rays, staging.
    pub memory_bytes: u64,
    /// Whether macro cells that cannot change the picture are skipped.
    pub skipping: Skipping,
    /// Requested error of a pixel channel in mode `dvr`, 1 is white; clamped to
    /// [`MAX_ERROR_LIMITS`](crate::engines::rules::MAX_ERROR_LIMITS).
    pub max_error: f64,
    /// Whether there is room to sum up errors of rays.
    pub sums_errors: bool,
    /// Rays along x and y of the largest picture for which there is room; `None`: the first one's.
    pub room: Option<[u32; 2]>,
}

impl Default for GpuOptions {
    fn default() -> Self {
        Self {
            memory_bytes: 1 << 30,
            skipping: Skipping::On,
            max_error: PacketRule::DEFAULT.max_error,
            sums_errors: false,
            room: None,
        }
    }
}
