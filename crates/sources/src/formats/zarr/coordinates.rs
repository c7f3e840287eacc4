//! Coordinates of the axes of an array, in arrays beside it that have the names of the axes (xarray, MDIO).

use std::path::Path;

use supervol_format::Dims;

use super::ome::{ArrayAxis, Role};
use super::store::Store;
use super::{Array, ArrayChunks, Chosen, Node, PlainArray, attributes, node};
use crate::formats::array_survey::{MASKS, POSITIONS, SurveyParts, survey_axes};
use crate::formats::cf::{COORDINATES_LIMIT, Coordinates, note_units};
use crate::grid::chunked::{ChunkGrid, ChunkMemory, Placement};
use crate::grid::dense::GridLayout;
use crate::grid::elements::NumberGrid;
use crate::input::folder::FolderOptions;
use crate::{Endian, Message, SourceError, SourceInfo};

/// The group of an array; `None` if the array is the whole store.
fn group_of<'a>(store: &Store, folder: &'a Path) -> Option<&'a Path> {
    folder.parent().filter(|_| folder != store.path)
}

/// Places the axes of an array by the arrays of coordinates beside it, and returns these. Coordinates that cannot be
/// read are not used. The axes of a survey have no coordinates of their own: its line numbers are no lengths.
pub(super) fn place_axes(
    store: &Store,
    found: &mut Chosen,
    options: &FolderOptions<'_>,
    notes: &mut Vec<Message>,
) -> Vec<Option<Coordinates>> {
    let Some(group) = group_of(store, &found.folder) else { return Vec::new() };
    let of_root = of_mdio_0(&root_attributes(store));
    let is_of_root = of_root.len() == found.axes.len();
    // An array of MDIO 0 does not name its axes itself.
    for (axis, (name, _)) in found.axes.iter_mut().zip(&of_root).filter(|(axis, _)| is_of_root && axis.name.is_empty())
    {
        *axis = ArrayAxis::named(name);
    }
    let is_survey = survey_axes(&found.axes).is_some();
    let mut along = Vec::new();
    for (axis, count) in found.axes.iter_mut().zip(&found.array.shape.shape) {
        let coordinates = beside(store, group, &axis.name, &[*count], options).unwrap_or_else(|error| {
            notes.push(format!("coordinates along {} are not used: {error}", axis.name).into());
            None
        });
        let stated = || of_root.iter().find(|(name, _)| *name == axis.name && is_of_root);
        let coordinates = coordinates.or_else(|| stated().map(|(_, coordinates)| coordinates.clone()));
        if let Some(coordinates) = coordinates.as_ref().filter(|_| !is_survey && axis.role == Role::Space) {
            coordinates.place(axis, notes);
        }
        along.push(coordinates);
    }
    if !is_survey {
        note_units(&found.axes, notes);
    }
    along
}

/// Attributes of the root of a store of version 2.
fn root_attributes(store: &Store) -> serde_json::Value {
    store.metadata(&store.path.join(".zattrs")).ok().flatten().unwrap_or_default()
}

/// Names and coordinates of the dimensions that the root of MDIO 0 states.
pub(super) fn of_mdio_0(root: &serde_json::Value) -> Vec<(String, Coordinates)> {
    let dimension = |stated: &serde_json::Value| {
        let values: Option<Vec<f64>> = stated["coords"].as_array()?.iter().map(serde_json::Value::as_f64).collect();
        Some((stated["name"].as_str()?.to_owned(), Coordinates { values: values?, unit: String::new() }))
    };
    let all = root["dimension"].as_array().map(|list| list.iter().map(dimension).collect::<Option<Vec<_>>>());
    all.flatten().unwrap_or_default()
}

