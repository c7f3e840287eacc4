//! Online half of Supervol: bricks are streamed into memory, engines draw them, and a renderer drives both.
//!
//! In the order of the data path; each module knows only those above it:
//! - [`stop`]: stop condition: a deadline or a cancel request;
//! - [`lod`]: level-of-detail rules: how fine a brick must be, by its size on screen and by its error;
//! - [`stream`]: which bricks are wanted, how they are read and decoded, and where they are kept;
//! - [`engines`]: from resident bricks to an image, on the CPU and on the GPU;
//! - [`render`]: options, frames and the renderer; the only module that knows all the others.
//!
//! Engines open no file, wait for nothing, and never change what is resident.

#![allow(clippy::missing_panics_doc, reason = "panics are broken invariants of its own")]
#![cfg_attr(
    test,
    allow(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_sign_loss,
        reason = "tests use small numbers"
    )
)]

pub mod engines;
pub mod lod;
pub mod render;
pub mod stop;
pub mod stream;
