//! Data of an HDF5 file in other files: external links and external raw data. They are read if they lie in the file's
//! folder or below it, or if files outside are allowed.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use hdf5_reader::error::Error;
use hdf5_reader::storage::DynStorage;
use hdf5_reader::{ExternalFileResolver, ExternalLinkResolver, FileStorage, Hdf5File, OpenOptions};

use super::{of_hdf5, sentence};
use crate::SourceError;
use crate::input::data_files::{Outside, find_all, look_at};
use crate::input::file::SourceFile;

/// Files that an HDF5 file refers to.
#[derive(Clone)]
pub(super) struct Linked {
    path: PathBuf,
    outside: Outside,
    opened: Arc<Mutex<Opened>>,
}

/// Files that were opened, and the reason why the first other file was not.
#[derive(Default)]
struct Opened {
    files: Vec<(PathBuf, SourceFile)>,
    refused: Option<SourceError>,
    /// Whether a link led to another HDF5 file.
    has_links: bool,
}

impl Linked {
    pub(super) fn of(path: &Path, outside: Outside) -> Self {
        Self { path: path.into(), outside, opened: Arc::default() }
    }

    fn opened(&self) -> std::sync::MutexGuard<'_, Opened> {
        // The list is consistent even after a panic, so a poisoned lock is safe to use.
        self.opened.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Files besides the opened one.
    pub(super) fn files(&self) -> Vec<SourceFile> {
        self.opened().files.iter().map(|(_, file)| file.clone()).collect()
    }

    /// Whether a link led to another HDF5 file.
    pub(super) fn has_links(&self) -> bool {
        self.opened().has_links
    }

    /// The reason why a file was not opened, if that happened.
    pub(super) fn refusal(&self) -> Option<SourceError> {
        self.opened().refused.take()
    }

    /// Opens a file by the name in the HDF5 file.
    fn open(&self, name: &str) -> Result<(PathBuf, File), Error> {
        let found = || -> Result<(PathBuf, SourceFile, File), SourceError> {
            let path = find_all(&self.path, &[name.to_owned()], self.outside)?.remove(0);
            let source_file = look_at(&self.path, &path)?;
            let file = File::open(&path).map_err(|e| SourceError::io(&path, e))?;
            Ok((path, source_file, file))
        };
        match found() {
            Ok((path, source_file, file)) => {
                let mut opened = self.opened();
                if opened.files.iter().all(|(known, _)| *known != path) {
                    opened.files.push((path.clone(), source_file));
                }
                Ok((path, file))
            }
            Err(error) => {
                let text = sentence(&error.to_string());
                self.opened().refused.get_or_insert(error);
                Err(Error::Other(text))
            }
        }
    }
}

impl ExternalFileResolver for Linked {
    fn resolve_external_file(&self, name: &str) -> Result<Option<DynStorage>, Error> {
        let (_, file) = self.open(name)?;
        Ok(Some(Arc::new(FileStorage::from_file(file)?)))
    }
}

/// Opens linked files, with the same limits as the file that links to them. Links in these are not followed.
pub(super) struct Links {
    pub(super) linked: Linked,
    pub(super) limits: fn(usize) -> OpenOptions,
    pub(super) memory_bytes: usize,
}

impl ExternalLinkResolver for Links {
    fn resolve_external_link(&self, name: &str) -> Result<Option<Hdf5File>, Error> {
        // A dataset behind a link that leads nowhere is missing; others are still read.
        let Ok((path, file)) = self.linked.open(name) else { return Ok(None) };
        self.linked.opened().has_links = true;
        let limits = (self.limits)(self.memory_bytes).with_external_file_resolver(Arc::new(self.linked.clone()));
        let opened = FileStorage::from_file(file)
            .and_then(|storage| Hdf5File::from_storage_with_options(Arc::new(storage), limits));
        match opened {
            Ok(file) => Ok(Some(file)),
            Err(error) => {
                self.linked.opened().refused.get_or_insert(of_hdf5(&path, error));
                Ok(None)
            }
        }
    }
}
