//! A renderer that lives across pictures.

use std::borrow::Cow;
use std::time::{Duration, Instant};

use supervol_format::canceller::Canceller;
use supervol_format::{BrickKey, Lod};
use supervol_runtime::render;
use supervol_runtime::render::fidelity::{Circumstances, Dimension, Fidelity, Outlook};
use supervol_runtime::render::options::RenderOptions;
use supervol_runtime::render::record::{Drawn, DrawnBy};
use supervol_runtime::render::renderer::{Ahead, MakeEngine, Picked, Step};
use supervol_runtime::render::stats::FrameStats;
use supervol_runtime::stream::field::Field;
use supervol_runtime::stream::state::StateKind;
use supervol_scene::image::Image;
use supervol_scene::scene::{ResolvedScene, Scene};

use crate::error::Error;
use crate::picture::{Picture, Subject};
use crate::volume::Volume;

/// Most bricks of a level whose states are looked at for failures: a look at more would take longer than a picture.
const LOOKED_AT: usize = 1 << 18;

/// Draws pictures of one volume, one after the other, and keeps what it has loaded.
///
/// 1. [`Renderer::set_scene`] says what is wanted. Another camera or look keeps all bricks.
/// 2. [`Renderer::advance`] makes the picture better until a deadline. There is a whole picture after each call.
/// 3. [`Renderer::picture`] is the picture so far.
///
/// A picture that has converged is the same, bit for bit, as that of [`Volume::draw`].
///
/// ```
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("ball.svol");
/// # supervol::doc_container(&path)?;
/// use std::time::Duration;
/// use supervol::{Options, Scene, Volume};
///
/// let mut renderer = Volume::open(&path)?.renderer(Options::default())?;
/// renderer.set_scene(&Scene::default())?;
/// while !renderer.advance_for(Duration::from_millis(33))?.is_finished {
///     let frame = renderer.picture().expect("a deadline leaves a whole picture");
///     assert_eq!(frame.image().width, 800);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Renderer {
    volume: Volume,
    inner: render::renderer::Renderer,
    /// Factor of heights that the inner renderer's volume is placed with.
    exaggeration: f64,
    /// The scene: complete, and as engines draw it.
    scene: Option<(Scene, ResolvedScene)>,
    engine: DrawnBy,
    /// Whether the picture so far is finished.
    is_finished: bool,
    /// Dimensions along which a picture so far was reduced for a time.
    once: Vec<Dimension>,
}

impl std::fmt::Debug for Renderer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Renderer").field("volume", &self.volume).field("scene", &self.scene).finish_non_exhaustive()
    }
}

impl Renderer {
    pub(crate) fn new(volume: Volume, options: RenderOptions) -> Result<Self, Error> {
        let inner = render::renderer::Renderer::new(volume.placed_for(&Scene::default())?, options)?;
        Ok(Self::of(volume, inner, DrawnBy::Supervol))
    }

    pub(crate) fn by_engines(
        volume: Volume,
        options: RenderOptions,
        engines: impl MakeEngine + 'static,
    ) -> Result<Self, Error> {
        let placed = volume.placed_for(&Scene::default())?;
        let inner = render::renderer::Renderer::by_engines(placed, options, engines)?;
        Ok(Self::of(volume, inner, DrawnBy::Caller))
    }

    fn of(volume: Volume, inner: render::renderer::Renderer, engine: DrawnBy) -> Self {
        Self { volume, inner, exaggeration: 1.0, scene: None, engine, is_finished: false, once: Vec::new() }
    }

    /// The volume that it draws.
    #[must_use]
    pub fn volume(&self) -> &Volume {
        &self.volume
    }

    /// How pictures are made.
    #[must_use]
    pub fn options(&self) -> &RenderOptions {
        self.inner.options()
    }

    /// The scene as engines draw it; `None` before the first [`Renderer::set_scene`].
    #[must_use]
    pub fn resolved(&self) -> Option<&ResolvedScene> {
        self.scene.as_ref().map(|(_, resolved)| resolved)
    }

    /// The request to stop [`Renderer::advance`] and [`Renderer::pick`], from another thread.
    #[must_use]
    pub fn canceller(&self) -> Canceller {
        self.inner.canceller()
    }

    /// Sets the scene that is drawn from now on. What it leaves open is chosen to suit the data.
    ///
    /// ```
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("ball.svol");
    /// # supervol::doc_container(&path)?;
    /// use supervol::{Options, Scene, Volume};
    ///
    /// let mut renderer = Volume::open(&path)?.renderer(Options::default())?;
    /// let wrong = Scene { samples_per_pixel: Some(3), ..Scene::default() };
    /// assert!(renderer.set_scene(&wrong).unwrap_err().to_string().contains("samples_per_pixel"));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If the scene is not valid, or cannot be drawn of this volume; the scene before stays then.
    pub fn set_scene(&mut self, scene: &Scene) -> Result<(), Error> {
        let exaggeration = scene.vertical_exaggeration.unwrap_or(1.0);
        let is_placed = exaggeration == self.exaggeration;
        let placed = if is_placed { self.inner.volume().clone() } else { self.volume.placed_for(scene)? };
        let complete = placed.complete(scene)?;
        let resolved = complete.resolve(placed.facts())?;
        if !is_placed {
            self.inner.set_volume(placed);
            self.exaggeration = exaggeration;
        }
        // The picture of an equal scene stays.
        self.is_finished &= is_placed && self.resolved() == Some(&resolved);
        self.scene = Some((complete, resolved.clone()));
        self.inner.set_scene(resolved);
        Ok(())
    }

