//! Arguments of `supervol view`.

use std::num::NonZero;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use crate::cache::CacheArguments;
use crate::quantity;
use crate::source::SourceArguments;

/// What to show first, and within what memory.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Container, or a volume file, which is built into the cache folder first; without it, the window asks for one
    pub file: Option<PathBuf>,
    /// Scene file (JSON) to begin with, - for standard input, or the scene itself ('{...}')
    #[arg(long, value_name = "SCENE.json")]
    pub scene: Option<PathBuf>,
    /// Most host memory to use for bricks, rays and pictures, beside the window itself
    #[arg(long, default_value = "512MiB", value_parser = quantity::bytes)]
    pub host_memory: u64,
    /// Largest error of any channel of any pixel that is aimed for, as for `render`
    #[arg(long, value_name = "E", default_value = "0.5/255", value_parser = quantity::picture_error)]
    pub max_error: f64,
    /// Time after which a change shows a picture, if coarse at first
    #[arg(long, value_name = "MS", default_value = "33", value_parser = quantity::milliseconds)]
    pub time_budget: u64,
    /// Who casts the rays of pictures; the window has a button for it
    #[arg(long, value_enum, default_value_t = BackendName::Cpu)]
    pub backend: BackendName,
    /// Threads; all processors by default
    #[arg(long, value_parser = quantity::threads)]
    pub threads: Option<NonZero<usize>>,
    /// Where containers of volume files are kept.
    #[command(flatten)]
    pub cache: CacheArguments,
    /// How a volume file is read.
    #[command(flatten)]
    pub source: SourceArguments,
}

/// Backends of the window's pictures.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum BackendName {
    /// The processor, which also says how far each pixel may be off
    Cpu,
    /// The graphics device, whichever there is
    Gpu,
    /// A graphics device where there is one that is no processor itself, else the CPU
    Auto,
}
