//! Reading a container: its description at once, TOC entries page by page, bricks one by one.
//!
//! Opening reads the two pages and the manifest. Entries are read lazily; at most [`CACHED_TOC_PAGES`] pages of them are
//! kept (64 KiB each), so that memory does not grow with the number of bricks. Everything may be called from any thread.
//! Nothing read from the file is trusted before its checksum fits and its numbers make sense.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use super::header::{self, Descriptor, Sections};
use super::manifest::{self, Manifest};
use super::toc::{self, BrickEntry, ENTRIES_PER_PAGE, ENTRY_BYTES};
use super::{ContainerError, checksum};
use crate::byte_source::{ByteSource, ReadShape};
use crate::codec::{self, BrickShape, Codec};
use crate::macro_cells::{MACRO_CELL_BYTES, dequantize_cells};
use crate::voxel_type::Voxel;
use crate::{BrickKey, Geometry, Pyramid, ValueRange, with_voxel};

/// Most TOC pages kept in memory: 1024 pages are 64 MiB and name 837,632 bricks.
pub const CACHED_TOC_PAGES: usize = 1024;

/// Bytes that must lie before the records: the header page.
pub const RECORDS_START: u64 = header::PAGE_BYTES as u64;

/// An open container.
pub struct Container {
    source: Arc<dyn ByteSource>,
    descriptor: Descriptor,
    sections: Sections,
    manifest: Manifest,
    file_bytes: u64,
    path: PathBuf,
    toc_pages: Mutex<TocPages>,
}

/// The most recently read TOC pages.
#[derive(Default)]
struct TocPages {
    pages: HashMap<u64, (u64, Arc<[u8]>)>,
    clock: u64,
}

impl std::fmt::Debug for Container {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Container").field("descriptor", &self.descriptor).finish_non_exhaustive()
    }
}

fn read(source: &dyn ByteSource, what: &str, offset: u64, buffer: &mut [u8]) -> Result<(), ContainerError> {
    let bytes = buffer.len() as u64;
    source.read_exact_at(offset, buffer).map_err(|source| ContainerError::Io {
        what: what.into(),
        offset,
        bytes,
        source,
    })
}

impl Container {
    /// Opens a container file.
    ///
    /// # Errors
    /// If the file cannot be read or is no whole container.
    pub fn open(path: &Path) -> Result<Self, ContainerError> {
        let io = |source| ContainerError::Io { what: "the file".into(), offset: 0, bytes: 0, source };
        let file = crate::byte_source::check_is_file(path).and_then(|()| std::fs::File::open(path)).map_err(io)?;
        Ok(Self { path: path.into(), ..Self::from_source(Arc::new(file))? })
    }

    /// Opens a container from any byte source.
    ///
    /// # Errors
    /// If the bytes cannot be read or are no whole container.
    pub fn from_source(source: Arc<dyn ByteSource>) -> Result<Self, ContainerError> {
        let io = |source| ContainerError::Io { what: "length of the file".into(), offset: 0, bytes: 0, source };
        let file_bytes = source.len().map_err(io)?;
        if file_bytes < 2 * header::PAGE_BYTES as u64 {
            let expected = format!("at least {} bytes", 2 * header::PAGE_BYTES);
            return Err(ContainerError::invalid("container", 0, expected, format!("{file_bytes} bytes")));
        }
        // The header first: a file that is no container at all should be called that.
        let (from_header, header_sections) = read_page(source.as_ref(), "header", 0)?;
        let footer_offset = file_bytes - header::PAGE_BYTES as u64;
        let (descriptor, sections) = read_page(source.as_ref(), "footer", footer_offset).map_err(unfinished)?;
        if from_header != descriptor || header_sections != Sections::default() {
            let found = format!("{from_header:?}, {header_sections:?}");
            return Err(ContainerError::invalid(
                "header",
                0,
                format!("the footer's {descriptor:?}, no sections"),
                found,
            ));
        }
        check_sections(&sections, &descriptor.pyramid, footer_offset)?;
        let manifest = read_manifest(source.as_ref(), &sections)?;
        Ok(Self {
            source,
            descriptor,
            sections,
            manifest,
            file_bytes,
            path: PathBuf::new(),
            toc_pages: Mutex::default(),
        })
    }

