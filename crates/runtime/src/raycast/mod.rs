//! Ray casters: from resident voxels to an image.
//!
//! - [`volume`]: what a ray caster reads: decoded bricks, and which of them are resident;
//! - [`blocks`]: ranges of values in a brick's blocks of cells, finer than those that containers keep;
//! - [`reference`](mod@reference): the brute-force `f64` integrator that decides what is right;
//! - [`cpu`]: frames and passes on the CPU, whichever caster takes the rays;
//! - [`scalar`]: the cell caster in plain Rust; its small functions are the twins of shader functions, and methods of
//!   comparison plug into it;
//! - [`gpu`]: the same ray caster in WGSL.

pub mod blocks;
pub mod cpu;
#[cfg(test)]
pub(crate) mod cubics;
pub mod gpu;
pub mod reference;
pub mod scalar;
pub mod volume;
