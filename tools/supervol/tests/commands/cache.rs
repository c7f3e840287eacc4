//! Volume files where containers are asked for, and several containers at once.

use std::io::Write;
use std::process::{Command, Stdio};

use crate::support;
use support::{Folder, json};

const SHAPE: [&str; 4] = ["--dims", "20x16x12", "--dtype", "u8"];

impl Folder {
    /// A headerless file of 20 x 16 x 12 bytes.
    fn raw(&self, name: &str, step: usize) {
        let voxels: Vec<u8> = (0..20 * 16 * 12).map(|i| (i * step % 251) as u8).collect();
        std::fs::write(self.path(name), voxels).expect("a temporary folder has room");
    }

    /// Runs the program, and returns what it says on standard error.
    fn said(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8_lossy(&output.stderr).into_owned()
    }

    fn kept(&self) -> Vec<String> {
        let listed = std::fs::read_dir(self.path("cache/containers")).expect("a cache folder");
        listed.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect()
    }
}

#[test]
fn a_volume_file_is_built_once_and_drawn_as_its_container_is() {
    let folder = Folder::new();
    folder.raw("a.raw", 3);
    let small = ["--size", "24x16", "--backend", "cpu", "--force"];
    let of_file = |output: &str| {
        let arguments: Vec<&str> =
            ["render", "a.raw", "--cache", "cache", "-o", output].into_iter().chain(SHAPE).chain(small).collect();
        folder.said(&arguments)
    };
    let first = of_file("1.npy");
    assert!(
        first.contains("a.raw: building a container of this volume file") && first.contains("32.00 GiB"),
        "{first}"
    );
    assert!(!of_file("2.npy").contains("building a container"));
    let kept = folder.kept();
    assert!(kept.len() == 1 && kept[0].starts_with("a-") && kept[0].ends_with(".svol"), "{kept:?}");
    let build: Vec<&str> = ["build", "a.raw", "-o", "a.svol"].into_iter().chain(SHAPE).collect();
    folder.expect(0, &build);
    let of_container: Vec<&str> = ["render", "a.svol", "-o", "3.npy"].into_iter().chain(small).collect();
    folder.expect(0, &of_container);
    let read = |name: &str| std::fs::read(folder.path(name)).expect("a picture");
    assert!(read("1.npy") == read("2.npy") && read("1.npy") == read("3.npy"));
    // Read otherwise, it is another volume.
    let spaced: Vec<&str> =
        ["histogram", "a.raw", "--cache", "cache", "--spacing", "1,1,2"].into_iter().chain(SHAPE).collect();
    assert!(folder.said(&spaced).contains("building a container"));
    assert_eq!(folder.kept().len(), 2);
    // Options for volume files change nothing in a container.
    let message = folder.expect(2, &["render", "a.svol", "--spacing", "1,1,2", "-o", "4.npy"]);
    assert!(message.contains("expected a volume file, found a container"), "{message}");
    // A picture never takes the place of the file that it shows.
    folder.raw("voxels.png", 3);
    let shown: Vec<&str> =
        ["render", "voxels.png", "--cache", "cache", "-o", "voxels.png", "--force"].into_iter().chain(SHAPE).collect();
    let message = folder.expect(2, &shown);
    assert!(message.contains("which this command reads"), "{message}");
}

#[test]
fn what_no_reader_takes_is_refused_before_a_build_is_announced() {
    let folder = Folder::new();
    std::fs::write(folder.path("letter.txt"), "Dear reader").expect("a temporary folder has room");
    let run = folder.run(&["render", "letter.txt", "-o", "a.png", "--cache", "cache"]);
    let said = String::from_utf8_lossy(&run.stderr);
    assert!(!run.status.success() && said.contains("letter.txt: neither its first bytes"), "{said}");
    assert!(!said.contains("building a container"), "{said}");
}

#[test]
fn the_cache_folder_holds_as_many_bytes_as_it_may() {
    let folder = Folder::new();
    for (name, step) in [("a.raw", 3), ("b.raw", 5), ("c.raw", 7)] {
        folder.raw(name, step);
        let arguments: Vec<&str> =
            ["histogram", name, "--cache", "cache", "--cache-limit", "9000"].into_iter().chain(SHAPE).collect();
        folder.said(&arguments);
    }
    let kept = folder.kept();
    assert!(kept.len() < 3 && kept.iter().any(|name| name.starts_with("c-")), "{kept:?}");
}

#[test]
fn several_containers_are_told_of_and_checked_one_after_the_other() {
    let folder = Folder::new();
    for (name, field) in [("a.svol", "ramp"), ("b.svol", "sphere")] {
        folder.expect(0, &["synth", field, "--dims", "20,20,20", "-o", name]);
    }
    let told = folder.expect(0, &["info", "a.svol", "b.svol"]);
    assert!(told.contains("file       a.svol") && told.contains("file       b.svol"), "{told}");
    assert_eq!(folder.expect(0, &["verify", "a.svol", "b.svol"]).matches("whole").count(), 2);
    // One that is broken does not keep the others from being checked; the exit code is its own.
    let mut bytes = std::fs::read(folder.path("a.svol")).expect("a container");
    let end = bytes.len() - 40;
    bytes[end] ^= 0xff;
    std::fs::write(folder.path("broken.svol"), &bytes).expect("a temporary folder has room");
    let output = folder.run(&["verify", "broken.svol", "b.svol"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stdout).contains("b.svol: whole"));
    assert!(String::from_utf8_lossy(&output.stderr).contains("broken.svol"));
}

/// Runs the program with this on its standard input.
fn piped(folder: &Folder, arguments: &[&str], input: &[u8]) -> String {
    let mut child = Command::new(env!("CARGO_BIN_EXE_supervol"))
        .args(arguments)
        .current_dir(folder.0.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program starts");
    child.stdin.take().expect("a pipe").write_all(input).expect("the program reads");
    let output = child.wait_with_output().expect("the program ends");
    assert!(output.status.success(), "{arguments:?}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn a_dash_is_standard_input() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "ramp", "--dims", "20,20,20", "-o", "a.svol"]);
    let container = std::fs::read(folder.path("a.svol")).expect("a container");
    assert_eq!(json(&piped(&folder, &["info", "-", "--json"], &container))["dims"], serde_json::json!([20, 20, 20]));
    assert!(piped(&folder, &["verify", "-"], &container).contains("-: whole"));
    let scene = br#"{"image": {"width": 31}}"#;
    let printed = piped(&folder, &["render", "a.svol", "--scene", "-", "--print-scene"], scene);
    assert_eq!(json(&printed)["image"]["width"], 31);
}
