//! Opacity along a ray (S02, S06, S08, S09): attenuation inside a segment, correction for its length, early
//! termination, and the number format of the sums.
//!
//! The fields are constant along a ray, or two constants one behind the other, so every right answer is a closed form.
//! The measured values come from the whole renderer: from a container to a picture.

use supervol_format::VoxelType;
use supervol_runtime::engines::cells::CellRule;
use supervol_runtime::engines::rules::TERMINATION_OPACITY;
use supervol_runtime::render::options::RenderOptions;
use supervol_scene::image::Image;
use supervol_sources::computed::Computed;

use super::parallel::{
    GREY_LEVELS, HALF_A_LEVEL, NEVER, by_cells, by_samples, default_unterminated, looking_along, pixel, worst,
};
use super::regime::{CurvePoint, Gate, Outcome, Regime};
use crate::comparison::{Accumulation, Rule, Sampling};
use crate::context::{ChartError, Context};
use crate::fixtures;
use crate::volume::{Volume, build_options, image_size, transfer_function};

/// The regimes of this file.
pub const REGIMES: &[Regime] = &[
    Regime {
        id: "S02",
        title: "Self-attenuation neglected",
        recipe: "CONST, one voxel thick, as one segment of optical depth tau; light emitted inside it, with \
                 attenuation inside it and without, over the exact 1 - exp(-tau).",
        x_label: "optical depth of the segment",
        y_label: "colour / exact colour",
        run: self_attenuation,
    },
    Regime {
        id: "S06",
        title: "Opacity correction for the number of samples",
        recipe: "CONST of alpha 0.1 per voxel, 20 voxels long, 5 to 640 samples; exact is 1 - 0.9^20.",
        x_label: "samples along the ray",
        y_label: "opacity of the ray",
        run: opacity_correction,
    },
    Regime {
        id: "S08",
        title: "Bias of early ray termination",
        recipe: "A black body in front of white, cut so that the ray reaches the limit of opacity just before the \
                 white begins: the most that ending it there can cost.",
        x_label: "transmittance at which rays end (1 - limit)",
        y_label: "light lost, grey levels of 255",
        run: early_termination,
    },
    Regime {
        id: "S09",
        title: "Precision of the accumulated opacity",
        recipe: "CONST of a small alpha per voxel, one sample per voxel, hundreds to thousands of voxels; the sums \
                 rounded to 8 bit, half, single and double precision after every sample.",
        x_label: "samples along the ray",
        y_label: "opacity of the ray",
        run: accumulation,
    },
];

/// Side of the picture, pixels; all rays are equal.
const PIXELS: u32 = 4;
/// Side of the view, world length: smaller than all volumes of this file.
const VIEW: f64 = 3.0;
/// Colour of the light with the measured attenuation.
const RED: f64 = 0.25;

/// The picture of a volume with one opacity per voxel and one colour, seen along z.
fn under_constant(volume: &Volume, alpha: f64, options: &RenderOptions) -> Result<Image, ChartError> {
    let tf = transfer_function(1.0, &[(0.0, [RED, 0.5, 1.0], alpha)]);
    let scene = volume.scene(&[&looking_along(volume, 2, VIEW), &image_size(PIXELS, PIXELS), &tf])?;
    Ok(volume.render(&scene, options)?.0)
}

/// Red and opacity of one ray: those of the pixel farthest from `exact` (all rays are equal).
fn gathered(volume: &Volume, alpha: f64, options: &RenderOptions, exact: [f64; 2]) -> Result<[f64; 2], ChartError> {
    let image = under_constant(volume, alpha, options)?;
    let far = |p: &&[f32; 4]| worst([f64::from(p[0]) - exact[0], f64::from(p[3]) - exact[1]]);
    let farthest = image.pixels.iter().max_by(|a, b| far(a).total_cmp(&far(b)));
    let farthest = farthest.ok_or_else(|| ChartError::Broken("a picture without pixels".into()))?;
    Ok([f64::from(farthest[0]), f64::from(farthest[3])])
}

/// Optical depth of a segment, and the brightness factor if attenuation inside the segment is neglected.
const SELF_ATTENUATION: [(f64, f64); 6] =
    [(0.05, 1.025), (0.1, 1.051), (0.25, 1.130), (0.5, 1.271), (1.0, 1.582), (2.0, 2.313)];
