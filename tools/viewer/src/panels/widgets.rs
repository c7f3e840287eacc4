//! Controls that several panels and dialogs share.

use std::path::Path;

use eframe::egui::{self, TextEdit, Ui};
use supervol_format::coordinates::AxisScale;
use supervol_format::readable::Shortened;

/// Most pixels of an exported picture along a side.
pub(super) const SIDE_LIMIT: u32 = 32_768;

/// A window of a dialog.
pub(super) fn window<'a>(title: &'static str, is_open: &'a mut bool) -> egui::Window<'a> {
    egui::Window::new(title).open(is_open).collapsible(false).pivot(egui::Align2::CENTER_CENTER).default_width(460.0)
}

/// Draws a text field for a path or a name; `name` is its accessible name.
pub(super) fn path_field(ui: &mut Ui, path: &mut String, name: &str) {
    ui.add(TextEdit::singleline(path).desired_width(f32::INFINITY)).accessible_name(name);
}

/// Draws a check box for overwriting if the file exists. Returns whether the file may be written.
pub(super) fn may_write(ui: &mut Ui, path: &str, replace: &mut bool) -> bool {
    let exists = Path::new(path).exists();
    if exists {
        ui.checkbox(replace, "Overwrite the existing file");
    }
    !path.trim().is_empty() && (!exists || *replace)
}

/// Width of a slider's number, in points.
const BESIDE_SLIDER: f32 = 70.0;

/// Makes the next sliders as wide as the panel.
pub(super) fn wide_slider(ui: &mut egui::Ui) {
    ui.spacing_mut().slider_width = (ui.available_width() - BESIDE_SLIDER).max(40.0);
}

/// Slider of a voxel along an axis. It shows and reads the coordinate on the axis, such as an inline number; a typed
/// coordinate goes to the nearest voxel.
pub(super) fn voxel_slider<'a, N: egui::emath::Numeric>(voxel: &'a mut N, scale: &'a AxisScale) -> egui::Slider<'a> {
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
pub(super) fn coordinate(scale: &AxisScale, voxel: f64) -> String {
    Shortened::along(scale.place(voxel), scale.step).to_string()
}

/// First and last coordinate of an axis, in words.
pub(super) fn extent_in_words(scale: &AxisScale) -> String {
    let [first, last] = [0.0, scale.count.saturating_sub(1) as f64].map(|voxel| coordinate(scale, voxel));
    format!("{} {first} to {last} {}", scale.name, scale.unit).trim_end().into()
}

/// Draws the content of a panel, with a scroll bar at its side if it does not fit.
pub(super) fn scrolled(ui: &mut egui::Ui, add: impl FnOnce(&mut egui::Ui)) {
    ui.spacing_mut().scroll = egui::style::ScrollStyle::thin();
    egui::ScrollArea::vertical().auto_shrink(false).show(ui, add);
}

/// Draws a heading of a panel.
pub(super) fn heading(ui: &mut egui::Ui, text: &str) {
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
