//! Spread of fine values within coarse voxels, for transfer functions that show nothing of averages.
//!
//! A coarse voxel is the average of many. Seismic amplitudes average to zero, which their transfer function leaves
//! transparent: a sketch from the coarsest level would be empty. If most opacity is lost that way, voxels of coarse
//! levels are classified by the values they average. These are modelled as spread around the voxel as the volume's
//! values are around their mean, scaled to the variance that averaging removed. The transfer function of a level is
//! then the mean over that spread (after Younesy, Möller and Carr 2006, "Improving the quality of multi-resolution
//! volume rendering", who store mean and deviation of each voxel). It is used for intermediate pictures only, never for
//! the final one.

use supervol_format::{Container, Lod};
use supervol_scene::facts::histogram::Histogram;
use supervol_scene::transfer_function::{ControlPoint, TransferFunction};
use supervol_scene::units::InUnits;
use supervol_scene::value_map::ValueMap;

use crate::stream::residency::{DecodedBrick, Voxels};

/// Points of a transfer function for coarse levels: half the bins of a manifest's histogram.
const POINTS: usize = 128;
/// Stride of the voxels of the coarsest level that are sampled: about ten thousand samples.
const STRIDE: usize = 23;
/// Least useful spread, as a share of the volume's: narrower ones change nothing visible in large pixels.
const LEAST_SPREAD: f64 = 0.1;

/// Spread of values, see the module. Values are in a picture's units.
#[derive(Debug, Clone)]
pub struct Spread {
    /// Values of level 0 minus their mean, and their shares.
    around_mean: Vec<(f64, f64)>,
    mean: f64,
    /// Values of voxels of the coarsest level.
    coarsest: Vec<f64>,
    /// Standard deviation lost in the coarsest level, as a share of level 0's.
    lost: f64,
    /// Ends of the range of values.
    range: [f64; 2],
}

impl Spread {
    /// The spread of a volume whose coarsest level has these voxel values; `None` if nothing varies or nothing is lost.
    #[must_use]
    pub fn of(container: &Container, coarsest: Vec<f64>) -> Option<Self> {
        let (manifest, in_units) = (container.manifest(), InUnits::of(container));
        let (counts, range) = match manifest.central() {
            Some(central) => (&central.histogram, in_units.central_range),
            None => (&manifest.histogram, in_units.value_range),
        };
        if counts.is_empty() || range.is_empty() || container.pyramid().coarsest() == Lod::FINEST {
            return None;
        }
        let fine: Vec<(f64, f64)> = Histogram::new(counts, range).shares().collect();
        let mean: f64 = fine.iter().map(|(value, share)| share * value).sum();
        let variance: f64 = fine.iter().map(|(value, share)| share * (value - mean).powi(2)).sum();
        // Averages with far values count as the nearest central value.
        let coarsest: Vec<f64> = coarsest.into_iter().map(|value| value.clamp(range.min, range.max)).collect();
        let count = coarsest.len() as f64;
        let coarse_mean = coarsest.iter().sum::<f64>() / count;
        let left = coarsest.iter().map(|value| (value - coarse_mean).powi(2)).sum::<f64>() / count;
        // Total variance is the variance of the averages plus the variance within them.
        let lost = (1.0 - left / variance).max(0.0).sqrt();
        let around_mean = fine.into_iter().map(|(value, share)| (value - mean, share)).collect();
        // False also if there are no voxels, or all are equal.
        (lost >= LEAST_SPREAD).then_some(Self { around_mean, mean, coarsest, lost, range: [range.min, range.max] })
    }

    /// The transfer function that shows of level `level` of `levels` what `function` shows of level 0; `None` if
    /// `function` itself will do.
    #[must_use]
    pub fn transfer_function(
        &self,
        of_finest: &TransferFunction,
        level: Lod,
        coarsest: Lod,
    ) -> Option<TransferFunction> {
        // Assumption, not measured: each level loses half of the variance, until the loss of the coarsest level is
        // reached.
        let halvings = f64::from(coarsest.0.saturating_sub(level.0));
        let scale = self.lost * (-0.5 * halvings).exp2();
        let fine = self.around_mean.iter().map(|(offset, share)| (self.mean + offset, *share));
        if level == Lod::FINEST || scale < LEAST_SPREAD || !of_finest.loses(&self.coarsest, fine) {
            return None;
        }
        let [low, high] = self.range;
        let points = (0..POINTS).map(|i| {
            let value = low + (high - low) * i as f64 / (POINTS - 1) as f64;
            let (mut kappa, mut emission) = (0.0, [0.0; 3]);
            for (offset, share) in &self.around_mean {
                let (color, alpha) = of_finest.classify(value + scale * offset);
                let weight = share * of_finest.kappa(alpha);
                kappa += weight;
                emission = std::array::from_fn(|c| emission[c] + weight * color[c]);
            }
            let color = emission.map(|e| if kappa > 0.0 { (e / kappa).clamp(0.0, 1.0) } else { 0.0 });
            ControlPoint { value, color, alpha: -(-kappa * of_finest.unit_distance()).exp_m1() }
        });
        TransferFunction::new(points.collect(), of_finest.unit_distance()).ok()
    }
}

/// Values of some voxels of a brick, evenly spread, without absent ones.
#[must_use]
pub fn values_of(brick: &DecodedBrick, map: &ValueMap) -> Vec<f64> {
    let of_number =
        |number: u16| (map.absent != Some(number)).then(|| map.to_data(map.from_stored_number(f32::from(number))));
    match &brick.voxels {
        Voxels::U8(voxels) => voxels.iter().step_by(STRIDE).filter_map(|&v| of_number(v.into())).collect(),
        Voxels::U16(voxels) => voxels.iter().step_by(STRIDE).filter_map(|&v| of_number(v)).collect(),
        Voxels::F32(voxels) => {
            let present = voxels.iter().step_by(STRIDE).filter(|v| !v.is_nan());
            present.map(|&v| map.to_data(v)).collect()
        }
    }
}
