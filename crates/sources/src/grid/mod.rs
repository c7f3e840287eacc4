//! Grids of voxels that several formats share.
//!
//! - [`dense`]: one dense grid in one or several files, or in a spool file once it is decoded;
//! - `chunked`: grids stored in chunks (Zarr, N5, HDF5);
//! - `elements`: the numbers of a grid: channels, frames, bits, 64-bit integers, half-precision floats;
//! - `layout`: shape, type and order of the voxels of a grid in a file;
//! - `header_data`: a dense grid in the data files that a header names;
//! - [`named`]: a source whose notes name options as a program does;
//! - [`placed`]: a source with another place in the world.

pub(crate) mod chunked;
pub mod dense;
pub(crate) mod elements;
pub(crate) mod header_data;
pub mod layout;
pub mod named;
pub mod placed;
