//! Extents of a volume: its domain, its edges, and the unit distance of presets.

use glam::DVec3;
use supervol_format::space::HALF_VOXEL;

use crate::facts::VolumeFacts;
use crate::units::edges;

/// The eight world corners of the volume's domain.
#[must_use]
pub fn domain_corners(facts: &VolumeFacts) -> [DVec3; 8] {
    let ([low, high], world) = (domain(facts), facts.geometry.world_from_index());
    std::array::from_fn(|corner| {
        let side = |a: usize| if corner >> a & 1 == 0 { low[a] } else { high[a] };
        world.transform_point3(DVec3::new(side(0), side(1), side(2)))
    })
}

/// The volume's domain in index coordinates.
#[must_use]
pub fn domain(facts: &VolumeFacts) -> [[f64; 3]; 2] {
    [[-HALF_VOXEL; 3], facts.dims.0.map(|n| n as f64 - HALF_VOXEL)]
}

/// A preset's unit distance is the mean edge of the volume divided by this.
const UNITS_PER_EDGE: f64 = 256.0;
/// Least number of unit distances across the thinnest axis.
const THINNEST_UNITS: f64 = 12.0;

/// World length over which a preset's opacities are gathered.
pub(super) fn unit_distance(facts: &VolumeFacts) -> f64 {
    let extents = extents(facts);
    let mean = extents.iter().sum::<f64>() / 3.0;
    let thinnest = extents.iter().copied().fold(f64::INFINITY, f64::min);
    // With a unit distance that suits its length, a single section or a few slices would be almost transparent.
    (mean / UNITS_PER_EDGE).max(facts.geometry.smallest_spacing()).min(thinnest / THINNEST_UNITS)
}

/// World lengths of the volume's edges.
pub(super) fn extents(facts: &VolumeFacts) -> [f64; 3] {
    let edges = edges(&facts.geometry);
    std::array::from_fn(|a| edges[a] * facts.dims.0[a] as f64)
}
