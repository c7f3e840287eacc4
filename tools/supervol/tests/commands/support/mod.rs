//! Running the program in a folder of its own.

#![allow(dead_code, reason = "each test binary uses a part of it")]

use std::process::{Command, Output};

/// A folder in which the program is run; gone when dropped.
pub struct Folder(pub tempfile::TempDir);

impl Folder {
    /// A container of 16 x 16 x 12 bytes that rise by 10 along x and by 1 along y, with slices 2 apart.
    pub fn with_ramp() -> Self {
        let folder = Self::new();
        let voxels: Vec<u8> = (0..16 * 16 * 12).map(|n| (10 * (n % 16) + n / 16 % 16) as u8).collect();
        std::fs::write(folder.path("v.raw"), voxels).expect("a temporary folder has room");
        let shape = ["--dims", "16x16x12", "--dtype", "u8", "--spacing", "1,1,2"];
        folder.expect(0, &[&["build", "v.raw", "-o", "v.svol"], &shape[..]].concat());
        folder
    }

    /// An empty one.
    pub fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    /// The path of a file in it.
    pub fn path(&self, name: &str) -> String {
        self.0.path().join(name).display().to_string()
    }

    /// The program, about to be run.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_supervol"));
        command.args(arguments).current_dir(self.0.path());
        command
    }

    /// Runs the program.
    pub fn run(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().expect("the program starts")
    }

    /// Runs and demands an exit code; returns standard output, or standard error where the code is not 0.
    pub fn expect(&self, code: i32, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        let (out, err) = (text(&output.stdout), text(&output.stderr));
        assert_eq!(output.status.code(), Some(code), "supervol {arguments:?}\n{out}\n{err}");
        if code == 0 { out } else { err }
    }
}

/// Parses what the program wrote.
pub fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e} in {text}"))
}
