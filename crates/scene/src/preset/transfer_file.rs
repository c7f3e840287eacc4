//! Readers of files with a transfer function or a colour map: our own JSON, ParaView's colour maps, ImageVis3D's
//! tables.
//!
//! | file | values | colours | opacities |
//! |---|---|---|---|
//! | JSON object with `points` and `unit_distance`, as in a scene | the data's | linear between points | linear between points |
//! | ParaView JSON: an array of presets, of which the first with `RGBPoints` is read | the data's | in its `ColorSpace` (`color_space.rs`) | its `Points`, if it has some |
//! | ImageVis3D `.1dt`: the number of entries, then red, green, blue, alpha of each | equal parts of the data's range | linear between entries | linear between entries |
//!
//! A file is read whole, up to a limit. Content that this program cannot draw is refused by name.

use std::path::Path;

use serde::Deserialize;

use super::color_space::ColorSpace;
use crate::facts::VolumeFacts;
use crate::spec::{PointSpec, PointsSpec};
use crate::transfer_function::{ControlPoint, POINT_LIMIT, TransferFunction, TransferFunctionError};

/// Most bytes of a file.
pub const FILE_LIMIT_BYTES: u64 = 4 << 20;
/// Most entries of a table.
pub const TABLE_LIMIT: usize = 1 << 16;
/// Points per piece of a colour map that is not linear in RGB.
const CURVE_PARTS: usize = 16;
/// Largest distance of a table entry from the line between its neighbours at which the entry is dropped. The second one
/// is used if the first leaves too many entries.
const EXACT: f64 = 1e-9;
const HALF_A_GREY_LEVEL: f64 = 0.5 / 255.0;
/// Most entries that one line replaces, which bounds the time of thinning.
const LINE_LIMIT: usize = 512;

/// Reason why a file holds no transfer function.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum TransferFileError {
    #[error("{path}: {source}")]
    Read { path: String, source: std::io::Error },
    #[error("{path}: at most {FILE_LIMIT_BYTES} bytes are read of a transfer function, found {found}")]
    TooLarge { path: String, found: u64 },
    #[error(
        "{path}: expected a JSON object with `points`, a ParaView colour map (a JSON array with `RGBPoints`), or a table of \
         ImageVis3D (.1dt): {reason}"
    )]
    Unknown { path: String, reason: String },
    #[error("{path}: {reason}")]
    Invalid { path: String, reason: String },
    #[error("{path} holds colours alone, no opacities: it is a colour map, no transfer function")]
    NoOpacities { path: String },
}

/// Share of a colour map's length over which a step is stretched.
const STEP: f64 = 1e-9;

/// Meaning of the values in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Values {
    /// Data values.
    Data,
    /// Shares of the data's range, from 0 to 1.
    Shares,
}

/// A transfer function or colour map as read from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferFile {
    path: String,
    name: Option<String>,
    values: Values,
    /// Colours by value, ascending; two entries at one value are a step.
    colors: Vec<(f64, [f64; 3])>,
    opacities: Option<Vec<(f64, [f64; 1])>>,
    unit_distance: Option<f64>,
}

impl TransferFile {
    /// Reads a file.
    ///
    /// # Errors
    /// If the file cannot be read, is too long, or has none of the known formats.
    pub fn read(path: &Path) -> Result<Self, TransferFileError> {
        let name = path.display().to_string();
        let io = |source| TransferFileError::Read { path: name.clone(), source };
        let bytes = std::fs::metadata(path).map_err(io)?.len();
        if bytes > FILE_LIMIT_BYTES {
            return Err(TransferFileError::TooLarge { path: name, found: bytes });
        }
        let text = std::fs::read_to_string(path).map_err(io)?;
        Self::parse(&text, &name)
    }

