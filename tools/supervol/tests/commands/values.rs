//! Values of every kind: statistics that resolve the data, and default pictures that no outlier decides.

use std::f32::consts::TAU;

use crate::support;
use support::{Folder, json};

/// Voxels along each edge.
const EDGE: usize = 24;

/// Smooth waves between -1 and 1.
fn wave(i: usize) -> f64 {
    let at = |n: usize, length: f64| (n as f64 / length).sin();
    (at(i % EDGE, 4.0) + at(7 + i / EDGE % EDGE, 5.0) + at(i / EDGE / EDGE, 6.0)) / 3.0
}

impl Folder {
    /// Builds `v.svol` from a raw file of these values.
    fn with_values(dtype: &str, values: &[f64]) -> Self {
        let folder = Self::new();
        let bytes: Vec<u8> = match dtype {
            "f32" => values.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect(),
            "i32" => values.iter().flat_map(|v| (*v as i32).to_le_bytes()).collect(),
            "u32" => values.iter().flat_map(|v| (*v as u32).to_le_bytes()).collect(),
            "i16" => values.iter().flat_map(|v| (*v as i16).to_le_bytes()).collect(),
            _ => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        };
        std::fs::write(folder.path("v.raw"), bytes).expect("room");
        let dims = format!("{EDGE},{EDGE},{EDGE}");
        folder.expect(0, &["build", "v.raw", "--dims", &dims, "--dtype", dtype, "-o", "v.svol"]);
        folder
    }

    fn info(&self) -> serde_json::Value {
        json(&self.expect(0, &["info", "v.svol", "--json"]))
    }

    /// Ends of the transfer function that these options give.
    fn window(&self, options: &[&str]) -> [f64; 2] {
        let scene = json(&self.expect(0, &[&["render", "v.svol", "--print-scene"], options].concat()));
        let points = scene.pointer("/transfer_function/points").and_then(|p| p.as_array()).expect("points");
        let value = |point: Option<&serde_json::Value>| point.and_then(|p| p["value"].as_f64()).expect("a value");
        [value(points.first()), value(points.last())]
    }
}

/// The value that `percent` of the values do not exceed.
fn exact(values: &[f64], percent: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[((values.len() as f64 * percent / 100.0).ceil() as usize).max(1) - 1]
}

#[test]
fn fields_far_from_zero_keep_their_percentiles_histogram_and_kind() {
    // Pressure, temperature, sound speed, density.
    for (offset, amplitude) in [(101_325.0, 200.0), (293.0, 15.0), (1500.0, 8.0), (1025.0, 4.0)] {
        for dtype in ["f32", "f64", "i32", "u32"] {
            let scale = if dtype.starts_with('f') { 1.0 } else { 100.0 };
            let values: Vec<f64> = (0..EDGE.pow(3)).map(|i| scale * (offset + amplitude * wave(i))).collect();
            let folder = Folder::with_values(dtype, &values);
            let info = folder.info();
            let kind = info["kind"].as_str().expect("a kind");
            assert!(!["mask", "labels", "constant"].contains(&kind), "{offset} {dtype}: {kind}");
            let range = exact(&values, 100.0) - exact(&values, 0.0);
            for pair in info["percentiles"].as_array().expect("percentiles") {
                let [percent, value] = [0, 1].map(|i| pair[i].as_f64().expect("a number"));
                // Integers are truncated.
                let room = range / 4096.0 + f64::from(!dtype.starts_with('f'));
                assert!((value - exact(&values, percent)).abs() <= room, "{offset} {dtype} {percent}: {value}");
            }
            let used = info["histogram"].as_array().expect("bins").iter().filter(|n| n.as_u64() != Some(0)).count();
            assert!(used > 200, "{offset} {dtype}: {used} of 256 bins");
            let [low, high] = folder.window(&["--clip-percent", "1"]);
            let removed = values.iter().filter(|v| **v < low || **v > high).count() as f64 / values.len() as f64;
            assert!((0.01..0.03).contains(&removed), "{offset} {dtype}: {removed} of the voxels are clipped");
        }
    }
}

