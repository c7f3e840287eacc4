//! The stability suite as its own page and as a section of the report.

use super::html::{self, Section, escape, grid, number, number_or_dash, paragraph, table};
use super::machine::Circumstances;
use super::plots::{Plot, Scaling, Series};
use super::{Extent, figure, palette};
use crate::record::{RecordedGate, RegimeRecord};
use crate::stability::WAITING;

/// Content of `stability.html`.
#[must_use]
pub fn stability_page(records: &[RegimeRecord], here: &Circumstances) -> String {
    let summary = paragraph(
        "Every method of volume rendering breaks somewhere: at borders between bricks, on thin features, far from the \
         origin, in almost opaque data. Each regime below leads into one such failure on purpose, measures the way there, \
         and holds the default to a promise (a gate).",
    );
    let sections = [
        Section::new("results", "Results", overview(records, "")),
        Section::new("curves", "Curves into the failure", curves(records)),
        Section::new("waiting", "Regimes that wait", waiting()),
        html::circumstances(here),
    ];
    html::page("Supervol: where methods fail", &summary, &sections)
}

/// Stability section of the chart's report.
pub(super) fn section(records: Option<&[RegimeRecord]>, extent: Extent) -> String {
    match records {
        Some(records) if extent == Extent::Whole => overview(records, "") + &curves(records),
        Some(records) => overview(records, PAGE),
        None => paragraph(
            "The stability suite has not been run into this folder; `supervol chart --stability -o FOLDER` does so, and the \
             next report into the folder shows it.",
        ),
    }
}

/// File name of the suite's own page, beside the report.
const PAGE: &str = "stability.html";

/// The word for a passed or failed gate.
fn verdict(pass: bool) -> &'static str {
    if pass { html::PASS } else { html::FAIL }
}

/// Table of all regimes. `page`: the page with their curves; empty for the same page.
fn overview(records: &[RegimeRecord], page: &str) -> String {
    let failed: Vec<&str> = records.iter().filter(|r| !r.pass).map(|r| r.id.as_str()).collect();
    let passed = records.len() - failed.len();
    let which = if failed.is_empty() { String::new() } else { format!(" ({})", failed.join(", ")) };
    let count =
        format!("<p><b>{passed}</b> of {} regimes pass, <b>{}</b> fail{which}.</p>\n", records.len(), failed.len());
    let row = |r: &RegimeRecord| {
        // The first failed gate, because readers look for it first.
        let first = r.gates.iter().find(|g| !g.pass).or(r.gates.first());
        let value = first.map_or_else(|| "\u{2013}".into(), |g| number_or_dash(g.value));
        vec![
            format!("<a href=\"{page}#{0}\">{0}</a>", escape(&r.id)),
            escape(&r.title),
            verdict(r.pass).into(),
            first.map_or_else(String::new, |g| escape(&g.what)),
            value,
            first.map_or_else(|| "\u{2013}".into(), limit),
        ]
    };
    let rows: Vec<Vec<String>> = records.iter().map(row).collect();
    count + &table(&["regime", "what fails", "result", "quoted gate", "measured", "promised"], &rows)
}

fn limit(gate: &RecordedGate) -> String {
    let sign = if gate.side == "at_most" { "≤" } else { "≥" };
    format!("{sign}\u{a0}{}", number_or_dash(gate.limit))
}

fn curves(records: &[RegimeRecord]) -> String {
    grid(&records.iter().map(regime).collect::<Vec<_>>())
}

/// One regime: recipe, curve, gates, note.
fn regime(record: &RegimeRecord) -> String {
    let gate = |g: &RecordedGate| {
        let value = g.value.map_or_else(|| "not finite".into(), number);
        format!("<li>{} {}: {value}, promised {}</li>", verdict(g.pass), escape(&g.what), limit(g))
    };
    let gates: String = record.gates.iter().map(gate).collect();
    let curve = if record.curve.is_empty() { paragraph("There is no curve.") } else { plot(record).html() };
    let (id, title) = (escape(&record.id), format!("{}: {}", record.id, record.title));
    let drawn = figure(
        &title,
        &curve,
        "Further right is deeper into the failure; lines are measured, dashed grey lines are what must come out, where that \
         is known; on an axis of powers of ten, 0 lies at the lower edge.",
    );
    let note = if record.note.is_empty() { String::new() } else { paragraph(&record.note) };
    format!("<div id=\"{id}\">{drawn}{}<ul>{gates}</ul>{note}</div>", paragraph(&record.recipe))
}

fn plot(record: &RegimeRecord) -> Plot {
    let mut names: Vec<&str> = Vec::new();
    for point in &record.curve {
        if !names.contains(&point.series.as_str()) {
            names.push(&point.series);
        }
    }
    let points = |name: &str, expected: bool| {
        let of_series = record.curve.iter().filter(|p| p.series == name);
        let y = of_series.map(|p| (p.x, if expected { p.expected } else { p.measured }));
        y.filter_map(|(x, y)| Some((x?, y?))).collect::<Vec<(f64, f64)>>()
    };
    let line = |(place, name): (usize, &&str)| Series {
        name: (*name).into(),
        look: palette::look(name, place),
        points: points(name, false),
    };
    let series = names.iter().enumerate().map(line).collect();
    Plot {
        scaling: [Scaling::Automatic; 2],
        guides: names.iter().map(|name| points(name, true)).collect(),
        ..Plot::of_lines([&record.x_label, &record.y_label], series)
    }
}

fn waiting() -> String {
    let rows: Vec<Vec<String>> = WAITING.iter().map(|(id, what)| vec![escape(id), escape(what)]).collect();
    paragraph("These regimes are about parts that do not exist yet.") + &table(&["regime", "waits for"], &rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ChartError;
    use crate::record::tests::{REGIME, outcome};

    #[test]
    fn the_page_shows_curves_gates_and_failures() {
        let measured = RegimeRecord::new(&REGIME, &Ok(outcome()), 1.0);
        let broken = RegimeRecord::new(&REGIME, &Err(ChartError::Broken("on <purpose>".into())), 1.0);
        let page = stability_page(&[measured, broken], &Circumstances::now("supervol chart --stability"));
        for part in
            ["FAIL", "PASS", "<svg", "size, voxels", "on &lt;purpose&gt;", "fixture &lt;of&gt;", "S28", "not finite"]
        {
            assert!(page.contains(part), "no {part}");
        }
        assert!(page.contains("<b>0</b> of 2 regimes pass"));
        let records = [RegimeRecord::new(&REGIME, &Ok(outcome()), 1.0)];
        let [whole, summary] = [Extent::Whole, Extent::Summary].map(|extent| section(Some(&records), extent));
        assert!(whole.contains("<svg") && whole.contains("href=\"#S99\""));
        assert!(!summary.contains("<svg") && summary.contains("href=\"stability.html#S99\""));
    }
}
