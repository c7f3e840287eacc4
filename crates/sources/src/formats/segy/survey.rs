//! Placement of the grid in the world: CDP coordinates, spacing, sample axis.
//!
//! The world frame is local and right-handed: x along the crossline axis, z down, and y a quarter turn clockwise from x
//! on the map. Its origin is the first inline and crossline, at the delay of the first sample. If inlines ascend
//! against y, the grid's second axis points along -y: its frame is left-handed, as in most surveys. Map coordinates are
//! large and rotated against the grid. They are stored as metadata, as the survey's corners.

use super::binary_header::{BinaryHeader, TRACE_HEADER_BYTES};
use super::fields::{Fields, scaled};
use super::grid::Grid;
use super::input::Input;
use super::layout::Layout;
use super::position_fit::PositionFit;
use super::scan::Scan;
use crate::cast::{index, signed};
use crate::{LineNumbers, Message, SourceError};

/// Estimates of a spacing from two opposite edges of the grid must agree this well, as a fraction.
const SPACING_TOLERANCE: f64 = 0.05;

/// A fitted corner may lie off by this fraction of the line spacing, judged by the residual of the fit.
const RESIDUAL_TOLERANCE: f64 = 0.5;

/// Horizontal placement of the grid.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Placement {
    /// Corners as [`crate::Survey::corners`] wants them.
    pub(super) corners: Option<[[f64; 2]; 4]>,
    /// Distance between crosslines (x) and between inlines (y).
    pub(super) spacing: [f64; 2],
    /// Units of the spacing; empty where it counts lines.
    pub(super) units: [&'static str; 2],
}

/// Finds corners and spacing, and notes every assumption.
pub(super) fn place(
    input: Input<'_>,
    (layout, header): (&Layout, &BinaryHeader),
    scan: &Scan,
    grid: &Grid,
    notes: &mut Vec<Message>,
) -> Result<Placement, SourceError> {
    let none = Placement { corners: None, spacing: [1.0; 2], units: [""; 2] };
    let (fit, x_byte) = match (scan.cdp.any(), scan.source.any()) {
        (true, _) => (&scan.cdp, 181),
        (false, true) => {
            notes.push(
                "CDP coordinates (bytes 181-188) are all zero; source coordinates (bytes 73-80) were used".into(),
            );
            (&scan.source, 73)
        }
        (false, false) => return Ok(none),
    };
    let Some(Corners { points, fitted, residual }) = corners(input, layout, grid, fit, x_byte)? else {
        notes.push("coordinates do not determine the grid's corners; the spacing between lines is 1".into());
        return Ok(none);
    };
    if fitted > 0 {
        notes.push(format!(
            "{fitted} of the grid's 4 corners have no live trace; their coordinates were extrapolated from the others"
        ).into());
    }
    let placed = Placement { corners: Some(points), ..none };
    if let Some(reason) = not_lengths(scan, fit) {
        notes.push(format!("{reason}; the spacing between lines is 1").into());
        return Ok(placed);
    }
    let spacing = spacing(points, grid.inline, grid.crossline)
        .filter(|s| fitted == 0 || residual <= RESIDUAL_TOLERANCE * s[0].min(s[1]));
    let Some(spacing) = spacing else {
        notes.push("the coordinates of the corners do not form a grid; the spacing between lines is 1".into());
        return Ok(placed);
    };
    let unit = if header.feet { "ft" } else { "m" };
    let units = [grid.crossline, grid.inline].map(|line| if line.count > 1 { unit } else { "" });
    Ok(Placement { spacing, units, ..placed })
}

/// Directions of the grid's axes in the local world. On a map with the first inline running to the right, inlines
/// ascend upwards or downwards; the corners decide. Without corners, downwards is assumed.
pub(crate) fn direction(corners: Option<[[f64; 2]; 4]>) -> [f64; 9] {
    let ascend_upwards = corners.is_some_and(|points| {
        let [along_x, along_y] = [1, 2].map(|c| [0, 1].map(|k| points[c][k] - points[0][k]));
        along_x[0] * along_y[1] - along_x[1] * along_y[0] > 0.0
    });
    let y = if ascend_upwards { -1.0 } else { 1.0 };
    [1.0, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, 1.0]
}