#[test]
fn one_outlier_decides_neither_window_nor_kind_nor_slice() {
    let field: Vec<f64> = (0..EDGE.pow(3)).map(|i| 110.0 * wave(i)).collect();
    let usual = Folder::with_values("f32", &field);
    let kind = usual.info()["kind"].clone();
    let slice = ["--slice", "k=12"];
    for (dtype, far) in [("f32", 1e6), ("f32", -1e8), ("f32", 1e30), ("f64", 1e30), ("f64", -1e300), ("i16", 32_000.0)]
    {
        let mut values = field.clone();
        values[5000] = far;
        let folder = Folder::with_values(dtype, &values);
        let info = folder.info();
        assert!(dtype != "f32" || info["kind"] == kind, "{far}: {}", info["kind"]);
        for options in [&[][..], &slice] {
            let [low, high] = folder.window(options);
            assert!(low > -120.0 && high < 120.0 && high - low > 100.0, "{dtype} {far} {options:?}: {low} to {high}");
        }
        let note = info["notes"].to_string();
        assert!(note.contains("1 voxel of 13824 lies far from all others"), "{far}: {note}");
        let rows = folder.expect(0, &["histogram", "v.svol", "--rows", "8"]);
        let filled = rows.lines().skip(1).take(8).filter(|row| row.contains('#')).count();
        assert_eq!(filled, 8, "{far}\n{rows}");
        folder.expect(0, &["verify", "v.svol"]);
    }
}

#[test]
fn a_null_is_named_and_left_out_however_much_it_fills() {
    let angle = |i: usize| f64::from(TAU * i as f32 / 97.0);
    for null in [1e30, -9999.0, f64::from(f32::MAX)] {
        let value = |i: usize| if i % 5 < 3 { null } else { 3.0 + 2.0 * angle(i).sin() };
        let folder = Folder::with_values("f32", &(0..EDGE.pow(3)).map(value).collect::<Vec<_>>());
        // Usual nulls are absent, and a note says so.
        let info = folder.info();
        let max = info["value_range"][1].as_f64().expect("a value");
        assert!(max < 6.0 && info["value_range"][0].as_f64() > Some(0.0), "{null}: {info}");
        let note = info["notes"].to_string();
        assert!(note.contains("usual null") && note.contains("--keep-nulls"), "{null}: {note}");
        // Kept, they are named and left out of default colours.
        let kept =
            ["build", "v.raw", "--dims", "24,24,24", "--dtype", "f32", "--keep-nulls", "-o", "v.svol", "--force"];
        folder.expect(0, &kept);
        let [low, high] = folder.window(&[]);
        assert!(low >= 0.0 && high <= 6.0, "{null}: {low} to {high}");
        let note = folder.info()["notes"].to_string();
        assert!(note.contains("perhaps a null") && note.contains("(1.00026 to 4.99974)"), "{null}: {note}");
        // The option that the note names makes them absent.
        let told = folder.expect(0, &["info", "v.svol"]);
        let value = told.split("--nodata ").nth(1).and_then(|rest| rest.split(' ').next()).expect("an option");
        let raw = ["--dims", "24,24,24", "--dtype", "f32", "--nodata", value, "-o", "v.svol", "--force"];
        folder.expect(0, &[&["build", "v.raw"], &raw[..]].concat());
        let info = folder.info();
        let max = info["value_range"][1].as_f64().expect("a value");
        assert!(max < 6.0 && info["value_range"][0].as_f64() > Some(0.0), "{value}: {info}");
    }
}

/// Labels of cubes of 6 voxels, with numbers by `number`.
fn cubes(number: impl Fn(usize) -> u32) -> Vec<f64> {
    let cube = |i: usize| i % EDGE / 6 + i / EDGE % EDGE / 6 * 4 + i / EDGE / EDGE / 6 * 16;
    (0..EDGE.pow(3)).map(|i| f64::from(number(cube(i)))).collect()
}

/// A sparse number of 31 bits.
fn sparse(cube: usize) -> u32 {
    (cube as u32 + 1).wrapping_mul(2_654_435_761) >> 1
}

impl Folder {
    /// The voxels of a level, in little endian.
    fn level(&self, level: &str) -> Vec<u32> {
        self.expect(0, &["extract", "v.svol", "--level", level, "-o", "v.npy", "--force"]);
        let bytes = std::fs::read(self.path("v.npy")).expect("extract wrote it");
        let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        bytes[header..].chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
    }

