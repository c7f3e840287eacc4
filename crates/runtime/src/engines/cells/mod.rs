//! The cell caster in plain Rust: ray by ray, trilinear cell by trilinear cell, crossings and cubics in `f64`.
//!
//! It has three duties:
//! - its small functions ([`cell`], [`quadrature`], [`shade`]) are the twins of the shader functions of the same names;
//! - it is written to be read and checked, so that faster CPU casters are compared with it;
//! - it passes every macro cell that may be visible to an [`Integrator`], so that other methods can be plugged in for
//!   comparison. They share the walk, levels of detail, skipping and waiting.
//!
//! In the order along a ray:
//! - `march`: brick by brick, until the ray is finished or waits;
//! - [`walk`]: crossings with the faces of bricks, macro cells and cells;
//! - [`visit`]: one brick, macro cell by macro cell, and access to its voxels;
//! - [`integrator`]: the interface; [`cell_by_cell`]: the integrator of this caster;
//! - [`frame`], [`rays`]: a picture by this caster, and its rays between passes;
//! - `bounded`, with `polynomials` and `shown_cells`: light with a proven bound, with opacity by the gradient and where `f32` does
//!   not suffice;
//! - `exact_values`: values from the container's own numbers;
//! - [`cell`], [`quadrature`], [`shade`], [`modes`]: one cell, and what a chord through it contributes.

pub(crate) mod bounded;
pub mod cell;
pub mod cell_by_cell;
mod exact_values;
pub mod frame;
pub mod integrator;
mod march;
pub mod modes;
mod polynomials;
pub mod quadrature;
pub mod rays;
pub mod shade;
pub(crate) mod shown_cells;
pub mod visit;
pub mod walk;

pub(crate) use cell_by_cell::gather_exact_cell;
pub use cell_by_cell::{CellByCell, CellRule, Pairs};
pub(crate) use exact_values::{gather_exact_uniform, gather_exact_value_cell, gather_exact_values};
pub use integrator::{Integration, Integrator};
pub(crate) use visit::CastRay;
pub use visit::{BrickVisit, LevelVisit, StoredVoxel, cells_of_macro_cell};
