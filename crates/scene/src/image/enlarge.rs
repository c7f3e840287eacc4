//! Enlargement of a picture: each of its pixels becomes a square of pixels, with linear interpolation between the
//! centres of the large pixels, so that no blocks show. The upper left corner stays.
//!
//! The work is divided by rows: [`Enlargement::fill_rows`] fills any number of whole rows, with the same bits whatever
//! the division. The caller decides which rows are filled, and by which thread.

use supervol_format::cast::{single, whole};

use super::Image;

/// Enlargement of one picture to a given width.
#[derive(Debug, Clone)]
pub struct Enlargement<'a> {
    small: &'a Image,
    factor: u32,
    /// Neighbours of each column of the large picture.
    columns: Vec<Neighbours>,
}

impl<'a> Enlargement<'a> {
    /// The enlargement of `small` by `factor` along each axis, to a picture of `width` pixels along x.
    #[must_use]
    pub fn new(small: &'a Image, factor: u32, width: u32) -> Self {
        Self { small, factor, columns: (0..width).map(|x| Neighbours::new(x, factor, small.width)).collect() }
    }

    /// Fills the pixels of whole rows that `is_filled` selects. `first` is the number of the first row.
    pub fn fill_rows(&self, first: u32, rows: &mut [[f32; 4]], is_filled: impl Fn(&[f32; 4]) -> bool) {
        let Self { small, factor, columns } = self;
        // Rows of `small` above and below the current row, already stretched to full width. The following rows reuse
        // them.
        let mut wide = [(usize::MAX, Vec::new()), (usize::MAX, Vec::new())];
        for (y, line) in (first..).zip(rows.chunks_exact_mut(columns.len())) {
            if !line.iter().any(&is_filled) {
                continue;
            }
            let Neighbours { first, second, weight } = Neighbours::new(y, *factor, small.height);
            if wide[0].0 != first {
                wide.swap(0, 1);
            }
            for (number, (held, row)) in [first, second].into_iter().zip(&mut wide) {
                if *held != number {
                    *held = number;
                    row.clear();
                    let pixels = &small.pixels[number * small.width as usize..][..small.width as usize];
                    row.extend(columns.iter().map(|at| interpolated(&pixels[at.first], &pixels[at.second], at.weight)));
                }
            }
            for ((pixel, above), below) in line.iter_mut().zip(&wide[0].1).zip(&wide[1].1) {
                if is_filled(pixel) {
                    *pixel = interpolated(above, below, weight);
                }
            }
        }
    }
}

/// The two pixels of a row or column beside a position, and the weight of the second; clamped at the ends.
#[derive(Debug, Clone, Copy)]
struct Neighbours {
    first: usize,
    second: usize,
    weight: f32,
}

impl Neighbours {
    /// Neighbours of the centre of pixel `i` among `count` pixels that are `factor` times as large.
    fn new(i: u32, factor: u32, count: u32) -> Self {
        let place = ((f64::from(i) + 0.5) / f64::from(factor) - 0.5).clamp(0.0, f64::from(count - 1));
        let first = whole::<u32>(place);
        let second = (first + 1).min(count - 1);
        Self { first: first as usize, second: second as usize, weight: single(place - f64::from(first)) }
    }
}

/// Linear interpolation from one pixel to another.
fn interpolated(a: &[f32; 4], b: &[f32; 4], weight: f32) -> [f32; 4] {
    let mut out = *a;
    for c in 0..4 {
        out[c] += weight * (b[c] - a[c]);
    }
    out
}

#[cfg(test)]
mod tests {
    use supervol_format::random::Random;

    use super::*;

    /// Fills a picture in bands of three rows.
    fn fill(large: &mut Image, small: &Image, factor: u32, is_filled: impl Fn(&[f32; 4]) -> bool + Copy) {
        let enlargement = Enlargement::new(small, factor, large.width);
        for (number, band) in (0..).zip(large.pixels.chunks_mut(3 * large.width as usize)) {
            enlargement.fill_rows(3 * number, band, is_filled);
        }
    }

    /// A ramp stays a ramp between the centres of the large pixels and is constant beyond the outer ones.
    #[test]
    fn enlarged_pictures_are_interpolated() {
        let pixels = (0..2).flat_map(|y| (0..3).map(move |x| [(10 * y + 4 * x) as f32; 4])).collect();
        let small = Image { width: 3, height: 2, pixels };
        let mut large = Image { width: 5, height: 4, pixels: vec![[0.0; 4]; 20] };
        fill(&mut large, &small, 2, |_| true);
        let row = |y: usize| large.pixels[5 * y..5 * (y + 1)].iter().map(|p| p[0]).collect::<Vec<_>>();
        assert_eq!(row(0), [0.0, 1.0, 3.0, 5.0, 7.0]);
        assert_eq!(row(1), [2.5, 3.5, 5.5, 7.5, 9.5]);
        assert_eq!(row(3), [10.0, 11.0, 13.0, 15.0, 17.0]);
        let before = large.clone();
        fill(&mut large, &before, 1, |_| true);
        assert_eq!(large, before);
    }

    /// Filling by rows equals filling pixel by pixel, bit for bit. Other pixels stay.
    #[test]
    fn what_is_unknown_is_interpolated_and_nothing_else() {
        let mut random = Random::new(20);
        for (factor, [width, height]) in [(1, [7, 6]), (2, [13, 9]), (4, [30, 1]), (8, [70, 41])] {
            let size = [width, height].map(|n: u32| n.div_ceil(factor));
            let mut pixels = |[width, height]: [u32; 2]| -> Vec<[f32; 4]> {
                (0..width * height).map(|_| std::array::from_fn(|_| random.unit() as f32)).collect()
            };
            let small = Image { width: size[0], height: size[1], pixels: pixels(size) };
            let mut large = Image { width, height, pixels: pixels([width, height]) };
            let is_unknown = |x: u32, y: u32| y % 5 != 3 && (x + y).is_multiple_of(3);
            let places = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
            let before = large.clone();
            for (pixel, (x, y)) in large.pixels.iter_mut().zip(places()) {
                if is_unknown(x, y) {
                    *pixel = [f32::NAN; 4];
                }
            }
            fill(&mut large, &small, factor, |pixel| pixel[0].is_nan());
            for (n, (x, y)) in places().enumerate() {
                let [at_x, at_y] = [Neighbours::new(x, factor, size[0]), Neighbours::new(y, factor, size[1])];
                let expected: [f32; 4] = std::array::from_fn(|c| {
                    let of_row = |row: usize| {
                        let [left, right] =
                            [at_x.first, at_x.second].map(|x| small.pixels[row * size[0] as usize + x][c]);
                        left + at_x.weight * (right - left)
                    };
                    let [top, bottom] = [at_y.first, at_y.second].map(of_row);
                    top + at_y.weight * (bottom - top)
                });
                let expected = if is_unknown(x, y) { expected } else { before.pixels[n] };
                assert_eq!(large.pixels[n], expected, "({x}, {y}) of {width} x {height} by {factor}");
            }
        }
    }
}
