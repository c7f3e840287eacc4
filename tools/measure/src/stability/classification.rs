//! Classification (S01, S03, S04): before or after interpolation, and narrow transfer functions.
//!
//! RAMP is linear, so its pictures have closed forms. ML is compared with the reference integrator.

use supervol_format::VoxelType;
use supervol_runtime::render::options::{Backend, RenderOptions};
use supervol_sources::computed::Computed;

use super::parallel::{
    GREY_LEVELS, HALF_A_LEVEL, NEVER, by_samples, default_unterminated, fixed_pairs, looking_along, pixel, worst,
};
use super::regime::{CurvePoint, Gate, Outcome, Regime};
use crate::comparison::{Classification, Rule, Sampling};
use crate::context::{ChartError, Context};
use crate::fixtures;
use crate::measure::{distance, order_of};
use crate::volume::{Volume, build_options, image_size, transfer_function};

/// The regimes of this file.
pub const REGIMES: &[Regime] = &[
    Regime {
        id: "S01",
        title: "Pre- versus post-classification",
        recipe: "RAMP 8^3 under a transfer function with one step, at the middle of the range (value 3.5): seen \
                 along z, across the edge, and along x, through it.",
        x_label: "distance from the edge, voxels",
        y_label: "distance from the closed form, grey levels of 255",
        run: order_of_classification,
    },
    Regime {
        id: "S03",
        title: "Value not linear inside a segment",
        recipe: "ML 40^3 under a hat 1/50 of the range wide, narrower than the field bends within a step of 2, 1, \
                 1/2, 1/4, ... voxels; against the reference.",
        x_label: "step, voxels",
        y_label: "greatest distance from the reference, grey levels of 255",
        run: bent_segments,
    },
    Regime {
        id: "S04",
        title: "Size of tables versus bit depth",
        recipe: "12- and 16-bit RAMP under a spike one code wide, whose colour changes across it; seen along the ramp.",
        x_label: "samples across the spike",
        y_label: "error of the red light, root mean square of 8 spikes, grey levels of 255",
        run: narrow_spikes,
    },
];

/// Value of S01's step: the centre of RAMP 8^3.
const EDGE: f64 = 3.5;
/// Voxels of S01 along each axis.
const RAMP: u64 = 8;
/// Opacity per voxel below and above the step.
const EDGE_ALPHA: [f64; 2] = [0.05, 0.6];

fn order_of_classification(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let volume = Volume::build(context, "s01", &fixtures::ramp([RAMP; 3]), &build_options(16))?;
    let fine = Sampling { step_voxels: 0.25, termination_opacity: NEVER, ..Sampling::default() };
    let lines = [
        ("default", default_unterminated()),
        ("post-classification, four samples per voxel", by_samples(fine)),
        (
            "pre-classification, four samples per voxel",
            by_samples(Sampling { classification: Classification::Pre, ..fine }),
        ),
    ];
    let mut curve = Vec::new();
    let mut greatest = Vec::new();
    for (name, options) in &lines {
        let profile = across_the_edge(&volume, context.pick(1024, 256), options)?;
        greatest.push(worst(profile.iter().map(|p| p.1)));
        let near = profile.iter().filter(|p| p.0.abs() < 1.25);
        curve.extend(near.step_by(context.pick(8, 4)).map(|&(x, error)| CurvePoint::new(name, x, error, Some(0.0))));
    }
    let default_shift = edge_shift(&volume, &default_unterminated())?;
    let mut shares = Vec::new();
    for step_voxels in [0.9, 0.5, 0.3, 0.1] {
        let shift = edge_shift(&volume, &by_samples(Sampling { step_voxels, ..fine }))?;
        shares.push(shift / (0.5 * step_voxels));
    }
    let gates = vec![
        Gate::at_most("default, off the edge pixels, grey levels", greatest[0], HALF_A_LEVEL),
        Gate::at_most("default, edge along the ray, voxels from where it is", default_shift.abs(), 1e-3),
        Gate::at_most("post-classification, edge along the ray, halves of a step from where it is", worst(shares), 1.0),
        Gate::at_most("post-classification, off the edge pixels, grey levels", greatest[1], HALF_A_LEVEL),
    ];
    let note = format!(
        "Pre-classification, a method of comparison, interpolates colours instead of values: the edge becomes a ramp \
         one voxel wide, wrong by up to {:.1} grey levels.",
        greatest[2]
    );
    Ok(Outcome { curve, gates, note })
}

