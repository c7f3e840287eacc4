//! Pictures without a scene file: what is recognised, what is drawn, and what each option of `render` changes.

use crate::support;
use support::{Folder, json};

const SMALL: [&str; 6] = ["--size", "48x36", "--backend", "cpu", "--level", "0"];

impl Folder {
    /// A sphere of bytes, 24 voxels along each edge.
    fn with_sphere() -> Self {
        let folder = Self::new();
        folder.expect(0, &["synth", "sphere", "--dims", "24,24,24", "-o", "v.svol", "--brick", "16"]);
        folder
    }

    /// A raw volume of bytes.
    fn with_bytes(dims: [usize; 3], value: impl Fn([usize; 3]) -> u8) -> Self {
        let folder = Self::new();
        let [nx, ny, nz] = dims;
        let at = |i: usize| value([i % nx, i / nx % ny, i / (nx * ny)]);
        std::fs::write(folder.path("v.raw"), (0..nx * ny * nz).map(at).collect::<Vec<u8>>()).expect("room");
        let dims = format!("{nx}x{ny}x{nz}");
        folder.expect(0, &["build", "v.raw", "--dims", &dims, "--dtype", "uint8", "-o", "v.svol"]);
        folder
    }

    /// The scene that these options mean.
    fn scene(&self, options: &[&str]) -> serde_json::Value {
        json(&self.expect(0, &[&["render", "v.svol", "--print-scene"], options].concat()))
    }

    /// The floats of a picture: width x height x 4.
    fn picture(&self, options: &[&str]) -> Vec<f32> {
        let output = self.path("p.npy");
        self.expect(0, &[&["render", "v.svol", "-o", &output], &SMALL[..], options].concat());
        Self::floats(&output)
    }

    fn floats(picture: &str) -> Vec<f32> {
        let bytes = std::fs::read(picture).expect("render wrote it");
        let header = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        bytes[header..].chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
    }
}

