//! The animation dialog: a turntable, or a path of key frames.

use std::path::PathBuf;

use eframe::egui::{self, Button, DragValue, Ui};
use supervol_preprocess::Existing;
use supervol_scene::camera_path::FRAME_LIMIT;
use supervol_scene::image::ImageFormat;
use supervol_scene::scene::RAY_LIMIT;

use super::widgets::{SIDE_LIMIT, path_field, window};
use crate::state::animation::{AnimationDialog, Kind};
use crate::viewer::Viewer;
use crate::worker::{Animation, Motion};

/// File formats of the pictures, with names and descriptions.
const FORMATS: [(ImageFormat, &str, &str); 3] = [
    (ImageFormat::Png, "PNG", "8 bits a channel, with background: for films"),
    (
        ImageFormat::Exr,
        "EXR",
        "OpenEXR: 32-bit floats, premultiplied, without background: for compositing (--frame-format exr)",
    ),
    (ImageFormat::Npy, "NumPy", "Arrays of 32-bit floats, premultiplied, without background (--frame-format npy)"),
];

/// Shows the dialog if it is open.
pub(super) fn show(viewer: &mut Viewer, ctx: &egui::Context) {
    let Some(mut dialog) = viewer.dialogs.animation.take() else { return };
    let (mut is_open, mut motion) = (true, None);
    let middle = ctx.content_rect().center();
    window("Animation", &mut is_open).default_pos(middle).show(ctx, |ui| motion = contents(viewer, &mut dialog, ui));
    if let Some(motion) = motion {
        let mut scene = viewer.scene.clone();
        [scene.image.width, scene.image.height] = dialog.size;
        let existing = if dialog.replace { Existing::Replace } else { Existing::Keep };
        let folder = PathBuf::from(dialog.folder.trim());
        viewer.worker.iter().for_each(|worker| {
            let (scene, motion, folder) = (scene.clone(), motion.clone(), folder.clone());
            worker.animate(Animation { scene, motion, folder, format: dialog.format, existing });
        });
    } else if is_open && !ctx.input(|input| input.key_pressed(egui::Key::Escape)) {
        viewer.dialogs.animation = Some(dialog);
    }
}

/// Draws the content of the dialog. Returns the requested motion.
fn contents(viewer: &mut Viewer, dialog: &mut AnimationDialog, ui: &mut Ui) -> Option<Motion> {
    ui.horizontal(|ui| {
        ui.selectable_value(&mut dialog.kind, Kind::Turntable, "Turntable")
            .on_hover_text("One turn around the volume (--turntable)");
        ui.selectable_value(&mut dialog.kind, Kind::Path, "Key frames")
            .on_hover_text("Moves from view to view (--path)");
    });
    let motion = match dialog.kind {
        Kind::Turntable => {
            ui.horizontal(|ui| {
                ui.label("Pictures of one turn");
                ui.add(DragValue::new(&mut dialog.frames).range(1..=FRAME_LIMIT).clamp_existing_to_range(false))
                    .accessible_name("Pictures of one turn");
            });
            Ok(Motion::Turntable(dialog.frames))
        }
        Kind::Path => {
            keys(viewer, ui);
            viewer.keys.path().map(Motion::Path)
        }
    };
    ui.horizontal(|ui| {
        for (format, name, words) in FORMATS {
            ui.selectable_value(&mut dialog.format, format, name).on_hover_text(words);
        }
    });
    let ending = dialog.format.ending();
    ui.label(format!("Folder for frame-00000.{ending} and so on; existing pictures are kept:"));
    path_field(ui, &mut dialog.folder, "Folder of the pictures");
    ui.horizontal(|ui| {
        ui.label("Pixels");
        for (side, name) in dialog.size.iter_mut().zip(["Width of pictures", "Height of pictures"]) {
            ui.add(DragValue::new(side).range(1..=SIDE_LIMIT).clamp_existing_to_range(false)).accessible_name(name);
        }
        ui.checkbox(&mut dialog.replace, "Overwrite other pictures");
    });
    let samples = u64::from(viewer.scene.samples_per_pixel.unwrap_or(1));
    let rays = dialog.size.map(u64::from).iter().product::<u64>() * samples;
    let trouble = match &motion {
        Err(why) => Some(why.clone()),
        _ if rays > RAY_LIMIT => Some(format!("expected at most {RAY_LIMIT} rays a picture, found {rays}")),
        _ => None,
    };
    if let Some(trouble) = &trouble {
        ui.colored_label(ui.visuals().warn_fg_color, trouble);
    }
    let may = trouble.is_none() && !dialog.folder.trim().is_empty();
    let is_begun = ui.add_enabled(may, Button::new("Make the pictures")).clicked();
    motion.ok().filter(|_| is_begun)
}

/// Draws the list of key frames.
fn keys(viewer: &mut Viewer, ui: &mut Ui) {
    let camera = viewer.scene.camera.clone();
    if ui.add_enabled(camera.is_some(), Button::new("Take this view")).clicked()
        && let Some(camera) = &camera
    {
        viewer.keys.add(camera);
    }
    let (mut gone, mut shown) = (None, None);
    egui::ScrollArea::vertical().max_height(160.0).show(ui, |ui| {
        for (i, key) in viewer.keys.0.iter_mut().enumerate() {
            ui.horizontal(|ui| {
                ui.label(format!("View {} at picture", i + 1));
                // The first key frame is always frame 0.
                let drag = DragValue::new(&mut key.frame).range(0..=FRAME_LIMIT - 1).clamp_existing_to_range(false);
                ui.add_enabled(i > 0, drag).accessible_name(format!("View {}, picture", i + 1));
                if ui.small_button("show").on_hover_text("Shows this view").clicked() {
                    shown = Some(key.camera.clone());
                }
                let button = ui.small_button("x").on_hover_text("Removes this view");
                if button.accessible_name(format!("View {}, remove", i + 1)).clicked() {
                    gone = Some(i);
                }
            });
        }
    });
    if let Some(i) = gone {
        viewer.keys.remove(i);
    }
    viewer.scene.camera = shown.or(viewer.scene.camera.take());
}
