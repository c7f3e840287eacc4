//! Records of measurements, kept by machine and date: `benches/record/<machine>/<date>.csv`.
//!
//! Each line is one measurement and the command that made it. The first six columns are the same as in the records of
//! single-part benches. A missing number is an empty field. Lines are only appended, and only to files with these
//! columns.

use std::fmt::Write as _;
use std::fs::{File, OpenOptions};
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use supervol_files::{OutputFile, check_distinct};
use supervol_format::cast::{narrow, whole};
use supervol_preprocess::Existing;

use crate::context::ChartError;
use crate::paths::Ride;
use crate::peers::results::{Comparison, Levels};
use crate::peers::{environment, report};
use crate::report::machine;

/// The columns of a record. `fastest`, `slowest` and `p95` (95th percentile of a path's frames) have the median's unit.
/// Errors are in grey levels of 255.
pub const COLUMNS: [&str; 15] = [
    "command",
    "case",
    "median",
    "unit",
    "fastest",
    "slowest",
    "p95",
    "program",
    "threads",
    "repeats",
    "version",
    "machine",
    "linf_levels",
    "p999_levels",
    "rmse_levels",
];
/// Significant digits of a number.
const DIGITS: i32 = 4;
/// Time limit for git.
const GIT_LIMIT: Duration = Duration::from_secs(10);
/// Folder of the records in the repository of this project.
const RECORD_FOLDER: &str = "benches/record";

/// One measurement.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// The measured case: volume, size, look.
    pub case: String,
    /// The program and its sampling method.
    pub program: String,
    /// Unit of the four numbers below.
    pub unit: &'static str,
    /// Median.
    pub median: f64,
    /// Least value.
    pub fastest: f64,
    /// Greatest value.
    pub slowest: f64,
    /// 95th percentile.
    pub p95: Option<f64>,
    /// Threads of the program.
    pub threads: usize,
    /// Number of measurements behind the median.
    pub repeats: usize,
    /// Distance from the reference; `None` where it was not measured.
    pub errors: Option<Levels>,
}

/// Entries of a comparison: processor time of each row.
#[must_use]
pub fn of_comparison(comparison: &Comparison) -> Vec<Entry> {
    let [width, height] = comparison.image_size;
    let entry = |row: &crate::peers::results::Row| Entry {
        case: case(&row.scene, row.dims, row.shading, [width, height]),
        program: format!("{}, {}", row.program, row.sampling),
        unit: "CPU-ms",
        median: row.cost.cpu.median_ms,
        fastest: row.cost.cpu.least_ms,
        slowest: row.cost.cpu.greatest_ms,
        p95: None,
        threads: comparison.threads,
        repeats: row.cost.repeats,
        errors: row.from_reference,
    };
    comparison.rows.iter().map(entry).collect()
}

/// Entries of rides along a path: wall time, processor time and bricks read of each frame.
#[must_use]
pub fn of_rides(path: &str, rides: &[Ride], threads: usize, image: [u32; 2]) -> Vec<Entry> {
    let entries = |ride: &Ride| {
        [
            ("ms", ride.summary(|f| f.ms)),
            ("CPU-ms", ride.summary(|f| f.cpu_ms)),
            ("bricks read", ride.summary(|f| f.page_ins as f64)),
            ("RMS error, grey levels", ride.summary(|f| f.rmse)),
        ]
        .map(|(unit, summary)| Entry {
            case: format!("path {path}, {}", case(&ride.scene, ride.dims, ride.shading, image)),
            program: if ride.backend == "gpu" { "Supervol, GPU" } else { "Supervol, default" }.into(),
            unit,
            median: summary.spread.median_ms,
            fastest: summary.spread.least_ms,
            slowest: summary.spread.greatest_ms,
            p95: Some(summary.p95),
            threads,
            repeats: ride.frames.len(),
            errors: None,
        })
    };
    rides.iter().flat_map(entries).collect()
}

fn case(scene: &str, [nx, ny, nz]: [u64; 3], shading: &str, [width, height]: [u32; 2]) -> String {
    format!("{scene} {nx}x{ny}x{nz} {shading} at {width}x{height}")
}

