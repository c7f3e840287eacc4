//! Pictures exported to files, drawn by the renderer that also draws for the screen, so that both share bricks and
//! memory budget.

use std::sync::Arc;

use supervol::{Picture, Scene};
use supervol_files::{OutputFile, check_distinct};
use supervol_scene::image::ImageFormat;

use super::drawing::DrawingState;
use super::messages::{Busy, Export, Message, Settings};
use super::shared::{Shared, lock};
use super::written::encode;

impl DrawingState {
    /// Draws the picture until it has converged or the user cancels, and writes it.
    pub(super) fn export(
        &mut self,
        shared: &Arc<Shared>,
        export: &Export,
        settings: &Settings,
    ) -> Result<Message, String> {
        let format = ImageFormat::from_path(&export.path).map_err(|e| e.to_string())?;
        let read = [self.opened.source.as_path(), self.opened.path.as_path()];
        check_distinct(&export.path, read).map_err(|e| e.to_string())?;
        let output = OutputFile::begin(&export.path, export.existing).map_err(|e| e.to_string())?;
        shared.send(|messages| {
            messages.busy = Some(Busy::Exporting(export.path.clone(), [0, export.scene.image.height]))
        });
        lock(&shared.requests).export_canceller = Some(self.renderer.canceller());
        let written = self.finished(shared, &export.scene, settings).and_then(|picture| {
            let Some(picture) = picture else {
                return Ok(Message::Done("export cancelled; no file was written".into()));
            };
            encode(&picture, settings.decorations, format, &mut output.file()).map_err(|e| e.to_string())?;
            output.publish().map_err(|e| e.to_string())?;
            let path = export.path.display();
            Ok(match picture.failed_bricks() {
                0 => Message::Done(format!("{path} is written")),
                failed => Message::Failure(format!("{path} is written, but {failed} bricks could not be read")),
            })
        });
        self.resume(shared, settings);
        written
    }

    /// The finished picture of a scene; `None` if the user has cancelled.
    pub(super) fn finished(
        &mut self,
        shared: &Arc<Shared>,
        scene: &Scene,
        settings: &Settings,
    ) -> Result<Option<Picture>, String> {
        let step = self.aim(shared, scene, settings).and_then(|()| self.renderer.advance(None));
        let step = step.map_err(|e| e.to_string())?;
        Ok(self.renderer.picture().filter(|_| step.is_finished && !step.is_cancelled))
    }
}
