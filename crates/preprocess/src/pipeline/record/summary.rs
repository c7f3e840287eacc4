//! Report of a finished build.

use supervol_sources::Message;

use std::time::Instant;

use super::Written;
use super::manifest::bounded_notes;
use crate::pipeline::options::Reduce;
use crate::pipeline::plan::BuildPlan;
use crate::pipeline::plan::labels::Labels;
use crate::pipeline::plan::max_error::MaxError;
use crate::report::{BuildNote, BuildReport};

/// Report of a finished build: sizes, times and notes.
pub(crate) fn report_of(
    plan: &BuildPlan<'_>,
    written: Written,
    source_notes: &[Message],
    started: Instant,
) -> BuildReport {
    let BuildPlan { descriptor, memory, .. } = plan;
    let Written { levels, container_bytes, restored } = written;
    let notes = notes_of(plan, source_notes, restored);
    let source_bytes = descriptor.dims().bytes(descriptor.voxel_type).unwrap_or(u64::MAX);
    let wall = started.elapsed().as_secs_f64();
    BuildReport {
        bricks: levels.iter().map(|l| l.bricks).sum(),
        levels,
        source_bytes,
        container_bytes,
        memory_budget_bytes: memory.budget_bytes,
        memory_planned_bytes: memory.planned_bytes(),
        threads: memory.threads,
        wall_ms: wall * 1e3,
        bytes_per_second: source_bytes as f64 / wall,
        notes,
    }
}

/// Notes of the source's reader, and choices of the build.
fn notes_of(plan: &BuildPlan<'_>, source_notes: &[Message], restored: u64) -> Vec<BuildNote> {
    let BuildPlan { options, descriptor, labels, reduce, memory, .. } = plan;
    let mut notes: Vec<BuildNote> = bounded_notes(source_notes).into_iter().map(BuildNote::Reader).collect();
    let is_labels = *labels != Labels::None;
    if is_labels && *reduce == Reduce::Majority {
        notes.push(BuildNote::Labels);
    }
    if descriptor.quantizer.is_some() {
        notes.push(BuildNote::Changed { error: descriptor.voxel_error() * descriptor.scale.abs() });
    } else if options.max_error != MaxError::Exact {
        notes.push(if is_labels || *reduce == Reduce::Majority {
            BuildNote::LabelsUnchanged
        } else {
            BuildNote::Unchanged
        });
    }
    if memory.threads < options.threads {
        notes.push(BuildNote::FewerThreads { threads: memory.threads, requested: options.threads });
    }
    if restored > 0 {
        notes.push(BuildNote::Continued { bricks: restored, bricks_total: descriptor.pyramid.brick_count() });
    }
    notes
}