/// Parts of a survey in the arrays beside its volume. `xyz` are the axes of the volume, with their coordinates.
pub(super) fn survey(
    store: &Store,
    folder: &Path,
    (xyz, along): ([usize; 3], &[Option<Coordinates>]),
    (info, options): (&SourceInfo, &FolderOptions<'_>),
) -> SurveyParts {
    let along = xyz.map(|axis| along.get(axis).cloned().flatten());
    let domain = store.metadata::<serde_json::Value>(&store.path.join("zarr.json")).ok().flatten();
    let domain = domain.and_then(|root| {
        let attributes = &root["attributes"];
        let said = attributes["attributes"]["traceDomain"].as_str().or(attributes["d3_domain"].as_str());
        said.map(str::to_owned)
    });
    let mut parts = SurveyParts { along, domain, ..SurveyParts::default() };
    let Some(group) = group_of(store, folder) else { return parts };
    let [crosslines, inlines, _] = info.dims.0;
    let lines = if xyz[1] < xyz[0] { [inlines, crosslines] } else { [crosslines, inlines] };
    // MDIO 0 has a group of metadata beside that of the data.
    let metadata = group.parent().map(|root| root.join("metadata")).filter(|_| group != store.path);
    let of_traces = |name: &str| {
        let groups = [Some(group), metadata.as_deref()].into_iter().flatten();
        let found = groups.filter_map(|group| beside(store, group, name, &lines, options).ok().flatten()).next()?;
        Some(found.transposed_unless(xyz[1] < xyz[0], lines))
    };
    parts.positions = POSITIONS.iter().find_map(|[x, y]| Some([of_traces(x)?, of_traces(y)?]));
    let mask = MASKS.iter().find_map(|name| of_traces(name));
    parts.live = mask.map(|mask| mask.values.iter().map(|live| *live != 0.0).collect());
    parts
}

/// The array of coordinates with a name and a shape in a group; `None` if there is none.
pub(super) fn beside(
    store: &Store,
    group: &Path,
    name: &str,
    shape: &[u64],
    options: &FolderOptions<'_>,
) -> Result<Option<Coordinates>, SourceError> {
    let is_plain = !name.is_empty() && !name.contains(['/', '\\']) && name != "." && name != "..";
    let folder = group.join(name);
    if !is_plain || !super::ZARR_FILES.iter().any(|file| store.has(&folder.join(file))) {
        return Ok(None);
    }
    let Some(Node::Array(PlainArray { array, attributes: of_array, .. })) = node(store, &folder)? else {
        return Ok(None);
    };
    let count = shape.iter().try_fold(1u64, |product, n| product.checked_mul(*n));
    if array.shape.shape != shape || count.is_none_or(|count| count > COORDINATES_LIMIT) {
        return Ok(None);
    }
    let numbers = numbers(store, &folder, array, options)?;
    let attribute =
        |name: &str| attributes::attribute(&of_array[name]).or_else(|| attributes::of_mdio(&of_array, name));
    Ok(numbers.map(|numbers| Coordinates::of(&numbers, &attribute)))
}

/// All numbers of an array of one or two axes; `None` if its chunks do not fit the memory.
fn numbers(
    store: &Store,
    folder: &Path,
    array: Array,
    options: &FolderOptions<'_>,
) -> Result<Option<Vec<f64>>, SourceError> {
    let (number, shape) = (array.number, array.shape.clone());
    let (axes, dims) = match shape.shape[..] {
        [x] => ([Some(0), None, None], [x, 1, 1]),
        [y, x] => ([Some(1), Some(0), None], [x, y, 1]),
        _ => return Ok(None),
    };
    let Some(bytes) = shape.chunk_bytes(number.stored().bytes()) else { return Ok(None) };
    let Ok(memory) = ChunkMemory::plan(bytes as u64, options.memory_bytes) else { return Ok(None) };
    let layout = GridLayout {
        dims: Dims(dims),
        voxel_type: number.stored(),
        endian: Endian::Little,
        fastest_first: GridLayout::X_FASTEST,
    };
    let placement = Placement { axes, fixed: vec![0; shape.shape.len()] };
    let chunks =
        ArrayChunks { store: store.clone(), folder: folder.into(), array, bytes, tables: std::sync::Mutex::default() };
    let grid = ChunkGrid::new(layout, shape, placement, Box::new(chunks), memory);
    let voxels = layout.dims.full_box();
    let mut out = vec![0; voxels.voxels() * number.stored().bytes()];
    grid.read_box(voxels, &mut out)?;
    Ok(Some(number.values(&out)))
}
