//! Values on a grid of texels in a plane, and their convolutions.
//!
//! Rows follow one another, x first. Beyond the grid the texels at its edge continue. A convolution adds its terms in
//! `f32`, in the order of the kernel's rows, so that its bits are the same on every machine.

use supervol_format::cast::{narrow, whole};

/// Values of `f32` on a grid of texels.
#[derive(Debug, Clone, PartialEq)]
pub struct Texels {
    /// Texels along x and y.
    size: [usize; 2],
    values: Vec<f32>,
}

/// Weights around a texel, row by row, `size` of them along x and y. Both sizes are odd.
#[derive(Debug, Clone, Copy)]
pub struct Kernel<'a> {
    pub size: [usize; 2],
    pub weights: &'a [f32],
}

impl Texels {
    /// A grid with these values.
    ///
    /// # Panics
    /// If there are not as many values as texels.
    pub fn new(size: [usize; 2], values: Vec<f32>) -> Self {
        assert_eq!(values.len(), size[0] * size[1], "values of {size:?} texels");
        Self { size, values }
    }

    /// A grid with the value that `value` has at each texel `[x, y]`.
    pub fn from_fn(size: [usize; 2], mut value: impl FnMut([usize; 2]) -> f32) -> Self {
        let texels = (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| [x, y]));
        let values = texels.map(&mut value).collect();
        Self { size, values }
    }

    /// Texels along x and y.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// All values.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// All values, to be changed.
    pub fn values_mut(&mut self) -> &mut [f32] {
        &mut self.values
    }

    /// The value at `[x, y]`, or at the edge of the grid nearest to it.
    pub fn at(&self, place: [i64; 2]) -> f32 {
        let [x, y] = [0, 1].map(|axis| narrow::<usize>(place[axis].clamp(0, narrow::<i64>(self.size[axis]) - 1)));
        self.values[y * self.size[0] + x]
    }

    /// The sum of the texels around each texel, weighted by the kernel.
    pub fn convolved(&self, kernel: Kernel<'_>) -> Self {
        let [width, height] = self.size;
        let [across, down] = kernel.size;
        let mut sums = vec![0.0; self.values.len()];
        let mut row = vec![0.0; width + across - 1];
        for (y, sums) in sums.chunks_exact_mut(width.max(1)).enumerate() {
            for (j, weights) in kernel.weights.chunks_exact(across).enumerate() {
                // The row, with the texels at its ends continued to both sides.
                let y = (y + j).saturating_sub(down / 2).min(height - 1);
                let texels = &self.values[y * width..(y + 1) * width];
                row[..across / 2].fill(texels[0]);
                row[across / 2..][..width].copy_from_slice(texels);
                row[across / 2 + width..].fill(texels[width - 1]);
                // Weight by weight, so that texels side by side are summed at once.
                for (i, weight) in weights.iter().enumerate() {
                    sums.iter_mut().zip(&row[i..]).for_each(|(sum, texel)| *sum += texel * weight);
                }
            }
        }
        Self { size: self.size, values: sums }
    }

    /// The grid blurred by a Gaussian of this standard deviation, texels; it is cut off at twice that.
    pub fn blurred(&self, sigma: f32) -> Self {
        let weights = &gaussian(sigma);
        let across = self.convolved(Kernel { size: [weights.len(), 1], weights });
        across.convolved(Kernel { size: [1, weights.len()], weights })
    }
}

/// Weights of a Gaussian, whose sum is 1.
fn gaussian(sigma: f32) -> Vec<f32> {
    let radius = whole::<i32>((2.0 * sigma).ceil());
    let density =
        |x: f32| (sigma * (2.0 * std::f32::consts::PI).sqrt()).recip() * (-x.powi(2) / (2.0 * sigma.powi(2))).exp();
    let mut weights: Vec<f32> = (-radius..=radius).map(|x| density(x.abs() as f32)).collect();
    let sum: f32 = weights.iter().sum();
    weights.iter_mut().for_each(|weight| *weight /= sum);
    weights
}

#[cfg(test)]
mod tests {
    use supervol_format::random::Random;

    use super::*;

    /// The sum as it is defined, texel by texel.
    fn sum_at(texels: &Texels, kernel: Kernel<'_>, [x, y]: [usize; 2]) -> f32 {
        let [across, down] = kernel.size;
        let mut sum = 0.0;
        for (n, weight) in kernel.weights.iter().enumerate() {
            let i = (x + n % across) as i64 - (across / 2) as i64;
            let j = (y + n / across) as i64 - (down / 2) as i64;
            sum += texels.at([i, j]) * weight;
        }
        sum
    }

    #[test]
    fn convolutions_are_sums_in_the_order_of_the_kernel() {
        let mut random = Random::new(1);
        for size in [[1, 1], [7, 5], [64, 33], [3, 40], [50, 2]] {
            let texels = Texels::from_fn(size, |_| random.between(-1e3, 1e3) as f32);
            for kernel_size in [[3, 3], [9, 1], [1, 9], [129, 1], [1, 129]] {
                let weights: Vec<f32> =
                    (0..kernel_size[0] * kernel_size[1]).map(|_| random.between(-1.0, 1.0) as f32).collect();
                let kernel = Kernel { size: kernel_size, weights: &weights };
                let expected = Texels::from_fn(size, |place| sum_at(&texels, kernel, place));
                assert!(texels.convolved(kernel) == expected, "{size:?} texels, kernel of {kernel_size:?}");
            }
        }
    }

    #[test]
    fn a_gaussian_is_symmetric_and_has_the_sum_one() {
        for sigma in [0.1, 1.0, 6.3, 64.0] {
            let weights = gaussian(sigma);
            let mirrored: Vec<f32> = weights.iter().rev().copied().collect();
            assert!(weights == mirrored && (weights.iter().sum::<f32>() - 1.0).abs() < 1e-5, "sigma {sigma}");
        }
    }
}
