//! Library of the tests and fuzz targets. The tests themselves are in `tests/tests`: `contracts` and `drawn` (pictures),
//! one file per contract, and the single files `dependencies.rs` and `memory_budget.rs`.
//!
//! - [`fields`]: volumes computed from coordinates, and containers built from them;
//! - [`counting`]: an allocator that counts;
//! - [`faults`]: byte sources and volumes that fail, end early, or count;
//! - [`formats`]: the result of reading every real file, as a table;
//! - [`forge`]: containers that break one rule and have correct checksums;
//! - [`oracle`]: ranges and interpolation from the definitions, without the code of the crates;
//! - [`pictures`]: containers of small volumes, their pictures, and distances between pictures;
//! - [`stability`]: one regime of the stability suite, at its smallest size;
//! - [`fuzz_bodies`], [`fuzz_small`]: bodies of the fuzz targets, called by libFuzzer and by a seeded test;
//! - [`fuzz_journal`]: the fuzz body for files of a killed build;
//! - [`fuzz_seeds`]: valid files for the fuzz targets.
//!
//! All randomness is seeded ([`supervol_format::random`]). A test that cannot run on this machine reports it with
//! [`skipped`].

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    clippy::missing_panics_doc,
    missing_debug_implementations,
    reason = "a library of tests: numbers are small, and what is wrong panics"
)]

pub mod counting;
pub mod faults;
pub mod fields;
pub mod forge;
#[cfg(feature = "pictures")]
pub mod formats;
pub mod fuzz_bodies;
pub mod fuzz_journal;
pub mod fuzz_seeds;
pub mod fuzz_small;
pub mod oracle;
#[cfg(feature = "pictures")]
pub mod pictures;
#[cfg(feature = "pictures")]
pub mod stability;

/// Prints that a test did not run, in words that `tools/ci.sh` searches for.
#[allow(clippy::print_stderr, reason = "a skipped test must be seen")]
pub fn skipped(why: &str) {
    eprintln!("SKIPPED: {why}");
}
