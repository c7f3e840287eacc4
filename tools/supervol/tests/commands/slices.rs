//! Slices in any direction, with filters, inside the volume; axes with names and units; scenes that hold a whole
//! picture.

use crate::support;
use support::{Folder, json};

const SMALL: [&str; 6] = ["--size", "48x36", "--backend", "cpu", "--force", "--level"];

impl Folder {
    /// Pixels of a picture, red, green, blue, alpha.
    fn pixels(&self, options: &[&str]) -> Vec<[f32; 4]> {
        self.expect(0, &[&["render", "v.svol", "-o", "p.npy"], &SMALL[..], &["0"], options].concat());
        let bytes = std::fs::read(self.path("p.npy")).expect("a picture");
        let start = bytes.len() - 48 * 36 * 16;
        let value = |b: &[u8]| f32::from_le_bytes(b.try_into().expect("four bytes"));
        bytes[start..].chunks_exact(16).map(|p| std::array::from_fn(|c| value(&p[4 * c..4 * c + 4]))).collect()
    }
}

#[test]
fn oblique_slices_show_the_values_of_their_plane() {
    let folder = Folder::with_ramp();
    let grey = ["--window", "0,255", "--colormap", "grey"];
    // The four pixels around the picture's middle.
    let middle = |options: &[&str]| {
        let pixels = folder.pixels(&[options, &grey].concat());
        let around = [17, 18].map(|y| [23, 24].map(|x| pixels[y * 48 + x]));
        [0, 3].map(|c| around.as_flattened().iter().map(|p| p[c]).sum::<f32>() / 4.0)
    };
    // Through the volume's middle: 10 * 7.5 + 7.5, whatever the direction.
    for normal in ["normal=1,1,0", "normal=-1,2,3", "normal=0,0,1@7.5,7.5,8"] {
        let [value, alpha] = middle(&["--slice", normal]);
        assert!((value * 255.0 - 82.5).abs() < 0.5 && alpha == 1.0, "{normal}: {value}");
    }
    // A cubic of a ramp is the ramp; the nearest voxel has a whole value, of which there are 16 along a line.
    let [cubic, _] = middle(&["--slice", "k=4", "--interpolation", "cubic"]);
    assert!((cubic * 255.0 - 82.5).abs() < 0.5, "{cubic}");
    let steps = |how: &str| {
        let options = ["--slice", "k=4", "--interpolation", how, "--supersample", "1"];
        let pixels = folder.pixels(&[&options[..], &grey].concat());
        let mut line: Vec<u32> = pixels[18 * 48..19 * 48].iter().map(|p| p[0].to_bits()).collect();
        line.dedup();
        line.len()
    };
    assert!(steps("nearest") <= 18 && steps("cubic") > 30, "{} {}", steps("nearest"), steps("cubic"));
    // The gradient of a ramp is the same everywhere: sqrt(10^2 + 1).
    let filtered = folder.pixels(&["--slice", "k=4", "--filter", "sobel", "--window", "0,20", "--colormap", "grey"]);
    assert!((filtered[18 * 48 + 24][0] * 20.0 - 101f32.sqrt()).abs() < 0.1, "{:?}", filtered[18 * 48 + 24]);
}

/// The one thing that graphics devices do not draw, whether there is one or not.
#[test]
fn oblique_slices_are_refused_on_graphics_devices() {
    let folder = Folder::with_ramp();
    let on_device = ["render", "v.svol", "--backend", "gpu", "--slice", "normal=1,1,0", "-o", "p.png"];
    let refused = folder.expect(2, &on_device);
    assert!(refused.contains("--backend") && refused.contains("cpu and reference"), "{refused}");
}

/// The voxel in the middle of an axis, whatever it is called; of two, the first.
#[test]
fn slices_in_the_middle_need_no_number() {
    let folder = Folder::with_ramp();
    // 16 x 16 x 12 voxels; z counts world lengths, 2 from voxel to voxel.
    for (axis, place) in [("i", "i=7"), ("j", "j=7"), ("k", "k=5"), ("x", "x=7"), ("y", "y=7"), ("z", "z=10")] {
        let middle = format!("{axis}=middle");
        assert_eq!(folder.pixels(&["--slice", &middle]), folder.pixels(&["--slice", place]), "{axis}");
    }
    let [one, other] =
        ["k=middle", "k=5"].map(|place| folder.pixels(&["--slice", place, "--slice", "i=3", "--slices", "volume"]));
    assert_eq!(one, other);
    let message = folder.expect(2, &["render", "v.svol", "-o", "p.png", "--slice", "k=centre"]);
    assert!(message.contains("middle"), "{message}");
    let message = folder.expect(2, &["render", "v.svol", "-o", "p.png", "--slice", "axial=middle"]);
    assert!(message.contains("'axial' is no axis of this volume"), "{message}");
}

