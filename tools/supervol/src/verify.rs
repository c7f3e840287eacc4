//! `supervol verify`: checks every rule of a container.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use supervol_format::readable::counted;

use crate::failure::{Failure, with_output};
use crate::progress::Reporter;
use crate::quantity::{self, show_bytes};

/// Which container.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Container
    container: PathBuf,
    /// Most memory
    #[arg(long, default_value = "512MiB", value_parser = quantity::bytes)]
    memory: u64,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let bar = Reporter::over_bricks();
    let result = supervol_preprocess::verify::verify(&arguments.container, arguments.memory, &|done, total| {
        bar.set_length(total);
        bar.set_position(done);
    });
    bar.finish_and_clear();
    let container = result?;
    writeln!(
        crate::terminal::remarks(),
        "{}: whole; {}, {}, every rule holds",
        arguments.container.display(),
        counted(container.pyramid().brick_count(), "brick"),
        show_bytes(container.file_bytes())
    )
    .map_err(with_output)
}
