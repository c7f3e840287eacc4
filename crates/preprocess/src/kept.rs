//! Cache of containers built from source files, so that a source can be viewed like a container. The first use builds
//! the container into the cache folder; later uses find it there.
//!
//! The key of a container is the state of its source: path, size and time of every file, and the reading options. A
//! source that changes in any of these gets another container. The folder holds a limited number of bytes. The least
//! recently used containers are removed first, but never the requested one.

use std::env;
use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use supervol_files::Existing;
use supervol_format::Container;
use supervol_format::canceller::Canceller;
use supervol_format::container::header::MAGIC;
use supervol_sources::grid::placed::{PlacedSource, Placing};
use supervol_sources::input::folder::{FolderDepth, Listing};
use supervol_sources::input::spool::SpoolFolder;
use supervol_sources::open::{Found, OpenOptions, look_at, open, split_array};
use supervol_sources::{SourceError, VolumeSource};
use xxhash_rust::xxh3::xxh3_64;

use crate::error::BuildError;
use crate::pipeline::build;
use crate::pipeline::options::BuildOptions;
use crate::preview::Preview;
use crate::provenance::identify_source_unless;
use crate::report::Progress;

/// Default limit in bytes of the containers in a cache folder.
pub const CACHE_LIMIT_BYTES: u64 = 32 << 30;
/// Number that grows when builds make other statistics or levels of the same source.
const GENERATION: u32 = 3;
/// Subfolder of the cache folder. Files outside it are never removed.
const CONTAINERS: &str = "containers";
/// Ending of the names of containers.
const ENDING: &str = "svol";
/// Ending of the names of file lists. A list names the files that a container was built from, besides the named source.
const LIST_ENDING: &str = "files";

/// Folder named by the first of these environment variables that is set, joined with the second text of its pair.
#[must_use]
pub fn first_of(variables: &[(&str, &str)]) -> Option<PathBuf> {
    let set = |&(variable, below): &(&str, &str)| {
        env::var_os(variable).filter(|value| !value.is_empty()).map(|value| PathBuf::from(value).join(below))
    };
    variables.iter().find_map(set)
}

/// The system's usual cache folder; `None` if the system does not name one.
#[must_use]
pub fn usual_folder() -> Option<PathBuf> {
    first_of(if cfg!(target_os = "macos") {
        &[("HOME", "Library/Caches/supervol")]
    } else if cfg!(windows) {
        &[("LOCALAPPDATA", "supervol/cache")]
    } else {
        &[("XDG_CACHE_HOME", "supervol"), ("HOME", ".cache/supervol")]
    })
}

/// Whether a path should be opened as a container: by its first bytes or its name. An unreadable file counts as one;
/// opening it gives the error.
#[must_use]
pub fn is_container(path: &Path) -> bool {
    if path.extension().is_some_and(|ending| ending == ENDING) {
        return true;
    }
    let (file, _) = split_array(path);
    if file.is_dir() {
        return false;
    }
    let mut start = Vec::new();
    let read = supervol_format::byte_source::check_is_file(&file)
        .and_then(|()| File::open(&file)?.take(MAGIC.len() as u64).read_to_end(&mut start));
    read.is_err() || start == MAGIC
}

/// Reading options for a source, where it does not state them itself.
#[derive(Debug, Clone, Default)]
pub struct Reading {
    /// See [`OpenOptions`]; the cache chooses the folder for decoded voxels.
    pub options: OpenOptions,
    /// Overridden placement and unit.
    pub placing: Option<Placing>,
}

impl Reading {
    /// Opens a source; compressed voxels are decoded into a file in `folder`.
    ///
    /// # Errors
    /// As [`open`].
    pub fn open(&self, source: &Path, folder: &Path) -> Result<Box<dyn VolumeSource>, SourceError> {
        self.open_unless(source, folder, &Canceller::default())
    }

    /// As [`Self::open`], but stops if the canceller is set during decoding.
    fn open_unless(
        &self,
        source: &Path,
        folder: &Path,
        canceller: &Canceller,
    ) -> Result<Box<dyn VolumeSource>, SourceError> {
        let spool = SpoolFolder::at(folder).unless(canceller.clone());
        let options = OpenOptions { spool, ..self.options.clone() };
        let opened = open(source, &options)?;
        Ok(match &self.placing {
            Some(placing) => Box::new(PlacedSource::new(opened, placing)?),
            None => opened,
        })
    }

