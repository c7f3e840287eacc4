//! The command line is a contract: names, outputs, JSON keys, exit codes.

use std::path::Path;
use std::process::Command;

use supervol_runtime::engines::gpu::device::{ADAPTER_VARIABLE, GpuDevice};
use supervol_runtime::render::renderer::NO_DEVICE;

use crate::support;
use support::{Folder, json};

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
    // The report states the choice of the axes of coarser levels.
    assert!(info["levels"][0]["rms_kept"].is_null());
    let kept = info["levels"][1]["rms_kept"].as_array().expect("auto measures").clone();
    assert!(kept.len() == 3 && kept.iter().all(|share| (0.0..=1.0).contains(&share.as_f64().expect("a share"))));
    assert!(folder.expect(0, &["info", "a.svol"]).contains("share of amplitudes"));

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
fn other_formats_go_in_and_out_and_several_volumes_are_chosen_from() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "sphere", "--dims", "20,20,20", "--dtype", "u8", "-o", "v.svol"]);
    for name in ["v.nii", "v.nii.gz", "v.mha", "v.tif", "v.vti"] {
        folder.expect(0, &["extract", "v.svol", "-o", name]);
        assert!(folder.expect(2, &["extract", "v.svol", "-o", name]).contains("--force"));
        folder.expect(0, &["build", name, "-o", "again.svol", "--force"]);
        folder.expect(0, &["extract", "again.svol", "-o", "again.raw", "--force"]);
        folder.expect(0, &["extract", "v.svol", "-o", "v.raw", "--force"]);
        let bytes = |name: &str| std::fs::read(folder.path(name)).expect("extract wrote it");
        assert!(bytes("v.raw") == bytes("again.raw"), "{name}");
        let message = folder.expect(2, &["build", name, "--frame", "1", "-o", "again.svol", "--force"]);
        assert!(message.contains("--frame 1") && message.contains(name), "{message}");
    }
    // The chosen part is recorded in the container.
    folder.expect(0, &["build", "v.nii", "--frame", "0", "-o", "again.svol", "--force"]);
    let info = json(&folder.expect(0, &["info", "again.svol", "--json"]));
    assert_eq!(info["source"]["name"], "v.nii --frame 0");
    // A folder of slices, which is not where the output may be looked for.
    std::fs::create_dir(folder.path("slices")).expect("room");
    for z in 0..3 {
        let name = format!("slices/s{z}.tif");
        folder.expect(0, &["extract", "v.svol", "--box", &format!("0:20,0:20,{z}:{}", z + 1), "-o", &name]);
    }
    folder.expect(0, &["build", "slices", "--spacing", "1mm,1mm,2mm", "-o", "slices/stack.svol"]);
    let info = json(&folder.expect(0, &["info", "slices/stack.svol", "--json"]));
    assert_eq!((&info["dims"], &info["source"]["name"]), (&serde_json::json!([20, 20, 3]), &"slices".into()));
    assert_eq!(info["spacing"], serde_json::json!([1.0, 1.0, 2.0]));
    assert!(folder.expect(2, &["build", "slices", "--series", "1", "-o", "x.svol"]).contains("no DICOM"));

    for name in ["m.ply", "m.stl", "m.obj"] {
        assert!(folder.expect(0, &["mesh", "v.svol", "--iso", "100", "-o", name]).contains("triangles"));
        assert!(folder.expect(2, &["mesh", "v.svol", "--iso", "100", "-o", name]).contains("--force"));
    }
    assert!(folder.expect(2, &["mesh", "v.svol", "--iso", "-5", "-o", "n.ply"]).contains("no surface"));
    assert!(folder.expect(2, &["mesh", "v.svol", "--iso", "100", "-o", "v.svol", "--force"]).contains("v.svol"));
    assert!(folder.expect(2, &["mesh", "v.svol", "--iso", "nan", "-o", "n.ply"]).contains("finite"));
    assert!(!Path::new(&folder.path("n.ply")).exists());
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
    assert!(found.iter().chain(&expected).all(|v| v.is_finite()), "a channel is no number");
    let worst = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst <= 0.5 / 255.0, "{worst}");
}

