//! HDF5: a dataset of a file (`FILE.h5:/PATH`), or the only one. Also BigDataViewer, Imaris, NetCDF 4 and MINC 2, which
//! are HDF5.
//!
//! The last three axes of a dataset are z, y, x; further axes are `frame` and `channel`. Chunks are decoded one by
//! one (deflate, shuffle, Fletcher, szip, LZ4, LZF, n-bit, scale-offset; other filters are refused). Contiguous
//! datasets are read in runs at the offsets in their headers.
//! Spacings come from the attributes `element_size_um` (Fiji, ilastik) and `resolutions` (BigDataViewer). BigDataViewer
//! stores its voxel sizes in a separate XML file, which can be opened instead: [`crate::formats::bigdataviewer`].
//! 16-bit floats are refused: the crate does not distinguish half precision from other formats.
//! The crate `hdf5-reader` reads the files through positional reads. Links to other files, and data in other files, are
//! not followed.

mod lzf;

use std::fmt::Debug;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use hdf5_reader::error::Error;
use hdf5_reader::group::Group;
use hdf5_reader::messages::HdfMessage;
use hdf5_reader::messages::filter_pipeline::FilterDescription;
use hdf5_reader::messages::layout::DataLayout;
use hdf5_reader::{
    ByteOrder, Dataset, Datatype, FileStorage, FilterRegistry, H5Type, Hdf5File, OpenOptions, SliceInfo, SliceInfoElem,
};
use supervol_format::readable::Mib;
use supervol_format::voxel_type::Voxel;
use supervol_format::{ByteSource, Dims, VoxelType};

use super::zarr::ome::{ArrayAxis, Role, geometry_of};
use super::zarr::placement::place;
use crate::cast::index;
use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::grid::chunked::{
    AXES_LIMIT, ArrayShape, ChunkGrid, ChunkMemory, ChunkedSource, Chunks, number_in_c_order, widened,
};
use crate::grid::dense::{GridLayout, checked_bytes};
use crate::grid::elements::{Channels, Elements, Frames, Number};
use crate::input::data_files::open_data;
use crate::input::file::SourceFile;
use crate::input::folder::FolderOptions;
use crate::input::selection::Choice;
use crate::input::text::shortened;
use crate::{Axis, Endian, Message, ReadOption, SourceError, SourceInfo};

/// First bytes of a file. A user block may precede them, of 512 bytes times a power of two.
const MAGIC: &[u8] = b"\x89HDF\r\n\x1a\n";

/// Ends of file names.
const ENDINGS: &[&str] = &[".h5", ".hdf5", ".ims"];

/// Row of the table of formats.
pub const FORMAT: Format = Format {
    name: "hdf5",
    title: "HDF5",
    endings: ENDINGS,
    choices: &[Choice::Array],
    sniff: |start, _| start.begins_with(MAGIC) || start.is_named(ENDINGS),
    certainty: Certainty::Certain,
    folder: Folder::Never,
    open: |path, options| Ok(Box::new(self::open(path, &options.of_folders())?)),
    found: |_| Found::Volume,
};
/// Filter number of LZF.
const LZF: u16 = 32_000;
/// Layout class of datasets that refer to other datasets.
const VIRTUAL: u8 = 3;
/// Largest number of datasets that are examined, largest depth of groups, and largest number of datasets that a message
/// lists.
const DATASETS_LIMIT: usize = 4096;
const DEPTH_LIMIT: usize = 12;
const LISTED_LIMIT: usize = 20;
/// Bytes per read of a contiguous dataset.
const RUN_BYTES: u64 = 1 << 20;
/// Largest size in bytes of an object's tables: its attributes, the positions of its chunks.
const HEADER_LIMIT_BYTES: usize = 16 << 20;

