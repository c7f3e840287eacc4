//! Some pixels of a picture, where not all are to be cast.

use std::ops::Range;

/// The pixels of a picture whose rays are to be cast.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AskedPixels {
    /// Pixels along x.
    width: usize,
    /// Rays along an edge of a pixel.
    subgrid: u32,
    /// Whether each pixel is asked for, row by row from the top.
    is_asked: Vec<bool>,
}

impl AskedPixels {
    /// These pixels, row by row from the top, of a picture of this width with so many rays along an edge of a pixel.
    #[must_use]
    pub fn new(is_asked: Vec<bool>, width: u32, subgrid: u32) -> Self {
        Self { width: width as usize, subgrid, is_asked }
    }

    /// Number of pixels.
    #[must_use]
    pub fn count(&self) -> u64 {
        self.is_asked.iter().filter(|&&is_asked| is_asked).count() as u64
    }

    /// Whether a ray belongs to one of them; x from the left, y from the top of the picture.
    #[must_use]
    pub fn has_ray(&self, ray: [u32; 2]) -> bool {
        let [x, y] = ray.map(|at| (at / self.subgrid) as usize);
        self.is_asked[y * self.width + x]
    }

    /// Their rays in these rows of rays, which are whole rows of pixels.
    #[must_use]
    pub fn rays_in(&self, rows: &Range<u32>) -> u64 {
        let [first, end] = [rows.start, rows.end].map(|row| (row / self.subgrid) as usize * self.width);
        let pixels = self.is_asked[first..end].iter().filter(|&&is_asked| is_asked).count() as u64;
        pixels * u64::from(self.subgrid).pow(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rays_of_a_pixel_are_asked_for_together() {
        let asked = AskedPixels::new(vec![false, true, false, false, false, true], 3, 2);
        assert_eq!((asked.count(), asked.rays_in(&(0..4)), asked.rays_in(&(2..4))), (2, 8, 4));
        let rays = (0..4).flat_map(|y| (0..6).map(move |x| [x, y]));
        let found: Vec<[u32; 2]> = rays.filter(|&ray| asked.has_ray(ray)).collect();
        assert_eq!(found, [[2, 0], [3, 0], [2, 1], [3, 1], [4, 2], [5, 2], [4, 3], [5, 3]]);
    }
}