/// Backend of a picture, and the lines of standard error about it. The adapter variable names lavapipe.
fn about_backend(folder: &Folder, backend: &[&str]) -> (String, Vec<String>) {
    let picture = ["render", "v.svol", "-o", "p.png", "--size", "16x12", "--stats", "t.json"];
    let command = [&picture[..], backend].concat();
    let output = folder.command(&command).env(ADAPTER_VARIABLE, "llvmpipe").output().expect("the program starts");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{text}");
    let stats = json(&std::fs::read_to_string(folder.path("t.json")).expect("render wrote it"));
    // Drivers have their own to say.
    let lines = text.lines().filter(|line| line.contains("--backend")).map(str::to_owned).collect();
    (stats["backend"].as_str().expect("a name").to_owned(), lines)
}

#[test]
fn who_casts_the_rays_and_why_is_said_in_one_line() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "vessels", "--dims", "20,20,20", "-o", "v.svol"]);
    let (backend, lines) = about_backend(&folder, &["--backend", "auto"]);
    let [line] = &lines[..] else { panic!("not one line: {lines:?}") };
    assert!(line.starts_with(&format!("--backend auto: {backend}, because ")), "{line}");
    // Without `--backend`, only an unusual choice is reported.
    let is_plain = line.ends_with(NO_DEVICE);
    assert_eq!(about_backend(&folder, &[]).1, if is_plain { vec![] } else { lines.clone() });
    assert!(about_backend(&folder, &["--backend", "cpu"]).1.is_empty());
}

#[test]
#[allow(clippy::print_stderr, reason = "a skipped test must be seen")]
fn a_software_adapter_that_is_named_warns_once() {
    if let Err(error) = GpuDevice::open_named(Some("llvmpipe")) {
        let is_required = std::env::var_os("SUPERVOL_REQUIRE_GPU").is_some_and(|v| v == "1");
        assert!(!is_required, "SUPERVOL_REQUIRE_GPU=1, but {error}");
        eprintln!("SKIPPED: no software adapter ({error})");
        return;
    }
    let folder = Folder::new();
    folder.expect(0, &["synth", "vessels", "--dims", "20,20,20", "-o", "v.svol"]);
    let (backend, lines) = about_backend(&folder, &["--backend", "gpu"]);
    let [line] = &lines[..] else { panic!("not one line: {lines:?}") };
    assert_eq!(backend, "gpu");
    assert!(line.starts_with("llvmpipe") && line.contains("is a processor: --backend cpu draws"), "{line}");
}

/// A scene over 48^3 voxels whose mode and image members are given.
fn check_scene(members: &str) -> String {
    format!(
        r#"{{"camera": {{"eye": [150, 30, 80], "target": [24, 24, 24], "up": [0, 0, 1], "fov_y": 30}}, {members},
            "transfer_function": {{"points": [{{"value": 40, "color": [0.2, 0.4, 1], "alpha": 0}},
                                              {{"value": 255, "color": [1, 0.6, 0.2], "alpha": 0.4}}]}}}}"#
    )
}

