//! Start and end of each executable.
//!
//! All executables parse the same command line, `[--quiet] COMMAND ...`. Each knows some of the commands. `supervol`
//! knows all commands and checks their arguments. For a command of another executable, it starts this executable with
//! the same arguments.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use rayon::ThreadPoolBuilder;
use supervol_files::unfinished::wait_for_end;

use crate::failure::Failure;
use crate::{signals, terminal};

/// Command line of `supervol`, restricted to the commands of one executable.
#[derive(Debug, Parser)]
#[command(
    name = "supervol",
    version,
    about = "Volumes larger than the hardware: build, check and render .svol containers"
)]
#[command(long_about = None)]
pub struct CommandLine<C: Subcommand> {
    /// Print only results, warnings and errors: no progress, notes or summaries
    #[arg(short, long, global = true)]
    pub quiet: bool,
    /// The command, with its arguments.
    #[command(subcommand)]
    pub command: C,
}

impl<C: Subcommand> CommandLine<C> {
    /// Runs the command and returns the exit code of the process.
    ///
    /// A signal ends the process at once. Before that, `end_programs` ends the child programs of the command. Its
    /// result is kept until the end.
    pub fn run<G>(
        self,
        end_programs: impl FnOnce() -> G + Send + 'static,
        run: impl FnOnce(C) -> Result<(), Failure>,
    ) -> ExitCode {
        if self.quiet {
            terminal::be_quiet();
        }
        if let Err(failure) = signals::watch(end_programs).and_then(|()| start_threads()) {
            return failure.report();
        }
        let result = run(self.command);
        // If a signal has arrived, it determines the end of the program.
        wait_for_end();
        match result {
            Ok(()) => ExitCode::SUCCESS,
            Err(failure) => failure.report(),
        }
    }
}

/// Starts the shared threads. A failure to start them at first use would be a panic.
fn start_threads() -> Result<(), Failure> {
    let started = ThreadPoolBuilder::new().build_global();
    started.map_err(|e| Failure::Machine(format!("cannot start the worker threads, one per processor: {e}")))
}
