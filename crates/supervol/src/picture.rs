//! A finished or unfinished picture, with all that is known of it.

use supervol_runtime::engines::maps::Maps;
use supervol_runtime::render::accuracy::check::{CheckProgress, ErrorMeasured, measure_error};
use supervol_runtime::render::accuracy::stated::ErrorStated;
use supervol_runtime::render::fidelity::{Circumstances, Dimension, Fidelity, Outlook};
use supervol_runtime::render::options::RenderOptions;
use supervol_runtime::render::record::{Drawn, DrawnBy, PictureRecord};
use supervol_runtime::render::stats::FrameStats;
use supervol_runtime::render::volume::PlacedVolume;
use supervol_runtime::stream::state::Failure;
use supervol_scene::image::{Image, ImageFormat};
use supervol_scene::scene::{ResolvedScene, Scene};

use crate::error::Error;

/// A picture, its failures and its stated error.
#[derive(Clone)]
pub struct Picture {
    subject: Subject,
    image: Image,
    maps: Maps,
    stats: FrameStats,
}

/// Volume, scene and options of a picture.
#[derive(Clone)]
pub(crate) struct Subject {
    pub volume: PlacedVolume,
    /// The complete scene.
    pub complete: Scene,
    /// The same as engines draw it.
    pub scene: ResolvedScene,
    pub options: RenderOptions,
    pub engine: DrawnBy,
    pub outlook: Outlook,
    /// Dimensions along which earlier pictures were reduced for a time.
    pub once: Vec<Dimension>,
}

impl Subject {
    /// A picture that is drawn once, by this engine.
    pub(crate) fn drawn_once(
        volume: PlacedVolume,
        scene: &Scene,
        options: &RenderOptions,
        engine: DrawnBy,
    ) -> Result<Self, Error> {
        let complete = volume.complete(scene)?;
        let scene = complete.resolve(volume.facts())?;
        let (options, outlook) = (options.clone(), Outlook::Final);
        Ok(Self { volume, complete, scene, options, engine, outlook, once: Vec::new() })
    }

    pub(crate) fn fidelity(&self, stats: &FrameStats, format: Option<ImageFormat>) -> Fidelity {
        let Self { outlook, ref once, .. } = *self;
        Fidelity::of(&self.drawn(stats), &Circumstances { format, outlook, once })
    }

    fn drawn<'a>(&'a self, stats: &'a FrameStats) -> Drawn<'a> {
        let Self { volume, complete: scene, options, engine, .. } = self;
        Drawn { container: volume.container(), facts: volume.facts(), scene, options, stats, engine: *engine }
    }
}

impl std::fmt::Debug for Picture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let size = [self.image.width, self.image.height];
        f.debug_struct("Picture").field("size", &size).field("stats", &self.stats).finish_non_exhaustive()
    }
}

impl Picture {
    pub(crate) fn new(subject: Subject, image: Image, maps: Maps, stats: FrameStats) -> Self {
        Self { subject, image, maps, stats }
    }

    /// The picture before the background is added: premultiplied red, green, blue and opacity, row by row from the top.
    #[must_use]
    pub fn image(&self) -> &Image {
        &self.image
    }

    /// Red, green and blue bytes over the scene's background, row by row from the top.
    #[must_use]
    pub fn to_rgb8(&self) -> Vec<u8> {
        self.image.to_rgb8(self.subject.scene.background)
    }

    /// The scene as engines drew it: everything that it left open is filled in, in the units of the picture.
    #[must_use]
    pub fn resolved(&self) -> &ResolvedScene {
        &self.subject.scene
    }

    /// The volume at the place where it was drawn.
    #[must_use]
    pub fn volume(&self) -> &PlacedVolume {
        &self.subject.volume
    }

    /// Writes the picture. The name's ending chooses the format: `.png` (8 bits, over the background), `.exr` or `.npy` (floats
    /// without the background). An existing file is replaced.
    ///
    /// PNG and OpenEXR files carry the picture's [record](Self::record), by which others can prove it
    /// ([`Volume::prove`](crate::Volume::prove)).
    ///
    /// # Errors
    /// If the ending is none of these, or the file cannot be written.
    #[cfg(feature = "images")]
    pub fn save(&self, path: impl AsRef<std::path::Path>) -> Result<(), Error> {
        let path = path.as_ref();
        let (format, record) = (ImageFormat::from_path(path)?, self.record());
        let text = record.text_in(format, &self.image, &self.image);
        Ok(self.image.write_with(path, self.subject.scene.background, Some(&text))?)
    }

    /// The record of the picture: the complete scene, the container by its checksum, requested and stated error, failures.
    /// The file of a picture carries it, with a checksum of its pixels.
    ///
    /// The stated error is in it if [`Options::predict_error`](RenderOptions::predict_error) was set.
    ///
    /// ```
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("ball.svol");
    /// # supervol::doc_container(&path)?;
    /// use supervol::{Options, Scene, Volume};
    ///
    /// let volume = Volume::open(&path)?;
    /// let record = volume.draw(&Scene::default(), &Options::default())?.record();
    /// assert_eq!((record.container.name.as_str(), record.requested_grey_levels), ("ball.svol", 0.5));
    /// // Its scene draws the same picture again.
    /// let again = volume.draw(&record.scene, &Options::default())?.record();
    /// assert_eq!(again, record);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn record(&self) -> PictureRecord {
        PictureRecord::of(&self.subject.drawn(&self.stats))
    }

    /// Whether the picture is reduced, in which dimension, why, for how long, and by how many grey levels.
    ///
    /// This is the picture in memory, of floats. [`Picture::fidelity_as`] tells it for a file.
    ///
    /// ```
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("ball.svol");
    /// # supervol::doc_container(&path)?;
    /// use supervol::{Dimension, Lossiness, Options, Scene, Volume};
    ///
    /// let options = Options { predict_error: true, ..Options::default() };
    /// let fidelity = Volume::open(&path)?.draw(&Scene::default(), &options)?.fidelity();
    /// assert!(!fidelity.is_reduced && fidelity.lossiness == Lossiness::NeverLossy);
    /// let rays = fidelity.along(Dimension::SamplingDensity);
    /// assert!(rays.grey_levels.is_some_and(|error| error > 0.0), "{}", fidelity.in_words);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn fidelity(&self) -> Fidelity {
        self.subject.fidelity(&self.stats, None)
    }

    /// The same for a file of this format: PNG has 8 bits a channel.
    #[must_use]
    pub fn fidelity_as(&self, format: ImageFormat) -> Fidelity {
        self.subject.fidelity(&self.stats, Some(format))
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

    /// The work for each pixel; `None` unless [`Options::count_work`](RenderOptions::count_work) is set.
    #[must_use]
    pub fn work_map(&self) -> Option<&Image> {
        self.maps.work.as_ref()
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
        self.check_telling(rays, &|_| {})
    }

    /// [`Picture::check`] that tells its progress, from any thread. [`Volume::check_fits`](crate::Volume::check_fits) says
    /// before the picture is drawn whether memory will suffice.
    ///
    /// # Errors
    /// As [`Picture::check`].
    pub fn check_telling(&self, rays: u64, progress: &(dyn Fn(CheckProgress) + Sync)) -> Result<ErrorMeasured, Error> {
        let Subject { volume, scene, options, .. } = &self.subject;
        Ok(measure_error(volume.container(), scene, options, &self.image, rays, progress)?)
    }
}
