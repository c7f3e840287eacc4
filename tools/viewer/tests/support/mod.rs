//! A viewer without a display, on small volumes in a temporary folder.

#![allow(dead_code, reason = "each file of tests uses a part of it")]

use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use eframe::egui::accesskit::{Action, ActionData, ActionRequest, Role, TreeId};
use eframe::egui::{Color32, Event, Key, Modifiers, PointerButton, Pos2, Vec2};
use egui_kittest::kittest::{NodeT, Queryable};
use egui_kittest::{Harness, Node};
use supervol::{Backend, Options, Picture};
use supervol_format::Dims;
use supervol_format::container::manifest::Source;
use supervol_preprocess::kept::Reading;
use supervol_preprocess::{BuildOptions, build};
use supervol_scene::image::stored::{StoredPicture, StoredPixels};
use supervol_scene::scene::Scene;
use supervol_sources::synthetic::Synthetic;
use supervol_viewer::folders::Folders;
use supervol_viewer::launch::Launch;
use supervol_viewer::saved_settings::SavedSettings;
use supervol_viewer::viewer::Viewer;
use supervol_viewer::worker::{Export, Settings};

/// Longer than any step takes, even on a busy machine.
const PATIENCE: Duration = Duration::from_secs(120);
/// Size of the window unless a test says otherwise: low, so that pictures take little time, and so wide that the status takes
/// one line: another line would make the picture lower at some moment.
pub const WINDOW: [f32; 2] = [1280.0, 500.0];
/// Size of the smallest window.
pub const SMALL: [f32; 2] = [800.0, 500.0];
/// Size of a usual window.
pub const ROOMY: [f32; 2] = [1280.0, 800.0];
/// Environment variable with a folder for screenshots.
const SCREENSHOTS: &str = "SUPERVOL_SCREENSHOTS";

/// A container of a synthetic volume of `edge`^3 voxels in bricks of 32.
pub fn container(folder: &Path, name: &str, edge: u64) -> PathBuf {
    container_in_bricks(folder, name, [edge, 32])
}

/// As [`container`], in bricks of another edge.
pub fn container_in_bricks(folder: &Path, name: &str, [edge, brick]: [u64; 2]) -> PathBuf {
    let path = folder.join(format!("{name}.svol"));
    let source = Synthetic::new(name, Dims([edge; 3]), None, 1).expect("a synthetic volume");
    let layout = supervol_format::BrickLayout::new(brick as u32).expect("a size of bricks");
    let options = BuildOptions { layout, threads: 2, ..BuildOptions::default() };
    build(&source, Source::computed(name), &path, &options, &|_| {}).expect("it is built");
    path
}

/// A NumPy file with a ramp.
pub fn npy(folder: &Path) -> PathBuf {
    npy_of(folder, "ramp", [20, 30, 40], |i| (6 * (i % 40)) as u8)
}

/// A NumPy file of bytes given by their index, of this shape, slowest axis first.
pub fn npy_of(folder: &Path, name: &str, shape: [usize; 3], voxel: impl Fn(usize) -> u8) -> PathBuf {
    let path = folder.join(format!("{name}.npy"));
    let [nz, ny, nx] = shape;
    let mut header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({nz}, {ny}, {nx}), }}");
    while !(10 + header.len() + 1).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend((0..nz * ny * nx).map(voxel));
    std::fs::write(&path, bytes).expect("a file");
    path
}

/// The picture that `render` draws of a scene.
pub fn headless(viewer: &Viewer, scene: &Scene) -> Picture {
    let options = Options {
        backend: Backend::Cpu,
        max_error: viewer.settings().max_error,
        predict_error: true,
        ..Options::default()
    };
    let picture = viewer.opened().expect("a volume is open").volume.draw(scene, &options).expect("a picture");
    assert!(picture.is_converged());
    picture
}

/// Pixels of a picture file.
pub fn pixels(path: &Path) -> StoredPixels {
    StoredPicture::read(path).expect("a picture").pixels
}

/// A scripted session with the viewer.
pub struct Session {
    pub harness: Harness<'static, Viewer>,
    pub folder: tempfile::TempDir,
    first: Scene,
    /// Messages to the window since the last key.
    pub told: Vec<String>,
}

