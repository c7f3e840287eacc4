//! `supervol render --slice ... --slice ...`: several slices side by side in one picture.

use std::path::Path;
use std::sync::Arc;

use supervol_arguments::failure::Failure;
use supervol_arguments::output::PictureFile;
use supervol_format::Container;
use supervol_format::readable::counted;
use supervol_runtime::render::options::RenderOptions;
use supervol_runtime::render::renderer::render;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::image::Image;
use supervol_scene::scene::Scene;

use crate::failed_bricks::{FailedBricks, check_all_read, check_any_read};
use crate::grid::Grid;
use crate::picture::with_render;
use crate::written::warn_of_nothing;

/// Slices of one volume, drawn as panels.
pub struct Panels<'a> {
    /// The volume and its facts.
    pub container: &'a Arc<Container>,
    pub facts: &'a VolumeFacts,
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
            let resolved = scene.resolve(self.facts).map_err(Failure::command)?;
            let (mut panel, stats) = render(self.container, &resolved, options).map_err(with_render)?;
            check_any_read(&stats)?;
            warn_of_nothing(&panel, &resolved, self.facts)?;
            if self.decorate {
                supervol_decorations::decorate(&mut panel, self.container, self.facts, &resolved, Some(name));
            }
            self.grid.put(&mut picture, number, &panel);
            background = resolved.background;
            failed += stats.bricks_failed;
        }
        file.write(&picture, background)?;
        let slices = counted(self.panels.len() as u64, "slice");
        writeln!(supervol_arguments::output::remarks_on(output), "{}: {width} x {height}, {slices}", output.display())
            .map_err(supervol_arguments::failure::with_output)?;
        check_all_read(container, failed, self.failed_bricks)
    }
}