    /// The different colours of a picture, besides the background.
    fn colors(&self, options: &[&str]) -> std::collections::BTreeSet<[u8; 3]> {
        let output = self.path("p.npy");
        let size = ["--size", "120x120", "--backend", "cpu", "--force"];
        self.expect(0, &[&["render", "v.svol", "-o", &output], &size[..], options].concat());
        let bytes = std::fs::read(&output).expect("render wrote it");
        let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        let floats: Vec<f32> =
            bytes[header..].chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        let shown = floats.chunks_exact(4).filter(|pixel| pixel[3] > 0.0);
        shown.map(|pixel| [0, 1, 2].map(|c| (pixel[c] * 255.0).round() as u8)).collect()
    }
}

#[test]
fn labels_with_sparse_numbers_are_labels_everywhere() {
    let values = cubes(sparse);
    let folder = Folder::new();
    let bytes: Vec<u8> = values.iter().flat_map(|v| (*v as u32).to_le_bytes()).collect();
    std::fs::write(folder.path("v.raw"), bytes).expect("room");
    let build = ["build", "v.raw", "--dims", "24,24,24", "--dtype", "u32", "-o", "v.svol", "--force", "--brick", "16"];
    folder.expect(0, &[&build, &["--max-error", "0.1%"][..]].concat());
    let info = folder.info();
    assert_eq!(info["kind"], "labels", "{}", info["kind_because"]);
    assert_eq!((&info["parameters"]["reduce"], &info["max_error"]), (&"majority".into(), &0.0.into()));
    assert_eq!(info["distinct_values"], 64);
    // No level holds a number that level 0 does not have, and level 0 is unchanged.
    let ids: std::collections::BTreeSet<u32> = values.iter().map(|v| *v as u32).collect();
    assert_eq!(folder.level("0"), values.iter().map(|v| *v as u32).collect::<Vec<_>>());
    assert!(folder.level("1").iter().all(|id| ids.contains(id)));
    // A slice meets 16 cubes, and shows 16 colours and no others.
    for slice in ["k=3", "i=9", "j=20"] {
        assert_eq!(folder.colors(&["--slice", slice]).len(), 16, "{slice}");
    }
    folder.expect(0, &["verify", "v.svol"]);
    // Told that they are measured values, they are averaged, and `info` says so, too.
    folder.expect(0, &[&build, &["--kind", "generic"][..]].concat());
    let info = folder.info();
    assert_eq!((&info["kind"], &info["parameters"]["reduce"]), (&"generic".into(), &"mean".into()));
}

#[test]
fn a_kind_that_is_named_at_the_build_is_kept() {
    let folder = Folder::new();
    let values = cubes(|cube| cube as u32 % 2 * 300);
    std::fs::write(folder.path("v.raw"), values.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect::<Vec<u8>>())
        .expect("room");
    let build = ["build", "v.raw", "--dims", "24,24,24", "--dtype", "f32", "-o", "v.svol", "--force"];
    folder.expect(0, &build);
    assert_eq!(folder.info()["kind"], "mask");
    folder.expect(0, &[&build, &["--kind", "labels", "--max-error", "5%"][..]].concat());
    let info = folder.info();
    assert_eq!((&info["kind"], &info["parameters"]["reduce"]), (&"labels".into(), &"majority".into()));
    assert_eq!(info["max_error"], 0.0);
    assert_eq!(folder.colors(&["--slice", "k=3"]).len(), 1, "label 0 is clear");
    let refused = folder.expect(2, &[&build, &["--kind", "jpeg"][..]].concat());
    assert!(refused.contains("jpeg") && refused.contains("labels"), "{refused}");
}

#[test]
fn more_labels_than_fit_a_volume_are_shown_on_slices() {
    let number = |i: usize| sparse(i % EDGE / 3 + i / EDGE % EDGE / 3 * 8 + i / EDGE / EDGE / 3 * 64);
    let values: Vec<f64> = (0..EDGE.pow(3)).map(|i| f64::from(number(i))).collect();
    let folder = Folder::with_values("u32", &values);
    assert_eq!(folder.info()["kind"], "labels");
    // Three planes of 64 labels each; lines where planes meet belong to both.
    let colors = folder.colors(&[]);
    assert!((100..=192).contains(&colors.len()), "{}", colors.len());
    let scene = json(&folder.expect(0, &["render", "v.svol", "--print-scene"]));
    assert_eq!(scene["slices"].as_array().map(Vec::len), Some(3));
    assert!(scene["slices"].as_array().is_some_and(|slices| slices.iter().all(|slice| slice["labels"] == true)));
}
