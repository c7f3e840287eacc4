//! The dialog of a file that needs options: which of its volumes, its size, its axes, the meaning of its values.
//!
//! The fields are those of the command line, in the same words and with the same checks. The dialog opens when a file
//! cannot be read without options, and by *File options* for the open file.

use std::path::PathBuf;

use eframe::egui::{self, ComboBox, TextEdit, Ui};
use supervol_arguments::source;
use supervol_preprocess::BuildOptions;
use supervol_sources::open::split_array;

use super::widgets::window;
use crate::state::file_options::{Content, FIELDS, Field, FileOptions};
use crate::viewer::Viewer;

impl FileOptions {
    /// Draws the content. Returns whether the file should be opened.
    fn show(&mut self, ui: &mut Ui) -> bool {
        let mut opens = false;
        ui.horizontal(|ui| {
            ui.label("File");
            ui.add(TextEdit::singleline(&mut self.path).desired_width(f32::INFINITY))
                .on_hover_text("Path of the file; an array in it is FILE:/NAME")
                .accessible_name("File of the options");
        });
        if !self.why.is_empty() {
            ui.colored_label(ui.visuals().warn_fg_color, &self.why);
        }
        let mut taken = None;
        for choice in &self.choices {
            if ui.button(&choice.words).on_hover_text("Opens this volume of the file").clicked() {
                taken = Some(choice.by.clone());
            }
        }
        if let Some(choice) = taken {
            self.take(&choice);
            opens = true;
        }
        // Above the fields, so that it stays in a small window.
        opens |= ui.button("Open with these options").clicked();
        if let Some(trouble) = &self.trouble {
            ui.colored_label(ui.visuals().error_fg_color, trouble);
        }
        let mut texts = self.texts.iter_mut();
        for (heading, fields) in FIELDS {
            ui.strong(heading);
            egui::Grid::new(heading).num_columns(2).show(ui, |ui| {
                for (field, text) in fields.iter().zip(texts.by_ref()) {
                    field.show(text, ui);
                    ui.end_row();
                }
            });
        }
        opens
    }
}

impl Field {
    fn show(&self, value: &mut String, ui: &mut Ui) {
        ui.label(self.label).on_hover_text(self.flag);
        match self.content {
            Content::Text(example) => {
                ui.add(TextEdit::singleline(value).hint_text(example).desired_width(240.0))
                    .on_hover_text(self.flag)
                    .accessible_name(self.label);
            }
            Content::Choice(words) => {
                let shown = if value.is_empty() { "as the file says" } else { value.as_str() };
                let box_ = ComboBox::from_id_salt(self.flag).selected_text(shown).show_ui(ui, |ui| {
                    let all = std::iter::once("").chain(words.iter().copied());
                    let named = |word: &&'static str| if word.is_empty() { "as the file says" } else { *word };
                    all.into_iter().find(|word| ui.selectable_label(value == word, named(word)).clicked())
                });
                box_.response.on_hover_text(self.flag).accessible_name(self.label);
                if let Some(word) = box_.inner.flatten() {
                    word.clone_into(value);
                }
            }
        }
    }
}

/// Shows the dialog if it is open.
pub(super) fn show(viewer: &mut Viewer, ctx: &egui::Context) {
    let Some(mut dialog) = viewer.dialogs.file_options.take() else { return };
    let (mut is_open, mut opens) = (true, false);
    let middle = ctx.content_rect().center();
    window("File options", &mut is_open).default_pos(middle).show(ctx, |ui| {
        let height = (ctx.content_rect().height() - 120.0).max(100.0);
        egui::ScrollArea::vertical().max_height(height).show(ui, |ui| opens = dialog.show(ui));
    });
    if opens {
        match source::reading_of_words(dialog.words(), BuildOptions::default().memory_bytes) {
            Ok(reading) => {
                let path = PathBuf::from(dialog.path.trim());
                if split_array(&path).0.exists() {
                    return viewer.open_read(&path, reading);
                }
                dialog.trouble = Some(format!("{} does not exist.", path.display()));
            }
            Err(why) => dialog.trouble = Some(why),
        }
    }
    if is_open && !ctx.input(|input| input.key_pressed(egui::Key::Escape)) {
        viewer.dialogs.file_options = Some(dialog);
    }
}
