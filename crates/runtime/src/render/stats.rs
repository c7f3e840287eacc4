//! Statistics of one frame: one flat JSON object, units in the names.
//!
//! The names are a contract with readers of `--stats` files: none is renamed, new ones may be added. Headless runs,
//! benchmarks and the viewer read this one struct. Counters stand beside the code they measure; this module only
//! gathers them.

use std::collections::BTreeMap;

use serde::Serialize;
use supervol_format::cast::narrow;
use supervol_format::{Lod, ValueRange};
use supervol_scene::scene::Mode;

use crate::engines::totals::EngineTotals;
use crate::render::accuracy::check::ErrorMeasured;
use crate::render::accuracy::predict::ErrorPredicted;
use crate::render::accuracy::stated::ErrorStated;
use crate::stream::counters::{DeviceCounters, RayCounters, StreamCounters};
use crate::stream::state::{Failure, StateKind};
use crate::stream::streamer::Streamer;

/// [`FrameStats::backend`] of pictures by an engine of the caller.
pub(crate) const OUTSIDE_ENGINE: &str = "engine";

/// Statistics of one frame.
#[derive(Debug, Clone, PartialEq, Serialize, Default)]
pub struct FrameStats {
    /// Pixels along x.
    pub image_width: u32,
    /// Pixels along y.
    pub image_height: u32,
    /// `cpu`, `gpu` or `reference`; `engine` for an engine of the caller.
    pub backend: &'static str,
    /// Reason why backend `auto` took no graphics device; null if it did, or for other backends.
    pub no_gpu_because: Option<String>,
    /// Whether the graphics adapter is software, which is many times slower than the CPU backend.
    pub adapter_is_software: bool,
    /// Instruction set of ray packets; null if there were none.
    pub instructions: Option<&'static str>,
    /// Name of the graphics adapter; null without one.
    pub adapter: Option<String>,
    /// Threads that cast and decoded.
    pub threads: usize,
    /// `dvr`, `mip`, ...
    pub mode: &'static str,
    /// The fixed level of detail; null if levels were chosen brick by brick.
    pub level: Option<u8>,
    /// Whether every ray was finished with the bricks it wanted, and no brick failed.
    pub converged: bool,
    /// Times the rays were cast.
    pub passes: u64,
    /// Bands of rows that the picture was cast in.
    pub bands: u64,
    /// Bricks of the container, all levels.
    pub bricks_total: u64,
    /// Bricks by state at the end of the frame, without those never met.
    pub bricks_by_state: BTreeMap<&'static str, u64>,
    /// The same by level, finest first.
    pub bricks_by_level: Vec<LevelStats>,
    /// Counters of streaming; from a renderer with several pictures, since the scene was set.
    #[serde(flatten)]
    pub streaming: StreamCounters,
    /// Wall time of casting rays.
    pub render_ms: f64,
    /// Wall time of the whole frame.
    pub total_ms: f64,
    /// Wall time from the start of the program until the picture's file is whole; 0 if no command writes one.
    pub handed_over_ms: f64,
    /// Processor time of the process during the frame; 0 if the system does not tell.
    pub cpu_ms: f64,
    /// Peak resident memory of the process; 0 if the system does not tell.
    pub peak_rss_bytes: u64,
    /// Bytes of bricks in the host cache at the end of the frame.
    pub host_cache_bytes: u64,
    /// Most bytes of bricks in the host cache at once.
    pub host_cache_peak_bytes: u64,
    /// Bytes that the host cache may hold, and with it the unpacked bricks beside it.
    pub host_cache_budget_bytes: u64,
    /// Most bytes of unpacked bricks beside the host cache at once; 0 while bricks are plain.
    pub host_unpacked_peak_bytes: u64,
    /// Bytes that the frame may hold in host memory.
    pub host_budget_bytes: u64,
    /// Bytes held on the graphics device.
    pub gpu_bytes: u64,
    /// Bytes that the frame may hold on the graphics device.
    pub gpu_budget_bytes: u64,
    /// Counters of the graphics device.
    #[serde(flatten)]
    pub device: DeviceCounters,
    /// Longest dispatch on the graphics device.
    pub gpu_dispatch_ms_max: f64,
    /// The driver's message, if the graphics device was lost and another one drew the picture; null if none was lost.
    pub gpu_lost_because: Option<String>,
    /// Counters of the picture's rays.
    #[serde(flatten)]
    pub casting: RayCounters,
    /// Times a ray took a coarser brick than it wanted.
    pub fallbacks: u64,
    /// Bricks that rays waited for at the deadline.
    pub bricks_missing_at_deadline: u64,
    /// Pixels unfinished at the deadline; they are taken from a picture of larger pixels.
    pub pixels_unfinished: u64,
    /// Edge of a pixel of that picture, in pixels; 0 if all are finished.
    pub coarsest_pixel: u32,
    /// Pixels that the CPU cast again, because the graphics device might be off by more than `max_error_requested`.
    pub pixels_cast_again: u64,
    /// Bricks that failed.
    pub bricks_failed: u64,
    /// The first failures.
    pub failures: Vec<Failure>,
    /// Requested error, a share of full scale. If levels are chosen automatically, it bounds the error from levels,
    /// provided that `bricks_without_bound` is 0.
    pub max_error_requested: f64,
    /// Bound on |drawn level - level 0| over all bricks that rays met and drew, data units; it covers visible and
    /// invisible values. Beside holes it holds where both levels are present. On a graphics device, it leaves out
    /// uniform bricks that no ray waited for. If a brick failed, it is the width of the range of all values.
    pub error_bound: f64,
    /// Bricks drawn from coarser levels without a bound of their effect on the picture. Reasons: their voxels are small
    /// against a pixel (`lod::by_error`, rule 3), they stand in for finer ones, or the level was requested. On a
    /// graphics device, uniform bricks are not counted.
    pub bricks_without_bound: u64,
    /// Levels of all bricks that rays met and drew, finest first. Empty for the reference integrator. On a graphics
    /// device, levels of which only uniform bricks were drawn may lack.
    pub levels_drawn: Vec<u8>,
    /// Pieces of rays at which the reference integrator did not converge.
    pub reference_capped_pieces: u64,
    /// Predicted distance from the exact picture, term by term, each with a flag whether it is a bound. For pictures in
    /// mode `dvr` by packets of rays, or by a graphics device if the transfer function has no steps. Null for others,
    /// and if not requested.
    pub error_predicted: Option<ErrorPredicted>,
    /// Stated distance of each pixel from the exact picture of the finest level, for any requested level and any
    /// progress. For pictures by packets of rays or by a graphics device. Null for others, and if not requested.
    pub error_stated: Option<ErrorStated>,
    /// Measured distance from the exact picture; null if not requested.
    pub error_measured: Option<ErrorMeasured>,
}

