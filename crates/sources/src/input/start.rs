//! First bytes and name of a file. Readers recognize their format by these.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::error::SourceError;

/// Bytes at the beginning of a file that are examined.
const START_BYTES: u64 = 512;

/// Path, first bytes and name of a file.
#[derive(Debug)]
pub struct FileStart<'a> {
    /// Path of the file.
    pub path: &'a Path,
    /// The first 512 bytes, or all bytes of a shorter file.
    pub bytes: Vec<u8>,
    /// Name without folders, in lower case.
    pub name: String,
}

impl<'a> FileStart<'a> {
    /// Reads the first bytes of a file.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn of(path: &'a Path) -> Result<Self, SourceError> {
        let mut bytes = Vec::new();
        let file = File::open(path).map_err(|e| SourceError::io(path, e))?;
        file.take(START_BYTES).read_to_end(&mut bytes).map_err(|e| SourceError::io(path, e))?;
        Ok(Self { path, bytes, name: lower_name(path) })
    }

    /// Whether the file begins with these bytes.
    #[must_use]
    pub fn begins_with(&self, bytes: &[u8]) -> bool {
        self.bytes.starts_with(bytes)
    }

    /// Whether these bytes occur anywhere in the first 512.
    #[must_use]
    pub fn holds(&self, bytes: &[u8]) -> bool {
        self.bytes.windows(bytes.len()).any(|window| window == bytes)
    }

    /// Whether the file begins with this text, after any white space.
    #[must_use]
    pub fn text_begins_with(&self, text: &[u8]) -> bool {
        self.bytes.trim_ascii_start().starts_with(text)
    }

    /// Whether the name has one of these endings, given in lower case.
    #[must_use]
    pub fn is_named(&self, endings: &[&str]) -> bool {
        is_named(&self.name, endings)
    }
}

/// The name of a file without its folders, in lower case.
#[must_use]
pub fn lower_name(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// Whether a name in lower case has one of these endings.
#[must_use]
pub fn is_named(name: &str, endings: &[&str]) -> bool {
    endings.iter().any(|ending| name.ends_with(ending))
}
