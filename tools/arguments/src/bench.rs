//! Arguments of `supervol bench`.

use std::num::NonZero;
use std::path::PathBuf;

use clap::{Args, ValueEnum};

use crate::output::Force;
use crate::quantity;
use crate::scene::ModeName;
use crate::source::SourceArguments;

/// Measurements to make, and programs to compare with.
///
/// By default, measures Supervol's own pictures: cost, and difference from the reference. `cargo bench -p
/// supervol-benches` measures single parts: codecs, builds, pictures.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Also draw every picture with VTK's CPU ray caster
    ///
    /// The first run installs VTK into a private Python environment (--environment).
    #[arg(long)]
    pub peers: bool,
    /// Measure frames along a camera path: orbit, dolly, drag (edits the transfer function), or a JSON file
    ///
    /// Folder benches/paths has examples of path files.
    #[arg(long, value_name = "NAME|FILE.json", conflicts_with = "peers", group = "cast")]
    pub path: Option<String>,
    /// Deadline of each frame of the path, in ms; the report states the difference from the converged frame
    #[arg(long, value_name = "MS", requires = "path", value_parser = quantity::milliseconds)]
    pub frame_budget: Option<u64>,
    /// Longest time after each frame for reading bricks of the next frame, in ms
    #[arg(long, value_name = "MS", requires = "path", value_parser = quantity::milliseconds)]
    pub ahead: Option<u64>,
    /// Largest allowed error of the path's frames, as a fraction of full scale: 0.05/255 to 16/255, or 1 [default: 1]
    ///
    /// With 1, levels of detail follow from the size of a pixel alone.
    #[arg(long, value_name = "E", requires = "path", value_parser = quantity::picture_error)]
    pub max_error: Option<f64>,
    /// Backend that casts the rays of the path or of the random scenes
    #[arg(long, value_name = "BACKEND", requires = "cast", default_value = "cpu")]
    pub backend: PathBackend,
    /// Edge of a virtual volume for the path, in voxels: 128 to 65536
    ///
    /// A virtual volume stores nothing. Each byte is computed when it is read.
    #[arg(long = "virtual", value_name = "N", requires = "path", conflicts_with_all = ["scene", "volume", "edge", "shading"],
          value_parser = clap::value_parser!(u64).range(128..=65_536))]
    pub virtual_edge: Option<u64>,
    /// Values of the virtual volume: numbers of bricks, or smooth waves
    ///
    /// With bricks, coarse levels tell nothing about fine ones; --virtual 10321 makes 1 TiB. With waves, --virtual
    /// 8192 makes 1 TiB.
    #[arg(long, value_name = "FIELD", requires = "virtual_edge", default_value = "bricks")]
    pub field: VirtualField,
    /// Memory limit for decoded bricks along the path, in bytes, for example 64MiB [default: the rest of
    /// --host-memory]
    #[arg(long, value_name = "BYTES", requires = "path", value_parser = quantity::bytes)]
    pub cache: Option<u64>,
    /// Compare N random scenes with the reference: 1 to 10000
    ///
    /// Each scene has a random volume, transfer function, camera, shading and clipping. It is drawn with --max-error
    /// 0.1, 0.5, 2 and 8 of 255. The exit code is 1 if one picture exceeds its allowed error, or a pixel the error that
    /// the picture states. 1000 scenes take about 7 minutes on one core. With --volume, N random scenes of each of these
    /// volumes.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=10_000), group = "cast",
          conflicts_with_all = ["peers", "path", "leaping", "quick", "scene", "size", "edge", "pixels", "repeats", "record"])]
    pub random_scenes: Option<u64>,
    /// Seed of the random scenes
    #[arg(long, value_name = "S", default_value = "1", requires = "random_scenes")]
    pub seed: u64,
    /// Number of the first random scene, for example to repeat a single one
    #[arg(long, value_name = "K", default_value = "0", requires = "random_scenes",
          value_parser = clap::value_parser!(u64).range(..1 << 48))]
    pub first_scene: u64,
    /// Rendering mode of the random scenes
    #[arg(long, value_enum, value_name = "MODE", default_value = "dvr", requires = "random_scenes")]
    pub mode: ModeName,
    /// Give each random scene a random opacity by the gradient, too (mode dvr, on the CPU)
    #[arg(long, requires = "random_scenes")]
    pub gradient_opacity: bool,
    /// Give each random scene cuts whose faces are lit by their own normals (mode dvr, on the CPU)
    #[arg(long, requires = "random_scenes", conflicts_with = "gradient_opacity")]
    pub cut_normals: bool,
    /// Measure empty-space leaping: its cost, and the time that it saves
    #[arg(long, conflicts_with_all = ["peers", "path", "record", "output", "shading"])]
    pub leaping: bool,
    /// Use small volumes and pictures: takes seconds instead of minutes
    #[arg(long)]
    pub quick: bool,
    /// Measure only this scene; repeat the option for several scenes
    #[arg(long, value_name = "NAME", conflicts_with = "volume")]
    pub scene: Vec<String>,
    /// Pictures of each scene: unshaded, shaded, or both
    #[arg(long, value_enum, default_value = "both", conflicts_with = "volume")]
    pub shading: ShadingName,
    /// Measure this volume instead of scenes: a container, or any file that `build` reads
    ///
    /// The picture is the default picture of `render`. --random-scenes takes several files.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    pub volume: Vec<PathBuf>,
    /// Size of a picture in pixels, for example 800x600 [default: 1024x768; 800x600 with --volume; 160x120 with
    /// --quick]
    #[arg(long, value_name = "WxH", value_parser = quantity::image_size)]
    pub size: Option<[u32; 2]>,
    /// Edge of the synthetic volumes in voxels: 2 to 4096 [default: 256 or 512, by scene]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(2..=4096), conflicts_with = "volume")]
    pub edge: Option<u64>,
    /// Number of pixels at which errors are measured; the seed that selects them is fixed [default: 1000; 300 with
    /// --quick]
    #[arg(long, value_name = "N", conflicts_with = "path")]
    pub pixels: Option<NonZero<usize>>,
    /// Number of timed pictures after the first; fewer if they take over a minute [default: 5; 3 with --quick]
    #[arg(long, value_name = "N", conflicts_with = "path")]
    pub repeats: Option<NonZero<usize>>,
    /// Also draw with Supervol at the sample positions of VTK
    #[arg(long, requires = "peers")]
    pub same_sampling: bool,
    /// Memory limit for Supervol's bricks, rays and pictures, for example 512MiB
    #[arg(long, default_value = "2GiB", value_parser = quantity::bytes)]
    pub host_memory: u64,
    /// Folder for tables, numbers (JSON) and pictures
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// CSV file to which the numbers are appended; for a folder DIR, the file is DIR/MACHINE/DATE.csv
    #[arg(long, value_name = "FILE.csv|DIR")]
    pub record: Option<PathBuf>,
    /// Number of threads of each program: 1 to 1024
    #[arg(long, default_value = "1", value_parser = quantity::threads)]
    pub threads: NonZero<usize>,
    /// Python program that creates the environment
    #[arg(long, value_name = "PROGRAM", default_value = "python3")]
    pub python: PathBuf,
    /// Folder of the Python environment [default: in the cache folder of the user]
    #[arg(long, value_name = "DIR")]
    pub environment: Option<PathBuf>,
    /// `--force`.
    #[command(flatten)]
    pub force: Force,
    /// Options for reading `--volume`. They stand last: the help puts options that follow under their headings.
    #[command(flatten)]
    pub source: SourceArguments,
}

/// Backends that `--path` and `--random-scenes` measure.
#[derive(Debug, Clone, Copy, ValueEnum)]
#[allow(missing_docs, reason = "names that need no help text; comments would become one")]
pub enum PathBackend {
    Cpu,
    Gpu,
    /// The CPU, then the GPU, in one table
    Both,
}

/// Fields of `--virtual`.
#[derive(Debug, Clone, Copy, ValueEnum)]
#[allow(missing_docs, reason = "names that need no help text; comments would become one")]
pub enum VirtualField {
    Bricks,
    Waves,
}

/// Pictures of a scene.
#[derive(Debug, Clone, Copy, ValueEnum)]
#[allow(missing_docs, reason = "names that need no help text; comments would become one")]
pub enum ShadingName {
    Both,
    Unshaded,
    Shaded,
}
