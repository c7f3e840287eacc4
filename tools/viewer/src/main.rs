//! `supervol-view`: the executable behind `supervol view`, a window on a volume.
//!
//! `supervol` starts it with its own arguments, unchanged.

use std::num::NonZero;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use supervol::Backend;
use supervol_arguments::allocation::ExitOnOutOfMemory;
use supervol_arguments::failure::Failure;
use supervol_arguments::program::CommandLine;
use supervol_arguments::scene::read_scene;
use supervol_arguments::source::refuse_for_container;
use supervol_arguments::view::{Arguments, BackendName};
use supervol_preprocess::BuildOptions;
use supervol_preprocess::kept::is_container;
use supervol_viewer::ViewerError;
use supervol_viewer::folders::Folders;
use supervol_viewer::launch::Launch;
use supervol_viewer::worker::Settings;

#[derive(Debug, Subcommand)]
enum Command {
    View(Box<Arguments>),
}

#[global_allocator]
static ALLOCATOR: ExitOnOutOfMemory = ExitOnOutOfMemory;

fn main() -> ExitCode {
    CommandLine::<Command>::parse().run(|| (), |Command::View(arguments)| view(&arguments))
}

/// Runs the command, until the window is closed.
fn view(arguments: &Arguments) -> Result<(), Failure> {
    let reading = arguments.source.reading(BuildOptions::default().memory_bytes)?;
    match &arguments.file {
        Some(file) if is_container(file) => refuse_for_container(&reading, file)?,
        Some(_) => (),
        None if reading.is_default() => (),
        None => {
            return Err(Failure::command(
                "options that describe volume files need a file to describe: name the file, too",
            ));
        }
    }
    let scene = arguments.scene.as_deref().map(read_scene).transpose()?.unwrap_or_default();
    let settings = Settings {
        host_memory_bytes: arguments.host_memory,
        max_error: arguments.max_error,
        interaction_ms: arguments.time_budget,
        backend: match arguments.backend {
            BackendName::Cpu => Backend::Cpu,
            BackendName::Gpu => Backend::Gpu,
            BackendName::Auto => Backend::Auto,
        },
        threads: arguments.threads.map(NonZero::get),
        ..Settings::default()
    };
    let usual = Folders::of_system();
    let cache = arguments.cache.cache.clone().or(usual.cache.clone());
    let folders = Folders { cache, cache_limit_bytes: arguments.cache.limit_bytes(), ..usual };
    supervol_viewer::run(Launch { file: arguments.file.clone(), reading, scene, settings, folders })
        .map_err(|error @ (ViewerError::Window(_) | ViewerError::Graphics(_))| Failure::Machine(error.to_string()))
}
