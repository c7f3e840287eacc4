//! HDF5: a dataset of a file (`FILE.h5:/PATH`), or the only one. Also BigDataViewer, Imaris, NetCDF 4 and MINC 2, which
//! are HDF5.
//!
//! The last three axes of a dataset are z, y, x; further axes are `frame` and `channel`. Chunks are decoded one by
//! one (deflate, shuffle, Fletcher, szip, LZ4, LZF, n-bit, scale-offset; other filters are refused). Contiguous
//! datasets are read in runs at the offsets in their headers.
//! Spacings come from the attributes `element_size_um` (Fiji, ilastik) and `resolutions` (BigDataViewer), from ITK's
//! datasets beside the voxels, or from dimension scales (netCDF). BigDataViewer stores its voxel sizes in a separate XML
//! file, which can be opened instead: [`crate::formats::bigdataviewer`].
//! Attributes of CF explain the numbers (`formats/cf.rs`).
//! 16-bit floats are refused: the crate does not distinguish half precision from other formats.
//! The crate `hdf5-reader` reads the files through positional reads. Links to other files, and data in other files, are
//! followed into the file's folder, or anywhere if files outside are allowed.

mod attributes;
mod axes;
mod links;
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
use supervol_format::space::WorldSpace;
use supervol_format::voxel_type::Voxel;
use supervol_format::{ByteSource, Dims, VoxelType, with_voxel};

use self::links::{Linked, Links};
use super::array_survey::survey_axes;
use super::cf::Explanation;
use super::zarr::ome::geometry_of;
use super::zarr::placement::{place, rename};
use crate::cast::index;
use crate::error::Part;
use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::grid::absent::AbsentColumns;
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
use crate::input::values::Values;
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
    choices: &[Choice::Array, Choice::Axes],
    sniff: |start, _| start.begins_with(MAGIC) || start.is_named(ENDINGS),
    certainty: Certainty::Certain,
    folder: Folder::Never,
    open: |path, options| Ok(Box::new(self::open(path, &options.of_folders())?)),
    found: |_| Found::Volume,
};
/// Filter number of LZF.
const LZF: u16 = 32_000;
/// Filters that round numbers when they are written (BitGroom, Granular BitRound): nothing is to be undone.
const ROUNDINGS: [u16; 2] = [32_022, 32_023];
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
    let memory_bytes = usize::try_from(options.memory_bytes / 4).unwrap_or(usize::MAX);
    let linked = Linked::of(path, options.outside);
    let limits = limits(memory_bytes)
        .with_external_file_resolver(Arc::new(linked.clone()))
        .with_external_link_resolver(Arc::new(Links { linked: linked.clone(), limits, memory_bytes }));
    let file = Hdf5File::from_storage_with_options(Arc::new(storage), limits).map_err(wrong)?;
    let name = choose(path, (&file, &linked), options.selection.array.as_deref())?;
    let dataset = file.dataset(&name).map_err(wrong)?;
    source(OpenedFile { path, file, bytes, source_file, linked }, &name, dataset, options)
}

