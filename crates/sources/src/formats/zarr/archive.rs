//! A Zarr or N5 in a ZIP file (`zarr.storage.ZipStore`, `.zarr.zip`, `.ozx`): positions of its entries.
//!
//! Stored entries, the usual case, are read in place. Deflated entries are inflated on each read, at most to the length
//! that the archive states. Deflated shards, whose chunks are read one by one, are inflated once into nameless files in
//! the spool folder; a few of these are kept. The crate `zip` reads the list of entries.

use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use flate2::read::DeflateDecoder;
use supervol_format::ByteSource;
use zip::{CompressionMethod, ZipArchive};

use super::super::npz::of_zip;
use crate::SourceError;
use crate::cast::index;
use crate::input::data_files::open_data;
use crate::input::spool::{DEFLATE_RATIO_LIMIT, Spool, SpoolFolder};
use crate::input::text::shortened;

/// Largest number of entries of an archive.
const ENTRIES_LIMIT: usize = 1 << 20;
/// Number of inflated shards that are kept, and the buffer size for inflating in bytes.
const SHARDS_KEPT: usize = 8;
const BUFFER_BYTES: usize = 1 << 18;

/// An open archive.
#[derive(Debug)]
pub(super) struct Archive {
    file: File,
    entries: BTreeMap<String, Entry>,
    spool: SpoolFolder,
    /// Inflated shards by their offset in the archive; the most recently inflated is the last.
    shards: Mutex<VecDeque<(u64, Arc<File>)>>,
}

/// Position of an entry's bytes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    start: u64,
    /// Size in the archive in bytes.
    stored: u64,
    /// Size after inflating in bytes.
    length: u64,
    is_deflated: bool,
}

impl Archive {
    /// Reads the list of entries. Deflated shards will be inflated into `spool`.
    pub(super) fn open(path: &Path, spool: &SpoolFolder) -> Result<Self, SourceError> {
        let file = open_data(path)?;
        let bytes = file.len().map_err(|e| SourceError::io(path, e))?;
        let mut archive = ZipArchive::new(BufReader::new(open_data(path)?)).map_err(|e| of_zip(path, e))?;
        if archive.len() > ENTRIES_LIMIT {
            let found = archive.len().to_string();
            return Err(SourceError::invalid(path, "archive", format!("at most {ENTRIES_LIMIT} entries"), found));
        }
        let mut entries = BTreeMap::new();
        for number in 0..archive.len() {
            let entry = archive.by_index_raw(number).map_err(|e| of_zip(path, e))?;
            if entry.is_dir() {
                continue;
            }
            let is_deflated = match entry.compression() {
                CompressionMethod::Stored if !entry.encrypted() => false,
                CompressionMethod::Deflated if !entry.encrypted() => true,
                _ => {
                    let what = format!("`{}` in it is neither stored nor deflated", shortened(entry.name()));
                    return Err(SourceError::unsupported(path, what, "unpack it first"));
                }
            };
            let (stored, length) = (entry.compressed_size(), entry.size());
            let start = entry.data_start().filter(|start| start.checked_add(stored).is_some_and(|end| end <= bytes));
            let start = start.ok_or_else(|| {
                let found = format!("`{}` of {stored} bytes beyond its {bytes}", shortened(entry.name()));
                SourceError::invalid(path, "archive", "entries inside the file", found)
            })?;
            if !is_deflated && stored != length {
                let found = format!("{stored} bytes for {length}");
                return Err(SourceError::invalid(path, "archive", "stored entries as long as they are", found));
            }
            entries
                .insert(entry.name().trim_start_matches('/').to_owned(), Entry { start, stored, length, is_deflated });
        }
        Ok(Self { file, entries, spool: spool.clone(), shards: Mutex::default() })
    }

    /// The entry with this name; `/` separates folders.
    pub(super) fn entry(&self, name: &str) -> Option<Entry> {
        self.entries.get(name).copied()
    }

    /// Names of all entries below a folder, relative to it. `folder` is empty or ends with `/`.
    pub(super) fn below<'a>(&'a self, folder: &'a str) -> impl Iterator<Item = &'a str> {
        let from = self.entries.range(folder.to_owned()..);
        from.map_while(move |(name, _)| name.strip_prefix(folder))
    }

