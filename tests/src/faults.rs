//! Faulty sources: they fail at the n-th read, fail beyond an offset, or end early. Also sources that count reads.

use std::io;
use std::sync::atomic::{AtomicU64, Ordering};

use supervol_format::{ByteSource, VoxelBox};
use supervol_sources::{SourceError, SourceInfo, VolumeSource};

/// A byte source whose `fail_at`-th read (counted from 0) fails with EIO; all others succeed.
#[derive(Debug)]
pub struct FailingBytes<S> {
    /// Source of the data.
    pub inner: S,
    /// Number of the read that fails.
    pub fail_at: u64,
    /// Number of reads so far.
    pub reads: AtomicU64,
}

impl<S> FailingBytes<S> {
    /// Fails the `fail_at`-th read of `inner`.
    pub fn new(inner: S, fail_at: u64) -> Self {
        Self { inner, fail_at, reads: AtomicU64::new(0) }
    }
}

impl<S: ByteSource> ByteSource for FailingBytes<S> {
    fn len(&self) -> io::Result<u64> {
        self.inner.len()
    }

    fn read_exact_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        if self.reads.fetch_add(1, Ordering::Relaxed) == self.fail_at {
            return Err(io::Error::other("injected read failure"));
        }
        self.inner.read_exact_at(offset, buffer)
    }
}

/// A byte source that reports its full length but ends earlier, like a file truncated after it was opened.
#[derive(Debug)]
pub struct ShortBytes<S> {
    /// Source of the data.
    pub inner: S,
    /// Number of bytes that can be read.
    pub readable: u64,
}

impl<S: ByteSource> ByteSource for ShortBytes<S> {
    fn len(&self) -> io::Result<u64> {
        self.inner.len()
    }

    fn read_exact_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        if offset.saturating_add(buffer.len() as u64) > self.readable {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        self.inner.read_exact_at(offset, buffer)
    }
}

/// A byte source that counts requests and bytes.
#[derive(Debug)]
pub struct CountingBytes<S> {
    /// Source of the data.
    pub inner: S,
    /// Number of requests so far; a request may have several ranges.
    pub reads: AtomicU64,
    /// Number of bytes read so far.
    pub bytes: AtomicU64,
}

impl<S> CountingBytes<S> {
    /// Counts the reads of `inner`.
    pub fn new(inner: S) -> Self {
        Self { inner, reads: AtomicU64::new(0), bytes: AtomicU64::new(0) }
    }
}

impl<S: ByteSource> ByteSource for CountingBytes<S> {
    fn len(&self) -> io::Result<u64> {
        self.inner.len()
    }

    fn read_exact_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        self.reads.fetch_add(1, Ordering::Relaxed);
        self.bytes.fetch_add(buffer.len() as u64, Ordering::Relaxed);
        self.inner.read_exact_at(offset, buffer)
    }

    fn read_several(&self, ranges: &mut [(u64, &mut [u8])]) -> io::Result<()> {
        self.reads.fetch_add(1, Ordering::Relaxed);
        let bytes: usize = ranges.iter().map(|(_, buffer)| buffer.len()).sum();
        self.bytes.fetch_add(bytes as u64, Ordering::Relaxed);
        self.inner.read_several(ranges)
    }
}

/// A volume whose `fail_at`-th box cannot be read.
#[derive(Debug)]
pub struct FailingVolume<S> {
    inner: S,
    fail_at: u64,
    boxes: AtomicU64,
}

impl<S> FailingVolume<S> {
    /// Fails the `fail_at`-th box of `inner`, counted from 0.
    pub fn new(inner: S, fail_at: u64) -> Self {
        Self { inner, fail_at, boxes: AtomicU64::new(0) }
    }

    /// Number of boxes requested so far.
    pub fn boxes(&self) -> u64 {
        self.boxes.load(Ordering::Relaxed)
    }
}

impl<S: VolumeSource> VolumeSource for FailingVolume<S> {
    fn info(&self) -> &SourceInfo {
        self.inner.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        if self.boxes.fetch_add(1, Ordering::Relaxed) == self.fail_at {
            let error = io::Error::other("injected read failure");
            return Err(SourceError::Io { path: "injected.raw".into(), source: error });
        }
        self.inner.read_box(voxels, out)
    }
}
