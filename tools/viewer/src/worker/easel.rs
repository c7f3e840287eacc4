//! One open volume with its renderer, and the picture on it.

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_runtime::engines::maps::work_in_colors;
use supervol_runtime::render::frame::stated::in_colors;
use supervol_runtime::render::options::{Backend, Progress, RenderOptions};
use supervol_runtime::render::renderer::Renderer;
use supervol_runtime::render::volume::PlacedVolume;
use supervol_runtime::stop::Canceller;
use supervol_scene::image::Image;
use supervol_scene::scene::{Mode, ResolvedScene, Scene, SceneError};

use super::marks::marks;
use super::sections::{Sections, needed, shares};
use super::{
    Beside, Busy, Decorations, Desk, Frame, Inspect, LookedAhead, Opened, Probe, Probed, Settings, View, frame_of, lock,
};

/// A picture at rest is shown anew after so long, as far as it has come.
const REFINEMENT: Duration = Duration::from_millis(150);
/// One step of looking ahead. A new wish cuts it short; this bounds what comes where that is not heard at once.
const LOOK: Duration = Duration::from_millis(40);
/// Most steps of looking ahead from one picture: with those, reading ends in a file that is slow and a cache that is large.
const LOOK_LIMIT: u32 = 100;

/// See the module.
pub(super) struct Easel {
    pub(super) opened: Arc<Opened>,
    pub(super) renderer: Renderer,
    /// The panels, once there were some.
    sections: Option<Sections>,
    view: Option<View>,
    /// The same, resolved.
    scene: Option<ResolvedScene>,
    /// The view's picture is what it will be, or cannot be drawn.
    is_settled: bool,
    /// Steps of looking ahead that may follow.
    looks_left: u32,
    /// What they have brought.
    ahead: LookedAhead,
    began: Instant,
    decorations: Decorations,
    inspect: Inspect,
}

/// With what pictures of the volume are made.
pub(super) fn options(desk: &Arc<Desk>, settings: &Settings) -> RenderOptions {
    let desk = Arc::downgrade(desk);
    let on_progress = move |progress: Progress| {
        let Some(desk) = desk.upgrade() else { return };
        let mut news = lock(&desk.news);
        // Only exports tell how far they are: pictures on the screen show it.
        if let Some(Busy::Exporting(_, rows)) = &mut news.busy {
            *rows = [progress.rows_finished, progress.rows];
            drop(news);
            (desk.wake)();
        }
    };
    let host_memory_bytes = match settings.beside {
        Beside::Nothing => settings.host_memory_bytes,
        Beside::Panels => shares(settings.host_memory_bytes)[0],
    };
    RenderOptions {
        backend: settings.backend,
        host_memory_bytes,
        threads: settings.threads,
        max_error: settings.max_error,
        predict_error: true,
        count_work: settings.inspect == Inspect::Work,
        progress: Some(Arc::new(on_progress)),
        ..RenderOptions::default()
    }
}

/// The same of sections.
fn options_of_sections(settings: &Settings) -> RenderOptions {
    RenderOptions {
        backend: Backend::Cpu,
        host_memory_bytes: shares(settings.host_memory_bytes)[1],
        threads: settings.threads,
        max_error: settings.max_error,
        ..RenderOptions::default()
    }
}

impl Easel {
    /// An easel without a picture; the window is told of the volume.
    pub(super) fn new(desk: &Arc<Desk>, opened: Arc<Opened>, settings: &Settings) -> Result<Self, String> {
        let volume = PlacedVolume::of(opened.container.clone());
        let renderer = Renderer::new(volume, options(desk, settings)).map_err(|e| e.to_string())?;
        desk.tell(|news| (news.opened, news.frame) = (Some(opened.clone()), None));
        let Settings { decorations, inspect, .. } = *settings;
        Ok(Self {
            opened,
            renderer,
            sections: None,
            view: None,
            scene: None,
            is_settled: true,
            looks_left: 0,
            ahead: LookedAhead::default(),
            began: Instant::now(),
            decorations,
            inspect,
        })
    }

