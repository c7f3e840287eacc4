//! Writing a container, front to back: header, brick records in the order they come, TOC, manifest, footer.
//!
//! 1. [`ContainerWriter::begin`] writes the header page.
//! 2. [`ContainerWriter::append`] writes one brick; every brick of the pyramid once, in any order.
//! 3. [`ContainerWriter::finish`] writes TOC, manifest and footer. Without it the file has no footer and no reader
//!    takes it for whole.
//!
//! Entries are kept in memory until `finish`: 80 bytes per brick, [`ContainerWriter::entry_table_bytes`]. The writer
//! opens, syncs and renames nothing: that is the caller's.

use std::io::{self, Write};

use super::header::{self, Descriptor, Sections, VERSION};
use super::manifest::Manifest;
use super::toc::{self, BrickEntry, ENTRIES_PER_PAGE, ENTRY_BYTES};
use super::{ContainerError, checksum};
use crate::codec::Codec;
use crate::{BrickKey, Pyramid};

/// One brick, ready to be written.
#[derive(Debug, Clone, PartialEq)]
pub struct EncodedBrick {
    /// Which brick.
    pub key: BrickKey,
    /// Its entry; offset and checksum are filled in by the writer.
    pub entry: BrickEntry,
    /// Payload, directly followed by the macro cells; empty where the codec is uniform.
    pub record: Vec<u8>,
}

/// A container being written to `out`.
#[derive(Debug)]
pub struct ContainerWriter<W> {
    out: W,
    descriptor: Descriptor,
    position: u64,
    entries: Vec<u8>,
    written: u64,
}

impl<W: Write> ContainerWriter<W> {
    /// Bytes that the entries of all bricks of a pyramid take in memory while it is written.
    #[must_use]
    pub fn entry_table_bytes(pyramid: &Pyramid) -> u64 {
        pyramid.brick_count() * ENTRY_BYTES as u64
    }

    /// Writes the header page.
    ///
    /// # Errors
    /// If `out` cannot be written.
    pub fn begin(mut out: W, descriptor: Descriptor) -> io::Result<Self> {
        out.write_all(&header::encode(&descriptor, Sections::default()))?;
        Self::resume(out, descriptor)
    }

    /// The writer of a container whose header page has been written before, and some bricks: [`Self::restore`] names those.
    ///
    /// # Errors
    /// If the entries do not fit in memory.
    pub fn resume(out: W, descriptor: Descriptor) -> io::Result<Self> {
        let table = usize::try_from(Self::entry_table_bytes(&descriptor.pyramid))
            .map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
        Ok(Self { out, descriptor, position: header::PAGE_BYTES as u64, entries: vec![0; table], written: 0 })
    }

    /// Remembers a brick that was written before, behind the last one; `out` need not stand there yet. False, and nothing is
    /// remembered, where it cannot have been.
    pub fn restore(&mut self, key: BrickKey, entry: &BrickEntry) -> bool {
        let at = self.slot(key);
        let has_record = entry.codec != Codec::Uniform;
        if self.entries[at..at + ENTRY_BYTES].iter().any(|b| *b != 0) || (has_record && entry.offset != self.position) {
            return false;
        }
        self.position += if has_record { entry.record_bytes() } else { 0 };
        self.entries[at..at + ENTRY_BYTES].copy_from_slice(&entry.encode());
        self.written += 1;
        true
    }

    /// What is being written.
    pub fn descriptor(&self) -> &Descriptor {
        &self.descriptor
    }

    /// Bytes written so far.
    pub fn position(&self) -> u64 {
        self.position
    }

    /// Writes one brick and remembers its entry; returns the entry as written.
    ///
    /// # Errors
    /// If `out` cannot be written.
    ///
    /// # Panics
    /// If the brick was written before, is none of the pyramid's, or its record is not as long as its entry says.
    pub fn append(&mut self, brick: EncodedBrick) -> io::Result<BrickEntry> {
        let EncodedBrick { key, mut entry, record } = brick;
        assert_eq!(record.len() as u64, entry.record_bytes(), "the record of {key} has another length than its entry");
        let at = self.slot(key);
        assert!(self.entries[at..at + ENTRY_BYTES].iter().all(|b| *b == 0), "{key} is written twice");
        if entry.codec != Codec::Uniform {
            entry.offset = self.position;
            entry.checksum = checksum(&record);
            self.out.write_all(&record)?;
            self.position += record.len() as u64;
        }
        self.entries[at..at + ENTRY_BYTES].copy_from_slice(&entry.encode());
        self.written += 1;
        Ok(entry)
    }

    fn slot(&self, key: BrickKey) -> usize {
        self.descriptor.pyramid.entry(key) as usize * ENTRY_BYTES
    }

    /// The entry of a brick that was appended before.
    ///
    /// # Errors
    /// If it was not.
    pub fn entry(&self, key: BrickKey) -> Result<BrickEntry, ContainerError> {
        let at = self.slot(key);
        let bytes: &[u8; ENTRY_BYTES] = self.entries[at..at + ENTRY_BYTES].try_into().expect("an entry has its size");
        if bytes.iter().all(|b| *b == 0) {
            return Err(ContainerError::invalid(format!("entry of {key}"), 0, "a brick already written", "none"));
        }
        BrickEntry::decode(bytes, key, 0)
    }

    /// Lets the caller push buffered bytes to where a reader of the unfinished file finds them.
    ///
    /// # Errors
    /// If `out` cannot be written.
    pub fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }

    /// Writes TOC, manifest and footer, and hands `out` back, flushed.
    ///
    /// # Errors
    /// If `out` cannot be written.
    ///
    /// # Panics
    /// If a brick of the pyramid was never appended.
    pub fn finish(mut self, manifest: &Manifest) -> io::Result<W> {
        let bricks = self.descriptor.pyramid.brick_count();
        assert_eq!(self.written, bricks, "a container is finished only when each brick is written");
        let toc_offset = self.position;
        for (number, entries) in (0..).zip(self.entries.chunks(ENTRIES_PER_PAGE * ENTRY_BYTES)) {
            self.out.write_all(&toc::cut(toc::encode_page(entries), toc::page_bytes(number, bricks, VERSION)))?;
        }
        // What no reader takes must not be written.
        let json =
            manifest.to_json().map_err(|e| io::Error::new(io::ErrorKind::InvalidData, format!("manifest: {e}")))?;
        self.out.write_all(&json)?;
        let toc_bytes = toc::bytes_for(bricks, VERSION);
        let sections = Sections {
            toc_offset,
            toc_bytes,
            manifest_offset: toc_offset + toc_bytes,
            manifest_bytes: json.len() as u64,
            manifest_checksum: checksum(&json),
        };
        self.out.write_all(&header::encode(&self.descriptor, sections))?;
        self.out.flush()?;
        Ok(self.out)
    }
}
