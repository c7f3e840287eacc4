//! One picture: casts it, writes it, and measures its error. `render` and `demo` share it.

use std::num::NonZero;
use std::time::Instant;

use supervol::{
    EngineError, Error, ErrorKind, FrameStats, GpuError, Options, RenderError, errors_in_colors, work_in_colors,
};
use supervol_arguments::failure::Failure;
use supervol_arguments::quantity::show_bytes;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::scene::ResolvedScene;

use crate::failed_bricks::check_any_read;
use crate::look::warnings;
use crate::prove::with_ray_bar;
use crate::written::{Finished, PictureOutputs, Subject, warn};

/// Part of a time budget, in milliseconds, for the work after casting: stating errors, conversion to bytes, writing
/// the file. Measured: 60 to 90 ns a pixel; the time above the reserved part may exceed the deadline (decision 008).
fn handing_over_ms([width, height]: [u32; 2]) -> u64 {
    const NANOSECONDS_PER_PIXEL: u64 = 50;
    u64::from(width) * u64::from(height) * NANOSECONDS_PER_PIXEL / 1_000_000
}

/// Renders and writes one picture, and casts `check` of its rays again.
pub fn draw(
    subject: &Subject<'_>,
    outputs: PictureOutputs,
    (options, start): (&Options, Instant),
    check: Option<NonZero<u64>>,
) -> Result<FrameStats, Failure> {
    let Subject { volume, scene, decorate } = *subject;
    if check.is_some() {
        volume.check_fits(scene, options).map_err(with_picture)?;
    }
    let in_time = |ms: u64| ms.saturating_sub(handing_over_ms([scene.image.width, scene.image.height]));
    let options = &Options { time_budget_ms: options.time_budget_ms.map(in_time), ..options.clone() };
    let picture = volume.draw(scene, options).map_err(with_picture)?;
    let mut stats = picture.stats().clone();
    check_any_read(&stats)?;
    let PictureOutputs { picture: output, maps: [error_map, work_map], fidelity, record } = outputs;
    let finished = Finished { picture: &picture, decorate };
    let format = output.format();
    finished.write(output, record)?;
    if let Some(file) = fidelity {
        finished.write_fidelity(format, file)?;
    }
    stats.handed_over_ms = start.elapsed().as_secs_f64() * 1e3;
    let (resolved, placed) = (picture.resolved(), picture.volume());
    warn_of_idle_cuts(resolved, placed.facts())?;
    if let (Some(file), Some(errors)) = (error_map, picture.error_map()) {
        file.write_map(errors.clone(), errors_in_colors)?;
    }
    if let (Some(file), Some(work)) = (work_map, picture.work_map()) {
        file.write_map(work.clone(), work_in_colors)?;
    }
    if let Some(rays) = check {
        let measured = with_ray_bar(|progress| picture.check_telling(rays.get(), progress));
        stats.error_measured = Some(measured.map_err(|error| match with_picture(error) {
            // The picture replaces unreadable bricks by their parents; the reference does not.
            Failure::Data(message) => Failure::Data(format!("--check: {message}")),
            other => other,
        })?);
    }
    Ok(stats)
}

/// Warns of cuts without effect.
fn warn_of_idle_cuts(resolved: &ResolvedScene, facts: &VolumeFacts) -> Result<(), Failure> {
    warnings::idle_cuts(resolved, facts).iter().try_for_each(|cut| {
        warn(&format!(
            "{cut} cuts nothing off this picture; expected numbers in world coordinates, as `info` prints them"
        ))
    })
}

/// Failure of a picture of the library.
pub fn with_picture(error: Error) -> Failure {
    match error {
        Error::Render(error) => with_render(error),
        error => match error.kind() {
            ErrorKind::Request => Failure::command(error),
            ErrorKind::Data => Failure::Data(error.to_string()),
            ErrorKind::Machine | ErrorKind::Cancelled => Failure::Machine(error.to_string()),
        },
    }
}

/// Failure of a picture that could not be drawn.
pub fn with_render(error: RenderError) -> Failure {
    let message = error.to_string();
    match error {
        RenderError::CheckTooLarge { level, needed_bytes, budget_bytes, finest_that_fits } => {
            let or_coarser = finest_that_fits
                .map_or(String::new(), |fits| format!(", or draw and check a coarser level with --level {fits}"));
            Failure::Command(format!(
                "--check: level {level} needs {} for the reference integrator, but --host-memory is {}; use \
                 --host-memory {}MiB{or_coarser}",
                show_bytes(needed_bytes),
                show_bytes(budget_bytes),
                needed_bytes.div_ceil(1 << 20),
            ))
        }
        RenderError::NoPlace | RenderError::NoSuchPixel { .. } => Failure::Command(format!("--pick: {message}")),
        RenderError::SlicesOnGpu | RenderError::GradientsOnGpu | RenderError::CutNormalsOnGpu => {
            Failure::Command(format!("--backend: {message}"))
        }
        error => {
            let message = format!("{message}{}", option_against(&error));
            match error.kind() {
                ErrorKind::Request => Failure::Command(message),
                ErrorKind::Data => Failure::Data(message),
                ErrorKind::Machine | ErrorKind::Cancelled => Failure::Machine(message),
            }
        }
    }
}

/// The option that helps against an error, in brackets.
fn option_against(error: &RenderError) -> &'static str {
    let error = match error {
        RenderError::Budget(_) => return " (option --host-memory)",
        RenderError::Engine(EngineError::Gpu(error)) => error,
        _ => return "",
    };
    match error {
        GpuError::NotBuilt
        | GpuError::NoAdapter { .. }
        | GpuError::TooSmall { .. }
        | GpuError::TableLimit { .. }
        | GpuError::Scene { .. } => " (option --backend cpu)",
        GpuError::OutOfMemory { .. } | GpuError::Budget { .. } => " (option --gpu-memory)",
        GpuError::Refused { .. } | GpuError::DeviceLost { .. } | GpuError::Brick { .. } | GpuError::NoRoom { .. } => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn budgets_that_are_too_small_are_wrong_commands_on_every_backend() {
        let gpu = GpuError::Budget { budget: 1, fixed: 2, slot_bytes: 3, min_slots: 4, needed: 5 };
        assert!(matches!(with_render(gpu.into()), Failure::Command(_)));
        let host = RenderError::ReferenceTooLarge { level: 0, needed_bytes: 2, budget_bytes: 1 };
        assert!(matches!(with_render(host), Failure::Command(_)));
    }
}
