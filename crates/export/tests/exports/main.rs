//! Exported files, read again.

#![allow(clippy::unwrap_used, reason = "tests fail loudly")]
#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "tests use small numbers"
)]

#[path = "../../../sources/tests/readers/grid_support/mod.rs"]
mod grid_support;

mod extract_files;
mod mesh_files;

#[global_allocator]
static RECORDING: grid_support::largest_allocation::Recording = grid_support::largest_allocation::Recording;
