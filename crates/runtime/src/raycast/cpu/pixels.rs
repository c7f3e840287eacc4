//! Tiles back to pixels: row by row from the top.

use super::packets::{Tile, tiles_of};
use super::tile::{TILE_RAYS, TILE_SIDE, place_of};
use super::{CpuFrame, RayState};

/// The pixels of all tiles, row by row from the top; of rays that wait `waiting` makes one.
#[must_use]
pub fn pixels_of(frame: &CpuFrame, tiles: &[Tile], waiting: impl Fn(&RayState) -> [f32; 4]) -> Vec<[f32; 4]> {
    row_by_row(frame, tiles, |tile, ray| match tile {
        Tile::Fresh => waiting(&RayState::new(None)),
        Tile::Finished(finished) => finished.pixels[ray],
        Tile::Waiting(gathered) => waiting(&gathered.state(ray)),
    })
}

/// What the rays of all tiles may be off by, row by row from the top, grey; NaN of those that are not finished.
#[must_use]
pub fn error_pixels_of(frame: &CpuFrame, tiles: &[Tile]) -> Vec<[f32; 4]> {
    row_by_row(frame, tiles, |tile, ray| {
        tile.errors().map_or([f32::NAN; 4], |errors| {
            let error = errors.of_rays[ray];
            [error, error, error, 1.0]
        })
    })
}

/// What `pixel` says of each ray, row by row from the top.
fn row_by_row(frame: &CpuFrame, tiles: &[Tile], pixel: impl Fn(&Tile, usize) -> [f32; 4]) -> Vec<[f32; 4]> {
    let (width, height) = (frame.camera.width as usize, frame.rows.len());
    let columns = tiles_of(frame)[0] as usize;
    let mut pixels = vec![[0.0; 4]; width * height];
    for (index, tile) in tiles.iter().enumerate() {
        let corner = [index % columns, index / columns].map(|i| i * TILE_SIDE as usize);
        for ray in 0..TILE_RAYS {
            let [x, y] = place_of(ray).map(|v| v as usize);
            let (x, y) = (corner[0] + x, corner[1] + y);
            if x < width && y < height {
                pixels[y * width + x] = pixel(tile, ray);
            }
        }
    }
    pixels
}