#[test]
fn a_check_says_how_far_the_picture_is_from_the_exact_one() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "marschner-lobb", "--dims", "48,48,48", "-o", "v.svol", "--brick", "16"]);
    std::fs::write(folder.path("s.json"), check_scene(r#""image": {"width": 40, "height": 30}"#)).expect("room");
    let render = ["render", "v.svol", "--scene", "s.json", "-o", "p.png", "--stats", "t.json"];
    let check_by = |backend: &str, more: &[&str]| -> (String, serde_json::Value) {
        let printed = folder.expect(0, &[&render[..], &["--backend", backend], more].concat());
        let stats = json(&std::fs::read_to_string(folder.path("t.json")).expect("render wrote it"));
        (printed, stats["error_measured"].clone())
    };
    let check = |more: &[&str]| check_by("cpu", more);
    let number = |measured: &serde_json::Value, key: &str| measured[key].as_f64().unwrap_or_else(|| panic!("no {key}"));

    let (printed, measured) = check(&["--level", "0"]);
    assert!(measured.is_null() && !printed.contains("error against"), "nobody asked: {printed}");

    let (printed, measured) = check(&["--level", "0", "--check"]);
    assert_eq!((number(&measured, "rays"), number(&measured, "level")), (1000.0, 0.0));
    let [largest, p999, mean] =
        ["largest_grey_levels", "p999_grey_levels", "mean_grey_levels"].map(|key| number(&measured, key));
    assert!(largest <= 0.5 && largest > 0.0, "{measured}");
    assert!(p999 <= largest && mean.abs() <= p999, "{measured}");
    for part in ["1000 rays", "level 0", "255 grey levels", "largest", "99.9th percentile", "mean"] {
        assert!(printed.contains(part), "'{part}' is not in {printed}");
    }
    let figure = format!("largest {largest:.4}, 99.9th percentile {p999:.4}");
    assert!(printed.contains(&figure), "'{figure}' is not in {printed}");
    assert_eq!(check(&["--level", "0", "--check"]).1["largest_grey_levels"], measured["largest_grey_levels"]);

    // The predicted error, term by term, is at least the measured one.
    let stats = json(&std::fs::read_to_string(folder.path("t.json")).expect("render wrote it"));
    let predicted = &stats["error_predicted"];
    let terms = ["cells", "ray_ends", "transfer_function", "levels", "rounding"];
    let levels_of =
        |term: &str| predicted[term]["grey_levels"].as_f64().unwrap_or_else(|| panic!("no {term}: {predicted}"));
    assert!((terms.map(levels_of).iter().sum::<f64>() - levels_of("total")).abs() < 1e-9, "{predicted}");
    assert!(largest <= levels_of("total") && predicted["level"] == 0, "{measured}, {predicted}");
    let bounds = ["total", "cells", "ray_ends", "levels"].map(|term| predicted[term]["is_bound"].as_bool());
    assert_eq!(bounds, [false, false, true, true].map(Some), "{predicted}");

    // Against the finest level, whatever is drawn.
    let (printed, _) = check(&["--level", "0", "--error-map", "e.npy", "--force"]);
    assert!(printed.contains("stated error, against the finest level"), "{printed}");
    let stats = json(&std::fs::read_to_string(folder.path("t.json")).expect("render wrote it"));
    let stated = stats["error_stated"]["largest_grey_levels"].as_f64().expect("packets state their error");
    assert!(largest <= stated && stated <= levels_of("total") + 1e-4, "{stats}");
    let map = std::fs::read(folder.path("e.npy")).expect("render wrote it");
    let shares = map[map.len() - 1200 * 16..].chunks_exact(16).map(|p| f32::from_le_bytes([p[0], p[1], p[2], p[3]]));
    assert!((f64::from(shares.fold(0.0, f32::max)) * 255.0 - stated).abs() < 1e-4, "{stats}");

    // More rays than pixels: every pixel, once.
    assert_eq!(number(&check(&["--check", "5000", "--level", "0"]).1, "rays"), 1200.0);
    // The picture of level 1 is exact for level 1 ...
    let (_, of_level) = check(&["--level", "1", "--check", "200"]);
    assert_eq!((number(&of_level, "rays"), number(&of_level, "level")), (200.0, 1.0));
    assert!(number(&of_level, "largest_grey_levels") <= 0.5, "{of_level}");
    // ... but levels chosen automatically stand in for level 0.
    std::fs::write(folder.path("s.json"), check_scene(r#""image": {"width": 8, "height": 6}"#)).expect("room");
    let (printed, automatic) = check(&["--check"]);
    assert_eq!((number(&automatic, "rays"), number(&automatic, "level")), (48.0, 0.0));
    assert!(number(&automatic, "largest_grey_levels") > 2.0, "levels of few voxels: {printed}");

    // Four rays make a pixel.
    let averaged = r#""image": {"width": 40, "height": 30}, "samples_per_pixel": 4"#;
    std::fs::write(folder.path("s.json"), check_scene(averaged)).expect("room");
    let (_, averaged) = check(&["--level", "0", "--check", "100"]);
    assert_eq!((number(&averaged, "rays"), number(&averaged, "pixels")), (100.0, 25.0));
    assert!(number(&averaged, "largest_grey_levels") <= 0.5, "{averaged}");
    // The reference is the reference.
    let exact = check_by("reference", &["--level", "0", "--check"]).1;
    assert_eq!(number(&exact, "largest_grey_levels"), 0.0);
}

/// The deadline counts from the start of the program, and the picture is handed over no later. A deadline that has
/// already passed is no reason to wait.
#[test]
fn the_time_until_a_picture_is_there_is_told() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "marschner-lobb", "--dims", "64,64,64", "-o", "v.svol"]);
    let render = ["render", "v.svol", "-o", "p.png", "--stats", "t.json", "--backend", "cpu", "--force"];
    for more in [&[][..], &["--time-budget", "1"], &["--check", "5000"]] {
        let begun = std::time::Instant::now();
        folder.expect(0, &[&render[..], more].concat());
        let outside = begun.elapsed().as_secs_f64() * 1e3;
        let stats = json(&std::fs::read_to_string(folder.path("t.json")).expect("render wrote it"));
        let [drawn, there] = ["total_ms", "handed_over_ms"].map(|key| stats[key].as_f64().expect("a number"));
        assert!(0.0 < drawn && drawn < there && there < outside, "{more:?}: {drawn}, {there}, {outside}");
    }
}