    /// Sets how pictures are made from now on. Loaded bricks stay as far as the budgets allow.
    ///
    /// # Errors
    /// If an option is wrong; the options before stay then.
    pub fn set_options(&mut self, options: RenderOptions) -> Result<(), Error> {
        self.inner.set_options(options)?;
        self.is_finished = false;
        Ok(())
    }

    /// Makes the picture better until it has converged, the deadline has come, or the [`Canceller`] is set. `None`: no deadline.
    ///
    /// # Errors
    /// If no scene is set, a budget is too small, or the machine fails.
    pub fn advance(&mut self, deadline: Option<Instant>) -> Result<Step, Error> {
        self.is_finished = false;
        let step = self.inner.advance(deadline)?;
        self.is_finished = step.is_finished;
        if !step.is_finished {
            self.note_reductions();
        }
        Ok(step)
    }

    /// Notes along which dimensions the picture so far is reduced for a time. Called at every deadline: it copies no scene.
    fn note_reductions(&mut self) {
        let Some((complete, _)) = &self.scene else { return };
        let (volume, stats) = (self.inner.volume(), self.inner.counts());
        let drawn = Drawn {
            container: volume.container(),
            facts: volume.facts(),
            scene: complete,
            options: self.inner.options(),
            stats: &stats,
            engine: self.engine,
        };
        let circumstances = Circumstances { format: None, outlook: Outlook::GoesOn, once: &self.once };
        let reduced: Vec<Dimension> = Fidelity::of(&drawn, &circumstances).improving().collect();
        for dimension in reduced {
            if !self.once.contains(&dimension) {
                self.once.push(dimension);
            }
        }
    }

    /// [`Renderer::advance`] for this long from now.
    ///
    /// # Errors
    /// As [`Renderer::advance`].
    pub fn advance_for(&mut self, time: Duration) -> Result<Step, Error> {
        self.advance(Some(Instant::now() + time))
    }

    /// The picture so far; `None` before the first [`Renderer::advance`].
    #[must_use]
    pub fn picture(&self) -> Option<Picture> {
        let image = self.inner.picture()?.into_owned();
        let maps = self.inner.maps();
        Some(Picture::new(self.subject()?, image, maps, self.inner.stats()))
    }

