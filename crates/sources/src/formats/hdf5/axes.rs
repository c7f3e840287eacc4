//! Axes of a dataset: names, coordinates and spacings that a file states.
//!
//! In order of precedence: ITK's `Spacing`, `Origin` and `Directions` beside the voxels; `element_size_um` (Fiji,
//! ilastik); the levels of BigDataViewer; dimension scales (netCDF) or labels of the axes (h5py).

use hdf5_reader::group::Group;
use hdf5_reader::{Dataset, Hdf5File};
use supervol_format::Geometry;

use super::attributes::{coordinates, numbers, numbers_of};
use crate::formats::array_survey::{MASKS, POSITIONS, SurveyParts, survey_axes};
use crate::formats::cf::{Coordinates, note_units};
use crate::formats::zarr::ome::{ArrayAxis, Role};
use crate::input::selection::Selection;
use crate::{Message, ReadOption, SourceInfo};

/// Name of a dimension scale without coordinates.
const NO_VARIABLE: &str = "This is a netCDF dimension but not a netCDF variable";

/// The axes of a dataset, and their coordinates, as far as stated.
pub(super) fn axes_of(
    file: &Hdf5File,
    name: &str,
    dataset: &Dataset,
    (selection, notes): (&Selection, &mut Vec<Message>),
) -> (Vec<ArrayAxis>, Vec<Option<Coordinates>>) {
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
    let is_positive = |values: &Vec<f64>| values.len() >= 2 && values.iter().all(|v| *v > 0.0 && v.is_finite());
    if let Some(sizes) = numbers(dataset, "element_size_um").filter(is_positive) {
        set(&sizes, "um");
        return (axes, Vec::new());
    }
    if let Some(factors) = level_of_viewer(file, name).filter(is_positive) {
        set(&factors, "");
        let what = Message::from("BigDataViewer keeps the size of voxels in its XML file: open that, or give it with ");
        notes.push(what.option(ReadOption::Spacing));
        return (axes, Vec::new());
    }
    let scales = scales(file, name, dataset);
    let along: Vec<_> = scales.iter().map(|scale| scale.variable.as_ref().and_then(coordinates)).collect();
    if scales.iter().all(|scale| !scale.name.is_empty()) {
        name_axes(&mut axes, (&scales, &along), selection, notes);
    }
    (axes, along)
}

/// Names the axes and places them by their coordinates.
fn name_axes(
    axes: &mut [ArrayAxis],
    (scales, along): (&[Scale], &[Option<Coordinates>]),
    selection: &Selection,
    notes: &mut Vec<Message>,
) {
    for (axis, scale) in axes.iter_mut().zip(scales) {
        *axis = ArrayAxis::named(&scale.name);
    }
    // Slices that follow one another in time are a volume, unless one of them is chosen.
    let is_flat = axes.iter().filter(|axis| axis.role == Role::Space).count() < 3;
    if is_flat && selection.frame.is_none() {
        axes.iter_mut().filter(|axis| axis.role == Role::Time).for_each(|axis| axis.role = Role::Space);
    }
    // Line numbers of a survey are no lengths.
    if survey_axes(axes).is_some() {
        return;
    }
    for (axis, coordinates) in axes.iter_mut().zip(along).filter(|(axis, _)| axis.role == Role::Space) {
        if let Some(coordinates) = coordinates {
            coordinates.place(axis, notes);
        }
    }
    note_units(axes, notes);
}

/// Parts of a survey in the datasets beside its volume. `xyz` are the axes of the volume, with their coordinates.
pub(super) fn survey(
    file: &Hdf5File,
    name: &str,
    (xyz, along): ([usize; 3], &[Option<Coordinates>]),
    info: &SourceInfo,
) -> SurveyParts {
    let along = xyz.map(|axis| along.get(axis).cloned().flatten());
    let domain = file.root_group().ok().and_then(|root| root.attribute("d3_domain").ok()?.read_string().ok());
    let group = name.rsplit_once('/').map_or(String::new(), |(group, _)| format!("{group}/"));
    let [crosslines, inlines, _] = info.dims.0;
    let lines = if xyz[1] < xyz[0] { [inlines, crosslines] } else { [crosslines, inlines] };
    let of_traces = |name: &str| {
        let dataset = file.dataset(&format!("{group}{name}")).ok().filter(|dataset| dataset.shape() == lines)?;
        Some(coordinates(&dataset)?.transposed_unless(xyz[1] < xyz[0], lines))
    };
    let positions = POSITIONS.iter().find_map(|[x, y]| Some([of_traces(x)?, of_traces(y)?]));
    let mask = MASKS.iter().find_map(|name| of_traces(name));
    let live = mask.map(|mask| mask.values.iter().map(|live| *live != 0.0).collect());
    SurveyParts { along, positions, live, domain }
}

/// Name of an axis, and the dataset of its coordinates.
#[derive(Default)]
struct Scale {
    name: String,
    variable: Option<Dataset>,
}

