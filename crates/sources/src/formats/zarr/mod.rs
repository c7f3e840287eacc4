//! Zarr (versions 2 and 3), OME-Zarr and N5: folders of chunks, or ZIP files of such folders, read chunk by chunk.
//!
//! A folder is an array or a group. An OME-Zarr image or an N5 pyramid gives its finest level, or that of
//! `level`. Other groups give their only array, or the named one (`FOLDER:/PATH`). Axes other than x, y and
//! z are `frame` (time) and `channel`. Missing chunks have the fill value. Codecs: gzip, zlib, zstd, Blosc (without
//! Snappy), LZ4, CRC-32C, byte shuffle, transposition, shards; others are refused by name. Written by hand: `zarrs`
//! adds 58 packages, and inflates a chunk without a limit (decision 020). Crates do the decompression. Chunk sizes are
//! checked against the memory before reading, no chunk is decoded beyond its size, and no file outside the folder is
//! read.

mod archive;
mod attributes;
mod blosc;
mod codecs;
mod coordinates;
mod metadata;
mod n5;
pub(crate) mod ome;
pub(crate) mod placement;
mod store;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use serde::Deserialize;
use serde_json::Value;
use supervol_files::folder_of;
use supervol_format::Dims;
use supervol_format::readable::Mib;
use supervol_format::recent::Recent;
use supervol_format::space::WorldSpace;

use crate::cast::{self, index};
use crate::error::Part;
use crate::formats::array_survey::survey_axes;
use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::grid::absent::AbsentColumns;
use crate::grid::chunked::{ChunkGrid, ChunkMemory, ChunkedSource, Chunks, widened};
use crate::grid::dense::{GridLayout, checked_bytes};
use crate::grid::elements::{Channels, Elements, Frames};
use crate::input::file::SourceFile;
use crate::input::folder::FolderOptions;
use crate::input::selection::{Choice, Selection};
use crate::input::spool::SpoolFolder;
use crate::input::text::shortened;
use crate::input::values::Values;
use crate::{Axis, Endian, Message, ReadOption, SourceError, SourceInfo};
use archive::Member;
use metadata::{Array, Index, Version2, Version3};
use ome::{ArrayAxis, Attributes};
use placement::place;
use store::Store;

/// Files that identify a folder as Zarr or N5.
const ZARR_FILES: [&str; 3] = ["zarr.json", ".zarray", ".zgroup"];
const N5_FILE: &str = "attributes.json";
/// Largest number of entries that a message lists.
const LISTED_LIMIT: usize = 20;
/// Largest number of arrays of a group that are examined.
const ARRAYS_LIMIT: usize = 256;
/// Number of shard indices that are kept, and the largest number of chunks of one.
const TABLES_KEPT: usize = 8;
const TABLE_LIMIT: u64 = 1 << 18;

/// Parts of a Zarr or N5 that may be chosen.
const CHOICES: &[Choice] = &[Choice::Level, Choice::Series, Choice::Array, Choice::Axes];

/// Row of the table of formats, for folders. A file that describes a folder is refused with the folder's name.
pub const FORMAT: Format = Format {
    name: "zarr",
    title: "Zarr, N5 (folders)",
    endings: &[],
    choices: CHOICES,
    sniff: |start, _| start.path.file_name().is_some_and(|name| descriptions().any(|known| name == known)),
    certainty: Certainty::Certain,
    folder: Folder::ByStructure(|folder| descriptions().any(|name| folder.join(name).is_file())),
    open: |path, options| {
        if path.is_dir() {
            return Ok(Box::new(self::open(path, &options.of_folders())?));
        }
        let advice = format!("give the folder: {}", folder_of(path).display());
        Err(SourceError::unsupported(path, "this describes the Zarr or N5 that it lies in", advice))
    },
    found: |_| Found::Other,
};

