//! Default look of each kind of data: mode, transfer function, shading and samples per pixel.

use super::extents::{extents, unit_distance};
use super::overview::Overview;
use super::slices::middle_slices;
use super::{colormap, ramps};
use crate::facts::histogram::Histogram;
use crate::facts::{DataKind, VolumeFacts};
use crate::slices::{Interpolation, SliceSpec};
use crate::spec::{IsoSpec, Mode, PointsSpec, ShadingSpec};
use crate::transfer_function::{ControlPoint, TransferFunction};

/// Most labels that the default picture shows in the volume. More would hide each other, and cells between two of them
/// hold dozens of others, which takes long. Slices show them.
const LABELS_IN_VOLUME: usize = 64;
/// Rays per pixel of a section, whose thin lines and steps need many.
const SECTION_SAMPLES: u32 = 16;
/// Unit distance of opaque matter in voxels: its face hides everything behind.
const FACE_VOXELS: f64 = 0.25;
/// Criteria of a background. Either one histogram bin holds at least the first share of all voxels. Or a quarter of the
/// voxels lie below the second share of the range.
const BACKGROUND: f64 = 0.3;
const DARK: f64 = 0.1;

/// Colours of solid matter, from its surface to its densest part: RGB in [0, 1].
const BONE: [[f64; 3]; 3] = [[0.72, 0.56, 0.44], [0.88, 0.80, 0.70], [1.0, 1.0, 0.97]];
const FLESH: [[f64; 3]; 3] = [[0.70, 0.50, 0.43], [0.86, 0.76, 0.70], [1.0, 0.98, 0.94]];
const STEEL: [[f64; 3]; 3] = [[0.45, 0.52, 0.62], [0.70, 0.75, 0.80], [1.0, 1.0, 1.0]];
const GLOW: [[f64; 3]; 3] = [[0.45; 3], [0.75; 3], [1.0; 3]];
/// Opacity of default surfaces around slices.
pub const SURFACE_AROUND_SLICES: f64 = 0.3;
/// Default colour of a surface.
const SURFACE: [f64; 3] = [0.86, 0.80, 0.70];

/// Default picture of a kind of data; it fills in what a scene leaves open.
#[derive(Debug, Clone, PartialEq)]
pub struct Look {
    /// Quantity that a ray computes.
    pub mode: Mode,
    /// Colours and opacities, with their unit distance.
    pub transfer_function: PointsSpec,
    /// Shading, if any.
    pub shading: Option<ShadingSpec>,
    /// Iso surfaces, for mode `iso`.
    pub iso: Vec<IsoSpec>,
    /// Rays per pixel, a square number.
    pub samples_per_pixel: u32,
    /// Slices that the default picture shows; usually none.
    pub slices: Vec<SliceSpec>,
    /// Colours and opacities of the volume around slices. If missing, the volume is clear around the default slices, and
    /// fainter around others ([`around_slices`]).
    pub around: Option<PointsSpec>,
}