/// Dimension scales of a dataset, or labels of its axes; empty names where there are none.
fn scales(file: &Hdf5File, name: &str, dataset: &Dataset) -> Vec<Scale> {
    let rank = dataset.shape().len();
    let mut found: Vec<Scale> = (0..rank).map(|axis| scale(file, name, dataset, axis).unwrap_or_default()).collect();
    let labels = dataset.attribute("DIMENSION_LABELS").ok().and_then(|labels| labels.read_strings().ok());
    for (scale, label) in found.iter_mut().zip(labels.unwrap_or_default()) {
        if scale.name.is_empty() {
            scale.name = label;
        }
    }
    found
}

/// The first dimension scale of an axis, which lies in the group of the dataset or above.
fn scale(file: &Hdf5File, name: &str, dataset: &Dataset, axis: usize) -> Option<Scale> {
    let list = dataset.attribute("DIMENSION_LIST").ok()?;
    let reference_bytes = dataset.vlen_reference_size();
    let reference = list.raw_data.get(axis * reference_bytes..)?.get(..reference_bytes)?;
    // A reference is the number of scales, an address of the file's width, and a number.
    let address_bytes = reference_bytes.checked_sub(8)?;
    let addresses = dataset.resolve_vlen_reference_bytes(reference, address_bytes).ok()?;
    let mut address = [0; 8];
    address.get_mut(..address_bytes)?.copy_from_slice(addresses.get(..address_bytes)?);
    let address = u64::from_le_bytes(address);
    let variable = groups_of(file, name).find_map(|group| {
        let (_, datasets) = group.members().ok()?;
        datasets.into_iter().find(|dataset| dataset.address() == address)
    })?;
    let name = variable.name().rsplit('/').next().unwrap_or_default().to_owned();
    let is_empty = variable
        .attribute("NAME")
        .ok()
        .and_then(|name| name.read_string().ok())
        .is_some_and(|name| name.starts_with(NO_VARIABLE));
    let is_line = variable.shape() == [dataset.shape()[axis]];
    Some(Scale { name, variable: Some(variable).filter(|_| is_line && !is_empty) })
}

/// The group of a dataset and the groups above it.
fn groups_of<'a>(file: &'a Hdf5File, name: &'a str) -> impl Iterator<Item = Group> + 'a {
    let ends = name.rmatch_indices('/').map(|(at, _)| at).filter(|at| *at > 0);
    ends.filter_map(|end| file.group(&name[..end]).ok()).chain(file.root_group().ok())
}

/// Factors along z, y and x by which a level of `BigDataViewer` is coarser (`tTTTTT/sSS/LEVEL/cells`).
fn level_of_viewer(file: &Hdf5File, name: &str) -> Option<Vec<f64>> {
    let (setup, level) = view_of(name)?;
    let table = file.dataset(&format!("{setup}/resolutions")).ok()?;
    if table.shape().len() != 2 || table.shape()[1] != 3 || level >= table.shape()[0] {
        return None;
    }
    let row = usize::try_from(level).ok()?.checked_mul(3)?;
    let mut factors = numbers_of(&table)?.get(row..)?.get(..3)?.to_vec();
    factors.reverse();
    Some(factors)
}

/// Setup and level of the name of a dataset of `BigDataViewer`.
fn view_of(name: &str) -> Option<(&str, u64)> {
    let parts: Vec<&str> = name.split('/').collect();
    let [time, setup, level, "cells"] = parts[..] else { return None };
    let level = level.parse().ok().filter(|_| time.starts_with('t') && setup.starts_with('s'))?;
    Some((setup, level))
}

/// Whether a dataset of `BigDataViewer` holds unsigned integers as signed ones: so do all without the attribute
/// `dataType`.
pub(super) fn is_unsigned_of_viewer(file: &Hdf5File, name: &str, dataset: &Dataset) -> bool {
    let Some((setup, _)) = view_of(name) else { return false };
    let of_setup = || file.group(setup).ok()?.attribute("dataType").ok()?.read_string().ok();
    let stated = dataset.attribute("dataType").ok().and_then(|kind| kind.read_string().ok()).or_else(of_setup);
    stated.is_none_or(|kind| kind.starts_with("uint"))
}

/// Place of an image by ITK, beside its voxels: directions are those of the axes, x first.
pub(super) fn place_by_itk(file: &Hdf5File, name: &str) -> Option<Geometry> {
    let group = name.strip_suffix("/VoxelData").filter(|group| group.starts_with("ITKImage/"))?;
    let list = |name: &str| numbers_of(&file.dataset(&format!("{group}/{name}")).ok()?);
    let (spacing, origin, directions) = (list("Spacing")?, list("Origin")?, list("Directions")?);
    let rank = spacing.len();
    if !(1..=3).contains(&rank) || origin.len() != rank || directions.len() != rank * rank {
        return None;
    }
    let mut geometry = Geometry::IDENTITY;
    for axis in 0..rank {
        geometry.spacing[axis] = spacing[axis];
        geometry.origin[axis] = origin[axis];
        (0..rank).for_each(|row| geometry.direction[3 * row + axis] = directions[axis * rank + row]);
    }
    geometry.defect().is_none().then_some(geometry)
}
