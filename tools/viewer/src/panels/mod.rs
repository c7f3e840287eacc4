//! The panels around the picture, and the picture itself. Panels only show the scene and change it.

mod animate;
mod browse;
mod cutting;
pub(crate) mod dialogs;
mod editor;
mod file_options;
mod gradient;
mod handles;
mod marks;
pub(crate) mod picture;
pub(crate) mod properties;
mod reading;
mod sections;
mod slices;
pub(crate) mod status;
pub(crate) mod tools;
pub(crate) mod transfer;
mod widgets;

use std::path::PathBuf;

use eframe::egui;

/// Files that were dropped on the window.
pub(crate) fn dropped_files(ctx: &egui::Context) -> Vec<PathBuf> {
    ctx.input(|input| input.raw.dropped_files.iter().map(|file| file.path().into()).collect())
}
