//! Maps of a picture: the error of each pixel, and the work of its rays. They are made on request.

use supervol_scene::image::Image;

/// Maps of a picture, of its size.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Maps {
    /// Error of each pixel; 1 is white.
    pub errors: Option<Image>,
    /// Work of each pixel's rays: see [`of_work`].
    pub work: Option<Image>,
}

/// Requested maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AskedMaps {
    /// Error of each pixel.
    pub errors: bool,
    /// Work of each pixel's rays.
    pub work: bool,
}

impl Maps {
    /// Begins the requested maps that do not exist yet; all pixels are unknown.
    pub fn begin(&mut self, asked: AskedMaps, size: [u32; 2]) {
        let begin = |map: &mut Option<Image>, is_asked: bool| {
            if is_asked && map.is_none() {
                *map = Some(Image::unknown(size));
            }
        };
        begin(&mut self.errors, asked.errors);
        begin(&mut self.work, asked.work);
    }

    /// Copies the maps of a band.
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

/// The work map in its public form. Red is the number of trilinear cells that a ray crosses, green the number of its
/// leaps, both as the mean over the rays of a pixel. Blue is 0 and alpha 1. Unfinished pixels are 0 in all channels.
#[must_use]
pub fn of_work(mut known: Image) -> Image {
    for pixel in &mut known.pixels {
        if pixel[0].is_nan() {
            *pixel = [0.0; 4];
        }
    }
    known
}

/// Cells or leaps of a ray at full colour.
const FULL: f32 = 1000.0;
/// Full colours of cells and of leaps.
const OF_CELLS: [f32; 3] = [1.0, 0.55, 0.1];
const OF_LEAPS: [f32; 3] = [0.05, 0.35, 1.0];

/// A work map in colours: orange for cells, blue for leaps, added up. Both go from black (none) to full colour (1,000
/// or more). Brightness is the square of the logarithm, which tells a hundred cells from three hundred.
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
