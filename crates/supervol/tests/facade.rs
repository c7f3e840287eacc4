//! The front door: wrong input is an error, failures are told, and pictures are those of the layers below.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "tests use small numbers"
)]
#![allow(clippy::unwrap_used, reason = "tests fail loudly")]
#![cfg(all(feature = "images", feature = "sources"))]

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::Duration;

use supervol::{
    ArraySource, Backend, BrickKey, BuildOptions, CheckProgress, Error, ErrorKind, LevelChoice, Lod, Options, Picture,
    ProofOptions, RenderError, Scene, Volume, VoxelBox,
};
use tempfile::TempDir;

const DIMS: [u64; 3] = [72, 60, 40];

/// Bits that look like noise, the same everywhere.
fn noise(number: u64) -> u8 {
    (number.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 58) as u8
}

/// A folder with a container of 72 x 60 x 40 bytes, in bricks of 16.
fn container() -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.svol");
    let [nx, ny, nz] = DIMS;
    let voxels: Vec<u8> = (0..nx * ny * nz).map(|n| (n % nx + n / nx % ny) as u8 + noise(n)).collect();
    let source = ArraySource::new(DIMS, voxels).unwrap();
    let layout = supervol::format::BrickLayout::new(16).unwrap();
    supervol::build_source(&source, "ramp", &path, &BuildOptions { layout, ..BuildOptions::default() }, &|_| {})
        .unwrap();
    (folder, path)
}

fn small(json: &str) -> Scene {
    let mut scene = Scene::from_json(json).unwrap();
    (scene.image.width, scene.image.height) = (60, 45);
    scene
}

fn bits(picture: &Picture) -> Vec<[u32; 4]> {
    picture.image().pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect()
}

