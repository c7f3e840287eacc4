//! Seeded noise without state: hashes of coordinates, and a small generator for tables.
//!
//! It uses integer arithmetic only, so that the same seed gives the same numbers everywhere.

use supervol_format::random::Random;

use crate::cast::low_32;

/// Generator of a seed for one purpose, for tables that are computed once.
pub(super) fn numbers_for(purpose: u64, seed: u64) -> Random {
    Random::new(seed ^ purpose.wrapping_mul(0xd6e8_feb8_6659_fd93))
}

/// Randomly 1 or -1.
pub(super) fn sign(random: &mut Random) -> f64 {
    if random.next_u64() & 1 == 0 { 1.0 } else { -1.0 }
}

/// Hash of 32 bits (the finaliser of MurmurHash3, Appleby 2011).
#[inline]
pub(super) fn mix(mut h: u32) -> u32 {
    h ^= h >> 16;
    h = h.wrapping_mul(0x85eb_ca6b);
    h ^= h >> 13;
    h = h.wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

/// Hash that the voxels of a row along x share. Coordinates are below 2^32, as every axis is.
pub(super) fn row_hash(seed: u64, y: u64, z: u64) -> u32 {
    let seed = mix(low_32(seed) ^ mix(low_32(seed >> 32) ^ 0x5bd1_e995));
    mix(mix(seed.wrapping_add(low_32(y).wrapping_mul(0x27d4_eb2f))).wrapping_add(low_32(z).wrapping_mul(0x1656_67b1)))
}

/// Noise of the voxel x of a row: between -1 and 1, symmetric about 0, with a triangular distribution.
#[inline]
pub(super) fn voxel_noise(row: u32, x: u32) -> f32 {
    let h = mix(row.wrapping_add(x.wrapping_mul(0x9e37_79b1)));
    let sum = (h & 0xffff).cast_signed() + (h >> 16).cast_signed() - 0xffff;
    sum as f32 * (1.0 / 65536.0)
}
