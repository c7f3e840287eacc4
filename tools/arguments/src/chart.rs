//! Arguments of `supervol chart`.

use std::path::PathBuf;

use clap::Args;

use crate::output::Force;

/// What to measure, how much of it, and where to write.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Smaller volumes and pictures, fewer transfer functions: minutes instead of tens of minutes
    #[arg(long)]
    pub quick: bool,
    /// Measure this scene only; may be given several times
    #[arg(long, value_name = "NAME", conflicts_with = "stability")]
    pub scene: Vec<String>,
    /// Measure where methods fail instead, and hold the default to its promises
    #[arg(long)]
    pub stability: bool,
    /// Measure this regime only, S01 to S48; may be given several times
    #[arg(long, value_name = "ID", requires = "stability")]
    pub only: Vec<String>,
    /// A report small enough to be kept with the program: all plots and findings, few pictures; no table of all points,
    /// and neither points.csv nor points.json
    #[arg(long, conflicts_with = "stability")]
    pub summary: bool,
    /// Folder for report.html, points.csv and points.json, or stability.html and stability.json; made if it is not there
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    /// `--force`.
    #[command(flatten)]
    pub force: Force,
}

impl Arguments {
    /// The command as a person would type it again. The folder stands by its own name, which tells nothing of the machine.
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
