//! The left panel: files, camera, clipping.

use eframe::egui::{self, Button, Slider, SliderClamping, Ui};
use supervol_scene::preset::view::Direction;

use super::widgets::{extent_in_words, heading, scrolled, voxel_slider, wide_slider};
use crate::command::{Command, keys_of};
use crate::edit;
use crate::planes::axis_name;
use crate::saved_settings::Theme;
use crate::state::file_options::FileOptions;
use crate::viewer::{Viewer, set_theme};
use crate::worker::Decorations;

/// Default width of the panel, in points.
const WIDTH: f32 = 208.0;
/// Least and greatest vertical exaggeration.
const EXAGGERATIONS: std::ops::RangeInclusive<f64> = 0.1..=50.0;

/// Draws the panel.
pub(crate) fn show(viewer: &mut Viewer, ui: &mut Ui) {
    egui::Panel::left("tools").default_size(WIDTH).size_range(150.0..=400.0).show(ui, |ui| {
        scrolled(ui, |ui| {
            files(viewer, ui);
            let is_open = viewer.opened.is_some();
            ui.add_enabled_ui(is_open, |ui| {
                view(viewer, ui);
                slice(viewer, ui);
                super::sections::controls(viewer, ui);
                super::slices::show(viewer, ui);
                crop(viewer, ui);
                super::cutting::controls(viewer, ui);
            });
            heading(ui, "Window");
            theme(viewer, ui);
            command(viewer, ui, Command::Help, "Keys and mouse");
        });
    });
}

/// Draws a button of a command, with its description and keys as a tooltip.
fn command(viewer: &mut Viewer, ui: &mut Ui, command: Command, label: &str) {
    let words = crate::command::BINDINGS.iter().find(|b| b.command == command).map_or("", |b| b.words);
    let tip = format!("{words} ({})", keys_of(ui.ctx(), command));
    let width = ui.available_width();
    if ui.add(Button::new(label).min_size(egui::vec2(width, 0.0))).on_hover_text(tip).clicked() {
        let ctx = ui.ctx().clone();
        viewer.run(&ctx, command);
    }
}

fn files(viewer: &mut Viewer, ui: &mut Ui) {
    heading(ui, "File");
    command(viewer, ui, Command::Open, "Open ...");
    let recent = viewer.saved.recent.clone();
    ui.add_enabled_ui(!recent.is_empty(), |ui| {
        ui.menu_button("Recent files", |ui| {
            for path in &recent {
                let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
                if ui.button(name).on_hover_text(path.display().to_string()).clicked() {
                    viewer.open(path);
                    ui.close();
                }
            }
        });
    });
    let is_file = |opened: &std::sync::Arc<crate::worker::OpenVolume>| opened.source != opened.path;
    if let Some(opened) = viewer.opened.clone().filter(is_file) {
        let words = "Reads the file again with options: another series, dataset, byte, axis, time or depth";
        if ui.button("File options ...").on_hover_text(words).clicked() {
            viewer.dialogs.file_options = Some(FileOptions::opened(&opened));
        }
    }
    let is_open = viewer.opened.is_some();
    ui.add_enabled_ui(is_open, |ui| {
        command(viewer, ui, Command::SaveScene, "Save scene ...");
        command(viewer, ui, Command::CopyCommand, "Copy command");
        command(viewer, ui, Command::Export, "Export picture ...");
        command(viewer, ui, Command::Animate, "Animation ...");
        let can = viewer.history.can();
        ui.columns(2, |columns| {
            for (i, (what, label)) in [(Command::Undo, "Undo"), (Command::Redo, "Redo")].into_iter().enumerate() {
                columns[i].add_enabled_ui(can[i], |ui| command(viewer, ui, what, label));
            }
        });
    });
}

