//! Arguments of `supervol bench`.

use std::num::NonZero;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use crate::output::Force;
use crate::quantity;
use crate::scene::ModeName;
use crate::source::SourceArguments;

/// What to measure, and against whom.
///
/// Without --peers, --path, --leaping and --random-scenes Supervol's own pictures are measured: cost, and distance from
/// the reference. Benches of single parts (codecs, builds, pictures) are run by `cargo bench -p supervol-benches`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Draw everything with VTK's CPU ray caster, too; it is installed into a private Python environment the first time
    #[arg(long)]
    pub peers: bool,
    /// Measure frames along a path instead: orbit, dolly, drag (the transfer function), or a file (see benches/paths)
    #[arg(long, value_name = "NAME|FILE.json", conflicts_with = "peers", group = "cast")]
    pub path: Option<String>,
    /// Hand over each frame of the path after this time, and measure how far it is from the converged one
    #[arg(long, value_name = "MS", requires = "path", value_parser = quantity::milliseconds)]
    pub frame_budget: Option<u64>,
    /// After each frame of the path, read for the next one for at most this time
    #[arg(long, value_name = "MS", requires = "path", value_parser = quantity::milliseconds)]
    pub ahead: Option<u64>,
    /// Error of the frames of the path that is aimed for, a share of full scale [default: 1, levels by the size of voxels alone]
    #[arg(long, value_name = "E", requires = "path", value_parser = quantity::picture_error)]
    pub max_error: Option<f64>,
    /// Who casts the rays of the path, or of the random scenes
    #[arg(long, value_name = "BACKEND", requires = "cast", default_value = "cpu")]
    pub backend: PathBackend,
    /// Along the path, a cube of N voxels along an edge of which nothing is stored: every byte is computed when it is read
    #[arg(long = "virtual", value_name = "N", requires = "path", conflicts_with_all = ["scene", "volume", "edge", "shading"],
          value_parser = clap::value_parser!(u64).range(128..=65_536))]
    pub virtual_edge: Option<u64>,
    /// What its voxels are: numbers of bricks, whose coarse levels tell nothing of the fine ones (10321 along an edge are 1 TiB), or
    /// waves, which are smooth (8192 are 1 TiB)
    #[arg(long, value_name = "FIELD", requires = "virtual_edge", default_value = "bricks")]
    pub field: VirtualField,
    /// Most memory for decoded bricks along the path [default: all that is left of --host-memory]
    #[arg(long, value_name = "BYTES", requires = "path", value_parser = quantity::bytes)]
    pub cache: Option<u64>,
    /// Instead, draw N random scenes (volume, transfer function, camera, shading, clipping) at --max-error 0.1, 0.5, 2 and 8 of 255, and compare them with the reference; exit code 1 if one is further off than was asked for.
    /// 1000 scenes take some 7 minutes on one core
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=10_000), group = "cast",
          conflicts_with_all = ["peers", "path", "leaping", "quick", "scene", "volume", "size", "edge", "pixels", "repeats", "record"])]
    pub random_scenes: Option<u64>,
    /// Seed of the random scenes
    #[arg(long, value_name = "S", default_value = "1", requires = "random_scenes")]
    pub seed: u64,
    /// Number of the first random scene: to draw one again
    #[arg(long, value_name = "K", default_value = "0", requires = "random_scenes",
          value_parser = clap::value_parser!(u64).range(..1 << 48))]
    pub first_scene: u64,
    /// What the rays of the random scenes gather
    #[arg(long, value_enum, value_name = "MODE", default_value = "dvr", requires = "random_scenes")]
    pub mode: ModeName,
    /// Measure what it costs to know where nothing shows, and what that saves
    #[arg(long, conflicts_with_all = ["peers", "path", "record", "output", "shading"])]
    pub leaping: bool,
    /// Small volumes and pictures: seconds instead of minutes
    #[arg(long)]
    pub quick: bool,
    /// Only this scene; may be given several times
    #[arg(long, value_name = "NAME", conflicts_with = "volume")]
    pub scene: Vec<String>,
    /// Which pictures of a scene
    #[arg(long, value_enum, default_value = "both", conflicts_with = "volume")]
    pub shading: ShadingName,
    /// This volume instead of scenes, in the picture that `render` makes without a scene file: a container, or any file
    /// that `build` reads
    #[arg(long, value_name = "FILE")]
    pub volume: Option<PathBuf>,
    /// Pixels of a picture [default: 1024x768; 800x600 with --volume; 160x120 with --quick]
    #[arg(long, value_name = "WxH", value_parser = quantity::image_size)]
    pub size: Option<[u32; 2]>,
    /// Voxels along an edge of the synthetic volumes [default: 256 or 512, by scene]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(2..=4096), conflicts_with = "volume")]
    pub edge: Option<u64>,
    /// Pixels at which errors are measured, drawn at random with a fixed seed [default: 1000; 300 with --quick]
    #[arg(long, value_name = "N", conflicts_with = "path")]
    pub pixels: Option<NonZero<usize>>,
    /// Pictures that are timed after the first, fewer where they take over a minute [default: 5; 3 with --quick]
    #[arg(long, value_name = "N", conflicts_with = "path")]
    pub repeats: Option<NonZero<usize>>,
    /// Let Supervol sample as VTK does, too
    #[arg(long, requires = "peers")]
    pub same_sampling: bool,
    /// Most memory for Supervol's bricks, rays and pictures
    #[arg(long, default_value = "2GiB", value_parser = quantity::bytes)]
    pub host_memory: u64,
    /// Write tables, numbers (JSON) and pictures into this folder
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Append the numbers to this .csv file, or to DIR/MACHINE/DATE.csv
    #[arg(long, value_name = "FILE.csv|DIR")]
    pub record: Option<PathBuf>,
    /// Threads of either program
    #[arg(long, default_value = "1", value_parser = quantity::threads)]
    pub threads: NonZero<usize>,
    /// The Python that makes the environment
    #[arg(long, value_name = "PROGRAM", default_value = "python3")]
    pub python: PathBuf,
    /// Folder of the environment; by default in the user's cache
    #[arg(long, value_name = "DIR")]
    pub environment: Option<PathBuf>,
    /// `--force`.
    #[command(flatten)]
    pub force: Force,
    /// How `--volume` is read. Last: options that follow would stand under its headings in the help.
    #[command(flatten)]
    pub source: SourceArguments,
}

/// Backends that `--path` and `--random-scenes` measure.
#[derive(Debug, Clone, Copy, ValueEnum)]
#[allow(missing_docs, reason = "the names say it, and comments would be help texts")]
pub enum PathBackend {
    Cpu,
    Gpu,
    /// One after the other, in one table.
    Both,
}

/// Fields of `--virtual`.
#[derive(Debug, Clone, Copy, ValueEnum)]
#[allow(missing_docs, reason = "the names say it, and comments would be help texts")]
pub enum VirtualField {
    Bricks,
    Waves,
}

/// Pictures of a scene.
#[derive(Debug, Clone, Copy, ValueEnum)]
#[allow(missing_docs, reason = "the names say it, and comments would be help texts")]
pub enum ShadingName {
    Both,
    Unshaded,
    Shaded,
}
