//! `supervol bench`: cost of pictures here and in other programs, cost of frames along a camera path, errors of
//! random scenes.

use std::io::Write;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use supervol_arguments::bench::{Arguments, PathBackend, ShadingName, VirtualField};
use supervol_arguments::failure::{Failure, with_container, with_output};
use supervol_arguments::input::read_text;
use supervol_arguments::output::ReportFolder;
use supervol_arguments::progress::{Reporter, announce};
use supervol_arguments::sample::CARP;
use supervol_arguments::source::{open, refuse_for_container, refuse_without_file};
use supervol_arguments::terminal::{Format, stdout};
use supervol_files::unfinished::UnfinishedFolder;
use supervol_format::Container;
use supervol_measure::ledger::Ledger;
use supervol_measure::paths::CameraPath;
use supervol_measure::peers::cases::{Looks, Subject};
use supervol_measure::peers::options::{PeerOptions, Run, SameSampling, Sizes};
use supervol_measure::peers::{Options, report, vtk};
use supervol_measure::random_scenes::Feature;
use supervol_measure::virtual_volume::Field;
use supervol_measure::volume::Volume;
use supervol_measure::{ChartError, Context, Scale, leaping, ledger, paths, peers, random_scenes};
use supervol_preprocess::kept::{Reading, is_container};
use supervol_preprocess::{BuildOptions, Existing};
use supervol_runtime::lod::by_error::ANY_ERROR;
use supervol_runtime::render::options::Backend;
use supervol_runtime::render::volume::PlacedVolume;
use supervol_scene::scene::Scene;

/// Size of the default picture of `render`; used for `--volume`.
const DEFAULT_PICTURE: [u32; 2] = [800, 600];

/// Field of this name.
fn field_of(name: VirtualField) -> Field {
    match name {
        VirtualField::Bricks => Field::BrickId,
        VirtualField::Waves => Field::Waves,
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let bench = Bench(arguments);
    // Options for volume files are checked whatever is measured.
    bench.reading()?;
    let folder = UnfinishedFolder::create_in(&std::env::temp_dir()).map_err(with_output)?;
    if let Some(output) = &arguments.output {
        // Before anything is measured: a folder that cannot be written costs no time.
        ReportFolder::begin(output, arguments.force)?;
    }
    let scale = if arguments.quick { Scale::Small } else { Scale::Full };
    let context = Context { scale, folder: folder.path(), say: &announce };
    match (&arguments.path, arguments.random_scenes) {
        (Some(path), _) => bench.along(&context, path),
        (None, Some(scenes)) => bench.random(&context, scenes),
        (None, None) if arguments.leaping => bench.leap(&context),
        (None, None) => bench.compare(&context),
    }
}

/// The command with its arguments.
struct Bench<'a>(&'a Arguments);

