//! Convergence of the default integration in pictures of ML 40^3. Cells are split at the transfer function's control
//! points, with 1, 2 or 4 Gauss pairs per part. The default adapts the number of pairs to each part; here it is fixed.

use supervol_runtime::render::options::Backend;

use super::{Case, FUNCTIONS, OrderRow, function};
use crate::context::{ChartError, Context};
use crate::fixtures;
use crate::measure::distance;
use crate::stability::parallel::fixed_pairs;
use crate::volume::{Point, Volume, build_options, image_size, transfer_function};

/// Name of the rule.
pub(super) const RULE: &str = "cells (default), fixed number of Gauss pairs";
/// World length over which alpha is gathered, voxels. Opacity is four times that on single rays, so that the error of
/// few pairs exceeds the rounding of `f32`.
const UNIT_DISTANCE: f64 = 0.25;
/// Opacity per voxel of the fog that measures the lengths of rays.
const FOG: f64 = 0.001;

/// One row per transfer function.
pub(super) fn rows(context: &Context<'_>) -> Result<Vec<OrderRow>, ChartError> {
    let volume = Volume::build(context, "convergence", &fixtures::marschner_lobb(40), &build_options(16))?;
    let pixels = context.pick(64, 20);
    let view = [volume.outside(), image_size(pixels, pixels)];
    let voxels = voxels_crossed(&volume, &view)?;
    let mut rows = Vec::new();
    for name in FUNCTIONS {
        (context.say)(&format!("orders of convergence: pictures, {name}"));
        let tf = function(name, UNIT_DISTANCE).map_err(|e| ChartError::Broken(e.to_string()))?;
        let points: Vec<Point> = tf.points().iter().map(|p| (p.value, p.color, p.alpha)).collect();
        let scene = volume.scene(&[&view[0], &view[1], &transfer_function(UNIT_DISTANCE, &points)])?;
        let exact = volume.finest(&scene, Backend::Reference)?;
        let mut curve = Vec::new();
        for pairs in [1, 2, 4] {
            let (image, stats) = volume.render(&scene, &fixed_pairs(pairs))?;
            curve.push((stats.casting.samples as f64 / voxels, distance(&image, &exact).rmse));
        }
        let case = Case { field: "trilinear 40^3", transfer_function: name, rule: RULE };
        rows.push(OrderRow::new(case, curve, 0.0, None)?);
    }
    Ok(rows)
}

/// Total length of all rays of a view inside the volume, in voxels, computed from the opacity of a thin fog.
fn voxels_crossed(volume: &Volume, view: &[String; 2]) -> Result<f64, ChartError> {
    let scene = volume.scene(&[&view[0], &view[1], &transfer_function(1.0, &[(0.0, [0.0; 3], FOG)])])?;
    let fog = volume.finest(&scene, Backend::Cpu)?;
    Ok(fog.pixels.iter().map(|p| (1.0 - f64::from(p[3])).ln() / (1.0 - FOG).ln()).sum())
}
