//! What stands around the picture, and the picture itself. Panels show the scene and change it; nothing else.

pub(crate) mod animate;
mod browse;
mod cutting;
pub(crate) mod dialogs;
mod editor;
mod handles;
mod marks;
pub(crate) mod picture;
pub(crate) mod properties;
mod sections;
mod slices;
pub(crate) mod status;
pub(crate) mod tools;
pub(crate) mod transfer;

use std::path::PathBuf;

use eframe::egui;
use supervol_scene::scene::{IsoSpec, Mode, Scene, ShadingSpec, TransferFunctionSpec};
use supervol_scene::slices::SliceSpec;

pub(crate) use self::dialogs::Dialogs;
use crate::edit;
use crate::worker::Opened;

/// What the panels remember of looks: the one that each mode was left with, and what the editor has in its hand.
#[derive(Default)]
pub(crate) struct Looks {
    left: Vec<(Mode, Look)>,
    /// The control point that is chosen in the editor.
    pub(crate) chosen: Option<usize>,
    /// The unit distance that density 1 stands for: that of the picture the volume began with.
    pub(crate) unit_distance: Option<f64>,
    /// Percentage of the voxels at each end that the window leaves out, as it was asked for last.
    pub(crate) clip_percent: f64,
    /// Where light comes from: degrees to the right of and above the viewer, as it was asked for last.
    pub(crate) light: [f64; 2],
    /// The slice in the volume that the wheel moves: its place in the scene.
    pub(crate) held_slice: usize,
    /// Points of the wheel that have moved no slice yet; `None`: the wheel moves the camera.
    pub(crate) wheel_points: Option<f64>,
    /// Handles of what cuts the volume are shown.
    pub(crate) are_handles_shown: bool,
    /// The one that is dragged.
    pub(crate) held: Option<handles::Held>,
    /// Slices of the modes that draw them at their depth, while another one is shown.
    kept_slices: Vec<SliceSpec>,
}

/// What a mode was left with.
#[derive(Clone)]
struct Look {
    transfer_function: Option<TransferFunctionSpec>,
    shading: Option<Option<ShadingSpec>>,
    iso: Vec<IsoSpec>,
    samples_per_pixel: Option<u32>,
}

impl Looks {
    /// Of a volume that is shown for the first time.
    pub(crate) fn of(scene: &Scene) -> Self {
        let unit_distance = edit::points(scene).and_then(|points| points.unit_distance);
        Self { unit_distance, clip_percent: 1.0, ..Self::default() }
    }

    /// The scene in another mode: as that was left, or as it usually is.
    pub(crate) fn switched(&mut self, scene: &Scene, opened: &Opened, mode: Mode) -> Scene {
        let Scene { transfer_function, shading, iso, samples_per_pixel, .. } = scene.clone();
        let now = scene.mode.unwrap_or_default();
        self.left.retain(|(left, _)| *left != now);
        self.left.push((now, Look { transfer_function, shading, iso, samples_per_pixel }));
        self.chosen = None;
        let slices = slices::with_mode(&mut self.kept_slices, now, &scene.slices, mode);
        let scene = Scene { slices, ..scene.clone() };
        match self.left.iter().find(|(left, _)| *left == mode) {
            Some((_, look)) => {
                let Look { transfer_function, shading, iso, samples_per_pixel } = look.clone();
                Scene { mode: Some(mode), transfer_function, shading, iso, samples_per_pixel, ..scene }
            }
            None => Scene { slices: scene.slices.clone(), ..edit::with_mode(&scene, opened, mode) },
        }
    }
}

/// Files that were dropped on the window.
pub(crate) fn dropped_files(ctx: &egui::Context) -> Vec<PathBuf> {
    ctx.input(|input| input.raw.dropped_files.iter().map(|file| file.path().into()).collect())
}

/// Points that stand beside a slider: its number.
const BESIDE_SLIDER: f32 = 70.0;

/// The next sliders are as wide as there is room.
fn wide_slider(ui: &mut egui::Ui) {
    ui.spacing_mut().slider_width = (ui.available_width() - BESIDE_SLIDER).max(40.0);
}

/// What a panel holds, with a bar beside it (not above it) where there is more than fits.
fn scrolled(ui: &mut egui::Ui, add: impl FnOnce(&mut egui::Ui)) {
    ui.spacing_mut().scroll = egui::style::ScrollStyle::thin();
    egui::ScrollArea::vertical().auto_shrink(false).show(ui, add);
}

/// A heading of a panel.
fn heading(ui: &mut egui::Ui, text: &str) {
    ui.add_space(6.0);
    ui.strong(text);
    ui.separator();
}
