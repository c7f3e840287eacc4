//! Selection of the axes that each coarser level halves.
//!
//! `xyz` halves all axes, `xy` halves x and y first. `auto` keeps voxels nearly cubic and loses the least detail. At
//! each level it measures, on sample boxes, the share of the field's variance that survives averaging along each axis.
//! It
//! - never halves the sample axis (z) of a seismic survey while x or y can be halved. Reflections alternate within a
//!   few samples and cancel out (STABILITY, S17);
//! - postpones an axis whose spacing is already twice the smallest (equal units only), or that would lose `WORSE` more
//!   variance than the best axis.
//!
//! An axis that fits one brick is not halved for its own sake; the last level fits one brick on every axis.
//!
//! The same boxes determine the useful precision of means. A mean represents voxels that differ, and its lowest bits
//! describe none of them, but no codec can remove them. Means of floats are therefore rounded to a power of two: the
//! longest one within half the median difference of voxel pairs. The median ignores undeclared fill values.
//! Means of integers are integers already. They are rounded further only in sections, whose coarser levels may take as
//! much room as level 0. Their step is odd, so that no voxel lies halfway. Equal pairs count there, too: for data of
//! few values, means tell the share of each value.
//!
//! The manifest holds the measurements ([`LevelPlan::describe`], [`LevelPlan::describe_steps`]), and `info` shows them.
//! The boxes are the same in every run, at most 27 of 32^3 voxels for any volume. A continued build therefore decides as
//! the killed one did.

use supervol_format::codec::quantize::Quantizer;
use supervol_format::voxel_type::Absence;
use supervol_format::{BrickLayout, Dims, VoxelBox, VoxelType};
use supervol_sources::{SourceError, SourceInfo, VolumeSource};

/// Method of choosing the axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LodAxes {
    /// By measurement, see the module head.
    #[default]
    Auto,
    /// All axes at each level.
    Xyz,
    /// x and y first; z once they fit one brick.
    Xy,
}

/// An axis is postponed if it would lose this much more of the variance than the best one.
const WORSE: f64 = 0.1;
/// Edge of a sample box in voxels.
const SAMPLE_EDGE: u64 = 32;
/// Number of sample boxes along each axis of the volume.
const SAMPLES_ALONG: u64 = 3;
/// Longest step of means, as a share of the median difference of two voxels. A mean then moves by at most half its own
/// distance from either voxel.
const STEP_SHARE: f64 = 0.5;

/// The levels of a volume, and the measurements that chose them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LevelPlan {
    /// Factors of levels 1, 2, ...
    pub factors: Vec<[u32; 3]>,
    /// For each of these levels, the share that halving x, y or z alone would keep of the previous level. It is the RMS
    /// of the deviations from each sample box's mean; 1 if unknown. Empty unless measured.
    pub rms_kept: Vec<[f64; 3]>,
    /// Steps of the means of each of these levels in stored units; 0 if they are not rounded. Empty unless measured.
    pub steps: Vec<f64>,
}

impl LevelPlan {
    /// The measurements as text for the manifest: three shares for each level from level 1 on; levels are separated by
    /// semicolons.
    #[must_use]
    pub fn describe(&self) -> Option<String> {
        let level = |[x, y, z]: &[f64; 3]| format!("{x:.4} {y:.4} {z:.4}");
        (!self.rms_kept.is_empty()).then(|| self.rms_kept.iter().map(level).collect::<Vec<_>>().join("; "))
    }

    /// The steps as text for the manifest: one for each level from level 1 on, separated by semicolons. `None` if no
    /// level is rounded.
    #[must_use]
    pub fn describe_steps(&self) -> Option<String> {
        let is_rounded = self.steps.iter().any(|&step| step > 0.0);
        is_rounded.then(|| self.steps.iter().map(f64::to_string).collect::<Vec<_>>().join("; "))
    }

    /// Parses the text of [`Self::describe_steps`] for a voxel type; `None` for any other text.
    #[must_use]
    pub fn steps_from(text: &str, voxel_type: VoxelType) -> Option<Vec<f64>> {
        let is_power = |step: f64| step.is_finite() && step == power_of_two_within(step);
        let is_odd = |step: f64| Quantizer::new(voxel_type, step).is_some() && step % 2.0 == 1.0;
        let is_step = |step: &f64| *step == 0.0 || if voxel_type.is_float() { is_power(*step) } else { is_odd(*step) };
        text.split("; ").map(|word| word.parse::<f64>().ok().filter(is_step)).collect()
    }

