//! Facts of a volume: what its header and manifest say, without a brick being read.

use supervol_format::container::manifest::Source;
use supervol_format::{Container, Dims, Geometry, ValueRange};

use crate::raycast::volume::ValueMap;
use crate::units::InUnits;

/// What kind of data a volume holds: decides the default picture only.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DataKind {
    /// Seismic amplitudes: signed, zero means nothing, z points down.
    Seismic,
    /// Densities from computed tomography.
    Ct,
    /// Anything else.
    #[default]
    Generic,
}

/// What scenes, the default camera and the presets must know of a volume.
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeFacts {
    /// Voxels of level 0.
    pub dims: Dims,
    /// Place in the world.
    pub geometry: Geometry,
    /// Least and greatest present value, data units.
    pub value_range: ValueRange,
    /// Pairs (percent in [0, 100], data value), ascending; may be empty.
    pub percentiles: Vec<(f64, f64)>,
    /// What the data are.
    pub kind: DataKind,
    /// Whether zero is the data's neutral value, with both signs around it.
    pub has_zero_centre: bool,
}

impl VolumeFacts {
    /// The facts of a container.
    #[must_use]
    pub fn of(container: &Container) -> Self {
        let (descriptor, manifest) = (container.descriptor(), container.manifest());
        let value_range = manifest.value_range.unwrap_or(ValueRange { min: 0.0, max: 1.0 });
        Self {
            dims: descriptor.dims(),
            geometry: descriptor.geometry,
            value_range,
            percentiles: manifest.percentiles.iter().map(|&[percent, value]| (percent, value)).collect(),
            kind: data_kind(&manifest.source, value_range),
            has_zero_centre: value_range.min < 0.0 && value_range.max > 0.0,
        }
    }
}

/// Whether values may be Hounsfield units: these go from air, near -1000, to bone, above 400, and to metal, below a million.
#[must_use]
pub fn is_hounsfield(range: ValueRange) -> bool {
    range.min < -500.0 && range.max > 400.0 && range.min.abs().max(range.max) < 1e6
}

/// What the data are, by where they came from and how far their values reach.
fn data_kind(source: &Source, value_range: ValueRange) -> DataKind {
    let seismic = source.format == "segy" || (source.format == "synth" && source.name.starts_with("seismic"));
    if seismic {
        DataKind::Seismic
    } else if is_hounsfield(value_range) {
        DataKind::Ct
    } else {
        DataKind::Generic
    }
}

/// Render values of a container: see [`ValueMap`].
#[must_use]
pub fn value_map(container: &Container) -> ValueMap {
    let d = container.descriptor();
    let InUnits { scale, offset, value_range, .. } = InUnits::of(container);
    let range = if container.manifest().value_range.is_some() { value_range } else { ValueRange::EMPTY };
    ValueMap::for_container(d.voxel_type, scale, offset, d.absence.nodata, range)
}
