//! Enlargement of pictures on several threads: bands of rows, each filled by one task. The pixels do not depend on the
//! number of threads.

use rayon::prelude::*;
use supervol_scene::image::Image;
use supervol_scene::image::enlarge::Enlargement;

/// Rows that one task fills.
const BAND_ROWS: u32 = 64;

/// Enlargement by a whole factor; see [`Enlargement`].
pub(crate) trait Enlarge: Sized {
    /// The picture enlarged by `factor` along each axis to `size` pixels.
    fn enlarged(self, factor: u32, size: [u32; 2]) -> Self;
    /// As [`Enlarge::enlarged`], but reuses the memory of `pixels`, whose content and length do not matter.
    fn enlarged_over(&self, pixels: Vec<[f32; 4]>, factor: u32, size: [u32; 2]) -> Self;
    /// Replaces pixels that are NaN by those of `small` enlarged by `factor`.
    fn fill_unknown(&mut self, small: &Self, factor: u32);
}

impl Enlarge for Image {
    fn enlarged(self, factor: u32, size: [u32; 2]) -> Self {
        if factor == 1 && [self.width, self.height] == size {
            return self;
        }
        self.enlarged_over(Vec::new(), factor, size)
    }

    fn enlarged_over(&self, mut pixels: Vec<[f32; 4]>, factor: u32, size: [u32; 2]) -> Self {
        let [width, height] = size;
        let count = width as usize * height as usize;
        if pixels.len() != count {
            pixels = vec![[0.0; 4]; count];
        }
        let mut large = Self { width, height, pixels };
        fill(&mut large, self, factor, |_| true);
        large
    }

    fn fill_unknown(&mut self, small: &Self, factor: u32) {
        fill(self, small, factor, |pixel| pixel[0].is_nan());
    }
}

/// Fills the pixels that `is_filled` selects.
fn fill(large: &mut Image, small: &Image, factor: u32, is_filled: impl Fn(&[f32; 4]) -> bool + Sync) {
    let enlargement = Enlargement::new(small, factor, large.width);
    let first_rows = (0..large.height).step_by(BAND_ROWS as usize).collect::<Vec<_>>();
    let bands = large.pixels.par_chunks_mut(large.width as usize * BAND_ROWS as usize);
    bands.zip(first_rows).for_each(|(band, first)| enlargement.fill_rows(first, band, &is_filled));
}

#[cfg(test)]
mod tests {
    use supervol_format::random::Random;

    use super::*;

    /// Bands filled by several threads equal one band filled by one thread.
    #[test]
    fn threads_change_no_pixel() {
        let mut random = Random::new(3);
        let pixels = (0..40 * 50).map(|_| std::array::from_fn(|_| random.between(0.0, 1.0) as f32)).collect();
        let small = Image { width: 40, height: 50, pixels };
        let mut expected = Image { width: 158, height: 199, pixels: vec![[0.0; 4]; 158 * 199] };
        Enlargement::new(&small, 4, 158).fill_rows(0, &mut expected.pixels, |_| true);
        let large = small.clone().enlarged(4, [158, 199]);
        assert_eq!(large, expected);
        assert_eq!(large.clone().enlarged(1, [158, 199]), large);
        let mut holed = large.clone();
        holed.pixels.iter_mut().step_by(7).for_each(|pixel| *pixel = [f32::NAN; 4]);
        holed.fill_unknown(&small, 4);
        assert_eq!(holed, large);
    }
}
