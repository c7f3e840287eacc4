//! When the machine has no memory and no threads to give: a sentence, exit code 3, and nothing left behind.
#![cfg(unix)]

use std::process::{Command, Output};
#[cfg(target_os = "linux")]
use std::time::Duration;

use crate::support;
use support::{Folder, json};

/// Runs a command in an address space of so many KiB.
fn run_in(folder: &Folder, kibibytes: u64, environment: &str, arguments: &str) -> Output {
    let program = env!("CARGO_BIN_EXE_supervol");
    let script = format!("ulimit -v {kibibytes}; {environment} exec {program} {arguments}");
    Command::new("sh").args(["-c", &script]).current_dir(folder.0.path()).output().expect("sh starts")
}

/// Demands exit code 3, a sentence that says `what`, and a folder in which only `left` is.
fn fails(folder: &Folder, output: &Output, what: &str, left: &[&str]) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains(what) && !said.contains("panicked"), "no '{what}' in: {said}");
    let names: Vec<_> = std::fs::read_dir(folder.0.path())
        .expect("a folder")
        .map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    assert_eq!(names, left, "{said}");
}

#[test]
fn memory_that_the_system_does_not_give_is_no_abort() {
    let folder = Folder::new();
    let synth = "synth constant --dims 2048,2048,2048 --memory 8GiB";
    for output in ["o.svol", "o.svol --brick 128 --threads 2"] {
        let built = run_in(&folder, 700_000, "", &format!("{synth} -o {output}"));
        fails(&folder, &built, "out of memory", &[]);
    }
    folder.expect(0, &["synth", "constant", "--dims", "1024,1024,512", "-o", "c.svol"]);
    // In file order: brick by brick, extraction takes no more than this.
    let extracted = run_in(&folder, 400_000, "", "extract c.svol -o c.nii.gz --memory 8GiB");
    fails(&folder, &extracted, "out of memory", &["c.svol"]);
}

#[test]
fn threads_that_do_not_start_are_no_panic() {
    let folder = Folder::new();
    let synth = "synth sphere --dims 8,8,8 --memory 64GiB -o o.svol";
    // Stacks so large that a few fill the address space: what little else is wanted still fits.
    let some = "RAYON_NUM_THREADS=1 RUST_MIN_STACK=67108864";
    fails(
        &folder,
        &run_in(&folder, 700_000, some, &format!("{synth} --threads 1000")),
        "cannot start 1000 threads",
        &[],
    );
    fails(&folder, &run_in(&folder, 700_000, "RUST_MIN_STACK=1073741824", synth), "cannot start a thread", &[]);
}

#[test]
fn more_threads_than_any_machine_has_are_refused() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "sphere", "--dims", "8,8,8", "-o", "c.svol"]);
    for threads in ["0", "10000", "18446744073709551615", "18446744073709551616"] {
        for command in [
            &["synth", "sphere", "--dims", "8,8,8", "-o", "o.svol"][..],
            &["render", "c.svol", "-o", "p.png"],
            &["bench", "--random-scenes", "1"],
        ] {
            let message = folder.expect(2, &[command, &["--threads", threads]].concat());
            assert!(message.contains("1 to 1024"), "{message}");
        }
    }
    folder.expect(0, &["synth", "sphere", "--dims", "8,8,8", "-o", "o.svol", "--threads", "64"]);
}

/// `--host-memory` is for the whole process: program, stacks and what the allocator keeps.
#[test]
fn a_picture_takes_no_more_memory_than_it_was_given() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "seismic", "--dims", "256,256,192", "--dtype", "f32", "--brick", "32", "-o", "v.svol"]);
    let scene = r#"{"mode": "mean", "image": {"width": 160, "height": 120}}"#;
    std::fs::write(folder.path("s.json"), scene).expect("room");
    for (memory, bytes) in [("32MiB", 32 << 20), ("40MiB", 40 << 20)] {
        let render = ["render", "v.svol", "--backend", "cpu", "--level", "0", "--threads", "2", "-o", "p.png"];
        let rest = ["--scene", "s.json", "--host-memory", memory, "--stats", "s.stats.json", "--force"];
        folder.expect(0, &[&render[..], &rest[..]].concat());
        let stats = json(&std::fs::read_to_string(folder.path("s.stats.json")).expect("render wrote it"));
        let number = |name: &str| stats[name].as_u64().expect("a number");
        assert!(number("bytes_decoded") > 40 << 20, "all of it is read: {stats}");
        assert!(number("peak_rss_bytes") <= bytes, "{} of {memory}: {stats}", number("peak_rss_bytes"));
    }
}

/// Runs the program, which must succeed; the most bytes of memory that it had resident, looked at every millisecond.
#[cfg(target_os = "linux")]
fn peak_of(folder: &Folder, arguments: &[&str]) -> u64 {
    let program = env!("CARGO_BIN_EXE_supervol");
    let mut command = Command::new(program);
    command.args(arguments).env("RAYON_NUM_THREADS", "2").current_dir(folder.0.path());
    let mut child = command.spawn().expect("it starts");
    let status = format!("/proc/{}/status", child.id());
    let mut peak_kibibytes = 0;
    let code = loop {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let peak = text.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix("kB"));
        peak_kibibytes = peak.map_or(peak_kibibytes, |number| number.trim().parse().expect("a number"));
        if let Some(code) = child.try_wait().expect("it can be waited for") {
            break code;
        }
        std::thread::sleep(Duration::from_millis(1));
    };
    assert!(code.success() && peak_kibibytes > 0, "supervol {arguments:?}: {code}");
    peak_kibibytes << 10
}

/// `--memory` is for the whole process, too, where it is 64 MiB more than the least that will do.
#[cfg(target_os = "linux")]
#[test]
fn commands_take_no_more_memory_than_they_were_given() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "seismic", "--dims", "256,256,192", "--dtype", "f32", "-o", "v.raw"]);
    let build =
        ["build", "v.raw", "--dims", "256,256,192", "--dtype", "f32", "--brick", "32", "-o", "v.svol", "--force"];
    let synth =
        ["synth", "seismic", "--dims", "256,256,192", "--dtype", "f32", "--brick", "32", "-o", "s.svol", "--force"];
    let commands: [&[&str]; 6] = [
        &build,
        &synth,
        &["verify", "v.svol"],
        &["verify", "v.svol", "--source", "v.raw", "--dims", "256,256,192", "--dtype", "f32"],
        &["extract", "v.svol", "-o", "x.raw", "--force"],
        &["mesh", "v.svol", "--iso", "0.4", "--level", "1", "-o", "x.ply", "--force"],
    ];
    for (command, (memory, bytes)) in
        commands.into_iter().flat_map(|c| [("72MiB", 72 << 20), ("96MiB", 96 << 20)].map(|m| (c, m)))
    {
        let peak = peak_of(&folder, &[command, &["--memory", memory, "--quiet"]].concat());
        assert!(peak <= bytes, "{command:?}: {peak} bytes of {memory}");
    }
}
