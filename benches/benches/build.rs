//! Throughput of a whole build in bytes of source voxels per second: pyramid, ranges, error bounds, checksums, file.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "it measures small numbers"
)]
#![allow(missing_docs, reason = "a bench has no callers")]

use std::fs::File;
use std::io::{BufWriter, Write};

use divan::Bencher;
use divan::counter::BytesCount;
use supervol_format::canceller::Canceller;
use supervol_format::container::manifest::Source;
use supervol_format::{Dims, Geometry, VoxelType};
use supervol_preprocess::preview::Preview;
use supervol_preprocess::{BuildOptions, Existing, build};
use supervol_sources::Endian;
use supervol_sources::formats::raw::{RawOptions, RawSource};
use supervol_sources::synthetic::Synthetic;

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

/// The preview of the viewer, from the page cache: 1024 x 1024 x 512 bytes, of which every 4th slice is read.
#[divan::bench(sample_count = 5, sample_size = 1)]
fn preview_of_half_a_gigabyte(bencher: Bencher<'_, '_>) {
    let dims = Dims([1024, 1024, 512]);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("bench.raw");
    let slice = |z: u64| -> Vec<u8> { (0..1 << 20u64).map(|i| ((i >> 5) ^ (i & 1023) ^ z) as u8).collect() };
    let mut file = BufWriter::new(File::create(&path).expect("a temporary folder can be written to"));
    (0..512).for_each(|z| file.write_all(&slice(z)).expect("a temporary folder has room for 512 MiB"));
    drop(file);
    let options = RawOptions {
        dims,
        voxel_type: VoxelType::U8,
        endian: Endian::Little,
        header_bytes: 0,
        geometry: Geometry::IDENTITY,
        nodata: None,
    };
    let source = RawSource::open(&path, &options).expect("the file has just been written");
    bencher.bench_local(|| {
        let preview = Preview::of(&source, folder.path(), &Canceller::default()).expect("a preview");
        assert_eq!(preview.expect("the volume is large").strides, [4, 8, 4]);
    });
}

fn main() {
    divan::main();
}
