//! Transfer functions of the presets. Values are in data units, opacities over the preset's unit distance.

use supervol_format::ValueRange;
use supervol_format::cast::whole;
use supervol_format::container::manifest::LABELS_LISTED;

use super::colormap;
use crate::facts::histogram::Histogram;
use crate::facts::{DataKind, VolumeFacts, is_hounsfield};
use crate::transfer_function::ControlPoint;

/// Hounsfield units found only at boundaries between air and tissue (skin, airways, faces of the lungs): first, middle,
/// last.
const HOUNSFIELD_FACES: [f64; 3] = [-600.0, -400.0, -250.0];
/// Hounsfield units at which the preset changes: end of soft tissue, bone, metal.
const HOUNSFIELD_BONE: [f64; 3] = [180.0, 450.0, 1500.0];
/// Offset of Hounsfield units in unsigned files.
pub(super) const HOUNSFIELD_OFFSET: f64 = 1024.0;
/// Window of maximum projections in Hounsfield units, from fat to dense bone. A coarse level gives no useful window:
/// air around the body makes it too dark, and averaging makes bone too low.
const HOUNSFIELD_PROJECTED: [f64; 2] = [-150.0, 1600.0];
/// Opacity of opaque points.
const OPAQUE: f64 = 1.0;

pub(super) fn point(value: f64, color: [f64; 3], alpha: f64) -> ControlPoint {
    ControlPoint { value, color, alpha }
}

/// Value at a percentile, interpolated. If no percentiles are known, they are taken as linear over the range.
pub(super) fn percentile(facts: &VolumeFacts, percent: f64) -> f64 {
    let range = facts.central_range;
    let ends = [(0.0, range.min), (100.0, range.max)];
    let known = if facts.percentiles.is_empty() { &ends[..] } else { &facts.percentiles[..] };
    let above = known.partition_point(|&(p, _)| p < percent);
    match (above.checked_sub(1).map(|i| known[i]), known.get(above)) {
        (Some((p0, v0)), Some(&(p1, v1))) => v0 + (v1 - v0) * (percent - p0) / (p1 - p0).max(f64::MIN_POSITIVE),
        (Some((_, v)), None) | (None, Some(&(_, v))) => v,
        (None, None) => 0.0,
    }
}

/// The window of typical values: percentiles 1 to 99; low < high, both finite.
pub(super) fn window(facts: &VolumeFacts) -> [f64; 2] {
    window_between(facts, [1.0, 99.0])
}

/// The values at two percentiles; low < high, both finite.
pub(super) fn window_between(facts: &VolumeFacts, percents: [f64; 2]) -> [f64; 2] {
    let [mut low, mut high] = percents.map(|p| percentile(facts, p));
    // In a mostly empty volume both percentiles are the background value; use the whole range then.
    let range = facts.central_range;
    if !range.is_empty() && high - low <= 1e-3 * range.width() {
        (low, high) = (range.min, range.max);
    }
    if !(low.is_finite() && high.is_finite()) {
        return [0.0, 1.0];
    }
    if high > low { [low, high] } else { [low, low + low.abs().max(1.0)] }
}

/// The window of amplitudes: symmetric around zero, or around the median for amplitudes stored unsigned.
pub(super) fn amplitude_window(facts: &VolumeFacts) -> [f64; 2] {
    let [low, high] = window(facts);
    let zero = if facts.has_zero_centre { 0.0 } else { percentile(facts, 50.0) };
    let clip = (low - zero).abs().max((high - zero).abs());
    [zero - clip, zero + clip]
}

/// A colour map over a window, opaque throughout.
pub(super) fn opaque(colors: &[(f64, [f64; 3])], [low, high]: [f64; 2]) -> Vec<ControlPoint> {
    colors.iter().map(|&(place, color)| point(low * (1.0 - place) + high * place, color, OPAQUE)).collect()
}

