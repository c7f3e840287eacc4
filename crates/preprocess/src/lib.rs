//! Offline half of Supervol: one volume file in, one `.svol` container out, in bounded memory.
//!
//! The data path: `supervol_sources` (readers) -> [`bricker`] (tiles, bricks with apron) -> [`downsample`] (coarser
//! voxels) and [`error_bound`] (their distance from the finer ones) -> [`pipeline`] (encoding and ordered writing).
//! `next_level` keeps coarser voxels in memory where there is room. [`verify`] checks a container rule by rule.
//!
//! Nothing here touches a GPU. The caller gives a memory limit in bytes ([`memory`]). The same input and options give
//! the same bytes, whatever the number of threads.

pub mod batch;
pub mod bounded;
pub mod bricker;
pub mod compare;
pub mod downsample;
pub mod error;
pub mod error_bound;
pub mod journal;
pub mod kept;
pub mod labels;
pub mod level_reader;
pub mod lod_axes;
pub mod memory;
pub mod naming;
mod next_level;
mod ordered;
pub mod pipeline;
pub mod preview;
pub mod provenance;
pub mod report;
mod restore;
mod slabs;
pub mod statistics;
pub mod verify;

pub use supervol_files::Existing;

pub use bounded::MaxError;
pub use error::BuildError;
pub use pipeline::{BuildOptions, build};
pub use provenance::{identify, identify_source};
