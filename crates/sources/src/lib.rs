//! Readers of volume files behind one trait, [`VolumeSource`].
//!
//! A source knows its grid, its voxel type and its placement in the world, and reads any box of voxels. Voxels are
//! little endian and packed, x fastest, in any order of the file. Values are not rescaled; scale and offset are
//! metadata. A reader checks every length against the file before it allocates. For a wrong file it returns an error
//! with what was expected, what was found, and where. It never panics.
//!
//! Several threads may call `read_box` at once, for boxes in any order. [`AccessOrder`] tells the cheapest order.
//!
//! Errors and notes name options of this crate, never those of a program.
//!
//! - [`mod@open`]: opens any file or folder with the reader that recognizes it;
//! - [`formats`]: the readers, one module per file format, and the table of all formats;
//! - [`input`]: access to input files, shared by the readers: selection, spool file, folders, start of a file;
//! - [`grid`]: dense and chunked grids of voxels, on which readers are built;
//! - [`synthetic`], [`computed`]: volumes computed from coordinates;
//! - [`message`]: messages that name options; [`stop`]: the end of long reads.

#![cfg_attr(
    test,
    allow(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_sign_loss,
        reason = "tests use small numbers"
    )
)]

mod cast;
pub mod computed;
mod endian;
mod error;
pub mod formats;
pub mod grid;
mod info;
pub mod input;
pub mod message;
pub mod open;
mod source;
pub mod stop;
pub mod synthetic;

pub use supervol_format::survey::{LineNumbers, Survey};

pub use crate::endian::Endian;
pub use crate::error::{Part, PartName, SourceError};
pub use crate::info::{AccessOrder, Axis, SourceInfo};
pub use crate::message::{Message, ReadOption};
pub use crate::source::VolumeSource;
