//! `build --batch`: many volumes, of which some are damaged; what came of each; and going on after a stop.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::support;
use support::{Folder, json};

/// The last line of each source.
fn results(folder: &Folder) -> BTreeMap<String, Value> {
    let text = std::fs::read_to_string(folder.path("out/results.jsonl")).expect("the batch wrote it");
    text.lines().map(json).map(|line| (line["source"].as_str().expect("a path").to_owned(), line)).collect()
}

fn npy(folder: &Folder, name: &str, first: u8) {
    let path = folder.path(name);
    std::fs::create_dir_all(std::path::Path::new(&path).parent().expect("a folder")).expect("room");
    let header = format!("{:117}\n", "{'descr': '|u1', 'fortran_order': False, 'shape': (20, 24, 28), }");
    let mut bytes = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    bytes.extend(header.into_bytes());
    bytes.extend((0..20 * 24 * 28).map(|i: u32| ((i * i) >> 5) as u8 ^ first));
    std::fs::write(path, bytes).expect("room");
}

fn containers(folder: &Folder) -> Vec<String> {
    let entries = std::fs::read_dir(folder.path("out")).expect("the batch made it");
    let mut names: Vec<_> = entries.map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned()).collect();
    names.retain(|name| name != "results.jsonl");
    names.sort();
    names
}

fn three_and_a_bad_one() -> Folder {
    let folder = Folder::new();
    npy(&folder, "in/a/v.npy", 0);
    npy(&folder, "in/b/v.npy", 1);
    npy(&folder, "in/w.npy", 2);
    std::fs::write(folder.path("in/bad.nrrd"), "NRRD0004\ntype: nothing\n").expect("room");
    std::fs::write(folder.path("in/notes.txt"), "Nothing to see").expect("room");
    folder
}

const BATCH: [&str; 6] = ["build", "--batch", "in", "-o", "out", "--threads=1"];

#[test]
fn one_bad_file_stops_no_other_and_names_do_not_collide() {
    let folder = three_and_a_bad_one();
    let said = folder.expect(1, &BATCH);
    assert!(said.contains("3 built, 0 done before, 1 failed, 1 other file passed over"), "{said}");
    let results = results(&folder);
    assert_eq!(results.len(), 4);
    for source in ["in/a/v.npy", "in/b/v.npy", "in/w.npy"] {
        let line = &results[source];
        assert_eq!((&line["status"], &line["error_bound"]), (&"done".into(), &0.0.into()), "{line}");
        assert!(line["milliseconds"].as_f64() > Some(0.0) && line["ratio"].as_f64() > Some(0.0), "{line}");
        let container = format!("out/{}", line["container"].as_str().expect("a name"));
        let bytes = std::fs::metadata(folder.path(&container)).expect("it was built").len();
        assert_eq!(line["container_bytes"].as_u64(), Some(bytes));
        // Each container holds its own source.
        folder.expect(0, &["extract", &container, "-o", "back.npy", "--force"]);
        let voxels = |path: &str| std::fs::read(folder.path(path)).expect("a file").split_off(128);
        assert!(voxels("back.npy") == voxels(source), "{source}");
        let info = json(&folder.expect(0, &["info", "--json", &container]));
        assert_eq!(info["source"]["xxh3_64"], line["source_xxh3_64"]);
    }
    assert_ne!(results["in/a/v.npy"]["container"], results["in/b/v.npy"]["container"]);
    assert_eq!(results["in/w.npy"]["container"], "w.svol");
    assert_eq!(containers(&folder).len(), 3);
    let bad = &results["in/bad.nrrd"];
    assert_eq!(bad["status"], "failed");
    assert!(bad["error"].as_str().is_some_and(|error| error.contains("bad.nrrd")), "{bad}");

    // A list builds the same, from standard input or a file; the bad one is tried again.
    std::fs::write(folder.path("list"), "in/w.npy\n\nin/missing.npy\nin/a/v.npy\n").expect("room");
    let said = folder.expect(2, &["build", "--batch", "list", "-o", "out"]);
    assert!(said.contains("0 built, 2 done before, 1 failed") && said.contains("missing.npy"), "{said}");
    std::fs::write(folder.path("good"), "in/w.npy\n").expect("room");
    let out = folder.expect(0, &["build", "--batch", "good", "-o", "out", "--json"]);
    assert_eq!(json(&out)["result"], results["in/w.npy"]);
}

