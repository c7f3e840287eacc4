//! Bins of fixed size that follow the order of the values.
//!
//! 8- and 16-bit voxels have a bin per value. Wider voxels are binned by sign, exponent and the upper 7 bits of the
//! mantissa, which resolves values to 1 part in 128 at any magnitude.

use supervol_format::VoxelType;
use supervol_format::cast::{narrow, single, whole};

/// Bits of a number that select its bin: sign, exponent (8 bits in single, 11 in double precision), 7 of the mantissa.
const SINGLE_BITS: u32 = 16;
const DOUBLE_BITS: u32 = 19;

/// Number of bins for voxels of this type.
pub fn bins(voxel_type: VoxelType) -> usize {
    if voxel_type == VoxelType::F64 { 1 << DOUBLE_BITS } else { 1 << SINGLE_BITS }
}

/// Bin of a stored value; greater values never have a smaller bin.
pub fn key(voxel_type: VoxelType, value: f64) -> usize {
    match voxel_type {
        VoxelType::U8 | VoxelType::U16 => whole(value),
        VoxelType::I8 => whole(value + 128.0),
        VoxelType::I16 => whole(value + 32768.0),
        VoxelType::F64 => {
            // Doubles in the range of f32 are rounded to f32 first, as for the other types.
            let rounded = single(value);
            let value = if rounded.is_normal() { f64::from(rounded) } else { value };
            (sortable(value) >> (64 - DOUBLE_BITS)) as usize
        }
        _ => {
            // Integers stay below infinity in f32, and present floats are finite.
            let bits = single(value).to_bits();
            // Floats sort like integers if negative ones have all bits flipped, and the others the sign bit.
            let sortable = if bits >> 31 == 1 { !bits } else { bits | 1 << 31 };
            (sortable >> (32 - SINGLE_BITS)) as usize
        }
    }
}

/// Bits that sort like the numbers: negative numbers have all bits flipped, the others the sign bit.
fn sortable(value: f64) -> u64 {
    let bits = value.to_bits();
    if bits >> 63 == 1 { !bits } else { bits | 1 << 63 }
}

/// Stored value of a bin: the value itself, or the middle of the bin.
pub fn value_of(voxel_type: VoxelType, bin: usize) -> f64 {
    match voxel_type {
        VoxelType::U8 | VoxelType::U16 => bin as f64,
        VoxelType::I8 => bin as f64 - 128.0,
        VoxelType::I16 => bin as f64 - 32768.0,
        // Zero is common, and the middle of its bin would be an arbitrary number.
        VoxelType::F64 if bin == key(VoxelType::F64, 0.0) => 0.0,
        VoxelType::F64 => {
            let sortable = (bin as u64) << (64 - DOUBLE_BITS) | 1 << (63 - DOUBLE_BITS);
            let middle = if sortable >> 63 == 1 { sortable & !(1 << 63) } else { !sortable };
            // Bits that f32 has, too: the middle is the same number for both types.
            f64::from_bits(middle & !((1 << 29) - 1))
        }
        _ => {
            let sortable = narrow::<u32>(bin) << (32 - SINGLE_BITS) | 1 << (31 - SINGLE_BITS);
            let bits = if sortable >> 31 == 1 { sortable & !(1 << 31) } else { !sortable };
            f64::from(f32::from_bits(bits))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_follow_the_order_of_values() {
        let single = [-1e30, -5.0, -1.0, -1e-20, 0.0, 1e-20, 1.0, 2.0, 3e4, 1e30];
        let double = [f64::MIN, -1e300, -5.0, -1e-45, -1e-300, 0.0, 1e-300, 1.1e-300, 1e-45, 1.0, 1e38, 1e39, 1e300];
        for (voxel_type, values) in
            [(VoxelType::F32, &single[..]), (VoxelType::F64, &single), (VoxelType::F64, &double)]
        {
            let bins: Vec<usize> = values.iter().map(|&v| key(voxel_type, v)).collect();
            assert!(bins.windows(2).all(|w| w[0] < w[1]), "{bins:?}");
            for &v in values.iter().filter(|v| **v != 0.0) {
                let back = value_of(voxel_type, key(voxel_type, v));
                assert!((back - v).abs() <= v.abs() / 128.0, "{v} became {back}");
            }
        }
    }

    #[test]
    fn doubles_are_counted_as_the_singles_are_that_they_round_to() {
        for value in [-1e30_f64, -0.1, 1.0 - 1e-9, 0.3, 7e-38, 3.4e38] {
            let [single, double] = [VoxelType::F32, VoxelType::F64].map(|of| value_of(of, key(of, value)));
            assert_eq!(single, double, "{value}");
        }
    }
}
