//! Places of rays in a tile.

use super::walk::BLOCK_SIDE;

/// Pixels along each side of a tile.
pub const TILE_SIDE: u32 = 16;
/// Rays of a tile.
pub const TILE_RAYS: usize = (TILE_SIDE * TILE_SIDE) as usize;

/// Place in the tile of ray number `ray`: neighbours in number are neighbours in the picture.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "a tile has few rays")]
pub const fn place_of(ray: usize) -> [u32; 2] {
    let ray = ray as u32;
    let (block, inside) = (ray / (BLOCK_SIDE * BLOCK_SIDE), ray % (BLOCK_SIDE * BLOCK_SIDE));
    let blocks = TILE_SIDE / BLOCK_SIDE;
    [block % blocks * BLOCK_SIDE + inside % BLOCK_SIDE, block / blocks * BLOCK_SIDE + inside / BLOCK_SIDE]
}