impl Bench<'_> {
    fn compare(&self, context: &Context<'_>) -> Result<(), Failure> {
        let peer = match (self.0.peers, self.0.environment.clone().or_else(cached_environment)) {
            (false, _) => None,
            (true, Some(environment)) => Some(PeerOptions { python: self.0.python.clone(), environment }),
            (true, None) => {
                let message = "--peers: the system names no cache folder; name a folder with --environment DIR";
                return Err(Failure::Command(message.into()));
            }
        };
        let options = Options {
            peer,
            carp_nifti_gz: CARP,
            subject: self.subject(context)?,
            looks: self.looks(),
            edge: self.0.edge,
            run: Run {
                threads: self.0.threads.get(),
                same_sampling: if self.0.same_sampling { SameSampling::Yes } else { SameSampling::No },
                sizes: self.sizes(context.scale),
            },
        };
        let ledger = self.ledger()?;
        let comparison = peers::compare(context, &options)?;
        let command = command_line();
        if let Some(output) = &self.0.output {
            self.reports(output, |folder| report::write(&comparison, &command, folder))?;
        }
        keep(ledger.as_ref(), &ledger::of_comparison(&comparison))?;
        write!(stdout(), "{}", report::markdown(&comparison, &command)).map_err(with_output)
    }

    fn along(&self, context: &Context<'_>, path: &str) -> Result<(), Failure> {
        let path = camera_path(path)?;
        let sizes = self.sizes(context.scale);
        let options = paths::Options {
            subject: self.subject(context)?,
            looks: self.looks(),
            edge: self.0.edge,
            carp_nifti_gz: CARP,
            threads: self.0.threads.get(),
            image: sizes.image,
            host_memory_bytes: sizes.host_memory_bytes,
            cache_bytes: self.0.cache,
            frame_budget_ms: self.0.frame_budget,
            ahead_ms: self.0.ahead,
            max_error: self.0.max_error.unwrap_or(ANY_ERROR),
            backends: match self.0.backend {
                PathBackend::Cpu => vec![Backend::Cpu],
                PathBackend::Gpu => vec![Backend::Gpu],
                PathBackend::Both => vec![Backend::Cpu, Backend::Gpu],
            },
        };
        let ledger = self.ledger()?;
        let rides = paths::run(context, &path, &options)?;
        let command = command_line();
        if let Some(output) = &self.0.output {
            self.reports(output, |folder| paths::write(&path, &rides, &command, folder))?;
        }
        keep(ledger.as_ref(), &ledger::of_rides(&path.name, &rides, options.threads, options.image))?;
        write!(stdout(), "{}", paths::markdown(&path, &rides, &options, &command)).map_err(with_output)
    }

    fn random(&self, context: &Context<'_>, scenes: u64) -> Result<(), Failure> {
        let (seed, first, threads) = (self.0.seed, self.0.first_scene, self.0.threads.get());
        let backend = match self.0.backend {
            PathBackend::Cpu => Backend::Cpu,
            PathBackend::Gpu => Backend::Gpu,
            PathBackend::Both => {
                let message = "--random-scenes: expected --backend cpu or gpu, found both";
                return Err(Failure::Command(message.into()));
            }
        };
        let feature = match (self.0.gradient_opacity, self.0.cut_normals) {
            (_, true) => Feature::CutNormals,
            (true, false) => Feature::GradientOpacity,
            (false, false) => Feature::None,
        };
        let mode = self.0.mode.into();
        let options = random_scenes::Options { seed, first, scenes, mode, feature, threads, backend };
        let mut found = Vec::new();
        if self.0.volume.is_empty() {
            found.push(random_scenes::run(context, options, None)?);
        }
        for file in &self.0.volume {
            let volume = Volume::open(&name_of(file), &self.container(file, context)?)?;
            found.push(random_scenes::run(context, options, Some(&volume))?);
        }
        let text = random_scenes::markdown(&found, &command_line());
        if let Some(output) = &self.0.output {
            self.reports(output, |folder| random_scenes::write(&found, &text, folder))?;
        }
        write!(stdout(), "{text}").map_err(with_output)?;
        let above: u64 = found.iter().map(|found| found.scenes_above().len() as u64).sum();
        let Some(number) = found.iter().position(|found| !found.scenes_above().is_empty()) else { return Ok(()) };
        let of = self.0.volume.get(number).map_or(String::new(), |file| format!(" --volume {}", file.display()));
        Err(Failure::Data(format!(
            "{above} of {} random scenes of seed {seed} exceed their allowed or their stated error; the same command with \
             --random-scenes 1 --first-scene {}{of} repeats the first of them",
            scenes * found.len() as u64,
            found[number].scenes_above()[0]
        )))
    }

    fn leap(&self, context: &Context<'_>) -> Result<(), Failure> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(self.0.threads.get()).build();
        let pool = pool.map_err(|e| ChartError::Command(format!("{} threads: {e}", self.0.threads)))?;
        let options = leaping::Options {
            subject: self.subject(context)?,
            edge: self.0.edge,
            image: self.sizes(context.scale).image,
            carp_nifti_gz: CARP,
        };
        let measured = pool.install(|| leaping::run(context, &options))?;
        write!(stdout(), "{}", leaping::markdown(&measured)).map_err(with_output)
    }

    /// Lets `write` fill a temporary folder, and moves its files to the output folder.
    fn reports(&self, output: &Path, write: impl FnOnce(&Path) -> Result<(), ChartError>) -> Result<(), Failure> {
        let path = self.0.path.as_ref().map(PathBuf::from);
        let inputs = self.0.volume.iter().chain([&path, &self.0.record].into_iter().flatten());
        let inputs: Vec<&Path> = inputs.map(PathBuf::as_path).collect();
        ReportFolder::begin(output, self.0.force)?.write_with(&inputs, write)
    }

    /// The record, opened before anything is measured.
    fn ledger(&self) -> Result<Option<Ledger>, ChartError> {
        let path = self.0.path.as_ref().map(PathBuf::from);
        let inputs: Vec<&Path> = self.0.volume.iter().chain(&path).map(PathBuf::as_path).collect();
        self.0.record.as_deref().map(|record| Ledger::open(record, &inputs)).transpose()
    }

    fn looks(&self) -> Looks {
        match self.0.shading {
            ShadingName::Both => Looks::Both,
            ShadingName::Unshaded => Looks::Unshaded,
            ShadingName::Shaded => Looks::Shaded,
        }
    }

    fn sizes(&self, scale: Scale) -> Sizes {
        let default = Sizes::of(scale);
        let image = match (self.0.size, self.0.volume.is_empty(), scale) {
            (Some(size), _, _) => size,
            (None, false, Scale::Full) => DEFAULT_PICTURE,
            (None, _, _) => default.image,
        };
        Sizes {
            image,
            repeats: self.0.repeats.map_or(default.repeats, NonZero::get),
            error_pixels: self.0.pixels.map_or(default.error_pixels, NonZero::get),
            host_memory_bytes: self.0.host_memory,
            ..default
        }
    }

    /// Options for reading `--volume`; refused if there is no volume file.
    fn reading(&self) -> Result<Reading, Failure> {
        let reading = self.0.source.reading(BuildOptions::default().memory_bytes)?;
        match self.0.volume.as_slice() {
            [] => refuse_without_file(&reading, "--volume")?,
            [_, other, ..] if self.0.random_scenes.is_none() => {
                let message = format!("--volume: expected one file, found also {}", other.display());
                return Err(Failure::Command(message));
            }
            files => files
                .iter()
                .filter(|file| is_container(file))
                .try_for_each(|file| refuse_for_container(&reading, file))?,
        }
        Ok(reading)
    }

    /// The container itself, or one built of a volume file.
    fn container(&self, file: &Path, context: &Context<'_>) -> Result<PathBuf, Failure> {
        if is_container(file) { Ok(file.into()) } else { built(file, &self.reading()?, context.folder) }
    }

    fn subject(&self, context: &Context<'_>) -> Result<Subject, Failure> {
        if let Some(edge) = self.0.virtual_edge {
            return Ok(Subject::Virtual(field_of(self.0.field), edge));
        }
        let Some(file) = self.0.volume.first() else { return Ok(Subject::Scenes(self.0.scene.clone())) };
        let path = self.container(file, context)?;
        let container = Container::open(&path).map_err(|e| with_container(&path, e))?;
        // Measured pictures show the container as it is stored, so the scene is completed for that.
        let scene = PlacedVolume::of(Arc::new(container)).complete(&Scene::default()).map_err(Failure::command)?;
        Ok(Subject::Own { container: path, scene: Box::new(scene) })
    }
}