/// A grey ramp over a window, opaque throughout.
pub(super) fn opaque_grey(window: [f64; 2]) -> Vec<ControlPoint> {
    opaque(&[(0.0, [0.0; 3]), (1.0, [1.0; 3])], window)
}

/// Seismic amplitudes: most opaque at both ends, transparent at zero; red-white-blue; clipped at the 99th percentile.
pub(super) fn seismic(facts: &VolumeFacts) -> Vec<ControlPoint> {
    let [low, high] = amplitude_window(facts);
    let (zero, clip) = (0.5 * low + 0.5 * high, 0.5 * high - 0.5 * low);
    let point = |offset: f64, color, alpha| point(zero + offset, color, alpha);
    vec![
        point(-clip, [0.55, 0.00, 0.05], 0.45),
        point(-0.60 * clip, [0.85, 0.15, 0.12], 0.18),
        point(-0.25 * clip, [0.97, 0.70, 0.60], 0.010),
        point(-0.12 * clip, [1.00, 0.92, 0.90], 0.0),
        point(0.12 * clip, [0.90, 0.94, 1.00], 0.0),
        point(0.25 * clip, [0.60, 0.75, 0.97], 0.010),
        point(0.60 * clip, [0.12, 0.30, 0.85], 0.18),
        point(clip, [0.03, 0.08, 0.50], 0.45),
    ]
}

/// The strongest seismic amplitudes as semi-opaque bodies; everything else is clear, so that sections behind show.
pub(super) fn strong_amplitudes(facts: &VolumeFacts) -> Vec<ControlPoint> {
    /// Least amplitude of a body, and that of its full opacity, as shares of the 99th percentile of the amplitudes.
    const LEAST: f64 = 0.65;
    const FULL: f64 = 0.85;
    let [low, high] = amplitude_window(facts);
    let (zero, clip) = (0.5 * low + 0.5 * high, 0.5 * high - 0.5 * low);
    let point = |share: f64, color, alpha| point(zero + share * clip, color, alpha);
    vec![
        point(-1.0, [0.55, 0.00, 0.05], 0.20),
        point(-FULL, [0.85, 0.15, 0.12], 0.08),
        point(-LEAST, [0.85, 0.15, 0.12], 0.0),
        point(LEAST, [0.12, 0.30, 0.85], 0.0),
        point(FULL, [0.12, 0.30, 0.85], 0.08),
        point(1.0, [0.03, 0.08, 0.50], 0.20),
    ]
}

/// The window of maximum projections of tomography in Hounsfield units, with or without offset. `None` if the values
/// are not in these units, or all lie on one side.
pub(super) fn projected_tissue(facts: &VolumeFacts) -> Option<[f64; 2]> {
    let range = facts.central_range;
    let [low, high] = match facts.kind {
        DataKind::CtOffset => HOUNSFIELD_PROJECTED.map(|value| value + HOUNSFIELD_OFFSET),
        DataKind::Ct if is_hounsfield(range) => HOUNSFIELD_PROJECTED,
        _ => return None,
    };
    let high = high.min(range.max);
    (range.min < low && low < high).then_some([low, high])
}

/// Tomography in Hounsfield units, with or without offset: white bone in a transparent body with visible skin and
/// airways. Visible soft tissue would cover the bones with fog, because its noise changes the light in every cell. For
/// values in other units the classes of the histogram are used: matter faint and warm, dense matter white.
pub(super) fn ct(facts: &VolumeFacts) -> Vec<ControlPoint> {
    let offset = if facts.kind == DataKind::CtOffset { HOUNSFIELD_OFFSET } else { 0.0 };
    if offset == 0.0 && !is_hounsfield(facts.central_range) {
        return ct_by_classes(facts);
    }
    let [first, face, last] = HOUNSFIELD_FACES.map(|value| value + offset);
    let [dense, bone, metal] = HOUNSFIELD_BONE.map(|value| value + offset);
    vec![
        point(first, [0.80, 0.50, 0.38], 0.0),
        point(face, [0.95, 0.68, 0.55], 0.3),
        point(last, [0.95, 0.68, 0.55], 0.0),
        point(dense, [0.95, 0.75, 0.60], 0.0),
        point(bone, [0.98, 0.95, 0.88], 0.35),
        point(metal, [1.0, 1.0, 1.0], 0.8),
    ]
}

