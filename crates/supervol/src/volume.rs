//! A volume: an open container, and everything that a program asks of it.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use supervol_format::level_reader::LevelReader;
use supervol_format::{Container, Dims, Lod, VoxelBox, VoxelType};
use supervol_runtime::engines::engine::Engine;
#[cfg(feature = "images")]
use supervol_runtime::render::accuracy::check::CheckProgress;
use supervol_runtime::render::accuracy::check::check_fits;
#[cfg(feature = "images")]
use supervol_runtime::render::accuracy::proof::{Proof, ProofOptions, Prover};
use supervol_runtime::render::options::RenderOptions;
use supervol_runtime::render::record::DrawnBy;
use supervol_runtime::render::renderer::{MakeEngine, render_by_engine, render_with_maps};
use supervol_runtime::render::volume::PlacedVolume;
use supervol_scene::facts::{DataKind, VolumeFacts};
#[cfg(feature = "images")]
use supervol_scene::image::stored::StoredPicture;
use supervol_scene::preset::placing::placement;
use supervol_scene::scene::Scene;

use crate::array::Array;
use crate::error::Error;
use crate::picture::{Picture, Subject};
use crate::renderer::Renderer;

/// An open volume. Clones share the container.
#[derive(Debug, Clone)]
pub struct Volume {
    stored: Arc<Container>,
    /// `None`: recognised.
    kind: Option<DataKind>,
    /// The volume without vertical exaggeration, which most scenes draw.
    natural: PlacedVolume,
}

