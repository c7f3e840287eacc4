//! Progress of a build: counts, and calls of the progress callback.

use std::sync::{Mutex, PoisonError};

use supervol_format::cast::whole;
use supervol_format::container::header::Descriptor;
use supervol_format::{Level, Lod};

use super::restore::Restored;
use crate::pipeline::options::OnProgress;
use crate::report::Progress;

/// Counts finished bricks and bytes, and calls the progress callback.
pub(super) struct ProgressCounter<'a> {
    on_progress: OnProgress<'a>,
    state: Mutex<Progress>,
}

impl<'a> ProgressCounter<'a> {
    /// Counter for a container with this description.
    pub(super) fn new(descriptor: &Descriptor, on_progress: OnProgress<'a>) -> Self {
        let levels = descriptor.pyramid.levels();
        let bytes = |l: &Level| l.dims.bytes(descriptor.voxel_type).unwrap_or(u64::MAX);
        // Each level but the last counts twice: once for itself, once for the next coarser one.
        let bytes_total = levels.iter().take(levels.len() - 1).map(bytes).fold(bytes(&levels[0]), u64::saturating_add);
        let bricks_total = descriptor.pyramid.brick_count();
        let start =
            Progress { level: 0, levels: levels.len(), bricks_done: 0, bricks_total, bytes_done: 0, bytes_total };
        Self { on_progress, state: Mutex::new(start) }
    }

    /// The counts so far.
    pub(super) fn now(&self) -> Progress {
        *self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Counts the restored tiles of an interrupted build as done.
    pub(super) fn restore(&self, levels: &[Restored], descriptor: &Descriptor) {
        for (lod, level) in descriptor.pyramid.lods().zip(levels) {
            let of_level = descriptor.pyramid.level_at(lod);
            let bytes = of_level.dims.bytes(descriptor.voxel_type).unwrap_or(u64::MAX);
            let share = level.report.bricks as f64 / of_level.brick_count() as f64;
            self.add(lod, level.report.bricks, whole(bytes as f64 * share));
        }
    }

    /// Counts bricks of a level, and the bytes of voxels that they were made of.
    pub(super) fn add(&self, lod: Lod, bricks: u64, bytes: u64) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.level = usize::from(lod.0);
        state.bricks_done += bricks;
        // Aprons are read more than once, but the total counts them once.
        state.bytes_done = (state.bytes_done + bytes).min(state.bytes_total);
        (self.on_progress)(*state);
    }
}
