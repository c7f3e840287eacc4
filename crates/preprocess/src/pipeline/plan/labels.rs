//! Detection of labels from samples of the voxels. Coarser levels of labels must not be means.
//!
//! Labels are few integers, and neighbours are equal except at region borders. A measured volume that is mostly
//! background, such as fluorescence, has equal neighbours there, too. So only pairs with at least one non-background
//! voxel count.

use std::collections::BTreeMap;

use supervol_format::VoxelType;
use supervol_format::cast::whole;
use supervol_sources::SourceInfo;

use crate::pipeline::plan::lod_axes::Sample;

/// Number of different values of a label volume. Two values are a mask, whose mean is a meaningful share.
const VALUES: std::ops::RangeInclusive<usize> = 3..=256;
/// Least share of equal neighbours.
const EQUAL: f64 = 0.8;
/// Fewest pairs for a decision.
const PAIRS: u64 = 1000;

/// Whether the voxels of a source may be labels, judged by its description.
pub(crate) fn may_be_labels(info: &SourceInfo) -> bool {
    let is_whole = !matches!(info.voxel_type, VoxelType::F32 | VoxelType::F64);
    let is_scaled = info.scale != 1.0 || info.offset != 0.0;
    is_whole && !is_scaled && info.survey.is_none()
}

/// Whether voxels that may be labels look like labels.
pub(crate) fn look_like_labels(samples: &[Sample]) -> bool {
    let Some(counts) = counts_of(samples) else { return false };
    let Some((&background, _)) = counts.iter().max_by_key(|(_, count)| **count) else { return false };
    let (mut equal, mut pairs) = (0, 0);
    for sample in samples {
        for (a, b) in (0..3).flat_map(|axis| sample.pairs(axis)).filter(|(a, b)| a.is_finite() && b.is_finite()) {
            let is_background = whole::<i64>(a) == background && whole::<i64>(b) == background;
            pairs += u64::from(!is_background);
            equal += u64::from(!is_background && a == b);
        }
    }
    VALUES.contains(&counts.len()) && pairs >= PAIRS && equal as f64 >= EQUAL * pairs as f64
}

/// Number of occurrences of each value; `None` if there are too many different values.
fn counts_of(samples: &[Sample]) -> Option<BTreeMap<i64, u64>> {
    // Most labels are small numbers, which need no search.
    let mut small = [0; 1 << u8::BITS];
    let mut counts = BTreeMap::new();
    for &value in samples.iter().flat_map(|sample| &sample.values).filter(|v| v.is_finite()) {
        match small.get_mut(whole::<usize>(value)) {
            Some(count) if value >= 0.0 => *count += 1,
            _ => *counts.entry(whole::<i64>(value)).or_default() += 1,
        }
        if counts.len() > *VALUES.end() {
            return None;
        }
    }
    counts.extend((0..).zip(small).filter(|(_, count)| *count > 0));
    Some(counts)
}

#[cfg(test)]
mod tests {
    use supervol_sources::VolumeSource;
    use supervol_sources::computed::Computed;

    use super::*;
    use crate::pipeline::plan::lod_axes::sample_boxes;

    fn are(voxel_type: VoxelType, value: fn([u64; 3]) -> f64) -> bool {
        let source = Computed::new([96, 96, 96], voxel_type, value);
        may_be_labels(source.info()) && look_like_labels(&sample_boxes(&source).unwrap())
    }

    fn distance([x, y, z]: [u64; 3]) -> f64 {
        [x, y, z].map(|v| (v as f64 - 48.0).powi(2)).iter().sum::<f64>().sqrt()
    }

    #[test]
    fn regions_of_few_whole_numbers_are_labels_and_nothing_else_is() {
        let regions = |p: [u64; 3]| if distance(p) < 20.0 { 7.0 } else { ((p[0] / 24) % 3) as f64 };
        assert!(are(VoxelType::U8, regions) && are(VoxelType::I16, regions));
        assert!(are(VoxelType::I16, |p| [-5.0, 300.0, 7.0][(p[0] / 24 % 3) as usize]), "whatever their numbers");
        assert!(!are(VoxelType::F32, regions), "floating-point numbers are measured");
        assert!(!are(VoxelType::U8, |p| f64::from(distance(p) < 30.0)), "a mask has a mean");
        assert!(!are(VoxelType::U8, |p| (4.0 * distance(p)) % 256.0), "smooth");
        assert!(!are(VoxelType::U8, |p| ((p[0] * 31 + p[1] * 17 + p[2] * 7) % 5) as f64), "noise of few values");
        // A few bright spots in the dark, as in fluorescence.
        assert!(!are(VoxelType::U8, |p| (200.0 - 40.0 * distance(p)).max(0.0)));
        assert!(!are(VoxelType::U8, |_| 3.0), "constant");
    }
}