    /// Reads the text of a file with the name `path`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn parse(text: &str, path: &str) -> Result<Self, TransferFileError> {
        let is_table = path.to_lowercase().ends_with(".1dt");
        let read = match text.trim_start().chars().next() {
            _ if is_table => parse_table(text),
            Some('[') => parse_paraview(text),
            Some('{') => parse_own(text),
            _ => {
                let reason = "it begins with neither [ nor {".into();
                return Err(TransferFileError::Unknown { path: path.into(), reason });
            }
        };
        read.map(|file| Self { path: path.into(), ..file })
            .map_err(|reason| TransferFileError::Invalid { path: path.into(), reason })
    }

    /// The name of the colour map, if the file gives one.
    #[must_use]
    pub fn name(&self) -> Option<&str> {
        self.name.as_deref()
    }

    /// Whether the file holds opacities.
    #[must_use]
    pub fn has_opacities(&self) -> bool {
        self.opacities.is_some()
    }

    /// The transfer function for a volume.
    ///
    /// # Errors
    /// If the file holds only colours, or more points than a transfer function may have.
    pub fn points(&self, facts: &VolumeFacts) -> Result<PointsSpec, TransferFileError> {
        let Some(opacities) = &self.opacities else {
            return Err(TransferFileError::NoOpacities { path: self.path.clone() });
        };
        let range = facts.central_range;
        let value = |place: f64| match self.values {
            Values::Data => place,
            Values::Shares => range.min * (1.0 - place) + range.max * place,
        };
        let point =
            |(place, color, [alpha]): (f64, [f64; 3], [f64; 1])| PointSpec { value: value(place), color, alpha };
        let points: Vec<PointSpec> = merged(&self.colors, opacities).into_iter().map(point).collect();
        let spec = PointsSpec { unit_distance: self.unit_distance, points };
        let invalid =
            |e: TransferFunctionError| TransferFileError::Invalid { path: self.path.clone(), reason: e.to_string() };
        TransferFunction::new(spec.control_points(), spec.unit_distance.unwrap_or(1.0)).map_err(invalid)?;
        Ok(spec)
    }

    /// The colours as a colour map over positions from 0 to 1. At a step, the colour before it ends a billionth
    /// earlier.
    ///
    /// # Errors
    /// If all colours are at one value.
    pub fn color_map(&self) -> Result<Vec<(f64, [f64; 3])>, TransferFileError> {
        let (first, last) = (self.colors[0].0, self.colors[self.colors.len() - 1].0);
        if first >= last {
            let reason = format!("a colour map spans values; this one is at {first} alone");
            return Err(TransferFileError::Invalid { path: self.path.clone(), reason });
        }
        let place = |value: f64| (value - first) / (last - first);
        let before_step = |i: usize| self.colors.get(i + 1).is_some_and(|next| next.0 == self.colors[i].0);
        let mut places: Vec<(f64, [f64; 3])> = Vec::with_capacity(self.colors.len());
        for (i, (value, color)) in self.colors.iter().enumerate() {
            let least = places.last().map_or(0.0, |point| point.0);
            let at = if before_step(i) { (place(*value) - STEP).max(least) } else { place(*value) };
            places.push((at, *color));
        }
        Ok(places)
    }
}

/// The result of a reader; path and name are added later.
fn file(values: Values, colors: Vec<(f64, [f64; 3])>, opacities: Option<Vec<(f64, [f64; 1])>>) -> TransferFile {
    TransferFile { path: String::new(), name: None, values, colors, opacities, unit_distance: None }
}

/// Our own format: points and unit distance, as in a scene.
fn parse_own(text: &str) -> Result<TransferFile, String> {
    let spec: PointsSpec = serde_json::from_str(text).map_err(|e| e.to_string())?;
    let points = spec.control_points();
    TransferFunction::new(points.clone(), spec.unit_distance.unwrap_or(1.0)).map_err(|e| e.to_string())?;
    let colors = points.iter().map(|p: &ControlPoint| (p.value, p.color)).collect();
    let opacities = points.iter().map(|p| (p.value, [p.alpha])).collect();
    Ok(TransferFile { unit_distance: spec.unit_distance, ..file(Values::Data, colors, Some(opacities)) })
}

/// The keys of a ParaView preset that are used.
#[derive(Deserialize)]
struct ParaView {
    #[serde(rename = "Name")]
    name: Option<String>,
    #[serde(rename = "ColorSpace")]
    color_space: Option<String>,
    #[serde(rename = "RGBPoints")]
    rgb_points: Option<Vec<f64>>,
    #[serde(rename = "Points")]
    points: Option<Vec<f64>>,
    #[serde(rename = "UseLogScale", default)]
    use_log_scale: serde_json::Value,
}

