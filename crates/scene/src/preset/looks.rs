//! What each kind of data looks like, unasked.

use super::overview::Overview;
use super::{colormap, extents, ramps, unit_distance};
use crate::facts::histogram::Histogram;
use crate::facts::{DataKind, VolumeFacts};
use crate::scene::{IsoSpec, Mode, PointsSpec, ShadingSpec};
use crate::transfer_function::ControlPoint;

/// Rays of a pixel where lines and steps are shown as they are, face on.
const SECTION_SAMPLES: u32 = 16;
/// Opaque matter hides what lies this many voxels behind its face.
const FACE_VOXELS: f64 = 0.25;
/// Share of the voxels in one histogram bin from which on that bin is background, and the share of the range below which
/// a quarter of the voxels are background.
const BACKGROUND: f64 = 0.3;
const DARK: f64 = 0.1;

/// Colours of solid matter, from its surface to its densest part.
const BONE: [[f64; 3]; 3] = [[0.72, 0.56, 0.44], [0.88, 0.80, 0.70], [1.0, 1.0, 0.97]];
const FLESH: [[f64; 3]; 3] = [[0.70, 0.50, 0.43], [0.86, 0.76, 0.70], [1.0, 0.98, 0.94]];
const STEEL: [[f64; 3]; 3] = [[0.45, 0.52, 0.62], [0.70, 0.75, 0.80], [1.0, 1.0, 1.0]];
const GLOW: [[f64; 3]; 3] = [[0.45; 3], [0.75; 3], [1.0; 3]];
/// Colour of a surface without a colour of its own.
const SURFACE: [f64; 3] = [0.86, 0.80, 0.70];

/// A picture's own choices: what a scene leaves open is filled in with these.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// What a ray gathers.
    pub mode: Mode,
    /// Colours and opacities, with their unit distance.
    pub transfer_function: PointsSpec,
    /// Shading, if any.
    pub shading: Option<ShadingSpec>,
    /// Surfaces, in mode `iso`.
    pub iso: Vec<IsoSpec>,
    /// Rays of a pixel.
    pub samples_per_pixel: u32,
}

impl Look {
    /// The look of a volume: that of a section where it is one, else that of its kind.
    #[must_use]
    pub fn of(facts: &VolumeFacts) -> Self {
        if let Some(axis) = facts.section_axis() {
            return Self::section(facts, axis);
        }
        let unit = unit_distance(facts);
        let lit = |points| Self { shading: Some(ShadingSpec::default()), ..Self::plain(points, unit) };
        match facts.kind {
            // Clear matter is murky where rays run through little of it: amplitudes on the faces tell more.
            DataKind::Seismic if is_flat(facts) => {
                let points = ramps::of_slice(facts);
                let unit = FACE_VOXELS * facts.geometry.smallest_spacing();
                Self { samples_per_pixel: 4, ..Self::plain(points, unit) }
            }
            DataKind::Seismic => Self::plain(ramps::seismic(facts), unit),
            DataKind::SeismicAttribute => Self::block(facts, "viridis"),
            DataKind::Ct | DataKind::CtOffset => lit(ramps::ct(facts)),
            // A piece of tissue without air around it.
            DataKind::Mri if !has_background(facts) => Self::block(facts, "grey"),
            DataKind::Mri => lit(ramps::solid(facts, FLESH)),
            DataKind::MicroCt => lit(ramps::solid(facts, BONE)),
            DataKind::Fluorescence => Self {
                mode: Mode::Mip,
                ..Self::plain(ramps::opaque_grey(ramps::window_between(facts, [50.0, 99.9])), unit)
            },
            DataKind::ElectronMicroscopy => Self::block(facts, "grey"),
            DataKind::Labels => Self::labels(facts),
            DataKind::Mask => Self::surface(facts),
            DataKind::Constant | DataKind::Empty => {
                let points = vec![ramps::point(facts.value_range.min, [0.5; 3], 1.0)];
                Self { shading: None, ..Self::plain(points, facts.geometry.smallest_spacing()) }
            }
            DataKind::Generic if facts.has_zero_centre => lit(ramps::signed(facts)),
            DataKind::Generic => {
                if facts.histogram.is_empty() {
                    lit(ramps::grey(facts))
                } else if has_background(facts) {
                    lit(ramps::solid(facts, STEEL))
                } else {
                    Self::block(facts, "viridis")
                }
            }
        }
    }

    /// Points over a unit distance, unshaded.
    fn plain(points: Vec<ControlPoint>, unit_distance: f64) -> Self {
        Self {
            mode: Mode::Dvr,
            transfer_function: PointsSpec::of(&points, unit_distance),
            shading: None,
            iso: Vec::new(),
            samples_per_pixel: 1,
        }
    }

