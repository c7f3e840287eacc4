//! Regimes of brick borders and skipping: S13, S21, S26, S27.
//!
//! A picture must not depend on its bricks: not on their size, not on their borders, not on which of them were skipped.

use glam::DVec3;
use supervol_format::Lod;
use supervol_format::random::Random;
use supervol_runtime::engines::cells::CellRule;
use supervol_runtime::engines::cpu::{Caster, CpuQuality};
use supervol_runtime::engines::gpu::device::GpuDevice;
use supervol_runtime::lod::LodChoice;
use supervol_runtime::render::options::{Backend, RenderOptions};
use supervol_runtime::stream::classify::Skipping;
use supervol_scene::camera::{Camera, Projection};
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;
use supervol_sources::VolumeSource;

use super::regime::{CurvePoint, Gate, Outcome, Regime};
use super::views::{BLUE, GOLD, HALF_A_LEVEL, SHADED, automatic, fractions, grey_levels, smooth};
use crate::context::{ChartError, Context};
use crate::fixtures::{self, Thin};
use crate::resident::{Classified, ResidentBricks, at_level, cast};
use crate::ricker::Ricker;
use crate::volume::{Point, Volume, build_options, finest, image_size, transfer_function};

/// The regimes of this module.
pub const REGIMES: &[Regime] = &[
    Regime {
        id: "S13",
        title: "Gradients at brick borders",
        recipe: "The distance field SPHERE, shaded, cut into bricks of 16, 32 and one brick; the same picture from each, \
                 level 0, CPU: ray by ray, to the last bit, and by packets, to a quarter of the error they aim at.",
        x_label: "bricks the volume is cut into",
        y_label: "greatest difference from the unbricked volume, grey levels of 255",
        run: gradients_at_borders,
    },
    Regime {
        id: "S21",
        title: "Leaping on and off",
        recipe: "Every fixture under random transfer functions, with spikes far narrower than the step of the stored \
                 ranges (1/255 of a brick's range); every level; what cannot be seen is left out, and then not.",
        x_label: "width of the transfer function's narrowest spike, share of the value range",
        y_label: "greatest difference between leaping and not leaping, grey levels of 255",
        run: leaping,
    },
    Regime {
        id: "S26",
        title: "Grazing rays through corners of bricks",
        recipe: "Rays from random points aimed at corners of bricks, and beside them by 1 to 2^20 units in the last \
                 place; mode mean over RAMP: lengths of all pieces are summed, and the mean has a closed form.",
        x_label: "distance of the aim from the corner, units in the last place",
        y_label: "greatest |sum of pieces - chord|, voxels",
        run: corner_rays,
    },
    Regime {
        id: "S27",
        title: "Brick size",
        recipe: "One field in bricks of 16, 32, 64 and 128 voxels (the last holds it whole), shaded, under a smooth and \
                 a steep transfer function, CPU and GPU, level 0.",
        x_label: "voxels along a brick's core",
        y_label: "greatest difference from the unbricked volume, grey levels of 255",
        run: brick_size,
    },
];

/// The waves of [`fixtures::waves_at`] on a grid.
pub fn waves(dims: [u64; 3]) -> supervol_sources::computed::Computed {
    let value = |v| fixtures::waves_at(fixtures::point(v));
    supervol_sources::computed::Computed::new(dims, supervol_format::VoxelType::F32, value)
}

/// 1 if the pictures differ in any bit, otherwise 0.
fn bits_differ(a: &Image, b: &Image) -> f64 {
    let bits = |image: &Image| -> Vec<u32> { image.pixels.as_flattened().iter().map(|v| v.to_bits()).collect() };
    if bits(a) == bits(b) { 0.0 } else { 1.0 }
}

/// Grey levels by which packets may change with the brick size: a quarter of their requested error. Positions are `f32`
/// from a ray's entry into a brick; refinement depends on the opacity in front of it (docs/decisions/006-packets.md).
const PACKET_BRICK_LEVELS: f64 = 0.125;

