//! Reader for boxes of a container's level that decodes bricks on all threads of the pool.
//!
//! A thread of the pool that reads for itself must decode alone ([`LevelReader::new`]). If it waited for others, it
//! would start another task and hold the memory of both.

use rayon::prelude::*;
use supervol_format::Lod;
use supervol_format::level_reader::{BrickStore, Decoding, LevelReader};

/// A reader whose bricks are decoded by all threads of the calling pool.
#[must_use]
pub fn by_all_threads(store: &dyn BrickStore, lod: Lod, budget_bytes: usize) -> LevelReader<'_> {
    LevelReader::new(store, lod, budget_bytes).decoding(Decoding {
        at_once: rayon::current_num_threads,
        decode: |keys, brick| keys.par_iter().map(|&key| brick(key)).collect(),
    })
}
