//! Access to input files, shared by the readers.
//!
//! - [`mod@file`]: a file with its length and times, so that a change is noticed;
//! - [`folder`]: files of a folder in natural order;
//! - `data_files`: data files that a header names, and the rule which of them may be opened;
//! - `open_files`: a bounded set of open files;
//! - [`selection`]: the part of a file that the user chose (channel, frame, dataset);
//! - [`spool`]: a temporary file for decoded voxels;
//! - `start`: the first bytes and the name of a file, by which formats are recognized;
//! - `text`: numbers and lines of text headers;
//! - [`values`]: use of the attributes by which a file explains its numbers.

pub(crate) mod data_files;
pub mod file;
pub mod folder;
pub(crate) mod open_files;
pub mod selection;
pub mod spool;
pub mod start;
pub(crate) mod text;
pub mod values;