/// A short name of a volume file, without slashes.
fn name_of(file: &Path) -> String {
    file.file_stem().map_or("volume".into(), |stem| stem.to_string_lossy().into_owned())
}

/// A container of a volume file, in this folder.
fn built(file: &Path, reading: &Reading, folder: &Path) -> Result<PathBuf, Failure> {
    let (source, origin) = open(reading, file, folder)?;
    let name = name_of(file);
    let path = folder.join(format!("{name}.svol"));
    announce(&format!("building {name}, {}", source.info().dims));
    let options = BuildOptions { existing: Existing::Replace, ..BuildOptions::default() };
    let reporter = Reporter::over_bytes(Format::Text);
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

/// A built-in path, or one from a file.
fn camera_path(name: &str) -> Result<CameraPath, Failure> {
    if let Some(path) = paths::built_in(name) {
        return Ok(path?);
    }
    let known = paths::BUILT_IN.map(|(known, _)| known).join(", ");
    let text = read_text(Path::new(name), &format!("{known} or a camera path, --path"))?;
    CameraPath::from_json(&text).map_err(|e| Failure::Command(format!("{name}: {e}")))
}

/// Default folder of the Python environments. Deleting it loses no results.
fn cached_environment() -> Option<PathBuf> {
    let of = |variable: &str| std::env::var_os(variable).map(PathBuf::from).filter(|path| path.is_absolute());
    let cache = of("XDG_CACHE_HOME").or_else(|| of("LOCALAPPDATA")).or_else(|| of("HOME").map(|h| h.join(".cache")))?;
    let package = vtk::PACKAGE;
    Some(cache.join("supervol").join("peers").join(format!("{}-{}", package.name, package.version)))
}

/// Options that name files of this machine and do not affect the measurement.
const PLACES: [&str; 5] = ["-o", "--output", "--record", "--environment", "--python"];

/// Command line for the record: without paths of this machine, files by their names.
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

/// The complete command line.
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
