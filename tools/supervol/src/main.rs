//! `supervol`: the one command-line program. A file per subcommand; no algorithm lives here.
//!
//! Exit codes: 0 done, 1 the data is wrong, 2 the command is wrong, 3 the machine failed us (disk full, no memory, I/O
//! error), 128 + n ended by signal n ([`signals`]). Results go to standard output, messages and progress to standard
//! error. What may be overwritten: [`output`].

mod allocation;
mod batch;
mod bench;
mod build;
mod cache;
mod chart;
mod completions;
mod demo;
mod extract;
mod failure;
mod histogram;
mod info;
mod input;
mod look;
mod mesh;
mod output;
mod panels;
mod pick;
mod progress;
mod quantity;
mod render;
mod sequence;
mod signals;
mod synth;
mod terminal;
mod verify;
#[cfg(feature = "viewer")]
mod view;

use std::process::ExitCode;
use std::time::Instant;

use clap::{Parser, Subcommand};
use supervol_files::unfinished::wait_for_end;

/// Turns volumes larger than the hardware into one bricked, multiresolution container, and renders them out of core.
#[derive(Debug, Parser)]
#[command(name = "supervol", version, about)]
struct Arguments {
    /// No progress, notes or summaries: only results, warnings and errors
    #[arg(short, long, global = true)]
    quiet: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Build a container from a volume file or a folder of slices
    Build(Box<build::Arguments>),
    /// Make a synthetic volume: as a container, or as a raw file
    Synth(synth::Arguments),
    /// Say what containers hold
    Info(Box<info::Arguments>),
    /// Draw the histogram of a container, with the opacities of its default picture
    Histogram(Box<histogram::Arguments>),
    /// Check every rule of containers
    Verify(Box<verify::Arguments>),
    /// Write voxels of a container to a plain file: .npy, .raw, .nrrd, .nii, .nii.gz, .mha, .tif, .vti, .sgy, .zarr
    Extract(extract::Arguments),
    /// Write the surface where a container has one value as a mesh: .ply, .stl, .obj
    Mesh(mesh::Arguments),
    /// Make a picture of a container, or of a volume file, of which a container is built and kept first
    Render(Box<render::Arguments>),
    /// Look at a volume in a window: turn, cut and colour it, save the scene, export pictures
    #[cfg(feature = "viewer")]
    View(Box<view::Arguments>),
    /// Measure pictures: cost, distance from the reference, and the same by other programs
    Bench(Box<bench::Arguments>),
    /// Build and render a real and a synthetic volume, to see that everything works
    Demo(demo::Arguments),
    /// Measure speed against accuracy, or where methods fail, and write a report
    Chart(chart::Arguments),
    /// Write what a shell needs to complete commands: `supervol completions bash > FILE`
    Completions(completions::Arguments),
    /// Write man pages
    Man(completions::ManArguments),
    /// Write the JSON Schema of scene files, for editors and programs that check them
    Schema,
}

#[global_allocator]
static ALLOCATOR: allocation::OrEnd = allocation::OrEnd;

fn main() -> ExitCode {
    let begun = Instant::now();
    let arguments = Arguments::parse();
    if arguments.quiet {
        terminal::be_quiet();
    }
    if let Err(failure) = signals::watch().and_then(|()| start_threads()) {
        return failure.report();
    }
    let result = match arguments.command {
        Command::Build(arguments) => build::run(&arguments),
        Command::Synth(arguments) => synth::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Histogram(arguments) => histogram::run(&arguments),
        Command::Verify(arguments) => verify::run(&arguments),
        Command::Extract(arguments) => extract::run(&arguments),
        Command::Mesh(arguments) => mesh::run(&arguments),
        Command::Render(arguments) => render::run(&arguments, begun),
        #[cfg(feature = "viewer")]
        Command::View(arguments) => view::run(&arguments),
        Command::Bench(arguments) => bench::run(&arguments),
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Chart(arguments) => chart::run(&arguments),
        Command::Completions(arguments) => completions::run::<Arguments>(&arguments),
        Command::Man(arguments) => completions::run_man::<Arguments>(&arguments),
        Command::Schema => completions::run_schema(),
    };
    // A signal that has come meanwhile decides how the program ends.
    wait_for_end();
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}

/// Starts the threads that commands share. Left to the first that needs them, one that cannot be started is a panic.
fn start_threads() -> Result<(), failure::Failure> {
    let started = rayon::ThreadPoolBuilder::new().build_global();
    started.map_err(|e| failure::Failure::Machine(format!("cannot start a thread for each processor: {e}")))
}
