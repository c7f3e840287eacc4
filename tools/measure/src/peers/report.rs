//! The comparison as a Markdown table and as JSON.

use std::fmt::Write;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use super::results::{Comparison, Levels, PeerReport, Row};
use crate::context::ChartError;

/// Seconds per day.
const DAY_SECONDS: u64 = 86_400;

/// Writes `peers.json`, `peers.md` and the timed pictures into a folder. Creates the folder if needed.
///
/// # Errors
/// If a file cannot be written.
pub fn write(comparison: &Comparison, command: &str, folder: &Path) -> Result<(), ChartError> {
    let cannot = |path: &Path, source| ChartError::Write { path: path.into(), source };
    std::fs::create_dir_all(folder).map_err(|e| cannot(folder, e))?;
    let mut value =
        serde_json::to_value(comparison).map_err(|e| ChartError::Broken(format!("numbers without JSON: {e}")))?;
    value["command"] = command.into();
    for (name, text) in [("peers.json", format!("{value:#}\n")), ("peers.md", markdown(comparison, command))] {
        let path = folder.join(name);
        std::fs::write(&path, text).map_err(|e| cannot(&path, e))?;
    }
    for (name, picture) in &comparison.pictures {
        let path = folder.join(name);
        picture.write(&path, [0.0; 3]).map_err(|e| cannot(&path, std::io::Error::other(e.to_string())))?;
    }
    Ok(())
}

/// A Markdown page: configuration, table, explanation of the table.
#[must_use]
pub fn markdown(comparison: &Comparison, command: &str) -> String {
    let [width, height] = comparison.image_size;
    let threads = match comparison.threads {
        1 => "one thread".into(),
        n => format!("{n} threads"),
    };
    let mut page = format!("# Supervol and its peers, {}\n\n    {command}\n\n", comparison.date);
    for line in [
        format!("Machine: {}; {threads} for either program.", comparison.machine),
        format!("Programs: Supervol {}{}.", comparison.supervol, comparison.peer.as_ref().map_or(String::new(), peer)),
        format!(
            "Cost: processor time of one {width} x {height} picture, all threads, median (fastest to slowest, number) of \
             those after the first."
        ),
        "Errors: grey levels of any channel, not rounded, from the float64 reference integrator, at so many random pixels \
         whose rays meet the volume."
            .into(),
        "Ratio: the row's processor time over that of Supervol's default; above 1, Supervol takes less.".into(),
    ] {
        let _ = writeln!(page, "- {line}");
    }
    if comparison.rows.iter().any(|row| row.ratio_to_same_sampling.is_some()) {
        page.push_str("- Same sampling: the same over Supervol's when it samples as the row does.\n");
    }
    let capped: u64 = comparison.rows.iter().map(|row| row.reference_capped_pieces).sum();
    if capped > 0 {
        let _ = writeln!(page, "- The reference gave up on {capped} intervals: some errors may be its own.");
    }
    page.push('\n');
    page.push_str(&table(&comparison.rows));
    page
}

fn peer(report: &PeerReport) -> String {
    let versions = report
        .versions
        .as_ref()
        .map(|v| format!("; {} {} (Python {}, NumPy {}, {})", report.name, v.vtk, v.python, v.numpy, v.window));
    let why_not = report.why_not.as_ref().map(|why| format!("; {} not measured: {why}", report.name));
    versions.unwrap_or_default() + &why_not.unwrap_or_default()
}

/// The rows as a Markdown table, also readable as plain text.
#[must_use]
pub fn table(rows: &[Row]) -> String {
    let head = [
        "scene",
        "shading",
        "program",
        "sampling",
        "voxels",
        "CPU ms",
        "wall ms",
        "first CPU ms",
        "CPU / default",
        "CPU / same sampling",
        "L-inf",
        "99.9 %",
        "RMSE",
        "bias",
        "pixels",
        "L-inf from default",
    ];
    let ratio = |value: f64| format!("{value:.2}");
    let line = |row: &Row| {
        let cpu = row.cost.cpu;
        let error = |show: fn(&Levels) -> String| row.from_reference.as_ref().map_or("-".into(), show);
        [
            row.scene.clone(),
            row.shading.into(),
            row.program.into(),
            row.sampling.clone(),
            row.dims.map(|n| n.to_string()).join(" x "),
            format!("{:.0} ({:.0} to {:.0}, {})", cpu.median_ms, cpu.least_ms, cpu.greatest_ms, row.cost.repeats),
            format!("{:.0}", row.cost.wall.median_ms),
            format!("{:.0}", row.cost.first_cpu_ms),
            ratio(row.ratio_to_default),
            row.ratio_to_same_sampling.map_or("-".into(), ratio),
            error(|e| format!("{:.2}", e.linf)),
            error(|e| format!("{:.2}", e.p999)),
            error(|e| format!("{:.3}", e.rmse)),
            error(|e| format!("{:+.3}", e.bias)),
            row.error_pixels.to_string(),
            format!("{:.2}", row.from_default.linf),
        ]
    };
    markdown_table(&head, &rows.iter().map(line).collect::<Vec<_>>())
}

/// A Markdown table with columns as wide as their widest cell.
#[must_use]
pub fn markdown_table<const N: usize>(head: &[&str; N], lines: &[[String; N]]) -> String {
    let cells: Vec<_> = [head.map(String::from)].into_iter().chain(lines.iter().cloned()).collect();
    let width = |column: usize| cells.iter().map(|line| line[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..N).map(width).collect();
    let mut text = String::new();
    for (i, line) in cells.iter().enumerate() {
        for (cell, width) in line.iter().zip(&widths) {
            let _ = write!(text, "| {cell:width$} ");
        }
        text.push_str("|\n");
        if i == 0 {
            for width in &widths {
                let _ = write!(text, "|{:-<1$}", "", width + 2);
            }
            text.push_str("|\n");
        }
    }
    text
}

/// Today's date, UTC, year-month-day.
#[must_use]
pub fn today() -> String {
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs());
    date_of(seconds / DAY_SECONDS)
}

/// Gregorian date of a number of days after 1970-01-01. Counts eras of 400 years from March, so that leap days come
/// last (Hinnant 2013, "chrono-compatible low-level date algorithms").
fn date_of(days: u64) -> String {
    let days = days + 719_468;
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}")
}

/// Processor, number of logical cores, operating system.
#[must_use]
pub fn machine() -> String {
    let known = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let named = known.lines().find(|line| line.starts_with("model name")).and_then(|line| line.split_once(':'));
    let processor = named.map_or("unknown processor", |(_, name)| name.trim());
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    format!("{processor}, {cores} logical cores, {} {}", std::env::consts::OS, std::env::consts::ARCH)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_become_dates() {
        let known = [
            (0, "1970-01-01"),
            (59, "1970-03-01"),
            (11_016, "2000-02-29"),
            (20_777, "2026-11-20"),
            (47_541, "2100-03-01"),
        ];
        for (days, date) in known {
            assert_eq!(date_of(days), date);
        }
    }

    #[test]
    fn a_table_has_lines_of_one_width() {
        let text = table(&[]);
        let widths: Vec<usize> = text.lines().map(str::len).collect();
        assert_eq!(widths.len(), 2);
        assert_eq!(widths[0], widths[1]);
    }
}