    /// Parses the text of [`Self::describe`]; `None` for any other text.
    #[must_use]
    pub fn rms_kept_from(text: &str) -> Option<Vec<[f64; 3]>> {
        let share = |word: &str| word.parse::<f64>().ok().filter(|share| (0.0..=1.0).contains(share));
        let level = |level: &str| -> Option<[f64; 3]> {
            level.split_whitespace().map(share).collect::<Option<Vec<f64>>>()?.try_into().ok()
        };
        text.split(';').map(level).collect()
    }
}

/// The levels of a source; `auto` needs the [`sample_boxes`].
pub(crate) fn plan(info: &SourceInfo, mut samples: Vec<Sample>, layout: BrickLayout, choice: LodAxes) -> LevelPlan {
    let mut dims = info.dims.0;
    let mut spacing = info.geometry.spacing;
    let mut out = LevelPlan::default();
    while dims.iter().any(|&n| layout.bricks_along(n) > 1) {
        let open: [bool; 3] = dims.map(|n| layout.bricks_along(n) > 1);
        let halved = match choice {
            LodAxes::Xyz => open,
            LodAxes::Xy => z_last(open),
            LodAxes::Auto => {
                let kept: [f64; 3] = std::array::from_fn(|a| variance_kept(&samples, a));
                out.rms_kept.push(kept.map(f64::sqrt));
                best_axes(info, open, spacing, kept)
            }
        };
        let factors = halved.map(|h| if h { 2 } else { 1 });
        for a in 0..3 {
            dims[a] = dims[a].div_ceil(u64::from(factors[a]));
            spacing[a] *= f64::from(factors[a]);
        }
        if choice == LodAxes::Auto {
            out.steps.push(step_of_means(info, &samples, halved));
        }
        samples.iter_mut().for_each(|s| s.halve(halved));
        out.factors.push(factors);
    }
    out
}

fn z_last(open: [bool; 3]) -> [bool; 3] {
    [open[0], open[1], open[2] && !(open[0] || open[1])]
}

/// Axes to halve; `kept` is the share of the variance that halving each axis keeps.
fn best_axes(info: &SourceInfo, open: [bool; 3], spacing: [f64; 3], kept: [f64; 3]) -> [bool; 3] {
    if info.survey.is_some() && (open[0] || open[1]) {
        return z_last(open);
    }
    let best = (0..3).filter(|&a| open[a]).map(|a| kept[a]).fold(0.0, f64::max);
    let one_unit = info.axes.iter().all(|axis| axis.unit == info.axes[0].unit);
    let smallest = (0..3).filter(|&a| open[a]).map(|a| spacing[a]).fold(f64::INFINITY, f64::min);
    let cubic = |a: usize| !one_unit || spacing[a] < 2.0 * smallest;
    let chosen: [bool; 3] = std::array::from_fn(|a| open[a] && cubic(a) && kept[a] >= best - WORSE);
    if chosen == [false; 3] { open } else { chosen }
}

/// A box of the volume as doubles, NaN if absent.
pub(crate) struct Sample {
    extent: [usize; 3],
    /// Values, x fastest.
    pub values: Vec<f64>,
}

impl Sample {
    /// Replaces pairs along the chosen axes by their means, where an axis still has two voxels.
    fn halve(&mut self, axes: [bool; 3]) {
        for axis in (0..3).filter(|&a| axes[a]) {
            if self.extent[axis] < 2 {
                continue;
            }
            let mut extent = self.extent;
            extent[axis] /= 2;
            let values = self.pairs(axis).map(|(a, b)| 0.5 * (a + b)).collect();
            *self = Self { extent, values };
        }
    }

    /// Neighbours (0, 1), (2, 3), ... along an axis, in memory order of the first.
    pub(crate) fn pairs(&self, axis: usize) -> impl Iterator<Item = (f64, f64)> + '_ {
        let stride = [1, self.extent[0], self.extent[0] * self.extent[1]][axis];
        let lines = self.values.chunks_exact(stride * self.extent[axis]);
        let halves = lines.flat_map(move |line| line.chunks_exact(2 * stride)).map(move |pair| pair.split_at(stride));
        halves.flat_map(|(firsts, seconds)| firsts.iter().copied().zip(seconds.iter().copied()))
    }
}

impl Sample {
    /// All neighbours along an axis.
    pub(crate) fn neighbours(&self, axis: usize) -> impl Iterator<Item = (f64, f64)> + '_ {
        let stride = [1, self.extent[0], self.extent[0] * self.extent[1]][axis];
        let lines = self.values.chunks_exact(stride * self.extent[axis]);
        lines.flat_map(move |line| line.iter().copied().zip(line[stride..].iter().copied()))
    }
}