    /// Who can stop the picture in progress or what is read for the next one; none where nothing is left to do.
    pub(super) fn unfinished(&self) -> Option<Canceller> {
        let sections = self.sections.as_ref().and_then(Sections::unfinished);
        sections.or_else(|| (!self.is_settled || self.looks_left > 0).then(|| self.renderer.canceller()))
    }

    /// A wish that came when the work it was to cut short had just ended must not stop what it asks for.
    pub(super) fn forget_cut(&mut self) {
        if self.scene.is_some() && self.renderer.canceller().is_cancelled() {
            // A step that is cancelled ends at once, and takes the word with it; errors show again in the next step.
            let _ = self.renderer.advance(Some(Instant::now()));
        }
        self.sections.iter_mut().for_each(Sections::forget_cut);
    }

    /// From now on pictures are made like this, from the next view on. What is loaded stays.
    pub(super) fn set(&mut self, desk: &Arc<Desk>, settings: &Settings) {
        self.renderer.set_options(options(desk, settings)).unwrap_or_else(|error| desk.fail(error));
        match settings.beside {
            Beside::Nothing => self.sections = None,
            Beside::Panels => self.sections.iter_mut().for_each(|s| s.set(desk, options_of_sections(settings))),
        }
        (self.decorations, self.inspect) = (settings.decorations, settings.inspect);
        (self.is_settled, self.looks_left) = (true, 0);
    }

    /// Begins a picture, and shows what there is of it within the time for interaction.
    pub(super) fn begin(&mut self, desk: &Arc<Desk>, view: View, settings: &Settings) {
        if view.volume != self.opened.number {
            return;
        }
        self.began = Instant::now();
        self.looks_left = 0;
        match self.resolved(desk, &view.scene) {
            Ok(scene) => {
                self.scene = Some(scene.clone());
                self.aim(desk, scene, settings);
            }
            Err(error) => {
                self.is_settled = true;
                desk.fail(error);
                return;
            }
        }
        self.view = Some(view);
        self.is_settled = false;
        self.advance(desk, Duration::from_millis(settings.interaction_ms));
    }

    /// From now on this is drawn: sections by the processor, also where pictures are to be a GPU's.
    pub(super) fn aim(&mut self, desk: &Arc<Desk>, scene: ResolvedScene, settings: &Settings) {
        let wanted = if scene.mode == Mode::Slice { Backend::Cpu } else { settings.backend };
        if self.renderer.options().backend != wanted {
            let options = options(desk, &Settings { backend: wanted, ..*settings });
            self.renderer.set_options(options).unwrap_or_else(|error| desk.fail(error));
        }
        self.renderer.set_scene(scene);
    }

    /// The scene as it is drawn. Files that it names and that the one before did not may take a while to read, and that is told.
    fn resolved(&self, desk: &Desk, scene: &Scene) -> Result<ResolvedScene, SceneError> {
        let is_known = |file: &Path| self.view.iter().flat_map(|view| view.scene.files()).any(|known| known == file);
        let Some(file) = scene.files().find(|file| !is_known(file)) else { return scene.resolve(&self.opened.facts) };
        desk.tell(|news| news.busy = Some(Busy::Reading(file.into())));
        let resolved = scene.resolve(&self.opened.facts);
        desk.tell(|news| news.busy = news.busy.take().filter(|busy| !matches!(busy, Busy::Reading(_))));
        resolved
    }

    /// Begins the section of a panel.
    pub(super) fn begin_section(&mut self, desk: &Desk, panel: usize, view: View, settings: &Settings) {
        if view.volume != self.opened.number || settings.beside == Beside::Nothing {
            return;
        }
        match needed(&mut self.sections, &self.opened, || options_of_sections(settings)) {
            Ok(sections) => sections.begin(desk, &self.opened, panel, view, settings.interaction_ms),
            Err(error) => desk.fail(error),
        }
    }

    /// Looks what is under a pixel; the next wish cuts that short.
    pub(super) fn probe(&mut self, desk: &Desk, probe: Probe) {
        if probe.volume != self.opened.number {
            return;
        }
        let found = match (probe.panel, &mut self.sections) {
            (Some(panel), Some(sections)) => {
                lock(&desk.wishes).cut = Some(sections.canceller());
                sections.pick(panel, probe.pixel)
            }
            (None, _) if self.scene.is_some() => {
                lock(&desk.wishes).cut = Some(self.renderer.canceller());
                super::picked(self.renderer.pick(probe.pixel))
            }
            _ => None,
        };
        if let Some(found) = found {
            desk.tell(|news| news.probed = Some(Probed { probe, found }));
        }
    }

