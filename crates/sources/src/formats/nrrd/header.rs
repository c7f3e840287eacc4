//! The text header of a NRRD file, parsed to fields; only numbers and names are interpreted.
//!
//! Format: <https://teem.sourceforge.net/nrrd/format.html>. A header is a magic line, then lines `field: description`,
//! `key:=value` or `# comment`. It ends at an empty line (the data follows) or at the end of the file (detached).
//! Field names are compared without case and spaces: `datafile` and `data file` are the same field.
//! The parser reads at most [`HEADER_LIMIT_BYTES`] and allocates in proportion to the bytes read.

use std::collections::HashMap;
use std::io::BufRead;
use std::path::Path;

use crate::SourceError;
use crate::input::data_files::{FILES_LIMIT, pattern_names};
use crate::input::text::{Lines, shortened};

/// Longest header that is read, in bytes; lists of tens of thousands of slices fit.
pub(super) const HEADER_LIMIT_BYTES: u64 = 4 << 20;

/// Largest number of axes of a NRRD (`NRRD_DIM_MAX`).
const AXES_LIMIT: usize = 16;

/// Encoding of the voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Raw,
    Gzip,
    Text,
}

/// Location of the voxels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum DataFiles {
    /// In the header's own file, behind the empty line.
    Attached,
    /// In these files, relative to the header.
    Named(Vec<String>),
}

/// The fields: name without spaces and in lower case, description trimmed.
#[derive(Debug)]
pub(super) struct Header {
    fields: Vec<(String, String)>,
    /// Index of each name in `fields`.
    places: HashMap<String, usize>,
    /// Offset of the first byte behind the header.
    pub(super) end: u64,
    /// Whether the header ended with an empty line.
    pub(super) has_data: bool,
    /// File names that follow `data file: LIST`.
    list: Vec<String>,
    /// Whether key and value pairs describe segments, as 3D Slicer writes them.
    is_segmentation: bool,
}

impl Header {
    pub(super) fn read(path: &Path, reader: impl BufRead) -> Result<Self, SourceError> {
        let mut lines = Lines::new(path, reader.take(HEADER_LIMIT_BYTES));
        let magic = lines.next()?.unwrap_or_default();
        check_magic(path, &magic)?;
        let mut header = Self {
            fields: Vec::new(),
            places: HashMap::new(),
            end: 0,
            has_data: false,
            list: Vec::new(),
            is_segmentation: false,
        };
        let mut in_list = false;
        while let Some(line) = lines.next()? {
            if in_list {
                let name = line.trim();
                if !name.is_empty() {
                    header.list.push(name.into());
                }
                if header.list.len() > FILES_LIMIT {
                    let found = "more";
                    return Err(SourceError::invalid(
                        path,
                        "data file: LIST",
                        format!("at most {FILES_LIMIT} files"),
                        found,
                    ));
                }
                continue;
            }
            if line.is_empty() {
                header.has_data = true;
                break;
            }
            if line.starts_with('#') {
                continue;
            }
            let Some((name, description)) = line.split_once(':') else {
                let found = format!("`{}`", shortened(&line));
                return Err(SourceError::invalid(path, "header", "lines `field: description` or `key:=value`", found));
            };
            // Key and value pairs are for people, but for those of a segmentation.
            if description.starts_with('=') {
                header.is_segmentation |= name.starts_with("Segmentation_") || name.starts_with("Segment0_");
                continue;
            }
            let name: String = name.chars().filter(|c| !c.is_whitespace()).collect::<String>().to_lowercase();
            let description = description.trim().to_owned();
            in_list = name == "datafile" && description.split_whitespace().next() == Some("LIST");
            if header.field(&name).is_some() {
                let found = format!("a second `{name}: {}`", shortened(&description));
                return Err(SourceError::invalid(path, "header", "each field once", found));
            }
            header.places.insert(name.clone(), header.fields.len());
            header.fields.push((name, description));
        }
        header.end = lines.offset;
        if lines.offset == HEADER_LIMIT_BYTES {
            let found = "no end of it";
            return Err(SourceError::invalid(path, "header", format!("at most {HEADER_LIMIT_BYTES} bytes"), found));
        }
        Ok(header)
    }

    /// The description of a field.
    pub(super) fn field(&self, name: &str) -> Option<&str> {
        self.places.get(name).map(|&place| self.fields[place].1.as_str())
    }

    /// Whether the voxels are the labels of segments.
    pub(super) fn is_segmentation(&self) -> bool {
        self.is_segmentation
    }