fn view(viewer: &mut Viewer, ui: &mut Ui) {
    heading(ui, "View");
    command(viewer, ui, Command::DefaultView, "Default view");
    let sides = [
        [(Direction::Front, "Front"), (Direction::Back, "Back")],
        [(Direction::Left, "Left"), (Direction::Right, "Right")],
        [(Direction::Top, "Top"), (Direction::Bottom, "Bottom")],
    ];
    for pair in sides {
        ui.columns(2, |columns| {
            for (column, (direction, label)) in columns.iter_mut().zip(pair) {
                command(viewer, column, Command::ViewFrom(direction), label);
            }
        });
    }
    let is_parallel = viewer.scene.camera.as_ref().is_some_and(|camera| camera.height.is_some());
    command(viewer, ui, Command::Projection, if is_parallel { "Parallel rays" } else { "Perspective" });
    let mut are_on = viewer.settings.decorations == Decorations::On;
    let words = "Draws box with axes, orientation, scale, colour legend and name (--decorate)";
    if ui.checkbox(&mut are_on, "Box, scale, colours").on_hover_text(words).changed() {
        viewer.settings.decorations = if are_on { Decorations::On } else { Decorations::Off };
        viewer.saved.decorations = viewer.settings.decorations;
    }
    if viewer.opened.is_some() && viewer.scene.camera.is_none() {
        ui.small(
            "The world coordinates of this volume are too coarse for a camera. It is shown from its default side.",
        );
    }
    ui.label("Vertical exaggeration");
    let mut factor = viewer.exaggeration;
    let slider = Slider::new(&mut factor, EXAGGERATIONS)
        .clamping(SliderClamping::Edits)
        .logarithmic(true)
        .max_decimals(2)
        .suffix(" x");
    let response = ui.add(slider).on_hover_text("Factor for heights or depths");
    let response = response.accessible_name("Vertical exaggeration");
    // Reopening the volume is expensive: only at the end of a drag.
    if response.changed() && !response.dragged() || response.drag_stopped() {
        viewer.set_exaggeration(factor);
    } else {
        viewer.exaggeration = factor;
    }
}

fn slice(viewer: &mut Viewer, ui: &mut Ui) {
    heading(ui, "Slice");
    let Some(opened) = viewer.opened.clone() else { return };
    let mut chosen = viewer.slice.as_ref().map(|slice| slice.axis);
    ui.horizontal_wrapped(|ui| {
        ui.selectable_value(&mut chosen, None, "None").on_hover_text("Shows the whole volume again");
        for axis in 0..3 {
            let name = axis_name(&opened, axis);
            let words = format!("Shows one slice across {name}, face on (--slice)");
            let _ = ui.selectable_value(&mut chosen, Some(axis), name).on_hover_text(words);
        }
    });
    if chosen != viewer.slice.as_ref().map(|slice| slice.axis) {
        viewer.set_slice(chosen.map(|axis| (axis, opened.facts().dims.0[axis] / 2)));
    }
    if let Some((axis, mut at)) = viewer.slice.as_ref().map(|slice| (slice.axis, slice.at)) {
        wide_slider(ui);
        let scale = &opened.coordinates.axes()[axis];
        let words = format!("Place of the slice: {}", extent_in_words(scale));
        let response = ui.add(voxel_slider(&mut at, scale)).on_hover_text(words);
        if response.accessible_name("Place of the slice").changed() {
            viewer.set_slice(Some((axis, at)));
        }
        ui.horizontal(|ui| super::reading::cine_button(viewer, ui));
    }
}

fn crop(viewer: &mut Viewer, ui: &mut Ui) {
    heading(ui, "Crop");
    let Some(opened) = viewer.opened.clone().filter(|_| viewer.slice.is_none()) else {
        ui.weak("Not available while a slice is shown; its crop is that of the volume.");
        return;
    };
    let dims = opened.facts().dims.0;
    let before = edit::kept_voxels(&viewer.scene, opened.facts());
    let mut kept = before;
    for axis in 0..3 {
        let name = axis_name(&opened, axis);
        let last = dims[axis] - 1;
        ui.label(&name).on_hover_text(format!("{name}: {} voxels, 0 to {last}", dims[axis]));
        for (end, what) in [(0, "first"), (1, "last")] {
            wide_slider(ui);
            let scale = &opened.coordinates.axes()[axis];
            ui.add(voxel_slider(&mut kept[axis][end], scale))
                .on_hover_text(format!("The {what} visible voxel: {}", extent_in_words(scale)))
                .accessible_name(format!("{name}, {what} voxel"));
        }
        let [first, end] = kept[axis];
        // A moved end that passes the other end takes it along.
        kept[axis] = if first <= end {
            kept[axis]
        } else if kept[axis][0] != before[axis][0] {
            [first, first]
        } else {
            [end, end]
        };
    }
    if kept != before {
        edit::keep_voxels(&mut viewer.scene, opened.facts(), kept);
    }
    if ui.add_enabled(viewer.scene.clip.index_box.is_some(), Button::new("Show all")).clicked() {
        viewer.scene.clip.index_box = None;
    }
}

fn theme(viewer: &mut Viewer, ui: &mut Ui) {
    ui.horizontal(|ui| {
        for (theme, label) in [(Theme::System, "System"), (Theme::Light, "Light"), (Theme::Dark, "Dark")] {
            if ui.selectable_value(&mut viewer.saved.theme, theme, label).changed() {
                set_theme(ui.ctx(), theme);
            }
        }
    });
}
