//! Grids of voxels that several formats share.
//!
//! - [`dense`]: one dense grid in one or several files, or in a spool file once it is decoded;
//! - `chunked`: grids stored in chunks (Zarr, N5, HDF5);
//! - `elements`: the numbers of a grid: channels, frames, bits, 64-bit integers, half-precision floats;
//! - [`placed`]: a source with another place in the world.

pub(crate) mod chunked;
pub mod dense;
pub(crate) mod elements;
pub mod placed;