/// Row of the table of formats, for ZIP files of what such a folder holds.
pub const ARCHIVE: Format = Format {
    title: "",
    endings: &[".zip", ".ozx"],
    sniff: |start, _| start.begins_with(b"PK\x03\x04") && is_zarr_archive(start.path),
    folder: Folder::Never,
    open: |path, options| Ok(Box::new(self::open(path, &options.of_folders())?)),
    found: |_| Found::Volume,
    ..FORMAT
};

/// Whether a ZIP file holds Zarr or N5; false if it cannot be read.
fn is_zarr_archive(path: &Path) -> bool {
    let is_of_zarr = |name: &str| name.rsplit('/').next().is_some_and(|file| descriptions().any(|known| known == file));
    archive::Archive::open(path, &SpoolFolder::system()).is_ok_and(|archive| archive.below("").any(is_of_zarr))
}

fn descriptions() -> impl Iterator<Item = &'static str> {
    ZARR_FILES.into_iter().chain([".zattrs", N5_FILE])
}

/// Number of finest voxels per voxel of a `BigDataViewer` N5 level along x, y and z, listed by the setup or stated by
/// the level.
pub(crate) fn factors_of_viewer(
    path: &Path,
    outside: crate::input::data_files::Outside,
    (setup, dataset, level): (&str, &str, u64),
) -> Result<Option<[f64; 3]>, SourceError> {
    let store = Store::new(path, outside, &SpoolFolder::system())?;
    let attributes = |folder: &str| store.metadata::<serde_json::Value>(&store.inside(folder)?.join(N5_FILE));
    let numbers = |value: &serde_json::Value| -> Option<[f64; 3]> {
        let numbers: Option<Vec<f64>> = value.as_array()?.iter().map(serde_json::Value::as_f64).collect();
        numbers?.try_into().ok().filter(|factors: &[f64; 3]| factors.iter().all(|factor| *factor >= 1.0))
    };
    let listed = attributes(setup)?.and_then(|found| numbers(&found["downsamplingFactors"][index(level)]));
    if listed.is_some() {
        return Ok(listed);
    }
    Ok(attributes(dataset)?.and_then(|found| numbers(&found["downsamplingFactors"])))
}

/// Opens a folder of Zarr or N5, or a ZIP file of one.
///
/// # Errors
/// If metadata or chunks break their rules. If an encoding is not supported, or a chunk does not fit the memory. If
/// there are several arrays and none is named.
pub fn open(path: &Path, options: &FolderOptions<'_>) -> Result<ChunkedSource, SourceError> {
    options.selection.refuse_series(path)?;
    let store = Store::new(path, options.outside, options.spool)?;
    let name = options.selection.array.as_deref().unwrap_or_default().trim_matches('/');
    let all: Vec<&str> = descriptions().collect();
    let folder = if name.is_empty() { store.root(&all) } else { store.inside(name)? };
    let mut notes = Vec::new();
    let found = find(&store, &folder, options.selection, &mut notes)?;
    source(&store, found, options, notes)
}

/// The selected array.
struct Chosen {
    folder: PathBuf,
    array: Array,
    axes: Vec<ArrayAxis>,
    /// Names of the channels, as far as the image states them.
    channels: Vec<String>,
    format: &'static str,
    /// Attributes of the array.
    attributes: Value,
    /// Whether the image is one of labels.
    is_labels: bool,
}

/// Contents of a folder.
enum Node {
    Array(PlainArray),
    Group(Attributes, Value),
    N5(n5::Attributes),
}

/// An array without the metadata of an image.
struct PlainArray {
    array: Array,
    /// Names of the axes.
    names: Option<Vec<Option<String>>>,
    attributes: Value,
}

