//! Regimes of stated errors: S49 to S51. Many cells are uncertain at once, so that their errors could add up.

use supervol_format::VoxelType;
use supervol_format::cast::index;
use supervol_format::random::Random;
use supervol_runtime::render::options::{Backend, RenderOptions};
use supervol_sources::computed::Computed;

use super::regime::{CurvePoint, Gate, Outcome, Regime};
use super::views::{BLUE, GOLD, RED, WHITE, fractions};
use crate::context::{ChartError, Context};
use crate::fixtures;
use crate::stated::Pixels;
use crate::volume::{Volume, build_options, finest, image_size};

/// The regimes of this module.
pub const REGIMES: &[Regime] = &[
    Regime {
        id: "S49",
        title: "Noise: many uncertain cells at once",
        recipe: "Waves with more and more noise of single voxels, thin opacities, light from the camera; true and stated error of each \
                 pixel, at four requested errors.",
        x_label: "noise, share of the value range",
        y_label: "greatest error of a pixel, grey levels of 255",
        run: noise,
    },
    Regime {
        id: "S50",
        title: "Gradients of every direction in a cell",
        recipe: "Plane waves across the diagonal, lit with a narrow highlight: towards half a cycle per voxel, the gradients at a \
                 cell's corners point in opposite directions, so that between them there may be no gradient at all.",
        x_label: "cycles per voxel",
        y_label: "greatest error of a pixel, grey levels of 255",
        run: gradients,
    },
    Regime {
        id: "S51",
        title: "Thin opacities over long rays",
        recipe: "Noise along the long axis of a thin volume, 0.0005 to 0.04 opaque per voxel, seen from its end: each cell is off by \
                 little, and there are many.",
        x_label: "cells along a ray",
        y_label: "greatest error of a pixel, grey levels of 255",
        run: long_rays,
    },
];

/// Requested errors, grey levels of 255.
const ASKED: [f64; 4] = [0.1, 0.5, 2.0, 8.0];
/// Light of the scenes.
const LIT: &str = r#""shading": {"ambient": 0.2, "diffuse": 0.7, "specular": 0.4, "shininess": 60}"#;

/// A volume with its scene, at one place of the regime.
struct Case {
    x: f64,
    volume: Volume,
    members: Vec<String>,
}

/// Noise of single voxels, even from 0 to 1, the first axis fastest.
fn noise_of(dims: [u64; 3], seed: u64) -> impl Fn([u64; 3]) -> f64 + Send + Sync {
    let mut random = Random::new(seed);
    let values: Vec<f64> = (0..dims.iter().product::<u64>()).map(|_| random.unit()).collect();
    move |[x, y, z]| values[index((z * dims[1] + y) * dims[0] + x)]
}

/// Curve and gates: of every pixel, the true error is at most the stated one, and that at most the requested one.
fn outcome(cases: Vec<Case>, note: &str) -> Result<Outcome, ChartError> {
    let (mut curve, mut compared) = (Vec::new(), 0);
    let (mut beyond_stated, mut beyond_asked) = (0.0f64, 0.0f64);
    for Case { x, volume, members } in cases {
        let members: Vec<&str> = members.iter().map(String::as_str).collect();
        let scene = volume.scene(&members)?;
        let exact = volume.finest(&scene, Backend::Reference)?;
        for asked in ASKED {
            let mut pixels = Pixels::new(0, asked);
            let aimed = RenderOptions { predict_error: true, ..finest(Backend::Cpu) };
            pixels.draw(0, &volume, &scene, &exact, aimed)?;
            let found = pixels.finish();
            curve.push(CurvePoint::new(&format!("true, {asked} asked"), x, found.largest_true_grey_levels, None));
            curve.push(CurvePoint::new(&format!("stated, {asked} asked"), x, found.largest_stated_grey_levels, None));
            beyond_stated = beyond_stated.max(found.largest_share_of_stated);
            beyond_asked = beyond_asked.max(found.largest_stated_grey_levels / asked);
            compared += found.pixels;
        }
    }
    let gates = vec![
        Gate::at_most("true error of a pixel, share of the stated one", beyond_stated, 1.0),
        Gate::at_most("stated error of a pixel, share of the requested one", beyond_asked, 1.0),
        Gate::at_least("pixels that are off by more than 0.01 grey levels", compared as f64, 10.0),
    ];
    Ok(Outcome { curve, gates, note: note.into() })
}

