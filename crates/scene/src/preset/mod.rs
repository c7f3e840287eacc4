//! Presets: named default transfer functions ([`NAMES`]): those of the kinds of data, and `grey`.
//!
//! The default picture of a kind is its *look* ([`Look`]): transfer function, mode, light and surfaces. It fills in
//! everything that a scene leaves open. On the command line, `--preset` is another name of `--kind` and selects the look.
//!
//! A preset gives its opacities over 1/256 of the volume's mean edge, not over a voxel. A volume of 2048^3 voxels
//! therefore looks like the same volume sampled at 256^3. The result is written into the scene as an explicit unit
//! distance; ray casters know nothing of volume sizes.
//!
//! - `looks`: mode, transfer function and shading of each kind of data
//! - `ramps`: the transfer functions
//! - `slices`: slices across the axes of the grid
//! - `view`: camera positions
//! - `placing`: position and proportions of the volume
//! - `overview`: a coarse level, from which the visible region is estimated
//! - `table`: planes that cut away the table that a patient lies on
//! - `windows`: named windows of tomography, level and width, gamma
//! - `transfer_file`: transfer functions and colour maps in files of other programs
//!
//! Presets choose parts of a scene ([`crate::spec`]). [`crate::scene`] puts them together.

mod color_space;
pub mod colormap;
mod extents;
pub mod looks;
pub mod overview;
pub mod placing;
pub mod ramps;
pub mod slices;
mod table;
pub mod transfer_file;
pub mod view;
pub mod windows;

use self::extents::unit_distance;
pub use self::extents::{domain, domain_corners};
pub use self::looks::Look;
use crate::facts::{DataKind, VolumeFacts};
use crate::spec::PointsSpec;
use crate::transfer_function::{TransferFunction, TransferFunctionError};

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

/// A transfer function that shows nothing of a volume.
#[must_use]
pub fn clear(facts: &VolumeFacts) -> PointsSpec {
    PointsSpec::of(&[ramps::point(facts.value_range.min, [0.5; 3], 0.0)], unit_distance(facts))
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
