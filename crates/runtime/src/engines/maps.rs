//! What is known of each pixel beside its colour, where somebody asks: how far it may be off, and what its rays cost.

use supervol_scene::image::Image;

/// Pictures of as many pixels as the one they belong to.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Maps {
    /// How far each pixel may be off, 1 being white.
    pub errors: Option<Image>,
    /// What the rays of each pixel cost: see [`of_work`].
    pub work: Option<Image>,
}

/// Maps that somebody asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AskedMaps {
    /// How far each pixel may be off.
    pub errors: bool,
    /// What the rays of each pixel cost.
    pub work: bool,
}

impl Maps {
    /// Begins the maps that are asked for and not there yet: nothing is known of any pixel.
    pub fn begin(&mut self, asked: AskedMaps, size: [u32; 2]) {
        let begin = |map: &mut Option<Image>, is_asked: bool| {
            if is_asked && map.is_none() {
                *map = Some(Image::unknown(size));
            }
        };
        begin(&mut self.errors, asked.errors);
        begin(&mut self.work, asked.work);
    }

    /// Writes what is known of the finished pixels of a band over what was known.
    pub fn write_over(&mut self, first_row: u32, band: Self) {
        let write = |map: &mut Option<Image>, band: Option<Image>| {
            if let (Some(map), Some(band)) = (map, band) {
                map.write_over(first_row, &band);
            }
        };
        write(&mut self.errors, band.errors);
        write(&mut self.work, band.work);
    }
}

/// A work map as it is handed out: of each pixel, the mean over its rays of the trilinear cells that a ray crosses (red) and of the
/// leaps that it takes (green); blue is 0, alpha 1, and all is 0 of pixels that are not finished.
#[must_use]
pub fn of_work(mut known: Image) -> Image {
    for pixel in &mut known.pixels {
        if pixel[0].is_nan() {
            *pixel = [0.0; 4];
        }
    }
    known
}

/// Cells or leaps of a ray from which colours do not grow any more.
const FULL: f32 = 1000.0;
/// Colours of that many cells, and of that many leaps.
const OF_CELLS: [f32; 3] = [1.0, 0.55, 0.1];
const OF_LEAPS: [f32; 3] = [0.05, 0.35, 1.0];

/// A work map for people to look at: orange for cells, blue for leaps, both by the square of the logarithm, which tells a hundred cells from
/// three hundred, from black (none) to full colour (1,000 or more), added up.
#[must_use]
pub fn work_in_colors(mut map: Image) -> Image {
    for pixel in &mut map.pixels {
        let [cells, leaps] = [pixel[0], pixel[1]].map(|count| (count.ln_1p() / FULL.ln_1p()).clamp(0.0, 1.0).powi(2));
        let [r, g, b] = std::array::from_fn(|c| (cells * OF_CELLS[c] + leaps * OF_LEAPS[c]).min(1.0));
        *pixel = [r, g, b, 1.0];
    }
    map
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_of_work_grow_with_its_logarithm_and_end() {
        let map = [[0.0, 0.0], [1000.0, 0.0], [0.0, 1000.0], [5000.0, 0.0], [30.64, 0.0]];
        let pixels = map.map(|[cells, leaps]| [cells, leaps, 0.0, 1.0]).to_vec();
        let found = work_in_colors(Image { width: 5, height: 1, pixels });
        let quarter = OF_CELLS.map(|c| 0.25 * c);
        for (pixel, expected) in found.pixels.iter().zip([[0.0; 3], OF_CELLS, OF_LEAPS, OF_CELLS, quarter]) {
            assert!((0..3).all(|c| (pixel[c] - expected[c]).abs() < 1e-3) && pixel[3] == 1.0, "{pixel:?} {expected:?}");
        }
    }

    #[test]
    fn pixels_without_an_end_have_cost_nothing_that_is_known() {
        let known = Image { width: 2, height: 1, pixels: vec![[f32::NAN; 4], [3.0, 2.0, 0.0, 1.0]] };
        assert_eq!(of_work(known).pixels, [[0.0; 4], [3.0, 2.0, 0.0, 1.0]]);
    }
}
