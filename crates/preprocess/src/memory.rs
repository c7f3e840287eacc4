//! How the bytes of `--memory` are divided. Everything that grows with the volume, the bricks or the threads is here.
//!
//! | part | bytes |
//! |---|---|
//! | entry table | 80 per brick, until the container is finished |
//! | workspaces | per thread [`WORKSPACE_COPIES`] stored bricks (cut, predicted, byte planes, encoded, ...) |
//! | statistics | per thread one histogram of 64 Ki counters, and one |
//! | brick cache | a sixteenth of the whole: decoded bricks of the finer level |
//! | tiles | the rest: [`TILES_IN_FLIGHT`] tiles of the level being read, with what is made of them |

use supervol_format::brick::APRON;
use supervol_format::container::toc::ENTRY_BYTES;
use supervol_format::{Level, Pyramid, VoxelType};

use crate::error::BuildError;
use crate::statistics::KEYS;

/// Stored bricks of scratch memory that one thread may need at once.
const WORKSPACE_COPIES: u64 = 6;
/// Two tiles in the air (one being read, one being encoded), its coarser half, and its encoded bricks.
const TILES_IN_FLIGHT: f64 = 3.6;

/// The division of one build's memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryPlan {
    /// What the user allowed.
    pub budget_bytes: u64,
    /// Entry table, workspaces and statistics.
    pub fixed_bytes: u64,
    /// Decoded bricks of the finer level.
    pub cache_bytes: u64,
    /// Largest tile.
    pub tile_bytes: u64,
}

impl MemoryPlan {
    /// Divides `budget_bytes`.
    ///
    /// # Errors
    /// If not even the smallest tile fits, with what would.
    pub fn new(
        budget_bytes: u64,
        threads: usize,
        pyramid: &Pyramid,
        voxel_type: VoxelType,
    ) -> Result<Self, BuildError> {
        let stored = pyramid.layout().stored() as u64;
        let brick = stored.pow(3) * voxel_type.bytes() as u64;
        let table = pyramid.brick_count() * ENTRY_BYTES as u64;
        let workspaces = threads as u64 * WORKSPACE_COPIES * brick;
        let statistics = (threads as u64 + 1) * KEYS as u64 * 8;
        let fixed_bytes = table + workspaces + statistics;
        let cache_bytes = budget_bytes / 16;
        let tile_bytes = (budget_bytes.saturating_sub(fixed_bytes + cache_bytes) as f64 / TILES_IN_FLIGHT) as u64;
        let smallest = pyramid.levels().iter().enumerate().map(|(lod, level)| {
            let finer = if lod == 0 { [1; 3] } else { level.factors };
            read_bytes(pyramid, level, finer, [1; 3], voxel_type)
        });
        let smallest = smallest.max().expect("a pyramid has levels");
        if tile_bytes < smallest {
            let needed = ((smallest as f64 * TILES_IN_FLIGHT) as u64 + fixed_bytes) * 16 / 15 + 1;
            let mib = |b: u64| format!("{} MiB", b.div_ceil(1 << 20));
            return Err(BuildError::Memory {
                needed: mib(needed),
                allowed: mib(budget_bytes),
                what: format!(
                    "{} for the table of {} bricks, {} for {threads} threads, the rest for tiles of one brick",
                    mib(table),
                    pyramid.brick_count(),
                    mib(workspaces + statistics)
                ),
                advice: "Allow more with --memory, or use smaller bricks (--brick) or fewer threads (--threads)".into(),
            });
        }
        Ok(Self { budget_bytes, fixed_bytes, cache_bytes, tile_bytes })
    }

    /// What the parts add up to, bytes.
    #[must_use]
    pub fn planned_bytes(&self) -> u64 {
        self.fixed_bytes + self.cache_bytes + (self.tile_bytes as f64 * TILES_IN_FLIGHT) as u64
    }
}

/// Bytes to read for a tile of `size` bricks of a level: its voxels with apron, times the factors to the finer level
/// that they are averages of (all 1 at level 0, which is read as it is).
#[must_use]
pub fn read_bytes(pyramid: &Pyramid, level: &Level, factors: [u32; 3], size: [u32; 3], voxel_type: VoxelType) -> u64 {
    let core = pyramid.layout().core() as u64;
    let voxels: u64 = (0..3)
        .map(|a| {
            let stored = (u64::from(size[a]) * core + 2 * APRON as u64).min(level.dims.0[a]);
            stored * u64::from(factors[a])
        })
        .product();
    voxels * voxel_type.bytes() as u64
}
