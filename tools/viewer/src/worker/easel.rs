//! One open volume with its renderer, and the picture on it.

use std::borrow::Cow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui::ColorImage;
use supervol_runtime::frame::{Backend, Progress, RenderOptions};
use supervol_runtime::image::Image;
use supervol_runtime::renderer::Renderer;
use supervol_runtime::scene::ResolvedScene;
use supervol_runtime::stop::Canceller;
use supervol_runtime::volume::Volume;

use super::{Busy, Decorations, Desk, Frame, Opened, Settings, View, lock};

/// A picture at rest is shown anew after so long, as far as it has come.
const REFINEMENT: Duration = Duration::from_millis(150);

/// See the module.
pub(super) struct Easel {
    pub(super) opened: Arc<Opened>,
    pub(super) renderer: Renderer,
    view: Option<View>,
    /// The same, resolved.
    scene: Option<ResolvedScene>,
    /// The view's picture is what it will be, or cannot be drawn.
    is_settled: bool,
    began: Instant,
    decorations: Decorations,
}

fn options(desk: &Arc<Desk>, settings: &Settings) -> RenderOptions {
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
    RenderOptions {
        backend: Backend::Cpu,
        host_memory_bytes: settings.host_memory_bytes,
        threads: settings.threads,
        max_error: settings.max_error,
        predict_error: true,
        progress: Some(Arc::new(on_progress)),
        ..RenderOptions::default()
    }
}

impl Easel {
    /// An easel without a picture; the window is told of the volume.
    pub(super) fn new(desk: &Arc<Desk>, opened: Arc<Opened>, settings: &Settings) -> Result<Self, String> {
        let volume = Volume::of(opened.container.clone());
        let renderer = Renderer::new(volume, options(desk, settings)).map_err(|e| e.to_string())?;
        desk.tell(|news| (news.opened, news.frame) = (Some(opened.clone()), None));
        let decorations = settings.decorations;
        Ok(Self { opened, renderer, view: None, scene: None, is_settled: true, began: Instant::now(), decorations })
    }

    /// Who can stop the picture in progress; none where there is none.
    pub(super) fn unfinished(&self) -> Option<Canceller> {
        (!self.is_settled).then(|| self.renderer.canceller())
    }

    /// From now on pictures are made like this, from the next view on. What is loaded stays.
    pub(super) fn set(&mut self, desk: &Arc<Desk>, settings: &Settings) {
        self.renderer.set_options(options(desk, settings));
        self.decorations = settings.decorations;
        self.is_settled = true;
    }

    /// Begins a picture, and shows what there is of it within the time for interaction.
    pub(super) fn begin(&mut self, desk: &Desk, view: View, settings: &Settings) {
        if view.volume != self.opened.number {
            return;
        }
        self.began = Instant::now();
        match view.scene.resolve(&self.opened.facts) {
            Ok(scene) => {
                self.scene = Some(scene.clone());
                self.renderer.set_scene(scene);
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

    /// Goes on with the picture.
    pub(super) fn refine(&mut self, desk: &Desk) {
        self.advance(desk, REFINEMENT);
    }

    fn advance(&mut self, desk: &Desk, time: Duration) {
        match self.renderer.advance(Some(Instant::now() + time)) {
            Ok(step) => {
                self.is_settled = step.is_converged;
                self.show(desk, step.is_converged);
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
        let picture = self.decorated(picture, scene);
        let size = [picture.width, picture.height].map(|n| n as usize);
        let image = Arc::new(ColorImage::from_rgb(size, &picture.to_rgb8(scene.background)));
        drop(picture);
        let frame = Frame {
            volume: view.volume,
            number: view.number,
            image,
            // Of pictures that are on their way, nobody can read it: it would take as long as casting them.
            stats: if is_converged { self.renderer.stats() } else { self.renderer.counts() },
            is_converged,
            spent_ms: self.began.elapsed().as_secs_f64() * 1e3,
        };
        desk.tell(|news| news.frame = Some(frame));
    }

    /// The picture with what is to stand beside the volume.
    pub(super) fn decorated<'a>(&self, picture: Cow<'a, Image>, scene: &ResolvedScene) -> Cow<'a, Image> {
        if self.decorations == Decorations::Off {
            return picture;
        }
        let mut picture = picture.into_owned();
        supervol_decorations::decorate(&mut picture, &self.opened.container, &self.opened.facts, scene);
        Cow::Owned(picture)
    }

    /// Goes on with the view's picture, after another one was drawn. One that had converged stays on the screen.
    pub(super) fn resume(&mut self) {
        if let Some(scene) = &self.scene {
            self.renderer.set_scene(scene.clone());
        }
    }
}
