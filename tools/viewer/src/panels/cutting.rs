//! Controls of clip planes and solids: adding, editing as numbers, removing. Handles in the picture do the same.

use eframe::egui::{Checkbox, DragValue, Ui};
use supervol_scene::clip::solids::Keep;
use supervol_scene::scene::{PlaneSpec, SolidSpec};

use super::widgets::heading;
use crate::cutting::{self, NewSolid};
use crate::edit;
use crate::state::browser::{Browser, FileKind};
use crate::viewer::Viewer;
use crate::worker::Message;

/// Steps of a dragged number over the extent of the volume.
const STEPS: f64 = 500.0;

/// Draws the controls.
pub(super) fn controls(viewer: &mut Viewer, ui: &mut Ui) {
    heading(ui, "Clip planes and solids");
    let Some(opened) = viewer.opened.clone().filter(|_| viewer.slice.is_none()) else {
        ui.weak("They do not clip a slice.");
        return;
    };
    let words = "Shows handles of crop box, planes, slices and solids in the picture: drag them (B)";
    ui.checkbox(&mut viewer.panel_state.are_handles_shown, "Handles in the picture").on_hover_text(words);
    let mut added = None;
    ui.horizontal_wrapped(|ui| {
        let words = "Removes the front half of the volume, as seen now (--clip)";
        if ui.button("+ plane").on_hover_text(words).clicked() {
            added = Some(cutting::add_plane(&mut viewer.scene, opened.facts()));
        }
        let solids = [("+ sphere", NewSolid::Sphere), ("+ box", NewSolid::Cuboid), ("+ cylinder", NewSolid::Cylinder)];
        for (label, kind) in solids {
            if ui.button(label).on_hover_text("Removes the inside or the outside of this solid (--clip)").clicked() {
                added = Some(cutting::add_solid(&mut viewer.scene, opened.facts(), kind));
            }
        }
        let words = "Clips with a closed triangle mesh in world coordinates (.ply, .stl, .obj)";
        if ui.button("+ mesh ...").on_hover_text(words).clicked() {
            viewer.dialogs.browser = Some(Browser::new(FileKind::Mesh, Some(&opened)));
        }
    });
    match added {
        Some(Ok(())) => viewer.panel_state.are_handles_shown = true,
        Some(Err(why)) => viewer.message = Some(Message::Failure(why)),
        None => {}
    }
    let words = "Lights cut faces by the cut, not by the data behind them: smooth where data are noisy (--cut-normals). It needs \
                 light, and a semi-transparent or opaque volume";
    let may_be_lit = viewer.scene.may_light_cuts();
    ui.add_enabled(may_be_lit, Checkbox::new(&mut viewer.scene.cut_normals, "Light cut faces evenly"))
        .on_hover_text(words)
        .on_disabled_hover_text(words);
    let speed = edit::stage(opened.facts()).diagonal / STEPS;
    let (mut plane_gone, mut solid_gone) = (None, None);
    for (i, plane) in viewer.scene.clip.planes.iter_mut().enumerate() {
        if ui.push_id(("plane", i), |ui| plane_numbers(plane, i + 1, speed, ui)).inner {
            plane_gone = Some(i);
        }
    }
    for (i, solid) in viewer.scene.clip.solids.iter_mut().enumerate() {
        if ui.push_id(("solid", i), |ui| solid_numbers(solid, i + 1, speed, ui)).inner {
            solid_gone = Some(i);
        }
    }
    if let Some(i) = plane_gone {
        viewer.scene.clip.planes.remove(i);
    }
    if let Some(i) = solid_gone {
        viewer.scene.clip.solids.remove(i);
    }
}

/// Draws a heading with a button to remove its item. Returns whether the button was pressed.
fn title(ui: &mut Ui, name: &str, more: impl FnOnce(&mut Ui)) -> bool {
    ui.separator();
    let mut is_gone = false;
    ui.horizontal(|ui| {
        ui.label(name);
        more(ui);
        let button = ui.small_button("x").on_hover_text("Removes it");
        is_gone = button.accessible_name(format!("{name}, remove")).clicked();
    });
    is_gone
}

