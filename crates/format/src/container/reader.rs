//! Reader of a container: its description at once, TOC entries page by page, bricks one by one.
//!
//! Opening takes one request for the header page and the last [`TAIL_BYTES`] of the file. These hold the footer, the
//! manifest and the entries of the coarsest bricks (`opening`). Other TOC pages are read on demand. At most
//! [`CACHED_TOC_PAGES`] pages of 64 KiB are cached, so that memory does not grow with the number of bricks. Any thread
//! may call any function. No data from the file is used before its checksum fits and its numbers are plausible.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::header::{self, Descriptor, Sections, VERSION_BRICK_ERRORS};
use super::manifest::Manifest;
use super::opening;
use super::toc::{self, BrickEntry, ENTRIES_PER_PAGE, ENTRY_BYTES};
use super::toc_pages::TocPages;
use super::{ContainerError, checksum};
use crate::byte_source::{ByteSource, ReadShape};
use crate::cell_errors::{self, CELL_ERROR_BYTES};
use crate::codec::{self, BrickShape, Codec};
use crate::macro_cells::{MACRO_CELL_BYTES, dequantize_cells};
use crate::voxel_type::Voxel;
use crate::{BrickKey, Geometry, Pyramid, ValueRange, cast, with_voxel};

pub use super::opening::TAIL_BYTES;
pub use super::toc_pages::CACHED_TOC_PAGES;

/// Largest number of TOC pages per request: 4 MiB.
const PAGES_AT_ONCE: usize = 64;
/// Name of a TOC page in messages.
const TOC_PAGE: &str = "TOC page";

/// Offset of the first record in bytes: the size of the header page.
pub const RECORDS_START: u64 = header::PAGE_BYTES as u64;

/// An open container.
pub struct Container {
    source: Arc<dyn ByteSource>,
    descriptor: Descriptor,
    /// Geometry in the file, unchanged by [`Container::placed`].
    stored_geometry: Geometry,
    sections: Sections,
    manifest: Manifest,
    file_bytes: u64,
    version: u32,
    path: PathBuf,
    toc_pages: Arc<TocPages>,
}

impl std::fmt::Debug for Container {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Container").field("descriptor", &self.descriptor).finish_non_exhaustive()
    }
}

