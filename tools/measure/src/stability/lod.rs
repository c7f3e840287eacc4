//! Regimes of levels of detail: S14, S15 (two levels in one picture), S16, S17, S18 (losses by averaging).
//!
//! S14 and S15 force a mix of levels: some bricks are answered as if they had failed. The others test automatic levels
//! in views in which one pixel covers several voxels. Their reference is level 0 averaged over the pixel (16 rays). The
//! x of their curves is voxels of level 0 per pixel.

use std::collections::BTreeMap;

use glam::DVec3;
use supervol_format::cast::narrow;
use supervol_format::{BrickKey, Lod};
use supervol_preprocess::BuildOptions;
use supervol_preprocess::lod_axes::LodAxes;
use supervol_runtime::render::accuracy::reference;
use supervol_runtime::render::options::Backend;
use supervol_scene::image::{Image, greatest};
use supervol_scene::scene::ResolvedScene;
use supervol_sources::{Axis, Survey, VolumeSource};

use super::regime::{CurvePoint, Gate, Outcome, Regime};
use super::views::{
    BLUE, GOLD, GREY_LEVEL, HALF_A_LEVEL, SHADED, WHITE, automatic, fractions, grey_levels, mean_opacity, orthographic,
    smooth,
};
use crate::context::{ChartError, Context};
use crate::fixtures::{self, Thin};
use crate::measure::distance;
use crate::resident::{Mixed, ResidentBricks, at_level};
use crate::ricker::Ricker;
use crate::volume::{HOST_MEMORY_BYTES, Volume, build_options, finest, image_size, transfer_function};

/// The regimes of this module.
pub const REGIMES: &[Regime] = &[
    Regime {
        id: "S14",
        title: "Step change between levels of detail",
        recipe: "CONST, left half from level 0, right half from a coarser level, opacities from thin to dense; the \
                 picture must not show where the level changes.",
        x_label: "level of the right half",
        y_label: "brightness jump, grey levels of 255",
        run: step_change,
    },
    Regime {
        id: "S15",
        title: "Seams between levels of detail",
        recipe: "SPHERE and ML, a checkerboard of bricks of level 0 and of level 1, 2 or 3, from outside and grazing along \
                 brick faces.",
        x_label: "coarser level of the checkerboard",
        y_label: "distance from the reference, L-infinity, grey levels of 255",
        run: seams,
    },
    Regime {
        id: "S16",
        title: "Averages that the transfer function does not see",
        recipe: "CHECK is +1 and -1 in turn, opaque at both and clear, or nearly so, at 0: every coarser level is 0. Levels \
                 chosen automatically, from farther and farther away.",
        x_label: "voxels of level 0 per pixel",
        y_label: "mean opacity",
        run: mean_vanishes,
    },
    Regime {
        id: "S17",
        title: "Seismic amplitudes collapse along the sample axis",
        recipe: "RICKER at 4 ms. First: how much of the root mean square amplitude each halving along z keeps, by peak \
                 frequency. Then: the seismic preset over levels chosen automatically, from farther and farther away.",
        x_label: "halvings along z; for `opacity`, voxels of level 0 per pixel",
        y_label: "share of the root mean square kept; mean opacity",
        run: seismic_collapse,
    },
    Regime {
        id: "S18",
        title: "Thin features",
        recipe: "SHEET, LINE and POINT of value 1, one voxel wide; visible from 0.5 on. First: the greatest value that each \
                 level keeps. Then: how much of their picture is gone with levels chosen automatically.",
        x_label: "level; for `pixels lost`, voxels of level 0 per pixel",
        y_label: "greatest value; share of pixels that level 0 shows and the picture does not",
        run: thin_features,
    },
];