    /// The same voxels placed elsewhere in the world: stretched, turned or moved.
    ///
    /// # Panics
    /// If the geometry has a defect ([`Geometry::defect`]).
    #[must_use]
    pub fn placed(mut self, geometry: Geometry) -> Self {
        assert_eq!(geometry.defect(), None, "a container is placed by a geometry without defects");
        self.descriptor.geometry = geometry;
        self
    }

    /// Where it lies; empty unless it was opened as a file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What the container holds.
    #[must_use]
    pub fn descriptor(&self) -> &Descriptor {
        &self.descriptor
    }

    /// Levels and bricks.
    #[must_use]
    pub fn pyramid(&self) -> &Pyramid {
        &self.descriptor.pyramid
    }

    /// Where the data came from.
    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Where the sections lie.
    #[must_use]
    pub fn sections(&self) -> Sections {
        self.sections
    }

    /// Length of the whole file, bytes.
    #[must_use]
    pub fn file_bytes(&self) -> u64 {
        self.file_bytes
    }

    /// Shape of a brick's stored voxels.
    #[must_use]
    pub fn shape(&self, key: BrickKey) -> BrickShape {
        shape_of(&self.descriptor, key)
    }

    /// The TOC entry of a brick.
    ///
    /// # Errors
    /// If its page cannot be read or is damaged, or the entry is impossible.
    ///
    /// # Panics
    /// If the key names no brick of the pyramid.
    pub fn entry(&self, key: BrickKey) -> Result<BrickEntry, ContainerError> {
        let number = self.pyramid().entry(key);
        let page_number = number / ENTRIES_PER_PAGE as u64;
        let page = self.toc_page(page_number)?;
        let at = (number % ENTRIES_PER_PAGE as u64) as usize * ENTRY_BYTES;
        let offset = self.sections.toc_offset + page_number * toc::PAGE_BYTES as u64 + at as u64;
        let bytes: &[u8; ENTRY_BYTES] = page[at..at + ENTRY_BYTES].try_into().expect("an entry has its size");
        let entry = BrickEntry::decode(bytes, key, offset)?;
        check_entry(&self.descriptor, key, &entry, self.sections.toc_offset).map_err(|(expected, found)| {
            ContainerError::invalid(format!("TOC entry of {key}"), offset, expected, found)
        })?;
        Ok(entry)
    }

    fn toc_page(&self, number: u64) -> Result<Arc<[u8]>, ContainerError> {
        {
            let mut pages = self.toc_pages.lock().unwrap_or_else(PoisonError::into_inner);
            pages.clock += 1;
            let now = pages.clock;
            if let Some((used, page)) = pages.pages.get_mut(&number) {
                *used = now;
                return Ok(page.clone());
            }
        }
        let offset = self.sections.toc_offset + number * toc::PAGE_BYTES as u64;
        let mut bytes = vec![0; toc::PAGE_BYTES];
        read(self.source.as_ref(), "TOC page", offset, &mut bytes)?;
        let entries = self.pyramid().brick_count() - number * ENTRIES_PER_PAGE as u64;
        toc::check_page(&bytes, number, entries.min(ENTRIES_PER_PAGE as u64) as usize, offset)?;
        let page: Arc<[u8]> = bytes.into();
        let mut pages = self.toc_pages.lock().unwrap_or_else(PoisonError::into_inner);
        if pages.pages.len() >= CACHED_TOC_PAGES {
            let oldest = pages.pages.iter().min_by_key(|(_, (used, _))| *used).map(|(&n, _)| n);
            oldest.and_then(|n| pages.pages.remove(&n));
        }
        let now = pages.clock;
        pages.pages.insert(number, (now, page.clone()));
        Ok(page)
    }

    /// How its source is best read.
    #[must_use]
    pub fn read_shape(&self) -> ReadShape {
        self.source.read_shape()
    }

