//! Where the viewer keeps what it makes for itself: containers of source files and scenes in the cache folder, what it remembers
//! in the settings folder. Both are the system's usual ones.

use std::env;
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use xxhash_rust::xxh3::xxh3_64;

/// A folder that one of these variables names, with what is to be added; the first that is set.
fn first_of(variables: &[(&str, &str)]) -> Option<PathBuf> {
    let set = |&(variable, below): &(&str, &str)| {
        env::var_os(variable).filter(|value| !value.is_empty()).map(|value| PathBuf::from(value).join(below))
    };
    variables.iter().find_map(set)
}

/// Where the viewer keeps things; `None` where the system does not say where that may be.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Folders {
    /// For what can be made again.
    pub cache: Option<PathBuf>,
    /// For what is remembered.
    pub settings: Option<PathBuf>,
}

impl Folders {
    /// The system's usual ones.
    #[must_use]
    pub fn of_system() -> Self {
        let [cache, settings]: [&[(&str, &str)]; 2] = if cfg!(target_os = "macos") {
            [&[("HOME", "Library/Caches/supervol")], &[("HOME", "Library/Application Support/supervol")]]
        } else if cfg!(windows) {
            [&[("LOCALAPPDATA", "supervol/cache")], &[("APPDATA", "supervol")]]
        } else {
            [
                &[("XDG_CACHE_HOME", "supervol"), ("HOME", ".cache/supervol")],
                &[("XDG_CONFIG_HOME", "supervol"), ("HOME", ".config/supervol")],
            ]
        };
        Self { cache: first_of(cache), settings: first_of(settings) }
    }
}

/// The container that is, or will be, built from a source file as it is now: another file, or another time at which it was
/// changed, has another one. The cache folder is made.
///
/// # Errors
/// If there is no cache folder, or the file cannot be looked at.
pub fn container_of(source: &Path, cache: Option<&Path>) -> io::Result<PathBuf> {
    let folder = cache.ok_or_else(|| io::Error::other("no cache folder to build into: use `supervol build`"))?;
    std::fs::create_dir_all(folder)
        .map_err(|e| io::Error::new(e.kind(), format!("cannot make the cache folder {}: {e}", folder.display())))?;
    let metadata = std::fs::metadata(source)?;
    let changed = metadata.modified()?.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    let identity = format!(
        "{}\n{}\n{}\n{}",
        std::fs::canonicalize(source)?.display(),
        metadata.len(),
        changed.as_nanos(),
        env!("CARGO_PKG_VERSION"),
    );
    let stem = source.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    Ok(folder.join(format!("{stem}-{:016x}.svol", xxh3_64(identity.as_bytes()))))
}

/// Removes the oldest files of a folder until so many are left.
///
/// # Errors
/// If the folder cannot be read.
pub fn keep_newest(folder: &Path, limit: usize) -> io::Result<()> {
    let listed = std::fs::read_dir(folder)?.flatten();
    let with_time = |entry: std::fs::DirEntry| Some((entry.metadata().ok()?.modified().ok()?, entry.path()));
    let mut files: Vec<(SystemTime, PathBuf)> = listed.filter_map(with_time).collect();
    files.sort();
    for (_, path) in &files[..files.len().saturating_sub(limit)] {
        // What somebody else has removed meanwhile is gone, too.
        let _ = std::fs::remove_file(path);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_has_changed_has_another_container() {
        let folder = tempfile::tempdir().unwrap();
        let (file, cache) = (folder.path().join("survey.sgy"), folder.path().join("cache"));
        std::fs::write(&file, b"one").unwrap();
        let first = container_of(&file, Some(&cache)).unwrap();
        assert_eq!(container_of(&file, Some(&cache)).unwrap(), first);
        assert!(first.starts_with(&cache) && first.file_name().unwrap().to_string_lossy().starts_with("survey-"));
        std::fs::write(&file, b"three").unwrap();
        assert_ne!(container_of(&file, Some(&cache)).unwrap(), first);
        assert!(container_of(&file, None).is_err_and(|e| e.to_string().contains("supervol build")));
    }

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

    #[test]
    fn the_first_variable_that_is_set_names_the_folder() {
        // PATH is set wherever tests run.
        let path = PathBuf::from(env::var_os("PATH").unwrap());
        assert_eq!(first_of(&[("SUPERVOL_NOT_SET", "x"), ("PATH", "below")]), Some(path.join("below")));
        assert_eq!(first_of(&[("SUPERVOL_NOT_SET", "x")]), None);
    }
}