/// Reads a folder's metadata.
fn node(store: &Store, folder: &Path) -> Result<Option<Node>, SourceError> {
    let path = folder.join("zarr.json");
    if let Some(found) = store.metadata::<Version3>(&path)? {
        let attributes = found.attributes.clone();
        if found.node_type != "array" {
            return Ok(Some(Node::Group(parsed(&path, &attributes)?, attributes)));
        }
        let names = found.dimension_names.clone();
        return Ok(Some(Node::Array(PlainArray { array: found.array(&path)?, names, attributes })));
    }
    let of_attributes = folder.join(".zattrs");
    let attributes = store.metadata::<Value>(&of_attributes)?;
    let is_described = attributes.is_some();
    let mut attributes = attributes.unwrap_or_default();
    let known: Attributes = parsed(&of_attributes, &attributes)?;
    let path = folder.join(".zarray");
    if let Some(found) = store.metadata::<Version2>(&path)? {
        attributes::add_fill_of_xarray(&mut attributes, &found.fill_value);
        return Ok(Some(Node::Array(PlainArray { array: found.array(&path)?, names: known.dimensions, attributes })));
    }
    if is_described || store.has(&folder.join(".zgroup")) {
        return Ok(Some(Node::Group(known, attributes)));
    }
    Ok(store.metadata::<n5::Attributes>(&folder.join(N5_FILE))?.map(Node::N5))
}

/// The attributes that images and arrays have.
fn parsed(path: &Path, attributes: &Value) -> Result<Attributes, SourceError> {
    if attributes.is_null() {
        return Ok(Attributes::default());
    }
    let found = Attributes::deserialize(attributes);
    found.map_err(|e| SourceError::invalid(path, "metadata", "what Zarr or N5 has there", e.to_string()))
}

/// Finds the selected array.
fn find(store: &Store, folder: &Path, selection: &Selection, notes: &mut Vec<Message>) -> Result<Chosen, SourceError> {
    match node(store, folder)? {
        None => {
            let expected = "an array or a group of Zarr or N5";
            Err(SourceError::invalid(
                folder,
                "folder",
                expected,
                "neither `zarr.json`, `.zarray` nor `attributes.json`",
            ))
        }
        Some(Node::Array(array)) => {
            selection.level_of(folder, 1)?;
            Ok(plain(folder.into(), array))
        }
        Some(Node::Group(attributes, of_group)) => match attributes.images() {
            [] => match of_mdio_0(store, folder, &of_group)? {
                Some(found) => {
                    selection.level_of(folder, 1)?;
                    Ok(found)
                }
                None => one_below(store, folder, (&attributes, &of_group), (selection, notes)),
            },
            [image, others @ ..] => {
                if !others.is_empty() {
                    notes.push(format!("{} images in one group; the first is used", others.len() + 1).into());
                }
                let found = image_level(store, folder, image, selection, notes)?;
                Ok(Chosen { channels: attributes.channels(), is_labels: attributes.is_labels(), ..found })
            }
        },
        Some(Node::N5(attributes)) => n5_level(store, folder, attributes, selection, notes),
    }
}

/// An array about which only the names of its axes may be known.
fn plain(folder: PathBuf, PlainArray { array, names, attributes }: PlainArray) -> Chosen {
    let rank = array.shape.shape.len();
    let names = names.filter(|names| names.len() == rank).unwrap_or_else(|| vec![None; rank]);
    let axes = names.into_iter().map(|name| ArrayAxis::named(&name.unwrap_or_default())).collect();
    Chosen { folder, array, axes, channels: Vec::new(), format: "zarr", attributes, is_labels: false }
}

/// The finest array of a survey by MDIO 0, whose root states the dimensions.
fn of_mdio_0(store: &Store, folder: &Path, of_group: &Value) -> Result<Option<Chosen>, SourceError> {
    let dimensions = coordinates::of_mdio_0(of_group);
    let data = folder.join("data");
    let whole = format!("chunked_{}", (0..dimensions.len()).map(|axis| axis.to_string()).collect::<String>());
    if dimensions.is_empty() || !store.has(&data.join(&whole).join(".zarray")) {
        return Ok(None);
    }
    let Some(Node::Array(array)) = node(store, &data.join(&whole))? else { return Ok(None) };
    let names = dimensions.into_iter().map(|(name, _)| Some(name)).collect();
    Ok(Some(plain(data.join(whole), PlainArray { names: Some(names), ..array })))
}

