//! Files of transfer functions: running tasks and the named collection.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use eframe::egui;
use supervol_files::{Existing, OutputError, OutputFile, check_distinct};
use supervol_scene::preset::transfer_file::TransferFile;

use crate::background_task::BackgroundTask;
use crate::folders::Folders;

/// Most listed names.
const NAMED_LIMIT: usize = 500;
/// Most characters of a name.
pub(crate) const NAME_LIMIT: usize = 60;

/// Result of a background task.
pub(crate) enum Outcome {
    /// A file was read.
    Loaded(Box<TransferFile>),
    /// This file was written.
    Saved(PathBuf),
    /// A failure, in words.
    Failed(String),
}

/// Running tasks and the named collection.
#[derive(Default)]
pub(crate) struct Transfer {
    /// Reading or writing.
    pub(crate) task: Option<BackgroundTask<Outcome>>,
    /// Names of the collection; `None` until the folder has been listed.
    pub(crate) named: Option<Vec<String>>,
    listing: Option<BackgroundTask<Vec<String>>>,
    /// The dialog to save.
    pub(crate) save: Option<SaveDialog>,
}

/// The dialog to save a transfer function.
pub(crate) struct SaveDialog {
    /// Name in the collection.
    pub(crate) name: String,
    /// Path of a file.
    pub(crate) path: String,
    /// Whether an existing file may be overwritten.
    pub(crate) replace: bool,
}

/// The folder of the collection.
pub(crate) fn folder(folders: &Folders) -> Option<PathBuf> {
    folders.settings.as_ref().map(|settings| settings.join("transfer-functions"))
}

/// The file of a name; `None` if the name is not valid in every file system.
pub(crate) fn file_of(folders: &Folders, name: &str) -> Option<PathBuf> {
    let is_good = |c: char| c.is_alphanumeric() || " _-+,()".contains(c);
    let name = name.trim();
    let good = !name.is_empty() && name.chars().count() <= NAME_LIMIT && name.chars().all(is_good);
    Some(folder(folders)?.join(format!("{name}.json"))).filter(|_| good)
}

fn names_in(folder: &Path) -> Vec<String> {
    let listed = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let name = |entry: std::fs::DirEntry| {
        let path = entry.path();
        let is_kept = path.extension().is_some_and(|end| end == "json");
        is_kept.then(|| path.file_stem().map(|stem| stem.to_string_lossy().into_owned())).flatten()
    };
    let mut names: Vec<String> = listed.filter_map(name).take(NAMED_LIMIT).collect();
    names.sort_by_key(|name| name.to_lowercase());
    names
}

impl Transfer {
    /// Starts to read a file.
    pub(crate) fn load(&mut self, ctx: &egui::Context, path: PathBuf) {
        self.task = Some(BackgroundTask::start(ctx, move || match TransferFile::read(&path) {
            Ok(file) => Outcome::Loaded(Box::new(file)),
            Err(error) => Outcome::Failed(error.to_string()),
        }));
    }

    /// Starts to write a file.
    pub(crate) fn save(
        &mut self,
        ctx: &egui::Context,
        (path, text): (PathBuf, String),
        existing: Existing,
        read: Vec<PathBuf>,
    ) {
        self.task = Some(BackgroundTask::start(ctx, move || match write(&path, &text, existing, &read) {
            Ok(()) => Outcome::Saved(path),
            Err(error) => Outcome::Failed(error.to_string()),
        }));
    }

    /// Names of the collection; empty while the folder is being listed.
    pub(crate) fn names(&mut self, ctx: &egui::Context, folders: &Folders) -> &[String] {
        if let Some(names) = self.listing.as_ref().and_then(BackgroundTask::take) {
            (self.named, self.listing) = (Some(names), None);
        }
        if self.named.is_none()
            && self.listing.is_none()
            && let Some(folder) = folder(folders)
        {
            self.listing = Some(BackgroundTask::start(ctx, move || names_in(&folder)));
        }
        self.named.as_deref().unwrap_or_default()
    }
}

/// Writes a file by the rules of all commands: completely or not at all, and never over an open file.
fn write(path: &Path, text: &str, existing: Existing, read: &[PathBuf]) -> Result<(), OutputError> {
    let failed = |source| OutputError::write(path, source);
    check_distinct(path, read.iter().map(PathBuf::as_path))?;
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(failed)?;
    }
    let output = OutputFile::begin(path, existing)?;
    output.file().write_all(text.as_bytes()).map_err(failed)?;
    output.publish()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_names_of_files() {
        let folders = Folders { settings: Some("/s".into()), ..Folders::default() };
        let expected = Path::new("/s/transfer-functions/Bone, dense (2).json");
        assert_eq!(file_of(&folders, " Bone, dense (2) ").as_deref(), Some(expected));
        for name in ["", "  ", "../other", "a/b", "a.b", "\0", &"x".repeat(61)] {
            assert_eq!(file_of(&folders, name), None, "{name:?}");
        }
        assert_eq!(file_of(&Folders::default(), "bone"), None, "there is no folder");
    }
}
