//! Arguments of `supervol view`.

use std::num::NonZero;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use crate::cache::CacheArguments;
use crate::quantity;
use crate::source::SourceArguments;

/// First picture of the window, and memory limits.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Container or volume file; without it, the window asks for a file
    ///
    /// For a volume file, a container is built into the cache folder first.
    pub file: Option<PathBuf>,
    /// First scene: a scene file (JSON), - for standard input, or the scene itself ('{...}')
    #[arg(long, value_name = "SCENE.json")]
    pub scene: Option<PathBuf>,
    /// Memory limit for bricks, rays and pictures, for example 2GiB
    ///
    /// The window itself uses memory beyond this limit.
    #[arg(long, default_value = "512MiB", value_parser = quantity::bytes)]
    pub host_memory: u64,
    /// Largest allowed error of a pixel channel, as a fraction of full scale: 0.05/255 to 16/255, or 1; see `render`
    #[arg(long, value_name = "E", default_value = "0.5/255", value_parser = quantity::picture_error)]
    pub max_error: f64,
    /// Deadline for the first picture after a change, in ms
    ///
    /// The first picture may be coarse; finer ones follow.
    #[arg(long, value_name = "MS", default_value = "33", value_parser = quantity::milliseconds)]
    pub time_budget: u64,
    /// Backend that casts the rays; a button of the window changes it
    #[arg(long, value_enum, default_value_t = BackendName::Cpu)]
    pub backend: BackendName,
    /// Number of threads: 1 to 1024 [default: all processors]
    #[arg(long, value_parser = quantity::threads)]
    pub threads: Option<NonZero<usize>>,
    /// Options of the cache folder.
    #[command(flatten)]
    pub cache: CacheArguments,
    /// Options for reading a volume file.
    #[command(flatten)]
    pub source: SourceArguments,
}

/// Backends of the window's pictures.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum BackendName {
    /// The CPU; it also states the error of each pixel
    Cpu,
    /// The GPU, also a software adapter
    Gpu,
    /// The GPU if there is a hardware adapter, else the CPU
    Auto,
}