/// Work map as numbers and as colours; the picture is the same with and without it.
#[test]
fn work_maps_count_what_the_statistics_count() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "sphere", "--dims", "48,48,48", "-o", "v.svol", "--brick", "16"]);
    let render = |output: &str, more: &[&str]| {
        let options =
            ["render", "v.svol", "-o", output, "--size", "40x30", "--level", "0", "--stats", "t.json", "--force"];
        folder.expect(0, &[&options[..], &["--supersample", "1", "--backend", "cpu"], more].concat());
        json(&std::fs::read_to_string(folder.path("t.json")).expect("render wrote it"))
    };
    let read = |name: &str| std::fs::read(folder.path(name)).expect("render wrote it");
    render("plain.npy", &[]);
    for mode in ["dvr", "mip", "mean", "iso"] {
        render("plain.npy", &["--mode", mode]);
        let stats = render("p.npy", &["--mode", mode, "--work-map", "w.npy"]);
        assert!(read("p.npy") == read("plain.npy"), "{mode}: another picture");
        let map = read("w.npy");
        let pixels = map[map.len() - 1200 * 16..].chunks_exact(16);
        let sum = |channel: usize| {
            let floats = pixels.clone().map(|p| p[4 * channel..4 * channel + 4].try_into().expect("four bytes"));
            floats.map(|bytes| f64::from(f32::from_le_bytes(bytes))).sum::<f64>()
        };
        let [cells, leaps] = ["cells", "macro_cells_skipped"].map(|name| stats[name].as_f64().expect("a count"));
        assert_eq!((sum(0), sum(1)), (cells, leaps), "{mode}");
        assert!(sum(0) > 0.0 && sum(3) == 1200.0, "{mode}");
    }
    render("p.png", &["--work-map", "w.png"]);
    assert!(read("w.png").starts_with(b"\x89PNG"));
    for wrong in [&["--backend", "reference"][..], &["--backend", "gpu"]] {
        let options = ["render", "v.svol", "-o", "p.png", "--work-map", "w.png"];
        assert!(folder.expect(2, &[&options[..], wrong].concat()).contains("--work-map"), "{wrong:?}");
    }
    folder.expect(2, &["render", "v.svol", "-o", "p.png", "--work-map", "p.png"]);
}

