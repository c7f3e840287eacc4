//! Options with which the viewer starts.

use std::path::PathBuf;

use supervol_preprocess::kept::Reading;
use supervol_scene::scene::Scene;

use crate::folders::Folders;
use crate::worker::Settings;

/// Options with which the viewer starts.
#[derive(Debug, Clone, Default)]
pub struct Launch {
    /// Container or source file; `None`: the window asks for one.
    pub file: Option<PathBuf>,
    /// Options for a source file that does not describe itself, for example its dimensions.
    pub reading: Reading,
    /// Scene; missing keys get defaults that suit the data.
    pub scene: Scene,
    /// Render settings.
    pub settings: Settings,
    /// Folders for the cache and for settings.
    pub folders: Folders,
}