    /// Goes on with the sections, then with the picture, or reads for the next one where this one has converged.
    pub(super) fn go_on(&mut self, desk: &Desk) {
        if let Some(sections) = self.sections.as_mut().filter(|sections| sections.unfinished().is_some()) {
            sections.go_on(desk);
        } else if self.is_settled {
            self.look_ahead(desk);
        } else {
            self.advance(desk, REFINEMENT);
        }
    }

    /// Brings into memory what the next picture will want, for a short time.
    fn look_ahead(&mut self, desk: &Desk) {
        self.looks_left = self.looks_left.saturating_sub(1);
        let until = Instant::now() + LOOK;
        match self.renderer.look_ahead(Some(until)) {
            Ok(ahead) => {
                self.ahead.page_ins += ahead.page_ins;
                self.ahead.is_complete = ahead.is_complete;
                // Before its time it ends where all is there, where there is no room or no motion to go by, or where somebody
                // has a wish.
                if ahead.is_complete || Instant::now() < until {
                    self.looks_left = 0;
                }
                if ahead.page_ins > 0 || ahead.is_complete {
                    let so_far = self.ahead;
                    desk.tell(|news| news.ahead = Some(so_far));
                }
            }
            Err(error) => {
                self.looks_left = 0;
                desk.fail(error);
            }
        }
    }

    /// For so long, or until it has converged, or somebody has another wish.
    fn advance(&mut self, desk: &Desk, time: Duration) {
        match self.renderer.advance(Some(Instant::now() + time)) {
            Ok(step) => {
                self.is_settled = step.is_finished;
                self.show(desk, step.is_finished);
                if let (true, Some(view)) = (step.is_finished, &self.view) {
                    self.looks_left = LOOK_LIMIT;
                    self.ahead = LookedAhead { number: view.number, ..LookedAhead::default() };
                }
            }
            Err(error) => {
                self.is_settled = true;
                desk.fail(error);
            }
        }
    }

    fn show(&self, desk: &Desk, is_converged: bool) {
        let (Some(view), Some(scene), Some(picture)) = (&self.view, &self.scene, self.renderer.picture()) else {
            return;
        };
        let map = match self.inspect {
            Inspect::Errors if is_converged => self.renderer.error_map().map(in_colors),
            Inspect::Work if is_converged => self.renderer.work_map().map(work_in_colors),
            Inspect::Nothing | Inspect::Bricks | Inspect::Errors | Inspect::Work => None,
        };
        let picture = map.map_or_else(|| self.decorated(picture, scene), Cow::Owned);
        // Of pictures that are on their way, nobody can read the stated error: it would take as long as casting them.
        let stats = if is_converged { self.renderer.stats() } else { self.renderer.counts() };
        let has_marks = stats.bricks_failed > 0 || self.inspect == Inspect::Bricks;
        let marks = if has_marks { marks(&self.renderer, self.inspect) } else { Vec::new() };
        let frame = frame_of(view, (&picture, scene.background), (stats, is_converged), self.began);
        let frame = Frame { marks, ..frame };
        desk.tell(|news| news.frame = Some(frame));
    }

    /// The picture with what is to stand beside the volume.
    pub(super) fn decorated<'a>(&self, picture: Cow<'a, Image>, scene: &ResolvedScene) -> Cow<'a, Image> {
        if self.decorations == Decorations::Off {
            return picture;
        }
        let mut picture = picture.into_owned();
        supervol_decorations::decorate(&mut picture, &self.opened.container, &self.opened.facts, scene, None);
        Cow::Owned(picture)
    }

    /// Goes on with the view's picture, after another one was drawn. One that had converged stays on the screen.
    pub(super) fn resume(&mut self, desk: &Arc<Desk>, settings: &Settings) {
        if let Some(scene) = self.scene.clone() {
            self.aim(desk, scene, settings);
        }
    }
}
