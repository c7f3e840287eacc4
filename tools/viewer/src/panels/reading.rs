//! Controls for reading sections: window and level, gamma, slab, cine.

use eframe::egui::{Button, ComboBox, DragValue, Slider, SliderClamping, Ui};
use supervol_scene::preset::windows::{self, NamedWindow};
use supervol_scene::scene::section::{Slab, SlabMode};

use super::widgets::wide_slider;
use crate::cine;
use crate::planes::axis_name;
use crate::viewer::Viewer;
use crate::worker::{OpenVolume, PANELS};

/// Named windows with names for the user.
const WINDOWS: [(NamedWindow, &str); 4] = [
    (NamedWindow::Bone, "Bone"),
    (NamedWindow::Lung, "Lung"),
    (NamedWindow::SoftTissue, "Soft tissue"),
    (NamedWindow::Brain, "Brain"),
];
/// Quantities of a slab with names for the user.
const SLABS: [(SlabMode, &str); 3] = [(SlabMode::Mean, "mean"), (SlabMode::Max, "maximum"), (SlabMode::Min, "minimum")];

/// Draws the controls of the panels.
pub(super) fn controls(viewer: &mut Viewer, opened: &OpenVolume, ui: &mut Ui) {
    if viewer.sections.has_window(opened.facts()) {
        window(viewer, opened, ui);
    }
    if viewer.sections.shows_slabs(opened.facts()) {
        slab(viewer, ui);
    }
    ui.horizontal_wrapped(|ui| {
        cine_button(viewer, ui);
        for axis in 0..PANELS {
            if viewer.sections.layout.shows(axis) {
                let name = axis_name(opened, axis);
                let words = format!("The cine moves along {name}");
                let _ = ui.selectable_value(&mut viewer.cine.axis, axis, name).on_hover_text(words);
            }
        }
    });
}

fn window(viewer: &mut Viewer, opened: &OpenVolume, ui: &mut Ui) {
    let (sections, facts) = (&mut viewer.sections, opened.facts());
    let Some(now) = sections.window(facts) else { return };
    let speed = (facts.central_range.width() / 500.0).max(f64::MIN_POSITIVE);
    let [level, width] = windows::level_and_width(now);
    let mut numbers = [level, width];
    ui.horizontal_wrapped(|ui| {
        for (number, name) in numbers.iter_mut().zip(["Level", "Width"]) {
            ui.label(name);
            ui.add(DragValue::new(number).speed(speed).max_decimals(3))
                .on_hover_text(format!("{name} of the window of values (--window level=LEVEL,width=WIDTH)"))
                .accessible_name(format!("Panels, {}", name.to_lowercase()));
        }
    });
    if numbers != [level, width] {
        sections.set_window(Some(windows::window_of(numbers)), facts);
    }
    ui.horizontal_wrapped(|ui| {
        for (named, name) in WINDOWS {
            let Some(range) = named.range(facts) else { continue };
            let [level, width] = named.level_and_width();
            let words = format!("Level {level}, width {width} Hounsfield units (--window)");
            if ui.small_button(name).on_hover_text(words).clicked() {
                sections.set_window(Some(range), facts);
            }
        }
        if ui.small_button("Default window").on_hover_text("The window of the first picture, gamma 1").clicked() {
            sections.set_window(None, facts);
            sections.gamma = 1.0;
        }
    });
    ui.checkbox(&mut sections.drag_sets_window, "Drag sets the window").on_hover_text(
        "A drag in a panel to the right widens the window, a drag up lowers its level. Without this, Ctrl and a drag do",
    );
    ui.label("Gamma");
    wide_slider(ui);
    let [least, most] = windows::GAMMAS;

    let slider = Slider::new(&mut sections.gamma, least..=most).clamping(SliderClamping::Always);
    ui.add(slider.logarithmic(true).max_decimals(2))
        .on_hover_text("Below 1 brightens a grey picture (--gamma)")
        .accessible_name("Panels, gamma");
}

fn slab(viewer: &mut Viewer, ui: &mut Ui) {
    let Slab { mut thickness, mut mode } =
        viewer.sections.slab.unwrap_or(Slab { thickness: 1.0, mode: SlabMode::Mean });
    let mut is_slab = viewer.sections.slab.is_some();
    ui.horizontal_wrapped(|ui| {
        ui.checkbox(&mut is_slab, "Slab").on_hover_text("Shows a layer around each section (--slab, --slab-mode)");
        if !is_slab {
            return;
        }
        ui.add(DragValue::new(&mut thickness).speed(0.1).range(1.0..=10_000.0).suffix(" voxels").max_decimals(1))
            .on_hover_text("Thickness of the layer")
            .accessible_name("Panels, thickness of the slab");
        let name = SLABS.iter().find(|(known, _)| *known == mode).map_or("", |(_, name)| name);
        let box_ = ComboBox::from_id_salt("slab").width(60.0).selected_text(name).show_ui(ui, |ui| {
            SLABS.into_iter().find(|(known, name)| ui.selectable_label(*known == mode, *name).clicked())
        });
        box_.response.on_hover_text("Quantity that the layer shows").accessible_name("Panels, quantity of the slab");
        if let Some((chosen, _)) = box_.inner.flatten() {
            mode = chosen;
        }
    });
    viewer.sections.slab = is_slab.then_some(Slab { thickness, mode });
}

/// Draws the button and the rate of the cine.
pub(super) fn cine_button(viewer: &mut Viewer, ui: &mut Ui) {
    let cine = &mut viewer.cine;
    let label = if cine.is_running { "Stop cine" } else { "Play cine" };
    let words = "Shows one slice after the other, again and again (C)";
    if ui.add(Button::new(label)).on_hover_text(words).clicked() {
        cine.is_running = !cine.is_running;
    }
    ui.add(DragValue::new(&mut cine.rate).speed(0.2).range(cine::RATES).suffix(" /s").max_decimals(1))
        .on_hover_text("Slices per second, at most; no slice is left out")
        .accessible_name("Rate of the cine");
    if cine.is_running {
        ui.weak("running");
    }
}
