//! Picture files of the window, with the records that `render` writes.

use std::io::{Seek, Write};

use supervol_runtime::render::record::{Drawn, DrawnBy, PictureRecord};
use supervol_scene::image::{EncodeError, ImageFormat};
use supervol_scene::scene::{ResolvedScene, Scene};

use super::drawing::DrawingState;

impl DrawingState {
    /// Encodes the renderer's picture of a scene, with decorations if they are on, and with its record.
    ///
    /// # Panics
    /// If there is no picture.
    pub(super) fn encode_picture(
        &self,
        (scene, resolved): (&Scene, &ResolvedScene),
        format: ImageFormat,
        out: &mut (impl Write + Seek),
    ) -> Result<(), EncodeError> {
        let plain = self.renderer.picture().expect("a finished drawing has a picture");
        let shown = self.decorated(plain.clone(), resolved);
        let (facts, stats) = (&self.opened.facts, self.renderer.stats());
        let record = PictureRecord::of(&Drawn {
            container: &self.opened.container,
            facts,
            scene: &scene.complete(facts, None),
            options: self.renderer.options(),
            stats: &stats,
            engine: DrawnBy::Supervol,
        });
        let text = record.text_in(format, &plain, &shown);
        shown.encode_with(format, resolved.background, Some(&text), out)
    }
}
