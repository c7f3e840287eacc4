//! Inputs reach no further than they should: no other files, no waiting, no orders to the terminal.
#![cfg(unix)]

use std::os::unix::fs::symlink;
use std::process::{Command, Stdio};

use crate::support;
use support::{Folder, json};

fn write(folder: &Folder, name: &str, bytes: impl AsRef<[u8]>) {
    std::fs::write(folder.path(name), bytes).expect("a temporary folder has room");
}

fn detached(data_file: &str, encoding: &str) -> String {
    format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: {encoding}\ndata file: {data_file}\n")
}

#[test]
fn data_files_of_nrrd_headers_stay_below_the_header() {
    let folder = Folder::new();
    std::fs::create_dir_all(folder.path("in/parts")).expect("folders");
    write(&folder, "secret", [7; 64]);
    write(&folder, "in/parts/own.raw", [7; 64]);
    symlink(folder.path("secret"), folder.path("in/link.raw")).expect("a link");
    let build = ["build", "in/v.nhdr", "-o", "v.svol", "--force"];
    for outside in ["../secret", "parts/../../secret", &folder.path("secret"), "link.raw", "LIST\n../secret"] {
        write(&folder, "in/v.nhdr", detached(outside, "raw"));
        let message = folder.expect(1, &build);
        assert!(message.contains("--allow-outside") && message.contains("v.nhdr"), "{outside}: {message}");
        folder.expect(0, &[&build[..], &["--allow-outside"]].concat());
    }
    // Nor does a header learn which other files there are.
    write(&folder, "in/v.nhdr", detached("../no-such-file", "raw"));
    assert!(folder.expect(1, &build).contains("--allow-outside"));
    for inside in ["parts/own.raw", "./parts/own.raw", &folder.path("in/parts/own.raw")] {
        write(&folder, "in/v.nhdr", detached(inside, "raw"));
        folder.expect(0, &build);
    }
}

#[test]
fn errors_print_nothing_that_stands_in_another_file() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("in")).expect("a folder");
    for secret in ["1 2 hunter2 4", &"hunter2".repeat(40), "hunter2"] {
        write(&folder, "secret", format!("{secret}{}", " ".repeat(200)));
        for encoding in ["text", "gzip", "raw"] {
            write(&folder, "in/v.nhdr", detached("../secret", encoding));
            for allowed in [&[][..], &["--allow-outside"]] {
                let built = folder.run(&[&["build", "in/v.nhdr", "-o", "v.svol", "--force"], allowed].concat());
                let said = [built.stdout, built.stderr].concat();
                assert!(!String::from_utf8_lossy(&said).contains("hunter2"), "{encoding} {allowed:?}");
            }
        }
    }
}

#[test]
fn what_is_no_container_is_called_so() {
    let folder = Folder::new();
    write(&folder, "v.raw", [7; 10_000]);
    for command in [&["info", "v.raw"][..], &["verify", "v.raw"], &["extract", "v.raw", "-o", "e.npy"]] {
        let message = folder.expect(1, command);
        assert!(message.contains("no Supervol container") && message.contains("supervol build"), "{message}");
    }
}

#[test]
fn volume_files_say_what_they_are_before_they_are_built() {
    let folder = Folder::new();
    let header =
        "NRRD0004\ntype: int16\ndimension: 3\nsizes: 5 4 3\nspacings: 1 2 3\nencoding: raw\nendian: little\n\n";
    write(&folder, "v.nrrd", [header.as_bytes(), &[7; 120]].concat());
    let text = folder.expect(0, &["info", "v.nrrd"]);
    for said in ["5 x 4 x 3 i16 voxels", "[1.0, 2.0, 3.0]", "v.nrrd (nrrd, ", "`supervol build` makes v.svol"] {
        assert!(text.contains(said), "{said}: {text}");
    }
    let before = json(&folder.expect(0, &["info", "v.nrrd", "--json"]));
    // By default, the container lies beside its source.
    folder.expect(0, &["build", "v.nrrd"]);
    let after = json(&folder.expect(0, &["info", "v.svol", "--json"]));
    for (key, value) in before.as_object().expect("an object") {
        let same = if key == "source" { value["name"] == after[key]["name"] } else { *value == after[key] };
        assert!(same, "{key}: {value} before, {} after", after[key]);
    }
    assert!(folder.expect(2, &["build", "v.nrrd"]).contains("v.svol"), "it is not replaced");
    // Bare voxels are what somebody says they are; a container is what it says itself.
    write(&folder, "v.raw", [7; 120]);
    let raw = ["--dims", "5,4,6", "--dtype", "u8"];
    assert!(folder.expect(0, &[&["info", "v.raw"], &raw[..]].concat()).contains("5 x 4 x 6 u8"));
    assert!(folder.expect(2, &["info", "v.svol", "--dims", "5,4,6", "--dtype", "u8"]).contains("change nothing"));
    assert!(folder.expect(2, &["info", "v.svo"]).contains("v.svo: there is no such file"));
    assert!(folder.expect(2, &["info", "v.nrrd", "--text-header"]).contains("expected a SEG-Y file"));
    // A folder may be a volume, too.
    std::fs::create_dir(folder.path("stack")).expect("a folder");
    let said = folder.expect(0, &["info", "stack"]);
    assert!(said.contains("the folder holds no volume and no unfinished files: "), "{said}");
}