/// View along z. For each pixel column except the outermost two: its position relative to the edge, voxels, and the
/// greatest distance from the closed form, grey levels.
fn across_the_edge(volume: &Volume, pixels: u32, options: &RenderOptions) -> Result<Vec<(f64, f64)>, ChartError> {
    let colors = [[0.1, 0.2, 0.9], [0.9, 0.6, 0.1]];
    let tf = transfer_function(
        1.0,
        &[
            (0.0, colors[0], EDGE_ALPHA[0]),
            (EDGE, colors[0], EDGE_ALPHA[0]),
            (EDGE, colors[1], EDGE_ALPHA[1]),
            (7.0, colors[1], EDGE_ALPHA[1]),
        ],
    );
    let width = (RAMP - 1) as f64;
    // A few rows are enough, because all are equal. The picture's width is the distance from the first to the last
    // voxel.
    let rows = 4;
    let height = width * f64::from(rows) / f64::from(pixels);
    let scene = volume.scene(&[&looking_along(volume, 2, height), &image_size(pixels, rows), &tf])?;
    let image = volume.render(&scene, options)?.0;
    let mut profile = Vec::new();
    for x in (0..pixels).filter(|x| (2 * x + 1).abs_diff(pixels) > 1) {
        let from_edge = ((f64::from(x) + 0.5) / f64::from(pixels) - 0.5) * width;
        let side = usize::from(from_edge >= 0.0);
        let opacity = 1.0 - (1.0 - EDGE_ALPHA[side]).powf(RAMP as f64);
        let [r, g, b] = colors[side].map(|c| c * opacity);
        let mut error: f64 = 0.0;
        for y in 0..rows {
            let found = pixel(&image, x, y)?;
            error = error.max(worst(found.into_iter().zip([r, g, b, opacity]).map(|(a, b)| a - b)));
        }
        profile.push((from_edge, GREY_LEVELS * error));
    }
    Ok(profile)
}

/// View along x, transparent before the edge: error of the length behind the edge, voxels.
fn edge_shift(volume: &Volume, options: &RenderOptions) -> Result<f64, ChartError> {
    let alpha: f64 = 0.1;
    let grey = [0.5; 3];
    let tf = transfer_function(1.0, &[(0.0, grey, 0.0), (EDGE, grey, 0.0), (EDGE, grey, alpha), (7.0, grey, alpha)]);
    let scene = volume.scene(&[&looking_along(volume, 0, 4.0), &image_size(4, 4), &tf])?;
    let image = volume.render(&scene, options)?.0;
    let exact = RAMP as f64 - 0.5 - EDGE;
    let length = |opacity: f64| (1.0 - opacity).ln() / (1.0 - alpha).ln();
    Ok(worst(image.pixels.iter().map(|p| length(f64::from(p[3])) - exact)))
}

