//! Surveys in arrays of Zarr and netCDF: axes called inline, crossline, and time, twt, depth or samples, as MDIO and
//! segysak write them.
//!
//! x counts crosslines, y inlines and z samples, as in SEG-Y. Line numbers and samples come from the coordinates of the
//! axes, corners from the arrays of CDP positions. Lines whose numbers descend are read in reverse, so that numbers
//! ascend along each axis. The world frame is that of SEG-Y.

use supervol_format::Geometry;

use super::cf::Coordinates;
use super::segy::{PositionFit, direction, spacing};
use super::zarr::ome::ArrayAxis;
use crate::cast::{self, index};
use crate::grid::mirrored::Mirrored;
use crate::{Axis, LineNumbers, Message, ReadOption, SourceInfo, Survey};

/// Names of the axes, in lower case.
const INLINE: [&str; 4] = ["inline", "iline", "inlines", "ilines"];
const CROSSLINE: [&str; 4] = ["crossline", "xline", "crosslines", "xlines"];
const SAMPLE: [&str; 8] = ["time", "twt", "depth", "sample", "samples", "tvd", "tvdss", "z"];
/// Names of the arrays of CDP positions, and of the arrays that tell which traces there are.
pub(crate) const POSITIONS: [[&str; 2]; 3] = [["cdp_x", "cdp_y"], ["cdp-x", "cdp-y"], ["CDP_X", "CDP_Y"]];
pub(crate) const MASKS: [&str; 2] = ["trace_mask", "live_mask"];
/// Steps of samples below this are in seconds, if no unit is stated.
const LEAST_STEP_MS: f64 = 0.1;

/// Axes that are crossline, inline and sample; `None` if the array is no survey.
pub(crate) fn survey_axes(axes: &[ArrayAxis]) -> Option<[usize; 3]> {
    let of = |names: &[&str]| {
        let is_named = |axis: &&(usize, &ArrayAxis)| names.contains(&axis.1.name.to_lowercase().as_str());
        let all: Vec<(usize, &ArrayAxis)> = axes.iter().enumerate().collect();
        let mut found = all.iter().filter(is_named).map(|(number, _)| *number);
        found.next().filter(|_| found.next().is_none())
    };
    Some([of(&CROSSLINE)?, of(&INLINE)?, of(&SAMPLE)?])
}

/// Parts of a survey that a file states. Lists of all traces have the crossline fastest.
#[derive(Debug, Default)]
pub(crate) struct SurveyParts {
    /// Coordinates along crosslines, inlines and samples.
    pub(crate) along: [Option<Coordinates>; 3],
    /// CDP x and y of all traces.
    pub(crate) positions: Option<[Coordinates; 2]>,
    /// Whether there is a trace, for all places.
    pub(crate) live: Option<Vec<bool>>,
    /// Domain of samples, such as `TWT` or `depth`, as far as stated apart from the axis.
    pub(crate) domain: Option<String>,
}

impl SurveyParts {
    /// Describes a volume as a survey. `axes` are those of x, y and z.
    pub(crate) fn describe(&self, info: &mut SourceInfo, axes: [&ArrayAxis; 3], notes: &mut Vec<Message>) -> Mirrored {
        let [crosslines, inlines, _] = info.dims.0;
        let mut mirrored = [false; 3];
        let mut lines = |axis: usize, count: u64, name: &str| {
            let (numbers, is_mirrored) = line_numbers(self.along[axis].as_ref(), count, name, notes);
            mirrored[axis] = is_mirrored;
            numbers
        };
        let (crossline, inline) = (lines(0, crosslines, "crossline"), lines(1, inlines, "inline"));
        let corners = self.corners([crosslines, inlines], mirrored);
        let (spacing, unit) = self.spacing(corners, inline, crossline, notes);
        let samples = Samples::of(axes[2], self.along[2].as_ref(), self.domain.as_deref(), notes);
        let missing_traces = self.live.as_ref().map_or(0, |live| live.iter().filter(|live| !**live).count() as u64);
        info.geometry = Geometry {
            spacing: [spacing[0], spacing[1], samples.step],
            origin: [0.0, 0.0, samples.first],
            direction: direction(corners),
        };
        let axis = |name: &str, unit: &str| Axis { name: name.into(), unit: unit.into() };
        let of_lines = |count: u64| if count > 1 { unit.as_str() } else { "" };
        info.axes = [
            axis("crossline", of_lines(crosslines)),
            axis("inline", of_lines(inlines)),
            axis(samples.name, &samples.unit),
        ];
        info.survey = Some(Survey {
            inline,
            crossline,
            corners,
            sample_interval: samples.step,
            first_sample: samples.first,
            missing_traces,
            dead_traces: 0,
            text_header: String::new(),
        });
        Mirrored(mirrored)
    }

