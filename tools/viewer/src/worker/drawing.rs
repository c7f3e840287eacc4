//! Drawing state of one open volume: its renderer, the current picture, and the sections beside it (`DrawingState`).

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol::{
    Backend, Canceller, DrawingProgress, Error, Options, PlacedVolume, Refining, Renderer, errors_in_colors,
    work_in_colors,
};
use supervol_scene::image::Image;
use supervol_scene::scene::{Mode, ResolvedScene, Scene};

use super::marks::marks;
use super::messages::{
    Busy, Decorations, Frame, Inspect, LookedAhead, OpenVolume, Probe, ProbeAnswer, Settings, SidePanels, View,
    frame_of, picked,
};
use super::sections::{Sections, needed, shares};
use super::shared::{Shared, lock};

/// Least interval between two updates of an unfinished picture on the screen.
const REFINEMENT: Duration = Duration::from_millis(150);
/// Least ratio of the time for drawing to the time for showing what is drawn.
const DRAWING_TO_SHOWING: u32 = 8;
/// Time of one step of looking ahead, which reads bricks for the next picture. A new request interrupts a step; this
/// limit bounds the delay if the interruption is not immediate.
const LOOK_AHEAD_STEP: Duration = Duration::from_millis(40);
/// Most steps of looking ahead after one picture. The limit ends reading from a slow file into a large cache.
const LOOK_AHEAD_LIMIT: u32 = 100;

/// The drawing state of one volume; see the module.
pub(super) struct DrawingState {
    pub(super) opened: Arc<OpenVolume>,
    pub(super) renderer: Renderer,
    /// Renderer of the panels beside the picture, created on first use.
    sections: Option<Sections>,
    view: Option<View>,
    /// Whether the picture of `view` is final, or cannot be drawn.
    is_settled: bool,
    /// Remaining steps of looking ahead.
    look_ahead_steps: u32,
    /// Result of looking ahead so far.
    ahead: LookedAhead,
    began: Instant,
    /// Time that the last update of the picture on the screen took.
    shown_in: Duration,
    decorations: Decorations,
    inspect: Inspect,
}

/// Time for drawing until the next update, if the last one took `shown_in`. Pictures of many rays take long to show.
pub(super) fn next_interval(least: Duration, shown_in: Duration) -> Duration {
    least.max(shown_in * DRAWING_TO_SHOWING)
}

/// Options for pictures of the volume.
pub(super) fn options(shared: &Arc<Shared>, settings: &Settings) -> Options {
    let shared = Arc::downgrade(shared);
    let on_progress = move |progress: DrawingProgress| {
        let Some(shared) = shared.upgrade() else { return };
        let mut messages = lock(&shared.messages);
        // Only exports report progress; pictures on the screen show it themselves.
        if let Some(Busy::Exporting(_, rows)) = &mut messages.busy {
            *rows = [progress.rows_finished, progress.rows];
            drop(messages);
            (shared.wake)();
        }
    };
    let host_memory_bytes = match settings.side_panels {
        SidePanels::Hidden => settings.host_memory_bytes,
        SidePanels::Shown => shares(settings.host_memory_bytes)[0],
    };
    Options {
        backend: settings.backend,
        host_memory_bytes,
        threads: settings.threads,
        max_error: settings.max_error,
        predict_error: true,
        count_work: settings.inspect == Inspect::Work,
        refining: Refining::WholeStages,
        progress: Some(Arc::new(on_progress)),
        ..Options::default()
    }
}

/// Options for sections.
fn options_of_sections(settings: &Settings) -> Options {
    Options {
        backend: Backend::Cpu,
        host_memory_bytes: shares(settings.host_memory_bytes)[1],
        threads: settings.threads,
        max_error: settings.max_error,
        ..Options::default()
    }
}

impl DrawingState {
    /// A new drawing state without a picture. Tells the window about the volume.
    pub(super) fn new(shared: &Arc<Shared>, opened: Arc<OpenVolume>, settings: &Settings) -> Result<Self, String> {
        let renderer = opened.volume.renderer(options(shared, settings)).map_err(|e| e.to_string())?;
        shared.send(|messages| (messages.opened, messages.frame) = (Some(opened.clone()), None));
        let Settings { decorations, inspect, .. } = *settings;
        Ok(Self {
            opened,
            renderer,
            sections: None,
            view: None,
            is_settled: true,
            look_ahead_steps: 0,
            ahead: LookedAhead::default(),
            began: Instant::now(),
            shown_in: Duration::ZERO,
            decorations,
            inspect,
        })
    }