    /// The bytes of an entry, inflated if necessary.
    pub(super) fn read(&self, path: &Path, entry: Entry, limit: u64) -> Result<Vec<u8>, SourceError> {
        if entry.length > limit || entry.stored > limit {
            let expected = format!("at most {limit} bytes");
            let found = format!("{} bytes", entry.length.max(entry.stored));
            return Err(SourceError::invalid(path, "entry of the archive", expected, found));
        }
        let mut stored = vec![0; index(entry.stored)];
        self.read_at(path, entry, 0, &mut stored)?;
        if !entry.is_deflated {
            return Ok(stored);
        }
        let mut inflated = Vec::with_capacity(index(entry.length));
        let wrong = |found: String| {
            SourceError::invalid(path, "entry of the archive", format!("{} inflated bytes", entry.length), found)
        };
        let read = DeflateDecoder::new(&stored[..]).take(entry.length + 1).read_to_end(&mut inflated);
        read.map_err(|e| wrong(e.to_string()))?;
        if inflated.len() as u64 != entry.length {
            let found = if inflated.len() as u64 > entry.length { "more".into() } else { inflated.len().to_string() };
            return Err(wrong(found));
        }
        Ok(inflated)
    }

    /// A deflated shard as an inflated file. Other threads that need it wait.
    fn shard(&self, path: &Path, entry: Entry) -> Result<Arc<File>, SourceError> {
        // The list is consistent even after a panic, so a poisoned lock is safe to use.
        let mut shards = self.shards.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, file)) = shards.iter().find(|(start, _)| *start == entry.start) {
            return Ok(Arc::clone(file));
        }
        let wrong = |found: String| {
            SourceError::invalid(path, "shard in the archive", format!("{} inflated bytes", entry.length), found)
        };
        if entry.length > entry.stored.saturating_mul(DEFLATE_RATIO_LIMIT) {
            return Err(wrong(format!("{} bytes, which hold fewer", entry.stored)));
        }
        let mut spool = Spool::create(&self.spool)?;
        let mut stream = DeflateDecoder::new(Part { archive: self, at: entry.start, end: entry.start + entry.stored });
        let (mut buffer, mut done) = (vec![0; BUFFER_BYTES], 0u64);
        loop {
            let count = stream.read(&mut buffer).map_err(|e| wrong(e.to_string()))?;
            done += count as u64;
            if count == 0 || done > entry.length {
                break;
            }
            spool.append(&buffer[..count])?;
        }
        if done != entry.length {
            return Err(wrong(if done > entry.length { "more".into() } else { done.to_string() }));
        }
        let file = Arc::new(spool.finish()?);
        if shards.len() >= SHARDS_KEPT {
            shards.pop_front();
        }
        shards.push_back((entry.start, Arc::clone(&file)));
        Ok(file)
    }

    /// Reads bytes of an entry as stored in the archive, from `at` on.
    fn read_at(&self, path: &Path, entry: Entry, at: u64, out: &mut [u8]) -> Result<(), SourceError> {
        self.file.read_exact_at(entry.start + at, out).map_err(|e| SourceError::io(path, e))
    }
}

/// Sequential reader of a part of an archive.
struct Part<'a> {
    archive: &'a Archive,
    at: u64,
    end: u64,
}

impl Read for Part<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let count = index((self.end - self.at).min(out.len() as u64));
        self.archive.file.read_exact_at(self.at, &mut out[..count])?;
        self.at += count as u64;
        Ok(count)
    }
}

/// A file of a store that is read in parts.
#[derive(Debug)]
pub(super) enum Member<'a> {
    /// A file in a folder, with its length in bytes.
    File(File, u64),
    /// A stored entry of an archive.
    Entry(&'a Archive, Entry),
    /// A deflated entry of an archive, inflated, with its length in bytes.
    Inflated(Arc<File>, u64),
}

impl<'a> Member<'a> {
    /// The entry as a file, inflated if it is deflated.
    pub(super) fn of(archive: &'a Archive, path: &Path, entry: Entry) -> Result<Self, SourceError> {
        if entry.is_deflated {
            return Ok(Self::Inflated(archive.shard(path, entry)?, entry.length));
        }
        Ok(Self::Entry(archive, entry))
    }

    pub(super) fn length(&self) -> u64 {
        match self {
            Self::File(_, length) | Self::Inflated(_, length) => *length,
            Self::Entry(_, entry) => entry.length,
        }
    }

    /// Fills `out` from byte `at` on. The caller has checked the length.
    pub(super) fn read_at(&self, path: &Path, at: u64, out: &mut [u8]) -> Result<(), SourceError> {
        match self {
            Self::Inflated(file, _) => file.read_exact_at(at, out).map_err(|e| SourceError::io(path, e)),
            Self::File(file, _) => file.read_exact_at(at, out).map_err(|e| SourceError::io(path, e)),
            Self::Entry(archive, entry) => archive.read_at(path, *entry, at, out),
        }
    }
}
