//! Files of the user stay: no command overwrites them without `--force`, and no command leaves unfinished files.
#![cfg(unix)]

use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::support;
use support::{Folder, json};

/// Between two looks at a folder.
const MOMENT: Duration = Duration::from_millis(5);
const RAW: [&str; 4] = ["--dims", "40,40,40", "--dtype", "u8"];
const SCENE: &str = r#"{"image": {"width": 16, "height": 12}}"#;

impl Folder {
    /// Names and bytes of all that is in it, links followed.
    fn contents(&self) -> Vec<(String, Vec<u8>)> {
        let entries = std::fs::read_dir(self.0.path()).expect("the folder can be read");
        let mut found: Vec<_> = entries
            .map(|entry| entry.expect("an entry"))
            .map(|e| (e.file_name().to_string_lossy().into_owned(), std::fs::read(e.path()).unwrap_or_default()))
            .collect();
        found.sort();
        found
    }

    fn names(&self) -> Vec<String> {
        self.contents().into_iter().map(|(name, _)| name).collect()
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        std::fs::write(self.path(name), bytes).expect("a temporary folder has room");
    }

    fn read(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    fn mode(&self, name: &str) -> u32 {
        std::fs::metadata(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}")).permissions().mode() & 0o777
    }

    fn start(&self, arguments: &[&str]) -> Child {
        Command::new(env!("CARGO_BIN_EXE_supervol"))
            .args(arguments)
            .current_dir(self.0.path())
            .env("TMPDIR", self.0.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("the program starts")
    }

    /// Unfinished files of a folder, as `info` lists them.
    fn unfinished(&self, inside: &str) -> Vec<serde_json::Value> {
        let listed = json(&self.expect(0, &["info", inside, "--json"]));
        listed["unfinished"].as_array().expect("a list").clone()
    }

    /// Starts a command and waits until it has begun a file or folder.
    fn begun(&self, arguments: &[&str], inside: &str) -> Child {
        let before = self.unfinished(inside).len();
        let mut child = self.start(arguments);
        while self.unfinished(inside).len() == before {
            assert!(child.try_wait().expect("a child").is_none(), "{arguments:?} ended by itself");
            std::thread::sleep(MOMENT);
        }
        child
    }

    /// Runs a command that must be refused as wrong, and demands that it changes no file and leaves none.
    fn refuse(&self, arguments: &[&str], words: &[&str]) {
        let before = self.contents();
        let message = self.expect(2, arguments);
        for word in words {
            assert!(message.contains(word), "no '{word}' in what {arguments:?} says: {message}");
        }
        assert!(self.contents() == before, "{arguments:?} changed a file");
    }
}

/// A raw volume, its container, a small scene, and a picture with statistics.
fn filled() -> Folder {
    let folder = Folder::new();
    folder.expect(0, &["synth", "sphere", "--dims", "40,40,40", "--dtype", "u8", "-o", "c.raw"]);
    folder.expect(0, &[&["build", "c.raw", "-o", "c.svol"], &RAW[..]].concat());
    folder.write("s.json", SCENE.as_bytes());
    folder.expect(0, &["render", "c.svol", "--scene", "s.json", "-o", "p.png", "--stats", "t.json"]);
    folder
}

fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").args([format!("-{name}"), child.id().to_string()]).status();
    assert!(sent.expect("kill starts").success());
}

#[test]
fn an_output_is_never_an_input() {
    let folder = filled();
    let link = |name: &str, to: &str| symlink(to, folder.path(name)).expect("a link");
    let build = |output: &str| [&["build", "c.raw", "-o", output, "--force"], &RAW[..]].concat().join(" ");
    link("to-raw.svol", "c.raw");
    std::fs::hard_link(folder.path("c.raw"), folder.path("hard.svol")).expect("a hard link");
    for output in ["c.raw", "./c.raw", "to-raw.svol", "hard.svol"] {
        folder.refuse(&build(output).split(' ').collect::<Vec<_>>(), &[output]);
    }
    link("to-container.png", "c.svol");
    link("to-container.raw", "c.svol");
    folder.refuse(&["render", "c.svol", "-o", "to-container.png", "--force"], &["c.svol"]);
    folder.refuse(&["extract", "c.svol", "-o", "to-container.raw", "--force"], &["c.svol"]);
    let render = ["render", "c.svol", "--scene", "s.json", "--force", "-o"];
    for (picture, statistics) in [("q.png", "c.svol"), ("q.png", "s.json"), ("q.png", "./q.png"), ("p.png", "p.png")] {
        folder.refuse(&[&render[..], &[picture, "--stats", statistics]].concat(), &[statistics]);
    }
    // The voxels of a header that stands alone are an input, too.
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 40 40 40\nencoding: raw\ndata file: c.raw\n";
    folder.write("v.nhdr", header.as_bytes());
    folder.refuse(&["build", "v.nhdr", "-o", "c.raw", "--force"], &["c.raw"]);
}

#[test]
fn files_of_another_kind_are_replaced_only_by_force() {
    let folder = filled();
    folder.expect(0, &["extract", "c.svol", "-o", "vol.npy"]);
    std::fs::copy(folder.path("c.svol"), folder.path("c.png")).expect("a copy");
    let render = ["render", "c.svol", "--scene", "s.json", "-o"];
    for (name, found) in [("vol.npy", "neither a picture"), ("c.png", "a container")] {
        folder.refuse(&[&render[..], &[name]].concat(), &["--force", name, found]);
    }
    folder.write("notes.json", b"{\"mine\": 1}");
    folder.write("other.svol", &folder.read("c.svol"));
    for name in ["other.svol", "p.png", "notes.json", "c.raw"] {
        folder.refuse(&[&render[..], &["q.png", "--stats", name]].concat(), &["--force", name]);
    }
    folder.refuse(&["extract", "c.svol", "-o", "vol.npy"], &["--force"]);
    folder.refuse(&["synth", "sphere", "--dims", "8,8,8", "-o", "c.svol"], &["--force"]);

    // Pictures take the place of pictures, statistics of statistics; an empty file is nothing to lose.
    folder.write("empty.png", b"");
    for name in ["p.png", "p.png", "p.npy", "p.npy", "p.exr", "p.exr", "empty.png"] {
        folder.expect(0, &[&render[..], &[name, "--stats", "t.json"]].concat());
    }
    let statistics = |name: &str| json(&String::from_utf8_lossy(&folder.read(name)));
    assert!(statistics("t.json")["render_ms"].is_number());
    for name in ["vol.npy", "c.png"] {
        folder.expect(0, &[&render[..], &[name, "--force", "--stats", "notes.json"]].concat());
    }
    assert!(folder.read("c.png").starts_with(b"\x89PNG"));
    assert!(statistics("notes.json")["render_ms"].is_number());
}

#[test]
fn reports_replace_reports_and_nothing_else() {
    let folder = Folder::new();
    let bench = ["bench", "--random-scenes", "1", "-o", "out"];
    folder.expect(0, &bench);
    folder.expect(0, &bench);
    let mine = folder.path("out/random-scenes.json");
    std::fs::write(&mine, r#"{"mine": 1}"#).expect("room");
    let message = folder.expect(2, &bench);
    assert!(message.contains("random-scenes.json") && message.contains("--force"), "{message}");
    assert_eq!(std::fs::read_to_string(&mine).expect("still there"), r#"{"mine": 1}"#);
    // The measured results are not lost either.
    let aside = message.trim().rsplit(' ').next().expect("the message ends with a folder");
    assert!(Path::new(&folder.path(aside)).join("random-scenes.json").is_file(), "{message}");
    folder.expect(0, &[&bench[..], &["--force"]].concat());
    assert!(json(&std::fs::read_to_string(&mine).expect("bench wrote it"))["seed"].is_number());
}

#[test]
fn modes_follow_the_mask_and_the_file_that_is_replaced() {
    let folder = filled();
    let with_mask = |arguments: &str| {
        let script = format!("umask 027; exec {} {arguments}", env!("CARGO_BIN_EXE_supervol"));
        let run = Command::new("sh").args(["-c", &script]).current_dir(folder.0.path()).stdout(Stdio::null()).status();
        assert!(run.expect("sh starts").success(), "{arguments}");
    };
    let commands = [
        ("m.svol", "synth sphere --dims 8,8,8 -o m.svol --force"),
        ("m.raw", "synth sphere --dims 8,8,8 -o m.raw --force"),
        ("m.npy", "extract c.svol -o m.npy --force"),
        ("m.png", "render c.svol --scene s.json -o m.png"),
        ("m.json", "render c.svol --scene s.json -o m.png --stats m.json"),
    ];
    for (name, command) in commands {
        with_mask(command);
        assert_eq!(folder.mode(name), 0o640, "{command}");
        for mode in [0o600, 0o664] {
            std::fs::set_permissions(folder.path(name), std::fs::Permissions::from_mode(mode)).expect("chmod");
            with_mask(command);
            assert_eq!(folder.mode(name), mode, "{command}");
        }
    }
}

#[test]
fn symbolic_links_are_followed_by_every_command() {
    let folder = filled();
    std::fs::create_dir(folder.path("real")).expect("a folder");
    let commands: [(&str, &[&str]); 4] = [
        ("out.svol", &["synth", "sphere", "--dims", "8,8,8", "--force", "-o"]),
        ("out.npy", &["extract", "c.svol", "--force", "-o"]),
        ("out.png", &["render", "c.svol", "--scene", "s.json", "--force", "-o"]),
        ("out.json", &["render", "c.svol", "--scene", "s.json", "-o", "p.png", "--force", "--stats"]),
    ];
    for (name, command) in commands {
        let target = format!("real/{name}");
        symlink(&target, folder.path(name)).expect("a link");
        folder.refuse(&[command, &[name]].concat(), &["link", name]);
        folder.write(&target, b"old");
        folder.expect(0, &[command, &[name]].concat());
        assert!(Path::new(&folder.path(name)).is_symlink(), "{name} is no link any more");
        assert!(folder.read(&target).len() > 3, "{target} was not replaced");
    }
    assert_eq!(std::fs::read_dir(folder.path("real")).expect("a folder").count(), commands.len());
}

#[test]
fn devices_and_pipes_are_written_to_and_never_replaced() {
    let folder = filled();
    let render = ["render", "c.svol", "--scene", "s.json", "-o"];
    symlink("/dev/null", folder.path("null.png")).expect("a link");
    folder.expect(0, &[&render[..], &["null.png", "--stats", "/dev/null"]].concat());
    assert!(Path::new("/dev/null").metadata().expect("it is there").file_type().is_char_device());
    let printed = folder.expect(0, &[&render[..], &["p.png", "--stats", "/dev/stdout"]].concat());
    assert!(printed.contains("\"render_ms\"") && printed.contains("p.png: 16 x 12"), "{printed}");

    let is_fifo = |name: &str| Path::new(&folder.path(name)).metadata().expect("it is there").file_type().is_fifo();
    for name in ["f.raw", "f.npy", "f.svol"] {
        assert!(Command::new("mkfifo").arg(folder.path(name)).status().expect("mkfifo starts").success());
    }
    let extract = ["extract", "c.svol", "-o"];
    for (command, name, plain) in [(&extract[..], "f.raw", "g.raw"), (&render[..], "f.npy", "g.npy")] {
        let path = folder.path(name);
        let reader = std::thread::spawn(move || std::fs::read(path).expect("a FIFO can be read"));
        folder.expect(0, &[command, &[name]].concat());
        folder.expect(0, &[command, &[plain]].concat());
        assert!(reader.join().expect("the reader ends") == folder.read(plain), "{name} is not {plain}");
        assert!(is_fifo(name), "{name} was replaced");
    }
    // A container is read back while it is built: refused at once, also where nobody reads.
    assert!(folder.expect(2, &["synth", "sphere", "--dims", "8,8,8", "--force", "-o", "f.svol"]).contains("FIFO"));
    assert!(is_fifo("f.svol"));
    assert!(folder.expect(2, &["synth", "sphere", "--dims", "8,8,8", "--force", "-o", "."]).contains("folder"));
}

/// Commands that go on until they are stopped, and the folder in which they keep what they have not finished.
const LONG: [(&[&str], &str); 6] = [
    (&["synth", "seismic", "--dims", "4096,4096,4096", "-o", "long.svol"], "."),
    (&["synth", "seismic", "--dims", "4096,4096,4096", "-o", "long.raw"], "."),
    (&["render", "c.svol", "--scene", "large.json", "--backend", "reference", "-o", "l.exr", "--stats", "l.json"], "."),
    (&["extract", "wide.svol", "-o", "long.raw"], "."),
    (&["chart", "-o", "report"], "report"),
    (&["bench", "--random-scenes", "10000"], "."),
];

#[test]
fn signals_end_every_command_and_leave_nothing() {
    let folder = filled();
    folder.write("large.json", br#"{"image": {"width": 3000, "height": 3000}}"#);
    folder.expect(0, &["synth", "constant", "--dims", "1024,1024,1024", "--brick", "128", "-o", "wide.svol"]);
    std::fs::create_dir(folder.path("report")).expect("a folder");
    let before = folder.names();
    for (arguments, inside) in LONG {
        for (name, code) in [("INT", 130), ("TERM", 143), ("HUP", 129)] {
            let mut child = folder.begun(arguments, inside);
            signal(&child, name);
            let status = child.wait().expect("it ends");
            assert_eq!(status.code(), Some(code), "{arguments:?} and SIG{name}");
            assert_eq!(folder.names(), before, "{arguments:?} and SIG{name}");
            let left = std::fs::read_dir(folder.path("report")).expect("a folder").count();
            assert_eq!(left, 0, "{arguments:?} and SIG{name}");
        }
    }
}

#[test]
fn a_command_that_nohup_started_outlives_its_terminal() {
    let folder = Folder::new();
    let program = env!("CARGO_BIN_EXE_supervol");
    let script = format!("trap '' HUP; exec {program} synth seismic --dims 4096,4096,4096 -o long.svol");
    let started = Command::new("sh").args(["-c", &script]).current_dir(folder.0.path()).stderr(Stdio::null()).spawn();
    let mut child = started.expect("sh starts");
    while folder.unfinished(".").is_empty() {
        std::thread::sleep(MOMENT);
    }
    signal(&child, "HUP");
    signal(&child, "TERM");
    assert_eq!(child.wait().expect("it ends").code(), Some(143));
}

#[test]
fn what_a_killed_command_left_is_named_and_then_removed() {
    let folder = Folder::new();
    let mut killed = folder.begun(&["synth", "seismic", "--dims", "4096,4096,4096", "-o", "long.svol"], ".");
    signal(&killed, "KILL");
    killed.wait().expect("it ends");
    let dead = folder.unfinished(".");
    assert!(dead.len() == 1 && dead[0]["writer"] == "dead", "{dead:?}");
    let listed = folder.expect(0, &["info", "."]);
    assert!(
        listed.contains(dead[0]["path"].as_str().expect("a path")) && listed.contains("the next build"),
        "{listed}"
    );

    // The next build removes it, and leaves what another is writing alone.
    folder.expect(0, &["synth", "sphere", "--dims", "16,16,16", "-o", "small.svol"]);
    assert_eq!(folder.names(), ["small.svol"]);
    let mut other = folder.begun(&["synth", "seismic", "--dims", "4096,4096,4096", "-o", "other.svol"], ".");
    folder.expect(0, &["synth", "sphere", "--dims", "16,16,16", "-o", "small.svol", "--force"]);
    let alive = folder.unfinished(".");
    assert!(alive.len() == 1 && alive[0]["writer"] == "alive", "{alive:?}");
    signal(&other, "TERM");
    assert_eq!(other.wait().expect("it ends").code(), Some(143));
    assert_eq!(folder.names(), ["small.svol"]);
}

#[test]
fn programs_that_a_command_has_started_end_with_it() {
    let folder = Folder::new();
    // Stands in for a Python that takes its time, and for what that has started in its turn.
    folder.write("python", b"#!/bin/sh\nsleep 1000 &\necho $$ $! > started.tmp\nmv started.tmp started\nwait\n");
    let status = Command::new("chmod").args(["+x", &folder.path("python")]).status();
    assert!(status.expect("chmod starts").success());
    let python = folder.path("python");
    for (name, code) in [("TERM", 143), ("INT", 130)] {
        let bench = ["bench", "--peers", "--quick", "--environment", "none", "--python", &python];
        let mut child = Command::new(env!("CARGO_BIN_EXE_supervol"))
            .args(bench)
            .current_dir(folder.0.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("the program starts");
        while !Path::new(&folder.path("started")).exists() {
            let ended = child.try_wait().expect("the program's state");
            assert!(ended.is_none(), "it ended before it started anything ({ended:?}); is supervol-measure built?");
            std::thread::sleep(MOMENT);
        }
        signal(&child, name);
        assert_eq!(child.wait().expect("it ends").code(), Some(code));
        let started = String::from_utf8(folder.read("started")).expect("numbers");
        for process in started.split_whitespace() {
            // A process that has ended and that nobody has reaped has no command line.
            let command = || std::fs::read(format!("/proc/{process}/cmdline")).unwrap_or_default();
            let end = std::time::Instant::now() + std::time::Duration::from_secs(10);
            while !command().is_empty() && std::time::Instant::now() < end {
                std::thread::sleep(MOMENT);
            }
            assert!(command().is_empty(), "SIG{name}: process {process} goes on");
        }
        std::fs::remove_file(folder.path("started")).expect("it is there");
    }
}

#[test]
fn records_are_appended_to_records_only() {
    let folder = filled();
    let bench = |record: &str| {
        let arguments =
            ["bench", "--quick", "--volume", "source.csv", "--dims", "8,8,8", "--dtype", "u8", "--record", record];
        folder.expect(2, &arguments)
    };
    folder.write("source.csv", &[7; 512]);
    std::fs::hard_link(folder.path("source.csv"), folder.path("other.csv")).expect("a link");
    for name in ["source.csv", "other.csv"] {
        assert!(bench(name).contains("reads or writes"), "{name}");
        assert_eq!(folder.read("source.csv"), [7; 512]);
    }
    assert!(Command::new("mkfifo").arg(folder.path("f.csv")).status().expect("mkfifo starts").success());
    assert!(bench("f.csv").contains("no file"));
    std::os::unix::fs::symlink("nowhere", folder.path("l.csv")).expect("a link");
    assert!(bench("l.csv").contains("symbolic link"));
    folder.write("notes.csv", b"mine,notes\n1,2\n");
    assert!(bench("notes.csv").contains("columns"));
    assert_eq!(folder.read("notes.csv"), b"mine,notes\n1,2\n");
}
