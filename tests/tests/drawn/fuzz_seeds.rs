//! Every fuzz body on its valid inputs and on seeded mutations of them, for machines without libFuzzer. The libFuzzer
//! targets are in `fuzz/`.

use std::num::NonZero;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::available_parallelism;

use supervol_format::random::Random;
use supervol_tests::fuzz_bodies;

/// Mutations per target.
const ROUNDS: u64 = 4000;
const SEED: u64 = 20_260_101;

/// One mutation: a mode byte with edits, a damaged copy of the valid input, or noise.
fn mutated(valid: &[u8], random: &mut Random) -> Vec<u8> {
    let edits =
        |random: &mut Random| -> Vec<u8> { (0..6 * (1 + random.below(6))).map(|_| random.next_u64() as u8).collect() };
    match random.below(8) {
        0 => (0..random.below(600)).map(|_| random.next_u64() as u8).collect(),
        1 | 2 => fuzz_bodies::apply_edits(valid, &edits(random)),
        // Bits above the lowest one choose the kind of file in bodies with several kinds. In container and journal, one
        // of them requests corrected checksums.
        6 => [vec![3], edits(random)].concat(),
        _ => [vec![random.below(64) as u8 * 2 + 1], edits(random)].concat(),
    }
}

fn run(name: &str) {
    let (_, body, valid) = fuzz_bodies::all().into_iter().find(|(n, ..)| *n == name).expect("the body is listed");
    valid.iter().for_each(|input| body(input));
    body(&[]);
    let (next, bad) = (AtomicU64::new(0), AtomicU64::new(ROUNDS));
    let work = || {
        loop {
            let round = next.fetch_add(1, Ordering::Relaxed);
            if round >= bad.load(Ordering::Relaxed) {
                return;
            }
            let random = &mut Random::new(SEED ^ round << 20);
            let input = mutated(&valid[random.below(valid.len() as u64) as usize], random);
            if catch_unwind(AssertUnwindSafe(|| body(&input))).is_err() {
                bad.fetch_min(round, Ordering::Relaxed);
            }
        }
    };
    // Plain threads, no thread pool: a body that waits for its own pool would start other bodies on the waiting thread.
    std::thread::scope(|scope| {
        (0..available_parallelism().map_or(1, NonZero::get)).for_each(|_| drop(scope.spawn(work)))
    });
    assert_eq!(bad.into_inner(), ROUNDS, "{name}: this round of seed {SEED} panics");
}

#[test]
fn container() {
    run("container");
}

#[test]
fn journal() {
    run("journal");
}

#[test]
fn codec_raw() {
    run("codec_raw");
}

#[test]
fn codec_rle() {
    run("codec_rle");
}

#[test]
fn codec_zstd() {
    run("codec_zstd");
}

#[test]
fn codec_wavelet() {
    run("codec_wavelet");
}

#[test]
fn codec_tree() {
    run("codec_tree");
}

#[test]
fn codec_trimmed() {
    run("codec_trimmed");
}

#[test]
fn segy() {
    run("segy");
}

#[test]
fn nrrd() {
    run("nrrd");
}

#[test]
fn metaimage() {
    run("metaimage");
}

#[test]
fn nifti() {
    run("nifti");
}

#[test]
fn npy() {
    run("npy");
}

#[test]
fn dicom() {
    run("dicom");
}

#[test]
fn dicom_frames() {
    run("dicom_frames");
}

#[test]
fn tiff() {
    run("tiff");
}

#[test]
fn vti() {
    run("vti");
}

#[test]
fn vtk() {
    run("vtk");
}

/// The valid inputs must be valid; otherwise their mutations test little.
#[test]
fn valid_inputs_are_accepted() {
    use supervol_sources::formats::segy::{SegyOptions, SegySource};
    let file = fuzz_bodies::segy_seed();
    SegySource::from_bytes(Box::new(file), "seed.sgy".as_ref(), &SegyOptions::default()).expect("the seed is valid");
    let folder = tempfile::tempdir().expect("a folder");
    let files = [
        ("seed.nrrd", fuzz_bodies::nrrd_seed()),
        ("seed.mha", fuzz_bodies::metaimage_seed()),
        ("seed.nii", fuzz_bodies::nifti_seed()),
        ("seed.npy", fuzz_bodies::npy_seed()),
        ("seed.dcm", fuzz_bodies::dicom_seed()),
        ("frames.dcm", fuzz_bodies::dicom_frames_seed()),
        ("seed.tif", fuzz_bodies::tiff_seed()),
        ("seed.vti", fuzz_bodies::vti_seed()),
        ("seed.vtk", fuzz_bodies::vtk_seed()),
    ];
    let (name, bytes) = fuzz_bodies::VIEWER_DATA;
    std::fs::write(folder.path().join(name), bytes).expect("a small file");
    let small = fuzz_bodies::small_volumes().into_iter().map(|(name, bytes)| (name, bytes.to_vec()));
    for (name, bytes) in files.into_iter().chain(small) {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("a small file");
        supervol_sources::open::open(&path, &Default::default()).unwrap_or_else(|e| panic!("{e}"));
    }
}

#[cfg(feature = "pictures")]
#[test]
fn valid_files_of_scenes_are_accepted() {
    use supervol_scene::clip::mesh_file;
    use supervol_scene::preset::transfer_file::TransferFile;

    let folder = tempfile::tempdir().expect("a folder");
    for (name, bytes) in fuzz_bodies::small_scene_files() {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("a small file");
        if name.ends_with(".1dt") || name.ends_with(".json") {
            TransferFile::read(&path).unwrap_or_else(|e| panic!("{e}"));
        } else {
            mesh_file::read(&path).unwrap_or_else(|e| panic!("{e}"));
        }
    }
}

#[test]
fn zarr() {
    run("zarr");
}

#[test]
fn zarr3() {
    run("zarr3");
}

#[test]
fn n5() {
    run("n5");
}

#[test]
fn hdf5() {
    run("hdf5");
}

#[test]
fn archives() {
    run("archives");
}

#[test]
fn slices() {
    run("slices");
}

#[test]
fn viewer_xml() {
    run("viewer_xml");
}

#[cfg(feature = "pictures")]
#[test]
fn scene_files() {
    run("scene_files");
}
