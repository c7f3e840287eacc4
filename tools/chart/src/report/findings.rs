//! Tables of the chart: what the default buys, what codecs and storage cost, every point.

use std::fmt::Write;

use super::html::{bytes, details, escape, number, number_or_dash, paragraph, table};
use crate::measure::INVISIBLE;
use crate::methods::CELLS;
use crate::points::{CPU, Point};

/// Families that integrate a ray in another way than the default's: what it competes with. Variations of the default
/// (termination, levels, codecs, ...) are not among them.
const RIVALS: [&str; 7] = [
    "midpoint samples",
    "midpoint samples, jittered",
    "left samples",
    "pre-integrated",
    "pre-integrated, no self-attenuation",
    "pre-classified",
    "opacity not corrected for the step",
];

/// What the default is compared with on one scene and look.
struct Comparison<'a> {
    default: &'a Point,
    /// The cheapest rival that is at least as near to exact.
    as_near: Option<&'a Point>,
    /// The nearest rival that is at least as cheap.
    as_cheap: Option<&'a Point>,
}

fn compare(points: &[Point]) -> Option<Comparison<'_>> {
    let default = points.iter().find(|p| p.default)?;
    let rivals = || points.iter().filter(|p| p.backend == CPU && RIVALS.contains(&p.method.as_str()));
    let as_near = rivals().filter(|p| p.linf <= default.linf).min_by(|a, b| a.cpu_ms.total_cmp(&b.cpu_ms));
    let as_cheap = rivals().filter(|p| p.cpu_ms <= default.cpu_ms).min_by(|a, b| a.linf.total_cmp(&b.linf));
    Some(Comparison { default, as_near, as_cheap })
}

/// The points of one scene and look after the other.
fn looks(points: &[Point]) -> impl Iterator<Item = &[Point]> {
    points.chunk_by(|a, b| (&a.scene, &a.transfer_function) == (&b.scene, &b.transfer_function))
}

/// The default against its rivals, counted and as a table.
pub(super) fn findings(points: &[Point]) -> String {
    let all: Vec<Comparison<'_>> = looks(points).filter_map(compare).collect();
    let invisible = all.iter().filter(|c| c.default.linf <= INVISIBLE).count();
    let unmatched = all.iter().filter(|c| c.as_near.is_none()).count();
    let beaten = all.iter().filter(|c| c.as_near.is_some_and(|rival| rival.cpu_ms < c.default.cpu_ms)).count();
    let mut html = format!(
        "<p>On <b>{invisible} of {0}</b> pictures the default's largest error is below half a grey level. On <b>{unmatched} of \
         {0}</b> no method of equal steps, at any of the steps measured, comes as near to the exact picture; on \
         <b>{beaten} of {0}</b> one does so in less processor time.</p>\n",
        all.len()
    );
    html += &paragraph(
        "Errors are the largest of any pixel, in grey levels of 255. Read a row as: the default costs this much and is this \
         far off; the cheapest method of equal steps that is as accurate costs so many times as much; and the best that \
         equal steps reach in the default's time is so far off.",
    );
    let rows: Vec<Vec<String>> = all.iter().map(comparison_row).collect();
    let headings = [
        "scene",
        "transfer function",
        "default, ms",
        "its error",
        "on the front",
        "cheapest as accurate",
        "times the cost",
        "most accurate as cheap",
        "its error",
    ];
    html + &table(&headings, &rows)
}

fn comparison_row(c: &Comparison<'_>) -> Vec<String> {
    let levels = |p: &Point| number(p.linf * 255.0);
    let name =
        |p: Option<&Point>| p.map_or_else(|| "none".into(), |p| escape(&format!("{}, {}", p.method, p.parameters)));
    vec![
        escape(&c.default.scene),
        escape(&c.default.transfer_function),
        number(c.default.cpu_ms),
        levels(c.default),
        if c.default.pareto { "yes".into() } else { "no".into() },
        name(c.as_near),
        number_or_dash(c.as_near.map(|p| p.cpu_ms / c.default.cpu_ms)),
        name(c.as_cheap),
        c.as_cheap.map_or_else(|| "\u{2013}".into(), levels),
    ]
}

