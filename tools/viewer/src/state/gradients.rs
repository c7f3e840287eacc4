//! Lengths of the gradient of the open volume. A thread of its own counts them once, when opacity by the gradient is first used.
//!
//! The thread needs the memory of one brick and of a table of bounded size. It stops when another volume is opened.

use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use eframe::egui;
use supervol::Canceller;
use supervol_preprocess::gradients::Gradients;
use supervol_scene::scene::{Mode, Scene};

use crate::background_task::BackgroundTask;
use crate::worker::{Message, OpenVolume};

/// Number of bars of the histogram.
const BARS: usize = 128;
/// Least time between two reports of progress.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(100);

/// Result of a count: `None` if it was cancelled, or the failure in words.
type Counted = Result<Option<Gradients>, String>;

/// State of the controls of opacity by the gradient that is not part of the scene.
#[derive(Default)]
pub(crate) struct GradientState {
    count: Option<Count>,
    /// Whether the user has switched it on, and the ramp follows once the lengths are counted.
    is_awaited: bool,
    /// Number of the volume, and the ramp that it had when the user switched it off.
    left: Option<(u64, [f64; 2])>,
}

/// Histogram of the lengths of the gradient.
#[derive(Debug, Clone, PartialEq)]
pub struct GradientHistogram {
    /// Number of voxels in equal parts of the lengths from 0 to `end`.
    pub counts: Vec<u64>,
    /// Greatest length shown.
    pub end: f64,
}

/// State of the count.
pub(crate) enum CountState {
    /// Share of finished bricks.
    Counting(f32),
    Done,
    Failed,
}

/// The count of one volume.
struct Count {
    /// Number of the volume.
    volume: u64,
    canceller: Canceller,
    /// Finished bricks, and all bricks.
    progress: Arc<[AtomicU64; 2]>,
    task: BackgroundTask<Counted>,
    found: Option<Counted>,
}

impl Drop for Count {
    fn drop(&mut self) {
        self.canceller.cancel();
    }
}

impl Count {
    fn start(ctx: &egui::Context, opened: &OpenVolume) -> Self {
        let (canceller, progress) = (Canceller::default(), Arc::<[AtomicU64; 2]>::default());
        let (stop, told, waker) = (canceller.clone(), progress.clone(), ctx.clone());
        let (container, source) = (opened.container().clone(), opened.source.clone());
        let task = BackgroundTask::start(ctx, move || {
            let last = Cell::new(Instant::now());
            let tell = |done: u64, total: u64| {
                told[0].store(done, Ordering::Relaxed);
                told[1].store(total, Ordering::Relaxed);
                if last.get().elapsed() >= PROGRESS_INTERVAL {
                    last.set(Instant::now());
                    waker.request_repaint();
                }
            };
            Gradients::unless_cancelled(&container, &stop, &tell).map_err(|error| {
                let path = source.display();
                format!(
                    "{path}: cannot count the lengths of the gradient, because a brick cannot be read: {error}. `supervol verify` \
                     says what is wrong with the container"
                )
            })
        });
        Self { volume: opened.number, canceller, progress, task, found: None }
    }
}

impl GradientState {
    /// Whether opacity by the gradient is on, or will be once the lengths are counted.
    pub(crate) fn is_on(&self, scene: &Scene) -> bool {
        scene.gradient_opacity.is_some() || self.is_awaited
    }

    /// Whether a count is running.
    pub(crate) fn is_counting(&self) -> bool {
        self.count.as_ref().is_some_and(|count| count.found.is_none())
    }

    /// Switches it on, with the ramp that it had, or with the usual one once the lengths are counted.
    pub(crate) fn switch_on(&mut self, ctx: &egui::Context, opened: &OpenVolume, scene: &mut Scene) {
        if let Some((_, ramp)) = self.left.filter(|(volume, _)| *volume == opened.number) {
            scene.gradient_opacity = Some(ramp);
            return;
        }
        // A count that has failed is tried again.
        self.count = self.count.take().filter(|count| !matches!(count.found, Some(Err(_))));
        self.is_awaited = true;
        self.begin(ctx, opened);
    }

    /// Switches it off.
    pub(crate) fn switch_off(&mut self, opened: &OpenVolume, scene: &mut Scene) {
        self.is_awaited = false;
        self.left = scene.gradient_opacity.take().map(|ramp| (opened.number, ramp)).or(self.left);
    }

    /// Starts the count of a volume, unless it has been started.
    pub(crate) fn begin(&mut self, ctx: &egui::Context, opened: &OpenVolume) {
        if self.count.as_ref().is_none_or(|count| count.volume != opened.number) {
            self.count = Some(Count::start(ctx, opened));
        }
    }

    /// Receives the result of the count, and sets the awaited ramp. Returns a failure to report.
    pub(crate) fn receive(&mut self, opened: Option<&OpenVolume>, scene: &mut Scene) -> Option<Message> {
        self.count = self.count.take().filter(|count| opened.is_some_and(|opened| opened.number == count.volume));
        self.is_awaited &= self.count.is_some() && scene.mode == Some(Mode::Dvr);
        let count = self.count.as_mut()?;
        let is_new = count.found.is_none();
        if is_new {
            count.found = count.task.take();
        }
        let found = count.found.as_ref()?;
        let is_awaited = std::mem::take(&mut self.is_awaited);
        match found {
            Ok(None) => None,
            Ok(Some(gradients)) if is_awaited => {
                scene.gradient_opacity = gradients.usual_ramp();
                let why = "This volume has no gradients: all voxels have the same value. Opacity by the gradient would hide it";
                scene.gradient_opacity.is_none().then(|| Message::Failure(why.into()))
            }
            Ok(Some(_)) => None,
            Err(why) => is_new.then(|| Message::Failure(why.clone())),
        }
    }

    /// State of the count of the open volume.
    pub(crate) fn state(&self) -> CountState {
        match self.count.as_ref().map(|count| (&count.found, &count.progress)) {
            Some((Some(Ok(Some(_))), _)) => CountState::Done,
            Some((Some(_), _)) => CountState::Failed,
            Some((None, progress)) => {
                let [done, total] = [0, 1].map(|i| progress[i].load(Ordering::Relaxed) as f32);
                CountState::Counting(done / total.max(1.0))
            }
            None => CountState::Counting(0.0),
        }
    }

    /// The histogram, once the lengths are counted; at least up to this length.
    pub(crate) fn histogram(&self, least_end: f64) -> Option<GradientHistogram> {
        let Some(Ok(Some(gradients))) = &self.count.as_ref()?.found else { return None };
        let end = gradients.histogram_end().max(least_end);
        Some(GradientHistogram { counts: gradients.counts(BARS, end).0, end })
    }
}