    /// Positions of the corners, as [`Survey::corners`] orders them; those without a position from a fit through all.
    /// Files fill the positions of missing traces with zeros or NaN.
    fn corners(&self, [crosslines, inlines]: [u64; 2], mirrored: [bool; 3]) -> Option<[[f64; 2]; 4]> {
        let [xs, ys] = self.positions.as_ref()?;
        let width = index(crosslines);
        let point = |x: usize, y: usize| {
            let at = y * width + x;
            let point = [*xs.values.get(at)?, *ys.values.get(at)?];
            (point.iter().all(|n| n.is_finite()) && point != [0.0; 2]).then_some(point)
        };
        let mut fit = PositionFit::default();
        for (y, x) in (0..index(inlines)).flat_map(|y| (0..width).map(move |x| (y, x))) {
            if let (Some(point), Ok(y), Ok(x)) = (point(x, y), i32::try_from(y), i32::try_from(x)) {
                fit.add([y, x], point);
            }
        }
        let turned = |at: u64, count: u64, is_mirrored: bool| if is_mirrored { count - 1 - at } else { at };
        let corner = |x: u64, y: u64| {
            let (x, y) = (turned(x, crosslines, mirrored[0]), turned(y, inlines, mirrored[1]));
            point(index(x), index(y)).or_else(|| fit.at(cast::signed(y), cast::signed(x)).map(|(point, _)| point))
        };
        let (last_x, last_y) = (crosslines - 1, inlines - 1);
        Some([corner(0, 0)?, corner(last_x, 0)?, corner(0, last_y)?, corner(last_x, last_y)?])
    }

    /// Distances between crosslines and between inlines, and their unit.
    fn spacing(
        &self,
        corners: Option<[[f64; 2]; 4]>,
        inline: LineNumbers,
        crossline: LineNumbers,
        notes: &mut Vec<Message>,
    ) -> ([f64; 2], String) {
        let Some(corners) = corners else { return ([1.0; 2], String::new()) };
        let unit = self.positions.as_ref().map_or("", |[x, _]| x.unit.as_str());
        if unit.starts_with("deg") {
            notes.push(format!("coordinates are in {unit}; the spacing between lines is 1").into());
            return ([1.0; 2], String::new());
        }
        let Some(spacing) = spacing(corners, inline, crossline) else {
            notes.push("the coordinates of the corners do not form a grid; the spacing between lines is 1".into());
            return ([1.0; 2], String::new());
        };
        (spacing, if unit.is_empty() { "m".into() } else { unit.into() })
    }
}

/// Line numbers of an axis, and whether they descend in the file.
fn line_numbers(
    coordinates: Option<&Coordinates>,
    count: u64,
    name: &str,
    notes: &mut Vec<Message>,
) -> (LineNumbers, bool) {
    let is_whole = |n: f64| n.fract() == 0.0 && n.abs() < 1e15;
    let whole = |n: f64| cast::whole::<i64>(n);
    let plain = LineNumbers { first: 1, step: 1, count };
    match coordinates.map(|found| (found, found.even())) {
        Some((_, Some([first, step]))) if is_whole(first) && is_whole(step) => {
            let last = first + step * (count - 1) as f64;
            let first = if step < 0.0 { last } else { first };
            (LineNumbers { first: whole(first), step: whole(step.abs()), count }, step < 0.0)
        }
        Some((found, _)) if count == 1 && found.values.first().is_some_and(|n| is_whole(*n)) => {
            (LineNumbers { first: whole(found.values[0]), ..plain }, false)
        }
        Some(_) => {
            notes.push(format!("the {name} numbers are not evenly spaced: lines are numbered from 1").into());
            (plain, false)
        }
        None => (plain, false),
    }
}

/// Third axis of a survey.
struct Samples {
    name: &'static str,
    unit: String,
    first: f64,
    step: f64,
}

