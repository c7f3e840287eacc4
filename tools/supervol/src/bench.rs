//! `supervol bench`: what pictures cost here, and in other programs; what frames cost while the camera moves; whether
//! random scenes keep the error that is asked for.

use std::io::Write;
use std::num::NonZero;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use supervol_files::unfinished::UnfinishedFolder;
use supervol_format::Container;
use supervol_measure::ledger::Ledger;
use supervol_measure::paths::CameraPath;
use supervol_measure::peers::cases::{Looks, Subject};
use supervol_measure::peers::{Options, PeerOptions, Run, SameSampling, Sizes, report, vtk};
use supervol_measure::virtual_volume::Field;
use supervol_measure::{ChartError, Context, Scale, leaping, ledger, paths, peers, random_scenes};
use supervol_preprocess::kept::{Reading, is_container};
use supervol_preprocess::{BuildOptions, Existing};
use supervol_runtime::lod::by_error::ANY_ERROR;
use supervol_runtime::render::options::Backend;

use crate::build::{SourceArguments, open, refuse_for_container, refuse_without_file};
use crate::demo::CARP;
use crate::failure::{Failure, with_container, with_output};
use crate::look::ModeName;
use crate::output::{Force, ReportFolder};
use crate::progress::{Reporter, announce};
use crate::quantity;
use crate::render::default_scene;

/// Size of the program's own default picture: that of `--volume`.
const DEFAULT_PICTURE: [u32; 2] = [800, 600];

