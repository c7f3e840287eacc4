//! Dialogs over the picture: opening, saving, exporting, and the list of keys.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use eframe::egui::{self, DragValue, TextEdit, Ui};
use supervol_files::{Existing, OutputError, OutputFile, check_distinct};
use supervol_format::cast::whole;
use supervol_runtime::render::options::Backend;
use supervol_scene::image::{GREY_LEVELS, ImageFormat};
use supervol_scene::scene::{Mode, RAY_LIMIT, Scene};
use xxhash_rust::xxh3::xxh3_64;

use super::animate::AnimationDialog;
use super::browse::{Browser, FileKind};
use super::file_options::FileOptions;
use super::{animate, browse, file_options, transfer};
use crate::command::{BINDINGS, MOUSE, words_of};
use crate::folders::{self, Folders};
use crate::viewer::Viewer;
use crate::worker::{Decorations, Export, Message, OpenVolume, Settings};

/// Most scene files kept for copied commands.
const SCENE_LIMIT: usize = 200;
/// Free points above and below the window of keys, including its title.
const ABOVE_AND_BELOW: f32 = 80.0;
/// Most pixels of an exported picture along a side.
pub(super) const SIDE_LIMIT: u32 = 32_768;

/// The open dialogs with their state.
#[derive(Default)]
pub(crate) struct Dialogs {
    /// Whether the window of keys is open.
    pub(crate) keys: bool,
    /// The file dialog.
    pub(crate) browser: Option<Browser>,
    /// The dialog of a file that needs options.
    pub(crate) file_options: Option<FileOptions>,
    save: Option<SaveDialog>,
    export: Option<ExportDialog>,
    /// The animation dialog.
    pub(crate) animation: Option<AnimationDialog>,
}

struct SaveDialog {
    path: String,
    replace: bool,
    /// Scene of a section; `None`: the scene of the picture at the time of saving.
    scene: Option<Scene>,
}

struct ExportDialog {
    path: String,
    replace: bool,
    size: [u32; 2],
    /// Width over height of the picture on the screen.
    aspect: f64,
    /// As in [`SaveDialog::scene`].
    scene: Option<Scene>,
}

/// Default path for an output file: beside the volume, with another extension.
pub(super) fn path_beside(opened: Option<&OpenVolume>, ending: &str) -> String {
    let path = opened.map(|opened| opened.source.with_extension(ending)).unwrap_or_default();
    std::path::absolute(&path).unwrap_or(path).display().to_string()
}

impl Dialogs {
    /// Opens the file dialog in the folder of the open volume.
    pub(crate) fn begin_open(&mut self, opened: Option<&OpenVolume>) {
        self.browser = Some(Browser::new(FileKind::Volume, opened));
    }

    /// Opens the dialog to save the scene.
    pub(crate) fn begin_save(&mut self, opened: Option<&OpenVolume>) {
        self.save = Some(SaveDialog { path: path_beside(opened, "scene.json"), replace: false, scene: None });
    }

    /// Opens the dialog to save the scene of a section.
    pub(crate) fn begin_save_section(&mut self, opened: &OpenVolume, scene: Scene) {
        let path = path_beside(Some(opened), "section.json");
        self.save = Some(SaveDialog { path, replace: false, scene: Some(scene) });
    }

    /// Opens the dialog to export a section.
    pub(crate) fn begin_export_section(&mut self, opened: &OpenVolume, scene: Scene) {
        self.begin_export(Some(opened), &scene);
        if let Some(dialog) = &mut self.export {
            dialog.path = path_beside(Some(opened), "section.png");
            dialog.scene = Some(scene);
        }
    }

    /// Opens the dialog to export a picture, with the size of the picture on the screen.
    pub(crate) fn begin_export(&mut self, opened: Option<&OpenVolume>, scene: &Scene) {
        let size = [scene.image.width, scene.image.height];
        let aspect = f64::from(size[0]) / f64::from(size[1]);
        self.export =
            Some(ExportDialog { path: path_beside(opened, "png"), replace: false, size, aspect, scene: None });
    }
}

/// Opens the animation dialog.
pub(crate) fn begin_animation(viewer: &mut Viewer) {
    viewer.dialogs.animation = Some(AnimationDialog::new(viewer));
}

