//! Start and end of each executable.
//!
//! All executables read the same command line, `[--quiet] COMMAND ...`; each knows some of the commands. `supervol`
//! knows all of them, checks the arguments of all, and starts the executable that runs the command, with the same
//! arguments.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use rayon::ThreadPoolBuilder;
use supervol_files::unfinished::wait_for_end;

use crate::failure::Failure;
use crate::{signals, terminal};

/// The command line of `supervol`, with the commands that one executable knows.
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
    /// Runs the command; the exit code of the process.
    ///
    /// A signal ends the process at once. `end_programs` then ends the programs that the command has started; what it
    /// returns is held until the end.
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
        // A signal that has come meanwhile decides how the program ends.
        wait_for_end();
        match result {
            Ok(()) => ExitCode::SUCCESS,
            Err(failure) => failure.report(),
        }
    }
}

/// Starts the threads that commands share. Left to the first use, a thread that cannot be started is a panic.
fn start_threads() -> Result<(), Failure> {
    let started = ThreadPoolBuilder::new().build_global();
    started.map_err(|e| Failure::Machine(format!("cannot start the worker threads, one per processor: {e}")))
}