/// Opens a dataset of a file.
///
/// # Errors
/// If the file breaks its rules. If a filter or type is not supported, or a chunk does not fit the memory. If there are
/// several datasets and none is named.
pub fn open(path: &Path, options: &FolderOptions<'_>) -> Result<ChunkedSource, SourceError> {
    options.selection.refuse_series(path)?;
    let source_file = SourceFile::of(path)?;
    let wrong = |e: Error| of_hdf5(path, e);
    let bytes = open_data(path)?;
    let same_bytes = bytes.try_clone().map_err(|e| SourceError::io(path, e))?;
    let storage = FileStorage::from_file(same_bytes).map_err(wrong)?;
    let memory = usize::try_from(options.memory_bytes / 4).unwrap_or(usize::MAX);
    let limits = OpenOptions::default()
        .with_chunk_cache_bytes(0)
        .with_chunk_cache_slots(1)
        .with_max_chunk_bytes(memory)
        .with_max_read_bytes(memory)
        .with_max_object_header_bytes(HEADER_LIMIT_BYTES)
        .with_filter_registry(filters(memory));
    let file = Hdf5File::from_storage_with_options(Arc::new(storage), limits).map_err(wrong)?;
    let name = choose(path, &file, options.selection.array.as_deref())?;
    let dataset = file.dataset(&name).map_err(wrong)?;
    source(OpenedFile { path, file, bytes, source_file }, &name, dataset, options)
}

/// The crate's filters, and LZF with at most `limit_bytes` decoded bytes.
fn filters(limit_bytes: usize) -> FilterRegistry {
    let mut filters = FilterRegistry::new();
    let decode = move |filter: &FilterDescription, stream: &[u8], _: usize| {
        // h5py writes its revision, the library's version, and the bytes of a chunk.
        let length = filter.client_data.get(2).map_or(0, |n| *n as usize);
        let decoded = (1..=limit_bytes).contains(&length).then(|| lzf::decoded(stream, length)).flatten();
        decoded.ok_or_else(|| Error::Other(format!("a chunk of LZF that holds no {length} bytes")))
    };
    filters.register(LZF, Box::new(decode));
    filters
}

