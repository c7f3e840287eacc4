//! Continuation of killed builds, and comparison of containers with their sources.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "tests use small numbers"
)]
#![allow(clippy::unwrap_used, reason = "tests fail loudly")]

mod compare_source;
mod gradients;
mod resume;
