//! Progress of long commands: a bar with bytes, rate and time left, or JSON lines for programs.

use std::io::Write;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use supervol::OnProgress;
use supervol_format::cast::whole;
use supervol_preprocess::report::Progress;
use supervol_scene::scene::Scene;

use crate::quantity::show_bytes;
use crate::terminal::Format;

/// Least time between two JSON lines.
const JSON_INTERVAL: Duration = Duration::from_millis(200);

/// Files of a scene from this size on are announced, because reading them takes long.
const LARGE_FILE_BYTES: u64 = 8 << 20;

/// Interval between two updates of a bar over rays.
const BAR_INTERVAL: Duration = Duration::from_millis(100);

/// Output of progress.
#[derive(Debug)]
pub enum Reporter {
    /// A bar on standard error; hidden if standard error is no terminal.
    Bar(ProgressBar),
    /// JSON lines on standard output.
    Json(Mutex<Option<Instant>>),
}

impl Reporter {
    /// A bar over bytes as text, or JSON lines.
    pub fn over_bytes(format: Format) -> Self {
        match format {
            Format::Text => Self::Bar(bar("{msg} {wide_bar} {bytes}/{total_bytes} {bytes_per_sec} {eta} left")),
            Format::Json => Self::Json(Mutex::new(None)),
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

    /// A bar over the pictures of an animation.
    pub fn over_pictures() -> ProgressBar {
        bar("{wide_bar} {pos}/{len} pictures {eta} left")
    }

    /// A bar over the pixels of `--check`.
    pub fn over_rays() -> ProgressBar {
        bar("check {wide_bar} {pos}/{len} pixels {eta} left")
    }

    /// Shows the progress of a build.
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
                    // A closed output does not stop the build.
                    let _ = writeln!(crate::terminal::stdout(), "{}", serde_json::json!({ "progress": progress }));
                }
            }
        }
    }

    /// Removes the bar from the screen.
    pub fn finish(&self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}

/// A bar over the rays of a picture, updated while they are cast. Dropping it removes the bar.
#[derive(Debug)]
pub struct RayBar {
    bar: ProgressBar,
    /// Finished rays: counted by packets (`finished`), and estimated from finished rows (`of_rows`). The bar shows
    /// the greater number.
    finished: Arc<AtomicU64>,
    of_rows: Arc<AtomicU64>,
    rays: u64,
    /// Thread that updates the bar; dropping the sender ends it.
    mover: Option<(mpsc::SyncSender<()>, JoinHandle<()>)>,
}

impl RayBar {
    /// A bar over the rays of this scene.
    pub fn over(scene: &Scene) -> Self {
        let rays_per_pixel = u64::from(scene.samples_per_pixel.unwrap_or(1));
        let rays = u64::from(scene.image.width) * u64::from(scene.image.height) * rays_per_pixel;
        let bar = bar("{wide_bar} {percent} % of the rays, {msg} {eta} left");
        bar.set_length(rays);
        let (finished, of_rows) = (Arc::default(), Arc::default());
        let mut this = Self { bar, finished, of_rows, rays, mover: None };
        if !this.bar.is_hidden() {
            this.mover = this.start_mover();
        }
        this
    }

    /// Without a thread the bar is not updated; the picture is drawn all the same.
    fn start_mover(&self) -> Option<(mpsc::SyncSender<()>, JoinHandle<()>)> {
        let (end, ended) = mpsc::sync_channel(1);
        let (bar, counts) = (self.bar.clone(), [self.finished.clone(), self.of_rows.clone()]);
        let moves = move || {
            while ended.recv_timeout(BAR_INTERVAL) == Err(RecvTimeoutError::Timeout) {
                let most = counts.iter().map(|count| count.load(Ordering::Relaxed)).max();
                bar.set_position(most.unwrap_or(0));
            }
        };
        let thread = std::thread::Builder::new().spawn(moves).ok()?;
        Some((end, thread))
    }

    /// For [`Options::rays_finished`](supervol::Options).
    pub fn finished(&self) -> Arc<AtomicU64> {
        self.finished.clone()
    }

    /// For [`Options::progress`](supervol::Options).
    pub fn on_progress(&self) -> OnProgress {
        let (bar, of_rows, rays) = (self.bar.clone(), self.of_rows.clone(), self.rays);
        Arc::new(move |progress| {
            let share = f64::from(progress.rows_finished) / f64::from(progress.rows.max(1));
            of_rows.store(whole::<u64>(share * rays as f64), Ordering::Relaxed);
            bar.set_message(format!("{} read,", show_bytes(progress.bytes_read)));
        })
    }
}

impl Drop for RayBar {
    fn drop(&mut self) {
        if let Some((end, thread)) = self.mover.take() {
            drop(end);
            // The thread only updates the bar, so its panic has no further effect.
            let _ = thread.join();
        }
        self.bar.finish_and_clear();
    }
}

/// Announces large files of a scene before they are read.
pub fn announce_files(scene: &Scene) {
    for file in scene.files() {
        // Unreadable files are reported by their reader.
        let bytes = std::fs::metadata(file).map_or(0, |metadata| metadata.len());
        if bytes >= LARGE_FILE_BYTES {
            announce(&format!("reading {} ({})", file.display(), show_bytes(bytes)));
        }
    }
}

/// Prints one line of progress on standard error, unless `--quiet` is set.
pub fn announce(line: &str) {
    if crate::terminal::is_quiet() {
        return;
    }
    // Errors are ignored: nobody reads this output.
    let _ = writeln!(crate::terminal::stderr(), "{line}");
}

fn bar(template: &str) -> ProgressBar {
    let quiet = crate::terminal::is_quiet();
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(None, target);
    bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}
