//! Settings that persist between sessions: recent files, window size, theme. One small JSON file; if it cannot be read
//! or written, defaults apply.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::folders::Folders;
use crate::sections::Layout;
use crate::worker::Decorations;

/// Most recent files.
const RECENT_LIMIT: usize = 12;
/// Most bytes of the file.
const BYTES_LIMIT: u64 = 1 << 20;

/// Colour theme of the window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "lowercase")]
pub enum Theme {
    /// The desktop's theme.
    #[default]
    System,
    /// Dark text on a light background.
    Light,
    /// Light text on a dark background.
    Dark,
}

/// The persistent settings; see the module.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
#[serde(default)]
pub struct SavedSettings {
    /// Recently opened files, the last one first.
    pub recent: Vec<PathBuf>,
    /// Colour theme.
    pub theme: Theme,
    /// Size of the window in points: width, height.
    pub window: Option<[f32; 2]>,
    /// Whether decorations are drawn around the volume.
    pub decorations: Decorations,
    /// Whether the panels are hidden.
    pub panels_hidden: bool,
    /// Panels beside the picture of the volume.
    pub layout: Layout,
}

fn file(folders: &Folders) -> Option<PathBuf> {
    folders.settings.as_ref().map(|folder| folder.join("viewer.json"))
}

impl SavedSettings {
    /// Reads the settings; defaults if there are none.
    #[must_use]
    pub fn read(folders: &Folders) -> Self {
        let read = |file: PathBuf| {
            let is_small = std::fs::metadata(&file).ok()?.len() <= BYTES_LIMIT;
            let text = is_small.then(|| std::fs::read_to_string(&file).ok())??;
            serde_json::from_str(&text).ok()
        };
        file(folders).and_then(read).unwrap_or_default()
    }

    /// Writes the settings.
    pub fn write(&self, folders: &Folders) {
        let Some(file) = file(folders) else { return };
        let write = || {
            let folder = file.parent().unwrap_or(Path::new("."));
            std::fs::create_dir_all(folder)?;
            // Written under another name first, so that a concurrent reader sees a complete file.
            let unfinished = folder.join(format!(".viewer-{}.json", std::process::id()));
            std::fs::write(&unfinished, serde_json::to_string_pretty(self)?)?;
            std::fs::rename(unfinished, &file)
        };
        // Errors are ignored: the viewer works without persistent settings.
        let _: std::io::Result<()> = write();
    }

    /// Adds an opened file to the recent files.
    pub fn add(&mut self, path: &Path) {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.into());
        self.recent.retain(|known| *known != path);
        self.recent.insert(0, path);
        self.recent.truncate(RECENT_LIMIT);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_files_are_remembered_once() {
        let mut saved = SavedSettings::default();
        for i in 0..3 * RECENT_LIMIT {
            saved.add(Path::new(&format!("/volumes/{}.svol", i % (2 * RECENT_LIMIT))));
        }
        saved.add(Path::new("/volumes/5.svol"));
        assert_eq!(saved.recent.len(), RECENT_LIMIT);
        assert_eq!(saved.recent[0], Path::new("/volumes/5.svol"));
        assert_eq!(saved.recent.iter().filter(|p| p.ends_with("5.svol")).count(), 1);
        let folder = tempfile::tempdir().unwrap();
        let folders = Folders { settings: Some(folder.path().join("supervol")), ..Folders::default() };
        assert_eq!(SavedSettings::read(&folders), SavedSettings::default());
        saved.write(&folders);
        assert_eq!(SavedSettings::read(&folders), saved);
        std::fs::write(file(&folders).unwrap(), "{").unwrap();
        assert_eq!(
            SavedSettings::read(&folders),
            SavedSettings::default(),
            "what cannot be read is as good as nothing"
        );
    }
}