fn ct_by_classes(facts: &VolumeFacts) -> Vec<ControlPoint> {
    let Classes { ground, dense, top } = Classes::of(facts);
    let soft = 0.5 * ground + 0.5 * dense;
    let metal = facts.central_range.max.max(top + 0.1 * (top - ground));
    vec![
        point(ground, [0.55, 0.25, 0.15], 0.0),
        point(ground + 0.6 * (soft - ground), [0.75, 0.35, 0.22], 0.002),
        point(soft, [0.88, 0.55, 0.42], 0.008),
        point(dense, [0.95, 0.75, 0.60], 0.03),
        point(0.4 * dense + 0.6 * top, [0.98, 0.95, 0.88], 0.35),
        point(metal, [1.0, 1.0, 1.0], 0.8),
    ]
}

/// Grey ramp over the window: dark and transparent below, white and dense above.
pub(super) fn grey(facts: &VolumeFacts) -> Vec<ControlPoint> {
    let [low, high] = window(facts);
    let at = |share: f64| low + share * (high - low);
    if facts.has_zero_centre {
        let clip = low.abs().max(high.abs());
        let wing = |value: f64, grey: f64, alpha: f64| point(value, [grey; 3], alpha);
        return vec![
            wing(-clip, 0.05, 0.30),
            wing(-0.15 * clip, 0.45, 0.0),
            wing(0.15 * clip, 0.55, 0.0),
            wing(clip, 0.95, 0.30),
        ];
    }
    vec![
        point(at(0.10), [0.15; 3], 0.0),
        point(at(0.35), [0.40; 3], 0.008),
        point(at(0.65), [0.70; 3], 0.06),
        point(at(1.0), [1.0; 3], 0.35),
    ]
}

/// Signed values that are no amplitudes: blue below zero, orange above, transparent around zero.
pub(super) fn signed(facts: &VolumeFacts) -> Vec<ControlPoint> {
    let [low, high] = window_between(facts, [0.1, 99.9]);
    let clip = low.abs().max(high.abs());
    vec![
        point(-clip, [0.10, 0.25, 0.90], 0.40),
        point(-0.15 * clip, [0.55, 0.70, 1.00], 0.0),
        point(0.15 * clip, [1.00, 0.80, 0.50], 0.0),
        point(clip, [0.95, 0.35, 0.05], 0.40),
    ]
}

/// Solid matter in air: transparent below the threshold between both, opaque within a few unit distances above it.
pub(super) fn solid(facts: &VolumeFacts, [dark, middle, light]: [[f64; 3]; 3]) -> Vec<ControlPoint> {
    let Classes { ground, dense, top } = Classes::of(facts);
    let near = ground + 0.3 * (dense - ground);
    let faint = faint_above(facts, ground)
        .map(|value| [point(value, dark, 0.0), point(0.5 * value + 0.5 * ground, dark, 0.05)]);
    let ground_alpha = if faint.is_some() { 0.08 } else { 0.0 };
    let mut points: Vec<ControlPoint> = faint.into_iter().flatten().collect();
    points.extend([
        point(ground, dark, ground_alpha),
        point(near, dark, 0.08),
        point(dense, middle, 0.35),
        point(top, light, 0.8),
    ]);
    points
}

/// Tissue in air. Its values differ little from those of air, compared with noise and shading of the coil. So it is
/// opaque soon after the threshold; slower ramps look like fog.
pub(super) fn tissue(facts: &VolumeFacts, [dark, middle, light]: [[f64; 3]; 3]) -> Vec<ControlPoint> {
    let Classes { ground, dense, top } = Classes::of(facts);
    let near = ground + 0.3 * (dense - ground);
    vec![point(ground, dark, 0.0), point(near, dark, 0.35), point(dense, middle, 0.7), point(top, light, 0.95)]
}

