//! The file being read: its bytes, and its path for messages.

use std::path::Path;

use supervol_format::ByteSource;

use crate::{Message, SourceError};

/// A file and what it is called.
#[derive(Clone, Copy)]
pub(super) struct Input<'a> {
    pub(super) path: &'a Path,
    pub(super) bytes: &'a dyn ByteSource,
}

impl Input<'_> {
    /// Size of the file in bytes.
    pub(super) fn len(&self) -> Result<u64, SourceError> {
        self.bytes.len().map_err(|e| SourceError::io(self.path, e))
    }

    /// Fills `buffer` from byte `offset` on.
    pub(super) fn read(&self, offset: u64, buffer: &mut [u8]) -> Result<(), SourceError> {
        self.bytes.read_exact_at(offset, buffer).map_err(|e| SourceError::io(self.path, e))
    }

    /// [`SourceError::Invalid`] for this file.
    pub(super) fn invalid(
        &self,
        location: impl Into<String>,
        expected: impl Into<Message>,
        found: impl Into<String>,
    ) -> SourceError {
        SourceError::invalid(self.path, location, expected, found)
    }

    /// [`SourceError::Unsupported`] for this file.
    pub(super) fn unsupported(&self, what: impl Into<String>, advice: impl Into<Message>) -> SourceError {
        SourceError::unsupported(self.path, what, advice)
    }
}