    /// Canceller of the unfinished picture, or of looking ahead; `None` if no work is left.
    pub(super) fn unfinished(&self) -> Option<Canceller> {
        let sections = self.sections.as_ref().and_then(Sections::unfinished);
        sections.or_else(|| (!self.is_settled || self.look_ahead_steps > 0).then(|| self.renderer.canceller()))
    }

    /// Clears a cancellation that came just after the work it was meant for had ended, so that it does not stop the
    /// next work.
    pub(super) fn clear_cancellation(&mut self) {
        if self.view.is_some() && self.renderer.canceller().is_cancelled() {
            // A cancelled step ends at once and clears the cancellation. An error here appears again in the next step.
            let _ = self.renderer.advance(Some(Instant::now()));
        }
        self.sections.iter_mut().for_each(Sections::clear_cancellation);
    }

    /// Applies settings from the next view on. Loaded bricks stay.
    pub(super) fn set(&mut self, shared: &Arc<Shared>, settings: &Settings) {
        self.renderer.set_options(options(shared, settings)).unwrap_or_else(|error| shared.report_failure(error));
        match settings.side_panels {
            SidePanels::Hidden => self.sections = None,
            SidePanels::Shown => self.sections.iter_mut().for_each(|s| s.set(shared, options_of_sections(settings))),
        }
        (self.decorations, self.inspect) = (settings.decorations, settings.inspect);
        (self.is_settled, self.look_ahead_steps) = (true, 0);
    }

    /// Begins a picture, and shows the result after the time for interaction.
    pub(super) fn begin(&mut self, shared: &Arc<Shared>, view: View, settings: &Settings) {
        if view.volume != self.opened.number {
            return;
        }
        self.began = Instant::now();
        self.look_ahead_steps = 0;
        if let Err(error) = self.aim_reading(shared, &view.scene, settings) {
            self.is_settled = true;
            return shared.report_failure(error);
        }
        self.view = Some(view);
        self.is_settled = false;
        self.advance(shared, Duration::from_millis(settings.interaction_ms));
    }

    /// Sets the scene that the renderer draws. Sections are drawn by the CPU, even if pictures are drawn by a GPU.
    pub(super) fn aim(&mut self, shared: &Arc<Shared>, scene: &Scene, settings: &Settings) -> Result<(), Error> {
        self.renderer.set_scene(scene)?;
        let is_slice = self.renderer.resolved().is_some_and(|resolved| resolved.mode == Mode::Slice);
        let wanted = if is_slice { Backend::Cpu } else { settings.backend };
        if self.renderer.options().backend != wanted {
            self.renderer.set_options(options(shared, &Settings { backend: wanted, ..*settings }))?;
        }
        Ok(())
    }

    /// The same. Reading files that the last scene did not use may take long and is reported to the window.
    fn aim_reading(&mut self, shared: &Arc<Shared>, scene: &Scene, settings: &Settings) -> Result<(), Error> {
        let is_known = |file: &Path| self.view.iter().flat_map(|view| view.scene.files()).any(|known| known == file);
        let Some(file) = scene.files().find(|file| !is_known(file)) else { return self.aim(shared, scene, settings) };
        shared.send(|messages| messages.busy = Some(Busy::Reading(file.into())));
        let aimed = self.aim(shared, scene, settings);
        shared.send(|messages| messages.busy = messages.busy.take().filter(|busy| !matches!(busy, Busy::Reading(_))));
        aimed
    }

    /// Begins the section of a panel.
    pub(super) fn begin_section(&mut self, shared: &Shared, panel: usize, view: View, settings: &Settings) {
        if view.volume != self.opened.number || settings.side_panels == SidePanels::Hidden {
            return;
        }
        match needed(&mut self.sections, &self.opened, || options_of_sections(settings)) {
            Ok(sections) => sections.begin(shared, panel, view, settings.interaction_ms),
            Err(error) => shared.report_failure(error),
        }
    }

    /// Determines the value under a pixel of the present picture. The next request interrupts this, and then it is tried
    /// again, unless there is a newer probe.
    pub(super) fn probe(&mut self, shared: &Shared, probe: Probe) {
        if probe.volume != self.opened.number {
            return;
        }
        let found = match (probe.panel, &mut self.sections) {
            (Some(panel), Some(sections)) if sections.shows(panel, probe.picture) => {
                lock(&shared.requests).interrupt = Some(sections.canceller());
                sections.pick(panel, probe.pixel)
            }
            (None, _) if self.view.as_ref().is_some_and(|view| view.number == probe.picture) => {
                lock(&shared.requests).interrupt = Some(self.renderer.canceller());
                picked(self.renderer.pick(probe.pixel))
            }
            _ => return,
        };
        match found {
            Some(found) => shared.send(|messages| messages.probed = Some(ProbeAnswer { probe, found })),
            None => {
                lock(&shared.requests).probe.get_or_insert(probe);
            }
        }
    }

