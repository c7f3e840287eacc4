//! Facts of a volume: what its header and manifest say, without a brick being read.

pub mod histogram;
pub mod kind;

use supervol_format::space::WorldSpace;
use supervol_format::{Container, Dims, Geometry, ValueRange};

pub use self::kind::DataKind;
use crate::units::InUnits;
use crate::value_map::ValueMap;

/// Which way the world is turned: decides where default cameras stand, and nothing else.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Frame {
    /// z points up; x and y as they come.
    #[default]
    Unknown,
    /// z points down: depth or time below a survey.
    Survey,
    /// A patient, x to the right, y to the front, z to the head.
    RightAnteriorSuperior,
    /// A patient, x to the left, y to the back, z to the head.
    LeftPosteriorSuperior,
}

impl Frame {
    /// Whether the world is a patient's.
    #[must_use]
    pub fn is_patient(self) -> bool {
        matches!(self, Self::RightAnteriorSuperior | Self::LeftPosteriorSuperior)
    }
}

/// What scenes, the default camera and the presets must know of a volume.
#[derive(Debug, Clone, PartialEq)]
pub struct VolumeFacts {
    /// Voxels of level 0.
    pub dims: Dims,
    /// Place in the world.
    pub geometry: Geometry,
    /// Which way the world is turned.
    pub frame: Frame,
    /// Least and greatest present value, data units.
    pub value_range: ValueRange,
    /// Pairs (percent in [0, 100], data value), ascending; may be empty.
    pub percentiles: Vec<(f64, f64)>,
    /// Counts of present voxels in equal parts of `value_range`; may be empty.
    pub histogram: Vec<u64>,
    /// What the data are.
    pub kind: DataKind,
    /// Whether zero is the data's neutral value, with both signs around it.
    pub has_zero_centre: bool,
}

impl VolumeFacts {
    /// The facts of a container, of whatever kind its data seem to be.
    #[must_use]
    pub fn of(container: &Container) -> Self {
        Self::of_kind(container, kind::recognise(container).kind)
    }

    /// The facts of a container whose data are of a kind that somebody knows.
    #[must_use]
    pub fn of_kind(container: &Container, kind: DataKind) -> Self {
        let (descriptor, manifest) = (container.descriptor(), container.manifest());
        let value_range = manifest.value_range.unwrap_or(ValueRange { min: 0.0, max: 1.0 });
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
            value_range,
            percentiles: manifest.percentiles.iter().map(|&[percent, value]| (percent, value)).collect(),
            histogram: manifest.histogram.clone(),
            kind,
            has_zero_centre: value_range.min < 0.0 && value_range.max > 0.0,
        }
    }

    /// A volume of which nothing is known but its size, its place and its values.
    #[must_use]
    pub fn plain(dims: Dims, geometry: Geometry, value_range: ValueRange) -> Self {
        Self {
            dims,
            geometry,
            frame: Frame::Unknown,
            value_range,
            percentiles: Vec::new(),
            histogram: Vec::new(),
            kind: DataKind::Generic,
            has_zero_centre: false,
        }
    }

    /// The axis along a single line of voxels: a trace, a well.
    #[must_use]
    pub fn line_axis(&self) -> Option<usize> {
        let n = self.dims.0;
        (0..3).find(|&a| n[a] > 1 && n[(a + 1) % 3] == 1 && n[(a + 2) % 3] == 1)
    }

    /// The axis across a section: one with a single voxel where both others have more, or with a few where both others have
    /// many more.
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

/// Most voxels across what is shown as a section, face on.
const SECTION_VOXELS: u64 = 4;

/// Whether values may be Hounsfield units: these go from air, near -1000, to bone, above 400, and to metal, below a million.
#[must_use]
pub fn is_hounsfield(range: ValueRange) -> bool {
    range.min < -500.0 && range.max > 400.0 && range.min.abs().max(range.max) < 1e6
}

/// Render values of a container: see [`ValueMap`].
#[must_use]
pub fn value_map(container: &Container) -> ValueMap {
    let d = container.descriptor();
    let InUnits { scale, offset, value_range, .. } = InUnits::of(container);
    let range = if container.manifest().value_range.is_some() { value_range } else { ValueRange::EMPTY };
    ValueMap::for_container(d.voxel_type, scale, offset, d.absence.nodata, range)
}
