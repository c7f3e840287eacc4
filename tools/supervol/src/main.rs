//! `supervol`: the command line. It parses arguments, calls the other crates, and reports; no algorithm lives here.
//!
//! Each command has one file; `man` and `schema` are in `completions`. Parts of `render`: `look`, `panels`, `pick`,
//! `picture`, `sequence`. Part of `build`: `batch`.
//!
//! Exit codes: 0 done, 1 the data is wrong, 2 the command is wrong, 3 the machine failed us (disk full, no memory, I/O
//! error), 128 + n ended by signal n ([`supervol_arguments::signals`]). Results go to standard output, messages and
//! progress to standard error. Rules for overwriting: [`supervol_arguments::output`]. `view`, `bench` and `chart` are
//! executables of their own ([`executables`]).

#![cfg_attr(
    test,
    allow(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_sign_loss,
        reason = "tests use small numbers"
    )
)]

mod batch;
mod build;
mod completions;
mod demo;
mod executables;
mod extract;
mod failed_bricks;
mod grid;
mod histogram;
mod info;
mod look;
mod mesh;
mod panels;
mod pick;
mod picture;
mod prove;
mod render;
mod sequence;
mod synth;
mod verify;
mod written;

use std::process::ExitCode;
use std::time::Instant;

use clap::{Parser, Subcommand};
use supervol_arguments::allocation::ExitOnOutOfMemory;
use supervol_arguments::program::CommandLine;
use supervol_arguments::{bench, chart, view};

use crate::executables::Executable;

#[derive(Debug, Subcommand)]
enum Command {
    /// Build a container from a volume file or a folder of slices
    Build(Box<build::Arguments>),
    /// Write a synthetic volume as a container or a raw file
    Synth(synth::Arguments),
    /// Describe containers, volume files and unfinished files
    Info(Box<info::Arguments>),
    /// Print or draw the histogram of a volume, with the opacities of its default picture
    Histogram(Box<histogram::Arguments>),
    /// Check containers against every rule of the format, or prove pictures of a container
    Verify(Box<verify::Arguments>),
    /// Write voxels of a container to a file of another format: .npy, .raw, .nrrd, .nii, .nii.gz, .mha, .tif, .vti,
    /// .sgy, .zarr
    Extract(extract::Arguments),
    /// Write an isosurface of a container as a mesh: .ply, .stl, .obj
    Mesh(mesh::Arguments),
    /// Render a picture of a container or volume file
    ///
    /// For a volume file, a container is built into the cache folder first. Without a scene, camera and colours are
    /// chosen to suit the data.
    Render(Box<render::Arguments>),
    /// Open a volume in a window: rotate, clip and colour it, save scenes, export pictures
    View(Box<view::Arguments>),
    /// Measure pictures: cost, difference from the reference, comparison with other programs
    Bench(Box<bench::Arguments>),
    /// Build and render a real and a synthetic volume, to test the installation
    Demo(demo::Arguments),
    /// Measure speed against accuracy, or the regimes in which methods fail, and write a report
    Chart(chart::Arguments),
    /// Print shell completions, for example `supervol completions bash > FILE`
    Completions(completions::Arguments),
    /// Write the man pages of all commands
    Man(completions::ManArguments),
    /// Print the JSON Schema of scene files, for editors and validators
    Schema,
}

#[global_allocator]
static ALLOCATOR: ExitOnOutOfMemory = ExitOnOutOfMemory;

fn main() -> ExitCode {
    let begun = Instant::now();
    CommandLine::<Command>::parse().run(
        || (),
        |command| match command {
            Command::Build(arguments) => build::run(&arguments),
            Command::Synth(arguments) => synth::run(&arguments),
            Command::Info(arguments) => info::run(&arguments),
            Command::Histogram(arguments) => histogram::run(&arguments),
            Command::Verify(arguments) => verify::run(&arguments),
            Command::Extract(arguments) => extract::run(&arguments),
            Command::Mesh(arguments) => mesh::run(&arguments),
            Command::Render(arguments) => render::run(&arguments, begun),
            Command::View(_) => Executable::VIEW.run(),
            Command::Bench(_) | Command::Chart(_) => Executable::MEASURE.run(),
            Command::Demo(arguments) => demo::run(&arguments),
            Command::Completions(arguments) => completions::run::<CommandLine<Command>>(&arguments),
            Command::Man(arguments) => completions::run_man::<CommandLine<Command>>(&arguments),
            Command::Schema => completions::run_schema(),
        },
    )
}
