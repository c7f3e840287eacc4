//! Rate, distortion and speed of the codecs on the bricks of real volumes:
//! `cargo bench -p supervol-benches --bench rates -- A.svol B.svol ...` prints a table.
//!
//! Of each container, which must hold the source's own voxels, up to [`BRICKS`] bricks of level 0 are looked at, evenly
//! spaced among those of more than one value. Voxels are moved to multiples of a step for each of [`SHARES`] of the
//! volume's range, as `build --max-error` does, and encoded by each codec. Bits are per voxel that is stored, aprons
//! included; speeds are bytes of voxels per second of processor time on one thread, the best of [`ROUNDS`] rounds over all
//! bricks.

#![allow(missing_docs, clippy::print_stdout, reason = "a bench has no callers, and prints what it found")]

use std::path::Path;

use rustix::time::{ClockId, clock_gettime};
use supervol_format::codec::quantize::Quantizer;
use supervol_format::codec::{Codec, CodecChoice, Coding, decode_into, encode};
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{BrickKey, Container, Lod, ValueRange};

const BRICKS: usize = 64;
const ROUNDS: usize = 5;
/// Greatest errors, as shares of the volume's range.
const SHARES: [f64; 4] = [0.0, 1e-4, 1e-3, 1e-2];
const CODECS: [CodecChoice; 4] = [
    CodecChoice::Only(Codec::Rle),
    CodecChoice::Only(Codec::Zstd),
    CodecChoice::Only(Codec::Wavelet),
    CodecChoice::Smallest,
];

/// A brick as it is in the source.
struct Brick {
    key: BrickKey,
    voxels: Vec<u8>,
}

fn cpu_seconds() -> f64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
}

/// The least time that a round over all bricks takes.
fn best_of_rounds(mut round: impl FnMut()) -> f64 {
    let times = (0..ROUNDS).map(|_| {
        let begun = cpu_seconds();
        round();
        cpu_seconds() - begun
    });
    times.fold(f64::INFINITY, f64::min)
}

fn bricks_of(container: &Container) -> Vec<Brick> {
    let entry = |key| container.entry(key).expect("a whole container");
    let of_more_than_one_value = |key: &BrickKey| entry(*key).codec != Codec::Uniform;
    let keys: Vec<_> = container.pyramid().keys_of(Lod::FINEST).filter(of_more_than_one_value).collect();
    let read =
        |&key: &BrickKey| Brick { key, voxels: container.read_brick(key, &entry(key)).expect("a whole container") };
    keys.iter().step_by(keys.len().div_ceil(BRICKS).max(1)).map(read).collect()
}

fn range_of(container: &Container, bricks: &[Brick]) -> ValueRange {
    let entries = bricks.iter().map(|brick| container.entry(brick.key).expect("a whole container").range);
    entries.fold(ValueRange::EMPTY, ValueRange::union)
}

/// Greatest error and mean square error of moved voxels.
fn distortion(container: &Container, exact: &[Brick], moved: &[Brick]) -> (f64, f64) {
    let descriptor = container.descriptor();
    let (mut greatest, mut squares, mut count) = (0.0f64, 0.0, 0.0f64);
    for (exact, moved) in exact.iter().zip(moved) {
        let [exact, moved] = [exact, moved].map(|brick| voxels_as_f64(descriptor.voxel_type, &brick.voxels));
        for (a, b) in exact.into_iter().zip(moved).filter(|(a, _)| !descriptor.absence.is_absent(*a)) {
            greatest = greatest.max((a - b).abs());
            squares += (a - b) * (a - b);
            count += 1.0;
        }
    }
    (greatest, squares / count.max(1.0))
}

fn measure(path: &Path) {
    let container = Container::open(path).expect("a container");
    let descriptor = container.descriptor();
    assert!(descriptor.quantizer.is_none(), "{}: its voxels have been moved already", path.display());
    let exact = bricks_of(&container);
    let width = range_of(&container, &exact).width();
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let bytes: usize = exact.iter().map(|brick| brick.voxels.len()).sum();
    for share in SHARES {
        let quantizer = Quantizer::within(descriptor.voxel_type, share * width);
        if share > 0.0 && quantizer.is_none() {
            continue;
        }
        let moved_one = |brick: &Brick| {
            let mut voxels = brick.voxels.clone();
            let _ = quantizer.map(|q| q.snap(descriptor.voxel_type, descriptor.absence, &mut voxels));
            Brick { key: brick.key, voxels }
        };
        let moved: Vec<Brick> = exact.iter().map(moved_one).collect();
        let (greatest, mean_square) = distortion(&container, &exact, &moved);
        let psnr =
            if mean_square > 0.0 { format!("{:.1}", 10.0 * (width * width / mean_square).log10()) } else { "-".into() };
        for choice in CODECS {
            let coding = Coding { choice, absence: descriptor.absence, quantizer };
            let code =
                |brick: &Brick| encode(coding, container.shape(brick.key), &brick.voxels).expect("there is memory");
            let payloads: Vec<(Codec, Vec<u8>)> = moved.iter().map(code).collect();
            let encode_s = best_of_rounds(|| moved.iter().for_each(|brick| drop(std::hint::black_box(code(brick)))));
            let mut out = Vec::new();
            let decode_s = best_of_rounds(|| {
                for (brick, (codec, payload)) in moved.iter().zip(&payloads) {
                    out.resize(brick.voxels.len(), 0);
                    decode_into(*codec, container.shape(brick.key), payload, &mut out)
                        .expect("what was encoded decodes");
                }
            });
            let payload_bytes: usize = payloads.iter().map(|(_, payload)| payload.len()).sum();
            let bits = payload_bytes as f64 * 8.0 / (bytes / descriptor.voxel_type.bytes()) as f64;
            let codec = match choice {
                CodecChoice::Only(codec) => codec.name(),
                CodecChoice::Smallest => "auto",
            };
            println!(
                "| {name} {} | {share} | {greatest:.4} | {psnr} | {codec} | {bits:.3} | {:.0} | {:.0} |",
                descriptor.voxel_type,
                bytes as f64 / decode_s / 1e6,
                bytes as f64 / encode_s / 1e6,
            );
        }
    }
}

fn main() {
    println!(
        "| data | error asked, share of range | greatest error | PSNR, dB | codec | bit/voxel | decode, MB/s | encode, MB/s |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    // Cargo hands benches an option of its own.
    let containers = std::env::args_os().skip(1).filter(|argument| !argument.to_string_lossy().starts_with("--"));
    containers.for_each(|path| measure(Path::new(&path)));
}
