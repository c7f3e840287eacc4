//! Gradient operators at a voxel, index space: value change per voxel.

use supervol_format::cast::narrow;

use super::GradientOperator;

/// Weights of Sobel's smoothing across the direction of the difference; their sum is 1.
const SOBEL: [f64; 3] = [0.25, 0.5, 0.25];

/// Gradient at a voxel from its neighbours `value([dx, dy, dz])`, offsets -1 to 1. NaN if a needed neighbour is NaN.
///
/// `Intermediate` has no own gradient at voxels: its two half-voxel differences average to the central difference.
#[must_use]
pub fn gradient_at_voxel(operator: GradientOperator, value: impl Fn([i32; 3]) -> f64) -> [f64; 3] {
    std::array::from_fn(|axis| match operator {
        GradientOperator::Central | GradientOperator::Intermediate => {
            let tap = |step: i32| {
                let mut offset = [0; 3];
                offset[axis] = step;
                value(offset)
            };
            0.5 * (tap(1) - tap(-1))
        }
        GradientOperator::Sobel => {
            let mut sum = 0.0;
            for b in -1..=1 {
                for c in -1..=1 {
                    let weight = SOBEL[narrow::<usize>(b + 1)] * SOBEL[narrow::<usize>(c + 1)];
                    let tap = |step: i32| {
                        let mut offset = [0; 3];
                        offset[axis] = step;
                        offset[(axis + 1) % 3] = b;
                        offset[(axis + 2) % 3] = c;
                        value(offset)
                    };
                    sum += weight * 0.5 * (tap(1) - tap(-1));
                }
            }
            sum
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_of_linear_fields_are_exact() {
        let field = |o: [i32; 3]| 5.0 + 2.0 * f64::from(o[0]) - 3.0 * f64::from(o[1]) + 0.5 * f64::from(o[2]);
        for operator in [GradientOperator::Central, GradientOperator::Intermediate, GradientOperator::Sobel] {
            assert_eq!(gradient_at_voxel(operator, field), [2.0, -3.0, 0.5]);
        }
    }
}
