//! State of the file dialog. Folders are listed by a [`BackgroundTask`].

use std::path::{Path, PathBuf};

use eframe::egui;
use supervol_sources::formats;
use supervol_sources::input::start::is_named;

use crate::background_task::BackgroundTask;
use crate::worker::OpenVolume;

/// Most files listed of a folder.
const LIST_LIMIT: usize = 2000;
/// Most names examined in a folder.
const NAME_LIMIT: usize = 200_000;
/// Ends of file names of transfer functions.
const TRANSFER_FUNCTIONS: [&str; 2] = [".json", ".1dt"];
/// Ends of file names of meshes.
const MESHES: [&str; 3] = [".ply", ".stl", ".obj"];

/// Kind of file to choose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FileKind {
    /// A volume to open.
    Volume,
    /// A transfer function or a colour map.
    TransferFunction,
    /// A closed mesh to clip the volume with.
    Mesh,
}

impl FileKind {
    /// Ends of file names of this kind. Other files are listed only if all files are requested.
    fn endings(self) -> Vec<&'static str> {
        match self {
            Self::Volume => [".svol"].into_iter().chain(formats::endings()).collect(),
            Self::TransferFunction => TRANSFER_FUNCTIONS.to_vec(),
            Self::Mesh => MESHES.to_vec(),
        }
    }

    /// Title of the dialog.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::Volume => "Open",
            Self::TransferFunction => "Load a transfer function",
            Self::Mesh => "Clip with a mesh",
        }
    }
}

/// Content of a folder.
#[derive(Default)]
pub(crate) struct Listing {
    /// Names, and whether they are folders; folders first.
    pub(crate) entries: Vec<(String, bool)>,
    /// Reason why the folder is not listed, or not completely.
    pub(crate) trouble: Option<String>,
}

/// State of the dialog.
pub(crate) struct Browser {
    pub(crate) wanted: FileKind,
    /// Text of the path field.
    pub(crate) path: String,
    pub(crate) folder: PathBuf,
    pub(crate) listing: Listing,
    /// The listing in progress.
    pub(crate) task: Option<BackgroundTask<Listing>>,
    pub(crate) all_files: bool,
}

fn list(folder: &Path, endings: Option<&[&str]>) -> Listing {
    let mut listing = Listing::default();
    let listed = match std::fs::read_dir(folder) {
        Ok(listed) => listed,
        Err(error) => {
            listing.trouble = Some(format!("{}: {error}", folder.display()));
            return listing;
        }
    };
    for entry in listed.flatten().take(NAME_LIMIT) {
        let name = entry.file_name().to_string_lossy().into_owned();
        // Symbolic links are followed.
        let is_folder = entry.path().is_dir();
        let is_shown = is_folder || endings.is_none_or(|endings| is_named(&name.to_lowercase(), endings));
        if is_shown && !name.starts_with('.') {
            listing.entries.push((name, is_folder));
        }
    }
    listing.entries.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.to_lowercase().cmp(&b.0.to_lowercase())));
    if listing.entries.len() > LIST_LIMIT {
        listing.trouble = Some(format!("only {LIST_LIMIT} of {} names are listed", listing.entries.len()));
        listing.entries.truncate(LIST_LIMIT);
    }
    listing
}

impl Browser {
    /// A dialog that starts in the folder of the open volume, or in the working directory.
    pub(crate) fn new(wanted: FileKind, opened: Option<&OpenVolume>) -> Self {
        let folder =
            opened.and_then(|opened| std::path::absolute(&opened.source).ok()?.parent().map(Path::to_path_buf));
        let folder = folder.or_else(|| std::env::current_dir().ok()).unwrap_or_default();
        let path = folder.display().to_string();
        Self { wanted, path, folder, listing: Listing::default(), task: None, all_files: false }
    }

    /// Starts to list the folder.
    pub(crate) fn begin_list(&mut self, ctx: &egui::Context) {
        let (folder, endings) = (self.folder.clone(), (!self.all_files).then(|| self.wanted.endings()));
        self.task = Some(BackgroundTask::start(ctx, move || list(&folder, endings.as_deref())));
    }

    /// Changes to another folder.
    pub(crate) fn go(&mut self, ctx: &egui::Context, folder: PathBuf) {
        self.path = folder.display().to_string();
        (self.folder, self.listing) = (folder, Listing::default());
        self.begin_list(ctx);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_come_first_and_other_files_only_when_they_are_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["b.svol", "A.NII", "c.h5", "notes.txt", ".hidden.svol", "look.1dt"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        std::fs::create_dir(folder.path().join("z")).unwrap();
        let names = |endings: Option<&[&str]>| -> Vec<String> {
            list(folder.path(), endings).entries.into_iter().map(|(name, _)| name).collect()
        };
        assert_eq!(names(Some(&FileKind::Volume.endings())), ["z", "A.NII", "b.svol", "c.h5"]);
        assert_eq!(names(Some(&FileKind::TransferFunction.endings())), ["z", "look.1dt"]);
        assert_eq!(names(None), ["z", "A.NII", "b.svol", "c.h5", "look.1dt", "notes.txt"]);
        assert!(list(&folder.path().join("none"), None).trouble.is_some_and(|trouble| trouble.contains("none")));
    }
}
