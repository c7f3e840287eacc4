//! Regimes of streaming: too little memory, failing sources, huge volumes, fast frames.
//!
//! Nearly all use [`crate::virtual_volume`], so the container can have any size and every byte is known. `session`
//! keeps a streamer over several frames, as a viewer does. `sources` counts, delays and damages reads.

mod cache;
mod coordinates;
mod determinism;
mod device;
mod long_run;
mod planner;
mod read_errors;
pub(crate) mod session;
mod sources;

use crate::stability::regime::Regime;

/// S32 to S35, S39 to S42, S44, S48.
pub const REGIMES: &[Regime] = &[
    cache::SMALL_CACHE,
    cache::STARVATION,
    planner::PLANNER_COST,
    planner::FLY_THROUGH,
    coordinates::HUGE_COORDINATES,
    determinism::EDITS_WHILE_LOADING,
    read_errors::READ_ERRORS,
    device::DEVICE_LOSS,
    determinism::DETERMINISM,
    long_run::LONG_RUN,
];
