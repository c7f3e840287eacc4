//! The desktop application behind `supervol view`: views, cuts, colours and exports a volume interactively.
//!
//! The viewer contains no rendering algorithm. It edits a [`Scene`](supervol::Scene), which the library's
//! [`Renderer`](supervol::Renderer) draws. Everything it can do is also possible with a scene
//! file and `supervol render`.
//!
//! ```text
//! mouse, keys, panels --> scene --> worker: Renderer --> picture, statistics --> window
//! ```
//!
//! - [`viewer`]: the application's state, and its changes by messages of the worker and by keys. Independent of a
//!   window.
//! - `frame`: one frame of the user interface. `panels/`: the panels around the picture, and dialogs.
//! - `state/`: state of panels and dialogs that is not part of the scene.
//! - `navigate`, `edit`, `planes`, `cutting`: effects of mouse, keys and panels on the scene.
//! - `sections`: content of the panels beside the picture.
//! - `cine`: slices one after the other.
//! - `history`: undo. `command`: the list of keys. `command_line`: the command that draws the picture.
//! - `preview`: from a preview to the volume.
//! - [`worker`]: the thread that opens, builds, draws and exports.
//! - `background_task`: short tasks on a thread of their own (listing folders, small files).
//! - `folders`, `saved_settings`: cache folder and settings that persist between sessions.
//! - [`launch`]: options at the start. This file: the window.

#![cfg_attr(
    test,
    allow(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_sign_loss,
        reason = "tests use small numbers"
    )
)]

mod background_task;
pub mod cine;
pub mod command;
mod command_line;
pub mod cutting;
pub mod edit;
pub mod folders;
mod frame;
pub mod history;
pub mod launch;
pub mod navigate;
mod panels;
pub mod planes;
mod preview;
pub mod saved_settings;
pub mod sections;
mod state;
pub mod viewer;
pub mod worker;

use crate::launch::Launch;
use crate::saved_settings::SavedSettings;
use crate::viewer::Viewer;
use eframe::egui;
use eframe::egui_wgpu::{WgpuConfiguration, WgpuSetup, WgpuSetupCreateNew};

/// Initial size of the window, in points.
const WINDOW: [f32; 2] = [1280.0, 800.0];
/// Least size of the window at which all panels are usable, in points.
const LEAST_WINDOW: [f32; 2] = [800.0, 500.0];

/// Reason why there is no window.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum ViewerError {
    #[error(
        "cannot open a window: {0}\n\
         The viewer needs a desktop (X11 or Wayland), named by DISPLAY or WAYLAND_DISPLAY. On Debian and Ubuntu, install its \
         libraries: apt install libxkbcommon-x11-0 libxcursor1 libxi6 libxrandr2 libwayland-client0. Without a desktop, use \
         `supervol render`: it draws the same pictures"
    )]
    Window(String),
    #[error(
        "cannot draw in the window: {0}\n\
         The viewer needs a Vulkan driver; a software driver suffices. On Debian and Ubuntu: apt install \
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

/// Opens the window and returns when it is closed.
///
/// # Errors
/// If there is no desktop or no graphics device.
pub fn run(launch: Launch) -> Result<(), ViewerError> {
    let saved = SavedSettings::read(&launch.folders);
    let viewport = egui::ViewportBuilder::default()
        .with_title("Supervol")
        .with_app_id("supervol")
        .with_inner_size(saved.window.unwrap_or(WINDOW))
        .with_min_inner_size(LEAST_WINDOW);
    let options = eframe::NativeOptions {
        viewport,
        // Pictures are shown without changes.
        dithering: false,
        wgpu_options: wgpu_options(),
        ..eframe::NativeOptions::default()
    };
    // winit panics if a library that it loads at run time is missing, for example X11's keyboard library.
    let opened = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        eframe::run_native("supervol", options, Box::new(|_| Ok(Box::new(Window(Viewer::new(launch, saved))))))
    }));
    match opened {
        Ok(result) => Ok(result?),
        Err(panic) => {
            let message = panic.downcast_ref::<String>().cloned();
            let message = message.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()));
            Err(ViewerError::Window(message.unwrap_or_else(|| "the libraries of the desktop failed".into())))
        }
    }
}

/// Vulkan only, as in the runtime. Any adapter suffices, because it only shows finished pictures.
fn wgpu_options() -> WgpuConfiguration {
    let mut setup = WgpuSetupCreateNew::without_display_handle();
    setup.instance_descriptor.backends = eframe::wgpu::Backends::PRIMARY;
    WgpuConfiguration { wgpu_setup: WgpuSetup::CreateNew(setup), ..WgpuConfiguration::default() }
}

/// The viewer as an eframe application.
struct Window(Viewer);

impl eframe::App for Window {
    fn ui(&mut self, ui: &mut egui::Ui, _: &mut eframe::Frame) {
        self.0.ui(ui);
    }

    fn on_exit(&mut self) {
        self.0.save_settings();
    }
}
