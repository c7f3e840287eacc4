//! Volume files behind one trait: where voxels come from.
//!
//! A source knows its grid, its voxel type and its place in the world, and hands out any box of voxels. Voxels are
//! handed out little endian and packed, x fastest, whatever the file's own order is; nothing is rescaled (scale and
//! offset travel as metadata). A reader checks every length against the file before it allocates, and answers a wrong
//! file with what was expected, what was found, and where: never a panic.
//!
//! `read_box` may be called from several threads at once, and for boxes in any order; [`AccessOrder`] says which order
//! the file likes.

pub mod computed;
mod endian;
mod error;
pub mod formats;
pub mod grid;
mod info;
pub mod input;
pub mod open;
mod source;
pub mod stop;
mod survey;
pub mod synthetic;

pub use crate::endian::Endian;
pub use crate::error::SourceError;
pub use crate::info::{AccessOrder, Axis, SourceInfo};
pub use crate::source::VolumeSource;
pub use crate::survey::{LineNumbers, Survey};
