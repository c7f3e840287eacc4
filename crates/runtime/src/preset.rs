//! Pictures for volumes nobody has written a scene for: a camera that frames the volume, and named transfer functions.
//!
//! A preset gives its opacities over 1/256 of the volume's mean edge, not over a voxel: a volume of 2048^3 voxels looks
//! like the same volume sampled at 256^3. This choice is part of the preset and ends up as an explicit unit distance;
//! the ray casters know nothing of volume sizes.

use crate::facts::{DataKind, VolumeFacts, is_hounsfield};
use crate::units::edges;
use glam::DVec3;
use supervol_format::space::HALF_VOXEL;

use crate::camera::{Camera, CameraError, Projection};

use crate::transfer_function::{ControlPoint, TransferFunction, TransferFunctionError};

/// Names that a scene may give as its transfer function.
pub const NAMES: [&str; 3] = ["seismic", "ct", "grey"];

/// Vertical angle of view of the default camera, degrees.
const FOV_Y: f64 = 30.0;
/// Share of the picture that the framed volume fills.
const FILL: f64 = 0.92;
/// A preset's opacities hold over the mean edge of the volume divided by this.
const UNITS_PER_EDGE: f64 = 256.0;
/// Least units across the thinnest axis.
const THINNEST_UNITS: f64 = 12.0;

/// Name of the preset that suits a kind of data.
#[must_use]
pub fn default_name(kind: DataKind) -> &'static str {
    match kind {
        DataKind::Seismic => "seismic",
        DataKind::Ct => "ct",
        DataKind::Generic => "grey",
    }
}

/// The eight world corners of the volume's domain.
#[must_use]
pub fn domain_corners(facts: &VolumeFacts) -> [DVec3; 8] {
    let world = facts.geometry.world_from_index();
    std::array::from_fn(|corner| {
        let side = |a: usize| if corner >> a & 1 == 0 { -HALF_VOXEL } else { facts.dims.0[a] as f64 - HALF_VOXEL };
        world.transform_point3(DVec3::new(side(0), side(1), side(2)))
    })
}

/// A perspective three-quarter view from above that frames the whole volume.
///
/// World z points up, except for seismic data, whose sample axis points down.
///
/// # Errors
/// Never for a valid geometry: the eye lies outside the volume, and up is not the forward axis.
pub fn default_camera(facts: &VolumeFacts, size: [u32; 2]) -> Result<Camera, CameraError> {
    let corners = domain_corners(facts);
    let centre = corners.iter().sum::<DVec3>() / 8.0;
    let up = match facts.kind {
        DataKind::Seismic => -(facts.geometry.linear() * DVec3::Z).normalize(),
        DataKind::Ct | DataKind::Generic => DVec3::Z,
    };
    // A horizontal frame around `up`: the world axis least parallel to it gives the first direction.
    let reference = if up.x.abs() < 0.9 { DVec3::X } else { DVec3::Y };
    let side = (reference - reference.dot(up) * up).normalize();
    let front = up.cross(side);
    let outward = (0.55 * side - 0.75 * front + 0.5 * up).normalize();
    let projection = Projection::Perspective { fov_y: FOV_Y };
    let unit = Camera::look_at(outward, DVec3::ZERO, up, projection, size)?;

    // A corner at (x, y, z) of the camera's frame around the centre is inside the picture when the eye's distance d
    // satisfies |x| <= FILL tan_x (d + z), and likewise y: the farthest such d frames all corners.
    let tan_y = (FOV_Y.to_radians() / 2.0).tan();
    let tan_x = tan_y * f64::from(size[0]) / f64::from(size[1]);
    let distance = corners.iter().fold(0.0f64, |distance, &corner| {
        let p = corner - centre;
        let needed = (p.dot(unit.right).abs() / tan_x).max(p.dot(unit.up).abs() / tan_y) / FILL;
        distance.max(needed - p.dot(unit.forward))
    });
    Ok(Camera { eye: centre + outward * distance, ..unit })
}

/// The named preset for a volume; the grey ramp for a name that is not in [`NAMES`].
///
/// # Errors
/// Never for finite facts: presets' points are sorted and in range.
pub fn transfer_function(name: &str, facts: &VolumeFacts) -> Result<TransferFunction, TransferFunctionError> {
    let points = match name {
        "seismic" => seismic(facts),
        "ct" => ct(facts),
        _ => grey(facts),
    };
    TransferFunction::new(points, unit_distance(facts))
}

fn unit_distance(facts: &VolumeFacts) -> f64 {
    let edges = edges(&facts.geometry);
    let extents: [f64; 3] = std::array::from_fn(|a| edges[a] * facts.dims.0[a] as f64);
    let mean = extents.iter().sum::<f64>() / 3.0;
    let thinnest = extents.iter().copied().fold(f64::INFINITY, f64::min);
    // A single section or a few slices would be clear glass at the scale of their length.
    (mean / UNITS_PER_EDGE).max(facts.geometry.smallest_spacing()).min(thinnest / THINNEST_UNITS)
}

