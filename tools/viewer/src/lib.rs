//! The desktop application behind `supervol view`: a volume is turned, cut, coloured and exported by hand.
//!
//! It owns no algorithm. What it shows is a [`Scene`] that it edits, drawn by the runtime's
//! [`Renderer`](supervol_runtime::render::renderer::Renderer); a scene file and `supervol render` can do all that it can do.
//!
//! ```text
//! mouse, keys, panels --> scene --> worker: Renderer --> picture, statistics --> window
//! ```
//!
//! - [`viewer`]: one frame of the window: news of the worker, keys, panels, the picture; knows nothing of windows;
//! - `panels/`: what stands around the picture; `navigate`, `edit`, `planes`, `cutting`: what mouse, keys and panels do to the
//!   scene; `sections`:
//!   what panels beside the picture show; `history`: undo;
//!   `command`: the list of keys;
//! - [`worker`]: the thread that opens, builds, draws and exports;
//! - `errand`: what is read and written beside it; `folders`, `remembered`: the cache folder, and what is remembered from one time to the next;
//! - this file: the window.

pub mod command;
pub mod cutting;
pub mod edit;
mod errand;
pub mod folders;
pub mod history;
pub mod navigate;
mod panels;
pub mod planes;
mod preview;
pub mod remembered;
pub mod sections;
pub mod viewer;
pub mod worker;

use std::path::PathBuf;

use eframe::egui;
use eframe::egui_wgpu::{WgpuConfiguration, WgpuSetup, WgpuSetupCreateNew};
use supervol_preprocess::kept::Reading;
use supervol_scene::scene::Scene;

use crate::folders::Folders;
use crate::remembered::Remembered;
use crate::viewer::Viewer;
use crate::worker::Settings;

/// Points of a window that is opened for the first time.
const WINDOW: [f32; 2] = [1280.0, 800.0];
/// Least points of a window in which all panels can be used.
const LEAST_WINDOW: [f32; 2] = [800.0, 500.0];

/// What is shown first.
#[derive(Debug, Clone, Default)]
pub struct Launch {
    /// Container or source file; `None`: the window asks for one.
    pub file: Option<PathBuf>,
    /// What this file does not say about itself, where it is no container.
    pub reading: Reading,
    /// What the scene says; the rest is chosen to suit the data.
    pub scene: Scene,
    /// With what pictures are made.
    pub settings: Settings,
    /// Where things are kept.
    pub folders: Folders,
}

/// Why there is no window.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum ViewerError {
    #[error(
        "no window can be opened: {0}\n\
         A desktop (X11 or Wayland) must be running, and DISPLAY or WAYLAND_DISPLAY must name it. On Debian and Ubuntu, install what \
         windows need: apt install libxkbcommon-x11-0 libxcursor1 libxi6 libxrandr2 libwayland-client0. Without a desktop, \
         `supervol render` draws the same pictures"
    )]
    Window(String),
    #[error(
        "the window has nothing to draw with: {0}\n\
         A Vulkan driver is needed; one that needs no graphics card will do. On Debian and Ubuntu: apt install \
         mesa-vulkan-drivers libvulkan1. On Fedora: dnf install mesa-vulkan-drivers vulkan-loader"
    )]
    Graphics(String),
}

impl From<eframe::Error> for ViewerError {
    fn from(error: eframe::Error) -> Self {
        match error {
            eframe::Error::Wgpu(error) => Self::Graphics(error.to_string()),
            other => Self::Window(other.to_string()),
        }
    }
}

/// Opens the window, and returns when it is closed.
///
/// # Errors
/// If there is no desktop, or nothing to draw with.
pub fn run(launch: Launch) -> Result<(), ViewerError> {
    let remembered = Remembered::read(&launch.folders);
    let viewport = egui::ViewportBuilder::default()
        .with_title("Supervol")
        .with_app_id("supervol")
        .with_inner_size(remembered.window.unwrap_or(WINDOW))
        .with_min_inner_size(LEAST_WINDOW);
    let options = eframe::NativeOptions {
        viewport,
        // Pictures are shown as they are.
        dithering: false,
        wgpu_options: wgpu_options(),
        ..eframe::NativeOptions::default()
    };
    // winit panics where a library is missing that it loads at run time: X11's keyboard, for one.
    let opened = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        eframe::run_native("supervol", options, Box::new(|_| Ok(Box::new(Window(Viewer::new(launch, remembered))))))
    }));
    match opened {
        Ok(result) => Ok(result?),
        Err(panic) => {
            let message = panic.downcast_ref::<String>().cloned();
            let message = message.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
            Err(ViewerError::Window(message.unwrap_or_else(|| "the desktop's libraries cannot be used".into())))
        }
    }
}

/// Vulkan alone, as in the runtime; any adapter will do, since it only puts finished pictures on the screen.
fn wgpu_options() -> WgpuConfiguration {
    let mut setup = WgpuSetupCreateNew::without_display_handle();
    setup.instance_descriptor.backends = eframe::wgpu::Backends::PRIMARY;
    WgpuConfiguration { wgpu_setup: WgpuSetup::CreateNew(setup), ..WgpuConfiguration::default() }
}

/// The viewer in a window of its own.
struct Window(Viewer);

impl eframe::App for Window {
    fn ui(&mut self, ui: &mut egui::Ui, _: &mut eframe::Frame) {
        self.0.ui(ui);
    }

    fn on_exit(&mut self) {
        self.0.remember();
    }
}
