//! Virtual containers of any size: no byte is stored; each one is computed when it is read.
//!
//! [`VirtualVolume`] is a [`ByteSource`]. The container reader, streamer, cache and ray casters run on it unchanged, up
//! to 65,536^3 voxels and coordinates beyond 2^24. A [`Field`] gives the voxel values.
//!
//! Each brick is valid ([`supervol_format::container::validate::check_brick`] holds): aprons hold the neighbours'
//! voxels, ranges are exact, and errors are bounds. Payloads are raw. Records have a fixed stride at level 0, and another one at
//! coarser levels, whose records also hold the error bounds of macro cells. They lie in the order of their TOC entries.
//!
//! Fields repeat every [`PERIOD`] bricks of a level. Bricks with congruent positions and the same borders have the same
//! record. So TOC pages are cheap, although each entry holds the checksum of its record. At most 8^3 records per level
//! are sealed, and all of them are kept.

mod field;

use std::collections::HashMap;
use std::io;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use supervol_format::brick::{APRON, MACRO_CELL};
use supervol_format::cast::index;
use supervol_format::cell_errors::CELL_ERROR_BYTES;
use supervol_format::codec::{Codec, CodecChoice};
use supervol_format::container::header::{self, Descriptor, Sections};
use supervol_format::container::manifest::{AxisName, Manifest, Source};
use supervol_format::container::reader::RECORDS_START;
use supervol_format::container::seal::seal_brick;
use supervol_format::container::toc::{self, BrickEntry, ENTRIES_PER_PAGE, ENTRY_BYTES};
use supervol_format::container::{ContainerError, checksum};
use supervol_format::macro_cells::MACRO_CELL_BYTES;
use supervol_format::voxel_type::Absence;
use supervol_format::{
    BrickIndex, BrickKey, BrickLayout, ByteSource, Container, Dims, Geometry, Lod, Pyramid, ValueRange,
};

use crate::context::ChartError;
use crate::volume::Volume;
pub use field::{Field, PERIOD, number, value};

/// Sealed brick without its payload, as in the file.
#[derive(Debug)]
struct Sealed {
    /// TOC entry with offset 0.
    entry: BrickEntry,
    macro_cells: Vec<u8>,
}

/// Byte source of a virtual container.
#[derive(Debug)]
pub struct VirtualVolume {
    field: Field,
    descriptor: Descriptor,
    sections: Sections,
    manifest: Vec<u8>,
    /// Distance between the starts of two records at level 0 and at coarser levels, bytes.
    strides: [u64; 2],
    sealed: Mutex<HashMap<BrickKey, Arc<Sealed>>>,
    beneath: Mutex<HashMap<BrickKey, ValueRange>>,
    reads: AtomicU64,
    records: AtomicU64,
}

impl VirtualVolume {
    /// A volume with these dims and bricks with this core. Each level halves all axes that are longer than one brick.
    ///
    /// # Errors
    /// If `dims` or `core` exceed a container's limits.
    pub fn new(field: Field, dims: [u64; 3], core: u32, geometry: Geometry) -> Result<Self, ChartError> {
        let layout = BrickLayout::new(core).ok_or_else(|| ChartError::Broken(format!("no bricks have core {core}")))?;
        let pyramid = Pyramid::new(Dims(dims), layout, &halvings(dims, layout)).map_err(ContainerError::from)?;
        let descriptor = Descriptor {
            voxel_type: field.voxel_type(),
            pyramid,
            geometry,
            scale: 1.0,
            offset: 0.0,
            absence: Absence { nodata: None },
            quantizer: None,
        };
        let cells = (layout.core() / MACRO_CELL).pow(3);
        let voxels = layout.stored().pow(3) * field.voxel_type().bytes();
        let strides =
            [MACRO_CELL_BYTES, MACRO_CELL_BYTES + CELL_ERROR_BYTES].map(|per_cell| (voxels + cells * per_cell) as u64);
        let mut source = Self {
            field,
            descriptor,
            sections: Sections::default(),
            manifest: Vec::new(),
            strides,
            sealed: Mutex::default(),
            beneath: Mutex::default(),
            reads: AtomicU64::new(0),
            records: AtomicU64::new(0),
        };
        source.manifest = serde_json::to_vec(&source.describe()).map_err(|e| ChartError::Broken(e.to_string()))?;
        source.sections = source.lay_out();
        Ok(source)
    }

