//! What tests and fuzz targets share. The tests themselves stand in `tests/*.rs`, one file per contract.
//!
//! - [`fields`]: volumes computed from coordinates, and what they become when built;
//! - [`faults`]: byte sources and volumes that fail, end early, or count;
//! - [`formats`]: the fate of every real file, as a table;
//! - [`forge`]: containers with one thing wrong and all checksums right;
//! - [`oracle`]: ranges and interpolation straight from the definitions, sharing no code with the crates;
//! - [`pictures`]: containers of small volumes, their pictures, and distances between these;
//! - [`stability`]: one regime of the stability suite, at its smallest size;
//! - [`fuzz_bodies`]: what a fuzz target does with its bytes, callable from libFuzzer and from a seeded test; [`fuzz_seeds`]: a valid
//!   file for each.
//!
//! All randomness is seeded ([`Random`]). A test that cannot run on this machine says so by [`skipped`].

pub mod faults;
pub mod fields;
pub mod forge;
pub mod formats;
pub mod fuzz_bodies;
pub mod fuzz_seeds;
pub mod oracle;
#[cfg(feature = "pictures")]
pub mod pictures;
#[cfg(feature = "pictures")]
pub mod stability;

/// A small generator with a fixed sequence per seed (splitmix64; Steele, Lea, Flood 2014).
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// The sequence of this seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next 64 bits.
    pub fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.0)
    }

    /// Uniform in `0..n`, for n far below 2^64.
    ///
    /// # Panics
    /// If `n` is 0.
    pub fn below(&mut self, n: u64) -> u64 {
        assert!(n > 0, "nothing is below 0");
        self.next_u64() % n
    }

    /// Uniform in `[0, 1)`.
    pub fn unit(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// The finaliser of splitmix64: a hash of 64 bits.
#[must_use]
pub fn mix(z: u64) -> u64 {
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Says loudly that a test did not run, in words that `tools/ci.sh` looks for.
#[allow(clippy::print_stderr, reason = "a skipped test must be seen")]
pub fn skipped(why: &str) {
    eprintln!("SKIPPED: {why}");
}