impl Session {
    /// A synthetic volume in a window of the usual size of tests.
    pub fn of(name: &str) -> Self {
        Self::new(name, WINDOW, 1.0, Settings::default())
    }

    /// As [`Self::of`], with a memory budget.
    pub fn with_budget(name: &str, host_memory_bytes: u64) -> Self {
        Self::new(name, WINDOW, 1.0, Settings { host_memory_bytes, ..Settings::default() })
    }

    /// As [`Self::of`], in a window of another size.
    pub fn sized(name: &str, size: [f32; 2], scale: f32) -> Self {
        Self::new(name, size, scale, Settings::default())
    }

    /// A session on a volume file that a function writes to the session's folder.
    pub fn of_file(make: impl FnOnce(&Path) -> PathBuf) -> Self {
        let mut session = Self::of("sphere");
        let file = make(session.folder.path());
        session.harness.state_mut().open(&file);
        session.until("it is open", |s| s.viewer().opened().is_some_and(|opened| opened.source == file));
        session.rest();
        session
    }

    /// A volume and bricks of other edges, with a scene.
    pub fn in_bricks(name: &str, edges: [u64; 2], scene: Scene, settings: Settings) -> Self {
        Self::with(name, edges, scene, (WINDOW, 1.0), settings)
    }

    /// As [`Self::in_bricks`], in the smallest window, so that many pictures take little time.
    pub fn small_in_bricks(name: &str, edges: [u64; 2], scene: Scene, settings: Settings) -> Self {
        Self::with(name, edges, scene, (SMALL, 1.0), settings)
    }

    /// A window of another size and scale, with render settings.
    pub fn in_window(name: &str, window: ([f32; 2], f32), settings: Settings) -> Self {
        Self::new(name, window.0, window.1, settings)
    }

    fn new(name: &str, size: [f32; 2], scale: f32, settings: Settings) -> Self {
        Self::with(name, [64, 32], Scene::default(), (size, scale), settings)
    }