impl Volume {
    /// Opens a container; no brick is read.
    ///
    /// With the feature `sources`, a volume file may be given as well. Its container is then built into the user's cache folder,
    /// or found there.
    ///
    /// # Errors
    /// If the file cannot be read, or is neither a container nor a known volume file.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        #[cfg(feature = "sources")]
        if !supervol_preprocess::kept::is_container(path) {
            return Self::open_container(&Self::kept_container(path)?);
        }
        Self::open_container(path)
    }

    fn open_container(path: &Path) -> Result<Self, Error> {
        let container = Container::open(path).map_err(|source| Error::Container { path: path.into(), source })?;
        Ok(Self::of(container))
    }

    /// The container of a volume file in the user's cache folder.
    #[cfg(feature = "sources")]
    fn kept_container(path: &Path) -> Result<std::path::PathBuf, Error> {
        use supervol_preprocess::BuildOptions;
        use supervol_preprocess::kept::{CACHE_LIMIT_BYTES, Cache, Reading};
        let cache = Cache::below(None, CACHE_LIMIT_BYTES)?;
        Ok(cache.container_of(path, &Reading::default(), &BuildOptions::default(), &|_| {})?)
    }

    /// The volume of a container that is open already, from whatever byte source.
    #[must_use]
    pub fn of(container: Container) -> Self {
        Self::with(Arc::new(container), None)
    }

    fn with(stored: Arc<Container>, kind: Option<DataKind>) -> Self {
        let natural = placed(&stored, kind, 1.0);
        Self { stored, kind, natural }
    }

    /// The same volume with its kind of data given instead of recognised: default pictures go by it.
    ///
    /// ```
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("ball.svol");
    /// # supervol::doc_container(&path)?;
    /// use supervol::{DataKind, Volume};
    ///
    /// let volume = Volume::open(&path)?.with_kind(DataKind::Mri);
    /// assert_eq!(volume.facts().kind, DataKind::Mri);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn with_kind(self, kind: DataKind) -> Self {
        Self::with(self.stored, Some(kind))
    }

    /// The same volume without the overview that completed scenes read: its memory is free again. It is read again when
    /// a scene asks for it.
    #[must_use]
    pub fn without_overview(self) -> Self {
        Self { natural: self.natural.without_overview(), ..self }
    }

    /// The container as it is stored.
    #[must_use]
    pub fn container(&self) -> &Container {
        &self.stored
    }

    /// Voxels of level 0 along x, y and z.
    #[must_use]
    pub fn dims(&self) -> Dims {
        self.stored.descriptor().dims()
    }

    /// Type of the stored voxels.
    #[must_use]
    pub fn voxel_type(&self) -> VoxelType {
        self.stored.descriptor().voxel_type
    }

    /// The coarsest level; 0 is the finest.
    #[must_use]
    pub fn coarsest_level(&self) -> u8 {
        self.stored.pyramid().coarsest().0
    }

    /// Size, place, value range and kind of the data.
    #[must_use]
    pub fn facts(&self) -> &VolumeFacts {
        self.natural.facts()
    }

    /// The volume at the place where a scene draws it: heights are as large as [`Scene::vertical_exaggeration`] says.
    ///
    /// # Errors
    /// If the scene is not valid.
    pub fn placed_for(&self, scene: &Scene) -> Result<PlacedVolume, Error> {
        scene.validate()?;
        Ok(match scene.vertical_exaggeration {
            None | Some(1.0) => self.natural.clone(),
            Some(factor) => placed(&self.stored, self.kind, factor),
        })
    }

    /// The scene with everything that it leaves open written out for this volume. The default scene gives the default picture.
    ///
    /// ```
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("ball.svol");
    /// # supervol::doc_container(&path)?;
    /// use supervol::{Scene, Volume};
    ///
    /// let scene = Volume::open(&path)?.complete(&Scene::from_json(r#"{"mode": "mip"}"#)?)?;
    /// assert!(scene.camera.is_some() && scene.transfer_function.is_some());
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If the scene is not valid.
    pub fn complete(&self, scene: &Scene) -> Result<Scene, Error> {
        Ok(self.placed_for(scene)?.complete(scene)?)
    }

    /// Values of a box of voxels of one level, in data units; the end of the box is not included.
    ///
    /// ```
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("ball.svol");
    /// # supervol::doc_container(&path)?;
    /// use supervol::{Volume, VoxelBox};
    ///
    /// let volume = Volume::open(&path)?;
    /// let middle = volume.read(0, VoxelBox { start: [16, 16, 24], end: [32, 32, 25] })?;
    /// assert_eq!(middle.shape(), [16, 16, 1]);
    /// assert_eq!(middle.get([8, 8, 0]), Some(250.0));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If there is no such level, the box leaves its grid or does not fit into memory, or a brick cannot be read.
    pub fn read(&self, level: u8, voxels: VoxelBox) -> Result<Array, Error> {
        let coarsest = self.coarsest_level();
        if level > coarsest {
            return Err(Error::Level { level, coarsest });
        }
        let dims = self.stored.pyramid().level_at(Lod(level)).dims;
        let is_inside = (0..3).all(|a| voxels.start[a] <= voxels.end[a] && voxels.end[a] <= dims.0[a]);
        // Asked for here, so that a box beyond all memory is an error and does not end the process.
        if !is_inside || Vec::<f64>::new().try_reserve_exact(voxels.voxels()).is_err() {
            return Err(Error::Box { voxels, dims });
        }
        let (scale, offset) = (self.stored.descriptor().scale, self.stored.descriptor().offset);
        let reader = LevelReader::new(&*self.stored, Lod(level), 0);
        let values = reader.values(voxels, |stored| stored * scale + offset);
        let values = values.map_err(|source| Error::Container { path: self.stored.path().into(), source })?;
        Ok(Array::new(voxels, values))
    }

    /// Draws one picture until it has converged, or until [`Options::time_budget_ms`](RenderOptions::time_budget_ms) is up.
    ///
    /// Parts that the scene omits are chosen to suit the data.
    ///
    /// # Errors
    /// If the scene or an option is wrong, a budget is too small, or the machine fails. Bricks that cannot be read are no error:
    /// see [`Picture::failures`].
    pub fn draw(&self, scene: &Scene, options: &RenderOptions) -> Result<Picture, Error> {
        let subject = Subject::drawn_once(self.placed_for(scene)?, scene, options, DrawnBy::Supervol)?;
        let (image, maps, stats) = render_with_maps(subject.volume.container(), &subject.scene, options)?;
        Ok(Picture::new(subject, image, maps, stats))
    }

    /// Draws one picture by an engine of the caller's own, with the streamer, the passes and the budgets of all others.
    ///
    /// # Errors
    /// As [`Volume::draw`], and whatever the engine reports.
    pub fn draw_by(
        &self,
        engine: &mut (dyn Engine + Send),
        scene: &Scene,
        options: &RenderOptions,
    ) -> Result<Picture, Error> {
        let subject = Subject::drawn_once(self.placed_for(scene)?, scene, options, DrawnBy::Caller)?;
        let (container, start) = (subject.volume.container(), Instant::now());
        let (image, maps, stats) = render_by_engine(container, &subject.scene, options, engine, start)?;
        Ok(Picture::new(subject, image, maps, stats))
    }

    /// Tells, before a picture is drawn, whether [`Picture::check`] will fit into
    /// [`Options::host_memory_bytes`](RenderOptions::host_memory_bytes). The check needs a whole level.
    ///
    /// ```
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("ball.svol");
    /// # supervol::doc_container(&path)?;
    /// use supervol::{ErrorKind, Options, Scene, Volume};
    ///
    /// let volume = Volume::open(&path)?;
    /// let options = Options { host_memory_bytes: 500_000, ..Options::default() };
    /// let error = volume.check_fits(&Scene::default(), &options).unwrap_err();
    /// assert_eq!(error.kind(), ErrorKind::Request);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If it will not, with the finest level that would fit; or if the scene is wrong.
    pub fn check_fits(&self, scene: &Scene, options: &RenderOptions) -> Result<(), Error> {
        let placed = self.placed_for(scene)?;
        Ok(check_fits(placed.container(), &placed.resolve(scene)?, options)?)
    }

    /// Proves a picture file: casts sample pixels again by the reference integrator, from the record that the file carries,
    /// and compares them within the requested and the stated error of that record.
    ///
    /// ```
    /// # let folder = tempfile::tempdir()?;
    /// # let path = folder.path().join("ball.svol");
    /// # supervol::doc_container(&path)?;
    /// use supervol::{Options, ProofOptions, Scene, Volume};
    ///
    /// let volume = Volume::open(&path)?;
    /// let picture = folder.path().join("ball.png");
    /// volume.draw(&Scene::default(), &Options::default())?.save(&picture)?;
    /// let proof = volume.prove(&picture, &ProofOptions { pixels: 300, ..ProofOptions::default() })?;
    /// assert!(proof.holds() && proof.pixels == 300);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If the file is no picture, has no record or one of another container, or claims no error. A picture that breaks its
    /// claims is no error: see [`Proof::holds`].
    #[cfg(feature = "images")]
    pub fn prove(&self, picture: impl AsRef<Path>, options: &ProofOptions) -> Result<Proof, Error> {
        self.prove_telling(picture, options, &|_| {})
    }

    /// [`Volume::prove`] that tells its progress, from any thread.
    ///
    /// # Errors
    /// As [`Volume::prove`].
    #[cfg(feature = "images")]
    pub fn prove_telling(
        &self,
        picture: impl AsRef<Path>,
        options: &ProofOptions,
        progress: &(dyn Fn(CheckProgress) + Sync),
    ) -> Result<Proof, Error> {
        let path = picture.as_ref();
        let stored = StoredPicture::read(path)?;
        let of_file = |source| Error::Proof { path: path.into(), source: Box::new(source) };
        Prover::new(&self.stored, &stored, options).and_then(|prover| prover.prove(progress)).map_err(of_file)
    }

    /// A renderer that keeps what it has loaded from picture to picture.
    ///
    /// # Errors
    /// If an option is wrong, or threads cannot be started.
    pub fn renderer(&self, options: RenderOptions) -> Result<Renderer, Error> {
        Renderer::new(self.clone(), options)
    }

    /// The same, with engines of the caller's own: `engines` makes one for each picture.
    ///
    /// # Errors
    /// If an option is wrong, or threads cannot be started.
    pub fn renderer_by(&self, engines: impl MakeEngine + 'static, options: RenderOptions) -> Result<Renderer, Error> {
        Renderer::by_engines(self.clone(), options, engines)
    }
}

/// A container at the place where it is drawn. Its kind is recognised where none is given.
fn placed(stored: &Container, kind: Option<DataKind>, exaggeration: f64) -> PlacedVolume {
    let facts = kind.map_or_else(|| VolumeFacts::of(stored), |kind| VolumeFacts::of_kind(stored, kind));
    let container = Arc::new(stored.at(placement(stored, &facts, exaggeration)));
    match kind {
        Some(kind) => PlacedVolume::of_kind(container, kind),
        None => PlacedVolume::of(container),
    }
}
