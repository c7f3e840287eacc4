//! Tables of the chart: benefit of the default, cost of codecs and storage, all points.

use std::fmt::Write;

use super::html::{bytes, details, escape, number, number_or_dash, paragraph, table};
use crate::measure::INVISIBLE;
use crate::methods::{DEFAULT, ERRORS};
use crate::points::{CPU, Point};
use crate::stated::AtLevel;

/// Families that compete with the default: they integrate rays in another way. Variations of the default (termination,
/// levels, codecs, ...) are not included.
const RIVALS: [&str; 7] = [
    "midpoint samples",
    "midpoint samples, jittered",
    "left samples",
    "pre-integrated",
    "pre-integrated, no self-attenuation",
    "pre-classified",
    "opacity not corrected for the step",
];

/// The default and its best rivals on one scene and look.
struct Comparison<'a> {
    default: &'a Point,
    /// The cheapest rival that is at least as accurate.
    as_near: Option<&'a Point>,
    /// The most accurate rival that is at least as cheap.
    as_cheap: Option<&'a Point>,
}

fn compare(points: &[Point]) -> Option<Comparison<'_>> {
    let default = points.iter().find(|p| p.default)?;
    let rivals = || points.iter().filter(|p| p.backend == CPU && RIVALS.contains(&p.method.as_str()));
    let as_near = rivals().filter(|p| p.linf <= default.linf).min_by(|a, b| a.cpu_ms.total_cmp(&b.cpu_ms));
    let as_cheap = rivals().filter(|p| p.cpu_ms <= default.cpu_ms).min_by(|a, b| a.linf.total_cmp(&b.linf));
    Some(Comparison { default, as_near, as_cheap })
}

/// The points, grouped by scene and look.
fn looks(points: &[Point]) -> impl Iterator<Item = &[Point]> {
    points.chunk_by(|a, b| (&a.scene, &a.transfer_function) == (&b.scene, &b.transfer_function))
}

/// The default against its rivals: counts and a table.
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

/// The default's curve over all pictures: requested error, measured error, cost.
pub(super) fn errors_asked_for(points: &[Point]) -> String {
    let of_look = |look: &[Point], levels: f64| -> Option<[f64; 4]> {
        let at = |levels: f64| {
            let asked =
                |p: &&Point| p.method == DEFAULT && p.max_error.is_some_and(|e| (e * 255.0 - levels).abs() < 1e-9);
            look.iter().find(asked)
        };
        let (point, default) = (at(levels)?, look.iter().find(|p| p.default)?);
        let stated = point.stated.unwrap_or(f64::NAN);
        Some([point.linf * 255.0, point.p999 * 255.0, point.cpu_ms / default.cpu_ms, stated * 255.0])
    };
    let row = |levels: f64| {
        let mut found: Vec<[f64; 4]> = looks(points).filter_map(|look| of_look(look, levels)).collect();
        let above = found.iter().filter(|[largest, ..]| *largest > levels).count();
        // Pictures that state nothing are not above it.
        let above_stated = found.iter().filter(|[largest, .., stated]| largest > stated).count();
        found.sort_by(|a, b| a[2].total_cmp(&b[2]));
        let middle = found.get(found.len() / 2)?[2];
        let greatest = |i: usize| found.iter().map(|f| f[i]).fold(0.0, f64::max);
        let range = format!("{} to {}", number(found[0][2]), number(found[found.len() - 1][2]));
        let of_all = |count: usize| format!("{count} of {}", found.len());
        let errors = [levels, greatest(3), greatest(0), greatest(1)].map(number);
        let numbers = errors.into_iter().chain([of_all(above), of_all(above_stated)]);
        Some(numbers.chain([number(middle), range]).collect::<Vec<String>>())
    };
    let rows: Vec<Vec<String>> = ERRORS.into_iter().filter_map(row).collect();
    if rows.is_empty() {
        return paragraph("The default was not measured at several errors in this run.");
    }
    paragraph(
        "The default drawn at each error that can be asked for (--max-error), over all pictures: the true error, the one that \
         a picture states, and pictures whose true error is above either. Errors are in grey levels of 255. Cost is the processor time of a picture over that of the same picture at the default error: the median, and from \
         the least to the greatest.",
    ) + &table(
        &[
            "asked for",
            "largest stated",
            "largest true",
            "largest 99.9th percentile",
            "pictures above asked",
            "pictures above stated",
            "cost, median",
            "cost",
        ],
        &rows,
    )
}

