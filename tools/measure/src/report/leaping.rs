//! Cost and benefit of empty-space skipping: a figure and a table.

use super::html::{escape, figure, number, paragraph, table};
use super::palette;
use super::plots::{Plot, Series};
use crate::leaping::{Measured, Ways};

/// Goal for rebuilding the clouds of 16.8 million macro cells, processor time, milliseconds.
const REBUILDING_GOAL_MS: f64 = 100.0;

/// The section of the report.
pub(super) fn section(scenes: &[Measured]) -> String {
    if scenes.is_empty() {
        return paragraph("Leaping was not measured in this run.");
    }
    let row = |scene: &Measured, ways: &Ways| {
        vec![
            escape(&scene.scene),
            escape(ways.kind),
            number(ways.leaps as f64),
            format!("{} %", number(100.0 * ways.walked)),
            number(ways.cpu_ms),
        ]
    };
    let rows: Vec<_> = scenes.iter().flat_map(|scene| scene.ways.iter().map(|ways| row(scene, ways))).collect();
    let headings = ["scene", "rays leap by", "leaps", "way walked cell by cell", "CPU ms"];
    paragraph(
        "Where a transfer function shows nothing, rays need not look. A proximity cloud says of each cube of cells how far the \
         nearest cube is that may show something (in the direction in which rays go, where it says ahead), so that a ray leaps \
         that far at once; an octree lets it leap out of the largest empty node around it. Cubes are macro cells of 8 cells \
         along an edge, or blocks of 4. Here rays go through all bricks of a picture without reading a voxel; in packets, but \
         for the last two rows of each scene, whose times compare with each other only.",
    ) + &table(&headings, &rows)
        + &rebuilding(scenes)
}

fn rebuilding(scenes: &[Measured]) -> String {
    let series = scenes.iter().enumerate().map(|(i, scene)| Series {
        name: scene.scene.clone(),
        look: palette::look(&scene.scene, i),
        points: scene.rebuilding.iter().map(|&(count, ms)| (count as f64, ms)).collect(),
    });
    let labels = ["macro cells", "clouds of all of them, CPU ms"];
    let limit = Some((REBUILDING_GOAL_MS, "goal for 16.8 million".into()));
    let plot = Plot { limit, ..Plot::of_lines(labels, series.collect()) };
    let reading = "What a new transfer function costs before the first ray: proportional to the number of macro cells.";
    figure("Making proximity clouds anew", &plot.html(), reading)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_way_has_a_row_and_every_scene_a_line() {
        let ways = |kind, cpu_ms| Ways { kind, leaps: 1200, walked: 0.25, cpu_ms };
        let scene = |name: &str| Measured {
            scene: name.into(),
            rebuilding: vec![(1 << 18, 1.5), (1 << 20, 6.0)],
            blocks: (64, 8, 0.1),
            ways: vec![ways("none", 9.0), ways("blocks, nearest ahead", 2.5)],
        };
        let html = section(&[scene("vessels"), scene("<carp>")]);
        assert_eq!(html.matches("<tr>").count(), 5, "a heading and two rows for each scene");
        assert_eq!(html.matches("25 %").count(), 4);
        assert!(html.contains("&lt;carp&gt;") && html.contains("goal for 16.8 million") && !html.contains("<carp>"));
        assert!(!section(&[]).contains("<table"));
    }
}
