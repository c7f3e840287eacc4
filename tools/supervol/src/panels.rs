//! `supervol render --slice ... --slice ...`: several slices side by side in one picture.

use std::path::Path;

use supervol::Volume;
use supervol_arguments::failure::Failure;
use supervol_arguments::output::PictureFile;
use supervol_format::readable::counted;
use supervol_runtime::render::options::RenderOptions;
use supervol_scene::image::Image;
use supervol_scene::scene::Scene;

use crate::failed_bricks::{FailedBricks, check_all_read, check_any_read};
use crate::grid::Grid;
use crate::picture::with_picture;
use crate::written::warn_of_nothing;

/// Slices of one volume, drawn as panels.
pub struct Panels<'a> {
    pub volume: &'a Volume,
    /// Name and scene of each panel.
    pub panels: &'a [(String, Scene)],
    pub grid: Grid,
    pub decorate: bool,
    pub failed_bricks: FailedBricks,
}

impl Panels<'_> {
    /// Draws and writes the panels. The paths are used in messages.
    pub fn run(
        &self,
        file: PictureFile,
        (container, output): (&Path, &Path),
        options: &RenderOptions,
    ) -> Result<(), Failure> {
        let [width, height] = self.grid.picture();
        let mut picture = Image { width, height, pixels: vec![[0.0; 4]; width as usize * height as usize] };
        let (mut background, mut failed) = ([0.0; 3], 0);
        for (number, (name, scene)) in self.panels.iter().enumerate() {
            let drawn = self.volume.draw(scene, options).map_err(with_picture)?;
            check_any_read(drawn.stats())?;
            let (placed, resolved) = (drawn.volume(), drawn.resolved());
            warn_of_nothing(drawn.image(), resolved, placed.facts())?;
            let mut panel = drawn.image().clone();
            if self.decorate {
                supervol_decorations::decorate(&mut panel, placed.container(), placed.facts(), resolved, Some(name));
            }
            self.grid.put(&mut picture, number, &panel);
            background = resolved.background;
            failed += drawn.failed_bricks();
        }
        file.write(&picture, background)?;
        let slices = counted(self.panels.len() as u64, "slice");
        writeln!(supervol_arguments::output::remarks_on(output), "{}: {width} x {height}, {slices}", output.display())
            .map_err(supervol_arguments::failure::with_output)?;
        check_all_read(container, failed, self.failed_bricks)
    }
}