/// Bytes read and the first picture's processor time, by codec and storage.
pub(super) fn storage(points: &[Point]) -> String {
    let mut html = paragraph(
        "A volume is stored in bricks, each encoded on its own. Bytes are those that the first picture read; the first \
         picture's processor time includes reading, checking and decoding them. Codecs give back the same voxels, so their \
         errors are equal; storage in 8 or 16 bits rounds them, which is its error.",
    );
    let is_shown = |p: &&Point| p.method == "codec" || p.method == "storage" || p.default;
    let has_codecs = |look: &&[Point]| look.iter().any(|p| p.method == "codec");
    let row = |p: &Point| {
        let what = if p.method == CELLS { "default".into() } else { format!("{}: {}", p.method, p.parameters) };
        vec![
            escape(&p.scene),
            escape(&p.transfer_function),
            escape(&what),
            bytes(p.bytes_read),
            number(p.bricks_read as f64),
            number(p.cold_cpu_ms),
            number(p.cpu_ms),
            number(p.linf * 255.0),
        ]
    };
    let rows: Vec<_> = looks(points).filter(has_codecs).flatten().filter(is_shown).map(row).collect();
    let headings = [
        "scene",
        "transfer function",
        "stored as",
        "read",
        "bricks",
        "first picture, CPU ms",
        "later pictures, CPU ms",
        "largest error, grey levels",
    ];
    html += &table(&headings, &rows);
    html
}

/// Every point, folded away by scene.
pub(super) fn all_points(points: &[Point]) -> String {
    let mut html = paragraph(
        "The same numbers as in points.csv and points.json. Errors are shares of full scale; bias is the mean signed \
         difference; FLIP is a difference as people see it, 0 (same) to 1; spread is the greatest minus the least time.",
    );
    for of_scene in points.chunk_by(|a, b| a.scene == b.scene) {
        html += &details(&format!("{}: {} points", of_scene[0].scene, of_scene.len()), &points_table(of_scene));
    }
    html
}

fn points_table(points: &[Point]) -> String {
    let headings = [
        "transfer function",
        "method",
        "parameters",
        "CPU ms",
        "spread",
        "wall ms",
        "samples",
        "read",
        "largest",
        "99.9 %",
        "RMSE",
        "PSNR dB",
        "bias",
        "FLIP",
        "front",
    ];
    let mut html = String::from("<div class=\"wide\"><table><thead><tr>");
    headings.iter().for_each(|h| html += &format!("<th>{}</th>", escape(h)));
    html += "</tr></thead><tbody>\n";
    for p in points {
        let texts = [&p.transfer_function, &p.method, &p.parameters].map(|t| format!("<td>{}</td>", escape(t)));
        let [time, errors] = [[p.cpu_ms, p.cpu_ms_spread, p.wall_ms], [p.linf, p.p999, p.rmse]].map(|n| n.map(number));
        let rest = [
            number_or_dash(p.psnr_db),
            number(p.bias),
            number(p.flip),
            if p.pareto { "●".into() } else { String::new() },
        ];
        let counts = [p.samples.to_string(), bytes(p.bytes_read)];
        let numbers = time.into_iter().chain(counts).chain(errors).chain(rest);
        let numbers: String = numbers.map(|n| format!("<td class=\"n\">{n}</td>")).collect();
        let class = if p.default { " class=\"default\"" } else { "" };
        let _ = writeln!(html, "<tr{class}>{}{numbers}</tr>", texts.concat());
    }
    html + "</tbody></table></div>\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::points::tests::point;

    #[test]
    fn rivals_are_families_of_the_chart() {
        for rival in RIVALS {
            assert!(crate::methods::methods().iter().any(|m| m.method == rival), "{rival}");
        }
    }

    #[test]
    fn the_default_is_compared_with_the_cheapest_as_near_and_the_nearest_as_cheap() {
        let mut points = vec![
            point("default", 4.0, 0.01),
            point("midpoint samples", 3.0, 0.2),
            point("midpoint samples", 2.0, 0.3),
            point("pre-integrated", 8.0, 0.01),
            point("left samples", 9.0, 0.001),
            point("termination", 1.0, 0.0),
        ];
        let c = compare(&points).unwrap();
        assert_eq!((c.as_near.map(|p| p.cpu_ms), c.as_cheap.map(|p| p.linf)), (Some(8.0), Some(0.2)));
        assert!(findings(&points).contains("<b>0 of 1</b>"));
        points[0].default = false;
        assert!(compare(&points).is_none());
    }
}