/// What to measure, and against whom.
///
/// Without --peers, --path, --leaping and --random-scenes Supervol's own pictures are measured: cost, and distance from
/// the reference. Benches of single parts (codecs, builds, pictures) are run by `cargo bench -p supervol-benches`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Draw everything with VTK's CPU ray caster, too; it is installed into a private Python environment the first time
    #[arg(long)]
    peers: bool,
    /// Measure frames along a path instead: orbit, dolly, drag (the transfer function), or a file (see benches/paths)
    #[arg(long, value_name = "NAME|FILE.json", conflicts_with = "peers", group = "cast")]
    path: Option<String>,
    /// Hand over each frame of the path after this time, and measure how far it is from the converged one
    #[arg(long, value_name = "MS", requires = "path", value_parser = quantity::milliseconds)]
    frame_budget: Option<u64>,
    /// After each frame of the path, read for the next one for at most this time
    #[arg(long, value_name = "MS", requires = "path", value_parser = quantity::milliseconds)]
    ahead: Option<u64>,
    /// Error of the frames of the path that is aimed for, a share of full scale [default: 1, levels by the size of voxels alone]
    #[arg(long, value_name = "E", requires = "path", value_parser = quantity::picture_error)]
    max_error: Option<f64>,
    /// Who casts the rays of the path, or of the random scenes
    #[arg(long, value_name = "BACKEND", requires = "cast", default_value = "cpu")]
    backend: PathBackend,
    /// Along the path, a cube of N voxels along an edge of which nothing is stored: every byte is computed when it is read
    #[arg(long = "virtual", value_name = "N", requires = "path", conflicts_with_all = ["scene", "volume", "edge", "shading"],
          value_parser = clap::value_parser!(u64).range(128..=65_536))]
    virtual_edge: Option<u64>,
    /// What its voxels are: numbers of bricks, whose coarse levels tell nothing of the fine ones (10321 along an edge are 1 TiB), or
    /// waves, which are smooth (8192 are 1 TiB)
    #[arg(long, value_name = "FIELD", requires = "virtual_edge", default_value = "bricks")]
    field: VirtualField,
    /// Most memory for decoded bricks along the path [default: all that is left of --host-memory]
    #[arg(long, value_name = "BYTES", requires = "path", value_parser = quantity::bytes)]
    cache: Option<u64>,
    /// Instead, draw N random scenes (volume, transfer function, camera, shading, clipping) at --max-error 0.1, 0.5, 2 and 8 of 255, and compare them with the reference; exit code 1 if one is further off than was asked for.
    /// 1000 scenes take some 7 minutes on one core
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=10_000), group = "cast",
          conflicts_with_all = ["peers", "path", "leaping", "quick", "scene", "volume", "size", "edge", "pixels", "repeats", "record"])]
    random_scenes: Option<u64>,
    /// Seed of the random scenes
    #[arg(long, value_name = "S", default_value = "1", requires = "random_scenes")]
    seed: u64,
    /// Number of the first random scene: to draw one again
    #[arg(long, value_name = "K", default_value = "0", requires = "random_scenes",
          value_parser = clap::value_parser!(u64).range(..1 << 48))]
    first_scene: u64,
    /// What the rays of the random scenes gather
    #[arg(long, value_enum, value_name = "MODE", default_value = "dvr", requires = "random_scenes")]
    mode: ModeName,
    /// Measure what it costs to know where nothing shows, and what that saves
    #[arg(long, conflicts_with_all = ["peers", "path", "record", "output", "shading"])]
    leaping: bool,
    /// Small volumes and pictures: seconds instead of minutes
    #[arg(long)]
    quick: bool,
    /// Only this scene; may be given several times
    #[arg(long, value_name = "NAME", conflicts_with = "volume")]
    scene: Vec<String>,
    /// Which pictures of a scene
    #[arg(long, value_enum, default_value = "both", conflicts_with = "volume")]
    shading: ShadingName,
    /// This volume instead of scenes, in the picture that `render` makes without a scene file: a container, or any file
    /// that `build` reads
    #[arg(long, value_name = "FILE")]
    volume: Option<PathBuf>,
    /// Pixels of a picture [default: 1024x768; 800x600 with --volume; 160x120 with --quick]
    #[arg(long, value_name = "WxH", value_parser = quantity::image_size)]
    size: Option<[u32; 2]>,
    /// Voxels along an edge of the synthetic volumes [default: 256 or 512, by scene]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(2..=4096), conflicts_with = "volume")]
    edge: Option<u64>,
    /// Pixels at which errors are measured, drawn at random with a fixed seed [default: 1000; 300 with --quick]
    #[arg(long, value_name = "N", conflicts_with = "path")]
    pixels: Option<NonZero<usize>>,
    /// Pictures that are timed after the first, fewer where they take over a minute [default: 5; 3 with --quick]
    #[arg(long, value_name = "N", conflicts_with = "path")]
    repeats: Option<NonZero<usize>>,
    /// Let Supervol sample as VTK does, too
    #[arg(long, requires = "peers")]
    same_sampling: bool,
    /// Most memory for Supervol's bricks, rays and pictures
    #[arg(long, default_value = "2GiB", value_parser = quantity::bytes)]
    host_memory: u64,
    /// Write tables, numbers (JSON) and pictures into this folder
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Append the numbers to this .csv file, or to DIR/MACHINE/DATE.csv
    #[arg(long, value_name = "FILE.csv|DIR")]
    record: Option<PathBuf>,
    /// Threads of either program
    #[arg(long, default_value = "1", value_parser = quantity::threads)]
    threads: NonZero<usize>,
    /// The Python that makes the environment
    #[arg(long, value_name = "PROGRAM", default_value = "python3")]
    python: PathBuf,
    /// Folder of the environment; by default in the user's cache
    #[arg(long, value_name = "DIR")]
    environment: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    // Last: what follows in the help would stand under its headings.
    #[command(flatten)]
    source: SourceArguments,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum PathBackend {
    Cpu,
    Gpu,
    /// One after the other, in one table.
    Both,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum VirtualField {
    Bricks,
    Waves,
}

impl From<VirtualField> for Field {
    fn from(field: VirtualField) -> Self {
        match field {
            VirtualField::Bricks => Self::BrickId,
            VirtualField::Waves => Self::Waves,
        }
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum ShadingName {
    Both,
    Unshaded,
    Shaded,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    // Whatever is measured.
    arguments.reading()?;
    let folder = UnfinishedFolder::create_in(&std::env::temp_dir()).map_err(with_output)?;
    if let Some(output) = &arguments.output {
        // Before anything is measured: a folder that cannot be written costs no time.
        ReportFolder::begin(output, arguments.force)?;
    }
    let scale = if arguments.quick { Scale::Small } else { Scale::Full };
    let context = Context { scale, folder: folder.path(), say: &announce };
    match (&arguments.path, arguments.random_scenes) {
        (Some(path), _) => arguments.along(&context, path),
        (None, Some(scenes)) => arguments.random(&context, scenes),
        (None, None) if arguments.leaping => arguments.leap(&context),
        (None, None) => arguments.compare(&context),
    }
}

impl Arguments {
    fn compare(&self, context: &Context<'_>) -> Result<(), Failure> {
        let peer = match (self.peers, self.environment.clone().or_else(cached_environment)) {
            (false, _) => None,
            (true, Some(environment)) => Some(PeerOptions { python: self.python.clone(), environment }),
            (true, None) => {
                let message = "--peers: the user's cache folder is not known; name a folder with --environment DIR";
                return Err(Failure::Command(message.into()));
            }
        };
        let options = Options {
            peer,
            carp_nifti_gz: CARP,
            subject: self.subject(context)?,
            looks: self.looks(),
            edge: self.edge,
            run: Run {
                threads: self.threads.get(),
                same_sampling: if self.same_sampling { SameSampling::Yes } else { SameSampling::No },
                sizes: self.sizes(context.scale),
            },
        };
        let ledger = self.ledger()?;
        let comparison = peers::compare(context, &options)?;
        let command = command_line();
        if let Some(output) = &self.output {
            self.reports(output, |folder| report::write(&comparison, &command, folder))?;
        }
        keep(ledger.as_ref(), &ledger::of_comparison(&comparison))?;
        write!(crate::terminal::stdout(), "{}", report::markdown(&comparison, &command)).map_err(with_output)
    }

    fn along(&self, context: &Context<'_>, path: &str) -> Result<(), Failure> {
        let path = camera_path(path)?;
        let sizes = self.sizes(context.scale);
        let options = paths::Options {
            subject: self.subject(context)?,
            looks: self.looks(),
            edge: self.edge,
            carp_nifti_gz: CARP,
            threads: self.threads.get(),
            image: sizes.image,
            host_memory_bytes: sizes.host_memory_bytes,
            cache_bytes: self.cache,
            frame_budget_ms: self.frame_budget,
            ahead_ms: self.ahead,
            max_error: self.max_error.unwrap_or(ANY_ERROR),
            backends: match self.backend {
                PathBackend::Cpu => vec![Backend::Cpu],
                PathBackend::Gpu => vec![Backend::Gpu],
                PathBackend::Both => vec![Backend::Cpu, Backend::Gpu],
            },
        };
        let ledger = self.ledger()?;
        let rides = paths::run(context, &path, &options)?;
        let command = command_line();
        if let Some(output) = &self.output {
            self.reports(output, |folder| paths::write(&path, &rides, &command, folder))?;
        }
        keep(ledger.as_ref(), &ledger::of_rides(&path.name, &rides, options.threads, options.image))?;
        write!(crate::terminal::stdout(), "{}", paths::markdown(&path, &rides, &options, &command)).map_err(with_output)
    }

    fn random(&self, context: &Context<'_>, scenes: u64) -> Result<(), Failure> {
        let (seed, first, threads) = (self.seed, self.first_scene, self.threads.get());
        let backend = match self.backend {
            PathBackend::Cpu => Backend::Cpu,
            PathBackend::Gpu => Backend::Gpu,
            PathBackend::Both => {
                let message = "--random-scenes: --backend both compares nothing; expected cpu or gpu";
                return Err(Failure::Command(message.into()));
            }
        };
        let options = random_scenes::Options { seed, first, scenes, mode: self.mode.into(), threads, backend };
        let found = random_scenes::run(context, options)?;
        let text = random_scenes::markdown(&found, &command_line());
        if let Some(output) = &self.output {
            self.reports(output, |folder| random_scenes::write(&found, &text, folder))?;
        }
        write!(crate::terminal::stdout(), "{text}").map_err(with_output)?;
        match found.scenes_above().as_slice() {
            [] => Ok(()),
            above => Err(Failure::Data(format!(
                "{} of {scenes} random scenes of seed {seed} are further off than was asked for; draw the first of them \
                 again with --random-scenes 1 --seed {seed} --first-scene {}",
                above.len(),
                above[0]
            ))),
        }
    }

    fn leap(&self, context: &Context<'_>) -> Result<(), Failure> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.threads.get()).build();
        let pool = pool.map_err(|e| ChartError::Command(format!("{} threads: {e}", self.threads)))?;
        let options = leaping::Options {
            subject: self.subject(context)?,
            edge: self.edge,
            image: self.sizes(context.scale).image,
            carp_nifti_gz: CARP,
        };
        let measured = pool.install(|| leaping::run(context, &options))?;
        write!(crate::terminal::stdout(), "{}", leaping::markdown(&measured)).map_err(with_output)
    }

    /// Writes what `write` puts into a folder into the one that was asked for.
    fn reports(&self, output: &Path, write: impl FnOnce(&Path) -> Result<(), ChartError>) -> Result<(), Failure> {
        let path = self.path.as_ref().map(PathBuf::from);
        let inputs: Vec<&Path> =
            [&self.volume, &path, &self.record].into_iter().flatten().map(PathBuf::as_path).collect();
        ReportFolder::begin(output, self.force)?.write_with(&inputs, write)
    }

    /// The record, opened before anything is measured.
    fn ledger(&self) -> Result<Option<Ledger>, ChartError> {
        let path = self.path.as_ref().map(PathBuf::from);
        let inputs: Vec<&Path> = [&self.volume, &path].into_iter().flatten().map(PathBuf::as_path).collect();
        self.record.as_deref().map(|record| Ledger::open(record, &inputs)).transpose()
    }

    fn looks(&self) -> Looks {
        match self.shading {
            ShadingName::Both => Looks::Both,
            ShadingName::Unshaded => Looks::Unshaded,
            ShadingName::Shaded => Looks::Shaded,
        }
    }

    fn sizes(&self, scale: Scale) -> Sizes {
        let default = Sizes::of(scale);
        let image = match (self.size, &self.volume, scale) {
            (Some(size), _, _) => size,
            (None, Some(_), Scale::Full) => DEFAULT_PICTURE,
            (None, _, _) => default.image,
        };
        Sizes {
            image,
            repeats: self.repeats.map_or(default.repeats, NonZero::get),
            error_pixels: self.pixels.map_or(default.error_pixels, NonZero::get),
            host_memory_bytes: self.host_memory,
            ..default
        }
    }

    /// How `--volume` is read; refused where nothing is.
    fn reading(&self) -> Result<Reading, Failure> {
        let reading = self.source.reading(BuildOptions::default().memory_bytes)?;
        match &self.volume {
            Some(file) if is_container(file) => refuse_for_container(&reading, file)?,
            Some(_) => (),
            None => refuse_without_file(&reading, "--volume")?,
        }
        Ok(reading)
    }

    fn subject(&self, context: &Context<'_>) -> Result<Subject, Failure> {
        if let Some(edge) = self.virtual_edge {
            return Ok(Subject::Virtual(self.field.into(), edge));
        }
        let Some(file) = &self.volume else { return Ok(Subject::Scenes(self.scene.clone())) };
        let path = if is_container(file) { file.clone() } else { built(file, &self.reading()?, context.folder)? };
        let container = Container::open(&path).map_err(|e| with_container(&path, e))?;
        Ok(Subject::Own { container: path, scene: Box::new(default_scene(&container)) })
    }
}

/// A container of a volume file, in this folder.
fn built(file: &Path, reading: &Reading, folder: &Path) -> Result<PathBuf, Failure> {
    let (source, origin) = open(reading, file, folder)?;
    let name = file.file_stem().map_or("volume".into(), |stem| stem.to_string_lossy());
    let path = folder.join(format!("{name}.svol"));
    announce(&format!("building {name}, {}", source.info().dims));
    let options = BuildOptions { existing: Existing::Replace, ..BuildOptions::default() };
    let reporter = Reporter::over_bytes(false);
    let built = supervol_preprocess::build(source.as_ref(), origin, &path, &options, &|p| reporter.show(p));
    reporter.finish();
    built?;
    Ok(path)
}

/// Appends to the record, if there is one.
fn keep(ledger: Option<&Ledger>, entries: &[ledger::Entry]) -> Result<(), ChartError> {
    let Some(ledger) = ledger else { return Ok(()) };
    ledger.append(&recorded_command(std::env::args().skip(1)), entries)?;
    announce(&format!("{} lines appended to {}", entries.len(), ledger.file.display()));
    Ok(())
}

/// A path that comes with the program, or one from a file.
fn camera_path(name: &str) -> Result<CameraPath, Failure> {
    if let Some(path) = paths::built_in(name) {
        return Ok(path?);
    }
    let known = paths::BUILT_IN.map(|(known, _)| known).join(", ");
    let text = crate::input::read_text(Path::new(name), &format!("{known} or a camera path, --path"))?;
    CameraPath::from_json(&text).map_err(|e| Failure::Command(format!("{name}: {e}")))
}

/// Where environments are kept unless somebody says otherwise: nothing but time is lost when the folder is deleted.
fn cached_environment() -> Option<PathBuf> {
    let of = |variable: &str| std::env::var_os(variable).map(PathBuf::from).filter(|path| path.is_absolute());
    let cache = of("XDG_CACHE_HOME").or_else(|| of("LOCALAPPDATA")).or_else(|| of("HOME").map(|h| h.join(".cache")))?;
    let package = vtk::PACKAGE;
    Some(cache.join("supervol").join("peers").join(format!("{}-{}", package.name, package.version)))
}

/// Options that say where files of this machine lie, and nothing about what is measured.
const PLACES: [&str; 5] = ["-o", "--output", "--record", "--environment", "--python"];

/// A command as records keep it: without places on this machine, files by their names.
fn recorded_command(arguments: impl Iterator<Item = String>) -> String {
    let mut words = vec!["supervol".to_string()];
    let mut arguments = arguments;
    while let Some(word) = arguments.next() {
        if PLACES.contains(&word.as_str()) {
            arguments.next();
            continue;
        }
        // The same with the value in one word: `--output=out`, `-oout`.
        if word.starts_with("-o") || PLACES.iter().any(|option| word.starts_with(&format!("{option}="))) {
            continue;
        }
        let (option, value) = word.split_once('=').map_or((None, word.as_str()), |(o, v)| (Some(o), v));
        let name = Path::new(value).file_name().map_or(value.into(), |name| name.to_string_lossy());
        words.push(option.map_or(name.to_string(), |option| format!("{option}={name}")));
    }
    words.join(" ")
}

/// This command as it was given.
fn command_line() -> String {
    let arguments = std::env::args().skip(1);
    ["supervol".to_string()].into_iter().chain(arguments).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recorded_commands_name_no_places() {
        let of = |text: &str| recorded_command(text.split(' ').map(String::from));
        let given = "bench --peers -o /home/me/out --record=/r --volume /data/ct.raw --dims 5,6,7 --python python3 --quick -oout";
        assert_eq!(of(given), "supervol bench --peers --volume ct.raw --dims 5,6,7 --quick");
        assert_eq!(of("bench --volume=/data/ct.svol --size 80x60"), "supervol bench --volume=ct.svol --size 80x60");
    }
}
