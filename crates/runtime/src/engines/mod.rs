//! Engines: from resident bricks to an image.
//!
//! - [`rules`]: every tolerance of the integral, with its reason;
//! - [`value_error`]: what values of rays may be off by;
//! - [`totals`], [`maps`]: counters and errors of a picture; maps of its errors and its work;
//! - `asked`: some pixels of a picture, where not all are to be cast;
//! - [`engine`], [`error`]: the interface of an engine, with its protocol; its errors;
//! - [`reference`](mod@reference): the brute-force `f64` integrator that defines the right picture;
//! - [`ray`], [`ray_scene`], [`feedback`]: a ray between passes, the description of its picture, the result of a pass;
//! - [`blocks`]: value ranges of blocks of 4^3 cells, by which casters leap;
//! - [`cells`]: the scalar cell caster, one ray at a time in `f64`; twin of the shader;
//! - [`packets`]: the CPU caster, packets of rays in `f32`;
//! - [`cpu`]: the choice between the two;
//! - [`gpu`]: the same ray caster in WGSL, and all other code for graphics devices.

pub(crate) mod asked;
pub mod blocks;
pub mod cells;
pub mod cpu;
#[cfg(test)]
pub(crate) mod cubics;
pub mod engine;
pub mod error;
pub mod feedback;
pub mod gpu;
pub mod maps;
pub mod packets;
pub mod ray;
pub mod ray_scene;
pub mod reference;
pub mod rules;
pub mod totals;
pub mod value_error;
