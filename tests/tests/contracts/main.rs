//! Contracts of containers and builds, on generated, damaged, huge and real files.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "tests use small numbers"
)]
#![allow(clippy::unwrap_used, reason = "tests fail loudly")]

mod bounded_error;
mod bounded_work;
mod container_contract;
mod corruption;
mod failures;
#[cfg(feature = "pictures")]
mod formats;
mod fuzz_targets;
mod huge_files;
mod reductions;
mod reproducible;
mod rounded_means;
mod section_ratios;
mod users_data;
mod verify_finds;