/// Why coordinates cannot be taken as lengths, if so. Units that the numbers contradict are overruled: no angle in
/// degrees exceeds 360.
fn not_lengths(scan: &Scan, fit: &PositionFit) -> Option<String> {
    let (unit, _) = scan.coordinate_units.iter().max_by_key(|(unit, count)| (**count, **unit))?;
    let (name, full_turn) = match unit {
        2 => ("seconds of arc", 360.0 * 3600.0),
        3 => ("decimal degrees", 360.0),
        4 => ("degrees, minutes, seconds", 3_600_000.0),
        _ => return None,
    };
    (fit.largest <= full_turn).then(|| format!("coordinates are in {name} (bytes 89-90 of the trace headers)"))
}

/// The four corners of the grid.
struct Corners {
    /// As [`crate::Survey::corners`] orders them.
    points: [[f64; 2]; 4],
    /// How many of them are extrapolated.
    fitted: u32,
    /// Residual of the extrapolation; 0 where there is none.
    residual: f64,
}

/// Finds the corners: in the headers of the traces that stand there, else by the fit through all traces.
fn corners(
    input: Input<'_>,
    layout: &Layout,
    grid: &Grid,
    fit: &PositionFit,
    x_byte: usize,
) -> Result<Option<Corners>, SourceError> {
    let (last_x, last_y) = (grid.crossline.count - 1, grid.inline.count - 1);
    let mut corners = Corners { points: [[0.0; 2]; 4], fitted: 0, residual: 0.0 };
    for (corner, (x, y)) in corners.points.iter_mut().zip([(0, 0), (last_x, 0), (0, last_y), (last_x, last_y)]) {
        if let Some(trace) = grid.trace(x, y) {
            let mut buffer = [0; index(TRACE_HEADER_BYTES)];
            input.read(layout.header_offset(trace), &mut buffer)?;
            let fields = Fields::trace_header(&buffer, layout.endian);
            let scalar = fields.i16(71);
            *corner = [x_byte, x_byte + 4].map(|byte| scaled(f64::from(fields.i32(byte)), scalar));
            continue;
        }
        let number = |line: LineNumbers, index: u64| line.first + signed(index) * line.step;
        let fitted = fit.at(number(grid.inline, y), number(grid.crossline, x));
        let Some((point, residual)) = fitted else { return Ok(None) };
        *corner = point;
        corners.fitted += 1;
        corners.residual = residual;
    }
    Ok(Some(corners))
}

/// Spacing along x and y from the corners, 1 along an axis with a single line; `None` if opposite edges disagree.
pub(crate) fn spacing(corners: [[f64; 2]; 4], inline: LineNumbers, crossline: LineNumbers) -> Option<[f64; 2]> {
    let edge = |a: usize, b: usize| (corners[a][0] - corners[b][0]).hypot(corners[a][1] - corners[b][1]);
    let axis = |count: u64, edges: [f64; 2]| -> Option<f64> {
        if count == 1 {
            return Some(1.0);
        }
        let [a, b] = edges.map(|e| e / (count - 1) as f64);
        let sane = a.is_finite() && a > 0.0 && (a - b).abs() <= SPACING_TOLERANCE * a;
        sane.then_some((a + b) / 2.0)
    };
    let x = axis(crossline.count, [edge(1, 0), edge(3, 2)])?;
    let y = axis(inline.count, [edge(2, 0), edge(3, 1)])?;
    // Edges along one line enclose no area, whatever their lengths are.
    let [u, v] = [1, 2].map(|c| [0, 1].map(|k| corners[c][k] - corners[0][k]));
    let area = (u[0] * v[1] - u[1] * v[0]).abs();
    let flat = crossline.count > 1 && inline.count > 1 && area < 0.1 * edge(1, 0) * edge(2, 0);
    (!flat).then_some([x, y])
}