fn noise(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let edge = context.pick(48, 16);
    let size = context.pick(image_size(64, 48), image_size(28, 21));
    let shares = context.pick(&[0.0, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0][..], &[0.0, 0.2, 1.0][..]);
    let cases = shares.iter().map(|&share| {
        let noise = noise_of([edge; 3], 1);
        let waves = move |v| fixtures::waves_at(fixtures::point(v)) * (1.0 - share) + share * noise(v);
        let source = Computed::new([edge; 3], VoxelType::F32, waves);
        let volume = Volume::build(context, &format!("S49 {share}"), &source, &build_options(16))?;
        let points = [(0.0, BLUE, 0.0005), (0.3, GOLD, 0.04), (0.5, RED, 0.01), (0.7, WHITE, 0.03), (1.0, BLUE, 0.005)];
        let tf = fractions(&volume, volume.facts.geometry.smallest_spacing(), &points);
        Ok(Case { x: share, volume, members: vec![tf, LIT.into(), size.clone()] })
    });
    outcome(cases.collect::<Result<_, ChartError>>()?, "")
}

fn gradients(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let edge = context.pick(32, 12);
    let size = context.pick(image_size(64, 48), image_size(28, 21));
    let cycles = context.pick(&[0.05, 0.1, 0.2, 0.3, 0.4, 0.45, 0.5][..], &[0.1, 0.4, 0.5][..]);
    let cases = cycles.iter().map(|&cycles| {
        let wave = move |v: [u64; 3]| {
            let phase = v[0] as f64 + 0.83 * v[1] as f64 + 0.71 * v[2] as f64;
            0.5 + 0.5 * (std::f64::consts::TAU * cycles * phase).sin()
        };
        let source = Computed::new([edge; 3], VoxelType::F32, wave);
        let volume = Volume::build(context, &format!("S50 {cycles}"), &source, &build_options(16))?;
        let points = [(0.0, BLUE, 0.0), (0.4, GOLD, 0.2), (0.6, WHITE, 0.02), (1.0, RED, 0.3)];
        let tf = fractions(&volume, volume.facts.geometry.smallest_spacing(), &points);
        Ok(Case { x: cycles, volume, members: vec![tf, LIT.into(), size.clone()] })
    });
    outcome(cases.collect::<Result<_, ChartError>>()?, "")
}

fn long_rays(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let lengths = context.pick(&[10, 30, 100, 300, 1000][..], &[10, 300][..]);
    let size = context.pick(image_size(24, 24), image_size(12, 12));
    let cases = lengths.iter().map(|&cells| {
        let dims = [8, 8, cells + 1];
        let noise = noise_of(dims, 2);
        let volume = Volume::build(
            context,
            &format!("S51 {cells}"),
            &Computed::new(dims, VoxelType::U8, move |v| 255.0 * noise(v)),
            &build_options(16),
        )?;
        let points = [(0.0, WHITE, 0.0005), (0.35, BLUE, 0.04), (0.6, GOLD, 0.002), (1.0, RED, 0.02)];
        let tf = fractions(&volume, volume.facts.geometry.smallest_spacing(), &points);
        let length = cells as f64;
        let camera = format!(
            r#""camera": {{"eye": [3.3, 3.6, {}], "target": [3.5, 3.5, {}], "up": [0, 1, 0], "height": 6}}"#,
            -length,
            0.5 * length
        );
        Ok(Case { x: length, volume, members: vec![tf, LIT.into(), size.clone(), camera] })
    });
    outcome(cases.collect::<Result<_, ChartError>>()?, "")
}