    /// Names of all fields, in lower case and without spaces.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.fields.iter().map(|(n, _)| n.as_str())
    }

    pub(super) fn required(&self, path: &Path, name: &str) -> Result<&str, SourceError> {
        let missing = || SourceError::invalid(path, "header", format!("a field `{name}`"), "none");
        self.field(name).ok_or_else(missing)
    }

    /// Number of voxels along each axis, fastest first; `dimension` of them.
    pub(super) fn sizes(&self, path: &Path) -> Result<Vec<u64>, SourceError> {
        let dimension = self.required(path, "dimension")?;
        let count = dimension.parse().ok().filter(|n| (1..=AXES_LIMIT).contains(n)).ok_or_else(|| {
            SourceError::invalid(path, "dimension", format!("1 to {AXES_LIMIT}"), format!("`{}`", shortened(dimension)))
        })?;
        let sizes = self.required(path, "sizes")?;
        let parsed: Option<Vec<u64>> = sizes.split_whitespace().map(|s| s.parse().ok().filter(|n| *n > 0)).collect();
        parsed.filter(|sizes| sizes.len() == count).ok_or_else(|| {
            let expected = format!("{count} positive whole numbers");
            SourceError::invalid(path, "sizes", expected, format!("`{}`", shortened(sizes)))
        })
    }

    /// A field with one number per axis, or `None`; NaN means "unknown".
    pub(super) fn per_axis(&self, path: &Path, name: &str, axes: usize) -> Result<Option<Vec<f64>>, SourceError> {
        let Some(text) = self.field(name) else { return Ok(None) };
        let parsed: Option<Vec<f64>> = text.split_whitespace().map(|s| s.parse().ok()).collect();
        let numbers = parsed.filter(|numbers| numbers.len() == axes);
        numbers.map(Some).ok_or_else(|| {
            SourceError::invalid(path, name, format!("{axes} numbers"), format!("`{}`", shortened(text)))
        })
    }

    /// A field with one word per axis, or `None`.
    pub(super) fn words(&self, path: &Path, name: &str, axes: usize) -> Result<Option<Vec<String>>, SourceError> {
        let Some(text) = self.field(name) else { return Ok(None) };
        let words: Vec<String> = text.split_whitespace().map(str::to_lowercase).collect();
        if words.len() != axes {
            let found = format!("`{}`", shortened(text));
            return Err(SourceError::invalid(path, name, format!("{axes} words"), found));
        }
        Ok(Some(words))
    }

    /// A field with quoted strings.
    pub(super) fn quoted(&self, name: &str) -> Option<Vec<String>> {
        let text = self.field(name)?;
        // Every second piece between quotation marks is inside a pair.
        Some(text.split('"').skip(1).step_by(2).map(str::to_owned).collect())
    }

    pub(super) fn encoding(&self, path: &Path) -> Result<Encoding, SourceError> {
        let text = self.required(path, "encoding")?;
        match text.to_lowercase().as_str() {
            "raw" => Ok(Encoding::Raw),
            "gz" | "gzip" => Ok(Encoding::Gzip),
            "txt" | "text" | "ascii" => Ok(Encoding::Text),
            "hex" | "bz2" | "bzip2" | "zrl" => {
                let advice =
                    "rewrite it as raw or gzip first, for example with `unu save -e gzip -f nrrd -i IN -o OUT`";
                Err(SourceError::unsupported(path, format!("the data is encoded as `{text}`"), advice))
            }
            _ => Err(SourceError::invalid(path, "encoding", "raw, gzip or text", format!("`{}`", shortened(text)))),
        }
    }

    /// An integer; 0 if the field is missing.
    pub(super) fn whole_number(&self, path: &Path, name: &str) -> Result<i64, SourceError> {
        let Some(text) = self.field(name) else { return Ok(0) };
        let number = text.parse();
        number.map_err(|_| SourceError::invalid(path, name, "a whole number", format!("`{}`", shortened(text))))
    }

    /// The data files. `axes` is the number of axes of the whole grid; each file must be a slab of it.
    pub(super) fn data_files(&self, path: &Path, axes: usize) -> Result<DataFiles, SourceError> {
        let Some(text) = self.field("datafile") else {
            if self.has_data {
                return Ok(DataFiles::Attached);
            }
            let expected = "an empty line and then the data, or a field `data file`";
            return Err(SourceError::invalid(path, "header", expected, "the end of the file"));
        };
        let words: Vec<&str> = text.split_whitespace().collect();
        let (names, sub_dimension) = match words[..] {
            ["LIST"] => (self.list.clone(), None),
            ["LIST", sub_dimension] => (self.list.clone(), Some(sub_dimension)),
            [pattern, min, max, step] if pattern.contains('%') => {
                (pattern_names(path, pattern, [min, max, step])?, None)
            }
            [pattern, min, max, step, sub_dimension] if pattern.contains('%') => {
                (pattern_names(path, pattern, [min, max, step])?, Some(sub_dimension))
            }
            [] => return Err(SourceError::invalid(path, "data file", "a file name", "nothing")),
            _ => return Ok(DataFiles::Named(vec![text.into()])),
        };
        // Whatever its number of axes, a file's slab follows the previous one in the grid's own order.
        let allowed = |s: &&str| s.parse::<usize>().is_ok_and(|s| (1..=axes).contains(&s));
        if let Some(wrong) = sub_dimension.filter(|s| !allowed(s)) {
            let found = format!("`{}`", shortened(wrong));
            return Err(SourceError::invalid(path, "data file", format!("a dimension of 1 to {axes} per file"), found));
        }
        if names.is_empty() {
            return Err(SourceError::invalid(path, "data file", "at least one file name", "none"));
        }
        Ok(DataFiles::Named(names))
    }
}

fn check_magic(path: &Path, line: &str) -> Result<(), SourceError> {
    match line.strip_prefix("NRRD000").map(|version| version.trim_end()) {
        Some("1" | "2" | "3" | "4" | "5") => Ok(()),
        _ => Err(SourceError::invalid(path, "first line", "NRRD0001 to NRRD0005", format!("`{}`", shortened(line)))),
    }
}
