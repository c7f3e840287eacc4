//! Regime of jittered sampling: S43. Jitter is a method of comparison; the default has no step.

use supervol_format::Lod;
use supervol_format::cast::single;
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use super::regime::{CurvePoint, Gate, Outcome, Regime};
use super::views::{BLUE, GOLD, GREY_LEVEL, HALF_A_LEVEL, fractions, smooth};
use crate::comparison::{Offset, Sampling};
use crate::context::{ChartError, Context};
use crate::fixtures;
use crate::measure::{distance, distance_of};
use crate::volume::{HOST_MEMORY_BYTES, Volume, build_options, image_size};

/// The regimes of this module.
pub const REGIMES: &[Regime] = &[Regime {
    id: "S43",
    title: "Jittered samples: noise instead of bias",
    recipe: "ML and SPHERE by midpoint samples (a method of comparison), each ray's first interval cut by noise; frames are \
             averaged, under smooth transfer functions and such with a step.",
    x_label: "frames averaged",
    y_label: "distance from the reference, root mean square, grey levels of 255",
    run: jitter,
}];

/// Largest number of averaged frames.
const FRAMES: u32 = 256;

/// A picture by midpoint samples.
fn sampled(
    volume: &Volume,
    scene: &ResolvedScene,
    (step_voxels, offset): (f64, Offset),
    threads: Option<usize>,
) -> Result<Image, ChartError> {
    let sampling = Sampling { step_voxels, offset, termination_opacity: 2.0, ..Sampling::default() };
    let options = RenderOptions {
        backend: Backend::Cpu,
        level: LevelChoice::Fixed(Lod(0)),
        host_memory_bytes: HOST_MEMORY_BYTES,
        caster: sampling.caster(),
        threads,
        ..RenderOptions::default()
    };
    Ok(volume.render(scene, &options)?.0)
}

fn jitter(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let edge = context.pick(40, 24);
    let ml = Volume::build(context, "S43 ML", &fixtures::marschner_lobb(edge), &build_options(64))?;
    let sphere = Volume::build(context, "S43 SPHERE", &fixtures::sphere(edge), &build_options(64))?;
    let size = context.pick(image_size(48, 36), image_size(16, 12));
    let step = fractions(&ml, 1.0, &[(0.0, BLUE, 0.01), (0.48, BLUE, 0.01), (0.48, GOLD, 0.2), (1.0, GOLD, 0.3)]);
    let ball = [(0.0, BLUE, 0.1), (0.48, BLUE, 0.2), (0.48, GOLD, 0.01), (1.0, GOLD, 0.01)];
    let (soft, ball) = (smooth(&ml, 1.0), fractions(&sphere, 1.0, &ball));
    let (mut curve, mut gates, mut differing) = (Vec::new(), Vec::new(), 0.0);
    let cases = [
        (&ml, "step at the ends of rays, too", &step, 1.0),
        (&ml, "smooth", &soft, 1.0),
        (&sphere, "step inside the volume", &ball, 1.0),
        (&ml, "step at the ends of rays, too", &step, 0.25),
    ];
    for (volume, name, tf, step_voxels) in cases {
        let scene = volume.scene(&[&volume.outside(), &size, tf])?;
        let exact = volume.finest(&scene, Backend::Reference)?;
        let series = format!("{name}, samples {step_voxels} voxel apart");
        let averaged = average(volume, &scene, step_voxels, &exact)?;
        let fixed = sampled(volume, &scene, (step_voxels, Offset::Fixed(1.0)), None)?;
        let fixed = distance(&fixed, &exact).rmse / GREY_LEVEL;
        for (frames, rmse) in averaged.rmse {
            curve.push(CurvePoint::new(&format!("{series}, jittered"), frames, rmse, None));
            curve.push(CurvePoint::new(&format!("{series}, the same every frame"), frames, fixed, None));
        }
        let what = format!("L-infinity of {FRAMES} frames' mean, {series}, grey levels");
        gates.push(Gate::at_most(what, averaged.linf, HALF_A_LEVEL));
        differing += averaged.differing;
    }
    gates.push(Gate::at_most("frames that another number of threads changes in any bit", differing, 0.0));
    let note = "What is averaged is the opacity 1 - exp(-depth), not the depth: noise of the depth with variance v leaves about \
                v/2 of the transmittance, however many frames are averaged. It shrinks with the step, and is largest where the \
                transfer function steps inside the first or last interval of a ray. The default does not jitter."
        .into();
    Ok(Outcome { curve, gates, note })
}

/// Result of averaging jittered frames.
struct Averaged {
    /// Number of frames, and distance of their mean from the reference: root mean square, grey levels.
    rmse: Vec<(f64, f64)>,
    /// Greatest difference between the mean of all frames and the reference, grey levels.
    linf: f64,
    /// Number of frames that differ when drawn again by one thread.
    differing: f64,
}

fn average(volume: &Volume, scene: &ResolvedScene, step_voxels: f64, exact: &Image) -> Result<Averaged, ChartError> {
    let exact = exact.pixels.as_flattened();
    let mut sum = vec![0.0f64; exact.len()];
    let mut averaged = Averaged { rmse: Vec::new(), linf: f64::INFINITY, differing: 0.0 };
    for frame in 0..FRAMES {
        let jittered = (step_voxels, Offset::Jittered { frame });
        let picture = sampled(volume, scene, jittered, None)?;
        if frame % 64 == 1 {
            let again = sampled(volume, scene, jittered, Some(1))?;
            averaged.differing += if again == picture { 0.0 } else { 1.0 };
        }
        sum.iter_mut().zip(picture.pixels.as_flattened()).for_each(|(sum, v)| *sum += f64::from(*v));
        let count = frame + 1;
        if count.is_power_of_two() {
            let mean: Vec<f32> = sum.iter().map(|v| single(v / f64::from(count))).collect();
            let d = distance_of(&mean, exact);
            averaged.rmse.push((f64::from(count), d.rmse / GREY_LEVEL));
            averaged.linf = d.linf / GREY_LEVEL;
        }
    }
    Ok(averaged)
}
