//! Builds that are killed at random moments, again and again, end with the bytes of one that was not.
#![cfg(unix)]

use std::process::{Command, Stdio};
use std::time::Duration;

use supervol_format::random::Random;

use crate::support;
use support::Folder;

/// Kills in all.
const KILLS: u64 = 50;
const BUILD: [&str; 8] = ["build", "c.raw", "--dims", "160,128,96", "--dtype", "f32le", "--memory=4MiB", "--threads=2"];

fn read(folder: &Folder, name: &str) -> Vec<u8> {
    std::fs::read(folder.path(name)).expect("the build wrote it")
}

#[test]
fn fifty_kills_change_no_byte() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "seismic", "--dims", "160,128,96", "--dtype", "f32", "-o", "c.raw"]);
    folder.expect(0, &[&BUILD[..], &["--brick=16", "-o", "whole.svol"]].concat());
    let expected = read(&folder, "whole.svol");
    let start = || {
        let mut command = Command::new(env!("CARGO_BIN_EXE_supervol"));
        command.args(BUILD).args(["--brick=16", "-o", "killed.svol"]).current_dir(folder.0.path());
        command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the program starts")
    };
    let (mut random, mut finished, mut went_on) = (Random::new(1), 0, 0);
    for kill in 0..KILLS {
        let mut child = start();
        std::thread::sleep(Duration::from_millis(5 + random.below(120)));
        child.kill().expect("it is a child");
        child.wait().expect("it ends");
        let is_whole = std::path::Path::new(&folder.path("killed.svol")).exists();
        // Every tenth is left alone, and so is one that was too fast.
        if is_whole || kill % 10 == 9 {
            if !is_whole {
                let said = folder.expect(0, &[&BUILD[..], &["--brick=16", "-o", "killed.svol"]].concat());
                went_on += u64::from(said.contains("went on with a build that was interrupted"));
            }
            assert!(read(&folder, "killed.svol") == expected, "other bytes after kill {kill}");
            folder.expect(0, &["verify", "killed.svol"]);
            std::fs::remove_file(folder.path("killed.svol")).expect("it is there");
            finished += 1;
        }
    }
    println!("{KILLS} kills, {finished} builds finished, {went_on} of them went on");
    assert!(finished >= KILLS / 10 && went_on > 0, "{finished} finished, {went_on} went on");
    // Nothing is left but what the last kill has left, and another build removes that.
    folder.expect(0, &[&BUILD[..], &["-o", "other.svol", "--brick=16", "--codec=raw"]].concat());
    let names = std::fs::read_dir(folder.0.path()).expect("a folder").count();
    assert_eq!(names, 3, "c.raw, whole.svol and other.svol");
}
