//! A volume: an open container with its facts.

use std::path::Path;
use std::sync::Arc;

use supervol_format::Container;
use supervol_format::container::ContainerError;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::scene::{ResolvedScene, Scene, SceneError};

/// An open container, and what scenes must know of it. Clones share both.
#[derive(Debug, Clone)]
pub struct Volume {
    container: Arc<Container>,
    facts: Arc<VolumeFacts>,
}

impl Volume {
    /// Opens a container file; no brick is read.
    ///
    /// # Errors
    /// If it cannot be read, or is none.
    pub fn open(path: &Path) -> Result<Self, ContainerError> {
        Ok(Self::of(Arc::new(Container::open(path)?)))
    }

    /// The volume of a container that is open already.
    #[must_use]
    pub fn of(container: Arc<Container>) -> Self {
        let facts = Arc::new(VolumeFacts::of(&container));
        Self { container, facts }
    }

    /// The container.
    #[must_use]
    pub fn container(&self) -> &Arc<Container> {
        &self.container
    }

    /// What scenes must know of it.
    #[must_use]
    pub fn facts(&self) -> &VolumeFacts {
        &self.facts
    }

    /// A scene with everything filled in for this volume.
    ///
    /// # Errors
    /// If the scene cannot be drawn.
    pub fn resolve(&self, scene: &Scene) -> Result<ResolvedScene, SceneError> {
        scene.resolve(&self.facts)
    }
}
