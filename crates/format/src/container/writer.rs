//! Writer of a container, front to back: header, brick records in the order of the calls, TOC, manifest, footer.
//!
//! 1. [`ContainerWriter::begin`] writes the header page.
//! 2. [`ContainerWriter::append`] writes one brick; call it once for every brick of the pyramid, in any order.
//! 3. [`ContainerWriter::finish`] writes TOC, manifest and footer. A file without a footer is unfinished, and readers
//!    refuse it.
//!
//! Entries stay in memory until `finish`: 80 bytes per brick, [`ContainerWriter::entry_table_bytes`]. The caller opens,
//! syncs and renames the file.

use std::io::{self, Write};

use super::header::{self, Descriptor, Sections, VERSION};
use super::manifest::Manifest;
use super::toc::{self, BrickEntry, ENTRIES_PER_PAGE, ENTRY_BYTES};
use super::{ContainerError, checksum};
use crate::codec::Codec;
use crate::macro_cells::MACRO_CELL_BYTES;
use crate::{BrickKey, Pyramid, cast, cell_errors};

/// One encoded brick, ready to be written.
#[derive(Debug, Clone, PartialEq)]
pub struct EncodedBrick {
    /// Key of the brick.
    pub key: BrickKey,
    /// TOC entry of the brick; the writer fills in offset and checksum.
    pub entry: BrickEntry,
    /// Payload, directly followed by the macro cells; empty if the codec is uniform.
    pub record: Vec<u8>,
}

impl EncodedBrick {
    /// Sets the error bounds of a brick of level 1 or more and of its macro cells, if its record holds these. Stored units.
    /// No bound of a macro cell is greater than `error`.
    ///
    /// # Panics
    /// If the record holds bounds of another number of macro cells.
    pub fn set_errors(&mut self, error: f64, of_cells: &[f64]) {
        self.entry.error = error;
        let bytes = cell_errors::quantize(of_cells, error);
        let (held, ranges) = (self.entry.macro_cell_bytes as usize, bytes.len() * MACRO_CELL_BYTES);
        if self.entry.codec == Codec::Uniform || held == ranges {
            return;
        }
        assert_eq!(held, ranges + bytes.len(), "{}: bytes of its macro cells", self.key);
        let at = self.record.len() - bytes.len();
        self.record[at..].copy_from_slice(&bytes);
    }
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
    /// Memory in bytes for the entries of all bricks of a pyramid while the container is written.
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

    /// Writer for a container whose header page and some bricks are already in the file. Call [`Self::restore`] for
    /// each of these bricks.
    ///
    /// # Errors
    /// If the entries do not fit in memory.
    pub fn resume(out: W, descriptor: Descriptor) -> io::Result<Self> {
        let table = usize::try_from(Self::entry_table_bytes(&descriptor.pyramid))
            .map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
        Ok(Self { out, descriptor, position: header::PAGE_BYTES as u64, entries: vec![0; table], written: 0 })
    }

    /// Adds the entry of a brick that is already in the file, behind the last one. `out` need not be positioned there
    /// yet. Returns false, and changes nothing, if the brick cannot lie there.
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

    /// Description of the container.
    pub fn descriptor(&self) -> &Descriptor {
        &self.descriptor
    }

    /// Length of the file so far in bytes.
    pub fn position(&self) -> u64 {
        self.position
    }

    /// Writes one brick and keeps its entry; returns the entry as written.
    ///
    /// # Errors
    /// If `out` cannot be written.
    ///
    /// # Panics
    /// If the brick was written before, is not one of the pyramid, or its record has another length than its entry
    /// says.
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
        cast::index(self.descriptor.pyramid.entry(key)) * ENTRY_BYTES
    }

    /// The entry of a brick that was written before.
    ///
    /// # Errors
    /// If the brick was not written.
    ///
    /// # Panics
    /// If the key is not a brick of the pyramid.
    pub fn entry(&self, key: BrickKey) -> Result<BrickEntry, ContainerError> {
        let at = self.slot(key);
        let bytes: &[u8; ENTRY_BYTES] = self.entries[at..at + ENTRY_BYTES].try_into().expect("an entry has its size");
        if bytes.iter().all(|b| *b == 0) {
            return Err(ContainerError::invalid(format!("entry of {key}"), 0, "a brick already written", "none"));
        }
        BrickEntry::decode(bytes, key, 0)
    }

    /// Flushes `out`, so that a reader of the unfinished file sees all bytes.
    ///
    /// # Errors
    /// If `out` cannot be written.
    pub fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }

    /// Writes TOC, manifest and footer; returns `out`, flushed.
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
        // `to_json` fails on a manifest that readers would refuse.
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