fn of_hdf5(path: &Path, error: Error) -> SourceError {
    match error {
        // The caller's message names the object.
        Error::Context { source, .. } if matches!(*source, Error::UnsupportedLayoutClass(VIRTUAL)) => {
            let advice = "give one of the files that it is made of, or write it whole first: `h5repack -l v:CHUNK=64x64x64 IN OUT`, \
                          with v its name";
            SourceError::unsupported(path, "it holds a virtual dataset, whose voxels lie in other files", advice)
        }
        Error::Io(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => SourceError::io(path, e),
        Error::UnsupportedFilter(what) => {
            let advice = "write it anew with gzip: `h5repack -f GZIP=1 IN OUT`";
            SourceError::unsupported(
                path,
                format!("a filter that is not read ({})", shortened(&what.to_string())),
                advice,
            )
        }
        other => SourceError::invalid(path, "HDF5", "a file that can be read", sentence(&other.to_string())),
    }
}

/// An error text of the crate, safe to print in a message.
fn sentence(text: &str) -> String {
    text.chars().take(160).map(|c| if c.is_control() { '?' } else { c }).collect()
}

/// A dataset that may be a volume.
struct Candidate {
    name: String,
    shape: Vec<u64>,
    /// Description of its elements, if they are not numbers.
    other: Option<&'static str>,
}

/// The dataset that is named, or the only one.
fn choose(path: &Path, file: &Hdf5File, wanted: Option<&str>) -> Result<String, SourceError> {
    let wrong = |e| of_hdf5(path, e);
    let mut found = Vec::new();
    if let Some(wanted) = wanted.map(|name| name.trim_matches('/')).filter(|name| !name.is_empty()) {
        if file.dataset(wanted).is_ok() {
            return Ok(wanted.into());
        }
        if let Ok(group) = file.group(wanted) {
            list(&group, wanted, DEPTH_LIMIT, &mut found).map_err(wrong)?;
        }
    }
    let is_whole = wanted.is_none_or(|name| name.trim_matches('/').is_empty());
    if is_whole || found.is_empty() {
        list(&file.root_group().map_err(wrong)?, "", DEPTH_LIMIT, &mut found).map_err(wrong)?;
    }
    let mut others = Vec::new();
    found.retain(|c| {
        let other = c.other.map(|other| format!("{} ({other})", shortened(&c.name)));
        others.extend(other.clone());
        other.is_none()
    });
    // If there is a volume, tables and lines are rarely meant.
    let volumes = found.iter().filter(|c| c.shape.iter().filter(|n| **n > 1).count() >= 3).count();
    if volumes > 0 {
        found.retain(|c| c.shape.iter().filter(|n| **n > 1).count() >= 3);
    }
    let describe = |c: &Candidate| {
        let sizes: Vec<String> = c.shape.iter().map(u64::to_string).collect();
        format!("{} ({})", shortened(&c.name), sizes.join(" x "))
    };
    let mut listed: Vec<String> = found.iter().take(LISTED_LIMIT).map(describe).collect();
    if found.len() > LISTED_LIMIT {
        listed.push(format!("and {} more", found.len() - LISTED_LIMIT));
    }
    let list = listed.join(", ");
    match (wanted.filter(|_| !is_whole), &found[..]) {
        (Some(wanted), _) => {
            let wanted = shortened(wanted);
            Err(SourceError::options(format!("{}: no dataset `{wanted}`; there are: {list}", path.display())))
        }
        (None, [one]) => Ok(one.name.clone()),
        (None, []) => {
            others.truncate(LISTED_LIMIT);
            let list = if others.is_empty() { String::new() } else { format!(", but {}", others.join(", ")) };
            let advice = "give another file; of compound and complex numbers write one part first, with Python: \
                          `f[NEW] = f[NAME][...].real`, or `f[NAME][FIELD]`";
            Err(SourceError::unsupported(path, format!("this HDF5 file holds no dataset of numbers{list}"), advice))
        }
        (None, [first, ..]) => {
            let plain = found.iter().find(|c| c.shape.len() == 3).unwrap_or(first);
            let advice = format!("name one, for example {}:/{}", path.display(), shortened(&plain.name));
            Err(SourceError::unsupported(path, format!("{} datasets: {list}", found.len()), advice))
        }
    }
}

/// Adds the datasets of numbers below a group.
fn list(group: &Group, name: &str, depth: usize, found: &mut Vec<Candidate>) -> Result<(), Error> {
    let (groups, datasets) = group.members()?;
    let below = |of: &str| {
        let last = of.rsplit('/').next().unwrap_or(of);
        if name.is_empty() { last.to_owned() } else { format!("{name}/{last}") }
    };
    for dataset in datasets {
        if found.len() >= DATASETS_LIMIT {
            return Ok(());
        }
        let is_number = number_of(dataset.dtype()).is_some() || is_of_16_bits(dataset.dtype());
        if !dataset.shape().is_empty() {
            let other = (!is_number).then(|| kind_of(dataset.dtype()));
            found.push(Candidate { name: below(dataset.name()), shape: dataset.shape().to_vec(), other });
        }
    }
    for group in groups {
        if depth > 0 && found.len() < DATASETS_LIMIT {
            list(&group, &below(group.name()), depth - 1, found)?;
        }
    }
    Ok(())
}

/// Description of elements that are not numbers.
fn kind_of(datatype: &Datatype) -> &'static str {
    match datatype {
        Datatype::Compound { .. } => "compound or complex",
        Datatype::String { .. } => "text",
        _ => "of another kind",
    }
}

