//! Draws the pictures of docs/user-guide.md, without a display:
//!
//!     cargo run -p supervol-viewer --example guide_pictures -- demo-output/carp.svol demo-output/seismic.svol docs/images/user-guide
//!
//! The containers are those of `supervol demo`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use eframe::egui::accesskit::Role;
use egui_kittest::kittest::{NodeT, Queryable};
use egui_kittest::{Harness, Node};
use supervol_preprocess::kept::Reading;
use supervol_scene::scene::Scene;
use supervol_viewer::folders::Folders;
use supervol_viewer::launch::Launch;
use supervol_viewer::saved_settings::{SavedSettings, Theme};
use supervol_viewer::viewer::Viewer;
use supervol_viewer::worker::Settings;

const SIZE: [f32; 2] = [1280.0, 800.0];
/// Smaller size for a picture that is mostly noise, which does not compress.
const SMALLER: [f32; 2] = [1000.0, 640.0];
const PATIENCE: Duration = Duration::from_secs(300);

struct Artist {
    harness: Harness<'static, Viewer>,
    folder: PathBuf,
}

impl Artist {
    fn new(volume: &Path, folder: &Path, theme: Theme, size: [f32; 2]) -> Result<Self, String> {
        let launch = Launch {
            file: Some(volume.into()),
            reading: Reading::default(),
            scene: Scene::default(),
            settings: Settings::default(),
            folders: Folders::default(),
        };
        let viewer = Viewer::new(launch, SavedSettings { theme, ..SavedSettings::default() });
        let harness = Harness::builder()
            .with_size(size)
            .with_render_cursor(false)
            .wgpu()
            .build_ui_state(|ui, viewer: &mut Viewer| viewer.ui(ui), viewer);
        let mut artist = Self { harness, folder: folder.into() };
        artist.rest()?;
        Ok(artist)
    }

    fn rest(&mut self) -> Result<(), String> {
        let start = Instant::now();
        self.harness.run_steps(3);
        while !(self.harness.state().is_idle() && self.harness.state().opened().is_some()) {
            self.harness.step();
            std::thread::sleep(Duration::from_millis(5));
            if start.elapsed() > PATIENCE {
                return Err(format!("the picture does not converge: {:?}", self.harness.state().message()));
            }
        }
        self.harness.run_steps(3);
        Ok(())
    }

    /// The usable widget with this label.
    fn usable<'a>(&'a self, label: &'a str) -> Result<Node<'a>, String> {
        let is_word = |node: &Node<'_>| matches!(node.accesskit_node().role(), Role::Label | Role::TextRun);
        let found = self.harness.query_all_by_label(label).find(|node| !is_word(node));
        found.ok_or_else(|| format!("nothing is called '{label}'"))
    }

    /// Clicks the widget with this label; scrolls its panel first if needed.
    fn click(&mut self, label: &str) -> Result<(), String> {
        let window = self.harness.ctx.content_rect().shrink(40.0);
        if !window.contains_rect(self.usable(label)?.rect()) {
            self.usable(label)?.scroll_to_me();
            self.harness.run_steps(10);
        }
        self.usable(label)?.click();
        self.rest()
    }

    /// Holds the mouse over the middle of a widget until the value under it is shown.
    fn point_at(&mut self, label: &str) -> Result<(), String> {
        let at = self.harness.get_by_label(label).rect().center();
        self.harness.hover_at(at + eframe::egui::vec2(40.0, 25.0));
        let start = Instant::now();
        while self.harness.state().sections().probed().is_none() {
            self.harness.step();
            if start.elapsed() > PATIENCE {
                return Err(format!("nothing is told of {label}"));
            }
        }
        Ok(())
    }

    fn draw(&mut self, name: &str) -> Result<(), String> {
        self.harness.run_steps(8);
        let path = self.folder.join(name);
        self.harness.render()?.save(&path).map_err(|e| format!("{}: {e}", path.display()))
    }
}

fn run() -> Result<(), String> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [carp, seismic, folder] = arguments.as_slice() else {
        return Err("expected: CARP.svol SEISMIC.svol FOLDER".into());
    };
    std::fs::create_dir_all(folder).map_err(|e| e.to_string())?;
    let mut artist = Artist::new(carp, folder, Theme::Dark, SIZE)?;
    artist.draw("window.png")?;
    artist.click("Iso")?;
    artist.draw("surfaces.png")?;
    let mut artist = Artist::new(carp, folder, Theme::Dark, SIZE)?;
    artist.click("work")?;
    artist.draw("work.png")?;
    let mut artist = Artist::new(seismic, folder, Theme::Light, SIZE)?;
    artist.click("Box, scale, colours")?;
    artist.draw("survey.png")?;
    artist.click("inline")?;
    artist.draw("slice.png")?;
    let mut artist = Artist::new(seismic, folder, Theme::Light, SMALLER)?;
    artist.click("Three panels")?;
    artist.point_at("Section inline")?;
    artist.draw("panels.png")
}

#[allow(clippy::print_stderr, reason = "why it failed")]
fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("guide_pictures: {message}");
            ExitCode::FAILURE
        }
    }
}
