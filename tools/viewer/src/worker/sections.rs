//! Pictures of the panels, each a section of the volume, and probes of their pixels.
//!
//! Sections have a renderer of their own with a part of the memory. So the picture of the volume keeps its progress and
//! its bricks while sections change. Both draw on the worker's thread, one after the other.

use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol::{Canceller, Options, Picked, Renderer};

use super::drawing::next_interval;
use super::messages::{OpenVolume, PANELS, View, frame_of, picked};
use super::shared::Shared;

/// Least time for which an unfinished section is drawn before the next check for requests.
const REFINEMENT: Duration = Duration::from_millis(100);

/// The renderer and the state of all panels; see the module.
pub(super) struct Sections {
    renderer: Renderer,
    panels: [Option<Panel>; PANELS],
    /// Time that the last update of a panel on the screen took.
    shown_in: Duration,
}

/// The section of one panel.
struct Panel {
    view: View,
    /// Whether its picture is final, or cannot be drawn.
    is_settled: bool,
    began: Instant,
}

impl Sections {
    /// No sections yet.
    pub(super) fn new(opened: &OpenVolume, options: Options) -> Result<Self, String> {
        let renderer = opened.volume.renderer(options).map_err(|e| e.to_string())?;
        Ok(Self { renderer, panels: [const { None }; PANELS], shown_in: Duration::ZERO })
    }

    /// Applies options from the next request on.
    pub(super) fn set(&mut self, shared: &Shared, options: Options) {
        self.renderer.set_options(options).unwrap_or_else(|error| shared.report_failure(error));
        self.panels.iter_mut().flatten().for_each(|panel| panel.is_settled = true);
    }

    /// Begins the picture of a panel, and shows the result after the time for interaction.
    pub(super) fn begin(&mut self, shared: &Shared, number: usize, view: View, interaction_ms: u64) {
        self.panels[number] = Some(Panel { view, is_settled: false, began: Instant::now() });
        self.advance(shared, number, Duration::from_millis(interaction_ms));
    }

    /// Continues the first unfinished panel.
    pub(super) fn continue_drawing(&mut self, shared: &Shared) {
        if let Some(number) = self.unsettled() {
            self.advance(shared, number, next_interval(REFINEMENT, self.shown_in));
        }
    }

    fn unsettled(&self) -> Option<usize> {
        self.panels.iter().position(|panel| panel.as_ref().is_some_and(|panel| !panel.is_settled))
    }

    /// Canceller of the unfinished picture; `None` if no work is left.
    pub(super) fn unfinished(&self) -> Option<Canceller> {
        self.unsettled().map(|_| self.renderer.canceller())
    }

    /// Canceller of any current work.
    pub(super) fn canceller(&self) -> Canceller {
        self.renderer.canceller()
    }

    /// As [`super::drawing::DrawingState::clear_cancellation`].
    pub(super) fn clear_cancellation(&mut self) {
        if self.panels.iter().any(Option::is_some) && self.renderer.canceller().is_cancelled() {
            let _ = self.renderer.advance(Some(Instant::now()));
        }
    }

    fn advance(&mut self, shared: &Shared, number: usize, time: Duration) {
        let Some(panel) = &mut self.panels[number] else { return };
        if let Err(error) = self.renderer.set_scene(&panel.view.scene) {
            self.panels[number] = None;
            return shared.report_failure(error);
        }
        match self.renderer.advance(Some(Instant::now() + time)) {
            Ok(step) => {
                panel.is_settled = step.is_finished;
                let began = Instant::now();
                let (Some(image), Some(scene)) = (self.renderer.image(), self.renderer.resolved()) else { return };
                let stats = self.renderer.stats();
                let frame = frame_of(&panel.view, (&image, scene.background), (stats, step.is_finished), panel.began);
                shared.send(|messages| messages.sections[number] = Some(frame));
                self.shown_in = began.elapsed();
            }
            Err(error) => {
                panel.is_settled = true;
                shared.report_failure(error);
            }
        }
    }

    /// Whether the present section of a panel is the one of this request.
    pub(super) fn shows(&self, number: usize, request: u64) -> bool {
        self.panels[number].as_ref().is_some_and(|panel| panel.view.number == request)
    }

    /// The point under a pixel of a panel; `None` if it was interrupted, or if the panel shows nothing.
    pub(super) fn pick(&mut self, number: usize, pixel: [u32; 2]) -> Option<Result<Option<Picked>, String>> {
        let panel = self.panels[number].as_ref()?;
        let set = self.renderer.set_scene(&panel.view.scene);
        picked(set.and_then(|()| self.renderer.pick(pixel)))
    }
}

/// Division of the memory budget in bytes: for the picture of the volume, for the panels.
pub(super) fn shares(host_memory_bytes: u64) -> [u64; 2] {
    /// The panels get one of this number of equal parts.
    const PARTS: u64 = 4;
    let of_panels = host_memory_bytes / PARTS;
    [host_memory_bytes - of_panels, of_panels]
}

/// The renderer of the panels, created on first use.
pub(super) fn needed<'a>(
    sections: &'a mut Option<Sections>,
    opened: &Arc<OpenVolume>,
    options: impl FnOnce() -> Options,
) -> Result<&'a mut Sections, String> {
    match sections {
        Some(sections) => Ok(sections),
        None => Ok(sections.insert(Sections::new(opened, options())?)),
    }
}
