//! Reading cost by requested error: a table, and a figure that summaries leave out.

use super::html::{bytes, escape, figure, number, paragraph, table};
use super::plots::{Plot, Series};
use super::{Extent, palette};
use crate::measure::GREY_LEVELS;
use crate::reading::{HOST_MEMORY_BYTES, Read};

/// The section of the report.
pub(super) fn section(reads: &[Read], extent: Extent) -> String {
    if reads.is_empty() {
        return paragraph("Reading was not measured in this run.");
    }
    let row = |read: &Read| {
        let [x, y, z] = read.dims;
        vec![
            escape(&read.scene),
            format!("{x} × {y} × {z}"),
            asked_for(read.max_error),
            number(read.bricks as f64),
            bytes(read.bytes),
            number(read.first_ms),
            number(read.cpu_ms),
            number(read.later_bricks as f64),
            number(read.last_ms),
        ]
    };
    let headings = [
        "volume",
        "voxels",
        "error asked for",
        "bricks",
        "read",
        "ms",
        "CPU ms",
        "bricks, frame after it",
        "ms, frame after it",
    ];
    let about = paragraph(&format!(
        "A frame is drawn until it has converged, from an empty cache and with {} of memory; then the camera moves on by six degrees. How \
         fine bricks have to be follows from the error that is asked for (--max-error) and from what coarser levels are off by, as the \
         container says; voxels finer than pixels are not read for any error. The larger volume is computed when it is read.",
        bytes(HOST_MEMORY_BYTES).replace(".0 ", " ")
    ));
    let figure = if extent == Extent::Whole { bricks_against_error(reads) } else { String::new() };
    about + &figure + &table(&headings, &reads.iter().map(row).collect::<Vec<_>>())
}

/// A requested error in grey levels; the largest one means that only voxel size matters.
fn asked_for(max_error: f64) -> String {
    if max_error < GREY_LEVELS { format!("{}/255", number(max_error)) } else { "none".into() }
}

fn bricks_against_error(reads: &[Read]) -> String {
    let of_scene = |(i, reads): (usize, &[Read])| Series {
        name: reads[0].scene.clone(),
        look: palette::look(&reads[0].scene, i),
        points: reads.iter().map(|read| (read.max_error, read.bricks as f64)).collect(),
    };
    let series = reads.chunk_by(|a, b| a.scene == b.scene).enumerate().map(of_scene).collect();
    let plot = Plot::of_lines(["error asked for, grey levels of 255", "bricks read"], series);
    figure(
        "Bricks of a frame against the error asked for",
        &plot.html(),
        "Further down less is read; a level line is a volume whose bricks no error in this range makes finer or coarser.",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_error_has_a_row_and_every_volume_a_line() {
        let read = |scene: &str, max_error| Read {
            scene: scene.into(),
            dims: [40, 30, 20],
            max_error,
            first_ms: 12.0,
            last_ms: 3.0,
            cpu_ms: 20.0,
            bricks: 77,
            later_bricks: 4,
            bytes: 5 << 20,
        };
        let reads = [read("<waves>", 255.0), read("<waves>", 4.0), read("seismic", 4.0)];
        let html = section(&reads, Extent::Whole);
        assert_eq!((html.matches("<tr>").count(), html.matches("<figure>").count()), (1 + 3, 1), "{html}");
        assert!(!section(&reads, Extent::Summary).contains("<figure>"));
        for part in ["&lt;waves&gt;", "40 × 30 × 20", "none", "4/255", "5.0 MiB", "1024 MiB of memory"] {
            assert!(html.contains(part), "no {part}: {html}");
        }
        assert!(!html.contains("<waves>") && !section(&[], Extent::Whole).contains("<table"));
    }
}
