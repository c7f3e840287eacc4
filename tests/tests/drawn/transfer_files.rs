//! Transfer functions and colour maps in files of other programs. The result matches the definition of each format;
//! wrong files are refused with the place of the error.

use std::path::Path;

use supervol_format::{Dims, Geometry, ValueRange};
use supervol_scene::facts::VolumeFacts;
use supervol_scene::preset::transfer_file::{FILE_LIMIT_BYTES, TransferFile};
use supervol_scene::scene::PointsSpec;
use supervol_scene::transfer_function::TransferFunction;

fn facts() -> VolumeFacts {
    VolumeFacts::plain(Dims([10, 10, 10]), Geometry::IDENTITY, ValueRange { min: -100.0, max: 300.0 })
}

fn function(spec: &PointsSpec) -> TransferFunction {
    TransferFunction::new(spec.control_points(), spec.unit_distance.unwrap_or(1.0)).expect("a function")
}

fn parsed(text: &str, name: &str) -> TransferFile {
    TransferFile::parse(text, name).unwrap_or_else(|e| panic!("{e}"))
}

fn near(found: &TransferFunction, value: f64, color: [f64; 3], alpha: f64) {
    let (c, a) = found.classify(value);
    let room = 2e-3;
    assert!((0..3).all(|i| (c[i] - color[i]).abs() < room) && (a - alpha).abs() < room, "at {value}: {c:?} {a}");
}

#[test]
fn our_own_files_come_back_as_they_were_written() {
    let text = r#"{"unit_distance": 2.5, "points": [{"value": -1.0, "color": [0.1, 0.2, 0.3], "alpha": 0.0},
        {"value": 4.0, "color": [1.0, 0.5, 0.0], "alpha": 0.25}, {"value": 4.0, "color": [0.0, 0.0, 1.0], "alpha": 1.0}]}"#;
    let read = parsed(text, "own.json").points(&facts()).unwrap();
    let expected: PointsSpec = serde_json::from_str(text).unwrap();
    assert_eq!(read, expected, "the step at 4 included");
    let again = serde_json::to_string_pretty(&read).unwrap();
    assert_eq!(parsed(&again, "own.json").points(&facts()).unwrap(), expected);
}

/// ParaView writes an array of presets, in which colours and opacities have separate points.
#[test]
fn colour_maps_of_paraview_are_read_with_their_opacities() {
    let text = r#"[{"ColorSpace": "RGB", "Creator": "a person", "Name": "two ramps", "NanColor": [1, 1, 0],
        "RGBPoints": [0, 0, 0, 0, 100, 1, 0, 0, 200, 1, 1, 1], "Points": [0, 0, 0.5, 0, 50, 0.2, 0.25, 0, 150, 1, 0.5, 0]}]"#;
    let file = parsed(text, "map.json");
    assert_eq!((file.name(), file.has_opacities()), (Some("two ramps"), true));
    let spec = file.points(&facts()).unwrap();
    assert_eq!(spec.unit_distance, None);
    let read = function(&spec);
    near(&read, 25.0, [0.25, 0.0, 0.0], 0.1);
    near(&read, 50.0, [0.5, 0.0, 0.0], 0.2);
    // At half the way, a quarter of the change: the midpoint of the preceding group.
    near(&read, 75.0, [0.75, 0.0, 0.0], 0.6);
    near(&read, 150.0, [1.0, 0.5, 0.5], 1.0);
    near(&read, 200.0, [1.0; 3], 1.0);
    let map = file.color_map().unwrap();
    assert_eq!(map, [(0.0, [0.0; 3]), (0.5, [1.0, 0.0, 0.0]), (1.0, [1.0; 3])]);
}