/// Draws three numbers in a row, named after the world's axes.
fn triple(numbers: &mut [f64; 3], name: &str, speed: f64, ui: &mut Ui) {
    ui.horizontal(|ui| {
        for (number, axis) in numbers.iter_mut().zip(["x", "y", "z"]) {
            ui.add(DragValue::new(number).speed(speed).max_decimals(3))
                .on_hover_text(format!("{name}, world {axis}"))
                .accessible_name(format!("{name} {axis}"));
        }
    });
}

fn length(number: &mut f64, name: &str, speed: f64, ui: &mut Ui) {
    ui.add(DragValue::new(number).speed(speed).range(f64::MIN_POSITIVE..=f64::MAX).max_decimals(3))
        .on_hover_text(format!("{name}, world length"))
        .accessible_name(name);
}

fn plane_numbers(plane: &mut PlaneSpec, number: usize, speed: f64, ui: &mut Ui) -> bool {
    let is_gone = title(ui, &format!("Plane {number}"), |ui| {
        let words = "Keeps the other side";
        if ui.small_button("flip").on_hover_text(words).clicked() {
            (plane.normal, plane.offset) = (plane.normal.map(|n| -n), -plane.offset);
        }
    });
    let mut normal = plane.normal;
    triple(&mut normal, &format!("Plane {number}, normal"), 0.01, ui);
    // A zero normal is not accepted.
    if normal != [0.0; 3] {
        plane.normal = normal;
    }
    ui.add(DragValue::new(&mut plane.offset).speed(speed).max_decimals(3))
        .on_hover_text("Keeps points where normal . position is at least this number")
        .accessible_name(format!("Plane {number}, offset"));
    is_gone
}

fn solid_numbers(solid: &mut SolidSpec, number: usize, speed: f64, ui: &mut Ui) -> bool {
    let shape = match solid {
        SolidSpec { sphere: Some(_), .. } => "sphere",
        SolidSpec { cuboid: Some(_), .. } => "box",
        SolidSpec { cylinder: Some(_), .. } => "cylinder",
        _ => "mesh",
    };
    let is_gone = title(ui, &format!("Solid {number}: {shape}"), |_| {});
    ui.horizontal(|ui| {
        for (keep, label) in [(Keep::Inside, "inside"), (Keep::Outside, "outside")] {
            let words = format!("Keeps the {label}");
            let response = ui.selectable_value(&mut solid.keep, keep, label).on_hover_text(words);
            let _ = response.accessible_name(format!("Solid {number}, keep {label}"));
        }
    });
    let named = |what: &str| format!("Solid {number}, {what}");
    if let Some(sphere) = &mut solid.sphere {
        triple(&mut sphere.center, &named("middle"), speed, ui);
        length(&mut sphere.radius, &named("radius"), speed, ui);
    }
    if let Some(cuboid) = &mut solid.cuboid {
        triple(&mut cuboid.center, &named("middle"), speed, ui);
        ui.horizontal(|ui| {
            for (edge, axis) in cuboid.edges.iter_mut().zip(["first", "second", "third"]) {
                length(edge, &named(&format!("{axis} edge")), speed, ui);
            }
        });
    }
    if let Some(cylinder) = &mut solid.cylinder {
        triple(&mut cylinder.from, &named("one end"), speed, ui);
        triple(&mut cylinder.to, &named("other end"), speed, ui);
        length(&mut cylinder.radius, &named("radius"), speed, ui);
    }
    if let Some(mesh) = &solid.mesh {
        let name = mesh.file_name().unwrap_or(mesh.as_os_str()).to_string_lossy();
        ui.label(name).on_hover_text(mesh.display().to_string());
    }
    is_gone
}