fn bent_segments(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let volume = Volume::build(context, "s03", &fixtures::marschner_lobb(40), &build_options(16))?;
    let pixels = context.pick(64, 20);
    let (blue, gold) = ([0.2, 0.4, 0.9], [1.0, 0.8, 0.3]);
    let tf = transfer_function(
        1.0,
        &[(0.0, blue, 0.0), (0.49, blue, 0.0), (0.5, gold, 0.6), (0.51, blue, 0.0), (1.0, blue, 0.0)],
    );
    let scene = volume.scene(&[&volume.outside(), &image_size(pixels, pixels), &tf])?;
    let exact = volume.finest(&scene, Backend::Reference)?;
    let default = distance(&volume.finest(&scene, Backend::Cpu)?, &exact);
    let steps: Vec<f64> = (-1..context.pick(9, 8)).map(|halving| 0.5f64.powi(halving)).collect();
    let mut curve = Vec::new();
    let mut errors = Vec::new();
    for (name, rule) in [("pre-integration", Rule::PreIntegrated), ("midpoint", Rule::Midpoint)] {
        for &step_voxels in &steps {
            (context.say)(&format!("S03: {name}, step {step_voxels}"));
            let options = by_samples(Sampling { step_voxels, rule, termination_opacity: NEVER, ..Sampling::default() });
            let found = distance(&volume.render(&scene, &options)?.0, &exact);
            curve.push(CurvePoint::new(name, step_voxels, GREY_LEVELS * found.linf, None));
            if rule == Rule::PreIntegrated {
                errors.push((1.0 / step_voxels, found.rmse));
            }
        }
    }
    curve.extend(steps.iter().map(|&step| CurvePoint::new("default", step, GREY_LEVELS * default.linf, None)));
    // The error falls irregularly while a step exceeds the ray's path through the hat, so only the finest steps count.
    let order = order_of(&errors[errors.len() - 3..]).unwrap_or(f64::NAN);
    let gates = vec![
        Gate::at_most("default, distance from the reference, grey levels", GREY_LEVELS * default.linf, HALF_A_LEVEL),
        Gate::at_least("pre-integration, order of the root mean square error over the three finest steps", order, 1.7),
    ];
    let note = "The default takes no steps: it cuts the cubic of each cell where it crosses a control point of the \
                transfer function, so that there is no segment over which the value bends around the hat; its line \
                is level because nothing in it depends on a step. It is not adaptive halving, which this project \
                does not have, but the regime is the same.";
    Ok(Outcome { curve, gates, note: note.into() })
}

/// Bits and codes per voxel of S04's ramp: 12 bit (4,095 at the end) and 16 bit (65,520).
const CODES_PER_VOXEL: [(u32, f64); 2] = [(12, 65.0), (16, 1040.0)];
/// Opacity at the top of the spike.
const SPIKE_ALPHA: f64 = 0.9;
/// Path length in the spike, in unit distances: so long that few Gauss pairs are not exact up to rounding.
const SPIKE_DEPTH: f64 = 6.0;
/// Number of spikes in the root mean square error: one spike may be hit by chance.
const SPIKES: u32 = 8;
/// Red at the three points of the spike.
const SPIKE_RED: [f64; 3] = [0.0, 0.3, 1.0];