#[test]
fn slices_within_the_volume_are_in_the_scene_that_is_printed() {
    let folder = Folder::with_ramp();
    let options = [
        "--slice",
        "i=4",
        "--slice",
        "normal=0,1,1",
        "--slices",
        "volume",
        "--slice-opacity",
        "0.5",
        "--camera",
        "30,20",
    ];
    let picture = folder.pixels(&options);
    assert_ne!(picture, folder.pixels(&["--camera", "30,20"]));
    let printed = folder.expect(0, &[&["render", "v.svol", "--print-scene", "--size", "48x36"], &options[..]].concat());
    let slices = &json(&printed)["slices"];
    assert_eq!((&slices[0]["normal"], &slices[0]["offset"]), (&serde_json::json!([1.0, 0.0, 0.0]), &4.0.into()));
    assert_eq!((&slices[1]["opacity"], slices.as_array().map(Vec::len)), (&0.5.into(), Some(2)));
    std::fs::write(folder.path("scene.json"), printed).expect("room");
    assert_eq!(picture, folder.pixels(&["--scene", "scene.json"]));
    // A volume whose default mode is a projection is drawn as a body, but only if slices need a depth.
    let mode = |more: &[&str]| {
        let options = [&["render", "v.svol", "--kind", "fluorescence", "--print-scene"], more].concat();
        json(&folder.expect(0, &options))["mode"].to_string()
    };
    assert_eq!([mode(&[]), mode(&["--slice", "k=3", "--slices", "volume"])], ["\"mip\"", "\"dvr\""]);
    for (options, part) in [
        (&["--slice", "normal=0,0,0"][..], "not all zero"),
        (&["--slice", "normal=1,0,0@99,0,0"], "lies outside the volume, or outside --crop"),
        (&["--slice", "k=3", "--filter", "sobel:2"], "has no size"),
        (&["--slice", "k=3", "--filter", "blur"], "gaussian, median"),
        (&["--slice", "k=3", "--slice-opacity", "0.5"], "--slices volume"),
        (&["--slice", "normal=1,1,0", "--slab", "3"], "--slab needs a slice across an axis"),
        (&["--slice", "k=3", "--camera", "top"], "--camera changes nothing"),
        (&["--slice", "k=3", "--slices", "volume", "--mode", "mip"], "without depth"),
        (&["--slices", "volume"], "--slice"),
    ] {
        let message = folder.expect(2, &[&["render", "v.svol", "-o", "q.png"], options].concat());
        assert!(message.contains(part), "{options:?}: '{part}' is not in {message}");
    }
}

#[test]
fn slices_are_drawn_alone_and_an_opaque_volume_does_not_hide_them() {
    let folder = Folder::with_ramp();
    let grey = ["--window", "0,255", "--colormap", "grey", "--camera", "front"];
    let middle = |options: &[&str]| folder.pixels(&[options, &grey].concat())[18 * 48 + 24];
    // Seen from the front, the slice y = 3 lies before y = 9. The ramp is 10 x + y, so the middle of the picture, near x =
    // 7.5, is about 78. The camera stands in perspective: the value is known to 5 on each side.
    let [near, .., alpha] = middle(&["--mode", "slice", "--slice", "y=3", "--slice", "y=9"]);
    assert!((near * 255.0 - 78.0).abs() < 6.0 && alpha == 1.0, "{near} {alpha}");
    let scene = |options: &[&str]| json(&folder.expect(0, &[&["render", "v.svol", "--print-scene"], options].concat()));
    // Without --slice: three planes through the middle voxels.
    let three = scene(&["--mode", "slice"]);
    let offsets: Vec<f64> =
        three["slices"].as_array().expect("slices").iter().filter_map(|s| s["offset"].as_f64()).collect();
    assert_eq!((three["mode"].as_str(), offsets), (Some("slice"), vec![8.0, 8.0, 12.0]));
    // A transparent pixel of slices alone shows no volume around them.
    let clear = |options: &[&str]| folder.pixels(options).iter().filter(|p| p[3] == 0.0).count();
    let alone = clear(&["--mode", "slice", "--slice", "z=10", "--camera", "30,5"]);
    assert!(alone > clear(&["--camera", "30,5"]) + 100, "{alone}");
    // The default opacities around a slice let half of the light through half the mean edge, by their definition. Here
    // all values are opaque.
    let points = |options: &[&str]| scene(&[&["--kind", "em"], options].concat())["transfer_function"].clone();
    let (whole, around) = (points(&[]), points(&["--slice", "y=8", "--slices", "volume"]));
    assert_eq!(whole["points"], around["points"]);
    let unit = |points: &serde_json::Value| points["unit_distance"].as_f64().expect("a length");
    let half_edge = 0.5 * (16.0 + 16.0 + 24.0) / 3.0;
    let densest =
        whole["points"].as_array().expect("points").iter().filter_map(|p| p["alpha"].as_f64()).fold(0.0, f64::max);
    let light = (1.0 - densest.min(0.9999)).powf(half_edge / unit(&around));
    assert!(unit(&around) > unit(&whole) && (light - 0.5).abs() < 1e-6, "{light}");
    // Given opacities stay.
    let given = ["--tf", "0:black:0,255:white:1"];
    assert_eq!(points(&given), points(&[&given[..], &["--slice", "y=8", "--slices", "volume"]].concat()));
    // A default surface is translucent around slices; a requested one stays opaque.
    let alpha = |options: &[&str]| scene(&[&["--mode", "iso"], options].concat())["iso"][0]["alpha"].as_f64();
    let volume = ["--slice", "y=8", "--slices", "volume"];
    let requested = alpha(&[&volume[..], &["--iso", "90"]].concat());
    assert_eq!([alpha(&[]), alpha(&volume), requested], [Some(1.0), Some(0.3), Some(1.0)]);
    let refused = folder
        .expect(2, &["render", "v.svol", "-o", "q.png", "--slice", "y=8", "--slices", "panels", "--mode", "slice"]);
    assert!(refused.contains("--mode changes nothing on a slice"), "{refused}");
}

