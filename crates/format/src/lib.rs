//! The contract that Supervol's preprocessor and runtime share.
//!
//! Axis order: x runs fastest in memory, then y, then z. Every array of three is `[x, y, z]`.
//! Voxel (i, j, k) is a sample at the index point (i, j, k) and owns the box `[i-1/2, i+1/2] x ...`.
//! LOD 0 is the source grid. Each coarser level halves some axes: coarse voxel c covers fine voxels 2c and 2c+1. On a
//! halved axis the index point p of the coarse grid is therefore the fine point `2p + 1/2` ([`space`]).
//!
//! The modules, in the order in which data meets them:
//! - [`voxel_type`]: the eight voxel types and how their bytes are read;
//! - [`space`]: boxes, dims, and the transform between index and world space;
//! - [`brick`], [`brick_key`], [`pyramid`]: which brick holds which voxels at which level;
//! - [`value_range`]: least and greatest present value;
//! - [`macro_cells`]: value ranges of cubes of 8^3 voxels in a brick; [`cell_errors`]: their error bounds;
//! - [`codec`]: encoding of brick voxels to bytes, and decoding;
//! - [`container`]: the `.svol` file, byte by byte;
//! - [`survey`]: line numbers and map positions of a seismic survey;
//! - [`coordinates`]: numbers by which a user names places of a volume;
//! - [`level_reader`]: boxes of voxels of one level, assembled from its bricks;
//! - [`file_order`]: a box of voxels cut into pieces in the order of a plain file;
//! - [`cast`]: integer conversions that are lossless on 64-bit targets;
//! - [`byte_source`]: positional reads of a container's bytes;
//! - [`readable`]: formatting of numbers in messages and listings;
//! - [`recent`]: a cache that forgets the least recently used value;
//! - [`vectors`]: loops over voxels, compiled a second time for wide vectors;
//! - [`canceller`]: a flag that stops long work from another thread;
//! - [`random`]: random numbers that are the same on every machine, for synthetic volumes and tests.
//!
//! This crate knows no GPU, starts no thread and prints nothing. It holds at most one brick besides those that a caller
//! hands to it or tells it to keep. It compiles for 64-bit targets only.

#![allow(
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    clippy::missing_panics_doc,
    reason = "codecs take the bits of a number as another type, and assert their own invariants"
)]
#![cfg_attr(test, allow(clippy::cast_possible_truncation, reason = "tests use small numbers"))]

pub mod brick;
pub mod brick_key;
pub mod byte_source;
pub mod canceller;
pub mod cast;
pub mod cell_errors;
pub mod codec;
pub mod container;
pub mod coordinates;
pub mod file_order;
pub mod level_reader;
pub mod macro_cells;
pub mod pyramid;
pub mod random;
pub mod readable;
pub mod recent;
pub mod space;
pub mod survey;
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

const _: () =
    assert!(usize::BITS >= 64, "only 64-bit targets are supported: offsets in containers are indices in memory");