fn narrow_spikes(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let exact = spike_exactly();
    let (mut curve, mut gates) = (Vec::new(), Vec::new());
    for (bits, slope) in CODES_PER_VOXEL {
        let source = Computed::new([64, 4, 4], VoxelType::U16, move |[x, _, _]| slope * x as f64);
        let volume = Volume::build(context, &format!("s04 {bits}"), &source, &build_options(16))?;
        let through = |options: &RenderOptions| -> Result<SpikeError, ChartError> {
            let mut sum = SpikeError::default();
            for i in 0..SPIKES {
                let code = ((0.21 + 0.037 * f64::from(i)) * 63.0 * slope).floor();
                let [red, opacity] = spike_picture(&volume, code, 1.0 / slope, options)?;
                sum.red += (red - exact[0]).powi(2) / f64::from(SPIKES);
                sum.opacity = sum.opacity.max((opacity / exact[1] - 1.0).abs());
            }
            Ok(SpikeError { red: GREY_LEVELS * sum.red.sqrt(), ..sum })
        };
        let series = |name: &str| format!("{name}, {bits} bit");
        let mut errors = Vec::new();
        for pairs in [1, 2, 4, 8, 16] {
            let error = through(&fixed_pairs(pairs))?.red;
            // Two parts, one on each side of the spike's top, each with this many pairs of samples.
            let samples = f64::from(4 * pairs);
            curve.push(CurvePoint::new(&series("default, fixed number of pairs"), samples, error, None));
            errors.push((samples, error));
        }
        let sampled = |samples_per_voxel: f64, rule| {
            let step_voxels = 1.0 / samples_per_voxel;
            by_samples(Sampling { step_voxels, rule, termination_opacity: NEVER, ..Sampling::default() })
        };
        for samples in [1.0 / slope, 1.0, 4.0, 16.0] {
            let found = through(&sampled(samples * slope, Rule::Midpoint))?;
            curve.push(CurvePoint::new(&series("midpoint"), samples, found.red, None));
        }
        let table = through(&sampled(1.0, Rule::PreIntegrated))?;
        curve.push(CurvePoint::new(&series("pre-integration, one sample per voxel"), 1.0 / slope, table.red, None));
        let default = through(&default_unterminated())?;
        // Adaptive pairs have no fixed number of samples: they are drawn at the last position.
        curve.push(CurvePoint::new(&series("default"), 64.0, default.red, None));
        let order = order_of(&errors[..3]).unwrap_or(f64::NAN);
        gates.extend([
            Gate::at_most(series("default, red, grey levels"), default.red, HALF_A_LEVEL),
            Gate::at_most(series("default, the spike is hit: opacity / exact - 1"), default.opacity, 2e-3),
            Gate::at_least(series("default, order over 1, 2, 4 pairs"), order, 1.7),
            Gate::at_most(series("pre-integration, the spike is hit: opacity / exact - 1"), table.opacity, 2e-3),
        ]);
    }
    let note = "The default reads no table of values: it finds where the cell's cubic crosses the spike's points, \
                whatever the bit depth. One midpoint per voxel meets the spike once in 65 and once in 1,040 rays at \
                most. Pre-integration by prefix sums hits it with one sample per voxel; its colour is the average \
                over the spike, not attenuated from front to back.";
    Ok(Outcome { curve, gates, note: note.into() })
}

/// Errors of the light through spikes.
#[derive(Debug, Clone, Copy, Default)]
struct SpikeError {
    /// Root mean square error of red, grey levels.
    red: f64,
    /// Greatest error of the opacity, as a fraction of the opacity.
    opacity: f64,
}

/// Red and opacity of a ray along the ramp; `length` is its world length inside the spike.
fn spike_picture(volume: &Volume, code: f64, length: f64, options: &RenderOptions) -> Result<[f64; 2], ChartError> {
    let at = |i: usize| [SPIKE_RED[i], 0.5, 0.2];
    let points = [(code - 0.5, at(0), 0.0), (code, at(1), SPIKE_ALPHA), (code + 0.5, at(2), 0.0)];
    let tf = transfer_function(length / SPIKE_DEPTH, &points);
    let scene = volume.scene(&[&looking_along(volume, 0, 2.0), &image_size(2, 2), &tf])?;
    let image = volume.render(&scene, options)?.0;
    let [red, _, _, opacity] = pixel(&image, 0, 0)?;
    Ok([red, opacity])
}

/// The integral through the spike, front to back, by many midpoint samples.
fn spike_exactly() -> [f64; 2] {
    const SAMPLES: u32 = 200_000;
    let (mut red, mut transmittance) = (0.0, 1.0);
    for i in 0..SAMPLES {
        let u = (f64::from(i) + 0.5) / f64::from(SAMPLES);
        let (side, share) = if u < 0.5 { (0, 2.0 * u) } else { (1, 2.0 * u - 1.0) };
        let alpha = SPIKE_ALPHA * if side == 0 { share } else { 1.0 - share };
        let opacity = -(SPIKE_DEPTH * (-alpha).ln_1p() / f64::from(SAMPLES)).exp_m1();
        red += transmittance * opacity * (SPIKE_RED[side] + share * (SPIKE_RED[side + 1] - SPIKE_RED[side]));
        transmittance *= 1.0 - opacity;
    }
    [red, 1.0 - transmittance]
}