    /// Whether all options have their default values.
    #[must_use]
    pub fn is_default(&self) -> bool {
        self.describe() == Self::default().describe()
    }

    /// Text of the options that influence the voxels or their placement.
    pub(crate) fn describe(&self) -> String {
        let mut options = OpenOptions { spool: SpoolFolder::default(), ..self.options.clone() };
        options.segy.memory_bytes = 0;
        format!("{options:?} {:?}", self.placing)
    }
}

/// Containers of source files in a folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cache {
    folder: PathBuf,
    limit_bytes: u64,
    has_previews: bool,
}

/// Events that a cache reports.
#[derive(Debug)]
pub enum Told<'a> {
    /// There is no container yet; this one is being built.
    Building(&'a Path),
    /// A preview, to be shown until the container is built.
    Preview(Box<Preview>),
    /// Progress of the build.
    Progress(Progress),
}

impl Cache {
    /// Cache below a folder, or below the system's usual cache folder, with at most `limit_bytes` of containers.
    ///
    /// # Errors
    /// If there is no cache folder.
    pub fn below(folder: Option<&Path>, limit_bytes: u64) -> Result<Self, BuildError> {
        let folder = folder.map(Path::to_path_buf).or_else(usual_folder).ok_or(BuildError::NoCacheFolder)?;
        Ok(Self { folder: folder.join(CONTAINERS), limit_bytes, has_previews: false })
    }

    /// The same cache, with previews while large containers are built ([`Told::Preview`]).
    #[must_use]
    pub fn with_previews(self) -> Self {
        Self { has_previews: true, ..self }
    }

