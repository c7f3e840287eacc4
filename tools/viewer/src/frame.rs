//! One frame of the user interface: messages of the worker, keys, panels, the picture. At its end, changes go to the
//! worker.

use eframe::egui;

use crate::panels::{self, transfer};
use crate::viewer::Viewer;
use crate::{cine, command};

impl Viewer {
    /// Runs one frame.
    pub fn ui(&mut self, ui: &mut egui::Ui) {
        let ctx = ui.ctx().clone();
        self.start(&ctx);
        self.receive(&ctx);
        transfer::receive(self);
        self.receive_gradients();
        for path in panels::dropped_files(&ctx) {
            self.open(&path);
        }
        for command in command::pressed(&ctx) {
            self.run(&ctx, command);
        }
        cine::advance(self, &ctx);
        panels::status::show(self, ui);
        if !self.saved.panels_hidden {
            panels::tools::show(self, ui);
            panels::properties::show(self, ui);
        }
        panels::picture::show(self, ui);
        panels::dialogs::show(self, &ctx);
        self.record_window_size(&ctx);
        self.send(&ctx);
        self.show_title(&ctx);
    }
}