/// Rounding of those factors.
const FACTOR_ROUNDING: f64 = 5e-4;

fn self_attenuation(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let constant = Volume::build(context, "s02 constant", &fixtures::constant([6, 6, 1], 0.5), &build_options(16))?;
    // A uniform brick is integrated as one chord. In a ramp the default goes cell by cell with Gauss pairs.
    let ramp = Volume::build(context, "s02 ramp", &fixtures::ramp([6, 6, 1]), &build_options(16))?;
    let whole =
        |rule| by_samples(Sampling { step_voxels: 1.0, rule, termination_opacity: NEVER, ..Sampling::default() });
    let lines = [
        ("default", &constant, default_unterminated()),
        ("default, cell by cell", &ramp, default_unterminated()),
        ("pre-integration", &constant, whole(Rule::PreIntegrated)),
        ("attenuation neglected", &constant, whole(Rule::PreIntegratedNeglecting)),
    ];
    let mut curve = Vec::new();
    for (series, volume, options) in &lines {
        for (tau, factor) in SELF_ATTENUATION {
            let opacity = -(-tau).exp_m1();
            let [red, _] = gathered(volume, opacity, options, [RED * opacity, opacity])?;
            let expected = if *series == "attenuation neglected" { factor } else { 1.0 };
            curve.push(CurvePoint::new(series, tau, red / (RED * opacity), Some(expected)));
        }
    }
    let deviation = |is_meant: fn(&str) -> bool| {
        let meant = curve.iter().filter(|p| is_meant(&p.series));
        worst(meant.map(|p| p.measured - p.expected.unwrap_or(f64::NAN)))
    };
    let gates = vec![
        Gate::at_most("default, |colour / exact - 1|", deviation(|s| s.starts_with("default")), 1e-3),
        Gate::at_most("pre-integration, |colour / exact - 1|", deviation(|s| s == "pre-integration"), 1e-3),
        Gate::at_most(
            "neglected, distance from the known factor",
            deviation(|s| s.starts_with("att")),
            FACTOR_ROUNDING,
        ),
    ];
    let note = "The factor of neglected attenuation is tau / (1 - exp(-tau)): a segment is too bright by it, and no \
                number of samples elsewhere mends that.";
    Ok(Outcome { curve, gates, note: note.into() })
}

/// Length of the ray of S06 in voxels.
const CORRECTED_VOXELS: u64 = 20;
/// Opacity per voxel of S06.
const CORRECTED_ALPHA: f64 = 0.1;

fn opacity_correction(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let field = fixtures::constant([6, 6, CORRECTED_VOXELS], 0.5);
    let volume = Volume::build(context, "s06", &field, &build_options(16))?;
    let length = CORRECTED_VOXELS as f64;
    let exact = 1.0 - (1.0 - CORRECTED_ALPHA).powf(length);
    let mut curve = Vec::new();
    for doubling in 0..8 {
        let n = f64::from(5 << doubling);
        let by = |rule| {
            let step_voxels = length / n;
            by_samples(Sampling { step_voxels, rule, termination_opacity: NEVER, ..Sampling::default() })
        };
        let uncorrected = 1.0 - (1.0 - CORRECTED_ALPHA * length / n).powf(n);
        for (series, options, expected) in [
            ("corrected", by(Rule::Midpoint), exact),
            ("linear rule", by(Rule::LinearOpacity), uncorrected),
            ("default", default_unterminated(), exact),
        ] {
            let [_, opacity] = gathered(&volume, CORRECTED_ALPHA, &options, [RED * expected, expected])?;
            curve.push(CurvePoint::new(series, n, opacity, Some(expected)));
        }
    }
    let deviation = |series: &str| {
        let line = curve.iter().filter(|p| p.series == series);
        worst(line.map(|p| p.measured - p.expected.unwrap_or(f64::NAN)))
    };
    let gates = vec![
        Gate::at_most("corrected opacity at every n, distance from exact", deviation("corrected"), 1e-4),
        Gate::at_most("default, distance from exact", deviation("default"), 1e-4),
        Gate::at_most("linear rule, distance from its own closed form", deviation("linear rule"), 1e-4),
    ];
    let note = format!(
        "Exact is {exact:.4}. The default has no number of samples: it is drawn beside the others as it is. The \
         linear rule (alpha times the step) goes from {:.4} at 5 samples to {:.4} at 640: it is right at one sample \
         per voxel only.",
        1.0 - (1.0 - CORRECTED_ALPHA * 4.0f64).powi(5),
        1.0 - (1.0 - CORRECTED_ALPHA / 32.0).powi(640),
    );
    Ok(Outcome { curve, gates, note })
}