fn number_of(datatype: &Datatype) -> Option<Number> {
    Some(Number::Voxel(match datatype {
        Datatype::FixedPoint { size: 1, signed: false, .. } => VoxelType::U8,
        Datatype::FixedPoint { size: 1, signed: true, .. } => VoxelType::I8,
        Datatype::FixedPoint { size: 2, signed: false, .. } => VoxelType::U16,
        Datatype::FixedPoint { size: 2, signed: true, .. } => VoxelType::I16,
        Datatype::FixedPoint { size: 4, signed: false, .. } => VoxelType::U32,
        Datatype::FixedPoint { size: 4, signed: true, .. } => VoxelType::I32,
        Datatype::FixedPoint { size: 8, signed, .. } => return Some(Number::Whole { signed: *signed }),
        Datatype::FloatingPoint { size: 4, .. } => VoxelType::F32,
        Datatype::FloatingPoint { size: 8, .. } => VoxelType::F64,
        Datatype::Enum { base, .. } => return number_of(base),
        _ => return None,
    }))
}

/// Whether the elements are 16-bit floats. The crate does not tell the exponent's width: half precision has 5 bits,
/// bfloat16 has 8.
fn is_of_16_bits(datatype: &Datatype) -> bool {
    matches!(datatype, Datatype::FloatingPoint { size: 2, .. })
}

fn refusal_of_16_bits(path: &Path, name: &str) -> SourceError {
    let what = format!("`{}` holds floats of 16 bits, of which there are several kinds", shortened(name));
    let advice = "write them as 32 bits first, with Python: `f[NEW] = f[NAME][...].astype('float32')`; half-precision floats are read from \
                  .npy and Zarr";
    SourceError::unsupported(path, what, advice)
}

/// An open HDF5 file.
struct OpenedFile<'a> {
    path: &'a Path,
    file: Hdf5File,
    /// The same file, for datasets that are read in place.
    bytes: File,
    source_file: SourceFile,
}

fn source(
    opened: OpenedFile<'_>,
    name: &str,
    dataset: Dataset,
    options: &FolderOptions<'_>,
) -> Result<ChunkedSource, SourceError> {
    let OpenedFile { path, file, bytes: file_bytes, source_file } = opened;
    if is_of_16_bits(dataset.dtype()) {
        return Err(refusal_of_16_bits(path, name));
    }
    let Some(number) = number_of(dataset.dtype()) else {
        let what = format!("`{}` is no array of whole or floating numbers of 8 to 64 bits", shortened(name));
        return Err(SourceError::unsupported(path, what, "name another dataset: FILE.h5:/PATH"));
    };
    let stored = number.stored();
    let mut array = array_shape(path, &dataset, stored)?;
    let contiguous = contiguous_at(&file, &dataset, array.whole_bytes(stored.bytes())).map_err(|e| of_hdf5(path, e))?;
    if contiguous.is_some() {
        array.endian = byte_order(dataset.dtype());
    }
    let mut notes = Vec::new();
    let axes = axes_of(&file, name, &dataset, &mut notes);
    let placement = place(path, (&array.shape, &axes, &[]), options.selection, &mut notes)?;
    let dims = Dims(placement.axes.map(|axis| axis.map_or(1, |axis| array.shape[axis])));
    checked_bytes(path, dims, stored)?;
    let bytes = array.chunk_bytes(stored.bytes()).unwrap_or(usize::MAX);
    let memory = ChunkMemory::plan(bytes as u64, options.memory_bytes).map_err(|needed| {
        let what = format!("its chunks {:?} are of {}", array.chunk, Mib(bytes as u64));
        let advice = Message::from(format!("allow {} with ", Mib(needed))).option(ReadOption::MemoryBytes);
        SourceError::unsupported(path, what, advice.text(", or write smaller chunks with h5repack"))
    })?;
    let mut info = SourceInfo::plain("hdf5", dims, stored);
    let of = placement.axes.map(|axis| axis.map(|axis| &axes[axis]));
    info.geometry = geometry_of(of);
    if let Some(defect) = info.geometry.defect() {
        return Err(SourceError::invalid(path, "attributes", "spacings above 0", defect));
    }
    info.axes = std::array::from_fn(|i| Axis {
        name: ["x", "y", "z"][i].into(),
        unit: of[i].map_or_else(String::new, |axis| axis.unit.clone()),
    });
    info.files = vec![source_file];
    let layout = GridLayout { dims, voxel_type: stored, endian: Endian::Little, fastest_first: GridLayout::X_FASTEST };
    let contiguous = contiguous.map(|first| (file_bytes, first));
    let chunks = DatasetChunks { path: path.into(), dataset, array: array.clone(), number, bytes, contiguous };
    let grid = ChunkGrid::new(layout, array, placement, Box::new(chunks), memory);
    let elements = Elements::of(path, &grid, number, (Channels::ONE, Frames::ONE), &mut notes)?;
    info.voxel_type = elements.voxel_type;
    info.notes = notes;
    Ok(ChunkedSource::new(info, grid, elements))
}