/// The closed form of a translucent block: `1 - exp(-f k L)`, with `k` of opacity 0.9999 over the unit distance.
#[test]
fn opacity_scales_an_opaque_block() {
    let folder = Folder::with_ramp();
    let opaque = ["--tf", "0:white:1,255:white:1", "--camera", "front"];
    // The unit distance of --tf is the smallest spacing, 1.
    for factor in [0.001, 0.01, 0.1] {
        let text = factor.to_string();
        let options = [&opaque[..], &["--opacity", &text]].concat();
        let found = f64::from(folder.pixels(&options)[18 * 48 + 24][3]);
        // The ray through the middle crosses 16 voxels of 1 nearly straight.
        let expected = 1.0 - 0.0001f64.powf(factor * 16.0);
        assert!((found - expected).abs() < 0.01, "{factor}: {found}, expected {expected}");
    }
}

#[test]
fn the_printed_scene_draws_exaggerated_heights_too() {
    let folder = Folder::with_ramp();
    let high = folder.pixels(&["--vertical-exaggeration", "3"]);
    assert_ne!(high, folder.pixels(&[]));
    let printed =
        folder.expect(0, &["render", "v.svol", "--vertical-exaggeration", "3", "--print-scene", "--size", "48x36"]);
    assert_eq!(json(&printed)["vertical_exaggeration"], 3.0);
    std::fs::write(folder.path("scene.json"), printed).expect("room");
    assert_eq!(high, folder.pixels(&["--scene", "scene.json"]));
    // The command line overrules the scene, but for the camera that this holds.
    let flat = folder
        .expect(0, &["render", "v.svol", "--scene", "scene.json", "--vertical-exaggeration", "1", "--print-scene"]);
    assert!(json(&flat)["vertical_exaggeration"].is_null());
}

#[test]
fn axes_are_what_somebody_says() {
    let folder = Folder::with_ramp();
    let shape = ["--dims", "16x16x12", "--dtype", "u8", "-o", "w.svol", "--force"];
    let axes = |options: &[&str]| {
        folder.expect(0, &[&["build", "v.raw"], &shape[..], options].concat());
        let info = json(&folder.expect(0, &["info", "w.svol", "--json"]));
        let axis = |n: usize| format!("{} {}", info["axes"][n]["name"], info["axes"][n]["unit"]).replace('"', "");
        [axis(0), axis(2)]
    };
    assert_eq!(axes(&["--unit", "um"]), ["x um", "z um"]);
    assert_eq!(axes(&["--spacing", "1mm,1mm,2mm", "--domain", "time"]), ["x mm", "time ms"]);
    assert_eq!(axes(&["--domain", "depth", "--unit", "ft"]), ["x ", "depth ft"]);
    let refused = |options: &[&str]| folder.expect(2, &[&["build", "v.raw"], &shape[..], options].concat());
    assert!(refused(&["--domain", "time", "--unit", "m"]).contains("expected one of s, ms, us"));
    assert!(refused(&["--unit", "cubit"]).contains("nm, um"));
}

#[test]
fn the_schema_of_scenes_is_printed() {
    let schema = json(&Folder::new().expect(0, &["schema"]));
    assert_eq!(schema["title"], "Scene");
    assert!(schema["properties"]["slices"].is_object());
}
