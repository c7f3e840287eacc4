//! The contract that Supervol's preprocessor and runtime share.
//!
//! Axis order: x runs fastest in memory, then y, then z; every array of three is `[x, y, z]`.
//! Voxel (i, j, k) is a sample at the index point (i, j, k) and owns the cell `[i-1/2, i+1/2] x ...`.
//! LOD 0 is the source grid; each coarser level halves some axes: coarse voxel c covers fine voxels 2c and 2c+1,
//! so that the index point p of the coarse grid is the fine point `2p + 1/2` on a halved axis ([`space`]).
//!
//! One page of what is here, in the order in which data meets it:
//! - [`voxel_type`]: the eight voxel types and how their bytes are read;
//! - [`space`]: boxes, dims, and the transform between index and world space;
//! - [`brick`], [`brick_key`], [`pyramid`]: which brick holds which voxels at which level;
//! - [`value_range`]: least and greatest present value;
//! - [`codec`]: brick voxels to bytes and back;
//! - [`container`]: the `.svol` file, byte by byte;
//! - [`level_reader`]: boxes of voxels of a level, out of its bricks;
//! - [`file_order`]: a box of voxels in pieces that follow one another in a plain file;
//! - [`byte_source`]: where a container's bytes are read from;
//! - [`readable`]: numbers in messages and listings;
//! - [`recent`]: things kept because they may be wanted again;
//! - [`vectors`]: loops over voxels, compiled once more for wide vectors;
//! - [`canceller`]: long work that somebody stops;
//! - [`random`]: numbers that are the same everywhere, for what is made and tested by chance.
//!
//! This crate knows no GPU, starts no thread, prints nothing, and holds no more than one brick that it was not handed or told to
//! keep.

pub mod brick;
pub mod brick_key;
pub mod byte_source;
pub mod canceller;
pub mod codec;
pub mod container;
pub mod file_order;
pub mod level_reader;
pub mod macro_cells;
pub mod pyramid;
pub mod random;
pub mod readable;
pub mod recent;
pub mod space;
pub mod value_range;
pub mod vectors;
pub mod voxel_type;

pub use brick::BrickLayout;
pub use brick_key::{BrickIndex, BrickKey, Lod};
pub use byte_source::ByteSource;
pub use container::reader::Container;
pub use pyramid::{Level, Pyramid};
pub use space::{Dims, Geometry, VoxelBox};
pub use value_range::ValueRange;
pub use voxel_type::VoxelType;
