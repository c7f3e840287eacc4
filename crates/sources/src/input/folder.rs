//! The files of a folder that holds one volume: slices of a series, pictures of a stack.
//!
//! Subfolders are searched. Links that lead outside are followed only if allowed, because a folder from someone else
//! could name any file of the machine. Files are in natural order: `s9` before `s10`.

use std::cmp::Ordering;
use std::path::{Path, PathBuf};

use super::data_files::{FILES_LIMIT, Outside};
use super::selection::Selection;
use super::spool::SpoolFolder;
use super::values::Values;
use crate::error::SourceError;
use crate::{Message, ReadOption};

/// Largest depth of subfolders that are searched.
const DEPTH_LIMIT: usize = 8;
/// Largest number of folder entries that are examined.
const ENTRIES_LIMIT: usize = 4 * FILES_LIMIT;

/// Options for a folder of slices, or for a single file of the same formats.
#[derive(Debug, Clone)]
pub struct FolderOptions<'a> {
    /// Series, frame and channel to read.
    pub selection: &'a Selection,
    /// Whether links may lead outside the folder.
    pub outside: Outside,
    /// Folder for decoded pixels.
    pub spool: &'a SpoolFolder,
    /// Largest memory in bytes for a decoded slice.
    pub memory_bytes: u64,
    /// Whether attributes of the file that explain its numbers are applied.
    pub values: Values,
}

/// Files of a folder, and the number of links that were not followed.
#[derive(Debug, Default)]
pub struct Listing {
    /// Files in natural order of their paths.
    pub files: Vec<PathBuf>,
    pub(crate) links_outside: usize,
    entries: usize,
}

/// Folders that a listing includes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FolderDepth {
    /// Only the folder itself.
    Flat,
    /// The folder and its subfolders, down to a limit.
    WithSubfolders,
}

impl FolderDepth {
    /// Largest number of folders inside one another below the listed one.
    const fn limit(self) -> usize {
        match self {
            Self::Flat => 0,
            Self::WithSubfolders => DEPTH_LIMIT,
        }
    }
}

impl Listing {
    /// Listing of a single file, as if it were alone in a folder.
    pub(crate) fn one(file: &Path) -> Self {
        Self { files: vec![file.into()], ..Self::default() }
    }

    /// Lists a folder. Names that begin with a dot are skipped.
    ///
    /// # Errors
    /// If a folder cannot be read or holds too many files.
    pub fn of(folder: &Path, depth: FolderDepth, outside: Outside) -> Result<Self, SourceError> {
        let whole = std::fs::canonicalize(folder).map_err(|e| SourceError::io(folder, e))?;
        let mut listing = Self::default();
        listing.list(folder, &whole, depth.limit(), outside)?;
        listing.files.sort_by(|a, b| natural(a, b));
        Ok(listing)
    }

    fn list(&mut self, folder: &Path, whole: &Path, depth: usize, outside: Outside) -> Result<(), SourceError> {
        let io = |e| SourceError::io(folder, e);
        for entry in std::fs::read_dir(folder).map_err(io)? {
            let entry = entry.map_err(io)?;
            self.entries += 1;
            if self.entries > ENTRIES_LIMIT {
                let expected = format!("at most {ENTRIES_LIMIT} files and folders");
                return Err(SourceError::invalid(whole, "folder", expected, "more"));
            }
            if entry.file_name().to_string_lossy().starts_with('.') {
                continue;
            }
            let path = entry.path();
            let is_link = entry.file_type().map_err(io)?.is_symlink();
            if is_link && outside == Outside::Refused {
                let leads_inside = std::fs::canonicalize(&path).is_ok_and(|target| target.starts_with(whole));
                if !leads_inside {
                    self.links_outside += 1;
                    continue;
                }
            }
            // A link to a folder could make a cycle.
            if path.is_dir() && !is_link && depth > 0 {
                self.list(&path, whole, depth - 1, outside)?;
            } else if path.is_file() {
                self.files.push(path);
            }
            if self.files.len() > FILES_LIMIT {
                return Err(SourceError::invalid(whole, "folder", format!("at most {FILES_LIMIT} files"), "more"));
            }
        }
        Ok(())
    }

    /// Notes the links that were not followed.
    pub(crate) fn note(&self, notes: &mut Vec<Message>) {
        if self.links_outside > 0 {
            let count = self.links_outside;
            let what = Message::from(format!("{count} links lead outside the folder and are left out; "));
            notes.push(what.option(ReadOption::Outside).text(" follows them"));
        }
    }
}

/// Natural order: numbers in names compare by value.
pub fn natural(a: &Path, b: &Path) -> Ordering {
    let (a, b) = (a.to_string_lossy(), b.to_string_lossy());
    let (mut left, mut right) = (a.as_bytes(), b.as_bytes());
    while let (Some(x), Some(y)) = (left.first(), right.first()) {
        let order = if x.is_ascii_digit() && y.is_ascii_digit() {
            let (m, n) = (digits(&mut left), digits(&mut right));
            // Without leading zeros, the longer number is the greater one.
            m.len().cmp(&n.len()).then_with(|| m.cmp(n))
        } else {
            (left, right) = (&left[1..], &right[1..]);
            x.to_ascii_lowercase().cmp(&y.to_ascii_lowercase())
        };
        if order != Ordering::Equal {
            return order;
        }
    }
    left.len().cmp(&right.len()).then_with(|| a.cmp(&b))
}

/// Removes the digits at the beginning of `text` and returns them without leading zeros.
fn digits<'a>(text: &mut &'a [u8]) -> &'a [u8] {
    let end = text.iter().position(|b| !b.is_ascii_digit()).unwrap_or(text.len());
    let (number, rest) = text.split_at(end);
    *text = rest;
    let zeros = number.iter().take_while(|b| **b == b'0').count();
    &number[zeros..]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_count_by_their_values() {
        let mut names =
            ["s10.png", "s9.png", "S1.png", "s007.png", "s7.png", "a/2", "a/10", "s.png"].map(PathBuf::from);
        names.sort_by(|a, b| natural(a, b));
        let sorted = ["a/2", "a/10", "s.png", "S1.png", "s007.png", "s7.png", "s9.png", "s10.png"].map(PathBuf::from);
        assert_eq!(names, sorted);
    }
}
