//! Progress and report of a build.

use serde::Serialize;

/// Progress of a build. Bytes count decoded voxels read, over all levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Progress {
    /// Level being written.
    pub level: usize,
    /// Number of levels.
    pub levels: usize,
    /// Number of bricks written so far.
    pub bricks_done: u64,
    /// Number of bricks of the container.
    pub bricks_total: u64,
    /// Bytes read so far.
    pub bytes_done: u64,
    /// Bytes to read in total.
    pub bytes_total: u64,
}

/// One level of a finished build.
#[derive(Debug, Clone, PartialEq, Serialize, Default)]
pub struct LevelReport {
    /// 1 or 2 per axis: voxels of the next finer level per voxel of this one.
    pub factors: [u32; 3],
    /// Size of the level in voxels.
    pub dims: [u64; 3],
    /// Number of bricks.
    pub bricks: u64,
    /// Number of bricks with one value.
    pub uniform_bricks: u64,
    /// Number of bricks without data.
    pub absent_bricks: u64,
    /// Number of bricks by codec: raw, rle, zstd, wavelet, trimmed.
    pub raw_bricks: u64,
    /// See `raw_bricks`.
    pub rle_bricks: u64,
    /// See `raw_bricks`.
    pub zstd_bricks: u64,
    /// See `raw_bricks`.
    pub wavelet_bricks: u64,
    /// See `raw_bricks`.
    pub trimmed_bricks: u64,
    /// Bytes of payloads and macro cells.
    pub bytes: u64,
    /// Largest error bound in data units.
    pub error: f64,
}

/// Report of a finished build.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BuildReport {
    /// The levels, finest first.
    pub levels: Vec<LevelReport>,
    /// Size of level 0 as plain voxels in bytes.
    pub source_bytes: u64,
    /// Size of the container in bytes.
    pub container_bytes: u64,
    /// Number of bricks of all levels.
    pub bricks: u64,
    /// Memory limit in bytes.
    pub memory_budget_bytes: u64,
    /// Planned memory in bytes.
    pub memory_planned_bytes: u64,
    /// Number of threads used.
    pub threads: usize,
    /// Wall time in milliseconds.
    pub wall_ms: f64,
    /// Level-0 bytes per second of wall time.
    pub bytes_per_second: f64,
    /// Observations of the source's reader.
    pub notes: Vec<String>,
}