/// The only array below a group without image metadata, or its only volume: arrays of coordinates are none.
fn one_below(
    store: &Store,
    folder: &Path,
    (attributes, of_group): (&Attributes, &Value),
    (selection, notes): (&Selection, &mut Vec<Message>),
) -> Result<Chosen, SourceError> {
    let names = store.nodes(folder, &ZARR_FILES);
    if attributes.collection().is_none() && names.len() <= ARRAYS_LIMIT {
        let (mut arrays, mut volumes) = (Vec::new(), Vec::new());
        for name in &names {
            let Ok(Some(Node::Array(array))) = node(store, &folder.join(name)) else { continue };
            let is_volume = array.array.shape.shape.iter().filter(|n| **n > 1).count() >= 3;
            if is_volume { volumes.push((name, array)) } else { arrays.push((name, array)) }
        }
        let usual = of_group["attributes"]["defaultVariableName"].as_str();
        let is_usual = |(name, _): &(&String, PlainArray)| Some(name.as_str()) == usual;
        let found = match (volumes.len(), volumes.iter().position(is_usual)) {
            (1, _) => volumes.pop(),
            (0, _) if names.len() == 1 => arrays.pop(),
            (_, Some(at)) => {
                notes.push(
                    format!("{} volumes; `{}` is read, as the file advises", volumes.len(), volumes[at].0).into(),
                );
                Some(volumes.swap_remove(at))
            }
            _ => None,
        };
        if let Some((name, array)) = found {
            selection.level_of(folder, 1)?;
            return Ok(plain(folder.join(name), array));
        }
    }
    Err(several(store, folder, attributes.collection().unwrap_or("group of Zarr"), &names))
}

/// Error that asks for the name of one of several arrays.
fn several(store: &Store, folder: &Path, what: &str, names: &[String]) -> SourceError {
    let mut listed: Vec<String> = names.iter().take(LISTED_LIMIT).map(|name| shortened(name)).collect();
    if names.len() > LISTED_LIMIT {
        listed.push(format!("and {} more", names.len() - LISTED_LIMIT));
    }
    let list = if listed.is_empty() { "nothing that is read".into() } else { listed.join(", ") };
    let below = folder.strip_prefix(&store.path).unwrap_or(folder).display().to_string();
    let below = if below.is_empty() { below } else { format!("{below}/") };
    let advice =
        format!("name one, for example {}:/{below}{}", store.path.display(), names.first().map_or("NAME", |n| n));
    let choice = |name: &String| Part::of_array(&store.path, &format!("{below}{name}"), shortened(name));
    SourceError::unsupported(folder, format!("this is a {what}: {list}"), advice)
        .with_choices(names.iter().take(LISTED_LIMIT).map(choice))
}

/// A level of an OME-Zarr image.
fn image_level(
    store: &Store,
    folder: &Path,
    image: &ome::Multiscale,
    selection: &Selection,
    notes: &mut Vec<Message>,
) -> Result<Chosen, SourceError> {
    let level = level_of(folder, image.datasets.len(), selection, notes)?;
    let Some(dataset) = image.datasets.get(index(level)) else {
        return Err(SourceError::invalid(folder, "multiscales", "at least one dataset", "none"));
    };
    let below = folder.strip_prefix(&store.path).unwrap_or(folder).join(&dataset.path);
    let at = store.inside(&below.to_string_lossy())?;
    let Some(Node::Array(PlainArray { array, attributes, .. })) = node(store, &at)? else {
        return Err(SourceError::invalid(&at, "dataset of the image", "an array", "none"));
    };
    let axes = image.axes(dataset, array.shape.shape.len(), notes);
    Ok(Chosen { folder: at, array, axes, channels: Vec::new(), format: "ome-zarr", attributes, is_labels: false })
}

/// The selected level of an image.
fn level_of(folder: &Path, levels: usize, selection: &Selection, notes: &mut Vec<Message>) -> Result<u64, SourceError> {
    if levels > 1 && selection.level.is_none() {
        let what = Message::from(format!("{levels} levels; the finest is used; ")).option(ReadOption::Level);
        notes.push(what.text(format_args!(" 0 to {} takes another", levels - 1)));
    }
    selection.level_of(folder, levels as u64)
}