pub(super) fn read(source: &dyn ByteSource, what: &str, offset: u64, buffer: &mut [u8]) -> Result<(), ContainerError> {
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
    /// If the file cannot be read or is not a whole container.
    pub fn open(path: &Path) -> Result<Self, ContainerError> {
        let io = |source| ContainerError::Io { what: "the file".into(), offset: 0, bytes: 0, source };
        let file = crate::byte_source::check_is_file(path).and_then(|()| std::fs::File::open(path)).map_err(io)?;
        Ok(Self { path: path.into(), ..Self::from_source(Arc::new(file))? })
    }

    /// Opens a container from any byte source.
    ///
    /// # Errors
    /// If the bytes cannot be read or are not a whole container.
    pub fn from_source(source: Arc<dyn ByteSource>) -> Result<Self, ContainerError> {
        let opening::Opened { file_bytes, version, descriptor, sections, manifest, tail } =
            opening::open(source.as_ref())?;
        let container = Self {
            source,
            stored_geometry: descriptor.geometry,
            descriptor,
            sections,
            manifest,
            file_bytes,
            version,
            path: PathBuf::new(),
            toc_pages: Arc::default(),
        };
        container.keep_pages_of(&tail);
        Ok(container)
    }

    /// Caches the TOC pages that lie whole in the tail of the file. Damaged pages are not cached; a later request for
    /// one of their entries reads them again and returns the error.
    fn keep_pages_of(&self, tail: &[u8]) {
        let tail_offset = self.file_bytes - tail.len() as u64;
        let first = tail_offset.saturating_sub(self.sections.toc_offset).div_ceil(toc::PAGE_BYTES as u64);
        for number in first..toc::pages_for(self.pyramid().brick_count()) {
            let at = cast::index(self.page_offset(number) - tail_offset);
            self.keep_page(number, tail[at..at + self.page_bytes(number)].to_vec());
        }
    }

    fn keep_page(&self, number: u64, stored: Vec<u8>) {
        let page = toc::uncut(stored);
        if self.check_page(&page, number).is_ok() {
            self.toc_pages.insert(number, page.into());
        }
    }

    /// The same voxels at another place in the world: stretched, turned or moved.
    ///
    /// # Panics
    /// If the geometry has a defect ([`Geometry::defect`]).
    #[must_use]
    pub fn placed(mut self, geometry: Geometry) -> Self {
        assert_eq!(geometry.defect(), None, "a container is placed by a geometry without defects");
        self.descriptor.geometry = geometry;
        self
    }

    /// The same container at another place in the world. Both share the byte source and the pages of the table of contents.
    ///
    /// # Panics
    /// If the geometry has a defect ([`Geometry::defect`]).
    #[must_use]
    pub fn at(&self, geometry: Geometry) -> Self {
        let again = Self {
            source: self.source.clone(),
            descriptor: self.descriptor.clone(),
            stored_geometry: self.stored_geometry,
            sections: self.sections,
            manifest: self.manifest.clone(),
            file_bytes: self.file_bytes,
            version: self.version,
            path: self.path.clone(),
            toc_pages: self.toc_pages.clone(),
        };
        again.placed(geometry)
    }

    /// Geometry in the file, unchanged by [`Container::placed`].
    #[must_use]
    pub fn stored_geometry(&self) -> Geometry {
        self.stored_geometry
    }

    /// Path of the file; empty unless the container was opened with [`Container::open`].
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Description of the container.
    #[must_use]
    pub fn descriptor(&self) -> &Descriptor {
        &self.descriptor
    }

    /// Levels and bricks.
    #[must_use]
    pub fn pyramid(&self) -> &Pyramid {
        &self.descriptor.pyramid
    }

    /// Description of the data and its origin.
    #[must_use]
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// Positions of the sections behind the bricks.
    #[must_use]
    pub fn sections(&self) -> Sections {
        self.sections
    }

    /// Length of the whole file in bytes.
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
    /// If the key is not a brick of the pyramid.
    pub fn entry(&self, key: BrickKey) -> Result<BrickEntry, ContainerError> {
        let number = self.pyramid().entry(key);
        let page_number = number / ENTRIES_PER_PAGE as u64;
        let page = self.toc_page(page_number)?;
        let at = cast::index(number % ENTRIES_PER_PAGE as u64) * ENTRY_BYTES;
        let offset = self.page_offset(page_number) + at as u64;
        let bytes: &[u8; ENTRY_BYTES] = page[at..at + ENTRY_BYTES].try_into().expect("an entry has its size");
        let entry = BrickEntry::decode(bytes, key, offset)?;
        check_entry(&self.descriptor, self.version, (key, &entry), self.sections.toc_offset).map_err(
            |(expected, found)| ContainerError::invalid(format!("TOC entry of {key}"), offset, expected, found),
        )?;
        Ok(entry)
    }

    /// Reads the TOC pages with the entries of these bricks into the cache, unless they are cached already. Pages of
    /// the first keys come first, and at most [`CACHED_TOC_PAGES`] are read. The pages come in requests of 4 MiB;
    /// before every request but the first, `goes_on` decides whether to continue. Damaged pages are skipped:
    /// [`Self::entry`] reports their defects.
    ///
    /// # Errors
    /// If a request fails. Pages of earlier requests stay cached.
    ///
    /// # Panics
    /// If a key is not a brick of the pyramid.
    pub fn read_entries_ahead(
        &self,
        keys: impl IntoIterator<Item = BrickKey>,
        goes_on: impl Fn() -> bool,
    ) -> Result<(), ContainerError> {
        let mut seen = BTreeSet::new();
        let numbers = keys.into_iter().map(|key| self.page_of(key)).filter(|&number| seen.insert(number));
        let missing = numbers.filter(|&number| !self.toc_pages.contains(number)).take(CACHED_TOC_PAGES);
        let mut missing: Vec<u64> = missing.collect();
        for (request, numbers) in missing.chunks_mut(PAGES_AT_ONCE).enumerate() {
            if request > 0 && !goes_on() {
                break;
            }
            numbers.sort_unstable();
            // Each page is read directly into its final buffer.
            let mut pages: Vec<Vec<u8>> = numbers.iter().map(|&number| vec![0; self.page_bytes(number)]).collect();
            let buffers = pages.iter_mut().map(Vec::as_mut_slice);
            let mut ranges: Vec<_> = numbers.iter().map(|&number| self.page_offset(number)).zip(buffers).collect();
            self.source.read_several(&mut ranges).map_err(|source| {
                let bytes = numbers.iter().map(|&number| self.page_bytes(number) as u64).sum();
                let offset = self.page_offset(numbers[0]);
                ContainerError::Io { what: TOC_PAGE.into(), offset, bytes, source }
            })?;
            for (&number, page) in numbers.iter().zip(pages) {
                self.keep_page(number, page);
            }
        }
        Ok(())
    }

    /// Whether the entry's TOC page is cached, so that [`Self::entry`] reads nothing.
    #[must_use]
    pub fn has_entry(&self, key: BrickKey) -> bool {
        self.toc_pages.contains(self.page_of(key))
    }

    /// Number of the TOC page that holds the entry of a brick.
    fn page_of(&self, key: BrickKey) -> u64 {
        self.pyramid().entry(key) / ENTRIES_PER_PAGE as u64
    }

    fn toc_page(&self, number: u64) -> Result<Arc<Vec<u8>>, ContainerError> {
        if let Some(page) = self.toc_pages.get(number) {
            return Ok(page);
        }
        let mut bytes = vec![0; self.page_bytes(number)];
        read(self.source.as_ref(), TOC_PAGE, self.page_offset(number), &mut bytes)?;
        let bytes = toc::uncut(bytes);
        self.check_page(&bytes, number)?;
        let page = Arc::new(bytes);
        self.toc_pages.insert(number, page.clone());
        Ok(page)
    }

    pub(super) fn page_offset(&self, number: u64) -> u64 {
        self.sections.toc_offset + number * toc::PAGE_BYTES as u64
    }

    /// Length of a page in the file in bytes.
    pub(super) fn page_bytes(&self, number: u64) -> usize {
        toc::page_bytes(number, self.pyramid().brick_count(), self.version)
    }

    fn check_page(&self, page: &[u8], number: u64) -> Result<(), ContainerError> {
        let entries = self.pyramid().brick_count() - number * ENTRIES_PER_PAGE as u64;
        let entries = cast::index(entries.min(ENTRIES_PER_PAGE as u64));
        toc::check_page(page, number, entries, (self.page_offset(number), self.page_bytes(number)))
    }

    /// Format version of the file.
    #[must_use]
    pub fn version(&self) -> u32 {
        self.version
    }

    pub(super) fn byte_source(&self) -> &dyn ByteSource {
        self.source.as_ref()
    }

    /// Read pattern that suits its byte source.
    #[must_use]
    pub fn read_shape(&self) -> ReadShape {
        self.source.read_shape()
    }

    /// Reads any bytes of the file. The streamer reads several neighbouring records with one call.
    ///
    /// # Errors
    /// If the bytes cannot be read.
    pub fn read_at(&self, offset: u64, buffer: &mut [u8]) -> Result<(), ContainerError> {
        read(self.source.as_ref(), "brick records", offset, buffer)
    }

    /// Decodes a brick from its record into `out`: stored voxels, little endian, x fastest. `record` is ignored if the
    /// codec is uniform.
    ///
    /// # Errors
    /// If the record's checksum does not fit, or its payload does not decode.
    ///
    /// # Panics
    /// If the length of `out` is not that of [`Self::shape`].
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
    /// If the brick cannot be read or decoded.
    pub fn read_brick(&self, key: BrickKey, entry: &BrickEntry) -> Result<Vec<u8>, ContainerError> {
        self.read_brick_into(key, entry, Vec::new())
    }

    /// As [`Self::read_brick`], but reuses the memory of `spare`, whose contents are lost.
    ///
    /// # Errors
    /// As [`Self::read_brick`].
    pub fn read_brick_into(
        &self,
        key: BrickKey,
        entry: &BrickEntry,
        mut spare: Vec<u8>,
    ) -> Result<Vec<u8>, ContainerError> {
        let record = self.read_record(key, entry)?;
        spare.resize(self.shape(key).bytes(), 0);
        self.decode_brick(key, entry, &record, &mut spare)?;
        Ok(spare)
    }

    /// Reads the macro-cell ranges of one brick without decoding voxels, see [`Self::macro_cells`].
    ///
    /// # Errors
    /// If the record cannot be read, or its checksum does not fit.
    pub fn read_macro_cells(&self, key: BrickKey, entry: &BrickEntry) -> Result<Vec<ValueRange>, ContainerError> {
        let record = self.read_record(key, entry)?;
        check_record(key, entry, &record)?;
        Ok(self.macro_cells(key, entry, &record))
    }

    /// Reads the bytes of a record without checking them; empty if the brick has no record.
    fn read_record(&self, key: BrickKey, entry: &BrickEntry) -> Result<Vec<u8>, ContainerError> {
        let mut record = vec![0; cast::index(entry.record_bytes())];
        if !record.is_empty() {
            read(self.source.as_ref(), &key.to_string(), entry.offset, &mut record)?;
        }
        Ok(record)
    }

    /// Macro-cell ranges in a record, x fastest, in stored values. All cells of a uniform or absent brick have the
    /// brick's range.
    ///
    /// # Panics
    /// If the length of `record` is not that of the entry.
    #[must_use]
    pub fn macro_cells(&self, key: BrickKey, entry: &BrickEntry, record: &[u8]) -> Vec<ValueRange> {
        if entry.codec == Codec::Uniform {
            return vec![entry.range; cells_of(&self.descriptor, key)];
        }
        let end = record.len() - self.cell_errors(key, entry, record).len();
        dequantize_cells(&record[entry.payload_bytes as usize..end], entry.range)
    }

    /// Error bounds of the macro cells in a record, as bytes ([`cell_errors`]), x fastest; empty if the brick's own bound
    /// holds in all of them.
    ///
    /// # Panics
    /// If the length of `record` is not that of the entry.
    #[must_use]
    pub fn cell_errors<'r>(&self, key: BrickKey, entry: &BrickEntry, record: &'r [u8]) -> &'r [u8] {
        &record[record.len() - cell_error_bytes(&self.descriptor, self.version, (key, entry))..]
    }

    /// Whether the record of a brick holds error bounds of its macro cells.
    #[must_use]
    pub fn holds_cell_errors(&self, key: BrickKey, entry: &BrickEntry) -> bool {
        cell_error_bytes(&self.descriptor, self.version, (key, entry)) > 0
    }

    /// Reads the error bounds of a brick's macro cells, in stored units, x fastest. They are read without the rest of the
    /// record, so that its checksum is not compared.
    ///
    /// # Errors
    /// If the record cannot be read.
    pub fn read_cell_errors(&self, key: BrickKey, entry: &BrickEntry) -> Result<Vec<f64>, ContainerError> {
        read_cell_errors(self.source.as_ref(), (&self.descriptor, self.version), key, entry)
    }
}

