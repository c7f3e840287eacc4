//! Proximity clouds of a brick: how far each macro cell is from the nearest one that may show something.
//!
//! The distance is Chebyshev's, in macro cells (Cohen, Sheffer 1994; Deakin, Knackstedt 2019): at distance k, the cube of
//! `2k - 1` macro cells around shows nothing, and a ray may leap to its face. Bricks end the cloud: what lies beyond is
//! another brick's, and whole bricks without anything to show are never entered.

use crate::raycast::volume::DecodedBrick;
use supervol_format::brick::MACRO_CELL;

/// Bytes after the last distance.
const PADDING: usize = 3;

/// Distances of a brick's macro cells, x fastest: 0 may show something.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProximityCloud {
    /// Macro cells along each axis.
    pub cells: [usize; 3],
    /// One per macro cell, and [`PADDING`] more, so that words can be read.
    pub distances: Vec<u8>,
    /// Whether all are 0: nothing to leap over.
    pub is_dense: bool,
    /// Whether none is 0: nothing to see.
    pub is_empty: bool,
}

impl ProximityCloud {
    /// The cloud of a brick; `shows` is asked for each range of render values.
    #[must_use]
    pub fn new(brick: &DecodedBrick, apron: usize, shows: impl Fn([f32; 2]) -> bool) -> Self {
        let cells = brick.extent.map(|n| (n as usize - 2 * apron).div_ceil(MACRO_CELL));
        let most = cells.iter().copied().max().unwrap_or(1).min(255) as u8;
        let mut distances: Vec<u8> =
            brick.macro_ranges.iter().map(|&range| if shows(range) { 0 } else { most }).collect();
        let is_dense = distances.iter().all(|&d| d == 0);
        let is_empty = distances.iter().all(|&d| d > 0);
        if !is_dense && !is_empty {
            spread(&mut distances, cells);
        }
        distances.extend([0; PADDING]);
        Self { cells, distances, is_dense, is_empty }
    }

    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        (size_of::<Self>() + size_of_val(&self.distances[..])) as u64
    }
}

/// Lowers every distance to the nearest zero's plus the way to it: two sweeps over the 13 neighbours before and after,
/// exact for Chebyshev's distance (Borgefors 1986).
fn spread(distances: &mut [u8], [nx, ny, nz]: [usize; 3]) {
    let sweep = |distances: &mut [u8], x: usize, y: usize, z: usize, sign: isize| {
        let mut least = distances[x + nx * (y + ny * z)];
        for dz in -1..=0isize {
            for dy in -1..=1isize {
                for dx in -1..=1isize {
                    let before = dz < 0 || (dz == 0 && (dy < 0 || (dy == 0 && dx < 0)));
                    let [px, py, pz] = [(x, dx), (y, dy), (z, dz)].map(|(at, d)| at.wrapping_add_signed(sign * d));
                    if before && px < nx && py < ny && pz < nz {
                        least = least.min(distances[px + nx * (py + ny * pz)] + 1);
                    }
                }
            }
        }
        distances[x + nx * (y + ny * z)] = least;
    };
    let places = |i: usize| (i % nx, i / nx % ny, i / (nx * ny));
    for i in 0..distances.len() {
        let (x, y, z) = places(i);
        sweep(distances, x, y, z, 1);
    }
    for i in (0..distances.len()).rev() {
        let (x, y, z) = places(i);
        sweep(distances, x, y, z, -1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_brute_force() {
        let cells = [5, 3, 4];
        let mut seed = 3u32;
        for _ in 0..200 {
            let mut random = || {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                seed >> 24
            };
            let shown: Vec<bool> = (0..60).map(|_| random() < 12).collect();
            if !shown.contains(&true) {
                continue;
            }
            let mut distances: Vec<u8> = shown.iter().map(|&s| if s { 0 } else { 5 }).collect();
            spread(&mut distances, cells);
            let place = |i: usize| [i % 5, i / 5 % 3, i / 15];
            for (i, &found) in distances.iter().enumerate() {
                let far = |j: usize| (0..3).map(|a| place(i)[a].abs_diff(place(j)[a])).max().unwrap();
                let expected = (0..60).filter(|&j| shown[j]).map(far).min().unwrap();
                assert_eq!(found, expected as u8);
            }
        }
    }
}