/// A dataset of N5, or a level of a pyramid with levels s0, s1, ...
fn n5_level(
    store: &Store,
    folder: &Path,
    attributes: n5::Attributes,
    selection: &Selection,
    notes: &mut Vec<Message>,
) -> Result<Chosen, SourceError> {
    let found = |folder: PathBuf, own: &n5::Attributes, group: &n5::Attributes| {
        let array = own.array(&folder.join(N5_FILE))?;
        let axes = own.axes(group);
        Ok(Chosen {
            array,
            axes,
            folder,
            channels: Vec::new(),
            format: "n5",
            attributes: Value::Null,
            is_labels: false,
        })
    };
    if attributes.is_array() {
        selection.level_of(folder, 1)?;
        return found(folder.into(), &attributes, &n5::Attributes::default());
    }
    let levels = (0..).take_while(|level| store.has(&folder.join(format!("s{level}")).join(N5_FILE))).count();
    if levels == 0 {
        return Err(several(store, folder, "group of N5", &store.folders(folder)));
    }
    let level = level_of(folder, levels, selection, notes)?;
    let at = folder.join(format!("s{level}"));
    let Some(own) = store.metadata::<n5::Attributes>(&at.join(N5_FILE))?.filter(n5::Attributes::is_array) else {
        return Err(SourceError::invalid(&at, "level", "a dataset of N5", "none"));
    };
    found(at, &own, &attributes)
}

fn source(
    store: &Store,
    mut found: Chosen,
    options: &FolderOptions<'_>,
    mut notes: Vec<Message>,
) -> Result<ChunkedSource, SourceError> {
    let path = found.folder.clone();
    let explanation = (options.values == Values::Explained && found.format != "n5")
        .then(|| attributes::explanation(&found.attributes));
    if let Some(explanation) = &explanation {
        found.array.number = explanation.number(found.array.number);
    }
    let along = match found.format {
        "zarr" => coordinates::place_axes(store, &mut found, options, &mut notes),
        _ => Vec::new(),
    };
    placement::rename(&path, &mut found.axes, options.selection)?;
    let placement = {
        let shown = (&found.array.shape.shape[..], &found.axes[..], &found.channels[..]);
        place(&path, shown, options.selection, &mut notes)?
    };
    let Chosen { array, axes, format, is_labels, .. } = found;
    let dims = Dims(placement.axes.map(|axis| axis.map_or(1, |axis| array.shape.shape[axis])));
    let stored = array.number.stored();
    checked_bytes(&path, dims, stored)?;
    let layout = GridLayout { dims, voxel_type: stored, endian: Endian::Little, fastest_first: GridLayout::X_FASTEST };
    let chunk_bytes = array.shape.chunk_bytes(stored.bytes());
    let too_much = |needed: Option<u64>| {
        let chunk = chunk_bytes.map_or_else(|| "more than can be addressed".into(), |n| Mib(n as u64).to_string());
        let advice = needed.map_or_else(
            || "write the array anew with smaller chunks".into(),
            |needed| {
                let advice = Message::from(format!("allow {} with ", Mib(needed))).option(ReadOption::MemoryBytes);
                advice.text(", or write the array anew with smaller chunks")
            },
        );
        SourceError::unsupported(&path, format!("its chunks {:?} are of {chunk}", array.shape.chunk), advice)
    };
    let bytes = chunk_bytes.ok_or_else(|| too_much(None))?;
    let memory = ChunkMemory::plan(bytes as u64, options.memory_bytes).map_err(|n| too_much(Some(n)))?;

    let mut info = SourceInfo::plain(format, dims, stored);
    let of = placement.axes.map(|axis| axis.map(|axis| &axes[axis]));
    info.geometry = ome::geometry_of(of);
    if let Some(geometry) = ome::geometry_of_patient(of) {
        (info.geometry, info.space) = (geometry, WorldSpace::LeftPosteriorSuperior);
    }
    info.labels = is_labels.then_some("the attribute `image-label` of the image says labels");
    if let Some(defect) = info.geometry.defect() {
        return Err(SourceError::invalid(&path, "place of the image", "spacings above 0, and finite numbers", defect));
    }
    info.axes = named_axes(of);
    let (files, are_all) = store.files(&path)?;
    if !are_all {
        notes.push("more chunks than are watched: whether they change while they are read is not noticed".into());
    }
    info.memory_bytes = files.len() as u64 * (size_of::<SourceFile>() as u64 + 2 * path.as_os_str().len() as u64 + 64);
    info.files = files;
    info.folder = (!store.is_archive()).then(|| store.path.clone());

    let number = array.number;
    let shape = array.shape.clone();
    let chunks = ArrayChunks { store: store.clone(), folder: path.clone(), array, bytes, tables: Mutex::default() };
    let grid = ChunkGrid::new(layout, shape, placement, Box::new(chunks), memory);
    let absent = explanation.as_ref().map_or(&[][..], |explanation| &explanation.absent);
    let elements = Elements::of_explained(&path, &grid, (number, absent), (Channels::ONE, Frames::ONE), &mut notes)?;
    info.voxel_type = elements.voxel_type;
    let absent =
        explanation.and_then(|explanation| explanation.apply((number, elements.marker()), &mut info, &mut notes));
    let survey =
        survey_axes(&axes).map(|xyz| (xyz, coordinates::survey(store, &path, (xyz, &along), (&info, options))));
    let order = survey.map(|(xyz, parts)| {
        let mirrored = parts.describe(&mut info, xyz.map(|axis| &axes[axis]), &mut notes);
        (mirrored, AbsentColumns::of(parts.live, &info, &mut notes))
    });
    info.notes = notes;
    Ok(ChunkedSource::new(info, grid, elements).with_absent(absent).with_order(order))
}

