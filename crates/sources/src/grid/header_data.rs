//! A dense grid in the data files that a header names.

use std::fs::File;
use std::path::{Path, PathBuf};

use super::dense::{GridFile, Part, checked_bytes};
use super::layout::GridLayout;
use crate::SourceError;
use crate::input::data_files::{look_at, open_data};
use crate::input::file::SourceFile;
use crate::input::spool::SpoolFolder;

/// How the voxels lie in the data files that a header names.
pub(crate) trait DataLayout {
    /// Whether they lie there as they are.
    fn is_raw(&self) -> bool;

    /// First byte of so many bytes of raw voxels in a file, at or behind `start`.
    fn offset(&self, path: &Path, start: u64, share_bytes: u64, notes: &mut Vec<String>) -> Result<u64, SourceError>;

    /// All voxels, so many bytes from each file, decoded one behind the other.
    fn decode(&self, files: &[PathBuf], start: u64, share_bytes: u64, spool: &SpoolFolder)
    -> Result<File, SourceError>;
}

/// Data files of a header, each of which holds the same share of the grid.
#[derive(Debug)]
pub(crate) struct HeaderData<'a> {
    /// The header.
    pub(crate) header: &'a Path,
    /// Key of the header that names the files.
    pub(crate) key: &'a str,
    /// The files, in the order of the grid.
    pub(crate) files: Vec<PathBuf>,
    /// First byte of each file that belongs to its share.
    pub(crate) start: u64,
    /// How the voxels lie in them.
    pub(crate) layout: GridLayout,
}

impl HeaderData<'_> {
    /// Opens the files; encoded voxels are decoded into `spool`.
    pub(crate) fn open(
        self,
        data: &impl DataLayout,
        spool: &SpoolFolder,
        notes: &mut Vec<String>,
    ) -> Result<(GridFile, Vec<SourceFile>), SourceError> {
        let Self { header, key, files, start, layout } = self;
        let bytes = checked_bytes(header, layout.dims, layout.voxel_type)?;
        if !bytes.is_multiple_of(files.len() as u64 * layout.voxel_type.bytes() as u64) {
            let expected = format!("a number of files that divides the {} voxels", layout.dims);
            return Err(SourceError::invalid(header, key, expected, format!("{} files", files.len())));
        }
        let source_files = files.iter().map(|path| look_at(header, path)).collect::<Result<Vec<_>, _>>()?;
        let share_bytes = bytes / files.len() as u64;
        if !data.is_raw() {
            let file = data.decode(&files, start, share_bytes, spool)?;
            return Ok((GridFile::single(&files[0], file, 0, layout)?, source_files));
        }
        let mut parts = Vec::with_capacity(files.len());
        for path in files {
            let offset = data.offset(&path, start, share_bytes, notes)?;
            parts.push(Part { path, offset });
        }
        let grid = match &parts[..] {
            [one] => GridFile::single(&one.path, open_data(&one.path)?, one.offset, layout),
            _ => GridFile::parts(header, parts, layout),
        };
        Ok((grid?, source_files))
    }
}