/// Share of the variance that means of pairs along this axis keep; 1 if unknown.
fn variance_kept(samples: &[Sample], axis: usize) -> f64 {
    let (mut total, mut lost) = (0.0, 0.0);
    for sample in samples {
        let present = || sample.values.iter().filter(|v| v.is_finite());
        let mean = present().sum::<f64>() / present().count().max(1) as f64;
        for (a, b) in sample.pairs(axis).filter(|(a, b)| a.is_finite() && b.is_finite()) {
            total += (a - mean).powi(2) + (b - mean).powi(2);
            lost += (a - b).powi(2) / 2.0;
        }
    }
    // Rounding can make the share of a field that cancels out negative.
    if total > 0.0 { (1.0 - lost / total).max(0.0) } else { 1.0 }
}

/// Longest step for means over these axes in stored units; 0 if they are not rounded.
fn step_of_means(info: &SourceInfo, samples: &[Sample], halved: [bool; 3]) -> f64 {
    if info.voxel_type.is_float() {
        return power_of_two_within(STEP_SHARE * median_difference(samples, halved, |d| d > 0.0));
    }
    if !info.dims.0.contains(&1) {
        return 0.0;
    }
    let furthest = 0.5 * STEP_SHARE * median_difference(samples, halved, |_| true);
    Quantizer::within(info.voxel_type, furthest).map_or(0.0, Quantizer::step)
}

