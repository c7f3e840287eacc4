//! Progress of long commands: a bar with bytes, rate and time left for people, a JSON object per line for programs.

use std::io::Write;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use supervol_preprocess::report::Progress;

/// Least time between two JSON lines.
const JSON_INTERVAL: Duration = Duration::from_millis(200);

/// Where progress goes.
pub enum Reporter {
    /// A bar on standard error; nothing where that is no terminal.
    Bar(ProgressBar),
    /// JSON lines on standard output.
    Json(Mutex<Option<Instant>>),
}

impl Reporter {
    /// A bar over bytes, or JSON lines.
    pub fn over_bytes(json: bool) -> Self {
        if json {
            Self::Json(Mutex::new(None))
        } else {
            Self::Bar(bar("{msg} {wide_bar} {bytes}/{total_bytes} {bytes_per_sec} {eta} left"))
        }
    }

    /// A bar over bricks.
    pub fn over_bricks() -> ProgressBar {
        bar("{msg} {wide_bar} {pos}/{len} bricks {per_sec} {eta} left")
    }

    /// A bar over the slices of a volume.
    pub fn over_slices() -> ProgressBar {
        bar("{wide_bar} {pos}/{len} slices {eta} left")
    }

    /// A bar over the rows of a picture.
    pub fn over_rows() -> ProgressBar {
        bar("{wide_bar} {pos}/{len} rows {msg}")
    }

    /// A bar over the pictures of an animation.
    pub fn over_pictures() -> ProgressBar {
        bar("{wide_bar} {pos}/{len} pictures {eta} left")
    }

    /// A bar over rays that are cast again.
    pub fn over_rays() -> ProgressBar {
        bar("check {wide_bar} {pos}/{len} pixels {eta} left")
    }

    /// Shows where a build is.
    pub fn show(&self, progress: Progress) {
        match self {
            Self::Bar(bar) => {
                bar.set_length(progress.bytes_total);
                bar.set_position(progress.bytes_done);
                bar.set_message(format!(
                    "level {}/{}, brick {}/{}",
                    progress.level + 1,
                    progress.levels,
                    progress.bricks_done,
                    progress.bricks_total
                ));
            }
            Self::Json(last) => {
                let mut last = last.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                let done = progress.bricks_done == progress.bricks_total;
                if done || last.is_none_or(|at| at.elapsed() >= JSON_INTERVAL) {
                    *last = Some(Instant::now());
                    // A reader that went away is no reason to stop building.
                    let _ = writeln!(crate::terminal::stdout(), "{}", serde_json::json!({ "progress": progress }));
                }
            }
        }
    }

    /// Takes the bar off the screen.
    pub fn finish(&self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}

/// One line of progress on standard error, unless all is to be quiet.
pub fn announce(line: &str) {
    if crate::terminal::is_quiet() {
        return;
    }
    // Progress that cannot be written is progress that nobody reads.
    let _ = writeln!(crate::terminal::stderr(), "{line}");
}

fn bar(template: &str) -> ProgressBar {
    let quiet = crate::terminal::is_quiet();
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(None, target);
    bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}
