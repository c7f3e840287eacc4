//! Positional reads of a container's bytes. Threads share a source without sharing a cursor.

use std::fs::File;
use std::io;
use std::path::Path;

/// Refuses everything but a regular file: opening a FIFO may block for ever, and reading a device may never end. Call
/// this before opening a path that a person has named.
///
/// # Errors
/// `InvalidInput` for a folder, a FIFO, a device or a socket; otherwise the system's error.
pub fn check_is_file(path: &Path) -> io::Result<()> {
    let kind = std::fs::metadata(path)?.file_type();
    if kind.is_file() {
        return Ok(());
    }
    let found =
        if kind.is_dir() { "a folder" } else { "a FIFO, device or socket (save what it gives to a file first)" };
    Err(io::Error::new(io::ErrorKind::InvalidInput, format!("expected a file, found {found}")))
}

/// Read pattern that suits a source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadShape {
    /// Largest gap in bytes between two wanted ranges that a reader reads over instead of skipping.
    pub gap_bytes: u64,
    /// Largest size in bytes of one read that serves several ranges. A single range may be longer.
    pub read_bytes: u64,
}

impl ReadShape {
    /// Pattern for local files: on every medium we know, reading a small gap is cheaper than a second request.
    pub const FILE: Self = Self { gap_bytes: 16 << 10, read_bytes: 4 << 20 };
}

/// Bytes of known length that can be read at any offset.
pub trait ByteSource: Send + Sync {
    /// Length in bytes.
    ///
    /// # Errors
    /// The system's error.
    fn len(&self) -> io::Result<u64>;

    /// Fills `buffer` from the byte `offset` on.
    ///
    /// # Errors
    /// `UnexpectedEof` if the source ends first; otherwise the system's error.
    fn read_exact_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()>;

    /// Fills each buffer from its byte offset on. A remote source requests all ranges at once.
    ///
    /// # Errors
    /// As [`Self::read_exact_at`]. After an error the contents of the buffers are unspecified.
    fn read_several(&self, ranges: &mut [(u64, &mut [u8])]) -> io::Result<()> {
        ranges.iter_mut().try_for_each(|(offset, buffer)| self.read_exact_at(*offset, buffer))
    }

    /// Read pattern that suits this source. A remote source prefers to read over larger gaps.
    fn read_shape(&self) -> ReadShape {
        ReadShape::FILE
    }

    /// Whether the length is 0.
    ///
    /// # Errors
    /// As [`Self::len`].
    fn is_empty(&self) -> io::Result<bool> {
        Ok(self.len()? == 0)
    }
}

impl ByteSource for File {
    fn len(&self) -> io::Result<u64> {
        Ok(self.metadata()?.len())
    }

    #[cfg(unix)]
    fn read_exact_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        std::os::unix::fs::FileExt::read_exact_at(self, buffer, offset)
    }

    #[cfg(windows)]
    fn read_exact_at(&self, mut offset: u64, mut buffer: &mut [u8]) -> io::Result<()> {
        while !buffer.is_empty() {
            match std::os::windows::fs::FileExt::seek_read(self, buffer, offset)? {
                0 => return Err(io::ErrorKind::UnexpectedEof.into()),
                n => (offset, buffer) = (offset + n as u64, &mut buffer[n..]),
            }
        }
        Ok(())
    }
}

/// A container in memory, for tests, fuzzing and small files.
impl ByteSource for Vec<u8> {
    fn len(&self) -> io::Result<u64> {
        Ok(Vec::len(self) as u64)
    }

    fn read_exact_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        let start = usize::try_from(offset).map_err(|_| io::ErrorKind::UnexpectedEof)?;
        let end = start.checked_add(buffer.len()).ok_or(io::ErrorKind::UnexpectedEof)?;
        buffer.copy_from_slice(self.get(start..end).ok_or(io::ErrorKind::UnexpectedEof)?);
        Ok(())
    }
}
