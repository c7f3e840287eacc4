//! Offline half of Supervol: one volume file in, one `.svol` container out, in bounded memory.
//!
//! The data path, left to right: [`source`] (one reader per file format) -> bricks -> container.

pub mod source;
