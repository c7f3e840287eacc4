//! State of the dialogs.

use supervol_scene::scene::Scene;

use super::animation::AnimationDialog;
use super::browser::{Browser, FileKind};
use super::file_options::FileOptions;
use crate::worker::OpenVolume;

/// The open dialogs with their state.
#[derive(Default)]
pub(crate) struct Dialogs {
    /// Whether the window of keys is open.
    pub(crate) keys: bool,
    /// The file dialog.
    pub(crate) browser: Option<Browser>,
    /// The dialog of a file that needs options.
    pub(crate) file_options: Option<FileOptions>,
    pub(crate) save: Option<SaveDialog>,
    pub(crate) export: Option<ExportDialog>,
    /// The animation dialog.
    pub(crate) animation: Option<AnimationDialog>,
}

/// The dialog to save a scene.
pub(crate) struct SaveDialog {
    pub(crate) path: String,
    pub(crate) replace: bool,
    /// Scene of a section; `None`: the scene of the picture at the time of saving.
    pub(crate) scene: Option<Scene>,
}

/// The dialog to export a picture.
pub(crate) struct ExportDialog {
    pub(crate) path: String,
    pub(crate) replace: bool,
    pub(crate) size: [u32; 2],
    /// Width over height of the picture on the screen.
    pub(crate) aspect: f64,
    /// As in [`SaveDialog::scene`].
    pub(crate) scene: Option<Scene>,
}

/// Default path for an output file: beside the volume, with another extension.
pub(crate) fn path_beside(opened: Option<&OpenVolume>, ending: &str) -> String {
    let path = opened.map(|opened| opened.source.with_extension(ending)).unwrap_or_default();
    std::path::absolute(&path).unwrap_or(path).display().to_string()
}

impl Dialogs {
    /// Opens the file dialog in the folder of the open volume.
    pub(crate) fn begin_open(&mut self, opened: Option<&OpenVolume>) {
        self.browser = Some(Browser::new(FileKind::Volume, opened));
    }

    /// Opens the dialog to save the scene.
    pub(crate) fn begin_save(&mut self, opened: Option<&OpenVolume>) {
        self.save = Some(SaveDialog { path: path_beside(opened, "scene.json"), replace: false, scene: None });
    }

    /// Opens the dialog to save the scene of a section.
    pub(crate) fn begin_save_section(&mut self, opened: &OpenVolume, scene: Scene) {
        let path = path_beside(Some(opened), "section.json");
        self.save = Some(SaveDialog { path, replace: false, scene: Some(scene) });
    }

    /// Opens the dialog to export a section.
    pub(crate) fn begin_export_section(&mut self, opened: &OpenVolume, scene: Scene) {
        self.begin_export(Some(opened), &scene);
        if let Some(dialog) = &mut self.export {
            dialog.path = path_beside(Some(opened), "section.png");
            dialog.scene = Some(scene);
        }
    }

    /// Opens the animation dialog.
    pub(crate) fn begin_animation(&mut self, opened: Option<&OpenVolume>, scene: &Scene) {
        self.animation = Some(AnimationDialog::new(path_beside(opened, "frames"), scene));
    }

    /// Opens the dialog to export a picture, with the size of the picture on the screen.
    pub(crate) fn begin_export(&mut self, opened: Option<&OpenVolume>, scene: &Scene) {
        let size = [scene.image.width, scene.image.height];
        let aspect = f64::from(size[0]) / f64::from(size[1]);
        self.export =
            Some(ExportDialog { path: path_beside(opened, "png"), replace: false, size, aspect, scene: None });
    }
}
