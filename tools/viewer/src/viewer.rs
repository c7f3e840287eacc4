//! The application's state, and its changes by messages of the worker and by keys.
//!
//! Nothing here waits, opens a volume or casts a ray. No window is needed: tests run the same frames.

use std::collections::VecDeque;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use eframe::egui::{self, ColorImage, TextureHandle, TextureOptions};
use supervol::FrameStats;
use supervol_format::cast::whole;
use supervol_preprocess::kept::Reading;
use supervol_scene::scene::{Mode, Scene};

use crate::cine::Cine;
use crate::command::Command;
use crate::folders::Folders;
use crate::history::History;
use crate::launch::Launch;
use crate::saved_settings::{SavedSettings, Theme};
use crate::sections::{Layout, Sections, Shown};
use crate::state::animation::KeyFrames;
use crate::state::dialogs::Dialogs;
use crate::state::file_options::FileOptions;
pub use crate::state::gradients::GradientHistogram;
use crate::state::gradients::GradientState;
use crate::state::panels::{PanelState, StatusHeight};
use crate::state::transfer::Transfer;
use crate::worker::{
    Busy, Export, Frame, LookedAhead, Mark, Message, Open, OpenVolume, PANELS, ProbeAnswer, Settings, SidePanels, View,
    Worker, preview_refusal,
};
use crate::{command_line, edit, navigate, planes, preview};

/// Step sizes of keys. `TURN`: degrees. `MOVE`: share of the picture's height. `NEARER`: factor of the distance to the
/// target. `FLY`: share of that distance.
const TURN: f64 = 5.0;
const MOVE: f64 = 0.05;
const NEARER: f64 = 0.85;
const FLY: f64 = 0.1;

/// Most stored latencies.
const LATENCY_LIMIT: usize = 512;

/// The picture on the screen.
pub struct Picture {
    /// Its pixels.
    pub image: Arc<ColorImage>,
    /// Texture with the pixels.
    pub texture: TextureHandle,
    /// Number of the request.
    pub number: u64,
    /// Statistics of the picture.
    pub stats: FrameStats,
    /// Whether the picture is final.
    pub is_converged: bool,
    /// Wall time of drawing it so far, in milliseconds.
    pub spent_ms: f64,
    /// Bricks to outline in it.
    pub marks: Vec<Mark>,
}

impl std::fmt::Debug for Picture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Picture")
            .field("number", &self.number)
            .field("stats", &self.stats)
            .field("is_converged", &self.is_converged)
            .finish_non_exhaustive()
    }
}

/// State of the slice that is shown instead of the volume.
pub(crate) struct ShownSlice {
    /// The grid's axis across the slice.
    pub(crate) axis: usize,
    /// Voxel along the axis.
    pub(crate) at: u64,
    /// The scene before the slice, which is restored afterwards.
    before: Scene,
}

/// The application.
pub struct Viewer {
    pub(crate) worker: Option<Worker>,
    pub(crate) opened: Option<Arc<OpenVolume>>,
    pub(crate) scene: Scene,
    pub(crate) history: History,
    pub(crate) settings: Settings,
    pub(crate) exaggeration: f64,
    pub(crate) picture: Option<Picture>,
    pub(crate) ahead: Option<LookedAhead>,
    pub(crate) busy: Option<Busy>,
    pub(crate) message: Option<Message>,
    pub(crate) dialogs: Dialogs,
    pub(crate) panel_state: PanelState,
    pub(crate) slice: Option<ShownSlice>,
    pub(crate) sections: Sections,
    pub(crate) cine: Cine,
    pub(crate) transfer: Transfer,
    pub(crate) gradients: GradientState,
    pub(crate) status_height: StatusHeight,
    /// Key frames of an animation.
    pub(crate) keys: KeyFrames,
    pub(crate) saved: SavedSettings,
    pub(crate) folders: Folders,
    /// Latencies in milliseconds from requests to their first pictures; the last one is the newest.
    pub(crate) latencies_ms: VecDeque<f64>,
    launch: Option<Launch>,
    /// First scene of the volume, or of its preview.
    begun: Scene,
    sent: Option<(u64, Scene)>,
    sent_settings: Settings,
    requests: u64,
    /// Requests without an answer, and their times.
    unanswered: VecDeque<(u64, Instant)>,
    /// Title of the window.
    title: String,
}