    /// The values on the faces of an opaque block.
    fn block(facts: &VolumeFacts, colors: &str) -> Self {
        let colors = colormap::by_name(colors).unwrap_or_default();
        let points = ramps::opaque(&colors, ramps::window(facts));
        Self { samples_per_pixel: 4, ..Self::plain(points, FACE_VOXELS * facts.geometry.smallest_spacing()) }
    }

    /// One section, opaque, face on: amplitudes red-white-blue, labels in colours, all else grey.
    fn section(facts: &VolumeFacts, axis: usize) -> Self {
        let unit = FACE_VOXELS * (extents(facts)[axis] / facts.dims.0[axis] as f64);
        Self { samples_per_pixel: SECTION_SAMPLES, ..Self::plain(ramps::of_slice(facts), unit) }
    }

    fn labels(facts: &VolumeFacts) -> Self {
        // Over a voxel, whatever the volume's size: between two labels lies one voxel.
        let unit = facts.geometry.smallest_spacing();
        let shading = ShadingSpec { ambient: 0.45, diffuse: 0.55, ..ShadingSpec::default() };
        Self { shading: Some(shading), samples_per_pixel: 4, ..Self::plain(ramps::labels(facts, 0.5), unit) }
    }

    /// The surface between two values.
    fn surface(facts: &VolumeFacts) -> Self {
        let grey = ramps::grey(facts);
        let iso = vec![IsoSpec { value: middle(facts), color: SURFACE, alpha: 1.0 }];
        let shading = Some(ShadingSpec::default());
        Self { mode: Mode::Iso, iso, shading, samples_per_pixel: 4, ..Self::plain(grey, unit_distance(facts)) }
    }
}

/// Whether a volume is a plate: far thinner one way than the others.
fn is_flat(facts: &VolumeFacts) -> bool {
    const FLAT: f64 = 0.1;
    let mut extents = extents(facts);
    extents.sort_by(f64::total_cmp);
    extents[0] <= FLAT * extents[1]
}

/// Whether there is something dark or empty around what the volume shows.
fn has_background(facts: &VolumeFacts) -> bool {
    let range = facts.value_range;
    let fullest = Histogram::new(&facts.histogram, range).fullest();
    fullest >= BACKGROUND || ramps::percentile(facts, 25.0) <= range.min + DARK * range.width()
}

/// A surface for who asks for one and gives no value: between emptiness and matter. By the histogram where the usual value of the
/// kind does not occur: tomography is not always in Hounsfield units.
#[must_use]
pub fn default_surface(facts: &VolumeFacts) -> IsoSpec {
    let usual = match facts.kind {
        DataKind::Mask => Some(middle(facts)),
        DataKind::Ct => Some(300.0),
        DataKind::CtOffset => Some(1324.0),
        _ => None,
    };
    let usual = usual.filter(|value| (facts.value_range.min..=facts.value_range.max).contains(value));
    let value = usual.unwrap_or_else(|| ramps::Classes::of(facts).ground);
    IsoSpec { value, color: SURFACE, alpha: 1.0 }
}

fn middle(facts: &VolumeFacts) -> f64 {
    0.5 * facts.value_range.min + 0.5 * facts.value_range.max
}

/// What is seen as a body (mode `dvr`) of a kind that is a projection unasked: nothing of the dark around, all else the denser the brighter
/// it is. Opaque colours, as a projection has them, would show nothing but the noise on the volume's faces.
#[must_use]
pub fn body(facts: &VolumeFacts) -> PointsSpec {
    PointsSpec::of(&ramps::solid(facts, GLOW), unit_distance(facts))
}

/// What projections (`mip`, `minip`, `mean`) are shown with: a grey ramp over what they come to; of tomography, from soft tissue to bone.
#[must_use]
pub fn projection(mode: Mode, facts: &VolumeFacts, overview: Option<&Overview>) -> PointsSpec {
    let of_tissue = if mode == Mode::Mip { ramps::projected_tissue(facts) } else { None };
    let projected = || overview.and_then(|overview| overview.projected_window(mode));
    let window = of_tissue.or_else(projected).unwrap_or_else(|| match mode {
        Mode::Mip => ramps::window_between(facts, [50.0, 99.9]),
        Mode::Minip => ramps::window_between(facts, [0.1, 50.0]),
        _ => ramps::window_between(facts, [5.0, 95.0]),
    });
    PointsSpec::of(&ramps::opaque_grey(window), unit_distance(facts))
}