    /// Container of a source in its present state: the cached one, or a new one.
    ///
    /// # Errors
    /// If the source cannot be read or the container cannot be built. If the build is cancelled
    /// ([`BuildOptions::canceller`]); the next call continues it.
    pub fn container_of(
        &self,
        source: &Path,
        reading: &Reading,
        options: &BuildOptions,
        told: &(dyn Fn(Told<'_>) + Sync),
    ) -> Result<PathBuf, BuildError> {
        let made = std::fs::create_dir_all(&self.folder);
        made.map_err(|e| BuildError::write(&self.folder, e))?;
        let path = self.path_of(source, reading, options.kind.as_deref())?;
        if !is_kept(&path) {
            // A file that no reader knows is refused before a build is announced. Opening the others may take a while.
            let is_known = reading.options.raw.is_some() || !source.is_file() || look_at(source)? != Found::Other;
            if is_known {
                told(Told::Building(&path));
            }
            let opened = reading.open_unless(source, &self.folder, &options.canceller)?;
            if !is_known {
                told(Told::Building(&path));
            }
            if self.has_previews {
                match Preview::of(opened.as_ref(), &self.folder, &options.canceller) {
                    Ok(Some(preview)) => told(Told::Preview(Box::new(preview))),
                    Err(error) if error.is_stopped() => return Err(error),
                    // The build reports errors of the source or the folder.
                    Ok(None) | Err(_) => {}
                }
            }
            let selection = &reading.options.selection;
            let origin = identify_source_unless(source, selection, opened.as_ref(), &options.canceller)?;
            let options = BuildOptions { existing: Existing::Replace, ..options.clone() };
            build(opened.as_ref(), origin, &path, &options, &|progress| told(Told::Progress(progress)))?;
            self.list_files(&path, source, opened.as_ref())?;
        }
        // Sets the time of the last use. If that fails, the order of building counts.
        let _ = File::open(&path).and_then(|file| file.set_modified(SystemTime::now()));
        self.prune(&path).map_err(|e| BuildError::write(&self.folder, e))?;
        Ok(path)
    }

    /// Path of the container of a source in its present state, built or not.
    ///
    /// The name depends on [`GENERATION`], so that containers of earlier programs are not used.
    fn path_of(&self, source: &Path, reading: &Reading, kind: Option<&str>) -> Result<PathBuf, SourceError> {
        let (file, array) = split_array(source);
        let whole = std::fs::canonicalize(&file).map_err(|e| SourceError::io(&file, e))?;
        let files = if whole.is_dir() {
            Listing::of(&whole, FolderDepth::WithSubfolders, reading.options.outside)?.files
        } else {
            vec![whole.clone()]
        };
        let mut identity = format!("{} {GENERATION}\n{array:?}\n{}\n", env!("CARGO_PKG_VERSION"), reading.describe());
        if let Some(kind) = kind {
            let _ = writeln!(identity, "{kind}");
        }
        for file in &files {
            identity += &line_of(file).map_err(|e| SourceError::io(file, e))?;
        }
        let stem = whole.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        Ok(self.folder.join(format!("{stem}-{:016x}.{ENDING}", xxh3_64(identity.as_bytes()))))
    }

    /// Writes the list of files, besides the named one, that a container was built from.
    fn list_files(&self, path: &Path, source: &Path, opened: &dyn VolumeSource) -> Result<(), BuildError> {
        let (asked, _) = split_array(source);
        let files = opened.info().files.iter().map(supervol_sources::input::file::SourceFile::path);
        let others: Vec<&Path> = files.filter(|file| !asked.is_dir() && *file != asked).collect();
        if others.is_empty() {
            return Ok(());
        }
        let lines: io::Result<String> = others.into_iter().map(line_of).collect();
        lines.and_then(|text| std::fs::write(list_of(path), text)).map_err(|e| BuildError::write(path, e))
    }

    /// Removes the least recently used containers until the rest, with `kept` among them, fits the limit.
    fn prune(&self, kept: &Path) -> io::Result<()> {
        let mut found = Vec::new();
        for entry in std::fs::read_dir(&self.folder)?.flatten() {
            // Another process may have removed the file meanwhile.
            let (path, Ok(metadata)) = (entry.path(), entry.metadata()) else { continue };
            if path.extension().is_some_and(|ending| ending == ENDING) {
                found.push((metadata.modified()?, metadata.len(), path));
            }
        }
        found.sort();
        let mut bytes: u64 = found.iter().map(|(_, bytes, _)| bytes).sum();
        for (_, of_this, path) in found.iter().filter(|(.., path)| path != kept) {
            if bytes <= self.limit_bytes {
                break;
            }
            let _ = (std::fs::remove_file(path), std::fs::remove_file(list_of(path)));
            bytes -= of_this;
        }
        Ok(())
    }
}

fn list_of(container: &Path) -> PathBuf {
    container.with_extension(LIST_ENDING)
}

/// Whether a container is whole, and the files in its list are unchanged.
fn is_kept(path: &Path) -> bool {
    if Container::open(path).is_err() {
        return false;
    }
    let Ok(listed) = std::fs::read_to_string(list_of(path)) else { return true };
    listed.split_inclusive('\0').all(|line| {
        let file = line.rsplit('\t').next().map(|file| PathBuf::from(file.trim_end_matches('\0')));
        file.and_then(|file| line_of(&file).ok()).is_some_and(|now| now == line)
    })
}

/// Size, time and path of a file, ended by a byte that no path contains.
fn line_of(file: &Path) -> io::Result<String> {
    let metadata = std::fs::metadata(file)?;
    let changed = metadata.modified()?.duration_since(SystemTime::UNIX_EPOCH).unwrap_or(Duration::ZERO);
    let mut line = String::new();
    let _ = write!(line, "{}\t{}\t{}\0", metadata.len(), changed.as_nanos(), file.display());
    Ok(line)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    /// A NRRD header with its voxels in a file beside it.
    fn source(folder: &Path, name: &str, voxel: u8) -> PathBuf {
        let (header, data) = (folder.join(format!("{name}.nhdr")), folder.join(format!("{name}.raw")));
        let text = format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 8 8 8\nencoding: raw\ndata file: {name}.raw\n");
        std::fs::write(&header, text).unwrap();
        let voxels: Vec<u8> = (0..512).map(|i| (i % 7) as u8 + voxel).collect();
        std::fs::write(data, voxels).unwrap();
        header
    }

    fn built(cache: &Cache, source: &Path, reading: &Reading) -> (PathBuf, bool) {
        let builds = AtomicUsize::new(0);
        let told = |told: Told<'_>| {
            if matches!(told, Told::Building(_)) {
                builds.fetch_add(1, Ordering::Relaxed);
            }
        };
        let path = cache.container_of(source, reading, &BuildOptions::default(), &told).unwrap();
        (path, builds.into_inner() > 0)
    }

    #[test]
    fn a_source_is_built_once_until_it_changes() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::below(Some(&folder.path().join("cache")), CACHE_LIMIT_BYTES).unwrap();
        let (file, plain) = (source(folder.path(), "a", 0), Reading::default());
        let (first, is_new) = built(&cache, &file, &plain);
        assert!(is_new && is_container(&first) && !is_container(&file));
        assert_eq!(built(&cache, &file, &plain), (first.clone(), false));
        // First the same file with other reading options; then changed voxels beside an unchanged header.
        let unit = Placing { spacing: Some([2.0; 3]), ..Placing::default() };
        let (placed, is_new) = built(&cache, &file, &Reading { placing: Some(unit), ..Reading::default() });
        assert!(is_new && placed != first);
        let data = folder.path().join("a.raw");
        std::fs::write(&data, [9; 512]).unwrap();
        File::open(&data).unwrap().set_modified(SystemTime::UNIX_EPOCH).unwrap();
        assert_eq!(built(&cache, &file, &plain), (first.clone(), true));
        let range = Container::open(&first).unwrap().manifest().value_range.unwrap();
        assert_eq!([range.min, range.max], [9.0; 2]);
        assert_eq!(built(&cache, &file, &plain), (first, false));
    }

