//! The panels around the picture, and the picture itself. Panels only show the scene and change it.

pub(crate) mod animate;
mod browse;
mod cutting;
pub(crate) mod dialogs;
mod editor;
pub(crate) mod file_options;
mod handles;
mod marks;
pub(crate) mod picture;
pub(crate) mod properties;
mod reading;
mod sections;
mod slices;
pub(crate) mod status;
pub(crate) mod tools;
pub(crate) mod transfer;

use std::path::PathBuf;

use eframe::egui;
use supervol_format::coordinates::AxisScale;
use supervol_format::readable::Shortened;
use supervol_scene::scene::{IsoSpec, Mode, Scene, ShadingSpec, TransferFunctionSpec};
use supervol_scene::slices::SliceSpec;

pub(crate) use self::dialogs::Dialogs;
use crate::worker::OpenVolume;
use crate::{edit, planes};

/// State of the panels that is not part of the scene: the last look of each mode, and selections of the editors.
#[derive(Default)]
pub(crate) struct PanelState {
    left: Vec<(Mode, Look)>,
    /// Index of the selected control point in the editor.
    pub(crate) chosen: Option<usize>,
    /// Unit distance at density 1: that of the volume's first picture.
    pub(crate) unit_distance: Option<f64>,
    /// Last requested percentage of voxels that the window excludes at each end.
    pub(crate) clip_percent: f64,
    /// Last requested light position: degrees to the right of and above the viewer.
    pub(crate) light: [f64; 2],
    /// Index of the selected slice in the volume, which the wheel moves.
    pub(crate) held_slice: usize,
    /// Scrolled points that have not yet moved a slice by a step; `None`: the wheel moves the camera.
    pub(crate) wheel_points: Option<f64>,
    /// Whether handles are shown.
    pub(crate) are_handles_shown: bool,
    /// The dragged handle.
    pub(crate) held: Option<handles::DraggedHandle>,
    /// Slices in the volume, kept while a mode without depth is shown.
    kept_slices: Vec<SliceSpec>,
}

/// Look of a mode when the user left it.
#[derive(Clone)]
struct Look {
    transfer_function: Option<TransferFunctionSpec>,
    shading: Option<Option<ShadingSpec>>,
    iso: Vec<IsoSpec>,
    samples_per_pixel: Option<u32>,
}

impl PanelState {
    /// Initial state for an opened volume.
    pub(crate) fn of(scene: &Scene) -> Self {
        let unit_distance = edit::points(scene).and_then(|points| points.unit_distance);
        Self { unit_distance, clip_percent: 1.0, ..Self::default() }
    }

    /// The scene in another mode, with the mode's last look or its default look.
    pub(crate) fn switched(&mut self, scene: &Scene, opened: &OpenVolume, mode: Mode) -> Scene {
        let Scene { transfer_function, shading, iso, samples_per_pixel, .. } = scene.clone();
        let now = scene.mode.unwrap_or_default();
        self.left.retain(|(left, _)| *left != now);
        self.left.push((now, Look { transfer_function, shading, iso, samples_per_pixel }));
        self.chosen = None;
        let slices = slices::with_mode(&mut self.kept_slices, &opened.facts, (now, &scene.slices), mode);
        let scene = Scene { slices, ..scene.clone() };
        let mut shown = match self.left.iter().find(|(left, _)| *left == mode) {
            Some((_, look)) => {
                let Look { transfer_function, shading, iso, samples_per_pixel } = look.clone();
                Scene { mode: Some(mode), transfer_function, shading, iso, samples_per_pixel, ..scene }
            }
            None => Scene { slices: scene.slices.clone(), ..edit::with_mode(&scene, opened, mode) },
        };
        let alone = Scene { slices: Vec::new(), ..shown.clone() };
        planes::follow_slices(&alone, &mut shown, &opened.facts);
        shown
    }
}

/// Files that were dropped on the window.
pub(crate) fn dropped_files(ctx: &egui::Context) -> Vec<PathBuf> {
    ctx.input(|input| input.raw.dropped_files.iter().map(|file| file.path().into()).collect())
}

/// Width of a slider's number, in points.
const BESIDE_SLIDER: f32 = 70.0;

/// Makes the next sliders as wide as the panel.
fn wide_slider(ui: &mut egui::Ui) {
    ui.spacing_mut().slider_width = (ui.available_width() - BESIDE_SLIDER).max(40.0);
}

/// Slider of a voxel along an axis. It shows and reads the coordinate on the axis, such as an inline number; a typed
/// coordinate goes to the nearest voxel.
fn voxel_slider<'a, N: egui::emath::Numeric>(voxel: &'a mut N, scale: &'a AxisScale) -> egui::Slider<'a> {
    let last = scale.count.saturating_sub(1) as f64;
    egui::Slider::new(voxel, N::from_f64(0.0)..=N::from_f64(last))
        .clamping(egui::SliderClamping::Edits)
        .integer()
        .custom_formatter(|voxel, _| coordinate(scale, voxel))
        .custom_parser(|text| nearest_voxel(scale, text))
}

/// Voxel nearest to a typed coordinate; a name or a unit may stand beside the number.
fn nearest_voxel(scale: &AxisScale, text: &str) -> Option<f64> {
    let number = text.split_whitespace().find_map(|word| word.parse::<f64>().ok())?;
    let voxel = scale.index(number).round().clamp(0.0, scale.count.saturating_sub(1) as f64);
    voxel.is_finite().then_some(voxel)
}

/// Coordinate of a voxel as text.
fn coordinate(scale: &AxisScale, voxel: f64) -> String {
    Shortened::along(scale.place(voxel), scale.step).to_string()
}

/// First and last coordinate of an axis, in words.
fn extent_in_words(scale: &AxisScale) -> String {
    let [first, last] = [0.0, scale.count.saturating_sub(1) as f64].map(|voxel| coordinate(scale, voxel));
    format!("{} {first} to {last} {}", scale.name, scale.unit).trim_end().into()
}

/// Draws the content of a panel, with a scroll bar at its side if it does not fit.
fn scrolled(ui: &mut egui::Ui, add: impl FnOnce(&mut egui::Ui)) {
    ui.spacing_mut().scroll = egui::style::ScrollStyle::thin();
    egui::ScrollArea::vertical().auto_shrink(false).show(ui, add);
}

/// Draws a heading of a panel.
fn heading(ui: &mut egui::Ui, text: &str) {
    ui.add_space(6.0);
    ui.strong(text);
    ui.separator();
}

#[cfg(test)]
mod tests {
    use supervol_format::coordinates::ScaleKind;

    use super::*;

    #[test]
    fn typed_coordinates_go_to_the_nearest_voxel() {
        let inlines = AxisScale {
            axis: 1,
            name: "inline".into(),
            unit: String::new(),
            first: 10_087.0,
            step: 4.0,
            count: 18,
            kind: ScaleKind::Counted,
        };
        let typed = |text| nearest_voxel(&inlines, text);
        assert_eq!([typed("inline 10123"), typed("10124"), typed(" 10126 ")], [Some(9.0), Some(9.0), Some(10.0)]);
        assert_eq!([typed("1"), typed("99999"), typed("inline"), typed("nan")], [Some(0.0), Some(17.0), None, None]);
        assert_eq!(extent_in_words(&inlines), "inline 10087 to 10155");
        let axial = AxisScale { first: -47.7, step: 0.1, unit: "mm".into(), name: "z".into(), ..inlines };
        assert_eq!((coordinate(&axial, 3.0), nearest_voxel(&axial, "-47.4 mm")), ("-47.4".into(), Some(3.0)));
    }
}
