//! `supervol-measure`: the executable behind `supervol bench` and `supervol chart`.
//!
//! `supervol` starts it with its own arguments, unchanged. The measurements are the library's; here are arguments,
//! files and messages.

mod commands;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use supervol_arguments::allocation::ExitOnOutOfMemory;
use supervol_arguments::program::CommandLine;
use supervol_arguments::{bench, chart};
use supervol_measure::peers::environment::end_all;

#[derive(Debug, Subcommand)]
enum Command {
    Bench(Box<bench::Arguments>),
    Chart(chart::Arguments),
}

#[global_allocator]
static ALLOCATOR: ExitOnOutOfMemory = ExitOnOutOfMemory;

fn main() -> ExitCode {
    CommandLine::<Command>::parse().run(end_all, |command| match command {
        Command::Bench(arguments) => commands::bench::run(&arguments),
        Command::Chart(arguments) => commands::chart::run(&arguments),
    })
}