impl Samples {
    /// From the axis and its coordinates. Numbers that descend are heights: they count downwards.
    fn of(axis: &ArrayAxis, coordinates: Option<&Coordinates>, domain: Option<&str>, notes: &mut Vec<Message>) -> Self {
        let said = axis.name.to_lowercase();
        let domain = domain.map(str::to_lowercase).unwrap_or_default();
        let is_time = |text: &str| text.starts_with("time") || text.starts_with("twt") || text.starts_with("owt");
        let is_depth = |text: &str| text.starts_with("depth") || text.starts_with("tvd");
        let name = match &said {
            said if is_time(said) || (!is_depth(said) && is_time(&domain)) => "time",
            said if is_depth(said) || is_depth(&domain) => "depth",
            _ => "sample",
        };
        let Some(([first, step], found)) = coordinates.and_then(|found| Some((found.even()?, found))) else {
            if coordinates.is_some_and(|found| found.values.len() > 1) {
                notes.push(format!("the coordinates along {} are not evenly spaced: samples count", axis.name).into());
            }
            return Self { name: "sample", unit: String::new(), first: 0.0, step: 1.0 };
        };
        let sign = step.signum();
        if sign < 0.0 {
            notes.push(format!("{} descends from {first}: counted downwards from {}", axis.name, -first + 0.0).into());
        }
        let (first, step) = (first * sign + 0.0, step.abs());
        let guess = match name {
            "time" if step < LEAST_STEP_MS => "s",
            "time" => "ms",
            "depth" => "m",
            _ => "",
        };
        let mut unit = found.unit.clone();
        if unit.is_empty() && !guess.is_empty() {
            unit = guess.into();
            let what = Message::from(format!("the unit of {} is not stated: taken for {guess}; ", axis.name));
            notes.push(what.option(ReadOption::AxisUnit).text(" says another"));
        }
        Self { name, unit, first, step }
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::{Dims, VoxelType};

    use super::*;

    fn along(values: &[f64], unit: &str) -> Option<Coordinates> {
        Some(Coordinates { values: values.to_vec(), unit: unit.into() })
    }

    #[test]
    fn a_survey_with_descending_inlines_and_a_missing_corner() {
        let axes = ["iline", "xline", "twt"].map(ArrayAxis::named);
        assert_eq!(survey_axes(&axes), Some([1, 0, 2]));
        let mut info = SourceInfo::plain("zarr", Dims([3, 2, 2]), VoxelType::F32);
        let position = |of: fn(f64, f64) -> f64| {
            let all = [102.0, 100.0].into_iter().flat_map(|il| [7.0, 8.0, 9.0].map(|xl| of(il, xl)));
            let mut values: Vec<f64> = all.collect();
            values[0] = 0.0;
            Coordinates { values, unit: "m".into() }
        };
        let parts = SurveyParts {
            along: [along(&[7.0, 8.0, 9.0], ""), along(&[102.0, 100.0], ""), along(&[0.1, 0.104], "")],
            positions: Some([position(|_, xl| 12.5 * xl), position(|il, _| 25.0 * il)]),
            live: Some(vec![false, true, true, true, true, true]),
            domain: None,
        };
        let mut notes = Vec::new();
        let mirrored = parts.describe(&mut info, [&axes[1], &axes[0], &axes[2]], &mut notes);
        assert_eq!(mirrored, Mirrored([false, true, false]));
        let survey = info.survey.expect("a survey");
        assert_eq!((survey.inline.first, survey.inline.step, survey.crossline.first), (100, 2, 7));
        assert_eq!((survey.missing_traces, survey.first_sample), (1, 0.1));
        let corners = survey.corners.expect("corners");
        let expected = [[87.5, 2500.0], [112.5, 2500.0], [87.5, 2550.0], [112.5, 2550.0]];
        for (corner, expected) in corners.iter().zip(expected) {
            assert!((corner[0] - expected[0]).abs() < 1e-6 && (corner[1] - expected[1]).abs() < 1e-6, "{corners:?}");
        }
        assert_eq!((info.axes[2].name.as_str(), info.axes[2].unit.as_str()), ("time", "s"));
        assert!((info.geometry.spacing[0] - 12.5).abs() < 1e-6 && (info.geometry.spacing[1] - 50.0).abs() < 1e-6);
    }

    #[test]
    fn other_axes_are_no_survey() {
        let named = |names: [&str; 3]| survey_axes(&names.map(ArrayAxis::named));
        assert_eq!(named(["z", "y", "x"]), None);
        assert_eq!(named(["Inline", "Crossline", "Depth"]), Some([1, 0, 2]));
        assert_eq!(named(["inline", "inline", "time"]), None);
    }
}