/// Shows all open dialogs.
pub(crate) fn show(viewer: &mut Viewer, ctx: &egui::Context) {
    keys(viewer, ctx);
    browse::show(viewer, ctx);
    file_options::show(viewer, ctx);
    transfer::show(viewer, ctx);
    animate::show(viewer, ctx);
    save(viewer, ctx);
    export(viewer, ctx);
}

pub(super) fn window<'a>(title: &'static str, is_open: &'a mut bool) -> egui::Window<'a> {
    egui::Window::new(title).open(is_open).collapsible(false).pivot(egui::Align2::CENTER_CENTER).default_width(460.0)
}

fn keys(viewer: &mut Viewer, ctx: &egui::Context) {
    let mut is_open = viewer.dialogs.keys;
    let middle = ctx.content_rect().center();
    // The window shows all keys at once if there is room.
    let height = ctx.content_rect().height() - ABOVE_AND_BELOW;
    window("Keys and mouse", &mut is_open).default_pos(middle).default_height(height).vscroll(true).show(ctx, |ui| {
        egui::Grid::new("keys").num_columns(2).striped(true).show(ui, |ui| {
            for (what, words) in MOUSE {
                ui.label(*what);
                ui.label(*words);
                ui.end_row();
            }
            for binding in BINDINGS {
                let keys: Vec<String> = binding.keys.iter().map(|key| words_of(ctx, key)).collect();
                ui.monospace(keys.join(", "));
                ui.label(binding.words);
                ui.end_row();
            }
        });
    });
    viewer.dialogs.keys = is_open && !ctx.input(|input| input.key_pressed(egui::Key::Escape));
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

fn save(viewer: &mut Viewer, ctx: &egui::Context) {
    let Some(mut dialog) = viewer.dialogs.save.take() else { return };
    let (mut is_open, mut is_saved) = (true, false);
    let middle = ctx.content_rect().center();
    window("Save scene", &mut is_open).default_pos(middle).show(ctx, |ui| {
        ui.label("Complete scene of this picture, for `supervol render --scene`:");
        path_field(ui, &mut dialog.path, "Scene file");
        let may = may_write(ui, &dialog.path, &mut dialog.replace);
        is_saved = ui.add_enabled(may, egui::Button::new("Save")).clicked();
    });
    if is_saved {
        let path = PathBuf::from(dialog.path.trim());
        let existing = if dialog.replace { Existing::Replace } else { Existing::Keep };
        let scene = dialog.scene.as_ref().unwrap_or(&viewer.scene);
        viewer.message = Some(match save_scene(viewer, scene, &path, existing) {
            Ok(()) => Message::Done(format!("{} is written", path.display())),
            Err(error) => Message::Failure(error.to_string()),
        });
    } else if is_open && !ctx.input(|input| input.key_pressed(egui::Key::Escape)) {
        viewer.dialogs.save = Some(dialog);
    }
}

/// Writes the scene by the rules of all commands: completely or not at all, and never over an open file.
fn save_scene(viewer: &Viewer, scene: &Scene, path: &Path, existing: Existing) -> Result<(), OutputError> {
    let read = viewer.opened.iter().flat_map(|opened| [opened.source.as_path(), opened.path.as_path()]);
    check_distinct(path, read)?;
    let output = OutputFile::begin(path, existing)?;
    let written = output.file().write_all(scene_text(scene).as_bytes());
    written.map_err(|source| OutputError::write(path, source))?;
    output.publish()?;
    Ok(())
}

/// Content of a scene file.
fn scene_text(scene: &Scene) -> String {
    serde_json::to_string_pretty(scene).expect("a scene has only text keys and finite numbers") + "\n"
}

fn export(viewer: &mut Viewer, ctx: &egui::Context) {
    let Some(mut dialog) = viewer.dialogs.export.take() else { return };
    let (mut is_open, mut is_begun) = (true, false);
    let middle = ctx.content_rect().center();
    let samples = dialog.scene.as_ref().unwrap_or(&viewer.scene).samples_per_pixel;
    let samples = u64::from(samples.unwrap_or(1));
    window("Export picture", &mut is_open).default_pos(middle).show(ctx, |ui| {
        ui.label(
            "The name selects the format: .png, .exr or .npy. The file is written when the picture has converged:",
        );
        path_field(ui, &mut dialog.path, "Picture file");
        ui.horizontal(|ui| {
            ui.label("Pixels");
            let [width, height] = &mut dialog.size;
            if ui
                .add(DragValue::new(width).range(1..=SIDE_LIMIT).clamp_existing_to_range(false))
                .accessible_name("Width, pixels")
                .changed()
            {
                *height = whole::<u32>((f64::from(*width) / dialog.aspect).round()).clamp(1, SIDE_LIMIT);
            }
            ui.label("x");
            ui.add(DragValue::new(height).range(1..=SIDE_LIMIT).clamp_existing_to_range(false))
                .accessible_name("Height, pixels");
        });
        let rays = dialog.size.map(u64::from).iter().product::<u64>() * samples;
        let format = ImageFormat::from_path(Path::new(dialog.path.trim()));
        if rays > RAY_LIMIT {
            ui.colored_label(ui.visuals().error_fg_color, format!("expected at most {RAY_LIMIT} rays, found {rays}"));
        }
        if let Err(error) = &format {
            ui.colored_label(ui.visuals().error_fg_color, error.to_string());
        }
        let may = may_write(ui, &dialog.path, &mut dialog.replace) && rays <= RAY_LIMIT && format.is_ok();
        is_begun = ui.add_enabled(may, egui::Button::new("Export")).clicked();
    });
    if is_begun {
        let mut scene = dialog.scene.unwrap_or_else(|| viewer.scene.clone());
        [scene.image.width, scene.image.height] = dialog.size;
        let existing = if dialog.replace { Existing::ReplacePicture } else { Existing::Keep };
        viewer.export(Export { scene, path: PathBuf::from(dialog.path.trim()), existing });
    } else if is_open && !ctx.input(|input| input.key_pressed(egui::Key::Escape)) {
        viewer.dialogs.export = Some(dialog);
    }
}

/// The command that draws this picture. Its scene is written to a file in the cache folder, named by its checksum.
pub(crate) fn command_line(
    opened: &OpenVolume,
    scene: &Scene,
    settings: &Settings,
    folders: &Folders,
) -> Result<String, String> {
    let folder = folders
        .cache
        .as_ref()
        .ok_or("there is no cache folder for the scene of the command; save the scene instead")?;
    let text = scene_text(scene);
    let file = folder.join("scenes").join(format!("{:016x}.json", xxh3_64(text.as_bytes())));
    let write = || {
        std::fs::create_dir_all(folder.join("scenes"))?;
        std::fs::write(&file, &text)?;
        folders::keep_newest(&folder.join("scenes"), SCENE_LIMIT)
    };
    write().map_err(|e: std::io::Error| format!("{}: {e}", file.display()))?;
    let path = std::path::absolute(&opened.path).unwrap_or_else(|_| opened.path.clone());
    let mut line = format!("supervol render {} --scene {} -o picture.png", quoted(&path), quoted(&file));
    let default = Settings::default();
    // Writing to a string cannot fail.
    if settings.decorations == Decorations::On {
        line += " --decorate";
    }
    line += match settings.backend {
        Backend::Auto => "",
        Backend::Gpu if scene.mode != Some(Mode::Slice) => " --backend gpu",
        Backend::Cpu | Backend::Gpu | Backend::Reference => " --backend cpu",
    };
    if settings.max_error != default.max_error {
        let _ = write!(line, " --max-error {}/255", settings.max_error * GREY_LEVELS);
    }
    if settings.host_memory_bytes != default.host_memory_bytes {
        let _ = write!(line, " --host-memory {}MiB", settings.host_memory_bytes >> 20);
    }
    Ok(line)
}

/// A path quoted for a shell.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = text.chars().all(|c| c.is_ascii_alphanumeric() || "/._-+,:@%".contains(c));
    if is_plain && !text.is_empty() { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_quoted_for_shells() {
        assert_eq!(quoted(Path::new("/a/b-1.svol")), "/a/b-1.svol");
        assert_eq!(quoted(Path::new("/a b/it's")), r"'/a b/it'\''s'");
    }
}
