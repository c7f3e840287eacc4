//! Supervol's part of the comparison: the CPU backend, level 0, with all needed bricks in the cache.
//!
//! Streamer and cache are kept between pictures, as in a viewer that draws frame after frame.

use std::time::Instant;

use supervol_runtime::render::options::{Backend, RenderOptions};
use supervol_runtime::render::process;
use supervol_runtime::render::renderer::Renderer;
use supervol_runtime::render::volume::PlacedVolume;
use supervol_scene::image::Image;

use super::cases::Case;
use super::options::{Run, Sizes};
use super::results::{Cost, Drawn, sampling_name};
use super::vtk;
use crate::comparison::{Rule, Sampling};
use crate::context::{ChartError, Context, Pace};
use crate::measure::Spread;
use crate::methods::Integrated;
use crate::volume::finest;

/// Program name of Supervol's rows.
pub const NAME: &str = "Supervol";

/// Sampling of Supervol in one row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampler {
    integration: Integrated,
    step_voxels: Option<f64>,
}

impl Sampler {
    /// The default, then the peer's sampling at each of these steps: midpoint samples, and the peer's opacity limit for
    /// ending rays. Offsets and arithmetic are Supervol's own.
    #[must_use]
    pub fn all(steps_voxels: &[f64]) -> Vec<Self> {
        let default = Self { integration: Integrated::DEFAULT, step_voxels: None };
        let sampled = steps_voxels.iter().map(|&step_voxels| Self {
            integration: Integrated::Sampled(Sampling {
                step_voxels,
                rule: Rule::Midpoint,
                termination_opacity: vtk::TERMINATION_OPACITY,
                ..Sampling::default()
            }),
            step_voxels: Some(step_voxels),
        });
        [default].into_iter().chain(sampled).collect()
    }

    fn name(self) -> String {
        match self.step_voxels {
            None => "default (cell by cell)".into(),
            Some(step) => sampling_name(step),
        }
    }
}

/// Draws a case several times.
///
/// # Errors
/// If a picture cannot be drawn.
pub fn draw(context: &Context<'_>, case: &Case<'_>, sampler: Sampler, run: &Run) -> Result<Drawn, ChartError> {
    let options = RenderOptions {
        threads: Some(run.threads),
        caster: sampler.integration.caster(),
        host_memory_bytes: run.sizes.host_memory_bytes,
        ..finest(Backend::Cpu)
    };
    let (cost, picture) = timed_pictures(context, case, &options, &run.sizes)?;
    Ok(Drawn { program: NAME, sampling: sampler.name(), step_voxels: sampler.step_voxels, cost, picture })
}

/// A first picture, then the timed pictures.
fn timed_pictures(
    context: &Context<'_>,
    case: &Case<'_>,
    options: &RenderOptions,
    sizes: &Sizes,
) -> Result<(Cost, Image), ChartError> {
    let container = &case.built.volume.container;
    let scene = case.scene(sizes.image)?;
    let mut renderer = Renderer::new(PlacedVolume::of(container.clone()), options.clone())?;
    renderer.set_scene(scene);
    let mut one = || -> Result<(f64, f64, Image), ChartError> {
        let (wall, cpu) = (Instant::now(), process::cpu_time());
        // The tables of the transfer function are made for each picture, as in a viewer that edits it. Brick visibility
        // is known from the previous picture, as in VTK.
        renderer.begin_anew();
        renderer.advance(None)?;
        let cpu_ms = process::cpu_time().saturating_sub(cpu).as_secs_f64() * 1e3;
        let wall_ms = wall.elapsed().as_secs_f64() * 1e3;
        Ok((cpu_ms, wall_ms, renderer.picture().expect("nobody cancels").into_owned()))
    };
    let pace = Pace::new(context.say);
    let (first_cpu_ms, first_ms, picture) = one()?;
    pace.tell(|| format!("  {NAME}: first picture after {:.1} s", first_ms / 1e3));
    let (mut cpu_ms, mut wall_ms) = (Vec::new(), Vec::new());
    let begun = Instant::now();
    while cpu_ms.is_empty() || (cpu_ms.len() < sizes.repeats && begun.elapsed() < sizes.row_limit) {
        let (cpu, wall, _) = one()?;
        cpu_ms.push(cpu);
        wall_ms.push(wall);
        pace.tell(|| format!("  {NAME}: picture {} of {}, {cpu:.0} CPU-ms", cpu_ms.len(), sizes.repeats));
    }
    let (cpu, wall) = (Spread::of(&cpu_ms), Spread::of(&wall_ms));
    Ok((Cost { repeats: cpu_ms.len(), cpu, wall, first_cpu_ms, cast_cpu: None }, picture))
}
