//! `supervol verify`: checks every rule of a container, or proves pictures of one ([`prove`](mod@crate::prove)).

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use supervol::{CHECK_SEED, ProofOptions, Volume};
use supervol_arguments::failure::{Failure, with_container, with_output};
use supervol_arguments::input::{Input, for_each};
use supervol_arguments::progress::Reporter;
use supervol_arguments::quantity::{self, show_bytes};
use supervol_arguments::source::{SourceArguments, refuse_without_file};
use supervol_format::Container;
use supervol_format::readable::counted;
use supervol_preprocess::BuildError;
use supervol_preprocess::compare::{Compared, compare};
use supervol_preprocess::kept::Reading;
use supervol_scene::image::read::is_picture;

use crate::prove;

/// Containers to check, and their source; or pictures to prove, and their container.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Containers to check, - is standard input; or pictures to prove, with --container
    ///
    /// After a file that breaks a rule, the others are still checked.
    #[arg(value_name = "CONTAINER|PICTURE", required = true)]
    containers: Vec<PathBuf>,
    /// Prove pictures of this container: cast pixels again with the reference integrator, and compare
    ///
    /// A picture is proved by the record that `render` writes into it. The container must have the recorded checksum,
    /// and pixels must be within the requested and the stated error. The first wrong pixels are printed. The finest
    /// level must fit into --memory, with 8 bytes a voxel.
    #[arg(long, value_name = "FILE", conflicts_with = "compare_with")]
    container: Option<PathBuf>,
    /// Number of random pixels of a picture to cast again, with all their rays; or `all`
    #[arg(long, value_name = "N", default_value = "1000", requires = "container", value_parser = prove::pixels)]
    rays: u64,
    /// Seed of the choice of these pixels
    #[arg(long, value_name = "S", default_value_t = CHECK_SEED, requires = "container")]
    seed: u64,
    /// Folder with the meshes that the picture's scene names [default: the folders of picture and container]
    #[arg(long, value_name = "FOLDER", requires = "container")]
    files: Option<PathBuf>,
    /// Also compare every voxel of level 0 with the file or folder that the container was built from
    ///
    /// The voxels of an exact container must be equal. Other voxels must lie within the error bound. Give the options
    /// of the build (--dims, --frame and so on) again.
    #[arg(long = "source", value_name = "FILE")]
    compare_with: Option<PathBuf>,
    /// Recompute all derived data from the decoded voxels; `verify` always does this, with or without --deep
    ///
    /// Derived data are ranges, flags, macro cells, aprons, coarser levels, error bounds and the statistics of the
    /// manifest. Only --source adds a check.
    #[arg(long)]
    deep: bool,
    /// Memory limit, for example 4GiB
    #[arg(long, default_value = "512MiB", value_parser = quantity::bytes)]
    memory: u64,
    #[command(flatten)]
    source: SourceArguments,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    // `deep` is ignored on purpose: `verify` always checks everything.
    let Arguments { containers, compare_with, deep: _, memory, source, .. } = arguments;
    let reading = source.reading(*memory)?;
    if let Some(container) = &arguments.container {
        refuse_without_file(&reading, "--source")?;
        return prove_pictures(arguments, container);
    }
    if let Some(picture) = containers.iter().find(|path| is_picture(path)) {
        let path = picture.display();
        return Err(Failure::Command(format!(
            "{path}: a picture is verified against its container; give --container FILE"
        )));
    }
    let Some(input) = compare_with else {
        refuse_without_file(&reading, "--source")?;
        return for_each(containers, |path| verify(path, *memory).map(drop));
    };
    let [path] = &containers[..] else {
        let found = containers.len();
        return Err(Failure::Command(format!("--source: expected one container to compare, found {found}")));
    };
    let container = verify(path, *memory)?;
    compare_with_source(path, &container, input, &reading, *memory)
}

/// Proves pictures of a container.
fn prove_pictures(arguments: &Arguments, path: &Path) -> Result<(), Failure> {
    let Arguments { containers: pictures, rays, seed, files, memory, .. } = arguments;
    let volume = Volume::of(Container::open(path).map_err(|error| with_container(path, error))?);
    let options = ProofOptions { pixels: *rays, seed: *seed, host_memory_bytes: *memory, ..ProofOptions::default() };
    for_each(pictures, |picture| prove::prove(picture, &volume, &options, files.as_deref()))
}

/// Compares a container with its source. Compressed voxels are decoded into a temporary file.
fn compare_with_source(
    path: &Path,
    container: &Container,
    input: &Path,
    reading: &Reading,
    memory_bytes: u64,
) -> Result<(), Failure> {
    let folder = std::env::temp_dir();
    let source = reading.open(input, &folder).map_err(BuildError::from)?;
    let bar = Reporter::over_bricks();
    let compared = compare(path, container, source.as_ref(), memory_bytes, &|done, total| {
        bar.set_length(total);
        bar.set_position(done);
    });
    bar.finish_and_clear();
    let Compared { voxels, greatest, bound } = compared?;
    let differ = if bound > 0.0 {
        format!("at most {greatest} from the source's ({bound} allowed)")
    } else {
        "equal to the source's".into()
    };
    let remark = format!("{}: {voxels} voxels of level 0 are {differ}", path.display());
    writeln!(supervol_arguments::terminal::remarks(), "{remark}").map_err(with_output)
}

/// Checks a container against every rule that needs no source.
fn verify(path: &Path, memory_bytes: u64) -> Result<Container, Failure> {
    let input = Input::named(path)?;
    let bar = Reporter::over_bricks();
    let result = supervol_preprocess::verify::verify(input.path(), memory_bytes, &|done, total| {
        bar.set_length(total);
        bar.set_position(done);
    });
    bar.finish_and_clear();
    let container = result.map_err(|error| match error {
        BuildError::Container { path, source } => with_container(&path, source),
        other => other.into(),
    })?;
    writeln!(
        supervol_arguments::terminal::remarks(),
        "{}: whole; {}, {}, every rule holds",
        path.display(),
        counted(container.pyramid().brick_count(), "brick"),
        show_bytes(container.file_bytes())
    )
    .map_err(with_output)?;
    Ok(container)
}
