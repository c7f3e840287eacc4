//! Report of a finished build.

use std::time::Instant;

use supervol_format::container::header::Descriptor;

use super::Written;
use super::manifest::bounded_notes;
use crate::pipeline::options::Reduce;
use crate::pipeline::plan::BuildPlan;
use crate::pipeline::plan::max_error::MaxError;
use crate::report::BuildReport;

/// Report of a finished build: sizes, times and notes.
pub(crate) fn report_of(
    plan: &BuildPlan<'_>,
    written: Written,
    source_notes: &[String],
    started: Instant,
) -> BuildReport {
    let BuildPlan { descriptor, memory, .. } = plan;
    let Written { levels, container_bytes, restored } = written;
    let mut notes = notes_of(plan, source_notes);
    notes.extend(note_of_restored(restored, descriptor));
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

/// Note for a build that continued an interrupted one.
fn note_of_restored(restored: u64, descriptor: &Descriptor) -> Option<String> {
    let total = descriptor.pyramid.brick_count();
    let note = || format!("went on with a build that was interrupted: {restored} of {total} bricks were there");
    (restored > 0).then(note)
}

/// Notes of the source's reader and of the choices that the build made.
fn notes_of(plan: &BuildPlan<'_>, source_notes: &[String]) -> Vec<String> {
    let BuildPlan { options, descriptor, reduce, memory, .. } = plan;
    let mut notes = bounded_notes(source_notes);
    if options.reduce.is_none() && *reduce == Reduce::Majority {
        notes.push("these are labels: coarser levels hold the most frequent one, not the mean (--reduce)".into());
    }
    if descriptor.quantizer.is_some() {
        let error = descriptor.voxel_error() * descriptor.scale.abs();
        notes.push(format!("voxels are within {error} of the source's (--max-error)"));
    } else if options.max_error != MaxError::Exact {
        let why = if *reduce == Reduce::Majority {
            "labels are kept as they are"
        } else {
            "voxels cannot be moved by so little"
        };
        notes.push(format!("{why}: --max-error is not applied"));
    }
    if memory.threads < options.threads {
        notes.push(format!("--memory suffices for {} of {} threads", memory.threads, options.threads));
    }
    notes
}
