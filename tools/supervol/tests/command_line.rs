//! The command line is a contract: names, outputs, JSON keys, exit codes.

use std::path::Path;
use std::process::{Command, Output};

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).display().to_string()
    }

    fn run(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_supervol"))
            .args(arguments)
            .current_dir(self.0.path())
            .output()
            .expect("the program starts")
    }

    /// Runs and demands an exit code; returns standard output, or standard error where the code is not 0.
    fn expect(&self, code: i32, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let (out, err) = (text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(code), "supervol {arguments:?}\n{out}\n{err}");
        if code == 0 { out } else { err }
    }
}

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e} in {text}"))
}

#[test]
fn a_raw_volume_goes_in_and_the_same_voxels_come_out() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "marschner-lobb", "--dims", "40,30,20", "-o", "a.raw"]);
    let raw = std::fs::read(folder.path("a.raw")).expect("synth wrote it");
    assert_eq!(raw.len(), 40 * 30 * 20);
    let build = [
        "build",
        "a.raw",
        "--dims",
        "40,30,20",
        "--dtype",
        "u8",
        "--spacing",
        "1,2,3",
        "--brick",
        "16",
        "-o",
        "a.svol",
    ];
    folder.expect(0, &build);
    assert!(folder.expect(2, &build).contains("--force"));
    folder.expect(0, &[&build[..], &["--force", "--json"]].concat());
    folder.expect(0, &["verify", "a.svol"]);

    let info = json(&folder.expect(0, &["info", "a.svol", "--json"]));
    for key in [
        "dims",
        "spacing",
        "origin",
        "direction",
        "dtype",
        "value_range",
        "unit",
        "axes",
        "bricks",
        "levels",
        "nodata",
        "source",
        "format_version",
    ] {
        assert!(info.get(key).is_some(), "info --json has no {key}");
    }
    assert_eq!(info["dims"], serde_json::json!([40, 30, 20]));
    assert_eq!(info["spacing"], serde_json::json!([1.0, 2.0, 3.0]));
    assert_eq!(info["direction"].as_array().map(Vec::len), Some(9));
    for key in ["factors", "dims", "bricks", "bytes", "error"] {
        assert!(info["levels"][0].get(key).is_some(), "a level has no {key}");
    }

    folder.expect(0, &["extract", "a.svol", "-o", "b.raw"]);
    assert_eq!(std::fs::read(folder.path("b.raw")).expect("extract wrote it"), raw);
    folder.expect(0, &["extract", "a.svol", "--box", "4:8,0:5,2:3", "-o", "b.npy"]);
    let npy = std::fs::read(folder.path("b.npy")).expect("extract wrote it");
    let header = String::from_utf8_lossy(&npy[..npy.len() - 20]).into_owned();
    assert!(header.contains("'shape': (1, 5, 4)") && header.contains("|u1"), "{header}");
    let row: Vec<u8> = (0..5).flat_map(|y| raw[(2 * 30 + y) * 40 + 4..][..4].to_vec()).collect();
    assert_eq!(npy[npy.len() - 20..], row);
    folder.expect(0, &["extract", "a.svol", "--level", "1", "-o", "c.nrrd"]);
    folder.expect(0, &["build", "c.nrrd", "-o", "c.svol"]);
}

#[test]
fn pictures_are_written_in_three_formats_with_statistics() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "vessels", "--dims", "48,48,48", "-o", "v.svol", "--brick", "32"]);
    let scene = r#"{"camera": {"eye": [150, 30, 80], "target": [24, 24, 24], "up": [0, 0, 1], "fov_y": 30},
        "image": {"width": 40, "height": 30}, "mode": "mip", "transfer_function": "grey"}"#;
    std::fs::write(folder.path("s.json"), scene).expect("a temporary folder has room");
    for name in ["p.png", "p.exr", "p.npy"] {
        folder.expect(
            0,
            &[
                "render",
                "v.svol",
                "--scene",
                "s.json",
                "-o",
                name,
                "--backend",
                "cpu",
                "--level",
                "0",
                "--stats",
                "t.json",
            ],
        );
        assert!(Path::new(&folder.path(name)).metadata().expect("it is there").len() > 100);
    }
    let stats = json(&std::fs::read_to_string(folder.path("t.json")).expect("render wrote it"));
    for key in [
        "render_ms",
        "cpu_ms",
        "peak_rss_bytes",
        "page_ins",
        "repeated_page_ins",
        "misses",
        "uses",
        "evictions",
        "converged",
    ] {
        assert!(stats.get(key).is_some(), "--stats has no {key}");
    }
    assert_eq!(stats["converged"], true);
    let npy = std::fs::read(folder.path("p.npy")).expect("render wrote it");
    assert!(String::from_utf8_lossy(&npy[..128]).contains("(30, 40, 4)"));
    // The reference integrator and the ray caster write the same picture to a fraction of a grey level.
    folder
        .expect(0, &["render", "v.svol", "--scene", "s.json", "-o", "r.npy", "--backend", "reference", "--level", "0"]);
    let reference = std::fs::read(folder.path("r.npy")).expect("render wrote it");
    let pixels = |bytes: &[u8]| -> Vec<f32> {
        let start = bytes.len() - 30 * 40 * 4 * 4;
        bytes[start..].as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
    };
    let (found, expected) = (pixels(&npy), pixels(&reference));
    assert!(expected.iter().any(|v| *v > 0.1), "the vessels are in the picture");
    let worst = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst <= 0.5 / 255.0, "{worst}");
}

