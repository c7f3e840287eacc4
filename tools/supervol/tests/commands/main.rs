//! The command line as a user runs it.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "tests use small numbers"
)]
#![allow(clippy::unwrap_used, reason = "tests fail loudly")]

mod batch;
mod bounded_builds;
mod cache;
mod command_line;
mod coordinates;
mod defaults;
mod every_option;
mod failed_bricks;
mod full_disk;
mod inputs;
mod library;
mod looks;
mod machine;
mod proofs;
mod resumed_builds;
mod sequences;
mod slices;
mod solids;
mod support;
mod users_data;
mod values;
