//! Files that appear only when they are whole: written under a temporary name beside the final one, synced, renamed.

use std::fs::File;
use std::path::{Path, PathBuf};

use crate::error::BuildError;

/// What to do with a file that is already there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Existing {
    /// Refuse.
    Keep,
    /// Replace it once the new one is whole.
    Replace,
}

/// A file being written. Dropped without [`OutputFile::publish`], it leaves nothing behind.
#[derive(Debug)]
pub struct OutputFile {
    unfinished: tempfile::NamedTempFile,
    path: PathBuf,
    existing: Existing,
}

/// The folder that a path lies in.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// # Errors
/// If the path is taken and not to be replaced.
pub fn check_free(path: &Path, existing: Existing) -> Result<(), BuildError> {
    if existing == Existing::Keep && path.exists() { Err(BuildError::Exists { path: path.into() }) } else { Ok(()) }
}

impl OutputFile {
    /// Begins a file that will be called `path`.
    ///
    /// # Errors
    /// If the path is taken and not to be replaced, or its folder cannot be written.
    pub fn begin(path: &Path, existing: Existing) -> Result<Self, BuildError> {
        check_free(path, existing)?;
        let unfinished = tempfile::Builder::new()
            .prefix(".supervol-")
            .suffix(".partial")
            .tempfile_in(folder_of(path))
            .map_err(|e| BuildError::write(path, e))?;
        Ok(Self { unfinished, path: path.into(), existing })
    }

    /// The file, to write to and to read back from.
    #[must_use]
    pub fn file(&self) -> &File {
        self.unfinished.as_file()
    }

    /// Syncs the file, makes it readable like any other, gives it its name, and makes the name last. Returns its length
    /// in bytes.
    ///
    /// # Errors
    /// If the disk does not take it, or the name was taken meanwhile and is not to be replaced.
    pub fn publish(self) -> Result<u64, BuildError> {
        let Self { unfinished, path, existing } = self;
        let write_error = |e| BuildError::write(&path, e);
        unfinished.as_file().sync_all().map_err(write_error)?;
        let bytes = unfinished.as_file().metadata().map_err(write_error)?.len();
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            let readable = std::fs::Permissions::from_mode(0o644);
            unfinished.as_file().set_permissions(readable).map_err(write_error)?;
        }
        let renamed = match existing {
            Existing::Replace => unfinished.persist(&path),
            Existing::Keep => unfinished.persist_noclobber(&path),
        };
        renamed.map_err(|e| match e.error.kind() {
            std::io::ErrorKind::AlreadyExists => BuildError::Exists { path: path.clone() },
            _ => write_error(e.error),
        })?;
        // The rename itself is durable once the folder is; folders cannot be opened everywhere, and then nothing is lost.
        if let Ok(folder) = File::open(folder_of(&path)) {
            folder.sync_all().map_err(write_error)?;
        }
        Ok(bytes)
    }
}
