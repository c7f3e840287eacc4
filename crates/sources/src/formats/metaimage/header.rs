//! The text header of a MetaImage: lines `Key = Value`; `ElementDataFile` is the last.
//!
//! Format: <https://itk.org/Wiki/MetaIO/Documentation>, and the behaviour of MetaIO itself.

use std::collections::HashMap;
use std::io::BufRead;
use std::path::Path;

use crate::SourceError;
use crate::input::data_files::{FILES_LIMIT, pattern_names};
use crate::input::text::{Lines, shortened};

/// Longest header that is read, in bytes; lists of tens of thousands of slices fit.
const HEADER_LIMIT_BYTES: u64 = 4 << 20;
/// Largest number of lines before `ElementDataFile`.
const FIELDS_LIMIT: usize = 1024;
/// Largest number of axes; MetaIO allows 10.
const AXES_LIMIT: usize = 10;

/// Location of the voxels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum DataFiles {
    /// In the header's own file, behind the last line.
    Local,
    /// In these files, relative to the header.
    Named(Vec<String>),
}

/// The fields, and the end of the header.
#[derive(Debug)]
pub(super) struct Header {
    fields: HashMap<String, String>,
    /// File names that follow `ElementDataFile = LIST`.
    list: Vec<String>,
    /// Offset of the first byte behind the header.
    pub(super) end: u64,
}

impl Header {
    pub(super) fn read(path: &Path, reader: impl BufRead) -> Result<Self, SourceError> {
        let mut lines = Lines::new(path, reader.take(HEADER_LIMIT_BYTES));
        let mut header = Self { fields: HashMap::new(), list: Vec::new(), end: 0 };
        let wrong = |expected: &str, found: String| SourceError::invalid(path, "header", expected, found);
        while let Some(line) = lines.next()? {
            if line.trim().is_empty() {
                continue;
            }
            let Some((key, value)) = line.split_once(['=', ':']) else {
                return Err(wrong("lines `Key = Value`", format!("`{}`", shortened(&line))));
            };
            let (key, value) = (key.trim().to_owned(), value.trim().to_owned());
            let is_last = key == "ElementDataFile";
            let is_list = is_last && value.split_whitespace().next() == Some("LIST");
            if header.fields.insert(key, value).is_some() {
                return Err(wrong("each field once", format!("`{}` again", shortened(&line))));
            }
            if header.fields.len() > FIELDS_LIMIT {
                return Err(wrong(&format!("at most {FIELDS_LIMIT} fields"), "more".into()));
            }
            if is_list {
                header.read_list(path, &mut lines)?;
            }
            if is_last {
                header.end = lines.offset;
                return Ok(header);
            }
        }
        Err(wrong("a last field `ElementDataFile`", "none".into()))
    }

    fn read_list(&mut self, path: &Path, lines: &mut Lines<'_, impl BufRead>) -> Result<(), SourceError> {
        while let Some(line) = lines.next()? {
            let name = line.trim();
            if !name.is_empty() {
                self.list.push(name.into());
            }
            if self.list.len() > FILES_LIMIT {
                let expected = format!("at most {FILES_LIMIT} files");
                return Err(SourceError::invalid(path, "ElementDataFile = LIST", expected, "more"));
            }
        }
        Ok(())
    }

    /// The value of the first of these fields that exists; MetaIO has several names for most fields.
    pub(super) fn field(&self, names: &[&str]) -> Option<&str> {
        names.iter().find_map(|name| self.fields.get(*name)).map(String::as_str)
    }

    pub(super) fn required(&self, path: &Path, name: &str) -> Result<&str, SourceError> {
        let missing = || SourceError::invalid(path, "header", format!("a field `{name}`"), "none");
        self.field(&[name]).ok_or_else(missing)
    }

