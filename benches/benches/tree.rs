//! Sizes and speed of the tree codec on all bricks of containers, beside the payloads that the containers hold.
//! `cargo bench -p supervol-benches --bench tree -- [--every N] A.svol B.svol ...` prints a table. With `--every`, one brick
//! in N is measured.
//!
//! A brick of the coarsest level keeps its payload. Every other one is coded from the voxels of the next level, with the
//! part of its apron that lies in the grid, and without apron. Where another codec is smaller, that codec counts. Speeds are
//! bytes of voxels per second of one thread, the best of [`ROUNDS`] rounds for each brick.

#![allow(missing_docs, clippy::print_stdout, reason = "a bench has no callers, and prints what it found")]

use std::path::Path;
use std::time::Instant;

use supervol_format::codec::tree::{Coarser, decode_into, encode_if_smaller};
use supervol_format::codec::{BrickShape, CodecChoice, Coding, encode};
use supervol_format::level_reader::LevelReader;
use supervol_format::{BrickKey, Container, Lod, VoxelBox};

const ROUNDS: usize = 3;
/// Aprons in voxels: stored and derived ones.
const APRONS: [u64; 2] = [2, 0];
/// Decoded bricks that a reader keeps, in bytes.
const CACHE_BYTES: usize = 256 << 20;

/// Bytes and seconds of one way of coding.
#[derive(Debug, Clone, Copy, Default)]
struct Figures {
    /// Payloads of all bricks, and of those of level 0.
    payloads: [usize; 2],
    /// Bricks for which another codec is smaller.
    others: usize,
    voxels: usize,
    encoding_s: f64,
    decoding_s: f64,
}

impl Figures {
    fn add(&mut self, key: BrickKey, payload: usize) {
        self.payloads[0] += payload;
        self.payloads[1] += if key.lod() == Lod::FINEST { payload } else { 0 };
    }
}

/// The least seconds of some rounds, and the last result.
fn timed<T>(mut work: impl FnMut() -> T) -> (f64, T) {
    let mut once = || {
        let begun = Instant::now();
        let result = work();
        (begun.elapsed().as_secs_f64(), result)
    };
    let first = once();
    (1..ROUNDS).map(|_| once()).fold(first, |(best, _), (seconds, result)| (best.min(seconds), result))
}

/// The payload that a container holds for a brick.
fn held(container: &Container, key: BrickKey, figures: &mut Figures) -> Option<usize> {
    let entry = container.entry(key).expect("a whole container");
    let payload = Some(entry.payload_bytes as usize).filter(|&bytes| bytes > 0)?;
    let mut record = vec![0; usize::try_from(entry.record_bytes()).expect("a record fits the memory")];
    container.read_at(entry.offset, &mut record).expect("a whole container");
    let mut out = vec![0; container.shape(key).bytes()];
    let decode = || container.decode_brick(key, &entry, &record, &mut out).expect("a whole container");
    figures.decoding_s += timed(decode).0;
    figures.voxels += out.len();
    figures.add(key, payload);
    Some(payload)
}

/// A brick as details of the next level's voxels.
fn coded(container: &Container, levels: [&LevelReader<'_>; 2], key: BrickKey, apron: u64, figures: &mut Figures) {
    let descriptor = container.descriptor();
    let factors = descriptor.pyramid.level_at(Lod(key.lod().0 + 1)).factors;
    let (core, whole) = (descriptor.pyramid.core_box(key), levels[0].whole());
    let stored = VoxelBox { start: core.start.map(|v| v.saturating_sub(apron)), end: core.end.map(|v| v + apron) };
    let fine = stored.intersect(whole);
    let coarse = VoxelBox {
        start: std::array::from_fn(|a| fine.start[a] / u64::from(factors[a])),
        end: std::array::from_fn(|a| fine.end[a].div_ceil(u64::from(factors[a]))),
    };
    let [voxels, coarser] = [(levels[0], fine), (levels[1], coarse)].map(|(level, part)| {
        let mut bytes = vec![0; part.voxels() * descriptor.voxel_type.bytes()];
        level.read_box(part, &mut bytes).expect("a whole container");
        bytes
    });
    let shape = BrickShape { voxel_type: descriptor.voxel_type, extent: fine.extent() };
    let (absence, quantizer) = (descriptor.absence, descriptor.quantizer);
    let coarser = Coarser { voxels: &coarser, factors, absence };
    let coding = Coding { choice: CodecChoice::Smallest, absence, quantizer };
    let other = encode(coding, shape, &voxels).expect("encoding needs only memory").1.len();
    let encoded = || encode_if_smaller(shape, &voxels, coarser, quantizer, other).expect("encoding needs only memory");
    let (encoding_s, payload) = timed(encoded);
    let Some(payload) = payload else {
        figures.others += 1;
        return figures.add(key, other);
    };
    let mut out = vec![0; voxels.len()];
    let decode = || decode_into(shape, &payload, coarser, &mut out).expect("what was encoded decodes");
    figures.decoding_s += timed(decode).0;
    assert!(out == voxels, "{key} is not lossless");
    figures.encoding_s += encoding_s;
    figures.voxels += out.len();
    figures.add(key, payload.len());
}

fn measure(path: &Path, every: usize) {
    let container = Container::open(path).expect("a container");
    let pyramid = container.pyramid();
    let (mut today, mut trees, mut bricks) = (Figures::default(), [Figures::default(); 2], 0);
    for lod in pyramid.lods() {
        let reader = LevelReader::new(&container, lod, CACHE_BYTES);
        let next = (lod != pyramid.coarsest()).then(|| LevelReader::new(&container, Lod(lod.0 + 1), CACHE_BYTES));
        let has_payload = |key: &BrickKey| container.entry(*key).expect("a whole container").payload_bytes > 0;
        for key in pyramid.keys_of(lod).filter(has_payload) {
            bricks += 1;
            if bricks % every != 0 {
                continue;
            }
            let Some(payload) = held(&container, key, &mut today) else { continue };
            for (figures, apron) in trees.iter_mut().zip(APRONS) {
                match &next {
                    Some(next) => coded(&container, [&reader, next], key, apron, figures),
                    None => figures.add(key, payload),
                }
            }
        }
    }
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let speed = |figures: Figures, seconds: f64| figures.voxels as f64 / seconds / 1e6;
    let [bytes, finest] = today.payloads;
    for (tree, apron) in trees.into_iter().zip(APRONS) {
        let [all, level_0] = [(tree.payloads[0], bytes), (tree.payloads[1], finest)].map(|(a, b)| a as f64 / b as f64);
        println!(
            "| {name} | {apron} | {bytes} | {all:.3} | {level_0:.3} | {} of {bricks} | {:.0} | {:.0} | {:.0} |",
            tree.others,
            speed(today, today.decoding_s),
            speed(tree, tree.decoding_s),
            speed(tree, tree.encoding_s),
        );
    }
}

fn main() {
    println!(
        "| data | apron | bytes today | share | share, level 0 | other codec | decode today, MB/s | decode, MB/s | encode, MB/s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let mut arguments = std::env::args().skip(1);
    let mut every = 1;
    while let Some(argument) = arguments.next() {
        if argument == "--every" {
            every = arguments.next().and_then(|n| n.parse().ok()).filter(|n| *n > 0).expect("a number after --every");
        } else if !argument.starts_with("--") {
            // Cargo passes an option of its own to benches.
            measure(Path::new(&argument), every);
        }
    }
}
