//! `supervol view`: a window on a volume.

use std::num::NonZero;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use supervol_preprocess::BuildOptions;
use supervol_preprocess::kept::is_container;
use supervol_runtime::render::options::Backend;
use supervol_viewer::folders::Folders;
use supervol_viewer::worker::Settings;
use supervol_viewer::{Launch, ViewerError};

use crate::build::{SourceArguments, refuse_for_container};
use crate::cache::CacheArguments;
use crate::failure::Failure;
use crate::{quantity, render};

/// What to show first, and within what memory.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Container, or a volume file, which is built into the cache folder first; without it, the window asks for one
    file: Option<PathBuf>,
    /// Scene file (JSON) to begin with, - for standard input, or the scene itself ('{...}')
    #[arg(long, value_name = "SCENE.json")]
    scene: Option<PathBuf>,
    /// Most host memory to use for bricks, rays and pictures, beside the window itself
    #[arg(long, default_value = "512MiB", value_parser = quantity::bytes)]
    host_memory: u64,
    /// Largest error of any channel of any pixel that is aimed for, as for `render`
    #[arg(long, value_name = "E", default_value = "0.5/255", value_parser = quantity::picture_error)]
    max_error: f64,
    /// Time after which a change shows a picture, if coarse at first
    #[arg(long, value_name = "MS", default_value = "33", value_parser = quantity::milliseconds)]
    time_budget: u64,
    /// Who casts the rays of pictures; the window has a button for it
    #[arg(long, value_enum, default_value_t = BackendName::Cpu)]
    backend: BackendName,
    /// Threads; all processors by default
    #[arg(long, value_parser = quantity::threads)]
    threads: Option<NonZero<usize>>,
    #[command(flatten)]
    cache: CacheArguments,
    #[command(flatten)]
    source: SourceArguments,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum BackendName {
    /// The processor, which also says how far each pixel may be off
    Cpu,
    /// The graphics device, whichever there is
    Gpu,
    /// A graphics device where there is one that is no processor itself, else the CPU
    Auto,
}

/// Runs the command, until the window is closed.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let reading = arguments.source.reading(BuildOptions::default().memory_bytes)?;
    match &arguments.file {
        Some(file) if is_container(file) => refuse_for_container(&reading, file)?,
        Some(_) => (),
        None if reading.is_default() => (),
        None => return Err(Failure::command("options for volume files belong to a file: name it, too")),
    }
    let scene = arguments.scene.as_deref().map(render::read_scene).transpose()?.unwrap_or_default();
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