    #[test]
    fn a_build_that_is_stopped_leaves_no_container_and_the_next_one_does() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::below(Some(&folder.path().join("cache")), CACHE_LIMIT_BYTES).unwrap();
        let file = source(folder.path(), "a", 0);
        let options = BuildOptions::default();
        options.canceller.cancel();
        let error = cache.container_of(&file, &Reading::default(), &options, &|_| ()).unwrap_err();
        assert!(error.is_stopped(), "{error}");
        assert_eq!(std::fs::read_dir(&cache.folder).unwrap().count(), 0);
        assert!(built(&cache, &file, &Reading::default()).1);
    }

    #[test]
    fn what_was_used_longest_ago_goes_first() {
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::below(Some(folder.path()), CACHE_LIMIT_BYTES).unwrap();
        let paths = ["a", "b", "c"].map(|name| built(&cache, &source(folder.path(), name, 1), &Reading::default()).0);
        for (age, path) in [(1, &paths[0]), (3, &paths[1]), (2, &paths[2])] {
            let used = SystemTime::now() - Duration::from_secs(60 * age);
            File::open(path).unwrap().set_modified(used).unwrap();
        }
        let bytes = std::fs::metadata(&paths[0]).unwrap().len();
        let small = Cache { limit_bytes: 2 * bytes, ..cache.clone() };
        // Using `a` makes it the newest; `b` is the oldest.
        assert_eq!(built(&small, &folder.path().join("a.nhdr"), &Reading::default()), (paths[0].clone(), false));
        assert_eq!(paths.each_ref().map(|path| path.exists()), [true, false, true]);
        // The requested container stays, however small the limit.
        let none = Cache { limit_bytes: 0, ..cache };
        assert_eq!(built(&none, &folder.path().join("c.nhdr"), &Reading::default()).0, paths[2]);
        assert_eq!(paths.each_ref().map(|path| path.exists()), [false, false, true]);
        assert!(!list_of(&paths[0]).exists() && list_of(&paths[2]).exists());
    }

    #[test]
    fn the_first_variable_that_is_set_names_the_folder() {
        // PATH is set on every machine that runs tests.
        let path = PathBuf::from(env::var_os("PATH").unwrap());
        assert_eq!(first_of(&[("SUPERVOL_NOT_SET", "x"), ("PATH", "below")]), Some(path.join("below")));
        assert_eq!(first_of(&[("SUPERVOL_NOT_SET", "x")]), None);
    }
}