    /// Reads any bytes of the file: how the streamer fetches several neighbouring records at once.
    ///
    /// # Errors
    /// If they cannot be read.
    pub fn read_at(&self, offset: u64, buffer: &mut [u8]) -> Result<(), ContainerError> {
        read(self.source.as_ref(), "brick records", offset, buffer)
    }

    /// Decodes a brick from its record into `out`: stored voxels, little endian, x fastest. `record` is ignored where
    /// the codec is uniform.
    ///
    /// # Errors
    /// If the record's checksum does not fit, or its payload does not decode.
    ///
    /// # Panics
    /// If `out` is not as long as [`Self::shape`] says.
    pub fn decode_brick(
        &self,
        key: BrickKey,
        entry: &BrickEntry,
        record: &[u8],
        out: &mut [u8],
    ) -> Result<(), ContainerError> {
        decode_record(&self.descriptor, key, entry, record, out)
    }

    /// Reads and decodes one brick.
    ///
    /// # Errors
    /// If it cannot be read or decoded.
    pub fn read_brick(&self, key: BrickKey, entry: &BrickEntry) -> Result<Vec<u8>, ContainerError> {
        let mut record = vec![0; entry.record_bytes() as usize];
        if !record.is_empty() {
            read(self.source.as_ref(), &key.to_string(), entry.offset, &mut record)?;
        }
        let mut voxels = vec![0; self.shape(key).bytes()];
        self.decode_brick(key, entry, &record, &mut voxels)?;
        Ok(voxels)
    }

    /// Macro-cell ranges of a record, x fastest, stored values; a uniform or absent brick's cells all have its range.
    ///
    /// # Panics
    /// If `record` is not as long as the entry says.
    #[must_use]
    pub fn macro_cells(&self, key: BrickKey, entry: &BrickEntry, record: &[u8]) -> Vec<ValueRange> {
        if entry.codec == Codec::Uniform {
            return vec![entry.range; self.pyramid().macro_cells(key).iter().product()];
        }
        dequantize_cells(&record[entry.payload_bytes as usize..], entry.range)
    }
}

/// Shape of the stored voxels of a brick.
pub(crate) fn shape_of(descriptor: &Descriptor, key: BrickKey) -> BrickShape {
    BrickShape { voxel_type: descriptor.voxel_type, extent: descriptor.pyramid.stored_extent(key) }
}

/// Decodes a record that `entry` describes; see [`Container::decode_brick`].
///
/// # Errors
/// If the record's checksum does not fit, or its payload does not decode.
pub fn decode_record(
    descriptor: &Descriptor,
    key: BrickKey,
    entry: &BrickEntry,
    record: &[u8],
    out: &mut [u8],
) -> Result<(), ContainerError> {
    let shape = shape_of(descriptor, key);
    if entry.codec == Codec::Uniform {
        let bits = entry.fill.to_le_bytes();
        let voxel = &bits[..shape.voxel_type.bytes()];
        out.chunks_exact_mut(voxel.len()).for_each(|v| v.copy_from_slice(voxel));
        return Ok(());
    }
    let sum = checksum(record);
    if sum != entry.checksum {
        let (expected, found) = (format!("{:016x}", entry.checksum), format!("{sum:016x}"));
        return Err(ContainerError::invalid(format!("{key}: checksum of its record"), entry.offset, expected, found));
    }
    let payload = &record[..entry.payload_bytes as usize];
    codec::decode_into(entry.codec, shape, payload, out).map_err(|source| ContainerError::Decode {
        key,
        offset: entry.offset,
        source,
    })
}