/// Shape of a dataset, with its own chunks or with runs of about 1 MiB.
fn array_shape(path: &Path, dataset: &Dataset, stored: VoxelType) -> Result<ArrayShape, SourceError> {
    let shape = dataset.shape().to_vec();
    let rank = shape.len();
    let is_right = |sizes: &[u64]| sizes.iter().all(|n| (1..=i64::MAX as u64).contains(n));
    if rank == 0 || rank > AXES_LIMIT || !is_right(&shape) {
        let expected = format!("1 to {AXES_LIMIT} axes with at least one element each");
        return Err(SourceError::invalid(path, "dataset", expected, format!("shape {shape:?}")));
    }
    let chunk = match dataset.chunks() {
        Some(chunks) => chunks.into_iter().map(u64::from).take(rank).collect(),
        None => {
            let mut left = RUN_BYTES / stored.bytes() as u64;
            let mut chunk = vec![1; rank];
            for (size, n) in chunk.iter_mut().zip(&shape).rev() {
                *size = (*n).min(left.max(1));
                left /= *size;
            }
            chunk
        }
    };
    if chunk.len() != rank || !is_right(&chunk) {
        return Err(SourceError::invalid(path, "chunks", format!("{rank} sizes above 0"), format!("{chunk:?}")));
    }
    Ok(ArrayShape { stored: (0..rank).collect(), shape, chunk, endian: Endian::Little, fill: [0; 8] })
}

/// Offset in the file of a contiguous dataset's voxels, in C order without gaps. `None` if they are not contiguous, not
/// in this file, or not `wanted` bytes; then the crate reads them or reports the defect.
fn contiguous_at(file: &Hdf5File, dataset: &Dataset, wanted: Option<u64>) -> Result<Option<u64>, Error> {
    let header = file.get_or_parse_header(dataset.address())?;
    let mut found = None;
    for message in &header.messages {
        match message {
            HdfMessage::ExternalFiles(_) => return Ok(None),
            HdfMessage::DataLayout(message) => found = Some(&message.layout),
            _ => (),
        }
    }
    let Some(DataLayout::Contiguous { address, size }) = found else { return Ok(None) };
    // Addresses of datasets that were never written lie beyond every file.
    let is_inside = address.checked_add(*size).is_some_and(|end| end <= file.storage().len());
    let is_whole = is_inside && Some(*size) == wanted;
    Ok(is_whole.then(|| file.superblock().base_address + address))
}

fn byte_order(datatype: &Datatype) -> Endian {
    match base_of(datatype) {
        Datatype::FixedPoint { byte_order: ByteOrder::BigEndian, .. }
        | Datatype::FloatingPoint { byte_order: ByteOrder::BigEndian, .. } => Endian::Big,
        _ => Endian::Little,
    }
}

