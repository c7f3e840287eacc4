//! A finished or unfinished picture, with all that is known of it.

use supervol_runtime::engines::maps::Maps;
use supervol_runtime::render::accuracy::check::{ErrorMeasured, measure_error};
use supervol_runtime::render::accuracy::stated::ErrorStated;
use supervol_runtime::render::options::RenderOptions;
use supervol_runtime::render::stats::FrameStats;
use supervol_runtime::render::volume::PlacedVolume;
use supervol_runtime::stream::state::Failure;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use crate::error::Error;

/// A picture, its failures and its stated error.
#[derive(Clone)]
pub struct Picture {
    volume: PlacedVolume,
    scene: ResolvedScene,
    options: RenderOptions,
    image: Image,
    maps: Maps,
    stats: FrameStats,
}

impl std::fmt::Debug for Picture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let size = [self.image.width, self.image.height];
        f.debug_struct("Picture").field("size", &size).field("stats", &self.stats).finish_non_exhaustive()
    }
}

impl Picture {
    pub(crate) fn new(
        (volume, scene, options): (PlacedVolume, ResolvedScene, RenderOptions),
        image: Image,
        maps: Maps,
        stats: FrameStats,
    ) -> Self {
        Self { volume, scene, options, image, maps, stats }
    }

    /// The picture before the background is added: premultiplied red, green, blue and opacity, row by row from the top.
    #[must_use]
    pub fn image(&self) -> &Image {
        &self.image
    }

    /// Red, green and blue bytes over the scene's background, row by row from the top.
    #[must_use]
    pub fn to_rgb8(&self) -> Vec<u8> {
        self.image.to_rgb8(self.scene.background)
    }

    /// Writes the picture. The name's ending chooses the format: `.png` (8 bits, over the background), `.exr` or `.npy` (floats
    /// without the background). An existing file is replaced.
    ///
    /// # Errors
    /// If the ending is none of these, or the file cannot be written.
    #[cfg(feature = "images")]
    pub fn save(&self, path: impl AsRef<std::path::Path>) -> Result<(), Error> {
        Ok(self.image.write(path.as_ref(), self.scene.background)?)
    }

    /// Whether every pixel is finished from the bricks that it wants, none of which failed.
    #[must_use]
    pub fn is_converged(&self) -> bool {
        self.stats.converged
    }

    /// Number of bricks that could not be read or decoded. Where it is not 0, the picture is not what the data show.
    #[must_use]
    pub fn failed_bricks(&self) -> u64 {
        self.stats.bricks_failed
    }

    /// Some of the bricks that could not be read or decoded, with reasons.
    #[must_use]
    pub fn failures(&self) -> &[Failure] {
        &self.stats.failures
    }

    /// Distance of the picture from the exact one of the finest level, as the engine states it.
    ///
    /// `None` unless [`Options::predict_error`](RenderOptions::predict_error) is set, and of backends that cannot state it.
    ///
    /// ```
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("ball.svol");
    /// # supervol::doc_container(&path)?;
    /// use supervol::{Options, Scene, Volume};
    ///
    /// let options = Options { predict_error: true, ..Options::default() };
    /// let picture = Volume::open(&path)?.draw(&Scene::default(), &options)?;
    /// let stated = picture.error_stated().expect("it was asked for");
    /// assert!(stated.largest_grey_levels >= stated.mean_grey_levels);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn error_stated(&self) -> Option<&ErrorStated> {
        self.stats.error_stated.as_ref()
    }

    /// The stated error of each pixel, as a grey picture in which 1 is full scale; `None` as in [`Picture::error_stated`].
    #[must_use]
    pub fn error_map(&self) -> Option<&Image> {
        self.maps.errors.as_ref()
    }

    /// Everything that was counted and measured.
    #[must_use]
    pub fn stats(&self) -> &FrameStats {
        &self.stats
    }

    /// Casts about `rays` rays of the picture again by the brute-force reference integrator, and compares.
    ///
    /// ```
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("ball.svol");
    /// # supervol::doc_container(&path)?;
    /// use supervol::{Options, Scene, Volume};
    ///
    /// let picture = Volume::open(&path)?.draw(&Scene::default(), &Options::default())?;
    /// let measured = picture.check(200)?;
    /// assert!(measured.largest_grey_levels <= 0.5, "the default error is half a grey level");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If the level does not fit the host budget, or a brick cannot be read.
    pub fn check(&self, rays: u64) -> Result<ErrorMeasured, Error> {
        Ok(measure_error(self.volume.container(), &self.scene, &self.options, &self.image, rays, &|_| {})?)
    }
}
