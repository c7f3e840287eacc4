//! Detection of labels. Coarser levels of labels must not be means, and their voxels are never moved.
//!
//! The caller or the file may say that voxels are labels. Otherwise samples of the voxels decide. Labels are integers,
//! and neighbours are equal except at region borders. A measured volume that is mostly background, such as fluorescence,
//! has equal neighbours there, too. So only pairs with at least one non-background voxel count.
//!
//! Thin regions have many borders, as the cortex has. There, labels differ by any amount, and measured values only by a
//! little. So fewer equal neighbours suffice if the others differ about as much as distant voxels do.

use std::collections::BTreeMap;

use supervol_format::VoxelType;
use supervol_format::cast::whole;
use supervol_sources::SourceInfo;

use crate::pipeline::options::{BuildOptions, Reduce};
use crate::pipeline::plan::lod_axes::Sample;

/// Name of the kind of data that labels are.
pub const KIND: &str = "labels";
/// Fewest different values. Two values are a mask, whose mean is a meaningful share.
const VALUES: usize = 3;
/// Most different values of labels that may differ by little.
const FEW_VALUES: usize = 256;
/// Least share of equal neighbours: of labels that may differ by little, and of others.
const EQUAL: f64 = 0.8;
const EQUAL_OF_SPARSE: f64 = 0.55;
/// Least difference of unequal neighbours, as a share of that of distant voxels: with fewer equal ones, and with more.
const JUMP: f64 = 0.25;
const JUMP_OF_EQUAL: f64 = 0.02;
/// Fewest pairs for a decision.
const PAIRS: u64 = 200;
/// Distance in the list of samples, in shares of its length, of voxels that count as distant.
const DISTANT: f64 = 0.381_966;

/// Whether voxels are labels, and why.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Labels {
    /// They are not.
    None,
    /// The caller says so.
    Named,
    /// The file says so, with the end of a sentence.
    Declared(&'static str),
    /// They look like labels.
    Recognised,
}

impl Labels {
    /// The statement of the caller or else of the file; `None` if neither says anything.
    pub(crate) fn named(options: &BuildOptions, info: &SourceInfo) -> Option<Self> {
        match &options.kind {
            Some(kind) if kind == KIND => return Some(Self::Named),
            Some(_) => return Some(Self::None),
            None => {}
        }
        if let Some(because) = info.labels.filter(|_| info.scale == 1.0 && info.offset == 0.0) {
            return Some(Self::Declared(because));
        }
        matches!(options.reduce, Some(Reduce::Mean | Reduce::Max)).then_some(Self::None)
    }

    /// The decision from samples.
    pub(crate) fn recognised(info: &SourceInfo, samples: &[Sample]) -> Self {
        if may_be_labels(info) && look_like_labels(samples) { Self::Recognised } else { Self::None }
    }

    /// The reason as the end of a sentence; `None` if the voxels are no labels.
    #[must_use]
    pub fn because(self) -> Option<&'static str> {
        match self {
            Self::None => None,
            Self::Named => Some("named when the container was built"),
            Self::Declared(because) => Some(because),
            Self::Recognised => Some("whole numbers, mostly equal to their neighbours"),
        }
    }
}

/// Whether the voxels of a source may be labels, judged by its description.
pub(crate) fn may_be_labels(info: &SourceInfo) -> bool {
    let is_whole = !matches!(info.voxel_type, VoxelType::F32 | VoxelType::F64);
    let is_scaled = info.scale != 1.0 || info.offset != 0.0;
    // DICOM files say whether they are segmentations.
    is_whole && !is_scaled && info.survey.is_none() && info.format != "dicom"
}

/// Whether voxels that may be labels look like labels.
fn look_like_labels(samples: &[Sample]) -> bool {
    let counts = counts_of(samples);
    let Some((&background, _)) = counts.iter().max_by_key(|(_, count)| **count) else { return false };
    let (mut equal, mut pairs, mut jumps) = (0, 0, Vec::new());
    for sample in samples {
        for (a, b) in (0..3).flat_map(|axis| sample.neighbours(axis)).filter(|(a, b)| a.is_finite() && b.is_finite()) {
            let is_background = whole::<i64>(a) == background && whole::<i64>(b) == background;
            pairs += u64::from(!is_background);
            equal += u64::from(!is_background && a == b);
            if a != b {
                jumps.push((a - b).abs());
            }
        }
    }
    if counts.len() < VALUES || pairs < PAIRS {
        return false;
    }
    let equal = equal as f64 / pairs as f64;
    if equal >= EQUAL && counts.len() <= FEW_VALUES {
        return true;
    }
    let least = if equal >= EQUAL { JUMP_OF_EQUAL } else { JUMP };
    equal >= EQUAL_OF_SPARSE && median(jumps) >= least * median(distant_jumps(samples))
}

/// Differences of unequal voxels far from each other.
fn distant_jumps(samples: &[Sample]) -> Vec<f64> {
    let values: Vec<f64> =
        samples.iter().flat_map(|sample| &sample.values).copied().filter(|v| v.is_finite()).collect();
    let distance = whole::<usize>(DISTANT * values.len() as f64);
    let pairs = values.iter().zip(values.iter().skip(distance));
    pairs.map(|(a, b)| (a - b).abs()).filter(|jump| *jump > 0.0).collect()
}

/// The median of numbers; 0 if there are none.
fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers.get(numbers.len() / 2).copied().unwrap_or(0.0)
}

/// Number of occurrences of each value.
fn counts_of(samples: &[Sample]) -> BTreeMap<i64, u64> {
    // Most labels are small numbers, which need no search.
    let mut small = [0; 1 << u8::BITS];
    let mut counts = BTreeMap::new();
    for &value in samples.iter().flat_map(|sample| &sample.values).filter(|v| v.is_finite()) {
        match small.get_mut(whole::<usize>(value)) {
            Some(count) if value >= 0.0 => *count += 1,
            _ => *counts.entry(whole::<i64>(value)).or_default() += 1,
        }
    }
    counts.extend((0..).zip(small).filter(|(_, count)| *count > 0));
    counts
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
        // Sparse numbers of thin regions, and of many regions.
        let thin = |p: [u64; 3]| [0.0, 1003.0, 17.0, 2029.0, 5.0][((p[0] + p[1]) / 3 % 5) as usize];
        assert!(are(VoxelType::I16, thin));
        let many = |p: [u64; 3]| {
            p.iter().fold(7u64, |n, v| (n * 31 + v / 6).wrapping_mul(2_654_435_761) >> 1 & 0x7FFF_FFFF) as f64
        };
        assert!(are(VoxelType::U32, many));
        assert!(!are(VoxelType::I16, |p| (100.0 * (distance(p) / 30.0).sin()).round()), "a smooth field in steps");
        assert!(
            !are(VoxelType::U16, |p| (p[0] * 7919 % 4096 + p[1] * 31 + p[2]) as f64 % 3000.0),
            "noise of many values"
        );
        // A few bright spots in the dark, as in fluorescence.
        assert!(!are(VoxelType::U8, |p| (200.0 - 40.0 * distance(p)).max(0.0)));
        assert!(!are(VoxelType::U8, |_| 3.0), "constant");
    }
}