/// Stated and true errors of pixels drawn from a fixed level.
pub(super) fn stated(scenes: &[(String, Vec<AtLevel>)]) -> String {
    let row = |scene: &str, at: &AtLevel| {
        vec![
            escape(scene),
            at.level.to_string(),
            number(at.pixels as f64),
            number(at.median_true_grey_levels),
            number(at.median_stated_grey_levels),
            number(at.median_stated_over_true),
            number(at.largest_share_of_stated),
            format!("{:.0} %", 100.0 * at.share_with_a_bound),
            number(at.scenes_above_stated.len() as f64),
        ]
    };
    let rows: Vec<_> = scenes.iter().flat_map(|(scene, levels)| levels.iter().map(|at| row(scene, at))).collect();
    let headings = [
        "scene",
        "level drawn",
        "pixels that are off",
        "true, median",
        "stated, median",
        "stated / true, median",
        "largest true / stated",
        "with a bound",
        "looks with a pixel beyond",
    ];
    paragraph(
        "With every picture comes, pixel by pixel, how far it may be from the exact picture of level 0 (--error-map). Here that is \
         compared with how far it is, over all looks of a scene and all pixels that are more than a hundredth of a grey level off. \
         What is stated must never be less than what is true; how much more it is, is what a user pays for certainty. Of a pixel \
         without a bound nothing is known but that colours end at white. Grey levels of 255.",
    ) + &table(&headings, &rows)
}

/// Bytes read, and processor time of the first picture, by codec and storage.
pub(super) fn storage(points: &[Point]) -> String {
    let mut html = paragraph(
        "A volume is stored in bricks, each encoded on its own. Bytes are those that the first picture read; the first \
         picture's processor time includes reading, checking and decoding them. Codecs give back the same voxels, so their \
         errors are equal; a bounded codec moves each by no more than its share of the volume's range, and storage in 8 or 16 \
         bits rounds them: that is their error.",
    );
    let is_shown = |p: &&Point| ["codec", "bounded codec", "storage"].contains(&p.method.as_str()) || p.default;
    let has_codecs = |look: &&[Point]| look.iter().any(|p| p.method == "codec");
    let row = |p: &Point| {
        let what = if p.default { "default".into() } else { format!("{}: {}", p.method, p.parameters) };
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

/// Tables of all points, folded by scene.
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
        "stated",
        "asked",
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
        let time = [p.cpu_ms, p.cpu_ms_spread, p.wall_ms].map(number);
        let promised = [p.stated, p.max_error].map(number_or_dash);
        let errors = [number(p.linf)].into_iter().chain(promised).chain([p.p999, p.rmse].map(number));
        let rest = [
            number_or_dash(p.psnr_db),
            number(p.bias),
            number_or_dash(p.flip),
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

    #[test]
    fn the_curve_is_summed_up_over_pictures() {
        let aimed = |levels: f64, cpu_ms, linf, look: &str| {
            let (method, max_error) = (DEFAULT.into(), Some(levels / 255.0));
            let is_default = levels == 0.5;
            let base = point("default", cpu_ms, linf / 255.0);
            // One picture of 9 grey levels states less.
            let stated = Some((0.9 * levels).max(if linf == 9.0 { 0.0 } else { linf }) / 255.0);
            Point { method, max_error, stated, default: is_default, transfer_function: look.into(), ..base }
        };
        let points = [
            aimed(8.0, 1.0, 3.0, "a"),
            aimed(0.5, 4.0, 0.25, "a"),
            aimed(8.0, 3.0, 9.0, "b"),
            aimed(0.5, 6.0, 0.125, "b"),
        ];
        let html = errors_asked_for(&points);
        for part in [">8<", ">9<", ">7.2<", "1 of 2", ">0.45<", ">0.5<", ">0.25 to 0.5<", "0 of 2", ">1 to 1<"] {
            assert!(html.contains(part), "no {part} in {html}");
        }
        assert!(errors_asked_for(&[]).contains("not measured"));
    }
}
