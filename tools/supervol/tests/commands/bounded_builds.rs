//! `build --codec wavelet` and `build --max-error`: voxels come back exactly or within the bound, and all commands
//! state the bound.

use crate::support;
use support::{Folder, json};

const DIMS: usize = 40;

/// A smooth field with some noise, f32.
fn field() -> Vec<f32> {
    let noise = |i: usize| (i.wrapping_mul(2_654_435_761) >> 7 & 0xff) as f32 / 256.0;
    let value = |i: usize| {
        let [x, y, z] = [i % DIMS, i / DIMS % DIMS, i / (DIMS * DIMS)].map(|v| v as f32 / 7.0);
        1000.0 * (x.sin() + (y + 0.3 * z).cos()) + 4.0 * noise(i)
    };
    (0..DIMS.pow(3)).map(value).collect()
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

#[test]
fn bounded_builds_keep_the_bound_and_say_it() {
    let folder = Folder::new();
    let exact = field();
    let bytes: Vec<u8> = exact.iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(folder.path("a.raw"), &bytes).expect("room for a small file");
    let build = |more: &[&str]| {
        let build =
            ["build", "a.raw", "--dims", "40,40,40", "--dtype", "f32", "--brick", "16", "-o", "a.svol", "--force"];
        folder.expect(0, &[&build[..], more].concat())
    };
    let info = || json(&folder.expect(0, &["info", "a.svol", "--json"]));

    build(&["--codec", "wavelet"]);
    assert_eq!((&info()["max_error"], &info()["format_version"]), (&0.0.into(), &4.into()));
    let lossless = info()["container_bytes"].as_u64().expect("a size");

    let said = build(&["--codec", "wavelet", "--max-error", "0.5"]);
    assert!(said.contains("within 0.5 of the source's"), "{said}");
    folder.expect(0, &["verify", "a.svol"]);
    let found = info();
    assert_eq!((&found["max_error"], &found["format_version"]), (&0.5.into(), &4.into()));
    assert_eq!(found["parameters"]["max_error"], "0.5");
    assert!(found["levels"][0]["error"].as_f64().is_some_and(|e| 0.4 < e && e <= 0.5), "{}", found["levels"][0]);
    assert!(found["container_bytes"].as_u64().is_some_and(|bytes| bytes < lossless / 2), "{found}");
    assert!(folder.expect(0, &["info", "a.svol"]).contains("voxels within 0.5"));
    folder.expect(0, &["extract", "a.svol", "-o", "b.raw"]);
    let moved = floats(&std::fs::read(folder.path("b.raw")).expect("extract wrote it"));
    let farthest = exact.iter().zip(&moved).map(|(a, b)| (a - b).abs()).fold(0.0f32, f32::max);
    assert!(0.4 < farthest && farthest <= 0.5, "{farthest}");

    // The picture says that it is not the source's.
    folder.expect(
        0,
        &[
            "render",
            "a.svol",
            "-o",
            "a.png",
            "--size",
            "32x32",
            "--backend",
            "cpu",
            "--level",
            "0",
            "--stats",
            "a.json",
        ],
    );
    let stats = json(&std::fs::read_to_string(folder.path("a.json")).expect("render wrote it"));
    assert!(stats["error_stated"]["levels_grey_levels"].as_f64().is_some_and(|e| e > 0.0), "{stats}");

    // A percentage is one of the range of all voxels, and nothing else than that many units.
    let range = found["value_range"].as_array().expect("a range").iter().map(|v| v.as_f64().expect("a number"));
    let width = range.fold([f64::MAX, f64::MIN], |[a, b], v| [a.min(v), b.max(v)]);
    build(&["--max-error", "1%"]);
    let percent = info()["max_error"].as_f64().expect("a number");
    let asked = (width[1] - width[0]) * 0.01;
    assert!(percent <= asked * 1.001 && percent > asked * 0.93, "{percent} of {asked}");
}

#[test]
fn verify_compares_with_the_source() {
    let folder = Folder::new();
    let mut values = field();
    let write = |name: &str, values: &[f32]| {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        std::fs::write(folder.path(name), bytes).expect("room for a small file");
    };
    write("a.raw", &values);
    // One voxel that is further off than any bound here.
    values[7 + DIMS * (9 + DIMS * 31)] += 3.0;
    write("b.raw", &values);
    let raw = ["--dims", "40,40,40", "--dtype", "f32"];
    for (error, said) in [("0", "64000 voxels of level 0 are equal to the source's"), ("0.5", "(0.5 allowed)")] {
        folder.expect(
            0,
            &[&["build", "a.raw", "--brick=16", "-o", "a.svol", "--force", "--max-error", error], &raw[..]].concat(),
        );
        let whole = folder.expect(0, &[&["verify", "a.svol", "--deep", "--source", "a.raw"], &raw[..]].concat());
        assert!(whole.contains("every rule holds") && whole.contains(said), "{whole}");
        let wrong = folder.expect(1, &[&["verify", "a.svol", "--source", "b.raw"], &raw[..]].concat());
        assert!(wrong.contains("voxel [7, 9, 31] against its source"), "{wrong}");
    }
    // A source that is none, and options without a source.
    folder.expect(2, &[&["verify", "a.svol", "--source", "none.raw"], &raw[..]].concat());
    folder.expect(1, &["verify", "a.svol", "--source", "a.raw", "--dims", "40,40,40", "--dtype", "i32"]);
    folder.expect(2, &[&["verify", "a.svol"], &raw[..]].concat());
    folder.expect(2, &[&["verify", "a.svol", "a.svol", "--source", "a.raw"], &raw[..]].concat());
    folder.expect(0, &["verify", "--deep", "a.svol"]);
}
