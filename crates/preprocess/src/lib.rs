//! Offline half of Supervol: one volume file in, one `.svol` container out, in bounded memory.
//!
//! # Data path of a build
//!
//! [`build`] takes the voxels of a source through five steps. Each step is a folder of [`pipeline`]:
//!
//! ```text
//! source (supervol_sources)                                                          container (.svol)
//!    |                                                                                    ^
//!    v                                                                                    |
//!  plan ----------> read ----------> reduce -------------> encode -------------> record --+
//!  samples, levels, one tile ahead,  coarser voxels,       bricks with apron,    writes bricks in tile order,
//!  memory, tiles,   from the source  their distance from   cut and compressed    journal, statistics, manifest
//!  error step       or from bricks   the finer voxels      on all threads
//!                      ^                                                            |
//!                      +---- finer level, read back if it did not fit in memory ----+
//! ```
//!
//! The plan is made once. The other steps run for each tile of each level, from the finest level to the coarsest.
//!
//! # Other modules
//!
//! | module | task |
//! |---|---|
//! | [`preview`] | a small container of a large source, for a first look |
//! | [`kept`] | containers built for a picture and kept for the next one |
//! | [`batch`], [`naming`] | many inputs, one folder of containers |
//! | [`verify`], [`compare`] | a container checked rule by rule; a container compared with its source or another one |
//! | [`gradients`] | lengths of the gradient, for a choice of opacity by the gradient |
//! | [`level_reader`] | boxes of a level, decoded by all threads |
//! | [`provenance`], [`statistics`], [`report`], [`error`] | types and functions that the modules above share |
//!
//! # Promises
//!
//! - Memory is limited to a number of bytes, which the caller gives ([`memory`]).
//! - The same input and options give the same bytes with any number of threads.
//! - Nothing here touches a GPU.

#![cfg_attr(
    test,
    allow(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_sign_loss,
        reason = "tests use small numbers"
    )
)]

pub mod batch;
pub mod compare;
pub mod error;
pub mod gradients;
pub mod kept;
pub mod level_reader;
pub mod naming;
pub mod pipeline;
pub mod preview;
pub mod provenance;
pub mod report;
pub mod statistics;
pub mod verify;

pub use supervol_files::Existing;

pub use error::BuildError;
pub use pipeline::build;
pub use pipeline::options::BuildOptions;
pub use pipeline::plan::max_error::MaxError;
pub use pipeline::plan::{lod_axes, memory};
pub use pipeline::record::{journal, manifest};
pub use pipeline::reduce::downsample;
pub use provenance::{identify, identify_source};
