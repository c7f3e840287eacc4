//! Default pictures of surveys, patients and thin volumes; planes in the coordinates of the volume's place.

use std::io::Write;
use std::path::Path;

use crate::support;
use support::{Folder, json};

impl Folder {
    /// Builds `v.svol` from `v.raw` of these bytes.
    fn with_raw(bytes: &[u8], dims: &str) -> Self {
        let folder = Self::new();
        std::fs::write(folder.path("v.raw"), bytes).expect("room");
        folder.expect(0, &["build", "v.raw", "--dims", dims, "--dtype", "uint8", "-o", "v.svol"]);
        folder
    }

    /// A patient on a curved table, in Hounsfield units: a cylinder around (32, 26) and a shell around (32, 16).
    fn with_patient() -> Self {
        let folder = Self::new();
        let value = |[x, y]: [f64; 2]| -> i16 {
            let from_axis = (x - 32.0).hypot(y - 26.0);
            let is_table = ((x - 32.0).hypot(y - 16.0) - 30.0).abs() <= 1.0 && y > 38.0;
            match from_axis {
                r if r <= 4.0 => 1000,
                r if r <= 16.0 => 40,
                _ if is_table => 300,
                _ => -1000,
            }
        };
        let mut file = std::fs::File::create(folder.path("v.nrrd")).expect("room");
        let header = "NRRD0004\ntype: int16\ndimension: 3\nspace: left-posterior-superior\nsizes: 64 64 40\n\
                      space directions: (2,0,0) (0,2,0) (0,0,3)\nspace origin: (0,0,0)\nendian: little\nencoding: raw\n\n";
        file.write_all(header.as_bytes()).expect("room");
        // Noise, so that these are no labels.
        let noise = |i: u32| (i.wrapping_mul(2_654_435_761) >> 24) as i16 / 8;
        let voxels = (0..64 * 64 * 40).map(|i| value([f64::from(i % 64), f64::from(i / 64 % 64)]) + noise(i));
        file.write_all(&voxels.flat_map(i16::to_le_bytes).collect::<Vec<u8>>()).expect("room");
        folder.expect(0, &["build", "v.nrrd", "-o", "v.svol"]);
        folder
    }

    fn printed(&self, options: &[&str]) -> (serde_json::Value, String) {
        let output = self.run(&[&["render", "v.svol", "--print-scene"], options].concat());
        let notes = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{notes}");
        (json(&String::from_utf8_lossy(&output.stdout)), notes)
    }
}

fn count(value: &serde_json::Value) -> usize {
    value.as_array().map_or(0, Vec::len)
}

#[test]
fn a_survey_is_three_sections_and_its_strongest_amplitudes() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "seismic", "--dims", "40,40,40", "-o", "v.svol"]);
    let (scene, _) = folder.printed(&[]);
    assert_eq!((scene["mode"].as_str(), count(&scene["slices"])), (Some("dvr"), 3));
    let points = scene["transfer_function"]["points"].as_array().expect("points");
    let clip = points[5]["value"].as_f64().expect("a number") - points[0]["value"].as_f64().expect("a number");
    let clear = points[3]["value"].as_f64().expect("a number") - points[2]["value"].as_f64().expect("a number");
    assert!((clear / clip - 0.65).abs() < 1e-9, "amplitudes below 0.65 of the 99th percentile are clear");
    assert!(points[2]["alpha"] == 0.0 && points[3]["alpha"] == 0.0 && points[5]["alpha"] != 0.0);
    let (volume, _) = folder.printed(&["--mode", "dvr"]);
    assert!(count(&volume["slices"]) == 0 && volume["transfer_function"] != scene["transfer_function"]);
}

#[test]
fn the_table_of_a_patient_is_cut_away_unless_it_is_to_stay() {
    let folder = Folder::with_patient();
    let info = json(&folder.expect(0, &["info", "v.svol", "--json"]));
    assert_eq!((info["kind"].as_str(), info["kind_certainty"].as_str()), (Some("ct"), Some("likely")));
    assert!(folder.expect(0, &["info", "v.svol"]).contains("Hounsfield units (likely)"));
    let (scene, notes) = folder.printed(&[]);
    let planes = scene["clip"]["planes"].as_array().expect("planes").clone();
    assert!((1..=5).contains(&planes.len()) && notes.contains("note: the table below the body is cut away"), "{notes}");
    let keeps = |p: [f64; 3]| {
        planes.iter().all(|plane| {
            let along: f64 = (0..3).map(|a| plane["normal"][a].as_f64().expect("a number") * p[a]).sum();
            along >= plane["offset"].as_f64().expect("a number")
        })
    };
    assert!(keeps([64.0, 84.0, 60.0]), "the back of the body");
    assert!(!keeps([64.0, 92.0, 60.0]) && !keeps([24.0, 78.0, 60.0]), "the middle and the edge of the table");
    for options in [&["--keep-table"][..], &["--mode", "dvr"]] {
        let (scene, notes) = folder.printed(options);
        assert!(count(&scene["clip"]["planes"]) == 0 && !notes.contains("table"), "{options:?}: {notes}");
    }
}

