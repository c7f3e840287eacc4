//! `supervol render --slice ... --slice ...`: several slices side by side in one picture.

use std::path::Path;
use std::sync::Arc;

use supervol_arguments::failure::Failure;
use supervol_arguments::output::PictureFile;
use supervol_format::Container;
use supervol_format::cast::narrow;
use supervol_format::readable::counted;
use supervol_runtime::render::options::RenderOptions;
use supervol_runtime::render::renderer::render;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::image::Image;
use supervol_scene::scene::Scene;

use crate::failed_bricks::{FailedBricks, check_all_read, check_any_read};
use crate::render::with_render;
use crate::written::warn_of_nothing;

/// Greatest number of panels of a picture.
pub const PANEL_LIMIT: usize = 64;

/// Arrangement of panels in a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grid {
    columns: u32,
    rows: u32,
    /// Pixels of a panel.
    pub size: [u32; 2],
}

impl Grid {
    /// Grid for this number of panels in a picture of this size, with about as many rows as columns. `None` if a
    /// panel would have no pixel.
    pub fn of(panels: usize, [width, height]: [u32; 2]) -> Option<Self> {
        let panels = u32::try_from(panels).ok()?;
        let columns = (1..=panels).find(|n| n * n >= panels)?;
        let rows = panels.div_ceil(columns);
        let size = [width / columns, height / rows];
        (size[0] > 0 && size[1] > 0).then_some(Self { columns, rows, size })
    }

    /// Size of the whole picture in pixels.
    fn picture(self) -> [u32; 2] {
        [self.columns * self.size[0], self.rows * self.size[1]]
    }

    /// Copies a panel into its place.
    fn put(self, picture: &mut Image, number: usize, panel: &Image) {
        let number = narrow::<u32>(number);
        let [column, row] = [number % self.columns, number / self.columns];
        for y in 0..self.size[1] {
            let to = ((row * self.size[1] + y) * picture.width + column * self.size[0]) as usize;
            let from = (y * panel.width) as usize;
            let width = self.size[0] as usize;
            picture.pixels[to..to + width].copy_from_slice(&panel.pixels[from..from + width]);
        }
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panels_fill_a_picture_row_by_row() {
        let cases = [(2, [2, 1]), (3, [2, 2]), (4, [2, 2]), (5, [3, 2]), (64, [8, 8])];
        for (panels, [columns, rows]) in cases {
            let grid = Grid::of(panels, [100, 60]).expect("there is room");
            assert_eq!((grid.columns, grid.rows, grid.size), (columns, rows, [100 / columns, 60 / rows]));
        }
        assert_eq!(Grid::of(9, [2, 60]), None);
        let grid = Grid::of(3, [5, 4]).expect("there is room");
        let mut picture = Image { width: 4, height: 4, pixels: vec![[0.0; 4]; 16] };
        let panel = Image { width: 2, height: 2, pixels: vec![[1.0; 4]; 4] };
        grid.put(&mut picture, 2, &panel);
        let painted: Vec<usize> = (0..16).filter(|&i| picture.pixels[i][0] > 0.0).collect();
        assert_eq!((grid.picture(), painted), ([4, 4], vec![8, 9, 12, 13]));
    }
}
