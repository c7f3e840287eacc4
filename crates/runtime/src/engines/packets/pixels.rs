//! Tiles between passes, and their pixels: row by row from the top.

use supervol_format::cast::narrow;

use super::noted::{TileErrors, TileWork};
use super::places::{TILE_RAYS, TILE_SIDE, place_of};
use super::tile::Gathered;
use crate::engines::ray::{RayState, pixel_of_light};
use crate::engines::ray_scene::RayScene;

/// Tiles along both sides of the rows of a picture.
#[must_use]
pub fn tiles_of(scene: &RayScene) -> [u32; 2] {
    [scene.camera.width.div_ceil(TILE_SIDE), narrow::<u32>(scene.rows.len()).div_ceil(TILE_SIDE)]
}

/// One tile between passes.
#[derive(Debug, Clone, Default)]
pub enum Tile {
    /// Not cast yet.
    #[default]
    Fresh,
    /// Some rays wait.
    Waiting(Box<Gathered>),
    /// Every ray is finished: premultiplied colour and opacity of each.
    Finished(Box<FinishedTile>),
}

/// A finished tile.
#[derive(Debug, Clone)]
pub struct FinishedTile {
    /// Premultiplied colour and opacity of each ray.
    pub(super) pixels: Box<[[f32; 4]]>,
    /// Rays that ended before they left the volume.
    pub(super) terminated_early: u64,
    /// Errors of its rays, if they were summed up.
    pub(super) errors: Option<Box<TileErrors>>,
    /// Work of its rays, if it was counted.
    pub(super) work: Option<Box<TileWork>>,
}

impl FinishedTile {
    /// Bytes held, without errors and work.
    pub(super) const BYTES: usize = size_of::<Self>() + TILE_RAYS * size_of::<[f32; 4]>();
}

impl Tile {
    /// Rays that wait for a brick.
    #[must_use]
    pub fn waiting(&self) -> u64 {
        match self {
            Self::Waiting(gathered) => gathered.waiting.iter().flatten().count() as u64,
            Self::Fresh | Self::Finished(_) => 0,
        }
    }

    /// Rays that ended before they left the volume, once the tile is finished.
    #[must_use]
    pub fn terminated_early(&self) -> u64 {
        match self {
            Self::Finished(tile) => tile.terminated_early,
            Self::Fresh | Self::Waiting(_) => 0,
        }
    }

    /// Errors of its rays, once the tile is finished, if they were summed up.
    #[must_use]
    pub fn errors(&self) -> Option<&TileErrors> {
        match self {
            Self::Finished(tile) => tile.errors.as_deref(),
            Self::Fresh | Self::Waiting(_) => None,
        }
    }

    /// Work of its rays, once the tile is finished, if it was counted.
    #[must_use]
    pub fn work(&self) -> Option<&TileWork> {
        match self {
            Self::Finished(tile) => tile.work.as_deref(),
            Self::Fresh | Self::Waiting(_) => None,
        }
    }
}

/// The pixels of all tiles, row by row from the top; `waiting` makes the pixel of a ray that waits.
#[must_use]
pub fn pixels_of(scene: &RayScene, tiles: &[Tile], waiting: impl Fn(&RayState) -> [f32; 4]) -> Vec<[f32; 4]> {
    row_by_row(scene, tiles, |tile, ray| match tile {
        Tile::Fresh => waiting(&RayState::new(None)),
        Tile::Finished(finished) => finished.pixels[ray],
        Tile::Waiting(gathered) => waiting(&gathered.state(ray)),
    })
}

/// The pixels of a tile whose rays are finished, in the rays' own order.
pub(super) fn pixels_of_tile(scene: &RayScene, gathered: &Gathered) -> Box<[[f32; 4]]> {
    if !scene.has_transmittance() {
        return (0..TILE_RAYS).map(|ray| scene.pixel(&gathered.state(ray))).collect();
    }
    let ([red, green, blue], transmittance) = (&gathered.color, &gathered.transmittance);
    (0..TILE_RAYS).map(|i| pixel_of_light([red[i], green[i], blue[i]], transmittance[i])).collect()
}

/// Errors of the rays of all tiles, row by row from the top, grey; NaN in tiles that are not finished.
#[must_use]
pub fn error_pixels_of(scene: &RayScene, tiles: &[Tile]) -> Vec<[f32; 4]> {
    row_by_row(scene, tiles, |tile, ray| {
        tile.errors().map_or([f32::NAN; 4], |errors| {
            let error = errors.of_rays[ray];
            [error, error, error, 1.0]
        })
    })
}

/// Work of the rays of all tiles, row by row from the top: cells, leaps, 0, 1; NaN in tiles that are not finished.
#[must_use]
pub fn work_pixels_of(scene: &RayScene, tiles: &[Tile]) -> Vec<[f32; 4]> {
    row_by_row(scene, tiles, |tile, ray| {
        tile.work().map_or([f32::NAN; 4], |work| {
            let [cells, leaps] = work[ray].map(|count| count as f32);
            [cells, leaps, 0.0, 1.0]
        })
    })
}

/// Results of `pixel` for all rays, row by row from the top.
fn row_by_row(scene: &RayScene, tiles: &[Tile], pixel: impl Fn(&Tile, usize) -> [f32; 4]) -> Vec<[f32; 4]> {
    let (width, height) = (scene.camera.width as usize, scene.rows.len());
    let columns = tiles_of(scene)[0] as usize;
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