/// Value at a percentile, interpolated; the range stands in where no percentiles are known.
fn percentile(facts: &VolumeFacts, percent: f64) -> f64 {
    let range = facts.value_range;
    let ends = [(0.0, range.min), (100.0, range.max)];
    let known = if facts.percentiles.is_empty() { &ends[..] } else { &facts.percentiles[..] };
    let above = known.partition_point(|&(p, _)| p < percent);
    match (above.checked_sub(1).map(|i| known[i]), known.get(above)) {
        (Some((p0, v0)), Some(&(p1, v1))) => v0 + (v1 - v0) * (percent - p0) / (p1 - p0).max(f64::MIN_POSITIVE),
        (Some((_, v)), None) | (None, Some(&(_, v))) => v,
        (None, None) => 0.0,
    }
}

fn point(value: f64, color: [f64; 3], alpha: f64) -> ControlPoint {
    ControlPoint { value, color, alpha }
}

/// Least and greatest value worth showing; never equal, always finite.
fn window(facts: &VolumeFacts) -> (f64, f64) {
    let mut low = percentile(facts, 1.0);
    let mut high = percentile(facts, 99.0);
    // Mostly empty volumes put both percentiles on the background: then the whole range is the window.
    let range = facts.value_range;
    if !range.is_empty() && high - low <= 1e-3 * range.width() {
        (low, high) = (range.min, range.max);
    }
    if !(low.is_finite() && high.is_finite()) {
        return (0.0, 1.0);
    }
    if high > low { (low, high) } else { (low, low + low.abs().max(1.0)) }
}

/// Symmetric double wing on a red-white-blue map, clipped at the 99th percentile; zero is transparent.
///
/// Amplitudes stored without a sign have their zero at the median.
fn seismic(facts: &VolumeFacts) -> Vec<ControlPoint> {
    let (low, high) = window(facts);
    let zero = if facts.has_zero_centre { 0.0 } else { percentile(facts, 50.0) };
    let clip = (low - zero).abs().max((high - zero).abs());
    let point = |offset: f64, color, alpha| point(zero + offset, color, alpha);
    vec![
        point(-clip, [0.55, 0.00, 0.05], 0.45),
        point(-0.60 * clip, [0.85, 0.15, 0.12], 0.18),
        point(-0.25 * clip, [0.97, 0.70, 0.60], 0.010),
        point(-0.12 * clip, [1.00, 0.92, 0.90], 0.0),
        point(0.12 * clip, [0.90, 0.94, 1.00], 0.0),
        point(0.25 * clip, [0.60, 0.75, 0.97], 0.010),
        point(0.60 * clip, [0.12, 0.30, 0.85], 0.18),
        point(clip, [0.03, 0.08, 0.50], 0.45),
    ]
}

/// Air transparent, soft tissue faint and warm, bone white.
///
/// Hounsfield units are recognised by a range that reaches from air to bone; anything else goes by percentiles.
fn ct(facts: &VolumeFacts) -> Vec<ControlPoint> {
    let range = facts.value_range;
    let [air, soft, dense, bone, metal] = if is_hounsfield(range) {
        [-500.0, 40.0, 180.0, 450.0, 1500.0]
    } else {
        let (low, high) = window(facts);
        let top = if range.is_empty() { high } else { range.max.max(high) };
        let at = |share: f64| low + share * (high - low);
        [at(0.20), at(0.45), at(0.70), at(0.95), top.max(at(1.2))]
    };
    vec![
        point(air, [0.55, 0.25, 0.15], 0.0),
        point(air + 0.6 * (soft - air), [0.75, 0.35, 0.22], 0.002),
        point(soft, [0.88, 0.55, 0.42], 0.008),
        point(dense, [0.95, 0.75, 0.60], 0.03),
        point(bone, [0.98, 0.95, 0.88], 0.35),
        point(metal, [1.0, 1.0, 1.0], 0.8),
    ]
}

/// Grey ramp over the window: dark and clear below, white and dense above.
fn grey(facts: &VolumeFacts) -> Vec<ControlPoint> {
    let (low, high) = window(facts);
    let at = |share: f64| low + share * (high - low);
    if facts.has_zero_centre {
        let clip = low.abs().max(high.abs());
        let wing = |value: f64, grey: f64, alpha: f64| point(value, [grey; 3], alpha);
        return vec![
            wing(-clip, 0.05, 0.30),
            wing(-0.15 * clip, 0.45, 0.0),
            wing(0.15 * clip, 0.55, 0.0),
            wing(clip, 0.95, 0.30),
        ];
    }
    vec![
        point(at(0.10), [0.15; 3], 0.0),
        point(at(0.35), [0.40; 3], 0.008),
        point(at(0.65), [0.70; 3], 0.06),
        point(at(1.0), [1.0; 3], 0.35),
    ]
}
