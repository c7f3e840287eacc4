//! Coordinates of a volume: options, read-outs, voxel boxes and meshes use the same numbers.

use std::path::{Path, PathBuf};

use crate::support;
use support::{Folder, json};

/// A real file, if it is there.
fn data(name: &str) -> Option<PathBuf> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data").join(name);
    file.exists().then_some(file)
}

impl Folder {
    /// Builds `v.svol` from a real file; whether the file is there.
    fn has_built(&self, name: &str) -> bool {
        let Some(file) = data(name) else { return false };
        self.expect(0, &["build", &file.to_string_lossy(), "-o", "v.svol"]);
        true
    }

    /// The point under a pixel of a slice in a picture of 40 x 30 pixels.
    fn picked(&self, slice: &str, pixel: &str) -> serde_json::Value {
        let options = ["--slice", slice, "--size", "40x30", "--pick", pixel, "--json"];
        let found = self.run(&[&["render", "v.svol"], &options[..]].concat());
        assert!(found.status.success(), "{slice}: {}", String::from_utf8_lossy(&found.stderr));
        json(&String::from_utf8_lossy(&found.stdout))[0].clone()
    }
}

#[track_caller]
fn assert_near(found: &serde_json::Value, expected: f64, within: f64) {
    let number = found.as_f64().unwrap_or(f64::NAN);
    assert!((number - expected).abs() <= within, "{found}: expected {expected}");
}

/// A survey with the values inline + crossline / 100 + sample / 100,000.
#[test]
fn a_slice_of_a_survey_is_picked_by_its_lines() {
    let folder = Folder::new();
    if !folder.has_built("segy/odd/small.sgy") {
        return;
    }
    for (slice, name, at) in [("inline 3", "inline", 3.0), ("crossline=22", "crossline", 22.0), ("k=7", "time", 28.0)] {
        let found = folder.picked(slice, "22,13");
        assert_eq!(found["picked"]["on"]["slice"], 0, "{found}");
        assert_near(&found["survey"][name], at, 1e-9);
        let number = |name: &str| found["survey"][name].as_f64().expect("a number");
        let expected = number("inline") + number("crossline") / 100.0 + number("time") / 4.0 / 1e5;
        assert_near(&found["picked"]["value"], expected, 1e-4);
    }
    // Between two lines there is a note, and the value is the mean.
    let between = folder.run(&["render", "v.svol", "--slice", "inline=2.5", "--size", "40x30", "--pick", "22,13"]);
    let note = String::from_utf8_lossy(&between.stderr).into_owned();
    assert!(note.contains("note: inline=2.5 lies between inline 2 and inline 3"), "{note}");
    let outside = folder.expect(2, &["render", "v.svol", "--slice", "inline 9", "-o", "p.png"]);
    assert!(outside.contains("inline runs from 1 to 5"), "{outside}");
}

#[test]
fn vertical_exaggeration_changes_no_coordinate() {
    let folder = Folder::new();
    if !folder.has_built("segy/odd/small.sgy") {
        return;
    }
    let options = ["--size", "40x30", "--vertical-exaggeration", "3", "--pick", "20,15", "--json"];
    let found = folder.expect(0, &[&["render", "v.svol", "--slice", "time=100"], &options[..]].concat());
    let found = &json(&found)[0];
    assert_near(&found["survey"]["time"], 100.0, 1e-9);
    assert_near(&found["picked"]["world"][2], 100.0, 1e-9);
    assert_near(&found["picked"]["index"][2], 25.0, 1e-9);
}

/// Corners of the survey on the map: first crossline and last crossline of the first inline, then of the last one.
const VOLVE: [[f64; 2]; 4] =
    [[436_415.70, 6_477_404.61], [433_941.46, 6_478_021.58], [436_621.36, 6_478_229.35], [434_147.12, 6_478_846.33]];

#[test]
fn points_and_meshes_of_a_survey_are_on_the_map() {
    let folder = Folder::new();
    if !folder.has_built("segy/real/volve_migvel_depth_sub3d.sgy") {
        return;
    }
    let found = folder.picked("inline 10123", "22,13");
    assert_near(&found["survey"]["inline"], 10_123.0, 1e-6);
    let share =
        [(10_123.0 - 10_087.0) / 68.0, (found["survey"]["crossline"].as_f64().expect("a line") - 2148.0) / 204.0];
    for (axis, name) in ["easting", "northing"].into_iter().enumerate() {
        let [first, along_x, along_y, _] = VOLVE.map(|corner| corner[axis]);
        let expected = first + share[1] * (along_x - first) + share[0] * (along_y - first);
        assert_near(&found["survey"][name], expected, 0.05);
    }
    // All vertices lie inside the survey's outline, give or take half a line, and keep the numbers of the third axis.
    let vertices = |options: &[&str]| -> Vec<[f64; 3]> {
        folder.expect(0, &[&["mesh", "v.svol", "--iso", "3000", "-o", "m.obj", "--force"], options].concat());
        let text = std::fs::read_to_string(folder.path("m.obj")).expect("a mesh");
        let vertex = |line: &str| {
            let numbers: Vec<f64> = line.strip_prefix("v ")?.split(' ').filter_map(|n| n.parse().ok()).collect();
            numbers.get(..3)?.try_into().ok()
        };
        text.lines().filter_map(vertex).collect()
    };
    let (map, local) = (vertices(&[]), vertices(&["--coordinates", "local"]));
    assert_eq!(map.len(), local.len());
    for (map, local) in map.iter().zip(&local) {
        let share = [local[0] / 2550.0, local[1] / 850.0];
        for axis in 0..2 {
            let [first, along_x, along_y, _] = VOLVE.map(|corner| corner[axis]);
            let expected = first + share[0] * (along_x - first) + share[1] * (along_y - first);
            assert!((map[axis] - expected).abs() < 0.2, "{map:?} {local:?}: expected {expected}");
        }
        assert!((map[2] - local[2]).abs() < 1e-2, "{map:?} {local:?}");
    }
}