#[test]
fn exit_codes_say_whose_fault_it_is() {
    let folder = Folder::new();
    folder.expect(2, &["no-such-command"]);
    folder.expect(2, &["build", "a.raw", "--dims", "1,2", "-o", "a.svol"]);
    assert!(folder.expect(2, &["info", "nothing.svol"]).contains("nothing.svol"));
    std::fs::write(folder.path("noise.raw"), vec![7u8; 1000]).expect("a temporary folder has room");
    assert!(
        folder.expect(1, &["build", "noise.raw", "--dims", "9,9,9", "--dtype", "u8", "-o", "a.svol"]).contains("729")
    );
    folder.expect(
        2,
        &["build", "noise.raw", "--dims", "10,10,10", "--dtype", "u8", "-o", "a.svol", "--codec", "wavelet"],
    );
    folder.expect(0, &["build", "noise.raw", "--dims", "10,10,10", "--dtype", "u8", "-o", "a.svol"]);
    let mut bytes = std::fs::read(folder.path("a.svol")).expect("build wrote it");
    bytes[100] ^= 1;
    std::fs::write(folder.path("bad.svol"), &bytes).expect("a temporary folder has room");
    assert!(folder.expect(1, &["verify", "bad.svol"]).contains("header"));
    bytes.truncate(5000);
    std::fs::write(folder.path("cut.svol"), &bytes).expect("a temporary folder has room");
    folder.expect(1, &["verify", "cut.svol"]);
    std::fs::write(folder.path("s.json"), r#"{"camra": 1}"#).expect("a temporary folder has room");
    assert!(folder.expect(2, &["render", "a.svol", "--scene", "s.json", "-o", "p.png"]).contains("camra"));
    assert!(folder.expect(2, &["render", "a.svol", "--level", "3", "-o", "p.png"]).contains("levels 0 to 0"));
    let left: Vec<_> = std::fs::read_dir(folder.0.path())
        .expect("the folder can be listed")
        .map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned())
        .filter(|name| name.contains("partial"))
        .collect();
    assert!(left.is_empty(), "unfinished files are left: {left:?}");
}

#[test]
fn bench_goes_on_without_the_peer_and_says_why_it_is_missing() {
    let folder = Folder::new();
    let python = ["--python", "/nowhere/python3", "--environment", "environment"];
    let run = [&["bench", "--peers", "--quick", "--scene", "vessels", "-o", "out"][..], &python].concat();
    let page = folder.expect(0, &run);
    assert!(page.contains("VTK not measured: no Python: /nowhere/python3"), "{page}");
    assert!(page.contains("| vessels | shaded   | Supervol | default"), "{page}");
    let json = json(&std::fs::read_to_string(folder.path("out/peers.json")).expect("bench wrote it"));
    assert_eq!(json["peer"]["measured"], false);
    assert!(json["rows"].as_array().is_some_and(|rows| rows.iter().all(|row| row["program"] == "Supervol")));
    assert!(folder.expect(2, &["bench", "--quick", "--scene", "teapot"]).contains("teapot"));
}

#[test]
fn a_chart_is_written_as_a_page_and_as_points() {
    let folder = Folder::new();
    folder.expect(0, &["chart", "--quick", "--scene", "marschner-lobb", "-o", "report"]);
    let read = |name: &str| std::fs::read_to_string(folder.0.path().join("report").join(name)).expect("chart wrote it");
    let points = json(&read("points.json"));
    let points = points.as_array().expect("an array of points");
    for key in [
        "scene",
        "transfer_function",
        "method",
        "parameters",
        "cpu_ms",
        "wall_ms",
        "samples",
        "bytes_read",
        "linf",
        "p999",
        "rmse",
        "psnr_db",
        "bias",
        "pareto",
        "default",
    ] {
        assert!(points.iter().all(|point| point.get(key).is_some()), "a point has no {key}");
    }
    let csv = read("points.csv");
    assert_eq!(csv.lines().count(), points.len() + 1);
    let page = read("report.html");
    assert!(page.contains("<svg") && page.contains("supervol chart --quick --scene marschner-lobb"));
    let files = std::fs::read_dir(folder.path("report")).expect("the folder can be listed").count();
    assert_eq!(files, 3, "containers and unfinished files are removed");
    assert!(folder.expect(2, &["chart", "--scene", "no-such", "-o", "report"]).contains("marschner-lobb"));
}

#[test]
fn stability_is_written_as_a_page_and_as_regimes() {
    let folder = Folder::new();
    let unknown = folder.expect(2, &["chart", "--stability", "--only", "S99", "-o", "report"]);
    let known = unknown.rsplit("there are ").next().expect("the known ones are listed");
    // One that exists already; S06 as soon as it does.
    let Some(id) = known.split([',', ' ', '\n']).filter(|id| id.starts_with('S')).min_by_key(|id| *id != "S06") else {
        panic!("no regime exists: {unknown}");
    };
    folder.expect(0, &["chart", "--stability", "--only", id, "--quick", "-o", "report"]);
    let read = |name: &str| std::fs::read_to_string(folder.0.path().join("report").join(name)).expect("chart wrote it");
    let regimes = json(&read("stability.json"));
    for key in ["id", "title", "curve", "gate", "value", "pass", "note"] {
        assert!(regimes[0].get(key).is_some(), "a regime has no {key}");
    }
    for key in ["x", "measured", "expected"] {
        assert!(regimes[0]["curve"][0].get(key).is_some(), "a point of a curve has no {key}");
    }
    assert!(regimes[0]["id"] == *id && read("stability.html").contains(id));
}
