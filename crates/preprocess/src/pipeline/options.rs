//! Options of a build.

use supervol_files::Existing;
use supervol_format::BrickLayout;
use supervol_format::canceller::Canceller;
use supervol_format::codec::CodecChoice;

use super::plan::lod_axes::LodAxes;
use super::plan::max_error::MaxError;
use crate::report::Progress;

/// Options of a build.
#[derive(Debug, Clone)]
pub struct BuildOptions {
    /// Size of the bricks.
    pub layout: BrickLayout,
    /// Codecs that may be used.
    pub codec: CodecChoice,
    /// Largest allowed error of a voxel. Labels are never changed.
    pub max_error: MaxError,
    /// Axes that coarser levels halve.
    pub lod_axes: LodAxes,
    /// Kind of data by its name in `supervol_scene::facts::DataKind`. `None`: labels are recognised
    /// ([`super::plan::labels`]), and viewers recognise the other kinds.
    pub kind: Option<String>,
    /// Operation that makes one voxel of several in coarser levels. `None` selects the majority for labels and the mean
    /// for all other data.
    pub reduce: Option<Reduce>,
    /// Memory limit in bytes.
    pub memory_bytes: u64,
    /// Largest number of encoding threads. Fewer are started if the memory does not suffice for all.
    pub threads: usize,
    /// Rule for an output that exists already.
    pub existing: Existing,
    /// Stops the build from another thread.
    pub canceller: Canceller,
}

/// Bricks of 64, the smallest codec, no error, levels by measurement, 1 GiB, all processors, nothing overwritten.
impl Default for BuildOptions {
    fn default() -> Self {
        Self {
            layout: BrickLayout::DEFAULT,
            codec: CodecChoice::Smallest,
            max_error: MaxError::Exact,
            lod_axes: LodAxes::Auto,
            kind: None,
            reduce: None,
            memory_bytes: 1 << 30,
            threads: std::thread::available_parallelism().map_or(1, std::num::NonZero::get),
            existing: Existing::Keep,
            canceller: Canceller::default(),
        }
    }
}

/// Callback for progress. Any thread may call it, many times a second.
pub type OnProgress<'a> = &'a (dyn Fn(Progress) + Sync);

/// Operation that makes one voxel of several.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Reduce {
    /// The mean: for measured data.
    #[default]
    Mean,
    /// The greatest value: bright structures are kept and grow.
    Max,
    /// The most frequent value (on a tie the least): for labels, whose means would be other labels.
    Majority,
}

impl Reduce {
    /// All operations.
    pub const ALL: [Self; 3] = [Self::Mean, Self::Max, Self::Majority];

    /// Name in manifests and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mean => "mean",
            Self::Max => "max",
            Self::Majority => "majority",
        }
    }
}