/// Overwrites the records of some bricks of level 0 with zeros.
fn damage(path: &Path, count: usize) {
    let volume = Volume::open(path).unwrap();
    let container = volume.container();
    let mut bytes = std::fs::read(path).unwrap();
    for key in container.pyramid().keys_of(Lod::FINEST).take(count) {
        let entry = container.entry(key).unwrap();
        bytes[entry.offset as usize..][..entry.record_bytes() as usize].fill(0);
    }
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn wrong_options_scenes_and_boxes_are_errors() {
    let (_folder, path) = container();
    let volume = Volume::open(&path).unwrap();
    let scene = small("{}");
    for max_error in [f64::NAN, -1.0, f64::NEG_INFINITY] {
        let options = Options { max_error, ..Options::default() };
        let error = volume.draw(&scene, &options).unwrap_err();
        assert!(error.kind() == ErrorKind::Request && error.to_string().contains("max_error"), "{error}");
        assert!(volume.renderer(options).is_err());
    }
    assert!(volume.renderer(Options { threads: Some(0), ..Options::default() }).is_err());
    let wrong = Scene { vertical_exaggeration: Some(f64::NAN), ..scene.clone() };
    assert!(matches!(volume.draw(&wrong, &Options::default()), Err(Error::Scene(_))));

    let mut renderer = volume.renderer(Options::default()).unwrap();
    let nothing = renderer.advance(None).unwrap_err();
    assert!(nothing.kind() == ErrorKind::Request && nothing.to_string().contains("scene"), "{nothing}");
    assert!(renderer.pick([0, 0]).is_err() && renderer.picture().is_none());
    assert!(renderer.set_scene(&wrong).is_err());

    assert!(matches!(volume.read(9, VoxelBox { start: [0; 3], end: [1; 3] }), Err(Error::Level { level: 9, .. })));
    let beyond = VoxelBox { start: [0; 3], end: [73, 1, 1] };
    assert!(matches!(volume.read(0, beyond), Err(Error::Box { .. })));
    let missing = Volume::open("no such.svol").unwrap_err();
    assert_eq!(missing.kind(), ErrorKind::Request, "{missing}");
}

#[test]
fn damaged_bricks_are_counted_by_steps_and_pictures() {
    let (_folder, path) = container();
    damage(&path, 20);
    let volume = Volume::open(&path).unwrap();
    let options = Options { level: LevelChoice::Fixed(Lod::FINEST), ..Options::default() };
    let scene = small(r#"{"mode": "mip", "transfer_function": "grey"}"#);
    let picture = volume.draw(&scene, &options).unwrap();
    assert!(!picture.is_converged() && picture.failed_bricks() == 20, "{picture:?}");
    assert!(picture.failures()[0].reason.contains("checksum"), "{:?}", picture.failures());

    let mut renderer = volume.renderer(options).unwrap();
    renderer.set_scene(&scene).unwrap();
    let step = renderer.advance(None).unwrap();
    assert!(step.is_finished && !step.is_converged() && step.bricks_failed == 20, "{step:?}");
    assert!(!renderer.picture().unwrap().is_converged());
    let expected: Vec<BrickKey> = volume.container().pyramid().keys_of(Lod::FINEST).take(20).collect();
    assert_eq!(renderer.bricks_failed(100), expected);
    assert_eq!(renderer.bricks_failed(3), expected[..3]);
    let there = renderer.bricks_in_memory(usize::MAX);
    assert!(!there.is_empty() && there.is_sorted() && expected.iter().all(|key| !there.contains(key)));
    assert_eq!(renderer.bricks_in_memory(2), there[..2]);
}

#[test]
fn a_screen_gets_the_image_and_the_numbers_of_the_picture() {
    let (_folder, path) = container();
    let options = Options { backend: Backend::Cpu, predict_error: true, ..Options::default() };
    let mut renderer = Volume::open(&path).unwrap().renderer(options).unwrap();
    assert!(renderer.image().is_none() && renderer.resolved().is_none());
    assert!(renderer.bricks_failed(9).is_empty() && renderer.bricks_in_memory(9).is_empty());
    let scene = small("{}");
    renderer.set_scene(&scene).unwrap();
    let step = renderer.advance_for(Duration::ZERO).unwrap();
    let early = renderer.stats();
    assert!(!step.is_finished && early.pixels_unfinished > 0 && early.error_stated.is_none(), "{early:?}");
    renderer.advance(None).unwrap();
    let picture = renderer.picture().unwrap();
    assert!(picture.error_stated().is_some() && renderer.stats().error_stated.as_ref() == picture.error_stated());
    assert!(renderer.image().unwrap().pixels == picture.image().pixels);
    assert_eq!(renderer.resolved(), Some(picture.resolved()));
    // An equal scene keeps the picture. Another one and other options begin anew.
    renderer.set_scene(&scene).unwrap();
    assert!(renderer.stats().error_stated.is_some());
    renderer.set_scene(&small(r#"{"mode": "mip"}"#)).unwrap();
    assert!(renderer.stats().error_stated.is_none() && renderer.image().is_none());
    renderer.set_options(Options { predict_error: false, ..renderer.options().clone() }).unwrap();
    renderer.advance(None).unwrap();
    assert!(renderer.stats().error_stated.is_none() && renderer.picture().unwrap().error_map().is_none());
}

#[test]
fn checks_and_proofs_tell_how_far_they_are() {
    let (folder, path) = container();
    let volume = Volume::open(&path).unwrap();
    let options = Options { predict_error: true, ..Options::default() };
    let scene = small(r#"{"samples_per_pixel": 1}"#);
    volume.check_fits(&scene, &options).unwrap();
    let picture = volume.draw(&scene, &options).unwrap();
    let last = Mutex::new((0, 0));
    let note = |progress: CheckProgress| {
        let mut last = last.lock().unwrap();
        *last = (last.0.max(progress.pixels_done), progress.pixels);
    };
    assert_eq!(picture.check_telling(50, &note).unwrap().pixels, 50);
    assert_eq!(*last.lock().unwrap(), (50, 50));
    let file = folder.path().join("p.png");
    picture.save(&file).unwrap();
    *last.lock().unwrap() = (0, 0);
    let options = ProofOptions { pixels: 70, ..ProofOptions::default() };
    let proof = volume.prove_telling(&file, &options, &note).unwrap();
    assert!(proof.holds() && *last.lock().unwrap() == (70, 70), "{proof:?} {last:?}");
    // A level of 72 x 60 x 40 numbers of 8 bytes does not fit.
    let small_memory = Options { host_memory_bytes: 1 << 20, ..Options::default() };
    let error = volume.check_fits(&scene, &small_memory).unwrap_err();
    assert!(matches!(error, Error::Render(RenderError::CheckTooLarge { level: 0, .. })), "{error}");
}

#[test]
fn a_renderer_comes_to_the_picture_that_is_drawn_at_once() {
    let (_folder, path) = container();
    let volume = Volume::open(&path).unwrap();
    let mut renderer = volume.renderer(Options::default()).unwrap();
    for json in ["{}", r#"{"vertical_exaggeration": 3}"#, r#"{"mode": "mip"}"#, r#"{"vertical_exaggeration": 3}"#] {
        let scene = small(json);
        renderer.set_scene(&scene).unwrap();
        while !renderer.advance_for(Duration::from_millis(2)).unwrap().is_finished {}
        let expected = volume.draw(&scene, &Options::default()).unwrap();
        let found = renderer.picture().unwrap();
        assert!(found.is_converged() && bits(&found) == bits(&expected), "{json}");
    }
    let [plain, high] =
        ["{}", r#"{"vertical_exaggeration": 3}"#].map(|json| volume.draw(&small(json), &Options::default()).unwrap());
    assert_ne!(bits(&plain), bits(&high), "heights are drawn larger");
}

#[test]
fn boxes_hold_the_voxels_that_were_built() {
    let (_folder, path) = container();
    let volume = Volume::open(&path).unwrap();
    let voxels = VoxelBox { start: [3, 50, 17], end: [70, 60, 39] };
    let array = volume.read(0, voxels).unwrap();
    assert_eq!((array.shape(), array.values().len()), ([67, 10, 22], 67 * 10 * 22));
    for place in [[0, 0, 0], [66, 9, 21], [5, 3, 8]] {
        let [x, y, z] = std::array::from_fn(|a| voxels.start[a] + place[a] as u64);
        let number = x + DIMS[0] * (y + DIMS[1] * z);
        let expected = (number % DIMS[0] + number / DIMS[0] % DIMS[1]) as u8 + noise(number);
        assert_eq!(array.get(place), Some(f64::from(expected)), "{place:?}");
    }
    assert_eq!(array.get([67, 0, 0]), None);
}
