//! Options for opening a file or a folder.

use super::raw::options::RawOptions;
use super::segy::options::SegyOptions;
use crate::grid::nulls::Nulls;
use crate::input::data_files::Outside;
use crate::input::folder::FolderOptions;
use crate::input::selection::Selection;
use crate::input::spool::SpoolFolder;
use crate::input::values::Values;

/// Options for opening a file or a folder. The defaults suit every file that describes itself.
#[derive(Debug, Clone, Default)]
pub struct OpenOptions {
    /// Description of a headerless file. If it is given, the file is read as raw.
    pub raw: Option<RawOptions>,
    /// Whether a header may name data files outside its folder (NRRD, MetaImage), and a folder may link to such files.
    pub outside: Outside,
    /// Options of SEG-Y. `memory_bytes` limits the memory of every other reader, too.
    pub segy: SegyOptions,
    /// Folder for the temporary file of decoded voxels.
    pub spool: SpoolFolder,
    /// Selected volume of a file that holds several.
    pub selection: Selection,
    /// Whether attributes of the file that explain its numbers are applied.
    pub values: Values,
    /// Value that is absent, besides those that the file declares; scaled, as [`SourceInfo`](crate::SourceInfo) says.
    /// Headerless files state it in `raw`.
    pub nodata: Option<f64>,
    /// Rule for usual nulls such as 1e30 and -999.25, of files that declare no absent value.
    pub nulls: Nulls,
}

impl OpenOptions {
    /// The options for folders of slices.
    #[must_use]
    pub fn of_folders(&self) -> FolderOptions<'_> {
        let Self { selection, outside, spool, segy, values, .. } = self;
        FolderOptions { selection, outside: *outside, spool, memory_bytes: segy.memory_bytes, values: *values }
    }
}
