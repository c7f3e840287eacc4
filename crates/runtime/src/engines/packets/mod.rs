//! The packet caster: tiles of rays, in packets of as many rays as the processor's vectors have lanes, in `f32`.
//!
//! Trilinear cells are integrated, not steps (docs/how-pictures-are-made.md), in passes:
//! 1. [`PacketRays::new`] makes the rays of a [`PacketFrame`], in tiles.
//! 2. [`PacketRays::cast_pass`] takes every unfinished ray as far as resident bricks allow. A ray that needs a brick
//!    that is not resident keeps its place and the brick's key; the pass returns all such keys.
//! 3. The caller makes some of them resident and casts the next pass, until no ray waits.
//! 4. [`PacketRays::image`] makes the picture of the rays, at any time.
//!
//! The picture is the same, to the last bit, for any number of threads, any order of bricks, and with or without
//! skipping. The size of bricks changes it by less than is visible (docs/decisions/006-packets.md).
//!
//! In the order of the data:
//! - `frame`, `tables`, `rule`: a picture, and the tables that its packets look up;
//! - `plans`, `summaries`, `silhouette`, `per_brick`: data derived from bricks; `memory`: the bytes of all these;
//! - `rays` and `cast` (the tiles of a pass), `begin` (rays of a tile), `visit` and `order` (its bricks);
//! - `tile`, `places`, `noted`, `parts_ahead`, `parts`: rays of a tile; `levels`, `work`: notes on them; `pixels`;
//! - `blocks` and `leap` (invisible parts), `walk` (`trace` records its path for tests), `fetch`;
//! - in `dvr` `packet`, `chord`, `lookup`, `uneven` and `integrate` (one cell), `span` (several cells by one line); `shade`, `shaded_cells`
//!   and `turning` (light); `queue`, `pending` and `refine` (cells that need more than one part); `inner_surfaces`;
//! - with opacity by the gradient `modulated`, instead of these;
//! - in the other modes `value_tiles` (bricks), `values` (`mip`, `minip`, `mean`), `surfaces` (`iso`);
//! - `simd`: vectors of the instruction sets.

#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
mod begin;
pub mod blocks;
mod budget;
mod cast;
pub(crate) mod chord;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
pub(crate) mod fetch;
pub mod frame;
pub(crate) mod highlight;
mod inner_surfaces;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
pub(crate) mod integrate;
#[cfg(test)]
mod integrate_bounds;
pub mod leap;
mod levels;
#[cfg(test)]
mod light_bounds;
pub(crate) mod lookup;
mod memory;
mod modulated;
mod noted;
mod order;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
mod packet;
mod parts;
mod parts_ahead;
mod pending;
mod per_brick;
mod pixels;
mod places;
pub mod plans;
mod queue;
pub mod rays;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
mod refine;
mod rule;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
pub(crate) mod shade;
mod shaded_cells;
mod silhouette;
pub mod simd;
mod span;
mod summaries;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
mod surfaces;
pub(crate) mod tables;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
mod tile;
pub mod trace;
pub(crate) mod turn;
mod turning;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
pub(crate) mod uneven;
mod value_tiles;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
mod values;
mod visit;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
pub(crate) mod walk;
mod work;

pub use frame::PacketFrame;
pub use memory::bytes_held;
pub use plans::{BrickPlans, Made};
pub use rays::PacketRays;
pub use rule::PacketRule;
