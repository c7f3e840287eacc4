//! Pictures exported to files, drawn by the renderer that also draws for the screen, so that both share bricks and
//! memory budget.

use std::sync::Arc;

use supervol_files::{OutputFile, check_distinct};
use supervol_scene::image::ImageFormat;

use super::drawing::DrawingState;
use super::messages::{Busy, Export, Message, Settings};
use super::shared::{Shared, lock};

impl DrawingState {
    /// Draws the picture until it has converged or the user cancels, and writes it.
    pub(super) fn export(
        &mut self,
        shared: &Arc<Shared>,
        export: &Export,
        settings: &Settings,
    ) -> Result<Message, String> {
        let format = ImageFormat::from_path(&export.path).map_err(|e| e.to_string())?;
        let scene = export.scene.resolve(&self.opened.facts).map_err(|e| e.to_string())?;
        let read = [self.opened.source.as_path(), self.opened.path.as_path()];
        check_distinct(&export.path, read).map_err(|e| e.to_string())?;
        let output = OutputFile::begin(&export.path, export.existing).map_err(|e| e.to_string())?;
        shared.send(|messages| messages.busy = Some(Busy::Exporting(export.path.clone(), [0, scene.image_size[1]])));
        lock(&shared.requests).export_canceller = Some(self.renderer.canceller());
        self.aim(shared, scene.clone(), settings);
        let step = self.renderer.advance(None);
        let written = step.map_err(|e| e.to_string()).and_then(|step| {
            if !step.is_finished {
                return Ok(Message::Done("export cancelled; no file was written".into()));
            }
            let mut file = output.file();
            self.encode_picture((&export.scene, &scene), format, &mut file).map_err(|e| e.to_string())?;
            output.publish().map_err(|e| e.to_string())?;
            let failed = self.renderer.stats().bricks_failed;
            let path = export.path.display();
            Ok(match failed {
                0 => Message::Done(format!("{path} is written")),
                _ => Message::Failure(format!("{path} is written, but {failed} bricks could not be read")),
            })
        });
        self.resume(shared, settings);
        written
    }
}
