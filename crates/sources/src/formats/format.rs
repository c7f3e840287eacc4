//! A row of the table of formats: how a file or folder of a format is recognized, and the reader that opens it.

use std::path::{Path, PathBuf};

use super::options::OpenOptions;
use crate::input::selection::Choice;
use crate::input::start::FileStart;
use crate::{SourceError, VolumeSource};

/// Files of a folder that are looked into, to tell what it is.
const FILES_LOOKED_AT: usize = 64;

/// One format that is read.
#[derive(Debug, Clone, Copy)]
pub struct Format {
    /// Name that sources of this format carry in [`SourceInfo::format`](crate::SourceInfo::format), or the commonest of them.
    pub name: &'static str,
    /// Name in messages that list what can be read; empty where another row's covers it.
    pub title: &'static str,
    /// Parts of a file that a person may choose. Frames and channels are checked by the readers.
    pub choices: &'static [Choice],
    /// Whether a file has this format.
    pub sniff: fn(&FileStart<'_>, &OpenOptions) -> bool,
    /// How much `sniff` says.
    pub certainty: Certainty,
    /// Whether a folder can be a volume of this format.
    pub folder: Folder,
    /// Opens a file, or a folder that `folder` recognizes.
    pub open: OpenVolume,
    /// What a recognized file is to a search for volumes in folders.
    pub found: fn(&FileStart<'_>) -> Found,
}

/// Function that opens a file or a folder as a volume.
pub type OpenVolume = fn(&Path, &OpenOptions) -> Result<Box<dyn VolumeSource>, SourceError>;

/// How much the first bytes and the name say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Certainty {
    /// No other format has them.
    Certain,
    /// Files of formats that are not read may look alike; those are ruled out first.
    Likely,
}

/// How a folder is recognized as one volume.
#[derive(Debug, Clone, Copy)]
pub enum Folder {
    /// No folder is a volume of this format.
    Never,
    /// By files of fixed names in it.
    ByStructure(fn(&Path) -> bool),
    /// By the files that it holds.
    ByFiles {
        /// Name of the format in messages.
        title: &'static str,
        /// Whether the folder is a volume of this format.
        sniff: fn(&FolderFiles) -> Result<bool, SourceError>,
    },
}

/// Meaning of a file for a search for volumes in folders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Found {
    /// A slice of a series, which its folder stands for.
    DicomSlice,
    /// A PNG or JPEG: a slice where there is nothing else, else a picture of something.
    Picture,
    /// A file that a reader takes.
    Volume,
    /// Nothing that a reader takes.
    Other,
}

/// Files of a folder, in natural order.
#[derive(Debug)]
pub struct FolderFiles(pub Vec<PathBuf>);

impl FolderFiles {
    /// Whether one of the first 64 files begins as `wanted` says.
    ///
    /// # Errors
    /// If a file before that one cannot be read.
    pub fn any_start(&self, wanted: fn(&FileStart<'_>) -> bool) -> Result<bool, SourceError> {
        for file in self.0.iter().take(FILES_LOOKED_AT) {
            if wanted(&FileStart::of(file)?) {
                return Ok(true);
            }
        }
        Ok(false)
    }
}

impl Format {
    /// Whether a folder is a volume of this format by its structure.
    #[must_use]
    pub fn is_structured(&self, folder: &Path) -> bool {
        matches!(self.folder, Folder::ByStructure(is) if is(folder))
    }

    /// Whether the files of a folder make it a volume of this format.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn takes_folder(&self, files: &FolderFiles) -> Result<bool, SourceError> {
        match self.folder {
            Folder::ByFiles { sniff, .. } => sniff(files),
            Folder::Never | Folder::ByStructure(_) => Ok(false),
        }
    }
}