/// An open record; lines are appended to it.
#[derive(Debug, Clone)]
pub struct Ledger {
    /// Path of the file.
    pub file: PathBuf,
    version: String,
    machine: String,
}

impl Ledger {
    /// Opens `record` itself if its name ends in `.csv`, otherwise `record/<machine>/<date>.csv`. Missing folders and
    /// the column line are created. Open the record before measuring: it takes the version at this moment, and a record
    /// that cannot be written is found early.
    ///
    /// # Errors
    /// If the file cannot be written, is one of `inputs`, is not a regular file, or has other columns.
    pub fn open(record: &Path, inputs: &[&Path]) -> Result<Self, ChartError> {
        let machine = machine::short_name();
        let file = if record.extension().is_some_and(|e| e == "csv") {
            record.to_path_buf()
        } else {
            record.join(&machine).join(format!("{}.csv", report::today()))
        };
        let cannot = |source| ChartError::Write { path: file.clone(), source };
        let folder = file.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder).map_err(cannot)?;
        let header = COLUMNS.join(",");
        check_distinct(&file, inputs.iter().copied())?;
        if file.exists() && !file.is_file() {
            return Err(ChartError::Command(format!("cannot append to {}: it is no file", file.display())));
        }
        match first_line(&file).map_err(cannot)?.as_deref() {
            None | Some("") => {
                // Like every output: complete or not at all, and never through a dangling link.
                let begun = OutputFile::begin(&file, Existing::Replace)?;
                begun.file().write_all((header + "\n").as_bytes()).map_err(cannot)?;
                begun.publish()?;
            }
            Some(found) if found == header => {}
            Some(found) => {
                let message = format!("{}: expected a record with the columns {header}, found {found}", file.display());
                return Err(ChartError::Command(message));
            }
        }
        let version = version(folder);
        Ok(Self { file, version, machine })
    }

    /// Appends the entries that one command measured.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn append(&self, command: &str, entries: &[Entry]) -> Result<(), ChartError> {
        let lines: String = entries.iter().map(|entry| line(entry, command, &self.version, &self.machine)).collect();
        let cannot = |source| ChartError::Write { path: self.file.clone(), source };
        let mut out = OpenOptions::new().append(true).open(&self.file).map_err(cannot)?;
        // One write call, so that lines of two processes do not mix.
        out.write_all(lines.as_bytes()).and_then(|()| out.sync_all()).map_err(cannot)
    }
}

/// First line of a file without its line end, cut at the length of a column line; `None` if the file does not exist.
fn first_line(file: &Path) -> std::io::Result<Option<String>> {
    let file = match File::open(file) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        other => other?,
    };
    let mut head = Vec::new();
    file.take(COLUMNS.join(",").len() as u64 + 1).read_to_end(&mut head)?;
    Ok(Some(String::from_utf8_lossy(&head).lines().next().unwrap_or_default().into()))
}

fn line(entry: &Entry, command: &str, version: &str, machine: &str) -> String {
    let number = |value: Option<f64>| value.map_or(String::new(), significant);
    let fields = [
        command.into(),
        entry.case.clone(),
        significant(entry.median),
        entry.unit.into(),
        significant(entry.fastest),
        significant(entry.slowest),
        number(entry.p95),
        entry.program.clone(),
        entry.threads.to_string(),
        entry.repeats.to_string(),
        version.into(),
        machine.into(),
        number(entry.errors.map(|e| e.linf)),
        number(entry.errors.map(|e| e.p999)),
        number(entry.errors.map(|e| e.rmse)),
    ];
    fields.map(|field| quoted(&field)).join(",") + "\n"
}

/// A CSV field (RFC 4180): quoted if it contains a comma, a quotation mark or a line break.
fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) { format!("\"{}\"", field.replace('"', "\"\"")) } else { field.into() }
}

/// A number with four significant digits, without an exponent.
fn significant(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let decimals = narrow::<usize>((DIGITS - 1 - whole::<i32>(value.abs().log10().floor())).max(0));
    let mut text = String::new();
    let _ = write!(text, "{value:.decimals$}");
    let is_fraction = text.contains('.');
    if is_fraction { text.trim_end_matches('0').trim_end_matches('.').into() } else { text }
}