/// Lower threshold of light matter (leaves, foam), which lies below the threshold of solid matter. Only for a
/// background of one value, as scanners write outside their reconstructed region; noise would be taken for matter.
fn faint_above(facts: &VolumeFacts, ground: f64) -> Option<f64> {
    const CLEAN_BACKGROUND: f64 = 0.5;
    let histogram = Histogram::new(&facts.histogram, facts.central_range);
    if facts.kind != DataKind::MicroCt || histogram.fullest() < CLEAN_BACKGROUND {
        return None;
    }
    let range = facts.central_range;
    let background = range.min + range.width() / facts.histogram.len() as f64;
    histogram.threshold_between(background, ground)
}

/// Colours of the labels that occur; 0 is transparent. A label is visible only near its own value: between two labels,
/// interpolation passes through other labels that are not present there.
///
/// Labels beyond [`LABELS_LISTED`] share the colours of equal parts of the range.
pub(super) fn labels(facts: &VolumeFacts, alpha: f64) -> Vec<ControlPoint> {
    const NEAR: f64 = 0.05;
    /// Least share of a label's number on which its colour holds: single precision resolves no less.
    const RESOLVED: f64 = 1e-6;
    /// Largest share of the gap to the next label on which the colour holds.
    const GAP: f64 = 0.4;
    let known = labels_of(facts);
    let range = facts.value_range;
    if known.len() > LABELS_LISTED {
        return bands(range, alpha);
    }
    let reach = |value: f64, next: Option<&f64>| {
        let gap = next.map_or(f64::INFINITY, |next| (next - value).abs());
        NEAR.max(RESOLVED * value.abs()).min(GAP * gap)
    };
    let plateau = |i: usize| {
        let value = known[i];
        let before = reach(value, i.checked_sub(1).and_then(|i| known.get(i)));
        let after = reach(value, known.get(i + 1));
        let color = colormap::of_label(whole::<i64>(value).unsigned_abs());
        let alpha = if value == 0.0 { 0.0 } else { alpha };
        [(-before, 0.0), (-0.5 * before, alpha), (0.5 * after, alpha), (after, 0.0)]
            .map(|(offset, alpha)| point(value + offset, color, alpha))
    };
    (0..known.len()).flat_map(plateau).collect()
}

/// The labels that may occur, ascending. Containers without a list tell by their histogram.
pub(super) fn labels_of(facts: &VolumeFacts) -> Vec<f64> {
    if !facts.labels.is_empty() {
        return facts.labels.clone();
    }
    let range = facts.value_range;
    let (first, last) = (range.min.ceil(), range.max.floor().max(range.min.ceil()));
    let histogram = Histogram::new(&facts.histogram, range);
    // Bins of width 1 or less tell labels apart.
    let is_known = facts.histogram.len() as f64 >= range.width();
    let is_there = |value: &f64| !is_known || *value == last || histogram.share_between(value - 0.5, value + 0.5) > 0.0;
    let most = whole::<u64>((last - first).clamp(0.0, LABELS_LISTED as f64));
    (0..=most).map(|i| first + i as f64).filter(is_there).collect()
}

/// Colours of labels that are too many for a colour each: equal parts of the range; 0 is transparent.
fn bands(range: ValueRange, alpha: f64) -> Vec<ControlPoint> {
    const BANDS: u32 = 1000;
    let at = |share: f64| range.min * (1.0 - share) + range.max * share;
    let mut points: Vec<ControlPoint> = Vec::new();
    if range.min <= 0.0 {
        points.extend([(0.0, 0.0), (0.5, 0.0)].map(|(value, alpha)| point(value, [0.5; 3], alpha)));
    }
    let clear = points.last().map_or(f64::NEG_INFINITY, |p| p.value);
    for band in 0..BANDS {
        let ends = [band, band + 1].map(|n| at(f64::from(n) / f64::from(BANDS)).max(clear));
        points.extend(ends.map(|value| point(value, colormap::of_label(u64::from(band) + 1), alpha)));
    }
    points
}

