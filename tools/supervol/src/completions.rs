//! `supervol completions`, `supervol man` and `supervol schema`: shell completions, man pages and the JSON Schema of
//! scenes, generated from the command line and the types.

use std::io::Write;
use std::path::PathBuf;

use clap::{Args, CommandFactory};
use clap_complete::Shell;
use supervol_arguments::failure::{Failure, with_output};
use supervol_arguments::output::{Force, ReportFolder};

/// Shell to complete for.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Shell that completes the commands
    shell: Shell,
}

/// Folder of the man pages.
#[derive(Debug, Args)]
pub struct ManArguments {
    /// Folder for supervol.1, supervol-render.1 and so on; it is created if it does not exist
    #[arg(short, long)]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
}

/// Writes the completions of a shell to standard output.
pub fn run<C: CommandFactory>(arguments: &Arguments) -> Result<(), Failure> {
    let mut command = C::command();
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut command, "supervol", &mut script);
    supervol_arguments::terminal::stdout().write_all(&script).map_err(with_output)
}

/// Writes the JSON Schema of scene files to standard output.
pub fn run_schema() -> Result<(), Failure> {
    let schema = supervol_scene::scene::Scene::schema();
    writeln!(supervol_arguments::terminal::stdout(), "{schema:#}").map_err(with_output)
}

/// Writes the man pages of the program and of each command.
pub fn run_man<C: CommandFactory>(arguments: &ManArguments) -> Result<(), Failure> {
    let folder = ReportFolder::begin(&arguments.output, arguments.force)?;
    folder.write_with(&[], |temporary| {
        // Without this, each command would get a page for its `help`.
        let mut command = C::command().disable_help_subcommand(true);
        // Puts the name of the program before the names of the pages.
        command.build();
        clap_mangen::generate_to(command, temporary)
            .map_err(|e| Failure::Machine(format!("cannot write the man pages: {e}")))
    })
}
