//! Where a container's bytes come from: positional reads, so that threads need not share a cursor.

use std::fs::File;
use std::io;
use std::path::Path;

/// Refuses what is no file: opening a FIFO may wait for ever, reading a device may never end. To be called before a file
/// that a person has named is opened.
///
/// # Errors
/// `InvalidInput` for a folder, a FIFO, a device or a socket; otherwise whatever the system says.
pub fn check_is_file(path: &Path) -> io::Result<()> {
    let kind = std::fs::metadata(path)?.file_type();
    if kind.is_file() {
        return Ok(());
    }
    let found =
        if kind.is_dir() { "a folder" } else { "a FIFO, device or socket (save what it gives to a file first)" };
    Err(io::Error::new(io::ErrorKind::InvalidInput, format!("expected a file, found {found}")))
}

/// How a source is best read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReadShape {
    /// Bytes between two wanted ranges that are rather read over than skipped.
    pub gap_bytes: u64,
    /// Most bytes of one read that serves several ranges; a single range may be longer.
    pub read_bytes: u64,
}

impl ReadShape {
    /// Local files: on every medium we know, reading a small gap is cheaper than a second request.
    pub const FILE: Self = Self { gap_bytes: 16 << 10, read_bytes: 4 << 20 };
}

/// Something with a length that can be read anywhere.
pub trait ByteSource: Send + Sync {
    /// Length in bytes.
    ///
    /// # Errors
    /// Whatever the system says.
    fn len(&self) -> io::Result<u64>;

    /// Fills `buffer` from `offset` on.
    ///
    /// # Errors
    /// `UnexpectedEof` where the source ends first; otherwise whatever the system says.
    fn read_exact_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()>;

    /// Fills each buffer from its offset on. A source that is far away asks for all of them at once.
    ///
    /// # Errors
    /// As [`Self::read_exact_at`]; what the buffers hold then is not said.
    fn read_several(&self, ranges: &mut [(u64, &mut [u8])]) -> io::Result<()> {
        ranges.iter_mut().try_for_each(|(offset, buffer)| self.read_exact_at(*offset, buffer))
    }

    /// How it is best read: a source that is far away reads over larger gaps.
    fn read_shape(&self) -> ReadShape {
        ReadShape::FILE
    }

    /// Whether there is nothing to read.
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

/// A container held in memory: tests, fuzzing, small files.
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
