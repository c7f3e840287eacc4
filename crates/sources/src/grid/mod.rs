//! Grids of voxels that several formats share.
//!
//! - [`dense`]: one dense grid in one or several files, or in a spool file once it is decoded;
//! - `absent`: numbers that mean "no data";
//! - `chunked`: grids stored in chunks (Zarr, N5, HDF5);
//! - `elements`: the numbers of a grid: channels, frames, bits, 64-bit integers, half-precision floats;
//! - `layout`: shape, type and order of the voxels of a grid in a file;
//! - `header_data`: a dense grid in the data files that a header names;
//! - `mirrored`: axes that are read in reverse;
//! - [`named`]: a source whose notes name options as a program does;
//! - [`nulls`]: usual nulls of files that declare no absent value;
//! - [`placed`]: a source with another place in the world;
//! - `stored`: a source without the scale, offset, unit and absent value of its file.

pub(crate) mod absent;
pub(crate) mod chunked;
pub mod dense;
pub(crate) mod elements;
pub(crate) mod header_data;
pub mod layout;
pub(crate) mod mirrored;
pub mod named;
pub mod nulls;
pub mod placed;
pub(crate) mod stored;