#[test]
fn a_check_that_does_not_fit_says_what_to_do_before_anything_is_drawn() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "marschner-lobb", "--dims", "128,128,128", "-o", "v.svol", "--brick", "16"]);
    let scene = check_scene(r#""image": {"width": 40, "height": 30}"#);
    std::fs::write(folder.path("s.json"), scene).expect("room");
    // 8 bytes for each of 128^3 voxels are 16 MiB.
    let render = ["render", "v.svol", "--scene", "s.json", "-o", "p.png", "--backend", "cpu", "--host-memory", "12MiB"];
    folder.expect(0, &render);
    std::fs::remove_file(folder.path("p.png")).expect("render wrote it");
    let refused = folder.expect(2, &[&render[..], &["--check"]].concat());
    for part in ["--check", "level 0", "--host-memory 17MiB", "--level 1"] {
        assert!(refused.contains(part), "'{part}' is not in {refused}");
    }
    assert!(!Path::new(&folder.path("p.png")).exists(), "a picture was drawn");
    folder.expect(0, &[&render[..], &["--check", "50", "--level", "1"]].concat());
    folder.expect(0, &[&render[..9], &["17MiB", "--check", "50"]].concat());
    // A picture goes round a brick that cannot be read; the reference does not.
    let mut bytes = std::fs::read(folder.path("v.svol")).expect("synth wrote it");
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0xff;
    std::fs::write(folder.path("v.svol"), &bytes).expect("room");
    folder.expect(0, &[&render[..9], &["17MiB", "--level", "0"]].concat());
    let unreadable = folder.expect(1, &[&render[..9], &["17MiB", "--level", "0", "--check"]].concat());
    assert!(unreadable.contains("--check") && unreadable.contains("brick"), "{unreadable}");
    for wrong in ["0", "-1", "many"] {
        folder.expect(2, &[&render[..], &["--check", wrong]].concat());
    }
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
    let build = ["build", "noise.raw", "--dims", "10,10,10", "--dtype", "u8", "-o", "a.svol"];
    for bound in ["-1", "nan", "much", "1/0"] {
        let refused = folder.expect(2, &[&build[..], &[&format!("--max-error={bound}")]].concat());
        assert!(refused.contains("--max-error") && refused.contains("not negative"), "{refused}");
        assert!(!Path::new(&folder.path("a.svol")).exists(), "--max-error {bound} wrote a container");
    }
    folder.expect(0, &[&build[..], &["--max-error", "0"]].concat());
    folder.expect(0, &[&build[..], &["--max-error", "0%", "--force"]].concat());
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
fn bench_draws_volumes_of_ones_own_and_keeps_records() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "marschner-lobb", "--dims", "24,20,16", "-o", "own.raw"]);
    let shape = ["--dims", "24,20,16", "--dtype", "u8", "--spacing", "1,1,2"];
    let bench = ["bench", "--volume", "own.raw", "--size", "40x30", "--pixels", "50", "--repeats", "1", "-o", "out"];
    let page = folder.expect(0, &[&bench[..], &shape, &["--record", "records"]].concat());
    assert!(page.contains("| own   | default | Supervol | default (cell by cell) | 24 x 20 x 16 |"), "{page}");
    let row = &json(&std::fs::read_to_string(folder.path("out/peers.json")).expect("bench wrote it"))["rows"][0];
    assert!(row["from_reference"]["linf"].as_f64().is_some_and(|error| error <= 0.5), "{row}");
    assert_eq!((row["error_pixels"].as_u64(), row["cost"]["repeats"].as_u64()), (Some(50), Some(1)));
    assert!(folder.0.path().join("out/own-default-supervol-default.png").exists());

    let only = |name: &Path| {
        let found: Vec<_> = std::fs::read_dir(name).expect("a folder").map(|e| e.expect("an entry").path()).collect();
        assert_eq!(found.len(), 1, "{found:?}");
        found[0].clone()
    };
    let record = only(&only(&folder.0.path().join("records")));
    let lines = |path: &Path| std::fs::read_to_string(path).expect("a record").lines().count();
    assert_eq!(lines(&record), 2);
    let again = record.display().to_string();
    folder.expect(0, &[&bench[..], &shape, &["--record", &again]].concat());
    assert_eq!(lines(&record), 3);

    assert!(folder.expect(2, &["bench", "--volume", "own.raw", "--scene", "vessels"]).contains("--scene"));
    assert!(folder.expect(2, &["bench", "--size", "40"]).contains("WIDTHxHEIGHT"));
    assert!(folder.expect(2, &[&["bench", "--quick"][..], &shape].concat()).contains("--volume"));
    folder.expect(1, &["bench", "--volume", "own.raw"]);
}