#[test]
fn volumes_come_through_pipes() {
    let folder = Folder::new();
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n\n";
    let voxels: Vec<u8> = (0..60).collect();
    write(&folder, "v.nrrd", [header.as_bytes(), &voxels].concat());
    let build = |arguments: &[&str]| {
        let input = std::fs::File::open(folder.path("v.nrrd")).expect("it has just been written");
        let mut command = Command::new(env!("CARGO_BIN_EXE_supervol"));
        command.arg("build").arg("-").args(arguments).current_dir(folder.0.path()).stdin(input);
        let output = command.output().expect("the program starts");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    assert_eq!(build(&["-o", "piped.svol"]).0, Some(0));
    let info = json(&folder.expect(0, &["info", "piped.svol", "--json"]));
    assert_eq!(info["source"]["name"], "standard input");
    assert_eq!(info["source"]["bytes"], header.len() + 60);
    folder.expect(0, &["extract", "piped.svol", "-o", "voxels.raw"]);
    assert_eq!(std::fs::read(folder.path("voxels.raw")).expect("it was written"), voxels);
    let (code, message) = build(&[]);
    assert!(code == Some(2) && message.contains("-o"), "{message}");
    assert_eq!(std::fs::read_dir(folder.0.path()).expect("a folder").count(), 3, "nothing is left of what was piped");
}

#[test]
fn outputs_that_cannot_be_begun_are_named_as_they_were_given() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "ramp", "--dims", "8,8,8", "-o", "v.svol"]);
    let message = folder.expect(3, &["render", "v.svol", "-o", "no-folder/p.png", "--size", "8x8"]);
    assert!(message.contains("no-folder/p.png") && !message.contains(".partial"), "{message}");
}

#[test]
fn quiet_commands_say_only_what_was_asked_for() {
    let folder = Folder::new();
    write(&folder, "v.raw", [7; 4096]);
    let build = ["build", "v.raw", "--dims", "16,16,16", "--dtype", "u8", "-o", "v.svol", "--force"];
    let picture = ["render", "v.svol", "-o", "p.png", "--size", "16x16", "--force"];
    for command in [&build[..], &["verify", "v.svol"], &["extract", "v.svol", "-o", "e.npy", "--force"], &picture] {
        let said = |quiet: &[&str]| {
            let out = folder.run(&[quiet, command].concat());
            assert!(out.status.success(), "{command:?}");
            String::from_utf8_lossy(&[out.stdout, out.stderr].concat()).into_owned()
        };
        assert!(!said(&[]).is_empty(), "{command:?}");
        // Warnings are never kept back.
        let quiet = said(&["-q"]);
        assert!(quiet.lines().all(|line| line.contains("warning")), "{command:?}: {quiet}");
    }
    assert!(folder.expect(0, &["info", "v.svol", "-q"]).contains("16 x 16 x 16"));
}

#[test]
fn what_is_no_file_is_refused_at_once() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "sphere", "--dims", "8,8,8", "-o", "c.svol"]);
    for name in ["f", "f.sgy", "f.nrrd", "f.nii", "f.npy", "f.svol", "f.json"] {
        assert!(Command::new("mkfifo").arg(folder.path(name)).status().expect("mkfifo starts").success());
    }
    std::fs::create_dir(folder.path("d.nrrd")).expect("a folder");
    write(&folder, "v.nhdr", detached("f", "raw"));
    let raw = ["--dims", "4,4,4", "--dtype", "u8"];
    // Nobody writes to the FIFOs: whoever opens one waits for ever.
    let commands: [&[&str]; 15] = [
        &["build", "f.sgy", "-o", "o.svol"],
        &["build", "f.nrrd", "-o", "o.svol"],
        &["build", "f.nii", "-o", "o.svol"],
        &["build", "f.npy", "-o", "o.svol"],
        &["build", "d.nrrd", "-o", "o.svol"],
        &["build", "/dev/zero", "-o", "o.svol"],
        &[&["build", "f", "-o", "o.svol"], &raw[..]].concat(),
        &[&["build", "/dev/zero", "-o", "o.svol"], &raw[..]].concat(),
        &["info", "f.svol"],
        &["verify", "f.svol"],
        &["verify", "d.nrrd"],
        &["extract", "f.svol", "-o", "o.raw"],
        &["render", "f.svol", "-o", "o.png"],
        &["render", "c.svol", "--scene", "f.json", "-o", "o.png"],
        &["bench", "--path", "f.json"],
    ];
    for command in commands {
        let message = folder.expect(2, command);
        assert!(message.contains("expected a file, found a"), "{command:?}: {message}");
    }
    assert!(folder.expect(1, &["build", "v.nhdr", "-o", "o.svol"]).contains("found a FIFO"));
}

