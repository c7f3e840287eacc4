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
    /// Notes of the source's reader, and choices of the build that the caller should know.
    pub notes: Vec<BuildNote>,
}

/// Note on a finished build. Its text names options of [`BuildOptions`](crate::BuildOptions).
#[derive(Debug, Clone, PartialEq)]
pub enum BuildNote {
    /// A note of the source's reader, or the number of further ones.
    Reader(String),
    /// The voxels look like labels, so coarser levels have the most frequent value.
    Labels,
    /// Voxels were changed.
    Changed {
        /// Largest error of a voxel in data units.
        error: f64,
    },
    /// An error was allowed, but labels are never changed.
    LabelsUnchanged,
    /// An error was allowed, but it is too small to change voxels.
    Unchanged,
    /// The memory suffices for some threads only.
    FewerThreads {
        /// Number of threads used.
        threads: usize,
        /// Number of threads requested.
        requested: usize,
    },
    /// The build continued an interrupted one.
    Continued {
        /// Number of bricks of the interrupted build.
        bricks: u64,
        /// Number of bricks of the container.
        bricks_total: u64,
    },
}

impl std::fmt::Display for BuildNote {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Reader(note) => f.write_str(note),
            Self::Labels => f.write_str(
                "these are labels: coarser levels hold the most frequent one, not the mean (option `reduce`)",
            ),
            Self::Changed { error } => write!(f, "voxels are within {error} of the source's (option `max_error`)"),
            Self::LabelsUnchanged => f.write_str("labels are kept as they are: the option `max_error` is not applied"),
            Self::Unchanged => {
                f.write_str("voxels cannot be moved by so little: the option `max_error` is not applied")
            }
            Self::FewerThreads { threads, requested } => {
                write!(f, "the option `memory_bytes` suffices for {threads} of {requested} threads")
            }
            Self::Continued { bricks, bricks_total } => {
                write!(f, "went on with a build that was interrupted: {bricks} of {bricks_total} bricks were there")
            }
        }
    }
}

/// A note is written as its text.
impl Serialize for BuildNote {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}