/// The cool-to-warm map has two or three points and is not linear in RGB. Values as published (Moreland 2009).
#[test]
fn colour_maps_are_straight_in_their_own_space() {
    let two =
        |space: &str, ends: &str| parsed(&format!(r#"[{{"ColorSpace": "{space}", "RGBPoints": [{ends}]}}]"#), "m.json");
    let cool_to_warm = "0, 0.231373, 0.298039, 0.752941, 1, 0.705882, 0.0156863, 0.14902";
    let map = two("Diverging", cool_to_warm).color_map().unwrap();
    let at = |place: f64| map.iter().min_by(|a, b| (a.0 - place).abs().total_cmp(&(b.0 - place).abs())).unwrap().1;
    for (place, published) in [(0.25, [141.0, 176.0, 254.0]), (0.5, [221.0; 3]), (0.75, [244.0, 154.0, 123.0])] {
        let found = at(place);
        assert!((0..3).all(|c| (255.0 * found[c] - published[c]).abs() < 1.0), "{place}: {found:?}");
    }
    assert!(two("Diverging", cool_to_warm).points(&facts()).unwrap_err().to_string().contains("colour map"));
    // Steps stay steps.
    let map = two("Step", "0, 1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1").color_map().unwrap();
    assert_eq!(map.iter().map(|p| p.1).collect::<Vec<_>>()[..2], [[1.0, 0.0, 0.0]; 2]);
    assert!(
        map.windows(2).all(|pair| pair[0].0 <= pair[1].0)
            && map.iter().any(|p| (p.0 - 0.5).abs() < 1e-6 && p.1 == [1.0, 0.0, 0.0])
    );
}

/// ImageVis3D: the number of entries, then red, green, blue and alpha of each, over the data's range.
#[test]
fn tables_of_imagevis3d_are_stretched_over_the_range() {
    let entries: String =
        (0..=200).map(|i| format!("{} 0 1 {}\n", f64::from(i) / 200.0, if i < 100 { 0.0 } else { 0.5 })).collect();
    let spec = parsed(&format!("201\n{entries}"), "table.1dt").points(&facts()).unwrap();
    assert!(spec.points.len() <= 4, "what lies on a line is left out: {}", spec.points.len());
    let read = function(&spec);
    near(&read, -100.0, [0.0, 0.0, 1.0], 0.0);
    near(&read, 98.0, [0.495, 0.0, 1.0], 0.0);
    near(&read, 100.0, [0.5, 0.0, 1.0], 0.5);
    near(&read, 300.0, [1.0, 0.0, 1.0], 0.5);
    // A table without linear parts has at most as many entries as a transfer function, or is thinned to half a grey
    // level.
    let rough = |count: usize| -> String {
        let entry = |i: usize| format!("0 {} 0 0.5\n", 0.5 + 0.4 * ((i * i) as f64 * 1e-7).sin());
        format!("{count}\n{}", (0..count).map(entry).collect::<String>())
    };
    let spec = parsed(&rough(20_000), "rough.1dt").points(&facts()).unwrap();
    let read = function(&spec);
    assert!(spec.points.len() <= 4096);
    for i in (0..20_000).step_by(37) {
        let expected = 0.5 + 0.4 * ((i * i) as f64 * 1e-7).sin();
        near(&read, -100.0 + 400.0 * i as f64 / 19_999.0, [0.0, expected, 0.0], 0.5);
    }
}

#[test]
fn what_is_wrong_is_refused_with_its_place() {
    let cases = [
        ("a.json", "viridis", "expected a JSON object"),
        ("a.json", "{\"points\": []}", "points"),
        ("a.json", "{\"points\": [{\"value\": 1, \"color\": [0, 0, 2], \"alpha\": 0}]}", "color"),
        ("a.json", "{\"colors\": []}", "unknown field"),
        ("a.json", "[]", "none of its 0 presets"),
        ("a.json", "[{\"IndexedColors\": [1, 0, 0]}]", "IndexedColors"),
        ("a.json", "[{\"RGBPoints\": [0, 0, 0]}]", "groups of 4 numbers"),
        ("a.json", "[{\"RGBPoints\": [0, 0, 0, 2]}]", "from 0 to 1"),
        ("a.json", "[{\"RGBPoints\": [1, 0, 0, 0, 0, 1, 1, 1]}]", "ascend"),
        ("a.json", "[{\"ColorSpace\": \"CIELUV\", \"RGBPoints\": [1, 0, 0, 0]}]", "CIELUV"),
        (
            "a.json",
            "[{\"RGBPoints\": [0, 0, 0, 0, 1, 1, 1, 1], \"Points\": [0, 0, 0.5, 0.3, 1, 1, 0.5, 0]}]",
            "sharpness 0.3",
        ),
        ("a.json", "[{\"UseLogScale\": 1, \"RGBPoints\": [1, 0, 0, 0, 2, 0, 0, 0]}]", "logarithmic"),
        ("a.1dt", "", "number of entries"),
        ("a.1dt", "99999999999 1 1 1 1", "number of entries"),
        ("a.1dt", "2\n0 0 0 0\n0 0 0", "ends in entry 1"),
        ("a.1dt", "2\n0 0 0 0\n0 0 0 7", "entry 1, alpha"),
        ("a.1dt", "2\n0 0 0 0\n0 0 0 1 5", "behind them"),
    ];
    for (name, text, words) in cases {
        let found = TransferFile::parse(text, name).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(found.contains(words) && found.contains(name), "{text}: {found}");
    }
    let flat = parsed("[{\"RGBPoints\": [1, 0, 0, 0]}]", "flat.json");
    assert!(flat.color_map().unwrap_err().to_string().contains("spans values"));
    let folder = tempfile::tempdir().unwrap();
    let large = folder.path().join("large.json");
    std::fs::File::create(&large).unwrap().set_len(FILE_LIMIT_BYTES + 1).unwrap();
    assert!(TransferFile::read(&large).unwrap_err().to_string().contains("at most"));
    assert!(TransferFile::read(Path::new("no-such-file.1dt")).unwrap_err().to_string().contains("no-such-file.1dt"));
}