/// Sample interval in ms (or depth units), and whether it is known.
///
/// The binary header's interval rules; the trace headers' is taken where the binary header's is zero or negative. A
/// negative interval is no interval: where neither is positive, samples are counted instead.
pub(super) fn sample_interval(
    header: &BinaryHeader,
    scan: &Scan,
    given: Option<f64>,
    notes: &mut Vec<Message>,
) -> Option<f64> {
    if given.is_some() {
        notes.push("the sample interval was given by hand and is not the file's".into());
        return given;
    }
    let claimed = scan.interval_us.map(|extent| (extent.min.0, extent.max.0));
    if header.interval_us > 0.0 {
        if let Some((min, max)) = claimed
            && (f64::from(min) != header.interval_us || f64::from(max) != header.interval_us)
        {
            notes.push(
                format!(
                    "sample intervals of the trace headers (bytes 117-118) are {min} to {max}; the binary header's {} \
                 (bytes 3217-3218) was used",
                    header.interval_us
                )
                .into(),
            );
        }
        return Some(header.interval_us / 1000.0);
    }
    match claimed {
        Some((min, max)) if min > 0 && min == max => {
            notes.push(
                format!(
                    "the sample interval {max} is the trace headers' (bytes 117-118); the binary header says {} \
                 (bytes 3217-3218)",
                    header.interval_us
                )
                .into(),
            );
            Some(f64::from(max) / 1000.0)
        }
        _ => {
            let traces =
                claimed.map_or("0".into(), |(a, b)| if a == b { a.to_string() } else { format!("{a} to {b}") });
            notes.push(
                format!(
                    "the sample interval is unknown: {} in the binary header (bytes 3217-3218), {traces} in the trace \
                 headers (bytes 117-118); the z axis counts samples",
                    header.interval_us
                )
                .into(),
            );
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fit_recovers_an_affine_grid_with_holes() {
        let mut fit = PositionFit::default();
        let point = |il: f64, xl: f64| [615_000.5 + 12.0 * xl + 0.3 * il, 6_076_000.0 - 0.3 * xl + 25.0 * il];
        for il in 100..140 {
            for xl in (300..400).step_by(2).filter(|xl| (xl * il) % 7 != 0) {
                fit.add([il, xl], point(f64::from(il), f64::from(xl)));
            }
        }
        let ((found, residual), expected) = (fit.at(90, 500).unwrap(), point(90.0, 500.0));
        assert!(residual < 1e-3, "{residual}");
        assert!((found[0] - expected[0]).abs() < 1e-5 && (found[1] - expected[1]).abs() < 1e-5, "{found:?}");
    }

    #[test]
    fn fit_knows_when_points_are_no_grid() {
        let mut fit = PositionFit::default();
        for line in 0..100 {
            fit.add([line / 10, line % 10], [f64::from(line * line % 37), f64::from(line * 7 % 11)]);
        }
        assert!(fit.at(0, 0).unwrap().1 > 3.0);
        let mut diagonal = PositionFit::default();
        (1..9).for_each(|n| diagonal.add([n, n], [f64::from(n), 1.0]));
        assert!(diagonal.at(0, 0).is_none());
    }

    #[test]
    fn the_handedness_of_the_map_is_kept() {
        // East and north: inlines ascend upwards, against y. Mirrored, they ascend along y.
        let north = [[0.0, 0.0], [40.0, 0.0], [0.0, 25.0], [40.0, 25.0]];
        assert_eq!(direction(Some(north))[4], -1.0);
        assert_eq!(direction(Some(north.map(|[x, y]| [x, -y])))[4], 1.0);
        // Turning the map changes nothing.
        assert_eq!(direction(Some(north.map(|[x, y]| [-y, x])))[4], -1.0);
        assert_eq!(direction(None)[4], 1.0);
    }

    #[test]
    fn spacing_needs_edges_that_agree() {
        let line = |count| LineNumbers { first: 1, step: 1, count };
        let square = [[0.0, 0.0], [40.0, 0.0], [0.0, 25.0], [40.0, 25.0]];
        assert_eq!(spacing(square, line(2), line(5)), Some([10.0, 25.0]));
        let crooked = [[0.0, 0.0], [40.0, 0.0], [0.0, 25.0], [90.0, 25.0]];
        assert_eq!(spacing(crooked, line(2), line(5)), None);
        let flat = [[0.0, 0.0], [40.0, 0.0], [40.0, 0.0], [80.0, 0.0]];
        assert_eq!(spacing(flat, line(2), line(5)), None);
        assert_eq!(spacing([[3.0, 4.0]; 4], line(1), line(1)), Some([1.0, 1.0]));
    }
}
