//! Convergence section: one plot per field and transfer function, and the measured orders beside the expected ones.

use super::html::{escape, figure, grid, number, number_or_dash, paragraph, table};
use super::palette;
use super::plots::{Plot, Series};
use crate::convergence::OrderRow;
use crate::measure::INVISIBLE;

/// The section of the report.
pub(super) fn section(rows: &[OrderRow]) -> String {
    if rows.is_empty() {
        return paragraph("Orders of convergence were not measured in this run.");
    }
    let same = |a: &OrderRow, b: &OrderRow| (a.field, a.transfer_function) == (b.field, b.transfer_function);
    let figures: Vec<String> = rows.chunk_by(same).map(convergence_figure).collect();
    let cells = |row: &OrderRow| {
        vec![
            escape(row.field),
            escape(row.transfer_function),
            escape(row.rule),
            order(row),
            number_or_dash(row.expected_order),
            number_or_dash(row.samples_per_voxel_needed),
            number_or_dash(row.expected_samples),
        ]
    };
    let headings = [
        "field",
        "transfer function",
        "rule",
        "order measured, \u{b1} spread from one set of 24 rays to the next",
        "order computed independently",
        "samples per voxel for half a grey level",
        "the same, computed independently",
    ];
    paragraph(
        "The order says how quickly error falls as samples are added: at order 2, twice the samples make a quarter of the \
         error. A dash under samples means: more than were tried, or not known. The independent computation is of one set of \
         24 rays, and orders over steps and narrow hats differ from set to set.",
    ) + &table(&headings, &rows.iter().map(cells).collect::<Vec<_>>())
        + &grid(&figures)
}

/// The order, with its spread if there is one.
fn order(row: &OrderRow) -> String {
    if row.order_spread == 0.0 {
        return number(row.order);
    }
    format!("{} \u{b1} {}", number(row.order), number(row.order_spread))
}

fn convergence_figure(rows: &[OrderRow]) -> String {
    let series = rows.iter().enumerate().map(|(i, row)| Series {
        name: row.rule.to_owned(),
        look: palette::look(row.rule, i),
        points: row.curve.clone(),
    });
    let labels = ["samples per voxel", "largest error, share of full scale"];
    let plot = Plot {
        guides: rows.iter().filter_map(guide).collect(),
        limit: Some((INVISIBLE, "half a grey level".into())),
        ..Plot::of_lines(labels, series.collect())
    };
    figure(
        &format!("{}, {}: error against samples", rows[0].field, rows[0].transfer_function),
        &plot.html(),
        "Steeper is better; a dashed grey line falls from a method's first point at the order computed independently.",
    )
}

/// Guide line of the expected order, from the first point with an error above 0.
fn guide(row: &OrderRow) -> Option<Vec<(f64, f64)>> {
    let order = row.expected_order?;
    let &(x0, y0) = row.curve.iter().find(|(x, y)| *x > 0.0 && *y > 0.0)?;
    let least = row.curve.iter().map(|p| p.1).filter(|y| *y > 0.0).fold(f64::INFINITY, f64::min);
    let line = row.curve.iter().filter(|p| p.0 >= x0).map(|&(x, _)| (x, y0 * (x / x0).powf(-order)));
    // Points far below the plot's own points would lie along its lower edge.
    Some(line.take_while(|p| p.1 >= 0.5 * least).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_tabled_and_guides_have_the_expected_slope() {
        let row = OrderRow {
            field: "waves",
            transfer_function: "smooth",
            rule: "midpoint samples",
            order: 1.98,
            order_spread: 0.02,
            expected_order: Some(2.0),
            samples_per_voxel_needed: None,
            expected_samples: None,
            curve: vec![(1.0, 1e-2), (2.0, 2.6e-3), (4.0, 6e-4)],
        };
        let line = guide(&row).unwrap();
        assert_eq!(line.len(), 3);
        assert!((line[2].1 - 1e-2 / 16.0).abs() < 1e-12);
        let html = section(&[row]);
        assert!(html.contains("1.98") && html.contains("<svg") && html.contains("error against samples"));
        assert!(section(&[]).contains("not measured"));
    }
}
