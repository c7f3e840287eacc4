//! Pictures compared with the reference, across backends, scenes, levels and errors; and known issues.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "tests use small numbers"
)]
#![allow(clippy::unwrap_used, reason = "tests fail loudly")]

mod error_stated;
mod fuzz_seeds;
mod known_issues;
mod levels_by_error;
mod pictures_agree;
mod random_scenes;
mod rounded_values;
mod stability;
mod transfer_files;