/// Version of the program. For records in this project's record folder, also the commit of the repository: the
/// program's commit, if the program was built from it.
fn version(folder: &Path) -> String {
    let version = env!("CARGO_PKG_VERSION").to_string();
    let folder = folder.to_string_lossy();
    let git = |arguments: &[&str]| {
        let all = [&["-C", folder.as_ref()], arguments].concat();
        environment::run(Path::new("git"), &all, GIT_LIMIT).ok().map(|answer| answer.trim().to_string())
    };
    let is_ours = git(&["rev-parse", "--show-prefix"]).is_some_and(|prefix| prefix.starts_with(RECORD_FOLDER));
    let Some(commit) = git(&["rev-parse", "--short=10", "HEAD"]).filter(|_| is_ours) else { return version };
    // Recording changes the record files themselves. Only changes of other files mark the version as modified.
    let others = format!(":(top,exclude){RECORD_FOLDER}");
    let changed = git(&["status", "--porcelain", "--untracked-files=no", "--", ":(top)", &others]);
    let suffix = if changed.is_none_or(|files| files.is_empty()) { "" } else { "-changed" };
    format!("{version}-{commit}{suffix}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry() -> Entry {
        Entry {
            case: "vessels 48x48x48 shaded at 160x120".into(),
            program: "Supervol, default (cell by cell)".into(),
            unit: "CPU-ms",
            median: 12.3456,
            fastest: 11.0,
            slowest: 12345.6,
            p95: None,
            threads: 1,
            repeats: 3,
            errors: Some(Levels { linf: 0.25, p999: 0.12, rmse: 0.000_123_456, bias: 0.0 }),
        }
    }

    #[test]
    fn lines_are_appended_under_one_header() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let ledger = Ledger::open(folder.path(), &[]).expect("room");
        ledger.append("supervol bench --dims 1,2,3", &[entry()]).expect("room");
        let file = ledger.file;
        assert_eq!(file.parent().and_then(Path::parent), Some(folder.path()));
        let again = Ledger::open(&file, &[]).expect("its own columns");
        again.append("again", &[entry(), entry()]).expect("room");
        assert_eq!(again.file, file);
        let text = std::fs::read_to_string(&file).expect("it was written");
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!((lines.len(), lines[0]), (4, COLUMNS.join(",").as_str()));
        let expected = "\"supervol bench --dims 1,2,3\",vessels 48x48x48 shaded at 160x120,12.35,CPU-ms,11,12346,,\
                        \"Supervol, default (cell by cell)\",1,3,";
        assert!(lines[1].starts_with(expected), "{}", lines[1]);
        assert!(lines[1].ends_with(",0.25,0.12,0.0001235"), "{}", lines[1]);
    }

    #[test]
    fn a_file_with_other_columns_is_left_alone() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("other.csv");
        std::fs::write(&file, "a,b\n1,2\n").expect("room");
        let error = Ledger::open(&file, &[]).expect_err("other columns").to_string();
        assert!(error.contains("found a,b"), "{error}");
        assert_eq!(std::fs::read_to_string(&file).expect("it is there"), "a,b\n1,2\n");
    }

    #[test]
    fn records_of_the_project_have_these_columns() {
        let record = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(RECORD_FOLDER);
        let mut files = 0;
        for machine in std::fs::read_dir(record).expect("the project has records") {
            for file in std::fs::read_dir(machine.expect("an entry").path()).expect("a folder for each machine") {
                let path = file.expect("an entry").path();
                // The same folder holds text files with the history of measurements.
                if path.extension().is_none_or(|ending| ending != "csv") {
                    continue;
                }
                let text = std::fs::read_to_string(&path).expect("a text");
                assert_eq!(text.lines().next(), Some(COLUMNS.join(",").as_str()), "{}", path.display());
                files += 1;
            }
        }
        assert!(files > 0);
    }

    #[test]
    fn numbers_have_four_digits() {
        for (value, text) in [(533.44, "533.4"), (1117.3, "1117"), (0.0, "0"), (62.0, "62"), (0.05, "0.05")] {
            assert_eq!(significant(value), text);
        }
    }
}