/// Shape of the stored voxels of a brick.
pub(crate) fn shape_of(descriptor: &Descriptor, key: BrickKey) -> BrickShape {
    BrickShape { voxel_type: descriptor.voxel_type, extent: descriptor.pyramid.stored_extent(key) }
}

/// Reads the error bounds of a brick's macro cells from a container of this version; see
/// [`Container::read_cell_errors`].
///
/// # Errors
/// If the record cannot be read.
pub fn read_cell_errors(
    source: &dyn ByteSource,
    (descriptor, version): (&Descriptor, u32),
    key: BrickKey,
    entry: &BrickEntry,
) -> Result<Vec<f64>, ContainerError> {
    let bytes = cell_error_bytes(descriptor, version, (key, entry));
    if bytes == 0 {
        return Ok(vec![entry.error; cells_of(descriptor, key)]);
    }
    let mut codes = vec![0; bytes];
    read(source, &key.to_string(), entry.offset + entry.record_bytes() - bytes as u64, &mut codes)?;
    Ok(cell_errors::dequantize_cells(&codes, entry.error))
}

/// Number of a brick's macro cells.
fn cells_of(descriptor: &Descriptor, key: BrickKey) -> usize {
    descriptor.pyramid.macro_cells(key).iter().product()
}

/// Bytes of error bounds in the record of a brick. Bricks with the uniform codec have no record.
fn cell_error_bytes(descriptor: &Descriptor, version: u32, (key, entry): (BrickKey, &BrickEntry)) -> usize {
    let has_record = entry.codec != Codec::Uniform;
    let has_bounds = has_record && version > VERSION_BRICK_ERRORS && cell_errors::are_held(&descriptor.pyramid, key);
    if has_bounds { cells_of(descriptor, key) * CELL_ERROR_BYTES } else { 0 }
}