    fn with(name: &str, edges: [u64; 2], scene: Scene, (size, scale): ([f32; 2], f32), settings: Settings) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let file = container_in_bricks(folder.path(), name, edges);
        Self::launched(folder, (file, Reading::default()), scene, (size, scale), settings)
    }

    /// A session on a file in a folder, with reading options, scene, window size and scale.
    pub fn launched(
        folder: tempfile::TempDir,
        (file, reading): (PathBuf, Reading),
        scene: Scene,
        (size, scale): ([f32; 2], f32),
        settings: Settings,
    ) -> Self {
        let [cache, kept] = ["cache", "settings"].map(|below| Some(folder.path().join(below)));
        let folders = Folders { cache, settings: kept, ..Folders::default() };
        let settings = Settings { threads: Some(2), ..settings };
        let launch = Launch { file: Some(file), reading, scene, settings, folders };
        let harness = Harness::builder()
            .with_size(size)
            .with_pixels_per_point(scale)
            .with_step_dt(1.0 / 30.0)
            .with_render_cursor(false)
            .wgpu()
            .build_ui_state(|ui, viewer: &mut Viewer| viewer.ui(ui), Viewer::new(launch, SavedSettings::default()));
        Self { harness, folder, first: Scene::default(), told: Vec::new() }
    }

    pub fn viewer(&self) -> &Viewer {
        self.harness.state()
    }

    pub fn cache(&self) -> PathBuf {
        self.folder.path().join("cache")
    }

    pub fn frames(&mut self, count: usize) {
        for _ in 0..count {
            self.harness.step();
            let outputs = self.harness.output().viewport_output.values();
            self.told.extend(outputs.flat_map(|output| output.commands.iter().map(|command| format!("{command:?}"))));
        }
    }

    /// Runs frames until a condition holds.
    pub fn until(&mut self, what: &str, mut holds: impl FnMut(&Self) -> bool) {
        let start = Instant::now();
        loop {
            self.frames(1);
            if holds(self) {
                return;
            }
            let told = self.viewer().message();
            assert!(start.elapsed() < PATIENCE, "waited in vain until {what}; told: {told:?}");
            std::thread::sleep(Duration::from_millis(3));
        }
    }

    /// Runs frames until the wanted picture has converged and keeps its size, now that it is told so.
    pub fn rest(&mut self) {
        self.frames(3);
        let is_done = |session: &Self| session.viewer().is_idle() && session.viewer().opened().is_some();
        loop {
            self.until("the picture has converged", is_done);
            self.frames(2);
            if is_done(self) {
                break;
            }
        }
        if self.first == Scene::default() {
            self.first = self.viewer().scene().clone();
        }
    }

    /// The widget with this label; a usable one if a plain text has the same label.
    pub fn node<'a>(&'a self, label: &'a str) -> Node<'a> {
        let is_word = |node: &Node<'_>| matches!(node.accesskit_node().role(), Role::Label | Role::TextRun);
        let found: Vec<_> = self.harness.query_all_by_label(label).collect();
        let usable = found.iter().position(|node| !is_word(node));
        let names =
            || self.harness.query_all_by(|_| true).filter_map(|n| n.accesskit_node().label()).collect::<Vec<_>>();
        match found.into_iter().nth(usable.unwrap_or(0)) {
            Some(node) => node,
            None => panic!("no widget is called '{label}' among {:?}", names()),
        }
    }

    /// Clicks the widget with this label; scrolls its panel first if needed.
    pub fn click(&mut self, label: &str) {
        let window = self.harness.ctx.content_rect();
        if !window.shrink(40.0).contains_rect(self.node(label).rect()) {
            self.node(label).scroll_to_me();
            self.frames(10);
        }
        let pos = self.node(label).rect().center();
        let button =
            |pressed| Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers: Modifiers::NONE };
        // All in one frame: from frame to frame the layout may move, since lines of the status come and go with pictures.
        self.harness.input_mut().events.extend([Event::PointerMoved(pos), button(true), button(false)]);
        self.frames(3);
    }

    pub fn press(&mut self, modifiers: Modifiers, key: Key) {
        self.told.clear();
        for pressed in [true, false] {
            let event = Event::Key { key, physical_key: None, pressed, repeat: false, modifiers };
            self.harness.input_mut().events.push(event);
            self.frames(1);
        }
    }

    /// A drag with the mouse, in a few steps.
    pub fn drag(&mut self, from: Pos2, by: Vec2, button: PointerButton) {
        let pressed = |pos, pressed| Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE };
        self.harness.hover_at(from);
        self.frames(1);
        self.harness.event(pressed(from, true));
        self.frames(1);
        for step in 1..=4 {
            self.harness.hover_at(from + by * (step as f32 / 4.0));
            self.frames(1);
        }
        self.harness.event(pressed(from + by, false));
        self.frames(2);
    }

    /// Sets the value of a slider or a number field, as a screen reader does.
    pub fn set(&mut self, label: &str, value: f64) {
        let target_node = self.node(label).accesskit_node().locate().0;
        self.harness.event(Event::AccessKitActionRequest(ActionRequest {
            action: Action::SetValue,
            target_tree: TreeId::ROOT,
            target_node,
            data: Some(ActionData::NumericValue(value)),
        }));
        self.frames(3);
    }

    /// Replaces the text of a field.
    pub fn type_over(&mut self, label: &str, text: &str) {
        self.node(label).focus();
        self.frames(2);
        self.press(Modifiers::COMMAND, Key::A);
        self.harness.event(Event::Text(text.into()));
        self.frames(2);
    }

    /// Changes the scene by a function, as an edit by hand.
    pub fn edit(&mut self, change: impl FnOnce(&mut Scene)) {
        let mut scene = self.viewer().scene().clone();
        change(&mut scene);
        self.harness.state_mut().set_scene(scene);
        self.frames(2);
    }

    /// Restores the first scene and closes all dialogs.
    pub fn begin_anew(&mut self) {
        let scene = self.first.clone();
        self.press(Modifiers::NONE, Key::Escape);
        self.harness.state_mut().set_scene(scene);
        self.frames(2);
    }

    pub fn export(&mut self, export: Export) {
        self.harness.state_mut().export(export);
    }

    /// Everything that a key may change: scene, messages, dialogs and panels.
    pub fn fingerprint(&mut self) -> String {
        let nodes = self.harness.get_all_by(|_| true).count();
        format!("{:?} {:?} {nodes} {:?}", self.viewer().scene(), self.viewer().message(), self.told)
    }

    pub fn pixels(&self) -> Vec<Color32> {
        self.viewer().picture().expect("a picture").image.pixels.clone()
    }

    /// Asserts that the picture on the screen is the one that `render` draws of the scene, bit for bit.
    pub fn assert_is_as_rendered(&mut self) {
        let picture = self.viewer().picture().expect("a picture");
        let expected = headless(self.viewer(), self.viewer().scene());
        let size = [expected.image().width, expected.image().height];
        assert_eq!(picture.image.size, size.map(|n| n as usize));
        let expected = expected.to_rgb8();
        let shown: Vec<u8> = picture.image.pixels.iter().flat_map(|p| [p.r(), p.g(), p.b()]).collect();
        let most = shown.iter().zip(&expected).map(|(a, b)| a.abs_diff(*b)).max();
        assert_eq!(most, Some(0), "grey levels between what is shown and what is rendered");
    }

    /// Asserts that a panel shows the picture that `render` draws of its scene, bit for bit.
    pub fn assert_section_is_as_rendered(&mut self, axis: usize) {
        let panel = self.viewer().sections().panel(axis).expect("a panel");
        let (scene, shown) = (panel.scene().expect("a scene"), panel.shown().expect("a picture"));
        let expected = headless(self.viewer(), scene);
        let size = [expected.image().width, expected.image().height];
        assert_eq!(shown.image.size, size.map(|n| n as usize));
        let bytes: Vec<u8> = shown.image.pixels.iter().flat_map(|p| [p.r(), p.g(), p.b()]).collect();
        assert!(bytes == expected.to_rgb8(), "section {axis} is not what render draws");
    }

    /// Draws the window, and writes it to a file on request. Without a graphics adapter, prints a message.
    #[allow(clippy::print_stderr, reason = "what is skipped is said")]
    pub fn screenshot(&mut self, name: &str) {
        match self.harness.render() {
            Ok(image) => {
                assert!(image.pixels().any(|p| p.0[0] > 100), "{name}: the window is dark");
                if let Some(folder) = std::env::var_os(SCREENSHOTS) {
                    let path = PathBuf::from(folder).join(format!("{name}.png"));
                    image.save(path).expect("a file");
                }
            }
            Err(error) => eprintln!("SKIPPED: no GPU adapter draws the window: {error}"),
        }
    }
}

