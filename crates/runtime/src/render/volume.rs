//! A volume to be drawn: an open container at its place in the world, with its facts.

use std::sync::{Arc, OnceLock};

use supervol_format::Container;
use supervol_scene::facts::{DataKind, VolumeFacts};
use supervol_scene::preset::overview::Overview;
use supervol_scene::scene::{ResolvedScene, Scene, SceneError};

/// An open container at its place in the world, with everything that scenes need to know of it. Clones share all of it.
#[derive(Debug, Clone)]
pub struct PlacedVolume {
    container: Arc<Container>,
    facts: Arc<VolumeFacts>,
    /// Read when a scene first asks for it; `None` if no level is small enough, or a brick of it cannot be read.
    overview: Arc<OnceLock<Option<Overview>>>,
}

impl PlacedVolume {
    /// The volume of an open container. Recognises its kind of data.
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

    /// The same volume without an overview that was read: its memory is free again once all clones are gone.
    #[must_use]
    pub fn without_overview(&self) -> Self {
        Self { overview: Arc::default(), ..self.clone() }
    }

    /// The container.
    #[must_use]
    pub fn container(&self) -> &Arc<Container> {
        &self.container
    }

    /// Facts of the volume at its place in the world.
    #[must_use]
    pub fn facts(&self) -> &VolumeFacts {
        &self.facts
    }

    /// A coarse level in memory, from which cameras frame the visible part. The first call reads it.
    ///
    /// `None` if even the coarsest level is too large, or a brick of it cannot be read; drawing the picture reports
    /// that brick.
    #[must_use]
    pub fn overview(&self) -> Option<&Overview> {
        self.overview.get_or_init(|| Overview::read(&self.container, &self.facts).ok().flatten()).as_ref()
    }

    /// The scene with all omitted parts filled in for this volume ([`Scene::complete`]).
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