/// Names and units of x, y and z; their usual names where the array states none.
fn named_axes(of: [Option<&ArrayAxis>; 3]) -> [Axis; 3] {
    std::array::from_fn(|i| {
        let usual = ["x", "y", "z"][i];
        let (name, unit) = of[i].map_or((usual, ""), |axis| (axis.name.as_str(), axis.unit.as_str()));
        Axis { name: if name.is_empty() { usual } else { name }.into(), unit: unit.into() }
    })
}

/// Offset and length in bytes of each chunk of a shard.
type Table = Arc<Vec<[u64; 2]>>;

/// The chunks of an array.
#[derive(Debug)]
struct ArrayChunks {
    store: Store,
    folder: PathBuf,
    array: Array,
    /// Size of a decoded chunk in bytes.
    bytes: usize,
    /// Indices of some shards, least recently used dropped first.
    tables: Mutex<Recent<PathBuf, Table>>,
}

impl Chunks for ArrayChunks {
    fn decode(&self, number: &[u64]) -> Result<Option<Vec<u8>>, SourceError> {
        let (path, data) = match &self.array.sharding {
            None => {
                let path = self.folder.join(self.array.keys.name(number));
                let data = self.store.read(&path, codecs::encoded_limit(self.bytes) as u64)?;
                (path, data)
            }
            Some(sharding) => {
                let shard: Vec<u64> = number.iter().zip(&sharding.count).map(|(n, count)| n / count).collect();
                let path = self.folder.join(self.array.keys.name(&shard));
                let inside = number.iter().zip(&sharding.count);
                // Fits: the number of chunks has been checked.
                let at = index(inside.fold(0, |at, (n, count)| at * count + n % count));
                let data = self.read_of_shard(&path, at, (&sharding.count, sharding.index))?;
                (path, data)
            }
        };
        let Some(data) = data else { return Ok(None) };
        let decoded = if self.array.has_block_headers { self.block(data) } else { self.stages(data, self.bytes) };
        let wrong =
            |found: String| SourceError::invalid(&path, "chunk", format!("{} bytes of voxels", self.bytes), found);
        decoded.map(Some).map_err(wrong)
    }
}

