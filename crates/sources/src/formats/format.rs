//! A row of the table of formats: how a file or folder of a format is recognized, and the reader that opens it.

use std::path::{Path, PathBuf};

use super::options::OpenOptions;
use crate::input::selection::Choice;
use crate::input::start::FileStart;
use crate::{SourceError, VolumeSource};

/// Largest number of files of a folder that are examined to recognize it.
const FILES_LOOKED_AT: usize = 64;

/// One format that is read.
#[derive(Debug, Clone, Copy)]
pub struct Format {
    /// Value of [`SourceInfo::format`](crate::SourceInfo::format) of these sources, or the most common one.
    pub name: &'static str,
    /// Name in messages that list all formats; empty if the title of another row covers it.
    pub title: &'static str,
    /// Ends of file names of this format, in lower case, for file dialogs; [`Format::sniff`] decides. Empty if files
    /// have no usual names.
    pub endings: &'static [&'static str],
    /// Parts of a file that the user may select. The readers themselves check frames and channels.
    pub choices: &'static [Choice],
    /// Whether a file has this format.
    pub sniff: fn(&FileStart<'_>, &OpenOptions) -> bool,
    /// Reliability of `sniff`.
    pub certainty: Certainty,
    /// Whether a folder can be a volume of this format.
    pub folder: Folder,
    /// Opens a file, or a folder that `folder` recognizes.
    pub open: OpenVolume,
    /// Meaning of a recognized file for a search for volumes in folders.
    pub found: fn(&FileStart<'_>) -> Found,
}

/// Function that opens a file or a folder as a volume.
pub type OpenVolume = fn(&Path, &OpenOptions) -> Result<Box<dyn VolumeSource>, SourceError>;

/// Reliability of the first bytes and the name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Certainty {
    /// No other format has them.
    Certain,
    /// Files of formats that we do not read may look the same. [`mod@crate::open`] rules these out first.
    Likely,
}

/// Rule that recognizes a folder as one volume.
#[derive(Debug, Clone, Copy)]
pub enum Folder {
    /// No folder is a volume of this format.
    Never,
    /// By files of fixed names in it.
    ByStructure(fn(&Path) -> bool),
    /// By the files in it.
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
    /// A slice of a series. The folder is the volume.
    DicomSlice,
    /// A PNG or JPEG: a slice if the folder holds only pictures, otherwise no part of a volume.
    Picture,
    /// A file that a reader opens.
    Volume,
    /// Any other file.
    Other,
}

/// Files of a folder, in natural order.
#[derive(Debug)]
pub struct FolderFiles(pub Vec<PathBuf>);

impl FolderFiles {
    /// Whether `wanted` accepts one of the first 64 files.
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
