//! Arrangement of the panels of a picture.

use supervol_format::cast::narrow;
use supervol_scene::image::Image;

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
    pub fn picture(self) -> [u32; 2] {
        [self.columns * self.size[0], self.rows * self.size[1]]
    }

    /// Copies a panel into its place.
    pub fn put(self, picture: &mut Image, number: usize, panel: &Image) {
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
