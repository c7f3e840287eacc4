//! Bricks that cannot be read: what is drawn is told to be wrong, by message, statistics and exit code.

use std::fs;

use supervol_format::{BrickKey, Container, Lod};

use crate::support;
use support::{Folder, json};

/// A container of noise, in bricks of 16.
fn folder() -> Folder {
    let folder = Folder::new();
    let voxels: Vec<u8> = (0u32..40 * 40 * 40).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    fs::write(folder.path("v.raw"), voxels).expect("a file");
    folder.expect(0, &["build", "v.raw", "--dims", "40,40,40", "--dtype", "u8", "--brick", "16", "-o", "v.svol"]);
    folder
}

/// Overwrites the records of bricks with zeros.
fn damage(folder: &Folder, is_bad: impl Fn(BrickKey) -> bool) -> usize {
    let path = folder.path("v.svol");
    let container = Container::open(path.as_ref()).expect("a container");
    let mut bytes = fs::read(&path).expect("its bytes");
    let pyramid = container.pyramid();
    let keys = (0..pyramid.brick_count()).filter_map(|entry| pyramid.key(entry)).filter(|&key| is_bad(key));
    let mut damaged = 0;
    for key in keys {
        let entry = container.entry(key).expect("an entry");
        let start = entry.offset as usize;
        bytes[start..start + entry.record_bytes() as usize].fill(0);
        damaged += 1;
    }
    fs::write(path, bytes).expect("a file");
    damaged
}

const RENDER: [&str; 8] = ["render", "v.svol", "-o", "v.png", "--backend", "cpu", "--level", "0"];

#[test]
fn some_bricks_that_fail_are_exit_code_1_after_what_there_is_is_written() {
    let folder = folder();
    let damaged = damage(&folder, |key| key.lod() == Lod::FINEST && key.brick().0 == [1, 1, 2]);
    assert_eq!(damaged, 1);
    let error = folder.expect(1, &[&RENDER[..], &["--stats", "s.json"]].concat());
    assert!(error.contains("1 brick could not be read") && error.contains("--allow-failed"), "{error}");
    assert!(fs::metadata(folder.path("v.png")).is_ok_and(|file| file.len() > 100), "what there is is written");
    let stats = json(&fs::read_to_string(folder.path("s.json")).expect("statistics"));
    assert_eq!((&stats["converged"], &stats["bricks_failed"]), (&false.into(), &1.into()), "{stats}");
    assert!(stats["error_bound"].as_f64().is_some_and(|bound| bound >= 250.0), "the width of all values: {stats}");
    let told = folder.expect(0, &[&RENDER[..], &["--allow-failed"]].concat());
    assert!(told.contains("not converged") && told.contains("(1, 1, 2)"), "{told}");
}

#[test]
fn no_picture_is_made_of_nothing() {
    let folder = folder();
    damage(&folder, |_| true);
    for allowed in [&[][..], &["--allow-failed"]] {
        let error = folder.expect(1, &[&RENDER[..], allowed].concat());
        assert!(error.contains("no picture is written"), "{error}");
        assert!(!fs::exists(folder.path("v.png")).expect("a folder"), "{error}");
        // Nor of slices side by side, nor by a camera that moves.
        let slices = ["--slice", "k=3", "--slice", "i=20"];
        let error = folder.expect(1, &[&RENDER[..], &slices, allowed].concat());
        assert!(error.contains("no picture is written"), "{error}");
        assert!(!fs::exists(folder.path("v.png")).expect("a folder"), "{error}");
        let turn = ["render", "v.svol", "-o", "f", "--backend", "cpu", "--level", "0", "--turntable", "2"];
        let error = folder.expect(1, &[&turn[..], allowed].concat());
        assert!(error.contains("no picture is written"), "{error}");
        assert!(!fs::exists(folder.path("f/frame-00000.png")).expect("a folder"), "{error}");
    }
}
