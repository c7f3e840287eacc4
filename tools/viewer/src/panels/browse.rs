//! The file dialog: chooses a volume, a transfer function or a mesh.

use std::path::{Path, PathBuf};

use eframe::egui::{self, Ui};
use supervol_scene::clip::solids::Keep;
use supervol_scene::scene::SolidSpec;

use super::widgets::{path_field, window};
use crate::background_task::BackgroundTask;
use crate::cutting;
use crate::state::browser::{Browser, FileKind};
use crate::viewer::Viewer;
use crate::worker::Message;

impl Browser {
    /// Draws the content of the dialog. Returns the chosen file.
    fn show(&mut self, ui: &mut Ui) -> Option<PathBuf> {
        let ctx = ui.ctx().clone();
        match self.task.as_ref().map(BackgroundTask::take) {
            Some(Some(listing)) => self.listing = listing,
            Some(None) => {}
            None => self.begin_list(&ctx),
        }
        let mut chosen = None;
        path_field(ui, &mut self.path, "File to open");
        ui.horizontal(|ui| {
            if ui.button("Open").clicked() || ui.input(|input| input.key_pressed(egui::Key::Enter)) {
                // A chosen folder is entered below. Errors of a file are reported when it is opened.
                chosen = Some(PathBuf::from(self.path.trim()));
            }
            if ui.button("Folder above").clicked()
                && let Some(above) = self.folder.parent().map(Path::to_path_buf)
            {
                self.go(&ctx, above);
            }
            if ui.checkbox(&mut self.all_files, "All files").changed() {
                self.begin_list(&ctx);
            }
        });
        if let Some(trouble) = &self.listing.trouble {
            ui.colored_label(ui.visuals().warn_fg_color, trouble);
        }
        chosen = self.entries(ui).or(chosen);
        // The path may be a folder: a listed one, or one typed into the field.
        if let Some(folder) = chosen.take_if(|path| path.is_dir()) {
            self.go(&ctx, folder);
        }
        chosen
    }

    /// Draws the list of entries. Returns the chosen one.
    fn entries(&mut self, ui: &mut Ui) -> Option<PathBuf> {
        let mut chosen = None;
        let row = ui.text_style_height(&egui::TextStyle::Body);
        let count = self.listing.entries.len();
        egui::ScrollArea::vertical().max_height(300.0).auto_shrink([false, true]).show_rows(
            ui,
            row,
            count,
            |ui, rows| {
                for (name, is_folder) in &self.listing.entries[rows] {
                    let label = if *is_folder { format!("{name}/") } else { name.clone() };
                    if ui.selectable_label(false, label).clicked() {
                        chosen = Some(self.folder.join(name));
                    }
                }
            },
        );
        chosen
    }
}

/// Shows the dialog if it is open.
pub(super) fn show(viewer: &mut Viewer, ctx: &egui::Context) {
    let Some(mut browser) = viewer.dialogs.browser.take() else { return };
    let (mut is_open, mut chosen) = (true, None);
    let middle = ctx.content_rect().center();
    window(browser.wanted.title(), &mut is_open).default_pos(middle).show(ctx, |ui| chosen = browser.show(ui));
    match chosen {
        Some(path) => match browser.wanted {
            FileKind::Volume => viewer.open(&path),
            FileKind::TransferFunction => viewer.transfer.load(ctx, path),
            FileKind::Mesh => {
                let mesh = Some(std::path::absolute(&path).unwrap_or(path));
                let solid = SolidSpec { keep: Keep::Inside, mesh, ..SolidSpec::default() };
                if let Err(why) = cutting::push_solid(&mut viewer.scene, solid) {
                    viewer.message = Some(Message::Failure(why));
                }
            }
        },
        None if is_open && !ctx.input(|input| input.key_pressed(egui::Key::Escape)) => {
            viewer.dialogs.browser = Some(browser);
        }
        None => {}
    }
}
