//! Arguments of `supervol chart`.

use std::path::PathBuf;

use clap::Args;

use crate::output::Force;

/// Measurements of the report, their extent, and its folder.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Use smaller volumes, smaller pictures and fewer transfer functions: takes minutes instead of tens of minutes
    #[arg(long)]
    pub quick: bool,
    /// Measure only this scene; repeat the option for several scenes
    #[arg(long, value_name = "NAME", conflicts_with = "stability")]
    pub scene: Vec<String>,
    /// Measure the regimes in which methods of volume rendering fail, and check the gates of the default method
    #[arg(long)]
    pub stability: bool,
    /// Measure only this regime: S01 to S51; repeat the option for several regimes
    #[arg(long, value_name = "ID", requires = "stability")]
    pub only: Vec<String>,
    /// Write a short report: all plots and findings, few pictures
    ///
    /// It has no table of all points. The files points.csv and points.json are not written.
    #[arg(long, conflicts_with = "stability")]
    pub summary: bool,
    /// Folder for the report; it is created if it does not exist
    ///
    /// Files: report.html, points.csv and points.json; with --stability, stability.html and stability.json.
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// `--force`.
    #[command(flatten)]
    pub force: Force,
}

impl Arguments {
    /// Command line that repeats the measurement. It names the folder without its path, which would identify the
    /// machine.
    #[must_use]
    pub fn command_line(&self) -> String {
        let mut words = vec!["supervol chart".to_string()];
        words.extend(self.quick.then(|| "--quick".into()));
        words.extend(self.scene.iter().map(|name| format!("--scene {name}")));
        words.extend(self.stability.then(|| "--stability".into()));
        words.extend(self.summary.then(|| "--summary".into()));
        words.extend(self.only.iter().map(|id| format!("--only {id}")));
        let name = self.output.file_name().unwrap_or(self.output.as_os_str());
        words.push(format!("-o {}", name.to_string_lossy()));
        words.join(" ")
    }
}