/// Compares a record with its checksum. Bricks with the uniform codec have no record.
fn check_record(key: BrickKey, entry: &BrickEntry, record: &[u8]) -> Result<(), ContainerError> {
    let sum = checksum(record);
    if entry.codec == Codec::Uniform || sum == entry.checksum {
        return Ok(());
    }
    let (expected, found) = (format!("{:016x}", entry.checksum), format!("{sum:016x}"));
    Err(ContainerError::invalid(format!("{key}: checksum of its record"), entry.offset, expected, found))
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
        codec::decode_uniform(shape.voxel_type, entry.fill, out);
        return Ok(());
    }
    check_record(key, entry, record)?;
    let payload = &record[..entry.payload_bytes as usize];
    codec::decode_into(entry.codec, shape, payload, out).map_err(|source| ContainerError::Decode {
        key,
        offset: entry.offset,
        source,
    })
}

/// Checks an entry. An error is what was expected and what was found.
fn check_entry(
    descriptor: &Descriptor,
    version: u32,
    (key, entry): (BrickKey, &BrickEntry),
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
        // Drawing uses either the range or the fill, so they must agree.
        let range = if entry.absent { ValueRange::EMPTY } else { ValueRange { min: fill, max: fill } };
        return if entry.range == range {
            Ok(())
        } else {
            Err((format!("the value range that flags and fill ask for, {range:?}"), format!("{:?}", entry.range)))
        };
    }
    // The largest lossless payload is a raw one, or runs that expand by 1 %; see codec::rle.
    let most = (shape.bytes() + shape.bytes() / 64 + 1024) as u64;
    let cells = cells_of(descriptor, key) * MACRO_CELL_BYTES + cell_error_bytes(descriptor, version, (key, entry));
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