    /// A new volume, opened as a container, and its byte source.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn open(field: Field, dims: [u64; 3], core: u32) -> Result<(Volume, Arc<Self>), ChartError> {
        let source = Arc::new(Self::new(field, dims, core, Geometry::IDENTITY)?);
        let container = Container::from_source(source.clone())?;
        Ok((Volume::of(&format!("{} {}", field.name(), Dims(dims)), Arc::new(container)), source))
    }

    fn lay_out(&self) -> Sections {
        let bricks = self.descriptor.pyramid.brick_count();
        let toc_offset = self.record_start(bricks);
        let toc_bytes = toc::bytes_for(bricks, header::VERSION);
        Sections {
            toc_offset,
            toc_bytes,
            manifest_offset: toc_offset + toc_bytes,
            manifest_bytes: self.manifest.len() as u64,
            manifest_checksum: checksum(&self.manifest),
        }
    }

    /// Number of bricks of level 0. Their entries come first.
    fn finest_bricks(&self) -> u64 {
        self.descriptor.pyramid.level_at(Lod::FINEST).brick_count()
    }

    /// Offset of the record of the entry with this number.
    fn record_start(&self, number: u64) -> u64 {
        let finest = number.min(self.finest_bricks());
        RECORDS_START + finest * self.strides[0] + (number - finest) * self.strides[1]
    }

    fn describe(&self) -> Manifest {
        let finest = self.places(Lod::FINEST).map(|key| self.range(key)).fold(ValueRange::EMPTY, ValueRange::union);
        let lods = self.descriptor.pyramid.lods();
        let errors = lods.map(|lod| self.places(lod).map(|key| self.error(key)).fold(0.0, f64::max));
        Manifest {
            tool: format!("supervol {}", env!("CARGO_PKG_VERSION")),
            parameters: [("lod_axes".into(), "xyz".into())].into(),
            source: Source::computed(self.field.name().to_lowercase()),
            space: String::new(),
            axes: ["x", "y", "z"].map(|name| AxisName { name: name.into(), unit: String::new() }),
            unit: String::new(),
            value_range: Some(finest),
            present_voxels: self.descriptor.dims().voxels().unwrap_or(u64::MAX),
            histogram: Vec::new(),
            percentiles: Vec::new(),
            distribution: None,
            level_errors: errors.collect(),
            survey: None,
            notes: vec![self.field.note().into()],
            others: std::collections::BTreeMap::default(),
        }
    }

    /// One representative brick for each different record of a level.
    fn places(&self, lod: Lod) -> impl Iterator<Item = BrickKey> {
        let along = self.descriptor.pyramid.level_at(lod).bricks.map(|n| {
            let mut places: Vec<u32> = (0..n.min(PERIOD + 1)).chain(n.saturating_sub(2)..n).collect();
            places.sort_unstable();
            places.dedup();
            places
        });
        let [nx, ny, nz] = [0, 1, 2].map(|a| along[a].len());
        (0..nx * ny * nz).map(move |i| {
            let place = [along[0][i % nx], along[1][i / nx % ny], along[2][i / nx / ny]];
            BrickKey::new(lod, BrickIndex(place))
        })
    }

    /// The representative of a brick, with the same record. Bricks at the lower and upper border represent themselves.
    /// So do bricks next to the upper border: a last brick of one voxel is narrower than the apron.
    fn representative(&self, key: BrickKey) -> BrickKey {
        let bricks = self.descriptor.pyramid.level_at(key.lod()).bricks;
        let place = std::array::from_fn(|a| {
            let i = key.brick().0[a];
            if i == 0 || i + 2 >= bricks[a] { i } else { 1 + (i - 1) % PERIOD }
        });
        BrickKey::new(key.lod(), BrickIndex(place))
    }

    /// Range of the values that interpolation reaches in a brick: its core and one voxel around it.
    fn range(&self, key: BrickKey) -> ValueRange {
        let pyramid = &self.descriptor.pyramid;
        let (core, dims) = (pyramid.core_box(key), pyramid.level_at(key.lod()).dims.0);
        let start = core.start.map(|start| start.saturating_sub(1));
        self.field.range(pyramid, key.lod(), start, std::array::from_fn(|a| core.end[a].min(dims[a] - 1)))
    }

    /// Range of a brick and of all finer bricks beneath it. The representative has the same range: if two bricks have
    /// one representative, so have their children, because doubled congruent positions are congruent.
    fn range_beneath(&self, key: BrickKey) -> ValueRange {
        let key = self.representative(key);
        if let Some(&range) = lock(&self.beneath).get(&key) {
            return range;
        }
        // Recursion depth: at most the number of levels.
        let children = self.descriptor.pyramid.children(key).map(|child| self.range_beneath(child));
        let range = children.fold(self.range(key), ValueRange::union);
        lock(&self.beneath).insert(key, range);
        range
    }

    fn error(&self, key: BrickKey) -> f64 {
        if key.lod() == Lod::FINEST {
            return 0.0;
        }
        self.field.error(&self.descriptor.pyramid, key, self.range_beneath(key))
    }

    /// Stored voxels of a brick: core and apron. Outside the grid, the border voxels are repeated.
    fn voxels(&self, key: BrickKey) -> Vec<u8> {
        let pyramid = &self.descriptor.pyramid;
        let (core, dims) = (pyramid.core_box(key), pyramid.level_at(key.lod()).dims.0);
        let [nx, ny, nz] = pyramid.stored_extent(key);
        let along: [Vec<u64>; 3] = std::array::from_fn(|a| {
            let at = |i: usize| (core.start[a] + i as u64).saturating_sub(APRON as u64).min(dims[a] - 1);
            (0..[nx, ny, nz][a]).map(at).collect()
        });
        self.field.voxels(pyramid, key.lod(), &along)
    }

    fn sealed(&self, key: BrickKey) -> io::Result<Arc<Sealed>> {
        let key = self.representative(key);
        if let Some(sealed) = lock(&self.sealed).get(&key) {
            return Ok(sealed.clone());
        }
        let pyramid = &self.descriptor.pyramid;
        let children = pyramid.children(key).map(|child| self.range_beneath(child));
        let children = children.fold(ValueRange::EMPTY, ValueRange::union);
        let raw = CodecChoice::Only(Codec::Raw);
        let brick = seal_brick(&self.descriptor, key, &self.voxels(key), raw, children, self.error(key))
            .map_err(io::Error::other)?;
        let mut entry = brick.entry;
        if entry.codec != Codec::Uniform {
            entry.checksum = checksum(&brick.record);
        }
        let macro_cells = brick.record[entry.payload_bytes as usize..].to_vec();
        let sealed = Arc::new(Sealed { entry, macro_cells });
        lock(&self.sealed).insert(key, sealed.clone());
        Ok(sealed)
    }

    /// Bytes of the file that hold the record of a brick. If these bytes cannot be read, the brick fails.
    ///
    /// # Panics
    /// If the key is not a brick of this volume.
    #[must_use]
    pub fn record_bytes_of(&self, key: BrickKey) -> Range<u64> {
        let number = self.descriptor.pyramid.entry(key);
        self.record_start(number)..self.record_start(number + 1)
    }

    /// Number of reads so far.
    #[must_use]
    pub fn reads(&self) -> u64 {
        self.reads.load(Ordering::Relaxed)
    }

    /// Number of computed brick records so far, including those touched only by merged reads.
    #[must_use]
    pub fn records(&self) -> u64 {
        self.records.load(Ordering::Relaxed)
    }

    /// Copies the part of a section that lies in the requested range. The section begins at byte `start`, the range at
    /// `wanted`.
    fn copy(wanted: u64, out: &mut [u8], start: u64, bytes: &[u8]) {
        let (begin, end) = (wanted.max(start), (wanted + out.len() as u64).min(start + bytes.len() as u64));
        if begin < end {
            out[index(begin - wanted)..index(end - wanted)]
                .copy_from_slice(&bytes[index(begin - start)..index(end - start)]);
        }
    }

    /// Indices of the parts that a read touches. The parts have `part_bytes` bytes each and begin at byte `start`.
    fn parts(offset: u64, bytes: u64, start: u64, part_bytes: u64, count: u64) -> Range<u64> {
        let first = offset.saturating_sub(start) / part_bytes;
        let last = (offset + bytes).saturating_sub(start).div_ceil(part_bytes);
        first.min(count)..last.min(count)
    }

    fn record(&self, number: u64) -> io::Result<Vec<u8>> {
        let key = self.key(number)?;
        let sealed = self.sealed(key)?;
        if sealed.entry.codec == Codec::Uniform {
            return Ok(Vec::new());
        }
        self.records.fetch_add(1, Ordering::Relaxed);
        let mut record = self.voxels(key);
        record.extend_from_slice(&sealed.macro_cells);
        Ok(record)
    }

    fn toc_page(&self, page: u64) -> io::Result<Vec<u8>> {
        let count = self.descriptor.pyramid.brick_count();
        let per_page = ENTRIES_PER_PAGE as u64;
        let mut entries = Vec::with_capacity(ENTRIES_PER_PAGE * ENTRY_BYTES);
        for number in page * per_page..((page + 1) * per_page).min(count) {
            let mut entry = self.sealed(self.key(number)?)?.entry;
            if entry.codec != Codec::Uniform {
                entry.offset = self.record_start(number);
            }
            entries.extend_from_slice(&entry.encode());
        }
        let bricks = self.descriptor.pyramid.brick_count();
        Ok(toc::cut(toc::encode_page(&entries), toc::page_bytes(page, bricks, header::VERSION)))
    }

    fn key(&self, number: u64) -> io::Result<BrickKey> {
        self.descriptor.pyramid.key(number).ok_or_else(|| io::Error::other(format!("there is no entry {number}")))
    }
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Downsampling factors of levels 1, 2, ...: each axis that is longer than one brick is halved.
#[must_use]
pub fn halvings(dims: [u64; 3], layout: BrickLayout) -> Vec<[u32; 3]> {
    let mut dims = dims;
    let mut out = Vec::new();
    while dims.iter().any(|&n| layout.bricks_along(n) > 1) {
        let factors = dims.map(|n| if layout.bricks_along(n) > 1 { 2 } else { 1 });
        dims = std::array::from_fn(|a| dims[a].div_ceil(u64::from(factors[a])));
        out.push(factors);
    }
    out
}