/// The two CPU casters with their names: the default and the caster of comparison.
fn casters() -> [(&'static str, RenderOptions); 2] {
    let ray_by_ray = RenderOptions { caster: Caster::Cells(CellRule::DEFAULT), ..finest(Backend::Cpu) };
    [("default", finest(Backend::Cpu)), ("ray by ray in f64", ray_by_ray)]
}

fn gradients_at_borders(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let edge = 32;
    let mut curve = Vec::new();
    let (mut differing, mut worst_of_packets) = (0.0, 0.0f64);
    let size = context.pick(image_size(192, 144), image_size(48, 36));
    let mut whole: [Option<Vec<Image>>; 2] = [None, None];
    for core in [32, 16] {
        let volume = Volume::build(context, &format!("S13 {core}"), &fixtures::sphere(edge), &build_options(core))?;
        let through_borders = volume.looking_from(DVec3::new(1.0, 1e-3, 2e-3), 2.2);
        let bricks = volume.container.pyramid().level_at(Lod(0)).brick_count();
        let scenes = [volume.outside(), through_borders]
            .iter()
            .flat_map(|camera| [smooth(&volume, 1.0), shell(&volume)].map(|tf| [camera.clone(), tf]))
            .map(|[camera, tf]| volume.scene(&[&camera, &size, SHADED, &tf]))
            .collect::<Result<Vec<_>, ChartError>>()?;
        for ((series, options), whole) in casters().into_iter().zip(&mut whole) {
            let pictures: Vec<Image> =
                scenes.iter().map(|scene| Ok(volume.render(scene, &options)?.0)).collect::<Result<_, ChartError>>()?;
            let expected = whole.get_or_insert_with(|| pictures.clone());
            let worst = pictures.iter().zip(expected.iter()).map(|(a, b)| grey_levels(a, b)).fold(0.0, f64::max);
            if options.caster.is_default() {
                worst_of_packets = worst_of_packets.max(worst);
            } else {
                differing += pictures.iter().zip(expected.iter()).map(|(a, b)| bits_differ(a, b)).sum::<f64>();
            }
            curve.push(CurvePoint::new(series, bricks as f64, worst, Some(0.0)));
        }
    }
    let gates = vec![
        Gate::at_most("pictures of 8 bricks that differ from the unbricked one in any bit, ray by ray", differing, 0.0),
        Gate::at_most("difference from the unbricked one, packets, grey levels", worst_of_packets, PACKET_BRICK_LEVELS),
    ];
    Ok(Outcome { curve, gates, note: "Four pictures each: two cameras, two transfer functions.".into() })
}

/// A steep shell at 0.4 of the value range.
fn shell(volume: &Volume) -> String {
    fractions(
        volume,
        1.0,
        &[(0.0, BLUE, 0.0), (0.4, BLUE, 0.0), (0.4, GOLD, 0.6), (0.45, GOLD, 0.7), (0.45, BLUE, 0.0)],
    )
}

fn brick_size(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let (dims, cores): ([u64; 3], &[u32]) =
        context.pick(([100, 90, 70], &[128, 64, 32, 16]), ([40, 36, 33], &[64, 32, 16]));
    let size = context.pick(image_size(96, 72), image_size(32, 24));
    let gpu = GpuDevice::open().is_ok();
    let mut backends: Vec<_> = casters().into();
    if gpu {
        backends.push(("gpu", finest(Backend::Gpu)));
    }
    let (mut curve, mut worst) = (Vec::new(), [0.0f64; 3]);
    let mut whole: Option<Vec<Vec<Image>>> = None;
    for &core in cores {
        let volume = Volume::build(context, &format!("S27 {core}"), &waves(dims), &build_options(core))?;
        let mut pictures = vec![Vec::new(); backends.len()];
        for tf in [smooth(&volume, 1.0), shell(&volume)] {
            let scene = volume.scene(&[&volume.outside(), &size, SHADED, &tf])?;
            for ((_, options), pictures) in backends.iter().zip(&mut pictures) {
                pictures.push(volume.render(&scene, options)?.0);
            }
        }
        let expected = whole.get_or_insert_with(|| pictures.clone());
        for (i, (series, _)) in backends.iter().enumerate() {
            let distance = pictures[i].iter().zip(&expected[i]).map(|(a, b)| grey_levels(a, b)).fold(0.0, f64::max);
            curve.push(CurvePoint::new(series, f64::from(core), distance, Some(0.0)));
            worst[i] = worst[i].max(distance);
        }
    }
    let [packets, ray_by_ray, worst_gpu] = worst;
    let mut gates = vec![
        Gate::at_most("CPU ray by ray, L-infinity between brick sizes, share of full scale", ray_by_ray / 255.0, 1e-5),
        Gate::at_most("CPU by packets, L-infinity between brick sizes, grey levels", packets, PACKET_BRICK_LEVELS),
    ];
    if gpu {
        gates.push(Gate::at_most("GPU, L-infinity between brick sizes, grey levels", worst_gpu, HALF_A_LEVEL));
    }
    Ok(Outcome { curve, gates, note: gpu_note(gpu) })
}

fn gpu_note(is_there: bool) -> String {
    if is_there { String::new() } else { "SKIPPED for the GPU: no adapter.".into() }
}

/// All small fixtures, with two levels and eight bricks.
fn every_fixture(context: &Context<'_>) -> Result<Vec<Volume>, ChartError> {
    let edge = 19;
    let ricker = Ricker { spikes: 1e-3, dead: Some(0.0), ..Ricker::clean([edge; 3]) };
    let mut sources: Vec<(String, Box<dyn VolumeSource>)> = vec![
        ("CONST".into(), Box::new(fixtures::constant([edge; 3], 0.5))),
        ("RAMP".into(), Box::new(fixtures::ramp([edge; 3]))),
        ("SPHERE".into(), Box::new(fixtures::sphere(edge))),
        ("ML".into(), Box::new(fixtures::marschner_lobb(edge))),
        ("STEP".into(), Box::new(fixtures::step(edge))),
        ("CHECK".into(), Box::new(fixtures::check(edge))),
        ("RICKER".into(), Box::new(ricker.source())),
    ];
    for thin in Thin::ALL {
        sources.push((thin.name().to_uppercase(), Box::new(fixtures::thin(edge, thin))));
    }
    let build = |(name, source): &(String, Box<dyn VolumeSource>)| {
        Volume::build(context, &format!("S21 {name}"), source.as_ref(), &build_options(16))
    };
    sources.iter().map(build).collect()
}

/// Widths of the narrowest spike, as fractions of the value range; stored ranges have a step of 1/255.
const SPIKE_WIDTHS: [f64; 5] = [1e-1, 1e-2, 1e-3, 1e-5, 1e-7];

/// A transfer function of one to three spikes of this width, sometimes with a ramp, transparent elsewhere. In half of
/// the cases a spike lies at an end of the value range, where rounding a range inward would lose it.
fn spiked(volume: &Volume, width: f64, random: &mut Random) -> String {
    let mut centres: Vec<f64> = (0..=random.below(3)).map(|_| random.unit()).collect();
    if random.below(2) == 0 {
        centres[0] = random.below(2) as f64;
    }
    centres.sort_by(f64::total_cmp);
    let mut color = || [random.unit(), random.unit(), random.unit()];
    let mut points: Vec<Point> = vec![(-1.0, color(), 0.0)];
    for centre in centres {
        let low = (centre - width / 2.0).max(points[points.len() - 1].0);
        let (a, b) = (color(), color());
        points.extend([(low, a, 0.0), (centre.max(low), b, 0.9), ((centre + width / 2.0).max(low), a, 0.0)]);
    }
    let last = points[points.len() - 1].0;
    if random.below(4) == 0 {
        points.push((last.max(0.9), BLUE, 0.0));
        points.push((last.max(1.0), GOLD, 0.2));
    }
    // CONST has a range of width 0: its spikes lie around the value itself.
    let scale = if volume.facts.value_range.width() > 0.0 { volume.facts.value_range.width() } else { 1.0 };
    let points: Vec<Point> =
        points.iter().map(|&(f, color, alpha)| (volume.facts.value_range.min + f * scale, color, alpha)).collect();
    transfer_function(1.0, &points)
}

fn leaping(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let volumes = every_fixture(context)?;
    let functions = context.pick(1000, 30);
    let mut random = Random::new(21);
    let mut worst = [0.0f64; SPIKE_WIDTHS.len()];
    let (mut differing, mut pictures, mut showing) = (0.0, 0u64, 0u64);
    for volume in &volumes {
        (context.say)(&format!("S21: {}", volume.name));
        let all = ResidentBricks::load(&volume.container)?;
        for i in 0..functions {
            let width = i % SPIKE_WIDTHS.len();
            let tf = spiked(volume, SPIKE_WIDTHS[width], &mut random);
            let shading = if i % 3 == 0 { SHADED } else { r#""mode": "dvr""# };
            let camera = volume.looking_from(DVec3::from_array(random.direction()), 2.4);
            let scene = volume.scene(&[&camera, &image_size(8, 6), &tf, shading])?;
            if i < AUTOMATIC_PICTURES {
                let [on, off] =
                    both_automatic(volume, &[&image_size(8, 6), &tf, shading], DVec3::from_array(random.direction()))?;
                worst[width] = worst[width].max(grey_levels(&on, &off));
                differing += bits_differ(&on, &off);
            }
            for lod in volume.container.pyramid().lods() {
                let [on, off] = both(&all, &scene, lod)?;
                worst[width] = worst[width].max(grey_levels(&on, &off));
                differing += bits_differ(&on, &off);
                pictures += 1;
                showing += u64::from(off.pixels.iter().any(|p| p[3] > 0.0));
            }
        }
    }
    let series = |(width, worst): (&f64, &f64)| CurvePoint::new("cpu (default)", *width, *worst, Some(0.0));
    let mut curve: Vec<_> = SPIKE_WIDTHS.iter().zip(&worst).map(series).collect();
    let mut gates = vec![
        Gate::at_most("CPU pictures that leaping changes in any bit", differing, 0.0),
        Gate::at_least("share of pictures that show anything", showing as f64 / pictures as f64, 0.25),
    ];
    let mut note = format!(
        "{pictures} pairs of pictures, {functions} transfer functions a fixture, seed 21; {AUTOMATIC_PICTURES} of them also with \
         levels chosen automatically."
    );
    match leaping_on_gpu(context, &volumes)? {
        Some((points, gpu)) => {
            curve.extend(points);
            gates.push(Gate::at_most("GPU, L-infinity, share of full scale", gpu / 255.0, 1e-5));
        }
        None => note += " SKIPPED for the GPU: no adapter.",
    }
    Ok(Outcome { curve, gates, note })
}

/// Two pictures of a level: with leaping and without.
fn both(all: &ResidentBricks, scene: &ResolvedScene, lod: Lod) -> Result<[Image; 2], ChartError> {
    let picture = |skipping| {
        let quality = CpuQuality { lod: LodChoice::Fixed(lod), skipping, ..CpuQuality::default() };
        all.picture(&Classified::new(all, scene, skipping)?, scene, quality)
    };
    Ok([picture(Skipping::On)?, picture(Skipping::Off)?])
}

/// Number of transfer functions per fixture that are also drawn with automatic levels.
const AUTOMATIC_PICTURES: usize = 5;

/// Two pictures from afar with automatic levels, read through the streamer: with leaping and without.
fn both_automatic(volume: &Volume, members: &[&str], direction: DVec3) -> Result<[Image; 2], ChartError> {
    let camera = volume.looking_from(direction, 6.0);
    let scene = volume.scene(&[&[camera.as_str()], members].concat())?;
    let picture = |skipping| {
        let options = RenderOptions { skipping, ..automatic(finest(Backend::Cpu)) };
        Ok::<_, ChartError>(volume.render(&scene, &options)?.0)
    };
    Ok([picture(Skipping::On)?, picture(Skipping::Off)?])
}

/// Points by spike width, and the greatest difference, grey levels; `None` without a GPU adapter.
fn leaping_on_gpu(context: &Context<'_>, volumes: &[Volume]) -> Result<Option<(Vec<CurvePoint>, f64)>, ChartError> {
    if GpuDevice::open().is_err() {
        return Ok(None);
    }
    let mut random = Random::new(22);
    let (mut points, mut worst) = (Vec::new(), 0.0f64);
    let few = context.pick(volumes.len(), 2);
    for &width in context.pick(&SPIKE_WIDTHS[..], &SPIKE_WIDTHS[2..3]) {
        let mut at_width = 0.0f64;
        for volume in volumes.iter().rev().take(few) {
            let tf = spiked(volume, width, &mut random);
            let scene = volume.scene(&[&volume.outside(), &image_size(24, 18), &tf])?;
            let picture = |skipping| {
                let options = RenderOptions { skipping, ..finest(Backend::Gpu) };
                Ok::<_, ChartError>(volume.render(&scene, &options)?.0)
            };
            at_width = at_width.max(grey_levels(&picture(Skipping::On)?, &picture(Skipping::Off)?));
        }
        points.push(CurvePoint::new("gpu", width, at_width, Some(0.0)));
        worst = worst.max(at_width);
    }
    Ok(Some((points, worst)))
}

/// Mean of `clamp(origin + t * rate, 0, top)` over the segment `[t0, t1]`: RAMP along a ray, closed form.
fn ramp_mean(origin: f64, rate: f64, top: f64, [t0, t1]: [f64; 2]) -> f64 {
    // The antiderivative of clamp(s, 0, top), up to a constant.
    let primitive = |s: f64| {
        if s <= 0.0 {
            0.0
        } else if s < top {
            0.5 * s * s
        } else {
            top * (s - 0.5 * top)
        }
    };
    let (a, b) = (origin + t0 * rate, origin + t1 * rate);
    if (b - a).abs() < 1e-6 {
        return 0.5 * (a.clamp(0.0, top) + b.clamp(0.0, top));
    }
    (primitive(b) - primitive(a)) / (b - a)
}

/// The number `ulps` units in the last place away.
fn nudged(v: f64, ulps: i64) -> f64 {
    f64::from_bits(v.to_bits().wrapping_add_signed(ulps))
}

fn corner_rays(context: &Context<'_>) -> Result<Outcome, ChartError> {
    const EDGE: u64 = 48;
    const ULPS: [i64; 8] = [0, 1, 2, 8, 64, 1 << 10, 1 << 15, 1 << 20];
    let rays_each = context.pick(1_000_000, 20_000) / ULPS.len() as u64;
    let volume = Volume::build(context, "S26", &fixtures::ramp([EDGE; 3]), &build_options(16))?;
    let all = ResidentBricks::load(&volume.container)?;
    // Opacity equals the mean, as a fraction of the range.
    let tf = fractions(&volume, 1.0, &[(0.0, BLUE, 0.0), (1.0, GOLD, 1.0)]);
    let mut scene = volume.scene(&[r#""mode": "mean""#, &volume.outside(), &image_size(1, 1), &tf])?;
    let mut random = Random::new(26);
    let (mut curve, mut worst_length, mut worst_mean, mut bad) = (Vec::new(), 0.0f64, 0.0f64, 0.0);
    let mut worst_share = 0.0f64;
    // Only the ray-by-ray caster reports lengths.
    let by_cells = CpuQuality { caster: Caster::Cells(CellRule::DEFAULT), ..at_level(Lod(0)) };
    for ulps in ULPS {
        let (mut length, mut mean, mut share) = (0.0f64, 0.0f64, 0.0f64);
        for _ in 0..rays_each {
            // Brick corners lie at 15.5 and 31.5; signs differ between axes.
            let target = DVec3::from_array([0, 1, 2].map(|_| {
                let corner = if random.below(2) == 0 { 15.5 } else { 31.5 };
                nudged(corner, if random.below(2) == 0 { ulps } else { -ulps })
            }));
            let eye = target - DVec3::from_array(random.direction()) * (60.0 + 30.0 * random.unit());
            let one_ray = Camera::look_at(
                eye,
                target,
                DVec3::from_array(random.direction()),
                Projection::Perspective { fov_y: 1.0 },
                [1, 1],
            );
            let Ok(camera) = one_ray else { continue };
            scene.camera = camera;
            let frame = all.frame(&scene, by_cells.clone());
            let begun = frame.begin();
            let chord = [begun.states()[0].t, begun.states()[0].t_end];
            let rays = cast(&all, &frame)?;
            let end = &rays.states()[0];
            let ray = scene.camera.ray(0, 0);
            let exact = ramp_mean(ray.origin.x, ray.direction.x, (EDGE - 1) as f64, chord);
            length = length.max((end.length - (chord[1] - chord[0])).abs());
            mean = mean.max((end.value / end.length - exact).abs());
            bad += if end.value.is_finite() && end.finished { 0.0 } else { 1.0 };
            let [_, _, _, opacity] = all.level(&scene, Lod(0))?.pixels[0];
            share = share.max((f64::from(opacity) - exact / (EDGE - 1) as f64).abs());
            bad += if opacity.is_finite() { 0.0 } else { 1.0 };
        }
        curve.push(CurvePoint::new("cells: lengths", ulps as f64, length, Some(0.0)));
        let of_range = mean / (EDGE - 1) as f64;
        curve.push(CurvePoint::new("cells: mean of RAMP, share of its range", ulps as f64, of_range, Some(0.0)));
        curve.push(CurvePoint::new("default: mean of RAMP, share of its range", ulps as f64, share, Some(0.0)));
        (worst_length, worst_mean) = (worst_length.max(length), worst_mean.max(mean));
        worst_share = worst_share.max(share);
    }
    let gates = vec![
        Gate::at_most("|sum of pieces - chord|, voxels", worst_length, 1e-6),
        Gate::at_most("|mean of RAMP - closed form|, share of the range", worst_mean / (EDGE - 1) as f64, 1e-6),
        Gate::at_most("the same, by packets", worst_share, 1e-6),
        Gate::at_most("rays that are not finished, or not finite", bad, 0.0),
    ];
    let note = format!(
        "{} rays. A piece covered twice and another left out would keep the sum of lengths, but not the mean of RAMP.",
        rays_each * ULPS.len() as u64
    );
    Ok(Outcome { curve, gates, note })
}
