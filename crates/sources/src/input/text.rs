//! Text in files: lines of a header, and words shortened for messages.

use std::io::BufRead;
use std::path::Path;

use crate::error::SourceError;

/// The first characters of a text from a file, safe to print in a message.
pub(crate) fn shortened(text: &str) -> String {
    let mut short: String = text.chars().take(60).map(|c| if c.is_control() { '?' } else { c }).collect();
    if text.chars().nth(60).is_some() {
        short.push_str("...");
    }
    short
}

/// Lines without line ends (Unix or Windows). Invalid UTF-8 becomes replacement characters.
pub(crate) struct Lines<'a, R> {
    path: &'a Path,
    reader: R,
    /// Number of bytes read so far.
    pub(crate) offset: u64,
}

impl<'a, R: BufRead> Lines<'a, R> {
    /// Lines from the reader's current position on.
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
