//! The command line and the library draw the same pictures, bit for bit.

use std::fs;

use supervol::{DataKind, Options, Scene, Volume};

use crate::support::Folder;

const SIZE: &str = "96x72";
const SAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/carp_ct.nii.gz");

/// The picture that the library draws, as the bytes of its NumPy file.
fn by_library(folder: &Folder, volume: &Volume, json: &str) -> Vec<u8> {
    let mut scene = Scene::from_json(json).expect("a scene");
    (scene.image.width, scene.image.height) = (96, 72);
    let picture = volume.draw(&scene, &Options::default()).expect("a picture");
    picture.save(folder.path("library.npy")).expect("a file");
    fs::read(folder.path("library.npy")).expect("its bytes")
}

/// The picture of `supervol render`.
fn by_program(folder: &Folder, options: &[&str]) -> Vec<u8> {
    folder.expect(0, &[&["render", "v.svol", "-o", "program.npy", "--size", SIZE, "--force"], options].concat());
    fs::read(folder.path("program.npy")).expect("a picture")
}

#[test]
fn library_and_program_draw_the_same_bits() {
    let folder = Folder::new();
    folder.expect(0, &["build", SAMPLE, "-o", "v.svol"]);
    let volume = Volume::open(folder.path("v.svol")).expect("a container");
    assert!(by_library(&folder, &volume, "{}") == by_program(&folder, &[]), "the default picture");
    assert!(
        by_library(&folder, &volume, r#"{"vertical_exaggeration": 2}"#)
            == by_program(&folder, &["--vertical-exaggeration", "2"]),
        "heights twice as large"
    );
    let volume = volume.with_kind(DataKind::Generic);
    assert!(by_library(&folder, &volume, "{}") == by_program(&folder, &["--kind", "generic"]), "a kind that is given");

    let folder = Folder::new();
    folder.expect(0, &["synth", "seismic", "--dims", "64,48,40", "-o", "v.svol"]);
    let volume = Volume::open(folder.path("v.svol")).expect("a container");
    assert!(by_library(&folder, &volume, "{}") == by_program(&folder, &[]), "a survey");
    assert!(by_library(&folder, &volume, r#"{"mode": "mip"}"#) == by_program(&folder, &["--mode", "mip"]), "mode mip");
}