    /// Continues the sections, then the picture; if all have converged, looks ahead.
    pub(super) fn continue_drawing(&mut self, shared: &Shared) {
        if let Some(sections) = self.sections.as_mut().filter(|sections| sections.unfinished().is_some()) {
            sections.continue_drawing(shared);
        } else if self.is_settled {
            self.look_ahead(shared);
        } else {
            self.advance(shared, next_interval(REFINEMENT, self.shown_in));
        }
    }

    /// Reads bricks that the next picture will need, for a short time.
    fn look_ahead(&mut self, shared: &Shared) {
        self.look_ahead_steps = self.look_ahead_steps.saturating_sub(1);
        let until = Instant::now() + LOOK_AHEAD_STEP;
        match self.renderer.look_ahead(Some(until)) {
            Ok(ahead) => {
                self.ahead.page_ins += ahead.page_ins;
                self.ahead.is_complete = ahead.is_complete;
                // An early end means: all bricks are there, there is no room, the camera did not move, or a new request
                // has come.
                if ahead.is_complete || Instant::now() < until {
                    self.look_ahead_steps = 0;
                }
                if ahead.page_ins > 0 || ahead.is_complete {
                    let so_far = self.ahead;
                    shared.send(|messages| messages.ahead = Some(so_far));
                }
            }
            Err(error) => {
                self.look_ahead_steps = 0;
                shared.report_failure(error);
            }
        }
    }

    /// Draws for a limited time, or until the picture has converged or a new request comes.
    fn advance(&mut self, shared: &Shared, time: Duration) {
        match self.renderer.advance(Some(Instant::now() + time)) {
            Ok(step) => {
                self.is_settled = step.is_finished;
                let began = Instant::now();
                self.show(shared, step.is_finished);
                self.shown_in = began.elapsed();
                if let (true, Some(view)) = (step.is_finished, &self.view) {
                    self.look_ahead_steps = LOOK_AHEAD_LIMIT;
                    self.ahead = LookedAhead { number: view.number, ..LookedAhead::default() };
                }
            }
            Err(error) => {
                self.is_settled = true;
                shared.report_failure(error);
            }
        }
    }

    fn show(&self, shared: &Shared, is_converged: bool) {
        let renderer = &self.renderer;
        let (Some(view), Some(scene), Some(image)) = (&self.view, renderer.resolved(), renderer.image()) else {
            return;
        };
        let placed = &self.opened.placed;
        let map = if is_converged { self.map() } else { None };
        let image = map.map_or_else(|| decorated(image, placed, scene, self.decorations), Cow::Owned);
        let stats = renderer.stats();
        let has_marks = stats.bricks_failed > 0 || self.inspect == Inspect::Bricks;
        let marks = if has_marks { marks(renderer, placed, self.inspect) } else { Vec::new() };
        let frame = frame_of(view, (&image, scene.background), (stats, is_converged), self.began);
        let frame = Frame { marks, ..frame };
        shared.send(|messages| messages.frame = Some(frame));
    }

    /// The map that is shown in place of the picture.
    fn map(&self) -> Option<Image> {
        match self.inspect {
            Inspect::Errors => self.renderer.picture()?.error_map().cloned().map(errors_in_colors),
            Inspect::Work => self.renderer.picture()?.work_map().cloned().map(work_in_colors),
            Inspect::Nothing | Inspect::Bricks => None,
        }
    }

    /// Continues the picture of `view` after another picture was drawn. A converged picture stays on the screen.
    pub(super) fn resume(&mut self, shared: &Arc<Shared>, settings: &Settings) {
        let Some(view) = self.view.take() else { return };
        self.aim(shared, &view.scene, settings).unwrap_or_else(|error| shared.report_failure(error));
        self.view = Some(view);
    }
}

/// An image of a volume with decorations, if they are on.
pub(super) fn decorated<'a>(
    image: Cow<'a, Image>,
    volume: &PlacedVolume,
    scene: &ResolvedScene,
    decorations: Decorations,
) -> Cow<'a, Image> {
    if decorations == Decorations::Off {
        return image;
    }
    let mut image = image.into_owned();
    supervol_decorations::decorate(&mut image, volume.container(), volume.facts(), scene, None);
    Cow::Owned(image)
}
