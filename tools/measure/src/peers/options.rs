//! Options of a measurement.

use std::path::PathBuf;
use std::time::Duration;

use crate::context::Scale;
use crate::volume::HOST_MEMORY_BYTES;

/// Options of the measurement.
#[derive(Debug, Clone)]
pub struct Run {
    /// Threads of each program; at least 1.
    pub threads: usize,
    /// Whether Supervol also samples like the peer.
    pub same_sampling: SameSampling,
    /// Sizes and repeats.
    pub sizes: Sizes,
}

/// Whether Supervol also draws each picture with the peer's sampling: samples at equal distances.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SameSampling {
    /// Supervol's default only.
    #[default]
    No,
    /// Supervol's default, and the peer's sampling.
    Yes,
}

/// Python and environment of the peer.
#[derive(Debug, Clone)]
pub struct PeerOptions {
    /// Python that makes the environment.
    pub python: PathBuf,
    /// Folder of the environment; created if needed.
    pub environment: PathBuf,
}

/// Sizes of a run.
#[derive(Debug, Clone)]
pub struct Sizes {
    /// Number of timed pictures per row, after the first; at least 1.
    pub repeats: usize,
    /// Time limit after which no further picture of a row is timed.
    pub row_limit: Duration,
    /// Width and height of the pictures, pixels.
    pub image: [u32; 2],
    /// Number of pixels that are compared with the reference.
    pub error_pixels: usize,
    /// Steps of the peer, in smallest voxel spacings.
    pub steps_voxels: Vec<f64>,
    /// Memory limit of Supervol's pictures, bytes.
    pub host_memory_bytes: u64,
}

impl Sizes {
    /// Sizes of a scale.
    #[must_use]
    pub fn of(scale: Scale) -> Self {
        let (repeats, image, error_pixels) = match scale {
            Scale::Full => (5, [1024, 768], 1000),
            Scale::Small => (3, [160, 120], 300),
        };
        Self {
            repeats,
            row_limit: Duration::from_secs(60),
            image,
            error_pixels,
            steps_voxels: vec![1.0],
            host_memory_bytes: HOST_MEMORY_BYTES,
        }
    }
}