fn parse_paraview(text: &str) -> Result<TransferFile, String> {
    let presets: Vec<ParaView> = serde_json::from_str(text).map_err(|e| e.to_string())?;
    let count = presets.len();
    let preset = presets.into_iter().find(|preset| preset.rgb_points.is_some());
    let preset = preset.ok_or_else(|| {
        format!("none of its {count} presets has `RGBPoints`; colours of categories (`IndexedColors`) are not read")
    })?;
    if matches!(preset.use_log_scale.as_f64(), Some(scale) if scale != 0.0) || preset.use_log_scale == true {
        return Err("`UseLogScale`: expected a linear scale, found a logarithmic one".into());
    }
    let space = preset.color_space.as_deref().unwrap_or("RGB").parse::<ColorSpace>()?;
    let nodes: Vec<(f64, [f64; 3])> =
        numbers::<4>("RGBPoints", "value, red, green, blue", &preset.rgb_points.unwrap_or_default())?
            .into_iter()
            .map(|[value, r, g, b]| (value, [r, g, b]))
            .collect();
    let colors = curve(&nodes, space);
    let opacities = preset.points.filter(|points| !points.is_empty()).map(|points| opacities(&points)).transpose()?;
    Ok(TransferFile { name: preset.name, ..file(Values::Data, colors, opacities) })
}

/// Groups of `N` numbers. The first of a group is a value, ascending; numbers 2 to 4 are shares in [0, 1].
fn numbers<const N: usize>(key: &str, of: &str, flat: &[f64]) -> Result<Vec<[f64; N]>, String> {
    let (groups, rest) = flat.as_chunks::<N>();
    if groups.is_empty() || !rest.is_empty() || groups.len() > POINT_LIMIT {
        return Err(format!(
            "`{key}`: expected 1 to {POINT_LIMIT} groups of {N} numbers ({of}), found {} numbers",
            flat.len()
        ));
    }
    if let Some(i) = groups.iter().position(|group| group.iter().any(|n| !n.is_finite())) {
        return Err(format!("`{key}`: expected finite numbers, found {:?} in group {i}", groups[i]));
    }
    if let Some(i) = groups.windows(2).position(|pair| pair[0][0] > pair[1][0]) {
        return Err(format!("`{key}`: expected values that ascend, found {} after {}", groups[i + 1][0], groups[i][0]));
    }
    let shares = |group: &[f64; N]| group[1..].iter().all(|share| (0.0..=1.0).contains(share));
    if let Some(i) = groups.iter().position(|group| !shares(group)) {
        return Err(format!(
            "`{key}`: expected numbers from 0 to 1 behind the value, found {:?} in group {i}",
            &groups[i][1..]
        ));
    }
    Ok(groups.to_vec())
}

/// Opacities of a piecewise function of VTK: value, opacity, midpoint, sharpness. If the midpoint is not the middle of
/// a piece, a point is added there.
fn opacities(flat: &[f64]) -> Result<Vec<(f64, [f64; 1])>, String> {
    let nodes = numbers::<4>("Points", "value, opacity, midpoint, sharpness", flat)?;
    let mut out: Vec<(f64, [f64; 1])> = Vec::with_capacity(nodes.len());
    for (i, [value, alpha, midpoint, sharpness]) in nodes.iter().enumerate() {
        out.push((*value, [*alpha]));
        let Some([next, end, ..]) = nodes.get(i + 1) else { continue };
        if *sharpness != 0.0 {
            return Err(format!(
                "`Points`: expected straight lines (sharpness 0), found sharpness {sharpness} in group {i}"
            ));
        }
        if *midpoint != 0.5 {
            out.push((value + midpoint * (next - value), [0.5 * (alpha + end)]));
        }
    }
    Ok(out)
}

/// A colour map that is linear in another space, as points that are dense enough for linear interpolation in RGB.
fn curve(nodes: &[(f64, [f64; 3])], space: ColorSpace) -> Vec<(f64, [f64; 3])> {
    let parts = if space == ColorSpace::Rgb { 1 } else { CURVE_PARTS.min(POINT_LIMIT / nodes.len() / 2).max(1) };
    let mut out = Vec::with_capacity(nodes.len() * parts);
    for pair in nodes.windows(2) {
        let [(from, before), (to, after)] = [pair[0], pair[1]];
        // A step has no intermediate colours.
        let parts = if to > from && space != ColorSpace::Step { parts } else { 1 };
        out.extend((0..parts).map(|part| {
            let share = part as f64 / parts as f64;
            (from + share * (to - from), space.between(before, after, share))
        }));
        if space == ColorSpace::Step {
            out.push((to, before));
        }
    }
    out.extend(nodes.last().copied());
    out
}

