//! Folders of the viewer. The cache folder holds containers built from source files ([`kept`]) and scenes; the settings
//! folder holds the settings of the last session. Defaults are the system's usual folders.

use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use supervol_preprocess::kept;

/// Folders of the viewer; `None` if the system names no such folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Folders {
    /// For files that can be made again.
    pub cache: Option<PathBuf>,
    /// Most bytes of containers in the cache folder.
    pub cache_limit_bytes: u64,
    /// For settings that persist between sessions.
    pub settings: Option<PathBuf>,
}

impl Default for Folders {
    fn default() -> Self {
        Self { cache: None, cache_limit_bytes: kept::CACHE_LIMIT_BYTES, settings: None }
    }
}

impl Folders {
    /// The system's usual folders.
    #[must_use]
    pub fn of_system() -> Self {
        let settings = kept::first_of(if cfg!(target_os = "macos") {
            &[("HOME", "Library/Application Support/supervol")]
        } else if cfg!(windows) {
            &[("APPDATA", "supervol")]
        } else {
            &[("XDG_CONFIG_HOME", "supervol"), ("HOME", ".config/supervol")]
        });
        Self { cache: kept::usual_folder(), settings, ..Self::default() }
    }
}

/// Removes the oldest files of a folder until at most `limit` are left.
///
/// # Errors
/// If the folder cannot be read.
pub fn keep_newest(folder: &Path, limit: usize) -> io::Result<()> {
    let listed = std::fs::read_dir(folder)?.flatten();
    let with_time = |entry: std::fs::DirEntry| Some((entry.metadata().ok()?.modified().ok()?, entry.path()));
    let mut files: Vec<(SystemTime, PathBuf)> = listed.filter_map(with_time).collect();
    files.sort();
    for (_, path) in &files[..files.len().saturating_sub(limit)] {
        // A failure means that another process has removed the file already.
        let _ = std::fs::remove_file(path);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_files_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        for age in 0..5u64 {
            let file = std::fs::File::create(folder.path().join(age.to_string())).unwrap();
            file.set_modified(SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(1000 - age)).unwrap();
        }
        keep_newest(folder.path(), 2).unwrap();
        let mut left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().flatten().map(|e| e.file_name()).collect();
        left.sort();
        assert_eq!(left, ["0", "1"]);
    }
}