impl std::fmt::Debug for Viewer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Viewer")
            .field("opened", &self.opened)
            .field("scene", &self.scene)
            .field("settings", &self.settings)
            .field("picture", &self.picture)
            .field("busy", &self.busy)
            .field("message", &self.message)
            .finish_non_exhaustive()
    }
}

impl Viewer {
    /// A viewer that will open the volume of `launch`. The worker starts with the first frame.
    #[must_use]
    pub fn new(launch: Launch, saved: SavedSettings) -> Self {
        let side_panels = side_panels(saved.layout);
        let settings = Settings { decorations: saved.decorations, side_panels, ..launch.settings };
        Self {
            worker: None,
            opened: None,
            scene: Scene::default(),
            history: History::default(),
            settings,
            exaggeration: 1.0,
            picture: None,
            ahead: None,
            busy: None,
            message: None,
            dialogs: Dialogs::default(),
            panel_state: PanelState::default(),
            slice: None,
            sections: Sections { layout: saved.layout, ..Sections::default() },
            cine: Cine::default(),
            transfer: Transfer::default(),
            gradients: GradientState::default(),
            status_height: StatusHeight::default(),
            keys: KeyFrames::default(),
            saved,
            folders: launch.folders.clone(),
            latencies_ms: VecDeque::new(),
            begun: Scene::default(),
            sent: None,
            sent_settings: settings,
            launch: Some(launch),
            requests: 0,
            unanswered: VecDeque::new(),
            title: String::new(),
        }
    }

    /// The present scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Replaces the scene of the present volume.
    pub fn set_scene(&mut self, scene: Scene) {
        self.scene = scene;
    }

    /// Draws a picture until it has converged, and writes it to a file.
    pub fn export(&mut self, export: Export) {
        if let Some(worker) = &self.worker {
            worker.export(export);
        }
    }

    /// The open volume.
    #[must_use]
    pub fn opened(&self) -> Option<&Arc<OpenVolume>> {
        self.opened.as_ref()
    }

    /// The picture on the screen.
    #[must_use]
    pub fn picture(&self) -> Option<&Picture> {
        self.picture.as_ref()
    }

    /// Sections in panels beside the picture.
    #[must_use]
    pub fn sections(&self) -> &Sections {
        &self.sections
    }

    /// Result of looking ahead; `None` if the present picture has not converged or the camera has not moved.
    #[must_use]
    pub fn looked_ahead(&self) -> Option<LookedAhead> {
        self.ahead.filter(|ahead| ahead.number == self.requests)
    }

    /// State of the cine.
    #[must_use]
    pub fn cine(&self) -> &Cine {
        &self.cine
    }

    /// The last failure or success.
    #[must_use]
    pub fn message(&self) -> Option<&Message> {
        self.message.as_ref()
    }

