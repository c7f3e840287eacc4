//! A dense grid in the data files that a header names.

use std::fs::File;
use std::path::{Path, PathBuf};

use super::dense::{GridFile, Part, checked_bytes};
use super::layout::GridLayout;
use crate::input::data_files::{look_at, open_data};
use crate::input::file::SourceFile;
use crate::input::spool::SpoolFolder;
use crate::{Message, SourceError};

/// Layout of the voxels in the data files of a header.
pub(crate) trait DataLayout {
    /// Whether the files hold the voxels without encoding.
    fn is_raw(&self) -> bool;

    /// Offset in a file of `share_bytes` bytes of raw voxels, at or behind byte `start`.
    fn offset(&self, path: &Path, start: u64, share_bytes: u64, notes: &mut Vec<Message>) -> Result<u64, SourceError>;

    /// Decodes the voxels of all files into one file, `share_bytes` bytes from each.
    fn decode(&self, files: &[PathBuf], start: u64, share_bytes: u64, spool: &SpoolFolder)
    -> Result<File, SourceError>;
}

/// Data files of a header, with equal shares of the grid.
#[derive(Debug)]
pub(crate) struct HeaderData<'a> {
    /// Path of the header.
    pub(crate) header: &'a Path,
    /// Header field that names the files, for messages.
    pub(crate) key: &'a str,
    /// The files, in the order of the grid.
    pub(crate) files: Vec<PathBuf>,
    /// Offset of the share in each file, in bytes.
    pub(crate) start: u64,
    /// Layout of the voxels.
    pub(crate) layout: GridLayout,
}

impl HeaderData<'_> {
    /// Opens the files; encoded voxels are decoded into `spool`.
    pub(crate) fn open(
        self,
        data: &impl DataLayout,
        spool: &SpoolFolder,
        notes: &mut Vec<Message>,
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
