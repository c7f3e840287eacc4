//! Bytes of source voxels per second of a whole build: pyramid, ranges, error bounds, checksums, file.

#![allow(missing_docs, reason = "a bench has no callers")]

use divan::Bencher;
use divan::counter::BytesCount;
use supervol_format::container::manifest::Source;
use supervol_format::{Dims, VoxelType};
use supervol_preprocess::source::synthetic::Synthetic;
use supervol_preprocess::{BuildOptions, Existing, build};

#[divan::bench(args = ["seismic", "vessels"], sample_count = 5, sample_size = 1)]
fn build_256(bencher: Bencher<'_, '_>, name: &str) {
    let dims = Dims([256; 3]);
    let source = Synthetic::new(name, dims, Some(VoxelType::U8), 1).expect("a known volume");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = folder.path().join("bench.svol");
    let options = BuildOptions { memory_bytes: 256 << 20, existing: Existing::Replace, ..BuildOptions::default() };
    let bytes = dims.bytes(VoxelType::U8).expect("256^3 fits");
    bencher.counter(BytesCount::new(bytes)).bench_local(|| {
        let origin = Source::computed(name);
        build(&source, origin, &output, &options, &|_| ()).expect("a temporary folder has room")
    });
}

fn main() {
    divan::main();
}
