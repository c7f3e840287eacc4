//! Cubic reconstruction: weights of four neighbours, and the prefilter of interpolating B-splines.
//!
//! `u` in [0, 1] is the position between the second and third of four neighbours.

use supervol_format::cast::narrow;

/// Weights of the Catmull-Rom spline (Catmull and Rom 1974). It interpolates and may overshoot.
#[must_use]
pub fn catmull_rom_weights(u: f64) -> [f64; 4] {
    let (u2, u3) = (u * u, u * u * u);
    [-0.5 * u3 + u2 - 0.5 * u, 1.5 * u3 - 2.5 * u2 + 1.0, -1.5 * u3 + 2.0 * u2 + 0.5 * u, 0.5 * u3 - 0.5 * u2]
}

/// Weights of the cubic B-spline. It stays in the range of the coefficients and interpolates only after prefiltering.
#[must_use]
pub fn bspline_weights(u: f64) -> [f64; 4] {
    let v = 1.0 - u;
    let (u2, u3) = (u * u, u * u * u);
    [v * v * v / 6.0, 0.5 * u3 - u2 + 2.0 / 3.0, (-3.0 * u3 + 3.0 * u2 + 3.0 * u + 1.0) / 6.0, u3 / 6.0]
}

/// Pole of the cubic B-spline's inverse filter: `sqrt(3) - 2`.
const POLE: f64 = -0.267_949_192_431_122_7;
/// Number of samples after which powers of the pole are below rounding.
const HORIZON: usize = 30;

/// Converts voxels (x fastest) into coefficients whose B-spline passes through the voxels, in place.
///
/// Unser, Aldroubi, Eden (1991): one causal and one anticausal recursive filter along each axis. The filter mirrors
/// each line about its first and last voxel, but the rendering model repeats the outermost value. The two differ within
/// a few voxels of the border.
///
/// # Panics
/// If the length of `voxels` does not match `dims`.
pub fn bspline_coefficients(dims: [usize; 3], voxels: &mut [f64]) {
    assert_eq!(voxels.len(), dims.iter().product::<usize>(), "voxels of a grid of {dims:?}");
    let strides = [1, dims[0], dims[0] * dims[1]];
    let mut line = Vec::new();
    for axis in 0..3 {
        let (n, stride) = (dims[axis], strides[axis]);
        if n < 2 {
            continue;
        }
        for start in (0..voxels.len()).filter(|i| i / stride % n == 0) {
            line.clear();
            line.extend((0..n).map(|i| voxels[start + i * stride]));
            filter_line(&mut line);
            line.iter().enumerate().for_each(|(i, v)| voxels[start + i * stride] = *v);
        }
    }
}

fn filter_line(line: &mut [f64]) {
    let n = line.len();
    // Sum over the mirrored signal before the line, up to rounding.
    let mirrored = |i: usize| {
        let period = 2 * (n - 1);
        let i = i % period;
        line[if i < n { i } else { period - i }]
    };
    let first: f64 = (0..HORIZON).map(|i| POLE.powi(narrow::<i32>(i)) * mirrored(i)).sum();
    line[0] = first;
    for i in 1..n {
        line[i] += POLE * line[i - 1];
    }
    line[n - 1] = POLE / (POLE * POLE - 1.0) * (line[n - 1] + POLE * line[n - 2]);
    for i in (0..n - 1).rev() {
        line[i] = POLE * (line[i + 1] - line[i]);
    }
    line.iter_mut().for_each(|v| *v *= 6.0);
}

/// Weighted sum over 4^3 values (x fastest) with the tensor product of the weights.
#[must_use]
pub fn tricubic(values: &[f64; 64], weights: [[f64; 4]; 3]) -> f64 {
    let [wx, wy, wz] = weights;
    let mut sum = 0.0;
    for z in 0..4 {
        for y in 0..4 {
            let row = &values[16 * z + 4 * y..16 * z + 4 * y + 4];
            let along_x: f64 = row.iter().zip(wx).map(|(v, w)| v * w).sum();
            sum += wz[z] * wy[y] * along_x;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_sum_to_one_and_reproduce_lines() {
        for i in 0..=20 {
            let u = f64::from(i) / 20.0;
            for weights in [catmull_rom_weights(u), bspline_weights(u)] {
                assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-14);
                let position: f64 = weights.iter().zip([-1.0, 0.0, 1.0, 2.0]).map(|(w, x)| w * x).sum();
                assert!((position - u).abs() < 1e-14);
            }
        }
        assert_eq!(catmull_rom_weights(0.0), [0.0, 1.0, 0.0, 0.0]);
    }

    #[test]
    fn the_spline_of_the_coefficients_passes_through_the_voxels() {
        let dims = [9, 7, 6];
        let voxels: Vec<f64> = (0..dims.iter().product::<usize>()).map(|i| ((i * 7919) % 101) as f64).collect();
        let mut coefficients = voxels.clone();
        bspline_coefficients(dims, &mut coefficients);
        let weights = [bspline_weights(0.0); 3];
        for (z, y, x) in [(1, 1, 1), (2, 3, 4), (3, 4, 6), (4, 5, 7)] {
            let values = std::array::from_fn(|i| {
                let at = [x + i % 4 - 1, y + i / 4 % 4 - 1, z + i / 16 - 1];
                // The weight of the fourth neighbour is 0 here, so any voxel is right.
                let at: [usize; 3] = std::array::from_fn(|a| at[a].min(dims[a] - 1));
                coefficients[at[0] + dims[0] * (at[1] + dims[1] * at[2])]
            });
            let voxel = voxels[x + dims[0] * (y + dims[1] * z)];
            assert!((tricubic(&values, weights) - voxel).abs() < 1e-9);
        }
    }
}