impl ByteSource for VirtualVolume {
    fn len(&self) -> io::Result<u64> {
        Ok(self.sections.manifest_offset + self.sections.manifest_bytes + header::PAGE_BYTES as u64)
    }

    fn read_exact_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        self.reads.fetch_add(1, Ordering::Relaxed);
        let (bytes, s) = (buffer.len() as u64, self.sections);
        if offset.checked_add(bytes).is_none_or(|end| end > self.len().unwrap_or(0)) {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        buffer.fill(0);
        if offset < RECORDS_START {
            Self::copy(offset, buffer, 0, &header::encode(&self.descriptor, Sections::default()));
        }
        if offset < s.toc_offset {
            let count = self.descriptor.pyramid.brick_count();
            let end = bytes.min(s.toc_offset - offset);
            let finest = self.finest_bricks();
            let coarser = Self::parts(offset, end, self.record_start(finest), self.strides[1], count - finest);
            let numbers = Self::parts(offset, end, RECORDS_START, self.strides[0], finest);
            for number in numbers.chain(coarser.start + finest..coarser.end + finest) {
                Self::copy(offset, buffer, self.record_start(number), &self.record(number)?);
            }
        }
        let page_bytes = toc::PAGE_BYTES as u64;
        for page in Self::parts(offset, bytes, s.toc_offset, page_bytes, s.toc_bytes.div_ceil(page_bytes)) {
            Self::copy(offset, buffer, s.toc_offset + page * page_bytes, &self.toc_page(page)?);
        }
        Self::copy(offset, buffer, s.manifest_offset, &self.manifest);
        let footer_offset = s.manifest_offset + s.manifest_bytes;
        if offset + bytes > footer_offset {
            Self::copy(offset, buffer, footer_offset, &header::encode(&self.descriptor, s));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