/// Thresholds between the classes of matter in empty space, in data units.
pub(super) struct Classes {
    /// Threshold between empty space and matter.
    pub(super) ground: f64,
    /// Threshold between light and dense matter.
    pub(super) dense: f64,
    /// Value that nearly all matter stays below.
    pub(super) top: f64,
}

impl Classes {
    /// Thresholds from the histogram, or from percentiles if there is none. `ground < dense < top`.
    pub(super) fn of(facts: &VolumeFacts) -> Self {
        let histogram = Histogram::new(&facts.histogram, facts.central_range);
        let [low, high] = window(facts);
        let ground = histogram.threshold_above(f64::NEG_INFINITY).unwrap_or(low + 0.2 * (high - low));
        let dense = histogram.threshold_above(ground).unwrap_or(low + 0.7 * (high - low));
        let top = histogram.quantile_above(ground, 0.995);
        let least = 1e-6 * facts.central_range.width().max(f64::MIN_POSITIVE);
        let dense = dense.max(ground + least);
        Self { ground, dense, top: top.max(dense + least) }
    }
}

/// The points of a transfer function, moved to another window and given other colours; `None` keeps either. Steps stay
/// steps. A point is added where the colour map bends between two points.
#[must_use]
pub fn repainted(
    points: &[ControlPoint],
    window: Option<[f64; 2]>,
    colors: Option<&[(f64, [f64; 3])]>,
) -> Vec<ControlPoint> {
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return Vec::new() };
    let [low, high] = [first.value, last.value];
    let place = |value: f64| if high > low { (value - low) / (high - low) } else { 0.5 };
    let mut out: Vec<(f64, ControlPoint)> = points.iter().map(|p| (place(p.value), *p)).collect();
    if let Some(colors) = colors {
        let bends = colors.iter().filter(|(at, _)| !out.iter().any(|(place, _)| place == at));
        let added: Vec<_> = bends
            .map(|&(at, color)| (at, point(low + at * (high - low), color, alpha_at(points, low + at * (high - low)))))
            .collect();
        out.extend(added);
        out.sort_by(|a, b| a.0.total_cmp(&b.0));
        out.iter_mut().for_each(|(place, point)| point.color = color_at(colors, *place));
    }
    let [low, high] = window.unwrap_or([low, high]);
    let mut least = f64::NEG_INFINITY;
    let mut value = |place: f64| {
        // Rounding must not put a point before the one at its left.
        least = (low * (1.0 - place) + high * place).max(least);
        least
    };
    out.iter().map(|(place, p)| ControlPoint { value: value(*place), ..*p }).collect()
}

fn alpha_at(points: &[ControlPoint], value: f64) -> f64 {
    let after = points.partition_point(|p| p.value <= value);
    match (after.checked_sub(1).map(|i| points[i]), points.get(after)) {
        (Some(a), Some(b)) => a.alpha + (b.alpha - a.alpha) * (value - a.value) / (b.value - a.value),
        (Some(p), None) => p.alpha,
        (None, p) => p.map_or(0.0, |p| p.alpha),
    }
}

pub(super) fn color_at(colors: &[(f64, [f64; 3])], place: f64) -> [f64; 3] {
    let after = colors.partition_point(|(at, _)| *at <= place);
    match (after.checked_sub(1).map(|i| colors[i]), colors.get(after)) {
        (Some((p, a)), Some(&(q, b))) => std::array::from_fn(|i| a[i] + (b[i] - a[i]) * (place - p) / (q - p)),
        (Some((_, color)), None) => color,
        (None, color) => color.map_or([0.0; 3], |(_, c)| *c),
    }
}

