//! Error bounds of macro cells: one byte for each cell of a brick of level 1 or more. Levels that are thinner than a macro cell
//! hold none: a byte would stand for far fewer than 8^3 voxels.
//!
//! The bound of a macro cell holds in its region, `[8m - 1/2, 8m + 7 1/2]` along each axis ([`crate::macro_cells`]), as the bound of
//! a brick does in the brick ([`BrickEntry::error`](crate::container::toc::BrickEntry::error)).
//!
//! Byte 0 is the bound 0. Byte c is the brick's bound times `2^((c - 255) / 16)`: steps of 4.4 %, from the brick's bound down to
//! 1/65,000 of it. Bounds are rounded up.

use crate::brick::MACRO_CELL;
use crate::{BrickKey, Lod, Pyramid};

/// Bytes per macro cell in a container.
pub const CELL_ERROR_BYTES: usize = 1;
/// Byte of the brick's own bound.
const GREATEST: u8 = 255;
/// `2^(-i / 16)`. Written out, so that every machine has the same bits.
const SIXTEENTHS: [f64; 16] = [
    1.0,
    0.957_603_280_698_573_7,
    0.917_004_043_204_671_2,
    0.878_126_080_186_649_7,
    0.840_896_415_253_714_5,
    0.805_245_165_974_627_1,
    0.771_105_412_703_970_4,
    0.738_413_072_969_749_7,
    std::f64::consts::FRAC_1_SQRT_2,
    0.677_127_773_468_446_3,
    0.648_419_777_325_504_8,
    0.620_928_906_036_742,
    0.594_603_557_501_360_5,
    0.569_394_317_378_345_8,
    0.545_253_866_332_628_8,
    0.522_136_891_213_706_9,
];

/// Whether the macro cells of a brick have bounds of their own in a container of the newest version.
#[must_use]
pub fn are_held(pyramid: &Pyramid, key: BrickKey) -> bool {
    key.lod() > Lod::FINEST && pyramid.level_at(key.lod()).dims.0.iter().all(|&n| n >= MACRO_CELL as u64)
}

/// Bound that a byte stands for in a brick with the bound `of_brick`.
#[must_use]
pub fn dequantize(code: u8, of_brick: f64) -> f64 {
    if code == 0 {
        return 0.0;
    }
    let sixteenths = usize::from(GREATEST - code);
    // Exact, as long as the result is no denormal number.
    let octaves = f64::from(1u32 << (sixteenths / SIXTEENTHS.len())).recip();
    of_brick * SIXTEENTHS[sixteenths % SIXTEENTHS.len()] * octaves
}

/// Bytes of bounds in a brick with the bound `of_brick`, none of which is greater than that.
#[must_use]
pub fn quantize(errors: &[f64], of_brick: f64) -> Vec<u8> {
    let bounds: Vec<f64> = (0..=GREATEST).map(|code| dequantize(code, of_brick)).collect();
    let code = |&error: &f64| {
        // The least code whose bound is not below; bounds ascend with their codes.
        let code = bounds.partition_point(|&bound| bound < error);
        u8::try_from(code).unwrap_or(GREATEST)
    };
    errors.iter().map(code).collect()
}

/// Decodes the bytes of [`quantize`].
#[must_use]
pub fn dequantize_cells(bytes: &[u8], of_brick: f64) -> Vec<f64> {
    bytes.iter().map(|&code| dequantize(code, of_brick)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn the_table_holds_the_powers_and_codes_ascend() {
        for (i, &share) in SIXTEENTHS.iter().enumerate() {
            assert!((share - 2f64.powf(-(i as f64) / 16.0)).abs() < 1e-15, "{i}");
        }
        let bounds: Vec<f64> = (0..=255).map(|code| dequantize(code, 3.0)).collect();
        assert!(bounds.windows(2).all(|pair| pair[0] < pair[1]));
        assert_eq!((bounds[0], bounds[255], bounds[239]), (0.0, 3.0, 1.5));
    }

    #[test]
    fn bytes_are_bounds_and_tight() {
        let mut random = Random::new(46);
        for of_brick in [1e-300, 0.5, 943.75, 1e300] {
            let errors: Vec<f64> = (0..4000)
                .map(|_| of_brick * 2f64.powf(-17.0 * (random.below(1 << 20) as f64 / f64::from(1 << 20))))
                .collect();
            let found = dequantize_cells(&quantize(&errors, of_brick), of_brick);
            for (&error, &bound) in errors.iter().zip(&found) {
                assert!(error <= bound, "{error} of {of_brick} became {bound}");
                assert!(bound <= 1.045 * error || bound <= of_brick / 60_000.0, "{error} of {of_brick} became {bound}");
            }
        }
        assert_eq!(quantize(&[0.0, 7.0], 7.0), [0, 255]);
        assert_eq!(quantize(&[0.0], 0.0), [0]);
        // An unknown bound stays unknown: it becomes neither a small one, nor NaN.
        let infinite = quantize(&[0.0, 1.0, f64::INFINITY], f64::INFINITY);
        assert_eq!(dequantize_cells(&infinite, f64::INFINITY), [0.0, f64::INFINITY, f64::INFINITY]);
        // Denormal numbers have no such steps, but bounds still.
        let tiny = quantize(&[f64::from_bits(3)], f64::from_bits(7));
        assert!(dequantize(tiny[0], f64::from_bits(7)) >= f64::from_bits(3));
    }
}
