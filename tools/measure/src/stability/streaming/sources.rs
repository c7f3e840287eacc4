//! Byte source that wraps another one: it counts and times reads. A rule can let reads fail or change their bytes.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use supervol_format::ByteSource;
use supervol_runtime::stream::loader::READER;

/// Called with the number of the read (from 0), its offset and the bytes read. May fail the read or change the bytes.
pub type Rule = Box<dyn Fn(u64, u64, &mut [u8]) -> io::Result<()> + Send + Sync>;

/// Byte source that wraps another one.
pub struct Watched {
    inner: Arc<dyn ByteSource>,
    rule: Rule,
    bytes: u64,
    reads: AtomicU64,
    nanoseconds: AtomicU64,
}

impl Watched {
    /// Wraps `inner`.
    ///
    /// # Errors
    /// If its length is unknown.
    pub fn new(inner: Arc<dyn ByteSource>, rule: Rule) -> io::Result<Self> {
        let bytes = inner.len()?;
        Ok(Self { inner, rule, bytes, reads: AtomicU64::new(0), nanoseconds: AtomicU64::new(0) })
    }

    /// The same source with another length: a file cut short before or after it was opened.
    #[must_use]
    pub fn with_length(self, bytes: u64) -> Self {
        Self { bytes, ..self }
    }

    /// Number of reads so far, including failed ones.
    pub fn reads(&self) -> u64 {
        self.reads.load(Ordering::Relaxed)
    }

    /// Time spent so far in reads that a frame waits for; reads by the streamer's own threads are not included.
    pub fn time(&self) -> Duration {
        Duration::from_nanos(self.nanoseconds.load(Ordering::Relaxed))
    }
}

/// The rule that lets all reads pass.
pub fn pass() -> Rule {
    Box::new(|_, _, _| Ok(()))
}

impl ByteSource for Watched {
    fn len(&self) -> io::Result<u64> {
        Ok(self.bytes)
    }

    fn read_exact_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        let start = Instant::now();
        let number = self.reads.fetch_add(1, Ordering::Relaxed);
        let result = if offset.checked_add(buffer.len() as u64).is_some_and(|end| end <= self.bytes) {
            self.inner.read_exact_at(offset, buffer).and_then(|()| (self.rule)(number, offset, buffer))
        } else {
            Err(io::ErrorKind::UnexpectedEof.into())
        };
        if std::thread::current().name().is_some_and(|name| name.starts_with(READER)) {
            return result;
        }
        // 64 bits of nanoseconds hold centuries.
        let nanoseconds = u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX);
        self.nanoseconds.fetch_add(nanoseconds, Ordering::Relaxed);
        result
    }
}