#[test]
fn the_printed_scene_is_the_picture() {
    let folder = Folder::with_sphere();
    std::fs::write(folder.path("empty.json"), "{}").expect("room");
    let default = folder.picture(&[]);
    assert_eq!(folder.picture(&["--scene", "empty.json"]), default);
    assert_eq!(folder.picture(&["--scene", "{}"]), default);
    let refused = folder.expect(2, &["render", "v.svol", "-o", "p.npy", "--scene", r#"{"camera": {}}"#]);
    assert!(refused.contains("--scene: "), "{refused}");
    let options = ["--camera", "40,10", "--colormap", "viridis", "--zoom", "1.5", "--crop", "0:24,0:24,0:12"];
    let text = folder.expect(0, &[&["render", "v.svol", "--print-scene"], &SMALL[..2], &options[..]].concat());
    std::fs::write(folder.path("s.json"), text).expect("room");
    let drawn = folder.picture(&options);
    assert_ne!(drawn, default);
    folder.expect(0, &["render", "v.svol", "--scene", "s.json", "-o", "q.npy", "--backend", "cpu", "--level", "0"]);
    assert_eq!(std::fs::read(folder.path("q.npy")).ok(), std::fs::read(folder.path("p.npy")).ok());
    folder.expect(2, &["render", "v.svol"]);
}

#[test]
fn transfer_functions_of_other_programs_are_drawn() {
    let folder = Folder::with_sphere();
    std::fs::write(folder.path("t.1dt"), "3\n0 0 0 0\n1 0 0 0.25\n1 1 1 1\n").expect("room");
    let map = r#"[{"ColorSpace": "RGB", "Name": "m", "RGBPoints": [10, 0, 0, 1, 30, 1, 0, 0], "Points": [10, 0, 0.5, 0, 30, 1, 0.5, 0]}]"#;
    std::fs::write(folder.path("m.json"), map).expect("room");
    let points = |options: &[&str]| {
        let scene = folder.scene(options);
        scene.pointer("/transfer_function/points").and_then(|p| p.as_array()).expect("points").clone()
    };
    let table = points(&["--tf", "t.1dt"]);
    assert_eq!((table.len(), table[1]["alpha"].as_f64(), table[1]["color"][0].as_f64()), (3, Some(0.25), Some(1.0)));
    let paraview = points(&["--tf", "m.json"]);
    assert_eq!((paraview[0]["value"].as_f64(), paraview[1]["value"].as_f64()), (Some(10.0), Some(30.0)));
    // As a colour map, the values are those of the picture.
    let [usual, painted] = [points(&[]), points(&["--colormap", "m.json"])];
    let ends = |points: &[serde_json::Value]| (points[0]["value"].clone(), points[points.len() - 1]["value"].clone());
    assert_eq!(ends(&painted), ends(&usual));
    assert_eq!(painted[0]["color"], serde_json::json!([0.0, 0.0, 1.0]));
    // The scene that is printed is the picture.
    assert_eq!(folder.picture(&["--tf", "t.1dt"]), {
        let text = folder.expect(0, &[&["render", "v.svol", "--print-scene", "--tf", "t.1dt"], &SMALL[..2]].concat());
        std::fs::write(folder.path("s.json"), text).expect("room");
        folder.picture(&["--scene", "s.json"])
    });
    std::fs::write(folder.path("c.json"), r#"[{"RGBPoints": [0, 0, 0, 0, 1, 1, 1, 1]}]"#).expect("room");
    for (options, words) in [
        (["--tf", "c.json"], "--colormap"),
        (["--tf", "missing.1dt"], "missing.1dt"),
        (["--colormap", "missing.json"], "missing.json"),
    ] {
        let told = folder.expect(2, &[&["render", "v.svol", "-o", "p.png"], &options[..]].concat());
        assert!(told.contains(words), "{options:?}: {told}");
    }
}

#[test]
fn each_option_changes_its_part_of_the_scene() {
    let folder = Folder::with_sphere();
    let usual = folder.scene(&[]);
    let changes: [(&[&str], &str); 17] = [
        (&["--size", "64x48"], "/image/width"),
        (&["--background", "#ff8000"], "/image/background"),
        (&["--camera", "top"], "/camera/eye"),
        (&["--camera", "-30,20"], "/camera/eye"),
        (&["--camera", "-30,20,500"], "/camera/eye"),
        (&["--zoom", "2"], "/camera/fov_y"),
        (&["--mode", "mip"], "/mode"),
        (&["--tf", "0:black:0,1:white:0.5"], "/transfer_function/points"),
        (&["--colormap", "turbo"], "/transfer_function/points"),
        (&["--window", "-0.5,0.5"], "/transfer_function/points"),
        (&["--clip-percent", "10"], "/transfer_function/points"),
        (&["--opacity", "0.5"], "/transfer_function/points"),
        (&["--kind", "labels"], "/transfer_function/points"),
        (&["--crop", "k=3:9"], "/clip/box"),
        (&["--crop", ":,3:,7"], "/clip/box"),
        (&["--clip", "1,0,0,5"], "/clip/planes"),
        (&["--supersample", "3"], "/samples_per_pixel"),
    ];
    for (options, place) in changes {
        let scene = folder.scene(options);
        assert_ne!(scene.pointer(place), usual.pointer(place), "{options:?} does not change {place}: {scene}");
    }
    let surfaces = folder.scene(&["--iso", "0.2,0.4"]);
    assert_eq!((surfaces["mode"].as_str(), surfaces["iso"][1]["alpha"].as_f64()), (Some("iso"), Some(1.0)));
    assert!(surfaces["shading"].is_object(), "surfaces are lit: {surfaces}");
    assert!(folder.scene(&["--mode", "iso"])["iso"][0]["value"].is_number());
    let [lit, unlit] = [&["--mode", "iso"][..], &["--mode", "iso", "--unlit"]].map(|options| folder.picture(options));
    assert_ne!(lit, unlit);
    let [plain, high] = [&[][..], &["--vertical-exaggeration", "3"]].map(|options| folder.picture(options));
    assert_ne!(plain, high);
}

#[test]
fn options_that_change_nothing_and_mistakes_are_refused_with_a_reason() {
    let folder = Folder::with_sphere();
    let refused: [(&[&str], &str); 16] = [
        (&["--iso", "0.3", "--colormap", "viridis"], "--colormap changes nothing"),
        (&["--mode", "mip", "--opacity", "2"], "--opacity changes nothing"),
        (&["--mode", "mip", "--unlit"], "--unlit changes nothing"),
        (&["--slab", "3"], "--slice"),
        (&["--slice", "inline=3"], "'inline' is no axis of this volume"),
        (&["--slice", "k=99"], "k runs from 0 to 23"),
        (&["--crop", "k=30:40"], "leaves nothing"),
        (&["--crop", "0:99,0:9,0:9"], "24 x 24 x 24"),
        (&["--camera", "sideways"], "front, back, left"),
        (&["--colormap", "jet"], "viridis"),
        (&["--window", "5,1"], "LOW < HIGH"),
        (&["--size", "0x9"], "WIDTHxHEIGHT"),
        (&["--background", "mauve"], "#rrggbb"),
        (&["--kind", "xray"], "micro-ct"),
        (&["--tf", "1:2"], "VALUE:COLOUR:OPACITY"),
        (&["--window", "0,1", "--clip-percent", "1"], "cannot be used with"),
    ];
    for (options, part) in refused {
        let message = folder.expect(2, &[&["render", "v.svol", "-o", "p.png"], options].concat());
        assert!(message.contains(part), "{options:?}: '{part}' is not in {message}");
    }
}

#[test]
fn a_slice_shows_the_values_of_its_plane() {
    // Value 10 * k: a slice is one grey.
    let folder = Folder::with_bytes([16, 16, 20], |[_, _, k]| 10 * k as u8);
    for (place, value) in [("k=7", 70.0), ("k=7.5", 75.0), ("z=12", 120.0)] {
        let picture = folder.picture(&["--slice", place, "--window", "0,200", "--colormap", "grey"]);
        let middle = 4 * (18 * 48 + 24);
        assert!((f64::from(picture[middle]) - value / 200.0).abs() < 2e-3, "{place}: {}", picture[middle]);
        assert_eq!(picture[middle + 3], 1.0);
    }
    // The mean over a slab; and across another axis, with z upwards.
    let slab = folder.picture(&["--slice", "k=10", "--slab", "10", "--window", "0,200", "--colormap", "grey"]);
    assert!((f64::from(slab[4 * (18 * 48 + 24)]) - 0.5).abs() < 2e-3);
    let upright = folder.picture(&["--slice", "j=3", "--window", "0,200", "--colormap", "grey"]);
    let column = |row: usize| upright[4 * (row * 48 + 24)];
    assert!(column(5) > column(18) && column(18) > column(30), "{} {} {}", column(5), column(18), column(30));
}

#[test]
fn slabs_show_means_and_extremes_and_gamma_bends_colours() {
    // Value 10 * k; the slab holds k from 5 to 15.
    let folder = Folder::with_bytes([16, 16, 20], |[_, _, k]| 10 * k as u8);
    let middle = |options: &[&str]| {
        let slab = ["--slice", "k=10", "--window", "0,200", "--colormap", "grey"];
        f64::from(folder.picture(&[&slab, options].concat())[4 * (18 * 48 + 24)])
    };
    for (mode, value) in [("mean", 100.0), ("max", 150.0), ("min", 50.0)] {
        let found = middle(&["--slab", "10", "--slab-mode", mode]);
        assert!((found - value / 200.0).abs() < 2e-3, "{mode}: {found}");
    }
    for gamma in [0.5, 2.0, 3.0] {
        let found = middle(&["--gamma", &gamma.to_string()]);
        assert!((found - 0.5f64.powf(gamma)).abs() < 2e-3, "{gamma}: {found}");
        let oblique = middle(&["--interpolation", "cubic", "--gamma", &gamma.to_string()]);
        assert!((oblique - found).abs() < 2e-3, "{gamma}: {oblique}");
    }
    assert_eq!(middle(&["--gamma", "1"]), middle(&[]));
    let refused = |options: &[&str]| folder.expect(2, &[&["render", "v.svol", "-o", "q.png"], options].concat());
    assert!(refused(&["--slice", "k=10", "--slab-mode", "max"]).contains("--slab"));
    assert!(refused(&["--gamma", "0"]).contains("from 0.1 to 10"));
    assert!(refused(&["--mode", "iso", "--gamma", "2"]).contains("--gamma changes nothing in mode iso"));
}

#[test]
fn windows_have_levels_widths_and_names() {
    // Hounsfield units -1000 to 1039 in steps of 10.
    let folder = Folder::new();
    let values: Vec<u8> = (0..8 * 8 * 204).flat_map(|i: i32| (10 * (i / 64) as i16 - 1000).to_le_bytes()).collect();
    std::fs::write(folder.path("h.raw"), values).expect("room");
    folder.expect(0, &["build", "h.raw", "--dims", "8,8,204", "--dtype", "i16", "-o", "v.svol"]);
    let ends = |window: &str| {
        let scene = folder.scene(&["--kind", "ct", "--slice", "k=3", "--window", window]);
        let points = scene["transfer_function"]["points"].as_array().expect("points").clone();
        [points.first(), points.last()].map(|p| p.expect("a point")["value"].as_f64().expect("a number"))
    };
    assert_eq!(ends("level=150,width=500"), [-100.0, 400.0]);
    assert_eq!(ends("-100,400"), [-100.0, 400.0]);
    for (name, window) in [
        ("bone", [-500.0, 1300.0]),
        ("lung", [-1350.0, 150.0]),
        ("soft-tissue", [-150.0, 250.0]),
        ("brain", [0.0, 80.0]),
    ] {
        assert_eq!(ends(name), window, "{name}");
    }
    let refused = |options: &[&str]| folder.expect(2, &[&["render", "v.svol", "-o", "q.png"], options].concat());
    assert!(refused(&["--window", "liver"]).contains("soft-tissue"));
    assert!(refused(&["--window", "level=3,width=0"]).contains("positive width"));
    let bytes = Folder::with_sphere();
    let message = bytes.expect(2, &["render", "v.svol", "-o", "q.png", "--window", "lung"]);
    assert!(message.contains("Hounsfield units") && message.contains("--kind ct"), "{message}");
}

#[test]
fn slices_lie_side_by_side() {
    let folder = Folder::with_sphere();
    let read = |options: &[&str], size: &str| {
        let slices = ["render", "v.svol", "-o", "s.npy", "--force", "--size", size];
        folder.expect(0, &[&slices[..], options].concat());
        Folder::floats(&folder.path("s.npy"))
    };
    let together = read(&["--slice", "k=12", "--slice", "i=7", "--slice", "j=3"], "40x30");
    for (number, slice) in ["k=12", "i=7", "j=3"].into_iter().enumerate() {
        let alone = read(&["--slice", slice], "20x15");
        for (at, row) in alone.chunks_exact(4 * 20).enumerate() {
            let begin = 4 * ((number / 2 * 15 + at) * 40 + number % 2 * 20);
            assert_eq!(together[begin..begin + 4 * 20], *row, "{slice}");
        }
    }
    for option in [&["--stats", "s.json"][..], &["--print-scene"], &["--turntable", "3"], &["--size", "1x1"]] {
        let two = ["render", "v.svol", "-o", "t.png", "--slice", "k=2", "--slice", "k=3"];
        folder.expect(2, &[&two[..], option].concat());
    }
}

#[test]
fn nothing_is_black_without_a_word() {
    let folder = Folder::with_sphere();
    let warning = |folder: &Folder, options: &[&str]| {
        let output = folder.run(&[&["render", "v.svol", "-o", "p.png"], &SMALL[..], options].concat());
        assert_eq!(output.status.code(), Some(0), "{options:?}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(!warning(&folder, &[]).contains("warning"));
    let scene = |text: &str| {
        std::fs::write(folder.path("s.json"), text).expect("room");
        warning(&folder, &["--scene", "s.json"])
    };
    let away = r#"{"camera": {"eye": [0, 0, 900], "target": [0, 0, 999], "up": [0, 1, 0], "fov_y": 30}}"#;
    assert!(scene(away).contains("the camera does not see the volume"));
    assert!(scene(r#"{"clip": {"planes": [{"normal": [1, 0, 0], "offset": 500}]}}"#).contains("clip box and planes"));
    assert!(warning(&folder, &["--iso", "1e6"]).contains("no surface is at 1000000"));
    assert!(
        warning(&folder, &["--tf", "1e6:black:0,2e6:white:1"])
            .contains("is transparent for all values in the camera's view")
    );
    let trace = Folder::with_bytes([1, 1, 250], |[_, _, k]| k as u8);
    assert!(!warning(&trace, &[]).contains("warning"), "a trace is drawn so wide that it can be seen");
    let constant = Folder::with_bytes([9, 9, 9], |_| 5);
    assert!(!warning(&constant, &[]).contains("warning"), "a grey block is something");
    assert!(warning(&constant, &["--tf", "6:black:0,7:white:1"]).contains("every voxel is 5"));
    let white = ["--tf", "0:white:1,9:white:1", "--unlit", "--background", "white", "--mode", "dvr"];
    assert!(warning(&folder, &white).contains("has the colour of the background; change --background"));
    assert!(!warning(&folder, &white[..2]).contains("warning"));
}

#[test]
fn kinds_are_named_with_their_reason_and_can_be_overruled() {
    let folder = Folder::with_bytes([40, 40, 40], |[i, j, k]| ((i / 8 * 7 + j / 8 * 3 + k / 8 * 11) % 5) as u8);
    let info = json(&folder.expect(0, &["info", "v.svol", "--json"]));
    assert_eq!((info["kind"].as_str(), info["left_handed"].as_bool()), (Some("labels"), Some(false)));
    let text = folder.expect(0, &["info", "v.svol"]);
    assert!(text.contains("kind       labels: whole numbers, mostly equal") && text.contains("right-handed"), "{text}");
    assert!(folder.expect(2, &["info", "v.svol", "--text-header"]).contains("SEG-Y"));
    assert_eq!(folder.scene(&["--kind", "fluorescence"])["mode"], "mip");
    assert_eq!(folder.scene(&["--preset", "fluorescence"]), folder.scene(&["--kind", "fluorescence"]));
    let drawn = folder.expect(0, &["histogram", "v.svol", "--rows", "5"]);
    assert_eq!(drawn.lines().count(), 6, "{drawn}");
    assert!(drawn.contains("12800") && drawn.contains("kind labels"), "{drawn}");
}

/// Whether a pixel at the border of a picture shows something, and whether any does.
fn shows_something(folder: &Folder, edge: usize, arguments: &[&str]) -> [bool; 2] {
    let size = format!("{edge}x{edge}");
    folder.expect(0, &[&["render", "v.svol", "-o", "v.npy", "--size", &size, "--force"], arguments].concat());
    let alphas: Vec<f32> = Folder::floats(&folder.path("v.npy")).chunks_exact(4).map(|pixel| pixel[3]).collect();
    assert_eq!(alphas.len(), edge * edge);
    let at_border = |i: &usize| [i % edge, i / edge].iter().any(|place| [0, edge - 1].contains(place));
    [(0..alphas.len()).filter(at_border).any(|i| alphas[i] > 0.0), alphas.iter().any(|alpha| *alpha > 0.0)]
}

#[test]
fn labels_that_coarse_levels_lose_are_in_the_picture() {
    let is_among = |places: [usize; 3], range: std::ops::Range<usize>| places.iter().all(|place| range.contains(place));
    let folder = Folder::with_bytes([128; 3], |[i, j, k]| {
        let block = if is_among([i, j, k], 50..70) { 1 + (i / 8) % 3 } else { 0 };
        // A rod one voxel across.
        if is_among([j, k, 60], 60..61) { 4 } else { block as u8 }
    });
    assert_eq!(json(&folder.expect(0, &["info", "v.svol", "--json"]))["kind"], "labels");
    for camera in ["front", "left", "top", "30,20"] {
        assert_eq!(shows_something(&folder, 96, &["--camera", camera]), [false, true], "{camera}");
    }
}

#[test]
fn doubles_of_any_size_are_the_same_kind_and_are_named_briefly() {
    let folder = Folder::new();
    let kind = |scale: f64| {
        let values = (0..20_u32.pow(3)).map(|i| scale * (f64::from(i % 20) / 3.0).sin());
        let bytes: Vec<u8> = values.flat_map(f64::to_le_bytes).collect();
        std::fs::write(folder.path("v.raw"), bytes).expect("a temporary folder has room");
        folder.expect(0, &["build", "v.raw", "--dims", "20,20,20", "--dtype", "f64", "-o", "v.svol", "--force"]);
        folder.expect(0, &["verify", "v.svol"]);
        let text = folder.expect(0, &["info", "v.svol"]);
        assert!(text.lines().all(|line| line.len() < 120), "{text}");
        json(&folder.expect(0, &["info", "v.svol", "--json"]))["kind"].clone()
    };
    let ordinary = kind(1.0);
    for scale in [1e-300, 1e-45, 1e37, 1e45, 1e300] {
        assert_eq!(kind(scale), ordinary, "{scale:e}");
    }
}

#[test]
fn a_slice_of_voxels_is_cut_out_by_its_number_alone() {
    let folder = Folder::with_bytes([6, 5, 4], |[x, y, z]| (x + 10 * y + 50 * z) as u8);
    folder.expect(0, &["extract", "v.svol", "--box", ":,2:,3", "-o", "e.raw"]);
    let expected: Vec<u8> = (2..5).flat_map(|y| (0..6).map(move |x| x + 10 * y + 150)).collect();
    assert_eq!(std::fs::read(folder.path("e.raw")).expect("voxels"), expected);
}

#[test]
fn a_histogram_is_drawn_as_it_is_listed() {
    let folder = Folder::with_sphere();
    let said = folder.expect(0, &["histogram", "v.svol", "-o", "h.svg"]);
    assert!(said.contains("h.svg"), "{said}");
    let svg = std::fs::read_to_string(folder.path("h.svg")).expect("a drawing");
    assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>") && svg.contains("opacity"), "{svg}");
    // As many bars as there are bins with voxels, and some frame.
    assert!(svg.matches("<rect").count() > 20, "{}", svg.matches("<rect").count());
    // It is replaced by its kind alone.
    folder.expect(0, &["histogram", "v.svol", "-o", "h.svg", "--linear"]);
    assert_ne!(std::fs::read_to_string(folder.path("h.svg")).expect("a drawing"), svg);
    for other in ["v.svol", "other.svg"] {
        std::fs::write(folder.path("other.svg"), "not a drawing").expect("room");
        assert!(folder.expect(2, &["histogram", "v.svol", "-o", other]).contains(other));
    }
    folder.expect(2, &["histogram", "v.svol", "-o", "h.pdf"]);
}

/// A ramp of 10 per voxel: central differences are 10, and 5 at its ends, where voxels are repeated.
#[test]
fn gradients_are_counted_and_choose_what_shows() {
    let folder = Folder::with_bytes([12, 10, 8], |[x, _, _]| 10 * x as u8);
    let found = json(&folder.expect(0, &["histogram", "v.svol", "--gradient", "--json", "--rows", "4"]));
    let gradient = &found["gradient"];
    assert_eq!([&gradient["known_voxels"], &gradient["unknown_voxels"]].map(|n| n.as_u64()), [Some(960), Some(0)]);
    assert_eq!(gradient["greatest"].as_f64(), Some(10.0));
    let rows: Vec<u64> =
        gradient["rows"].as_array().expect("rows").iter().filter_map(|row| row["voxels"].as_u64()).collect();
    assert_eq!(rows.iter().sum::<u64>(), 960, "{found}");
    assert!(rows[3] == 800 && rows[0] == 0, "{found}");
    let text = folder.expect(0, &["histogram", "v.svol", "--gradient", "--linear"]);
    assert!(text.contains("data units per world unit") && text.contains("99.9 %") && text.contains("800"), "{text}");
    folder.expect(2, &["histogram", "v.svol", "--json"]);

    assert_eq!(folder.scene(&["--gradient-opacity", "4,12"])["gradient_opacity"], serde_json::json!([4.0, 12.0]));
    assert_eq!(folder.scene(&["--gradient-opacity", "4,12"])["mode"], "dvr");
    let opacity = |options: &[&str]| {
        let fog = ["--mode", "dvr", "--tf", "0:white:0.1,120:white:0.1", "--camera", "left"];
        let _ = std::fs::remove_file(folder.path("p.npy"));
        let alphas: Vec<f32> = folder.picture(&[&fog[..], options].concat()).chunks_exact(4).map(|p| p[3]).collect();
        alphas.into_iter().fold(0.0, f32::max)
    };
    let [plain, half, none] =
        [&[][..], &["--gradient-opacity", "0,20"], &["--gradient-opacity", "10.5,20"]].map(opacity);
    assert!(none == 0.0 && half > 0.2 && half < 0.8 * plain, "{plain}, {half}, {none}");
    for wrong in ["3", "3,2", "-1,2", "a,b"] {
        let said = folder.expect(2, &["render", "v.svol", "-o", "x.png", "--gradient-opacity", wrong]);
        assert!(said.contains("G0,G1"), "{said}");
    }
    let said = folder.expect(2, &["render", "v.svol", "-o", "x.png", "--mode", "mip", "--gradient-opacity", "1,2"]);
    assert!(said.contains("gradient_opacity") && said.contains("dvr"), "{said}");
    let said = folder.expect(2, &["render", "v.svol", "-o", "x.png", "--backend", "gpu", "--gradient-opacity", "1,2"]);
    assert!(said.contains("--backend") && said.contains("gradient"), "{said}");
}

/// A cut through noise is even by its own normal: seen head on, the default light gives `0.3 + 0.7` of a colour, and highlights of 0.2.
#[test]
fn cut_normals_light_the_faces_of_cuts() {
    let noise = |[x, y, z]: [usize; 3]| 100 + (x * 7919 + y * 104_729 + z * 1_299_709 + x * y * z * 31) as u8 % 60;
    let folder = Folder::with_bytes([16, 16, 16], noise);
    let cut = ["--clip", "0,-1,0,-8", "--cut-normals"];
    let scene = folder.scene(&cut);
    assert!(scene["cut_normals"] == true && scene["mode"] == "dvr" && scene["shading"]["ambient"] == 0.3, "{scene}");
    assert!(folder.scene(&cut[..2]).get("cut_normals").is_none());
    let spread = |options: &[&str]| {
        let look = [
            "--kind",
            "micro-ct",
            "--mode",
            "dvr",
            "--tf",
            "0:#808080:1,255:#808080:1",
            "--camera",
            "back",
            "--zoom",
            "3",
        ];
        let _ = std::fs::remove_file(folder.path("p.npy"));
        let picture = folder.picture(&[&look[..], options].concat());
        let reds: Vec<f32> = picture.chunks_exact(4).filter(|p| p[3] > 0.99).map(|p| p[0]).collect();
        assert!(reds.len() > 100, "{} pixels show", reds.len());
        let ends = reds.iter().fold([f32::INFINITY, 0.0], |[low, high], &red| [low.min(red), high.max(red)]);
        [255.0 * ends[0], 255.0 * ends[1]]
    };
    let ([low, high], [dark, bright]) = (spread(&cut), spread(&cut[..2]));
    // Grey 128 of 255, and 0.2; the camera is in front, so that rays meet the face at up to some degrees.
    assert!(high <= 128.0 + 51.0 + 1.0 && low > 165.0, "{low} to {high}");
    assert!(dark < 120.0 && bright > dark + 30.0, "{dark} to {bright}");
    let refused = |options: &[&str], words: &[&str]| {
        let said = folder.expect(2, &[&["render", "v.svol", "-o", "x.png", "--cut-normals"], options].concat());
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
    };
    refused(&[], &["--cut-normals", "--clip or --crop"]);
    refused(&["--mode", "mip", "--clip", "1,0,0,5"], &["cut_normals", "mode `dvr`", "found mode `mip`"]);
    refused(&["--iso", "120", "--clip", "1,0,0,5"], &["--iso", "--cut-normals"]);
    refused(&["--unlit", "--clip", "1,0,0,5"], &["--unlit", "--cut-normals"]);
    refused(&["--slice", "k=4"], &["--cut-normals", "face on"]);
    refused(&["--backend", "gpu", "--clip", "1,0,0,5"], &["--backend", "cut_normals"]);
}

#[test]
fn the_usual_surface_of_a_kind_is_taken_where_its_value_occurs() {
    let bytes = Folder::with_bytes([8, 8, 8], |[x, _, _]| if x < 4 { 5 } else { 150 });
    let value = |options: &[&str]| {
        bytes.scene(&[&["--mode", "iso"], options].concat()).pointer("/iso/0/value").and_then(|v| v.as_f64())
    };
    // No byte has 300 Hounsfield units.
    assert!(value(&["--kind", "ct"]).is_some_and(|v| (5.0..150.0).contains(&v)), "{:?}", value(&["--kind", "ct"]));
    std::fs::write(bytes.path("h.raw"), (0..512).flat_map(|i: i16| (4 * i - 1000).to_le_bytes()).collect::<Vec<_>>())
        .expect("room");
    bytes.expect(0, &["build", "h.raw", "--dims", "8,8,8", "--dtype", "i16", "-o", "v.svol", "--force"]);
    assert_eq!(value(&["--kind", "ct"]), Some(300.0));
}

#[test]
fn shells_and_manuals_know_every_command() {
    let folder = Folder::new();
    for shell in ["bash", "zsh", "fish"] {
        let script = folder.expect(0, &["completions", shell]);
        assert!(script.contains("histogram") && script.contains("vertical-exaggeration"), "{shell}");
    }
    folder.expect(0, &["man", "-o", "pages"]);
    assert!(!std::path::Path::new(&folder.path("pages/supervol-help.1")).exists());
    let page = std::fs::read_to_string(folder.path("pages/supervol-render.1")).expect("man wrote it");
    assert!(page.contains("Position of the camera"), "{page}");
}

#[test]
fn decorations_are_drawn_beside_what_is_measured() {
    let folder = Folder::with_sphere();
    let bare = folder.picture(&[]);
    let decorated = folder.picture(&["--decorate"]);
    let changed = bare.iter().zip(&decorated).filter(|(a, b)| a != b).count();
    assert!(changed > 400, "{changed}");
    // The error is that of the picture without them.
    let checked =
        folder.expect(0, &[&["render", "v.svol", "-o", "q.npy", "--decorate", "--check", "100"], &SMALL[..]].concat());
    assert!(checked.contains("largest 0."), "{checked}");
}

/// Rays that are parallel, as of sections, are no reason to leave the box and what its edges are called out.
#[test]
fn sections_have_places_along_their_edges() {
    let folder = Folder::with_sphere();
    let of = |options: &[&str]| {
        let options = [&["--slice", "z=12", "--size", "240x180", "--force"], options].concat();
        let output = folder.path("s.npy");
        folder.expect(0, &[&["render", "v.svol", "-o", &output, "--backend", "cpu"], &options[..]].concat());
        Folder::floats(&output)
    };
    let (bare, decorated) = (of(&[]), of(&["--decorate"]));
    let differs = |x: usize, y: usize| (0..4).any(|c| bare[4 * (240 * y + x) + c] != decorated[4 * (240 * y + x) + c]);
    // The lowest rows hold the first and the last place, the axis, and round places between them.
    let columns = (0..240).filter(|x| (166..180).any(|y| differs(*x, y))).count();
    assert!(columns > 100, "{columns}");
    // The left edge of the section is its other edge.
    let rows = (30..150).filter(|y| (10..36).any(|x| differs(x, *y))).count();
    assert!(rows > 30, "{rows}");
}

/// Nothing is lost without a word.
#[test]
fn options_that_change_nothing_are_said() {
    let folder = Folder::with_sphere();
    let warned = |options: &[&str]| {
        let run =
            folder.run(&[&["render", "v.svol", "--force", "--backend", "cpu", "--size", "48x36"], options].concat());
        assert!(run.status.success());
        String::from_utf8_lossy(&run.stderr).into_owned()
    };
    assert!(warned(&["-o", "a.exr", "--background", "red"]).contains("--background changes nothing"));
    assert!(warned(&["-o", "a.npy", "--background", "red"]).contains("--background changes nothing"));
    assert!(!warned(&["-o", "a.png", "--background", "red"]).contains("changes nothing"));
    let with_gpu_memory = ["-o", "a.png", "--gpu-memory", "100MiB"];
    assert!(warned(&with_gpu_memory).contains("--gpu-memory changes nothing"));
    for option in ["--zoom", "--opacity", "--vertical-exaggeration"] {
        let refused = folder.expect(2, &["render", "v.svol", "-o", "a.png", option, "-1"]);
        assert!(refused.contains("'-1': expected a positive number"), "{refused}");
    }
}

#[test]
fn folders_are_no_containers() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("slices")).expect("a temporary folder has room");
    for command in [&["verify", "slices"][..], &["extract", "slices", "-o", "a.npy"]] {
        let refused = folder.expect(2, command);
        assert!(refused.contains("found a folder") && refused.contains("supervol build"), "{refused}");
    }
}

#[test]
fn standard_output_takes_a_png_and_nothing_else() {
    let folder = Folder::with_sphere();
    folder.expect(0, &[&["render", "v.svol", "-o", "a.png", "--decorate=off"][..], &SMALL[..]].concat());
    let piped = folder.run(&[&["render", "v.svol", "-o", "-"][..], &SMALL[..]].concat());
    assert_eq!(piped.stdout, std::fs::read(folder.path("a.png")).expect("it is written"), "a pipe is not a terminal");
    assert!(String::from_utf8_lossy(&piped.stderr).contains("-: "), "remarks go to standard error");
    let refused = folder.expect(2, &["render", "v.svol", "-o", "-", "--print-scene"]);
    assert!(refused.contains("expected a file"), "{refused}");
}

#[test]
fn a_place_given_by_hand_is_kept_with_its_unit() {
    let folder = Folder::new();
    std::fs::write(folder.path("v.raw"), [7u8, 8, 9, 10, 11, 12, 13, 14]).expect("room");
    let raw = ["build", "v.raw", "--dims", "2x2x2", "--dtype", "uint8", "-o", "v.svol"];
    let turned = ["--spacing", "500um,500um,2mm", "--origin", "-1,2,3", "--direction", "0,1,0,1,0,0,0,0,1"];
    folder.expect(0, &[&raw[..], &turned].concat());
    let info = json(&folder.expect(0, &["info", "v.svol", "--json"]));
    assert_eq!((info["spacing"][2].as_f64(), info["axes"][2]["unit"].as_str()), (Some(2000.0), Some("um")));
    assert_eq!((info["origin"][0].as_f64(), info["left_handed"].as_bool()), (Some(-1.0), Some(true)));
    for name in ["v.nrrd", "v.nii", "v.mha", "v.tif", "v.zarr"] {
        folder.expect(0, &["extract", "v.svol", "-o", name]);
        folder.expect(0, &["build", name, "-o", "again.svol", "--force"]);
        let again = json(&folder.expect(0, &["info", "again.svol", "--json"]));
        let unit = again["axes"][2]["unit"].as_str();
        assert_eq!((again["spacing"][2].as_f64(), unit), (Some(2000.0), Some("um")), "{name}");
    }
    // Options override the data of a file, with a note.
    folder.expect(0, &["build", "v.nrrd", "--spacing", "3,3,3", "-o", "w.svol"]);
    assert!(folder.expect(0, &["info", "w.svol"]).contains("note       the spacing was given by hand"));
    assert!(folder.expect(2, &["build", "v.nrrd", "--spacing", "3,3,-3", "-o", "x.svol"]).contains("spacing"));
}

/// A patient in RAS, the same in LPS, and what `extract` writes of it: one picture, and the space is not lost.
#[test]
fn the_same_patient_is_seen_from_the_same_side() {
    let folder = Folder::new();
    let voxels: Vec<u8> = (0..20 * 16 * 12)
        .map(|i| if i % 20 < 8 && i / 320 > 4 { 120 + (i % 90) as u8 } else { (i % 50) as u8 })
        .collect();
    for (name, space, sign) in [("ras", "right-anterior-superior", 1), ("lps", "left-posterior-superior", -1)] {
        let header = format!(
            "NRRD0004\ntype: uint8\ndimension: 3\nspace: {space}\nsizes: 20 16 12\n\
             space directions: ({sign},0,0) (0,{sign},0) (0,0,2)\nspace origin: ({},{},7)\nencoding: raw\n\n",
            5 * sign,
            -3 * sign
        );
        std::fs::write(folder.path(name), [header.as_bytes(), &voxels].concat()).expect("room");
        folder.expect(0, &["build", name, "-o", &format!("{name}.svol")]);
    }
    folder.expect(0, &["extract", "lps.svol", "-o", "again.nrrd"]);
    folder.expect(0, &["build", "again.nrrd", "-o", "again.svol"]);
    let info = json(&folder.expect(0, &["info", "again.svol", "--json"]));
    assert_eq!((info["space"].as_str(), info["kind"].as_str()), (Some("left-posterior-superior"), Some("mri")));
    let pictures = ["ras", "lps", "again"].map(|name| {
        std::fs::rename(folder.path(&format!("{name}.svol")), folder.path("v.svol")).expect("it was built");
        folder.picture(&[])
    });
    assert_eq!(pictures[1], pictures[2]);
    let apart = pictures[0].iter().zip(&pictures[1]).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(apart < 1e-3 && pictures[0].iter().any(|v| *v > 0.1), "{apart}");
}

/// Nothing is accepted that does nothing.
#[test]
fn options_of_a_picture_are_refused_where_none_is_written() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "sphere", "--dims", "8,8,8", "-o", "c.svol"]);
    for options in
        [&["--decorate"][..], &["--error-map", "e.npy"], &["--work-map", "w.npy"], &["--stats", "s.json"], &["--check"]]
    {
        let message = folder.expect(2, &[&["render", "c.svol", "--print-scene"][..], options].concat());
        assert!(message.contains("--output"), "{message}");
    }
}

#[test]
fn surfaces_stand_inside_the_volume() {
    let folder = Folder::with_sphere();
    let surfaces = ["--mode", "dvr", "--surface", "0.2:#ff0000:0.5", "--surface", "-0.3"];
    let scene = folder.scene(&surfaces);
    assert_eq!((scene["mode"].as_str(), scene["iso"].as_array().map(Vec::len)), (Some("dvr"), Some(2)));
    assert_eq!((&scene["iso"][0]["value"], &scene["iso"][0]["alpha"]), (&0.2.into(), &0.5.into()));
    assert!(scene["shading"].is_object(), "surfaces are lit");
    assert_eq!(folder.scene(&surfaces[2..])["mode"], "dvr");
    assert_ne!(folder.picture(&surfaces), folder.picture(&["--mode", "dvr"]));
    // The scene that is printed means the same.
    std::fs::write(folder.path("s.json"), scene.to_string()).expect("room");
    assert_eq!(folder.picture(&["--scene", "s.json"]), folder.picture(&surfaces));
    let refused = folder.expect(2, &["render", "v.svol", "-o", "p.png", "--mode", "mip", "--surface", "0.2"]);
    assert!(refused.contains("mode dvr"), "{refused}");
    let refused = folder.expect(2, &["render", "v.svol", "-o", "p.png", "--mode", "dvr", "--iso", "0.2"]);
    assert!(refused.contains("--surface"), "{refused}");
    folder.expect(2, &["render", "v.svol", "-o", "p.png", "--iso", "0.1", "--surface", "0.2"]);
}