    /// The image of the picture so far, for a screen: no map and no stated error is computed, and an image that is there
    /// is not copied. Premultiplied red, green, blue and opacity, row by row from the top; `None` as for
    /// [`Renderer::picture`].
    ///
    /// ```
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("ball.svol");
    /// # supervol::doc_container(&path)?;
    /// use std::time::Duration;
    /// use supervol::{Options, Scene, Volume};
    ///
    /// let mut renderer = Volume::open(&path)?.renderer(Options::default())?;
    /// renderer.set_scene(&Scene::default())?;
    /// let background = renderer.resolved().expect("a scene is set").background;
    /// loop {
    ///     let step = renderer.advance_for(Duration::from_millis(33))?;
    ///     let shown = renderer.image().expect("a deadline leaves a whole picture").to_rgb8(background);
    ///     assert_eq!(shown.len(), 800 * 600 * 3);
    ///     if step.is_finished {
    ///         break;
    ///     }
    /// }
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn image(&self) -> Option<Cow<'_, Image>> {
        self.inner.picture()
    }

    /// Everything that was counted and measured since the picture was begun. The stated error is in it once the picture is
    /// finished: summing it up before would take as long as drawing.
    #[must_use]
    pub fn stats(&self) -> FrameStats {
        if self.is_finished { self.inner.stats() } else { self.inner.counts() }
    }

    /// Reads bricks for the next picture, as if the camera moved on as it did last. Call it when the picture is finished
    /// and the program is idle. It takes free memory only, and no brick of the picture leaves memory. It ends when all
    /// these bricks are there, at the deadline, or when the [`Canceller`] is set.
    ///
    /// It does nothing if the camera has not moved, if the picture is unfinished, with slices, and on graphics devices.
    ///
    /// ```
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("ball.svol");
    /// # supervol::doc_container(&path)?;
    /// use supervol::scene::camera_path::turntable;
    /// use supervol::scene::preset::view::upright;
    /// use supervol::{Backend, Options, Scene, Volume};
    ///
    /// let volume = Volume::open(&path)?;
    /// let scene = volume.complete(&Scene::default())?;
    /// let first = scene.camera.clone().expect("a complete scene has a camera");
    /// let mut renderer = volume.renderer(Options { backend: Backend::Cpu, ..Options::default() })?;
    /// for camera in turntable(&first, upright(volume.facts()), 90).into_iter().take(2) {
    ///     renderer.set_scene(&Scene { camera: Some(camera), ..scene.clone() })?;
    ///     renderer.advance(None)?;
    /// }
    /// assert!(renderer.look_ahead(None)?.is_complete);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If threads cannot be started.
    pub fn look_ahead(&mut self, deadline: Option<Instant>) -> Result<Ahead, Error> {
        Ok(self.inner.look_ahead(deadline)?)
    }

    /// At most `limit` bricks that could not be read or decoded, finest level first. The picture shows coarser ones in their
    /// place. They are read again with later pictures, after some time.
    ///
    /// Of a level of more than 262,144 bricks, only so many are looked at.
    #[must_use]
    pub fn bricks_failed(&self, limit: usize) -> Vec<BrickKey> {
        let Some(streamer) = self.inner.streamer() else { return Vec::new() };
        let (pyramid, states) = (self.inner.volume().container().pyramid(), streamer.states());
        let has_failed = |lod: &Lod| states.count(*lod, StateKind::Failed) > 0;
        let failed = (0..=pyramid.coarsest().0).map(Lod).filter(has_failed).flat_map(|lod| {
            let keys = pyramid.keys_of(lod).take(LOOKED_AT);
            keys.filter(|key| states.state(Field::FIRST.brick(*key)).kind() == StateKind::Failed)
        });
        failed.take(limit).collect()
    }

    /// At most `limit` bricks in host memory, finest level first.
    ///
    /// ```
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("ball.svol");
    /// # supervol::doc_container(&path)?;
    /// use supervol::{Backend, Options, Scene, Volume};
    ///
    /// let mut renderer = Volume::open(&path)?.renderer(Options { backend: Backend::Cpu, ..Options::default() })?;
    /// renderer.set_scene(&Scene::default())?;
    /// renderer.advance(None)?;
    /// assert!(!renderer.bricks_in_memory(10).is_empty() && renderer.bricks_failed(10).is_empty());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn bricks_in_memory(&self, limit: usize) -> Vec<BrickKey> {
        let Some(streamer) = self.inner.streamer() else { return Vec::new() };
        let of_field = streamer.cache().keys().filter(|key| key.field == Field::FIRST);
        let mut keys: Vec<BrickKey> = of_field.map(|key| key.brick).collect();
        keys.sort_unstable();
        keys.truncate(limit);
        keys
    }

    /// Subject of the picture so far; `None` without a scene.
    fn subject(&self) -> Option<Subject> {
        let (complete, scene) = self.scene.clone()?;
        Some(Subject {
            volume: self.inner.volume().clone(),
            complete,
            scene,
            options: self.inner.options().clone(),
            engine: self.engine,
            outlook: Outlook::GoesOn,
            once: self.once.clone(),
        })
    }

    /// The first visible point under a pixel, counted from the top left; `None` where nothing is to be seen.
    ///
    /// ```
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("ball.svol");
    /// # supervol::doc_container(&path)?;
    /// use supervol::{Options, Scene, Volume};
    ///
    /// let mut renderer = Volume::open(&path)?.renderer(Options::default())?;
    /// renderer.set_scene(&Scene::default())?;
    /// let middle = renderer.pick([400, 300])?.expect("the ball is in the middle");
    /// assert!(middle.value > 0.0);
    /// assert!(renderer.pick([0, 0])?.is_none());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If no scene is set, the picture has no such pixel, the mode has no depth, or a budget is too small.
    pub fn pick(&mut self, pixel: [u32; 2]) -> Result<Option<Picked>, Error> {
        Ok(self.inner.pick(pixel)?)
    }
}

#[cfg(all(test, feature = "sources"))]
mod tests {
    use supervol_runtime::render::fidelity::Lossiness;
    use supervol_runtime::render::options::Backend;

    use super::*;

    #[test]
    fn a_picture_in_progress_is_reduced_for_now_and_was_so_once_it_has_converged() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("ball.svol");
        crate::doc_container(&path).expect("a container");
        let options = RenderOptions { backend: Backend::Cpu, ..RenderOptions::default() };
        let mut renderer = Volume::open(&path).expect("a volume").renderer(options).expect("a renderer");
        renderer.set_scene(&Scene::default()).expect("a scene");
        let step = renderer.advance(Some(Instant::now())).expect("a step");
        assert!(!step.is_finished, "the deadline has passed: {step:?}");
        let early = renderer.picture().expect("a whole picture").fidelity();
        assert_eq!((early.lossiness, early.waiting_helps), (Lossiness::TransientlyLossy, true), "{early:#?}");
        renderer.advance(None).expect("a step");
        let whole = renderer.picture().expect("a picture").fidelity();
        assert_eq!((whole.lossiness, whole.is_reduced), (Lossiness::FormerlyLossy, false), "{whole:#?}");
        assert!(whole.in_words.contains("any more"), "{}", whole.in_words);
    }
}