/// Bricks of one level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct LevelStats {
    /// Level of detail; 0 is the finest.
    pub level: usize,
    /// Bricks in the host cache at the end of the frame.
    pub resident: u64,
    /// Bricks known to have one value.
    pub uniform: u64,
    /// Bricks known to show nothing.
    pub nothing: u64,
    /// Bricks that would change the picture too much, so that finer ones are drawn.
    pub too_coarse: u64,
    /// Bricks that failed.
    pub failed: u64,
    /// Bricks that came into the host cache.
    pub page_ins: u64,
    /// Bytes of records read.
    pub bytes_read: u64,
}

/// Name of a mode in scene files.
#[must_use]
pub fn mode_name(mode: Mode) -> &'static str {
    match mode {
        Mode::Dvr => "dvr",
        Mode::Mip => "mip",
        Mode::Minip => "minip",
        Mode::Mean => "mean",
        Mode::Iso => "iso",
        Mode::Slice => "slice",
    }
}

impl FrameStats {
    /// The same, with the effect of failed bricks: the parts drawn in their place are not the requested picture.
    #[must_use]
    pub fn with_failures(mut self, values: ValueRange) -> Self {
        if self.bricks_failed > 0 {
            self.converged = false;
            self.error_bound = self.error_bound.max(values.width());
        }
        self
    }

    /// Whether all wanted bricks failed, so that nothing can be drawn.
    #[must_use]
    pub fn has_nothing_but_failures(&self) -> bool {
        let are_there = |kind: StateKind| self.bricks_by_state.get(kind.name()).is_some_and(|&n| n > 0);
        self.bricks_failed > 0
            && self.streaming.page_ins == 0
            && !are_there(StateKind::InHost)
            && !are_there(StateKind::Uniform)
    }

    /// The same without earlier costs of streaming: page-ins, evictions, reads and decoding.
    #[must_use]
    pub fn since(mut self, before: &Self) -> Self {
        // Nothing to subtract before anything was gathered.
        if self.bricks_total == 0 {
            return self;
        }
        self.streaming = self.streaming.since(&before.streaming);
        for (level, before) in self.bricks_by_level.iter_mut().zip(&before.bricks_by_level) {
            level.page_ins -= before.page_ins;
            level.bytes_read -= before.bytes_read;
        }
        self
    }

