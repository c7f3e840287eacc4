//! The bytes of a grid: one file from an offset on, or several files with an equal share each.
//!
//! Part files are opened on demand, and few stay open ([`OpenFiles`]). Opening checks all lengths once.

use std::fs::File;
use std::path::{Path, PathBuf};

use supervol_format::ByteSource;

use crate::SourceError;
use crate::cast::index;
use crate::input::open_files::OpenFiles;

/// One of several files of a grid.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// Path of the file.
    pub path: PathBuf,
    /// Offset of the file's share of the grid in bytes.
    pub offset: u64,
}

/// Files of a grid, see the module head.
#[derive(Debug)]
pub(super) enum Storage {
    Single { path: PathBuf, file: File, offset: u64 },
    Parts { parts: Vec<Part>, part_bytes: u64, open: OpenFiles },
}

impl Storage {
    pub(super) fn single(path: &Path, file: File, offset: u64, bytes: u64) -> Result<Self, SourceError> {
        check_length(path, &file, offset, bytes)?;
        Ok(Self::Single { path: path.into(), file, offset })
    }

    pub(super) fn parts(header: &Path, parts: Vec<Part>, bytes: u64) -> Result<Self, SourceError> {
        let count = parts.len() as u64;
        if count == 0 || !bytes.is_multiple_of(count) {
            let expected = format!("a number of data files that divides the {bytes} bytes of the grid");
            return Err(SourceError::invalid(header, "data files", expected, format!("{count} files")));
        }
        let part_bytes = bytes / count;
        for part in &parts {
            let file = File::open(&part.path).map_err(|e| SourceError::io(&part.path, e))?;
            check_length(&part.path, &file, part.offset, part_bytes)?;
        }
        Ok(Self::Parts { parts, part_bytes, open: OpenFiles::default() })
    }

    /// Fills `out` with the bytes of the grid from byte `position` on.
    pub(super) fn read(&self, position: u64, out: &mut [u8]) -> Result<(), SourceError> {
        match self {
            Self::Single { path, file, offset } => {
                file.read_exact_at(offset + position, out).map_err(|e| SourceError::io(path, e))
            }
            Self::Parts { parts, part_bytes, open } => {
                let (mut position, mut out) = (position, out);
                while !out.is_empty() {
                    // The index fits `usize`: that many parts are in memory.
                    let number = index(position / part_bytes);
                    let inside = position % part_bytes;
                    let length = index((part_bytes - inside).min(out.len() as u64));
                    let (now, later) = out.split_at_mut(length);
                    let part = &parts[number];
                    let file = open.get(number, &part.path).map_err(|e| SourceError::io(&part.path, e))?;
                    file.read_exact_at(part.offset + inside, now).map_err(|e| SourceError::io(&part.path, e))?;
                    (position, out) = (position + length as u64, later);
                }
                Ok(())
            }
        }
    }
}

fn check_length(path: &Path, file: &File, offset: u64, bytes: u64) -> Result<(), SourceError> {
    let found = file.len().map_err(|e| SourceError::io(path, e))?;
    match offset.checked_add(bytes) {
        Some(end) if end <= found => Ok(()),
        end => {
            let expected = end.map_or_else(|| "less than 2^64 bytes".into(), |end| format!("{end} bytes"));
            let what = format!("{expected} ({bytes} of voxels from byte {offset} on)");
            Err(SourceError::invalid(path, "length of the file", what, format!("{found} bytes")))
        }
    }
}