#[test]
fn bench_moves_along_camera_paths() {
    let folder = Folder::new();
    let small = ["--quick", "--scene", "vessels", "--edge", "32", "--size", "24x18", "--shading", "unshaded"];
    let page = folder.expect(0, &[&["bench", "--path", "orbit", "-o", "out"][..], &small].concat());
    assert!(page.contains("| vessels | unshaded | 32 x 32 x 32 |"), "{page}");
    let json = json(&std::fs::read_to_string(folder.path("out/path-orbit.json")).expect("bench wrote it"));
    let frames = json["rides"][0]["frames"].as_array().expect("frames");
    assert_eq!(frames.len(), 60);
    for key in ["ms", "cpu_ms", "page_ins"] {
        assert!(frames.iter().all(|frame| frame.get(key).is_some()), "a frame has no {key}");
    }
    for name in ["00", "30", "59"] {
        assert!(folder.0.path().join(format!("out/vessels-unshaded-orbit-{name}.png")).exists());
    }
    let one = r#"{"name": "one", "what": "Stands.", "fov_y": 30, "up": [0, 0, 1],
                  "frames": [{"eye": [3, 0, 0], "target": [0, 0, 0]}]}"#;
    std::fs::write(folder.path("one.json"), one).expect("a temporary folder has room");
    folder.expect(0, &[&["bench", "--path", "one.json"][..], &small].concat());
    assert!(folder.expect(2, &["bench", "--path", "nowhere"]).contains("orbit, dolly"));
    std::fs::write(folder.path("two.json"), one.replace("eye", "I")).expect("a temporary folder has room");
    assert!(folder.expect(2, &["bench", "--path", "two.json"]).contains("two.json"));
}

/// On every look the default keeps what is asked and stated, is as exact as all of level 0, and more so than samples.
fn default_is_near_exact_at_level_0(points: &[serde_json::Value]) {
    let looks = ["smooth", "smooth shaded", "spike"];
    for look in looks {
        let number = |method: &str, parameters: &str, key: &str| {
            let is = |p: &&serde_json::Value| {
                p["transfer_function"] == look && p["method"] == method && p["parameters"] == parameters
            };
            let point = points.iter().find(is).unwrap_or_else(|| panic!("{method} {parameters} on {look}"));
            point[key].as_f64()
        };
        let default = |key: &str| number("default", "--max-error 0.5/255", key).expect("a number");
        assert!(default("p999") < 0.5 / 255.0 && default("cpu_ms") > 0.0, "{look}");
        assert!(default("linf") <= default("stated") && default("stated") <= default("max_error"), "{look}");
        assert_eq!(number("level of detail", "level 0", "linf"), Some(default("linf")), "{look}");
        let sampled = |key: &str| number("midpoint samples", "step 1 voxel", key);
        assert!(sampled("stated").is_none() && sampled("linf").expect("a number") > default("linf"), "{look}");
    }
    assert!(points.iter().filter(|p| p["pareto"] == true).count() >= looks.len());
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
        "max_error",
    ] {
        assert!(points.iter().all(|point| point.get(key).is_some()), "a point has no {key}");
    }
    let csv = read("points.csv");
    assert_eq!(csv.lines().count(), points.len() + 1);
    // The default is a curve over the error that is asked for, on every picture; what users get is one point of it.
    for look in ["smooth", "smooth shaded", "spike"] {
        let of_look = points.iter().filter(|point| point["transfer_function"] == look && point["method"] == "default");
        let asked: Vec<_> =
            of_look.clone().map(|point| point["max_error"].as_f64().expect("a number") * 255.0).collect();
        assert!(asked.len() == 7 && asked.is_sorted_by(|a, b| a > b), "{look}: {asked:?}");
        let defaults: Vec<_> = of_look.filter(|point| point["default"] == true).collect();
        assert!(defaults.len() == 1 && defaults[0]["parameters"] == "--max-error 0.5/255", "{look}: {defaults:?}");
        assert!(
            points.iter().any(|point| point["max_error"].is_null()),
            "methods of comparison are asked for no error"
        );
    }
    default_is_near_exact_at_level_0(points);
    let page = read("report.html");
    assert!(page.contains("<svg") && page.contains("supervol chart --quick --scene marschner-lobb"));
    for look in ["smooth shaded", "spike"] {
        assert!(page.contains(&format!("marschner-lobb, {look}: pictures and where they are wrong")), "{look}");
    }
    // The report compares stated errors at two levels; no picture of any look contradicts them.
    let section =
        |id: &str| page.split(&format!("id=\"{id}\"")).nth(1).and_then(|rest| rest.split("</section>").next());
    let stated = section("stated").expect("a section on what is stated");
    assert_eq!(stated.matches("<tr>").count(), 3, "{stated}");
    assert!(stated.matches(">0</td></tr>").count() == 2 && !page.contains("further off than is stated"), "{stated}");
    let leaping = section("leaping").expect("a section on leaping");
    assert!(leaping.matches("<tr>").count() == 8 && leaping.contains("blocks, nearest ahead"), "{leaping}");
    // Two sizes by five codecs; two volumes without loss and within an error; three figures of this run and one of a record.
    let stored = section("stored").expect("a section on what is stored");
    assert_eq!(stored.matches("<tr>").count(), 1 + 10 + 1 + 4, "{stored}");
    assert!(stored.matches("<figure>").count() == 4 && stored.contains("goal, 2 cores, lossless"), "{stored}");
    let read = section("read").expect("a section on what is read for an error");
    assert!(read.matches("<tr>").count() == 1 + 4 && read.contains("4/255") && read.contains("2/255"), "{read}");
    let files = std::fs::read_dir(folder.path("report")).expect("the folder can be listed").count();
    assert_eq!(files, 3, "containers and unfinished files are removed");
    assert!(folder.expect(2, &["chart", "--scene", "no-such", "-o", "report"]).contains("marschner-lobb"));
    folder.expect(2, &["chart", "--stability", "--summary", "-o", "report"]);
}