/// Bytes of a brick's record on the disk that were made unreadable; they can be restored.
pub struct Fault {
    path: PathBuf,
    offset: u64,
    bytes: Vec<u8>,
}

impl Fault {
    /// Inverts every byte of a stored brick of level 0: number `number` of those with a record.
    pub fn new(path: &Path, container: &supervol_format::Container, number: usize) -> Self {
        let keys = container.pyramid().keys_of(supervol_format::Lod::FINEST);
        let entries = keys.map(|key| container.entry(key).expect("an entry"));
        let stored: Vec<_> = entries.filter(|entry| entry.payload_bytes > 0 && entry.offset > 0).collect();
        let entry = &stored[number % stored.len()];
        let (offset, length) = (entry.offset, entry.payload_bytes as usize);
        let mut bytes = vec![0; length];
        let mut file = std::fs::OpenOptions::new().read(true).write(true).open(path).expect("the container");
        file.seek(SeekFrom::Start(offset)).and_then(|_| file.read_exact(&mut bytes)).expect("a record");
        let fault = Self { path: path.into(), offset, bytes };
        fault.write(&fault.bytes.iter().map(|byte| !byte).collect::<Vec<u8>>());
        fault
    }

    fn write(&self, bytes: &[u8]) {
        let mut file = std::fs::OpenOptions::new().write(true).open(&self.path).expect("the container");
        file.seek(SeekFrom::Start(self.offset)).and_then(|_| file.write_all(bytes)).expect("it is written");
    }

    /// Restores the bytes.
    pub fn mend(self) {
        self.write(&self.bytes);
    }
}