#[test]
fn what_is_done_is_checked_and_what_has_changed_is_kept() {
    let folder = three_and_a_bad_one();
    folder.expect(1, &BATCH);
    std::fs::remove_file(folder.path("in/bad.nrrd")).expect("it is there");
    let before = results(&folder);
    let container = |source: &str| format!("out/{}", before[source]["container"].as_str().expect("a name"));
    let read = |path: &str| std::fs::read(folder.path(path)).expect("a file");
    let all = || containers(&folder).iter().map(|name| read(&format!("out/{name}"))).collect::<Vec<_>>();
    let bytes = all();
    let said = folder.run(&BATCH);
    assert!(String::from_utf8_lossy(&said.stderr).contains("0 built, 3 done before, 0 failed"), "{said:?}");
    assert!(said.status.success() && all() == bytes);

    // A container that is gone is built again, with the same bytes.
    std::fs::remove_file(folder.path(&container("in/a/v.npy"))).expect("it is there");
    let said = folder.run(&BATCH);
    assert!(String::from_utf8_lossy(&said.stderr).contains("1 built, 2 done before"), "{said:?}");
    assert!(all() == bytes);

    // Another source, another container, other options: nothing is replaced unless that is asked for.
    npy(&folder, "in/a/v.npy", 9);
    let mut forged = read(&container("in/b/v.npy"));
    forged[5000] ^= 1;
    std::fs::write(folder.path(&container("in/b/v.npy")), &forged).expect("room");
    let said = folder.expect(2, &BATCH);
    assert!(said.contains("has changed") && said.contains("its checksum was"), "{said}");
    assert!(read(&container("in/b/v.npy")) == forged);
    let said = folder.expect(2, &[&BATCH[..], &["--max-error=3"]].concat());
    assert!(said.contains("in/w.npy") && said.contains("other options"), "{said}");
    folder.expect(0, &[&BATCH[..], &["--force"]].concat());
    assert!(
        read(&container("in/b/v.npy"))
            == bytes[containers(&folder)
                .iter()
                .position(|n| container("in/b/v.npy").ends_with(n.as_str()))
                .expect("it is there")]
    );
    let after = results(&folder);
    assert_ne!(after["in/a/v.npy"]["container_xxh3_64"], before["in/a/v.npy"]["container_xxh3_64"]);
    assert_eq!(after["in/w.npy"], before["in/w.npy"]);
    folder.expect(0, &BATCH);
}

#[test]
fn files_of_others_are_left_alone() {
    let folder = three_and_a_bad_one();
    std::fs::create_dir(folder.path("out")).expect("room");
    std::fs::write(folder.path("out/w.svol"), "mine").expect("room");
    let said = folder.expect(2, &BATCH);
    assert!(said.contains("w.svol exists") && said.contains("2 built"), "{said}");
    assert_eq!(std::fs::read(folder.path("out/w.svol")).expect("it is there"), b"mine");
    // A folder whose results file is something else, an output in an input, and no volumes.
    std::fs::create_dir(folder.path("other")).expect("room");
    std::fs::write(folder.path("other/results.jsonl"), "mine\n").expect("room");
    folder.expect(1, &["build", "--batch", "in", "-o", "other"]);
    assert_eq!(std::fs::read(folder.path("other/results.jsonl")).expect("it is there"), b"mine\n");
    std::fs::create_dir(folder.path("empty")).expect("room");
    let said = folder.expect(2, &["build", "--batch", "empty", "-o", "o2"]);
    assert!(said.contains("found none"), "{said}");
    folder.expect(2, &["build", "in/w.npy", "--batch", "in", "-o", "o2"]);
    folder.expect(2, &["build", "-o", "o2"]);
}

/// Signals and kills at any moment: the same command again, and in the end all is as if nothing had happened.
#[test]
#[cfg(unix)]
fn a_batch_that_is_stopped_goes_on() {
    use std::process::{Command, Stdio};
    let folder = Folder::new();
    for i in 0..12 {
        folder.expect(
            0,
            &[
                "synth",
                "seismic",
                "--dims",
                "64,64,48",
                "--dtype",
                "f32",
                "--seed",
                &i.to_string(),
                "-o",
                &format!("{i}.raw"),
            ],
        );
    }
    let list: String = (0..12).map(|i| format!("{i}.raw\n")).collect();
    std::fs::write(folder.path("list"), list).expect("room");
    let batch = ["build", "--batch", "list", "--dims=64,64,48", "--dtype=f32le", "--brick=16", "--threads=1"];
    folder.expect(0, &[&batch[..], &["-o", "whole"]].concat());
    let (mut stops, mut with_some) = (0, 0);
    for attempt in 0..60u64 {
        let mut child = Command::new(env!("CARGO_BIN_EXE_supervol"))
            .args(batch)
            .args(["-o", "out"])
            .current_dir(folder.0.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("the program starts");
        std::thread::sleep(std::time::Duration::from_millis(30 + attempt * 37 % 170 + attempt * 4));
        let signal = if attempt % 2 == 0 { "-TERM" } else { "-KILL" };
        let _ = Command::new("kill").args([signal, &child.id().to_string()]).status();
        let status = child.wait().expect("it ends");
        let done = std::fs::read_dir(folder.path("out")).map_or(0, |out| {
            out.filter(|e| e.as_ref().is_ok_and(|e| e.path().extension().is_some_and(|e| e == "svol"))).count()
        });
        with_some += u64::from(done > 0 && done < 12);
        stops += u64::from(!status.success());
        if status.success() {
            break;
        }
    }
    let said = folder.run(&[&batch[..], &["-o", "out"]].concat());
    assert!(said.status.success(), "{said:?}");
    println!("{stops} stops, {with_some} with some containers");
    assert!(stops > 0 && with_some > 0, "{stops} stops, {with_some} between containers");
    for i in 0..12 {
        let read = |out: &str| std::fs::read(folder.path(&format!("{out}/{i}.svol"))).expect("it was built");
        assert!(read("out") == read("whole"), "{i}: other bytes");
    }
    let left = std::fs::read_dir(folder.path("out")).expect("it is there").count();
    assert_eq!(left, 13, "12 containers and the results");
}
