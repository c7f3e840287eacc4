//! Transfer functions in files: loading, saving, and a named collection in the settings folder. Files are read and
//! written by a [`BackgroundTask`].

use std::path::PathBuf;

use eframe::egui::{self, Button, ComboBox, Ui};
use supervol_files::Existing;
use supervol_scene::preset::transfer_file::TransferFile;
use supervol_scene::scene::TransferFunctionSpec;

use super::widgets::{may_write, path_field, window};
use crate::background_task::BackgroundTask;
use crate::edit;
use crate::state::browser::{Browser, FileKind};
use crate::state::dialogs::path_beside;
use crate::state::transfer::{NAME_LIMIT, Outcome, SaveDialog, file_of, folder};
use crate::viewer::Viewer;
use crate::worker::{Message, OpenVolume};

/// Takes the results of background tasks.
pub(crate) fn receive(viewer: &mut Viewer) {
    let Some(outcome) = viewer.transfer.task.as_ref().and_then(BackgroundTask::take) else { return };
    viewer.transfer.task = None;
    let Some(opened) = viewer.opened.clone() else { return };
    match outcome {
        Outcome::Loaded(file) => {
            let taken = take(viewer, &opened, &file).map_err(|e| e.to_string());
            viewer.panel_state.chosen = None;
            viewer.message = taken.err().map(Message::Failure).or(viewer.message.take());
        }
        Outcome::Saved(path) => {
            viewer.transfer.named = None;
            viewer.message = Some(Message::Done(format!("{} is written", path.display())));
        }
        Outcome::Failed(why) => viewer.message = Some(Message::Failure(why)),
    }
}

/// Applies a file to the scene: its whole transfer function, or its colours over the present window if it has only
/// colours.
fn take(
    viewer: &mut Viewer,
    opened: &OpenVolume,
    file: &TransferFile,
) -> Result<(), supervol_scene::preset::transfer_file::TransferFileError> {
    if !file.has_opacities() {
        edit::paint(&mut viewer.scene, &file.color_map()?);
        return Ok(());
    }
    let mut spec = file.points(opened.facts())?;
    // Files of other programs keep the present unit distance.
    let present = edit::points(&viewer.scene).and_then(|points| points.unit_distance);
    spec.unit_distance = spec.unit_distance.or(present);
    viewer.scene.transfer_function = Some(TransferFunctionSpec::Points(spec));
    Ok(())
}

/// Draws the controls.
pub(super) fn controls(viewer: &mut Viewer, ui: &mut Ui) {
    let ctx = ui.ctx().clone();
    ui.horizontal(|ui| {
        let words = "Loads a transfer function or a colour map from a file: JSON of supervol or of ParaView, .1dt of ImageVis3D \
                     (--tf, --colormap)";
        if ui.button("Load ...").on_hover_text(words).clicked() {
            viewer.dialogs.browser = Some(Browser::new(FileKind::TransferFunction, viewer.opened.as_deref()));
        }
        if ui.button("Save as ...").on_hover_text("Saves to a file, or under a name in this list").clicked() {
            let path = path_beside(viewer.opened.as_deref(), "tf.json");
            viewer.transfer.save = Some(SaveDialog { name: String::new(), path, replace: false });
        }
        let folders = viewer.folders.clone();
        let names = viewer.transfer.names(&ctx, &folders).to_vec();
        ui.add_enabled_ui(!names.is_empty(), |ui| {
            let box_ = ComboBox::from_id_salt("named").width(80.0).selected_text("Named").show_ui(ui, |ui| {
                names.into_iter().find(|name| ui.selectable_label(false, name).clicked())
            });
            box_.response
                .on_hover_text("Transfer functions that were saved under a name")
                .accessible_name("Named transfer functions");
            if let Some(path) = box_.inner.flatten().and_then(|name| file_of(&folders, &name)) {
                viewer.transfer.load(&ctx, path);
            }
        });
    });
}

/// Shows the dialog to save a transfer function, if it is open.
pub(super) fn show(viewer: &mut Viewer, ctx: &egui::Context) {
    let Some(mut dialog) = viewer.transfer.save.take() else { return };
    let (mut is_open, mut target) = (true, None);
    let middle = ctx.content_rect().center();
    let folders = viewer.folders.clone();
    window("Save the transfer function", &mut is_open).default_pos(middle).show(ctx, |ui| {
        ui.label("Under a name, for all volumes:");
        path_field(ui, &mut dialog.name, "Name to keep it by");
        let kept = file_of(&folders, &dialog.name);
        let words = format!("Letters, digits and ` _-+,()`, at most {NAME_LIMIT}");
        if ui.add_enabled(kept.is_some(), Button::new("Keep")).on_hover_text(words).clicked() {
            target = kept;
        }
        ui.separator();
        ui.label("Or to a file, for --tf:");
        path_field(ui, &mut dialog.path, "Transfer function file");
        let may = may_write(ui, &dialog.path, &mut dialog.replace);
        if ui.add_enabled(may, Button::new("Write")).clicked() {
            target = Some(PathBuf::from(dialog.path.trim()));
        }
    });
    let Some(path) = target else {
        if is_open && !ctx.input(|input| input.key_pressed(egui::Key::Escape)) {
            viewer.transfer.save = Some(dialog);
        }
        return;
    };
    let Some(spec) = edit::points(&viewer.scene) else { return };
    let text = serde_json::to_string_pretty(spec).expect("points have finite numbers only") + "\n";
    let is_kept = folder(&folders).is_some_and(|folder| path.starts_with(folder));
    let existing = if dialog.replace || is_kept { Existing::Replace } else { Existing::Keep };
    let read = viewer.opened.iter().flat_map(|opened| [opened.source.clone(), opened.path.clone()]).collect();
    viewer.transfer.save(ctx, (path, text), existing, read);
}