fn step_change(context: &Context<'_>) -> Result<Outcome, ChartError> {
    const EDGE: u64 = 64;
    const ALPHAS: [f64; 3] = [0.003, 0.02, 0.2];
    let volume = Volume::build(context, "S14", &fixtures::constant([EDGE; 3], 3.0), &build_options(16))?;
    let all = ResidentBricks::load(&volume.container)?;
    let size = context.pick(image_size(96, 64), image_size(24, 16));
    let facing = orthographic(&volume, volume.middle(), DVec3::Y, [0.0, 0.0, 1.0], 40.0);
    let (mut curve, mut worst) = (Vec::new(), 0.0f64);
    let coarsest = volume.container.pyramid().coarsest();
    for coarse in 1..=coarsest.0 {
        let (mut jump, mut uncorrected) = (0.0f64, 0.0f64);
        for alpha in ALPHAS {
            let tf = transfer_function(1.0, &[(3.0, GOLD, alpha)]);
            let right = |key: BrickKey| key.brick().0[0] >= 2;
            let mixed = Mixed { all: &all, coarse: Lod(coarse), is_coarse: &right };
            // Seen straight on, all rays have the same length in the volume: the whole picture has one colour.
            let picture = all.picture(&mixed, &volume.scene(&[&facing, &size, &tf])?, at_level(Lod(0)))?;
            jump = jump.max(spread(&picture) / GREY_LEVEL);
            // Seen obliquely and shaded, the picture equals that of level 0.
            let scene = volume.scene(&[&volume.outside(), &size, &tf, SHADED])?;
            let picture = all.picture(&mixed, &scene, at_level(Lod(0)))?;
            jump = jump.max(grey_levels(&picture, &all.level(&scene, Lod(0))?));
            let opacity = |voxels: f64| 1.0 - (1.0 - alpha).powf(voxels);
            let lost = opacity(EDGE as f64) - opacity(EDGE as f64 / f64::from(1 << coarse));
            uncorrected = uncorrected.max(lost / GREY_LEVEL);
        }
        curve.push(CurvePoint::new("default", f64::from(coarse), jump, Some(0.0)));
        let series = "one sample per voxel of each level, opacity not corrected (closed form)";
        curve.push(CurvePoint::new(series, f64::from(coarse), uncorrected, None));
        worst = worst.max(jump);
    }
    let gates = vec![Gate::at_most("brightness jump, grey levels", worst, HALF_A_LEVEL)];
    Ok(Outcome { curve, gates, note: "Opacities per voxel: 0.003, 0.02, 0.2; the worst is shown.".into() })
}

/// Greatest difference between any two pixels, any channel.
fn spread(picture: &Image) -> f64 {
    let channel = |c: usize| picture.pixels.iter().map(move |p| f64::from(p[c]));
    (0..4).map(|c| channel(c).fold(f64::MIN, f64::max) - channel(c).fold(f64::MAX, f64::min)).fold(0.0, f64::max)
}

fn seams(context: &Context<'_>) -> Result<Outcome, ChartError> {
    const EDGE: u64 = 128;
    let size = context.pick(image_size(64, 48), image_size(24, 18));
    let sphere = Volume::build(context, "S15 SPHERE", &fixtures::sphere(EDGE), &build_options(16))?;
    let ml = Volume::build(context, "S15 ML", &fixtures::marschner_lobb(EDGE), &build_options(16))?;
    let shell = fractions(
        &sphere,
        2.0,
        &[
            (0.0, BLUE, 0.0),
            (0.35, BLUE, 0.0),
            (0.4, GOLD, 0.4),
            (0.45, BLUE, 0.0),
            (0.7, BLUE, 0.0),
            (1.0, WHITE, 0.2),
        ],
    );
    let soft = smooth(&ml, 4.0);
    let mut curve = Vec::new();
    let (mut excess, mut excess_rmse) = (f64::MIN, f64::MIN);
    let mut outside = 0.0f64;
    for (volume, tf) in [(&sphere, &shell), (&ml, &soft)] {
        let all = ResidentBricks::load(&volume.container)?;
        // Along a face between bricks, crossing it at a small angle.
        let grazing = orthographic(volume, [63.5, 63.5, 63.5], DVec3::new(1.0, 0.02, 0.013), [0.0, 0.0, 1.0], 70.0);
        for (view, camera) in [("outside", volume.outside()), ("grazing", grazing)] {
            let scene = volume.scene(&[&camera, &size, tf])?;
            let exact = volume.finest(&scene, Backend::Reference)?;
            let fine = all.level(&scene, Lod(0))?;
            for coarse in 1..=volume.container.pyramid().coarsest().0 {
                let pure = all.level(&scene, Lod(coarse))?;
                let odd = |key: BrickKey| key.brick().0.iter().sum::<u32>() % 2 == 1;
                let mixed = Mixed { all: &all, coarse: Lod(coarse), is_coarse: &odd };
                let mixed = all.picture(&mixed, &scene, at_level(Lod(0)))?;
                let [f, p, m] = [&fine, &pure, &mixed].map(|picture| distance(picture, &exact));
                excess = excess.max((m.linf - f.linf.max(p.linf)) / GREY_LEVEL);
                excess_rmse = excess_rmse.max((m.rmse - f.rmse.max(p.rmse)) / GREY_LEVEL);
                outside = outside.max(beyond(&mixed, [&fine, &pure]) / GREY_LEVEL);
                let x = f64::from(coarse);
                for (name, d) in [("level 0", f), ("coarser level", p), ("checkerboard", m)] {
                    curve.push(CurvePoint::new(
                        &format!("{}, {view}: {name}", &volume.name[4..]),
                        x,
                        d.linf / GREY_LEVEL,
                        None,
                    ));
                }
            }
        }
    }
    let gates = vec![
        Gate::at_most("L-infinity beyond the worse of the two pure levels, grey levels", excess, HALF_A_LEVEL),
        Gate::at_most("RMSE beyond the worse of the two pure levels, grey levels", excess_rmse, HALF_A_LEVEL),
        Gate::at_most("any pixel outside the interval of the two pure levels, grey levels", outside, HALF_A_LEVEL),
    ];
    let note = format!(
        "The band is the whole picture: every ray crosses seams. Errors of opposite sign cancel along a ray of one level and \
         need not along a mixed one, so that a pixel may leave the interval of its own two pure colours; it does so by at \
         most {outside:.2} grey levels, although its distance from the reference stays within that of the worse level."
    );
    Ok(Outcome { curve, gates, note })
}

