//! A volume as it is drawn: an open container at its place in the world, with its facts.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use supervol_format::Container;
use supervol_format::container::ContainerError;
use supervol_scene::facts::{DataKind, VolumeFacts};
use supervol_scene::preset::overview::Overview;
use supervol_scene::scene::{ResolvedScene, Scene, SceneError};

/// An open container at its place in the world, and everything that scenes must know of it. Clones share all of it.
#[derive(Debug, Clone)]
pub struct PlacedVolume {
    container: Arc<Container>,
    facts: Arc<VolumeFacts>,
    /// Read when a scene first asks for it; `None` where no level is small enough, or a brick of it cannot be read.
    overview: Arc<OnceLock<Option<Overview>>>,
}

impl PlacedVolume {
    /// Opens a container file where it is stored to be; no brick is read.
    ///
    /// # Errors
    /// If the file cannot be read, or is no container.
    pub fn open(path: &Path) -> Result<Self, ContainerError> {
        Ok(Self::of(Arc::new(Container::open(path)?)))
    }

    /// The volume of a container that is open already. Its kind of data is recognised.
    #[must_use]
    pub fn of(container: Arc<Container>) -> Self {
        let facts = VolumeFacts::of(&container);
        Self::with_facts(container, facts)
    }

    /// The volume of a container whose kind of data is known.
    #[must_use]
    pub fn of_kind(container: Arc<Container>, kind: DataKind) -> Self {
        let facts = VolumeFacts::of_kind(&container, kind);
        Self::with_facts(container, facts)
    }

    fn with_facts(container: Arc<Container>, facts: VolumeFacts) -> Self {
        Self { container, facts: Arc::new(facts), overview: Arc::default() }
    }

    /// The container.
    #[must_use]
    pub fn container(&self) -> &Arc<Container> {
        &self.container
    }

    /// Facts of the volume where it is placed.
    #[must_use]
    pub fn facts(&self) -> &VolumeFacts {
        &self.facts
    }

    /// A coarse level in memory, by which cameras frame what can be seen. The first call reads it.
    ///
    /// `None` where even the coarsest level is too large, or a brick of it cannot be read: whoever draws the picture reports
    /// that brick.
    #[must_use]
    pub fn overview(&self) -> Option<&Overview> {
        self.overview.get_or_init(|| Overview::read(&self.container, &self.facts).ok().flatten()).as_ref()
    }

    /// The scene with everything that it leaves open written out for this volume ([`Scene::complete`]).
    ///
    /// # Errors
    /// If the scene is not valid.
    pub fn complete(&self, scene: &Scene) -> Result<Scene, SceneError> {
        scene.validate()?;
        let leaves_open = scene.camera.is_none() || scene.transfer_function.is_none();
        Ok(scene.complete(&self.facts, if leaves_open { self.overview() } else { None }))
    }

    /// The scene in the form that engines draw, with everything filled in for this volume.
    ///
    /// # Errors
    /// If the scene is not valid, or cannot be drawn of this volume.
    pub fn resolve(&self, scene: &Scene) -> Result<ResolvedScene, SceneError> {
        self.complete(scene)?.resolve(&self.facts)
    }
}