    /// Render settings.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Whether all work is done: the picture on the screen is that of the present scene, and it has converged.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        let is_drawn = self.picture.as_ref().is_some_and(|p| p.is_converged) && self.is_up_to_date();
        let is_quiet = self.busy.is_none() && !self.gradients.is_counting();
        is_quiet && (self.opened.is_none() || is_drawn && self.sections.are_idle())
    }

    /// Shows the file's name in the window's title, and whether work is going on, for task bars and scripts.
    pub(crate) fn show_title(&mut self, ctx: &egui::Context) {
        let Some(opened) = &self.opened else { return };
        let name = opened.source.file_name().map(|n| n.to_string_lossy()).unwrap_or_default();
        let title = if self.is_idle() { format!("{name} - Supervol") } else { format!("{name} (working) - Supervol") };
        if title != self.title {
            ctx.send_viewport_cmd(egui::ViewportCommand::Title(title.clone()));
            self.title = title;
        }
    }

    /// Whether the picture on the screen shows the present scene, converged or not.
    pub(crate) fn is_up_to_date(&self) -> bool {
        let is_sent = self.sent.as_ref().is_some_and(|(_, scene)| *scene == self.scene);
        is_sent && self.picture.as_ref().is_some_and(|picture| picture.number == self.requests)
    }

    /// Stores the window's size in the persistent settings.
    pub(crate) fn record_window_size(&mut self, ctx: &egui::Context) {
        let (rect, is_full) = ctx.input(|i| (i.viewport().inner_rect, i.viewport().fullscreen.unwrap_or(false)));
        if let Some(rect) = rect.filter(|rect| !is_full && rect.is_finite()) {
            self.saved.window = Some(rect.size().into());
        }
    }

    /// Starts the worker in the first frame.
    pub(crate) fn start(&mut self, ctx: &egui::Context) {
        let Some(launch) = self.launch.take() else { return };
        set_theme(ctx, self.saved.theme);
        let waker = ctx.clone();
        match Worker::start(self.settings, self.folders.clone(), move || waker.request_repaint()) {
            Ok(worker) => self.worker = Some(worker),
            Err(error) => self.message = Some(Message::Failure(format!("cannot start a thread: {error}"))),
        }
        if let Some(file) = &launch.file {
            self.exaggeration = launch.scene.vertical_exaggeration.unwrap_or(1.0);
            self.open_with(file, launch.reading, launch.scene);
        }
    }

    /// Opens a file with its default picture.
    pub fn open(&mut self, path: &Path) {
        self.exaggeration = 1.0;
        self.open_with(path, Reading::default(), Scene::default());
    }

    /// Opens a file with options of its own, with its default picture.
    pub(crate) fn open_read(&mut self, path: &Path, reading: Reading) {
        self.exaggeration = 1.0;
        self.open_with(path, reading, Scene::default());
    }

    fn open_with(&mut self, path: &Path, reading: Reading, scene: Scene) {
        self.message = None;
        if let Some(worker) = &self.worker {
            worker.open(Open { path: path.into(), reading, exaggeration: self.exaggeration, scene });
        }
    }

    /// Opens the present volume again with this vertical exaggeration. The look stays; the camera frames the volume
    /// again.
    pub fn set_exaggeration(&mut self, factor: f64) {
        let Some(opened) = self.opened.clone() else { return };
        self.set_slice(None);
        self.exaggeration = factor;
        self.open_with(&opened.source, opened.reading.clone(), Scene { camera: None, ..self.scene.clone() });
    }

    /// Opens another channel or time point of the present file, with the default picture and the same view direction.
    /// If the file has no such part, a message says so, and the present part stays.
    pub(crate) fn open_part(&mut self, channel: Option<u64>, frame: Option<u64>) {
        let Some(opened) = self.opened.clone() else { return };
        let mut reading = opened.reading.clone();
        (reading.options.selection.channel, reading.options.selection.frame) = (channel, frame);
        self.set_slice(None);
        self.open_with(&opened.source, reading, Scene { camera: self.scene.camera.clone(), ..Scene::default() });
    }

    /// Receives the messages of the worker.
    pub(crate) fn receive(&mut self, ctx: &egui::Context) {
        let Some(worker) = &self.worker else { return };
        let is_dead = worker.is_dead();
        let messages = worker.messages();
        self.busy = if is_dead { None } else { messages.busy };
        self.ahead = messages.ahead.or(self.ahead);
        if let Some(message) = messages.message {
            self.message = Some(message);
        }
        if is_dead {
            let what = "the drawing thread has crashed because of a bug in supervol; its message is on standard error. Save the scene \
                        and start supervol again";
            self.message = Some(Message::Failure(what.into()));
        }
        if let Some(refused) = messages.refused {
            self.dialogs.file_options = Some(FileOptions::refused(*refused));
        }
        if let Some(opened) = messages.opened {
            self.show_volume(ctx, opened);
        }
        if let Some(frame) = messages.frame {
            self.show(ctx, frame);
        }
        for (axis, frame) in messages.sections.into_iter().enumerate() {
            if let Some(frame) = frame {
                self.show_section(ctx, axis, frame);
            }
        }
        if let Some(probed) = messages.probed {
            self.receive_answer(probed);
        }
    }

    /// Receives the lengths of the gradient.
    pub(crate) fn receive_gradients(&mut self) {
        let told = self.gradients.receive(self.opened.as_deref(), &mut self.scene);
        self.message = told.or(self.message.take());
    }

    /// The histogram of the lengths of the gradient, as the editor shows it. `None` until they are counted.
    #[must_use]
    pub fn gradient_histogram(&self) -> Option<GradientHistogram> {
        self.gradients.histogram(self.scene.gradient_opacity.map_or(0.0, |[_, to]| to))
    }

    /// Receives the answer to a probe.
    pub(crate) fn receive_answer(&mut self, probed: ProbeAnswer) {
        let Some(opened) = self.opened.clone().filter(|opened| opened.number == probed.probe.volume) else { return };
        if self.sections.moving == Some(probed.probe.number) {
            self.sections.moving = None;
            if let Ok(Some(picked)) = &probed.found {
                self.sections.move_to(picked.index, opened.facts(), &mut self.scene);
            }
        }
        self.sections.answered = Some(probed);
    }

    /// Shows the scene of an opened volume.
    fn show_volume(&mut self, ctx: &egui::Context, opened: Arc<OpenVolume>) {
        let is_same = self.opened.as_ref().is_some_and(|before| before.source == opened.source);
        let preview = self.opened.as_ref().filter(|before| is_same && before.exaggeration == opened.exaggeration);
        if let (Some(strides), None) = (preview.and_then(|before| before.preview_of), opened.preview_of) {
            return self.replace_preview(strides, opened);
        }
        let mut scene = opened.scene.clone();
        if let Some(before) =
            self.opened.as_ref().filter(|before| is_same && before.exaggeration != opened.exaggeration)
        {
            planes::carry(&mut scene, &before.facts().geometry, &opened.facts().geometry);
            self.sections.panels.iter_mut().for_each(|panel| panel.camera = None);
        }
        // The window determines the picture's size, and with it the default camera.
        (scene.image.width, scene.image.height) = (self.scene.image.width, self.scene.image.height);
        if !opened.has_requested_camera {
            scene.camera = edit::camera_from(&scene, &opened, None);
        }
        edit::write_out(&mut scene, opened.facts());
        if is_same {
            self.history.commit(&scene, ctx.input(|input| input.time));
        } else {
            self.history = History::new(&scene);
            self.sections = Sections::of(opened.facts(), self.sections.layout);
            self.panel_state = PanelState::of(&scene);
            self.keys = KeyFrames::default();
            self.picture = None;
            self.saved.add(&opened.source);
            self.saved.write(&self.folders);
        }
        self.slice = None;
        self.begun = scene.clone();
        self.scene = scene;
        self.opened = Some(opened);
    }

    /// Replaces a preview by its volume.
    fn replace_preview(&mut self, strides: [u64; 3], opened: Arc<OpenVolume>) {
        let slice = self.slice.take().map(|slice| {
            self.scene = Scene { image: self.scene.image.clone(), ..slice.before };
            (slice.axis, slice.at * strides[slice.axis])
        });
        let mut scene = preview::carry_over(&self.scene, &self.begun, strides, &opened);
        scene.image = self.scene.image.clone();
        edit::write_out(&mut scene, opened.facts());
        let cursor = self.sections.cursor;
        self.sections = Sections::of(opened.facts(), self.sections.layout);
        self.sections.cursor =
            std::array::from_fn(|a| (cursor[a] * strides[a] as f64).min(opened.facts().dims.0[a] as f64 - 1.0));
        self.history = History::new(&scene);
        self.panel_state = PanelState::of(&scene);
        (self.begun, self.scene) = (scene.clone(), scene);
        self.opened = Some(opened);
        self.set_slice(slice);
    }

    fn show(&mut self, ctx: &egui::Context, frame: Frame) {
        if self.opened.as_ref().is_none_or(|opened| opened.number != frame.volume) {
            return;
        }
        self.record_latency(frame.number);
        let Frame { number, image, stats, is_converged, spent_ms, marks, .. } = frame;
        let texture = match self.picture.take() {
            Some(mut picture) => {
                picture.texture.set(image.clone(), TextureOptions::NEAREST);
                picture.texture
            }
            None => ctx.load_texture("picture", image.clone(), TextureOptions::NEAREST),
        };
        self.picture = Some(Picture { image, texture, number, stats, is_converged, spent_ms, marks });
    }

    fn show_section(&mut self, ctx: &egui::Context, axis: usize, frame: Frame) {
        if self.opened.as_ref().is_none_or(|opened| opened.number != frame.volume) {
            return;
        }
        let Frame { number, image, stats, is_converged, .. } = frame;
        let panel = &mut self.sections.panels[axis];
        let texture = match panel.shown.take() {
            Some(mut shown) => {
                shown.texture.set(image.clone(), TextureOptions::NEAREST);
                shown.texture
            }
            None => ctx.load_texture(format!("section {axis}"), image.clone(), TextureOptions::NEAREST),
        };
        panel.shown = Some(Shown { image, texture, number, stats, is_converged });
    }

    /// Sets the layout of sections beside the picture.
    pub(crate) fn set_layout(&mut self, layout: Layout) {
        if layout == self.sections.layout {
            return;
        }
        (self.sections.layout, self.saved.layout) = (layout, layout);
        self.settings.side_panels = side_panels(layout);
        // Removed panels drop their picture. The others are requested again, because the division of the memory
        // changes.
        for panel in &mut self.sections.panels {
            (panel.shown, panel.sent) = (None, None);
        }
    }

    /// Executes a command.
    pub fn run(&mut self, ctx: &egui::Context, command: Command) {
        match command {
            Command::Help => self.dialogs.keys = !self.dialogs.keys,
            Command::Open => self.dialogs.begin_open(self.opened.as_deref()),
            Command::Panels => self.saved.panels_hidden = !self.saved.panels_hidden,
            Command::FullScreen => {
                let is_full = ctx.input(|input| input.viewport().fullscreen.unwrap_or(false));
                ctx.send_viewport_cmd(egui::ViewportCommand::Fullscreen(!is_full));
            }
            _ if self.opened.is_none() => {}
            Command::SaveScene | Command::Export | Command::Animate | Command::CopyCommand if self.is_preview() => {
                self.message = self.preview_message();
            }
            Command::Cine => {
                self.cine.is_running = !self.cine.is_running;
                if self.cine.is_running && self.slice.is_none() && self.sections.layout == Layout::Alone {
                    self.set_layout(Layout::Three);
                }
            }
            Command::Handles => self.panel_state.are_handles_shown = !self.panel_state.are_handles_shown,
            Command::Sections => self.set_layout(match self.sections.layout {
                Layout::Three => Layout::Alone,
                _ => Layout::Three,
            }),
            Command::SaveScene => self.dialogs.begin_save(self.opened.as_deref()),
            Command::Export => self.dialogs.begin_export(self.opened.as_deref(), &self.scene),
            Command::Animate => self.dialogs.begin_animation(self.opened.as_deref(), &self.scene),
            Command::CopyCommand => self.copy_command(ctx),
            Command::Undo => {
                let before = self.history.undo(&self.scene, ctx.input(|input| input.time));
                self.restore(before);
            }
            Command::Redo => {
                let after = self.history.redo(&self.scene, ctx.input(|input| input.time));
                self.restore(after);
            }
            view => self.run_view(view),
        }
    }

    /// Whether a preview is shown instead of the volume.
    #[must_use]
    pub fn is_preview(&self) -> bool {
        self.opened.as_ref().is_some_and(|opened| opened.preview_of.is_some())
    }

    fn preview_message(&self) -> Option<Message> {
        let opened = self.opened.as_ref()?;
        let refused = |strides| Message::Failure(preview_refusal(&opened.source, strides));
        opened.preview_of.map(refused)
    }

    /// Restores a scene of the history.
    fn restore(&mut self, scene: Option<Scene>) {
        if let Some(scene) = scene {
            // A scene of the history is complete, including slices.
            (self.scene, self.slice) = (scene, None);
        }
    }

    fn run_view(&mut self, command: Command) {
        let (Some(opened), Some(camera)) = (&self.opened, &self.scene.camera) else { return };
        let stage = edit::stage(opened.facts());
        let steps = |[right, up]: [i8; 2], length: f64| [f64::from(right) * length, f64::from(up) * length];
        let camera = match command {
            Command::DefaultView => edit::camera_from(&self.scene, opened, None),
            Command::ViewFrom(direction) => edit::camera_from(&self.scene, opened, Some(direction)),
            Command::Projection => Some(navigate::other_projection(camera)),
            Command::Turn(by) => Some(navigate::orbit(camera, &stage, steps(by, TURN))),
            Command::Move(by) => Some(navigate::pan(camera, steps(by, MOVE))),
            Command::Nearer(by) => Some(navigate::dolly(camera, &stage, NEARER.powi(i32::from(by)), [0.0; 2], 1.0)),
            Command::Fly(by) => Some(navigate::fly(camera, f64::from(by) * FLY)),
            _ => return,
        };
        self.scene.camera = camera;
    }

    fn copy_command(&mut self, ctx: &egui::Context) {
        let Some(opened) = &self.opened else { return };
        self.message = Some(match command_line::command_line(opened, &self.scene, &self.settings, &self.folders) {
            Ok(line) => {
                let message = Message::Done(format!("copied: {line}"));
                ctx.copy_text(line);
                message
            }
            Err(error) => Message::Failure(error),
        });
    }

    /// Switches to another mode, with the look that it last had.
    pub(crate) fn set_mode(&mut self, mode: Mode) {
        if let Some(opened) = &self.opened {
            self.scene = self.panel_state.switched(&self.scene, opened, mode);
        }
    }

    /// Shows a slice (axis, voxel), or with `None` the previous scene again. Consecutive slices keep camera and
    /// colours.
    pub(crate) fn set_slice(&mut self, wanted: Option<(usize, u64)>) {
        let Some(opened) = self.opened.clone() else { return };
        let last = self.slice.take();
        let Some((axis, at)) = wanted else {
            let (width, height) = (self.scene.image.width, self.scene.image.height);
            self.scene = last.map_or_else(|| self.scene.clone(), |slice| slice.before);
            (self.scene.image.width, self.scene.image.height) = (width, height);
            return;
        };
        let is_same_axis = last.as_ref().is_some_and(|slice| slice.axis == axis);
        let before = last.map_or_else(|| self.scene.clone(), |slice| slice.before);
        let Some(mut scene) = edit::sliced(&before, &opened, axis, at) else {
            self.message = Some(Message::Failure("this slice lies outside the crop box".into()));
            self.slice = is_same_axis.then_some(ShownSlice { axis, at, before });
            return;
        };
        scene.image = self.scene.image.clone();
        if is_same_axis {
            let Scene { transfer_function, samples_per_pixel, .. } = self.scene.clone();
            (scene.transfer_function, scene.samples_per_pixel) = (transfer_function, samples_per_pixel);
            scene.camera = match (self.scene.camera.take(), scene.camera.take()) {
                (Some(now), Some(usual)) => Some(navigate::shifted_to(&now, &usual)),
                (_, usual) => usual,
            };
        }
        self.scene = scene;
        self.slice = Some(ShownSlice { axis, at, before });
    }

    /// Moves the shown slice, or the selected slice in the volume, by steps, limited to the volume.
    pub(crate) fn step_slice(&mut self, steps: f64) {
        let Some(opened) = self.opened.clone() else { return };
        if let Some((axis, at)) = self.slice.as_ref().map(|slice| (slice.axis, slice.at)) {
            let last = (opened.facts().dims.0[axis] - 1) as f64;
            let next = whole::<u64>((at as f64 + steps).clamp(0.0, last));
            if next != at {
                self.set_slice(Some((axis, next)));
            }
        } else if let Some(slice) = self.scene.slices.get_mut(self.panel_state.held_slice) {
            planes::step(slice, opened.facts(), steps);
        }
    }

    /// Sends the changes of this frame to the worker.
    pub(crate) fn send(&mut self, ctx: &egui::Context) {
        let Some(worker) = &self.worker else { return };
        if let Some(opened) = &self.opened {
            // Scenes of the history may be older than the place of the volume.
            self.scene.vertical_exaggeration = opened.scene_exaggeration();
        }
        // Cut faces that are gone, or have no light, are not lit any more.
        if self.scene.cut_normals && !self.scene.may_light_cuts() {
            self.scene.cut_normals = false;
        }
        // A drag is one edit: it ends when the button is released. So is a cine.
        if !ctx.input(|input| input.pointer.any_down()) && !self.cine.is_running {
            self.history.commit(&self.scene, ctx.input(|input| input.time));
        }
        let are_set = self.settings == self.sent_settings;
        if !are_set {
            worker.set(self.settings);
            self.sent_settings = self.settings;
        }
        let Some(opened) = &self.opened else { return };
        let is_sent = |(volume, scene): &(u64, Scene)| *volume == opened.number && *scene == self.scene;
        if !are_set || !self.sent.as_ref().is_some_and(is_sent) {
            self.requests += 1;
            self.sections.picture = self.requests;
            worker.view(View { number: self.requests, volume: opened.number, scene: self.scene.clone() });
            self.sent = Some((opened.number, self.scene.clone()));
            push_bounded(&mut self.unanswered, (self.requests, Instant::now()));
        }
        self.send_sections(!are_set);
    }

    /// Requests sections that have changed, or all of them.
    fn send_sections(&mut self, again: bool) {
        let (Some(worker), Some(opened)) = (&self.worker, &self.opened) else { return };
        for axis in 0..PANELS {
            let panel = &mut self.sections.panels[axis];
            let Some(scene) = panel.scene.as_ref().filter(|_| self.sections.layout.shows(axis)) else { continue };
            let is_sent = |(volume, sent, _): &(u64, Scene, u64)| *volume == opened.number && sent == scene;
            if again || !panel.sent.as_ref().is_some_and(is_sent) {
                self.sections.requests += 1;
                let number = self.sections.requests;
                worker.section(axis, View { number, volume: opened.number, scene: scene.clone() });
                panel.sent = Some((opened.number, scene.clone(), number));
            }
        }
    }

    /// Records the latency of a picture; older requests remain without an answer.
    fn record_latency(&mut self, number: u64) {
        while let Some(&(request, since)) = self.unanswered.front().filter(|(request, _)| *request <= number) {
            self.unanswered.pop_front();
            if request == number {
                push_bounded(&mut self.latencies_ms, since.elapsed().as_secs_f64() * 1e3);
            }
        }
    }

    /// The last few hundred latencies in milliseconds, from requests to their first pictures.
    #[must_use]
    pub fn latencies_ms(&self) -> &VecDeque<f64> {
        &self.latencies_ms
    }

    /// Writes the persistent settings.
    pub fn save_settings(&self) {
        self.saved.write(&self.folders);
    }
}

/// Appends to a list of bounded length.
fn push_bounded<T>(list: &mut VecDeque<T>, value: T) {
    if list.len() == LATENCY_LIMIT {
        list.pop_front();
    }
    list.push_back(value);
}

/// Whether a layout has panels.
fn side_panels(layout: Layout) -> SidePanels {
    if layout == Layout::Alone { SidePanels::Hidden } else { SidePanels::Shown }
}

/// Sets the colour theme.
pub(crate) fn set_theme(ctx: &egui::Context, theme: Theme) {
    ctx.set_theme(match theme {
        Theme::System => egui::ThemePreference::System,
        Theme::Light => egui::ThemePreference::Light,
        Theme::Dark => egui::ThemePreference::Dark,
    });
}
