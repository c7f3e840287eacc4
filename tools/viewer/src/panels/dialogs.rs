//! Dialogs over the picture: opening, saving, exporting, and the list of keys.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use eframe::egui::{self, DragValue};
use supervol_files::{Existing, OutputError, OutputFile, check_distinct};
use supervol_format::cast::whole;
use supervol_scene::image::ImageFormat;
use supervol_scene::scene::{RAY_LIMIT, Scene};

use super::widgets::{SIDE_LIMIT, may_write, path_field, window};
use super::{animate, browse, file_options, transfer};
use crate::command::{BINDINGS, MOUSE, words_of};
use crate::command_line::scene_text;
use crate::viewer::Viewer;
use crate::worker::{Export, Message};

/// Free points above and below the window of keys, including its title.
const ABOVE_AND_BELOW: f32 = 80.0;
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
