//! Texts in files, whatever they hold: lines of a header, and words fit for a message.

use std::io::BufRead;
use std::path::Path;

use crate::error::SourceError;

/// The first characters of a text from a file, fit for a message.
pub(crate) fn shortened(text: &str) -> String {
    let mut short: String = text.chars().take(60).map(|c| if c.is_control() { '?' } else { c }).collect();
    if text.chars().nth(60).is_some() {
        short.push_str("...");
    }
    short
}

/// Lines without their ends, Unix or Windows; bytes that are no UTF-8 become replacement characters.
pub(crate) struct Lines<'a, R> {
    path: &'a Path,
    reader: R,
    /// Bytes read so far.
    pub(crate) offset: u64,
}

impl<'a, R: BufRead> Lines<'a, R> {
    /// Lines of a text that begins where the reader is.
    pub(crate) fn new(path: &'a Path, reader: R) -> Self {
        Self { path, reader, offset: 0 }
    }

    /// The next line; `None` at the end.
    pub(crate) fn next(&mut self) -> Result<Option<String>, SourceError> {
        let mut line = Vec::new();
        let count = self.reader.read_until(b'\n', &mut line).map_err(|e| SourceError::io(self.path, e))?;
        self.offset += count as u64;
        if count == 0 {
            return Ok(None);
        }
        if line.last() == Some(&b'\n') {
            line.pop();
        }
        if line.last() == Some(&b'\r') {
            line.pop();
        }
        Ok(Some(String::from_utf8_lossy(&line).into_owned()))
    }
}
