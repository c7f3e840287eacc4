//! What a build did, and how far it is.

use serde::Serialize;

/// Where a build is. Bytes count decoded voxels read, over all levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Progress {
    /// Level being written.
    pub level: usize,
    /// Number of levels.
    pub levels: usize,
    /// Bricks written so far.
    pub bricks_done: u64,
    /// Bricks there will be.
    pub bricks_total: u64,
    /// Bytes read so far.
    pub bytes_done: u64,
    /// Bytes there are to read.
    pub bytes_total: u64,
}

/// One level of a finished build.
#[derive(Debug, Clone, PartialEq, Serialize, Default)]
pub struct LevelReport {
    /// 1 or 2 per axis against the next finer level.
    pub factors: [u32; 3],
    /// Voxels.
    pub dims: [u64; 3],
    /// Number of bricks.
    pub bricks: u64,
    /// Bricks of one value.
    pub uniform_bricks: u64,
    /// Bricks without data.
    pub absent_bricks: u64,
    /// Bricks by codec: raw, rle, zstd, wavelet, trimmed.
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
    /// Largest error bound, data units.
    pub error: f64,
}

/// What a build did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BuildReport {
    /// Finest first.
    pub levels: Vec<LevelReport>,
    /// Bytes of level 0 as plain voxels.
    pub source_bytes: u64,
    /// Bytes of the container.
    pub container_bytes: u64,
    /// Bricks of all levels.
    pub bricks: u64,
    /// Memory that was allowed, bytes.
    pub memory_budget_bytes: u64,
    /// Memory that the plan added up to, bytes.
    pub memory_planned_bytes: u64,
    /// Threads used.
    pub threads: usize,
    /// Wall time, milliseconds.
    pub wall_ms: f64,
    /// Level-0 bytes per second of wall time.
    pub bytes_per_second: f64,
    /// What the reader of the source noticed.
    pub notes: Vec<String>,
}
