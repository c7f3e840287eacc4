//! Rays of a picture in tiles.

use supervol_format::BrickKey;
use supervol_scene::image::Image;

use super::cast::cast_tiles;
use super::frame::PacketFrame;
use super::pixels::{Tile, error_pixels_of, pixels_of, tiles_of, work_pixels_of};
use crate::engines::feedback::PassFeedback;
use crate::engines::totals::ErrorsByReason;
use crate::stop::Stop;
use crate::stream::residency::{BrickView, KnownEntry, Resident};

/// The rays of a picture, and the picture that they are cast for.
#[derive(Debug, Clone)]
pub struct PacketRays {
    frame: PacketFrame,
    tiles: Vec<Tile>,
}

impl PacketRays {
    /// All rays before the first pass.
    #[must_use]
    pub fn new(frame: PacketFrame) -> Self {
        let [columns, rows] = tiles_of(&frame.scene);
        Self { frame, tiles: vec![Tile::Fresh; columns as usize * rows as usize] }
    }

    /// Sets the stop condition. At the stop, rays wait at their place and continue there in the next pass.
    pub(crate) fn set_stop(&mut self, stop: Stop) {
        self.frame.set_stop(stop);
    }

    /// Casts every unfinished ray as far as resident bricks allow.
    ///
    /// # Panics
    /// If a brick's size is not what the pyramid says.
    pub fn cast_pass<V: BrickView + ?Sized>(&mut self, view: &V) -> PassFeedback {
        PassFeedback::merged(cast_tiles(&Viewed(view), &self.frame, &mut self.tiles))
    }

    /// The picture of what the rays have gathered, sub-grid averaged.
    #[must_use]
    pub fn image(&self) -> Image {
        let scene = &self.frame.scene;
        scene.image_of(pixels_of(scene, &self.tiles, |state| scene.pixel(state)))
    }

    /// The picture of finished tiles, sub-grid averaged: NaN elsewhere, and where pixels are not asked for.
    #[must_use]
    pub fn finished_pixels(&self) -> Image {
        let scene = &self.frame.scene;
        scene.image_of(pixels_of(scene, &self.tiles, |_| [f32::NAN; 4]))
    }

    /// Error of each pixel of finished tiles, sub-grid averaged: grey, 1 is white, NaN elsewhere. `None` if errors are
    /// not summed up.
    #[must_use]
    pub fn error_pixels(&self) -> Option<Image> {
        self.frame.deviations.as_ref()?;
        let scene = &self.frame.scene;
        Some(scene.image_of(error_pixels_of(scene, &self.tiles)))
    }

    /// Work of each pixel's rays in finished tiles, sub-grid averaged: cells, leaps, 0, 1; NaN elsewhere. `None` if
    /// work is not counted.
    #[must_use]
    pub fn work_pixels(&self) -> Option<Image> {
        let scene = &self.frame.scene;
        self.frame.tables.counts_work().then(|| scene.image_of(work_pixels_of(scene, &self.tiles)))
    }

    /// Largest errors of rays; zero unless they are summed up.
    #[must_use]
    pub fn errors(&self) -> ErrorsByReason {
        let errors = self.tiles.iter().filter_map(Tile::errors);
        errors.fold(ErrorsByReason::default(), |greatest, tile| greatest.or(tile.greatest))
    }

    /// Rays that wait for a brick.
    #[must_use]
    pub fn waiting(&self) -> u64 {
        self.tiles.iter().map(Tile::waiting).sum()
    }

    /// Whether every ray is finished.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.tiles.iter().all(|tile| matches!(tile, Tile::Finished(_)))
    }

    /// Rays that ended before they left the volume.
    #[must_use]
    pub fn terminated_early(&self) -> u64 {
        self.tiles.iter().map(Tile::terminated_early).sum()
    }

    /// Rays of the picture; of the pixels that are asked for, if these are not all.
    #[must_use]
    pub fn ray_count(&self) -> u64 {
        let PacketFrame { scene, asked, .. } = &self.frame;
        asked.as_ref().map_or_else(|| scene.ray_count(), |asked| asked.rays_in(&scene.rows))
    }
}

/// A view of any kind as one that can be named: the packet caster is compiled once.
struct Viewed<'a, V: ?Sized>(&'a V);

impl<V: BrickView + ?Sized> BrickView for Viewed<'_, V> {
    fn lookup(&self, key: BrickKey) -> Resident<'_> {
        self.0.lookup(key)
    }

    fn stand_in(&self, key: BrickKey) -> Resident<'_> {
        self.0.stand_in(key)
    }

    fn entry(&self, key: BrickKey) -> Option<KnownEntry> {
        self.0.entry(key)
    }
}
