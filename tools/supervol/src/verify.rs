//! `supervol verify`: checks every rule of a container.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use supervol_format::readable::counted;

use crate::failure::{Failure, with_output};
use crate::input::{Input, for_each};
use crate::progress::Reporter;
use crate::quantity::{self, show_bytes};

/// Which containers.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Containers; - is what standard input gives. All are checked, also where one breaks a rule
    #[arg(value_name = "CONTAINER", required = true)]
    containers: Vec<PathBuf>,
    /// Most memory
    #[arg(long, default_value = "512MiB", value_parser = quantity::bytes)]
    memory: u64,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    for_each(&arguments.containers, |path| verify(path, arguments.memory))
}

fn verify(path: &Path, memory_bytes: u64) -> Result<(), Failure> {
    let input = Input::named(path)?;
    let bar = Reporter::over_bricks();
    let result = supervol_preprocess::verify::verify(input.path(), memory_bytes, &|done, total| {
        bar.set_length(total);
        bar.set_position(done);
    });
    bar.finish_and_clear();
    let container = result?;
    writeln!(
        crate::terminal::remarks(),
        "{}: whole; {}, {}, every rule holds",
        path.display(),
        counted(container.pyramid().brick_count(), "brick"),
        show_bytes(container.file_bytes())
    )
    .map_err(with_output)
}