fn parse_table(text: &str) -> Result<TransferFile, String> {
    let mut words = text.split_whitespace();
    let count: Option<usize> = words.next().and_then(|word| word.parse().ok());
    let count = count.filter(|count| (2..=TABLE_LIMIT).contains(count)).ok_or_else(|| {
        format!(
            "expected the number of entries, 2 to {TABLE_LIMIT}, found '{}'",
            text.split_whitespace().next().unwrap_or("")
        )
    })?;
    let mut entries = Vec::with_capacity(count);
    for i in 0..count {
        let mut entry = [0.0; 4];
        for (channel, name) in entry.iter_mut().zip(["red", "green", "blue", "alpha"]) {
            let word =
                words.next().ok_or_else(|| format!("expected {count} entries of 4 numbers, it ends in entry {i}"))?;
            let share = word.parse().ok().filter(|share: &f64| (0.0..=1.0).contains(share));
            *channel =
                share.ok_or_else(|| format!("entry {i}, {name}: expected a number from 0 to 1, found '{word}'"))?;
        }
        entries.push(entry);
    }
    if let Some(word) = words.next() {
        return Err(format!("expected {count} entries of 4 numbers, found '{word}' behind them"));
    }
    let mut kept = simplified(&entries, EXACT);
    if kept.len() > POINT_LIMIT {
        kept = simplified(&entries, HALF_A_GREY_LEVEL);
    }
    let place = |i: usize| i as f64 / (count - 1) as f64;
    let colors = kept.iter().map(|&i| (place(i), [entries[i][0], entries[i][1], entries[i][2]])).collect();
    let opacities = kept.iter().map(|&i| (place(i), [entries[i][3]])).collect();
    Ok(file(Values::Shares, colors, Some(opacities)))
}

/// Indices of the entries that remain if entries on the line between their neighbours are dropped.
fn simplified(entries: &[[f64; 4]], tolerance: f64) -> Vec<usize> {
    let last = entries.len() - 1;
    let is_line = |from: usize, to: usize| {
        (from + 1..to).all(|i| {
            let share = (i - from) as f64 / (to - from) as f64;
            let between = |c: usize| entries[from][c] + share * (entries[to][c] - entries[from][c]);
            (0..4).all(|c| (entries[i][c] - between(c)).abs() <= tolerance)
        })
    };
    let mut kept = vec![0];
    let mut from = 0;
    while from < last {
        let mut to = from + 1;
        while to < last && to - from < LINE_LIMIT && is_line(from, to + 1) {
            to += 1;
        }
        kept.push(to);
        from = to;
    }
    kept
}

/// Two piecewise linear functions with common points: the values of both.
fn merged<const A: usize, const B: usize>(
    a: &[(f64, [f64; A])],
    b: &[(f64, [f64; B])],
) -> Vec<(f64, [f64; A], [f64; B])> {
    let mut values: Vec<f64> = a.iter().map(|p| p.0).chain(b.iter().map(|p| p.0)).collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    let is_step = |value: f64| [steps(a, value), steps(b, value)].contains(&true);
    let mut out = Vec::with_capacity(values.len());
    for value in values {
        if is_step(value) {
            out.push((value, limit(a, value, Side::Below), limit(b, value, Side::Below)));
        }
        out.push((value, limit(a, value, Side::Above), limit(b, value, Side::Above)));
    }
    out
}

/// The side from which a value is approached.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Side {
    Below,
    Above,
}

/// Whether several points lie at a value.
fn steps<const N: usize>(points: &[(f64, [f64; N])], value: f64) -> bool {
    points.iter().filter(|p| p.0 == value).count() > 1
}

/// One-sided limit of a function at a value; constant beyond its ends.
fn limit<const N: usize>(points: &[(f64, [f64; N])], value: f64, side: Side) -> [f64; N] {
    let next = match side {
        Side::Below => points.partition_point(|p| p.0 < value),
        Side::Above => points.partition_point(|p| p.0 <= value),
    };
    match (next.checked_sub(1).map(|i| points[i]), points.get(next)) {
        (Some((from, before)), Some(&(to, after))) => {
            let share = (value - from) / (to - from);
            std::array::from_fn(|c| before[c] + share * (after[c] - before[c]))
        }
        (Some((_, end)), None) => end,
        (None, end) => end.map_or([0.0; N], |p| p.1),
    }
}