/// Opacity of the body per voxel: so small that a ray ends within 5 % of the limit's transmittance.
const BODY_ALPHA: f64 = 0.05;
/// S08: voxels of the body, voxels of the white behind it, value of the white. The body's values are 0 to 5.
const BODY: (u64, u64, f64) = (200, 12, 100.0);
/// Extra thickness of the body beyond the limit, voxels, so that rounding does not decide.
const BODY_SLACK: f64 = 1e-3;

fn early_termination(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let (depth, white_depth, white) = BODY;
    // The body's value varies across the view; a uniform brick would be integrated as one chord.
    let field = move |[x, _, z]: [u64; 3]| if z < depth { x as f64 } else { white };
    let source = Computed::new([6, 6, depth + white_depth], VoxelType::F32, field);
    let volume = Volume::build(context, "s08", &source, &build_options(16))?;
    let options = by_cells(CellRule::DEFAULT);
    let mut curve = Vec::new();
    for limit in [0.95, 0.99, 0.998, TERMINATION_OPACITY] {
        let by_steps = by_samples(Sampling { step_voxels: 0.5, termination_opacity: limit, ..Sampling::default() });
        let rule = CellRule { termination_opacity: limit, ..CellRule::DEFAULT };
        let series = if limit == TERMINATION_OPACITY { "default" } else { "cells, other limits" };
        for (series, options) in [(series, by_cells(rule)), ("midpoint, two samples per voxel", by_steps)] {
            let lost = worst_loss(&volume, limit, &options)?;
            curve.push(CurvePoint::new(series, 1.0 - limit, GREY_LEVELS * lost, Some(GREY_LEVELS * (1.0 - limit))));
        }
    }
    let default_loss = curve.iter().find(|p| p.series == "default").map_or(f64::NAN, |p| p.measured);
    let beyond = worst(curve.iter().map(|p| (p.measured - p.expected.unwrap_or(f64::NAN)).max(0.0)));
    let wedge = GREY_LEVELS * wedge_bias(&volume, &options)?;
    let gates = vec![
        Gate::at_most("default, most that a pixel loses, grey levels", default_loss, HALF_A_LEVEL),
        Gate::at_most("default, signed mean where every pixel loses the most, grey levels", default_loss.abs(), 0.1),
        Gate::at_most("default, signed mean where the thickness varies, grey levels", wedge.abs(), 0.1),
        Gate::at_most("any limit, loss beyond its bound (1 - limit) 255, grey levels", beyond, 1e-3),
    ];
    let note = format!(
        "Rays end at an opacity of {TERMINATION_OPACITY}. In the recipe's picture all pixels are alike, so that the \
         signed mean is the loss of one pixel: {default_loss:.4} grey levels. Where the body's thickness varies \
         across the picture from 0 to {depth} voxels the signed mean is {wedge:.4}. A mean below 0.1 whatever the \
         picture needs a limit of at least {:.5}.",
        1.0 - 0.1 / GREY_LEVELS
    );
    Ok(Outcome { curve, gates, note })
}

/// Transfer function of S08: black for the body's values, white just above them.
fn body_and_white() -> String {
    let edge = 6.0;
    let body = [0.0; 3];
    transfer_function(
        1.0,
        &[(0.0, body, BODY_ALPHA), (edge, body, BODY_ALPHA), (edge, [1.0; 3], 1.0), (BODY.2, [1.0; 3], 1.0)],
    )
}