#[test]
fn stability_is_written_as_a_page_and_as_regimes() {
    let folder = Folder::new();
    let unknown = folder.expect(2, &["chart", "--stability", "--only", "S99", "-o", "report"]);
    let known = unknown.rsplit("expected one of ").next().expect("the known ones are listed");
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

/// Commands that are executables of their own are known without these: their options are checked, their help is whole.
#[test]
fn a_missing_executable_is_named_with_the_command_that_builds_it() {
    let folder = Folder::new();
    let alone = folder.path(&format!("supervol{}", std::env::consts::EXE_SUFFIX));
    std::fs::copy(env!("CARGO_BIN_EXE_supervol"), &alone).expect("a temporary folder has room");
    let run = |arguments: &[&str]| {
        let output = Command::new(&alone).args(arguments).env("PATH", folder.0.path()).output().expect("it starts");
        (output.status.code(), [output.stdout, output.stderr].concat())
    };
    for (arguments, package) in [
        (&["view"][..], "supervol-viewer"),
        (&["bench", "--quick"], "supervol-measure"),
        (&["--quiet", "chart", "-o", "report"], "supervol-measure"),
    ] {
        let (code, said) = run(arguments);
        let said = String::from_utf8_lossy(&said).into_owned();
        assert!(said.contains(&format!("cargo build --release -p {package}")), "{said}");
        assert_eq!(code, Some(2), "{arguments:?}: {said}");
    }
    let (code, said) = run(&["chart", "--help"]);
    assert!(code == Some(0) && String::from_utf8_lossy(&said).contains("--stability"));
    assert_eq!(run(&["view", "--no-such-option"]).0, Some(2));
}

/// Errors outside the limits of the caster are refused; it would clamp them silently. 1 is documented as any error.
#[test]
fn errors_that_cannot_be_aimed_at_are_refused() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "sphere", "--dims", "16,16,16", "-o", "a.svol"]);
    std::fs::write(folder.path("s.json"), r#"{"image": {"width": 8, "height": 6}}"#)
        .expect("a temporary folder has room");
    let render = ["render", "a.svol", "--scene", "s.json", "--backend", "cpu", "--stats", "s.stats", "-o"];
    for bound in ["0", "0.01/255", "17/255", "0.5", "1.5", "300%"] {
        let refused = folder.expect(2, &[&render[..], &["refused.png", "--max-error", bound]].concat());
        for part in ["--max-error", "expected 0.05/255 to 16/255", "or 1 ", &format!("found {bound}, which is ")] {
            assert!(refused.contains(part), "{bound}: no '{part}' in {refused}");
        }
        assert!(!Path::new(&folder.path("refused.png")).exists(), "--max-error {bound} drew a picture");
    }
    for (bound, asked) in [("0.05/255", 0.05 / 255.0), ("16/255", 16.0 / 255.0), ("1%", 0.01), ("1", 1.0)] {
        folder.expect(0, &[&render[..], &["taken.png", "--max-error", bound]].concat());
        let stats = json(&std::fs::read_to_string(folder.path("s.stats")).expect("render wrote it"));
        assert_eq!(stats["max_error_requested"].as_f64(), Some(asked), "{bound}");
    }
}