/// The window between the percentiles `percent` and 100 - `percent`; symmetric for amplitudes.
#[must_use]
pub fn clipped_window(facts: &VolumeFacts, percent: f64) -> [f64; 2] {
    let [low, high] = window_between(facts, [percent, 100.0 - percent]);
    if facts.kind != DataKind::Seismic {
        return [low, high];
    }
    let zero = if facts.has_zero_centre { 0.0 } else { percentile(facts, 50.0) };
    let clip = (low - zero).abs().max((high - zero).abs());
    [zero - clip, zero + clip]
}

/// The transfer function of a slice whose window or colours the user sets: as [`of_slice`], with labels as grey
/// numbers.
#[must_use]
pub fn plain_slice(facts: &VolumeFacts) -> Vec<ControlPoint> {
    if facts.kind == DataKind::Labels { opaque_grey(window_between(facts, [0.0, 100.0])) } else { of_slice(facts) }
}

/// The default transfer function of a slice, opaque: amplitudes red-white-blue, labels in colours, everything else
/// grey.
#[must_use]
pub fn of_slice(facts: &VolumeFacts) -> Vec<ControlPoint> {
    let named = |name| colormap::by_name(name).unwrap_or_default();
    match facts.kind {
        DataKind::Seismic => opaque(&named("seismic"), amplitude_window(facts)),
        DataKind::SeismicAttribute => opaque(&named("viridis"), window(facts)),
        DataKind::Labels => labels(facts, OPAQUE),
        // The usual window for reading a body: soft tissue and bone.
        DataKind::Ct => opaque_grey([-200.0, 500.0]),
        DataKind::CtOffset => opaque_grey([-200.0, 500.0].map(|v| v + HOUNSFIELD_OFFSET)),
        _ => opaque_grey(window_between(facts, [0.1, 99.9])),
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::{Dims, Geometry};

    use super::*;

    fn facts(kind: DataKind, min: f64, max: f64) -> VolumeFacts {
        VolumeFacts { kind, ..VolumeFacts::plain(Dims([8; 3]), Geometry::IDENTITY, ValueRange { min, max }) }
    }

    #[test]
    fn labels_that_nobody_gave_have_no_colour() {
        let shown = |histogram: &[(usize, u64)], bins: usize| -> Vec<f64> {
            let mut facts = facts(DataKind::Labels, 0.0, 200.0);
            facts.histogram = vec![0; bins];
            histogram.iter().for_each(|&(bin, count)| facts.histogram[bin] = count);
            let points = labels(&facts, 0.5);
            points.chunks_exact(4).map(|plateau| 0.5 * (plateau[1].value + plateau[2].value)).collect()
        };
        // 256 bins over 0 to 200: label n is in bin floor(1.28 n), the last label in the last bin.
        assert_eq!(shown(&[(0, 9), (3, 1), (8, 2), (255, 1)], 256), [0.0, 3.0, 7.0, 200.0]);
        // Bins wider than 1 do not tell labels apart.
        assert_eq!(shown(&[(0, 9), (99, 1)], 100).len(), 201);
    }

    #[test]
    fn maximum_projections_of_tomography_go_from_soft_tissue_to_bone() {
        let window = |kind, min, max| projected_tissue(&facts(kind, min, max));
        assert_eq!(window(DataKind::Ct, -1000.0, 3000.0), Some([-150.0, 1600.0]));
        assert_eq!(window(DataKind::CtOffset, 0.0, 4095.0), Some([874.0, 2624.0]));
        // Limited to the greatest value that occurs; `None` if values are not Hounsfield units.
        assert_eq!(window(DataKind::Ct, -1000.0, 700.0), Some([-150.0, 700.0]));
        assert_eq!(window(DataKind::Ct, 0.0, 255.0), None);
        assert_eq!(window(DataKind::Mri, -1000.0, 3000.0), None);
    }
}
