//! `supervol demo`: builds two containers and renders two pictures, as a test of a new installation. It needs no
//! driver.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use supervol::{Backend, Options, Volume};
use supervol_arguments::failure::{Failure, with_container, with_output};
use supervol_arguments::output::{Force, PictureFile};
use supervol_arguments::quantity::show_bytes;
use supervol_arguments::sample::CARP;
use supervol_files::OutputFile;
use supervol_format::container::manifest::Source;
use supervol_format::{Container, Dims};
use supervol_preprocess::{BuildError, BuildOptions, Existing};
use supervol_scene::scene::Scene;
use supervol_sources::VolumeSource;
use supervol_sources::formats::nifti::NiftiSource;
use supervol_sources::input::spool::SpoolFolder;
use supervol_sources::synthetic::Synthetic;

use crate::picture;
use crate::written::{PictureOutputs, Subject};

const CARP_SCENE: &str = include_str!("../scenes/carp.json");
const SEISMIC_SCENE: &str = include_str!("../scenes/seismic.json");
/// Crosslines, inlines and samples of the synthetic survey.
const SURVEY_DIMS: Dims = Dims([256, 256, 320]);
/// Memory limit of each build, bytes.
const BUILD_MEMORY_BYTES: u64 = 128 << 20;
/// Memory limit of each picture, bytes.
const RENDER_MEMORY_BYTES: u64 = 128 << 20;

/// Folder of the demo.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Folder for containers and pictures; it is created if it does not exist
    #[arg(short, long, default_value = "demo-output")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let folder = &arguments.output;
    let cannot_write = |path: &Path, e| Failure::Machine(format!("cannot write {}: {e}", path.display()));
    std::fs::create_dir_all(folder).map_err(|e| cannot_write(folder, e))?;

    say(format_args!("A real volume: computed tomography of a carp (M. Scheuring, University of Erlangen)."))?;
    let sample = folder.join("carp_ct.nii.gz");
    if std::fs::read(&sample).ok().as_deref() != Some(CARP) {
        let file = OutputFile::begin(&sample, arguments.force.or(Existing::Keep))?;
        file.file().write_all(CARP).map_err(|e| cannot_write(&sample, e))?;
        file.publish()?;
    }
    let carp = NiftiSource::open(&sample, &SpoolFolder::at(folder)).map_err(BuildError::from)?;
    let origin = supervol_preprocess::identify(&sample, carp.info().format)?;
    show(&carp, origin, &folder.join("carp"), CARP_SCENE, arguments.force)?;

    say(format_args!("\nA synthetic seismic survey: layers, folds, faults, channels, seed 1."))?;
    let seismic = Synthetic::new("seismic", SURVEY_DIMS, None, 1).map_err(BuildError::from)?;
    let origin = Source::computed("seismic seed 1");
    show(&seismic, origin, &folder.join("seismic"), SEISMIC_SCENE, arguments.force)
}

/// Builds `STEM.svol` and renders `STEM.png`.
fn show(source: &dyn VolumeSource, origin: Source, stem: &Path, scene: &str, force: Force) -> Result<(), Failure> {
    let (container_path, image_path) = (stem.with_extension("svol"), stem.with_extension("png"));
    // Files of an earlier demo may be overwritten; a container of that name with another volume may not.
    let is_ours = Container::open(&container_path).is_ok_and(|found| found.manifest().source == origin);
    let existing = force.or(if is_ours { Existing::Replace } else { Existing::Keep });
    let image = PictureFile::begin(&image_path, force)?;
    let options = BuildOptions { memory_bytes: BUILD_MEMORY_BYTES, existing, ..BuildOptions::default() };
    let report = supervol_preprocess::build(source, origin, &container_path, &options, &|_| ())?;
    say(format_args!(
        "  {}: {} from {} of voxels, {} bricks in {} levels, {:.1} s, at most {} of memory",
        container_path.display(),
        show_bytes(report.container_bytes),
        show_bytes(report.source_bytes),
        report.bricks,
        report.levels.len(),
        report.wall_ms / 1e3,
        show_bytes(report.memory_budget_bytes),
    ))?;

    let started = Instant::now();
    let volume = Volume::of(Container::open(&container_path).map_err(|e| with_container(&container_path, e))?);
    let scene = Scene::from_json(scene).map_err(Failure::command)?;
    let options = Options { backend: Backend::Cpu, host_memory_bytes: RENDER_MEMORY_BYTES, ..Options::default() };
    let subject = Subject { volume: &volume, scene: &scene, decorate: false };
    let outputs = PictureOutputs { picture: image, maps: [None, None], fidelity: None, record: None };
    let stats = picture::draw(&subject, outputs, (&options, Instant::now()), None)?;
    say(format_args!(
        "  {}: {} x {}, {} bricks ({}) read, {:.1} s, at most {} of memory for bricks and rays, peak of the process {}",
        image_path.display(),
        stats.image_width,
        stats.image_height,
        stats.streaming.page_ins,
        show_bytes(stats.streaming.bytes_read),
        started.elapsed().as_secs_f64(),
        show_bytes(stats.host_budget_bytes),
        show_bytes(stats.peak_rss_bytes),
    ))
}

fn say(line: std::fmt::Arguments<'_>) -> Result<(), Failure> {
    writeln!(supervol_arguments::terminal::stdout(), "{line}").map_err(with_output)
}