/// Loss of a pixel if the body in front is just thick enough to reach the opacity limit.
fn worst_loss(volume: &Volume, limit: f64, options: &RenderOptions) -> Result<f64, ChartError> {
    // The last cell with only body voxels ends at the last voxel of the body.
    let last = BODY.0 as f64 - 1.0;
    let thickness = (1.0 - limit).ln() / (1.0 - BODY_ALPHA).ln() + BODY_SLACK;
    let cut = format!(r#""clip": {{"box": [[-0.5, -0.5, {:?}], [5.5, 5.5, 400.0]]}}"#, last - thickness);
    let scene =
        volume.scene(&[&looking_along(volume, 2, VIEW), &image_size(PIXELS, PIXELS), &body_and_white(), &cut])?;
    let ended = volume.render(&scene, options)?.0;
    let whole = volume.render(&scene, &default_unterminated())?.0;
    let loss = |x, y| Ok::<f64, ChartError>(pixel(&whole, x, y)?[0] - pixel(&ended, x, y)?[0]);
    let losses: Result<Vec<f64>, ChartError> = (0..PIXELS * PIXELS).map(|i| loss(i % PIXELS, i / PIXELS)).collect();
    Ok(worst(losses?))
}

/// Mean difference from the whole picture over all channels. A slanted plane cuts the body: all its thicknesses occur.
fn wedge_bias(volume: &Volume, options: &RenderOptions) -> Result<f64, ChartError> {
    let depth = BODY.0 as f64;
    // The picture is 64 times as wide as high. The plane passes z = depth at its start and z = 0 at its end.
    let slope = depth / VIEW;
    let offset = depth + slope * (2.5 - 0.5 * VIEW);
    let cut = format!(r#""clip": {{"planes": [{{"normal": [{slope:?}, 0, 1], "offset": {offset:?}}}]}}"#);
    let scene =
        volume.scene(&[&looking_along(volume, 2, VIEW / 64.0), &image_size(256, 4), &body_and_white(), &cut])?;
    let ended = volume.render(&scene, options)?.0;
    let whole = volume.render(&scene, &default_unterminated())?.0;
    Ok(crate::measure::distance(&ended, &whole).bias)
}

/// Cases of S09: opacity per voxel, number of voxels, and independently computed sums in 8 bit and in half precision.
const SUMS: [(f64, u64, f64, f64); 4] =
    [(1.5e-3, 1_000, 0.0, 0.766), (3e-3, 500, 0.349, 0.775), (5e-4, 4_000, 0.0, 0.512), (1e-4, 20_000, 0.0, 0.250)];
/// Rounding of those sums.
const SUM_ROUNDING: f64 = 5e-4;

fn accumulation(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let mut curve = Vec::new();
    for (alpha, n, byte, half) in SUMS {
        (context.say)(&format!("S09: {n} voxels of opacity {alpha}"));
        let name = format!("s09 {n}");
        let volume = Volume::build(context, &name, &fixtures::constant([6, 6, n], 0.5), &build_options(16))?;
        let exact = 1.0 - (1.0 - alpha).powf(n as f64);
        let in_numbers =
            |accumulation| by_samples(Sampling { accumulation, termination_opacity: NEVER, ..Sampling::default() });
        for (series, options, expected) in [
            ("default", default_unterminated(), exact),
            ("64-bit float", in_numbers(Accumulation::Double), exact),
            ("32-bit float", in_numbers(Accumulation::Single), exact),
            ("16-bit float", in_numbers(Accumulation::Half), half),
            ("8 bit", in_numbers(Accumulation::Byte), byte),
        ] {
            let [_, opacity] = gathered(&volume, alpha, &options, [RED * expected, expected])?;
            curve.push(CurvePoint::new(series, n as f64, opacity, Some(expected)));
        }
    }
    let deviation = |series: &[&str]| {
        let lines = curve.iter().filter(|p| series.contains(&p.series.as_str()));
        worst(lines.map(|p| p.measured - p.expected.unwrap_or(f64::NAN)))
    };
    let gates = vec![
        Gate::at_most("32-bit float, distance from exact", deviation(&["32-bit float"]), 1e-4),
        Gate::at_most("default and 64-bit float, distance from exact", deviation(&["default", "64-bit float"]), 1e-4),
        Gate::at_most(
            "8 bit and 16-bit float, distance from the known sums",
            deviation(&["8 bit", "16-bit float"]),
            SUM_ROUNDING,
        ),
    ];
    let note = "Exact sums are 0.777, 0.777, 0.865 and 0.865. Below half a unit of the last place an increment \
                vanishes: 8 bit gathers nothing in three of the four cases, half precision stops where its units \
                have grown too large. The default gathers in double precision, cell by cell.";
    Ok(Outcome { curve, gates, note: note.into() })
}
