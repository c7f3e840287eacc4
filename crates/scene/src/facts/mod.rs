//! Facts of a volume: everything that its header and manifest say. No brick is read.

pub mod histogram;
pub mod kind;

use supervol_format::coordinates::Coordinates;
use supervol_format::space::WorldSpace;
use supervol_format::{Container, Dims, Geometry, ValueRange};

pub use self::kind::DataKind;
use crate::camera::unit_vector;

/// Orientation of the world axes. It decides the position of default cameras and nothing else.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Frame {
    /// z points up; x and y have no named direction.
    #[default]
    Unknown,
    /// z points down: depth or time below a survey.
    Survey,
    /// Patient: x to the right, y to the front, z to the head.
    RightAnteriorSuperior,
    /// Patient: x to the left, y to the back, z to the head.
    LeftPosteriorSuperior,
}

impl Frame {
    /// Whether the world axes are those of a patient.
    #[must_use]
    pub fn is_patient(self) -> bool {
        matches!(self, Self::RightAnteriorSuperior | Self::LeftPosteriorSuperior)
    }
}

/// Facts of a volume that scenes, the default camera and the presets need.
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeFacts {
    /// Voxels of level 0 along x, y, z.
    pub dims: Dims,
    /// Position, spacing and direction in the world.
    pub geometry: Geometry,
    /// Orientation of the world axes.
    pub frame: Frame,
    /// World direction of north, a unit vector, for a survey with positions on the map.
    pub north: Option<[f64; 3]>,
    /// Least and greatest present value, data units.
    pub value_range: ValueRange,
    /// Range of the central values, data units: those without the few that lie far from all others. Usually it equals
    /// `value_range`.
    pub central_range: ValueRange,
    /// Share of the present voxels that have no central value.
    pub far_share: f64,
    /// Pairs (percent in [0, 100], data value) of the central values, ascending; may be empty.
    pub percentiles: Vec<(f64, f64)>,
    /// Counts of voxels in equal parts of `central_range`; may be empty.
    pub histogram: Vec<u64>,
    /// The labels that occur, ascending; empty if the container lists none.
    pub labels: Vec<f64>,
    /// Kind of data; it decides the default picture.
    pub kind: DataKind,
    /// Whether central values of both signs occur, so that zero is the neutral value.
    pub has_zero_centre: bool,
}

impl VolumeFacts {
    /// The facts of a container, with the kind of data recognised from the container.
    #[must_use]
    pub fn of(container: &Container) -> Self {
        Self::of_kind(container, kind::recognise(container).kind)
    }

    /// The facts of a container with a kind of data that the caller names.
    #[must_use]
    pub fn of_kind(container: &Container, kind: DataKind) -> Self {
        let (descriptor, manifest) = (container.descriptor(), container.manifest());
        let value_range = manifest.value_range.unwrap_or(ValueRange { min: 0.0, max: 1.0 });
        let (central_range, percentiles, histogram) = match manifest.central() {
            Some(central) => (central.range, &central.percentiles, &central.histogram),
            None => (value_range, &manifest.percentiles, &manifest.histogram),
        };
        let frame = match WorldSpace::from_name(&manifest.space) {
            WorldSpace::RightAnteriorSuperior => Frame::RightAnteriorSuperior,
            WorldSpace::LeftPosteriorSuperior => Frame::LeftPosteriorSuperior,
            WorldSpace::Unknown if manifest.survey.is_some() || kind.is_seismic() => Frame::Survey,
            WorldSpace::Unknown => Frame::Unknown,
        };
        Self {
            dims: descriptor.dims(),
            geometry: descriptor.geometry,
            frame,
            north: north(container),
            value_range,
            central_range,
            far_share: manifest
                .central()
                .map_or(0.0, |central| (central.below + central.above) as f64 / manifest.present_voxels.max(1) as f64),
            percentiles: percentiles.iter().map(|&[percent, value]| (percent, value)).collect(),
            histogram: histogram.clone(),
            labels: manifest.distribution.as_ref().map_or_else(Vec::new, |distribution| distribution.labels.clone()),
            kind,
            has_zero_centre: central_range.min < 0.0 && central_range.max > 0.0,
        }
    }

    /// Facts of a volume of which only size, position and value range are known.
    #[must_use]
    pub fn plain(dims: Dims, geometry: Geometry, value_range: ValueRange) -> Self {
        Self {
            dims,
            geometry,
            frame: Frame::Unknown,
            north: None,
            value_range,
            central_range: value_range,
            far_share: 0.0,
            percentiles: Vec::new(),
            histogram: Vec::new(),
            labels: Vec::new(),
            kind: DataKind::Generic,
            has_zero_centre: false,
        }
    }

    /// The only axis with more than one voxel, if there is just one such axis: a trace or a well.
    #[must_use]
    pub fn line_axis(&self) -> Option<usize> {
        let n = self.dims.0;
        (0..3).find(|&a| n[a] > 1 && n[(a + 1) % 3] == 1 && n[(a + 2) % 3] == 1)
    }

    /// The axis across a section, if the volume is one. A section has one voxel along this axis and more along the
    /// others. A few voxels also count as a section if there are many more along the others.
    #[must_use]
    pub fn section_axis(&self) -> Option<usize> {
        let n = self.dims.0;
        let thin = (0..3).min_by_key(|&a| n[a])?;
        let others = [(thin + 1) % 3, (thin + 2) % 3];
        if n[thin] == 1 && others.iter().all(|&a| n[a] > 1) {
            return Some(thin);
        }
        (n[thin] <= SECTION_VOXELS && others.iter().all(|&a| n[a] >= (2 * SECTION_VOXELS).max(4 * n[thin])))
            .then_some(thin)
    }
}

/// World direction of north in the drawn geometry.
fn north(container: &Container) -> Option<[f64; 3]> {
    let [_, north] = Coordinates::of(container).compass()?;
    unit_vector(container.descriptor().geometry.linear() * north).map(|north| north.to_array())
}

/// Most voxels across a volume that is shown as a section, face on.
const SECTION_VOXELS: u64 = 4;

/// Whether a range may be Hounsfield units. These go from air (near -1000) to bone (above 400) and metal (below a
/// million).
#[must_use]
pub fn is_hounsfield(range: ValueRange) -> bool {
    range.min < -500.0 && range.max > 400.0 && range.min.abs().max(range.max) < 1e6
}