/// Greatest distance of a pixel's channel outside the interval of two pictures.
fn beyond(picture: &Image, [a, b]: [&Image; 2]) -> f64 {
    let channels = picture.pixels.as_flattened().iter().zip(a.pixels.as_flattened()).zip(b.pixels.as_flattened());
    let outside = channels.map(|((v, a), b)| f64::from((v - a.max(*b)).max(a.min(*b) - v)));
    // Negative inside the interval. NaN counts as outside.
    greatest(outside.filter(|outside| outside.is_nan() || *outside > 0.0))
}

/// A view with a fixed number of voxels per pixel.
struct FarView {
    voxels_per_pixel: u32,
    /// Automatic levels, one ray per pixel.
    automatic: Image,
    /// Level 0, 16 rays per pixel.
    level_0: Image,
    /// Level 0, one ray per pixel: the same rays as the automatic picture.
    same_rays: Image,
    /// Coarsest level of the bricks that the automatic picture read.
    coarsest_read: usize,
}

/// Orthographic pictures of about `window` voxels, with 1, 2, 4, ... voxels per pixel. `target` gives the index point
/// in the picture's centre for each pixel size. The number of pixels is odd, so the middle ray passes through it.
fn far_views(
    volume: &Volume,
    target: impl Fn(u32) -> [f64; 3],
    window: u32,
    members: &[&str],
) -> Result<Vec<FarView>, ChartError> {
    let mut views = Vec::new();
    for voxels_per_pixel in [1, 2, 4, 8] {
        let pixels = window / voxels_per_pixel + 1;
        let height = f64::from(pixels * voxels_per_pixel);
        let camera =
            orthographic(volume, target(voxels_per_pixel), DVec3::new(0.21, 1.0, -0.13), [0.0, 0.0, 1.0], height);
        let size = image_size(pixels, pixels);
        let mut all: Vec<&str> = vec![&camera, &size];
        all.extend(members);
        let one = volume.scene(&all)?;
        all.push(r#""samples_per_pixel": 16"#);
        let averaged = volume.scene(&all)?;
        let (automatic, stats) = volume.render(&one, &automatic(finest(Backend::Cpu)))?;
        let coarsest_read =
            stats.bricks_by_level.iter().filter(|l| l.resident + l.uniform + l.nothing > 0).map(|l| l.level).max();
        views.push(FarView {
            voxels_per_pixel,
            automatic,
            level_0: volume.finest(&averaged, Backend::Cpu)?,
            same_rays: volume.finest(&one, Backend::Cpu)?,
            coarsest_read: coarsest_read.unwrap_or(0),
        });
    }
    Ok(views)
}

fn mean_vanishes(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let edge = context.pick(128, 64);
    let volume = Volume::build(context, "S16", &fixtures::check(edge), &build_options(16))?;
    let (mut curve, mut gates, mut coarsest) = (Vec::new(), Vec::new(), 0);
    for (name, alpha_of_mean) in [("clear at 0", 0.0), ("opacity 0.001 at 0", 0.001)] {
        let tf = transfer_function(1.0, &[(-1.0, GOLD, 0.3), (0.0, WHITE, alpha_of_mean), (1.0, BLUE, 0.3)]);
        let mut worst = 0.0f64;
        for view in far_views(&volume, |_| volume.middle(), 32, &[&tf])? {
            let x = f64::from(view.voxels_per_pixel);
            let (coarse, fine) = (mean_opacity(&view.automatic), mean_opacity(&view.level_0));
            curve.push(CurvePoint::new(
                &format!("{name}, default: levels chosen automatically"),
                x,
                coarse,
                Some(fine),
            ));
            worst = worst.max((coarse - fine).abs());
            coarsest = coarsest.max(view.coarsest_read);
        }
        gates.push(Gate::at_most(format!("|mean opacity - that of level 0|, {name}"), worst, 0.05));
    }
    let note = format!(
        "Expected is level 0 averaged over the pixel. The coarsest level met was {coarsest}. A coarser brick is drawn where its \
         error bound, seen through the transfer function, keeps the picture within the target, or where its voxels are small \
         against a pixel and its mean opacity is that of the values beneath it."
    );
    Ok(Outcome { curve, gates, note })
}

/// Fraction of the root mean square that a mean over 2, 4, ... samples keeps, by peak frequency.
const RMS_KEPT: [(f64, [f64; 5]); 3] = [
    (15.0, [0.98, 0.90, 0.65, 0.28, 0.14]),
    (25.0, [0.94, 0.74, 0.37, 0.17, 0.08]),
    (35.0, [0.89, 0.57, 0.24, 0.12, 0.06]),
];
/// Tolerance of a measured fraction: the known numbers have two digits, and the cubes have a finite number of samples.
const RMS_TOLERANCE: f64 = 0.02;

fn seismic_collapse(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let (mut curve, mut off) = (Vec::new(), 0.0f64);
    for (peak_hz, expected) in RMS_KEPT {
        let dims = [16, 16, context.pick(16384, 4096)];
        let cube = Ricker { peak_hz, ..Ricker::clean(dims) };
        // x and y fit into one brick, so levels halve only z.
        let volume = Volume::build(context, &format!("S17 {peak_hz} Hz"), &cube.source(), &build_options(16))?;
        let scene = volume.scene(&[&image_size(1, 1)])?;
        let finest_rms = level_rms(&volume, 0, &scene)?;
        for (level, &expected) in (1u8..).zip(&expected) {
            let kept = level_rms(&volume, level, &scene)? / finest_rms;
            curve.push(CurvePoint::new(&format!("{peak_hz} Hz"), f64::from(level), kept, Some(expected)));
            off = off.max((kept - expected).abs());
        }
    }
    let (opacities, change, coarsest) = seismic_opacity(context)?;
    curve.extend(opacities);
    let gates = vec![
        Gate::at_most("change of mean opacity between adjacent distances, share", change, 0.10),
        Gate::at_most("|share of root mean square kept - figure|", off, RMS_TOLERANCE),
    ];
    let note = format!(
        "The opacity series is a survey of RICKER built with automatic axes (x and y are halved before z) under the seismic \
         preset; its coarsest level met was {coarsest}. A level that averages reflections away has an error bound as large as \
         they are and a narrower range than the values beneath it; both refuse it."
    );
    Ok(Outcome { curve, gates, note })
}

fn level_rms(volume: &Volume, level: u8, scene: &ResolvedScene) -> Result<f64, ChartError> {
    let values = reference::load_level(&volume.container, Lod(level), scene, HOST_MEMORY_BYTES)?.values;
    Ok((values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt())
}

/// Mean opacity of a survey by distance, its greatest relative change between distances, and the coarsest level.
fn seismic_opacity(context: &Context<'_>) -> Result<(Vec<CurvePoint>, f64, usize), ChartError> {
    let dims = [64, 64, context.pick(512, 256)];
    let source = Ricker::clean(dims).source().with_info(|info| {
        info.axes = [("crossline", "m"), ("inline", "m"), ("time", "ms")]
            .map(|(name, unit)| Axis { name: name.into(), unit: unit.into() });
        info.survey = Some(Survey::plain([dims[0], dims[1]], 4.0));
    });
    let options = BuildOptions { lod_axes: LodAxes::Auto, ..build_options(16) };
    let volume = Volume::build(context, "seismic S17", &source, &options)?;
    // A slab of twelve inlines: thin enough for a half transparent picture.
    let slab = format!(r#""clip": {{"box": [[-0.5, 25.5, -0.5], [63.5, 37.5, {}]]}}"#, dims[2] as f64 - 0.5);
    let members = [r#""transfer_function": "seismic""#, &slab];
    let (mut curve, mut change, mut coarsest) = (Vec::new(), 0.0f64, 0);
    let mut nearer: Option<f64> = None;
    for (x, [opacity, fine]) in mean_opacities(&volume, &members, &mut coarsest)? {
        curve.push(CurvePoint::new("opacity, default: levels chosen automatically", x, opacity, Some(fine)));
        change = change.max(nearer.map_or(0.0, |nearer| (opacity / nearer - 1.0).abs()));
        nearer = Some(opacity);
    }
    Ok((curve, change, coarsest))
}

/// Mean opacities of far pictures by pixel size: of automatic levels, and of level 0. The farthest picture has only 36
/// pixels, and their positions alone change its mean by 10 %. So each value averages pictures with sub-pixel shifts.
fn mean_opacities(volume: &Volume, members: &[&str], coarsest: &mut usize) -> Result<Vec<(f64, [f64; 2])>, ChartError> {
    /// Number of shifts along each side of a pixel.
    const SHIFTS: u32 = 4;
    let mut sums = BTreeMap::new();
    for shift in 0..SHIFTS * SHIFTS {
        let parts = [shift % SHIFTS, shift / SHIFTS].map(|i| (f64::from(i) + 0.5) / f64::from(SHIFTS) - 0.5);
        // The camera looks along y.
        let target_for = |pixel: u32| {
            let [x, y, z] = volume.middle();
            [x + parts[0] * f64::from(pixel), y, z + parts[1] * f64::from(pixel)]
        };
        for view in far_views(volume, target_for, 40, members)? {
            let sum: &mut [f64; 2] = sums.entry(view.voxels_per_pixel).or_default();
            for (sum, picture) in sum.iter_mut().zip([&view.automatic, &view.level_0]) {
                *sum += mean_opacity(picture) / f64::from(SHIFTS * SHIFTS);
            }
            *coarsest = (*coarsest).max(view.coarsest_read);
        }
    }
    Ok(sums.into_iter().map(|(pixel, means)| (f64::from(pixel), means)).collect())
}

fn thin_features(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let edge = context.pick(128, 64);
    let tf = transfer_function(1.0, &[(0.0, BLUE, 0.0), (0.5, BLUE, 0.0), (0.6, GOLD, 0.9), (1.0, GOLD, 0.9)]);
    let (mut curve, mut off, mut lost_most) = (Vec::new(), 0.0f64, 0.0f64);
    for thin in Thin::ALL {
        let source: &dyn VolumeSource = &fixtures::thin(edge, thin);
        let volume = Volume::build(context, &format!("S18 {}", thin.name()), source, &build_options(16))?;
        let scene = volume.scene(&[&image_size(1, 1)])?;
        for level in 0..=volume.container.pyramid().coarsest().0 {
            let values = reference::load_level(&volume.container, Lod(level), &scene, HOST_MEMORY_BYTES)?.values;
            let kept = values.iter().copied().fold(0.0, f64::max);
            let expected = 0.5f64.powi(i32::from(level) * narrow::<i32>(thin.thin_axes()));
            curve.push(CurvePoint::new(
                &format!("{}: greatest value", thin.name()),
                f64::from(level),
                kept,
                Some(expected),
            ));
            off = off.max((kept - expected).abs());
        }
        // The feature is always in the centre of the picture.
        let mut target = volume.middle();
        target[..thin.thin_axes()].fill((edge / 2 + 1) as f64);
        for view in far_views(&volume, |_| target, 32, &[&tf])? {
            let lost = pixels_lost(&view)?;
            let x = f64::from(view.voxels_per_pixel);
            let series = format!("{}, default: pixels lost", thin.name());
            curve.push(CurvePoint::new(&series, x, lost, Some(0.0)));
            lost_most = lost_most.max(lost);
        }
    }
    let gates = vec![
        Gate::at_most("share of pixels that level 0 shows and the automatic picture treats as empty", lost_most, 0.0),
        Gate::at_most("|greatest value - mean's|", off, 1e-6),
    ];
    let note = "Both pictures are of the same rays, which run through the feature; level 0 shows it where its opacity is above half a \
                grey level. A coarser brick that shows less than \
                the range beneath it is refused, and its children are drawn."
        .into();
    Ok(Outcome { curve, gates, note })
}

/// Fraction of the visible pixels of level 0 that are fully transparent in the automatic picture.
fn pixels_lost(view: &FarView) -> Result<f64, ChartError> {
    let shown = |p: &[f32; 4]| f64::from(p[3]) > 0.5 * GREY_LEVEL;
    let pairs = || view.same_rays.pixels.iter().zip(&view.automatic.pixels).filter(|(fine, _)| shown(fine));
    match pairs().count() {
        0 => Err(ChartError::Broken("no ray meets the thin feature".into())),
        all => Ok(pairs().filter(|(_, coarse)| coarse[3] == 0.0).count() as f64 / all as f64),
    }
}
