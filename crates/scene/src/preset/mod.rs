//! Presets: default pictures by kind of data, used for everything that a scene leaves open.
//!
//! A preset gives its opacities over 1/256 of the volume's mean edge, not over a voxel. A volume of 2048^3 voxels
//! therefore looks like the same volume sampled at 256^3. The result is written into the scene as an explicit unit
//! distance; ray casters know nothing of volume sizes.
//!
//! - `looks`: mode, transfer function and shading of each kind of data
//! - `ramps`: the transfer functions
//! - `view`: camera positions
//! - `section`: one slice, face on
//! - `placing`: position and proportions of the volume
//! - `overview`: a coarse level, from which the visible region is estimated
//! - `transfer_file`: transfer functions and colour maps in files of other programs
//!
//! A preset's result is a complete [`crate::scene::Scene`].

mod color_space;
pub mod colormap;
pub mod looks;
pub mod overview;
pub mod placing;
pub mod ramps;
pub mod section;
pub mod transfer_file;
pub mod view;

use glam::DVec3;
use supervol_format::space::HALF_VOXEL;

pub use self::looks::Look;
use self::view::Framed;
use crate::camera::Camera;
use crate::facts::{DataKind, VolumeFacts};
use crate::scene::SceneError;
use crate::transfer_function::{TransferFunction, TransferFunctionError};
use crate::units::{Units, edges};

/// Names that a scene may give as its transfer function: the kinds of data and a plain grey ramp.
pub const NAMES: [&str; 12] = [
    "seismic",
    "attribute",
    "ct",
    "ct-offset",
    "mri",
    "fluorescence",
    "em",
    "micro-ct",
    "labels",
    "mask",
    "generic",
    "grey",
];

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

/// The default camera for the whole volume: see [`view`].
///
/// # Errors
/// Never for a valid geometry: the eye lies outside the volume, and up is not the forward axis.
pub fn default_camera(facts: &VolumeFacts, size: [u32; 2]) -> Result<Camera, SceneError> {
    view::View::of(facts).camera(&Framed::whole(facts, domain(facts)), size).camera(&Units::WORLD, size)
}

/// The named preset for a volume; the grey ramp if the name is not in [`NAMES`].
///
/// # Errors
/// Never for finite facts: presets' points are sorted and in range.
pub fn transfer_function(name: &str, facts: &VolumeFacts) -> Result<TransferFunction, TransferFunctionError> {
    match name.parse::<DataKind>() {
        Ok(kind) => {
            let spec = Look::of(&VolumeFacts { kind, ..facts.clone() }).transfer_function;
            TransferFunction::new(spec.control_points(), spec.unit_distance.unwrap_or(unit_distance(facts)))
        }
        Err(_) => TransferFunction::new(ramps::grey(facts), unit_distance(facts)),
    }
}

/// A preset's unit distance is the mean edge of the volume divided by this.
const UNITS_PER_EDGE: f64 = 256.0;
/// Least number of unit distances across the thinnest axis.
const THINNEST_UNITS: f64 = 12.0;

/// World length over which a preset's opacities are gathered.
fn unit_distance(facts: &VolumeFacts) -> f64 {
    let extents = extents(facts);
    let mean = extents.iter().sum::<f64>() / 3.0;
    let thinnest = extents.iter().copied().fold(f64::INFINITY, f64::min);
    // With a unit distance that suits its length, a single section or a few slices would be almost transparent.
    (mean / UNITS_PER_EDGE).max(facts.geometry.smallest_spacing()).min(thinnest / THINNEST_UNITS)
}

/// World lengths of the volume's edges.
fn extents(facts: &VolumeFacts) -> [f64; 3] {
    let edges = edges(&facts.geometry);
    std::array::from_fn(|a| edges[a] * facts.dims.0[a] as f64)
}
