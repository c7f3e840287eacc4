//! What tests and fuzz targets share. The tests themselves stand in `tests/*.rs`, one file per contract.
//!
//! - [`fields`]: volumes computed from coordinates, and what they become when built;
//! - [`counting`]: an allocator that counts;
//! - [`faults`]: byte sources and volumes that fail, end early, or count;
//! - [`formats`]: the fate of every real file, as a table;
//! - [`forge`]: containers with one thing wrong and all checksums right;
//! - [`oracle`]: ranges and interpolation straight from the definitions, sharing no code with the crates;
//! - [`pictures`]: containers of small volumes, their pictures, and distances between these;
//! - [`stability`]: one regime of the stability suite, at its smallest size;
//! - [`fuzz_bodies`]: what a fuzz target does with its bytes, callable from libFuzzer and from a seeded test; [`fuzz_seeds`]: a valid
//!   file for each; [`fuzz_journal`]: the body of what a killed build leaves, which needs a build.
//!
//! All randomness is seeded ([`supervol_format::random`]). A test that cannot run on this machine says so by [`skipped`].

pub mod counting;
pub mod faults;
pub mod fields;
pub mod forge;
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

/// Says loudly that a test did not run, in words that `tools/ci.sh` looks for.
#[allow(clippy::print_stderr, reason = "a skipped test must be seen")]
pub fn skipped(why: &str) {
    eprintln!("SKIPPED: {why}");
}