/// Median absolute difference of voxel pairs along these axes, among those that `counts` accepts; 0 if there are none.
fn median_difference(samples: &[Sample], halved: [bool; 3], counts: impl Fn(f64) -> bool) -> f64 {
    let pairs = |axis: usize| samples.iter().flat_map(move |sample| sample.pairs(axis));
    let differences = (0..3).filter(|&a| halved[a]).flat_map(pairs).map(|(a, b)| (a - b).abs());
    let mut differences: Vec<f64> = differences.filter(|&d| d.is_finite() && counts(d)).collect();
    if differences.is_empty() {
        return 0.0;
    }
    let middle = differences.len() / 2;
    *differences.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The greatest power of two that is not above a positive number; 0 for a number that is not normal.
fn power_of_two_within(number: f64) -> f64 {
    const MANTISSA: u64 = (1 << (f64::MANTISSA_DIGITS - 1)) - 1;
    if number.is_normal() && number > 0.0 { f64::from_bits(number.to_bits() & !MANTISSA) } else { 0.0 }
}

/// Up to 27 sample boxes, evenly spread.
pub(crate) fn sample_boxes(source: &dyn VolumeSource) -> Result<Vec<Sample>, SourceError> {
    let info = source.info();
    let absence = Absence::declared(info.nodata, info.voxel_type);
    let starts = |n: u64| -> Vec<u64> {
        let mut starts: Vec<u64> =
            (0..SAMPLES_ALONG).map(|i| n.saturating_sub(SAMPLE_EDGE) * i / (SAMPLES_ALONG - 1)).collect();
        starts.dedup();
        starts
    };
    let Dims(dims) = info.dims;
    let mut samples = Vec::new();
    for z in starts(dims[2]) {
        for y in starts(dims[1]) {
            for x in starts(dims[0]) {
                let start = [x, y, z];
                let voxels = VoxelBox { start, end: std::array::from_fn(|a| (start[a] + SAMPLE_EDGE).min(dims[a])) };
                let mut bytes = vec![0; voxels.voxels() * info.voxel_type.bytes()];
                source.read_box(voxels, &mut bytes)?;
                let values = supervol_format::voxel_type::voxels_as_f64(info.voxel_type, &bytes)
                    .into_iter()
                    .map(|v| if absence.is_absent(v) { f64::NAN } else { v })
                    .collect();
                samples.push(Sample { extent: voxels.extent(), values });
            }
        }
    }
    Ok(samples)
}

#[cfg(test)]
mod tests {
    use supervol_sources::Survey;

    use super::*;

    struct Field {
        info: SourceInfo,
        value: fn([u64; 3]) -> u8,
    }

    impl VolumeSource for Field {
        fn info(&self) -> &SourceInfo {
            &self.info
        }

        fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
            let [nx, ny, _] = voxels.extent();
            for (i, v) in out.iter_mut().enumerate() {
                let local = [i % nx, i / nx % ny, i / nx / ny];
                *v = (self.value)(std::array::from_fn(|a| voxels.start[a] + local[a] as u64));
            }
            Ok(())
        }
    }

    fn plan_of(dims: [u64; 3], spacing: [f64; 3], choice: LodAxes, value: fn([u64; 3]) -> u8) -> LevelPlan {
        let mut info = SourceInfo::plain("synth", Dims(dims), VoxelType::U8);
        info.geometry.spacing = spacing;
        plan_with(info, choice, value)
    }

    fn plan_with(info: SourceInfo, choice: LodAxes, value: fn([u64; 3]) -> u8) -> LevelPlan {
        let layout = BrickLayout::new(16).expect("16 is a core");
        let field = Field { info, value };
        let samples = sample_boxes(&field).expect("the field is always readable");
        plan(&field.info, samples, layout, choice)
    }

    fn factors_of(dims: [u64; 3], spacing: [f64; 3], value: fn([u64; 3]) -> u8) -> Vec<[u32; 3]> {
        plan_of(dims, spacing, LodAxes::Auto, value).factors
    }

    /// Means of pairs of a wave of k radians per voxel are that wave times cos(k / 2). (With fewer than four pairs per
    /// wave, the phase matters.)
    #[test]
    fn what_is_kept_of_waves_is_the_closed_form() {
        let k = |voxels: f64| std::f64::consts::TAU / voxels;
        let waves = |p: [u64; 3]| (128.0 + 100.0 * (p[2] as f64 * std::f64::consts::TAU / 16.0).sin()).round() as u8;
        // Only z is longer than a brick, so each level halves it.
        let kept = plan_of([16, 16, 64], [1.0; 3], LodAxes::Auto, waves).rms_kept;
        let expected = [(k(16.0) / 2.0).cos(), (k(8.0) / 2.0).cos()];
        assert_eq!(kept.len(), 2);
        for (level, (kept, expected)) in kept.iter().zip(expected).enumerate() {
            assert_eq!(kept[..2], [1.0, 1.0], "nothing changes along x and y");
            assert!((kept[2] - expected).abs() < 0.01, "level {}: {} instead of {expected}", level + 1, kept[2]);
        }
    }

    fn line(values: Vec<f64>) -> [Sample; 1] {
        [Sample { extent: [values.len(), 1, 1], values }]
    }

    fn ramp(slope: f64) -> Vec<f64> {
        (0..64).map(|i| slope * f64::from(i)).collect()
    }

    #[test]
    fn means_are_rounded_by_what_pairs_differ_by_and_fill_values_do_not_count() {
        let floats = SourceInfo::plain("synth", Dims([64; 3]), VoxelType::F32);
        let step = |values: Vec<f64>| step_of_means(&floats, &line(values), [true, false, false]);
        // Half of 3 is 1.5, half of 4 is 2.
        assert_eq!([ramp(3.0), ramp(4.0), ramp(0.011)].map(step), [1.0, 2.0, 0.003_906_25]);
        let mut filled = ramp(3.0);
        filled[3..30].fill(1e30);
        filled[40] = f64::NAN;
        assert_eq!(step(filled), 1.0);
        // Equal neighbours do not count.
        assert_eq!([vec![7.0; 64], vec![f64::NAN; 64], vec![1.0]].map(step), [0.0; 3]);
        assert_eq!(step_of_means(&floats, &line(ramp(3.0)), [false, true, true]), 0.0, "none along y and z");
    }

    #[test]
    fn means_of_integers_are_rounded_in_sections_alone() {
        let step = |voxel_type, dims, values| {
            let info = SourceInfo::plain("synth", Dims(dims), voxel_type);
            step_of_means(&info, &line(values), [true, false, false])
        };
        let section = [64, 1, 64];
        // A quarter of the difference to either side, in integers.
        let steps = [3.0, 4.0, 11.0, 12.0].map(|slope| step(VoxelType::U8, section, ramp(slope)));
        assert_eq!(steps, [0.0, 3.0, 5.0, 7.0]);
        assert_eq!(step(VoxelType::I16, section, ramp(4000.0)), 2001.0);
        assert_eq!(step(VoxelType::I16, [64, 2, 64], ramp(4000.0)), 0.0, "two voxels thick");
        let mask: Vec<f64> = (0..64).map(|i| if i % 16 < 5 { 255.0 } else { 0.0 }).collect();
        assert_eq!(step(VoxelType::U8, section, mask), 0.0, "its means are shares");
    }

    #[test]
    fn steps_are_written_and_read() {
        let plan = LevelPlan { steps: vec![0.0, 0.25, 2f64.powi(-40), 2f64.powi(60)], ..LevelPlan::default() };
        let text = plan.describe_steps().expect("there are steps");
        assert_eq!(LevelPlan::steps_from(&text, VoxelType::F32), Some(plan.steps));
        assert_eq!(LevelPlan { steps: vec![0.0; 3], ..LevelPlan::default() }.describe_steps(), None);
        for wrong in ["", "3", "-1", "-0.5", "inf", "NaN", "1;2", "x", "1; "] {
            assert_eq!(LevelPlan::steps_from(wrong, VoxelType::F32), None, "{wrong}");
        }
        assert_eq!(LevelPlan::steps_from("0; 3; 1; 511", VoxelType::U8), Some(vec![0.0, 3.0, 1.0, 511.0]));
        for wrong in ["2", "0.5", "-3", "513", "inf", "NaN", "3;5"] {
            assert_eq!(LevelPlan::steps_from(wrong, VoxelType::U8), None, "{wrong}");
        }
    }

    #[test]
    fn what_was_measured_is_written_and_read() {
        let layers = |p: [u64; 3]| if p[2].is_multiple_of(2) { 200 } else { 50 };
        let measured = plan_of([64; 3], [1.0; 3], LodAxes::Auto, layers);
        let text = measured.describe().expect("auto measures");
        assert!(text.starts_with("1.0000 1.0000 0.0000; "), "{text}");
        let read = LevelPlan::rms_kept_from(&text).expect("it was written");
        assert_eq!(read.len(), measured.factors.len());
        assert_eq!(measured, plan_of([64; 3], [1.0; 3], LodAxes::Auto, layers), "another run measures the same");
        assert_eq!(plan_of([64; 3], [1.0; 3], LodAxes::Xyz, layers).describe(), None, "nobody measured");
        for wrong in ["", "1 1", "1 1 1;", "1 1 2", "1 1 x", "1 1 NaN", "1 1 1 1"] {
            assert_eq!(LevelPlan::rms_kept_from(wrong), None, "{wrong:?}");
        }
    }

    #[test]
    fn smooth_cubic_volumes_halve_all_axes() {
        let smooth = |p: [u64; 3]| (p[0] + p[1] + p[2]) as u8;
        assert_eq!(factors_of([64; 3], [1.0; 3], smooth), [[2, 2, 2], [2, 2, 2]]);
    }

    #[test]
    fn thick_slices_wait_until_voxels_are_cubic() {
        let smooth = |p: [u64; 3]| (p[0] + p[1] + p[2]) as u8;
        assert_eq!(factors_of([64, 64, 32], [1.0, 1.0, 4.0], smooth)[..2], [[2, 2, 1], [2, 2, 1]]);
    }

    #[test]
    fn an_axis_whose_pairs_cancel_waits() {
        let layers = |p: [u64; 3]| if p[2].is_multiple_of(2) { 200 } else { 50 };
        assert_eq!(factors_of([64; 3], [1.0; 3], layers)[0], [2, 2, 1]);
    }

    fn survey_plan(dims: [u64; 3], value: fn([u64; 3]) -> u8) -> LevelPlan {
        let survey = Survey::plain([dims[0], dims[1]], 4.0);
        let info = SourceInfo::plain("survey", Dims(dims), VoxelType::U8);
        plan_with(SourceInfo { survey: Some(survey), ..info }, LodAxes::Auto, value)
    }

    /// Independent of the measurement: the second field is constant along z, and along x halving loses everything.
    #[test]
    fn samples_of_a_survey_wait_for_its_traces() {
        const TRACES: [u32; 3] = [2, 2, 1];
        const SAMPLES: [u32; 3] = [1, 1, 2];
        let smooth = |p: [u64; 3]| (p[0] + p[1] + p[2]) as u8;
        let alternating = |p: [u64; 3]| if p[0].is_multiple_of(2) { 200 } else { 50 };
        for value in [smooth, alternating] {
            let plan = survey_plan([64; 3], value);
            assert_eq!(plan.factors, [TRACES, TRACES, SAMPLES, SAMPLES]);
            assert_eq!(plan.rms_kept.len(), 4, "what z would have kept is measured all the same");
        }
        assert_eq!(survey_plan([64; 3], alternating).rms_kept[0], [0.0, 1.0, 1.0]);
        assert_ne!(factors_of([64; 3], [1.0; 3], smooth)[0], TRACES, "without a survey z does not wait");
    }

    #[test]
    fn a_section_of_a_survey_halves_its_traces_first() {
        let smooth = |p: [u64; 3]| (p[0] + p[2]) as u8;
        let [line, samples] = [[2, 1, 1], [1, 1, 2]];
        assert_eq!(survey_plan([64, 1, 64], smooth).factors, [line, line, samples, samples]);
    }
}