/// Limits of the crate's memory, and its filters.
fn limits(memory_bytes: usize) -> OpenOptions {
    OpenOptions::default()
        .with_chunk_cache_bytes(0)
        .with_chunk_cache_slots(1)
        .with_max_chunk_bytes(memory_bytes)
        .with_max_read_bytes(memory_bytes)
        .with_max_object_header_bytes(HEADER_LIMIT_BYTES)
        .with_filter_registry(filters(memory_bytes))
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
    for rounding in ROUNDINGS {
        filters.register(rounding, Box::new(|_: &FilterDescription, stream: &[u8], _: usize| Ok(stream.to_vec())));
    }
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
fn choose(path: &Path, (file, linked): (&Hdf5File, &Linked), wanted: Option<&str>) -> Result<String, SourceError> {
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
            let what = Message::from(format!("{}: no dataset `{wanted}`; there are: {list}", path.display()));
            Err(SourceError::options(match linked.refusal() {
                Some(refusal) => what.text("; a link is not followed: ").message(refusal.message()),
                None => what,
            }))
        }
        (None, [one]) => Ok(one.name.clone()),
        (None, []) => {
            if let Some(refusal) = linked.refusal() {
                return Err(refusal);
            }
            others.truncate(LISTED_LIMIT);
            let list = if others.is_empty() { String::new() } else { format!(", but {}", others.join(", ")) };
            let advice = "give another file; of compound and complex numbers write one part first, with Python: \
                          `f[NEW] = f[NAME][...].real`, or `f[NAME][FIELD]`";
            Err(SourceError::unsupported(path, format!("this HDF5 file holds no dataset of numbers{list}"), advice))
        }
        (None, [first, ..]) => {
            let plain = found.iter().find(|c| c.shape.len() == 3).unwrap_or(first);
            let advice = format!("name one, for example {}:/{}", path.display(), shortened(&plain.name));
            let choices = found.iter().take(LISTED_LIMIT).map(|c| Part::of_array(path, &c.name, describe(c)));
            Err(SourceError::unsupported(path, format!("{} datasets: {list}", found.len()), advice)
                .with_choices(choices))
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
    linked: Linked,
}

fn source(
    opened: OpenedFile<'_>,
    name: &str,
    dataset: Dataset,
    options: &FolderOptions<'_>,
) -> Result<ChunkedSource, SourceError> {
    let OpenedFile { path, file, bytes: file_bytes, source_file, linked } = opened;
    if is_of_16_bits(dataset.dtype()) {
        return Err(refusal_of_16_bits(path, name));
    }
    let Some(number) = number_of(dataset.dtype()) else {
        let what = format!("`{}` is no array of whole or floating numbers of 8 to 64 bits", shortened(name));
        return Err(SourceError::unsupported(path, what, "name another dataset: FILE.h5:/PATH"));
    };
    let explanation = explanation(&file, name, &dataset, options.values);
    let (of_dataset, number) = (number, explanation.as_ref().map_or(number, |explanation| explanation.number(number)));
    let stored = number.stored();
    let mut array = array_shape(path, &dataset, stored)?;
    // A linked dataset is not at its address in this file.
    let is_elsewhere = linked.has_links() || has_external_data(&file, &dataset).map_err(|e| of_hdf5(path, e))?;
    let contiguous = match is_elsewhere {
        true => {
            check_first_element(path, &dataset, &linked)?;
            None
        }
        false => contiguous_at(&file, &dataset, array.whole_bytes(stored.bytes())).map_err(|e| of_hdf5(path, e))?,
    };
    if contiguous.is_some() {
        array.endian = byte_order(dataset.dtype());
    }
    let mut notes = Vec::new();
    let (mut axes, along) = axes::axes_of(&file, name, &dataset, (options.selection, &mut notes));
    rename(path, &mut axes, options.selection)?;
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
    let of_itk = axes::place_by_itk(&file, name).filter(|_| placement.axes == [2, 1, 0].map(Some));
    if let Some(geometry) = of_itk {
        (info.geometry, info.space) = (geometry, WorldSpace::LeftPosteriorSuperior);
    }
    if let Some(defect) = info.geometry.defect() {
        return Err(SourceError::invalid(path, "attributes", "spacings above 0", defect));
    }
    info.axes = std::array::from_fn(|i| Axis {
        name: of[i].map(|axis| axis.name.as_str()).filter(|name| !name.is_empty()).unwrap_or(["x", "y", "z"][i]).into(),
        unit: of[i].map_or_else(String::new, |axis| axis.unit.clone()),
    });
    if of_itk.is_some() {
        info.axes.iter_mut().for_each(|axis| axis.unit = "mm".into());
    }
    info.files = [vec![source_file], linked.files()].concat();
    let layout = GridLayout { dims, voxel_type: stored, endian: Endian::Little, fastest_first: GridLayout::X_FASTEST };
    let contiguous = contiguous.map(|first| (file_bytes, first));
    let (path_is, shape) = (path.into(), array.clone());
    let chunks = DatasetChunks { path: path_is, dataset, array: shape, number: of_dataset, bytes, contiguous };
    let grid = ChunkGrid::new(layout, array, placement, Box::new(chunks), memory);
    let absent = explanation.as_ref().map_or(&[][..], |explanation| &explanation.absent);
    let elements = Elements::of_explained(path, &grid, (number, absent), (Channels::ONE, Frames::ONE), &mut notes)?;
    info.voxel_type = elements.voxel_type;
    let absent =
        explanation.and_then(|explanation| explanation.apply((number, elements.marker()), &mut info, &mut notes));
    let survey = survey_axes(&axes).map(|xyz| (xyz, axes::survey(&file, name, (xyz, &along), &info)));
    let order = survey.map(|(xyz, parts)| {
        let mirrored = parts.describe(&mut info, xyz.map(|axis| &axes[axis]), &mut notes);
        (mirrored, AbsentColumns::of(parts.live, &info, &mut notes))
    });
    info.notes = notes;
    Ok(ChunkedSource::new(info, grid, elements).with_absent(absent).with_order(order))
}

/// Meaning of the numbers of a dataset; `None` if they are read as stored.
fn explanation(file: &Hdf5File, name: &str, dataset: &Dataset, values: Values) -> Option<Explanation> {
    if values == Values::Stored {
        return None;
    }
    let mut explanation = Explanation::of(&|name| attributes::attribute(dataset, name));
    if explanation.absent.is_empty() {
        explanation.absent.extend(attributes::fill_of_netcdf(dataset));
    }
    explanation.is_unsigned |= axes::is_unsigned_of_viewer(file, name, dataset);
    Some(explanation)
}

/// Reads one element of a dataset with voxels in other files, so that a missing file is noticed when it is opened.
fn check_first_element(path: &Path, dataset: &Dataset, linked: &Linked) -> Result<(), SourceError> {
    let first = SliceInfoElem::Slice { start: 0, end: 1, step: 1 };
    let selection = SliceInfo { selections: vec![first; dataset.shape().len()] };
    let read = match number_of(base_of(dataset.dtype())) {
        Some(Number::Voxel(voxel_type)) => {
            with_voxel!(voxel_type, V => dataset.read_slice::<Member<V>>(&selection).map(drop))
        }
        _ => dataset.read_slice::<i64>(&selection).map(drop),
    };
    read.map_err(|error| linked.refusal().unwrap_or_else(|| of_hdf5(path, error)))
}

/// Whether the voxels of a dataset of this file lie in other files.
fn has_external_data(file: &Hdf5File, dataset: &Dataset) -> Result<bool, Error> {
    let header = file.get_or_parse_header(dataset.address())?;
    Ok(header.messages.iter().any(|message| matches!(message, HdfMessage::ExternalFiles(_))))
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
        if let HdfMessage::DataLayout(message) = message {
            found = Some(&message.layout);
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