#[test]
fn volumes_thinner_than_a_pixel_are_seen() {
    let bytes: Vec<u8> = (0..4 * 4 * 10_000).map(|i| (50 + i / 16 % 150) as u8).collect();
    let folder = Folder::with_raw(&bytes, "4x4x10000");
    let size = ["--size", "200x150"];
    let (scene, notes) = folder.printed(&size);
    assert!(
        scene["samples_per_pixel"].as_u64().is_some_and(|n| n > 4) && !notes.contains("warning"),
        "{scene} {notes}"
    );
    let rows = |options: &[&str]| {
        let drawn = [&["render", "v.svol", "-o", "v.npy", "--force", "--backend", "cpu"], &size[..], options].concat();
        folder.expect(0, &drawn);
        let bytes = std::fs::read(folder.path("v.npy")).expect("render wrote it");
        let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        let alphas = bytes[header..].chunks_exact(16).map(|b| f32::from_le_bytes([b[12], b[13], b[14], b[15]]));
        let alphas: Vec<f32> = alphas.collect();
        alphas.chunks_exact(200).filter(|row| row.iter().any(|alpha| *alpha > 0.0)).count()
    };
    assert!(rows(&[]) > 100, "{} rows", rows(&[]));
    // One ray is one ray where it was asked for. Short things may vanish: the look has 4 rays.
    assert_eq!(folder.printed(&[&size[..], &["--supersample", "1"]].concat()).0["samples_per_pixel"], 1);
    assert_eq!(folder.printed(&[&size[..], &["--zoom", "0.02"]].concat()).0["samples_per_pixel"], 4);
}

#[test]
fn opacity_acts_on_surfaces_too() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "sphere", "--dims", "24,24,24", "-o", "v.svol"]);
    let alpha = |options: &[&str]| folder.printed(options).0["iso"][0]["alpha"].as_f64().expect("a number");
    assert_eq!(alpha(&["--iso", "0.5", "--opacity", "0.25"]), 0.25 * alpha(&["--iso", "0.5"]));
    assert_eq!(alpha(&["--iso", "0.5", "--opacity", "9"]), 1.0);
}

#[test]
fn planes_are_given_in_the_coordinates_of_the_place() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "sphere", "--dims", "24,24,24", "-o", "v.svol"]);
    let plane = |options: &[&str]| folder.printed(options).0["clip"]["planes"][0].clone();
    let without_a_place = plane(&["--clip", "1,0,0,0.1"]);
    assert_eq!(without_a_place, serde_json::json!({"normal": [1.0, 0.0, 0.0], "offset": 0.1}));

    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/segy/real/f3_int16_be.sgy");
    if !file.exists() {
        return;
    }
    folder.expect(0, &["build", &file.to_string_lossy(), "-o", "v.svol", "--force"]);
    let east = plane(&["--clip", "1,0,0,620400"]);
    let local = plane(&["--clip", "1,0,0,620400", "--coordinates", "local"]);
    assert_eq!(local, serde_json::json!({"normal": [1.0, 0.0, 0.0], "offset": 620_400.0}));
    let info = json(&folder.expect(0, &["info", "v.svol", "--json"]));
    let number = |value: &serde_json::Value| value.as_f64().expect("a number");
    // Corners in the file: first inline with first and last crossline, last inline with both.
    for (corner, [i, j]) in [[0.0, 0.0], [17.0, 0.0], [0.0, 22.0], [17.0, 22.0]].into_iter().enumerate() {
        let along = [i, j, 0.0].iter().enumerate().map(|(a, n)| n * number(&info["spacing"][a])).collect::<Vec<_>>();
        let world = [0, 1, 2].map(|row| {
            let column = |a: usize| number(&info["direction"][3 * row + a]) * along[a];
            number(&info["origin"][row]) + column(0) + column(1) + column(2)
        });
        let beyond: f64 = (0..3).map(|a| number(&east["normal"][a]) * world[a]).sum::<f64>() - number(&east["offset"]);
        let expected = number(&info["survey"]["corners"][corner][0]) - 620_400.0;
        assert!((beyond - expected).abs() < 0.5, "corner {corner}: {beyond} m east of the plane instead of {expected}");
    }
    // A slice through a point of the map lies on it.
    let slice =
        folder.printed(&["--slice", "normal=1,0,0@620400,6074500,100", "--slices", "volume"]).0["slices"][0].clone();
    for a in 0..3 {
        assert!((number(&slice["normal"][a]) - number(&east["normal"][a])).abs() < 1e-9, "{slice} {east}");
    }
    assert!((number(&slice["offset"]) - number(&east["offset"])).abs() < 1e-6, "{slice} {east}");
}
