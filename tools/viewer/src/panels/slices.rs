//! Controls of slices in the volume: adding, moving, turning, filtering, removing.

use eframe::egui::{Button, ComboBox, DragValue, Slider, SliderClamping, Ui};
use supervol_scene::preset::colormap;
use supervol_scene::slices::filter::{FilterKind, FilterSpec};
use supervol_scene::slices::{Interpolation, SLICE_LIMIT, SliceSpec};

use super::widgets::{extent_in_words, heading, voxel_slider, wide_slider};
use crate::planes::{self, Place};
use crate::viewer::Viewer;
use crate::worker::{Message, OpenVolume};

/// Interpolations with names for the user.
const INTERPOLATIONS: [(Interpolation, &str); 3] =
    [(Interpolation::Nearest, "nearest"), (Interpolation::Linear, "linear"), (Interpolation::Cubic, "cubic")];

/// Draws the controls.
pub(super) fn show(viewer: &mut Viewer, ui: &mut Ui) {
    heading(ui, "Slices in the volume");
    let Some(opened) = viewer.opened.clone().filter(|_| viewer.slice.is_none()) else {
        ui.weak("Not available while one slice is shown face on.");
        return;
    };
    let is_possible = planes::has_depth(viewer.scene.mode.unwrap_or_default());
    if !is_possible {
        ui.weak("Projections have no depth. Choose Volume, Iso or Slices only.");
    }
    let has_room = viewer.scene.slices.len() < SLICE_LIMIT;
    ui.add_enabled_ui(is_possible && has_room, |ui| ui.horizontal_wrapped(|ui| adders(viewer, &opened, ui)));
    let mut removed = None;
    let may_remove = planes::may_remove(&viewer.scene);
    let mut scene = std::mem::take(&mut viewer.scene);
    for (i, slice) in scene.slices.iter_mut().enumerate() {
        let number = i + 1;
        ui.push_id(("slice", i), |ui| {
            ui.separator();
            ui.horizontal(|ui| {
                let what = planes::place_of(slice, opened.facts()).axis;
                let what = what.map_or("oblique".into(), |axis| planes::axis_name(&opened, axis));
                let words = "Selects this slice: Alt and the wheel over the picture move it";
                ui.radio_value(&mut viewer.panel_state.held_slice, i, format!("{number}: {what}")).on_hover_text(words);
                let button = ui.add_enabled(may_remove, Button::new("x").small()).on_hover_text("Removes this slice");
                let button = button.on_disabled_hover_text("Slices only: the last slice stays");
                if button.accessible_name(format!("Slice {number}, remove")).clicked() {
                    removed = Some(i);
                }
            });
            place(slice, &opened, number, ui);
            wide_slider(ui);
            ui.add(Slider::new(&mut slice.opacity, 0.0..=1.0).clamping(SliderClamping::Edits).max_decimals(2))
                .on_hover_text("Opacity, 0 to 1; 1 hides everything behind the slice")
                .accessible_name(format!("Slice {number}, opacity"));
            let name = format!("Slice {number}");
            interpolation(slice, &name, ui);
            filter(slice, &opened, &name, ui);
        });
    }
    viewer.scene = scene;
    if let Some(i) = removed {
        planes::remove(&mut viewer.scene, opened.facts(), i);
        viewer.panel_state.held_slice = viewer.panel_state.held_slice.min(viewer.scene.slices.len().saturating_sub(1));
    }
}

fn adders(viewer: &mut Viewer, opened: &OpenVolume, ui: &mut Ui) {
    for axis in [Some(0), Some(1), Some(2), None] {
        let name = axis.map_or("oblique".into(), |axis| planes::axis_name(opened, axis));
        let words = match axis {
            Some(_) => format!("Adds a slice across {name} (--slices volume)"),
            None => "Adds a slice in any direction".into(),
        };
        if ui.button(format!("+ {name}")).on_hover_text(words).clicked() {
            match planes::add(&mut viewer.scene, opened.facts(), axis) {
                Ok(()) => viewer.panel_state.held_slice = viewer.scene.slices.len() - 1,
                Err(why) => viewer.message = Some(Message::Failure(why)),
            }
        }
    }
}

