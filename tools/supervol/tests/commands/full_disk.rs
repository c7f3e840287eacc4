//! Disks that are too small: the build says what is missing, keeps what it has, and goes on when there is room.
#![cfg(target_os = "linux")]

use std::process::{Command, Output};

use crate::support;
use support::Folder;

/// Runs a command whose files may have so many blocks of 512 bytes; what is beyond is an error and no signal.
fn run_with_files_of(folder: &Folder, blocks: u64, arguments: &[&str]) -> Output {
    let script =
        format!("trap '' XFSZ; ulimit -f {blocks}; exec {} {}", env!("CARGO_BIN_EXE_supervol"), arguments.join(" "));
    Command::new("sh").args(["-c", &script]).current_dir(folder.0.path()).output().expect("sh starts")
}

fn names(folder: &Folder) -> Vec<String> {
    let entries = std::fs::read_dir(folder.0.path()).expect("a folder");
    let mut names: Vec<_> = entries.map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Fails at every tenth of the container's length, goes on from each failure to the next, and ends with the same bytes.
fn goes_on_from_failure_to_failure(more: &[&str]) {
    let folder = Folder::new();
    folder.expect(0, &["synth", "seismic", "--dims", "160,128,96", "--dtype", "f32", "-o", "c.raw"]);
    let build = |output: &'static str| {
        let fixed =
            ["build", "c.raw", "--dims=160,128,96", "--dtype=f32le", "--memory=4MiB", "--threads=2", "--brick=16"];
        [&fixed[..], more, &["-o", output]].concat()
    };
    folder.expect(0, &build("whole.svol"));
    let expected = std::fs::read(folder.path("whole.svol")).expect("it was built");
    let (mut kept, mut went_on) = (0, 0);
    for tenth in 1..10 {
        let output = run_with_files_of(&folder, expected.len() as u64 * tenth / 10 / 512, &build("v.svol"));
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{said}");
        assert!(said.contains("v.svol") && said.contains("Files may not be so long"), "{said}");
        let names = names(&folder);
        if said.contains("is kept") {
            assert_eq!(names.len(), 4, "container and journal are kept: {names:?}");
            assert!(said.contains("more are needed") && said.contains("goes on from there"), "{said}");
            // The estimate: what is there and what is missing make the container, within a half.
            let number = |before: &str| -> f64 {
                let (_, rest) = said.split_once(before).expect("the message says it");
                rest.split_whitespace().next().and_then(|n| n.parse().ok()).expect("a number of MiB")
            };
            let estimate = (number("about ") + number("; about ")) * f64::from(1 << 20);
            let share = estimate / expected.len() as f64;
            assert!((0.5..2.0).contains(&share), "{tenth} tenths: estimated {share} of the container. {said}");
            kept += 1;
        } else {
            assert_eq!(names, ["c.raw", "whole.svol"], "nothing was finished, nothing is kept");
        }
        went_on += u64::from(tenth > 1 && kept > 0);
    }
    assert!(kept >= 6, "{kept} of 9 failures kept something");
    let said = folder.expect(0, &build("v.svol"));
    assert!(said.contains("went on with a build that was interrupted") && went_on > 4, "{said}");
    assert!(std::fs::read(folder.path("v.svol")).expect("it was built") == expected, "other bytes");
    assert_eq!(names(&folder), ["c.raw", "v.svol", "whole.svol"]);
}

#[test]
fn a_full_disk_keeps_what_is_finished() {
    goes_on_from_failure_to_failure(&[]);
}

#[test]
fn so_it_does_where_voxels_are_moved() {
    goes_on_from_failure_to_failure(&["--max-error=0.5%"]);
}

/// A batch stops: the next volume would find no room either, and would remove what is kept of this one.
#[test]
fn a_batch_on_a_full_disk_stops_and_goes_on() {
    let folder = Folder::new();
    for name in ["a", "b"] {
        folder.expect(0, &["synth", "seismic", "--dims", "96,96,96", "--dtype", "f32", "-o", &format!("{name}.raw")]);
    }
    std::fs::write(folder.path("list"), "a.raw\nb.raw\n").expect("room");
    let batch =
        ["build", "--batch", "list", "--dims=96,96,96", "--dtype=f32le", "--brick=16", "--memory=4MiB", "-o", "out"];
    let output = run_with_files_of(&folder, 2000, &batch);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("is kept") && !said.contains("[2/2]"), "{said}");
    let output = folder.run(&batch);
    assert!(output.status.success(), "{output:?}");
    let lines = std::fs::read_to_string(folder.path("out/results.jsonl")).expect("the batch wrote it");
    assert!(lines.contains("went on with a build that was interrupted"), "{lines}");
    assert_eq!(std::fs::read_dir(folder.path("out")).expect("it is there").count(), 3);
}