/// Scenes of volumes that exist: a table for each volume, and a list of them in the numbers.
#[test]
fn bench_draws_random_scenes_of_volumes() {
    let folder = Folder::new();
    let sample = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/carp_ct.nii.gz");
    folder.expect(0, &["build", sample, "-o", "carp.svol"]);
    let scenes = ["bench", "--random-scenes", "2", "--mode", "mip", "-o", "out", "--volume", "carp.svol"];
    let page = folder.expect(0, &[&scenes[..], &[sample]].concat());
    for name in ["of carp,", "of carp_ct.nii,"] {
        assert!(page.contains(&format!("Random scenes 0 to 1 of seed 1 {name} mode mip")), "{name}: {page}");
    }
    let numbers = std::fs::read_to_string(folder.path("out/random-scenes.json")).expect("bench wrote it");
    let found = json(&numbers)["volumes"].as_array().expect("a list of volumes").clone();
    let names: Vec<_> = found.iter().filter_map(|volume| volume["volume"].as_str()).collect();
    assert_eq!(names, ["carp", "carp_ct.nii"]);
    // One volume in two files: the same scenes, with the same errors.
    assert_eq!(found[0]["errors"], found[1]["errors"]);
    assert_eq!(found[0]["stated"].as_array().map(Vec::len), Some(5), "four requested errors, and level 1: {numbers}");
    let refused = folder.expect(2, &["bench", "--quick", "--volume", "carp.svol", sample]);
    assert!(refused.contains("--volume: expected one file"), "{refused}");
}

#[test]
fn bench_draws_random_scenes_and_keeps_the_error() {
    let folder = Folder::new();
    let page = folder.expect(0, &["bench", "--random-scenes", "3", "--seed", "5", "--first-scene", "2", "-o", "out"]);
    assert!(page.contains("Random scenes 2 to 4 of seed 5"), "{page}");
    let read = |name: &str| std::fs::read_to_string(folder.0.path().join("out").join(name)).expect("bench wrote it");
    assert!(page == read("random-scenes.md"));
    let found = json(&read("random-scenes.json"));
    assert_eq!(
        (found["seed"].as_u64(), found["first_scene"].as_u64(), found["scenes"].as_u64()),
        (Some(5), Some(2), Some(3))
    );
    let errors = found["errors"].as_array().expect("an entry for each error");
    let asked: Vec<_> = errors.iter().map(|at| at["asked_grey_levels"].as_f64().expect("a number")).collect();
    assert_eq!(asked, [0.1, 0.5, 2.0, 8.0]);
    for at in errors {
        let largest = at["largest_grey_levels"].as_f64().expect("a number");
        assert!(at["p999_grey_levels"].as_f64().is_some_and(|p999| p999 <= largest), "{at}");
        assert!(at["scenes_above"].as_array().is_some_and(Vec::is_empty), "{at}");
    }
    let page = folder.expect(0, &["bench", "--random-scenes", "1", "--seed", "5", "--mode", "mean"]);
    assert!(page.contains("Random scenes 0 to 0 of seed 5, mode mean"), "{page}");
    let lone = [&["--seed", "3"][..], &["--mode", "mip"]];
    for wrong in [&["--random-scenes", "0"][..], &["--random-scenes", "3", "--peers"]].into_iter().chain(lone) {
        folder.expect(2, &[&["bench"][..], wrong].concat());
    }
}