#[test]
fn voxels_are_extracted_by_lines_and_times() {
    let folder = Folder::new();
    if !folder.has_built("segy/odd/small.sgy") {
        return;
    }
    let extracted = |range: &str, level: &str| {
        folder.expect(0, &["extract", "v.svol", "--box", range, "--level", level, "-o", "e.raw", "--force"]);
        std::fs::read(folder.path("e.raw")).expect("voxels")
    };
    assert_eq!(extracted("inline=2:3,time=20:40", "0"), extracted(":,1:3,5:11", "0"));
    assert_eq!(extracted("crossline=21.5:23.5", "0"), extracted("2:4,:,:", "0"));
    let wrong = folder.expect(2, &["extract", "v.svol", "--box", "inline=2.2:2.8", "-o", "e.raw", "--force"]);
    assert!(wrong.contains("holds no voxel") && wrong.contains("inline runs from 1 to 5"), "{wrong}");
    let unknown = folder.expect(2, &["extract", "v.svol", "--box", "axial=2:3", "-o", "e.raw", "--force"]);
    assert!(unknown.contains("expected inline, crossline, time, i, j, k, x, y or z"), "{unknown}");
}

/// A patient's millimetres, as on the axes of its pictures.
#[test]
fn a_slice_of_a_patient_is_picked_by_its_millimetres() {
    let folder = Folder::new();
    if !folder.has_built("dicom/brain_pd_19slices") {
        return;
    }
    let info = json(&folder.expect(0, &["info", "v.svol", "--json"]));
    let number = |key: &str, at: usize| info[key][at].as_f64().expect("a number");
    // The axial plane through the middle of the grid: its world z on the line through the middle.
    let found = folder.picked("axial=-30", "20,15");
    let index: Vec<f64> = (0..3).map(|a| found["picked"]["index"][a].as_f64().expect("a number")).collect();
    let world: Vec<f64> = (0..3)
        .map(|row| {
            let along = (0..3).map(|a| number("direction", 3 * row + a) * number("spacing", a) * index[a]);
            number("origin", row) + along.sum::<f64>()
        })
        .collect();
    (0..3).for_each(|row| assert_near(&found["picked"]["world"][row], world[row], 1e-6));
    // The grid is tilted, so z is -30 only in the middle of the slice.
    let tilt = number("direction", 7) * number("spacing", 1) * (index[1] - 127.5)
        + number("direction", 6) * number("spacing", 0) * (index[0] - 127.5);
    assert_near(&found["picked"]["world"][2], -30.0 + tilt, 1e-6);
    let outside = folder.expect(2, &["render", "v.svol", "--slice", "z=500", "-o", "p.png"]);
    assert!(outside.contains("z runs from -51.0577") && outside.contains(" mm"), "{outside}");
}

#[test]
fn a_mean_of_label_numbers_is_refused() {
    let folder = Folder::new();
    let voxels: Vec<u8> = (0..16 * 16 * 16).map(|i| [0, 5, 17, 30][i % 16 / 4]).collect();
    std::fs::write(folder.path("v.raw"), voxels).expect("a file");
    let build = ["build", "v.raw", "--dims", "16,16,16", "--dtype", "u8", "--kind", "labels", "-o", "v.svol"];
    folder.expect(0, &build);
    let refused = folder.expect(2, &["render", "v.svol", "--slice", "k=4", "--slab", "3", "-o", "p.png"]);
    assert!(refused.contains("no label") && refused.contains("--kind generic"), "{refused}");
    let options = ["--slice", "k=4", "--slab", "3", "--kind", "generic", "-o", "p.png"];
    folder.expect(0, &[&["render", "v.svol"], &options[..]].concat());
    // A slice of labels is picked: the number of the voxel.
    let found = folder.picked("k=4", "20,15");
    let index = found["picked"]["index"][0].as_f64().expect("a place");
    let expected = [0.0, 5.0, 17.0, 30.0][((index + 0.5) / 4.0).floor() as usize];
    assert_near(&found["picked"]["value"], expected, 0.0);
}

#[test]
fn a_volume_file_is_built_as_the_kind_that_is_asked_for() {
    let folder = Folder::new();
    let voxels: Vec<u8> = (0..24 * 24 * 24).map(|i| (i * i % 251) as u8).collect();
    std::fs::write(folder.path("v.raw"), voxels).expect("a file");
    let cache = folder.path("cache");
    let built = |kind: &[&str]| {
        let raw = ["--dims", "24,24,24", "--dtype", "u8", "--cache", &cache];
        folder.expect(0, &[&["render", "v.raw", "-o", "p.png", "--size", "40x30", "--force"], &raw[..], kind].concat());
        let listed = std::fs::read_dir(Path::new(&cache).join("containers")).into_iter().flatten().flatten();
        let kinds = listed.map(|entry| entry.path()).filter(|path| path.extension().is_some_and(|end| end == "svol"));
        let kind_of =
            |path: PathBuf| json(&folder.expect(0, &["info", &path.to_string_lossy(), "--json"]))["kind"].clone();
        let mut kinds: Vec<String> = kinds.map(kind_of).map(|kind| kind.as_str().unwrap_or("").to_owned()).collect();
        kinds.sort();
        kinds
    };
    let first = built(&[]);
    assert!(first.len() == 1 && first[0] != "labels", "{first:?}");
    assert!(built(&["--kind", "labels"]).contains(&"labels".to_owned()));
}
