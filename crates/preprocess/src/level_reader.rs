//! Levels of a container that are read by all threads there are: each decodes a brick.
//!
//! Where a thread of the pool reads for itself, it decodes alone ([`LevelReader::new`]): a thread that waits for others would begin
//! with whatever else there is to do, and hold the bytes of both.

use rayon::prelude::*;
use supervol_format::Lod;
use supervol_format::level_reader::{BrickStore, Decoding, LevelReader};

/// A reader whose boxes are decoded by all threads of the pool that asks for them.
#[must_use]
pub fn by_all_threads(store: &dyn BrickStore, lod: Lod, budget_bytes: usize) -> LevelReader<'_> {
    LevelReader::new(store, lod, budget_bytes).decoding(Decoding {
        at_once: rayon::current_num_threads,
        decode: |keys, brick| keys.par_iter().map(|&key| brick(key)).collect(),
    })
}
