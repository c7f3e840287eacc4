//! What a person may say about a file beside its name.

use super::raw::options::RawOptions;
use super::segy::options::SegyOptions;
use crate::input::data_files::Outside;
use crate::input::folder::FolderOptions;
use crate::input::selection::Selection;
use crate::input::spool::SpoolFolder;

/// What a person may say about a file beside its name.
#[derive(Debug, Clone, Default)]
pub struct OpenOptions {
    /// Shape of a headerless file; its presence makes the file raw.
    pub raw: Option<RawOptions>,
    /// For headers that name data files (NRRD, MetaImage), and for folders with links.
    pub outside: Outside,
    /// For SEG-Y; its memory is what every other reader may take, too.
    pub segy: SegyOptions,
    /// Where compressed or textual voxels are decoded to.
    pub spool: SpoolFolder,
    /// Which volume of several.
    pub selection: Selection,
}

impl OpenOptions {
    /// Those for folders of slices.
    #[must_use]
    pub fn of_folders(&self) -> FolderOptions<'_> {
        let Self { selection, outside, spool, segy, .. } = self;
        FolderOptions { selection, outside: *outside, spool, memory_bytes: segy.memory_bytes }
    }
}
