//! `supervol bench`: what the same pictures cost here, and in other programs.

use std::io::Write;
use std::num::NonZero;
use std::path::PathBuf;

use clap::Args;
use supervol_chart::peers::{self, Options, PeerOptions, report, vtk};
use supervol_chart::{Context, Scale};

use crate::demo::CARP;
use crate::failure::{Failure, with_output};
use crate::progress::announce;

/// What to measure, and against whom.
///
/// Without --peers Supervol's own pictures are measured: cost, and distance from the reference. Benches of single parts
/// (codecs, builds, pictures) are run by `cargo bench -p supervol-benches`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Draw everything with VTK's CPU ray caster, too; it is installed into a private Python environment the first time
    #[arg(long)]
    peers: bool,
    /// Small volumes and pictures: seconds instead of minutes
    #[arg(long)]
    quick: bool,
    /// Only this scene; may be given several times
    #[arg(long, value_name = "NAME")]
    scene: Vec<String>,
    /// Write peers.json, peers.md and the pictures into this folder
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Threads of either program; all processors by default
    #[arg(long)]
    threads: Option<NonZero<usize>>,
    /// The Python that makes the environment
    #[arg(long, value_name = "PROGRAM", default_value = "python3")]
    python: PathBuf,
    /// Folder of the environment; by default in the user's cache
    #[arg(long, value_name = "DIR")]
    environment: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let folder = tempfile::tempdir().map_err(with_output)?;
    let peer = match (arguments.peers, arguments.environment.clone().or_else(cached_environment)) {
        (false, _) => None,
        (true, Some(environment)) => Some(PeerOptions { python: arguments.python.clone(), environment }),
        (true, None) => {
            let message = "--peers: the user's cache folder is not known; name a folder with --environment DIR";
            return Err(Failure::Command(message.into()));
        }
    };
    let options = Options {
        peer,
        threads: arguments.threads.map_or_else(rayon::current_num_threads, NonZero::get),
        carp_nifti_gz: CARP,
        only: arguments.scene.clone(),
    };
    let scale = if arguments.quick { Scale::Small } else { Scale::Full };
    let context = Context { scale, folder: folder.path(), say: &announce };
    let comparison = peers::compare(&context, &options)?;
    let command = command_line();
    if let Some(output) = &arguments.output {
        report::write(&comparison, &command, output)?;
    }
    write!(std::io::stdout(), "{}", report::markdown(&comparison, &command)).map_err(with_output)
}

/// Where environments are kept unless somebody says otherwise: nothing but time is lost when the folder is deleted.
fn cached_environment() -> Option<PathBuf> {
    let of = |variable: &str| std::env::var_os(variable).map(PathBuf::from).filter(|path| path.is_absolute());
    let cache = of("XDG_CACHE_HOME").or_else(|| of("LOCALAPPDATA")).or_else(|| of("HOME").map(|h| h.join(".cache")))?;
    let package = vtk::PACKAGE;
    Some(cache.join("supervol").join("peers").join(format!("{}-{}", package.name, package.version)))
}

/// This command as it was given.
fn command_line() -> String {
    let arguments = std::env::args().skip(1);
    ["supervol".to_string()].into_iter().chain(arguments).collect::<Vec<_>>().join(" ")
}