#[test]
fn scenes_are_small() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "sphere", "--dims", "8,8,8", "-o", "c.svol"]);
    let scene = |blanks: usize| format!("{{\"image\": {{\"width\": 8, \"height\": 6}}{}}}", " ".repeat(blanks));
    let render = ["render", "c.svol", "--scene", "s.json", "-o", "p.png"];
    write(&folder, "s.json", scene(900_000));
    folder.expect(0, &render);
    write(&folder, "s.json", scene(1_000_000));
    let message = folder.expect(2, &render);
    assert!(message.contains("s.json") && message.contains("at most 1000000 bytes"), "{message}");
}

#[test]
fn terminals_get_no_orders_from_files() {
    let folder = Folder::new();
    let bad = "\u{1b}]0;x\u{7}\u{9b}2J\u{7f}";
    let header = format!(
        "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\nsample units: \"{bad}\"\n\
         labels: \"{bad}\" \"b\" \"c\"\n{bad}: 1\nspace: {bad}\n\n"
    );
    let name = "v\u{1b}[2J.nrrd";
    write(&folder, name, [header.as_bytes(), &[7; 64]].concat());
    let wrong = header.replace("uint8", bad);
    write(&folder, "w\u{1b}[2J.nrrd", [wrong.as_bytes(), &[7; 64]].concat());
    let mut said = Vec::new();
    let mut keep = |arguments: &[&str], code: i32| {
        let output = folder.run(arguments);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        said.extend([output.stdout.clone(), output.stderr].concat());
        String::from_utf8(output.stdout).expect("UTF-8")
    };
    keep(&["build", name, "-o", "v.svol"], 0);
    keep(&["build", name, "-o", "v.svol", "--force", "--json"], 0);
    keep(&["build", "w\u{1b}[2J.nrrd", "-o", "w.svol"], 1);
    keep(&["info", "v.svol"], 0);
    let info = keep(&["info", "v.svol", "--json"], 0);
    assert_eq!(json(&info)["source"]["name"], name, "what is not shown raw is still there");
    keep(&["extract", "v.svol", "-o", "out\u{1b}[2J.raw"], 0);
    keep(&["bench", "--volume", name, "--size", "8x6", "--repeats", "1", "--pixels", "10"], 0);
    let said = String::from_utf8(said).expect("UTF-8");
    assert!(said.contains("\\u001b[2J"), "{said}");
    let raw: Vec<char> = said.chars().filter(|c| c.is_control() && *c != '\n' && *c != '\t').collect();
    assert!(raw.is_empty(), "{raw:?} in {said}");
}

/// Bytes in the middle of the records, which come first in the file.
fn damage(folder: &Folder, name: &str) {
    let mut bytes = std::fs::read(folder.path(name)).expect("a container");
    bytes[5000..6000].fill(0xa5);
    write(folder, name, bytes);
}

#[test]
fn errors_of_extract_name_the_container() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "seismic", "--dims", "40,40,40", "-o", "damaged.svol"]);
    damage(&folder, "damaged.svol");
    let message = folder.expect(1, &["extract", "damaged.svol", "-o", "o.raw"]);
    assert!(message.contains("damaged.svol"), "{message}");
}

#[test]
fn an_error_that_nobody_can_be_told_is_no_panic() {
    let folder = Folder::new();
    let full = std::fs::File::options().write(true).open("/dev/full").expect("Linux has it");
    let status = Command::new(env!("CARGO_BIN_EXE_supervol"))
        .args(["info", "missing.svol"])
        .current_dir(folder.0.path())
        .stdout(Stdio::null())
        .stderr(full)
        .status()
        .expect("the program starts");
    assert_eq!(status.code(), Some(2));
}

#[test]
fn who_stops_reading_is_not_told_of_it() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "sphere", "--dims", "8,8,8", "-o", "c.svol"]);
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let output = Command::new(env!("CARGO_BIN_EXE_supervol"))
        .args(["info", "c.svol"])
        .current_dir(folder.0.path())
        .stdout(writer)
        .output()
        .expect("the program starts");
    assert_eq!(output.status.code(), Some(141));
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn outputs_that_cannot_be_written_are_found_before_anything_is_made() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "sphere", "--dims", "8,8,8", "-o", "c.svol"]);
    // The reference would need days.
    write(&folder, "s.json", br#"{"image": {"width": 4000, "height": 4000}}"#);
    let render = ["render", "c.svol", "--scene", "s.json", "--backend", "reference", "-o"];
    assert!(folder.expect(3, &[&render[..], &["missing/p.png"]].concat()).contains("missing/p.png"));
    assert!(
        folder.expect(3, &[&render[..], &["p.png", "--stats", "missing/t.json"]].concat()).contains("missing/t.json")
    );
    assert_eq!(std::fs::read_dir(folder.0.path()).expect("a folder").count(), 2);
}