fn place(slice: &mut SliceSpec, opened: &OpenVolume, number: usize, ui: &mut Ui) {
    let Place { axis, mut at, range: [least, most], .. } = planes::place_of(slice, opened.facts());
    wide_slider(ui);
    let (slider, words) = match axis {
        Some(axis) => {
            let scale = &opened.coordinates.axes()[axis];
            (voxel_slider(&mut at, scale), format!("Place of the slice: {}", extent_in_words(scale)))
        }
        None => (
            Slider::new(&mut at, least..=most).clamping(SliderClamping::Edits).max_decimals(2),
            "World length along the normal from the volume's middle".into(),
        ),
    };
    if ui.add(slider).on_hover_text(words).accessible_name(format!("Slice {number}, place")).changed() {
        planes::move_to(slice, opened.facts(), at);
    }
    if axis.is_some() {
        return;
    }
    let mut normal = slice.normal;
    ui.label("normal");
    ui.horizontal(|ui| {
        for (component, name) in normal.iter_mut().zip(["x", "y", "z"]) {
            let words = format!("Component of the normal along world {name}; the length of the normal does not matter");
            ui.add(DragValue::new(component).speed(0.01).max_decimals(3))
                .on_hover_text(words)
                .accessible_name(format!("Slice {number}, normal {name}"));
        }
    });
    if normal != slice.normal {
        planes::turn(slice, opened.facts(), normal);
    }
}

/// Draws the choice of interpolation; `what` names the slice for accessibility.
pub(super) fn interpolation(slice: &mut SliceSpec, what: &str, ui: &mut Ui) {
    ui.horizontal(|ui| {
        ui.label("between");
        let name = INTERPOLATIONS.iter().find(|(how, _)| *how == slice.interpolation).map_or("", |(_, name)| name);
        let box_ = ComboBox::from_id_salt("interpolation").width(70.0).selected_text(name).show_ui(ui, |ui| {
            INTERPOLATIONS
                .into_iter()
                .find(|(how, name)| ui.selectable_label(*how == slice.interpolation, *name).clicked())
        });
        box_.response
            .on_hover_text("Interpolation between voxels (--interpolation)")
            .accessible_name(format!("{what}, interpolation"));
        if let Some((how, _)) = box_.inner.flatten() {
            slice.interpolation = how;
        }
    });
}

/// Draws filter and colours; `what` names the slice for accessibility.
pub(super) fn filter(slice: &mut SliceSpec, opened: &OpenVolume, what: &str, ui: &mut Ui) {
    let now = slice.filter.map(|filter| filter.kind);
    let named = |kind: Option<FilterKind>| {
        FilterKind::NAMES.iter().find(|(_, known)| Some(*known) == kind).map_or("none", |(name, _)| name)
    };
    ui.horizontal(|ui| {
        ui.label("filter");
        let box_ = ComboBox::from_id_salt("filter").width(70.0).selected_text(named(now)).show_ui(ui, |ui| {
            let kinds = std::iter::once(None).chain(FilterKind::NAMES.map(|(_, kind)| Some(kind)));
            kinds.into_iter().find(|kind| ui.selectable_label(*kind == now, named(*kind)).clicked())
        });
        box_.response
            .on_hover_text("Image filter on the values of the slice (--filter)")
            .accessible_name(format!("{what}, filter"));
        if let Some(kind) = box_.inner.flatten() {
            slice.filter = kind.map(|kind| FilterSpec { kind, size: kind.sizes().map(|[least, _]| least.max(1.0)) });
            // Colours belong to values; values of edge and slope filters have another meaning.
            if kind.is_some_and(|kind| !kind.keeps_values()) {
                slice.colors.clear();
            }
        }
        if let Some(FilterSpec { kind, size: Some(size) }) = &mut slice.filter
            && let Some([least, most]) = kind.sizes()
        {
            ui.add(DragValue::new(size).speed(0.05).range(least..=most).clamp_existing_to_range(false).max_decimals(1))
                .on_hover_text("Size of the filter in voxels")
                .accessible_name(format!("{what}, size of the filter"));
        }
    });
    if slice.filter.is_none_or(|filter| filter.kind.keeps_values()) {
        ui.horizontal(|ui| colors(slice, opened, what, ui));
    }
}

fn colors(slice: &mut SliceSpec, opened: &OpenVolume, what: &str, ui: &mut Ui) {
    ui.label("colours");
    let box_ = ComboBox::from_id_salt("colours")
        .width(70.0)
        .selected_text("choose")
        .show_ui(ui, |ui| colormap::NAMES.into_iter().find(|name| ui.selectable_label(false, *name).clicked()));
    box_.response
        .on_hover_text("Colour map of the slice, over its range of values")
        .accessible_name(format!("{what}, colours"));
    if let Some(name) = box_.inner.flatten() {
        planes::paint(slice, opened.facts(), name);
    }
}
