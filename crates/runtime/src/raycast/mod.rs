//! Ray casters: from resident voxels to an image.
//!
//! - [`volume`]: what a ray caster reads: decoded bricks, and which of them are resident;
//! - [`reference`](mod@reference): the brute-force `f64` integrator that decides what is right;
//! - [`cpu`]: the ray caster in Rust; its small functions are the twins of shader functions.
//! - [`gpu`]: the same ray caster in WGSL;
//! - [`method`]: how rays are integrated: the default, or one of the methods of [`comparison`], which nobody gets unasked.

pub mod comparison;
pub mod cpu;
pub mod gpu;
pub mod method;
pub mod reference;
pub mod volume;
