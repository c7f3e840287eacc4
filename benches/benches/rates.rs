//! Rate, distortion and speed of the codecs on the bricks of real volumes. `cargo bench -p supervol-benches --bench
//! rates -- A.svol B.svol ...` prints a table. With `--bricks FOLDER`, the measured bricks (exact and quantised) and
//! the figures are written, too, for `tools/rates.py`.
//!
//! Containers must hold the source's own voxels. Up to [`BRICKS`] bricks of level 0 are measured per container, evenly
//! spaced among those that are not uniform. Voxels are quantised with an error of each of [`SHARES`] of the volume's
//! range, as `build --max-error` does, and encoded by each codec. Bits are per stored voxel, aprons included. Speeds
//! are bytes of voxels per second of processor time on one thread, the best of [`ROUNDS`] rounds over all bricks.
//!
//! Files in `FOLDER` for each `NAME.svol`:
//! - `NAME-SHARE.raw`: all bricks one after the other, x fastest, little-endian.
//! - `NAME.json`: voxel type, stored voxels of each brick along x, y, z with the apron, value range and nodata value.
//!   For each share: file of the quantised bricks, step, errors and the codecs' figures.

#![allow(missing_docs, clippy::print_stdout, reason = "a bench has no callers, and prints what it found")]

use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use supervol_format::Container;
use supervol_format::codec::quantize::Quantizer;
use supervol_format::codec::{Codec, CodecChoice, Coding};
use supervol_format::voxel_type::voxels_as_f64;
use supervol_measure::storage::codecs::{Brick, Figures, bricks_of, bytes_of, figures, moved};

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

/// Greatest error and mean square error of quantised voxels.
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

/// Writes bricks one after the other.
fn write_bricks(path: &Path, bricks: &[Brick]) {
    let voxels: Vec<&[u8]> = bricks.iter().map(|brick| brick.voxels.as_slice()).collect();
    std::fs::write(path, voxels.concat()).expect("room for bricks");
}

fn measure(path: &Path, folder: Option<&Path>) {
    let container = Container::open(path).expect("a container");
    let descriptor = container.descriptor();
    assert!(descriptor.quantizer.is_none(), "{}: its voxels have been moved already", path.display());
    let (exact, range) = bricks_of(&container, BRICKS).expect("a whole container");
    let width = range.width();
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let voxels = bytes_of(&exact) / descriptor.voxel_type.bytes();
    let mut errors: Vec<Value> = Vec::new();
    for share in SHARES {
        let quantizer = Quantizer::within(descriptor.voxel_type, share * width);
        if share > 0.0 && quantizer.is_none() {
            continue;
        }
        let moved = moved(&exact, descriptor.absence, quantizer);
        let (greatest, mean_square) = distortion(&container, &exact, &moved);
        let psnr = (mean_square > 0.0).then(|| 10.0 * (width * width / mean_square).log10());
        let coding = |choice| Coding { choice, absence: descriptor.absence, quantizer };
        let codecs: Vec<Figures> = CODECS.map(|choice| figures(&moved, coding(choice), ROUNDS)).into();
        for Figures { codec, bytes, decode_mb_s, encode_mb_s } in &codecs {
            let bits = *bytes as f64 * 8.0 / voxels as f64;
            let psnr = psnr.map_or("-".into(), |psnr| format!("{psnr:.1}"));
            let voxel_type = descriptor.voxel_type;
            println!(
                "| {name} {voxel_type} | {share} | {greatest:.4} | {psnr} | {codec} | {bits:.3} | {decode_mb_s:.0} | {encode_mb_s:.0} |"
            );
        }
        let Some(folder) = folder else { continue };
        let file = format!("{name}-{share}.raw");
        write_bricks(&folder.join(&file), &moved);
        let of_codec = |f: Figures| json!({ "codec": f.codec, "bytes": f.bytes, "decode_mb_s": f.decode_mb_s, "encode_mb_s": f.encode_mb_s });
        let codecs: Vec<Value> = codecs.into_iter().map(of_codec).collect();
        errors.push(json!({ "share": share, "asked": share * width, "step": quantizer.map(Quantizer::step), "found": greatest, "psnr": psnr, "file": file, "codecs": codecs }));
    }
    if let Some(folder) = folder {
        let extents: Vec<[usize; 3]> = exact.iter().map(|brick| brick.shape.extent).collect();
        let about = json!({
            "name": name, "type": descriptor.voxel_type.to_string(), "extents": extents, "range": [range.min, range.max],
            "nodata": descriptor.absence.nodata, "errors": errors,
        });
        std::fs::write(folder.join(format!("{name}.json")), format!("{about:#}\n")).expect("room for figures");
    }
}

fn main() {
    println!(
        "| data | error asked, share of range | greatest error | PSNR, dB | codec | bit/voxel | decode, MB/s | encode, MB/s |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    let mut arguments = std::env::args_os().skip(1);
    let (mut folder, mut containers) = (None, Vec::new());
    while let Some(argument) = arguments.next() {
        if argument == "--bricks" {
            folder = Some(PathBuf::from(arguments.next().expect("a folder after --bricks")));
        } else if !argument.to_string_lossy().starts_with("--") {
            // Cargo passes an option of its own to benches.
            containers.push(PathBuf::from(argument));
        }
    }
    folder.iter().for_each(|folder| std::fs::create_dir_all(folder).expect("a folder for bricks"));
    containers.iter().for_each(|path| measure(path, folder.as_deref()));
}
