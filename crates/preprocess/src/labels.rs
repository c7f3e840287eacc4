//! Whether voxels are labels, by what samples of them hold: then coarser levels must not be means.
//!
//! Labels are few whole numbers, and neighbours are equal except where two regions meet. Where most of a volume is background,
//! as in fluorescence, neighbours are equal there in whatever is measured, too: so that only pairs count of which one is not.

use std::collections::BTreeMap;

use supervol_format::VoxelType;

use crate::lod_axes::{Sample, sample_boxes};
use crate::source::{SourceError, VolumeSource};

/// Fewest and most different values. Two are a mask, whose mean says how much of a voxel is in it.
const VALUES: std::ops::RangeInclusive<usize> = 3..=256;
/// Least share of equal neighbours.
const EQUAL: f64 = 0.8;
/// Fewest pairs that say anything.
const PAIRS: u64 = 1000;

/// Whether the voxels of a source are labels.
///
/// # Errors
/// If samples cannot be read.
pub fn are_labels(source: &dyn VolumeSource) -> Result<bool, SourceError> {
    let info = source.info();
    let is_whole = !matches!(info.voxel_type, VoxelType::F32 | VoxelType::F64);
    let is_scaled = info.scale != 1.0 || info.offset != 0.0;
    if !is_whole || is_scaled || info.survey.is_some() {
        return Ok(false);
    }
    Ok(look_like_labels(&sample_boxes(source)?))
}

fn look_like_labels(samples: &[Sample]) -> bool {
    let mut counts: BTreeMap<i64, u64> = BTreeMap::new();
    for &value in samples.iter().flat_map(|sample| &sample.values).filter(|v| v.is_finite()) {
        *counts.entry(value as i64).or_default() += 1;
        if counts.len() > *VALUES.end() {
            return false;
        }
    }
    let Some((&background, _)) = counts.iter().max_by_key(|(_, count)| **count) else { return false };
    let (mut equal, mut pairs) = (0, 0);
    for sample in samples {
        for (a, b) in (0..3).flat_map(|axis| sample.pairs(axis)).filter(|(a, b)| a.is_finite() && b.is_finite()) {
            let is_background = a as i64 == background && b as i64 == background;
            pairs += u64::from(!is_background);
            equal += u64::from(!is_background && a == b);
        }
    }
    VALUES.contains(&counts.len()) && pairs >= PAIRS && equal as f64 >= EQUAL * pairs as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::computed::Computed;

    fn are(voxel_type: VoxelType, value: fn([u64; 3]) -> f64) -> bool {
        are_labels(&Computed::new([96, 96, 96], voxel_type, value)).unwrap()
    }

    fn distance([x, y, z]: [u64; 3]) -> f64 {
        [x, y, z].map(|v| (v as f64 - 48.0).powi(2)).iter().sum::<f64>().sqrt()
    }

    #[test]
    fn regions_of_few_whole_numbers_are_labels_and_nothing_else_is() {
        let regions = |p: [u64; 3]| if distance(p) < 20.0 { 7.0 } else { ((p[0] / 24) % 3) as f64 };
        assert!(are(VoxelType::U8, regions) && are(VoxelType::I16, regions));
        assert!(!are(VoxelType::F32, regions), "floating-point numbers are measured");
        assert!(!are(VoxelType::U8, |p| f64::from(distance(p) < 30.0)), "a mask has a mean");
        assert!(!are(VoxelType::U8, |p| (4.0 * distance(p)) % 256.0), "smooth");
        assert!(!are(VoxelType::U8, |p| ((p[0] * 31 + p[1] * 17 + p[2] * 7) % 5) as f64), "noise of few values");
        // A few bright spots in the dark, as in fluorescence.
        assert!(!are(VoxelType::U8, |p| (200.0 - 40.0 * distance(p)).max(0.0)));
        assert!(!are(VoxelType::U8, |_| 3.0), "constant");
    }
}
