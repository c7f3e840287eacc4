//! Transfer functions in files: loading, saving, and a named collection in the settings folder. Files are read and
//! written by a [`BackgroundTask`].

use std::io::Write as _;
use std::path::{Path, PathBuf};

use eframe::egui::{self, Button, ComboBox, Ui};
use supervol_files::{Existing, OutputError, OutputFile, check_distinct};
use supervol_scene::preset::transfer_file::TransferFile;
use supervol_scene::scene::TransferFunctionSpec;

use super::browse::{Browser, FileKind};
use super::dialogs::{may_write, path_beside, path_field, window};
use crate::background_task::BackgroundTask;
use crate::edit;
use crate::folders::Folders;
use crate::viewer::Viewer;
use crate::worker::{Message, OpenVolume};

/// Most listed names.
const NAMED_LIMIT: usize = 500;
/// Most characters of a name.
const NAME_LIMIT: usize = 60;

/// Result of a background task.
enum Outcome {
    Loaded(Box<TransferFile>),
    Saved(PathBuf),
    Failed(String),
}

/// Running tasks and the named collection.
#[derive(Default)]
pub(crate) struct Transfer {
    task: Option<BackgroundTask<Outcome>>,
    /// Names of the collection; `None` until the folder has been listed.
    named: Option<Vec<String>>,
    listing: Option<BackgroundTask<Vec<String>>>,
    save: Option<SaveDialog>,
}

struct SaveDialog {
    name: String,
    path: String,
    replace: bool,
}

/// The folder of the collection.
fn folder(folders: &Folders) -> Option<PathBuf> {
    folders.settings.as_ref().map(|settings| settings.join("transfer-functions"))
}

/// The file of a name; `None` if the name is not valid in every file system.
fn file_of(folders: &Folders, name: &str) -> Option<PathBuf> {
    let is_good = |c: char| c.is_alphanumeric() || " _-+,()".contains(c);
    let name = name.trim();
    let good = !name.is_empty() && name.chars().count() <= NAME_LIMIT && name.chars().all(is_good);
    Some(folder(folders)?.join(format!("{name}.json"))).filter(|_| good)
}

fn names_in(folder: &Path) -> Vec<String> {
    let listed = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let name = |entry: std::fs::DirEntry| {
        let path = entry.path();
        let is_kept = path.extension().is_some_and(|end| end == "json");
        is_kept.then(|| path.file_stem().map(|stem| stem.to_string_lossy().into_owned())).flatten()
    };
    let mut names: Vec<String> = listed.filter_map(name).take(NAMED_LIMIT).collect();
    names.sort_by_key(|name| name.to_lowercase());
    names
}

impl Transfer {
    /// Starts to read a file.
    pub(crate) fn load(&mut self, ctx: &egui::Context, path: PathBuf) {
        self.task = Some(BackgroundTask::start(ctx, move || match TransferFile::read(&path) {
            Ok(file) => Outcome::Loaded(Box::new(file)),
            Err(error) => Outcome::Failed(error.to_string()),
        }));
    }

    fn save(&mut self, ctx: &egui::Context, (path, text): (PathBuf, String), existing: Existing, read: Vec<PathBuf>) {
        self.task = Some(BackgroundTask::start(ctx, move || match write(&path, &text, existing, &read) {
            Ok(()) => Outcome::Saved(path),
            Err(error) => Outcome::Failed(error.to_string()),
        }));
    }

    /// Names of the collection; empty while the folder is being listed.
    fn names(&mut self, ctx: &egui::Context, folders: &Folders) -> &[String] {
        if let Some(names) = self.listing.as_ref().and_then(BackgroundTask::take) {
            (self.named, self.listing) = (Some(names), None);
        }
        if self.named.is_none()
            && self.listing.is_none()
            && let Some(folder) = folder(folders)
        {
            self.listing = Some(BackgroundTask::start(ctx, move || names_in(&folder)));
        }
        self.named.as_deref().unwrap_or_default()
    }
}

/// Writes a file by the rules of all commands: completely or not at all, and never over an open file.
fn write(path: &Path, text: &str, existing: Existing, read: &[PathBuf]) -> Result<(), OutputError> {
    let failed = |source| OutputError::write(path, source);
    check_distinct(path, read.iter().map(PathBuf::as_path))?;
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    let output = OutputFile::begin(path, existing)?;
    output.file().write_all(text.as_bytes()).map_err(failed)?;
    output.publish()?;
    Ok(())
}

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
    let mut spec = file.points(&opened.facts)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_names_of_files() {
        let folders = Folders { settings: Some("/s".into()), ..Folders::default() };
        let expected = Path::new("/s/transfer-functions/Bone, dense (2).json");
        assert_eq!(file_of(&folders, " Bone, dense (2) ").as_deref(), Some(expected));
        for name in ["", "  ", "../other", "a/b", "a.b", "\0", &"x".repeat(61)] {
            assert_eq!(file_of(&folders, name), None, "{name:?}");
        }
        assert_eq!(file_of(&Folders::default(), "bone"), None, "there is no folder");
    }
}