    /// Whether a field is true; `otherwise` if it is missing.
    pub(super) fn flag(&self, path: &Path, names: &[&str], otherwise: bool) -> Result<bool, SourceError> {
        let Some(text) = self.field(names) else { return Ok(otherwise) };
        match text.chars().next().map(|c| c.to_ascii_lowercase()) {
            Some('t' | 'y' | '1') => Ok(true),
            Some('f' | 'n' | '0') => Ok(false),
            _ => Err(SourceError::invalid(path, names[0], "True or False", format!("`{}`", shortened(text)))),
        }
    }

    /// An integer; 0 if the field is missing.
    pub(super) fn whole_number(&self, path: &Path, name: &str) -> Result<i64, SourceError> {
        let Some(text) = self.field(&[name]) else { return Ok(0) };
        let wrong = |_| SourceError::invalid(path, name, "a whole number", format!("`{}`", shortened(text)));
        text.parse().map_err(wrong)
    }

    /// Exactly `count` numbers, or `None` if all these fields are missing.
    pub(super) fn numbers(&self, path: &Path, names: &[&str], count: usize) -> Result<Option<Vec<f64>>, SourceError> {
        let Some(text) = self.field(names) else { return Ok(None) };
        let parsed: Option<Vec<f64>> = text.split_whitespace().map(|s| s.parse().ok()).collect();
        let wrong =
            || SourceError::invalid(path, names[0], format!("{count} numbers"), format!("`{}`", shortened(text)));
        parsed.filter(|numbers| numbers.len() == count).map(Some).ok_or_else(wrong)
    }

    /// Number of voxels along each axis, fastest first; `NDims` of them.
    pub(super) fn sizes(&self, path: &Path) -> Result<Vec<u64>, SourceError> {
        let text = self.required(path, "NDims")?;
        let count = text.parse().ok().filter(|n| (1..=AXES_LIMIT).contains(n)).ok_or_else(|| {
            SourceError::invalid(path, "NDims", format!("1 to {AXES_LIMIT}"), format!("`{}`", shortened(text)))
        })?;
        let text = self.required(path, "DimSize")?;
        let parsed: Option<Vec<u64>> = text.split_whitespace().map(|s| s.parse().ok().filter(|n| *n > 0)).collect();
        parsed.filter(|sizes| sizes.len() == count).ok_or_else(|| {
            let expected = format!("{count} positive whole numbers");
            SourceError::invalid(path, "DimSize", expected, format!("`{}`", shortened(text)))
        })
    }

    /// Location of the voxels. `axes` is the number of axes of the grid; if there are several files, each must be a
    /// slab of it.
    pub(super) fn data_files(&self, path: &Path, axes: usize) -> Result<DataFiles, SourceError> {
        const FIELD: &str = "ElementDataFile";
        let text = self.required(path, FIELD)?;
        let words: Vec<&str> = text.split_whitespace().collect();
        let (names, slab) = match words[..] {
            ["LOCAL" | "Local" | "local"] => return Ok(DataFiles::Local),
            ["LIST"] => (self.list.clone(), None),
            ["LIST", slab] => (self.list.clone(), Some(slab.trim_end_matches(['d', 'D']))),
            [pattern, min, max, step] if pattern.contains('%') => {
                (pattern_names(path, pattern, [min, max, step])?, None)
            }
            [pattern, min, max] if pattern.contains('%') => (pattern_names(path, pattern, [min, max, "1"])?, None),
            [] => return Err(SourceError::invalid(path, FIELD, "a file name", "nothing")),
            _ => (vec![text.into()], None),
        };
        let is_allowed = |slab: &&str| slab.parse::<usize>().is_ok_and(|n| (1..=axes).contains(&n));
        if let Some(wrong) = slab.filter(|slab| !is_allowed(slab)) {
            let expected = format!("a dimension of 1 to {axes} per file");
            return Err(SourceError::invalid(path, FIELD, expected, format!("`{}`", shortened(wrong))));
        }
        if names.is_empty() {
            return Err(SourceError::invalid(path, FIELD, "at least one file name", "none"));
        }
        Ok(DataFiles::Named(names))
    }
}