impl ArrayChunks {
    fn stages(&self, data: Vec<u8>, wanted: usize) -> Result<Vec<u8>, String> {
        codecs::decode(&self.array.stages, data, wanted)
    }

    /// Decodes an N5 block, which may be smaller than a chunk.
    fn block(&self, mut data: Vec<u8>) -> Result<Vec<u8>, String> {
        let shape = &self.array.shape;
        let (sizes, header) = n5::split_block(&data, shape.chunk.len())?;
        let sizes: Vec<u64> = sizes.into_iter().rev().collect();
        if sizes.iter().zip(&shape.chunk).any(|(size, chunk)| size > chunk) {
            return Err(format!("a block of {sizes:?}, where chunks are of {:?}", shape.chunk));
        }
        let element = self.array.number.stored().bytes();
        let wanted = index(sizes.iter().product::<u64>()) * element;
        if header > data.len() {
            return Err("shorter than its header".into());
        }
        data.drain(..header);
        data = self.stages(data, wanted)?;
        if sizes == shape.chunk {
            return Ok(data);
        }
        Ok(widened(&data, &sizes, &shape.chunk, element, self.bytes))
    }

    /// Reads a chunk of a shard; `None` if the shard does not have it.
    fn read_of_shard(
        &self,
        path: &Path,
        at: usize,
        (count, index): (&[u64], Index),
    ) -> Result<Option<Vec<u8>>, SourceError> {
        let Some(file) = self.store.open(path)? else { return Ok(None) };
        let length = file.length();
        let table = self.table(path, &file, (count, index))?;
        let [start, bytes] = table[at];
        if [start, bytes] == [u64::MAX; 2] {
            return Ok(None);
        }
        let limit = codecs::encoded_limit(self.bytes) as u64;
        if bytes > limit || start.checked_add(bytes).is_none_or(|end| end > length) {
            let expected = format!("at most {limit} bytes within the {length} of the shard");
            return Err(SourceError::invalid(path, "index of the shard", expected, format!("{bytes} from {start} on")));
        }
        let mut data = vec![0; cast::index(bytes)];
        file.read_at(path, start, &mut data)?;
        Ok(Some(data))
    }

    /// Index of a shard: offset and length of each chunk.
    fn table(&self, path: &Path, file: &Member<'_>, (count, index): (&[u64], Index)) -> Result<Table, SourceError> {
        let length = file.length();
        {
            // The list is consistent even after a panic, so a poisoned lock is safe to use.
            let mut tables = self.tables.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(table) = tables.get(path) {
                return Ok(Arc::clone(table));
            }
        }
        let chunks = count.iter().try_fold(1u64, |product, n| product.checked_mul(*n)).filter(|n| *n <= TABLE_LIMIT);
        let Some(chunks) = chunks else {
            let what = format!("shards of {count:?} chunks, which is more than {TABLE_LIMIT}");
            return Err(SourceError::unsupported(path, what, "write the array anew with smaller shards"));
        };
        let bytes = 16 * chunks + if index.has_checksum { 4 } else { 0 };
        let wrong = |found: String| SourceError::invalid(path, "index of the shard", format!("{bytes} bytes"), found);
        let start = length.checked_sub(bytes).ok_or_else(|| wrong(format!("a file of {length}")))?;
        let mut data = vec![0; cast::index(bytes)];
        file.read_at(path, if index.at_end { start } else { 0 }, &mut data)?;
        let stages: &[_] = if index.has_checksum { &[codecs::Codec::Crc32c] } else { &[] };
        let data = codecs::decode(stages, data, 16 * cast::index(chunks)).map_err(wrong)?;
        let numbers = data.as_chunks::<8>().0.as_chunks::<2>().0;
        let table = Arc::new(numbers.iter().map(|pair| pair.map(u64::from_le_bytes)).collect::<Vec<_>>());
        let mut tables = self.tables.lock().unwrap_or_else(PoisonError::into_inner);
        tables.insert_within(TABLES_KEPT, path.into(), Arc::clone(&table));
        Ok(table)
    }
}
