//! Supervol's side: the CPU backend, level 0, from a cache that already holds every brick the picture needs.
//!
//! Streamer and cache outlive the pictures, as they do in a viewer that draws frame after frame.

use std::time::Instant;

use supervol_runtime::frame::caster::CpuCaster;
use supervol_runtime::frame::{Backend, FrameWalk, RenderError, RenderOptions, cpu_frame, plan_host, streamer_for};
use supervol_runtime::image::Image;
use supervol_runtime::process;
use supervol_runtime::raycast::comparison::{Rule, Sampling};
use supervol_runtime::raycast::cpu::RayState;
use supervol_runtime::raycast::method::Method;
use supervol_runtime::streamer::budget::Bands;

use super::cases::Case;
use super::{Cost, Drawn, Sizes, Spread, vtk};
use crate::context::ChartError;
use crate::volume::finest;

/// Name of our rows.
pub const NAME: &str = "Supervol";

/// How Supervol samples in one row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampler {
    method: Method,
    step_voxels: Option<f64>,
}

impl Sampler {
    /// The default, and the peer's way of sampling at each of these steps: a point in the middle of each interval, rays
    /// ended where the peer ends them. Offsets and arithmetic are our own.
    #[must_use]
    pub fn all(steps_voxels: &[f64]) -> Vec<Self> {
        let default = Self { method: Method::DEFAULT, step_voxels: None };
        let sampled = steps_voxels.iter().map(|&step_voxels| Self {
            method: Method::Sampled(Sampling {
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
            Some(step) => super::sampling_name(step),
        }
    }
}

/// Draws a case at both sizes; the larger one is timed.
///
/// # Errors
/// If a picture cannot be made.
pub fn draw(case: &Case<'_>, sampler: Sampler, sizes: Sizes, threads: usize) -> Result<Drawn, ChartError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|e| RenderError::Threads { threads, message: e.to_string() })?;
    let options = RenderOptions { method: sampler.method, ..finest(Backend::Cpu) };
    let (cost, picture) = pool.install(|| timed_pictures(case, &options, sizes))?;
    let options = RenderOptions { threads: Some(threads), ..options };
    let (error_picture, _) = case.built.volume.render(&case.scene(sizes.error_image)?, &options)?;
    Ok(Drawn {
        program: NAME,
        sampling: sampler.name(),
        step_voxels: sampler.step_voxels,
        cost,
        picture,
        error_picture,
    })
}

/// A first picture, and as many more as are wanted, on the calling thread's pool.
fn timed_pictures(case: &Case<'_>, options: &RenderOptions<'_>, sizes: Sizes) -> Result<(Cost, Image), ChartError> {
    let container = &case.built.volume.container;
    let scene = case.scene(sizes.image)?;
    let plan = plan_host(container, &scene, options, size_of::<RayState>() as u64, Bands::Allowed)
        .map_err(RenderError::from)?;
    let mut streamer = streamer_for(container, &scene, options, plan);
    let mut one = || -> Result<(f64, f64, Image), ChartError> {
        let (wall, cpu) = (Instant::now(), process::cpu_time());
        // Tables of the transfer function are made for each picture, as a viewer would while it is edited.
        let frame = cpu_frame(container, &scene, options);
        let mut walk = FrameWalk::new(&mut streamer, plan, options, wall);
        let image = walk.run(&mut CpuCaster::new(frame), scene.image_size)?;
        let cpu_ms = process::cpu_time().saturating_sub(cpu).as_secs_f64() * 1e3;
        Ok((cpu_ms, wall.elapsed().as_secs_f64() * 1e3, image))
    };
    let (first_cpu_ms, _, picture) = one()?;
    let (mut cpu_ms, mut wall_ms) = (Vec::new(), Vec::new());
    for _ in 0..sizes.repeats {
        let (cpu, wall, _) = one()?;
        cpu_ms.push(cpu);
        wall_ms.push(wall);
    }
    let cost = Cost { cpu: Spread::of(&cpu_ms), wall: Spread::of(&wall_ms), first_cpu_ms, cast_cpu: None };
    Ok((cost, picture))
}