impl Look {
    /// The look of a volume: that of a section if it is one, else that of its kind.
    #[must_use]
    pub fn of(facts: &VolumeFacts) -> Self {
        if let Some(axis) = facts.section_axis() {
            return Self::section(facts, axis);
        }
        let unit = unit_distance(facts);
        let lit = |points| Self { shading: Some(ShadingSpec::default()), ..Self::plain(points, unit) };
        match facts.kind {
            // A thin transparent plate shows little; amplitudes on its faces show more.
            DataKind::Seismic if is_flat(facts) => {
                let points = ramps::of_slice(facts);
                let unit = FACE_VOXELS * facts.geometry.smallest_spacing();
                Self { samples_per_pixel: 4, ..Self::plain(points, unit) }
            }
            // Sections as interpreters read them, with the strongest amplitudes in front of them.
            DataKind::Seismic => Self {
                slices: middle_slices(facts),
                around: Some(PointsSpec::of(&ramps::strong_amplitudes(facts), unit)),
                ..Self::plain(ramps::seismic(facts), unit)
            },
            DataKind::SeismicAttribute => Self::block(facts, "viridis"),
            DataKind::Ct | DataKind::CtOffset => lit(ramps::ct(facts)),
            // A piece of tissue without air around it.
            DataKind::Mri if !has_background(facts) => Self::block(facts, "grey"),
            DataKind::Mri => lit(ramps::tissue(facts, FLESH)),
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

    /// Unshaded emission and absorption with these control points over a unit distance.
    fn plain(points: Vec<ControlPoint>, unit_distance: f64) -> Self {
        Self {
            mode: Mode::Dvr,
            transfer_function: PointsSpec::of(&points, unit_distance),
            shading: None,
            iso: Vec::new(),
            samples_per_pixel: 1,
            slices: Vec::new(),
            around: None,
        }
    }

    /// An opaque block: the values on its faces.
    fn block(facts: &VolumeFacts, colors: &str) -> Self {
        let colors = colormap::by_name(colors).unwrap_or_default();
        let points = ramps::opaque(&colors, ramps::window(facts));
        Self { samples_per_pixel: 4, ..Self::plain(points, FACE_VOXELS * facts.geometry.smallest_spacing()) }
    }

    /// One section, opaque, face on: amplitudes red-white-blue, labels in colours, everything else grey.
    fn section(facts: &VolumeFacts, axis: usize) -> Self {
        let unit = FACE_VOXELS * (extents(facts)[axis] / facts.dims.0[axis] as f64);
        Self { samples_per_pixel: SECTION_SAMPLES, ..Self::plain(ramps::of_slice(facts), unit) }
    }

    fn labels(facts: &VolumeFacts) -> Self {
        // The unit distance is one voxel, whatever the volume's size, because the transition between two labels is one
        // voxel wide.
        let unit = facts.geometry.smallest_spacing();
        let shading = ShadingSpec { ambient: 0.45, diffuse: 0.55, ..ShadingSpec::default() };
        let look = Self::plain(ramps::labels(facts, 0.5), unit);
        if ramps::labels_of(facts).len() > LABELS_IN_VOLUME {
            let sharp = |slice| SliceSpec { labels: true, interpolation: Interpolation::Nearest, ..slice };
            return Self { slices: middle_slices(facts).into_iter().map(sharp).collect(), ..look };
        }
        Self { shading: Some(shading), samples_per_pixel: 4, ..look }
    }

    /// The iso surface at the middle of the value range.
    fn surface(facts: &VolumeFacts) -> Self {
        let grey = ramps::grey(facts);
        let iso = vec![IsoSpec { value: middle(facts), color: SURFACE, alpha: 1.0 }];
        let shading = Some(ShadingSpec::default());
        Self { mode: Mode::Iso, iso, shading, samples_per_pixel: 4, ..Self::plain(grey, unit_distance(facts)) }
    }
}

/// Whether a volume is a plate: its shortest edge is far shorter than the second one.
fn is_flat(facts: &VolumeFacts) -> bool {
    const FLAT: f64 = 0.1;
    let mut extents = extents(facts);
    extents.sort_by(f64::total_cmp);
    extents[0] <= FLAT * extents[1]
}

/// Whether the volume has a dark or empty background.
fn has_background(facts: &VolumeFacts) -> bool {
    let range = facts.central_range;
    let histogram = Histogram::new(&facts.histogram, range);
    let is_dark = || histogram.has_background();
    histogram.fullest() >= BACKGROUND || is_dark() || ramps::percentile(facts, 25.0) <= range.min + DARK * range.width()
}

/// The surface for a request without an iso value: between empty space and matter. The histogram decides if the usual
/// value of the kind does not occur, because tomography is not always in Hounsfield units.
#[must_use]
pub fn default_surface(facts: &VolumeFacts) -> IsoSpec {
    let usual = match facts.kind {
        DataKind::Mask => Some(middle(facts)),
        DataKind::Ct => Some(300.0),
        DataKind::CtOffset => Some(1324.0),
        _ => None,
    };
    let usual = usual.filter(|value| (facts.central_range.min..=facts.central_range.max).contains(value));
    let value = usual.unwrap_or_else(|| ramps::Classes::of(facts).ground);
    IsoSpec { value, color: SURFACE, alpha: 1.0 }
}

fn middle(facts: &VolumeFacts) -> f64 {
    0.5 * facts.central_range.min + 0.5 * facts.central_range.max
}

/// Fainter opacities for a volume around slices: a path of half the volume's mean edge lets half of the light pass, at the
/// mean extinction of the volume's voxels. Opacities that let more pass stay as they are. A body that fills a small share
/// of the volume counts as if it filled more; otherwise it would stay opaque.
///
/// Programs for slices (3D Slicer, OpendTect, ParaView) show slices without the volume around them. Here the volume
/// stays as a faint context. Mode `slice` shows slices alone.
#[must_use]
pub fn around_slices(points: PointsSpec, facts: &VolumeFacts) -> PointsSpec {
    /// Least share of the volume that visible voxels count for.
    const VISIBLE_SHARE: f64 = 0.3;
    let unit = points.unit_distance.unwrap_or_else(|| facts.geometry.smallest_spacing());
    let Ok(function) = TransferFunction::new(points.control_points(), unit) else { return points };
    let mean = if facts.histogram.is_empty() {
        function.kappa(points.points.iter().map(|p| p.alpha).fold(0.0, f64::max))
    } else {
        let histogram = Histogram::new(&facts.histogram, facts.central_range);
        let seen = histogram.shares().map(|(value, share)| (share, function.kappa(function.classify(value).1)));
        let [sum, visible] = seen.fold([0.0; 2], |[sum, visible], (share, kappa)| {
            [sum + share * kappa, visible + if kappa > 0.0 { share } else { 0.0 }]
        });
        sum * (VISIBLE_SHARE / visible.max(f64::MIN_POSITIVE)).max(1.0)
    };
    let path = 0.5 * extents(facts).iter().sum::<f64>() / 3.0;
    let denser = mean * path / std::f64::consts::LN_2;
    PointsSpec { unit_distance: Some(unit * denser.max(1.0)), ..points }
}

/// The transfer function of mode `dvr` for kinds whose default mode is a projection: transparent background, and
/// opacity that rises with the value. The opaque colours of a projection would show only the noise on the volume's
/// faces.
#[must_use]
pub fn body(facts: &VolumeFacts) -> PointsSpec {
    PointsSpec::of(&ramps::solid(facts, GLOW), unit_distance(facts))
}

/// The transfer function of projections (`mip`, `minip`, `mean`): a grey ramp over the projected values; for
/// tomography, from soft tissue to bone.
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
