//! Throughput of codecs in bytes of decoded voxels per second and core, on one brick of the synthetic survey.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "it measures small numbers"
)]
#![allow(missing_docs, reason = "a bench has no callers")]

use divan::Bencher;
use divan::counter::BytesCount;
use supervol_format::codec::{BrickShape, Codec, CodecChoice, decode_into, decode_uniform, encode};
use supervol_format::{Dims, VoxelType};
use supervol_sources::VolumeSource;
use supervol_sources::synthetic::Synthetic;

const EXTENT: u64 = 68;
const TYPES: [VoxelType; 3] = [VoxelType::U8, VoxelType::I16, VoxelType::F32];
const CODECS: [Codec; 4] = [Codec::Raw, Codec::Rle, Codec::Zstd, Codec::Wavelet];

fn brick(voxel_type: VoxelType) -> (BrickShape, Vec<u8>) {
    let dims = Dims([EXTENT; 3]);
    let source = Synthetic::new("seismic", dims, Some(voxel_type), 1).expect("the survey takes every type");
    let shape = BrickShape { voxel_type, extent: [EXTENT as usize; 3] };
    let mut voxels = vec![0; shape.bytes()];
    source.read_box(dims.full_box(), &mut voxels).expect("a computed volume is always readable");
    (shape, voxels)
}

#[divan::bench(args = TYPES, consts = [0, 1, 2, 3])]
fn decode<const CODEC: usize>(bencher: Bencher<'_, '_>, voxel_type: &VoxelType) {
    let (shape, voxels) = brick(*voxel_type);
    let (codec, payload) =
        encode(CodecChoice::Only(CODECS[CODEC]), shape, &voxels).expect("encoding needs only memory");
    let mut out = vec![0; voxels.len()];
    bencher.counter(BytesCount::new(voxels.len())).bench_local(|| {
        decode_into(codec, shape, &payload, &mut out).expect("what was encoded decodes");
    });
}

#[divan::bench(args = TYPES)]
fn decode_one_value(bencher: Bencher<'_, '_>, voxel_type: &VoxelType) {
    let mut out = vec![0; EXTENT.pow(3) as usize * voxel_type.bytes()];
    bencher.counter(BytesCount::new(out.len())).bench_local(|| decode_uniform(*voxel_type, 0x1234_5678, &mut out));
}

#[divan::bench(args = TYPES)]
fn encode_smallest(bencher: Bencher<'_, '_>, voxel_type: &VoxelType) {
    let (shape, voxels) = brick(*voxel_type);
    bencher
        .counter(BytesCount::new(voxels.len()))
        .bench_local(|| encode(CodecChoice::Smallest, shape, &voxels).expect("encoding needs only memory"));
}

fn main() {
    divan::main();
}