/// The axes of a dataset, with the spacings that its attributes state.
fn axes_of(file: &Hdf5File, name: &str, dataset: &Dataset, notes: &mut Vec<Message>) -> Vec<ArrayAxis> {
    let rank = dataset.shape().len();
    let mut axes = vec![ArrayAxis::named(""); rank];
    // Time and channel precede the three spatial axes; vector components follow them.
    if rank > 3 && dataset.shape()[rank - 1] <= 4 && dataset.shape()[..rank - 1].iter().filter(|n| **n > 4).count() >= 3
    {
        axes[rank - 1].role = Role::Channel;
    }
    let space: Vec<usize> = (0..rank).filter(|i| axes[*i].role == Role::Space).collect();
    let last = &space[space.len().saturating_sub(3)..];
    let mut set = |values: &[f64], unit: &str| {
        for (axis, value) in last.iter().rev().zip(values.iter().rev()) {
            axes[*axis].spacing = *value;
            axes[*axis].unit = unit.into();
        }
    };
    let is_positive = |values: &[f64]| values.len() >= 2 && values.iter().all(|v| *v > 0.0 && v.is_finite());
    let sizes = dataset.attribute("element_size_um").ok().and_then(|a| a.read_1d::<f64>().or_else(|_| floats(&a)).ok());
    if let Some(sizes) = sizes.filter(|sizes| is_positive(sizes)) {
        set(&sizes, "um");
        return axes;
    }
    if let Some(factors) = level_of_viewer(file, name).filter(|factors| is_positive(factors)) {
        set(&factors, "");
        let what = Message::from("BigDataViewer keeps the size of voxels in its XML file: open that, or give it with ");
        notes.push(what.option(ReadOption::Spacing));
    }
    axes
}

fn floats(attribute: &hdf5_reader::Attribute) -> Result<Vec<f64>, Error> {
    Ok(attribute.read_1d::<f32>()?.into_iter().map(f64::from).collect())
}

/// Factors along z, y and x by which a level of `BigDataViewer` is coarser (`tTTTTT/sSS/LEVEL/cells`).
fn level_of_viewer(file: &Hdf5File, name: &str) -> Option<Vec<f64>> {
    let parts: Vec<&str> = name.split('/').collect();
    let [time, setup, level, "cells"] = parts[..] else { return None };
    let level: u64 = level.parse().ok().filter(|_| time.starts_with('t') && setup.starts_with('s'))?;
    let table = file.dataset(&format!("{setup}/resolutions")).ok()?;
    if table.shape().len() != 2 || table.shape()[1] != 3 || level >= table.shape()[0] {
        return None;
    }
    let row =
        SliceInfo { selections: vec![SliceInfoElem::Index(level), SliceInfoElem::Slice { start: 0, end: 3, step: 1 }] };
    let mut factors: Vec<f64> = table.read_slice::<f64>(&row).ok()?.into_iter().collect();
    factors.reverse();
    Some(factors)
}

/// The chunks of a dataset.
struct DatasetChunks {
    path: std::path::PathBuf,
    dataset: Dataset,
    array: ArrayShape,
    number: Number,
    /// Size of a decoded chunk in bytes.
    bytes: usize,
    /// The file, and the offset of the voxels in it, if they are contiguous.
    contiguous: Option<(File, u64)>,
}

impl Debug for DatasetChunks {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DatasetChunks").field("path", &self.path).field("array", &self.array).finish_non_exhaustive()
    }
}

impl Chunks for DatasetChunks {
    fn decode(&self, number: &[u64]) -> Result<Option<Vec<u8>>, SourceError> {
        let ArrayShape { shape, chunk, .. } = &self.array;
        let starts: Vec<u64> = number.iter().zip(chunk).map(|(n, size)| n * size).collect();
        let ends: Vec<u64> = (0..shape.len()).map(|i| (starts[i] + chunk[i]).min(shape[i])).collect();
        let element = self.number.stored().bytes();
        let sizes: Vec<u64> = starts.iter().zip(&ends).map(|(start, end)| end - start).collect();
        let wanted = index(sizes.iter().product::<u64>()) * element;
        let data = match &self.contiguous {
            Some((file, first)) => {
                // A chunk is one run: on all axes behind the one that it divides it spans the whole array.
                let at = number_in_c_order(&starts, shape) * element as u64;
                let mut data = vec![0; wanted];
                file.read_exact_at(first + at, &mut data).map_err(|e| SourceError::io(&self.path, e))?;
                data
            }
            None => self.selected(&starts, &ends)?,
        };
        if data.len() != wanted {
            let found = format!("{} bytes", data.len());
            return Err(SourceError::invalid(&self.path, "chunk", format!("{wanted} bytes of voxels"), found));
        }
        Ok(Some(if sizes == *chunk { data } else { widened(&data, &sizes, chunk, element, self.bytes) }))
    }
}