/// What is impossible about an entry, if anything: (expected, found).
fn check_entry(
    descriptor: &Descriptor,
    key: BrickKey,
    entry: &BrickEntry,
    records_end: u64,
) -> Result<(), (String, String)> {
    let shape = shape_of(descriptor, key);
    if entry.codec == Codec::Uniform {
        let bits = entry.fill.to_le_bytes();
        let fill = with_voxel!(shape.voxel_type, V => V::read_le(&bits[..size_of::<V>()]).to_f64());
        let numbers = [entry.offset, entry.record_bytes(), entry.checksum];
        if numbers != [0; 3] || !(entry.uniform || entry.absent) {
            return Err(("no record, and flag uniform or absent, for the uniform codec".into(), format!("{entry:?}")));
        }
        // What is drawn of the brick goes by the one or by the other.
        let range = if entry.absent { ValueRange::EMPTY } else { ValueRange { min: fill, max: fill } };
        return if entry.range == range {
            Ok(())
        } else {
            Err((format!("the value range that flags and fill ask for, {range:?}"), format!("{:?}", entry.range)))
        };
    }
    // The worst lossless payload is a raw one, or runs that expand by 1 %; see codec::rle.
    let most = (shape.bytes() + shape.bytes() / 64 + 1024) as u64;
    let cells = descriptor.pyramid.macro_cells(key).iter().product::<usize>() * MACRO_CELL_BYTES;
    if u64::from(entry.payload_bytes) > most || entry.payload_bytes == 0 || entry.macro_cell_bytes as usize != cells {
        let expected = format!("a payload of 1 to {most} bytes and {cells} bytes of macro cells");
        return Err((expected, format!("{} and {}", entry.payload_bytes, entry.macro_cell_bytes)));
    }
    let end = entry.offset.checked_add(entry.record_bytes());
    if entry.offset < RECORDS_START || end.is_none_or(|end| end > records_end) {
        let expected = format!("a record between {RECORDS_START} and {records_end}");
        return Err((expected, format!("{} bytes at {}", entry.record_bytes(), entry.offset)));
    }
    if entry.absent != entry.range.is_empty() || entry.fill != 0 || entry.uniform {
        return Err(("an empty range exactly where absent, and no fill".into(), format!("{entry:?}")));
    }
    Ok(())
}

fn read_page(source: &dyn ByteSource, what: &str, offset: u64) -> Result<(Descriptor, Sections), ContainerError> {
    let mut page = [0; header::PAGE_BYTES];
    read(source, what, offset, &mut page)?;
    header::decode(&page, what, offset)
}

/// A good header without a footer is the mark of an unfinished or truncated file: say so.
fn unfinished(error: ContainerError) -> ContainerError {
    match error {
        ContainerError::Magic { offset, expected, found, .. } => {
            let what = "the file is truncated or was never finished; footer".into();
            ContainerError::Invalid { what, offset, expected, found }
        }
        other => other,
    }
}

/// The sections must follow one another without a gap and have the sizes that the pyramid demands.
fn check_sections(s: &Sections, pyramid: &Pyramid, footer_offset: u64) -> Result<(), ContainerError> {
    let toc_bytes = toc::pages_for(pyramid.brick_count()) * toc::PAGE_BYTES as u64;
    let follows = |start: u64, length: u64, next: u64| start.checked_add(length) == Some(next);
    let whole = s.toc_offset >= RECORDS_START
        && s.toc_bytes == toc_bytes
        && follows(s.toc_offset, s.toc_bytes, s.manifest_offset)
        && follows(s.manifest_offset, s.manifest_bytes, footer_offset)
        && s.manifest_bytes <= manifest::BYTES_LIMIT;
    if whole {
        return Ok(());
    }
    let expected = format!(
        "a TOC of {toc_bytes} bytes, then a manifest of at most {} bytes, then the footer at {footer_offset}, without gaps",
        manifest::BYTES_LIMIT
    );
    Err(ContainerError::invalid("footer: sections", footer_offset, expected, format!("{s:?}")))
}

fn read_manifest(source: &dyn ByteSource, sections: &Sections) -> Result<Manifest, ContainerError> {
    let offset = sections.manifest_offset;
    let mut bytes = vec![0; sections.manifest_bytes as usize];
    read(source, "manifest", offset, &mut bytes)?;
    let sum = checksum(&bytes);
    if sum != sections.manifest_checksum {
        let (expected, found) = (format!("{:016x}", sections.manifest_checksum), format!("{sum:016x}"));
        return Err(ContainerError::invalid("manifest: checksum", offset, expected, found));
    }
    Manifest::from_json(&bytes).map_err(|e| ContainerError::invalid("manifest", offset, "the manifest's JSON", e))
}
