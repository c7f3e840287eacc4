//! Engines: from resident bricks to an image.
//!
//! - [`engine`]: the interface of an engine, with its protocol; [`error`]: its errors;
//! - [`totals`]: sums and errors that an engine states of its picture;
//! - [`maps`]: values per pixel beside the colour: stated error, work;
//! - [`reference`](mod@reference): the brute-force `f64` integrator that defines the right picture;
//! - [`packets`]: the CPU caster, packets of rays in `f32`;
//! - [`cells`]: the scalar cell caster, one ray at a time in `f64`; twin of the shader;
//! - [`gpu`]: the same ray caster in WGSL, and everything else that knows a graphics device;
//! - [`rules`]: every tolerance of the integral, with its reason;
//! - [`blocks`]: value ranges of blocks of 4^3 cells, by which casters leap.

pub mod blocks;
pub mod cells;
#[cfg(test)]
pub(crate) mod cubics;
pub mod engine;
pub mod error;
pub mod gpu;
pub mod maps;
pub mod packets;
pub mod reference;
pub mod rules;
pub mod totals;