    /// Fills in all fields from the streamer.
    pub fn gather_streamer(&mut self, streamer: &Streamer) {
        let (states, cache) = (streamer.states(), streamer.cache());
        let pyramid = streamer.container().pyramid();
        self.bricks_total = pyramid.brick_count();
        let met = StateKind::ALL.into_iter().filter(|&kind| kind != StateKind::Unknown);
        self.bricks_by_state = met.map(|kind| (kind.name(), states.total(kind))).collect();
        self.bricks_by_level = (0..pyramid.levels().len())
            .map(|level| {
                let lod = Lod(narrow::<u8>(level));
                LevelStats {
                    level,
                    resident: states.count(lod, StateKind::InHost),
                    uniform: states.count(lod, StateKind::Uniform),
                    nothing: states.count(lod, StateKind::Nothing),
                    too_coarse: states.count(lod, StateKind::TooCoarse),
                    failed: states.count(lod, StateKind::Failed),
                    page_ins: states.page_ins(lod),
                    bytes_read: streamer.record_bytes(lod),
                }
            })
            .collect();
        self.streaming = streamer.counters();
        self.host_cache_bytes = cache.bytes();
        self.host_unpacked_peak_bytes = streamer.unpacked.peak_bytes();
        self.host_cache_peak_bytes = cache.peak_bytes();
        self.host_cache_budget_bytes = streamer.plan.cache_bytes;
        self.bricks_failed = states.total(StateKind::Failed);
        self.failures = states.failures().to_vec();
        let drawn = streamer.drawn_errors();
        (self.error_bound, self.bricks_without_bound) = (drawn.bound, drawn.without_bound);
        self.levels_drawn = (0..narrow::<u8>(Lod::LIMIT)).filter(|level| drawn.levels >> level & 1 == 1).collect();
    }

    /// Fills in all fields from the engine but its errors.
    pub fn gather_engine(&mut self, totals: EngineTotals) {
        (self.casting, self.instructions) = (totals.rays, totals.instructions);
        if let Some(device) = totals.device {
            self.device = device.counters;
            self.gpu_bytes = device.planned_bytes;
            self.gpu_dispatch_ms_max = device.dispatch_ms_max;
            self.adapter = Some(device.adapter);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every key of a `--stats` file that readers may use: none may be missing, none may hold a nested value.
    const KEYS: &str = "
        image_width image_height backend no_gpu_because adapter_is_software instructions adapter threads
        mode level converged passes bands bricks_total bricks_by_state bricks_by_level uses misses page_ins
        repeated_page_ins evictions cancelled states_forgotten reads merged_reads failed_reads bytes_read
        bytes_decoded bricks_packed bricks_unpacked retried_reads read_ms wait_ms decode_ms plan_ms upload_ms render_ms total_ms handed_over_ms cpu_ms
        peak_rss_bytes host_cache_bytes host_cache_peak_bytes host_cache_budget_bytes host_unpacked_peak_bytes host_budget_bytes
        gpu_bytes gpu_budget_bytes gpu_page_ins gpu_anomalies upload_bytes gpu_written_bytes gpu_read_bytes
        gpu_submits gpu_dispatches gpu_dispatch_ms_max gpu_lost_because rays
        rays_terminated_early samples cells cells_refined cells_exact macro_cells macro_cells_skipped
        fallbacks bricks_missing_at_deadline pixels_unfinished coarsest_pixel pixels_cast_again bricks_failed failures
        max_error_requested error_bound bricks_without_bound levels_drawn reference_capped_pieces error_predicted
        error_stated error_measured
    ";

    #[test]
    fn no_key_of_the_statistics_is_lost_and_each_stands_alone() {
        let json = serde_json::to_value(FrameStats::default()).unwrap();
        let found: Vec<&str> = json.as_object().unwrap().keys().map(String::as_str).collect();
        let mut expected: Vec<&str> = KEYS.split_whitespace().collect();
        expected.sort_unstable();
        assert_eq!(found, expected);
    }

    #[test]
    fn counts_stand_in_the_keys_that_name_them() {
        let stats = FrameStats {
            streaming: StreamCounters { page_ins: 1, wait_ms: 0.5, ..StreamCounters::default() },
            casting: RayCounters { samples: 2, rays_waiting: 3, ..RayCounters::default() },
            device: DeviceCounters { page_ins: 4, anomalies: 5, upload_ms: 6.5, ..DeviceCounters::default() },
            ..FrameStats::default()
        };
        let json = serde_json::to_value(&stats).unwrap();
        assert_eq!((&json["page_ins"], &json["wait_ms"], &json["samples"]), (&1.into(), &0.5.into(), &2.into()));
        assert_eq!(
            (&json["gpu_page_ins"], &json["gpu_anomalies"], &json["upload_ms"]),
            (&4.into(), &5.into(), &6.5.into())
        );
    }
}