impl DatasetChunks {
    /// Little-endian bytes of the voxels between two positions, read by the crate.
    fn selected(&self, starts: &[u64], ends: &[u64]) -> Result<Vec<u8>, SourceError> {
        let range = |(start, end): (&u64, &u64)| SliceInfoElem::Slice { start: *start, end: *end, step: 1 };
        let selection = SliceInfo { selections: starts.iter().zip(ends).map(range).collect() };
        let data = match self.number {
            Number::Half => return Err(refusal_of_16_bits(&self.path, "dataset")),
            Number::Whole { signed: true } => self.whole::<i64>(&selection, i64::to_le_bytes),
            Number::Whole { signed: false } => self.whole::<u64>(&selection, u64::to_le_bytes),
            Number::Voxel(VoxelType::U8) => self.voxels::<u8>(&selection),
            Number::Voxel(VoxelType::I8) => self.voxels::<i8>(&selection),
            Number::Voxel(VoxelType::U16) => self.voxels::<u16>(&selection),
            Number::Voxel(VoxelType::I16) => self.voxels::<i16>(&selection),
            Number::Voxel(VoxelType::U32) => self.voxels::<u32>(&selection),
            Number::Voxel(VoxelType::I32) => self.voxels::<i32>(&selection),
            Number::Voxel(VoxelType::F32) => self.voxels::<f32>(&selection),
            Number::Voxel(VoxelType::F64) => self.voxels::<f64>(&selection),
        };
        data.map_err(|e| of_hdf5(&self.path, e))
    }

    fn voxels<V: Voxel + H5Type>(&self, selection: &SliceInfo) -> Result<Vec<u8>, Error> {
        if matches!(self.dataset.dtype(), Datatype::Enum { .. }) {
            let (found, _) = self.dataset.read_slice::<Member<V>>(selection)?.into_raw_vec_and_offset();
            return Ok(little_endian(found.into_iter().map(|member| member.0)));
        }
        // Already in C order. A plain list, because iterating over an array of dynamic rank is slow.
        let (found, _) = self.dataset.read_slice::<V>(selection)?.into_raw_vec_and_offset();
        Ok(little_endian(found.into_iter()))
    }

    fn whole<T: H5Type>(&self, selection: &SliceInfo, bytes: fn(T) -> [u8; 8]) -> Result<Vec<u8>, Error> {
        Ok(self.dataset.read_slice::<T>(selection)?.into_raw_vec_and_offset().0.into_iter().flat_map(bytes).collect())
    }
}

fn little_endian<V: Voxel>(values: impl ExactSizeIterator<Item = V>) -> Vec<u8> {
    let mut out = vec![0; values.len() * size_of::<V>()];
    for (voxel, value) in out.chunks_exact_mut(size_of::<V>()).zip(values) {
        value.write_le(voxel);
    }
    out
}

/// Value of an enumeration as a number: h5py stores booleans as enumerations.
#[derive(Clone)]
struct Member<V>(V);

impl<V: H5Type> H5Type for Member<V> {
    fn hdf5_type() -> Datatype {
        V::hdf5_type()
    }

    fn from_bytes(bytes: &[u8], datatype: &Datatype) -> Result<Self, Error> {
        V::from_bytes(bytes, base_of(datatype)).map(Self)
    }

    fn element_size(datatype: &Datatype) -> usize {
        V::element_size(base_of(datatype))
    }
}

/// The number type of an enumeration.
fn base_of(datatype: &Datatype) -> &Datatype {
    match datatype {
        Datatype::Enum { base, .. } => base,
        other => other,
    }
}
